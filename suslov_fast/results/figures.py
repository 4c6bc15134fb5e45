"""Figures of runs. Imports Matplotlib (extra `plots`)."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..checks import FloatArray, extra, integer, kind_of, real_array, short, wrong
from ..fields.names import latex
from ..keywords import refuse_unknown
from .frames import times_of, varying_numbers

try:
    import matplotlib.pyplot as plt
    from matplotlib import colormaps
    from matplotlib.cbook import normalize_kwargs
    from matplotlib.colors import ListedColormap, Normalize, is_color_like
    from matplotlib.lines import Line2D
except ImportError:
    extra("matplotlib", "plots")  # raises an error that says how to install it
    raise

__all__ = ["COLOURS", "axes_for", "plot_events", "plot_run", "plt", "symbol"]
# Viridis without its lightest colours, which are faint on white.
COLOURS = ListedColormap(colormaps["viridis"](np.linspace(0.05, 0.78, 256)))
_MANY = 100_000  # more states are not joined by default; more numbers in them: pixels in PDF files
_ALONE = 64  # the most orbits that have a line each
_IN_LEGEND = 8  # the most orbits in a legend
_STYLES = "-", "--", ":", "-."  # styles of lines, for values of a second parameter
_SIZES = {200: 6, 2000: 4}  # sizes of dots, by the most states that have them; else 2
_EQUAL = 8.0  # the largest ratio of extents in space whose axes have equal scales by default
_ZOOM = 0.8  # of axes in space: the layout leaves no room for their labels
_TIME = -1  # stands for time in place of the index of a component


def axes_for(ax: Any, size: tuple[float, float], count: int = 2) -> Any:
    """Return the user's axes after a check, or axes of a new figure, for `count` components."""
    if ax is not None:
        if not hasattr(ax, "zaxis" if count == 3 else "plot"):
            how = "figure.add_subplot(projection='3d')" if count == 3 else "figure.add_subplot()"
            raise wrong("ax", f"axes for {count} components", f"{kind_of(ax)}: {how}", TypeError)
        return ax
    if count != 3:
        return plt.figure(figsize=size, layout="constrained").add_subplot()
    axes = plt.figure(figsize=size, layout="constrained").add_subplot(projection="3d")
    axes.set_box_aspect(None, zoom=_ZOOM)
    return axes


def plot_run(
    run: Any, components: Any, lines: bool | None, color: Any, ax: Any, label: Any, given: Any
) -> Any:
    """Draw the saved states of a run, and return the axes; see `Trajectories.plot`."""
    others = [word for word in given if not hasattr(Line2D, f"set_{word}")]
    refuse_unknown("plot", others, type(run).plot)
    given = dict(normalize_kwargs(given, Line2D))
    color = given.pop("color", color)
    components = ("time", [*run.body._layout.parts]) if components == ("time",) else components
    if lists := [each for each in components if isinstance(each, (list, tuple))]:
        before = [*components[: components.index(lists[0])]]
        for k, name in enumerate(lists[0]):  # each name has a colour
            shade = f"C{k % 10}" if color is None else color
            text = label or symbol(str(name))
            ax = plot_run(run, (*before, name), lines, shade, ax, text, given)
        ax.set_ylabel("")
        return ax
    return _plot_one(run, components, lines, color, ax, label, given)


def _plot_one(
    run: Any, components: Any, lines: bool | None, color: Any, ax: Any, label: Any, given: Any
) -> Any:
    """Draw the saved states of a run in one figure, and return the axes."""
    chosen, B = _components(run, components), math.prod(run.status.shape)
    axes = axes_for(ax, (5.4, 5.0), len(chosen))
    parts = run.body._layout.of_parts(run.states)
    columns = [times_of(run) if k == _TIME else parts[..., k] for k in chosen]
    states = np.stack(columns, axis=-1).reshape(len(run.states), B, len(chosen))
    if lines is None:
        lines = len(states) * B <= _MANY and _are_near(states, chosen)
    numbers, name, fixed = _colours(run, color)
    norm: Any = None if numbers is None else Normalize(np.nanmin(numbers), np.nanmax(numbers))
    size = next((each for most, each in _SIZES.items() if len(states) * B <= most), 2)
    dots = {"linestyle": "none", "marker": ".", "markersize": size}
    style: dict[str, Any] = {"linewidth": 0.7} if lines else dots
    second, values = _second(run, name) if numbers is not None else ("", ())
    gaps = np.full((1, B, len(chosen)), np.nan)  # interrupt the line through orbits of one colour
    joined = np.concatenate([states, gaps]).swapaxes(0, 1)
    # Many orbits of about the same colour are one line, because thousands of lines take minutes.
    groups = np.arange(B)
    if B > _ALONE:
        groups = groups % 10 if numbers is None else np.floor(63.99 * norm(numbers).filled(np.nan))
    for k, group in enumerate(np.unique(groups[groups >= 0])):
        members = groups == group
        shade = fixed if numbers is None else COLOURS(norm(numbers[members][0]))
        text = label if k == 0 else None
        if label is None and fixed is None and 1 < B <= _IN_LEGEND:
            text = f"trajectory {k}" if numbers is None else f"{name} = {numbers[k]:g}"
            if second:
                text += f", {second} = {values[k]:g}"
                which = int(np.unique(values).searchsorted(values[k])) % len(_STYLES)
                style |= {"linestyle": _STYLES[which]} if lines else {}
        points = joined[members].reshape(-1, len(chosen))[:-1]
        of_line = {"rasterized": states.size > _MANY} | style | given
        axes.plot(*points.T, label=text, color=shade, **of_line)
    if numbers is not None and B > _IN_LEGEND:
        mappable = plt.cm.ScalarMappable(norm, COLOURS)
        text = f"{name}, each for {len(np.unique(values))} {second}" if second else name
        axes.figure.colorbar(mappable, ax=axes, label=text, shrink=0.8)
    if ax is None and len(chosen) == 3 and _TIME not in chosen:
        _equalize(axes, states)
    _label(axes, run, chosen)
    if axes.get_legend_handles_labels()[1]:
        # The best place takes seconds to find among many points.
        axes.legend(fontsize="small", loc="upper right" if states.size > _MANY else "best")
    return axes


def _equalize(axes: Any, states: FloatArray) -> None:
    """Give axes in space equal scales, unless one extent of the states is much smaller."""
    extents = np.ptp(states[np.isfinite(states).all(axis=-1)], axis=0) if states.size else [0.0]
    if 0.0 < np.max(extents) <= _EQUAL * np.min(extents):
        limits = axes.get_xlim(), axes.get_ylim(), axes.get_zlim()
        axes.set_box_aspect(np.ptp(limits, axis=1), zoom=_ZOOM)


def plot_events(events: Any, components: Any, color: Any, ax: Any, given: Any) -> Any:
    """Draw the states of events, and return the axes; see `Events.plot`."""
    chosen = _components(events, components)
    axes = axes_for(ax, (5.4, 5.0), len(chosen))
    parts = events.body._layout.of_parts(events.states)
    columns = [events.time if k == _TIME else parts[:, k] for k in chosen]
    numbers, name, fixed = _colours(events, color)
    size = next((each for most, each in _SIZES.items() if len(parts) <= most), 1)
    style: dict[str, Any] = {"s": size**2, "linewidths": 0, "rasterized": len(parts) > _MANY}
    if numbers is None:
        axes.scatter(*columns, **{"color": fixed or "k"} | style | given)
    else:
        shades = {"c": numbers[events.trajectory], "cmap": COLOURS}
        dots = axes.scatter(*columns, **shades | style | given)
        axes.figure.colorbar(dots, ax=axes, label=name, shrink=0.8)
    _label(axes, events, chosen)
    return axes


def _label(axes: Any, run: Any, chosen: list[int]) -> None:
    """Write the names of components at the axes."""
    labels = ["$t$" if k == _TIME else symbol(str(run.body._layout.parts[k])) for k in chosen]
    axes.set(**dict(zip(("xlabel", "ylabel", "zlabel"), labels, strict=False)))


def _components(run: Any, components: Sequence[Any]) -> list[int]:
    """Return the indices of two or three components, given by index or label, or _TIME."""
    names = [*run.body._layout.parts, "time"]
    components = ["time" if k == "t" and "t" not in names else k for k in components]
    if len(components) == 1:
        components = ("time", *components)
    if len(names) == 2 and tuple(components) == (0, 1):  # the only component, over time
        components = ("time", 0)
    last = len(names) - 2
    expected = f"two or three integers from 0 to {last}, or names among {short(names)}"
    unknown = [k for k in components if isinstance(k, str) and k not in names]
    if len(components) not in (2, 3) or unknown:
        raise wrong("components", expected, short(components))
    places = (
        names.index(k) if isinstance(k, str) else integer("components", k, 0, expected, last)
        for k in components
    )
    return [_TIME if k > last else k for k in places]


def _colours(run: Any, color: Any) -> tuple[Any, str, Any]:
    """Return numbers to show as colours and their name, or None, "" and a colour of Matplotlib."""
    parameters, shape = varying_numbers(run), run.status.shape
    if color is None:
        color = next((name for name, values in parameters.items() if values.size > 1), None)
    if color is None:
        return None, "", None
    if isinstance(color, str) and color in parameters:
        values = np.broadcast_to(np.asarray(parameters[color], float), shape)
        return values.ravel(), r"$\epsilon$" if color == "eps" else symbol(color), None
    if is_color_like(color):
        return None, "", color
    if isinstance(color, str):
        known = ", ".join(["a colour of Matplotlib", *parameters])
        raise wrong("color", f"one of {known}", short(color))
    values = real_array("color", color, allow_nan=True)
    if values.shape != shape:
        raise wrong("color", f"have the shape {shape}", values.shape)
    return values.ravel(), "", None


def _second(run: Any, shown: str) -> tuple[str, Any]:
    """Return a second parameter that varies, and its values; or "" and (). Colours show `shown`."""
    for name in varying_numbers(run):
        values, text, _ = _colours(run, name)
        if shown not in ("", text) and np.ptp(values):
            return text, values
    return "", ()


def _are_near(states: FloatArray, chosen: list[int]) -> bool:
    """Return True if the median step is below 1/20 of the extent of all states (N, B, c)."""
    lengths = np.linalg.norm(np.diff(states, axis=0), axis=-1)
    extent = np.nanmax(states, axis=(0, 1)) - np.nanmin(states, axis=(0, 1)) if states.size else 0
    return _TIME in chosen or bool(lengths.size and 20.0 * np.nanmedian(lengths) < np.max(extent))


def symbol(label: str) -> str:
    r"""Return `$\Omega_{1}$` for "Omega1"; other labels than a letter with an index stay text."""
    return f"${formula}$" if (formula := latex(str(label))) else str(label).replace("$", r"\$")
