"""`Crossings`, the result of `crossings`: points, states on both sides, and its methods."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.classes import BodyOrField
from ..checks import FloatArray
from ..engine.problem import Problem
from ..engine.status import first_beyond
from ..engine.stretches import March
from ..maps import Map
from .failures import OnSingular, report_failures
from .points import Points
from .results import in_short, read_only
from .search import Search


@dataclass(frozen=True, eq=False, repr=False)
class Crossings(Points):
    """Points where orbits of a batch cross a surface: the result of :func:`crossings`.

    There are K crossings, ordered by trajectory, then by n.

    Attributes
    ----------
    trajectory : ndarray(int, shape=(K,))
        Index of the trajectory, in the batch flattened in C order;
        ``points.time[points.trajectory == i]`` are the times of trajectory i.
    n : ndarray(int, shape=(K,))
        The orbit crosses between its states n and n + 1, counted from the initial state.
    before, after : ndarray(float, shape=(K, D))
        The states n and n + 1, those of :func:`iterate` bit for bit. Start a return map from
        `after`: rounding may put a point of `states` below the surface, where it crosses again at
        once.
    fraction : ndarray(float, shape=(K,))
        The part of the step from n to n + 1 before the crossing, from 0 to 1. For methods of order
        2 it is a / (a - b), where a and b are the values of the surface at n and n + 1; for higher
        orders a step of the length ``fraction * eps`` from `before` ends on the surface.
    over_pole : ndarray(bool, shape=(K,))
        True where the surface changes its sign through infinity, because a step of a higher order
        has a pole within its length. Its point lies on the straight line from `before` to `after`,
        and its trajectory has the status `PASSED_POLE`.
    states, time : ndarray(float, shape=(K, D) and (K,))
        Points on the surface between `before` and `after`, and times (n + fraction) eps.
    count : ndarray(int, shape=(...))
        Number of crossings of each trajectory.
    status, failed_at, first_pole, final : ndarray, shape=(...), and (..., D) for `final`
        As in :class:`Trajectories`, after transient + steps steps. For a trajectory that ended at
        its crossing number `most`, `final` is the state after this crossing, and later failures and
        poles are not reported.
    valid : ndarray(bool, shape=(K,))
        True where no pole was passed before the state `after`. The other crossings are crossings of
        the map, not necessarily of the motion.
    body, eps, steps, transient, direction, most, method
        The arguments of :func:`crossings`.

    Notes
    -----
    ``len(points)`` is K. Two objects are equal if all attributes are equal; NaN equals NaN. Arrays
    are read-only: change a copy, such as ``points.after.copy()``.

    Examples
    --------
    When does x1 of a harmonic oscillator change sign upwards? At 3 pi / 2, then every 2 pi:

    >>> from suslov_fast import QuadraticField, crossings
    >>> oscillator = QuadraticField.from_function(lambda x: (x[1], -x[0]), 2)
    >>> points = crossings(oscillator, [1.0, 0.0], 1 / 8, 200, lambda x: x[..., 0])
    >>> points
    Crossings(x: (4, 2), n: 37, 88, 138, 188, eps: 0.125, failed: 0 of 1)
    >>> points.time.round(2)
    array([ 4.72, 11.01, 17.3 , 23.59])
    """

    coordinates = "trajectory", "n", "time"

    trajectory: NDArray[np.int64]
    n: NDArray[np.int64]
    before: FloatArray
    after: FloatArray
    fraction: FloatArray
    over_pole: NDArray[np.bool_]
    count: NDArray[np.int64]
    status: NDArray[np.int8]
    failed_at: NDArray[np.int64]
    first_pole: NDArray[np.int64]
    final: FloatArray
    body: BodyOrField
    eps: float | FloatArray
    map: Map
    method: str
    steps: int
    transient: int
    direction: int
    most: int | None

    @cached_property
    def states(self) -> FloatArray:
        """The points, shape (K, D).

        For methods of order 2 they are ``before + fraction * (after - before)``, where the value of
        the surface, interpolated linearly, is 0. For higher orders they are the states after a step
        of the length ``fraction * eps`` from `before`, except those over a pole.
        """
        if self.map.order == 2:
            points = self.after - self.before
            points *= self.fraction[:, np.newaxis]  # in place, in two fifths of the time
            points += self.before
        else:
            problem = Problem(self.map, self.body, self.final, self.eps, self.count.shape)
            eps = self._at_crossings(np.asarray(self.eps))
            march = March(problem, self.method)
            points = march.step_of(self.trajectory, self.before, self.fraction * eps)
            chords = self.before + self.fraction[:, np.newaxis] * (self.after - self.before)
            points = np.where(self.over_pole[:, np.newaxis], chords, points)
        return read_only(points)

    @cached_property
    def time(self) -> FloatArray:
        """Times (n + fraction) eps of the crossings, shape (K,), negative for negative eps."""
        eps = self._at_crossings(np.asarray(self.eps))
        times: FloatArray = read_only((self.n + self.fraction) * eps)
        return times

    @property
    def valid(self) -> NDArray[np.bool_]:
        """True for crossings before the first failure or pole of their trajectory, shape (K,)."""
        first = first_beyond(self.failed_at, self.first_pole).ravel()
        return read_only((self.n + 1 < first[self.trajectory]) & ~self.over_pole)

    @property
    def _heading(self) -> str:
        from .plot import titled

        return titled(self)

    def __repr__(self) -> str:
        n = self.n
        steps = f"{n.min()} ... {n.max()}" if n.size > 4 else ", ".join(map(str, n))
        if not n.size:
            steps = {1: "none upwards", -1: "none downwards", 0: "none"}[self.direction]
        return f"Crossings({self._variable}: {self.before.shape}, n: {steps}, {in_short(self)})"


def searched(
    search: Search,
    steps: int,
    transient: int,
    method: str,
    on_singular: OnSingular,
    reports: Any,
) -> Crossings:
    """Carry out a search, report its failures, and return the crossings."""
    march = search.march
    with reports as report:
        search.run(transient, transient + steps, report)
    if search.is_stopped:
        steps = max(march.n - transient, 0)
    problem = march.problem
    attributes = search.result() | {
        "body": problem.body,
        "eps": problem.eps,
        "map": problem.map,
        "method": method,
        "steps": steps,
        "transient": transient,
        "direction": search.direction,
        "most": search.most,
    }
    points = Crossings._of(attributes)
    report_failures(points, march, on_singular, 0, name="crossings")
    return points
