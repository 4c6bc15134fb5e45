"""The command `suslov-fast`."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Sequence
from typing import NoReturn

from .. import __version__
from . import pictures, run
from .errors import UserError


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UserError(message)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command and exit: with 0, with 2 and one line if the user erred, 130 on a signal."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by whoever started this process
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name) and threading.current_thread() is threading.main_thread():
            signal.signal(getattr(signal, name), signal.default_int_handler)
    try:
        try:
            options = _parser().parse_args(_with_numbers_joined(arguments))
            options.command(options)
        finally:
            sys.stdout.flush()
    except UserError as error:
        _stop(2, str(error))
    except KeyboardInterrupt:
        _stop(130, "interrupted")
    except OSError as error:
        # Files are dealt with where they are opened: this is the output. What is left of it cannot
        # be written when Python ends either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            sys.exit(1)
        _stop(2, f"standard output: {error.strerror}")
    sys.exit(0)


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
    commands = parser.add_subparsers(metavar="{run,pictures,animate}", required=True)
    run.add_to(commands)
    pictures.add_to(commands)
    return parser
