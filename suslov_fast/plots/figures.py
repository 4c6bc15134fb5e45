"""Figures and axes in the style of all pictures. Importing this module imports Matplotlib."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from ..checks import wrong
from .style import style

# Without the lightest colours, which are faint on white.
COLOURS = ListedColormap(colormaps["viridis"](np.linspace(0.05, 0.9, 256)))


class StyledFigure(Figure):
    """A figure that is saved in the style it was drawn in."""

    def savefig(self, *arguments: Any, **keywords: Any) -> None:
        """Save the figure, as `matplotlib.figure.Figure.savefig` does."""
        with style():
            super().savefig(*arguments, **keywords)


def axes_for(ax: Any, size: tuple[float, float]) -> Any:
    """Return the plane axes passed, checked, or those of a new figure of a size in inches.

    pyplot knows the new figure, so that notebooks and `plt.show()` show it.
    """
    if ax is None:
        figure = plt.figure(FigureClass=StyledFigure, figsize=size, layout="constrained")
        return figure.add_subplot()
    if not isinstance(ax, Axes) or ax.name == "3d":
        raise wrong("ax", "plane axes of Matplotlib", repr(ax), TypeError)
    return ax


def set_title(axes: Any, title: str) -> None:
    """Set a title in small letters, unless the axes have one."""
    if not axes.get_title():
        axes.set_title(title, fontsize="small")
