"""The command `suslov-fast`."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from .. import __version__
from . import pictures, run
from .errors import UserError


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UserError(message)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command and exit: with 0, with 2 and one line if the user erred, 130 on Ctrl-C."""
    try:
        options = _parser().parse_args(arguments)
        options.command(options)
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


def _stop(status: int, message: str) -> NoReturn:
    print("suslov-fast: " + " ".join(message.split()), file=sys.stderr)
    sys.exit(status)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="suslov-fast",
        description="The Hirota-Kimura discretization of the nonholonomic Suslov problem.",
    )
    parser.add_argument("--version", action="version", version=f"suslov-fast {__version__}")
    commands = parser.add_subparsers(metavar="{run,pictures}", required=True)
    run.add_to(commands)
    pictures.add_to(commands)
    return parser
