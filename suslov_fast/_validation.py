"""Checks of what a user passes in; each message says what was received and what was expected."""

from __future__ import annotations

import numbers
import operator
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def real_array(name: str, value: ArrayLike, allow_nan: bool = False) -> FloatArray:
    """Any array-like of finite real numbers as float64; with `allow_nan` also NaN."""
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
    if np.ma.is_masked(value):
        raise ValueError(f"{name}: expected real numbers, got a masked array with missing values")
    with np.errstate(over="ignore"):  # a long double beyond float64 is reported below
        array = array.astype(np.float64, copy=False)
    finite = ~np.isinf(array) if allow_nan else np.isfinite(array)
    if not finite.all():
        index = tuple(int(i) for i in np.argwhere(~finite)[0])
        where = f" at index {index}" if index else ""
        raise ValueError(f"{name}: expected finite real numbers, got {array[index]}{where}")
    return array


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
    array = real_array(name, value, allow_nan)
    if array.ndim == 0 or array.shape[-1] != dimension:
        raise ValueError(f"{name}: expected shape (..., {dimension}), got {array.shape}")
    return array


def common_shape(**shapes: tuple[int, ...]) -> tuple[int, ...]:
    """The shape that the named batch shapes broadcast to."""
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError as error:
        received = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise ValueError(
            f"expected batch shapes that broadcast against each other, got {received}"
        ) from error


def integer(name: str, value: Any, minimum: int, expected: str) -> int:
    """An integer of at least `minimum` that fits in 64 bits."""
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


def instance(name: str, value: Any, expected: type) -> None:
    """An object of one class."""
    if not isinstance(value, expected):
        raise TypeError(f"{name}: expected {expected.__name__}, got {type(value).__name__}")


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
