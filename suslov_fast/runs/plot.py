"""Pictures of runs and crossings, and axes and colours of all pictures.

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
    extra("matplotlib", "plots")  # raises in the words of all extras
    raise

__all__ = ["COLOURS", "axes_for", "plot_crossings", "plot_run", "plt"]
# Without the lightest colours, which are faint on white.
COLOURS = ListedColormap(colormaps["viridis"](np.linspace(0.05, 0.9, 256)))

# More dots make a picture large and no clearer; on lines, more than a few hide them.
_MOST, _FEW = 20_000, 2000
# States joined by lines; the least of an orbit, in the shortest of at most so many pieces.
_MOST_JOINED, _SHORT, _SHORTEST, _PIECES = 100_000, 2000, 500, 10
# So few values of a parameter have a legend, more a bar.
_IN_LEGEND = 6


def axes_for(ax: Any, size: tuple[float, float]) -> Any:
    """Return the plane axes passed, or those of a new figure, which pyplot shows."""
    if ax is None:
        return plt.figure(figsize=size, layout="constrained").add_subplot()
    if not isinstance(ax, Axes) or ax.name == "3d":
        raise wrong("ax", "plane axes of Matplotlib", repr(ax), TypeError)
    return ax


class _Colours(NamedTuple):
    """Numbers that give colours, and what they are; without numbers all have one colour."""

    values: FloatArray | None = None
    label: str = ""
    is_parameter: bool = False

    def of(self, index: Any) -> FloatArray | None:
        return None if self.values is None else self.values[index]

    @property
    def norm(self) -> Any:
        return None if self.values is None else Normalize(*_range(self.values))

    def explain(self, axes: Any, drawn: Any) -> None:
        """Add a bar to axes, or a legend of a few values of a parameter."""
        if self.values is None:
            return
        few = np.unique(self.values[np.isfinite(self.values)])
        if not self.is_parameter or len(few) > _IN_LEGEND:
            axes.figure.colorbar(drawn, ax=axes, label=self.label, shrink=0.8)
            return
        square: Any = {"marker": "s", "markersize": 5, "linestyle": "none"}
        pens = [Line2D([], [], color=COLOURS(self.norm(value)), **square) for value in few]
        axes.legend(pens, [f"{self.label} = {value:g}" for value in few], fontsize="small")


def plot_run(run: Any, components: Any, lines: bool | None, color: Any, ax: Any) -> Any:
    """Draw the saved states of a run, and return the axes; see `Trajectories.plot`."""
    pair = _pair(run, components)
    if lines not in (None, True, False):
        raise wrong("lines", "True, False or None", lines)
    B, is_whole = math.prod(run.status.shape), run.n[-1] == len(run) - 1
    colours = _colours(run, color, run.status.shape)
    if colours.values is None and color is None:
        colours = _levels(run, run.states[0])
    axes = axes_for(ax, (5.4, 5.0))
    states = run.states.reshape(len(run), B, len(run.body._labels))
    plane, members = _pieces(states, pair)
    if lines is None:
        lines = is_whole and _are_near(plane)
    if not lines:
        plane, members = states[..., pair], np.arange(B)
    drawn, count = _draw(axes, plane, colours, members, lines)
    colours.explain(axes, drawn)
    _label(axes, run, pair)
    N, shown = int(run.n[-1]), f", {count:,} of their states" if count < B * (run.n[-1] + 1) else ""
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
    expected = f"two integers from 0 to {last}, or two of {', '.join(labels)}"
    given = components if isinstance(components, (tuple, list)) else ()
    if len(given) != 2 or any(isinstance(k, str) and k not in labels for k in given):
        raise wrong("components", expected, short(components))
    indices = [labels.index(k) if isinstance(k, str) else k for k in given]
    return [integer("components", k, 0, expected, last) for k in indices]


def _varying(states: FloatArray) -> list[int]:
    """Return the first two components that vary among states (K, D), or others in their place."""
    extent = np.ptp(states, axis=0) if len(states) else np.zeros(states.shape[1])
    is_constant = ~(extent > 1e-9 * extent.max())
    return sorted(np.argsort(is_constant, kind="stable")[:2].tolist())


def _colours(
    run: Any, color: Any, shape: tuple[int, ...], of_crossings: dict[str, Any] | None = None
) -> _Colours:
    """Return the colours that the user wants: by default the first parameter that varies.

    `shape` is that of numbers: of the batch, or (K,) for crossings, which also take those of the
    batch, and the numbers `of_crossings` by their names.
    """
    others = of_crossings or {}
    named = {n: a for n, a in varying(run.body).items() if n not in run.body._axes}
    if np.ndim(run.eps):
        named["eps"] = np.asarray(run.eps)
    if color is None:
        color = next((name for name, values in named.items() if values.size > 1), None)
        if color is None:
            return _Colours()
    if isinstance(color, str):
        if color not in {*named, *others}:
            known = ", ".join([*named, *others]) or "none"
            raise ValueError(f"color: {short(color)} is none of the names here: {known}")
        if color in others:
            return _Colours(np.asarray(others[color], float), color)
        values = named[color]
        values = run._at_crossings(values) if others else np.broadcast_to(values, shape)
        return _Colours(values.ravel(), color, is_parameter=True)
    values = real_array("color", color, allow_nan=True)
    if others and values.shape == run.count.shape != shape:
        values = run._at_crossings(values)
    if values.shape != shape:
        expected = f"have the shape {shape}"
        if others:
            expected += f", one for each crossing, or {run.count.shape}, for each trajectory"
        raise wrong("color", expected, values.shape)
    return _Colours(values.ravel())


def _levels(run: Any, states: FloatArray) -> _Colours:
    """Return the levels of states, of what the map conserves; none if all are equal."""
    name = run.map.conserves(run.body)
    if name and states.size:
        values = evaluate(name, run.body, states, run.eps, map=run.map).ravel()
        finite = values[np.isfinite(values)]
        if finite.size and np.ptp(finite) > 1e-9 * abs(finite).max():
            return _Colours(values, f"level of the {name.replace('_', ' ')}")
    return _Colours()


def _pieces(states: FloatArray, pair: list[int]) -> tuple[FloatArray, NDArray[Any]]:
    """Return pieces (n, pieces, 2) of orbits (N, B, D), not too many states, and their orbits.

    They are whole orbits, if these are short, or pieces from the beginning to the end.
    """
    N, B, _ = states.shape
    members = np.arange(B)
    if N * B > _MOST_JOINED:
        count = min(B, max(_MOST_JOINED // min(N, _SHORT), 1))
        members = np.linspace(0, B - 1, count).round().astype(np.int64)
    each = min(N, max(_MOST_JOINED // max(len(members), 1), 1))
    parts = 1 if each == N else max(min(_PIECES, each // _SHORTEST), 1)
    length = each // parts
    begins = np.linspace(0, N - length, parts).round().astype(np.int64)
    pieces = [states[begin : begin + length, members][..., pair] for begin in begins]
    return np.concatenate(pieces, axis=1), np.tile(members, parts)


def _are_near(plane: FloatArray) -> bool:
    """True if the median of steps is below 1/20 of the extent of all states (n, pieces, 2)."""
    lengths = np.hypot(*np.diff(plane, axis=0).T)
    lengths = lengths[~np.isnan(lengths)]
    known = plane[~np.isnan(plane).any(axis=-1)]
    return bool(lengths.size and 20.0 * np.median(lengths) < np.ptp(known, axis=0).max())


def _draw(
    axes: Any, plane: FloatArray, colours: _Colours, members: NDArray[Any], lines: bool
) -> tuple[Any, int]:
    """Draw states (n, pieces, 2) of orbits; return what has colours, and how many states."""
    n, count = len(plane), plane[..., 0].size
    drawn = None
    if lines:
        look: dict[str, Any] = {"linewidths": 0.7, "joinstyle": "round", "capstyle": "round"}
        if colours.values is None:
            look["color"] = COLOURS(0.3)
        else:
            look |= {"array": colours.of(members), "cmap": COLOURS, "norm": colours.norm}
        drawn = LineCollection(list(np.moveaxis(plane, 1, 0)), **look)
        axes.add_collection(drawn)
        axes.autoscale_view()  # which Matplotlib does itself from 3.11 on
    if not lines or count <= _FEW:
        size = 4.0 if lines else None
        drawn, count = _dots(axes, plane.reshape(-1, 2), colours, np.tile(members, n), size)
    return drawn, count


def _dots(
    axes: Any, points: FloatArray, colours: _Colours, owners: NDArray[Any], size: Any = None
) -> tuple[Any, int]:
    """Draw points (K, 2) with the colours of their owners; return the dots and their number."""
    shown = np.arange(len(points))
    if len(points) > _MOST:  # by chance, as every k-th state may show one of k islands
        shown = np.random.default_rng(0).choice(len(points), _MOST, replace=False)
    if colours.values is None:
        look: dict[str, Any] = {"color": COLOURS(0.3)}
    else:
        look = {"c": colours.of(owners[shown]), "cmap": COLOURS, "norm": colours.norm}
    size = size or min(max(8000.0 / max(len(shown), 1), 2.0), 14.0)
    drawn = axes.scatter(*points[shown].T, s=size, linewidths=0, **look)
    axes.autoscale_view()
    return drawn, len(shown)


def _range(values: FloatArray) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    return (finite.min(), finite.max()) if finite.size else (0.0, 1.0)


def _label(axes: Any, run: Any, pair: list[int]) -> None:
    labels = [_symbol(str(run.body._labels[each])) for each in pair]
    axes.set(xlabel=labels[0], ylabel=labels[1])


def _symbol(label: str) -> str:
    r"""Return `$\Omega_{1}$` for "Omega1"; other labels than letters with an index are text."""
    return f"${found}$" if (found := latex(label)) else label.replace("$", r"\$")


def _title(run: Any) -> str:
    eps = rf", $\epsilon$ = {spelled(float(run.eps))}" if np.ndim(run.eps) == 0 else ""
    return f"{run.map.title}{eps}"


def spelled(eps: float) -> str:
    """Return a step size as it was probably written: 0.2, or 1/256 in place of 0.00390625."""
    near, is_short = Fraction(eps).limit_denominator(100_000), float(f"{eps:.3g}") == eps
    is_power_of_2 = 8 <= Fraction(eps).denominator <= 2**20
    is_fraction = float(near) == eps and abs(near.numerator) < 1000
    return str(near) if is_fraction and (is_power_of_2 or not is_short) else f"{eps:g}"


def _orbits(B: int) -> str:
    return "1 orbit" if B == 1 else f"{B:,} orbits"
