"""Tables of SciPy at symbols: piecewise polynomials, whose knots end steps as those of `np.interp`.

`PPoly` is the class of cubic splines, of pchip and of Akima's; splines in another form, and
`interp1d`, become piecewise polynomials here.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from .symbols import Symbol, Untraceable, as_symbols, has_symbols, interpolated


def _held(t: Any, knots: Any, values: Any) -> Any:
    """Return values[i] between knots i and i + 1, and the first and last one beyond all knots."""
    inner, is_jump = knots[1:-1], np.diff(values) != 0
    if not is_jump.any():
        return float(values[0])
    pairs = np.stack([values[:-1], values[1:]], 1)[is_jump]
    places = np.repeat(inner[is_jump], 2)
    heights = np.array([values[0], *pairs.ravel(), values[-1]])
    return interpolated(t, np.array([knots[0], *places, knots[-1]]), heights)


def _polynomial(t: Any, knots: Any, rows: Any) -> Any:
    """Return the polynomial with coefficients `rows`, highest power first, of each interval."""
    late, value = t - _held(t, knots, knots[:-1]), 0.0
    for row in rows:
        value = value * late + _held(t, knots, row)
    return value


def _within(t: Any, knots: Any, value: Any, below: Any, above: Any) -> Any:
    """Return `value` in the range of the knots, elsewhere `below` and `above`, None for `value`."""
    value = value if below is None else np.where(t < knots[0], below, value)
    return value if above is None else np.where(t > knots[-1], above, value)


def _ppoly(table: Any, t: Any, nu: int = 0, extrapolate: Any = None) -> Any:
    """Return the value of a `PPoly` at a symbol."""
    table = table.derivative(nu) if nu else table
    extrapolate = table.extrapolate if extrapolate is None else extrapolate
    if extrapolate == "periodic":
        t = table.x[0] + (t - table.x[0]) % (table.x[-1] - table.x[0])
    beyond = None if extrapolate else np.nan
    rows = table.c.reshape(*table.c.shape[:2], -1)
    parts = [
        _within(t, table.x, _polynomial(t, table.x, rows[:, :, k]), beyond, beyond)
        for k in range(rows.shape[2])
    ]
    return parts[0] if table.c.ndim == 2 else as_symbols(parts).reshape(table.c.shape[2:])


def _spline(table: Any, t: Any, nu: int = 0, extrapolate: Any = None) -> Any:
    """Return the value of a `BSpline` at a symbol."""
    from scipy.interpolate import PPoly

    k, extrapolate = table.k, table.extrapolate if extrapolate is None else extrapolate
    columns = table.c.reshape(len(table.c), -1).T
    polynomials = [PPoly.from_spline((table.t, column, k)) for column in columns]
    exists = np.diff(table.t[k : len(table.t) - k]) > 0  # other intervals are empty, or beyond
    c = np.stack([each.c[:, k : k + len(exists)][:, exists] for each in polynomials], 2)
    x = table.t[k : len(table.t) - k][[*exists, True]]
    return _ppoly(PPoly(c.reshape(*c.shape[:2], *table.c.shape[1:]), x), t, nu, extrapolate)


def _univariate(table: Any, t: Any, nu: int = 0, ext: Any = None) -> Any:
    """Return the value of a `UnivariateSpline` at a symbol."""
    from scipy.interpolate import BSpline

    knots, c, k = table._eval_args
    if ext not in (None, 0, "extrapolate") or table.ext != 0:
        raise Untraceable("UnivariateSpline with ext other than 0: write CubicSpline")
    return _spline(BSpline(knots, c[: len(knots) - k - 1], k), t, nu)


def _interp1d(table: Any, t: Any) -> Any:
    """Return the value of an `interp1d` at a symbol."""
    kind, x, y = table._kind, table.x, np.asarray(table.y, float)
    if y.ndim != 1:
        raise Untraceable("interp1d of several rows: write one interp1d for each")
    if kind == "spline":
        [value] = np.ravel(_spline(table._spline, t, extrapolate=True))
    elif kind == "linear":
        slopes = np.diff(y) / np.diff(x)
        is_line = isinstance(table.fill_value, str)
        value = _polynomial(t, x, [slopes, y[:-1]]) if is_line else interpolated(t, x, y)
    elif kind.startswith("nearest"):
        value = _held(t, np.array([x[0], *(x[1:] + x[:-1]) / 2, x[-1]]), y)
    else:
        value = _held(t, x, y[:-1] if kind == "previous" else y[1:])
    fill = table.fill_value
    if isinstance(fill, str):
        return value
    ends = fill if isinstance(fill, tuple) else (fill, fill)
    below, above = (float(np.ravel(a)[0]) for a in ends)
    return _within(t, x, value, below, above)


def _rule_of(table: Any) -> Callable[..., Any] | None:
    """Return the function for a table at a symbol; None for other objects."""
    if (of := sys.modules.get("scipy.interpolate")) is None:
        return None
    rules = {of.PPoly: _ppoly, of.BSpline: _spline, of.interp1d: _interp1d}
    rules |= {of.UnivariateSpline: _univariate}
    return next((rules[each] for each in type(table).__mro__ if each in rules), None)


def is_table(value: Any) -> bool:
    return type(value).__module__.startswith("scipy.") and _rule_of(value) is not None


def at_symbols(table: Any, t: Any, *given: Any, **options: Any) -> Any:
    """Return the value of a table at numbers or symbols."""
    if not has_symbols([t]):
        return table(t, *given, **options)
    rule: Any = _rule_of(table)
    rule = partial(rule, table)
    if isinstance(t, Symbol):
        return rule(t, *given, **options)
    return as_symbols([rule(each, *given, **options) for each in as_symbols(t)])
