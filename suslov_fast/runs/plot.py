"""Figures of runs and crossings, and the axes and colours that all figures share.

Imports Matplotlib (extra `plots`).
"""

import math
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies.names import latex
from ..checks import FloatArray, extra, integer, real_array, short, wrong
from ..quantities.evaluation import evaluate
from .datasets import varying

try:
    import matplotlib.pyplot as plt
    from matplotlib import colormaps
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap, Normalize
    from matplotlib.lines import Line2D
except ImportError:
    extra("matplotlib", "plots")  # raises an error that says how to install it
    raise

__all__ = ["COLOURS", "axes_for", "plot_crossings", "plot_run", "plt"]
# Viridis without its lightest colours, which are faint on white.
COLOURS = ListedColormap(colormaps["viridis"](np.linspace(0.05, 0.9, 256)))

# Most dots in a figure, because more make it large and no clearer.
_MOST_DOTS = 20_000
# Most dots on lines, because more hide the lines.
_MOST_ON_LINES = 2000
# Most states joined by lines.
_MOST_JOINED = 100_000
# Where not all states can be drawn: least number of states of an orbit, if it has so many; most
# pieces of an orbit, and least number of states in a piece.
_FEWEST_OF_ORBIT, _PIECES, _SHORTEST = 2000, 10, 500
# Most values of a parameter in a legend; for more there is a colour bar.
_IN_LEGEND = 6


def axes_for(ax: Any, size: tuple[float, float]) -> Any:
    """Return the user's axes, checked, or those of a new figure of pyplot."""
    if ax is None:
        return plt.figure(figsize=size, layout="constrained").add_subplot()
    if not isinstance(ax, Axes) or ax.name == "3d":
        raise wrong("ax", "plane axes of Matplotlib", repr(ax), TypeError)
    return ax


class _Colours(NamedTuple):
    """Numbers to be shown as colours, and their label; without numbers there is one colour."""

    values: FloatArray | None = None
    label: str = ""
    is_parameter: bool = False

    def of(self, index: Any) -> FloatArray | None:
        return None if self.values is None else self.values[index]

    @property
    def norm(self) -> Any:
        return None if self.values is None else Normalize(*_range(self.values))

    def explain(self, axes: Any, drawn: Any) -> None:
        """Add a colour bar, or a legend if a parameter has few values."""
        if self.values is None:
            return
        values = np.unique(self.values[np.isfinite(self.values)])
        if not self.is_parameter or len(values) > _IN_LEGEND:
            axes.figure.colorbar(drawn, ax=axes, label=self.label, shrink=0.8)
            return
        style: Any = {"marker": "s", "markersize": 5, "linestyle": "none"}
        squares = [Line2D([], [], color=COLOURS(self.norm(value)), **style) for value in values]
        axes.legend(squares, [f"{self.label} = {value:g}" for value in values], fontsize="small")


def plot_run(run: Any, components: Any, lines: bool | None, color: Any, ax: Any) -> Any:
    """Draw the saved states of a run, and return the axes; see `Trajectories.plot`."""
    pair = _pair(run, components)
    if lines not in (None, True, False):
        raise wrong("lines", "True, False or None", repr(lines))
    B, is_whole = math.prod(run.status.shape), run.n[-1] == len(run) - 1
    colours = _colours(run, color, run.status.shape)
    if colours.values is None and color is None:
        colours = _levels(run, run.states[0])
    axes = axes_for(ax, (5.4, 5.0))
    states = run.states.reshape(len(run), B, len(run.body._labels))
    pieces, orbits = _pieces(states, pair)
    if lines is None:
        lines = is_whole and _are_near(pieces)
    if not lines:
        pieces, orbits = states[..., pair], np.arange(B)
    drawn, count = _draw(axes, pieces, colours, orbits, lines)
    colours.explain(axes, drawn)
    _label(axes, run, pair)
    N = int(run.n[-1])
    shown = f", {count:,} of their states" if count < B * (N + 1) else ""
    axes.set_title(f"{_title(run)}\n{_orbits(B)} of {N:,} steps{shown}", fontsize="small")
    return axes


def plot_crossings(points: Any, components: Any, color: Any, ax: Any) -> Any:
    """Draw crossings, and return the axes; see `Crossings.plot`."""
    K = len(points)
    pair = _pair(points, _varying(points.states) if components is None else components)
    numbers = {name: getattr(points, name) for name in ("trajectory", "n", "time")}
    colours = _colours(points, color, (K,), numbers)
    if colours.values is None and color is None and np.size(points.eps) == 1:
        colours = _levels(points, points.before)
    axes = axes_for(ax, (5.4, 5.0))
    drawn, count = _dots(axes, points.states[:, pair], colours, np.arange(K))
    colours.explain(axes, drawn)
    _label(axes, points, pair)
    shown = f"{count:,} of {K:,}" if count < K else f"{K:,}"
    title = f"{_title(points)}\n{shown} crossings by {_orbits(points.count.size)}"
    axes.set_title(title, fontsize="small")
    return axes


def _pair(run: Any, components: Any) -> list[int]:
    """Return the indices of two components, given by index or label."""
    labels = [*run.body._labels]
    last = len(labels) - 1
    if last == 0:
        text = f"states have the component {labels[0]} alone: draw it over run.time with Matplotlib"
        raise ValueError(f"components: {text}")
    expected = f"two integers from 0 to {last}, or two of {', '.join(labels)}"
    pair = components if isinstance(components, (tuple, list)) else ()
    if len(pair) != 2 or any(isinstance(k, str) and k not in labels for k in pair):
        raise wrong("components", expected, short(components))
    indices = [labels.index(k) if isinstance(k, str) else k for k in pair]
    return [integer("components", k, 0, expected, last) for k in indices]


def _varying(states: FloatArray) -> list[int]:
    """Return the first two components that vary among states (K, D), or else others."""
    extent = np.ptp(states, axis=0) if len(states) else np.zeros(states.shape[1])
    is_constant = ~(extent > 1e-9 * extent.max())
    return sorted(np.argsort(is_constant, kind="stable")[:2].tolist())


def _colours(
    run: Any, color: Any, shape: tuple[int, ...], of_crossings: dict[str, Any] | None = None
) -> _Colours:
    """Return the colours for `color`: by default those of the first parameter that varies.

    `shape` is that of the batch, or (K,) for crossings. For these, `color` may also be a name in
    `of_crossings`, or have the shape of the batch.
    """
    of_crossings = of_crossings or {}
    parameters = {k: array for k, array in varying(run.body).items() if k not in run.body._axes}
    if np.ndim(run.eps):
        parameters["eps"] = np.asarray(run.eps)
    if color is None:
        color = next((name for name, values in parameters.items() if values.size > 1), None)
        if color is None:
            return _Colours()
    if isinstance(color, str):
        if color not in {*parameters, *of_crossings}:
            known = ", ".join([*parameters, *of_crossings]) or "nothing varies, so pass numbers"
            raise ValueError(f"color: {short(color)} is none of the names here: {known}")
        if color in of_crossings:
            return _Colours(np.asarray(of_crossings[color], float), color)
        values = parameters[color]
        values = run._at_crossings(values) if of_crossings else np.broadcast_to(values, shape)
        return _Colours(values.ravel(), color, is_parameter=True)
    values = real_array("color", color, allow_nan=True)
    if of_crossings and values.shape == run.count.shape != shape:
        values = run._at_crossings(values)
    if values.shape != shape:
        expected = f"have the shape {shape}"
        if of_crossings:
            expected += f", one for each crossing, or {run.count.shape}, for each trajectory"
        raise wrong("color", expected, values.shape)
    return _Colours(values.ravel())


def _levels(run: Any, states: FloatArray) -> _Colours:
    """Return the values of the conserved quantity as colours; one colour if all are equal."""
    name = run.map.conserves(run.body)
    if name and states.size:
        values = evaluate(name, run.body, states, run.eps, map=run.map).ravel()
        finite = values[np.isfinite(values)]
        if finite.size and np.ptp(finite) > 1e-9 * abs(finite).max():
            return _Colours(values, f"level of the {name.replace('_', ' ')}")
    return _Colours()


def _pieces(states: FloatArray, pair: list[int]) -> tuple[FloatArray, NDArray[Any]]:
    """Return at most _MOST_JOINED states as pieces (n, pieces, 2), and the orbit of each piece.

    If orbits (N, B, D) are short, pieces are whole orbits, of which some may be left out; else they
    are spread evenly from the beginning of an orbit to its end.
    """
    N, B, _ = states.shape
    orbits = np.arange(B)
    if N * B > _MOST_JOINED:
        count = min(B, max(_MOST_JOINED // min(N, _FEWEST_OF_ORBIT), 1))
        orbits = np.linspace(0, B - 1, count).round().astype(np.int64)
    of_orbit = min(N, max(_MOST_JOINED // max(len(orbits), 1), 1))
    parts = 1 if of_orbit == N else max(min(_PIECES, of_orbit // _SHORTEST), 1)
    length = of_orbit // parts
    begins = np.linspace(0, N - length, parts).round().astype(np.int64)
    pieces = [states[begin : begin + length, orbits][..., pair] for begin in begins]
    return np.concatenate(pieces, axis=1), np.tile(orbits, parts)


def _are_near(pieces: FloatArray) -> bool:
    """Return whether the median step is below 1/20 of the extent of all states (n, pieces, 2)."""
    lengths = np.hypot(*np.diff(pieces, axis=0).T)
    lengths = lengths[~np.isnan(lengths)]
    existing = pieces[~np.isnan(pieces).any(axis=-1)]
    return bool(lengths.size and 20.0 * np.median(lengths) < np.ptp(existing, axis=0).max())


def _draw(
    axes: Any, pieces: FloatArray, colours: _Colours, orbits: NDArray[Any], lines: bool
) -> tuple[Any, int]:
    """Draw pieces (n, pieces, 2) of orbits; return the coloured artist and the number of states."""
    n, count = len(pieces), pieces[..., 0].size
    drawn = None
    if lines:
        style: dict[str, Any] = {"linewidths": 0.7, "joinstyle": "round", "capstyle": "round"}
        if colours.values is None:
            style["color"] = COLOURS(0.3)
        else:
            style |= {"array": colours.of(orbits), "cmap": COLOURS, "norm": colours.norm}
        drawn = LineCollection(list(np.moveaxis(pieces, 1, 0)), **style)
        axes.add_collection(drawn)
        axes.autoscale_view()  # Matplotlib before 3.11 does not do so itself
    if not lines or count <= _MOST_ON_LINES:
        size = 4.0 if lines else None
        drawn, count = _dots(axes, pieces.reshape(-1, 2), colours, np.tile(orbits, n), size)
    return drawn, count


def _dots(
    axes: Any, points: FloatArray, colours: _Colours, owners: NDArray[Any], size: Any = None
) -> tuple[Any, int]:
    """Draw points (K, 2) in the colours of their owners; return the dots and their number."""
    shown = np.arange(len(points))
    if len(points) > _MOST_DOTS:  # at random, because every k-th state may show one of k islands
        shown = np.random.default_rng(0).choice(len(points), _MOST_DOTS, replace=False)
    if colours.values is None:
        style: dict[str, Any] = {"color": COLOURS(0.3)}
    else:
        style = {"c": colours.of(owners[shown]), "cmap": COLOURS, "norm": colours.norm}
    size = size or min(max(8000.0 / max(len(shown), 1), 2.0), 14.0)
    drawn = axes.scatter(*points[shown].T, s=size, linewidths=0, **style)
    axes.autoscale_view()
    return drawn, len(shown)


def _range(values: FloatArray) -> tuple[float, float]:
    """Return the least and the largest finite value."""
    finite = values[np.isfinite(values)]
    return (finite.min(), finite.max()) if finite.size else (0.0, 1.0)


def _label(axes: Any, run: Any, pair: list[int]) -> None:
    """Label the axes with the names of two components."""
    labels = [_symbol(str(run.body._labels[k])) for k in pair]
    axes.set(xlabel=labels[0], ylabel=labels[1])


def _symbol(label: str) -> str:
    r"""Return `$\Omega_{1}$` for "Omega1"; labels that are no letter with an index stay text."""
    return f"${formula}$" if (formula := latex(label)) else label.replace("$", r"\$")


def _title(run: Any) -> str:
    """Return the title of the map, with the step size if there is one only."""
    eps = rf", $\epsilon$ = {spelled(float(run.eps))}" if np.ndim(run.eps) == 0 else ""
    return f"{run.map.title}{eps}"


def spelled(eps: float) -> str:
    """Return a step size as a user writes it: 0.2, and 1/256 instead of 0.00390625."""
    near, is_short = Fraction(eps).limit_denominator(100_000), float(f"{eps:.3g}") == eps
    is_power_of_2 = 8 <= Fraction(eps).denominator <= 2**20
    is_fraction = float(near) == eps and abs(near.numerator) < 1000
    return str(near) if is_fraction and (is_power_of_2 or not is_short) else f"{eps:g}"


def _orbits(B: int) -> str:
    return "1 orbit" if B == 1 else f"{B:,} orbits"
