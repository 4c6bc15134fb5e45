"""The coordinates (x, y) of equation (xy), and the same made dimensionless: (X, Y)."""

import numpy as np

from .jit import formula

# |X| + |Y| below this: a step changes the state by less than one part in 1e150.
MOTIONLESS = 1e-150


@formula
def split(v):
    """v as a sum of two numbers of 26 bits, whose products are exact (Veltkamp)."""
    c = 134217729.0 * v
    high = c - (c - v)
    return high, v - high


@formula
def product_error(v, w, vw):
    """v*w - vw exactly, for vw = v*w rounded (Dekker)."""
    v1, v2 = split(v)
    w1, w2 = split(w)
    return v2 * w2 - (((vw - v1 * w1) - v2 * w1) - v1 * w2)


@formula
def sum_of_products(v1, w1, v2, w2):
    """v1*w1 + v2*w2 to a few ulps of the sum, however much of it cancels.

    Near the steady-state line x is a small difference, and the map amplifies its relative error.
    """
    p1 = v1 * w1
    p2 = v2 * w2
    s = p1 + p2
    t = s - p1
    sum_error = (p1 - (s - t)) + (p2 - t)
    return s + (sum_error + (product_error(v1, w1, p1) + product_error(v2, w2, p2)))


@formula
def to_xy(I1, I2, I13, I23, omega1, omega2):
    """Equation (xy)."""
    x = sum_of_products(I13, omega1, I23, omega2)
    y = sum_of_products(I23 * I1, omega1, -I13 * I2, omega2)
    return x, y


@formula
def from_xy(I1, I2, I13, I23, x, y):
    """The inverse of equation (xy)."""
    D = I13 * I13 * I2 + I23 * I23 * I1
    return (I13 * I2 * x + I23 * y) / D, (I23 * I1 * x - I13 * y) / D


@formula
def to_canonical(I1, I2, I13, I23, eps, omega1, omega2):
    """X = eps x / sqrt(2 I1 I2) and Y = eps y / (2 I1 I2), in which no parameter is left."""
    x, y = to_xy(I1, I2, I13, I23, omega1, omega2)
    a2 = 2.0 * I1 * I2
    return eps * x / np.sqrt(a2), eps * y / a2


@formula
def from_canonical(I1, I2, I13, I23, eps):
    """The matrix (m11, m12, m21, m22) that takes (X, Y) back to (Omega1, Omega2)."""
    a2 = 2.0 * I1 * I2
    m11, m21 = from_xy(I1, I2, I13, I23, np.sqrt(a2) / eps, 0.0)
    m12, m22 = from_xy(I1, I2, I13, I23, 0.0, a2 / eps)
    return m11, m12, m21, m22
