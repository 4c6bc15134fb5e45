"""The map of the Suslov gyrostat, for `blocks`."""

from typing import NamedTuple

import numpy as np

from .._formulas import gyrostat as formulas
from .._formulas import units
from .._formulas.elementary import larger, two_to_the
from .._jit import formula, select
from . import codes
from .lanes import entry

D = 2


class State(NamedTuple):
    """L, Z and omega in a unit."""

    L: float
    Z: float
    omega1: float
    omega2: float


class Constants(NamedTuple):
    """Constants of the map, the unit of omega, and its bound."""

    b1: float
    b2: float
    K: float
    c: float
    unit: float
    bound: float


@formula
def enter(parameters, omega, i):
    I1, I2, I13, I23, k, eps = parameters
    p, u = units.enter(
        entry(I1, i), entry(I2, i), entry(I13, i), entry(I23, i), entry(k, i), entry(eps, i),
        omega[i, 0], omega[i, 1],
    )  # fmt: skip
    b1, b2, K, c, L, Z = formulas.enter(*p)
    unit, Y = two_to_the(u.W), c - Z
    # Out of range L and K are NaN: there is a state 0, and no next one.
    L0 = select(np.isnan(p.omega1), np.nan, select(np.isnan(K), 0.0, L))
    supercritical = 1.0 + b1 * b2 * K * (2.0 * L - K) <= Y * Y
    status = select(supercritical, codes.SUPERCRITICAL, codes.OK)
    status = select(np.isnan(p.omega1), codes.NONFINITE, status)
    constants = Constants(b1, b2, K, c, unit, units.bound_in(unit))
    return status, True, State(L0, Z, p.omega1, p.omega2), constants


@formula
def advance(k, s):
    L, Z, omega1, omega2 = formulas.step(k.b1, k.b2, k.K, k.c, s.L, s.Z, s.omega1, s.omega2)
    exists = larger(abs(omega1), abs(omega2)) < k.bound
    L, omega1 = select(exists, L, np.nan), select(exists, omega1, np.nan)
    return L, Z, omega1, select(exists, omega2, np.nan)


@formula
def show(k, s):
    return s.omega1 * k.unit, s.omega2 * k.unit


@formula
def cause(k, s):
    d = formulas.denominator(k.b1, k.b2, k.K, k.c, s.L, s.Z)
    in_range = np.isfinite(k.K + s.L * s.L)
    return codes.SINGULAR if np.isnan(d) and in_range else codes.NONFINITE
