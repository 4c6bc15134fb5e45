"""Runs that a kernel iterates step by step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .._jit import Kernel
from .._kernels.iterate import LANES
from . import threads
from .problem import Outcome, Problem, check_computed, never, not_computed


def iterate(problem: Problem, kernel: Kernel, numbers: int = 2, work: float = 1.0) -> Outcome:
    """Iterate a problem in three dimensions.

    `kernel` is one of `_kernels.iterate`, which holds a state in so many `numbers`; `work` is that
    of a step, in steps of the canonical map.
    """
    size, resume = problem.size, problem.resume
    turns = problem.orientation is not None
    turn = np.zeros((size if turns else 0, 4))
    turn[:, 0] = 1.0
    if problem.start:
        state = resume["state"].copy()
        turn = resume["turn"].copy() if turns else turn
        status, failed_at = resume["status"].copy(), resume["failed_at"].copy()
    else:
        state = np.empty((0 if problem.single else size, numbers))
        status, failed_at = not_computed(size), np.empty(size, np.int64)
    final = problem.room_for_last()
    turning = (problem.time_step, problem.orientation, turn, problem.turns) if turns else None
    for part in problem.parts(work, LANES):
        threads.run(
            kernel,
            part.work(LANES, work),
            problem.threads,
            tuple(problem.parameters),
            problem.omega,
            (*part, problem.every, problem.first_row),
            problem.saved,
            turning,
            (final, status, failed_at, state),
        )
    failed_at = _failed_at(status, failed_at)
    kept = {"state": state, "status": status, "failed_at": failed_at}
    return Outcome(final, status, failed_at, kept | ({"turn": turn} if turns else {}))


def _failed_at(status: NDArray[np.int8], failed_at: NDArray[np.int64]) -> NDArray[np.int64]:
    """The numbers of the first missing states, which kernels write where there is one."""
    if not check_computed(status):
        return never(status.size)
    failed_at[status >= 0] = -1
    return failed_at
