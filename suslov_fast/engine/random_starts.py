"""Random initial states, each computed from a seed and its index."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from ..checks import FloatArray, integer, positive, require


@dataclass(frozen=True)
class RandomStarts:
    """Random initial states for :func:`ensemble` or :func:`iterate`, uniform in a cube around 0.

    State i is computed when it is needed, from the seed and i alone, so that a batch larger than
    memory can be divided in any way.

    Parameters
    ----------
    size : int or tuple of int
        Number of states, or the shape of the batch.
    extent : float
        Half the edge of the cube: components lie in [-extent, extent), in the unit of the states.
    seed : int
        Key of the generator (Philox), 0 or more. The same seed gives the same states.

    Raises
    ------
    TypeError, ValueError
        If size or seed is not an integer from 0, or extent not a positive number.

    Examples
    --------
    >>> from suslov_fast import RandomStarts, Suslov3D, iterate
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> iterate(body, RandomStarts(1000, extent=2.0, seed=1), eps=0.2, steps=10).omega.shape
    (11, 1000, 2)
    >>> RandomStarts(10**9, extent=2.0, seed=1).states(2, start=999_999_998).round(3)
    array([[ 0.428, -0.594],
           [-0.209, -0.973]])
    """

    size: int | tuple[int, ...]
    extent: float
    seed: int = 0

    def __post_init__(self) -> None:
        lengths = self.size if isinstance(self.size, (tuple, list)) else [self.size]
        size = tuple(integer("size", length, 0) for length in lengths)
        extent, seed = positive("extent", self.extent), integer("seed", self.seed, 0)
        vars(self).update(size=size[0] if len(size) == 1 else size, extent=extent, seed=seed)

    @property
    def shape(self) -> tuple[int, ...]:
        """The batch shape."""
        return (self.size,) if isinstance(self.size, int) else self.size

    def states(self, count: int, start: int = 0, dimension: int = 2) -> FloatArray:
        """Return `count` states from number `start` on, of shape (count, dimension)."""
        count, start = integer("count", count, 0), integer("start", start, 0)
        dimension = integer("dimension", dimension, 1)
        require(32 * count * dimension, "use fewer initial states, or ensemble")
        # Philox makes four 64-bit words for each value of its counter.
        first, skipped = divmod(start * dimension, 4)
        generator = np.random.Philox(key=self.seed, counter=first)
        words = generator.random_raw(skipped + count * dimension)
        unit = (words[skipped:] >> np.uint64(11)) * 2.0**-53
        states: FloatArray = np.asarray((2.0 * unit - 1.0) * self.extent, np.float64)
        return states.reshape(count, dimension)

    def _part(self, where: tuple[slice, ...], dimension: int) -> FloatArray:
        """Return the states (..., D) of a part of the batch: a slice for each of its axes."""
        *outer, inner = [range(part.start, part.stop) for part in where] or [range(1)]
        begins, shape = product(*outer, inner[:1]), self.shape or (1,)
        rows = [
            self.states(len(inner), int(np.ravel_multi_index(begin, shape)), dimension)
            for begin in begins
        ]
        return np.reshape(rows, (*(part.stop - part.start for part in where), dimension))
