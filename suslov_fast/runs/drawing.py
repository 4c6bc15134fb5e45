"""Figures of runs and crossings, and the axes and colours that all figures share.

Imports Matplotlib (extra `plots`).
"""

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies.fields.names import latex
from ..checks import FloatArray, extra, instance, integer, real_array, short, wrong
from .files.datasets import varying_numbers

try:
    import matplotlib.pyplot as plt
    from matplotlib import colormaps
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap, Normalize, is_color_like, to_hex
    from matplotlib.lines import Line2D
    from mpl_toolkits.mplot3d.art3d import Line3DCollection
except ImportError:
    extra("matplotlib", "plots")  # raises an error that says how to install it
    raise

__all__ = ["COLOURS", "axes_for", "plot_crossings", "plot_run", "plt"]
# Viridis without its lightest colours, which are faint on white.
COLOURS = ListedColormap(colormaps["viridis"](np.linspace(0.05, 0.9, 256)))

# Most dots in a figure, because drawing these takes up to 10 s.
MOST_DOTS = 1_000_000
# Most dots that vector formats hold one by one; more are an image there.
_MOST_VECTORS = 10_000
# Most dots on lines, because more hide the lines.
_MOST_ON_LINES, _MOST_OVER_TIME = 2000, 200
# Most states joined by lines by default.
_MOST_JOINED = 100_000
# Most values of a parameter in a legend; for more there is a colour bar.
_IN_LEGEND = 6
# Most starts in a legend, and most components of a start there.
_MOST_STARTS, _MOST_OF_START = 8, 4
# Most components in the key of a figure over time.
_IN_KEY = 12


def axes_for(ax: Any, size: tuple[float, float], count: int = 2) -> Any:
    """Return the user's axes, checked, or those of a new figure, for so many components."""
    projection = {"projection": "3d"} if count == 3 else {}
    if ax is None:
        return plt.figure(figsize=size, layout="constrained").add_subplot(**projection)
    if not isinstance(ax, Axes) or (ax.name == "3d") != (count == 3):
        how = 'such as those of plt.figure().add_subplot(projection="3d")'
        plane = "plane axes of Matplotlib, such as those of plt.subplots()"
        expected = f"axes of Matplotlib in space, {how}" if count == 3 else plane
        raise wrong("ax", expected, repr(ax), TypeError)
    return ax


class _Colours(NamedTuple):
    """Numbers to be shown as colours, and their label; without numbers there is one colour."""

    values: FloatArray | None = None
    label: str = ""
    is_parameter: bool = False
    single: Any = COLOURS(0.3)
    starts: Sequence[str] | None = None  # their names in the key, if numbers are those of starts

    def of(self, index: Any) -> FloatArray | None:
        return None if self.values is None else self.values[index]

    @property
    def norm(self) -> Any:
        if self.values is None:
            return None
        finite = self.values[np.isfinite(self.values)]
        return Normalize(finite.min(), finite.max()) if finite.size else Normalize(0.0, 1.0)

    def explain(self, axes: Any, drawn: Any) -> None:
        """Add a colour bar, or a legend if a parameter has few values."""
        if self.values is None:
            return
        values = np.unique(self.values[np.isfinite(self.values)])
        if self.starts is not None:
            self._key(axes, range(len(self.starts)), self.starts)
            return
        if not self.is_parameter or len(values) > _IN_LEGEND:
            axes.figure.colorbar(drawn, ax=axes, label=self.label, shrink=0.8)
            return
        self._key(axes, values, [f"{self.label} = {value:g}" for value in values])

    def _key(self, axes: Any, values: Any, names: Sequence[str]) -> None:
        style: Any = {"marker": "s", "markersize": 5, "linestyle": "none"}
        _key_of(axes, names, [COLOURS(self.norm(value)) for value in values], **style)


def _key_of(axes: Any, names: Sequence[str], shades: Sequence[Any], **style: Any) -> None:
    """Add a legend, whose entries ``axes.legend()`` finds again."""
    keys = [
        axes.add_line(Line2D([], [], color=shade, label=name, **style))
        for name, shade in zip(names, shades, strict=True)
    ]
    if keys:
        axes.legend(handles=keys, fontsize="small")


def plot_run(
    run: Any, components: Any, lines: bool | None, color: Any, title: Any, ax: Any, label: Any
) -> Any:
    """Draw the saved states of a run, and return the axes; see `Trajectories.plot`."""
    if several := _several_over_time(run, components):
        return _plot_over_time(run, several, lines, color, title, ax, label)
    chosen = _components(run, components)
    if lines not in (None, True, False):
        raise wrong("lines", "True, False or None", repr(lines))
    B = math.prod(run.status.shape)
    colours = _colours(run, color, run.status.shape)
    axes = axes_for(ax, (5.4, 5.0), len(chosen))
    states = _drawn(run, run.states, chosen).reshape(len(run), B, len(chosen))
    if lines is None:
        are_few = len(run) * B <= _MOST_JOINED
        lines = are_few and run._is_whole and (_are_near(states) or _TIME in chosen)
    most = _MOST_OVER_TIME if _TIME in chosen else _MOST_ON_LINES
    drawn, count = _draw(axes, states, colours, lines, most)
    drawn.set_label(label)
    colours.explain(axes, drawn)
    _label(axes, run, chosen)
    what, reach, total = run._heading
    left_out = count < B * len(run)
    shown = f", {count:,} of their states" if count < B * total else ""
    _entitle(axes, title, f"{what}\n{_orbits(B)} {reach}{shown}", left_out)
    return axes


def _several_over_time(run: Any, components: Any) -> list[str]:
    """Return the labels for "time" alone, all, and for ("time", (labels)); nothing for others."""
    labels = [*run.body.labels]
    match components:
        case ["time"]:
            return labels
        case ["time", [*chosen]] if {*chosen} <= {*labels}:
            return chosen
    return []


def _plot_over_time(
    run: Any, labels: list[str], lines: bool | None, color: Any, title: Any, ax: Any, label: Any
) -> Any:
    """Draw several components over time, each in its own colour."""
    for name, given in (("color", color), ("label", label)):
        if given is not None:
            expected = f"None for several components, which have a {name} each"
            raise wrong(name, expected, short(given))
    axes = axes_for(ax, (5.4, 4.0))
    shades = [to_hex(shade) for shade in COLOURS(np.linspace(0.0, 1.0, len(labels)))]
    for name, shade in zip(labels, shades, strict=True):
        plot_run(run, ("time", name), lines, shade, title, axes, None)
    axes.set_ylabel("")
    if len(labels) <= _IN_KEY:
        _key_of(axes, [_symbol(str(name)) for name in labels], shades, linewidth=1.5)
    return axes


def plot_crossings(
    points: Any, components: Any, color: Any, title: Any, ax: Any, label: Any
) -> Any:
    """Draw crossings, and return the axes; see `Crossings.plot`."""
    K = len(points)
    chosen = _components(points, components or _varying(points))
    of_crossings = {name: getattr(points, name) for name in points.coordinates}
    colours = _colours(points, color, (K,), of_crossings)
    axes = axes_for(ax, (5.4, 5.0), len(chosen))
    drawn, count = _dots(axes, _drawn(points, points.states, chosen), colours, np.arange(K))
    drawn.set_label(label)
    colours.explain(axes, drawn)
    _label(axes, points, chosen)
    shown = f"{count:,} of {K:,}" if count < K else f"{K:,}"
    text = f"{points._heading}\n{shown} {points.what} by {_orbits(math.prod(points._batch))}"
    _entitle(axes, title, text, count < K)
    return axes


_TIME = -1  # in place of the index of a component


def _components(run: Any, components: Sequence[Any]) -> list[int]:
    """Return the indices of two or three components, given by index or label, or _TIME."""
    labels = [*run.body.labels]
    last, names = len(labels) - 1, [*labels, "time"]
    if last == 0 and components == (0, 1):  # the only component, over time
        return [_TIME, 0]
    if len(components) == 1 and components[0] in labels:
        return [_TIME, labels.index(components[0])]
    shown = names if last < 20 else [*labels[:3], "...", *names[-2:]]
    expected = f"two or three integers from 0 to {last}, or names among {', '.join(shown)}"
    expected += f', such as "time", "{labels[0]}"'
    if len(components) not in (2, 3) or any(
        isinstance(k, (tuple, list)) or (isinstance(k, str) and k not in names) for k in components
    ):
        raise wrong("components", expected, short(components))
    indices = []
    for k in components:
        if isinstance(k, str):
            indices.append(labels.index(k) if k in labels else _TIME)
        else:
            indices.append(integer("components", k, 0, expected, last))
    return indices


def _drawn(run: Any, states: FloatArray, chosen: list[int]) -> FloatArray:
    """Return the chosen components of states (..., D), with times in place of _TIME."""
    times = np.reshape(run.time, (*run.time.shape, *(1,) * (states.ndim - 1 - run.time.ndim)))
    times = np.broadcast_to(times, states.shape[:-1])
    return np.stack([times if k == _TIME else states[..., k] for k in chosen], axis=-1)


def _varying(points: Any) -> list[int]:
    """Return two components that vary: a coordinate and its momentum, else the first two."""
    states, D = points.states, points.states.shape[-1]
    extent = np.ptp(states, axis=0) if len(states) else np.zeros(D)
    is_constant = ~(extent > 1e-9 * extent.max())
    K, m = getattr(points.body, "K", None), D // 2
    if K is not None and np.array_equal(np.asarray(K, float), np.eye(D, k=m) - np.eye(D, k=-m)):
        for k in range(m):
            if not is_constant[[k, k + m]].any():
                return [k, k + m]
    if D == 1:
        return [_TIME, 0]
    return sorted(np.argsort(is_constant, kind="stable")[:2].tolist())


def _colours(
    run: Any, color: Any, shape: tuple[int, ...], of_crossings: dict[str, Any] | None = None
) -> _Colours:
    """Return the colours for `color`: by default those of the first parameter that varies.

    `shape` is that of the batch, or (K,) for crossings. For these, `color` may also be a name in
    `of_crossings`, or have the shape of the batch.
    """
    of_crossings = of_crossings or {}
    parameters = varying_numbers(run)
    if color is None:
        color = next((name for name, values in parameters.items() if values.size > 1), None)
        if color is None:
            return _of_starts(run, shape, bool(of_crossings))
    if isinstance(color, str):
        if color not in {*parameters, *of_crossings}:
            if is_color_like(color):
                return _Colours(single=color)
            names = [repr(name) for name in (*parameters, *of_crossings)]
            known = " or ".join([*names, "a colour of Matplotlib such as 'red'"])
            known += ", or an array with a number for each "
            known += "crossing or trajectory" if of_crossings else "trajectory"
            raise wrong("color", known, short(color))
        if color in of_crossings:
            return _Colours(np.asarray(of_crossings[color], float), color)
        values = parameters[color]
        values = run._at_crossings(values) if of_crossings else np.broadcast_to(values, shape)
        label = r"$\epsilon$" if color == "eps" else _symbol(color)
        return _Colours(values.ravel(), label, is_parameter=True)
    if is_color_like(color) and np.shape(color) != shape:  # an RGB or RGBA tuple
        return _Colours(single=color)
    values = real_array("color", color, allow_nan=True)
    if of_crossings and values.shape == run._batch != shape:
        values = run._at_crossings(values)
    if values.shape != shape:
        expected = f"have the shape {shape}, one number for each orbit"
        if of_crossings:
            expected = f"have the shape {shape}, one number for each crossing, or "
            expected += f"{run.count.shape}, one for each trajectory"
        raise wrong("color", expected, values.shape)
    return _Colours(values.ravel())


def _of_starts(run: Any, shape: tuple[int, ...], is_of_crossings: bool) -> _Colours:
    """Return a colour for each start, whose values few have as their names."""
    if is_of_crossings:
        count, values = math.prod(run._batch), run.trajectory.astype(float)
    else:
        count, values = math.prod(shape), np.arange(math.prod(shape), dtype=float)
    if count < 2 or not values.size:
        return _Colours()
    names = [f"trajectory {k}" for k in range(count)] if count <= _MOST_STARTS else []
    if names and not is_of_crossings and len(run.body.labels) <= _MOST_OF_START:
        at_start = (np.reshape(run.time, (len(run), -1)) == 0).all(axis=1)
        for states in run.states[at_start][:1].reshape(-1, count, len(run.body.labels)):
            named = [", ".join(f"{a:.3g}" for a in state) for state in states]
            names = [f"({each})" for each in named] if len({*named}) == count else names
    return _Colours(values, starts=names)


def _are_near(states: FloatArray) -> bool:
    """Return whether the median step is below 1/20 of the extent of all states (N, B, c)."""
    lengths = np.linalg.norm(np.diff(states, axis=0), axis=-1)
    lengths = lengths[~np.isnan(lengths)]
    existing = states[~np.isnan(states).any(axis=-1)]
    return bool(lengths.size and 20.0 * np.median(lengths) < np.ptp(existing, axis=0).max())


def _draw(
    axes: Any, states: FloatArray, colours: _Colours, lines: bool, most: int
) -> tuple[Any, int]:
    """Draw orbits (N, B, c); return the coloured artist and the number of states.

    Lines have dots at the states if there are at most so many.
    """
    (N, B, c), drawn = states.shape, None
    count, orbits = N * B, np.arange(B)
    if lines:
        style: dict[str, Any] = {"linewidths": 0.7, "joinstyle": "round", "capstyle": "round"}
        if colours.values is None:
            style["color"] = colours.single
        else:
            style |= {"array": colours.of(orbits), "cmap": COLOURS, "norm": colours.norm}
        collection = LineCollection if c == 2 else Line3DCollection
        drawn = collection(list(np.moveaxis(states, 1, 0)), **style)
        if c == 2:
            axes.add_collection(drawn)
            axes.autoscale_view()  # Matplotlib before 3.11 does not do so itself
        else:
            axes.add_collection3d(drawn)
            axes.auto_scale_xyz(*states.reshape(-1, 3).T)
    if not lines or count <= most:
        size = 4.0 if lines else None
        drawn, count = _dots(axes, states.reshape(-1, c), colours, np.tile(orbits, N), size)
    return drawn, count


def _dots(
    axes: Any, points: FloatArray, colours: _Colours, owners: NDArray[Any], size: Any = None
) -> tuple[Any, int]:
    """Draw points (K, c) in the colours of their owners; return the dots and their number."""
    shown = np.arange(len(points))
    if len(points) > MOST_DOTS:  # at random, because every k-th state may show one of k islands
        shown = np.random.default_rng(0).choice(len(points), MOST_DOTS, replace=False)
    if colours.values is None:
        style: dict[str, Any] = {"color": colours.single}
    else:
        style = {"c": colours.of(owners[shown]), "cmap": COLOURS, "norm": colours.norm}
    count = max(len(shown), 1)  # the more dots, the smaller, so that islands stay visible
    size = size or min(max(8000.0 / count, min(2.0, 40_000.0 / count), 0.4), 14.0)
    style["rasterized"] = len(shown) > _MOST_VECTORS
    drawn = axes.scatter(*points[shown].T, s=size, linewidths=0, **style)
    axes.autoscale_view()
    return drawn, len(shown)


def _label(axes: Any, run: Any, chosen: list[int]) -> None:
    """Label the axes with the names of the components."""
    labels = ["$t$" if k == _TIME else _symbol(str(run.body.labels[k])) for k in chosen]
    axes.set(**dict(zip(("xlabel", "ylabel", "zlabel"), labels, strict=False)))


def _entitle(axes: Any, title: Any, text: str, left_out: bool) -> None:
    """Write the user's title, or this text for True, and for None if states are left out."""
    if title is True or (title is None and left_out):
        title = text
    if title not in (None, False):
        instance("title", title, str)
        axes.set_title(title, fontsize="small", wrap=True)


def _symbol(label: str) -> str:
    r"""Return `$\Omega_{1}$` for "Omega1"; labels that are no letter with an index stay text."""
    return f"${formula}$" if (formula := latex(label)) else label.replace("$", r"\$")


def titled(run: Any) -> str:
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
