"""Runs of the n-dimensional map by the closed form, where bodies move as those in three do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .._kernels import codes
from . import iterate_nd, jump
from .layout import for_kernel
from .problem import Outcome, Problem
from .progress import reporter
from .reduction import of_n_3, reduce

_NO_STATES, _NO_TURNS = np.empty((0, 0, 2)), np.empty((0, 0, 3, 3))
# Numbers of 3D states that are held at a time, and their rows, if there are as many.
_TOGETHER, _ROWS = 2**20, 2**12


def run(problem: Problem) -> Outcome:
    """The last states, and how each trajectory ended; saved states are filled on the way.

    A trajectory is taken from the closed form or iterated for what it is, whatever is beside it.
    """
    if not (problem.size and jump.jumps(problem)):
        return iterate_nd.run(problem)
    solved = _solved(problem)
    if not solved.any():
        return iterate_nd.run(problem)
    reduced = _Reduced(problem)
    jumping = reduced.reduced.fits & solved
    if jumping.all():
        with reporter(problem.progress, problem.stop - problem.start) as report:
            outcome = reduced.run()
            report(problem.stop - problem.start)
        return outcome
    return _one_or_the_other(problem, jumping) if jumping.any() else iterate_nd.run(problem)


def _solved(problem: Problem) -> NDArray[np.bool_]:
    """Return where J I = b I and J = a orthogonally to I, to the last bit, or n < 4."""
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
    """Return the 3D problem of n = 3."""
    J, I, eps = problem.parameters
    given = [for_kernel(each) for each in (*of_n_3(J, I), eps)]
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
    """Return the arrays from which a run goes on, which those that jump do not need."""
    return {
        "state": np.zeros((size, m)),
        "exponent": np.zeros(size),
        "status": np.zeros(size, np.int8),
        "failed_at": np.zeros(size, np.int64),
    }


class _Reduced:
    """A run, and the run in three dimensions that it comes to."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.reduced = reduced = reduce(problem.parameters, problem.omega, problem.threads)
        parameters = [for_kernel(each) for each in reduced.three.T]
        self.three = replace(
            problem,
            omega=reduced.state,
            parameters=parameters,
            eps=parameters[4],
            saved=_NO_STATES,
            turns=_NO_TURNS,
            resume={},
            progress=None,
        )

    def run(self) -> Outcome:
        """As `jump.run`; all trajectories must fit."""
        problem = self.problem
        size, m = problem.omega.shape
        if m == 2:
            return _done(problem, *jump.run(_in_three(problem))[:3])
        final = np.empty((size, m))
        status, failed_at = np.empty(size, np.int8), np.empty(size, np.int64)
        rows = len(problem.saved)
        lanes = max(_TOGETHER // (2 * min(max(rows, 1), _ROWS)), 1)
        for begin in range(0, size, lanes):
            some = np.arange(begin, min(begin + lanes, size))
            end = begin + some.size
            height = max(_TOGETHER // (2 * some.size), 1)
            for row in range(0, max(rows, 1), height):
                three = self._part(some, row, min(row + height, rows))
                last, status[begin:end], failed_at[begin:end], _ = jump.run(three)
                if rows:
                    rows_of_part = problem.saved[row : row + len(three.saved)]
                    self.reduced.expand(three.saved, rows_of_part, begin, problem.threads)
            self.reduced.expand(last[np.newaxis], final[np.newaxis], begin, problem.threads)
        if rows and problem.start == 0:
            first = problem.saved[0]
            np.copyto(first, problem.omega, where=failed_at[:, np.newaxis] != 0)
        return _done(problem, final, status, failed_at)

    def _part(self, some: NDArray[np.intp], row: int, end: int) -> Problem:
        """The run in three dimensions of some trajectories, from a saved row to another."""
        problem, before = self.problem, row + self.problem.first_row - 1
        last = end == len(problem.saved)
        stop = problem.stop if last else (end + problem.first_row - 1) * problem.every
        saved = np.empty((end - row, some.size, 2))
        start = before * problem.every if row else problem.start
        return replace(self.three.some(some, stop, saved), start=start)
