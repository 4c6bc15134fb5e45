"""`suslov-fast info`: what a saved run is and what came of it."""

from __future__ import annotations

import argparse
from typing import Any

from . import ensemble
from .errors import UserError
from .files import load, result_file
from .summary import as_json, as_text, facts_of, outcome_of


def add_to(commands: Any) -> None:
    """Add the command to a parser."""
    parser = commands.add_parser(
        "info",
        help="print what a saved run is and what came of it",
        description=(
            "Print what a file of `suslov-fast run -o` or Trajectories.save holds. The drift is "
            "that since state 0, where it was saved."
        ),
    )
    parser.set_defaults(command=info)
    parser.add_argument("file", type=result_file, metavar="FILE", help="a .npz, .nc or .zarr")
    parser.add_argument("--json", action="store_true", help="print one JSON object, for programs")


def info(options: argparse.Namespace) -> str:
    """Carry out the command, and return what it found."""
    if ensemble.is_ensemble(options.file):
        return ensemble.info(options.file, options.json)
    try:
        trajectories = load(options.file)
        start = trajectories.omega[0] if trajectories.n[0] == 0 else None
        facts = {**facts_of(trajectories), **outcome_of(trajectories, start)}
    except MemoryError as error:
        raise UserError(
            f"{options.file}: expected a run that fits in memory, got: {error}"
        ) from error
    return as_json(facts) if options.json else as_text(facts)
