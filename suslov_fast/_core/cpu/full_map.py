"""The loop over steps of the three-component scheme."""

import numpy as np
from numba import prange

from ..codes import NONFINITE, OK, SINGULAR
from ..formulas.full_map import full_matrix, full_step
from ..jit import Loop, part

# Trajectories that a task takes side by side; what they need fits in the first cache.
LANES = 128
# More tasks than the threads of any machine that this is likely to meet.
TASKS = 64
# Rows of a block: eight coefficients, the state, and the state that it began with. They stand in
# one flat array at offsets that the compiler knows, so that it sees that none overlap.
STATE, BEFORE, ROWS = 8, 11, 14


@part
def enter(k, state, first, width, rows):
    """Fill the rows of a block; lanes beyond its width rest."""
    for r in range(ROWS * LANES):
        rows[r] = 0.0
    for l in range(width):
        for r in range(STATE):
            rows[r * LANES + l] = k[r, first + l]
        for c in range(3):
            rows[(STATE + c) * LANES + l] = state[c, first + l]
            rows[(BEFORE + c) * LANES + l] = state[c, first + l]


@part
def advance(rows):
    """One step of a block."""
    for l in range(LANES):
        next1, next2, next3 = full_step(
            rows[l],
            rows[LANES + l],
            rows[2 * LANES + l],
            rows[3 * LANES + l],
            rows[4 * LANES + l],
            rows[5 * LANES + l],
            rows[6 * LANES + l],
            rows[7 * LANES + l],
            rows[STATE * LANES + l],
            rows[(STATE + 1) * LANES + l],
            rows[(STATE + 2) * LANES + l],
        )
        rows[STATE * LANES + l] = next1
        rows[(STATE + 1) * LANES + l] = next2
        rows[(STATE + 2) * LANES + l] = next3


@part
def how_it_ended(rows, l):
    """How many steps the trajectory of a lane went from its first state here, and how it ended."""
    k1, k2, k3, k4 = rows[l], rows[LANES + l], rows[2 * LANES + l], rows[3 * LANES + l]
    k5, k6, k7, k8 = (
        rows[4 * LANES + l],
        rows[5 * LANES + l],
        rows[6 * LANES + l],
        rows[7 * LANES + l],
    )
    omega = (
        rows[BEFORE * LANES + l],
        rows[(BEFORE + 1) * LANES + l],
        rows[(BEFORE + 2) * LANES + l],
    )
    steps = 0
    following = full_step(k1, k2, k3, k4, k5, k6, k7, k8, omega[0], omega[1], omega[2])
    while not np.isnan(following[0]):
        omega = following
        steps += 1
        following = full_step(k1, k2, k3, k4, k5, k6, k7, k8, omega[0], omega[1], omega[2])
    m11, m12, m21, m22, det = full_matrix(k1, k2, k3, k4, k5, k6, omega[0], omega[1], omega[2])
    in_range = np.isfinite(m11 * m22) and np.isfinite(m12 * m21)
    return steps, SINGULAR if np.isnan(det) and in_range else NONFINITE


def _iterate(k, begin, end, start, stop, every, first_row, state, out, status, failed_at, scratch):
    """Iterate trajectories `begin` to `end` from state `start` to state `stop`.

    k           (8, B), the coefficients.
    state       (3, B), state `start`, then state `stop`; NaN where it does not exist.
    out         (rows, B, 3), states whose number is a multiple of `every`, from the one numbered
                first_row * every on; rows may be 0.
    status      (B,), SINGULAR or NONFINITE where a trajectory has ended; read and written.
    failed_at   (B,), the first state that does not exist, where one does not; read and written.
    scratch     (tasks, ROWS LANES), one for each task.
    """
    n_tasks = scratch.shape[0]
    n_blocks = (end - begin + LANES - 1) // LANES
    for task in prange(n_tasks):
        rows = scratch[task]
        for block in range(task * n_blocks // n_tasks, (task + 1) * n_blocks // n_tasks):
            first = begin + block * LANES
            width = min(LANES, end - first)
            enter(k, state, first, width, rows)
            to_save = every - start % every
            for n in range(start, stop):
                advance(rows)
                to_save -= 1
                if to_save == 0:
                    to_save = every
                    row = (n + 1) // every - first_row
                    for l in range(width):
                        for c in range(3):
                            out[row, first + l, c] = rows[(STATE + c) * LANES + l]
            for l in range(width):
                for c in range(3):
                    state[c, first + l] = rows[(STATE + c) * LANES + l]
                if status[first + l] == OK and np.isnan(state[0, first + l]):
                    steps, status[first + l] = how_it_ended(rows, l)
                    failed_at[first + l] = start + steps + 1


iterate = Loop(_iterate)
