"""Axes and panel letters of all pictures, and orbits in a plane."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._checks import FloatArray


def axes_for(ax: Any, size: tuple[float, float], letter: str | None = None) -> Any:
    """Return the plane axes passed, checked, or those of a new figure.

    The figure, with width and height in inches, is not shown in a window. The letter is above the
    panel, outside data and legends.
    """
    from matplotlib.axes import Axes

    from .styled_figure import StyledFigure

    if ax is None:
        ax = StyledFigure(figsize=size, layout="constrained").add_subplot()
    elif not isinstance(ax, Axes) or ax.name == "3d":
        raise TypeError(f"ax: expected plane axes of Matplotlib, got {ax!r}")
    if letter:
        ax.set_title(f"({letter})", loc="left", weight="bold", fontsize="medium")
    return ax


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
