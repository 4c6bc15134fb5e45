"""Random initial states, computed when they are needed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..checks import FloatArray, integer, real_number, wrong
from .memory import require


@dataclass(frozen=True)
class RandomStarts:
    """Random initial states for :func:`ensemble` or :func:`iterate`, uniform in a cube around 0.

    State i depends on the seed and on i alone, and is computed when it is needed.

    Parameters
    ----------
    size : int or tuple of int
        Number of states, or the shape of the batch.
    extent : float
        Each component lies in [-extent, extent), in the unit of the states.
    seed : int
        0 or more.

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
            size = tuple(integer("size", length, 0) for length in size)
        else:
            size = integer("size", size, 0)
        extent = real_number("extent", self.extent)
        if not isinstance(extent, float) or extent <= 0.0:
            raise wrong("extent", "a positive number", self.extent)
        object.__setattr__(self, "size", size)
        object.__setattr__(self, "extent", extent)
        object.__setattr__(self, "seed", integer("seed", self.seed, 0))

    @property
    def shape(self) -> tuple[int, ...]:
        """The batch shape."""
        return self.size if isinstance(self.size, tuple) else (self.size,)

    def states(self, count: int, start: int = 0, dimension: int = 2) -> FloatArray:
        """Return the states `start` to `start + count`.

        Parameters
        ----------
        count, start : int
            0 or more.
        dimension : int
            The number of components of a state, D.

        Returns
        -------
        ndarray(float, shape=(count, D))
        """
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

    def _part(self, where: tuple[slice, ...], dimension: int) -> FloatArray:
        """Return the states (..., D) of a part of the batch, given by a slice for each axis."""
        if not where:
            return self.states(1, 0, dimension).reshape(dimension)
        shape = (*(part.stop - part.start for part in where), dimension)
        require(16 * math.prod(shape), "fewer initial states, or `ensemble`, need less")
        states = np.empty(shape)
        if not states.size:
            return states
        first = [part.start for part in where]
        for index in np.ndindex(states.shape[:-2]):
            start = int(np.ravel_multi_index(np.add(first, (*index, 0)), self.shape))
            states[index] = self.states(states.shape[-2], start, dimension)
        return states
