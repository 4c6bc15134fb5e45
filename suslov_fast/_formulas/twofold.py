"""Numbers of twice the digits, as pairs: the rounded number, and its rounding error."""

import numpy as np

from .._jit import formula, select, two_product
from .coordinates import sum_of_ordered, two_sum
from .elementary import LN2_HIGH, LN2_LOW, halvings, logarithm_beyond, two_to_the

ONE = 1.0, 0.0


@formula
def product(v, w):
    """v w, to about 2**-104."""
    p, lost = two_product(v[0], w[0])
    return sum_of_ordered(p, lost + (v[0] * w[1] + v[1] * w[0]))


@formula
def square(v):
    return product(v, v)


@formula
def plus(v, w):
    """v + w, to about 2**-104 of the larger term."""
    total, lost = two_sum(v[0], w[0])
    more, rest = two_sum(v[1], w[1])
    total, lost = sum_of_ordered(total, lost + more)
    return sum_of_ordered(total, lost + rest)


@formula
def plus_smaller(v, w):
    """v + w for |v| >= |w|, to about 2**-104."""
    total, lost = sum_of_ordered(v[0], w[0])
    return sum_of_ordered(total, lost + (v[1] + w[1]))


@formula
def difference(v, w):
    """v - w."""
    return plus(v, (-w[0], -w[1]))


@formula
def quotient(v, w):
    """v / w."""
    inverse = 1.0 / w[0]
    q = v[0] * inverse
    back, lost = two_product(q, w[0])
    return sum_of_ordered(q, (((v[0] - back) - lost) + (v[1] - q * w[1])) * inverse)


@formula
def root(v):
    """The square root of v > 0."""
    r = np.sqrt(v[0])
    back, lost = two_product(r, r)
    return sum_of_ordered(r, (((v[0] - back) - lost) + v[1]) / (2.0 * r))


@formula
def half_tangent(t):
    """The tangent of half the angle whose tangent is t."""
    return quotient(t, plus_smaller(root(plus_smaller(ONE, square(t))), ONE))


@formula
def eighth_tangent(t):
    """The tangent of an eighth of the angle whose tangent is 0 <= t <= 1."""
    return half_tangent(half_tangent(half_tangent(t)))


@formula
def term(n, q, rest):
    """1 / n - q rest."""
    more, lost = product(q, rest)
    return plus_smaller(quotient(ONE, (n, 0.0)), (-more, -lost))


@formula
def angle_of_eighth(t):
    """The angle of which an eighth has the tangent 0 <= t <= 0.1."""
    # Taylor's series, whose last terms need half the digits.
    q = square(t)
    x = q[0]
    rest = 1.0 / 25.0 - x * (1.0 / 27.0 - x * (1.0 / 29.0 - x * (1.0 / 31.0)))
    rest = 1.0 / 17.0 - x * (1.0 / 19.0 - x * (1.0 / 21.0 - x * (1.0 / 23.0 - x * rest)))
    total = term(9.0, q, term(11.0, q, term(13.0, q, term(15.0, q, (rest, 0.0)))))
    total = term(1.0, q, term(3.0, q, term(5.0, q, term(7.0, q, total))))
    high, low = product(t, total)
    return 8.0 * high, 8.0 * low


@formula
def logarithm_of_ratio(L, L_lost, r):
    """log |r| as a sum of two numbers, r = (1 - L) / (1 + L)."""
    power = halvings(abs(r))
    d, d_lost = two_sum(1.0, -L)
    # Near L = 1 only r has the digits of 1 - L, unless L_lost has them.
    near = (L_lost == 0.0) & (abs(d) < 0.5)
    d, d_lost = select(near, r * (1.0 + L), d), select(near, 0.0, d_lost)
    s, s_lost = two_sum(1.0, L)
    # r = 2**power f, and log f = 2 artanh(q), q = (f - 1)/(f + 1).
    scale = two_to_the(-power)
    scale = select(r < 0.0, -scale, scale)
    d, d_lost = scale * d, scale * d_lost
    # L_lost is added last, since it may exceed 1. For large L, where scale = -1, it cancels in the
    # first sum, like L.
    above, lost = two_sum(d, -s)
    above, above_lost = two_sum(above, (lost + (d_lost - s_lost)) - (scale + 1.0) * L_lost)
    below, lost = two_sum(d, s)
    below, below_lost = two_sum(below, (lost + (d_lost + s_lost)) - (scale - 1.0) * L_lost)
    q, q_lost = quotient((above, above_lost), (below, below_lost))
    total, lost = sum_of_ordered(power * LN2_HIGH, 2.0 * q)
    lost = lost + ((2.0 * q_lost + logarithm_beyond(q)) + power * LN2_LOW)
    high = total + lost
    return high, lost - (high - total)
