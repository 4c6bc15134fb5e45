"""Matplotlib figures, imported when they are drawn (extra `plots`)."""

from __future__ import annotations

from typing import Any


def new_figure(size: tuple[float, float]) -> Any:
    """A figure of so many inches that no window shows."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError("plots need matplotlib: pip install 'suslov_fast[plots]'") from error
    return Figure(figsize=size, layout="constrained")


def axes_or_new(axes: Any, size: tuple[float, float]) -> Any:
    """The axes that are given, or those of a new figure."""
    return new_figure(size).add_subplot() if axes is None else axes
