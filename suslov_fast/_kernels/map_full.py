"""The three-component scheme, equation (3) of the paper, in which Omega3 need not vanish."""

from collections import namedtuple

import numpy as np

from .._formulas.coordinates import ZERO_TO_ROUNDING
from .._formulas.elementary import exponent, larger, scaled, two_to_the
from .._formulas.units import bound_in
from .._jit import formula, select
from . import codes
from .lanes import body_at, entry

D = 3

# omega in a unit.
State = namedtuple("State", "omega1 omega2 omega3")
# The coefficients of two equations, the unit of states, and their bound. Each equation is divided
# by its own moment of inertia, and in units of a power of two in which 1 is `one1` or `one2` and no
# coefficient is above 2.
Constants = namedtuple("Constants", "one1 k1 k3 k5 k7 one2 k2 k4 k6 k8 unit bound")


@formula
def row(I_1, product1, product2, difference, h, H):
    """1 and four coefficients of one equation: h I_i3 / I_1, 2 h I_j3 / I_1, h difference / I_1 and
    2 I_i3 / I_1, for a step of 2 h 2**H.
    """
    ratio = product1 / I_1
    along, across = scaled(h * ratio, H), scaled(2.0 * h * (product2 / I_1), H)
    turning, twice = scaled(h * (difference / I_1), H), 2.0 * ratio
    largest = larger(larger(abs(along), abs(across)), larger(abs(turning), abs(twice)))
    unit = two_to_the(-exponent(larger(largest, 1.0)))
    return unit, along * unit, across * unit, turning * unit, twice * unit


@formula
def enter(parameters, omega, i):
    I1, I2, I13, I23, eps = body_at(parameters[:5], i)
    I3, omega1, omega2, omega3 = entry(parameters[5], i), omega[i, 0], omega[i, 1], omega[i, 2]
    W, E = exponent(larger(larger(abs(omega1), abs(omega2)), abs(omega3))), exponent(eps)
    unknown, unit = omega1 + omega2 + omega3 != omega1 + omega2 + omega3, two_to_the(W)
    inverse, h = two_to_the(-W), 0.5 * eps * two_to_the(-E)
    one1, k1, k3, k5, k7 = row(I1, I13, I23, I3 - I2, h, E + W)
    one2, k2, k4, k6, k8 = row(I2, I23, I13, I1 - I3, h, E + W)
    state = State(select(unknown, np.nan, omega1 * inverse), omega2 * inverse, omega3 * inverse)
    constants = Constants(one1, k1, k3, k5, k7, one2, k2, k4, k6, k8, unit, bound_in(unit))
    return select(unknown, codes.NONFINITE, codes.OK), True, state, constants


@formula
def matrix(k, s):
    """Matrix (m11, m12; m21, m22) of the equations for Omega1 and Omega2, and its determinant,
    NaN where that is zero to rounding.
    """
    k1_omega2, k2_omega1 = k.k1 * s.omega2, k.k2 * s.omega1
    m11, m22 = k.one1 + k1_omega2, k.one2 - k2_omega1
    m12 = k.k5 * s.omega3 + (k.k1 * s.omega1 + k.k3 * s.omega2)
    m21 = k.k6 * s.omega3 - (k.k2 * s.omega2 + k.k4 * s.omega1)
    det = m11 * m22 - m12 * m21
    # Where the determinant is 0, its two terms are equally large.
    size = (k.one1 + abs(k1_omega2)) * (k.one2 + abs(k2_omega1))
    return m11, m12, m21, m22, select(abs(det) > ZERO_TO_ROUNDING * size, det, np.nan)


@formula
def advance(k, s):
    """Omega3 changes sign, and Omega1 and Omega2 solve two linear equations."""
    m11, m12, m21, m22, det = matrix(k, s)
    r1 = k.one1 * s.omega1 + s.omega3 * (k.k7 + (k.k5 * s.omega2 - k.k3 * s.omega3))
    r2 = k.one2 * s.omega2 + s.omega3 * (k.k8 + (k.k6 * s.omega1 + k.k4 * s.omega3))
    next1, next2 = (m22 * r1 - m12 * r2) / det, (m11 * r2 - m21 * r1) / det
    exists = (abs(next1) < k.bound) & (abs(next2) < k.bound)
    return (
        select(exists, next1, np.nan),
        select(exists, next2, np.nan),
        select(exists, -s.omega3, np.nan),
    )


@formula
def show(k, s):
    return s.omega1 * k.unit, s.omega2 * k.unit, s.omega3 * k.unit


@formula
def cause(k, s):
    m11, m12, m21, m22, det = matrix(k, s)
    in_range = np.isfinite(m11 * m22) and np.isfinite(m12 * m21)
    return codes.SINGULAR if np.isnan(det) and in_range else codes.NONFINITE
