"""Runs of the n-dimensional map."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeAlias

import numba
import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .._jit import Kernel
from .._kernels import map_nd
from .._kernels.codes import NEEDS_ELIMINATION, NOT_COMPUTED
from .._kernels.elimination import WIDTH
from . import threads
from .problem import Outcome, Problem, check_computed, never, not_computed, worst

_Turning: TypeAlias = tuple[FloatArray, ...] | None
# Numbers of states of trajectories that are computed anew together.
_TOGETHER = 2**20
# Lanes of a block are a multiple of this: whole vectors.
_VECTOR = 8


def run(problem: Problem) -> Outcome:
    """Iterate a checked problem.

    Raises
    ------
    MemoryError
        If there is no room for elimination where that is needed.
    """
    if problem.method == "gauss":
        return _run(problem, map_nd.iterate_by_elimination)
    outcome = _run(problem, map_nd.iterate)
    if worst(outcome.status) == NEEDS_ELIMINATION:
        left = np.flatnonzero(outcome.status == NEEDS_ELIMINATION)
        together = max(_TOGETHER // (problem.omega.shape[1] * (len(problem.saved) + 1)), 1)
        for begin in range(0, left.size, together):
            _run_anew(problem, left[begin : begin + together], outcome)
    check_computed(outcome.status)
    return outcome


def _run_anew(problem: Problem, some: NDArray[np.intp], outcome: Outcome) -> None:
    """Iterate some trajectories with elimination where it is needed."""
    (rows, _, m), turns = problem.saved.shape, problem.orientation is not None
    part = replace(
        problem.some(some, problem.stop, np.empty((rows, some.size, m))),
        start=problem.start,
        turns=np.empty((len(problem.turns), some.size, m + 1, m + 1)),
        orientation=None if problem.orientation is None else problem.orientation[some],
        resume={name: array[some] for name, array in problem.resume.items()},
    )
    of_part = _run(part, map_nd.iterate_with_elimination)
    if rows:
        problem.saved[:, some] = part.saved
    if turns:
        problem.turns[:, some] = part.turns
    outcome.final[some], outcome.status[some] = of_part.final, of_part.status
    outcome.failed_at[some] = of_part.failed_at
    for name, array in outcome.resume.items():
        array[some] = of_part.resume[name]


def _run(problem: Problem, kernel: Kernel) -> Outcome:
    size, m = problem.omega.shape
    plain = kernel is map_nd.iterate
    # Every step in O(n) may need elimination: then the first part takes some 0.3 s.
    work = max(8.0 * m, m**3 / 48.0) if kernel is map_nd.iterate_with_elimination else 8.0 * m
    work = m**3 / 3.0 if kernel is map_nd.iterate_by_elimination else work
    kept: tuple[Any, ...] = _kept(problem)
    final, status, failed_at, state, exponent = kept
    tasks, lanes = _tasks_and_lanes(size, problem.threads)
    columns, turning = _turning(problem, tasks, lanes)
    pairs = m + m % 2
    body = (lanes,) if max(len(each) for each in problem.parameters[:2]) > 1 else ()
    room = (
        np.empty((tasks, 2, pairs, *body)),
        np.empty((tasks, 2, pairs, lanes)),
        np.empty((tasks, 0, 1, 1)) if plain else _matrices(tasks, m),
    )
    for part in problem.parts(work, map_nd.LANES):
        if part.start:  # else all of them are new
            own = status[part.begin : part.end]
            own[failed_at[part.begin : part.end] < 0] = NOT_COMPUTED
        threads.run(
            kernel,
            part.work(map_nd.LANES, work),
            problem.threads,
            (*problem.parameters, problem.omega),
            (*part, problem.every, problem.first_row),
            problem.saved,
            turning,
            kept,
            room,
        )
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
    """Return the number of tasks that share the trajectories, and of lanes their blocks have."""
    blocks = max(-(-size // map_nd.LANES), 1)
    tasks = min(threads or numba.get_num_threads(), blocks) if blocks > 1 else 1
    # Of several tasks each has as many blocks, and these about the same size.
    blocks = -(-blocks // tasks) * tasks
    lanes = -(-max(size, 1) // (blocks * _VECTOR)) * _VECTOR
    return tasks, lanes


def _kept(problem: Problem) -> tuple[NDArray[np.generic], ...]:
    """Return final, status, failed_at, state and exponent of a run, copies where it goes on."""
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


def _matrices(tasks: int, m: int) -> FloatArray:
    """Return room for elimination."""
    try:
        return np.empty((tasks, m + 4, m + 2, WIDTH))
    except (MemoryError, ValueError) as error:  # NumPy has both for sizes out of all proportion
        size = 8.0 * tasks * m * (m + 1) * WIDTH
        raise MemoryError(
            f"expected {size:.3g} bytes to work in, which there are not: elimination takes them; "
            "use method='rank2', fewer threads, or shorter steps"
        ) from error
