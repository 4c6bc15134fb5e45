"""Conserved quantities of the 3D flow and the 3D map, and terms of those in n dimensions.

Arguments that are called M, P, E and W are the logarithms of units: see `units`.
"""

import numpy as np

from .._jit import formula, select
from .coordinates import sum_of_products, to_canonical
from .elementary import scaled
from .units import above_one, normal_state


@formula
def energy(I1, I2, omega1, omega2):
    """Energy, conserved by equation (2)."""
    return 0.5 * I1 * omega1 * omega1 + 0.5 * I2 * omega2 * omega2


@formula
def canonical_x(I1, I2, eps, x, k):
    """X = 2**k eps x / sqrt(2 I1 I2) and 1 in one unit, in which neither is above 1, and its
    logarithm.
    """
    return above_one(eps * x / np.sqrt(2.0 * I1 * I2), k)


@formula
def integral(I1, I2, eps, M, E, W, omega1, omega2, x, of_x):
    """First integral F, equation (6), reduced by the factor I1 I2; x is in units 2**of_x."""
    X, one, k = canonical_x(I1, I2, eps, x, E + of_x - M)
    above = omega1 * (omega1 / I2) + omega2 * (omega2 / I1)
    return scaled(above / (4.0 * one * one + 2.0 * X * X), 2.0 * W - M - 2.0 * k)


@formula
def density(I1, I2, eps, M, E, x, of_x):
    """Density 1 / (x (4 I1 I2 + eps**2 x**2)) of the invariant measure."""
    X, one, k = canonical_x(I1, I2, eps, x, E + of_x - M)
    value = 1.0 / (x * (I1 * I2) * (4.0 * one * one + 2.0 * X * X))
    return scaled(value, -of_x - 2.0 * M - 2.0 * k)


@formula
def first_integral(I1, I2, I13, I23, eps, M, P, E, omega1, omega2):
    """F of Lemma 1."""
    omega1, omega2, W = normal_state(omega1, omega2)
    x = sum_of_products(I13, omega1, I23, omega2)
    return integral(I1, I2, eps, M, E, W, omega1, omega2, x, P + W)


@formula
def modified_energy(I1, I2, I13, I23, eps, M, P, E, omega1, omega2):
    """2 I1 I2 F, from the energy."""
    omega1, omega2, W = normal_state(omega1, omega2)
    x = sum_of_products(I13, omega1, I23, omega2)
    X, one, k = canonical_x(I1, I2, eps, x, E + W + P - M)
    return scaled(energy(I1, I2, omega1, omega2) / (one * one + 0.5 * X * X), M + 2 * W - 2 * k)


@formula
def level(X, Y):
    """T = sqrt((X**2 + 2 Y**2) / (2 + X**2)) = |eps| sqrt(h / (I1 I2)), conserved by the map."""
    # Units in which the sums of squares are in range.
    size = abs(X) + abs(Y) + 1e-300
    above, below = 1.0 / size, 1.0 / (abs(X) + 1.0)
    X1, Y1, X2 = X * above, Y * above, X * below
    squares = (X1 * X1 + 2.0 * Y1 * Y1) / (X2 * X2 + 2.0 * below * below)
    return size * below * np.sqrt(squares)


# X and Y are computed for steps of at most this power of two in the units of body and state; then
# no product is out of range, even if the moments are far apart.
LONGEST = 64.0


@formula
def level_of_longer_step(T, X, j):
    """T for X and Y multiplied by 2**j, j >= 0."""
    unit = 1.0 / (abs(X) + 1.0)
    ones, X1 = 2.0 * unit * unit, abs(X) * unit
    longer = scaled(X1, j)
    large = longer > 1.0
    # sqrt(ones + longer**2), in the unit of the larger of 1 and longer.
    ratio = select(large, 1.0 / longer, longer)
    below = select(large, np.sqrt(1.0 + ones * ratio * ratio), np.sqrt(ones + ratio * ratio))
    T = T * (np.sqrt(ones + X1 * X1) / below)
    return select(large, T / X1, scaled(T, j))


# The number below 1.
BELOW_ONE = 1.0 - 2.0**-53


@formula
def criticality(I1, I2, I13, I23, eps, M, P, E, omega1, omega2):
    """t = eps sqrt(h / (I1 I2)), with the sign of eps."""
    omega1, omega2, W = normal_state(omega1, omega2)
    K = E + W + P - M
    k = select(K < LONGEST, K, LONGEST)
    X, Y, _ = to_canonical(I1, I2, I13, I23, scaled(eps, k), omega1, omega2)
    T, Y = level_of_longer_step(level(X, Y), X, K - k), scaled(Y, K - k)
    # Rounding must not move an orbit to the other regime: T < 1 exactly if |Y| < 1.
    below = select(T > 1.0, T, 1.0)
    below = select(T != T, T, below)
    T = select(abs(Y) < 1.0, select(T < 1.0, T, BELOW_ONE), below)
    return select(eps < 0.0, -T, T)


@formula
def invariant_density(I1, I2, I13, I23, eps, M, P, E, omega1, omega2):
    """Density of the invariant measure."""
    omega1, omega2, W = normal_state(omega1, omega2)
    return density(I1, I2, eps, M, E, sum_of_products(I13, omega1, I23, omega2), P + W)
