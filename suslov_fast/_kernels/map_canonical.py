"""The map in three dimensions in the coordinates (X, Y), for `blocks`."""

from typing import NamedTuple

import numpy as np

from .._formulas import canonical_map, coordinates, units
from .._formulas.elementary import larger, two_to_the
from .._jit import formula, select
from . import codes
from .lanes import body_at

D = 2


class State(NamedTuple):
    X: float
    Z: float  # c - Y


class Constants(NamedTuple):
    """omega = (m (X, Z) + rest) scale, which is finite if |X| + |Z| < bound."""

    c: float
    m11: float
    m12: float
    m21: float
    m22: float
    rest1: float
    rest2: float
    scale: float
    bound: float


@formula
def enter(parameters, omega, i):
    I1, I2, I13, I23, eps = body_at(parameters, i)
    omega1, omega2 = omega[i, 0], omega[i, 1]
    p, u = units.enter(I1, I2, I13, I23, 0.0, eps, omega1, omega2)
    X, Y, lost, _ = coordinates.dimensionless(*p)
    m11, m12, m21, m22 = coordinates.from_canonical(p.I1, p.I2, p.I13, p.I23, p.eps)
    # The identity map (I13 = I23 = 0, or eps = 0) has no such matrix: the state does not change.
    rests = coordinates.at_rest(p.I13, p.I23, p.eps, X, Y)
    m11, m12 = select(rests, 0.0, m11), select(rests, 0.0, m12)
    m21, m22 = select(rests, 0.0, m21), select(rests, 0.0, m22)
    X, Y, lost = select(rests, 0.0, X), select(rests, 0.0, Y), select(rests, 0.0, lost)
    c, Z = canonical_map.shifted(Y, lost)
    unit = two_to_the(u.W)
    largest = larger(larger(abs(m11), abs(m12)), larger(abs(m21), abs(m22)))
    bound = units.bound_in(unit) / largest
    rest1 = select(rests, omega1, 0.0) + m12 * c
    rest2 = select(rests, omega2, 0.0) + m22 * c
    X = select(omega1 + omega2 == omega1 + omega2, X, np.nan)
    status = select(abs(Y) >= 1.0, codes.SUPERCRITICAL, codes.OK)
    status = select(X == X, status, codes.NONFINITE)
    scale = select(rests, 1.0, unit)
    constants = Constants(c, m11, -m12, m21, -m22, rest1, rest2, scale, bound)
    return status, not canonical_map.stays_bounded(X, Z, c, bound), State(X, Z), constants


@formula
def advance(k, s):
    return canonical_map.canonical_step(s.X, s.Z, 0.0)


@formula
def careful(k, s):
    return canonical_map.careful_step(s.X, s.Z)


@formula
def guarded(k, s):
    return canonical_map.guarded_step(s.X, s.Z, k.c, k.bound)


@formula
def show(k, s):
    return coordinates.angular_velocity(
        k.m11, k.m12, k.m21, k.m22, k.rest1, k.rest2, k.scale, s.X, s.Z
    )


@formula
def cause(k, s):
    d, regular = canonical_map.denominator(s.X, s.Z, k.c)
    return codes.SINGULAR if np.isfinite(d) and not regular else codes.NONFINITE


@formula
def settle(k, s):
    return canonical_map.without_negligible(s.X, s.Z, k.c), s.Z


@formula
def is_slow(s):
    return canonical_map.has_subnormal_square(s.X)
