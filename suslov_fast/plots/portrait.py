"""The phase portrait of a planar field: arrows, nullclines and equilibria."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from ..checks import real_array, wrong
from ..fields.field import Field
from ..motions.equilibria import equilibria

_POINTS = 300  # points on each axis at which f is evaluated
_STARTS = 12  # starts on each axis from which equilibria are searched
_DIGITS = 6  # equilibria that differ by less than this, in extents, are one
_COLOURS = "tab:blue", "tab:orange"


def draw_portrait(field: Field, extent: Any, has_nullclines: bool, ax: Any) -> Any:
    """Draw the phase portrait of a field of two components, and return the axes."""
    from ..results.figures import axes_for, symbol

    layout = field._layout
    if field.shape or layout.D != 2:
        has = f"a family of shape {field.shape}: pass field[k]" if field.shape else f"{field!r}"
        expected = "a single field of two variables, without the time"
        raise wrong("system", expected, has)
    left, right, low, high = limits = _limits(extent)
    x, y = np.meshgrid(np.linspace(left, right, _POINTS), np.linspace(low, high, _POINTS))
    points = np.stack([x, y], axis=-1)
    with np.errstate(all="ignore"):
        f = np.ma.masked_invalid(field._value(points))
    axes = axes_for(ax, (5.4, 5.0))
    names = [symbol(name) for name in layout.parts]
    if f.count():
        axes.streamplot(x, y, f[..., 0], f[..., 1], color="0.7", linewidth=0.7, arrowsize=0.8)
    for k, colour in enumerate(_COLOURS):
        if has_nullclines and f[..., k].min() < 0.0 < f[..., k].max():
            axes.contour(x, y, f[..., k], [0.0], colors=colour)
            axes.plot([], [], color=colour, label=rf"{names[k]}$' = 0$")
    states, stable = _equilibria(field, points, limits)
    for is_stable, colour, text in ((True, "k", "stable"), (False, "w", "not stable")):
        dots = layout.of_parts(states[stable == is_stable])
        if len(dots):
            style = {"color": "k", "markerfacecolor": colour, "label": f"equilibrium, {text}"}
            axes.plot(*dots.T, "o", zorder=3, **style)
    axes.set(xlim=(left, right), ylim=(low, high), xlabel=names[0], ylabel=names[1])
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="upper right", fontsize="small", framealpha=0.9)
    return axes


def _limits(extent: Any) -> list[float]:
    """Return the least and the largest value of both variables, for a number or four numbers."""
    given = real_array("extent", extent).ravel()
    limits = np.concatenate([-given, given, -given, given]) if given.size == 1 else given
    if limits.size != 4 or not (limits[0] < limits[1] and limits[2] < limits[3]):
        expected = "a positive number a, for -a to a, or (left, right, low, high)"
        raise wrong("extent", expected, extent)
    return [*map(float, limits)]


def _equilibria(field: Field, points: Any, limits: list[float]) -> tuple[Any, Any]:
    """Return the equilibria of a field within the limits, each once, and which are stable."""
    step = _POINTS // _STARTS
    near = field._layout.leave(points[step // 2 :: step, step // 2 :: step])
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # not every start leads to one
        found = equilibria(field, near=near)
    x, y = np.moveaxis(field._layout.of_parts(found.states), -1, 0)
    left, right, low, high = limits
    inside = np.flatnonzero((x >= left) & (x <= right) & (y >= low) & (y <= high))
    each = np.stack([x.ravel() / (right - left), y.ravel() / (high - low)], axis=-1)[inside]
    _, first = np.unique(each.round(_DIGITS) + 0.0, axis=0, return_index=True)
    where = np.unravel_index(inside[first], x.shape)
    return found.states[where], found.stable[where]
