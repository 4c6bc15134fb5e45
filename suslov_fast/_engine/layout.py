"""Between batches of any shape and the flat arrays that loops take."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray, few_and_finite


def flat_parameter(array: FloatArray, batch: tuple[int, ...]) -> FloatArray:
    """A parameter as one number that serves all trajectories, or one for each."""
    if array.size == 1:
        return for_kernel(array.reshape(1))
    return for_kernel(np.broadcast_to(array, batch).reshape(-1))


def flat_rows(array: FloatArray, batch: tuple[int, ...]) -> FloatArray:
    """Vectors as one row (1, D) that serves all trajectories, or one for each."""
    D = array.shape[-1]
    if array.size == D:
        return for_kernel(array.reshape(1, D))
    return for_kernel(np.broadcast_to(array, (*batch, D)).reshape(-1, D))


def flat_vectors(array: FloatArray, batch: tuple[int, ...]) -> FloatArray:
    """Vectors as a (B, D) array."""
    return _flat(array, batch, 1)


def own_states(state: FloatArray, batch: tuple[int, ...]) -> FloatArray:
    """States (B, D) that nobody else writes to; NaN in all components where one is."""
    flat = flat_vectors(state, batch)
    if np.may_share_memory(flat, state):
        flat = flat.copy()
    if not few_and_finite(flat) and np.isnan(flat.min(initial=0.0)):  # no array of its own
        flat[np.isnan(flat).any(axis=-1)] = np.nan
    return flat


def flat_matrices(array: FloatArray, batch: tuple[int, ...]) -> FloatArray:
    """Matrices as a (B, n, n) array."""
    return _flat(array, batch, 2)


def _flat(array: FloatArray, batch: tuple[int, ...], axes: int) -> FloatArray:
    shape = (*batch, *array.shape[-axes:])
    full = array if array.shape == shape else np.broadcast_to(array, shape)
    return for_kernel(full.reshape((math.prod(batch), *array.shape[-axes:])))


def for_kernel(array: FloatArray) -> FloatArray:
    """The array as the one type that loops are compiled for, a copy only if it must be."""
    flags = array.flags
    if flags.c_contiguous and flags.aligned and flags.writeable:
        return array
    return np.require(array, np.float64, ["C", "A", "W"])


def checked_out(name: str, out: Any, shape: tuple[int, ...]) -> FloatArray:
    """An array of the user's that is to be filled."""
    if not isinstance(out, np.ndarray) or isinstance(out, np.ma.MaskedArray):
        raise TypeError(f"{name}: expected a NumPy array, got {type(out).__name__}")
    if out.dtype != np.float64:
        raise TypeError(f"{name}: expected dtype float64, got {out.dtype}")
    if out.shape != shape:
        raise ValueError(f"{name}: expected shape {shape}, got {out.shape}")
    if not out.flags.c_contiguous:
        raise ValueError(f"{name}: expected a C-contiguous array, got one that is not")
    if not (out.flags.writeable and out.flags.aligned):
        raise ValueError(f"{name}: expected a writeable, aligned array, got one that is not")
    return out


def first_index(mask: NDArray[Any]) -> tuple[int, ...]:
    """The index of the first element that is true."""
    return tuple(int(i) for i in np.unravel_index(int(np.argmax(mask)), mask.shape))


def spell(index: tuple[int, ...]) -> str:
    """An index as users write it: `3`, `(1, 2)`, or `0` where there is only one."""
    return f"{index}" if len(index) > 1 else f"{(*index, 0)[0]}"
