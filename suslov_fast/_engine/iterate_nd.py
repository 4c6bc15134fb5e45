"""Runs of the n-dimensional map."""

from __future__ import annotations

from typing import TypeAlias

import numba
import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .._kernels import map_nd
from .._kernels.codes import NEEDS_ELIMINATION, NOT_COMPUTED
from .._kernels.elimination import WIDTH
from . import threads
from .problem import Outcome, Problem, check_computed, never, not_computed, worst

_Turning: TypeAlias = tuple[FloatArray, ...] | None
# Lanes of a block are a multiple of this: whole vectors.
_VECTOR = 8


def run(problem: Problem) -> Outcome:
    """Iterate a checked problem.

    Raises
    ------
    MemoryError
        If there is no room for elimination where that is needed.
    """
    size, m = problem.omega.shape
    gauss = problem.method == "gauss"
    # Every step in O(n) may need elimination: then the first part takes some 0.3 s.
    work = m**3 / 3.0 if gauss else max(8.0 * m, m**3 / 48.0)
    final, status, failed_at, state, exponent = kept = _kept(problem)
    tasks, lanes = _tasks_and_lanes(size, problem.threads)
    columns, turning = _turning(problem, tasks, lanes)
    pairs = m + m % 2
    body = (lanes,) if max(len(each) for each in problem.parameters[:2]) > 1 else ()
    room = (
        np.empty((tasks, 2, pairs, *body)),
        np.empty((tasks, 2, pairs, lanes)),
        *_matrices(tasks, m, gauss),
    )
    for part in problem.parts(work, map_nd.LANES):
        own = status[part.begin : part.end]
        if part.start:  # else all of them are new
            own[failed_at[part.begin : part.end] < 0] = NOT_COMPUTED
        threads.run(
            map_nd.iterate,
            part.work(map_nd.LANES, work),
            problem.threads,
            gauss,
            (*problem.parameters, problem.omega),
            (*part, problem.every, problem.first_row),
            problem.saved,
            turning,
            kept,
            room,
        )
        if worst(own) == NEEDS_ELIMINATION:
            raise MemoryError(_no_room(m, tasks))
        check_computed(own)
    resume: dict[str, NDArray[np.generic]] = {
        "state": state,
        "exponent": exponent,
        "status": status,
        "failed_at": failed_at,
    }
    if columns is not None:
        resume["columns"] = columns
        if len(problem.turns) and not len(problem.saved):
            problem.turns[-1] = columns.swapaxes(1, 2)
    return Outcome(final, status, failed_at, resume)


def _tasks_and_lanes(size: int, threads: int | None) -> tuple[int, int]:
    """How many tasks share the trajectories, and how many lanes their blocks have."""
    blocks = max(-(-size // map_nd.LANES), 1)
    tasks = min(threads or numba.get_num_threads(), blocks) if blocks > 1 else 1
    # Of several tasks each has as many blocks, and these about the same size.
    blocks = -(-blocks // tasks) * tasks
    lanes = -(-max(size, 1) // (blocks * _VECTOR)) * _VECTOR
    return tasks, lanes


def _kept(problem: Problem) -> tuple[NDArray[np.generic], ...]:
    """What a run writes: final, status, failed_at, state, exponent; it begins with copies."""
    size, m = problem.omega.shape
    final = problem.saved[-1] if problem.saves_last else np.empty((size, m))
    if problem.start:
        before = problem.resume
        names = "status", "failed_at", "state", "exponent"
        return (final, *(before[name].copy() for name in names))
    return final, not_computed(size), never(size).copy(), np.empty((size, m)), np.empty(size)


def _turning(problem: Problem, tasks: int, lanes: int) -> tuple[FloatArray | None, _Turning]:
    """The transposed orientations, which a run turns in place, and the argument of kernels."""
    if problem.orientation is None:
        return None, None
    m = problem.omega.shape[1]
    if problem.start:
        columns = problem.resume["columns"].copy()
    else:
        columns = problem.orientation.swapaxes(1, 2).copy()
    room = np.empty((tasks, m, lanes)), np.empty((tasks, 2 * m + 4, m + 1))
    return columns, (problem.eps, columns, problem.turns, *room)


def _matrices(tasks: int, m: int, needed: bool) -> tuple[FloatArray, FloatArray]:
    """Room for elimination; empty where there is none and O(n) steps can do without.

    The system gives memory when it is first written to: what is not used costs nothing.
    """
    width = WIDTH // (1 + (m > 16) + 2 * (m > 64))  # so that most of a matrix stays in the caches
    try:
        return np.empty((tasks, m, m + 1, width)), np.empty((tasks, 2, m + 1, width))
    except (MemoryError, ValueError) as error:  # NumPy has both for sizes out of all proportion
        if needed:
            raise MemoryError(_no_room(m, tasks)) from error
        return np.empty((tasks, 0, 1, width)), np.empty((tasks, 2, 1, width))


def _no_room(m: int, tasks: int) -> str:
    size = 8.0 * tasks * m * (m + 1) * _VECTOR
    return (
        f"expected {size:.3g} bytes to work in, which there are not: elimination takes them; "
        "use method='rank2', fewer threads, or shorter steps"
    )
