"""What functions of scripts for SciPy call: arrays that f fills, `math`, interpolation of SciPy."""

from __future__ import annotations

import functools
import math
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FunctionType
from typing import Any

import numpy as np

from .symbols import MAKERS, Symbol, Symbols, Untraceable, interpolated

_OF_MATH = {
    "fabs": "abs", "pow": "power", "asin": "arcsin", "acos": "arccos", "atan": "arctan",
    "atan2": "arctan2", "asinh": "arcsinh", "acosh": "arccosh", "atanh": "arctanh",
    **{name: name for name in "sin cos tan sinh cosh tanh exp log sqrt cbrt log10 log2 log1p "
       "expm1 exp2 hypot floor ceil trunc degrees radians".split()},
}  # fmt: skip
_FILLED = "empty", "full", "ones", "zeros", "empty_like", "full_like", "ones_like", "zeros_like"
_PLAIN = {name: getattr(np, name) for name in {*MAKERS, *_FILLED}}


def _has_symbols(values: Any) -> bool:
    return any(
        isinstance(a, (Symbol, Symbols)) or (type(a) in (list, tuple) and _has_symbols(a))
        for a in values
    )


def _either(plain: Any, traced: Any) -> Any:
    """Return a function that calls `traced` for symbols and `plain` for numbers."""

    @functools.wraps(plain)
    def function(*given: Any, **options: Any) -> Any:
        return (traced if _has_symbols(given) else plain)(*given, **options)

    return function


def _extreme(ufunc: Any, *given: Any) -> Any:
    return functools.reduce(ufunc, given[0] if len(given) == 1 else given)


_OF_PYTHON = {
    "max": _either(max, functools.partial(_extreme, np.maximum)),
    "min": _either(min, functools.partial(_extreme, np.minimum)),
}
_FAR = {*sys.stdlib_module_names, "suslov_fast"} - {"__main__"}


def _log(a: Any, base: Any = math.e) -> Any:
    return np.log(a) if base == math.e else np.log(a) / np.log(base)


# ------------------------------------------------------------------------------ arrays
def _making(name: str, make: Any, is_users: Callable[[Any], bool]) -> Any:
    """Return a function such as `np.zeros`, whose arrays of floats f can fill with symbols."""

    def function(*given: Any, **options: Any) -> Any:
        if not is_users(sys._getframe(1)):
            return make(*given, **options)
        if name not in _FILLED:  # np.array and np.asarray
            if options.get("dtype") in (float, np.float64) and _has_symbols(given):
                del options["dtype"]
            return make(*given, **options)
        array = make(*given, **options)
        if array.dtype != np.float64 or array.ndim == 0:
            return array
        if name.startswith("empty"):
            array[...] = np.nan
        return array.astype(object).view(Symbols)

    # Other threads may pickle the function meanwhile.
    function.__module__, function.__name__, function.__qualname__ = "numpy", name, name
    return function


# ------------------------------------------------------------------------------ tables
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
    """Return the value of a `PPoly` at symbols."""
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
    return parts[0] if table.c.ndim == 2 else np.array(parts).reshape(table.c.shape[2:])


def _spline(table: Any, t: Any, nu: int = 0, extrapolate: Any = None) -> Any:
    """Return the value of a `BSpline` at symbols."""
    from scipy.interpolate import PPoly

    table = table.derivative(nu) if nu else table
    k, c = table.k, table.c.reshape(len(table.c), -1)
    ends = slice(k, len(table.t) - k)
    extrapolate = table.extrapolate if extrapolate is None else extrapolate
    parts = []
    for column in c.T:
        polynomial = PPoly.from_spline((table.t, column, k))
        kept = PPoly(polynomial.c[:, k : len(table.t) - k - 1], polynomial.x[ends], extrapolate)
        exists = np.diff(kept.x) > 0
        kept = PPoly(kept.c[:, exists], kept.x[[*exists, True]], extrapolate)
        parts.append(_ppoly(kept, t))
    return parts[0] if table.c.ndim == 1 else np.array(parts).reshape(table.c.shape[1:])


def _interp1d(table: Any, t: Any) -> Any:
    """Return the value of an `interp1d` at symbols."""
    kind, x, y = table._kind, table.x, np.asarray(table.y, float)
    if y.ndim != 1:
        raise Untraceable("interp1d of several rows: write one interp1d for each")
    if kind == "spline":
        value = _spline(table._spline, t, extrapolate=True)
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


def _tables() -> list[tuple[Any, Any]]:
    """Return the classes of SciPy whose objects are tables, if a script imported them."""
    if "scipy.interpolate" not in sys.modules:
        return []
    from scipy.interpolate import BSpline, PPoly, interp1d

    found = [(PPoly, _ppoly), (BSpline, _spline), (interp1d, _interp1d)]
    return [(next(a for a in of.__mro__ if "__call__" in vars(a)), new) for of, new in found]


def _called(plain: Any, traced: Any) -> Any:
    @functools.wraps(plain)
    def function(self: Any, t: Any, *given: Any, **options: Any) -> Any:
        if not _has_symbols([t]):
            return plain(self, t, *given, **options)
        if isinstance(t, Symbol):
            return traced(self, t, *given, **options)
        return np.array([traced(self, each, *given, **options) for each in t])

    return function


# ------------------------------------------------------------------------------ namespaces
def _spaces_of(f: Any) -> list[dict[str, Any]]:
    """Return the global names of f, and of functions of the user's files that f calls."""
    for name in ("function", "func", "__func__", "py_func"):  # Timed, partial, methods, Numba
        f = getattr(f, name, f)
    if not isinstance(f, FunctionType):
        f = getattr(type(f), "__call__", None)  # noqa: B004
    seen: dict[int, dict[str, Any]] = {}
    functions, stack = set[int](), [f]
    while stack:
        f = getattr((each := stack.pop()), "py_func", each)
        is_far = bool(functions) and not _is_near(f)
        if not isinstance(f, FunctionType) or id(f) in functions or is_far:
            continue
        functions.add(id(f))
        seen[id(f.__globals__)] = f.__globals__
        stack += [f.__globals__[name] for name in f.__code__.co_names if name in f.__globals__]
        for cell in f.__closure__ or ():
            with suppress(ValueError):  # if the name has no value yet
                stack.append(cell.cell_contents)
    return [*seen.values()]


def _is_near(f: Any) -> bool:
    """Return True for a function in a file of the user."""
    if not isinstance(f, FunctionType) or "-packages" in f.__code__.co_filename:
        return False
    return str(f.__globals__.get("__name__")).partition(".")[0] not in _FAR


@contextmanager
def as_in_scripts(f: Any) -> Iterator[None]:
    """Let f, and the functions that it calls, use symbols where scripts for SciPy have numbers.

    During the block `math`, tables of SciPy, and functions such as `np.zeros` that are called in
    files of the user, take symbols; for numbers, and for other threads, all of them are as before.
    """
    spaces, caller = _spaces_of(f), threading.get_ident()
    known = {*map(id, spaces)}

    def is_users(frame: Any) -> bool:
        is_near = id(frame.f_globals) in known or "-packages" not in frame.f_code.co_filename
        return is_near and threading.get_ident() == caller

    of_math = {k: _either(getattr(math, k), getattr(np, v)) for k, v in _OF_MATH.items()}
    of_math["log"] = _either(math.log, _log)
    of_numpy = {name: _making(name, getattr(np, name), is_users) for name in _PLAIN}
    new_of = {id(getattr(math, k)): v for k, v in of_math.items()}
    new_of |= {id(_PLAIN[k]): v for k, v in of_numpy.items()}
    changes = [(vars(math), of_math), (vars(np), of_numpy)]
    for space in spaces:
        names = {k: new_of[id(v)] for k, v in space.items() if id(v) in new_of}
        changes.append((space, {k: v for k, v in _OF_PYTHON.items() if k not in space} | names))
    tables = [(of, vars(of)["__call__"], new) for of, new in _tables()]
    old = [{k: space[k] for k in new if k in space} for space, new in changes]
    try:
        for space, new in changes:
            space.update(new)
        for of, call, value in tables:
            of.__call__ = _called(call, value)
        yield
    finally:
        for of, call, _ in tables:
            of.__call__ = call
        for (space, new), before in zip(changes, old, strict=True):
            for name in new.keys() - before.keys():
                space.pop(name, None)
            space.update(before)
