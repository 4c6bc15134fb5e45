"""The command `suslov-fast`."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from types import FrameType
from typing import Any, NoReturn

from .options import COMMANDS, FAILURE, INTERRUPTED, CommandError, parse
from .work import interrupt


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command and exit.

    The status is 0; 2 for a command line that makes no sense and 1 for other failures, with one
    line on stderr; 130 after a signal.
    """
    _prepare_streams()
    words = sys.argv[1:] if arguments is None else arguments
    try:
        try:
            # Imports take longer than many a run. An exception could be dropped in a callback of
            # what is being imported.
            with _signals(_exit_at_once):
                options = parse(words)
                module = import_module(f".{COMMANDS[options.command].module}", __package__)
                function = getattr(module, options.command.replace("-", "_"))
            with _signals(interrupt):
                text = function(options)
            if text:
                print(text)
        finally:
            sys.stdout.flush()
    except CommandError as error:
        _stop(error.status, str(error))
    except (ImportError, MemoryError) as error:
        _stop(FAILURE, str(error) or "expected more memory")
    except KeyboardInterrupt as error:
        _stop(INTERRUPTED, str(error) or "interrupted")
    except OSError as error:
        if error.filename is not None:
            _stop(FAILURE, f"{error.filename}: {error.strerror or error}")
        # Other files have a name: this is the output. Python could not write the rest of it at
        # exit either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            sys.exit(FAILURE)
        _stop(FAILURE, f"standard output: {error.strerror or error}")
    sys.exit(0)


@contextmanager
def _signals(handler: Any) -> Iterator[None]:
    """Give all requests to stop to a handler, but for those that are ignored, as under nohup."""
    before = {}
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, handler)
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)


def _exit_at_once(number: int, frame: FrameType | None) -> NoReturn:
    sys.stderr.write("suslov-fast: interrupted\n")
    sys.stderr.flush()
    os._exit(INTERRUPTED)


def _prepare_streams() -> None:
    """Make sure that there are streams to write to, and that they take every name of a file."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by the parent process
            stream = open(os.devnull, "w")  # noqa: SIM115
            setattr(sys, name, stream)
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def _stop(status: int, message: str) -> NoReturn:
    print("suslov-fast: " + " ".join(message.split()), file=sys.stderr)
    sys.exit(status)
