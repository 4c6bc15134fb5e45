"""Runs of the 3D map: which loop takes which part of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .._core.cpu import blocks, closed_form
from .._kernels import maps_3d
from . import closed_form as closed
from . import threads
from .iterate import iterate
from .problem import Outcome, Problem, check_computed, never, not_computed
from .progress import reporter

# From so many steps on the closed form is faster than they are, where only the last state counts.
JUMP = 32
# Orbits that may meet a pole are iterated for so many steps, those not past it for 16 times more.
_AHEAD = 256
# So many of their states at a time, in arrays of their own.
_TOGETHER = 2**20


def run(problem: Problem) -> Outcome:
    """The last states, and how each trajectory ended; saved states are filled on the way."""
    return _jump(problem) if jumps(problem) else _iterate(problem)


def jumps(problem: Problem) -> bool:
    """Whether states are taken from the closed form, where they can be."""
    if problem.method != "auto" or problem.orientation is not None or problem.stop > 2**53:
        return False
    # The last state alone of a short run is found faster step by step.
    return problem.stop >= (1 if problem.keeps else JUMP)


def _iterate(problem: Problem) -> Outcome:
    """Step by step."""
    return iterate(problem, maps_3d.printed if problem.method == "ds2" else maps_3d.canonical)


def _jump(problem: Problem) -> Outcome:
    """All states by the closed form.

    Orbits that may meet a pole are iterated from their start until they are past it.
    """
    saved, size = problem.saved, problem.size
    rows, status, failed_at = len(saved), not_computed(size), never(size)
    if rows:
        _fill(problem, problem.omega, closed.NO_START, saved, problem.first_row, status)
    if problem.saves_last:
        final = saved[-1]
    else:
        final = last(problem, problem.omega, problem.stop, status)
    if check_computed(status):
        failed_at = failed_at.copy()
        unsafe = np.flatnonzero(status < 0)
        together = max(_TOGETHER // (problem.last_row + 1), 1)
        for first in range(0, unsafe.size, together):
            _past_poles(problem, unsafe[first : first + together], final, status, failed_at)
    if problem.progress:
        with reporter(problem.progress, problem.stop - problem.start) as report:
            report(problem.stop - problem.start)
    return Outcome(final, status, failed_at, {})


def _past_poles(
    problem: Problem,
    left: NDArray[np.intp],
    final: FloatArray,
    status: NDArray[np.int8],
    failed_at: NDArray[np.int64],
) -> None:
    """The same for trajectories that may meet a pole on their way."""
    ahead = _AHEAD
    while left.size:
        ahead = min(ahead, problem.stop)
        # All rows of this run and of what went before it: where it is cut does not matter.
        rows = np.empty((problem.last_row + 1 if len(problem.saved) else 0, left.size, 2))
        few = problem.some(left, ahead, rows[: ahead // problem.every + 1])
        final[left], status[left], failed_at[left], _ = _iterate(few)
        past = status[left] >= 0
        if ahead < problem.stop:
            ended = not_computed(left.size)
            ends = last(few, final[left], problem.stop - ahead, ended)
            check_computed(ended)
            past &= ended >= 0
            if len(rows):
                since = np.full(left.size, float(ahead))
                _fill(few, final[left], since, rows, 0, closed.NO_STATUS)
            final[left[past]] = ends[past]
        # Those that came to an end are done with too.
        done = past | (status[left] < 0) | (ahead == problem.stop)
        rows[ahead // problem.every + 1 :, status[left] < 0] = np.nan
        if len(problem.saved):
            problem.saved[:, left[done]] = rows[problem.first_row :, done]
        left = left[~done]
        ahead *= 16


def _fill(
    problem: Problem,
    omega: FloatArray,
    start: FloatArray,
    rows: FloatArray,
    first_row: int,
    status: NDArray[np.int8],
) -> None:
    """The rows from `first_row` on, by the closed form from states omega numbered `start`."""
    count = len(rows)
    closed.fill_run(
        1.0,
        (0.0, float(problem.every)),
        (first_row, first_row + count, -first_row, 1),
        False,
        problem.parameters,
        omega,
        start,
        rows,
        status,
        closed.none_missing(count * len(omega)),
        problem.threads,
    )


def last(problem: Problem, omega: FloatArray, n: int, status: NDArray[np.int8]) -> FloatArray:
    """State n, counted from omega; a status is negative where the closed form may not be used."""
    size = len(omega)
    final = np.empty((size, 2))
    threads.run(
        closed_form.jump,
        size * closed_form.ENTERING if size > blocks.LANES else 0,
        problem.threads,
        *problem.parameters,
        omega,
        float(n),
        final,
        status,
    )
    return final
