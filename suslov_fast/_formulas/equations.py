"""The equations of motion of both bodies in three dimensions, the reaction of their constraint, and
the derivative of the map.

A formula gets a problem in the units of `units`; k = 0 is the body without a rotor.
"""

import numpy as np

from .._jit import formula, select
from .coordinates import ZERO_TO_ROUNDING, dimensionless, rotor, shifted, sum_of_products
from .elementary import smaller

# |X| + |Y| + |K| below this: the derivative is the identity plus a small matrix, computed
# separately.
NEAR_IDENTITY = 0.25
# Above this |X|, in the first state of an orbit or near a pole, the new Y is not a small change of
# the old one.
LARGE = 1.5


@formula
def vector_field(I1, I2, I13, I23, k, eps, omega1, omega2):
    """Derivatives of Omega1 and Omega2, from equation (2): -l Omega2 / I1 and l Omega1 / I2."""
    l = rotor(I13, I23, k, omega1, omega2)
    return -omega2 * l / I1, omega1 * l / I2


@formula
def reaction(I1, I2, I13, I23, k, eps, omega1, omega2):
    """The terms l' and (I1 - I2) Omega1 Omega2 of equation (2), whose difference the multiplier is.

    l' = I13 Omega1' + I23 Omega2', with l as a factor.
    """
    l = rotor(I13, I23, k, omega1, omega2)
    return l * (I23 * omega1 / I2 - I13 * omega2 / I1), (I1 - I2) * (omega1 * omega2)


@formula
def denominator(X, c, Z, K):
    """D = 1 - Y + X (2 X - K) of the next state, Y = c - Z, and the size of its terms in X."""
    return ((1.0 - c) + Z) + X * (2.0 * X - K), abs(X) * (2.0 * abs(X) + abs(K))


@formula
def over_denominator(numerator, D, size):
    """numerator / D of `denominator`; NaN at poles, where D is 0 to rounding.

    The threshold decreases towards X = 0, where steady states (0, Y) approach the point (0, 1).
    """
    exists = abs(D) > ZERO_TO_ROUNDING * smaller(1.0 + size, 2.0**20 * size)
    return select(exists, numerator / D, np.nan)


@formula
def next_coordinates(X, X0, c, Z):
    """The next X and Z = c - Y of a body without a rotor, with one division, from equation (8) as
    X_next / X = (1 + Y_next) / (1 - Y) = (1 + Y) / D; X0 is X, or 0 if X**2 is negligible.

    Nothing waits for the division that can be done beside it.
    """
    square = X0 * (2.0 * X0)
    ratio = over_denominator((1.0 + c) - Z, ((1.0 - c) + Z) + square, square)
    far = square > 2.0 * LARGE * LARGE
    start, change = select(far, 1.0 + c, Z), select(far, (c - 1.0) - Z, square)
    return X * ratio, start + change * ratio


@formula
def turn_of_gyrostat(X, c, Z, K):
    """X_next / X, and both parts of z_next / z = (1 + i X_next) / (1 - i X), with one division.

    In z the sum X + X_next, which cancels for large Y, is 2 X (1 + X**2) / D.
    """
    inverse, KX = over_denominator(1.0, *denominator(X, c, Z, K)), K * X
    return (
        ((1.0 + c) - Z + KX) * inverse,
        ((1.0 - c) + Z - KX) * inverse,
        (2.0 * X) * inverse,
    )


@formula
def discrete_reaction(I1, I2, I13, I23, k, eps, omega1, omega2):
    """Terms of equation (4), as those above: (l_next - l) / eps and
    (I1 - I2) (Omega1 Omega2_next + Omega1_next Omega2) / 2.

    Both are rational functions of the state with the denominator of the next state, and in these
    no terms cancel that do not cancel in the result.
    """
    X, Y, lost, K = dimensionless(I1, I2, I13, I23, k, eps, omega1, omega2)
    inverse = over_denominator(1.0, *denominator(X, *shifted(Y, lost), K))
    a, half = I1 * I2, 0.5 * eps
    l, x = rotor(I13, I23, k, omega1, omega2), sum_of_products(I13, omega1, I23, omega2)
    y = sum_of_products(I23 * I1, omega1, -I13 * I2, omega2)
    slope = l * ((y - half * l * x) / a) * inverse
    of_1 = I1 * omega1 * omega1 * sum_of_products(I13, omega1, k, 1.0)
    of_2 = I2 * omega2 * omega2 * sum_of_products(I23, omega2, k, 1.0)
    mean = (omega1 * omega2 * (1.0 - K * X) + half * (of_1 - of_2) / a) * inverse
    return slope, (I1 - I2) * mean


@formula
def matrix(I1, I2, I13, I23, k, eps, omega1, omega2):
    """Entries (11, 12, 21, 22) of the matrix that the paper inverts before equation (5)."""
    h1, h2 = 0.5 * eps / I1, 0.5 * eps / I2
    return (
        1.0 + h1 * (I13 * omega2),
        h1 * (I13 * omega1 + 2.0 * I23 * omega2 + k),
        -h2 * (2.0 * I13 * omega1 + I23 * omega2 + k),
        1.0 - h2 * (I23 * omega1),
    )


@formula
def derivative(X, Y, lost, K):
    """Derivative of the next (X, Y) by (X, Y), minus the last result (0 or 1) times the identity.

    X_next = X (1 + Y + K X) / D,  Y_next = Y - 2 X X_next + K (X + X_next).
    """
    r = over_denominator(1.0, *denominator(X, *shifted(Y, lost), K))
    below, above, square, KX = (1.0 - Y) - lost, (1.0 + Y) + lost, X * X, K * X
    less, more = below - KX, 2.0 * (1.0 + square) * r
    d11 = ((above + KX) * r) * ((less - 2.0 * square) * r) + (KX * r) * more
    d12 = (X * r) * more
    d21 = 2.0 * (below * r) * ((K * (1.0 - square) - 2.0 * X * above) * r)
    d22 = (
        (less * r) * (less * r)
        - (4.0 * Y * X * r) * (X * r)
        - 2.0 * (KX * r) * ((square - 1.0) * r)
    )
    # The same minus 1, without cancellation.
    e11 = below * (Y + 2.0 * KX) - square * (3.0 - Y + K * K + 2.0 * X * (X - K))
    e11, e22 = 2.0 * e11 * (r * r), -d12 * (2.0 * X - K)
    near = abs(X) + abs(Y) + abs(K) < NEAR_IDENTITY
    return select(near, e11, d11), d12, d21, select(near, e22, d22), select(near, 1.0, 0.0)


@formula
def jacobian(I1, I2, I13, I23, k, eps, omega1, omega2):
    """Entries (11, 12, 21, 22) of the derivative of the map; NaN at its poles."""
    X, Y, lost, K = dimensionless(I1, I2, I13, I23, k, eps, omega1, omega2)
    d11, d12, d21, d22, identity = derivative(X, Y, lost, K)
    # From (X, Y) to sqrt(I1) Omega1 and sqrt(I2) Omega2: a rotation, and a common factor.
    D = I13 * I13 * I2 + I23 * I23 * I1
    inverse = select(D > 0.0, 1.0 / D, 0.0)
    along = select(D > 0.0, I13 * I13 * I2 * inverse, 1.0)
    across, both = I23 * I23 * I1 * inverse, I13 * I23 * inverse
    shear, ratio = both * np.sqrt(I1 * I2) * (d12 + d21), np.sqrt(I2 / I1)
    return (
        identity + (along * d11 + across * d22 + shear),
        both * I2 * (d11 - d22) + ratio * (across * d21 - along * d12),
        both * I1 * (d11 - d22) + (across * d12 - along * d21) / ratio,
        identity + (across * d11 + along * d22 - shear),
    )
