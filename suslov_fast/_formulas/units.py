"""Powers of two taken out of numbers, so that no product of them leaves the range of float64.

Parameters and states may be given in any unit. Quantities are computed from numbers of the order
of 1, and the power of two that is due is put back last: exactly, unless the result is subnormal.
"""

import numpy as np

from .._jit import formula, select

# The exponents for which a power of two is a normal number, less one; `power` of it is 0.
NO_POWER = -1023
# Products of three such powers reach every result that has digits left.
HALFWAY = 1000


@formula
def exponent(v):
    """The k in [-1023, 1022] for which 2**k <= |v| < 2**(k + 1), as near as there is one."""
    biased = (np.float64(v).view(np.int64) >> 52) & 0x7FF
    return (select(biased < 2045, biased, np.int64(2045))) - 1023


@formula
def power(k):
    """2**k for k from -1022 to 1023, and 0 for -1023."""
    return np.int64((k + 1023) << 52).view(np.float64)


@formula
def fraction(k):
    """2**k for k <= 0, and 0 where that is subnormal."""
    return power(select(k > NO_POWER, k, np.int64(NO_POWER)))


@formula
def scaled(v, k):
    """v 2**k for any k, rounded at most once."""
    first = select(k < HALFWAY, k, np.int64(HALFWAY))
    first = select(first > -HALFWAY, first, np.int64(-HALFWAY))
    rest = k - first
    rest = select(rest < HALFWAY, rest, np.int64(HALFWAY))
    rest = select(rest > -HALFWAY, rest, np.int64(-HALFWAY))
    return v * power(first) * power(rest)


@formula
def larger(v, w):
    return select(v > w, v, w)


@formula
def normal_body(I1, I2, I13, I23, eps):
    """A body and a step size in units of powers of two, and the logarithms of the units.

    The moments have the unit 2**M, the products of inertia 2**P and the step size 2**E. All is of
    the order of 1, unless moments differ by orders of magnitude, or products do.
    """
    M = (exponent(I1) + exponent(I2)) >> 1
    product = larger(abs(I13), abs(I23))
    P = select(product > 0.0, exponent(product), M)
    E = exponent(eps)
    products = power(-P)
    return I1 * power(-M), I2 * power(-M), I13 * products, I23 * products, eps * power(-E), M, P, E


@formula
def normal_state(omega1, omega2):
    """A state in the unit 2**W, and W."""
    W = exponent(larger(abs(omega1), abs(omega2)))
    unit = power(-W)
    return omega1 * unit, omega2 * unit, W


@formula
def own_unit(eps, omega1, omega2):
    """A step size and a state in units in which the state is of the order of 1, and its unit."""
    W = exponent(larger(abs(omega1), abs(omega2)))
    W = select(W > NO_POWER, W, np.int64(NO_POWER + 1))
    unit = power(-W)
    return scaled(eps, W), omega1 * unit, omega2 * unit, power(W)


@formula
def moderate(v, k):
    """v 2**k for v of the order of 1, or 2**900 in its place: far enough, and no square of a
    ratio of such numbers leaves the range.
    """
    return scaled(v, select(k < 900, k, np.int64(900)))


@formula
def above_one(v, k):
    """|v 2**k|, if it is above 1, as a number of the order of 1, with 1 in the same unit, and its
    logarithm.
    """
    large = k + exponent(v)
    large = select((large > 0) & (v != 0.0), large, np.int64(0))
    return scaled(v, k - large), fraction(-large), large
