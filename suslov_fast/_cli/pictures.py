"""`suslov-fast pictures`, the paper's four and four more, and `suslov-fast animate`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from .. import _plots
from .._bodies.paper import PICTURES
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
    """Add the commands to a parser."""
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
    add("--dpi", type=_positive, default=160, metavar="N", help="dots per inch of png (160)")
    add("--letters", action="store_true", help="write the letters of panels, (a), (b) ...")

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
    add("--steps", type=_positive, default=440, metavar="N", help="steps of 0.05 (440)")
    add("--dpi", type=_positive, default=100, metavar="N", help="dots per inch (100)")


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"expected an integer of at least 1, got {text}")
    return number


def _check_matplotlib(command: str) -> None:
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise UserError(
            f"{command}: expected matplotlib, got none; pip install 'suslov_fast[plots]'"
        ) from error


def pictures(options: argparse.Namespace) -> None:
    """Carry out the command `pictures`."""
    _check_matplotlib("pictures")
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


def animate(options: argparse.Namespace) -> None:
    """Carry out the command `animate`."""
    _check_matplotlib("animate")
    from matplotlib.animation import FFMpegWriter, PillowWriter

    writers: dict[str, Any] = {".gif": PillowWriter, ".mp4": FFMpegWriter}
    suffix = options.file.suffix.lower()
    if suffix not in writers:
        raise UserError(f"{options.file}: expected a name that ends in .gif or .mp4, got {suffix}")
    if not writers[suffix].isAvailable():
        raise UserError(f"{options.file}: expected ffmpeg to write it with, got none; use .gif")
    try:
        animation = _plots.animate_body(PICTURES[options.picture].body, steps=options.steps)
    except ValueError as error:
        raise UserError(f"--picture {options.picture}: {error}") from error
    try:
        animation.save(str(options.file), writer=writers[suffix](fps=25), dpi=options.dpi)
    except OSError as error:
        raise UserError(
            f"{options.file}: expected a file that can be written, got: {error.strerror}"
        ) from error
    print(options.file)
