"""Numbers of twice the digits, as pairs: the rounded number, and its rounding error."""

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
