"""The Suslov gyrostat: a body with a rotor of constant momentum k along the constrained axis.

With l = I13 Omega1 + I23 Omega2 + k its equations are I1 Omega1' = -l Omega2 and
I2 Omega2' = l Omega1. The discrete equations have polarised products as in equation
(4) of the paper, and k (Omega_i + Omega_i_next) / 2 for k Omega_i. With h = eps / 2, L = h l,
K = h k and Y = h (I23 Omega1 / I2 - I13 Omega2 / I1) they give

L_next = L (1 + Y + K L / (I1 I2)) / (1 - Y + L (2 L - K) / (I1 I2)),
Y_next = Y - (2 L L_next - K (L + L_next)) / (I1 I2),

and, given L_next, two linear equations for Omega_next, whose determinant 1 + L**2 / (I1 I2) has no
zero. So l is accurate near the steady states l = 0, and the poles are those of the first line.

Y is stored as Z = c - Y as in `canonical_map`.
"""

import numpy as np

from .._jit import formula, select
from .canonical_map import ZERO_TO_ROUNDING, shifted
from .coordinates import dimensionless, rotor


@formula
def enter(I1, I2, I13, I23, k, eps, omega1, omega2):
    """Constants 1 / I1, 1 / I2, K and c of an orbit, and its L and Z, in the units of `units`.

    They are NaN where the step is out of range.
    """
    l = rotor(I13, I23, k, omega1, omega2)
    _, Y, lost, _ = dimensionless(I1, I2, I13, I23, k, eps, omega1, omega2)
    c, Z = shifted(Y, lost)
    h = 0.5 * eps
    return 1.0 / I1, 1.0 / I2, h * k, c, h * l, Z


@formula
def denominator(b1, b2, K, c, L, Z):
    """Denominator of L_next; NaN if it is 0 to rounding."""
    first, second = (1.0 - c) + Z, (b1 * L) * (b2 * (2.0 * L - K))
    size = abs(first) + (b1 * abs(L)) * (b2 * (2.0 * abs(L) + abs(K)))
    d = first + second
    return select(abs(d) > ZERO_TO_ROUNDING * size, d, np.nan)


@formula
def step(b1, b2, K, c, L, Z, omega1, omega2):
    """Next state (L, Z, Omega1, Omega2); NaN if there is none."""
    below = denominator(b1, b2, K, c, L, Z)
    p, q, u = b1 * L, b2 * L, (b1 * L) * (b2 * K)
    next_L = L * (((1.0 + c) - Z + u) / below)
    # c - Y_next as one quotient: the two terms of Y_next cancel where L or K is large.
    next_Z = (Z * ((1.0 - c) + Z - u) + 2.0 * ((1.0 + c) * (p * q) - u)) / below
    # The second equation inserted into the first.
    next_p, next_q = b1 * next_L, b2 * next_L
    inverse = 1.0 / (1.0 + p * q)
    right1, right2 = omega1 - next_p * omega2, omega2 + next_q * omega1
    return next_L, next_Z, (right1 - p * right2) * inverse, (right2 + q * right1) * inverse
