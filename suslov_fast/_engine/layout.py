"""Between batches of any shape and the flat arrays that kernels take."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._checks import FloatArray
from .._checks import first_index as first_index
from .._checks import spell as spell


def flat_parameter(value: float | FloatArray, batch: tuple[int, ...]) -> FloatArray:
    """Return a parameter as one number that serves all trajectories, or one for each."""
    if type(value) is float:
        return np.array([value])
    array = np.asarray(value)
    return for_kernel((array if array.size == 1 else np.broadcast_to(array, batch)).reshape(-1))


def flat_rows(array: FloatArray, batch: tuple[int, ...]) -> FloatArray:
    """Return vectors as one row (1, D) that serves all trajectories, or one for each."""
    D = array.shape[-1]
    if array.size != D:
        array = np.broadcast_to(array, (*batch, D))
    return for_kernel(array.reshape(-1, D))


def flat_vectors(array: FloatArray, batch: tuple[int, ...]) -> FloatArray:
    """Return vectors as a (B, D) array."""
    D = array.shape[-1]
    if array.shape[:-1] != batch:
        array = np.broadcast_to(array, (*batch, D))
    return for_kernel(array.reshape((-1, D)))


def flat_matrices(array: FloatArray, batch: tuple[int, ...]) -> FloatArray:
    """Return matrices as a (B, n, n) array."""
    n = array.shape[-1]
    if array.shape[:-2] != batch:
        array = np.broadcast_to(array, (*batch, n, n))
    return for_kernel(array.reshape((-1, n, n)))


def own_parameter(value: float | FloatArray) -> float | FloatArray:
    """Return a parameter that nobody else writes to."""
    return value if type(value) is float else np.array(value)


def own_states(state: FloatArray, batch: tuple[int, ...]) -> FloatArray:
    """Return states (B, D) that nobody else writes to."""
    shape = -1, state.shape[-1]
    if state.shape[:-1] == batch and state.flags.c_contiguous:
        return state.reshape(shape).copy()
    return np.array(np.broadcast_to(state, (*batch, shape[1])), order="C").reshape(shape)


def for_kernel(array: FloatArray) -> FloatArray:
    """Return the array as the one type that kernels are compiled for; a copy only if it must be."""
    return array if array.flags.carray else np.require(array, np.float64, ["C", "A", "W"])


def checked_out(out: Any, shape: tuple[int, ...]) -> FloatArray:
    """Return an array of the user's that is to be filled."""
    if not isinstance(out, np.ndarray) or isinstance(out, np.ma.MaskedArray):
        raise TypeError(f"out: expected a NumPy array, got {type(out).__name__}")
    if out.dtype != np.float64:
        raise TypeError(f"out: expected dtype float64, got {out.dtype}")
    if out.shape != shape:
        raise ValueError(f"out: expected shape {shape}, got {out.shape}")
    for fits, expected in (
        (out.flags.c_contiguous, "a C-contiguous array"),
        (out.flags.writeable and out.flags.aligned, "a writeable, aligned array"),
    ):
        if not fits:
            raise ValueError(f"out: expected {expected}, got one that is not")
    return out
