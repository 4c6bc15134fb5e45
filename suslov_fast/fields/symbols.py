"""Symbolic numbers and arrays of them, with which functions of users are called.

A symbolic number is a value of a list of operations (`core.expressions`). A function of NumPy that
is called with symbolic numbers, or with arrays of them, calls the methods here. Arrays keep the
class `Symbols`, so that comparisons, `np.where` and similar functions work entry by entry.
"""

from __future__ import annotations

import functools
import math
import operator
import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.expressions.dense_product import ENTRY, DenseMatrix, is_large
from ..core.expressions.function_records import FUNCTIONS, OTHER_NAMES
from ..words import OF_ARRAYS, STEPS

TABLES = "np.interp or CubicSpline for a table"


class _Made(threading.local):
    count = 0  # how many errors `Untraceable` this thread has made


MADE = _Made()


class Untraceable(TypeError):
    """The function of the user contains an operation that no expression program has."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        MADE.count += 1  # f may catch the error, and would return a wrong formula


class NotReal(Untraceable):
    """A complex number stands where a real one is wanted."""


def applied(name: str, *values: Any) -> Any:
    """Return the value of a function of numbers; some of them may be symbolic."""
    tracer, has_complex = None, False
    for each in values:
        if type(each) is not float:
            has_complex = has_complex or is_complex(each)
            tracer = each.tracer if isinstance(each, Symbol) else tracer
    if tracer is None:  # numbers, such as some entries of arrays
        return _of_numbers(name, values)
    if has_complex:
        return tracer.of_complex(name, values)
    name = "positive" if name == "conjugate" else name
    if name == "where":
        condition, *rest = values
        if not isinstance(condition, Symbol):
            return rest[0] if condition else rest[1]
        operands = [tracer.truth(condition), *map(tracer.number, rest)]
    elif name.startswith(("logical", "bitwise")):
        if name.startswith("bitwise") and not all(map(_is_truth, values)):
            raise Untraceable(
                "& | ^ and ~ join comparisons, as in (x > 0) & (y > 0): a power is x**2"
            )
        operands = [*map(tracer.truth, values)]
        name = OTHER_NAMES.get(name, name)
    else:
        operands = [*map(tracer.number, values)]
    return tracer.applied(name, operands)


def is_complex(value: Any) -> bool:
    """Return True for a complex number, and for a complex symbol."""
    if isinstance(value, Symbol):
        return value.is_complex
    return isinstance(value, (complex, np.complexfloating))


def _are_truths(values: Any) -> bool:
    """Return True for an array of truth values and integers."""
    entries = np.ravel(_base(values)).tolist()
    return all(isinstance(a, int) or _is_truth(a) for a in entries)


def _begins_with_truth(value: Any) -> bool:
    first = next(value.flat, None) if isinstance(value, np.ndarray) else value
    return not is_complex(first) and _is_truth(first)


def _is_truth(value: Any) -> bool:
    if isinstance(value, Symbol):
        return bool(value.tracer.is_truth(value.operand))
    return isinstance(value, (bool, np.bool_))


def _of_numbers(name: str, values: Sequence[Any]) -> Any:
    """Return the value of a function of numbers."""
    if name in _OF_PYTHON:  # integers and fractions stay exact
        return getattr(operator, _OF_PYTHON[name])(*values)
    if not hasattr(np, name):
        from scipy import special

        return getattr(special, name)(*values)
    return getattr(np, name)(*values)


_OF_PYTHON = {
    "add": "add", "subtract": "sub", "multiply": "mul", "divide": "truediv", "negative": "neg"
}  # fmt: skip


def _rint(a: Any) -> Any:
    up = np.floor(a + 0.5)
    return np.where((up - a == 0.5) & (up % 2.0 == 1.0), up - 1.0, up)  # 2.5 becomes 2


def _copysign(a: Any, b: Any) -> Any:
    is_below = math.copysign(1.0, b) < 0.0 if isinstance(b, (int, float)) else b < 0.0
    return np.where(is_below, -abs(a), abs(a))


# Functions that are made of others, and the numbers of their operands.
_SHORTER: dict[str, tuple[Callable[..., Any], int]] = {
    "square": (lambda a: applied("power", a, 2.0), 1),
    "reciprocal": (lambda a: applied("divide", 1.0, a), 1),
    "fmax": (functools.partial(applied, "maximum"), 2),
    "fmin": (functools.partial(applied, "minimum"), 2),
    "fmod": (lambda a, b: a - b * np.trunc(a / b), 2),
    "rint": (_rint, 1),
    "copysign": (_copysign, 2),
    "isnan": (lambda a: a != a, 1),
    "isinf": (lambda a: abs(a) == math.inf, 1),
    "isfinite": (lambda a: abs(a) < math.inf, 1),
}


@functools.cache
def _function(name: str) -> tuple[Callable[..., Any], int]:
    """Return the function of symbolic numbers with a name of NumPy, and the number of operands."""
    if name in _SHORTER:
        return _SHORTER[name]
    word = {"invert": "bitwise_not"}.get(name, name)
    if word != "conjugate" and not word.startswith("bitwise"):
        word = OTHER_NAMES.get(word, word)
    record = FUNCTIONS.get(OTHER_NAMES.get(word, word))
    if record is None:
        known = [each for each in FUNCTIONS if not FUNCTIONS[each].sign and each != "quotient"]
        how = OF_ARRAYS.get(name)
        how = f"write {how}" if how else f"f may call {', '.join(known)}"
        raise Untraceable(f"calls {name}, which has no rule: {how}")
    return functools.partial(applied, word), record.operands


@functools.cache
def _on_arrays(name: str) -> Any:
    """Return the function of arrays of symbolic numbers with a name of NumPy."""
    return np.frompyfunc(*_function(name), 1, identity=None)  # so that all axes can be reduced


def _is_symbolic(value: Any) -> bool:
    """Return True for a symbol, and for an array that may contain symbols."""
    if isinstance(value, np.ndarray):
        return bool(value.dtype == object)
    return isinstance(value, Symbol)


def has_symbols(values: Any) -> bool:
    """Return True if symbols, or arrays that may contain them, are in a list, or in lists in it."""
    return any(_is_symbolic(a) or (type(a) in (list, tuple) and has_symbols(a)) for a in values)


def as_symbols(value: Any, whole: bool = True) -> Any:
    """Return a list or tuple with symbols as an array of them; other values as they are.

    Rows of different lengths stay a list, and a list of arrays does unless it is to be one `whole`.
    """
    if type(value) not in (list, tuple) or not has_symbols(value):
        return value
    rows = [as_symbols(a, whole) if type(a) in (list, tuple) else a for a in value]
    is_of_lists = not any(isinstance(a, np.ndarray) for a in value)
    if list in (kinds := {*map(type, rows)}) or tuple in kinds:
        return type(value)(rows)
    shapes = {np.shape(a) for a in rows}
    if len(shapes) > 1:
        return type(value)(rows)
    if shapes == {()}:
        return Symbols.of(rows)
    return np.stack(rows).view(Symbols) if whole or is_of_lists else type(value)(rows)


def _carried_out(self: Any, ufunc: Any, method: Any, *inputs: Any, **kwargs: Any) -> Any:
    """Return the value of a function of NumPy at symbolic numbers, as `__array_ufunc__`."""
    name = ufunc.__name__
    if isinstance(kwargs.get("out", (None,))[0], Symbol):
        raise Untraceable(f"np.{name} is to write into a variable, by out= or one operand too many")
    is_product = ufunc is np.matmul and method == "__call__"
    if is_product and (product := _product(*inputs)) is not None:
        return product
    is_of_user = not hasattr(np, name) and name not in _METHODS and "(" in name  # from np.vectorize
    if ufunc.signature is not None or is_of_user:  # NumPy computes these by methods of symbols
        return _wrapped(getattr(ufunc, method)(*map(_base, inputs), **_bases(name, kwargs)))
    if ufunc is np.add and method == "__call__" and all(map(_begins_with_truth, inputs)):
        raise Untraceable(
            "a sum of two comparisons is 2 for numbers of Python, True for NumPy's: write "
            "1.0 * (a > b) + (c > d), or | for or"
        )
    function, _ = _function(name)
    if np.dtype(kwargs.get("dtype") or float).kind in "biu" and not _are_truths(inputs[0]):
        raise Untraceable(f"np.{name} makes integers of symbols: write np.trunc(x), without dtype")
    if method == "__call__" and not kwargs and not any(map(_is_array, inputs)):
        return function(*inputs)
    out = kwargs.get("out")
    on_arrays = getattr(_on_arrays(name), method)
    result = on_arrays(*map(_base, inputs), **_bases(name, kwargs))
    return out[0] if out and out[0] is not None else _wrapped(result)


def _product(a: Any, b: Any) -> Any:
    """Return the product of a large matrix of numbers and a vector as one operation, else None."""
    if isinstance(a, Symbols) and not isinstance(b, Symbols):
        a, b = np.asarray(b).T, a  # v @ W
    if not isinstance(b, Symbols) or b.ndim != 1 or isinstance(a, Symbols):
        return None
    a = np.asarray(a)
    if a.ndim != 2 or a.dtype.kind not in "fiubc" or a.shape[1] != len(b) or not is_large(a):
        return None
    tracer = next((each.tracer for each in b if isinstance(each, Symbol)), None)
    if tracer is None or not (tracer.has_products and np.isfinite(a).all()):
        return None
    if a.dtype.kind == "c" or any(map(is_complex, b)):
        real, imag = a.real @ b.real, a.real @ b.imag
        if a.dtype.kind == "c":
            real, imag = real - a.imag @ b.imag, imag + a.imag @ b.real
        return _wrapped(np.frompyfunc(tracer.complex_of, 2, 1)(*map(_base, (real, imag))))
    emit = tracer.values.emit
    whole = emit(DenseMatrix(a), *map(tracer.number, b))
    return Symbols.of([Symbol(tracer, emit(ENTRY, whole, float(i))) for i in range(len(a))])


def _is_array(value: Any) -> bool:
    return isinstance(value, (np.ndarray, list, tuple))


def _bases(name: str, options: dict[str, Any]) -> dict[str, Any]:
    """Return the options of a function of NumPy for its call with arrays of objects."""
    for each in options.get("out", ()):
        if isinstance(each, np.ndarray) and each.dtype != object:
            how = "make it np.zeros(n, object), or write a = a + b in place of a += b"
            raise Untraceable(f"np.{name} writes symbols into an array of {each.dtype}: {how}")
    if _is_symbolic(options.get("where")):
        raise Untraceable(f"where of np.{name} depends on x: write np.where(condition, a, b)")
    others = {key: value for key, value in options.items() if key not in ("dtype", "subok")}
    if "out" in others:
        others["out"] = tuple(map(_base, others["out"]))
    return others


def _base(value: Any) -> Any:
    """Return symbols as a plain array of objects, with which NumPy computes entry by entry."""
    if isinstance(value, Symbols):
        return value.view(np.ndarray)
    if isinstance(value, Symbol):
        array = np.empty((), object)
        array[()] = value
        return array
    return np.asarray(value, object) if _is_array(value) else value


def _wrapped(value: Any) -> Any:
    """Return an array of objects, or arrays in a list or tuple, as `Symbols`."""
    if type(value) in (list, tuple) and any(map(_is_symbolic, value)):
        return type(value)(map(_wrapped, value))
    if isinstance(value, np.ndarray) and value.dtype == object:
        return value.view(Symbols)
    return value


def _where(condition: Any, *values: Any) -> Any:
    if len(values) != 2:
        raise Untraceable("np.where(condition) finds places: write np.where(condition, a, b)")
    return _wrapped(_on_arrays("where")(_base(condition), *map(_base, values)))


def _clip(a: Any, a_min: Any = None, a_max: Any = None, **options: Any) -> Any:
    least, most = options.pop("min", a_min), options.pop("max", a_max)
    if least is None or most is None or options:
        a = a if least is None else np.maximum(a, least, **options)
        return a if most is None else np.minimum(a, most, **options)
    return _wrapped(_on_arrays("clip")(*map(_base, (a, least, most))))


def _select(condlist: Any, choicelist: Any, default: Any = 0) -> Any:
    result = default
    for condition, choice in reversed([*zip(condlist, choicelist, strict=True)]):
        result = _where(condition, choice, result)
    return result


def interpolated(
    x: Any, xp: Any, fp: Any, left: Any = None, right: Any = None, period: Any = None
) -> Any:
    """Return ``np.interp`` of numbers x, some of them symbolic, in a table of numbers."""
    try:
        knots, heights = (np.array(a, np.float64) for a in (xp, fp))
        before = float(heights[0] if left is None else left)
        after = float(heights[-1] if right is None else right)
    except (TypeError, IndexError):
        how = "a table of numbers, with x alone a symbol"
        raise Untraceable(f"np.interp takes {how}: for other points write np.where") from None
    is_table = knots.ndim == 1 and knots.shape == heights.shape
    if not is_table or not (np.isfinite(knots).all() and np.isfinite(heights).all()):
        raise Untraceable("xp and fp of np.interp must be finite, and have one length")
    if period is not None:  # one turn, with the last knot before it and the first one after it
        turn = abs(float(period))
        if not 0.0 < turn < math.inf:
            raise Untraceable("the period of np.interp must be finite, and not 0")
        x, knots = np.mod(x, turn), knots % turn
        order = np.argsort(knots, kind="stable")
        knots = np.concatenate([[knots[order[-1]] - turn], knots[order], [knots[order[0]] + turn]])
        heights = heights[[order[-1], *order, order[0]]]
    if (np.diff(knots) < 0).any():
        raise Untraceable("xp of np.interp must not decrease; equal neighbours are a jump")
    tables = tuple(knots.tolist()), tuple(heights.tolist()), before, after

    def of_one(each: Any) -> Any:
        if not isinstance(each, Symbol):
            return np.interp(each, knots, heights, before, after)
        return each.tracer.applied("interp", [each.tracer.number(each)], *tables)

    if not _is_array(x):
        return of_one(x)
    if isinstance(x, np.ndarray) and x.dtype != object:  # all entries are numbers
        return np.interp(x, knots, heights, before, after)
    return _wrapped(np.frompyfunc(of_one, 1, 1)(_base(x)))


def _isclose(a: Any, b: Any, rtol: float = 1e-5, atol: float = 1e-8, **_: Any) -> Any:
    return abs(a - b) <= atol + rtol * abs(b)


def _piecewise(x: Any, conditions: Any, functions: Any, *given: Any, **options: Any) -> Any:
    values = [f(x, *given, **options) if callable(f) else f for f in functions]
    last = values.pop() if len(values) > len(conditions) else 0.0
    return _select(conditions[::-1], values[::-1], last)  # NumPy takes the last one that is true


_FUNCTIONS: dict[Any, Callable[..., Any]] = {
    np.isclose: _isclose,
    np.piecewise: _piecewise,
    np.where: _where,
    np.sinc: lambda x: np.where(x == 0.0, 1.0, np.sin(math.pi * x) / (math.pi * x)),
    np.round: lambda a, decimals=0: np.rint(a * 10.0**decimals) / 10.0**decimals,
    np.around: lambda a, decimals=0: np.rint(a * 10.0**decimals) / 10.0**decimals,
    np.fix: lambda x: np.trunc(x),
    np.nan_to_num: lambda x, copy=True, nan=0.0: np.where(x == x, x, nan),
    np.clip: _clip,
    np.interp: interpolated,
    np.select: _select,
    # Functions of NumPy that ask for the type of an array, which is "object" here.
    np.angle: lambda z, deg=False: _on_angles(z) * (180.0 / math.pi if deg else 1.0),
    np.correlate: lambda a, v, *mode: _plain("correlate", a, np.conj(v), *mode),
    np.iscomplex: lambda z: np.imag(z) != 0,
    np.iscomplexobj: lambda z: _are_complex(z),
    np.isrealobj: lambda z: not _are_complex(z),
    np.gradient: lambda *given, **options: _gradient(*given, **options),
    np.linalg.norm: lambda z, *others, **options: _norm(z, *others, **options),
}


def _gradient(f: Any, spacing: Any = 1.0, *others: Any, axis: Any = 0, edge_order: Any = 1) -> Any:
    """Return np.gradient of a vector, from the gradients of unit vectors."""
    if others or np.ndim(f) != 1 or axis not in (None, 0, -1) or has_symbols([spacing]):
        raise Untraceable("np.gradient of symbols takes a vector, and places of numbers")
    unit = np.eye(len(f), dtype=complex if np.iscomplexobj(spacing) else float)  # for NumPy 1
    weights: Any = np.gradient(unit, spacing, axis=0, edge_order=edge_order)
    return np.array([row[row != 0.0] @ f[row != 0.0] for row in weights], object).view(Symbols)


def _on_angles(z: Any) -> Any:
    return _wrapped(np.frompyfunc(functools.partial(applied, "angle"), 1, 1)(_base(z)))


def _are_complex(z: Any) -> bool:
    return any(map(is_complex, np.ravel(_base(z)).tolist()))


def _norm(z: Any, ord: Any = None, axis: Any = None, keepdims: bool = False) -> Any:
    is_plain = ord is None or (ord, np.ndim(z)) in ((2, 1), ("fro", 2), ("f", 2))
    if axis is None and is_plain and _are_complex(z):
        return np.sqrt(np.sum(abs(np.ravel(z)) ** 2))
    return _plain("linalg.norm", z, ord, axis, keepdims)


def _plain(name: str, *given: Any) -> Any:
    """Return the value of NumPy's code of a function, without its dispatch."""
    function: Any = operator.attrgetter(name)(np)
    return _wrapped(function._implementation(*given))


def _of_function(self: Any, func: Any, types: Any, args: Any, kwargs: Any) -> Any:
    """Return the value of a function of NumPy that is no ufunc, as `__array_function__`."""
    before = MADE.count
    try:
        return _by_rule(func, args, kwargs)
    except (TypeError, ValueError):
        numbers = [_of_only_numbers(a) for a in args]
        if not any(a is not b for a, b in zip(numbers, args, strict=True)):
            raise
        MADE.count = before
        return func(*numbers, **kwargs)


def _of_only_numbers(a: Any) -> Any:
    """Return an array that f could have filled with symbols, but filled with numbers, as floats."""
    is_filled = isinstance(a, Symbols) and not any(isinstance(each, Symbol) for each in a.flat)
    return np.array(a.view(np.ndarray), float) if is_filled else a


def _by_rule(func: Any, args: Any, kwargs: Any) -> Any:
    is_product = func is np.dot and len(args) == 2 and not kwargs
    if is_product and (product := _product(*args)) is not None:
        return product
    if func in _FUNCTIONS:
        return _FUNCTIONS[func](*args, **kwargs)
    if func.__name__ in OF_ARRAYS or not hasattr(func, "_implementation"):
        _function(func.__name__)
    if func.__name__ not in _OF_COMPLEX and any(map(_has_complex, [*args, *kwargs.values()])):
        raise Untraceable(
            f"np.{func.__name__} has no rule for complex numbers: pass z.real, z.imag"
        )
    # NumPy's code of the function, without its dispatch. If a later NumPy has no such attribute,
    # the line above raises the error of a function without a rule.
    return _wrapped(func._implementation(*args, **kwargs))


# Functions of NumPy that have the same values for complex symbols as for complex numbers. Others
# may ask for the type of an array, which is "object" here, or compare numbers.
_OF_COMPLEX = frozenset(
    "append array_split atleast_1d atleast_2d atleast_3d average block broadcast_arrays "
    "broadcast_to choose column_stack concat concatenate convolve copy correlate cross cumprod "
    "cumsum cumulative_prod cumulative_sum delete diag diagflat diagonal diff dot dstack "
    "ediff1d einsum empty_like expand_dims fftshift flip fliplr flipud full_like hsplit hstack "
    "ifftshift imag inner insert isreal ix_ kron linspace logspace matmul matrix_norm "
    "matrix_transpose mean meshgrid moveaxis multi_dot ndim ones_like outer pad permute_dims "
    "polyadd polyder polyint polymul polysub polyval prod ravel real repeat reshape resize roll "
    "rollaxis rot90 shape size split squeeze stack std sum swapaxes take tensordot tile trace "
    "transpose trapezoid trapz tril triu unstack vander var vdot vecdot vector_norm vsplit "
    "vstack zeros_like".split()
)


def _has_complex(value: Any) -> bool:
    if isinstance(value, (list, tuple)):
        return any(map(_has_complex, value))
    return _are_complex(value) if isinstance(value, np.ndarray) else is_complex(value)


class Symbols(np.ndarray[Any, Any]):
    """An array of symbolic numbers, or of symbolic numbers and numbers."""

    _op_priority = 20.0  # numbers of SymPy, which have 10, leave operations to symbols
    __array_priority__ = 20.0  # methods of arrays, such as W.dot(x), return `Symbols`
    __array_ufunc__, __array_function__ = _carried_out, _of_function

    @classmethod
    def of(cls, symbols: Sequence[Symbol]) -> Symbols:
        # An assignment of the list takes ten times as long: it asks each symbol if it is an array.
        return np.fromiter(symbols, object, len(symbols)).view(cls)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, (Symbol, Symbols)):
            how = f"write np.where(condition, a, b), {STEPS}, or a sum over all entries"
            raise Untraceable(f"an index of an array depends on x, such as x[x > 0]: {how}")
        if isinstance(index, str):
            raise Untraceable(f"components have numbers in f: write x[0] in place of x[{index!r}]")
        return super().__getitem__(index)

    def __setitem__(self, index: Any, value: Any) -> None:
        if isinstance(index, Symbols) and index.shape == self.shape and np.ndim(value) == 0:
            index, value = ..., np.where(index, value, self)  # x[x < 0] = 0
        super().__setitem__(index, value)

    def astype(self, dtype: Any, *given: Any, **options: Any) -> Any:
        entries, kind = self.view(np.ndarray).ravel().tolist(), np.dtype(dtype).kind
        if has_symbols(entries) and (kind in "fc" or _are_truths(self)):
            return self + 0.0
        return super().astype(dtype, *given, **options)

    @property  # type: ignore[misc]
    def real(self) -> Any:
        return _part("real", self)

    @property  # type: ignore[misc]
    def imag(self) -> Any:
        return _part("imag", self)

    def __bool__(self) -> bool:
        if self.size == 1:
            return bool(self.item())
        raise asked("an array of conditions")


def asked(what: str) -> Exception:
    """Return the error of a function that asks whether a symbolic value is true."""
    how = "np.where(condition, a, b), & | ~ in place of and, or, not, and no loop until x is small"
    return Untraceable(
        f"asks too often whether conditions are true, such as {what}: an `if`, `and`, `max` or "
        f"`while` of x has up to 64 paths: write {how}"
    )


class Symbol(np.lib.mixins.NDArrayOperatorsMixin):
    """A symbolic number, for which f computes as for a number."""

    __slots__ = ("operand", "tracer")
    tracer: Any
    is_complex = False
    __hash__ = object.__hash__
    _op_priority = Symbols._op_priority
    __array_ufunc__, __array_function__ = _carried_out, _of_function

    def __init__(self, tracer: Any, operand: Any) -> None:
        self.tracer, self.operand = tracer, operand

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Return a method such as `sin`, which NumPy calls for each entry of an array."""
            if name.startswith("_") or not (name in _METHODS or name in OF_ARRAYS):
                raise AttributeError(f"a symbol has no attribute {name!r}: it is a number")
            return functools.partial(_function(name)[0], self)

    def conjugate(self) -> Symbol:
        """Return the number, which is real; products of NumPy call this."""
        return self

    conj, real, imag = conjugate, property(conjugate), 0.0

    def __bool__(self) -> bool:
        if self.tracer.decide is None:
            raise asked(str(self))
        return bool(self.tracer.decide(self))

    def __format__(self, how: str) -> str:
        return str(self)  # functions may print what they compute

    def _converted(self, *_: Any) -> Any:
        why = "is a symbol without a value, which is no float"
        how = f"write np.sin for sin of SymPy, {TABLES}"
        raise Untraceable(f"{self} {why}: {how}")

    __float__ = __complex__ = _converted

    def _as_integer(self) -> int:
        why = "is a symbol without a value, so it is no index, and int cannot convert it"
        how = f"np.floor(x) for int(x), {STEPS} for values[k] from knots[k] on"
        raise Untraceable(f"{self} {why}: write {how}")

    __int__ = __index__ = _as_integer

    def __floor__(self) -> Any:
        return applied("floor", self)

    def __ceil__(self) -> Any:
        return applied("ceil", self)

    def __repr__(self) -> str:
        return str(self.tracer.text(self.operand))


_METHODS = {*FUNCTIONS, *OTHER_NAMES, *_SHORTER}
for _name in ("add", "sub", "mul", "truediv", "floordiv", "mod", "pow", "and", "or", "xor"):
    # x += y makes x another symbol, because no symbol changes in place.
    setattr(Symbol, f"__i{_name}__", getattr(Symbol, f"__{_name}__"))


def _part(name: str, array: Symbols) -> Any:
    return _wrapped(np.frompyfunc(operator.attrgetter(name), 1, 1)(_base(array)))
