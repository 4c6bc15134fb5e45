"""The loop over steps of the three-component scheme."""

import numpy as np
from numba import prange

from ..codes import NONFINITE, OK, SINGULAR
from ..formulas.full_map import full_matrix, full_step
from ..jit import Loop
from ..staged import staged
from . import intrinsics  # noqa: F401  (compiles what is imported from vector)
from .blocks import LANES, in_whole_vectors, tasks_for
from .vector import on_stack

# Rows of a block: eight coefficients, the state, and the state that it began with.
STATE, BEFORE, ROWS = 8, 11, 14


@staged
def enter(k, state, first, width, lanes, rows):
    """Fill the rows of a block; lanes beyond its width rest."""
    for r in range(ROWS):
        for l in range(width, lanes):
            rows[r, l] = 0.0
    for l in range(width):
        for r in range(STATE):
            rows[r, l] = k[r, first + l]
        for c in range(3):
            rows[STATE + c, l] = state[c, first + l]
            rows[BEFORE + c, l] = state[c, first + l]


@staged
def coefficients(rows, l):
    return (
        rows[0, l],
        rows[1, l],
        rows[2, l],
        rows[3, l],
        rows[4, l],
        rows[5, l],
        rows[6, l],
        rows[7, l],
    )


@staged
def advance(rows, lanes):
    """One step of a block."""
    for l in range(lanes):
        rows[STATE, l], rows[STATE + 1, l], rows[STATE + 2, l] = full_step(
            *coefficients(rows, l), rows[STATE, l], rows[STATE + 1, l], rows[STATE + 2, l]
        )


@staged
def how_it_ended(rows, l):
    """How many steps the trajectory of a lane went from its first state here, and how it ended."""
    k = coefficients(rows, l)
    omega1, omega2, omega3 = rows[BEFORE, l], rows[BEFORE + 1, l], rows[BEFORE + 2, l]
    next1, next2, next3 = full_step(*k, omega1, omega2, omega3)
    steps = 0
    while not np.isnan(next1):
        steps += 1
        omega1, omega2, omega3 = next1, next2, next3
        next1, next2, next3 = full_step(*k, omega1, omega2, omega3)
    m11, m12, m21, m22, det = full_matrix(*k[:6], omega1, omega2, omega3)
    in_range = np.isfinite(m11 * m22) and np.isfinite(m12 * m21)
    return steps, SINGULAR if np.isnan(det) and in_range else NONFINITE


@staged
def iterate_blocks(
    task, n_tasks, k, begin, end, start, stop, every, first_row, state, out, status, failed_at
):
    """What one task of `iterate` does."""
    rows, n_blocks = on_stack(ROWS, LANES), (end - begin + LANES - 1) // LANES
    for block in range(task * n_blocks // n_tasks, (task + 1) * n_blocks // n_tasks):
        first = begin + block * LANES
        width = min(LANES, end - first)
        lanes = in_whole_vectors(width)
        enter(k, state, first, width, lanes, rows)
        to_save = every - start % every
        for n in range(start, stop):
            advance(rows, lanes)
            to_save -= 1
            if to_save == 0:
                to_save = every
                row = (n + 1) // every - first_row
                for l in range(width):
                    for c in range(3):
                        out[row, first + l, c] = rows[STATE + c, l]
        for l in range(width):
            for c in range(3):
                state[c, first + l] = rows[STATE + c, l]
            if status[first + l] == OK and np.isnan(state[0, first + l]):
                steps, status[first + l] = how_it_ended(rows, l)
                failed_at[first + l] = start + steps + 1


def _iterate(k, begin, end, start, stop, every, first_row, state, out, status, failed_at):
    """Iterate trajectories `begin` to `end` from state `start` to state `stop`.

    k           (8, B), the coefficients.
    state       (3, B), state `start`, then state `stop`; NaN where it does not exist.
    out         (rows, B, 3), states whose number is a multiple of `every`, from the one numbered
                first_row * every on; rows may be 0.
    status      (B,), SINGULAR or NONFINITE where a trajectory has ended; read and written.
    failed_at   (B,), the first state that does not exist, where one does not; read and written.
    """
    n_tasks = tasks_for((end - begin + LANES - 1) // LANES)
    for task in prange(n_tasks):
        iterate_blocks(
            task,
            n_tasks,
            k,
            begin,
            end,
            start,
            stop,
            every,
            first_row,
            state,
            out,
            status,
            failed_at,
        )


iterate = Loop(_iterate)
