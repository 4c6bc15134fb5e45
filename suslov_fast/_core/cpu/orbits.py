"""What is known of the orbits of a block before any time is, and their states at one.

Arrays of a block are flat, with rows of WIDTH numbers, one for each lane:

given   the bodies, the step sizes and the states, as in `blocks`.
body    what the rows named below hold of each body and step size; lane 0 alone where all orbits
        share it.
orbit   what the rows named below hold of each orbit.
work    the times, and the states then.
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
from ..formulas.elementary import exponent, two_to_the, within
from ..lanewise import any_lane, larger, select, smaller
from ..staged import staged
from . import intrinsics  # noqa: F401  (compiles what is imported from vector)
from .blocks import gather_pairs, spread
from .vector import VECTOR

# Trajectories of a block, and those that are worked on at once: two vectors, as an operation on one
# would wait for the one before.
WIDTH, ABREAST = 64, 2 * VECTOR
# Orbits whose (X, Y) is in a unit above 2 to the power of this are left to iteration.
LARGE_UNIT = 900.0

# Where the rows of `given` lie.
GIVEN = 7 * WIDTH
I1_, I2_, I13_, I23_, EPS, GIVEN1, GIVEN2 = range(0, GIVEN, WIDTH)
# Those of `body`: the step size divided by a power of two, and the exponent of that; the matrix
# from (X, Y) of such a step size to omega; `spread_of_body`; and what `canonical_body` returns.
BODY = 15 * WIDTH
OWN_EPS, EXPONENT, M11, M12, M21, M22, SPREAD, *CANONICAL = range(0, BODY, WIDTH)
# Those of `orbit`: omega = (A1 A + B1 B, A2 A + B2 B); then what A and B are made of, as the
# formulas of the closed form say; the unit of time as a product; X, Y and T at time 0; whether the
# first state is far out; whether it is a number; and the status of the orbit after any number of
# steps forward.
ORBIT = 19 * WIDTH
A1, B1, A2, B2, KAPPA, V, K, LAG, R, *_REST = range(0, ORBIT, WIDTH)
LOG, LOG_LOST, UNIT1, UNIT2, X0, Y0, T0, FAR, KNOWN, CODE = _REST
# Those of `work`.
WORK = 3 * WIDTH
N, OMEGA1, OMEGA2 = range(0, WORK, WIDTH)


def lanes_at(array, index):
    """The ABREAST numbers that start at an element."""
    return array[index:][:ABREAST].copy()


def store_lanes(array, index, lanes):
    """The reverse of `lanes_at`."""
    array[index:][:ABREAST] = lanes


def enter_body(given, body, l):
    """What depends on the bodies and the step sizes of lanes l, l + 1, ... alone."""
    I1, I2, I13, I23, eps = (lanes_at(given, row + l) for row in range(0, GIVEN1, WIDTH))
    power = exponent(eps)
    own_eps = eps * two_to_the(-power)
    matrix = from_canonical(I1, I2, I13, I23, own_eps)
    of_body = own_eps, power, *matrix, spread_of_body(I1, I2), *canonical_body(I1, I2, I13, I23)
    for row, value in zip(range(0, BODY, WIDTH), of_body, strict=True):
        store_lanes(body, row + l, value)


@staged
def in_whole(width):
    """The lanes in use for so many trajectories or times."""
    return (width + ABREAST - 1) // ABREAST * ABREAST


@staged
def body_of_all(bodies):
    """Whether all orbits share their body and their step size."""
    shared = True
    for parameter in bodies:
        shared &= parameter.size == 1
    return shared


@staged
def enter_block(bodies, states, first, width, anew, given, body):
    """Gather the trajectories of a block; lanes beyond its width hold harmless numbers.

    bodies    I1, I2, I13, I23 and eps.
    anew      whether no block was entered there before: a body that all share is entered once.
    returns   the lanes in use, and by how much the lanes of `body` differ from one to the next.
    """
    shared = body_of_all(bodies)
    lanes = in_whole(width)
    if anew or not shared:
        of_bodies = ABREAST if shared else lanes
        row = 0
        for parameter in bodies:
            spread(parameter, first, width, of_bodies, given[row : row + WIDTH])
            row += WIDTH
        for l in range(0, of_bodies, ABREAST):
            enter_body(given, body, l)
    gather_pairs(states, first, width, given[GIVEN1 : GIVEN1 + WIDTH], given[GIVEN2:])
    for l in range(width, lanes):
        given[GIVEN1 + l], given[GIVEN2 + l] = 1.0, 1.0
    return lanes, 0 if shared else 1


def _entering(flow):
    """All that is known of some orbits before any time is."""

    def enter_orbit(back, given, body, orbit, l, b):
        """Of lanes l, l + 1, ..., whose bodies are in lanes b, b + 1, ...

        back   1, or -1 for what is known of them back in time.
        """
        omega1, omega2 = lanes_at(given, GIVEN1 + l), lanes_at(given, GIVEN2 + l)
        I13, I23, eps = (lanes_at(given, row + b) for row in (I13_, I23_, EPS))
        own_eps, e = lanes_at(body, OWN_EPS + b), lanes_at(body, EXPONENT + b)
        canonical = (lanes_at(body, row + b) for row in CANONICAL)
        largest = larger(abs(omega1), abs(omega2))
        o = exponent(largest)
        inverse = two_to_the(-o)
        X, Y, lost = canonical_state(
            I13, I23, *canonical, own_eps, omega1 * inverse, omega2 * inverse
        )
        # The unit of (X, Y), that of omega / (X, Y) as a product, and the unit of time as one.
        if flow:
            unit = -exponent(larger(abs(X), abs(Y)))
            scale1, scale2 = two_to_the(-unit), two_to_the(o)
            time = within(e + o - unit, 2000.0)
            near = within(time, 1000.0)
            unit1, unit2 = two_to_the(near), two_to_the(time - near)
        else:
            unit, scale1, scale2, unit1, unit2 = e + o, two_to_the(-e), 1.0, 1.0, 1.0
        factor = two_to_the(within(unit, 1022.0))
        X, Y, lost = X * factor, Y * (back * factor), lost * (back * factor)

        # T or K as a sum, r, and log |r| as a sum.
        if flow:
            T, T_lost = level_of_flow(X, Y, lost)
            r, log_r, log_lost, one, lag = 1.0, -2.0 * T, -2.0 * T_lost, 1.0, 0.0
            of_x = 4.0 * T
        else:
            T, r = ratio_of_map(X, Y, lost)
            T, T_lost = level_of_map(X, Y, lost, T, r)
            log_r, log_lost = logarithm_of_ratio(T, T_lost, r)
            one, lag = 1.0 + T, 1.0
            of_x = 4.0 * (T / one)
        v, k, lag = first_of_sequence(X, Y, T, one, lag)
        of_y = back * T
        m11, m12, m21, m22 = (lanes_at(body, row + b) for row in (M11, M12, M21, M22))

        # States that do not move are what their B alone makes. Next to (0, 1) none follows; and
        # beyond the range of float64 none is computed.
        rests, ends = X == 0.0, omega1 + omega2 != omega1 + omega2
        known = select(ends, 0.0, 1.0)
        if not flow:
            beyond = out_of_range(X, largest * lanes_at(body, SPREAD + b))
            rests = rests | at_rest(I13, I23, eps, X, Y)
            ends = ends | select(rests, (1.0 - Y) - lost == 0.0, beyond | (unit > LARGE_UNIT))
        # Y decreases along an orbit, and the poles, where 1 - Y + X**2 = 0, lie at Y >= 1.
        code = select(
            Y >= 1.0, float(NONFINITE), select(Y <= -1.0, float(SUPERCRITICAL), float(OK))
        )
        code = select(ends, float(NONFINITE), select(rests, float(OK), code))
        far = select((r <= 0.0) & (abs(Y) > FAR_OUT * T), 1.0, 0.0)
        of_orbit = (
            select(rests, 0.0, m11 * of_x * scale1 * scale2),
            select(ends, np.nan, select(rests, -omega1, m12 * of_y * scale1 * scale2)),
            select(rests, 0.0, m21 * of_x * scale1 * scale2),
            select(ends, np.nan, select(rests, -omega2, m22 * of_y * scale1 * scale2)),
            *(select(rests, 0.0, value) for value in (2.0 * r, v, k, lag)),
            select(rests, 1.0, r),
            *(select(rests, 0.0, value) for value in (log_r, log_lost)),
            unit1,
            unit2,
            X,
            Y,
            T,
            select(rests, 0.0, far),
            known,
            code,
        )
        for row, value in zip(range(0, ORBIT, WIDTH), of_orbit, strict=True):
            store_lanes(orbit, row + l, value)

    return enter_orbit


enter_orbit_of_map, enter_orbit_of_flow = _entering(False), _entering(True)


@staged
def enter_orbit(flow, back, given, body, orbit, l, b):
    """All that is known of orbits before any time is: forward, or back in time."""
    if flow:
        enter_orbit_of_flow(back, given, body, orbit, l, b)
    else:
        enter_orbit_of_map(back, given, body, orbit, l, b)


@staged
def enter_orbits(flow, back, given, body, orbit, lanes, step):
    """The same of all orbits of a block."""
    for l in range(0, lanes, ABREAST):
        enter_orbit(flow, back, given, body, orbit, l, step * l)


def after(n, orbit, l):
    """The w after |n| steps, or after that time, as f 2**k."""
    steps = abs(n) * lanes_at(orbit, UNIT1 + l) * lanes_at(orbit, UNIT2 + l)
    lag, r, log_r, lost, v, k = (lanes_at(orbit, row + l) for row in (LAG, R, LOG, LOG_LOST, V, K))
    return growth(smaller(steps, LONG_TIME), lag, r, log_r, lost, v, k)


def put_state(A, B, orbit, work, l):
    """Put what A and B make into `work`; whether a state is NaN without a reason before time 0."""
    a1, b1, a2, b2 = (lanes_at(orbit, row + l) for row in (A1, B1, A2, B2))
    omega1, omega2 = combined(a1, b1, a2, b2, A, B)
    store_lanes(work, OMEGA1 + l, omega1)
    store_lanes(work, OMEGA2 + l, omega2)
    known = lanes_at(orbit, KNOWN + l) != 0.0
    return any_lane((omega1 + omega2 != omega1 + omega2) & known)


def state_at(orbit, work, l):
    """The states of lanes l, l + 1, ... at their times; whether any needs another form."""
    f, k = after(lanes_at(work, N + l), orbit, l)
    A, B = orbit_point(f, k, lanes_at(orbit, KAPPA + l))
    return put_state(A, B, orbit, work, l), any_lane(lanes_at(orbit, FAR + l) != 0.0)


def far_state_at(orbit, work, l):
    """The same for those of them that are far out."""
    n = lanes_at(work, N + l)
    f, k = after(n, orbit, l)
    near = orbit_point(f, k, lanes_at(orbit, KAPPA + l))
    r, log_r, lost, X, Y, T = (lanes_at(orbit, row + l) for row in (R, LOG, LOG_LOST, X0, Y0, T0))
    far = far_point(smaller(abs(n), LONG_TIME), r, log_r, lost, 0.5 * X * (1.0 / T + 1.0), Y / T)
    is_far = lanes_at(orbit, FAR + l) != 0.0
    A, B = (select(is_far, *values) for values in zip(far, near, strict=True))
    return put_state(A, B, orbit, work, l)


@staged
def states_at(orbit, work, lanes):
    """The states of a block at the numbers of steps |n| in its row N, one for each lane.

    Returns whether `count_missing` would find any.
    """
    found = False
    for l in range(0, lanes, ABREAST):
        missing, far = state_at(orbit, work, l)
        if far:
            missing = far_state_at(orbit, work, l)
        found |= missing
    return found


@staged
def count_missing(orbit, work, lanes, missing):
    """Count states that are NaN without a reason before time 0.

    missing   (2,): those at steps of the map, and those between.
    """
    for l in range(lanes):
        total = work[OMEGA1 + l] + work[OMEGA2 + l]
        if (total != total) & (orbit[KNOWN + l] != 0.0):
            missing[0 if np.floor(work[N + l]) == work[N + l] else 1] += 1
