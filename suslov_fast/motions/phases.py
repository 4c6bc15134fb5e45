"""`Phases`: when motions begin and end to slide along surfaces, or to rest on surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray, extra
from ..keywords import public

MODES = "leaves", "slides", "rests"


@dataclass(frozen=True, eq=False, repr=False)
class Phases:
    """Times at which motions slide, rest or leave: the attribute ``phases`` of a :class:`Motion`.

    The K entries are ordered by trajectory, then along the motion.

    Attributes
    ----------
    trajectory : ndarray(int, shape=(K,))
        Index of the trajectory, in the batch flattened in C order.
    surface : ndarray(str, shape=(K,))
        The surface, as the text of the function that is 0 on it.
    time : ndarray(float, shape=(K,))
        The times, as accurate as the tolerance.
    mode : ndarray(str, shape=(K,))
        "slides" or "rests" where such a phase begins, "leaves" where it ends.

    Examples
    --------
    A block on a belt of speed 0.3 sticks, until the spring pulls it off:

    >>> import numpy as np
    >>> from suslov_fast import Field, flow
    >>> block = Field(lambda s: (s[1], -s[0] - 0.4 * np.sign(s[1] - 0.3)), "x v")
    >>> phases = flow(block, [0.0, 0.3], time=3.0).phases
    >>> phases.surface.tolist(), phases.time.round(4).tolist(), phases.mode.tolist()
    (['v - 0.3', 'v - 0.3'], [0.0, 1.3333], ['slides', 'leaves'])
    """

    trajectory: NDArray[np.int64]
    surface: NDArray[np.str_]
    time: FloatArray
    mode: NDArray[np.str_]

    def __repr__(self) -> str:
        counts = (f"{mode}: {np.count_nonzero(self.mode == mode)}" for mode in MODES[::-1])
        return f"Phases({', '.join(counts)})"

    @public
    def to_dataframe(self) -> Any:
        """Return a pandas table with the attributes as columns."""
        return extra("pandas", "xarray").DataFrame(dict(vars(self)))


def phases_of(rows: Any, surfaces: tuple[str, ...]) -> Phases:
    """Return the `Phases` of rows (K, 4) from `rows_of`, or of None; `surfaces` are texts."""
    rows = np.empty((0, 4)) if rows is None else rows
    trajectory, which, mode = rows[:, [0, 1, 3]].astype(np.int64).T
    names = np.array(MODES)[mode]
    return Phases(trajectory, np.array(surfaces, str)[which], rows[:, 2].copy(), names)


def rows_of(records: Any, D: int, count: int, contacts: int) -> FloatArray:
    """Return rows (K, 4) of phases: trajectory, number of the surface, time, place in `MODES`.

    In the states of `Records`, modes follow after D components: `count` modes of surfaces of f,
    then `contacts` modes of contacts. Phases that begin and end at one instant are left out.
    """
    rows = []
    for g in range(count + contacts):
        modes = records.before[:, D + g], records.states[:, D + g]
        before, after = (mode < 0.5 if g >= count else mode == 0.0 for mode in modes)
        (changes,) = np.nonzero(before != after)
        trajectory, time = records.trajectory[changes], records.time[changes]
        is_new = np.ones(len(changes), bool)
        is_new[1:] = (trajectory[1:] != trajectory[:-1]) | (time[1:] != time[:-1])
        first = np.flatnonzero(is_new)
        changes = changes[first[np.diff([*first, len(changes)]) % 2 == 1]]
        mode = np.where(after[changes], 1 + (g >= count), 0)
        surface = np.full(len(changes), g)
        rows.append(np.c_[records.trajectory[changes], surface, records.time[changes], mode])
    both = np.concatenate(rows)
    return both[np.lexsort((abs(both[:, 2]), both[:, 0]))]
