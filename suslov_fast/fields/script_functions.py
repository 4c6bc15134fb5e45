"""What a function finds in place of `np.zeros`, `math.sin`, `max` and others: they take symbols."""

from __future__ import annotations

import cmath
import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from .linear_algebra import det, inv, linear, solve
from .symbols import Symbol, Symbols, Untraceable, applied, as_symbols, has_symbols, is_complex

_OF_MATH = {
    "fabs": "abs", "pow": "power", "asin": "arcsin", "acos": "arccos", "atan": "arctan",
    "atan2": "arctan2", "asinh": "arcsinh", "acosh": "arccosh", "atanh": "arctanh",
    **{name: name for name in "sin cos tan sinh cosh tanh exp sqrt cbrt log10 log2 log1p expm1 "
       "exp2 hypot floor ceil trunc degrees radians copysign fmod isnan isfinite isinf".split()},
}  # fmt: skip
_FILLED = "empty", "full", "ones", "zeros", "empty_like", "full_like", "ones_like", "zeros_like"
_OF_NUMBERS = "array", "asarray", "ascontiguousarray", "eye", "identity"
_OF_ROWS = {Symbol, float, int}


def either(plain: Any, traced: Any) -> Any:
    """Return a function that calls `traced` for symbols and `plain` for numbers."""

    @functools.wraps(plain)
    def function(*given: Any, **options: Any) -> Any:
        return (traced if has_symbols(given) else plain)(*given, **options)

    return function


def entry_by_entry(function: Any) -> Any:
    """Return a function of numbers as one of arrays, as `np.vectorize` does."""

    def of_arrays(*given: Any, **options: Any) -> Any:
        one = functools.partial(function, **options)
        arrays = [np.asarray(a, object).view(np.ndarray) for a in given]
        found = np.frompyfunc(one, len(given), 1)(*arrays)
        return found.view(Symbols) if isinstance(found, np.ndarray) else found

    return of_arrays


def _vectorize(function: Any, *given: Any, **options: Any) -> Any:
    return either(np.vectorize(function, *given, **options), entry_by_entry(function))


def _extreme(plain: Any, ufunc: Any, *given: Any, key: Any = None, default: Any = None) -> Any:
    if key is not None:
        return plain(*given, key=key)
    return functools.reduce(ufunc, given[0] if len(given) == 1 else given)


def _isinstance(value: Any, kinds: Any) -> bool:
    """Return the answer for a float64 or complex128, if the value is a symbol."""
    if not isinstance(value, Symbol):
        return isinstance(value, kinds)
    return issubclass(np.complex128 if value.is_complex else np.float64, kinds)


def _log(a: Any, base: Any = math.e) -> Any:
    return np.log(a) if base == math.e else np.log(a) / np.log(base)


def _of_reals(name: str, function: Any) -> Any:
    def of_reals(*given: Any) -> Any:
        if any(map(is_complex, given)):
            raise Untraceable(f"math.{name} takes real numbers: write cmath.{name}")
        return function(*given)

    return of_reals


def _distance(a: Any, b: Any) -> Any:
    return np.sqrt(np.sum((np.asarray(a) - np.asarray(b)) ** 2))


def _real(a: Any) -> Any:
    a = a.item() if isinstance(a, Symbols) else a
    if isinstance(a, Symbol) and a.is_complex:
        raise Untraceable(f"float of {a}, which is complex: take z.real, z.imag or abs(z)")
    return a


class _Number(type):
    """The class of `float` and `complex` where they take symbols: of numbers, they are the same."""

    of: Any
    convert: Any

    def __call__(cls, *given: Any, **options: Any) -> Any:
        return (cls.convert if has_symbols(given) else cls.of)(*given, **options)

    def __instancecheck__(cls, value: Any) -> bool:
        return isinstance(value, cls.of)

    def __subclasscheck__(cls, other: Any) -> bool:
        return issubclass(other, cls.of)

    def __eq__(cls, other: object) -> bool:
        return other is cls or other is cls.of

    def __hash__(cls) -> int:
        return hash(cls.of)

    def __getattr__(cls, name: str) -> Any:
        return getattr(cls.of, name)


class _Float(metaclass=_Number):
    of, dtype = float, np.dtype(float)  # `dtype` is what NumPy takes it for
    convert = staticmethod(_real)


class _Float64(metaclass=_Number):
    of, dtype = np.float64, np.dtype(float)
    convert = staticmethod(_real)


class _Complex(metaclass=_Number):
    of, dtype = complex, np.dtype(complex)
    convert = staticmethod(lambda real, imag=0.0: real + 1j * imag if has_symbols([imag]) else real)


OF_BUILTINS = {
    "max": either(max, functools.partial(_extreme, max, np.maximum)),
    "min": either(min, functools.partial(_extreme, min, np.minimum)),
    "round": either(round, lambda a, digits=0: np.round(a, digits)),
    "divmod": either(divmod, lambda a, b: (a // b, a % b)),
    "isinstance": _isinstance,
    "float": _Float,
    "complex": _Complex,
}


def _in_place() -> dict[int, tuple[Any, Any]]:
    """Return the table of functions of `math` and `cmath`."""
    pairs = [(getattr(math, a), _of_reals(a, getattr(np, b))) for a, b in _OF_MATH.items()]
    pairs += [(getattr(cmath, a), getattr(np, b)) for a, b in _OF_MATH.items() if hasattr(cmath, a)]
    pairs += [(of.log, _log) for of in (math, cmath)] + [(cmath.phase, np.angle)]
    pairs += [(math.fsum, sum), (math.dist, _distance)]
    pairs += [(np.isscalar, lambda a: isinstance(a, Symbol))]
    of_errors = "erf", "erfc"
    pairs += [(getattr(math, name), functools.partial(applied, name)) for name in of_errors]
    return {id(plain): (plain, either(plain, traced)) for plain, traced in pairs}


def _is_row(value: Any) -> bool:
    """Return True for a list of symbols and numbers."""
    return type(value) in (list, tuple) and _OF_ROWS.issuperset(map(type, value))


def _filling(make: Any, fills_all: bool) -> Callable[..., Any]:
    """Return a function such as `np.zeros`, whose arrays of floats f can fill with symbols."""
    name = make.__name__

    @functools.wraps(make)
    def function(*given: Any, **options: Any) -> Any:
        if name in _OF_NUMBERS and has_symbols(given):
            if name.endswith("array") and len(given) == 1 and not options and _is_row(given[0]):
                return Symbols.of(given[0])  # for speed
            dtype = given[1] if len(given) > 1 else options.pop("dtype", None)
            array = make(given[0], **options).view(Symbols)
            return array if dtype is None else array.astype(dtype)
        array = make(*given, **options)
        fills = name in _FILLED or fills_all
        if not fills or array.dtype.char not in "dD" or array.ndim == 0:
            return array
        if name.startswith("empty"):
            array[...] = np.nan
        return array.astype(object).view(Symbols)

    return function


_OF_MATRICES = {"solve": solve, "inv": inv, "det": det}
_LINEAR = "fft", "ifft", "rfft", "irfft", "dct", "idct", "dst", "idst", "diff", "hilbert"
_OF_SCIPY = "scipy.linalg", "scipy.fft", "scipy.fftpack"


def _with_numbers(plain: Any, traced: Any) -> Any:
    """Return a function of matrices; those of numbers that f filled go to `plain`."""

    @functools.wraps(plain)
    def function(*given: Any, **options: Any) -> Any:
        if not has_symbols(given):
            return plain(*given, **options)
        arrays = [np.asarray(a, object) for a in given]
        if any(isinstance(each, Symbol) for a in arrays for each in a.ravel()):
            return traced(*given, **options)
        return plain(*(np.real_if_close(a.astype(complex)) for a in arrays), **options)

    return function


def of_scipy(value: Any) -> Any:
    """Return a function of SciPy for matrices, or a transform, one for symbols; else None."""
    module, name = str(getattr(value, "__module__", "")), str(getattr(value, "__name__", ""))
    if not module.startswith(_OF_SCIPY):
        return None
    if module.startswith("scipy.linalg") and name in _OF_MATRICES:
        return _with_numbers(value, _OF_MATRICES[name])
    is_transform = name in _LINEAR and not module.startswith("scipy.linalg")
    return either(value, linear(value)) if is_transform else None


def _of_numpy() -> list[tuple[Any, Any]]:
    pairs = [(getattr(np.linalg, name), rule) for name, rule in _OF_MATRICES.items()]
    transforms = [getattr(np.fft, name) for name in _LINEAR[:4]]
    return pairs + [(f, linear(f)) for f in transforms]


def _exchanged(fills_all: bool) -> dict[int, tuple[Any, Any]]:
    made = [getattr(np, name) for name in (*_FILLED, *_OF_NUMBERS)]
    table = {id(f): (f, _with_numbers(f, rule)) for f, rule in _of_numpy()}
    table |= {id(np.float64): (np.float64, _Float64), id(np.vectorize): (np.vectorize, _vectorize)}
    return table | _in_place() | {id(make): (make, _filling(make, fills_all)) for make in made}


# Functions, by their ids, with those in their place. With the second table f can also fill arrays
# of its own numbers, as np.array([0.0, 0.0]).
IN_PLACE, IN_PLACE_FILLING_ALL = _exchanged(False), _exchanged(True)


class _TakingLists:
    """A function of NumPy, for which lists with symbols are arrays of them."""

    def __init__(self, function: Any) -> None:
        self._function = function

    def __call__(self, *given: Any, **options: Any) -> Any:
        for each in given:
            if type(each) is list or type(each) is tuple:
                whole = self._function.__name__ not in _OF_SEQUENCES
                given = tuple(as_symbols(a, whole) for a in given)
                break
        return self._function(*given, **options)

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._function, name)
        return _TakingLists(value) if callable(value) else value


# Functions of lists of arrays, which they join.
_OF_SEQUENCES = {
    *"concatenate stack hstack vstack dstack column_stack block select piecewise append".split()
}
_KINDS = np.ufunc, type(np.sum)


@functools.cache
def _taking_lists(function: Any) -> Any:
    return _TakingLists(function)


def taking_lists(value: Any) -> Any:
    """Return a function of NumPy, one that takes lists of symbols; None for other values."""
    return _taking_lists(value) if isinstance(value, _KINDS) else None
