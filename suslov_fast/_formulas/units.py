"""Scaling by powers of two, which keeps products in the range of float64.

Parameters and states may have any unit. `enter` scales them to numbers of the order of 1, and
`leave` scales a result back: exactly, unless it is subnormal. Between them a formula is what it is
on paper. Logarithms of units are integers, stored as floats.
"""

from collections import namedtuple

import numpy as np

from .._jit import formula, select
from .elementary import TO_INTEGER, exponent, larger, scaled, smaller, two_to_the

# A body is NaN if the exponents of its moments differ by more than APART, or if its smaller product
# of inertia would be subnormal; so is a step size above 2**LONGEST_STEP. Then squares and products
# of three numbers are in range, except for the square of a negligible product of inertia.
APART, LONGEST_STEP, FARTHEST_PRODUCT = 400.0, 500.0, 960.0
# In place of the logarithm of 0, of which no unit is taken.
LOG_OF_ZERO = -1e4

# Components of omega up to this are finite: float64 ends at 1.8e308, and a component is a sum of
# up to three products.
LARGEST_COMPONENT = 1e307

# A body and a step size in their own units, 2**M of moments, 2**P of products of inertia, 2**Q of k
# and 2**E of eps.
ScaledBody = namedtuple("ScaledBody", "I1 I2 I13 I23 k eps M P Q E")
# A body, a step size and a state in one system of units.
ScaledState = namedtuple("ScaledState", "I1 I2 I13 I23 k eps omega1 omega2")
# Logarithms of the units of moments, of products of inertia and of omega. That of k is P + W, and
# that of time M - P - W.
Units = namedtuple("Units", "M P W")


@formula
def of_body(I1, I2, I13, I23, k, eps):
    """A body and a step size in their own units."""
    of_1, of_2 = exponent(I1), exponent(I2)
    M = ((0.5 * (of_1 + of_2) - 0.25) + TO_INTEGER) - TO_INTEGER  # rounded down
    most, least = larger(abs(I13), abs(I23)), smaller(abs(I13), abs(I23))
    P, Q, E = exponent(most), exponent(k), exponent(eps)
    apart = (abs(of_1 - of_2) > APART) | (least > 0.0) & (P - exponent(least) > FARTHEST_PRODUCT)
    of_moments = select(apart, np.nan, two_to_the(-M))
    of_products = select(apart, np.nan, two_to_the(-P))
    return ScaledBody(
        I1 * of_moments,
        I2 * of_moments,
        I13 * of_products,
        I23 * of_products,
        k * two_to_the(-Q),
        eps * two_to_the(-E),
        M,
        select(most > 0.0, P, select(k == 0.0, M, LOG_OF_ZERO)),
        select(k == 0.0, LOG_OF_ZERO, Q),
        E,
    )


@formula
def of_state(body, omega1, omega2):
    """The problem of a body and a state, and its units.

    No term of l = I13 omega1 + I23 omega2 + k is above 2. A state that is NaN in one component is
    NaN in both.
    """
    W = exponent(larger(abs(omega1), abs(omega2)))
    unit = two_to_the(-W)
    unit = select(omega1 + omega2 == omega1 + omega2, unit, np.nan)
    P = larger(body.P, body.Q - W)
    # What is below 2**-1022 of the largest term is negligible.
    of_products = two_to_the(larger(body.P - P, -1022.0))
    of_k = two_to_the(larger(body.Q - W - P, -1022.0))
    longer = body.E + P + W - body.M
    problem = ScaledState(
        body.I1,
        body.I2,
        body.I13 * of_products,
        body.I23 * of_products,
        body.k * of_k,
        select((longer < LONGEST_STEP) | (body.eps == 0.0), scaled(body.eps, longer), np.nan),
        omega1 * unit,
        omega2 * unit,
    )
    return problem, Units(body.M, P, W)


@formula
def scaled_state(I1, I2, I13, I23, k, eps, omega1, omega2):
    """`of_state` of a body that is not used for other states."""
    return of_state(of_body(I1, I2, I13, I23, k, eps), omega1, omega2)


@formula
def bound_in(unit):
    """Bound of states in a unit, below which they are finite in the unit of the user."""
    return LARGEST_COMPONENT / larger(unit, 1.0)


@formula
def leave(value, units, moment, product, omega):
    """A result whose dimension is moment**... product**... omega**..., in the unit of the user."""
    return scaled(value, moment * units.M + product * units.P + omega * units.W)
