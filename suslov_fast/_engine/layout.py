"""Conversion between batches of any shape and the flat arrays of kernels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .._bodies.base import Body
from .._checks import FloatArray


def for_kernel(array: FloatArray) -> FloatArray:
    """Return the array in the only type that kernels are compiled for; a copy only if needed."""
    return array if array.flags.carray else np.require(array, np.float64, ["C", "A", "W"])


def flat_arrays(array: FloatArray, batch: tuple[int, ...], axes: int = 1) -> FloatArray:
    """Return arrays (..., D), or with `axes` axes each, as (B, D): one for each trajectory."""
    split = array.ndim - axes
    inner = array.shape[split:]
    if array.shape[:split] != batch:
        array = np.broadcast_to(array, (*batch, *inner))
    return for_kernel(array.reshape((-1, *inner)))


def flat_parameter(value: float | FloatArray, batch: tuple[int, ...], axes: int = 0) -> FloatArray:
    """Return a parameter with `axes` axes as (1, ...) if common to the whole batch, or (B, ...)."""
    if type(value) is float:
        return np.array([value])
    array = np.asarray(value)
    inner = array.shape[array.ndim - axes :]
    if array.size == math.prod(inner):
        return for_kernel(array.reshape((1, *inner)))
    return flat_arrays(array, batch, axes)


def flat_body(body: Body, batch: tuple[int, ...]) -> tuple[FloatArray, ...]:
    if not body.shape:
        return body.batch_of_one
    return tuple(flat_parameter(value, batch, body._vector_axes) for value in body.parameters)


def for_loops(
    body: Body, eps: float | FloatArray, batch: tuple[int, ...]
) -> tuple[FloatArray, ...]:
    """Return the parameters of a body and eps."""
    return *flat_body(body, batch), flat_parameter(eps, batch)


def checked_out(out: Any, shape: tuple[int, ...]) -> FloatArray:
    """Return the array `out` of the user, checked."""
    if not isinstance(out, np.ndarray) or isinstance(out, np.ma.MaskedArray):
        raise TypeError(f"out: expected a NumPy array, got {type(out).__name__}")
    if out.dtype != np.float64:
        raise TypeError(f"out: expected dtype float64, got {out.dtype}")
    if out.shape != shape:
        raise ValueError(f"out: expected shape {shape}, got {out.shape}")
    if not out.flags.c_contiguous:
        raise ValueError("out: expected a C-contiguous array, got one that is not")
    if not out.flags.carray:
        raise ValueError("out: expected a writeable, aligned array, got one that is not")
    return out


def alike(size: int, most: int, lanes: int) -> int:
    """Return the length of parts of about equal length, at most `most`, in multiples of lanes."""
    parts = -(-size // most)
    return -(-size // (parts * lanes)) * lanes
