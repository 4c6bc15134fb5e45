"""The command `suslov-fast`."""

from __future__ import annotations

import argparse
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
        print("suslov-fast: " + " ".join(str(error).split()), file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("suslov-fast: interrupted", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:
        # Whoever read the summary has gone; nothing more can be printed, at exit either.
        sys.stdout = None  # type: ignore[assignment]
        sys.exit(1)
    sys.exit(0)


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
