"""Orientations in three dimensions, a block of trajectories at a time.

The block has TURNING rows `r`: the quaternion of the rotation since state 0, the time step, the
angular velocity before a step, and R0. `turning` is a tuple of arrays:

time_step     (B,) or (1,), in the unit of time of the angular velocities
R0            (B, 3, 3), the orientations at state 0
quaternions   (B, 4), read and written
turns         (rows, B, 3, 3), the results
"""

import numpy as np

from .._formulas.rotation import row_times_matrix, turn_between, turned
from .._jit import carray, formula, inner, select, stack
from .lanes import LANES, entry
from .tiles import lead_of, write_row

_TIME_STEP, BEFORE, _START, TURNING = 4, 5, 7, 16
_TILE = 9 * LANES


@formula
def enter_turns(turning, omega, first, width, lanes, r):
    """Fill the rows of a block, with the angular velocities omega (B, 2)."""
    time_step, R0, quaternions, _ = turning
    for l in range(lanes):
        b = first + min(l, width - 1)
        missing = np.isnan(omega[b, 0]) | np.isnan(omega[b, 1])
        for k in range(4):
            r[k, l] = select(missing, np.nan, quaternions[b, k])
        r[_TIME_STEP, l] = entry(time_step, b)
        r[BEFORE, l], r[BEFORE + 1, l] = omega[b, 0], omega[b, 1]
        for i in range(3):
            for j in range(3):
                r[_START + 3 * i + j, l] = R0[b, i, j]


@formula
def turn_on(states, r, lanes):
    """Rotate the bodies by one step, from the previous angular velocities to those in `states`."""
    for l in range(lanes):
        next1, next2 = states[2 * l], states[2 * l + 1]
        unit, b1, b2 = turn_between(r[_TIME_STEP, l], r[BEFORE, l], r[BEFORE + 1, l], next1, next2)
        r[0, l], r[1, l], r[2, l], r[3, l] = turned(
            r[0, l], r[1, l], r[2, l], r[3, l], unit, b1, b2
        )
        r[BEFORE, l], r[BEFORE + 1, l] = next1, next2


@inner
def write_turns(turning, r, row, first, width):
    """Write orientations to a row of the results."""
    turns, tile = turning[3], carray(stack(_TILE), (_TILE,))
    for i in range(3):
        k = _START + 3 * i
        for l in range(width):
            tile[9 * l + 3 * i], tile[9 * l + 3 * i + 1], tile[9 * l + 3 * i + 2] = (
                row_times_matrix(
                    r[k, l], r[k + 1, l], r[k + 2, l], r[0, l], r[1, l], r[2, l], r[3, l]
                )
            )
    batch, flat = turns.shape[1], turns.reshape(turns.size)
    write_row(tile, flat, 9 * (row * batch + first), 9 * width, 9 * batch, lead_of(turns))


@formula
def leave_turns(turning, r, first, width):
    """Write the quaternions from which a run is resumed."""
    for l in range(width):
        for k in range(4):
            turning[2][first + l, k] = r[k, l]
