"""The command `suslov-fast`."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Sequence
from typing import Any, NoReturn

from .. import __version__
from . import animate, explore, info, pictures, run, warm_up
from .errors import UserError

_COMMANDS = {
    "run": run,
    "info": info,
    "warm-up": warm_up,
    "pictures": pictures,
    "animate": animate,
    "explore": explore,
}


class _Parser(argparse.ArgumentParser):
    def __init__(self, **settings: Any) -> None:
        # A later option must not change what the beginning of a name meant.
        super().__init__(**{"allow_abbrev": False, **settings})

    def error(self, message: str) -> NoReturn:
        raise UserError(message)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command and exit: with 0, with 2 and one line if the user erred, 130 on a signal."""
    _prepare_streams()
    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name) and threading.current_thread() is threading.main_thread():
            signal.signal(getattr(signal, name), signal.default_int_handler)
    try:
        try:
            options = _parser().parse_args(_with_numbers_joined(arguments))
            text = options.command(options)
            if text:
                print(text)
        finally:
            sys.stdout.flush()
    except UserError as error:
        _stop(2, str(error))
    except KeyboardInterrupt as error:
        _stop(130, str(error) or "interrupted")
    except OSError as error:
        if error.filename is not None:
            _stop(2, f"{error.filename}: {error.strerror or error}")
        # Files are dealt with where they are opened: this is the output. What is left of it cannot
        # be written when Python ends either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            sys.exit(1)
        _stop(2, f"standard output: {error.strerror or error}")
    sys.exit(0)


def _prepare_streams() -> None:
    """Make sure that there is something to write to, and that it takes every name of a file."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by whoever started this process
            stream = open(os.devnull, "w")  # noqa: SIM115
            setattr(sys, name, stream)
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def _with_numbers_joined(arguments: Sequence[str] | None) -> list[str]:
    """Write `--eps -1e-3` as `--eps=-1e-3`: argparse takes some negative numbers for options."""
    joined: list[str] = []
    for argument in sys.argv[1:] if arguments is None else arguments:
        if joined and joined[-1].startswith("--") and _is_negative(argument):
            joined[-1] += f"={argument}"
        else:
            joined.append(argument)
    return joined


def _is_negative(text: str) -> bool:
    """Whether a number, or a list of numbers, begins with a minus."""
    try:
        [float(part) for part in text.split(",")]
    except ValueError:
        return False
    return text.startswith("-")


def _stop(status: int, message: str) -> NoReturn:
    print("suslov-fast: " + " ".join(message.split()), file=sys.stderr)
    sys.exit(status)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="suslov-fast",
        description="The Hirota-Kimura discretization of the nonholonomic Suslov problem.",
    )
    parser.add_argument("--version", action="version", version=f"suslov-fast {__version__}")
    commands = parser.add_subparsers(metavar=f"{{{','.join(_COMMANDS)}}}", required=True)
    for command in _COMMANDS.values():
        command.add_to(commands)
    return parser
