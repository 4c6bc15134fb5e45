"""Checks of what a user passes in; each message says what was received and what was expected."""

from __future__ import annotations

import math
import numbers
import operator
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


# Arrays beyond this size take longer to look through than to compute with.
LARGE = 2**14
_FLOAT64 = np.dtype(np.float64)
# Two calls of NumPy take as long as the sum of so many numbers in Python.
_FEW = 64
# NumPy broadcasts no more axes than these.
_AXES = 32


def real_array(name: str, value: ArrayLike, allow_nan: bool = False) -> FloatArray:
    """Any array-like of finite real numbers as float64; with `allow_nan` also NaN."""
    return finite_floats(name, integers_or_floats(name, value), allow_nan)


def real_number(name: str, value: ArrayLike) -> float | FloatArray:
    """A finite real number as a float, with which all is faster by far, or an array of them."""
    if type(value) is not float:
        array = real_array(name, value)
        return array.item() if array.ndim == 0 else array
    if not math.isfinite(value):
        _refuse_infinite(name, np.array(value), allow_nan=False)
    return value


def integers_or_floats(name: str, value: ArrayLike) -> NDArray[Any]:
    """Any array-like of real numbers: integers of whatever type they are, or float64."""
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ValueError(
            f"{name}: expected a rectangular array of real numbers, got {_short(value)}"
        ) from error
    # `numpy.ma` is imported where something may be of it.
    if array is not value and isinstance(value, np.ndarray) and np.ma.is_masked(value):
        raise ValueError(f"{name}: expected real numbers, got a masked array with missing values")
    if array.dtype is _FLOAT64:
        return array
    if array.dtype.kind == "O":
        array = _from_objects(name, value, array)
    if array.dtype.kind not in "iuf":
        raise TypeError(
            f"{name}: expected real numbers, got {_short(value)} of dtype {array.dtype}"
        )
    if array.dtype.kind != "f":
        return array
    with np.errstate(over="ignore"):  # a long double beyond float64 is reported as infinite
        return array.astype(np.float64, copy=False)


def finite_floats(name: str, array: NDArray[Any], allow_nan: bool = False) -> FloatArray:
    """What `integers_or_floats` has returned as finite float64."""
    array = _floats(array)
    if not _finite(array):
        _refuse_infinite(name, array, allow_nan)
    return array


def _floats(array: NDArray[Any]) -> FloatArray:
    return array if array.dtype is _FLOAT64 else array.astype(np.float64)


def _finite(array: FloatArray) -> bool:
    """Whether all numbers are finite; those whose sum overflows may be too."""
    if array.size <= _FEW:
        return math.isfinite(sum(array.ravel().tolist()))
    return bool(np.isfinite(array).all())


def _refuse_infinite(name: str, array: FloatArray, allow_nan: bool) -> None:
    wrong = np.isinf(array) if allow_nan else ~np.isfinite(array)
    if wrong.any():
        index = tuple(int(i) for i in np.argwhere(wrong)[0])
        where = f" at index {index}" if index else ""
        raise ValueError(f"{name}: expected finite real numbers, got {array[index]}{where}")


def _from_objects(name: str, value: ArrayLike, array: NDArray[Any]) -> FloatArray:
    for item in array.flat:
        if not isinstance(item, numbers.Real) or isinstance(item, (bool, np.bool_)):
            raise TypeError(
                f"{name}: expected real numbers, got {_short(item)} of type {type(item).__name__}"
            )
    try:
        return array.astype(np.float64)
    except OverflowError as error:
        raise ValueError(
            f"{name}: expected numbers in the range of float64, got {_short(value)}"
        ) from error


def vectors(name: str, value: ArrayLike, dimension: int, allow_nan: bool = False) -> FloatArray:
    """An array of finite real vectors, components on the last axis."""
    return finite_floats(name, _vectors(name, value, dimension), allow_nan)


def states(name: str, value: ArrayLike, dimension: int, later: bool = False) -> FloatArray:
    """The same of states; where a component is NaN all become so: there is no such state.

    With `later`, a LARGE array is left as it is to whoever reads it, who must then call
    `real_array` if there are infinite numbers.
    """
    array = _floats(_vectors(name, value, dimension))
    if (later and array.size > LARGE) or _finite(array):
        return array
    _refuse_infinite(name, array, allow_nan=True)
    return np.where(np.isnan(array).any(axis=-1, keepdims=True), np.nan, array)


def _vectors(name: str, value: ArrayLike, dimension: int) -> NDArray[Any]:
    array = integers_or_floats(name, value)
    if array.ndim == 0 or array.shape[-1] != dimension:
        raise ValueError(f"{name}: expected shape (..., {dimension}), got {array.shape}")
    return array


def inertia_matrix(
    name: str, value: ArrayLike, n: int | None = None, positive: bool = True
) -> FloatArray:
    """Symmetric (..., n, n) matrices, positive definite unless said otherwise."""
    matrix = real_array(name, value)
    side = matrix.shape[-1] if n is None and matrix.ndim else n
    if matrix.ndim < 2 or matrix.shape[-2:] != (side, side) or (n is None and matrix.ndim > 2):
        expected = "(n, n)" if n is None else f"(..., {n}, {n})"
        raise ValueError(f"{name}: expected shape {expected}, got {matrix.shape}")
    size = abs(matrix).max(axis=(-2, -1), initial=0.0)
    asymmetry = abs(matrix - matrix.swapaxes(-2, -1)).max(axis=(-2, -1), initial=0.0)
    if not (asymmetry <= 1e-12 * size).all():
        raise ValueError(
            f"{name}: expected a symmetric inertia matrix, got one with "
            f"|I - I.T| = {asymmetry.max()}"
        )
    if positive:
        eigenvalues = np.linalg.eigvalsh(matrix)
        if not (eigenvalues > 1e-15 * size[..., np.newaxis]).all():
            raise ValueError(
                f"{name}: expected a positive definite inertia matrix, got the eigenvalue "
                f"{eigenvalues.min()}"
            )
    return matrix


def unit_axis(name: str, value: ArrayLike, n: int) -> FloatArray:
    """Axes (..., n) of any length but 0, divided by their length."""
    axis = vectors(name, value, n)
    largest = abs(axis).max(axis=-1, keepdims=True, initial=0.0)
    if not (largest > 0).all():
        raise ValueError(f"{name}: expected an axis other than 0, got one of length 0")
    axis = axis / largest
    unit: FloatArray = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    return unit


def rotations(name: str, value: ArrayLike, n: int) -> FloatArray:
    """Rotation matrices (..., n, n), orthogonal to 1e-10."""
    matrices = vectors(name, value, n)
    if matrices.ndim < 2 or matrices.shape[-2] != n:
        raise ValueError(f"{name}: expected shape (..., {n}, {n}), got {matrices.shape}")
    error = abs(matrices @ matrices.swapaxes(-2, -1) - np.eye(n)).max(initial=0.0)
    if error > 1e-10 or not (np.linalg.det(matrices) > 0).all():
        raise ValueError(
            f"{name}: expected rotation matrices, got |R R.T - 1| = {error:.2g} and determinant "
            f"{np.linalg.det(matrices).min(initial=np.inf):.2g}"
        )
    return matrices


def common_shape(shapes: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """The shape that the named batch shapes broadcast to."""
    if not any(shapes.values()):
        return ()
    for name, shape in shapes.items():
        if len(shape) > _AXES:
            raise ValueError(
                f"{name}: expected a batch of at most {_AXES} axes, got one of {len(shape)}"
            )
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError as error:
        received = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise ValueError(
            f"expected batch shapes that broadcast against each other, got {received}"
        ) from error


def integer(name: str, value: Any, minimum: int, expected: str) -> int:
    """An integer of at least `minimum` that fits in 64 bits."""
    if type(value) is int and minimum <= value < 2**62:
        return value
    try:
        if isinstance(value, (bool, np.bool_)):
            raise TypeError
        number = operator.index(value)
    except TypeError as error:
        raise TypeError(
            f"{name}: expected {expected}, got {_short(value)} of type {type(value).__name__}"
        ) from error
    if number < minimum:
        raise ValueError(f"{name}: expected {expected}, got {number}")
    if number >= 2**62:
        raise ValueError(f"{name}: expected an integer below 2**62, got {_short(number)}")
    return number


def one_of(name: str, value: Any, choices: Sequence[str]) -> str:
    """One of a few strings."""
    if not isinstance(value, str) or value not in choices:
        raise ValueError(
            f"{name}: expected one of {', '.join(map(repr, choices))}, got {_short(value)}"
        )
    return value


def instance(name: str, value: Any, expected: type | tuple[type, ...]) -> None:
    """An object of one class, or of one of several."""
    if not isinstance(value, expected):
        classes = expected if isinstance(expected, tuple) else (expected,)
        names = " or ".join(each.__name__ for each in classes)
        raise TypeError(f"{name}: expected {names}, got {type(value).__name__}")


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def first_index(mask: NDArray[Any]) -> tuple[int, ...]:
    """The index of the first element that is true."""
    return tuple(int(i) for i in np.unravel_index(int(np.argmax(mask)), mask.shape))


def spell(index: tuple[int, ...]) -> str:
    """An index as users write it: `3`, `(1, 2)`, or `0` where there is only one."""
    return f"{index}" if len(index) > 1 else f"{(*index, 0)[0]}"
