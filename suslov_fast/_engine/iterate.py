"""Runs that a kernel iterates step by step."""

from __future__ import annotations

import numpy as np

from .._jit import Kernel
from .._kernels.iterate import LANES
from . import threads
from .problem import Outcome, Problem, check_computed, never, not_computed

_NO_TURN = 1.0, 0.0, 0.0, 0.0


def iterate(problem: Problem, kernel: Kernel, numbers: int = 2, work: float = 1.0) -> Outcome:
    """Iterate a problem by a kernel of `block_loop`, which holds a state in so many `numbers`.

    `work` is that of a step, in steps of the canonical map.
    """
    size, resume, turning = problem.size, {}, None
    if problem.start:
        resume = {name: array.copy() for name, array in problem.resume.items()}
    else:
        resume["status"], resume["failed_at"] = not_computed(size), np.empty(size, np.int64)
        resume["state"] = np.empty((0 if problem.single else size, numbers))
        if problem.orientation is not None:
            resume["turn"] = np.tile(_NO_TURN, (size, 1))
    status, failed_at, state = resume["status"], resume["failed_at"], resume["state"]
    if problem.orientation is not None:
        turning = (problem.eps, problem.orientation, resume["turn"], problem.turns)
    final = problem.saved[-1] if problem.saves_last else np.empty(problem.omega.shape)
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
    if check_computed(status):
        failed_at[status >= 0] = -1  # kernels write it where a state is missing
    else:
        resume["failed_at"] = failed_at = never(size)
    return Outcome(final, status, failed_at, resume)
