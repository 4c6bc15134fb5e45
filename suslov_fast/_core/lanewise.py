"""Formulas without branches, of numbers or of vectors of them, compiled by being called.

Staged parts call a formula once, on stand-ins for its arguments, and it needs no mark for that. Its
conditions are those of `select`, its largest and smallest numbers those of `larger` and `smaller`;
loops over what is known beforehand are written out. Interpreted, vectors are NumPy arrays.
"""

import numpy as np

from .stand_ins import DOUBLE, INTEGER, Emitted
from .stand_ins import VECTOR as VECTOR


def select(conditions, first, second):
    """The first where a condition holds, the second elsewhere."""
    if isinstance(conditions, Emitted):
        return conditions.choose(first, second)
    return np.where(conditions, first, second)[()]


def larger(a, b):
    """b where one is NaN."""
    return select(a > b, a, b)


def smaller(a, b):
    """b where one is NaN."""
    return select(a < b, a, b)


def any_lane(conditions):
    """Whether the condition of any lane holds."""
    if isinstance(conditions, Emitted):
        return conditions.any_lane()
    return bool(conditions.any())


def shuffled(first, second, places):
    """The numbers of two vectors at some places, as a vector."""
    if isinstance(first, Emitted):
        return first.shuffled(second, places)
    return np.concatenate((first, second))[places]


def split(v):
    """v as a sum of two numbers of 26 bits, whose products are exact (Veltkamp)."""
    c = 134217729.0 * v
    high = c - (c - v)
    return high, v - high


def two_product(v, w):
    """v*w, rounded, and what the rounding lost (Dekker)."""
    product = v * w
    if isinstance(product, Emitted):
        return product, v.call("fma", w, -product)  # the same, unless it is subnormal
    v1, v2 = split(v)
    w1, w2 = split(w)
    return product, v2 * w2 - (((product - v1 * w1) - v2 * w1) - v1 * w2)


def bits_of(v):
    """The bits of numbers, as integers."""
    return v.cast(INTEGER) if isinstance(v, Emitted) else np.float64(v).view(np.int64)


def number_of_bits(bits):
    """The reverse of `bits_of`."""
    return bits.cast(DOUBLE) if isinstance(bits, Emitted) else np.int64(bits).view(np.float64)
