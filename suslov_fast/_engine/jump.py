"""Runs of the 3D map: step by step, or, with the method "auto", by the closed form."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .._kernels import maps_3d
from .._kernels.closed_form import NOT_FOUND
from . import closed_form as closed
from .iterate import iterate
from .problem import Outcome, Problem, check_computed, never, not_computed, worst
from .progress import reporter

# From so many steps on the closed form is faster than they are, where only the last state counts.
JUMP = 32
# So many states of orbits that must be iterated at a time, in arrays of their own.
_TOGETHER = 2**20


def run(problem: Problem) -> Outcome:
    """Find the last states, and how each trajectory ends; fill saved states."""
    return _jump(problem) if jumps(problem) else _iterate(problem)


def _iterate(problem: Problem) -> Outcome:
    return iterate(problem, maps_3d.printed if problem.method == "ds2" else maps_3d.canonical)


def jumps(problem: Problem) -> bool:
    """Return True if states are taken from the closed form, where they can be."""
    if problem.method != "auto" or problem.orientation is not None or problem.stop > 2**53:
        return False
    return problem.stop >= (1 if problem.keeps else JUMP)


def _jump(problem: Problem) -> Outcome:
    """Evaluate all states; orbits that leave the range of the closed form are iterated."""
    saved, size = problem.saved, problem.size
    status, failed_at = not_computed(size), never(size).copy()
    ends, missing = (status, failed_at, float(problem.stop)), np.zeros(3)
    if len(saved):
        first = problem.first_row
        rows = closed.Run(1.0, 0.0, float(problem.every), first, first + len(saved), -first, 1)
        closed.fill_rows(
            rows, False, problem.parameters, problem.omega, saved, ends, missing, problem.threads
        )
    final = saved[-1] if problem.saves_last else _last(problem, ends)
    failed = check_computed(status)
    if failed and worst(status) == NOT_FOUND:
        _iterate_others(problem, final, status, failed_at)
    if problem.progress:
        with reporter(problem.progress, problem.stop - problem.start) as report:
            report(problem.stop - problem.start)
    return Outcome(final, status, failed_at if failed else never(size), {})


def _iterate_others(
    problem: Problem, final: FloatArray, status: NDArray[np.int8], failed_at: NDArray[np.int64]
) -> None:
    """Iterate the trajectories whose status is NOT_FOUND from step 0, some at a time."""
    left, first = np.flatnonzero(status == NOT_FOUND), problem.first_row
    count = first + len(problem.saved) if len(problem.saved) else 0
    together = max(_TOGETHER // (count + 1), 1)
    for begin in range(0, left.size, together):
        some = left[begin : begin + together]
        rows = np.empty((count, some.size, 2))
        found = _iterate(problem.some(some, problem.stop, rows))
        final[some], status[some], failed_at[some], _ = found
        if count:
            problem.saved[:, some] = rows[first:]


def _last(problem: Problem, ends: closed.Ends) -> FloatArray:
    """Return the last states, and write how trajectories end."""
    final = np.empty((1, *problem.omega.shape))
    n, row, parameters = np.array([float(problem.stop)]), np.zeros(1, np.intp), problem.parameters
    closed.fill_states(
        1.0, n, row, False, parameters, problem.omega, final, ends, np.zeros(3), problem.threads
    )
    states: FloatArray = final[0]
    return states
