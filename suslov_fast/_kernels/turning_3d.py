"""Orientations in three dimensions, a block of trajectories at a time.

`turning` is a tuple of arrays:

time_step     (B,) or (1,), in the unit of time of the angular velocities
R0            (B, 3, 3), the orientations at state 0
quaternions   (B, 4), read and written
turns         (rows, B, 3, 3), the results
"""

from collections import namedtuple

import numpy as np

from .._formulas.rotation import row_times_matrix, turn_between, turned
from .._jit import formula, inlined, inner, select, stack
from .lanes import LANES, entry
from .tiles import lead_of, write_row

_TILE = 9 * LANES

# Rotations of a block of trajectories: q (4, LANES), the quaternions since state 0; the time step,
# in the unit of time of the angular velocities; the angular velocities before a step; and R0
# (9, LANES), the orientations at state 0, row by row.
Turns = namedtuple("Turns", "q time_step omega1 omega2 R0")


@inlined
def turns_block():
    q, R0 = stack(4, LANES), stack(9, LANES)
    return Turns(q, stack(LANES), stack(LANES), stack(LANES), R0)


@formula
def enter_turns(turning, omega, first, width, lanes, r):
    """Fill the rows of a block, with the angular velocities omega (B, 2)."""
    time_step, R0, quaternions, _ = turning
    for l in range(lanes):
        b = first + min(l, width - 1)
        unknown = np.isnan(omega[b, 0]) | np.isnan(omega[b, 1])
        for k in range(4):
            r.q[k, l] = select(unknown, np.nan, quaternions[b, k])
        r.time_step[l] = entry(time_step, b)
        r.omega1[l], r.omega2[l] = omega[b, 0], omega[b, 1]
        for i in range(3):
            for j in range(3):
                r.R0[3 * i + j, l] = R0[b, i, j]


@formula
def start_turns(states, r, lanes):
    """Set the angular velocities before the next step."""
    for l in range(lanes):
        r.omega1[l], r.omega2[l] = states[2 * l], states[2 * l + 1]


@formula
def turn_on(states, r, lanes):
    """Rotate the bodies by one step, from the previous angular velocities to those in `states`."""
    for l in range(lanes):
        next1, next2 = states[2 * l], states[2 * l + 1]
        unit, b1, b2 = turn_between(r.time_step[l], r.omega1[l], r.omega2[l], next1, next2)
        r.q[0, l], r.q[1, l], r.q[2, l], r.q[3, l] = turned(
            r.q[0, l], r.q[1, l], r.q[2, l], r.q[3, l], unit, b1, b2
        )
        r.omega1[l], r.omega2[l] = next1, next2


@inner
def write_turns(turning, r, place, first, width):
    """Write orientations to row `place` of the results."""
    _, _, _, turns = turning
    tile, q, R0 = stack(_TILE), r.q, r.R0
    for k in range(0, 9, 3):
        for l in range(width):
            tile[9 * l + k], tile[9 * l + k + 1], tile[9 * l + k + 2] = row_times_matrix(
                R0[k, l], R0[k + 1, l], R0[k + 2, l], q[0, l], q[1, l], q[2, l], q[3, l]
            )
    batch, flat = turns.shape[1], turns.reshape(turns.size)
    write_row(tile, 0, flat, 9 * (place * batch + first), 9 * width, 9 * batch, lead_of(turns))


@formula
def leave_turns(turning, r, first, width):
    """Write the quaternions from which a run is resumed."""
    _, _, quaternions, _ = turning
    for l in range(width):
        for k in range(4):
            quaternions[first + l, k] = r.q[k, l]
