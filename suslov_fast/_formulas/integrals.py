"""Conserved quantities of both bodies in three dimensions, with those of Section 4.

A formula gets a problem in the units of `units`; k = 0 is the body without a rotor, and
l = I13 Omega1 + I23 Omega2 + k.
"""

import math

import numpy as np

from .._jit import formula, select
from .coordinates import dimensionless, rotor, to_xy
from .elementary import arctangent, exponent, larger, logarithm, two_to_the
from .twofold import difference, plus, product, square

# The number below 1.
BELOW_ONE = 1.0 - 2.0**-53
# T below this: artanh(T) / T is 1, and T may have lost digits.
TINY = 1e-150
# s above this: s**2 + 1 is s**2.
LOSES_ONE = 1e8


@formula
def energy(I1, I2, omega1, omega2):
    """Energy, conserved by equation (2)."""
    return 0.5 * I1 * omega1 * omega1 + 0.5 * I2 * omega2 * omega2


@formula
def first_integral(I1, I2, I13, I23, k, eps, omega1, omega2):
    """F of Lemma 1, equation (6)."""
    step = eps * rotor(I13, I23, k, omega1, omega2)
    return (I1 * omega1 * omega1 + I2 * omega2 * omega2) / (4.0 * I1 * I2 + step * step)


@formula
def modified_energy(I1, I2, I13, I23, k, eps, omega1, omega2):
    """2 I1 I2 F."""
    return 2.0 * I1 * I2 * first_integral(I1, I2, I13, I23, k, eps, omega1, omega2)


@formula
def invariant_density(I1, I2, I13, I23, k, eps, omega1, omega2):
    """Density 1 / (l (4 I1 I2 + eps**2 l**2)) of the invariant measure."""
    l = rotor(I13, I23, k, omega1, omega2)
    step = eps * l
    return 1.0 / (l * (4.0 * I1 * I2 + step * step))


@formula
def length_of_products(I1, I2, I13, I23):
    """|g| = sqrt(I13**2 / I1 + I23**2 / I2); beside a large k both terms may be tiny."""
    unit = exponent(larger(abs(I13), abs(I23)))
    I13, I23 = I13 * two_to_the(-unit), I23 * two_to_the(-unit)
    return np.sqrt(I13 * (I13 / I1) + I23 * (I23 / I2)) * two_to_the(unit)


@formula
def criticality(I1, I2, I13, I23, k, eps, omega1, omega2):
    """e A = e |g| |z| / sqrt(1 + e**2 l**2), e = eps / (2 sqrt(I1 I2)).

    Here z = sqrt(I1) Omega1 + i sqrt(I2) Omega2. Without a rotor it is t = eps sqrt(h / (I1 I2)).
    """
    X, Y, _, K = dimensionless(I1, I2, I13, I23, k, eps, omega1, omega2)
    z = np.sqrt(I1 * omega1 * omega1 + I2 * omega2 * omega2)
    gz = length_of_products(I1, I2, I13, I23) * z
    T = 0.5 * abs(eps) * gz / np.sqrt((I1 * I2) * (1.0 + X * X))
    # Rounding must not move an orbit to the other regime.
    subcritical = (1.0 - Y) * (1.0 + Y) > K * (K - 2.0 * X)
    within, beyond = select(T < 1.0, T, BELOW_ONE), select(T > 1.0, T, 1.0)
    T = select(T == T, select(subcritical, within, beyond), T)
    return select(eps < 0.0, -T, T)


@formula
def rotation_number(I1, I2, I13, I23, k, eps, omega1, omega2):
    """Turns of the phase in a step: sign(k) arctan(e mu) / pi, and 0 unless k**2 > A**2.

    With mu**2 = k**2 - A**2, I1 I2 (1 + e**2 l**2) mu**2 is a difference of two terms, computed
    with twice the digits of a float:

    k**2 (I1 I2 + (eps l / 2)**2) - (I13**2 I2 + I23**2 I1) (I1 Omega1**2 + I2 Omega2**2).
    """
    of_1, of_2 = product((I1, 0.0), (omega1, 0.0)), product((I2, 0.0), (omega2, 0.0))
    l = plus(product((I13, 0.0), (omega1, 0.0)), product((I23, 0.0), (omega2, 0.0)))
    half_step = product((0.5 * eps, 0.0), plus(l, (k, 0.0)))
    below = plus(product((I1, 0.0), (I2, 0.0)), square(half_step))
    g = plus(product((I2, 0.0), square((I13, 0.0))), product((I1, 0.0), square((I23, 0.0))))
    z = plus(product(of_1, (omega1, 0.0)), product(of_2, (omega2, 0.0)))
    rest, lost = difference(product(square((k, 0.0)), below), product(g, z))
    tangent = 0.5 * abs(eps) * np.sqrt(larger(rest + lost, 0.0) / below[0] / (I1 * I2))
    turns = arctangent(tangent, 1.0) / math.pi
    turns = select((k < 0.0) != (eps < 0.0), -turns, turns)
    return select(rest > 0.0, turns, select(rest <= 0.0, 0.0, np.nan))


@formula
def inverse_hyperbolic_sine(s):
    size = abs(s)
    root = select(size > LOSES_ONE, size, np.sqrt(1.0 + size * size))
    # log(size + root), as minus the log of the inverse, which is 1 minus an accurate number.
    inverse = 1.0 / (root + size)
    less = select(size > LOSES_ONE, size, size + size * size / (root + 1.0))
    value = -logarithm(inverse, less * inverse)
    value = select(size < np.inf, value, size)
    return select(s < 0.0, -value, value)


@formula
def constants(I1, I2, I13, I23, k, eps, omega1, omega2):
    """Constants h, k1, k2 and t of Section 4; k1 and k2 are NaN unless -1 < t < 1.

    With T = |t| and r = (1 - T) / (1 + T),
    k1 = -(2 / eps) artanh(t) = sqrt(h / (I1 I2)) log(r) / T,
    and sinh(k2) = y / (|x| sqrt(I1 I2 (1 - T**2))).
    """
    t = criticality(I1, I2, I13, I23, k, eps, omega1, omega2)
    T, (x, y) = abs(t), to_xy(I1, I2, I13, I23, k, eps, omega1, omega2)
    X, Y, lost, _ = dimensionless(I1, I2, I13, I23, k, eps, omega1, omega2)
    below = 1.0 + X * X
    h = 0.25 * (x * x + y / I1 * (y / I2)) / below
    complement = ((1.0 - Y) - lost) * ((1.0 + Y) + lost) / below  # 1 - T**2
    inverse = 1.0 / (1.0 + T)
    log_r = logarithm(complement * inverse * inverse, 2.0 * (select(T < 1.0, T, 1.0)) * inverse)
    k1 = np.sqrt(h / (I1 * I2)) * (select(T > TINY, log_r / T, -2.0))
    k2 = inverse_hyperbolic_sine(y / (abs(x) * np.sqrt(I1 * I2 * complement)))
    k2 = select(h == 0.0, 0.0, k2)
    below_critical = abs(Y) < 1.0
    return h, select(below_critical, k1, np.nan), select(below_critical, k2, np.nan), t
