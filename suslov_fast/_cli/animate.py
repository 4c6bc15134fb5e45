"""`suslov-fast animate`: draw a moving body in space."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from .._bodies.paper import PICTURES
from .._show.plots import animate_body
from .errors import UserError
from .pictures import at_least_one, check_matplotlib


def add_to(commands: Any) -> None:
    """Add the command to a parser."""
    parser = commands.add_parser(
        "animate",
        help="draw a moving body in space",
        description=(
            "Draw the ellipsoid of inertia of a body of the paper, its axes e1 and e2, and the "
            "path of the axis a about which it does not turn, from one steady rotation to the "
            "other. FILE ends in .gif, or in .mp4 where ffmpeg is installed."
        ),
    )
    parser.set_defaults(command=animate)
    add = partial(parser.add_argument)
    add("-o", dest="file", type=Path, required=True, metavar="FILE", help="where to write it")
    add("--picture", type=int, choices=tuple(PICTURES), default=2, help="whose body (2)")
    add("--steps", type=at_least_one, default=440, metavar="N", help="steps of 0.05 (440)")
    add("--dpi", type=at_least_one, default=100, metavar="N", help="dots per inch (100)")


def animate(options: argparse.Namespace) -> None:
    """Carry out the command."""
    check_matplotlib("animate")
    from matplotlib.animation import FFMpegWriter, PillowWriter

    writers: dict[str, Any] = {".gif": PillowWriter, ".mp4": FFMpegWriter}
    suffix = options.file.suffix.lower()
    if suffix not in writers:
        raise UserError(f"{options.file}: expected a name that ends in .gif or .mp4, got {suffix}")
    if not writers[suffix].isAvailable():
        raise UserError(f"{options.file}: expected ffmpeg to write it with, got none; use .gif")
    try:
        animation = animate_body(PICTURES[options.picture].body, steps=options.steps)
    except ValueError as error:
        raise UserError(f"--picture {options.picture}: {error}") from error
    try:
        animation.save(str(options.file), writer=writers[suffix](fps=25), dpi=options.dpi)
    except OSError as error:
        raise UserError(
            f"{options.file}: expected a file that can be written, got: {error.strerror}"
        ) from error
    print(options.file)
