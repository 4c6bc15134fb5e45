"""The map of the Suslov gyrostat, a module for `iterate`."""

from typing import NamedTuple

import numpy as np

from .._formulas import gyrostat as formulas
from .._formulas.elementary import larger, two_to_the
from .._formulas.units import enter as enter_units
from .._jit import carray, formula, select, stack
from . import codes
from .blocks import LARGEST
from .lanes import LANES, entry, row

D, STATE = 2, 4
_STATE = STATE * LANES


class Block(NamedTuple):
    """A block of trajectories: L, Z and omega in a unit, constants, a bound of omega."""

    state: object
    L: object
    Z: object
    omega1: object
    omega2: object
    b1: object
    b2: object
    K: object
    c: object
    bound: object
    unit: object


@formula
def block():
    state = carray(stack(_STATE), (STATE, LANES))
    return Block(
        state, state[0], state[1], state[2], state[3], row(), row(), row(), row(), row(), row()
    )


@formula
def enter(parameters, omega, i, b, l):
    I1, I2, I13, I23, k, eps = parameters
    p, units = enter_units(
        entry(I1, i), entry(I2, i), entry(I13, i), entry(I23, i), entry(k, i), entry(eps, i),
        omega[i, 0], omega[i, 1],
    )  # fmt: skip
    b1, b2, K, c, L, Z = formulas.enter(*p)
    unit = two_to_the(units.W)
    b.b1[l], b.b2[l], b.K[l], b.c[l] = b1, b2, K, c
    b.bound[l], b.unit[l] = LARGEST / larger(unit, 1.0), unit
    # Out of range L and K are NaN: there is a state 0, and no next one.
    b.L[l] = select(np.isnan(p.omega1), np.nan, select(np.isnan(K), 0.0, L))
    b.Z[l], b.omega1[l], b.omega2[l] = Z, p.omega1, p.omega2
    Y = c - Z
    supercritical = 1.0 + b1 * b2 * K * (2.0 * L - K) <= Y * Y
    code = codes.SUPERCRITICAL if supercritical else codes.OK
    return codes.NONFINITE if np.isnan(p.omega1) else code, 1


@formula
def advance(b, l):
    L, Z, omega1, omega2 = formulas.step(
        b.b1[l], b.b2[l], b.K[l], b.c[l], b.L[l], b.Z[l], b.omega1[l], b.omega2[l]
    )
    exists = larger(abs(omega1), abs(omega2)) < b.bound[l]
    b.L[l], b.Z[l] = select(exists, L, np.nan), Z
    b.omega1[l], b.omega2[l] = select(exists, omega1, np.nan), select(exists, omega2, np.nan)


@formula
def show(b, l, out, i):
    out[i], out[i + 1] = b.omega1[l] * b.unit[l], b.omega2[l] * b.unit[l]


@formula
def cause(b, l):
    d = formulas.denominator(b.b1[l], b.b2[l], b.K[l], b.c[l], b.L[l], b.Z[l])
    in_range = np.isfinite(b.K[l] + b.L[l] * b.L[l])
    return codes.SINGULAR if np.isnan(d) and in_range else codes.NONFINITE
