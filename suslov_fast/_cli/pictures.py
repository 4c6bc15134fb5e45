"""`suslov-fast pictures`: draw the paper's four pictures, and three of what follows."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .errors import UserError
from .files import written_whole


def add_to(commands: Any) -> None:
    """Add the command to a parser."""
    parser = commands.add_parser(
        "pictures",
        help="draw the paper's four pictures, and three more",
        description=(
            "Draw the four pictures of the paper as DIR/picture1.png ... picture4.png, an orbit in "
            "each regime with its closed form as regimes.png, the order of the map as "
            "convergence.png, and motion for n = 4 as four_dimensions.png."
        ),
    )
    parser.set_defaults(command=pictures)
    parser.add_argument(
        "-o", dest="folder", type=Path, default=Path(), metavar="DIR", help="(this folder)"
    )


def pictures(options: argparse.Namespace) -> None:
    """Carry out the command."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise UserError(
            "pictures: expected matplotlib, got none; pip install 'suslov_fast[plots]'"
        ) from error
    from .drawings import DRAWINGS

    try:
        options.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(
            f"{options.folder}: expected a folder or a name for one, got: {error.strerror}"
        ) from error
    for name, draw in DRAWINGS.items():
        path = options.folder / f"{name}.png"
        with written_whole(path) as file:
            draw().savefig(file, format="png", dpi=160)
        print(path)
