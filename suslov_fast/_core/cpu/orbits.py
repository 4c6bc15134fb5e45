"""What is known of the orbits of a block before any time is, and their states at one.

given   (7, WIDTH): the bodies, the step sizes and the states, as in `blocks`.
body    (BODY, WIDTH): what the rows named below hold of each body and step size.
orbit   (ORBIT, WIDTH): what the rows named below hold of each orbit.
work    (WORK_ROWS, WIDTH): the numbers of steps, and what is made of them.

Short passes over lanes with few results each: one loop over all of this would not be vectorised.
"""

import numpy as np

from ..codes import NONFINITE, OK, SUPERCRITICAL
from ..formulas.closed_form import (
    FAR_OUT,
    LONG_TIME,
    combined,
    far_point,
    first_of_sequence,
    growth,
    level_of_flow,
    level_of_map,
    logarithm_of_ratio,
    orbit_point,
    out_of_range,
    ratio_of_map,
    spread_of_body,
)
from ..formulas.coordinates import at_rest, canonical_body, canonical_state, from_canonical
from ..formulas.elementary import exponent, scaled
from ..jit import part
from .blocks import gather_bodies, gather_states, in_whole_vectors

# Trajectories of a block.
WIDTH = 64

# Rows of `body`: the step size divided by its power of two, and the exponent of that; the matrix
# from (X, Y) of such a step size to omega; `spread_of_body`; and what `canonical_body` returns.
OWN_EPS, EXPONENT, M11, M12, M21, M22, SPREAD = range(7)
A2_, A2_LOST, C1, C1_LOST, C2, C2_LOST, INVERSE, ROOT = range(7, 15)
BODY = 15
# Rows of `orbit`: omega = (A1 A + B1 B, A2 A + B2 B); then what A and B are made of, as the
# formulas of the closed form say; the unit of time as a product; whether the first state is far
# out; whether it is a number; and the status of the orbit after any number of steps forward.
A1, B1, A2, B2, KAPPA, V, K, LAG, R, LOG, LOG_LOST, G, H, UNIT1, UNIT2, FAR, KNOWN, CODE = range(18)
ORBIT = 18
# Rows of `work`. While an orbit is entered they hold other things.
N, STEPS, F, E, A, B, OMEGA1, OMEGA2 = range(8)
WORK_ROWS = 8
X, Y, LOST, T, T_LOST, OWN, SCALE = range(7)


@part
def enter_bodies(I1, I2, I13, I23, eps, first, width, lanes, given, body):
    """Gather the bodies and the step sizes of a block, and find what depends on them alone."""
    gather_bodies(I1, I2, I13, I23, eps, first, width, lanes, given)
    for l in range(lanes):
        power = exponent(given[4, l])
        body[EXPONENT, l], body[OWN_EPS, l] = power, scaled(given[4, l], -power)
        body[SPREAD, l] = spread_of_body(given[0, l], given[1, l])
    for l in range(lanes):
        body[M11, l], body[M12, l], body[M21, l], body[M22, l] = from_canonical(
            given[0, l], given[1, l], given[2, l], given[3, l], body[OWN_EPS, l]
        )
    for l in range(lanes):
        (
            body[A2_, l],
            body[A2_LOST, l],
            body[C1, l],
            body[C1_LOST, l],
            body[C2, l],
            body[C2_LOST, l],
            body[INVERSE, l],
            body[ROOT, l],
        ) = canonical_body(given[0, l], given[1, l], given[2, l], given[3, l])


@part
def enter_block(I1, I2, I13, I23, eps, states, first, width, entered, given, body):
    """Gather the trajectories of a block; lanes beyond its width hold harmless numbers.

    entered   the number of the block before it in `given`, or -1: bodies that all share are
              entered once.
    """
    shared = I1.size * I2.size * I13.size * I23.size * eps.size == 1
    lanes = in_whole_vectors(width)
    if entered < 0 or not shared:
        # The first block may be narrower than those after it.
        of_bodies = in_whole_vectors(min(states.size // 2, WIDTH)) if shared else lanes
        enter_bodies(I1, I2, I13, I23, eps, first, width, of_bodies, given, body)
    gather_states(states, first, width, lanes, given)
    return lanes


@part
def enter_units(flow, given, body, orbit, work, lanes):
    """X, Y and what it lost; the unit of time, and the exponent of the unit of omega / (X, Y)."""
    for l in range(lanes):
        work[OWN, l] = exponent(max(abs(given[5, l]), abs(given[6, l])))
    for l in range(lanes):
        own = work[OWN, l]
        work[X, l], work[Y, l], work[LOST, l] = canonical_state(
            given[2, l],
            given[3, l],
            body[A2_, l],
            body[A2_LOST, l],
            body[C1, l],
            body[C1_LOST, l],
            body[C2, l],
            body[C2_LOST, l],
            body[INVERSE, l],
            body[ROOT, l],
            body[OWN_EPS, l],
            scaled(given[5, l], -own),
            scaled(given[6, l], -own),
        )
    for l in range(lanes):
        e, o = body[EXPONENT, l], work[OWN, l]
        own = -exponent(max(abs(work[X, l]), abs(work[Y, l])))
        unit = own if flow else max(min(e + o, 2000.0), -2000.0)
        work[SCALE, l] = o - own if flow else -e
        time = max(min(e + o - own, 2000.0), -2000.0) if flow else 0.0
        orbit[UNIT1, l] = scaled(1.0, max(min(time, 1000.0), -1000.0))
        orbit[UNIT2, l] = scaled(1.0, time - max(min(time, 1000.0), -1000.0))
        work[X, l], work[Y, l] = scaled(work[X, l], unit), scaled(work[Y, l], unit)
        work[LOST, l] = scaled(work[LOST, l], unit)


@part
def enter_levels(flow, work, orbit, lanes):
    """T or K as a sum, log |r| as a sum, and r."""
    if flow:
        for l in range(lanes):
            work[T, l], work[T_LOST, l] = level_of_flow(work[X, l], work[Y, l], work[LOST, l])
            orbit[R, l] = 1.0
            orbit[LOG, l], orbit[LOG_LOST, l] = -2.0 * work[T, l], -2.0 * work[T_LOST, l]
        return
    for l in range(lanes):
        work[T, l], orbit[R, l] = ratio_of_map(work[X, l], work[Y, l], work[LOST, l])
    for l in range(lanes):
        work[T, l], work[T_LOST, l] = level_of_map(
            work[X, l], work[Y, l], work[LOST, l], work[T, l], orbit[R, l]
        )
    for l in range(lanes):
        orbit[LOG, l], orbit[LOG_LOST, l] = logarithm_of_ratio(
            work[T, l], work[T_LOST, l], orbit[R, l]
        )


@part
def enter_sequences(flow, back, body, orbit, work, lanes):
    for l in range(lanes):
        one, lag = (1.0, 0.0) if flow else (1.0 + work[T, l], 1.0)
        orbit[V, l], orbit[K, l], orbit[LAG, l] = first_of_sequence(
            work[X, l], work[Y, l], work[T, l], one, lag
        )
    for l in range(lanes):
        orbit[KAPPA, l] = 2.0 * orbit[R, l]
        orbit[H, l] = work[Y, l] / work[T, l]
        orbit[G, l] = 0.5 * work[X, l] * (1.0 / work[T, l] + 1.0)
        far = (orbit[R, l] <= 0.0) & (abs(work[Y, l]) > FAR_OUT * work[T, l])
        orbit[FAR, l] = 1.0 if far else 0.0
    for l in range(lanes):
        share = 4.0 * (work[T, l] if flow else work[T, l] / (1.0 + work[T, l]))
        level, scale = back * work[T, l], work[SCALE, l]
        orbit[A1, l] = scaled(body[M11, l] * share, scale)
        orbit[B1, l] = scaled(body[M12, l] * level, scale)
        orbit[A2, l] = scaled(body[M21, l] * share, scale)
        orbit[B2, l] = scaled(body[M22, l] * level, scale)


@part
def enter_rest(flow, given, body, orbit, work, lanes):
    """States that do not move are what their B alone makes; next to (0, 1) none follows."""
    for l in range(lanes):
        x, y = work[X, l], work[Y, l]
        rests = x == 0.0
        if not flow:
            rests = rests | at_rest(given[2, l], given[3, l], given[4, l], x, y)
        work[OWN, l] = 1.0 if rests else 0.0
    if not flow:
        for l in range(lanes):
            x, y, rests = work[X, l], work[Y, l], work[OWN, l] != 0.0
            largest = max(abs(given[5, l]), abs(given[6, l]))
            nowhere = rests & ((1.0 - y) - work[LOST, l] == 0.0)
            beyond = out_of_range(x, largest * body[SPREAD, l]) & (work[OWN, l] == 0.0)
            work[SCALE, l] = 1.0 if nowhere | beyond else 0.0
    for l in range(lanes):
        rests, ends = work[OWN, l] != 0.0, (work[SCALE, l] != 0.0) & (not flow)
        orbit[A1, l], orbit[A2, l] = 0.0 if rests else orbit[A1, l], 0.0 if rests else orbit[A2, l]
        b1, b2 = -given[5, l] if rests else orbit[B1, l], -given[6, l] if rests else orbit[B2, l]
        orbit[B1, l], orbit[B2, l] = np.nan if ends else b1, np.nan if ends else b2
        orbit[R, l] = 1.0 if rests else orbit[R, l]
    for l in range(lanes):
        y, moves = work[Y, l], work[OWN, l] == 0.0
        state = given[5, l] + given[6, l]
        orbit[KNOWN, l] = 1.0 if state == state else 0.0
        # Y decreases along an orbit, and the poles, where 1 - Y + X**2 = 0, lie at Y >= 1.
        lost = (state != state) | (work[SCALE, l] != 0.0) | (moves & (y >= 1.0))
        code = SUPERCRITICAL if moves & (abs(y) >= 1.0) else OK
        orbit[CODE, l] = NONFINITE if lost else code
    for k in (KAPPA, V, K, LAG, LOG, LOG_LOST, FAR):
        for l in range(lanes):
            orbit[k, l] = 0.0 if work[OWN, l] != 0.0 else orbit[k, l]


@part
def enter_orbits(flow, back, given, body, orbit, work, lanes):
    """All that is known of the orbits before any time is: forward, or back in time."""
    enter_units(flow, given, body, orbit, work, lanes)
    for l in range(lanes):
        work[Y, l], work[LOST, l] = back * work[Y, l], back * work[LOST, l]
    enter_levels(flow, work, orbit, lanes)
    enter_sequences(flow, back, body, orbit, work, lanes)
    enter_rest(flow, given, body, orbit, work, lanes)


@part
def any_of(row, lanes):
    """Whether a number of a row is not 0; `any` of a comparison would allocate."""
    total = 0.0
    for l in range(lanes):
        total = max(total, abs(row[l]))
    return total != 0.0


@part
def states_at(orbit, work, lanes):
    """The states of a block at the numbers of steps |n| in its row N, one for each lane."""
    for l in range(lanes):
        work[STEPS, l] = min(abs(work[N, l]) * orbit[UNIT1, l] * orbit[UNIT2, l], LONG_TIME)
    for l in range(lanes):
        work[F, l], work[E, l] = growth(
            work[STEPS, l],
            orbit[LAG, l],
            orbit[R, l],
            orbit[LOG, l],
            orbit[LOG_LOST, l],
            orbit[V, l],
            orbit[K, l],
        )
    for l in range(lanes):
        work[A, l], work[B, l] = orbit_point(work[F, l], work[E, l], orbit[KAPPA, l])
    if any_of(orbit[FAR], lanes):
        for l in range(lanes):
            work[F, l], work[E, l] = far_point(
                work[STEPS, l],
                orbit[R, l],
                orbit[LOG, l],
                orbit[LOG_LOST, l],
                orbit[G, l],
                orbit[H, l],
            )
        for l in range(lanes):
            work[A, l] = work[F, l] if orbit[FAR, l] != 0.0 else work[A, l]
            work[B, l] = work[E, l] if orbit[FAR, l] != 0.0 else work[B, l]
    for l in range(lanes):
        work[OMEGA1, l], work[OMEGA2, l] = combined(
            orbit[A1, l], orbit[B1, l], orbit[A2, l], orbit[B2, l], work[A, l], work[B, l]
        )


@part
def count_missing(orbit, work, lanes, missing):
    """Count states that are NaN without a reason before time 0."""
    for l in range(lanes):
        if (work[OMEGA1, l] + work[OMEGA2, l] != work[OMEGA1, l] + work[OMEGA2, l]) & (
            orbit[KNOWN, l] != 0.0
        ):
            missing[0 if np.floor(work[N, l]) == work[N, l] else 1] += 1
