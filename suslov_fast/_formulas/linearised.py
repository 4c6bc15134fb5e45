"""The derivative of the 3D map, and the matrix that the paper inverts.

M, P, E and W are logarithms of units: see `units`.
"""

import numpy as np

from .._jit import formula, select
from .canonical_map import denominator, shifted
from .coordinates import at_rest, to_canonical
from .elementary import exponent, larger, scaled, two_to_the
from .printed_map import printed_coefficients
from .units import moderate, normal_state

# |X| + |Y| below this: the derivative is the identity plus a small matrix, computed separately.
NEAR_IDENTITY = 0.25


@formula
def canonical_jacobian(X, Z, c):
    """Derivative of `canonical_step` by X and Y, minus the last result (0 or 1) times the identity.

    With d = 1 - Y + X**2 its rows are
    ((1 + Y)(1 - Y - X**2), X (2 + X**2)) / d**2,
    (-2 X (1 + Y)(1 - Y), (1 - Y)**2 - 2 Y X**2) / d**2.
    """
    # In the unit of |X| if that is above 1: its square is in range.
    one = two_to_the(-exponent(larger(abs(X), 1.0)))
    X1 = X * one
    square, unit = X1 * X1, one * one
    below, above, Y = ((1.0 - c) + Z) * unit, ((1.0 + c) - Z) * unit, (c - Z) * unit
    r = 1.0 / (below + square)
    near = abs(X) + abs(c - Z) < NEAR_IDENTITY
    from_X = 2.0 * Y * below - square * (3.0 * unit - Y) - square * square
    from_Y = -square * (2.0 * unit + square)
    d11 = select(near, from_X, above * (below - square))
    d22 = select(near, from_Y, below * below - 2.0 * Y * square)
    d12 = X1 * one * (2.0 * unit + square)
    d21 = -2.0 * X * above * below
    return d11 * r * r, d12 * r * r, d21 * r * r, d22 * r * r, select(near, 1.0, 0.0)


@formula
def jacobian(I1, I2, I13, I23, eps, M, P, E, omega1, omega2):
    """Entries (11, 12, 21, 22) of the derivative of the map; NaN at its poles."""
    omega1, omega2, W = normal_state(omega1, omega2)
    eps_W = moderate(eps, E + W + P - M)
    X, Y, lost = to_canonical(I1, I2, I13, I23, eps_W, omega1, omega2)
    rests = at_rest(I13, I23, eps_W, X, Y)
    c, Z = shifted(Y, lost)
    _, regular = denominator(X, Z, c)
    d11, d12, d21, d22, identity = canonical_jacobian(X, Z, c)
    # From (X, Y) to (x, y), then to (Omega1, Omega2).
    s = np.sqrt(2.0 * I1 * I2)
    d12, d21 = d12 / s, d21 * s
    right11, right12 = d11 * I13 + d12 * (I23 * I1), d11 * I23 - d12 * (I13 * I2)
    right21, right22 = d21 * I13 + d22 * (I23 * I1), d21 * I23 - d22 * (I13 * I2)
    inverse = 1.0 / (I13 * I13 * I2 + I23 * I23 * I1)
    a11 = identity + (I13 * I2 * right11 + I23 * right21) * inverse
    a12 = (I13 * I2 * right12 + I23 * right22) * inverse
    a21 = (I23 * I1 * right11 - I13 * right21) * inverse
    a22 = identity + (I23 * I1 * right12 - I13 * right22) * inverse
    # A NaN in an entry or in the state makes all entries NaN.
    poison = 0.0 * (a11 + a12 + a21 + a22)
    poison = select(regular, poison, np.nan)
    poison = select(rests, 0.0 * (omega1 + omega2), poison)
    return (
        (select(rests, 1.0, a11)) + poison,
        (select(rests, 0.0, a12)) + poison,
        (select(rests, 0.0, a21)) + poison,
        (select(rests, 1.0, a22)) + poison,
    )


@formula
def matrix(I1, I2, I13, I23, eps, M, P, E, omega1, omega2):
    """Entries (11, 12, 21, 22) of the matrix that the paper inverts before equation (5)."""
    omega1, omega2, W = normal_state(omega1, omega2)
    k1, k2, k3, k4 = printed_coefficients(I1, I2, I13, I23, eps)
    K = E + W + P - M
    # A NaN in the state makes all entries NaN.
    poison = 0.0 * (omega1 + omega2)
    return (
        1.0 + scaled(k1 * omega2 + poison, K),
        scaled(k1 * omega1 + k3 * omega2, K),
        scaled(-k4 * omega1 - k2 * omega2, K),
        1.0 - scaled(k2 * omega1 + poison, K),
    )
