"""The 3D map as the paper prints it, equation (5)."""

import numpy as np

from .._jit import formula, select
from .canonical_map import ZERO_TO_ROUNDING


@formula
def printed_coefficients(I1, I2, I13, I23, eps):
    """The four coefficients of equation (5), from the body and the step size."""
    return (
        eps * I13 / (2.0 * I1),
        eps * I23 / (2.0 * I2),
        eps * I23 / I1,
        eps * I13 / I2,
    )


@formula
def printed_denominator(k1, k2, k3, k4, omega1, omega2):
    """Return Delta of equation (5), and True if it is finite and differs from 0 beyond rounding."""
    product = (k1 * omega1 + k3 * omega2) * (k4 * omega1 + k2 * omega2)
    delta = (1.0 + k1 * omega2) * (1.0 - k2 * omega1) + product
    # Where delta is 0, the product is as large as the other term.
    size = (1.0 + abs(k1 * omega2)) * (1.0 + abs(k2 * omega1))
    return delta, ZERO_TO_ROUNDING * size < abs(delta) < np.inf


@formula
def printed_step(k1, k2, k3, k4, omega1, omega2, bound):
    """Next state by equation (5); NaN if it does not exist or exceeds a bound."""
    delta, regular = printed_denominator(k1, k2, k3, k4, omega1, omega2)
    next1 = omega1 - k2 * omega1 * omega1 - k1 * omega1 * omega2 - k3 * omega2 * omega2
    next2 = omega2 + k1 * omega2 * omega2 + k2 * omega1 * omega2 + k4 * omega1 * omega1
    next1, next2 = next1 / delta, next2 / delta
    exists = regular & (abs(next1) + abs(next2) < bound)
    return select(exists, next1, np.nan), select(exists, next2, np.nan)
