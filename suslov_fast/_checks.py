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
# Four calls of NumPy take as long as so many numbers of Python.
_FEW = 32
# NumPy broadcasts no more axes than these.
_AXES = 32


def real_array(
    name: str, value: ArrayLike, allow_nan: bool = False, later: bool = False
) -> FloatArray:
    """Any array-like of finite real numbers as float64; with `allow_nan` also NaN.

    With `later`, whoever reads a LARGE array must find infinite numbers, and then call this again.
    """
    if type(value) is float and math.isfinite(value):
        return np.array(value)
    if type(value) is np.ndarray and value.dtype is _FLOAT64 and few_and_finite(value):
        return value
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ValueError(
            f"{name}: expected a rectangular array of real numbers, got {_short(value)}"
        ) from error
    if array.dtype.kind == "O":
        array = _from_objects(name, value, array)
    if array.dtype.kind not in "iuf":
        raise TypeError(
            f"{name}: expected real numbers, got {_short(value)} of dtype {array.dtype}"
        )
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        raise ValueError(f"{name}: expected real numbers, got a masked array with missing values")
    if array.dtype.kind in "iu":  # which are finite
        return array.astype(np.float64)
    if array.dtype != np.float64:
        with np.errstate(over="ignore"):  # a long double beyond float64 is reported below
            array = array.astype(np.float64)
    if (later and array.size > LARGE) or few_and_finite(array):
        return array
    finite = ~np.isinf(array) if allow_nan else np.isfinite(array)
    if not finite.all():
        index = tuple(int(i) for i in np.argwhere(~finite)[0])
        where = f" at index {index}" if index else ""
        raise ValueError(f"{name}: expected finite real numbers, got {array[index]}{where}")
    return array


def few_and_finite(array: FloatArray) -> bool:
    """Whether an array is finite, and so small that it is faster to look at each number."""
    return array.size <= _FEW and all(map(math.isfinite, array.ravel().tolist()))


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


def vectors(
    name: str, value: ArrayLike, dimension: int, allow_nan: bool = False, later: bool = False
) -> FloatArray:
    """An array of finite real vectors, components on the last axis."""
    array = real_array(name, value, allow_nan, later)
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


def common_shape(**shapes: tuple[int, ...]) -> tuple[int, ...]:
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
