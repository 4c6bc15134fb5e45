"""Scaling by powers of two, which keeps products in the range of float64.

Parameters and states may have any unit. Quantities are computed from numbers of the order of 1, and
the result is scaled last: exactly, unless it is subnormal. Logarithms of units are integers, stored
as floats.
"""

from .._jit import formula, select
from .elementary import TO_INTEGER, exponent, larger, scaled, smaller, two_to_the


@formula
def fraction(k):
    """2**k for an integer k <= 0, and 0 where that is subnormal."""
    return select(k < -1022.0, 0.0, two_to_the(larger(k, -1022.0)))


@formula
def normal_body(I1, I2, I13, I23, eps):
    """A body and a step size in units of powers of two, and the logarithms of the units.

    The moments have the unit 2**M, the products of inertia 2**P and the step size 2**E. All are of
    the order of 1, unless the moments, or the products, differ by orders of magnitude.
    """
    # Rounded down.
    M = ((0.5 * (exponent(I1) + exponent(I2)) - 0.25) + TO_INTEGER) - TO_INTEGER
    product = larger(abs(I13), abs(I23))
    P = select(product > 0.0, exponent(product), M)
    E = exponent(eps)
    of_moments, of_products = two_to_the(-M), two_to_the(-P)
    return (
        I1 * of_moments,
        I2 * of_moments,
        I13 * of_products,
        I23 * of_products,
        eps * two_to_the(-E),
        M,
        P,
        E,
    )


@formula
def normal_state(omega1, omega2):
    """A state in the unit 2**W, and W."""
    W = exponent(larger(abs(omega1), abs(omega2)))
    unit = two_to_the(-W)
    return omega1 * unit, omega2 * unit, W


@formula
def moderate(v, k):
    """v 2**min(k, 900) for v of the order of 1, which keeps squares of ratios of such numbers in
    range.
    """
    return scaled(v, smaller(k, 900.0))


@formula
def above_one(v, k):
    """|v 2**k|, if it is above 1, as a number of the order of 1, with 1 in the same unit, and its
    logarithm.
    """
    large = k + exponent(v)
    large = select((large > 0.0) & (v != 0.0), large, 0.0)
    return scaled(v, k - large), fraction(-large), large
