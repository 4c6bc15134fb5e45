"""Crossings of a surface by orbits: sections, maxima, exits, returns.

The march computes the orbits in pieces that fit into the caches. The user's function returns a
value for each state of a piece; only the states on both sides of a change of sign are kept.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies.advice import arguments_of
from ..checks import FloatArray, integer, one_of, wrong
from ..core.crossings import keep, put
from ..engine.arguments import BodyOrField, RandomStarts, check, require
from ..engine.status import ON_SINGULAR, OnSingular, Status, report_failures
from ..engine.stretches import March, Progress, Report, reporter
from ..maps import map_of
from .crossings import Crossings

# Numbers in a piece, which stays in the caches. A call of a kernel costs as much as some steps, so
# a piece has at least _STATES states of each trajectory, if these are at most _LARGE numbers.
_PIECE, _STATES, _LARGE = 2**17, 48, 2**22
_FIRST = 64  # steps of the first piece where a run may end early; each next one has twice as many
_WITHOUT_END = 2**62
_LAST = "components on the last axis, as x[..., 2]"  # advice, for surfaces of a single state

Surface = Callable[[FloatArray], ArrayLike]


def crossings(
    body: BodyOrField,
    omega0: ArrayLike | RandomStarts,
    /,
    eps: ArrayLike,
    steps: int,
    surface: Surface,
    *,
    direction: int = 1,
    transient: int = 0,
    most: int | None = None,
    threads: int | None = None,
    on_singular: OnSingular = "warn",
    progress: Progress = None,
) -> Crossings:
    """Find where orbits cross a surface s(x) = 0, and keep no other states.

    States are those of :func:`iterate` with method "auto", bit for bit. With a = s(x_n) and
    b = s(x_{n+1}), an orbit crosses between states n and n + 1 upwards if a < 0 <= b, and downwards
    if b < 0 <= a. So 0 counts as positive: an orbit that starts on the surface does not cross it
    upwards there, and crosses it downwards at once if b < 0.

    Parameters
    ----------
    body, omega0, eps, threads
        As in :func:`iterate`.
    steps : int
        Number of steps after the transient, 0 or more: transient <= n < transient + steps.
    surface : callable
        The function s, which takes states (..., D) and returns real numbers (...), each from its
        own state alone, with NumPy or compiled by Numba. A section:
        ``lambda x: x[..., 2] - 27``; a maximum of a component:
        ``lambda x: -vector_field(field, x)[..., 2]``; an exit: ``lambda x: (x**2).sum(-1) - 4``.
        It is called in the calling thread, once with the initial states before any step, then with
        read-only pieces (rows, ..., D) of the run, in which the batch keeps its shape. There is no
        crossing next to a value that is NaN or infinite.
    direction : {1, -1, 0}
        Crossings upwards, downwards, or both, in the order of n, also for a negative step size.
    transient : int
        Number of steps that are taken first, in which crossings are ignored.
    most : int, optional
        The number of crossings, 1 or more, at which a trajectory ends: ``most=1`` for first
        returns, times of escape and basins. The run ends when all trajectories have ended or
        failed.
    on_singular : {"warn", "raise", "ignore"}
        What to do if trajectories fail: one :class:`SingularStepWarning` for all, a
        :class:`SingularStepError` that holds the result as `crossings`, or nothing.
    progress : bool or callable, optional
        True shows a bar (needs tqdm); a callable is called as ``progress(done, transient +
        steps)``.

    Returns
    -------
    Crossings

    Notes
    -----
    The points :attr:`Crossings.states` lie on the straight line between two states of the map. If
    eps is so small that the map approximates the flow, a point differs from the crossing of the
    flow by O(eps**2), as a state of the map at a fixed time does. For larger eps points between two
    states have no meaning: use `before` or `after`.

    Memory is that of the crossings and of one piece, some 4 MB, or a few states of each trajectory.

    Examples
    --------
    The section of the Lorenz system at x3 = 27, and successive maxima of x3:

    >>> from suslov_fast import QuadraticField, crossings, vector_field
    >>> def lorenz(x, rho):
    ...     return 10 * (x[1] - x[0]), x[0] * (rho - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]
    >>> field = QuadraticField.from_function(lorenz, 3, rho=28)
    >>> starts = [[1.0, 1.0, 20.0], [-2.0, 1.0, 20.0]]
    >>> section = crossings(field, starts, 1 / 64, 2000, lambda x: x[..., 2] - 27, transient=500)
    >>> bool(abs(section.states[:, 2] - 27).max() < 1e-13)
    True
    >>> peaks = crossings(field, starts, 1 / 64, 2000, lambda x: -vector_field(field, x)[..., 2])
    >>> peaks.of(0).states[:3, 2].round(1)
    array([40.5, 38.7, 44. ])
    """
    problem = check(map_of(body), body, omega0, eps, threads, name="omega0")
    steps, transient = integer("steps", steps, 0), integer("transient", transient, 0)
    direction = integer("direction", direction, -1, "1, -1 or 0", 1)
    if most is not None:
        most = integer("most", most, 1, "None or an integer of at least 1")
    one_of("on_singular", on_singular, ON_SINGULAR)
    reports = reporter(progress, transient + steps)
    if not callable(surface):
        raise wrong("surface", "a function of states", checks.kind_of(surface), TypeError)
    if len(needed := arguments_of(surface)) > 1:
        expected = "a function of the states alone, as lambda x: x[..., 2] - 27"
        raise wrong("surface", expected, f"one of {', '.join(needed)}", TypeError)
    if type(problem.eps) is not float:  # a copy, for the result
        problem = problem._replace(eps=np.array(problem.eps))
    search = _Search(March(problem), surface, direction, most, steps)
    with reports as report:
        result = search.run(transient, steps, report)
    report_failures(result, on_singular, name="crossings")
    return result


class _Search:
    """The crossings of a march, piece by piece."""

    def __init__(
        self, march: March, surface: Surface, direction: int, most: int | None, steps: int
    ) -> None:
        self.march, self.surface = march, surface
        self.changed: Any = {1: np.greater, -1: np.less, 0: np.not_equal}[direction]
        self.most = most or _WITHOUT_END
        B, D = march.omega0.shape
        self.batch = march.problem.batch
        # The last state of the piece before, and the states of this piece, with their values.
        width = max(B * D, 1)
        self.rows = min(max(_PIECE // width, min(_STATES, _LARGE // width), 1), steps)
        require(8 * (self.rows + 1) * B * (D + 1), "divide the batch")
        self.states = np.empty((self.rows + 1, *self.batch, D))
        self.values = np.empty((self.rows + 1, B))
        self.values[0] = self.values_of(march.omega0.reshape(1, *self.batch, D))
        self.counts = np.zeros(B, np.int64)
        self.pieces: list[tuple[NDArray[np.int64], FloatArray]] = []  # as `keep` writes them

    def values_of(self, states: FloatArray) -> FloatArray:
        """Return the surface at states (rows, ..., D), as (rows, B), after checks."""
        states = states.view()
        states.flags.writeable = False
        try:
            values = np.asarray(self.surface(states))
        except IndexError as error:  # of one who takes a single state for the argument
            if not re.search("out of bounds|too many indices", str(error)):
                raise
            raise wrong("surface", _LAST, error, IndexError) from error
        if values.dtype.kind == "b":
            how = "pass the difference, not the comparison"
            raise wrong("surface", "real numbers", f"bool: {how}", TypeError)
        if values.dtype.kind not in "iuf":
            raise wrong("surface", "real numbers", f"values of dtype {values.dtype}", TypeError)
        if values.shape != states.shape[:-1]:
            received = f"values {values.shape} for states {states.shape}"
            expected = f"a number for each state, values (...) for (..., D), with {_LAST}"
            raise wrong("surface", expected, received)
        return values.reshape(len(states), -1).astype(np.float64, copy=False)

    def run(self, transient: int, steps: int, report: Report | None) -> Crossings:
        """March to the end, and return all crossings."""
        march, n, end = self.march, transient, transient + steps
        march.to(transient, report=report if transient else None)
        alive = march.status.ravel().copy()  # statuses of those that end before they fail
        self.states[0] = march.final
        if 0 < n < end:
            self.values[0] = self.values_of(self.states[:1])
        longest = self.rows if self.most == _WITHOUT_END else min(_FIRST, self.rows)
        while n < end and (march.status >= 0).any():
            rows = min(longest, end - n)
            longest = min(2 * longest, self.rows)
            states = self.states[: rows + 1]
            march.to(n + rows, 1, states[n > 0 :])  # the first piece begins with state 0
            # States beyond the end of a trajectory may overflow in the surface, without a warning.
            with np.errstate(over="ignore", invalid="ignore"):
                self.values[1 : rows + 1] = self.values_of(states[1:])
            self.look(n, states, self.values[: rows + 1])
            self.states[0], self.values[0] = states[rows], self.values[rows]
            # Trajectories that have ended are marked as failed: kernels may then leave them out.
            march.status.reshape(-1)[self.counts >= self.most] = Status.NONFINITE
            n += rows
            if report is not None:
                report(n)
        return self.result(alive)

    def look(self, n: int, states: FloatArray, values: FloatArray) -> None:
        """Keep the crossings between these states (rows + 1, ..., D), which begin with state n."""
        is_positive = values >= 0.0
        places = np.flatnonzero(self.changed(is_positive[1:], is_positive[:-1]))
        if places.size:
            flat = states.reshape(*values.shape, -1)
            integers = np.empty((places.size, 3), np.int64)
            numbers = np.empty((places.size, 2 * flat.shape[-1] + 1))
            given = places, n, values, flat, self.most, self.counts, integers, numbers
            count = keep(*given)
            if count == len(places):
                self.pieces.append((integers, numbers))
            elif count:  # copies, for memory
                self.pieces.append((integers[:count].copy(), numbers[:count].copy()))

    def result(self, alive: NDArray[np.int8]) -> Crossings:
        """Put the crossings in order, and return them."""
        march, counts = self.march, self.counts
        ends = np.cumsum(counts)
        starts, K, D = ends - counts, int(counts.sum()), march.omega0.shape[1]
        n, fraction = np.empty(K, np.int64), np.empty(K)
        before, after = np.empty((K, D)), np.empty((K, D))
        self.pieces.reverse()
        while self.pieces:  # memory for them is given back on the way
            put(*self.pieces.pop(), starts, n, before, after, fraction)
        final, status, failed_at = march.final.copy(), march.status.copy(), march.failed_at.copy()
        ended = counts >= self.most
        final.reshape(-1, D)[ended] = after[ends[ended] - 1]
        status.reshape(-1)[ended] = alive[ended]
        failed_at.reshape(-1)[ended] = -1
        trajectory = np.repeat(np.arange(len(counts)), counts)
        return Crossings(
            trajectory, n, before, after, fraction, counts.reshape(self.batch), status, failed_at,
            final, march.problem.body, march.problem.eps, march.problem.map,
        )  # fmt: skip
