"""State n of the 3D map, and the state of the flow at a time, without iteration.

These are the solutions of Section 4 of the paper, in forms without cancellation near the line X = 0
and near t = 1, in the dimensionless coordinates (X, Y) of `coordinates`, and for n >= 0: a change
of the sign of Y gives the inverse map.

An orbit of the map has T = t, its `level`, and r = (1 - T)/(1 + T). On it
w_n = X / (T - Y) (1 + T) / 2 = (T + Y) / X / r / (1 + T) is a geometric sequence of ratio r, and

X_n = 4 T / (1 + T) A,   Y_n = T B,   A = w / (1 + k w**2),   B = (k w**2 - 1) / (k w**2 + 1),

where k = 2 r. 1 + k w**2 can cancel only if r < 0 and |k| w**2 is near 1: near a pole, and
where |Y| is much larger than T. There, with R = r**(2 n) and h = Y_0 / T,

A = X_0 (1 + T) / (2 T) r**n / D,   B = (h (1 + R) - (1 - R)) / D,   D = (1 + R) - h (1 - R)

cancels at poles only. Orbits of the flow satisfy the same with K = sqrt(X**2 / 2 + Y**2) for T,
exp(-2 K) for the ratio, and 1 for r and 1 + T elsewhere.

log r is stored as a sum of two numbers: n log r is large if an orbit starts near X = 0.
"""

from typing import NamedTuple

import numpy as np

from .._jit import formula, select, two_product
from .canonical_map import ZERO_TO_ROUNDING
from .coordinates import (
    canonical_body,
    canonical_state,
    from_canonical,
    sum_of_ordered,
    two_sum,
)
from .elementary import (
    LN2_HIGH,
    LN2_LOW,
    exponent,
    exponential,
    halvings,
    is_integer,
    larger,
    logarithm,
    logarithm_beyond,
    scaled,
    smaller,
    two_to_the,
    within,
)
from .integrals import level

# log r for r = 0: its exponential underflows to 0, and r**0 is 1.
NO_POWER = -1e5
# Ratio |Y| / T beyond which a state is far from both limits; only for t > 1.
FAR_OUT = 1.5
# Longer times and larger numbers of steps are replaced by this: `two_product` does not overflow.
LONGEST = 2.0**990
# A state with |X| + |Y| below this is taken for a fixed point: `level` would leave the range of
# float64.
SMALLEST = 1e-280
# Squares of larger X or Y leave the range of float64.
LARGEST = 2.0**500
# Powers of two up to this are part of the coefficients of an orbit; larger ones multiply its
# states, which would leave the range of float64 in between.
PART_OF_COEFFICIENTS = 300.0
# A flow whose unit of time is farther from 1 than this power of two is out of range.
LONGEST_UNIT = 960.0


class Orbit(NamedTuple):
    """Time-independent data of an orbit.

    omega = (a1 A + b1 B, a2 A + b2 B) 2**power, where A and B follow from
    w_n = v 2**k r**(n - lag), or where h is not 0 from X_0 (1 + T) / (2 T) = g and Y_0 / T = h.

    fate   one of the constants below, or 1 more than a real number near which the index of a
           nonexistent state may lie.
    """

    a1: float
    b1: float
    a2: float
    b2: float
    power: float
    v: float
    k: float
    lag: float
    r: float
    log_r: float
    log_lost: float
    g: float
    h: float
    fate: float


# Fates of orbits: beyond the range of float64; state 0 is NaN; state 0 is the pole (0, 1);
# t < 1; and t >= 1 without a pole in later states.
OUT_OF_RANGE, UNKNOWN, UNDEFINED, REGULAR, SUPERCRITICAL = -3.0, -2.0, -1.0, 0.0, 0.5
# Additional value of the coordinates of a state: a fixed point.
RESTS = 1.0


@formula
def level_in_two(size, correction, Y, lost, least):
    """Return T or K as a sum, from its rounded value and a correction, nearly size - |Y|.

    A correction below half of `least` extends the digits of |Y|.
    """
    more = correction + select(Y > 0.0, lost, -lost)
    small = 2.0 * abs(correction) <= least
    return sum_of_ordered(select(small, abs(Y), size), select(small, more, 0.0))


@formula
def logarithm_of_ratio(T, T_lost, r):
    """Return log |r|, as a sum of two numbers, for r = (1 - T) / (1 + T)."""
    k = halvings(abs(r))
    d, d_lost = two_sum(1.0, -T)
    # Near t = 1 only r has the digits of 1 - T, unless T has them.
    near = (T_lost == 0.0) & (abs(d) < 0.5)
    d, d_lost = select(near, r * (1.0 + T), d), select(near, 0.0, d_lost)
    s, s_lost = two_sum(1.0, T)
    # r = 2**k m, and log m = 2 artanh(q), q = (m - 1)/(m + 1).
    scale = two_to_the(-k)
    scale = select(r < 0.0, -scale, scale)
    d, d_lost = scale * d, scale * d_lost
    # T_lost comes last, as it may be larger than 1. For large T, where scale = -1, it cancels in
    # the first sum.
    above, lost = two_sum(d, -s)
    above, above_lost = two_sum(above, (lost + (d_lost - s_lost)) - (scale + 1.0) * T_lost)
    below, lost = two_sum(d, s)
    below, below_lost = two_sum(below, (lost + (d_lost + s_lost)) - (scale - 1.0) * T_lost)
    q = above / below
    back, back_lost = two_product(q, below)
    q_lost = (((above - back) - back_lost) + (above_lost - q * below_lost)) / below
    total, lost = sum_of_ordered(k * LN2_HIGH, 2.0 * q)
    lost = lost + ((2.0 * q_lost + logarithm_beyond(q)) + k * LN2_LOW)
    high = total + lost
    some = r != 0.0
    return select(some, high, NO_POWER), select(some, lost - (high - total), 0.0)


@formula
def first_of_sequence(X, Y, T, one, lag):
    """Return v and k, where w_lag = v 2**k, and the lag itself, 0 or that of the argument.

    one   1 + T for the map, 1 for the flow.
    lag   1 for the map, whose r may be 0, and 0 for the flow.
    """
    k = exponent(X)
    X = X * two_to_the(-k)
    negative = Y < 0.0
    rest = (T + abs(Y)) / one
    v = select(negative, 0.5 * X, rest) / select(negative, rest, X)
    own = exponent(v)
    return v * two_to_the(-own), select(negative, k, -k) + own, select(negative, 0.0, lag)


@formula
def coordinates_of_map(back, I1, I2, I13, I23, eps, omega1, omega2):
    """Return X, Y and the rounding error of Y, with back = -1 for the inverse map; the power of two
    that scales the states; that of time; and a fate or `RESTS`.
    """
    power, o = exponent(eps), exponent(larger(abs(omega1), abs(omega2)))
    body = canonical_body(I1, I2, I13, I23)
    own, inverse = eps * two_to_the(-power), two_to_the(-o)
    X, Y, lost = canonical_state(I13, I23, *body, own, omega1 * inverse, omega2 * inverse)
    factor = two_to_the(within(power + o, 1022.0))
    X, Y, lost = X * factor, Y * (back * factor), lost * (back * factor)
    rests = (X == 0.0) | (abs(X) + abs(Y) < SMALLEST)
    kind = select(rests, select((1.0 - Y) - lost == 0.0, UNDEFINED, RESTS), REGULAR)
    kind = select((abs(X) + abs(Y) < LARGEST) & (power + o < 1022.0), kind, OUT_OF_RANGE)
    kind = select((I13 == 0.0) & (I23 == 0.0) | (eps == 0.0), RESTS, kind)
    unknown = omega1 + omega2 != omega1 + omega2
    return X, Y, lost, -power, 0.0, select(unknown, UNKNOWN, kind)


@formula
def coordinates_of_flow(back, I1, I2, I13, I23, eps, omega1, omega2):
    """Return the coordinates for the flow, in the unit of the orbit; eps is the unit of time."""
    power, o = exponent(eps), exponent(larger(abs(omega1), abs(omega2)))
    body = canonical_body(I1, I2, I13, I23)
    own, inverse = eps * two_to_the(-power), two_to_the(-o)
    X, Y, lost = canonical_state(I13, I23, *body, own, omega1 * inverse, omega2 * inverse)
    e = exponent(larger(abs(X), abs(Y)))
    factor, time = two_to_the(-e), power + o + e
    X, Y, lost = X * factor, Y * (back * factor), lost * (back * factor)
    kind = select(abs(time) < LONGEST_UNIT, REGULAR, OUT_OF_RANGE)
    kind = select(X == 0.0, RESTS, kind)
    unknown = omega1 + omega2 != omega1 + omega2
    return X, Y, lost, o + e, time, select(unknown, UNKNOWN, kind)


@formula
def sequence_of_map(X, Y, lost, time, kind):
    """Return T and the fields of an `Orbit` from v on."""
    moves, supercritical = kind == REGULAR, abs(Y) >= 1.0
    X, Y, lost = select(moves, X, 1.0), select(moves, Y, 0.0), select(moves, lost, 0.0)
    # Both factors of r are of the order of 1 or smaller however large X and Y are.
    T = level(X, Y)
    below = 1.0 / (abs(X) + 1.0)
    share, X1, XT = below / (1.0 + T), X * below, X * (1.0 + T)
    r = (((1.0 - Y) - lost) * share) * (((1.0 + Y) + lost) * share)
    r = r / (below * below + 0.5 * X1 * X1)
    sum_with_Y = T + abs(Y)
    correction = 0.5 * r * XT * (XT / sum_with_Y)  # T - |Y|
    T, T_lost = level_in_two(T, correction, Y, lost, smaller(abs(Y), abs(1.0 - abs(Y))))
    log_r, log_lost = logarithm_of_ratio(T, T_lost, r)
    v, k, lag = first_of_sequence(X, Y, T, 1.0 + T, 1.0)
    far = (r <= 0.0) & (abs(Y) > FAR_OUT * T)
    # Y decreases along an orbit, and the poles, where 1 - Y + X**2 = 0, lie at Y >= 1. Where state
    # n does not exist, r**(2 n) = (Y - T) / (Y + T).
    ahead = (Y >= 1.0) & (r < 0.0)
    q = select(ahead, -correction / sum_with_Y, 1.0)
    pole = 0.5 * logarithm(q, 2.0 * (T / sum_with_Y)) / log_r
    fate = select(supercritical, SUPERCRITICAL, REGULAR)
    fate = select(moves | (kind == RESTS), fate, kind)
    return (
        T,
        select(moves, v, 0.0),
        select(moves, k, 0.0),
        select(moves, lag, 0.0),
        select(moves, r, 1.0),
        select(moves, log_r, 0.0),
        select(moves, log_lost, 0.0),
        select(moves & far, 0.5 * X * (1.0 / T + 1.0), 0.0),
        select(moves & far, Y / T, 0.0),
        select(moves & ahead, 1.0 + pole, fate),
    )


@formula
def sequence_of_flow(X, Y, lost, time, kind):
    """Return K and the fields of an `Orbit` from v on."""
    moves = kind == REGULAR
    X, Y, lost = select(moves, X, 1.0), select(moves, Y, 0.0), select(moves, lost, 0.0)
    K = np.sqrt(0.5 * X * X + Y * Y)
    K, K_lost = level_in_two(K, 0.5 * X * (X / (K + abs(Y))), Y, lost, abs(Y))
    v, k, _ = first_of_sequence(X, Y, K, 1.0, 0.0)
    unit = -2.0 * two_to_the(within(time, LONGEST_UNIT))
    return (
        K,
        select(moves, v, 0.0),
        select(moves, k, 0.0),
        0.0,
        1.0,
        select(moves, K * unit, 0.0),
        select(moves, K_lost * unit, 0.0),
        0.0,
        0.0,
        select(kind == RESTS, REGULAR, kind),
    )


@formula
def coefficients(of_x, of_y, power, kind, back, I1, I2, I13, I23, eps, omega1, omega2):
    """Return a1, b1, a2, b2 and power of an `Orbit` for which x is of_x A and y is of_y B."""
    m11, m12, m21, m22 = from_canonical(I1, I2, I13, I23, eps * two_to_the(-exponent(eps)))
    s = exponent(of_y)
    power = power + s
    own = within(power, PART_OF_COEFFICIENTS)
    unit = two_to_the(own)
    of_x, of_y = of_x * two_to_the(-s) * unit, back * of_y * two_to_the(-s) * unit
    moves, ends = kind == REGULAR, kind < 0.0
    a1, b1, a2, b2 = m11 * of_x, m12 * of_y, m21 * of_x, m22 * of_y
    fits = abs(a1) + abs(a2) + abs(b1) + abs(b2) < LARGEST
    ends = ends | moves & (~fits)
    # A fixed point is given by b alone.
    return (
        select(moves, a1, 0.0),
        select(ends, np.nan, select(moves, b1, -omega1)),
        select(moves, a2, 0.0),
        select(ends, np.nan, select(moves, b2, -omega2)),
        select(moves & fits, power - own, 0.0),
    )


@formula
def power_of_ratio(n, r, log_r, log_lost):
    """Return p, k and the sign s for which r**n = s (1 + p) 2**k, k an integer.

    s is NaN if no such number exists: between two states of t >= 1.
    """
    x, lost = two_product(n, log_r)
    lost = lost + n * log_lost
    endless = x < NO_POWER
    p, k = exponential(select(endless, NO_POWER, x), select(endless, 0.0, lost))
    even = is_integer(0.5 * abs(n)) | (r >= 0.0)
    exists = is_integer(abs(n)) | (r > 0.0)
    return p, k, select(exists, select(even, 1.0, -1.0), np.nan)


@formula
def growth(n, orbit):
    """Return f and k for which w_n = f 2**k."""
    steps = smaller(n, LONGEST) - orbit.lag
    p, k, sign = power_of_ratio(steps, orbit.r, orbit.log_r, orbit.log_lost)
    v = orbit.v * sign
    return v + v * p, orbit.k + k


@formula
def square(w):
    """Return w**2, or 0 if it is subnormal and negligible relative to 1."""
    w = select(abs(w) > 1e-100, w, 0.0)
    return w * w


@formula
def near_point(f, k, kappa):
    """Return A and B of w = f 2**k of any size; NaN at a pole."""
    # Scale w and 1 by a power of two that brings the larger one to the order of 1.
    large = (k > 0.0) & (kappa != 0.0)
    factor = select(abs(k) <= 1000.0, two_to_the(-smaller(abs(k), 1000.0)), 0.0)
    u = select(large, factor, 1.0)
    v = select(large, f, f * select(k > 0.0, 1.0 / factor, factor))
    first, second = square(u), kappa * square(v)
    D = first + second
    inverse = 1.0 / select(abs(D) > ZERO_TO_ROUNDING * (first + abs(second)), D, np.nan)
    return u * v * inverse, (second - first) * inverse


@formula
def far_point(n, orbit):
    """Return A and B by the second of the two forms."""
    p, k, sign = power_of_ratio(smaller(n, LONGEST), orbit.r, orbit.log_r, orbit.log_lost)
    power, h = scaled(1.0 + p, k), orbit.h
    # Near 1 the distance from 1 is more precise.
    rest = select(k == 0.0, -p, 1.0 - power)
    rest = rest * (2.0 - rest)
    R = square(power)
    D = (1.0 + R) - h * rest
    inverse = 1.0 / select(abs(D) > ZERO_TO_ROUNDING * ((1.0 + R) + abs(h) * rest), D, np.nan)
    return orbit.g * (sign * power) * inverse, (h * (1.0 + R) - rest) * (abs(sign) * inverse)


@formula
def near_state(half, kappa, a1, b1, a2, b2):
    """Return the angular velocity at a w whose square does not overflow and that is not near a
    pole.

    half    w / 2.
    kappa   4 k.
    """
    twice_inverse = 2.0 / (1.0 + half * (half * kappa))
    return b1 + (a1 * half - b1) * twice_inverse, b2 + (a2 * half - b2) * twice_inverse


@formula
def state_at(n, orbit):
    """Return state n >= 0 of any orbit; infinite or NaN if it does not exist."""
    f, k = growth(n, orbit)
    A, B = near_point(f, k, 2.0 * orbit.r)
    far_A, far_B = far_point(n, orbit)
    far = orbit.h != 0.0
    A, B = select(far, far_A, A), select(far, far_B, B)
    omega1, omega2 = orbit.a1 * A + orbit.b1 * B, orbit.a2 * A + orbit.b2 * B
    return scaled(omega1, orbit.power), scaled(omega2, orbit.power)
