"""The command `suslov-fast`."""

from __future__ import annotations

import os
import signal
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any, NoReturn

from .flags import CLOSED_PIPE, COMMANDS, FAILURE, INTERRUPTED, CommandError, parse


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command and exit with its status; errors are one line on stderr."""
    _stop_like_ctrl_c("SIGTERM", "SIGHUP")
    with warnings.catch_warnings():
        warnings.showwarning = _print_warning
        _run(sys.argv[1:] if arguments is None else arguments)


def _run(arguments: Sequence[str]) -> NoReturn:
    try:
        try:
            options = parse(arguments)
        finally:  # a help text that cannot be written is an error of the output, too
            print(end="", flush=True)
        # Imported here: the modules import Numba, which would delay `--help`.
        module, function = COMMANDS[options.command].function.split(".")
        if text := getattr(import_module(f".{module}", __package__), function)(options):
            print(text, flush=True)
    except CommandError as error:
        _fail(error.status, str(error))
    except (ImportError, MemoryError, Warning) as error:
        _fail(FAILURE, str(error) or "not enough memory")
    except KeyboardInterrupt as error:
        _fail(INTERRUPTED, str(error) or "interrupted")
    except OSError as error:  # of the output: those of other files are CommandErrors
        # Otherwise Python would try to write the rest at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            sys.exit(CLOSED_PIPE)
        _fail(FAILURE, f"standard output: {error.strerror or error}")
    sys.exit(0)


def _print_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    print("suslov-fast: warning:", *str(message).split(), file=sys.stderr)


def _stop_like_ctrl_c(*names: str) -> None:
    """Let signals raise KeyboardInterrupt, except those that are ignored, as under nohup."""
    for name in names:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            with suppress(ValueError):  # only the main thread can set signal handlers
                signal.signal(number, signal.default_int_handler)


def _fail(status: int, message: str) -> NoReturn:
    print("suslov-fast:", " ".join(message.split()), file=sys.stderr)
    sys.exit(status)
