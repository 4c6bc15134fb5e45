"""Checks of arguments; most messages read "name must be ..., not ...: what to type"."""

import inspect
import math
import numbers
import operator
import os
import re
import sys
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from decimal import Decimal
from fractions import Fraction
from importlib import import_module
from typing import Any, Protocol, SupportsFloat, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .core.numba.interrupts import uninterrupted

FloatArray = NDArray[np.float64]


class _HasArray(Protocol):
    def __array__(self) -> NDArray[Any]: ...


# Types of step sizes and times: NumPy's ArrayLike also admits text.
Reals = (
    SupportsFloat
    | _HasArray
    | Sequence[SupportsFloat]
    | Sequence[Sequence[SupportsFloat]]
    | Sequence[Sequence[Sequence[SupportsFloat]]]
)

# Types of initial states: an array, or an array for each name of a component.
StatesLike = ArrayLike | Mapping[str, ArrayLike]

_FLOAT64 = np.dtype(np.float64)
_FLOATS = {float}
_NUMBERS = {float, int, np.float64, Fraction}
# Number of elements up to which a sum in Python is faster than a call of NumPy.
_FEW = 64
# Exponents of 10 of ranges: moments of inertia and step sizes have a modulus from 1e-50 to 1e50,
# other parameters from 1e-60 to 1e60.
MOMENTS, OTHERS = 50, 60
OF_SYMBOLS = (
    "symbols have no values: formulas are report(system).integrals and, of one step, "
    "kahan(field).formulas of suslov_fast.integrability; sympy.lambdify([names], formulas) makes a "
    "function of formulas"
)
_PACKAGES = {"flint": "python-flint"}  # packages whose modules have another name
_HERE = os.path.dirname(__file__) + os.sep


def wrong(name: str, expected: str, received: object = None, error: Any = ValueError) -> Any:
    """Return the error "name must be expected, not received"; also "must have" and "must hold"."""
    must = expected if expected.startswith(("have ", "hold ")) else f"be {expected}"
    instead = "" if received is None else f", not {received}"
    return error(f"{name} must {must}{instead}")


def extra(module: str, name: str) -> Any:
    """Import and return a module that the extra `name` of the package installs."""
    try:
        with uninterrupted():
            return import_module(module)
    except ImportError as error:
        needed = _PACKAGES.get(module.partition(".")[0], module.partition(".")[0])
        how = f"pip install {needed}, or '.[{name}]' in a copy of the repository"
        raise ImportError(f"the package {needed} is not installed: {how}") from error


def warn(message: str, category: type[Warning] = UserWarning) -> None:
    """Warn at the user's line of code, which is in the first frame outside the package."""
    frame, level = sys._getframe(1), 2
    while frame.f_back and frame.f_code.co_filename.startswith((_HERE, "<string>")):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, level)


def real_array(name: str, value: ArrayLike, allow_nan: bool = False) -> FloatArray:
    """Return any array-like of real numbers as float64; they are finite, or NaN if allowed."""
    array = float_array(name, value)
    _all_finite(name, array, allow_nan)
    return array


def real_number(name: str, value: Any) -> float | FloatArray:
    """Return finite real numbers: one number as a float, which is much faster than an array."""
    if type(value) in (float, int) and -(2.0**53) <= value <= 2.0**53:
        return float(value)
    array = real_array(name, value)
    return array.item() if array.ndim == 0 else array


def one_number(name: str, value: Any, how: str = "") -> float:
    """Return a finite real number as a float."""
    number = real_number(name, value)
    if not isinstance(number, float):
        raise wrong(name, "a number", f"an array of shape {number.shape}{how}")
    return number


def positive(name: str, value: Any) -> float:
    """Return a positive finite number as a float."""
    number = one_number(name, value, ": one number, in a call for each")
    if number <= 0.0:
        raise wrong(name, "positive", short(value))
    return number


def within(name: str, value: Any, exponent: int) -> Any:
    """Return numbers that are 0, or between 10**-exponent and 10**exponent in modulus."""
    # Every `exponent` is 50 or more.
    if type(value) is float and (value == 0.0 or 1e-50 <= abs(value) <= 1e50):
        return value
    array = np.asarray(value)
    size = abs(array[array != 0])
    if size.dtype == object:
        with suppress(OverflowError):  # floats are compared much faster than fractions
            size = size.astype(np.float64)
    if len(bad := size[(size < 10.0**-exponent) | (size > 10.0**exponent)]):
        expected = f"0, or have a modulus from 1e-{exponent} to 1e{exponent}"
        raise wrong(name, expected, f"{short(bad.tolist()[0])}: use other units")
    return value


PLAIN = {np.ndarray, list, tuple}  # types of states that `start_of` leaves as they are


def start_of(value: Any, time: Any) -> tuple[Any, Any]:
    """Return states and the time at them; a motion goes on at its end, by default at its time."""
    if type(value) in PLAIN or not hasattr(value, "_last"):  # the first test is for speed
        return value, time
    states, end = value._last
    return states, end if time is None else time


def states(name: str, value: Any, labels: Sequence[str]) -> FloatArray:
    """Return states (..., D) with the components `labels`; a state with any NaN becomes all NaN."""
    if type(value) is np.ndarray:  # for speed in small calls, as the next lines
        is_one = value.dtype is _FLOAT64 and value.shape == (len(labels),)
        if is_one and len(labels) <= _FEW and math.isfinite(sum(value.tolist())):
            return value
    elif type(value) is list and len(value) == len(labels) <= _FEW:
        is_one = _FLOATS.issuperset(map(type, value))
        if is_one and math.isfinite(sum(value)):
            return np.array(value)
    array = float_array(name, unlabelled(name, value, labels, float_array))
    if len(labels) == 1 and array.shape == ():
        array = array[np.newaxis]
    if array.shape[-1:] != (len(labels),):
        received = f"{array.shape}{_advice_on_shape(array.shape, labels)}"
        last = f", with {', '.join(labels)} on the last axis" if len(labels) <= 8 else ""
        raise wrong(name, f"have the shape (..., {len(labels)}){last}", received)
    if _all_finite(name, array, allow_nan=True):
        return array
    return np.where(np.isnan(array).any(axis=-1, keepdims=True), np.nan, array)


def unlabelled(
    name: str, value: Any, labels: Sequence[str], read: Callable[[str, Any], Any]
) -> Any:
    """Return states as arrays or lists, without the names of a table of pandas or of a mapping.

    `read` makes an array of the values of a component.
    """
    if type(value) is np.ndarray:  # for speed in small calls
        return value
    if hasattr(value, "iloc") and {*labels} <= {*value.keys()}:
        return value[[*labels]].to_numpy()
    if isinstance(value, (list, tuple)) and hasattr((*value[:1], 0)[0], "iloc"):
        return [unlabelled(name, each, labels, read) for each in value]
    if isinstance(value, Mapping) and not hasattr(value, "dims"):
        if {*value} != {*labels}:
            raise wrong(name, f"a value for each of {', '.join(labels)}", short({**value}))
        parts = np.broadcast_arrays(*(read(name, value[label]) for label in labels))
        return np.stack(parts, axis=-1)
    if name in ("x0", "omega0") and getattr(value, "_called", "") == "a run":
        last = f"{kind_of(value)}: pass run.states[-1]"
        raise wrong(name, "states at one time", last, TypeError)
    return value


def _advice_on_shape(shape: tuple[int, ...], labels: Sequence[str]) -> str:
    """Return what to pass in place of states of a wrong shape, for messages; "" if unknown."""
    if shape[-1:] == (3,) and [*labels] == ["Omega1", "Omega2"]:
        return ": for vectors in the basis of a tensor pass (omega @ body.rotation.T)[..., :2]"
    if len(shape) < 2 or shape[0] != len(labels):
        return ""
    how = "np.moveaxis(x0, 0, -1)" if len(shape) > 2 else "the transpose"
    return f": pass {how}, because the last axis holds the components"


def without_fractions(value: Any) -> tuple[Any, Any]:
    """Return numbers with floats in place of fractions, and the exact numbers or None."""
    if isinstance(value, Fraction | list | tuple | np.ndarray):
        with suppress(Exception):  # for other values the caller raises an error
            exact = np.asarray(value)
            if exact.dtype.kind == "O" and any(isinstance(a, Fraction) for a in exact.flat):
                return np.vectorize(float, [object])(exact)[()], exact
    return value, None


def float_array(name: str, value: Any) -> FloatArray:
    """Return any array-like of real numbers as float64, including infinite ones and NaN."""
    if type(value) is np.ndarray and value.dtype is _FLOAT64:
        return value
    refuse(name, value)
    try:
        array = np.asarray(value)
        if array.dtype.kind == "O" and all(isinstance(each, numbers.Real) for each in array.flat):
            exact, array = array, array.astype(np.float64)
            whole = numbers.Integral, float
            if any(not isinstance(each, whole) and each != float(each) for each in exact.flat):
                warn(
                    f"{name}: fractions, and numbers of more digits, become floats here; map = "
                    "suslov_fast.integrability.kahan(field, eps), with x = map(x), keeps fractions"
                )
    except (ValueError, OverflowError) as error:
        expected = "numbers in the range of float64, with rows of equal length"
        expected += ", short ones filled with nan" * (name == "times")
        raise wrong(name, expected, short(value)) from error
    except Exception as error:  # raised by the value, such as a tensor with a gradient
        received = f"{kind_of(value)}, which is no array: {error}"
        raise wrong(name, "hold real numbers", received, TypeError) from error
    if array.dtype.kind not in "iuf":
        what = f" of dtype {array.dtype}"
        if array.dtype.kind == "c":
            what += ": a field of complex variables is Field(f, names, complex=True)"
        if array.dtype.kind == "O":
            item = next(each for each in array.flat if not isinstance(each, numbers.Real))
            what = f": {short(item)} is of the type {kind_of(item)}" * (array.ndim > 0)
            what += f": {OF_SYMBOLS}" * hasattr(item, "free_symbols")
        raise wrong(name, "hold real numbers", f"{short(value)}{what}", TypeError)
    return array if array.dtype is _FLOAT64 else array.astype(np.float64, copy=False)


def _all_finite(name: str, array: FloatArray, allow_nan: bool) -> bool:
    """Return True if all numbers are finite, False if some are NaN; others raise an error."""
    if array.size <= _FEW and math.isfinite(sum(array.ravel().tolist())):
        return True
    finite = np.isfinite(array)
    if finite.all():
        return True
    bad = np.isinf(array) if allow_nan else ~finite
    if bad.any():
        index = first_index(bad)
        where = f" at index {index}" if index else ""
        raise wrong(name, "finite", f"{array[index]}{where}")
    return False


def refuse(name: str, value: Any) -> None:
    """Raise an error for units, booleans, masked arrays and labelled axes, also inside a list."""
    if type(value) in _NUMBERS or value is None:
        return
    if getattr(getattr(value, "dtype", None), "kind", "") in ("m", "M"):
        first = f" - {name}[0]" * (value.dtype.kind == "M")
        how = f"dates: pass ({name}{first}) / np.timedelta64(1, 's') as an array"
        raise wrong(name, "numbers without a unit", how, TypeError)
    if type(value) is np.ndarray:
        value = value.ravel().tolist() if value.dtype.kind == "O" else []
    if isinstance(value, (list, tuple)):
        if not _NUMBERS.issuperset(map(type, value)):
            for item in value:
                refuse(name, item)
        return
    kind = type(value).__name__
    if isinstance(value, (bool, np.bool_)):
        raise wrong(name, "hold real numbers", f"the bool {value}", TypeError)
    if hasattr(value, "dims"):
        how = f"a labelled {kind}: pass its array, by .to_numpy()"
        raise wrong(name, "a plain array", how, TypeError)
    refuse_unit(name, value)
    if isinstance(value, np.ndarray) and np.ma.is_masked(value):
        how = "fill them first, for example by .filled(0.0)"
        raise ValueError(f"{name} is a masked array with missing values: {how}")


def refuse_unit(name: str, value: Any) -> None:
    """Raise an error for a quantity with a unit."""
    if hasattr(value, "unit") or hasattr(value, "units"):
        kind, number = type(value).__name__, "magnitude" if hasattr(value, "magnitude") else "value"
        unit = getattr(value, "unit", getattr(value, "units", None))
        how = f"convert it to the unit of the other arguments: {name}.to(...).{number}"
        raise wrong(name, "numbers without a unit", f"a {kind} in {unit}: {how}", TypeError)


def square_matrices(name: str, value: ArrayLike, n: int, allow_nan: bool = False) -> FloatArray:
    """Return matrices (..., n, n) of finite real numbers."""
    matrices = real_array(name, value, allow_nan)
    if matrices.shape[-2:] != (n, n):
        how = f": pass np.diag({name})" if matrices.shape == (n,) else ""
        raise wrong(name, f"have the shape (..., {n}, {n})", f"{matrices.shape}{how}")
    return matrices


def rotations(name: str, value: ArrayLike, n: int) -> FloatArray:
    """Return rotation matrices (..., n, n), orthogonal to 1e-10."""
    matrices = square_matrices(name, value, n)
    error = abs(matrices @ matrices.swapaxes(-2, -1) - np.eye(n)).max(initial=0.0)
    least = np.linalg.det(matrices).min(initial=1.0)
    if error > 1e-10 or least < 0:
        deviation = f"|R R.T - 1| = {error:.2g} and the determinant {least:.2g}"
        raise wrong(name, f"a rotation matrix: it has {deviation}")
    return matrices


def common_shape(shapes: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """Return the shape to which the named batch shapes broadcast."""
    others = {*filter(None, shapes.values())}
    if len(others) < 2:  # for speed in small calls
        return others.pop() if others else ()
    try:
        return np.broadcast_shapes(*shapes.values())
    except (ValueError, RuntimeError) as error:  # RuntimeError for too many axes
        received = ", ".join(f"{name} {shape}" for name, shape in shapes.items() if shape)
        how = "for all combinations insert axes of length 1, such as x[:, np.newaxis]"
        raise ValueError(f"batch shapes do not broadcast: {received}; {how}") from error


def integer(name: str, value: Any, minimum: int, expected: str = "", maximum: int = 2**62) -> int:
    """Return an integer from `minimum` to `maximum`; `expected` describes the range in messages."""
    if type(value) is int and minimum <= value <= maximum:
        return value
    expected = expected or f"an integer, {minimum} or more"
    refuse_unit(name, value)
    try:
        if isinstance(value, (bool, np.bool_)):
            raise TypeError
        # 1e3 is an integer for users, here as in the command.
        is_whole = isinstance(value, float) and value.is_integer()
        number = int(value) if is_whole else operator.index(value)
    except TypeError as error:
        received = "None" if value is None else f"the {type(value).__name__} {short(value)}"
        raise wrong(name, expected, received, TypeError) from error
    if not minimum <= number <= maximum:
        limit = ", at most 2**62" if number > maximum == 2**62 else ""
        raise wrong(name, expected + limit, short(number))
    return number


def one_of(name: str, value: Any, choices: Collection[str], instead: str = "") -> str:
    """Return a string that is one of the choices."""
    if not isinstance(value, str) or value not in choices:
        expected = "one of " * (len(choices) > 1) + ", ".join(map(repr, choices))
        raise wrong(name, expected, short(value) + instead)
    return value


def left_out(beside: str, **given: bool) -> None:
    """Raise TypeError if one of the arguments is given that must not be combined with `beside`."""
    for name in filter(given.get, given):
        raise wrong(name, f"left out beside {beside}", error=TypeError)


def signature_of(f: Any) -> inspect.Signature | None:
    """Return the signature of a function, also if Numba compiled it; None if it has none."""
    try:
        return inspect.signature(getattr(f, "py_func", f))
    except (TypeError, ValueError):
        return None


def arguments_of(f: Any) -> list[str]:
    """Return the names of the required arguments of a function; [] if it has no signature."""
    signature = signature_of(f)
    parameters = signature.parameters.values() if signature else ()
    stars = inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD
    return [a.name for a in parameters if a.default is a.empty and a.kind not in stars]


def is_false(answer: object) -> bool:
    """Return True if a user's function returned False; without `return` it returns None."""
    return isinstance(answer, bool | np.bool_) and not answer


def instance(name: str, value: Any, expected: Any) -> None:
    """Raise TypeError unless an object is of a class, or of a class in a tuple or union."""
    if not isinstance(value, expected):
        classes = expected if isinstance(expected, tuple) else get_args(expected) or (expected,)
        called = either([vars(kind).get("_called", kind.__name__) for kind in classes])
        called = "a dictionary" if expected is Mapping else called
        is_system = all(hasattr(kind, "_called") for kind in classes)
        how = ": pass a body, or a field such as Field(f, names)" * is_system
        raise wrong(name, called, kind_of(value) + how, TypeError)


def either(names: Sequence[str]) -> str:
    """Return names as "A", "A or B", or "A, B or C"."""
    *others, last = names
    return f"{', '.join(others)} or {last}" if others else last


def kind_of(value: Any) -> str:
    """Return the class of a value, for messages."""
    kind = "None" if value is None else type(value).__name__
    return f"the class {value.__name__}" if isinstance(value, type) else kind


def spelled(number: Fraction | int) -> str:
    """Return a number as p/q if q is at most 1000 and p is short, else with six digits."""
    if number.denominator <= 1000 and abs(number.numerator) < 10**17:
        return str(number)
    try:
        return f"{float(number):.6g}"
    except OverflowError:
        return f"{Decimal(number.numerator) / number.denominator:.6g}"


def short(value: Any) -> str:
    """Return a value as text of at most 60 characters, for messages."""
    text = spelled(value) if isinstance(value, Fraction) else " ".join(repr(value).split())
    # np.float64(2.0) becomes 2.0, but np.sin(2.0) in the text of an equation stays.
    text = re.sub(r"\bnp\.(?:float|u?int|complex)\d+\(([^()]*)\)", r"\1", text)
    return text if len(text) <= 60 else f"{text[:57]}..."


def first_index(mask: NDArray[Any]) -> tuple[int, ...]:
    """Return the index of the first True in a mask, in C order."""
    return tuple(int(i) for i in np.unravel_index(int(np.argmax(mask)), mask.shape))


def spell(index: tuple[int, ...]) -> str:
    """Return an index as users write it: `3`, `(1, 2)`, or `0` for a single trajectory."""
    return f"{index}" if len(index) > 1 else f"{(*index, 0)[0]}"
