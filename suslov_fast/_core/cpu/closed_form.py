"""Loops over trajectories and times of the closed form.

Common arguments, flat over the batch of B trajectories:

I1 ... eps   five arrays of B numbers, or of one that serves all; for the flow, eps scales time.
omega        (B, 2), the initial states.

Arrays of a block, lanes last, beside `given` of `loops_blocks`:

orbit   (7, LANES): X, Y, and the constants T, 1 / (1 + T)**2, r, log |r|; what rounding lost of Y,
        and then whether the state rests.
frame   (4, LANES): m11, m12, m21, m22, where omega = m (X, Y).
states  (2, LANES): angular velocities to be written.
"""

import numpy as np
from numba import prange

from ..codes import NONFINITE, OK, SUPERCRITICAL
from ..formulas.closed_form import orbit_of_flow, orbit_of_map, orbit_point
from ..formulas.coordinates import angular_velocity, at_rest, from_canonical, to_canonical
from ..jit import Loop, part
from . import intrinsics  # noqa: F401
from .blocks import (
    LANES,
    TASKS,
    gather_bodies,
    gather_states,
    in_whole_vectors,
    one_body,
    scatter_pairs,
)
from .vector import on_stack

# What a state costs, in steps of the map.
WORK = 30
# Times that one task takes.
CHUNK = 4096
# From so many times on, a loop goes along them and not across the batch.
ALONG = 16


@part
def enter_bodies(given, frame, lanes):
    for l in range(lanes):
        frame[0, l], frame[1, l], frame[2, l], frame[3, l] = from_canonical(
            given[0, l], given[1, l], given[2, l], given[3, l], given[4, l]
        )


@part
def enter_orbits(flow, given, orbit, lanes):
    for l in range(lanes):
        orbit[0, l], orbit[1, l], orbit[6, l] = to_canonical(
            given[0, l],
            given[1, l],
            given[2, l],
            given[3, l],
            given[4, l],
            given[5, l],
            given[6, l],
        )
    if flow:
        for l in range(lanes):
            orbit[2, l], orbit[3, l], orbit[4, l], orbit[5, l] = orbit_of_flow(
                orbit[0, l], orbit[1, l]
            )
            orbit[6, l] = orbit[0, l] == 0.0 and orbit[1, l] == 0.0
    else:
        for l in range(lanes):
            orbit[2, l], orbit[3, l], orbit[4, l], orbit[5, l] = orbit_of_map(
                orbit[0, l], orbit[1, l], orbit[6, l]
            )
            orbit[6, l] = at_rest(given[2, l], given[3, l], given[4, l], orbit[0, l], orbit[1, l])


# Short passes with few results each: one loop over all of this would not be vectorised.


@part
def go_across(given, orbit, frame, lag, n, states, lanes):
    """State n, or the state at time n, of each trajectory of a block."""
    for l in range(lanes):
        states[0, l], states[1, l] = orbit_point(
            orbit[0, l],
            orbit[1, l],
            orbit[2, l],
            orbit[3, l],
            orbit[4, l],
            orbit[5, l],
            lag,
            n,
        )
    for l in range(lanes):
        states[0, l], states[1, l] = angular_velocity(
            frame[0, l], frame[1, l], frame[2, l], frame[3, l], 0.0, 0.0, states[0, l], states[1, l]
        )
    for l in range(lanes):
        still = (orbit[6, l] != 0.0) | (n == 0.0)
        states[0, l] = given[5, l] if still else states[0, l]
        states[1, l] = given[6, l] if still else states[1, l]


@part
def go_along(given, orbit, frame, lag, times, l, out):
    """The states of the trajectory of one lane at all times, as a flat array."""
    X_0, Y_0, T, c, r, log_r, rests = orbit[:, l]
    m11, m12, m21, m22 = frame[:, l]
    omega1, omega2 = given[5, l], given[6, l]
    for j in range(times.size):
        n = times[j]
        X, Y = orbit_point(X_0, Y_0, T, c, r, log_r, lag, n)
        next1, next2 = angular_velocity(m11, m12, m21, m22, 0.0, 0.0, X, Y)
        still = (rests != 0.0) | (n == 0.0)
        out[2 * j] = omega1 if still else next1
        out[2 * j + 1] = omega2 if still else next2


def _fill(flow, I1, I2, I13, I23, eps, omega, times, out):
    """States of the map at step numbers `times`, or of the flow at times `times`.

    times   (N,).
    out     (B, N, 2); NaN where there is no state.
    """
    chunks = (times.size + CHUNK - 1) // CHUNK
    n_parts = (omega.shape[0] + LANES - 1) // LANES * chunks
    lag = 0.0 if flow else 1.0
    shared = one_body(I1, I2, I13, I23, eps)
    n_tasks = min(n_parts, TASKS)
    flat = out.reshape(out.size)
    for task in prange(n_tasks):
        given, orbit = on_stack(7, LANES), on_stack(7, LANES)
        frame, states = on_stack(4, LANES), on_stack(2, LANES)
        begin_of_task = task * n_parts // n_tasks
        for k in range(begin_of_task, (task + 1) * n_parts // n_tasks):
            first = k // chunks * LANES
            width = min(LANES, omega.shape[0] - first)
            lanes = in_whole_vectors(width)
            begin = k % chunks * CHUNK
            end = min(begin + CHUNK, times.size)
            if k == begin_of_task or not shared:
                gather_bodies(I1, I2, I13, I23, eps, first, width, lanes, given)
                enter_bodies(given, frame, lanes)
            gather_states(omega, first, width, lanes, given)
            enter_orbits(flow, given, orbit, lanes)
            if times.size >= ALONG:
                for l in range(width):
                    row = (first + l) * times.size
                    go_along(
                        given,
                        orbit,
                        frame,
                        lag,
                        times[begin:end],
                        l,
                        flat[2 * (row + begin) : 2 * (row + end)],
                    )
            else:
                for j in range(times.size):
                    go_across(given, orbit, frame, lag, times[j], states, lanes)
                    for l in range(width):
                        out[first + l, j, 0], out[first + l, j, 1] = states[0, l], states[1, l]


@part
def keep_safe(orbit, states, lanes):
    """NaN in place of the states of orbits that may meet a pole.

    Y decreases along an orbit, and the poles, where 1 - Y + X**2 = 0, lie at Y >= 1.
    """
    for l in range(lanes):
        steady = (orbit[0, l] == 0.0) & (orbit[1, l] != 1.0)
        safe = (orbit[6, l] != 0.0) | (orbit[1, l] < 1.0) | steady
        states[0, l] = states[0, l] if safe else np.nan
        states[1, l] = states[1, l] if safe else np.nan


def _jump(I1, I2, I13, I23, eps, omega, n, final, status):
    """State n > 0 of the map, of each orbit that cannot meet a pole on its way there.

    final    (B, 2), the states; NaN for the other orbits.
    status   (B,): OK or SUPERCRITICAL; NONFINITE for the other orbits.
    """
    n_blocks = (omega.shape[0] + LANES - 1) // LANES
    shared = one_body(I1, I2, I13, I23, eps)
    n_tasks = min(n_blocks, TASKS)
    for task in prange(n_tasks):
        given, orbit = on_stack(7, LANES), on_stack(7, LANES)
        frame, states = on_stack(4, LANES), on_stack(2, LANES)
        begin_of_task = task * n_blocks // n_tasks
        for block in range(begin_of_task, (task + 1) * n_blocks // n_tasks):
            first = block * LANES
            width = min(LANES, omega.shape[0] - first)
            lanes = in_whole_vectors(width)
            if block == begin_of_task or not shared:
                gather_bodies(I1, I2, I13, I23, eps, first, width, lanes, given)
                enter_bodies(given, frame, lanes)
            gather_states(omega, first, width, lanes, given)
            enter_orbits(False, given, orbit, lanes)
            go_across(given, orbit, frame, 1.0, n, states, lanes)
            keep_safe(orbit, states, lanes)
            scatter_pairs(states[0], states[1], first, width, final.reshape(final.size))
            for l in range(width):
                code = SUPERCRITICAL if (abs(orbit[1, l]) >= 1.0) & (orbit[6, l] == 0.0) else OK
                status[first + l] = code if abs(states[0, l]) < np.inf else NONFINITE


fill = Loop(_fill)
jump = Loop(_jump)
