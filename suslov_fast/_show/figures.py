"""Axes, legends and panel letters of all pictures, and curves around bodies."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._checks import FloatArray, real_number, wrong

# Distance of a legend from the axes, in units of its font size: the label of the axis is between.
_BELOW = 4.2


def positive(name: str, value: Any) -> float:
    """Return a positive number."""
    number = real_number(name, value)
    if not isinstance(number, float) or number <= 0:
        raise wrong(name, "a positive number", value)
    return number


def axes_for(ax: Any, size: tuple[float, float], letter: str | None = None) -> Any:
    """Return the plane axes passed, checked, or those of a new figure.

    The figure, with width and height in inches, is not shown in a window. The letter is above the
    panel, outside data and legends.
    """
    from matplotlib.axes import Axes

    from .picture import Picture

    if ax is None:
        ax = Picture(figsize=size, layout="constrained").add_subplot()
    elif not isinstance(ax, Axes) or ax.name == "3d":
        raise TypeError(f"ax: expected plane axes of Matplotlib, got {ax!r}")
    if letter:
        ax.set_title(f"({letter})", loc="left", weight="bold", fontsize="medium")
    return ax


def legend_below(axes: Any, columns: int) -> None:
    """Draw the legend below the label of the horizontal axis."""
    place = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "borderaxespad": _BELOW}
    axes.legend(**place, ncols=columns, frameon=False, fontsize="small")


def towards_eye(axes: Any) -> FloatArray:
    """Return the unit vector from axes in three dimensions to the eye."""
    elevation, azimuth = np.deg2rad([axes.elev, axes.azim])
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


def plot_around(axes: Any, points: FloatArray, in_front: Any, alpha: float, **look: Any) -> None:
    """Draw a curve (N, 3) around a body at `zorder` 2, the part behind it with `alpha`.

    The part behind ends at the first point of the part in front, so that there is no gap.
    """
    behind = ~in_front
    behind[1:] |= ~in_front[:-1]
    behind[:-1] |= ~in_front[1:]
    for order, shown, opacity in ((1, behind, alpha), (3, in_front, 1.0)):
        part = np.where(shown[:, np.newaxis], points, np.nan)
        axes.plot(*part.T, zorder=order, alpha=opacity, **look)


def plot_orbits(axes: Any, states: FloatArray, components: tuple[int, int]) -> None:
    """Draw orbits, states (N, batch, D), in the plane of two components.

    Colours follow the size of the first state, so that neighbouring orbits look alike; above the
    axes stands which components of how many are shown.
    """
    from matplotlib import colormaps

    size = np.sqrt((states[0] ** 2).sum(axis=-1))
    rank = size.argsort().argsort() / max(1, len(size) - 1)
    colours = colormaps["viridis"](0.05 + 0.85 * rank)
    if len(size):
        axes.set_prop_cycle(color=colours)
    axes.plot(*(states[..., k] for k in components), ".-", markersize=3, linewidth=0.6)
    notes = ["colour: size of the first state"] * (len(size) > 1)
    if states.shape[-1] > 2:
        shown = " and ".join(str(k + 1) for k in components)
        notes.insert(0, f"components {shown} of {states.shape[-1]}")
    axes.set_title("; ".join(notes), fontsize="small")
