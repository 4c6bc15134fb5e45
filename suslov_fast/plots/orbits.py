"""Pictures of runs, and axes and colours of all pictures. Imports Matplotlib (extra `plots`)."""

import math
from typing import Any

import numpy as np

from ..checks import FloatArray, integer, wrong

try:
    import matplotlib.pyplot as plt
    from matplotlib import colormaps
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap
except ImportError as error:
    install = "pip install '.[plots]' in a copy of the repository"
    raise ImportError(f"plots need matplotlib: {install}") from error

__all__ = ["COLOURS", "axes_for", "plot_run", "plt"]
# Without the lightest colours, which are faint on white.
COLOURS = ListedColormap(colormaps["viridis"](np.linspace(0.05, 0.9, 256)))

# More dots make a picture large and no clearer; on lines, more than a few hide them.
_MOST, _FEW = 20_000, 2000


def axes_for(ax: Any, size: tuple[float, float]) -> Any:
    """Return the plane axes passed, or those of a new figure, which pyplot shows."""
    if ax is None:
        return plt.figure(figsize=size, layout="constrained").add_subplot()
    if not isinstance(ax, Axes) or ax.name == "3d":
        raise wrong("ax", "plane axes of Matplotlib", repr(ax), TypeError)
    return ax


def plot_run(run: Any, components: tuple[int, int], lines: bool | None, ax: Any) -> Any:
    """Draw the saved states of a run, and return the axes; see `Trajectories.plot`."""
    D, symbols = run.body.dimension, run.map.symbols(run.body)
    expected = f"two integers from 0 to {D - 1}"
    pair = [integer("components", k, 0, expected) for k in components]
    if len(pair) != 2 or max(pair) >= D:
        raise wrong("components", expected, components)
    if lines not in (None, True, False):
        raise wrong("lines", "True, False or None", lines)
    plane = run.states[..., pair].reshape(len(run), -1, 2)
    if lines is None:
        lines = plane[..., 0].size <= _MOST and run.n[-1] == len(run) - 1 and _are_near(plane)
    axes = axes_for(ax, (5.4, 5.0))
    levels, label = _levels(run)
    drawn, count = _draw(axes, plane, levels, lines)
    if levels is not None:
        axes.figure.colorbar(drawn, ax=axes, label=label, shrink=0.8)
    axes.set(xlabel=symbols[pair[0]], ylabel=symbols[pair[1]])
    axes.set_title(_title(run, count), fontsize="small")
    return axes


def _are_near(plane: FloatArray) -> bool:
    """True if the median of steps is below 1/20 of the extent of all states (N, B, 2)."""
    lengths = np.hypot(*np.diff(plane, axis=0).T)
    lengths = lengths[~np.isnan(lengths)]
    known = plane[~np.isnan(plane).any(axis=-1)]
    return bool(lengths.size and 20.0 * np.median(lengths) < np.ptp(known, axis=0).max())


def _levels(run: Any) -> tuple[FloatArray | None, str]:
    """The levels (B,) of the orbits, and what they are levels of; None if they have one colour."""
    if name := run.map.conserves(run.body):
        values = run._value(name, run.states[0]).ravel()
        finite = values[np.isfinite(values)]
        if finite.size and np.ptp(finite) > 1e-9 * abs(finite).max():
            return values, f"level of the {name.replace('_', ' ')}"
    return None, ""


def _draw(axes: Any, plane: FloatArray, levels: FloatArray | None, lines: bool) -> tuple[Any, int]:
    """Draw states (N, B, 2), coloured by levels (B,); return what has colours, and how many."""
    look: dict[str, Any] = {"color": COLOURS(0.3)} if levels is None else {"cmap": COLOURS}
    count = plane[..., 0].size
    if lines:
        pen: dict[str, Any] = {"linewidths": 0.7, "joinstyle": "round", "capstyle": "round"}
        drawn = LineCollection(list(np.moveaxis(plane, 1, 0)), array=levels, **pen, **look)
        axes.add_collection(drawn)
    if not lines or count <= _FEW:
        shown = np.arange(count)
        if count > _MOST:  # by chance, as every k-th state may show one of k islands
            shown = np.random.default_rng(0).choice(count, _MOST, replace=False)
            count = _MOST
        if levels is not None:
            look["c"] = levels[shown % len(levels)]
        size = 4.0 if lines else min(max(8000.0 / max(count, 1), 2.0), 14.0)
        drawn = axes.scatter(*plane.reshape(-1, 2)[shown].T, s=size, linewidths=0, **look)
    axes.autoscale_view()
    return drawn, count


def _title(run: Any, count: int) -> str:
    B, N = math.prod(run.states.shape[1:-1]), int(run.n[-1])
    eps = rf", $\epsilon$ = {float(run.eps):g}" if np.ndim(run.eps) == 0 else ""
    orbits = "1 orbit" if B == 1 else f"{B:,} orbits"
    states = f", {count:,} of their states" if count < B * (N + 1) else ""
    return f"{run.map.title}{eps}\n{orbits} of {N:,} steps{states}"
