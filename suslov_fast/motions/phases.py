"""`Phases`: when motions begin and end to slide along surfaces, or to rest on them."""

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
    """When motions begin and end to slide or rest: the attribute ``phases`` of a :class:`Motion`.

    There are K rows, ordered by trajectory, then along the motion.

    Attributes
    ----------
    trajectory : ndarray(int, shape=(K,))
        Index of the trajectory, in the batch flattened in C order.
    surface : ndarray(str, shape=(K,))
        The text of the surface: the function that is 0 on it.
    time : ndarray(float, shape=(K,))
        Times, with the digits of the tolerance.
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
        """Return the rows as a table of pandas, with the attributes as columns; needs pandas."""
        return extra("pandas", "xarray").DataFrame(dict(vars(self)))


def phases_of(rows: Any, surfaces: tuple[str, ...]) -> Phases:
    """Return the `Phases` with rows (K, 4) of `rows_of`, or None; `surfaces` are texts."""
    rows = np.empty((0, 4)) if rows is None else rows
    trajectory, which, mode = rows[:, [0, 1, 3]].astype(np.int64).T
    names = np.array(MODES)[mode]
    return Phases(trajectory, np.array(surfaces, str)[which], rows[:, 2].copy(), names)


def rows_of(records: Any, D: int, count: int, contacts: int) -> FloatArray:
    """Return rows (K, 4) of phases: trajectory, number of the surface, time, place in `MODES`.

    `records` are `Records` of states (D) with modes of `count` surfaces and then of contacts. Modes
    that begin and end at one instant are left out.
    """
    found = []
    for g in range(count + contacts):
        before, after = (
            a[:, D + g] < 0.5 if g >= count else a[:, D + g] == 0.0
            for a in (records.before, records.states)
        )
        (own,) = np.nonzero(before != after)
        trajectory, time = records.trajectory[own], records.time[own]
        is_new = np.ones(len(own), bool)
        is_new[1:] = (trajectory[1:] != trajectory[:-1]) | (time[1:] != time[:-1])
        first = np.flatnonzero(is_new)
        own = own[first[np.diff([*first, len(own)]) % 2 == 1]]
        mode = np.where(after[own], 1 + (g >= count), 0)
        columns = records.trajectory[own], np.full(len(own), g), records.time[own], mode
        found.append(np.stack([np.asarray(a, float) for a in columns], axis=1))
    rows = np.concatenate(found)
    return rows[np.lexsort((abs(rows[:, 2]), rows[:, 0]))]
