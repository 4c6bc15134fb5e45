"""Axes and colours of all pictures. Importing this module imports Matplotlib (extra `plots`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..checks import wrong

try:
    import matplotlib.pyplot as plt
    from matplotlib import colormaps
    from matplotlib.axes import Axes
    from matplotlib.colors import ListedColormap
except ImportError as error:
    install = "pip install '.[plots]' in a copy of the repository"
    raise ImportError(f"plots need matplotlib: {install}") from error

__all__ = ["COLOURS", "axes_for", "plt", "set_title"]
# Without the lightest colours, which are faint on white.
COLOURS = ListedColormap(colormaps["viridis"](np.linspace(0.05, 0.9, 256)))


def axes_for(ax: Any, size: tuple[float, float]) -> Any:
    """Return the plane axes passed, checked, or those of a new figure of a size in inches.

    pyplot knows the new figure, so that notebooks and `plt.show()` show it.
    """
    if ax is None:
        return plt.figure(figsize=size, layout="constrained").add_subplot()
    if not isinstance(ax, Axes) or ax.name == "3d":
        raise wrong("ax", "plane axes of Matplotlib", repr(ax), TypeError)
    return ax


def set_title(axes: Any, title: str) -> None:
    """Set a title in small letters, unless the axes have one."""
    if not axes.get_title():
        axes.set_title(title, fontsize="small")
