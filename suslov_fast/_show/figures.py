"""Axes, style, legends and panel letters of all pictures (extra `plots`)."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np

P = ParamSpec("P")
T = TypeVar("T")


def style() -> AbstractContextManager[None]:
    """Context with the settings of all pictures, which leaves the user's rcParams alone.

    PDF and PostScript get TrueType fonts, as journals ask, and mathematics the font of the text.
    """
    try:
        from matplotlib import rc_context, rcParams, rcParamsDefault
    except ImportError as error:
        raise ImportError("plots need matplotlib: pip install 'suslov_fast[plots]'") from error
    settings: dict[Any, Any] = {"pdf.fonttype": 42, "ps.fonttype": 42}
    fontset = "mathtext.fontset"
    if rcParams["font.family"][0] == "serif" and rcParams[fontset] == rcParamsDefault[fontset]:
        same = rcParams["font.serif"][0] == rcParamsDefault["font.serif"][0]
        settings[fontset] = "dejavuserif" if same else "stix"
    return rc_context(settings)


def styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Let a function draw in the style of all pictures."""

    @wraps(draw)
    def drawn(*arguments: P.args, **keywords: P.kwargs) -> T:
        with style():
            return draw(*arguments, **keywords)

    return drawn


def new_figure(size: tuple[float, float]) -> Any:
    """Return a figure, width and height in inches, that no window shows."""
    from .picture import Picture

    return Picture(figsize=size, layout="constrained")


def axes_for(
    ax: Any, size: tuple[float, float], projections: tuple[str | None, ...] = (None,)
) -> list[Any]:
    """Return the axes passed, checked, or those of a new figure: one for each projection."""
    if ax is None:
        figure, count = new_figure(size), len(projections)
        return [
            figure.add_subplot(1, count, k + 1, projection=projection)
            for k, projection in enumerate(projections)
        ]
    from matplotlib.axes import Axes

    panels = list(np.ravel(np.asarray(ax, dtype=object)))
    if len(panels) != len(projections):
        raise ValueError(f"ax: expected {len(projections)} axes, got {len(panels)}")
    for panel, projection in zip(panels, projections, strict=True):
        if not isinstance(panel, Axes) or (projection == "3d") != (panel.name == "3d"):
            kind = "axes with projection='3d'" if projection else "plane axes of Matplotlib"
            raise TypeError(f"ax: expected {kind}, got {panel!r}")
    return panels


def letter_panels(panels: list[Any], letters: Any) -> None:
    """Write the letters above the panels, where no data and no legend are."""
    for panel, letter in zip(panels, letters or [None] * len(panels), strict=True):
        if letter is not None:
            panel.set_title(f"({letter})", loc="left", weight="bold", fontsize="medium")


def legend_below(axes: Any, columns: int) -> None:
    """Draw the legend below the label of the horizontal axis."""
    axes.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
        borderaxespad=4.2,
        ncols=columns,
        frameon=False,
        fontsize="small",
    )
