"""The three-component scheme, in which Omega3 may be nonzero, a module for `iterate`."""

from typing import NamedTuple

import numpy as np

from .._formulas.elementary import exponent, larger, two_to_the
from .._formulas.full_map import Coefficients, full_coefficients, full_matrix, full_step
from .._jit import carray, formula, select, stack
from . import codes
from .blocks import LARGEST
from .lanes import LANES, body_at, entry, row

D, STATE = 3, 3
_STATE = STATE * LANES


class Block(NamedTuple):
    """A block of trajectories: states in a unit, coefficients by name, a bound of the states."""

    state: object
    omega1: object
    omega2: object
    omega3: object
    of: Coefficients
    bound: object
    unit: object


@formula
def block():
    state = carray(stack(_STATE), (STATE, LANES))
    of = Coefficients(
        row(), row(), row(), row(), row(), row(), row(), row(), row(), row()
    )  # fmt: skip
    return Block(state, state[0], state[1], state[2], of, row(), row())


@formula
def coefficients_at(b, l):
    k = b.of
    return Coefficients(
        k.one1[l], k.k1[l], k.k3[l], k.k5[l], k.k7[l],
        k.one2[l], k.k2[l], k.k4[l], k.k6[l], k.k8[l],
    )  # fmt: skip


@formula
def enter(parameters, omega, i, b, l):
    I1, I2, I13, I23, eps = body_at(parameters[:5], i)
    omega1, omega2, omega3 = omega[i, 0], omega[i, 1], omega[i, 2]
    W = exponent(larger(larger(abs(omega1), abs(omega2)), abs(omega3)))
    k, of = full_coefficients(I1, I2, I13, I23, eps, entry(parameters[5], i), W), b.of
    of.one1[l], of.k1[l], of.k3[l], of.k5[l], of.k7[l] = k.one1, k.k1, k.k3, k.k5, k.k7
    of.one2[l], of.k2[l], of.k4[l], of.k6[l], of.k8[l] = k.one2, k.k2, k.k4, k.k6, k.k8
    unit, inverse = two_to_the(W), two_to_the(-W)
    b.bound[l], b.unit[l] = LARGEST / larger(unit, 1.0), unit
    missing = omega1 + omega2 + omega3 != omega1 + omega2 + omega3
    b.omega1[l] = select(missing, np.nan, omega1 * inverse)
    b.omega2[l], b.omega3[l] = omega2 * inverse, omega3 * inverse
    return codes.NONFINITE if missing else codes.OK, 1


@formula
def advance(b, l):
    next1, next2, next3 = full_step(coefficients_at(b, l), b.omega1[l], b.omega2[l], b.omega3[l])
    in_range = larger(abs(next1), abs(next2)) < b.bound[l]
    b.omega1[l] = select(in_range, next1, np.nan)
    b.omega2[l], b.omega3[l] = select(in_range, next2, np.nan), select(in_range, next3, np.nan)


@formula
def show(b, l, out, i):
    unit = b.unit[l]
    out[i], out[i + 1], out[i + 2] = b.omega1[l] * unit, b.omega2[l] * unit, b.omega3[l] * unit


@formula
def cause(b, l):
    k = coefficients_at(b, l)
    m11, m12, m21, m22, det = full_matrix(k, b.omega1[l], b.omega2[l], b.omega3[l])
    in_range = np.isfinite(m11 * m22) and np.isfinite(m12 * m21)
    return codes.SINGULAR if np.isnan(det) and in_range else codes.NONFINITE
