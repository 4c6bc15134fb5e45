"""`Crossings`, the result of `crossings` along maps and motions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.classes import BodyOrField
from ..checks import FloatArray
from ..engine.status import ended_in_words, first_beyond
from ..maps import Map
from .points import Points, span
from .results import OfMotion, in_short, read_only


@dataclass(frozen=True, eq=False, repr=False)
class Crossings(Points, OfMotion):
    """Points where orbits of a batch cross surfaces: the result of :func:`crossings`.

    There are K crossings, ordered by trajectory, then along the orbit.

    Attributes
    ----------
    trajectory : ndarray(int, shape=(K,))
        Index of the trajectory, in the batch flattened in C order;
        ``points.time[points.trajectory == i]`` are the times of trajectory i.
    time, states : ndarray(float, shape=(K,) and (K, D))
        Times and states of the crossings. Along a motion they have the digits of the tolerance,
        and lie on the surface to rounding, on the side to which the motion goes. Along a map the
        points lie on the straight line from `before` to `after`, and times are (n + fraction) eps.
    surface : ndarray(int, shape=(K,))
        Which of the surfaces is crossed; 0 if there is one.
    count : ndarray(int, shape=(...))
        Number of crossings of each trajectory.
    status : ndarray(int8, shape=(...))
        As in :class:`Motion` or :class:`Trajectories`. Of a trajectory that ended at its crossing
        number `most`, later failures and poles are not reported.
    end : ndarray(float, shape=(...))
        The time at which a solution ends, or of the first state that a map lacks; NaN if there is
        none.
    final : ndarray(float, shape=(..., D))
        The state at the last time, or at the crossing number `most`; along a map the state after
        it. NaN where a solution has ended.
    steps : int or ndarray(int, shape=(...))
        Along a map the argument, along motions the number of steps taken.
    n : ndarray(int, shape=(K,)), or None along motions, as all that follow
        The orbit of the map crosses between its states n and n + 1, counted from the initial state.
    before, after : ndarray(float, shape=(K, D))
        The states n and n + 1, those of :func:`iterate` bit for bit. Start a return map from
        `after`: rounding may put a point of `states` below the surface, where it crosses again at
        once.
    fraction : ndarray(float, shape=(K,))
        The part of the step from n to n + 1 before the crossing, a / (a - b), from 0 to 1, where a
        and b are the values of the surface at n and n + 1.
    failed_at, first_pole : ndarray(int, shape=(...))
        As in :class:`Trajectories`.
    valid : ndarray(bool, shape=(K,))
        True where no pole was passed before the state `after`. The other crossings are crossings of
        the map, not necessarily of the motion. True along motions.
    body, eps, method, transient, direction, most, last, rtol, atol, max_step, stiff
        The arguments of :func:`crossings`; `last` is the last time of a motion. Those of the other
        one of map and motion are None.

    Notes
    -----
    ``len(points)`` is K, and ``points.ok`` is True if no orbit ended early. Two objects are equal
    if all attributes are equal; NaN equals NaN. Arrays are read-only: change a copy, such as
    ``points.after.copy()``.

    Examples
    --------
    When does an oscillator pass 0 upwards? At 3 pi / 2, then every 2 pi:

    >>> from suslov_fast import QuadraticField, crossings
    >>> oscillator = QuadraticField.from_function(lambda x: (x[1], -x[0]), "q p")
    >>> points = crossings(oscillator, [1.0, 0.0], surface="q", time=20.0)
    >>> points
    Crossings(x: (3, 2), time: 4.71239 to 17.2788, rtol: 1e-09)
    >>> along_map = crossings(oscillator, [1.0, 0.0], 1 / 8, 200, "q")
    >>> along_map
    Crossings(x: (4, 2), n: 37, 88, 138, 188, eps: 0.125, failed: 0 of 1)
    >>> points.time.round(4), along_map.time.round(2)
    (array([ 4.7124, 10.9956, 17.2788]), array([ 4.72, 11.01, 17.3 , 23.59]))
    """

    trajectory: NDArray[np.int64]
    time: FloatArray
    states: FloatArray
    surface: NDArray[np.int64]
    count: NDArray[np.int64]
    status: NDArray[np.int8]
    end: FloatArray
    final: FloatArray
    body: BodyOrField
    steps: Any
    transient: float
    direction: int
    most: int | None
    # Of maps; `Any`, so that type checkers ask for no tests of None.
    n: NDArray[np.int64] | Any = None
    before: FloatArray | Any = None
    after: FloatArray | Any = None
    fraction: FloatArray | Any = None
    failed_at: NDArray[np.int64] | Any = None
    first_pole: NDArray[np.int64] | Any = None
    eps: float | FloatArray | Any = None
    map: Map | Any = None
    method: str | None = None
    # Of motions.
    last: float | Any = None

    @property
    def coordinates(self) -> tuple[str, ...]:
        return "trajectory", "surface" if self.map is None else "n", "time"

    @property
    def valid(self) -> NDArray[np.bool_]:
        """True for crossings before the first failure or pole of their trajectory, shape (K,)."""
        if self.map is None:
            return read_only(np.ones(len(self), np.bool_))
        first = first_beyond(self.failed_at, self.first_pole).ravel()
        return read_only(self.n + 1 < first[self.trajectory])

    @property
    def _heading(self) -> str:
        from .drawing import titled

        return super()._heading if self.map is None else titled(self)

    def __repr__(self) -> str:
        states, size = f"{self._variable}: {self.states.shape}", self.status.size
        states += f", trajectory: 0 to {size - 1}" * (size > 1)
        none = {1: "none upwards", -1: "none downwards", 0: "none"}[self.direction]
        if self.map is None:
            time = span(self.time) if self.time.size else none
            ended = ended_in_words(self.status)
            return f"Crossings({states}, time: {time}, rtol: {self.rtol:g}{ended})"
        n = self.n
        steps = f"{n.min()} ... {n.max()}" if n.size > 4 else ", ".join(map(str, n))
        if not n.size:
            steps = none
        return f"Crossings({states}, n: {steps}, {in_short(self)})"
