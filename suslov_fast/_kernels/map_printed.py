"""The map in three dimensions by equation (5) as the paper prints it, for `blocks`."""

from collections import namedtuple

import numpy as np

from .._formulas import coordinates, units
from .._formulas.coordinates import ZERO_TO_ROUNDING
from .._formulas.elementary import two_to_the
from .._jit import formula, select
from . import codes
from .lanes import body_at

D = 2

# omega in a unit.
State = namedtuple("State", "omega1 omega2")
# The coefficients of equation (5), the unit of states, and their bound.
Constants = namedtuple("Constants", "k1 k2 k3 k4 unit bound")


@formula
def enter(parameters, omega, i):
    I1, I2, I13, I23, eps = body_at(parameters, i)
    omega1, omega2 = omega[i, 0], omega[i, 1]
    p, u = units.scaled_state(I1, I2, I13, I23, 0.0, eps, omega1, omega2)
    _, Y, _, _ = coordinates.dimensionless(*p)
    rests, unit = (eps == 0.0) | (I13 == 0.0) & (I23 == 0.0), two_to_the(u.W)
    constants = Constants(
        k1=select(rests, 0.0, p.eps * p.I13 / (2.0 * p.I1)),
        k2=select(rests, 0.0, p.eps * p.I23 / (2.0 * p.I2)),
        k3=select(rests, 0.0, p.eps * p.I23 / p.I1),
        k4=select(rests, 0.0, p.eps * p.I13 / p.I2),
        unit=select(rests, 1.0, unit),
        bound=select(rests, np.inf, units.bound_in(unit)),
    )
    unknown = (omega1 + omega2 != omega1 + omega2) | select(rests, False, Y != Y)
    state = State(
        select(unknown, np.nan, select(rests, omega1, p.omega1)), select(rests, omega2, p.omega2)
    )
    status = select((abs(Y) >= 1.0) & ~rests, codes.SUPERCRITICAL, codes.OK)
    return select(unknown, codes.NONFINITE, status), True, state, constants


@formula
def _denominator(k, s):
    """Return Delta of equation (5), and True if it is finite and differs from 0 beyond rounding."""
    product = (k.k1 * s.omega1 + k.k3 * s.omega2) * (k.k4 * s.omega1 + k.k2 * s.omega2)
    delta = (1.0 + k.k1 * s.omega2) * (1.0 - k.k2 * s.omega1) + product
    # Where delta is 0, the product is as large as the other term.
    size = (1.0 + abs(k.k1 * s.omega2)) * (1.0 + abs(k.k2 * s.omega1))
    return delta, ZERO_TO_ROUNDING * size < abs(delta) < np.inf


@formula
def advance(k, s):
    """Next state by equation (5)."""
    delta, regular = _denominator(k, s)
    omega1, omega2, k1, k2 = s.omega1, s.omega2, k.k1, k.k2
    next1 = omega1 - k2 * omega1 * omega1 - k1 * omega1 * omega2 - k.k3 * omega2 * omega2
    next2 = omega2 + k1 * omega2 * omega2 + k2 * omega1 * omega2 + k.k4 * omega1 * omega1
    next1, next2 = next1 / delta, next2 / delta
    exists = regular & (abs(next1) + abs(next2) < k.bound)
    return select(exists, next1, np.nan), select(exists, next2, np.nan)


@formula
def show(k, s):
    return s.omega1 * k.unit, s.omega2 * k.unit


@formula
def cause(k, s):
    delta, regular = _denominator(k, s)
    return codes.SINGULAR if np.isfinite(delta) and not regular else codes.NONFINITE
