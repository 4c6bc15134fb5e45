"""Between batches of any shape and memory order and the flat arrays that loops take."""

from __future__ import annotations

import math
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray

Scalar = TypeVar("Scalar", bound=np.generic)


def flat_parameter(array: FloatArray, batch: tuple[int, ...], order: str) -> FloatArray:
    """A parameter as one number that serves all trajectories, or one for each."""
    if array.size == 1:
        return for_kernel(array.reshape(1))
    return for_kernel(np.broadcast_to(array, batch).ravel(order))  # type: ignore[arg-type]


def flat_vectors(array: FloatArray, batch: tuple[int, ...], order: str) -> FloatArray:
    """Vectors as a (B, D) array."""
    dimension = array.shape[-1]
    shape = (*batch, dimension)
    full = array if array.shape == shape else np.broadcast_to(array, shape)
    if order == "F":
        full = full.transpose(*reversed(range(len(batch))), len(batch))
    return for_kernel(full.reshape(-1, dimension))


def for_kernel(array: FloatArray) -> FloatArray:
    """The array as the one type that loops are compiled for, a copy only if it must be."""
    flags = array.flags
    if flags.c_contiguous and flags.aligned and flags.writeable:
        return array
    return np.require(array, np.float64, ["C", "A", "W"])


def unflatten(flat: NDArray[Scalar], batch: tuple[int, ...], order: str) -> NDArray[Scalar]:
    """A view of shape (..., trailing) of an array of shape (B, trailing)."""
    trailing = flat.shape[1:]
    if order == "C":
        return flat.reshape((*batch, *trailing))
    axes = len(batch)
    view = flat.reshape((*reversed(batch), *trailing))
    return view.transpose(*reversed(range(axes)), *range(axes, view.ndim))


def saved_states(shape: tuple[int, ...], order: str, out: FloatArray | None) -> FloatArray:
    """The array of shape (..., n_saved, D) that is to be filled."""
    if out is None:
        return np.empty(shape, order=order)  # type: ignore[call-overload, no-any-return]
    if not isinstance(out, np.ndarray):
        raise TypeError(f"out: expected a NumPy array, got {type(out).__name__}")
    if out.dtype != np.float64:
        raise TypeError(f"out: expected dtype float64, got {out.dtype}")
    if out.shape != shape:
        raise ValueError(f"out: expected shape {shape}, got {out.shape}")
    if not (out.flags.c_contiguous or out.flags.f_contiguous):
        raise ValueError("out: expected a C- or F-contiguous array, got one that is neither")
    if not (out.flags.writeable and out.flags.aligned):
        raise ValueError("out: expected a writeable, aligned array, got one that is not")
    return out


def flat_saved_states(array: FloatArray, order: str) -> FloatArray:
    """A view of the saved states: (B, n_saved, D), or (D, n_saved, B) in order "F"."""
    *batch, n_saved, dimension = array.shape
    size = math.prod(batch)
    if order == "C":
        return array.reshape(size, n_saved, dimension)
    return array.T.reshape(dimension, n_saved, size)


def apart(argument: FloatArray, out: FloatArray) -> FloatArray:
    """An argument that does not change when `out` is written to."""
    return argument.copy() if np.may_share_memory(argument, out) else argument


def first_index(mask: NDArray[Any]) -> tuple[int, ...]:
    """The index of the first element that is true."""
    return tuple(int(i) for i in np.unravel_index(int(np.argmax(mask)), mask.shape))


def spell(index: tuple[int, ...]) -> str:
    """An index as users write it: `3`, `(1, 2)`, or `0` where there is only one."""
    return f"{index}" if len(index) > 1 else f"{(*index, 0)[0]}"
