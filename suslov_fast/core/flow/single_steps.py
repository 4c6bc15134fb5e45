"""A trajectory that takes one step at a time, so that its caller can look at each."""

import numpy as np

from .batch_solver import BatchSolver, SolverRequest
from .code_arguments import NUMBER
from .memory import BEGINS, LaneState


def attempts(f, table, x, last, settings):
    """Yield t, the number of steps and x (D,): at first, and after each attempted step.

    The steps are those of `BatchSolver` to the time `last`.
    """
    request = SolverRequest([last], 1, settings)
    motion = BatchSolver(f, table, x[np.newaxis], request, np.empty((1, 1, f.D)))
    motion.numbers[NUMBER.most], places = 0.0, motion.rows  # the code returns after each attempt
    rows, which, mode = motion._rows(slice(0, 1)), np.zeros(1, np.int64), LaneState.EXPLICIT
    while True:
        state, own = rows[0, places.state], rows[0, : f.D].copy()
        if motion.starts is not None:
            own[[*f.offsets]] += motion.starts[0]
        yield rows[0, places.t], rows[0, places.steps], own
        if state > LaneState.IMPLICIT:
            return
        if state in (BEGINS, 1 - mode):  # the first integrator, or the other one
            mode = int(max(state, LaneState.EXPLICIT))
            own_table = motion._table(which)
            take = motion._taker(motion.integrator(mode), rows, own_table, 1)
        while not take():
            pass
        if rows[0, places.state] == LaneState.TOO_MANY:  # it has made its one attempt
            rows[0, places.state] = mode
        motion.keep_branches(which, own_table)
