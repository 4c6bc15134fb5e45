"""Checks of arguments; each message states what was expected and what was received."""

from __future__ import annotations

import copy
import dataclasses
import math
import numbers
import operator
import os
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

# Arrays larger than this take longer to check than to compute with.
LARGE_ARRAY = 2**14
_FLOAT64 = np.dtype(np.float64)
# Up to this size the sum in Python is faster than two calls of NumPy.
_FEW = 64
# Integers up to this are exact as floats.
EXACT = 2**53
_NUMBERS = {float, int}
# Types without labels and units.
_PLAIN = {float, int, list, tuple, np.ndarray, type(None)}
# Axes of the package's datasets after those of the batch.
_AXES_OF_COMPONENTS = ("component", "space", "body")
# Files whose frames lie between a warning and the line of the user, beside the constructors of
# dataclasses: this package, and `replace`.
_NOT_OF_USERS = (os.path.dirname(__file__) + os.sep, dataclasses.__file__, copy.__file__)


def wrong(
    name: str, expected: str, received: object, error: type[Exception] = ValueError
) -> Exception:
    return error(f"{name}: expected {expected}, got {received}")


def warn(message: str, category: type[Warning] = UserWarning) -> None:
    """Warn of the user's line: that of the first frame outside the package."""
    frame, level = sys._getframe(1), 2
    while frame.f_back and (
        frame.f_code.co_filename.startswith(_NOT_OF_USERS)
        or (frame.f_code.co_filename, frame.f_code.co_name) == ("<string>", "__init__")
    ):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, level)


def real_array(name: str, value: ArrayLike, allow_nan: bool = False) -> FloatArray:
    """Return any array-like of finite real numbers as float64; with `allow_nan` also NaN."""
    array = _floats(name, value)
    _all_finite(name, array, allow_nan)
    return array


def real_number(name: str, value: ArrayLike) -> float | FloatArray:
    """Return a finite real number as a float, or an array; floats are much faster."""
    if type(value) is np.float64 or (type(value) is int and abs(value) < EXACT):
        value = float(value)
    if type(value) is not float:
        array = real_array(name, value)
        return array.item() if array.ndim == 0 else array
    if not math.isfinite(value):
        raise wrong(name, "finite real numbers", value)
    return value


def positive(name: str, value: ArrayLike) -> float:
    number = real_number(name, value)
    if not isinstance(number, float) or number <= 0:
        raise wrong(name, "a positive number", value)
    return number


def vectors(
    name: str, value: ArrayLike, dimension: int, allow_nan: bool = False, labels: Sequence[str] = ()
) -> FloatArray:
    """Return finite real vectors, components on the last axis; the names of these are `labels`."""
    array = _vectors(name, value, dimension, labels)
    _all_finite(name, array, allow_nan)
    return array


def states(name: str, value: ArrayLike, labels: Sequence[str], later: bool = False) -> FloatArray:
    """Return states; if one component is NaN, set all components of that state to NaN.

    `labels` are the names of the components.
    With `later`, a LARGE_ARRAY array is not checked here; the caller calls `real_array` if it finds
    infinite numbers.
    """
    array = _vectors(name, value, len(labels), labels)
    if (later and array.size > LARGE_ARRAY) or _all_finite(name, array, allow_nan=True):
        return array
    return np.where(np.isnan(array).any(axis=-1, keepdims=True), np.nan, array)


def _vectors(name: str, value: Any, dimension: int, labels: Sequence[str]) -> FloatArray:
    array = _floats(name, value)
    if type(value) is not np.ndarray:
        check_labels(name, value, labels)
    if array.ndim == 0 or array.shape[-1] != dimension:
        raise wrong(name, f"shape (..., {dimension})", array.shape)
    return array


def _floats(name: str, value: Any) -> FloatArray:
    """Return any array-like of real numbers as float64, including infinite ones and NaN."""
    if type(value) is np.ndarray and value.dtype is _FLOAT64:
        return value
    refuse_units(name, value)
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise wrong(name, "a rectangular array of real numbers", _short(value)) from error
    if array.dtype is _FLOAT64:
        return array
    if array.dtype.kind == "O":
        for item in array.flat:
            _refuse_units(name, item)
            if not isinstance(item, numbers.Real):
                received = f"{_short(item)} of type {type(item).__name__}"
                raise wrong(name, "real numbers", received, TypeError)
        try:
            return array.astype(np.float64)
        except OverflowError as error:
            raise wrong(name, "numbers in the range of float64", _short(value)) from error
    if array.dtype.kind not in "iuf":
        received = f"{_short(value)} of dtype {array.dtype}"
        raise wrong(name, "real numbers", received, TypeError)
    with np.errstate(over="ignore"):  # a long double beyond float64 is reported as infinite
        return array.astype(np.float64, copy=False)


def _all_finite(name: str, array: FloatArray, allow_nan: bool) -> bool:
    """Return True if all numbers are finite; False if there are NaN or the sum overflows."""
    if array.size <= _FEW:
        if math.isfinite(sum(array.ravel().tolist())):
            return True
    elif np.isfinite(array).all():
        return True
    infinite = np.isinf(array) if allow_nan else ~np.isfinite(array)
    if infinite.any():
        index = first_index(infinite)
        where = f" at index {index}" if index else ""
        raise wrong(name, "finite real numbers", f"{array[index]}{where}")
    return False


def refuse_units(name: str, value: Any) -> None:
    """Raise an error for booleans, tables, masked arrays and quantities, alone or in lists."""
    for item in _unusual(value):
        _refuse_units(name, item)


def _unusual(value: Any) -> list[Any]:
    """Return what is not a plain number in nested lists, with some that are, or the value."""
    if not isinstance(value, (list, tuple)):
        return [value]
    if _NUMBERS.issuperset(map(type, value)):
        return []
    return [item for each in value for item in _unusual(each)]


def _refuse_units(name: str, value: Any) -> None:
    if isinstance(value, (bool, np.bool_)) or getattr(value, "dtype", None) == np.bool_:
        raise wrong(name, "real numbers", f"{_short(value)} of dtype bool", TypeError)
    if type(value) in _PLAIN:
        return
    # `numpy.ma` is imported only if the array may be masked.
    if isinstance(value, np.ndarray) and np.ma.is_masked(value):
        raise wrong(name, "real numbers", "a masked array with missing values")
    if hasattr(value, "columns"):
        how = f"{type(value).__name__}, whose labels would be ignored: pass its to_numpy()"
        raise wrong(name, "an array", how, TypeError)
    if hasattr(value, "data_vars"):
        raise wrong(name, "an array", "Dataset: pass one variable, as dataset.omega", TypeError)
    if _is_xarray(value):
        value = getattr(value, "data", None)  # its attributes are annotations only
    if hasattr(value, "unit") or hasattr(value, "units"):
        unit = getattr(value, "unit", getattr(value, "units", None))
        number = "magnitude" if hasattr(value, "magnitude") else "value"
        received = (
            f"{type(value).__name__} in {unit}: pass its number in the unit that all arguments "
            f"share, as {name}.to(...).{number}"
        )
        raise wrong(name, "numbers without a unit", received, TypeError)


def _is_xarray(value: Any) -> bool:
    return type(value).__module__.partition(".")[0] == "xarray"


def aligned(arguments: dict[str, Any], components: Sequence[str] = ()) -> dict[str, Any]:
    """Return arguments, the labelled ones aligned by the names of their axes.

    States have these components.
    """
    if _PLAIN.issuperset(map(type, arguments.values())):
        return arguments
    labelled = {
        name: [dim for dim in value.dims if dim not in _axes_of_components(value, components)]
        for name, value in arguments.items()
        if _is_xarray(value)
    }
    if len(labelled) < 2:
        return arguments
    arrays, longest = dict(arguments), max(labelled, key=lambda name: len(labelled[name]))
    whole = labelled[longest]
    found: dict[Any, tuple[str, Any]] = {}
    for name, dims in labelled.items():
        value = arguments[name]
        coords = getattr(value, "coords", {})
        for dim in filter(coords.__contains__, dims):
            first_name, labels = found.setdefault(dim, (name, coords[dim].variable))
            if not labels.equals(coords[dim].variable):
                expected = f"the coordinates of {first_name} along {dim!r}"
                raise wrong(name, expected, "others: pass what xarray.align returns")
        if not set(dims) <= set(whole):
            expected = f"axes among {tuple(whole)}, those of {longest}"
            raise wrong(name, expected, f"{tuple(dims)}: pass values without labels")
        of_components = _axes_of_components(value, components)
        if of_components or name != "eps":
            check_labels(name, value, components)
        first = min(map(whole.index, dims), default=len(whole))
        absent = [dim for dim in whole[first:] if dim not in dims]
        arrays[name] = value.expand_dims(absent).transpose(*whole[first:], *of_components).data
    return arrays


def without_labels(parameters: dict[str, Any]) -> None:
    """Raise ValueError for named axes, and for series of pandas whose indices differ."""
    indices: dict[str, Any] = {}
    items = [(name, each) for name, value in parameters.items() for each in _unusual(value)]
    for name, value in items:
        if _is_xarray(value) and value.dims:
            expected = "an array without labels, as a body has none"
            raise wrong(name, expected, f"the axes {value.dims}: pass its values")
        if type(value).__name__ == "Series":
            first = next(iter(indices), name)
            if not value.index.equals(indices.setdefault(first, value.index)):
                expected = f"the index of {first}" if name != first else "one index"
                raise wrong(name, expected, "another: pass values without labels")


def check_labels(name: str, value: Any, components: Sequence[str]) -> None:
    """Raise ValueError if components are not on the last axis, or not those named, in order."""
    if isinstance(value, (list, tuple)):
        if not _NUMBERS.issuperset(map(type, value)):
            for k, item in enumerate(value):
                _check_item(name, item, k, components)
    elif _is_xarray(value):
        _check_axes(name, value, components)
    elif type(value).__name__ == "Series" and value.ndim == 1:
        _check_order(name, value.index, components)


def _check_item(name: str, item: Any, k: int, components: Sequence[str]) -> None:
    """Check the labels of an item of a list, which has no axis but that of components."""
    check_labels(name, item, components)
    if _is_xarray(item):
        if {*item.dims} - {*_axes_of_components(item, components)}:
            received = f"one with the axes {item.dims} at [{k}]: pass its values"
            raise wrong(name, "labelled items with an axis 'component' alone", received)
        labels = (each.item() for each in getattr(item, "coords", {}).values() if item.ndim == 0)
        for label in labels:
            if label in components and components.index(label) != k:
                place = components.index(label)
                raise wrong(name, f"{label} at [{place}]", f"it at [{k}]: pass its values")


def _axes_of_components(value: Any, components: Sequence[str]) -> list[Any]:
    """Return the axes of components, by their names or by their labels."""
    coords = getattr(value, "coords", {})
    return [
        dim
        for dim in value.dims
        if dim in _AXES_OF_COMPONENTS
        or (components and dim in coords and {*coords[dim].values.tolist()} == {*components})
    ]


def _check_axes(name: str, value: Any, components: Sequence[str]) -> None:
    dims, of_components = list(value.dims), _axes_of_components(value, components)
    if not dims:
        return
    if (
        not of_components and dims[-1] != f"dim_{len(dims) - 1}"
    ):  # the name that xarray gives by default
        expected = "a last axis 'component'"
        if components:
            expected += f", or one with the labels {_short([*components])}"
        how = f"the axes {tuple(dims)}: if the last one holds the components, pass {name}.values"
        raise wrong(name, expected, how)
    if dims[len(dims) - len(of_components) :] != of_components or "n" in dims[1:]:
        order = f"the axes {tuple(of_components)} in this order at the end, and 'n' first"
        named = ", ".join([*(["'n'"] if "n" in dims else []), "...", *map(repr, of_components)])
        raise wrong(name, order, f"{tuple(dims)}: pass {name}.transpose({named})")
    coords = getattr(value, "coords", {})
    if dims[-1] in coords:
        _check_order(name, coords[dims[-1]].values, components)


def _check_order(name: str, labels: Any, components: Sequence[str]) -> None:
    received = np.asarray(labels).tolist()
    if not received:
        return
    expected = list(components) if isinstance(received[0], str) else sorted(received)
    if received != expected:
        how = f"{_short(received)}: pass values in this order, without labels"
        raise wrong(name, f"the components {_short(expected)} in order", how)


def inertia_matrix(name: str, value: ArrayLike, n: int | None = None) -> FloatArray:
    """Return symmetric positive definite matrices (..., n, n), or a single one if n is None."""
    matrix = real_array(name, value)
    side = n or (0, *matrix.shape)[-1]
    if matrix.shape[-2:] != (side, side) or (n is None and matrix.ndim != 2):
        raise wrong(name, f"shape (..., {n}, {n})" if n else "shape (n, n)", matrix.shape)
    size = abs(matrix).max(axis=(-2, -1), initial=0.0)
    asymmetry = abs(matrix - matrix.swapaxes(-2, -1)).max(axis=(-2, -1), initial=0.0)
    if not (asymmetry <= 1e-12 * size).all():
        raise wrong(name, "a symmetric inertia matrix", f"one with |I - I.T| = {asymmetry.max()}")
    eigenvalues = np.linalg.eigvalsh(matrix)
    if not (eigenvalues > 1e-15 * size[..., np.newaxis]).all():
        raise wrong(
            name, "a positive definite inertia matrix", f"the eigenvalue {eigenvalues.min()}"
        )
    return matrix


def unit_axis(name: str, value: ArrayLike, n: int) -> FloatArray:
    """Return nonzero axes (..., n), normalized."""
    axis = vectors(name, value, n)
    largest = abs(axis).max(axis=-1, keepdims=True, initial=0.0)
    if not (largest > 0).all():
        raise wrong(name, "an axis other than 0", "one of length 0")
    axis = axis / largest
    unit: FloatArray = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    return unit


def square_matrices(name: str, value: ArrayLike, n: int, allow_nan: bool = False) -> FloatArray:
    """Return matrices (..., n, n) of finite real numbers."""
    matrices = vectors(name, value, n, allow_nan)
    if matrices.ndim < 2 or matrices.shape[-2] != n:
        raise wrong(name, f"shape (..., {n}, {n})", matrices.shape)
    return matrices


def rotations(name: str, value: ArrayLike, n: int) -> FloatArray:
    """Return rotation matrices (..., n, n), orthogonal to 1e-10."""
    matrices = square_matrices(name, value, n)
    error = abs(matrices @ matrices.swapaxes(-2, -1) - np.eye(n)).max(initial=0.0)
    determinant = np.linalg.det(matrices)
    if error > 1e-10 or not (determinant > 0).all():
        least = determinant.min(initial=np.inf)
        raise wrong(
            name, "rotation matrices", f"|R R.T - 1| = {error:.2g} and determinant {least:.2g}"
        )
    return matrices


def common_shape(shapes: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """Return the shape that the named batch shapes broadcast to."""
    if not any(shapes.values()):
        return ()
    try:
        return np.broadcast_shapes(*shapes.values())
    except (ValueError, RuntimeError) as error:  # RuntimeError for too many axes
        received = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        expected = "expected batch shapes that broadcast against each other"
        raise ValueError(f"{expected}, got {received}{_axes_that_fit(shapes)}") from error


def _axes_that_fit(shapes: dict[str, tuple[int, ...]]) -> str:
    """Return a hint if one argument, with more axes, gives all combinations."""
    for name, shape in reversed(shapes.items()):
        for more in range(1, max(map(len, shapes.values())) + 1):
            if name != "body" and name.isidentifier() and len(shape) == 1:
                with suppress(ValueError):
                    np.broadcast_shapes(*(shapes | {name: shape + (1,) * more}).values())
                    return f"; {name}[:{', None' * more}] would fit"
    return ""


def integer(name: str, value: Any, minimum: int, expected: str = "") -> int:
    """Return an integer of at least `minimum` that fits in 64 bits."""
    if type(value) is int and minimum <= value < 2**62:
        return value
    expected = expected or f"an integer of at least {minimum}"
    try:
        if isinstance(value, (bool, np.bool_)):
            raise TypeError
        number = operator.index(value)
    except TypeError as error:
        received = f"{_short(value)} of type {type(value).__name__}"
        raise wrong(name, expected, received, TypeError) from error
    if number < minimum:
        raise wrong(name, expected, number)
    if number >= 2**62:
        raise wrong(name, "an integer below 2**62", _short(number))
    return number


def one_of(name: str, value: Any, choices: Sequence[str]) -> str:
    if not isinstance(value, str) or value not in choices:
        raise wrong(name, f"one of {', '.join(map(repr, choices))}", _short(value))
    return value


def instance(name: str, value: Any, expected: Any) -> None:
    """Check the class of an object; `expected` is a class, a tuple or a union of classes."""
    if not isinstance(value, expected):
        classes = expected if isinstance(expected, tuple) else get_args(expected) or (expected,)
        names = " or ".join(each.__name__ for each in classes)
        received = getattr(value, "_kind", type(value).__name__)
        if isinstance(value, type):
            received = f"the class {value.__name__}"
        raise wrong(name, names, received, TypeError)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def first_index(mask: NDArray[Any]) -> tuple[int, ...]:
    return tuple(int(i) for i in np.unravel_index(int(np.argmax(mask)), mask.shape))


def spell(index: tuple[int, ...]) -> str:
    """Return an index as users write it: `3`, `(1, 2)`, or `0` for a single trajectory."""
    return f"{index}" if len(index) > 1 else f"{(*index, 0)[0]}"
