"""The map of the Suslov gyrostat, for `blocks`: a rotor of momentum k along the constrained axis.

With l = I13 Omega1 + I23 Omega2 + k its equations are I1 Omega1' = -l Omega2 and
I2 Omega2' = l Omega1. The discrete equations have polarised products as in equation
(4) of the paper, and k (Omega_i + Omega_i_next) / 2 for k Omega_i. In X = e l, Y and K = e k of
`coordinates.dimensionless` they give

X_next = X (1 + Y + K X) / D,  Y_next = Y - 2 X X_next + K (X + X_next),  D = 1 - Y + 2 X**2 - K X.

So l is accurate near the steady states l = 0. A step multiplies
z = sqrt(I1) Omega1 + i sqrt(I2) Omega2 by (1 + i X_next) / (1 - i X), see `turn_of_gyrostat`.
"""

from collections import namedtuple

import numpy as np

from .._formulas import units
from .._formulas.coordinates import dimensionless, shifted
from .._formulas.elementary import larger, two_to_the
from .._formulas.equations import denominator, over_denominator, turn_of_gyrostat
from .._jit import formula, select
from . import codes
from .lanes import entry

D = 2

# X, Z = c - Y, and omega in a unit.
State = namedtuple("State", "X Z omega1 omega2")
# sqrt(I2 / I1) and its inverse, K, c of `shifted`, the unit of omega, and its bound.
Constants = namedtuple("Constants", "ratio inverse K c unit bound")


@formula
def enter(parameters, omega, i):
    I1, I2, I13, I23, k, eps = parameters
    p, u = units.scaled_state(
        entry(I1, i), entry(I2, i), entry(I13, i), entry(I23, i), entry(k, i), entry(eps, i),
        omega[i, 0], omega[i, 1],
    )  # fmt: skip
    X, Y, lost, K = dimensionless(*p)
    (c, Z), unit, ratio = shifted(Y, lost), two_to_the(u.W), np.sqrt(p.I2 / p.I1)
    # Out of range X is NaN, and K: there is a state 0, and no next one.
    X0 = select(np.isnan(p.omega1), np.nan, select(np.isnan(X), 0.0, X))
    supercritical = 1.0 + K * (2.0 * X - K) <= Y * Y
    status = select(supercritical, codes.SUPERCRITICAL, codes.OK)
    status = select(np.isnan(p.omega1), codes.NONFINITE, status)
    constants = Constants(ratio, 1.0 / ratio, K, c, unit, units.bound_in(unit))
    return status, True, State(X0, Z, p.omega1, p.omega2), constants


@formula
def advance(k, s):
    ratio, along, across = turn_of_gyrostat(s.X, k.c, s.Z, k.K)
    # c - Y_next; the two terms of Y_next above cancel where X or K is large.
    next_X, next_Z = s.X * ratio, along * s.Z + across * ((1.0 + k.c) * s.X - k.K)
    omega1 = along * s.omega1 - (across * k.ratio) * s.omega2
    omega2 = along * s.omega2 + (across * k.inverse) * s.omega1
    exists = larger(abs(omega1), abs(omega2)) < k.bound
    next_X, omega1 = select(exists, next_X, np.nan), select(exists, omega1, np.nan)
    return next_X, next_Z, omega1, select(exists, omega2, np.nan)


@formula
def show(k, s):
    return s.omega1 * k.unit, s.omega2 * k.unit


@formula
def cause(k, s):
    is_pole = np.isnan(over_denominator(1.0, *denominator(s.X, k.c, s.Z, k.K)))
    in_range = np.isfinite(k.ratio + k.K + s.X * s.X)
    return codes.SINGULAR if is_pole and in_range else codes.NONFINITE
