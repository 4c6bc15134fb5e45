"""Numbers of twice the digits, as pairs: the rounded number, and its rounding error."""

import numpy as np

from .._jit import formula, two_product
from .coordinates import sum_of_ordered, two_sum


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
def difference(v, w):
    """v - w."""
    return plus(v, (-w[0], -w[1]))


@formula
def quotient(v, w):
    """v / w."""
    q = v[0] / w[0]
    back, lost = two_product(q, w[0])
    return sum_of_ordered(q, (((v[0] - back) - lost) + (v[1] - q * w[1])) / w[0])


@formula
def root(v):
    """The square root of v > 0."""
    r = np.sqrt(v[0])
    back, lost = two_product(r, r)
    return sum_of_ordered(r, (((v[0] - back) - lost) + v[1]) / (2.0 * r))


@formula
def arctangent(t):
    """The arctangent of 0 <= t <= 1."""
    one = 1.0, 0.0
    for _ in range(3):  # halves of the angle
        t = quotient(t, plus(one, root(plus(one, square(t)))))
    q, total = square(t), (0.0, 0.0)
    for k in range(15, -1, -1):  # Taylor's series
        total = difference(quotient(one, (2.0 * k + 1.0, 0.0)), product(q, total))
    high, low = product(t, total)
    return 8.0 * high, 8.0 * low
