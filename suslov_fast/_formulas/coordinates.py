"""Coordinates (x, y) of equation (7), and their dimensionless form (X, Y)."""

import numpy as np

from .._jit import formula, select, two_product

# A denominator this much smaller than its own terms is zero to rounding: the state is on a pole.
# Rounding of the body, the state and the terms may amount to four units 2**-53.
ZERO_TO_ROUNDING = 2.0**-50
# What the sum of Y and its rounding error may differ from 1 where it is 1.
ROUNDING_OF_ONE = 2.0**-100
# Numbers below this are soon subnormal if they decrease, and then at least four times slower.
NEGLIGIBLE = 2.0**-960


@formula
def two_sum(v, w):
    """Rounded sum v + w, and its rounding error (Knuth)."""
    total = v + w
    t = total - v
    return total, (v - (total - t)) + (w - t)


@formula
def sum_of_ordered(v, w):
    """`two_sum` where |v| is not less than |w|, or v = 0."""
    total = v + w
    return total, w - (total - v)


@formula
def sum_of_products(v1, w1, v2, w2):
    """v1*w1 + v2*w2 to a few ulps of the sum, despite cancellation.

    Near the steady-state line x is a small difference, and the map amplifies its relative error.
    """
    p1, error1 = two_product(v1, w1)
    p2, error2 = two_product(v2, w2)
    total, error = two_sum(p1, p2)
    return total + (error + (error1 + error2))


@formula
def rotor(I13, I23, k, omega1, omega2):
    """l = I13 Omega1 + I23 Omega2 + k to a few ulps, despite cancellation."""
    return rotor_twofold(I13, I23, k, omega1, omega2)[0]


@formula
def rotor_twofold(I13, I23, k, omega1, omega2):
    """`rotor`, and its rounding error."""
    p1, error1 = two_product(I13, omega1)
    p2, error2 = two_product(I23, omega2)
    x, error = two_sum(p1, p2)
    total, rest = two_sum(x, k)
    return sum_of_ordered(total, rest + (error + (error1 + error2)))


@formula
def to_xy(I1, I2, I13, I23, k, eps, omega1, omega2):
    """Coordinates x and y of equation (7)."""
    x = sum_of_products(I13, omega1, I23, omega2)
    y = sum_of_products(I23 * I1, omega1, -I13 * I2, omega2)
    return x, y


@formula
def from_xy(I1, I2, I13, I23, x, y):
    """Inverse of `to_xy`."""
    D = I13 * I13 * I2 + I23 * I23 * I1
    return (I13 * I2 * x + I23 * y) / D, (I23 * I1 * x - I13 * y) / D


@formula
def dimensionless(I1, I2, I13, I23, k, eps, omega1, omega2):
    """X = e l, Y = eps y / (2 I1 I2) with its rounding error, and K = e k, where
    e = eps / (2 sqrt(I1 I2)).

    In (X, Y) the map of a body without a rotor has no parameter. Near Y = 1 it amplifies the
    relative error of 1 - Y, which is (1 - Y) - lost to a few ulps.
    """
    a2, a2_lost = two_product(2.0 * I1, I2)
    c1, c1_lost = two_product(I23, I1)
    c2, c2_lost = two_product(-I13, I2)
    inverse = 1.0 / a2
    e = eps * np.sqrt(0.5 * inverse)
    # y in 160 bits: all of the first 53 may cancel for parameters of few decimal digits.
    y1, y1_lost = two_product(c1, omega1)
    y2, y2_lost = two_product(c2, omega2)
    z1, z1_lost = two_product(c1_lost, omega1)
    z2, z2_lost = two_product(c2_lost, omega2)
    y, rest = two_sum(y1, y2)
    lost, lost_of_y = two_sum(y1_lost, y2_lost)
    z, lost_of_z = two_sum(z1, z2)
    lost, lost_of_sum = two_sum(lost, z)
    rest, lost_of_rest = two_sum(rest, lost)
    lost = (lost_of_y + lost_of_z) + (lost_of_sum + lost_of_rest) + (z1_lost + z2_lost)
    y, rest = two_sum(y, rest)
    y, y_lost = two_sum(y, rest + lost)
    n, n_lost = two_product(eps, y)
    Y = n * inverse
    back, back_lost = two_product(Y, a2)
    lost = (((n - back) - back_lost) + (n_lost + eps * y_lost - Y * a2_lost)) * inverse
    return e * rotor(I13, I23, k, omega1, omega2), Y, lost, e * k


@formula
def shifted(Y, lost):
    """Return c, 0 where Y is small and 1 where 1 - Y is, and Z = c - (Y + lost), for the maps."""
    c = select(Y > 0.5, 1.0, 0.0)
    Z = (c - Y) - lost
    return c, select((c > 0.0) & (abs(Z) < ROUNDING_OF_ONE), 0.0, Z)


@formula
def from_canonical(I1, I2, I13, I23, eps):
    """Matrix (m11, m12, m21, m22) from (X, Y) to (Omega1, Omega2)."""
    a2 = 2.0 * I1 * I2
    m11, m21 = from_xy(I1, I2, I13, I23, np.sqrt(2.0 * a2) / eps, 0.0)
    m12, m22 = from_xy(I1, I2, I13, I23, 0.0, a2 / eps)
    return m11, m12, m21, m22
