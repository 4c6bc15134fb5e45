"""The three-component scheme, equation (3) of the paper, in which Omega3 need not vanish."""

from collections import namedtuple

import numpy as np

from .._formulas.coordinates import ZERO_TO_ROUNDING, sum_of_products
from .._formulas.elementary import exponent, larger, scaled, two_to_the
from .._formulas.units import LOG_OF_ZERO, bound_in
from .._jit import formula, select
from . import codes
from .lanes import body_at, entry

D = 3

# omega in a unit.
State = namedtuple("State", "omega1 omega2 omega3")
# `_coefficients` of two equations; half the step size, or any for a step of 0, whose exponent is in
# these; the unit of states, and their bound.
Constants = namedtuple("Constants", "one1 a1 b1 d1 t1 i1 one2 a2 b2 d2 t2 i2 h unit bound")


@formula
def _exponent_or_none(v):
    return select(v == 0.0, LOG_OF_ZERO, exponent(v))


@formula
def _coefficients(moment, I13, I23, gyration, twice, I3, H):
    """The moment of inertia, I13 2**H, I23 2**H, gyration 2**H, twice and I3, all in one unit, a
    power of two in which none but I3 is above 2.

    They have no rounding errors, which would differ in the two equations.
    """
    quadratic = larger(_exponent_or_none(I13), _exponent_or_none(I23))
    quadratic = larger(quadratic, _exponent_or_none(gyration)) + H
    unit = -larger(larger(exponent(moment), _exponent_or_none(twice)), quadratic)
    of_products = H + unit
    return (
        scaled(moment, unit),
        scaled(I13, of_products),
        scaled(I23, of_products),
        scaled(gyration, of_products),
        scaled(twice, unit),
        scaled(I3, unit),
    )


@formula
def enter(parameters, omega, i):
    I1, I2, I13, I23, eps = body_at(parameters[:5], i)
    I3, omega1, omega2, omega3 = entry(parameters[5], i), omega[i, 0], omega[i, 1], omega[i, 2]
    W, E = exponent(larger(larger(abs(omega1), abs(omega2)), abs(omega3))), exponent(eps)
    unknown, unit = omega1 + omega2 + omega3 != omega1 + omega2 + omega3, two_to_the(W)
    h = select(eps == 0.0, 1.0, 0.5 * (eps * two_to_the(-E)))
    H = select(eps == 0.0, LOG_OF_ZERO, E + W)
    inverse = two_to_the(-W)
    one1, a1, b1, d1, t1, i1 = _coefficients(I1, I13, I23, I3 - I2, 2.0 * I13, I3, H)
    one2, a2, b2, d2, t2, i2 = _coefficients(I2, I13, I23, I1 - I3, 2.0 * I23, I3, H)
    state = State(select(unknown, np.nan, omega1 * inverse), omega2 * inverse, omega3 * inverse)
    constants = Constants(
        one1, a1, b1, d1, t1, i1, one2, a2, b2, d2, t2, i2, h, unit, bound_in(unit)
    )
    return select(unknown, codes.NONFINITE, codes.OK), True, state, constants


@formula
def _solutions(k, s):
    """Determinant of the equations for h Omega1 and h Omega2, NaN where it is zero to rounding, and
    the products of it and the two solutions.

    omega stands for h omega here. With x1 = a1 omega1 + b1 omega2, which nearly vanishes next to
    the steady states, the matrix is
    (one1 + a1 omega2, x1 + b1 omega2 + d1 omega3; -x2 - a2 omega1 + d2 omega3, one2 - b2 omega1).
    Terms that cancel are left out: in the determinant, products of a, b, omega1 and omega2 add up
    to 2 x1 x2; in the solutions those of one2 d1 and of one1 d2 leave terms in I3, i1 and i2.
    """
    omega1, omega2, omega3 = k.h * s.omega1, k.h * s.omega2, k.h * s.omega3
    x1 = sum_of_products(k.a1, omega1, k.b1, omega2)
    x2 = sum_of_products(k.a2, omega1, k.b2, omega2)
    c1, c2, m12, m21 = k.a1 * omega2, -k.b2 * omega1, x1 + k.b1 * omega2, x2 + k.a2 * omega1
    turn1, turn2 = k.d1 * omega3, k.d2 * omega3
    both = k.one1 * k.one2
    first, second, third = k.one1 * c2, k.one2 * c1, 2.0 * x1 * x2
    fourth, fifth, sixth = turn1 * m21, turn2 * m12, turn1 * turn2
    det = (both + (first + second)) + (third + ((fourth - fifth) - sixth))
    # What a rounding error of the state changes, in units of it.
    size1 = abs(k.a1 * omega1) + abs(k.b1 * omega2)
    size2 = abs(k.a2 * omega1) + abs(k.b2 * omega2)
    size = both + (abs(first) + abs(second)) + abs(sixth)
    size += 2.0 * (abs(x1) * size2 + abs(turn1) * size2 + abs(turn2) * size1)
    still1 = k.one1 * omega1 + k.t1 * omega3
    still2 = k.one2 * omega2 + k.t2 * omega3
    rest1 = omega3 * (k.d1 * omega2 - 2.0 * k.b1 * omega3)
    rest2 = omega3 * (k.d2 * omega1 + 2.0 * k.a2 * omega3)
    right1, right2, square = still1 + rest1, still2 + rest2, 2.0 * (omega3 * omega3)
    above1 = (k.one2 * still1 - k.b1 * k.i2 * square) - turn1 * rest2
    above2 = (k.one1 * still2 + k.a2 * k.i1 * square) - turn2 * rest1
    above1, above2 = above1 + (c2 * right1 - m12 * right2), above2 + (c1 * right2 + m21 * right1)
    return select(abs(det) > ZERO_TO_ROUNDING * size, det, np.nan), above1, above2


@formula
def advance(k, s):
    """Omega3 changes sign, and Omega1 and Omega2 solve two linear equations."""
    det, above1, above2 = _solutions(k, s)
    next1, next2 = above1 / (k.h * det), above2 / (k.h * det)
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
    det, above1, above2 = _solutions(k, s)
    in_range = np.isfinite(above1) and np.isfinite(above2)
    return codes.SINGULAR if np.isnan(det) and in_range else codes.NONFINITE
