"""The map in three dimensions by equation (5) as printed, for `blocks`."""

from typing import NamedTuple

import numpy as np

from .._formulas import coordinates, printed_map, units
from .._formulas.elementary import two_to_the
from .._jit import formula, select
from . import codes
from .lanes import body_at

D = 2


class State(NamedTuple):
    """Omega in a unit."""

    omega1: float
    omega2: float


class Constants(NamedTuple):
    """Coefficients of the map, the unit of states, and their bound."""

    k1: float
    k2: float
    k3: float
    k4: float
    unit: float
    bound: float


@formula
def enter(parameters, omega, i):
    I1, I2, I13, I23, eps = body_at(parameters, i)
    omega1, omega2 = omega[i, 0], omega[i, 1]
    p, u = units.enter(I1, I2, I13, I23, 0.0, eps, omega1, omega2)
    _, Y, _, _ = coordinates.dimensionless(*p)
    rests, unit = (eps == 0.0) | (I13 == 0.0) & (I23 == 0.0), two_to_the(u.W)
    k1, k2, k3, k4 = printed_map.printed_coefficients(p.I1, p.I2, p.I13, p.I23, p.eps)
    constants = Constants(
        select(rests, 0.0, k1), select(rests, 0.0, k2),
        select(rests, 0.0, k3), select(rests, 0.0, k4),
        select(rests, 1.0, unit), select(rests, np.inf, units.bound_in(unit)),
    )  # fmt: skip
    unknown = (omega1 + omega2 != omega1 + omega2) | select(rests, False, Y != Y)
    state = State(
        select(unknown, np.nan, select(rests, omega1, p.omega1)), select(rests, omega2, p.omega2)
    )
    status = select((abs(Y) >= 1.0) & ~rests, codes.SUPERCRITICAL, codes.OK)
    return select(unknown, codes.NONFINITE, status), True, state, constants


@formula
def advance(k, s):
    return printed_map.printed_step(k.k1, k.k2, k.k3, k.k4, s.omega1, s.omega2, k.bound)


@formula
def show(k, s):
    return s.omega1 * k.unit, s.omega2 * k.unit


@formula
def cause(k, s):
    d, regular = printed_map.printed_denominator(k.k1, k.k2, k.k3, k.k4, s.omega1, s.omega2)
    return codes.SINGULAR if np.isfinite(d) and not regular else codes.NONFINITE
