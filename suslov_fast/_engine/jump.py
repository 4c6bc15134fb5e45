"""Runs of the 3D map by the closed form: method "auto"."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .._kernels.closed_form import NOT_FOUND
from . import closed_form as closed
from .problem import Outcome, Problem, never, not_computed, worst
from .progress import reporter

# From so many steps on the closed form is faster than they are, where only the last state counts.
JUMP = 32
# So many states of orbits that must be iterated at a time, in arrays of their own.
_TOGETHER = 2**20


def jumps(problem: Problem) -> bool:
    """Return True if states are taken from the closed form, where they can be."""
    if problem.method != "auto" or problem.orientation is not None or problem.stop > 2**53:
        return False
    return problem.stop >= (1 if problem.keeps else JUMP)


def jump(problem: Problem, iterate: Callable[[Problem], Outcome]) -> Outcome:
    """Find all states by the closed form; those that leave its range are iterated."""
    saved, size = problem.saved, problem.size
    status, failed_at = not_computed(size), np.full(size, -1)
    ends, missing = (status, failed_at, float(problem.stop)), np.zeros(3)
    if len(saved):
        first = problem.first_row
        run = closed.Run(1.0, 0.0, float(problem.every), first, first + len(saved), -first, 1)
        closed.fill_rows(
            run, False, problem.parameters, problem.omega, saved, ends, missing, problem.threads
        )
    if problem.saves_last:
        final = saved[-1]
    else:
        final = last(problem, problem.omega, problem.stop, status, failed_at)
    least = worst(status)
    if least == NOT_FOUND:
        left = np.flatnonzero(status == NOT_FOUND)
        together = max(_TOGETHER // (problem.last_row + 1), 1)
        for begin in range(0, left.size, together):
            some = left[begin : begin + together]
            rows = np.empty((problem.last_row + 1 if len(saved) else 0, some.size, 2))
            found = iterate(problem.some(some, problem.stop, rows))
            final[some], status[some], failed_at[some] = found[:3]
            if len(saved):
                saved[:, some] = rows[problem.first_row :]
    if problem.progress:
        with reporter(problem.progress, problem.stop - problem.start) as report:
            report(problem.stop - problem.start)
    return Outcome(final, status, failed_at if least < 0 else never(size), {})


def last(
    problem: Problem,
    omega: FloatArray,
    n: int,
    status: NDArray[np.int8],
    failed_at: NDArray[np.int64] | None = None,
) -> FloatArray:
    """Return state n, and write how trajectories end."""
    final = np.empty((1, len(omega), 2))
    failed_at = np.empty(len(omega), np.int64) if failed_at is None else failed_at
    closed.fill_states(
        1.0,
        np.array([float(n)]),
        np.zeros(1, np.intp),
        False,
        problem.parameters,
        omega,
        final,
        (status, failed_at, float(n)),
        np.zeros(3),
        problem.threads,
    )
    return final[0]
