"""The map of the Suslov gyrostat, for `blocks`: a rotor of momentum k along the constrained axis.

With l = I13 Omega1 + I23 Omega2 + k its equations are I1 Omega1' = -l Omega2 and
I2 Omega2' = l Omega1. The discrete equations have polarised products as in equation
(4) of the paper, and k (Omega_i + Omega_i_next) / 2 for k Omega_i. With h = eps / 2, L = h l,
K = h k and Y = h (I23 Omega1 / I2 - I13 Omega2 / I1) they give

L_next = L (1 + Y + K L / (I1 I2)) / (1 - Y + L (2 L - K) / (I1 I2)),
Y_next = Y - (2 L L_next - K (L + L_next)) / (I1 I2),

So l is accurate near the steady states l = 0. Given L_next, Omega_next is the solution of two
linear equations with the determinant 1 + L**2 / (I1 I2). In it L + L_next, which cancels for large
Y, is 2 L times this determinant, over the denominator of L_next, whose zeros are the poles.
"""

from collections import namedtuple

import numpy as np

from .._formulas import units
from .._formulas.coordinates import ZERO_TO_ROUNDING, dimensionless, rotor, shifted
from .._formulas.elementary import larger, two_to_the
from .._jit import formula, select
from . import codes
from .lanes import entry

D = 2

# L, Z = c - Y, and omega in a unit.
State = namedtuple("State", "L Z omega1 omega2")
# 1 / I1 and 1 / I2, K, c of `shifted`, the unit of omega, and its bound.
Constants = namedtuple("Constants", "b1 b2 K c unit bound")


@formula
def enter(parameters, omega, i):
    I1, I2, I13, I23, k, eps = parameters
    p, u = units.enter(
        entry(I1, i), entry(I2, i), entry(I13, i), entry(I23, i), entry(k, i), entry(eps, i),
        omega[i, 0], omega[i, 1],
    )  # fmt: skip
    h, unit = 0.5 * p.eps, two_to_the(u.W)
    _, Y, lost, _ = dimensionless(*p)
    c, Z = shifted(Y, lost)
    constants = Constants(1.0 / p.I1, 1.0 / p.I2, h * p.k, c, unit, units.bound_in(unit))
    b1, b2, K = constants.b1, constants.b2, constants.K
    L, Y = h * rotor(p.I13, p.I23, p.k, p.omega1, p.omega2), c - Z
    # Out of range L is NaN, and b1 or K: there is a state 0, and no next one.
    L0 = select(np.isnan(p.omega1), np.nan, select(np.isnan(L), 0.0, L))
    supercritical = 1.0 + b1 * b2 * K * (2.0 * L - K) <= Y * Y
    status = select(supercritical, codes.SUPERCRITICAL, codes.OK)
    status = select(np.isnan(p.omega1), codes.NONFINITE, status)
    return status, True, State(L0, Z, p.omega1, p.omega2), constants


@formula
def denominator(k, s):
    """Denominator of L_next; NaN if it is 0 to rounding."""
    first, second = (1.0 - k.c) + s.Z, (k.b1 * s.L) * (k.b2 * (2.0 * s.L - k.K))
    size = abs(first) + (k.b1 * abs(s.L)) * (k.b2 * (2.0 * abs(s.L) + abs(k.K)))
    d = first + second
    return select(abs(d) > ZERO_TO_ROUNDING * size, d, np.nan)


@formula
def advance(k, s):
    c, Z, below = k.c, s.Z, denominator(k, s)
    p, q, u = k.b1 * s.L, k.b2 * s.L, (k.b1 * s.L) * (k.b2 * k.K)
    L = s.L * (((1.0 + c) - Z + u) / below)
    # c - Y_next as one quotient: the two terms of Y_next cancel where L or K is large.
    next_Z = (Z * ((1.0 - c) + Z - u) + 2.0 * ((1.0 + c) * (p * q) - u)) / below
    along, across = (1.0 - p * (k.b2 * L)) / (1.0 + p * q), 2.0 * (s.L / below)
    omega1 = along * s.omega1 - (k.b1 * across) * s.omega2
    omega2 = along * s.omega2 + (k.b2 * across) * s.omega1
    exists = larger(abs(omega1), abs(omega2)) < k.bound
    L, omega1 = select(exists, L, np.nan), select(exists, omega1, np.nan)
    return L, next_Z, omega1, select(exists, omega2, np.nan)


@formula
def show(k, s):
    return s.omega1 * k.unit, s.omega2 * k.unit


@formula
def cause(k, s):
    in_range = np.isfinite(k.b1 + k.K + s.L * s.L)
    return codes.SINGULAR if np.isnan(denominator(k, s)) and in_range else codes.NONFINITE
