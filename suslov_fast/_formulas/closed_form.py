"""The n-th state of the 3D map, and the state of the flow at time t, without iterating.

Section 4 of the paper, in forms that cancel nowhere: next to the line X = 0, next to t = 1 and on
it. All is in the dimensionless coordinates (X, Y) of `coordinates`, and for n >= 0: the inverse map
is the map with Y reversed.

An orbit of the map has T = t, its `level`, and r = (1 - T)/(1 + T). On it
w_n = X / (T - Y) (1 + T) / 2 = (T + Y) / X / r / (1 + T) is a geometric sequence of ratio r, and

X_n = 4 T / (1 + T) A,   Y_n = T B,   A = w / (1 + k w**2),   B = (k w**2 - 1) / (k w**2 + 1),

where k = 2 r. Only where r < 0 and |k| w**2 is near 1 may 1 + k w**2 cancel: next to a pole, and
where |Y| is much larger than T. There, with R = r**(2 n) and h = Y_0 / T,

A = X_0 (1 + T) / (2 T) r**n / D,   B = (h (1 + R) - (1 - R)) / D,   D = (1 + R) - h (1 - R)

cancels at poles only. Orbits of the flow obey the same with K = sqrt(X**2 / 2 + Y**2) for T,
exp(-2 K) for the ratio, and 1 for r and 1 + T elsewhere.

log r is held as a sum of two numbers: n log r is large where an orbit comes from next to X = 0.
"""

import numpy as np

from .._jit import formula, select, two_product
from .canonical_map import ZERO_TO_ROUNDING
from .coordinates import sum_of_ordered, two_sum
from .elementary import (
    LN2_HIGH,
    LN2_LOW,
    exponent,
    exponential,
    halvings,
    is_integer,
    larger,
    logarithm_beyond,
    scaled,
    smaller,
    two_to_the,
)
from .integrals import level

# exp of less than this, times anything, is 0: so log r is where r = 0, whose power 0 is 1.
NO_POWER = -1e5
# Corrections of |Y| so much smaller than it are added to it without rounding the sum.
SMALL_CORRECTION = 2.0**-8
# |Y| beyond so many T is far from both limits, which only orbits with t > 1 can be.
FAR_OUT = 1.5
# Times in the unit of an orbit, and numbers of steps, that are as good as infinite: a step that
# changes a state at all does so by 1e-150 of it.
LONG_TIME = 2.0**900


@formula
def quotient(v, v_lost, w, w_lost):
    """(v + v_lost) / (w + w_lost), and what rounding lost."""
    q = v / w
    back, back_lost = two_product(q, w)
    return q, (((v - back) - back_lost) + (v_lost - q * w_lost)) / w


@formula
def level_in_two(size, correction, Y, lost, least):
    """T or K, of which size is a rounded value, and size - |Y| is nearly `correction`.

    The sum is used where the correction is small beside `least`.
    """
    more = correction + select(Y > 0.0, lost, -lost)
    small = abs(correction) <= SMALL_CORRECTION * least
    return sum_of_ordered(select(small, abs(Y), size), select(small, more, 0.0))


@formula
def ratio_of_map(X, Y, lost):
    """T and r of an orbit."""
    T = level(X, Y)
    # Both factors are of the order of 1 or smaller however large X and Y are.
    below = 1.0 / (abs(X) + 1.0)
    share = below / (1.0 + T)
    above = (((1.0 - Y) - lost) * share) * (((1.0 + Y) + lost) * share)
    return T, above / (below * below + 0.5 * (X * below) * (X * below))


@formula
def level_of_map(X, Y, lost, T, r):
    """T as a sum of two numbers, from T, where that makes any difference."""
    XT = X * (1.0 + T)
    correction = 0.5 * r * XT * (XT / (T + abs(Y)))
    return level_in_two(T, correction, Y, lost, smaller(abs(Y), abs(1.0 - abs(Y))))


@formula
def logarithm_of_ratio(T, T_lost, r):
    """log |r|, as a sum of two numbers, for r = (1 - T) / (1 + T)."""
    k = halvings(abs(r))
    d, d_lost = two_sum(1.0, -T)
    d, d_lost = sum_of_ordered(d, d_lost - T_lost)
    # Next to t = 1 only r knows the digits of 1 - T, unless T does.
    near = (T_lost == 0.0) & (abs(d) < 0.5)
    d, d_lost = select(near, r * (1.0 + T), d), select(near, 0.0, d_lost)
    s, s_lost = two_sum(1.0, T)
    s_lost = s_lost + T_lost
    # r = 2**k m, and log m = 2 artanh((m - 1)/(m + 1)).
    scale = two_to_the(-k)
    scale = select(r < 0.0, -scale, scale)
    d, d_lost = scale * d, scale * d_lost
    above, lost = two_sum(d, -s)
    above, above_lost = two_sum(above, lost + (d_lost - s_lost))
    below, lost = two_sum(d, s)
    q, q_lost = quotient(above, above_lost, below, lost + (d_lost + s_lost))
    total, lost = sum_of_ordered(k * LN2_HIGH, 2.0 * q)
    lost = lost + ((2.0 * q_lost + logarithm_beyond(q)) + k * LN2_LOW)
    high = total + lost
    some = r != 0.0
    return select(some, high, NO_POWER), select(some, lost - (high - total), 0.0)


@formula
def level_of_flow(X, Y, lost):
    """K as a sum of two numbers, X and Y being of the order of 1."""
    size = abs(X) + abs(Y)
    X1, Y1 = X / size, Y / size
    K = size * np.sqrt(0.5 * X1 * X1 + Y1 * Y1)
    return level_in_two(K, 0.5 * X * (X / (K + abs(Y))), Y, lost, abs(Y))


@formula
def first_of_sequence(X, Y, T, one, lag):
    """v and k, where w_lag = v 2**k, and the lag itself, 0 or the one given.

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
def logarithm_of_power(power, log_r, log_lost):
    """power log |r|, as a sum of two numbers."""
    x, lost = two_product(power, log_r)
    return x, lost + power * log_lost


@formula
def power_of_logarithm(x, lost):
    """p and k, an integer, for which exp(x + lost) = (1 + p) 2**k, x <= 0."""
    endless = x < NO_POWER
    return exponential(select(endless, NO_POWER, x), select(endless, 0.0, lost))


@formula
def sign_of_power(power, r):
    """The sign of r**power; NaN where there is no such number: between two states of t >= 1."""
    even = is_integer(0.5 * abs(power)) | (r >= 0.0)
    exists = is_integer(abs(power)) | (r > 0.0)
    return select(exists, select(even, 1.0, -1.0), np.nan)


@formula
def growth(n, lag, r, log_r, log_lost, v, k):
    """f and k for which w_n = f 2**k."""
    p, halved = power_of_logarithm(*logarithm_of_power(n - lag, log_r, log_lost))
    v = v * sign_of_power(n - lag, r)
    return v + v * p, k + halved


@formula
def square(w):
    """w**2 beside a square of 1, where what is subnormal is slow and does not count."""
    w = select(abs(w) > 1e-100, w, 0.0)
    return w * w


@formula
def orbit_point(f, k, kappa):
    """A and B of w = f 2**k, whatever its size; NaN at a pole."""
    # Both w and 1 times a power of two, so that the larger one is of the order of 1.
    large = (k > 0.0) & (kappa != 0.0)
    factor = select(abs(k) <= 1000.0, two_to_the(-smaller(abs(k), 1000.0)), 0.0)
    u = select(large, factor, 1.0)
    v = select(large, f, f * select(k > 0.0, 1.0 / factor, factor))
    first, second = square(u), kappa * square(v)
    D = first + second
    inverse = 1.0 / select(abs(D) > ZERO_TO_ROUNDING * (first + abs(second)), D, np.nan)
    return u * v * inverse, (second - first) * inverse


@formula
def far_point(n, r, log_r, log_lost, g, h):
    """A and B by the second form of the two, where g = X_0 (1 + T) / (2 T)."""
    p, k = power_of_logarithm(*logarithm_of_power(n, log_r, log_lost))
    power = scaled(1.0 + p, larger(k, -2000.0))
    # Next to 1 its distance from 1 has digits that it lacks.
    rest = select(k == 0.0, -p, 1.0 - power)
    rest = rest * (2.0 - rest)
    R = square(power)
    D = (1.0 + R) - h * rest
    inverse = 1.0 / select(abs(D) > ZERO_TO_ROUNDING * ((1.0 + R) + abs(h) * rest), D, np.nan)
    sign = sign_of_power(n, r)
    return g * (sign * power) * inverse, (h * (1.0 + R) - rest) * (abs(sign) * inverse)


@formula
def near_state(half, kappa, a1, b1, a2, b2):
    """The angular velocity at a w neither so large that its square overflows, nor next to a pole.

    half    w / 2.
    kappa   4 k.
    """
    twice_inverse = 2.0 / (1.0 + half * (half * kappa))
    return b1 + (a1 * half - b1) * twice_inverse, b2 + (a2 * half - b2) * twice_inverse


@formula
def combined(a1, b1, a2, b2, A, B):
    """The angular velocity, of which A and B are the parts."""
    return a1 * A + b1 * B, a2 * A + b2 * B


@formula
def spread_of_body(I1, I2):
    """How much larger a state of an orbit may be than another."""
    of1, of2 = np.sqrt(I1), np.sqrt(I2)
    return larger(of1, of2) / smaller(of1, of2)


@formula
def out_of_range(X, largest):
    """Whether X**2 is beyond float64, or states of the orbit, up to `largest`, may be.

    Such an orbit of the map is left to iteration, which sees where it ends.
    """
    return (abs(X) > 2.0**500) | (largest > 2.0**1000)
