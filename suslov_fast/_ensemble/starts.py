"""Sources of initial states."""

from __future__ import annotations

import hashlib
import math
import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._checks import FloatArray, check_labels, vectors, wrong
from .._engine.random_starts import RandomStarts, Slices

# Number of states read at a time.
_READ = 2**20


@dataclass(frozen=True, eq=False)
class GivenStarts:
    """States in an array: in memory, in a memory-mapped file, or of Dask."""

    array: Any

    @property
    def shape(self) -> tuple[int, ...]:
        """The batch shape."""
        return tuple(int(length) for length in self.array.shape[:-1])

    def _part(self, where: Slices, dimension: int) -> FloatArray:
        """Return the states (..., D) of a part of the batch."""
        values = self.array[where]
        if hasattr(values, "compute"):
            values = values.compute()
        return np.array(vectors("omega0", values, dimension, allow_nan=True))

    def _identity(self) -> Any:
        """Return the digest of all states, which are read once."""
        digest, shape = hashlib.sha256(), self.shape
        step = max(1, _READ // max(math.prod(shape[1:]), 1))
        parts = [(slice(k, k + step),) for k in range(0, shape[0], step)] if shape else [()]
        for where in parts:
            digest.update(np.ascontiguousarray(self._part(where, self.array.shape[-1])).data)
        return {"shape": list(shape), "sha256": digest.hexdigest()}


Source = RandomStarts | GivenStarts


def source_of(omega0: Any, labels: tuple[str, ...]) -> Source:
    """Return the source of the argument `omega0`; the labels are those of components."""
    dimension = len(labels)
    if isinstance(omega0, RandomStarts):
        return omega0
    if isinstance(omega0, (str, os.PathLike)):
        path = os.fspath(omega0)
        if not path.endswith(".npy"):
            raise wrong("omega0", "the name of a .npy file", repr(omega0))
        omega0 = open_npy(path)
    elif hasattr(getattr(omega0, "data", omega0), "dask"):
        check_labels("omega0", omega0, labels)
        omega0 = getattr(omega0, "data", omega0)  # the data of a labelled array
        if any(length != length for length in omega0.shape):
            known = "an array of known shape"
            raise wrong("omega0", known, f"{omega0.shape}: call its compute_chunk_sizes()")
    elif not isinstance(omega0, np.memmap):
        return GivenStarts(vectors("omega0", omega0, dimension, True, labels).copy())
    if omega0.ndim == 0 or omega0.shape[-1] != dimension:
        raise wrong("omega0", f"shape (..., {dimension})", omega0.shape)
    return GivenStarts(omega0)


def open_npy(path: str | os.PathLike[str]) -> Any:
    """Return the array in a .npy file, memory-mapped."""
    try:
        return np.lib.format.open_memmap(path, mode="r")
    except ValueError as error:
        expected = "a .npy file with an array of numbers"
        raise wrong(os.fspath(path), expected, "another file, or a damaged one") from error


def part_of(shape: tuple[int, ...], where: Slices) -> Slices:
    """Return the slices of an array that broadcasts to the batch for a part of the batch."""
    along = where[len(where) - len(shape) :]
    return tuple(
        slice(0, 1) if length == 1 else each for length, each in zip(shape, along, strict=True)
    )


def values_or_digest(array: FloatArray) -> Any:
    """Return a small array as lists, and the digest of a large one."""
    if array.size <= 16:
        return array.tolist()
    digest = hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()
    return {"shape": list(array.shape), "sha256": digest}
