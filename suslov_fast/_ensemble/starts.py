"""Where initial states come from."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from .._checks import FloatArray, integer, real_array, vectors

# Rows that are looked at together where all starts are read once.
_TOGETHER = 2**20

Slices = tuple[slice, ...]


class Source(Protocol):
    """Initial states of a batch, a part at a time."""

    @property
    def shape(self) -> tuple[int, ...]:
        """The batch shape."""

    def part(self, where: Slices) -> FloatArray:
        """The states (..., D) of a part of the batch."""

    def identity(self) -> Any:
        """Plain values that differ where any bit of the states does."""


@dataclass(frozen=True)
class RandomStarts:
    """Random initial states for :func:`ensemble`, uniform in a cube around 0.

    They are made where they are needed, from a counter: state i depends on the seed and on i alone,
    not on how many there are, nor on how a run is cut.

    Parameters
    ----------
    size : int or tuple of int
        How many states, or the shape of the batch.
    extent : float
        Each component lies in [-extent, extent).
    seed : int
        0 or more.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.

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
        expected = "an integer of at least 0"
        size = self.size
        if isinstance(size, (tuple, list)):
            size = tuple(integer("size", each, 0, expected) for each in size)
        else:
            size = integer("size", size, 0, expected)
        extent = real_array("extent", self.extent)
        if extent.ndim or not extent > 0:
            raise ValueError(f"extent: expected a positive number, got {self.extent!r}")
        object.__setattr__(self, "size", size)
        object.__setattr__(self, "extent", float(extent))
        object.__setattr__(self, "seed", integer("seed", self.seed, 0, expected))

    @property
    def shape(self) -> tuple[int, ...]:
        """The batch shape."""
        return self.size if isinstance(self.size, tuple) else (self.size,)

    def states(self, count: int, start: int = 0, dimension: int = 2) -> FloatArray:
        """States `start` to `start + count`, shape (count, dimension)."""
        # A counter gives four words of 64 bits.
        first, skipped = divmod(start * dimension, 4)
        words = np.random.Philox(key=self.seed, counter=first).random_raw(
            skipped + count * dimension
        )
        unit = (words[skipped:] >> np.uint64(11)) * 2.0**-53
        states: FloatArray = np.asarray((2.0 * unit - 1.0) * self.extent, np.float64)
        return states.reshape(count, dimension)


@dataclass(frozen=True)
class _Random:
    """Random starts for a body of some dimension."""

    starts: RandomStarts
    dimension: int

    @property
    def shape(self) -> tuple[int, ...]:
        return self.starts.shape

    def part(self, where: Slices) -> FloatArray:
        shape = tuple(each.stop - each.start for each in where)
        states = np.empty((*shape, self.dimension))
        for index in np.ndindex(shape[:-1]):
            row = (*(each.start + k for each, k in zip(where[:-1], index, strict=True)),)
            first = int(np.ravel_multi_index((*row, 0), self.shape)) if row else 0
            first += where[-1].start if where else 0
            count = shape[-1] if where else 1
            states[index] = self.starts.states(count, first, self.dimension).reshape(
                states[index].shape
            )
        return states

    def identity(self) -> Any:
        return {
            "random": {"size": list(self.shape), "extent": self.starts.extent},
            "seed": self.starts.seed,
        }


@dataclass(frozen=True, eq=False)
class Kept:
    """Starts in memory, or a Dask array."""

    array: Any

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(int(length) for length in self.array.shape[:-1])

    def part(self, where: Slices) -> FloatArray:
        return _states(self.array[where], self.array.shape[-1])

    def identity(self) -> Any:
        return digest_of(self)


@dataclass(frozen=True)
class _File:
    """Starts in a .npy file, of which only what is needed is read."""

    path: str
    dimension: int

    @property
    def _array(self) -> Any:
        array = np.load(self.path, mmap_mode="r", allow_pickle=False)
        if array.ndim == 0 or array.shape[-1] != self.dimension:
            raise ValueError(
                f"{self.path}: expected shape (..., {self.dimension}), got {array.shape}"
            )
        return array

    @property
    def shape(self) -> tuple[int, ...]:
        shape: tuple[int, ...] = self._array.shape[:-1]
        return shape

    def part(self, where: Slices) -> FloatArray:
        return _states(self._array[where], self.dimension)

    def identity(self) -> Any:
        return digest_of(self)


def _states(values: Any, dimension: int) -> FloatArray:
    """Values as states, checked; lazy ones are computed."""
    if hasattr(values, "compute"):
        values = values.compute()
    return np.array(vectors("omega0", values, dimension, allow_nan=True))


def source_of(omega0: Any, dimension: int) -> Source:
    """The source of initial states that a user means."""
    if isinstance(omega0, RandomStarts):
        return _Random(omega0, dimension)
    if isinstance(omega0, (str, os.PathLike)):
        path = os.path.abspath(os.fspath(omega0))
        if not path.endswith(".npy"):
            raise ValueError(f"omega0: expected the name of a .npy file, got {omega0!r}")
        found = _File(path, dimension)
        found.shape  # noqa: B018  that it is there and fits
        return found
    if hasattr(omega0, "dask"):
        lazy = getattr(omega0, "data", omega0)  # that of a labelled array
        if lazy.ndim == 0 or lazy.shape[-1] != dimension:
            raise ValueError(f"omega0: expected shape (..., {dimension}), got {lazy.shape}")
        return Kept(lazy)
    return Kept(vectors("omega0", omega0, dimension, allow_nan=True).copy())


def own_part(shape: tuple[int, ...], where: Slices) -> Slices:
    """The part of what has a shape that broadcasts to a batch, for a part of the batch."""
    along = where[len(where) - len(shape) :]
    return tuple(
        slice(0, 1) if length == 1 else each for length, each in zip(shape, along, strict=True)
    )


def digest_of(source: Source) -> dict[str, Any]:
    """A digest of all states, which are read once, in parts."""
    digest = hashlib.sha256()
    for where in _rows(source.shape):
        digest.update(np.ascontiguousarray(source.part(where)).data)
    return {"shape": list(source.shape), "sha256": digest.hexdigest()}


def described(array: ArrayLike) -> Any:
    """A small array itself, a large one as its digest."""
    values = np.ascontiguousarray(array)
    if values.size <= 16:
        return np.asarray(array).tolist()
    return {"shape": list(values.shape), "sha256": hashlib.sha256(values.data).hexdigest()}


def _rows(shape: tuple[int, ...]) -> Iterator[Slices]:
    """Parts of a batch in its order."""
    if not shape:
        yield ()
        return
    rest = int(np.prod(shape[1:]))
    if rest > _TOGETHER:
        for k in range(shape[0]):
            for where in _rows(shape[1:]):
                yield (slice(k, k + 1), *where)
        return
    step = max(1, _TOGETHER // max(rest, 1))
    for k in range(0, shape[0], step):
        yield (
            slice(k, min(k + step, shape[0])),
            *(slice(0, length) for length in shape[1:]),
        )
