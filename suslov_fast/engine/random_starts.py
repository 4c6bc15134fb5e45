"""Random initial states, each computed from a seed and its index."""

import math
from dataclasses import KW_ONLY, dataclass
from itertools import product
from typing import Any, NoReturn

import numpy as np

from ..checks import FloatArray, integer, positive, real_array, require, wrong
from ..keywords import public, public_class


@public_class
@dataclass(frozen=True)
class RandomStarts:
    """Random initial states, uniform in a cube around 0 or in a box.

    Pass it as initial states to :func:`iterate`, :func:`crossings` or :func:`ensemble`. State i
    depends only on the seed and i, so a batch larger than memory can be divided in any way.

    Parameters
    ----------
    size : int or tuple of int
        Number of states, or the shape of the batch.
    extent : float, optional
        Half the edge of a cube: components lie in [-extent, extent).
    seed : int
        Key of the generator (Philox), 0 or more. The same seed gives the same states.
    low, high : float or sequence of float, optional
        The corners of a box, in place of `extent`: components lie in [low, high). Numbers for all
        components, or one number for each.

    Raises
    ------
    TypeError, ValueError
        If size or seed is not an integer from 0, extent not a positive number, low not below high,
        or both extent and low or high are given, or neither.

    Examples
    --------
    >>> from suslov_fast import RandomStarts, Suslov3D, iterate
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> iterate(body, RandomStarts(1000, extent=2.0, seed=1), eps=0.2, steps=10).omega.shape
    (11, 1000, 2)
    >>> RandomStarts(10**9, extent=2.0, seed=1).states(2, start=999_999_998).round(3)
    array([[ 0.428, -0.594],
           [-0.209, -0.973]])
    >>> RandomStarts(2, low=(0, 10), high=(1, 20)).states(2).round(3)  # populations are positive
    array([[1.2000e-02, 1.2415e+01],
           [1.1100e-01, 1.5644e+01]])
    """

    size: int | tuple[int, ...]
    extent: float | None = None
    seed: int = 0
    _: KW_ONLY
    low: Any = None
    high: Any = None

    def __post_init__(self) -> None:
        lengths = self.size if isinstance(self.size, (tuple, list)) else [self.size]
        size = tuple(integer("size", length, 0) for length in lengths)
        seed = integer("seed", self.seed, 0)
        vars(self).update(size=size[0] if len(size) == 1 else size, seed=seed)
        if self.low is None and self.high is None:
            if self.extent is None:
                raise TypeError("RandomStarts needs extent, or low and high, such as low=0, high=2")
            vars(self).update(extent=positive("extent", self.extent))
            return
        if self.extent is not None or self.low is None or self.high is None:
            raise TypeError("RandomStarts takes extent alone, or low and high, not some of each")
        low, high = real_array("low", self.low), real_array("high", self.high)
        if max(low.ndim, high.ndim) > 1 or (low.ndim and high.ndim and low.shape != high.shape):
            received = f"shapes {low.shape} and {high.shape}"
            raise wrong("low and high", "numbers, or one for each component", received)
        if not (low < high).all():
            raise wrong("low", "below high", f"{low.tolist()} with high = {high.tolist()}")
        with np.errstate(over="ignore"):
            if not np.isfinite(high - low).all():
                expected = "less than 1.8e308 apart"
                raise wrong("low and high", expected, f"{low.tolist()} and {high.tolist()}")
        # As tuples, because a set of starts is hashable.
        for name, ends in (("low", low), ("high", high)):
            vars(self)[name] = tuple(ends.tolist()) if ends.ndim else float(ends)

    @property
    def shape(self) -> tuple[int, ...]:
        """The batch shape."""
        return (self.size,) if isinstance(self.size, int) else self.size

    @public
    def states(self, count: int, start: int = 0, dimension: int = 2) -> FloatArray:
        """Return consecutive states.

        Parameters
        ----------
        count : int
            The number of states.
        start : int
            The number of the first one, which may exceed the size.
        dimension : int
            The number of components of a state.

        Returns
        -------
        ndarray(float, shape=(count, dimension))

        Examples
        --------
        >>> from suslov_fast import RandomStarts
        >>> starts = RandomStarts(10, extent=1.0)
        >>> bool((starts.states(4)[2:] == starts.states(2, start=2)).all())
        True
        """
        count, start = integer("count", count, 0), integer("start", start, 0)
        dimension = integer("dimension", dimension, 1)
        require(32 * count * dimension, "use fewer initial states, or ensemble")
        # Philox makes four 64-bit words for each value of its counter.
        first, skipped = divmod(start * dimension, 4)
        generator = np.random.Philox(key=self.seed, counter=first)
        words = generator.random_raw(skipped + count * dimension)
        unit = ((words[skipped:] >> np.uint64(11)) * 2.0**-53).reshape(count, dimension)
        states: FloatArray
        if self.extent is not None:
            states = np.asarray((2.0 * unit - 1.0) * self.extent, np.float64)
            return states
        low, high = np.array(self.low), np.array(self.high)
        if max(low.size, high.size) not in (1, dimension):
            received = f"{max(low.size, high.size)} for {dimension} components"
            raise wrong("low and high", "numbers, or one for each component", received)
        # Rounding may reach the upper end.
        states = np.minimum(low + (high - low) * unit, np.nextafter(high, low))
        return states

    def __array__(self, *_: object, **__: object) -> NoReturn:
        how = f"call .states({math.prod(self.shape)}, dimension=D), which returns them as an array"
        raise TypeError(f"RandomStarts has no states yet: {how}")

    __getitem__ = __array__

    def _part(self, where: tuple[slice, ...], dimension: int) -> FloatArray:
        """Return the states (..., D) of a part of the batch: a slice for each of its axes."""
        *outer, inner = [range(part.start, part.stop) for part in where] or [range(1)]
        begins, shape = product(*outer, inner[:1]), self.shape or (1,)
        rows = [
            self.states(len(inner), int(np.ravel_multi_index(begin, shape)), dimension)
            for begin in begins
        ]
        return np.reshape(rows, (*(part.stop - part.start for part in where), dimension))
