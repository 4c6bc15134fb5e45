"""`suslov-fast pictures`: draw the paper's four pictures."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from .._bodies import Suslov3D
from .._conserved import criticality, energy
from .._coordinates import from_xy, to_xy
from .._map import iterate
from .._paper import PICTURES, Picture
from .._validation import FloatArray
from .errors import UserError
from .files import written_whole

_LEVELS = 9
# Orbits start and end at this angle from the line, seen where levels of the energy are circles.
_NEAR = 0.03


def add_to(commands: Any) -> None:
    """Add the command to a parser."""
    parser = commands.add_parser(
        "pictures",
        help="draw the paper's four pictures",
        description="Draw the four pictures of the paper as DIR/picture1.png ... picture4.png.",
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
    try:
        options.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(
            f"{options.folder}: expected a folder or a name for one, got: {error.strerror}"
        ) from error
    for number, picture in PICTURES.items():
        path = options.folder / f"picture{number}.png"
        with written_whole(path) as file:
            _draw(number, picture).savefig(file, format="png", dpi=160)
        print(path)


def _orbits(picture: Picture) -> list[FloatArray]:
    """Orbits from one end of the line to the other on either side of it, innermost first."""
    body, eps, extent = picture.body, picture.eps, picture.extent
    # Energies from the middle to the corners, as lengths along the line.
    farthest = np.sqrt(energy(body, [extent, extent]) / energy(body, _line(body)))
    orbits: list[FloatArray] = []
    for level in farthest * np.arange(1, _LEVELS + 1) / (_LEVELS + 1):
        _, y_end = to_xy(body, level * _line(body))
        y = y_end * np.cos(_NEAR)
        x = y_end * np.sin(_NEAR) / np.sqrt(body.I1 * body.I2) * np.array([-1.0, 1.0])
        starts = from_xy(body, np.stack([x, [y, y]], axis=-1))
        t = criticality(body, starts[0], eps)
        steps = int(np.ceil(np.arctanh(np.cos(_NEAR)) / np.arctanh(t)))
        orbits.extend(iterate(body, starts, eps, steps).omega)
    return orbits


def _line(body: Suslov3D) -> FloatArray:
    """The direction of the repelling half of the line of steady states."""
    direction: FloatArray = np.array([body.I23, -body.I13]) / np.hypot(body.I13, body.I23)
    return direction


def _steps_shown(orbit: FloatArray, extent: float) -> FloatArray:
    """The steps (from, to) that lie within the picture, those in the middle of the orbit first."""
    inside = np.asarray((abs(orbit) < 0.97 * extent).all(axis=-1))
    steps = np.flatnonzero(inside[:-1] & inside[1:])
    steps = steps[np.argsort(abs(steps - len(orbit) // 2))]
    return np.stack([orbit[steps], orbit[steps + 1]], axis=1)


def _draw(number: int, picture: Picture) -> Any:
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    body, eps, extent = picture.body, picture.eps, picture.extent
    figure = Figure(figsize=(6.4, 6.8), layout="constrained")
    axes: Any = figure.add_subplot()
    colours = colormaps["viridis"](np.linspace(0.15, 0.85, _LEVELS))
    for k, orbit in enumerate(_orbits(picture)):
        colour = colours[k // 2]
        axes.plot(*orbit.T, "-", color=colour, linewidth=0.7, alpha=0.6)
        axes.plot(*orbit.T, ".", color=colour, markersize=4.5, markeredgewidth=0)
        for tail, head in _steps_shown(orbit, extent)[:1]:
            arrow = {"arrowstyle": "-|>", "color": colour, "mutation_scale": 13}
            axes.annotate("", xy=head, xytext=tail, arrowprops=arrow)
    repelling, attracting = (np.outer([0, s * extent], _line(body)) for s in (2.0, -2.0))
    line = r"$I_{13}\,\Omega_1 + I_{23}\,\Omega_2 = 0$"
    style = {"color": "crimson", "linewidth": 2.6}
    axes.plot(*attracting.T, label=f"{line}, attracting", **style)
    axes.plot(*repelling.T, label=f"{line}, repelling", linestyle=(0, (4, 2)), **style)
    axes.set(
        xlim=(-extent, extent),
        ylim=(-extent, extent),
        aspect="equal",
        xlabel=r"$\Omega_1$",
        ylabel=r"$\Omega_2$",
    )
    axes.set_title(
        f"Picture {number}\n"
        rf"$\epsilon = {eps:g},\ I_1 = {body.I1:g},\ I_2 = {body.I2:g},\ "
        rf"I_{{13}} = {body.I13:g},\ I_{{23}} = {body.I23:g}$"
    )
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure
