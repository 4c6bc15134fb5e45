"""`suslov-fast pictures`: draw the paper's four pictures, and four more."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from .._bodies.paper import PICTURES
from .._show import plots as _plots
from .errors import UserError
from .files import written_whole

FORMATS = ("png", "pdf", "svg")
# Text stays text in vector formats, and the same picture is the same file.
_STYLE = {"pdf.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": "suslov_fast"}


def _picture(number: int, letters: bool) -> Any:
    letter = "abcd"[number - 1] if letters else None
    return _plots.plot_phase(*PICTURES[number], letter=letter)


def _panels(plot: Callable[..., Any], names: str, letters: bool) -> Any:
    return plot(letters=names if letters else None)[0]


# Each takes whether to write the letters of panels, and returns axes.
DRAWINGS: dict[str, Callable[[bool], Any]] = {
    **{f"picture{number}": partial(_picture, number) for number in PICTURES},
    "regimes": partial(_panels, _plots.plot_regimes, "abc"),
    "convergence": lambda letters: _plots.plot_convergence(),
    "four_dimensions": partial(_panels, _plots.plot_four_dimensions, "ab"),
    "scattering": partial(_panels, _plots.plot_scattering, "ab"),
}


def add_to(commands: Any) -> None:
    """Add the command to a parser."""
    parser = commands.add_parser(
        "pictures",
        help="draw the paper's four pictures, and four more",
        description=(
            "Draw the four pictures of the paper as DIR/picture1.png ... picture4.png, an orbit in "
            "each regime with its closed form as regimes.png, the order of the map as "
            "convergence.png, motion for n = 4 as four_dimensions.png, and the scattering angle "
            "as scattering.png."
        ),
    )
    parser.set_defaults(command=pictures)
    add = partial(parser.add_argument)
    add("-o", dest="folder", type=Path, default=Path(), metavar="DIR", help="(this folder)")
    add("--format", choices=FORMATS, default="png", help="of the files (png)")
    add("--dpi", type=at_least_one, default=160, metavar="N", help="dots per inch of png (160)")
    add("--letters", action="store_true", help="write the letters of panels, (a), (b) ...")


def at_least_one(text: str) -> int:
    """Read a positive integer."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"expected an integer of at least 1, got {text}")
    return number


def check_matplotlib(command: str) -> None:
    """Say how to install what a command needs."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise UserError(
            f"{command}: expected matplotlib, got none; pip install 'suslov_fast[plots]'"
        ) from error


def pictures(options: argparse.Namespace) -> None:
    """Carry out the command."""
    check_matplotlib("pictures")
    from matplotlib import rc_context

    try:
        options.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(
            f"{options.folder}: expected a folder or a name for one, got: {error.strerror}"
        ) from error
    for name, draw in DRAWINGS.items():
        path = options.folder / f"{name}.{options.format}"
        with rc_context(_STYLE), written_whole(path) as file:
            figure = draw(options.letters).figure
            date = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
            figure.savefig(
                file, format=options.format, dpi=options.dpi, metadata=date[options.format]
            )
        print(path)
