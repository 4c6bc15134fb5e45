"""Reduction of a body in n dimensions with a closed form to one in three.

With J I = b I, J = a on the vectors orthogonal to I, and across = that part of omega, the 3D body
I1 = b, I2 = a, I13 = 0 has x = |I| |across|, y = b I.omega if I23 Omega1 = I.omega and
I23 Omega2 = |I| |across|.
"""

import numpy as np

from .._jit import formula, select, two_product
from .coordinates import two_sum
from .elementary import TO_INTEGER, exponent, larger, scaled

# The unit in the last place of numbers from 2 to 4.
_LAST_PLACE = 2.0**-51


@formula
def sum_in_two(total, lost, v, w):
    """Return total + lost + v w as the rounded sum and its rounding error."""
    product, of_product = two_product(v, w)
    total, of_sum = two_sum(total, product)
    return total, lost + (of_product + of_sum)


@formula
def as_product(p, lost):
    """Return A and B, 1 <= B < 2 or nearly, whose product is p + lost to 76 bits; p is finite.

    Near Y = 1, and for orbits that start near X = 0, y must be more precise than float64. The 3D
    map takes y as a product: (S + i u)(S + j u) = S**2 + (i + j) S u + i j u**2 with the rounded
    root S and u one unit in its last place. i + j determines the leading digits, i j the rest.
    """
    half = 2.0 * np.floor(0.5 * exponent(p))
    whole = scaled(abs(p), -half)
    more = scaled(select(p > 0.0, lost, -lost), -half)
    S = (np.sqrt(whole) + 2.0) - 2.0
    square, square_lost = two_product(S, S)
    unit = S * _LAST_PLACE
    rest = whole - square
    k = np.ceil((rest + (more - square_lost)) / unit)
    rest = (rest - k * unit) + (more - square_lost)
    root = np.sqrt(larger(k * k - 4.0 * (rest / _LAST_PLACE) / _LAST_PLACE, 0.0))
    i = (0.5 * (k + root) + TO_INTEGER) - TO_INTEGER
    A = scaled(S + i * _LAST_PLACE, half)
    B = S + (k - i) * _LAST_PLACE
    A = select(p > 0.0, A, -A)
    return select(lost == 0.0, p, A), select(lost == 0.0, 1.0, B)
