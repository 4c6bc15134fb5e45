"""The map in three dimensions in the coordinates (X, Y), a module for `iterate`."""

from typing import NamedTuple

import numpy as np

from .._formulas import canonical_map, coordinates, units
from .._formulas.elementary import larger, two_to_the
from .._jit import carray, formula, select, stack
from . import codes
from .blocks import LARGEST
from .lanes import LANES, body_at, row

D, STATE = 2, 2
_STATE = STATE * LANES


class Block(NamedTuple):
    """A block of trajectories: omega = (m (X, Z) + rest) scale, |X| + |Z| < bound, Z = c - Y."""

    state: object
    X: object
    Z: object
    c: object
    m11: object
    m12: object
    m21: object
    m22: object
    rest1: object
    rest2: object
    scale: object
    bound: object


@formula
def block():
    state = carray(stack(_STATE), (STATE, LANES))
    return Block(
        state, state[0], state[1],
        row(), row(), row(), row(), row(), row(), row(), row(), row(),
    )  # fmt: skip


@formula
def enter(parameters, omega, i, b, l):
    I1, I2, I13, I23, eps = body_at(parameters, i)
    omega1, omega2 = omega[i, 0], omega[i, 1]
    p, u = units.enter(I1, I2, I13, I23, 0.0, eps, omega1, omega2)
    X, Y, lost = coordinates.to_canonical(p.I1, p.I2, p.I13, p.I23, p.eps, p.omega1, p.omega2)
    m11, m12, m21, m22 = coordinates.from_canonical(p.I1, p.I2, p.I13, p.I23, p.eps)
    # The identity map (I13 = I23 = 0, or eps = 0) has no such matrix: the state does not change.
    rests = coordinates.at_rest(p.I13, p.I23, p.eps, X, Y)
    m11, m12 = select(rests, 0.0, m11), select(rests, 0.0, m12)
    m21, m22 = select(rests, 0.0, m21), select(rests, 0.0, m22)
    X, Y, lost = select(rests, 0.0, X), select(rests, 0.0, Y), select(rests, 0.0, lost)
    c, Z = canonical_map.shifted(Y, lost)
    unit = two_to_the(u.W)
    largest = larger(larger(abs(m11), abs(m12)), larger(abs(m21), abs(m22)))
    # omega is finite if |X| + |Z| is below this.
    bound = (LARGEST / larger(unit, 1.0)) / largest
    b.m11[l], b.m12[l], b.m21[l], b.m22[l] = m11, -m12, m21, -m22
    b.rest1[l] = select(rests, omega1, 0.0) + m12 * c
    b.rest2[l] = select(rests, omega2, 0.0) + m22 * c
    b.scale[l], b.bound[l], b.c[l] = select(rests, 1.0, unit), bound, c
    X = select(omega1 + omega2 == omega1 + omega2, X, np.nan)
    b.X[l], b.Z[l] = X, Z
    code = codes.SUPERCRITICAL if abs(Y) >= 1.0 else codes.OK
    bounded = canonical_map.stays_bounded(X, Z, c, bound)
    return codes.NONFINITE if np.isnan(X) else code, 0 if bounded else 1


@formula
def advance(b, l):
    b.X[l], b.Z[l] = canonical_map.canonical_step(b.X[l], b.Z[l], 0.0)


@formula
def careful(b, l):
    b.X[l], b.Z[l] = canonical_map.careful_step(b.X[l], b.Z[l])


@formula
def guarded(b, l):
    b.X[l], b.Z[l] = canonical_map.guarded_step(b.X[l], b.Z[l], b.c[l], b.bound[l])


@formula
def show(b, l, out, i):
    out[i], out[i + 1] = coordinates.angular_velocity(
        b.m11[l], b.m12[l], b.m21[l], b.m22[l],
        b.rest1[l], b.rest2[l], b.scale[l], b.X[l], b.Z[l],
    )  # fmt: skip


@formula
def cause(b, l):
    d, regular = canonical_map.denominator(b.X[l], b.Z[l], b.c[l])
    return codes.SINGULAR if np.isfinite(d) and not regular else codes.NONFINITE


@formula
def settle(b, l, rounds):
    X = b.X[l]
    if rounds:
        b.X[l] = canonical_map.without_negligible(X, b.Z[l], b.c[l])
    return 1 if canonical_map.has_subnormal_square(X) else 0
