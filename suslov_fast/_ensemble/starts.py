"""Sources of initial states."""

from __future__ import annotations

import hashlib
import math
import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._checks import FloatArray, check_labels, integer, positive, vectors, wrong
from .._docs import filled
from .._engine.memory import require

Slices = tuple[slice, ...]

# Number of states read at a time.
_READ = 2**20


@filled
@dataclass(frozen=True)
class RandomStarts:
    """Random initial states for :func:`ensemble`, uniform in a cube around 0.

    State i depends only on the seed and on i, and is computed when it is needed.

    Parameters
    ----------
    size : int or tuple of int
        Number of states, or the shape of the batch.
    extent : float
        Each component lies in [-extent, extent), in the unit of angular velocity.
    seed : int
        0 or more.

    %(Raises: invalid)s

    Examples
    --------
    >>> from suslov_fast import RandomStarts
    >>> starts = RandomStarts(10**9, extent=2.0, seed=1)
    >>> starts.states(2, start=999_999_998).shape
    (2, 2)
    """

    size: int | tuple[int, ...]
    extent: float
    seed: int = 0

    def __post_init__(self) -> None:
        size = self.size
        if isinstance(size, (tuple, list)):
            size = tuple(integer("size", each, 0) for each in size)
        else:
            size = integer("size", size, 0)
        object.__setattr__(self, "size", size)
        object.__setattr__(self, "extent", positive("extent", self.extent))
        object.__setattr__(self, "seed", integer("seed", self.seed, 0))

    @property
    def shape(self) -> tuple[int, ...]:
        """The batch shape."""
        return self.size if isinstance(self.size, tuple) else (self.size,)

    def states(self, count: int, start: int = 0, dimension: int = 2) -> FloatArray:
        """Return the states `start` to `start + count`, shape (count, dimension)."""
        count, start = integer("count", count, 0), integer("start", start, 0)
        dimension = integer("dimension", dimension, 1)
        require(32 * count * dimension, "fewer initial states, or `ensemble`, need less")
        # One value of the counter gives four 64-bit words.
        first, skipped = divmod(start * dimension, 4)
        generator = np.random.Philox(key=self.seed, counter=first)
        words = generator.random_raw(skipped + count * dimension)
        unit = (words[skipped:] >> np.uint64(11)) * 2.0**-53
        states: FloatArray = np.asarray((2.0 * unit - 1.0) * self.extent, np.float64)
        return states.reshape(count, dimension)

    def _part(self, where: Slices, dimension: int) -> FloatArray:
        """Return the states (..., D) of a part of the batch."""
        if not where:
            return self.states(1, 0, dimension).reshape(dimension)
        states = np.empty((*(each.stop - each.start for each in where), dimension))
        first = [each.start for each in where]
        for index in np.ndindex(states.shape[:-2]):
            start = int(np.ravel_multi_index(np.add(first, (*index, 0)), self.shape))
            states[index] = self.states(states.shape[-2], start, dimension)
        return states

    def _identity(self) -> Any:
        """Return plain values that differ if any bit of the states differs."""
        return {"random": {"size": list(self.shape), "extent": self.extent}, "seed": self.seed}


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
        omega0 = np.load(path, mmap_mode="r", allow_pickle=False)
    elif hasattr(getattr(omega0, "data", omega0), "dask"):
        check_labels("omega0", omega0, labels)
        omega0 = getattr(omega0, "data", omega0)  # the data of a labelled array
        if any(length != length for length in omega0.shape):
            known = "an array of known shape"
            raise wrong("omega0", known, f"{omega0.shape}: call its compute_chunk_sizes()")
    else:
        return GivenStarts(vectors("omega0", omega0, dimension, True, labels).copy())
    if omega0.ndim == 0 or omega0.shape[-1] != dimension:
        raise wrong("omega0", f"shape (..., {dimension})", omega0.shape)
    return GivenStarts(omega0)


def part_of(shape: tuple[int, ...], where: Slices) -> Slices:
    """Return the slices of an array that broadcasts to the batch for a part of the batch."""
    along = where[len(where) - len(shape) :]
    return tuple(
        slice(0, 1) if length == 1 else each for length, each in zip(shape, along, strict=True)
    )


def described(array: FloatArray) -> Any:
    """Return a small array as lists, and the digest of a large one."""
    if array.size <= 16:
        return array.tolist()
    digest = hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()
    return {"shape": list(array.shape), "sha256": digest}
