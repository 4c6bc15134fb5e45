"""Runs of the n-dimensional map by the closed form, where bodies move as those in three do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numba
import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .._core import codes
from .._core.cpu import closed_form, reduced_nd
from .._core.cpu.orbits import WIDTH
from .._core.cpu.seeds import GROUP
from .._core.cpu.vector import VECTOR, aligned
from . import closed_form as closed
from . import iterate_3d, iterate_nd, threads
from .layout import for_kernel
from .problem import Outcome, Problem, check_computed, never, worst
from .progress import reporter

_NO_STATES, _NO_TURNS = np.empty((0, 0, 2)), np.empty((0, 0, 3, 3))
# Numbers of states that are held beside the result at a time.
_TOGETHER = 2**20


def run(problem: Problem) -> Outcome:
    """The last states, and how each trajectory ended; saved states are filled on the way.

    A trajectory is taken from the closed form or iterated for what it is, whatever is beside it.
    """
    if not (problem.size and iterate_3d.jumps(problem)):
        return iterate_nd.run(problem)
    solved = _solved(problem)
    if not solved.any():
        return iterate_nd.run(problem)
    reduced = _Reduced(problem)
    jumping = reduced.fits & solved
    if jumping.all():
        with reporter(problem.progress, problem.stop - problem.start) as report:
            outcome = reduced.run()
            report(problem.stop - problem.start)
        return outcome
    return _one_or_the_other(problem, jumping) if jumping.any() else iterate_nd.run(problem)


def _solved(problem: Problem) -> NDArray[np.bool_]:
    """Where J I = b I and J = a on the vectors orthogonal to I, to the last bit, or n < 4."""
    J, I, _ = problem.parameters
    if J.shape[1] == 2:
        return np.ones(1, np.bool_)
    J, coupled = np.broadcast_arrays(J, I != 0)
    several = coupled.sum(axis=-1) > 1
    # Without the coupled component, if it is one.
    left_out = coupled & ~several[:, np.newaxis]
    low = np.where(left_out, np.inf, J).min(axis=-1)
    solved: NDArray[np.bool_] = low >= np.where(left_out, 0.0, J).max(axis=-1)
    return solved | ~coupled.any(axis=-1)


def _in_three(problem: Problem) -> Problem:
    """Of n = 3, with J = (I1, I2) and I = (I23, -I13): e1 and e2 are turned to fit."""
    J, I, eps = problem.parameters
    given = [for_kernel(each) for each in (J[:, 0], J[:, 1], -I[:, 1], I[:, 0], eps)]
    return replace(problem, parameters=given, resume={}, progress=None)


def _done(
    problem: Problem, final: FloatArray, status: NDArray[np.int8], failed_at: NDArray[np.int64]
) -> Outcome:
    # In n dimensions t >= 1 is no status: most bodies have no t.
    np.minimum(status, codes.OK, out=status)
    resume = _resume(*problem.omega.shape) | {"status": status, "failed_at": failed_at}
    return Outcome(final, status, failed_at, resume)


def _one_or_the_other(problem: Problem, jumping: NDArray[np.bool_]) -> Outcome:
    size, m = problem.omega.shape
    whole = Outcome(
        np.empty((size, m)), np.empty(size, np.int8), np.empty(size, np.int64), _resume(size, m)
    )
    steps, done = problem.stop - problem.start, 0
    with reporter(problem.progress, steps) as report:
        for some in _blocks(problem, jumping):
            saved = np.empty((len(problem.saved), some.size, m))
            part = replace(
                problem.some(some, problem.stop, saved),
                start=problem.start,
                resume={name: array[some] for name, array in problem.resume.items()},
            )
            outcome = _Reduced(part).run() if jumping[some[0]] else iterate_nd.run(part)
            if len(saved):
                problem.saved[:, some] = saved
            whole.final[some], whole.status[some] = outcome.final, outcome.status
            whole.failed_at[some] = outcome.failed_at
            for name, array in whole.resume.items():
                array[some] = outcome.resume[name]
            done += some.size
            report(done * steps // size)
    return whole


def _blocks(problem: Problem, jumping: NDArray[np.bool_]) -> Iterator[NDArray[np.intp]]:
    """Trajectories that jump, and others: some at a time."""
    together = max(_TOGETHER // (problem.omega.shape[1] * (len(problem.saved) + 1)), 1)
    for chosen in (np.flatnonzero(jumping), np.flatnonzero(~jumping)):
        for first in range(0, chosen.size, together):
            yield chosen[first : first + together]


def _resume(size: int, m: int) -> dict[str, NDArray[np.generic]]:
    """What a run is gone on with from, which for those that jump is nothing."""
    return {
        "state": np.zeros((size, m)),
        "exponent": np.zeros(size),
        "status": np.zeros(size, np.int8),
        "failed_at": np.zeros(size, np.int64),
    }


class _Reduced:
    """A run, and the run in three dimensions that it comes to."""

    def __init__(self, problem: Problem) -> None:
        size, m = problem.omega.shape
        self.problem = problem
        # One array: the system gives new memory for each large one, and takes it back.
        numbers = np.empty((7 + 2 * m, size))
        self.given, state = numbers[:5], numbers[5:7].reshape(size, 2)
        self.along = numbers[7 : 7 + m].reshape(size, m)
        self.across = numbers[7 + m :].reshape(size, m)
        self.fits = np.empty(size, np.bool_)
        threads.run(
            reduced_nd.reduce,
            size * (closed_form.ENTERING + 8 * m) if size > 1 else 0,
            problem.threads,
            *problem.parameters,
            problem.omega,
            self.given,
            state,
            self.along,
            self.across,
            self.fits.view(np.int8),
            _room(problem if size > VECTOR else None, reduced_nd.room_to_reduce(m)),
        )
        self.three = Problem(
            method=problem.method,
            omega=state,
            parameters=list(self.given),
            time_step=self.given[4],
            start=problem.start,
            stop=problem.stop,
            every=problem.every,
            keeps=problem.keeps,
            saved=_NO_STATES,
            turns=_NO_TURNS,
            threads=problem.threads,
        )

    def run(self) -> Outcome:
        """As `iterate_3d.run`; all trajectories must fit."""
        problem = self.problem
        if problem.omega.shape[1] == 2:
            return _done(problem, *iterate_3d.run(_in_three(problem))[:3])
        size = problem.size
        status, saved = np.full(size, codes.NOT_COMPUTED, np.int8), problem.saved
        if len(saved):
            self._fill(status)
        if problem.saves_last:
            final = saved[-1]
        else:
            last = iterate_3d.last(self.three, self.three.omega, problem.stop, status)
            final = np.empty_like(problem.omega)
            together = max(_TOGETHER // final.shape[1], 1)
            for some in (slice(k, k + together) for k in range(0, size, together)):
                final[some] = self._expanded(last[some], some)
        check_computed(status)
        failed_at = never(size)
        if worst(status) < 0:
            failed_at = failed_at.copy()
            unsafe = np.flatnonzero(status < 0)
            together = max(_TOGETHER // (problem.omega.shape[1] * (len(saved) + 1)), 1)
            for first in range(0, unsafe.size, together):
                few = unsafe[first : first + together]
                rows = np.empty((len(saved), few.size, 2))
                three = replace(self.three.some(few, problem.stop, rows), start=problem.start)
                last, status[few], failed_at[few], _ = iterate_3d.run(three)
                final[few] = self._expanded(last, few)
                if len(saved):
                    saved[:, few] = self._expanded(rows, few)
        if len(saved) and problem.start == 0:
            saved[0] = problem.omega
        return _done(problem, final, status, failed_at)

    def _expanded(self, state: FloatArray, some: NDArray[np.intp] | slice) -> FloatArray:
        """States (..., m), from those of three dimensions; the same bits as those of `fill`."""
        omega = self.along[some] * state[..., :1]
        omega += self.across[some] * state[..., 1:]
        return omega

    def _fill(self, status: NDArray[np.int8]) -> None:
        """The saved states, where they are not beyond a pole."""
        problem = self.problem
        rows, size, m = problem.saved.shape
        parallel = problem if size * rows > reduced_nd.STATES else None
        room = _room(parallel, reduced_nd.room_to_fill(m))
        missing = np.zeros((len(room), 2), np.int64)
        for lanes, (begin, end) in _slices(size, rows, m):
            threads.run(
                reduced_nd.fill,
                (lanes[1] - lanes[0]) * (closed_form.ENTERING + (end - begin) * (1 + m // 2)),
                problem.threads,
                self.given,
                self.three.omega,
                self.along,
                self.across,
                closed.NO_START,
                (0.0, float(problem.every)),
                lanes,
                (problem.first_row + begin, problem.first_row + end, problem.first_row),
                problem.saved,
                status,
                missing,
                room,
            )


def _room(problem: Problem | None, length: int) -> FloatArray:
    """So many numbers for each task of a run, or for a single one, on cache lines."""
    tasks = 1 if problem is None else problem.threads or numba.get_num_threads()
    length = -(-length // VECTOR) * VECTOR
    room: FloatArray = aligned(tasks * length).reshape(tasks, length)
    return room


def _slices(size: int, rows: int, m: int) -> Iterator[tuple[closed.Range, closed.Range]]:
    """Trajectories and saved states of each of the calls that a long one is cut into."""
    most = max(4 * closed.SLICE // m, 1)
    if size * rows <= most:
        yield (0, size), (0, rows)
        return
    width = min(max(most // min(rows, reduced_nd.STATES), WIDTH), size)
    height = max(most // max(width, 1), GROUP)
    for lane in range(0, size, max(width, 1)):
        for row in range(0, rows, height):
            yield (lane, min(lane + width, size)), (row, min(row + height, rows))
