"""The three-component scheme, in which Omega3 may be nonzero, for `blocks`."""

from typing import NamedTuple

import numpy as np

from .._formulas.elementary import exponent, larger, two_to_the
from .._formulas.full_map import Coefficients, full_coefficients, full_matrix, full_step
from .._jit import formula, select
from . import codes
from .lanes import body_at, entry

D = 3
Constants = Coefficients


class State(NamedTuple):
    """Omega in a unit."""

    omega1: float
    omega2: float
    omega3: float


@formula
def enter(parameters, omega, i):
    I1, I2, I13, I23, eps = body_at(parameters[:5], i)
    omega1, omega2, omega3 = omega[i, 0], omega[i, 1], omega[i, 2]
    W = exponent(larger(larger(abs(omega1), abs(omega2)), abs(omega3)))
    unknown, inverse = omega1 + omega2 + omega3 != omega1 + omega2 + omega3, two_to_the(-W)
    state = State(select(unknown, np.nan, omega1 * inverse), omega2 * inverse, omega3 * inverse)
    constants = full_coefficients(I1, I2, I13, I23, eps, entry(parameters[5], i), W)
    return select(unknown, codes.NONFINITE, codes.OK), True, state, constants


@formula
def advance(k, s):
    next1, next2, next3 = full_step(k, s.omega1, s.omega2, s.omega3)
    exists = larger(abs(next1), abs(next2)) < k.bound
    return (
        select(exists, next1, np.nan),
        select(exists, next2, np.nan),
        select(exists, next3, np.nan),
    )


@formula
def show(k, s):
    return s.omega1 * k.unit, s.omega2 * k.unit, s.omega3 * k.unit


@formula
def cause(k, s):
    m11, m12, m21, m22, det = full_matrix(k, s.omega1, s.omega2, s.omega3)
    in_range = np.isfinite(m11 * m22) and np.isfinite(m12 * m21)
    return codes.SINGULAR if np.isnan(det) and in_range else codes.NONFINITE
