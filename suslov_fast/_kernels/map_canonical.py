"""The map in three dimensions in the dimensionless coordinates (X, Y), for `blocks`.

X = e l and Y are those of `coordinates.dimensionless`. In these, one map serves every body and step
size: equation (8), solved, is

X_next = X (1 + Y) / (1 - Y + 2 X**2),  Y_next = Y - 2 X X_next.

A state is stored as (X, Z) with Z = c - Y. The constant c of an orbit is 0 where Y is small, and 1
where 1 - Y is small, so that neither is a difference of rounded numbers.
"""

from collections import namedtuple

import numpy as np

from .._formulas import coordinates, units
from .._formulas.coordinates import NEGLIGIBLE
from .._formulas.elementary import larger, two_to_the
from .._formulas.equations import LARGE, next_coordinates
from .._jit import formula, select
from . import codes
from .lanes import body_at

D = 2
# |X| + |Y| below this: a step changes the state by less than one part in 1e150.
MOTIONLESS = 1e-150
# Below this |X|, X**2 is subnormal. It is negligible relative to a state that moves.
SMALLEST_SQUARED = 2.0**-510
# Bound of |X| + |Z| of orbits with c = 0, -1 < Y <= 1/2 and |X| < LARGE, which reach no pole: by
# T**2 = (X**2 + Y**2)/(1 + X**2), which is conserved, X**2 is below 4 and |Y| below 1.
LARGEST_BOUNDED = 3.0

State = namedtuple("State", "X Z")
# omega = (m (X, Z) + rest) scale, which is finite if |X| + |Z| < bound.
Constants = namedtuple("Constants", "c m11 m12 m21 m22 rest1 rest2 scale bound")


@formula
def enter(parameters, omega, i):
    I1, I2, I13, I23, eps = body_at(parameters, i)
    omega1, omega2 = omega[i, 0], omega[i, 1]
    p, u = units.scaled_state(I1, I2, I13, I23, 0.0, eps, omega1, omega2)
    X, Y, lost, _ = coordinates.dimensionless(*p)
    m11, m12, m21, m22 = coordinates.from_canonical(p.I1, p.I2, p.I13, p.I23, p.eps)
    # The identity map (I13 = I23 = 0, or eps = 0) has no such matrix: the state does not change.
    rests = (p.I13 == 0.0) & (p.I23 == 0.0) | (p.eps == 0.0) | (abs(X) + abs(Y) < MOTIONLESS)
    m11, m12 = select(rests, 0.0, m11), select(rests, 0.0, m12)
    m21, m22 = select(rests, 0.0, m21), select(rests, 0.0, m22)
    X, Y, lost = select(rests, 0.0, X), select(rests, 0.0, Y), select(rests, 0.0, lost)
    c, Z = coordinates.shifted(Y, lost)
    unit = two_to_the(u.W)
    largest = larger(larger(abs(m11), abs(m12)), larger(abs(m21), abs(m22)))
    bound = units.bound_in(unit) / largest
    rest1 = select(rests, omega1, 0.0) + m12 * c
    rest2 = select(rests, omega2, 0.0) + m22 * c
    X = select(omega1 + omega2 == omega1 + omega2, X, np.nan)
    status = select(abs(Y) >= 1.0, codes.SUPERCRITICAL, codes.OK)
    status = select(X == X, status, codes.NONFINITE)
    scale = select(rests, 1.0, unit)
    bounded = (c == 0.0) & (Z < 1.0) & (abs(X) < LARGE) & (bound > LARGEST_BOUNDED)
    constants = Constants(c, m11, -m12, m21, -m22, rest1, rest2, scale, bound)
    return status, not bounded, State(X, Z), constants


@formula
def _squarable(X):
    """X, or 0 if its square is subnormal."""
    return select(abs(X) < SMALLEST_SQUARED, 0.0, X)


@formula
def advance(k, s):
    """`next_coordinates` of orbits with c = 0 that reach no pole."""
    X0 = _squarable(s.X)
    square = X0 * (2.0 * X0)
    ratio = (1.0 - s.Z) / ((1.0 + s.Z) + square)
    return s.X * ratio, s.Z + square * ratio


@formula
def guarded(k, s):
    X, Z = next_coordinates(s.X, _squarable(s.X), k.c, s.Z)
    exists = abs(X) + abs(Z) < k.bound
    return select(exists, X, np.nan), select(exists, Z, np.nan)


@formula
def show(k, s):
    """omega; both are NaN where X is."""
    omega1, omega2 = k.m11 * s.X + k.m12 * s.Z, k.m21 * s.X + k.m22 * s.Z
    return (omega1 + k.rest1) * k.scale, (omega2 + k.rest2) * k.scale


@formula
def cause(k, s):
    next_X, _ = next_coordinates(s.X, _squarable(s.X), k.c, s.Z)
    return codes.SINGULAR if np.isnan(next_X) and np.isfinite(s.X * s.X + s.Z) else codes.NONFINITE


@formula
def settle(k, s):
    # Near the smallest normal number, and converging to a fixed point.
    return select((abs(s.X) < NEGLIGIBLE) & (k.c < s.Z), 0.0, s.X), s.Z
