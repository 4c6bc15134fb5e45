"""The continuous problem in 3D, equation (2), and the reaction of its constraint.

In n dimensions: one component at a time. M, P, E and W are logarithms of units: see `units`.
"""

import numpy as np

from .._jit import formula, select
from .canonical_map import guarded_step, shifted
from .coordinates import angular_velocity, at_rest, from_canonical, sum_of_products, to_canonical
from .elementary import scaled
from .units import fraction, moderate, normal_state


@formula
def vector_field(I1, I2, I13, I23, eps, M, P, E, omega1, omega2):
    """Derivatives of Omega1 and Omega2, from equation (2)."""
    omega1, omega2, W = normal_state(omega1, omega2)
    x = sum_of_products(I13, omega1, I23, omega2)
    k = 2 * W + P - M
    return scaled(-omega2 * x / I1, k), scaled(omega1 * x / I2, k)


@formula
def polarised_reaction(I1, I2, I13, I23, M, P, omega1, omega2, next1, next2):
    """Discretized multiplier of equation (2), and the logarithm of its unit.

    For next = omega it is the continuous one. Equation (8) gives the difference quotient of
    x = I13 Omega1 + I23 Omega2 without cancellation and without a division by eps.
    """
    x = sum_of_products(I13, omega1, I23, omega2)
    x_next = sum_of_products(I13, next1, I23, next2)
    slope1 = -0.5 * (next2 * x + omega2 * x_next) / I1
    slope2 = 0.5 * (next1 * x + omega1 * x_next) / I2
    gyration = 0.5 * (I1 - I2) * (omega1 * next2 + next1 * omega2)
    # The larger of the units of the two terms.
    first, second = 2 * P - M, M
    unit = select(first > second, first, second)
    value = fraction(first - unit) * (I13 * slope1 + I23 * slope2)
    return value - fraction(second - unit) * gyration, unit


@formula
def reaction(I1, I2, I13, I23, eps, M, P, E, omega1, omega2):
    """Multiplier of equation (2)."""
    omega1, omega2, W = normal_state(omega1, omega2)
    value, unit = polarised_reaction(I1, I2, I13, I23, M, P, omega1, omega2, omega1, omega2)
    return scaled(value, unit + 2 * W)


@formula
def discrete_reaction(I1, I2, I13, I23, eps, M, P, E, omega1, omega2):
    """Multiplier between a state and the next; NaN if there is none."""
    omega1, omega2, W = normal_state(omega1, omega2)
    eps_W = moderate(eps, E + W + P - M)
    X, Y, lost = to_canonical(I1, I2, I13, I23, eps_W, omega1, omega2)
    rests = at_rest(I13, I23, eps_W, X, Y)
    c, Z = shifted(Y, lost)
    X, Z = guarded_step(X, Z, c, np.inf)
    m11, m12, m21, m22 = from_canonical(I1, I2, I13, I23, eps_W)
    next1, next2 = angular_velocity(m11, -m12, m21, -m22, m12 * c, m22 * c, 1.0, X, Z)
    next1, next2 = select(rests, omega1, next1), select(rests, omega2, next2)
    value, unit = polarised_reaction(I1, I2, I13, I23, M, P, omega1, omega2, next1, next2)
    return scaled(value, unit + 2 * W)
