"""Figures of runs and crossings. Imports Matplotlib (extra `plots`)."""

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ..checks import FloatArray, extra, integer, kind_of, real_array, short, wrong
from ..fields.names import latex
from .frames import varying_numbers

try:
    import matplotlib.pyplot as plt
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap, Normalize, is_color_like
except ImportError:
    extra("matplotlib", "plots")  # raises an error that says how to install it
    raise

__all__ = ["COLOURS", "axes_for", "plot_events", "plot_run", "plt"]
# Viridis without its lightest colours, which are faint on white.
COLOURS = ListedColormap(colormaps["viridis"](np.linspace(0.05, 0.9, 256)))
_MANY = 100_000  # states: above, they are not joined by default, and pixels in PDF files
_ALONE = 64  # orbits with a line of their own
_IN_LEGEND = 8  # orbits, or components, with an entry of their own
_TIME = -1  # in place of the index of a component


def axes_for(ax: Any, size: tuple[float, float], count: int = 2) -> Any:
    """Return the user's axes, or axes of a new figure, for so many components."""
    if ax is not None:
        if not hasattr(ax, "zaxis" if count == 3 else "plot"):
            how = "figure.add_subplot(projection='3d')" if count == 3 else "figure.add_subplot()"
            raise wrong("ax", f"axes for {count} components", f"{kind_of(ax)}: {how}", TypeError)
        return ax
    projection = {"projection": "3d"} if count == 3 else {}
    return plt.figure(figsize=size, layout="constrained").add_subplot(**projection)


def plot_run(
    run: Any, components: Any, lines: bool | None, color: Any, title: Any, ax: Any, label: Any
) -> Any:
    """Draw the saved states of a run, and return the axes; see `Trajectories.plot`."""
    labels = [*run.body._labels]
    match components:
        case ["time"]:
            several = labels
        case ["time", [*several]] if {*several} <= {*labels}:
            pass
        case _:
            several = []
    if several:  # each in a colour of its own
        for k, name in enumerate(several):
            own = f"C{k % 10}" if color is None else color
            ax = plot_run(run, ("time", name), lines, own, None, ax, label or _symbol(name))
        ax.set_ylabel("")
        return _finished(ax, title)
    chosen, B = _components(run, components), math.prod(run.status.shape)
    axes = axes_for(ax, (5.4, 5.0), len(chosen))
    states = _drawn(run, run.states, chosen).reshape(len(run.states), B, len(chosen))
    if lines is None:
        lines = run._is_whole and len(states) * B <= _MANY and _are_near(states, chosen)
    numbers, name, fixed = _colours(run, color, run.status.shape)
    norm = None if numbers is None else Normalize(np.nanmin(numbers), np.nanmax(numbers))
    style = {"linewidth": 0.7} if lines else {"linestyle": "none", "marker": ".", "ms": 2}
    gaps = np.full((1, B, len(chosen)), np.nan)  # between orbits of one colour
    joined = np.concatenate([states, gaps]).swapaxes(0, 1)
    for k, (shade, members) in enumerate(_by_colour(B, numbers, norm, fixed)):
        own = label if k == 0 else None
        if label is None and fixed is None and 1 < B <= _IN_LEGEND:
            own = f"trajectory {k}" if numbers is None else f"{name} = {numbers[k]:g}"
        points = joined[members].reshape(-1, len(chosen))[:-1]
        axes.plot(*points.T, label=own, color=shade, rasterized=states.size > _MANY, **style)
    if numbers is not None and B > _IN_LEGEND:
        mappable = plt.cm.ScalarMappable(norm, COLOURS)
        axes.figure.colorbar(mappable, ax=axes, label=name, shrink=0.8)
    _label(axes, run, chosen)
    what, reach, _ = run._heading
    return _finished(axes, f"{what}\n{B:,} orbits {reach}" if title is True else title)


def _by_colour(B: int, numbers: Any, norm: Any, fixed: Any) -> list[tuple[Any, Any]]:
    """Return colours, each with the orbits that a line of Matplotlib draws in it.

    Many orbits of one colour are one line, because thousands of lines take minutes.
    """
    shades = [fixed] * B if numbers is None else [*COLOURS(norm(numbers))]
    if B <= _ALONE:
        return [(shade, [k]) for k, shade in enumerate(shades)]
    if fixed is not None:
        return [(fixed, slice(None))]
    if numbers is None:  # the next colours of the axes
        return [(None, slice(k, None, 10)) for k in range(10)]
    levels = np.floor(63.99 * np.ma.filled(norm(numbers), np.nan))
    present = np.unique(levels[np.isfinite(levels)])
    return [(COLOURS((level + 0.5) / 64), levels == level) for level in present]


def plot_events(points: Any, components: Any, color: Any, title: Any, ax: Any, label: Any) -> Any:
    """Draw crossings, and return the axes; see `Events.plot`."""
    chosen = _components(points, components or _varying(points))
    axes = axes_for(ax, (5.4, 5.0), len(chosen))
    of_points = {name: getattr(points, name) for name in points._coordinates}
    count = len(points.states)
    numbers, name, fixed = _colours(points, color, (count,), of_points)
    shade = {"color": fixed} if numbers is None else {"c": numbers, "cmap": COLOURS}
    size = min(max(8000.0 / max(count, 1), 0.4), 14.0)
    drawn = axes.scatter(
        *_drawn(points, points.states, chosen).T, s=size, linewidths=0, label=label,
        rasterized=count > _MANY, **shade,
    )  # fmt: skip
    if numbers is not None:
        axes.figure.colorbar(drawn, ax=axes, label=name, shrink=0.8)
    _label(axes, points, chosen)
    text = f"{points._heading}\n{count:,} events"
    return _finished(axes, text if title is True else title)


def _finished(axes: Any, title: Any) -> Any:
    """Add a title and a legend, if there is something to say."""
    if title:
        axes.set_title(title, fontsize="small", wrap=True)
    if axes.get_legend_handles_labels()[1]:
        # The best place takes seconds to find among many points.
        is_large = sum(len(line.get_xdata()) for line in axes.get_lines()) > _MANY
        axes.legend(fontsize="small", loc="upper right" if is_large else "best")
    return axes


def _components(run: Any, components: Sequence[Any]) -> list[int]:
    """Return the indices of two or three components, given by index or label, or _TIME."""
    names = [*run.body._labels, "time"]
    if len(components) == 1:
        components = ("time", *components)
    if len(names) == 2 and tuple(components) == (0, 1):  # the only component, over time
        components = ("time", 0)
    shown = ", ".join(names if len(names) < 20 else [*names[:3], "...", *names[-2:]])
    expected = f"two or three integers from 0 to {len(names) - 2}, or names among {shown}"
    if len(components) not in (2, 3):
        raise wrong("components", expected, short(components))
    found = []
    for k in components:
        if isinstance(k, str) and k not in names:
            raise wrong("components", expected, short(components))
        is_name = isinstance(k, str)
        found.append(
            names.index(k) if is_name else integer("components", k, 0, expected, len(names) - 2)
        )
    return [_TIME if k == len(names) - 1 else k for k in found]


def _drawn(run: Any, states: FloatArray, chosen: list[int]) -> FloatArray:
    """Return the chosen components of states (..., D), with times in place of _TIME."""
    times = np.reshape(run.time, (*run.time.shape, *(1,) * (states.ndim - 1 - run.time.ndim)))
    times = np.broadcast_to(times, states.shape[:-1])
    return np.stack([times if k == _TIME else states[..., k] for k in chosen], axis=-1)


def _varying(points: Any) -> list[int]:
    """Return two components that vary: a coordinate and its momentum, else the first two."""
    states, D = points.states, points.states.shape[-1]
    extent = np.ptp(states, axis=0) if len(states) else np.zeros(D)
    varies = np.flatnonzero(extent > 1e-9 * extent.max(initial=0.0)).tolist()
    pairs = [(k, k + D // 2) for k in varies if k + D // 2 in varies]
    if pairs and D % 2 == 0 and getattr(points.body, "_is_hamiltonian", False):
        return [*pairs[0]]
    return [_TIME, 0] if D == 1 else [*varies, *({*range(D)} - {*varies})][:2]


def _colours(
    run: Any, color: Any, shape: tuple[int, ...], of_points: dict[str, Any] | None = None
) -> tuple[Any, str, Any]:
    """Return numbers to show as colours and their name, or None, "" and a colour of Matplotlib."""
    parameters = varying_numbers(run)
    if color is None:
        color = next((name for name, values in parameters.items() if values.size > 1), None)
        color = "trajectory" if color is None and of_points and run.count.size > 1 else color
    if color is None:
        return None, "", None
    named = parameters | (of_points or {})
    if isinstance(color, str) and color in named:
        name, values = color, np.asarray(named[color], float)
        if color in parameters:
            values = run._at_events(values) if of_points else np.broadcast_to(values, shape)
        return values.ravel(), r"$\epsilon$" if name == "eps" else _symbol(name), None
    if is_color_like(color):
        return None, "", color
    if isinstance(color, str):
        raise wrong("color", f"one of {', '.join(named)}, or a colour of Matplotlib", short(color))
    values = real_array("color", color, allow_nan=True)
    if of_points and values.shape == run.count.shape != shape:
        values = run._at_events(values)
    if values.shape != shape:
        raise wrong("color", f"have the shape {shape}", values.shape)
    return values.ravel(), "", None


def _are_near(states: FloatArray, chosen: list[int]) -> bool:
    """Return whether the median step is below 1/20 of the extent of all states (N, B, c)."""
    lengths = np.linalg.norm(np.diff(states, axis=0), axis=-1)
    extent = np.nanmax(states, axis=(0, 1)) - np.nanmin(states, axis=(0, 1)) if states.size else 0
    return _TIME in chosen or bool(lengths.size and 20.0 * np.nanmedian(lengths) < np.max(extent))


def _label(axes: Any, run: Any, chosen: list[int]) -> None:
    """Label the axes with the names of the components."""
    labels = ["$t$" if k == _TIME else _symbol(str(run.body._labels[k])) for k in chosen]
    axes.set(**dict(zip(("xlabel", "ylabel", "zlabel"), labels, strict=False)))


def _symbol(label: str) -> str:
    r"""Return `$\Omega_{1}$` for "Omega1"; labels that are no letter with an index stay text."""
    return f"${formula}$" if (formula := latex(str(label))) else str(label).replace("$", r"\$")


def titled(run: Any) -> str:
    """Return the title of the map, with the step size if there is one only."""
    is_shown = np.ndim(run.eps) == 0 and run.body._has_eps
    eps = rf", $\epsilon$ = {spelled(float(run.eps))}" if is_shown else ""
    return f"{run.map.title}{eps}"


def spelled(eps: float) -> str:
    """Return a step size as a user writes it: 0.2, and 1/256 instead of 0.00390625."""
    near = Fraction(eps).limit_denominator(100_000)
    is_power_of_2 = 8 <= Fraction(eps).denominator <= 2**20
    return str(near) if float(near) == eps and is_power_of_2 else f"{eps:g}"
