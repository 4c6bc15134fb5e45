"""The three-component scheme, in which Omega3 may be nonzero."""

import numpy as np

from .._formulas.elementary import exponent, larger, two_to_the
from .._formulas.full_map import Coefficients, full_coefficients, full_matrix, full_step
from .._jit import formula, select
from . import codes
from .iterate import LARGEST, map_kernel
from .lanes import body_at, entry

# Rows of a block: the coefficients, a bound of the state, and the unit of omega.
_BOUND, _UNIT = 10, 11


@formula
def coefficients_at(c, l):
    return Coefficients(
        c[0, l], c[1, l], c[2, l], c[3, l], c[4, l], c[5, l], c[6, l], c[7, l], c[8, l], c[9, l]
    )


@formula
def enter(parameters, omega, b, c, s, l):
    I1, I2, I13, I23, eps = body_at(parameters[:5], b)
    omega1, omega2, omega3 = omega[b, 0], omega[b, 1], omega[b, 2]
    W = exponent(larger(larger(abs(omega1), abs(omega2)), abs(omega3)))
    k = full_coefficients(I1, I2, I13, I23, eps, entry(parameters[5], b), W)
    c[0, l], c[1, l], c[2, l], c[3, l], c[4, l] = k.one1, k.k1, k.k3, k.k5, k.k7
    c[5, l], c[6, l], c[7, l], c[8, l], c[9, l] = k.one2, k.k2, k.k4, k.k6, k.k8
    unit, inverse = two_to_the(W), two_to_the(-W)
    c[_BOUND, l], c[_UNIT, l] = LARGEST / larger(unit, 1.0), unit
    missing = omega1 + omega2 + omega3 != omega1 + omega2 + omega3
    s[0, l] = select(missing, np.nan, omega1 * inverse)
    s[1, l], s[2, l] = omega2 * inverse, omega3 * inverse
    return codes.NONFINITE if missing else codes.OK, 1


@formula
def advance(c, s, l):
    next1, next2, next3 = full_step(coefficients_at(c, l), s[0, l], s[1, l], s[2, l])
    in_range = larger(abs(next1), abs(next2)) < c[_BOUND, l]
    s[0, l] = select(in_range, next1, np.nan)
    s[1, l], s[2, l] = select(in_range, next2, np.nan), select(in_range, next3, np.nan)


@formula
def show(c, s, l, out, i):
    unit = c[_UNIT, l]
    out[i], out[i + 1], out[i + 2] = s[0, l] * unit, s[1, l] * unit, s[2, l] * unit


@formula
def cause(c, s, l):
    m11, m12, m21, m22, det = full_matrix(coefficients_at(c, l), s[0, l], s[1, l], s[2, l])
    in_range = np.isfinite(m11 * m22) and np.isfinite(m12 * m21)
    return codes.SINGULAR if np.isnan(det) and in_range else codes.NONFINITE


full = map_kernel("full", 3, 3, enter, advance, show, cause)
