"""The three-component scheme, equation (3) of the paper, in which Omega3 need not vanish."""

from typing import NamedTuple

from .._jit import formula, select
from .canonical_map import nan_at_zero
from .elementary import exponent, larger, scaled, two_to_the
from .units import bound_in


class Coefficients(NamedTuple):
    """Coefficients of the scheme, from the body and the step size, and the unit of states.

    Each equation is divided by its own moment of inertia, and in units of a power of two in which 1
    is `one1` or `one2` and no coefficient is above 1. States below the bound are finite.
    """

    one1: float
    k1: float
    k3: float
    k5: float
    k7: float
    one2: float
    k2: float
    k4: float
    k6: float
    k8: float
    unit: float
    bound: float


@formula
def fraction(k):
    """2**k for an integer k <= 0, and 0 where that is subnormal."""
    return select(k < -1022.0, 0.0, two_to_the(larger(k, -1022.0)))


@formula
def ratio(v, w, k):
    """v / w 2**k as a number of the order of 1, or 0, and the logarithm of its unit."""
    of_v, of_w = exponent(v), exponent(w)
    return (v * two_to_the(-of_v)) / (w * two_to_the(-of_w)), k + of_v - of_w


@formula
def row(I_1, product1, product2, difference, eps, E):
    """1 and four coefficients of one equation: h I_i3 / I_1, eps I_j3 / I_1, h difference / I_1 and
    2 I_i3 / I_1, where h = eps / 2 and E is the logarithm of the unit of eps.
    """
    along, of_along = ratio(product1, I_1, 0.0)
    across, of_across = ratio(product2, I_1, E)
    turning, of_turning = ratio(difference, I_1, E - 1.0)
    # `exponent` of 0 is the least one, and is not used.
    unit = larger(larger(of_along + 1.0, of_along + E), larger(of_across, of_turning))
    unit = larger(unit + 1.0, 0.0)
    return (
        fraction(-unit),
        scaled(along * eps, of_along + E - 1.0 - unit),
        scaled(across * eps, of_across - unit),
        scaled(turning * eps, of_turning - unit),
        scaled(along, of_along + 1.0 - unit),
    )


@formula
def full_coefficients(I1, I2, I13, I23, eps, I3, W):
    """Coefficients for states in the unit 2**W."""
    E = exponent(eps)
    eps, E = eps * two_to_the(-E), E + W
    one1, k1, k3, k5, k7 = row(I1, I13, I23, I3 - I2, eps, E)
    one2, k2, k4, k6, k8 = row(I2, I23, I13, I1 - I3, eps, E)
    unit = two_to_the(W)
    return Coefficients(one1, k1, k3, k5, k7, one2, k2, k4, k6, k8, unit, bound_in(unit))


@formula
def full_matrix(k, omega1, omega2, omega3):
    """Matrix (m11, m12; m21, m22) of the equations for Omega1 and Omega2, and its determinant,
    NaN where that is zero to rounding.
    """
    k1_omega2, k2_omega1 = k.k1 * omega2, k.k2 * omega1
    m11, m22 = k.one1 + k1_omega2, k.one2 - k2_omega1
    m12 = k.k5 * omega3 + (k.k1 * omega1 + k.k3 * omega2)
    m21 = k.k6 * omega3 - (k.k2 * omega2 + k.k4 * omega1)
    # Where the determinant is 0, its two terms are equally large.
    size = (k.one1 + abs(k1_omega2)) * (k.one2 + abs(k2_omega1))
    return m11, m12, m21, m22, nan_at_zero(m11 * m22 - m12 * m21, size)


@formula
def full_step(k, omega1, omega2, omega3):
    """One step: Omega3 changes sign, and Omega1, Omega2 solve two linear equations.

    All three are NaN if there is no next state.
    """
    m11, m12, m21, m22, det = full_matrix(k, omega1, omega2, omega3)
    r1 = k.one1 * omega1 + omega3 * (k.k7 + (k.k5 * omega2 - k.k3 * omega3))
    r2 = k.one2 * omega2 + omega3 * (k.k8 + (k.k6 * omega1 + k.k4 * omega3))
    next1, next2 = (m22 * r1 - m12 * r2) / det, (m11 * r2 - m21 * r1) / det
    poison = 0.0 * next1 + 0.0 * next2
    return next1 + poison, next2 + poison, poison - omega3
