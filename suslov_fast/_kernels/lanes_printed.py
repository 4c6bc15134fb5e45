"""The map in three dimensions by equation (5) as printed, a module for `iterate`."""

from typing import NamedTuple

import numpy as np

from .._formulas import coordinates, printed_map, units
from .._formulas.elementary import larger, two_to_the
from .._jit import carray, formula, select, stack
from . import codes
from .blocks import LARGEST
from .lanes import LANES, body_at, row

D, STATE = 2, 2
_STATE = STATE * LANES


class Block(NamedTuple):
    """A block of trajectories: states in a unit, coefficients of the map, a bound of the states."""

    state: object
    omega1: object
    omega2: object
    k1: object
    k2: object
    k3: object
    k4: object
    bound: object
    unit: object


@formula
def block():
    state = carray(stack(_STATE), (STATE, LANES))
    return Block(state, state[0], state[1], row(), row(), row(), row(), row(), row())


@formula
def enter(parameters, omega, i, b, l):
    I1, I2, I13, I23, eps = body_at(parameters, i)
    omega1, omega2 = omega[i, 0], omega[i, 1]
    p, u = units.enter(I1, I2, I13, I23, 0.0, eps, omega1, omega2)
    _, Y, _ = coordinates.to_canonical(p.I1, p.I2, p.I13, p.I23, p.eps, p.omega1, p.omega2)
    rests, unit = (eps == 0.0) | (I13 == 0.0) & (I23 == 0.0), two_to_the(u.W)
    k1, k2, k3, k4 = printed_map.printed_coefficients(p.I1, p.I2, p.I13, p.I23, p.eps)
    b.k1[l], b.k2[l] = select(rests, 0.0, k1), select(rests, 0.0, k2)
    b.k3[l], b.k4[l] = select(rests, 0.0, k3), select(rests, 0.0, k4)
    b.bound[l] = select(rests, np.inf, LARGEST / larger(unit, 1.0))
    b.unit[l] = select(rests, 1.0, unit)
    missing = (omega1 + omega2 != omega1 + omega2) | select(rests, False, Y != Y)
    b.omega1[l] = select(missing, np.nan, select(rests, omega1, p.omega1))
    b.omega2[l] = select(rests, omega2, p.omega2)
    code = codes.SUPERCRITICAL if abs(Y) >= 1.0 and not rests else codes.OK
    return codes.NONFINITE if missing else code, 1


@formula
def advance(b, l):
    b.omega1[l], b.omega2[l] = printed_map.printed_step(
        b.k1[l], b.k2[l], b.k3[l], b.k4[l], b.omega1[l], b.omega2[l], b.bound[l]
    )


@formula
def show(b, l, out, i):
    out[i], out[i + 1] = b.omega1[l] * b.unit[l], b.omega2[l] * b.unit[l]


@formula
def cause(b, l):
    d, regular = printed_map.printed_denominator(
        b.k1[l], b.k2[l], b.k3[l], b.k4[l], b.omega1[l], b.omega2[l]
    )
    return codes.SINGULAR if np.isfinite(d) and not regular else codes.NONFINITE
