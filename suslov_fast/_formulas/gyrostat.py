"""The Suslov gyrostat: a body with a rotor of constant momentum k along the constrained axis.

With l = I13 Omega1 + I23 Omega2 + k its equations are I1 Omega1' = -l Omega2 and
I2 Omega2' = l Omega1. The discrete equations have polarised products as in equation
(4) of the paper, and k (Omega_i + Omega_i_next) / 2 for k Omega_i. With h = eps / 2, L = h l,
K = h k and Y = h (I23 Omega1 / I2 - I13 Omega2 / I1) they give

L_next = L (1 + Y + K L / (I1 I2)) / (1 - Y + L (2 L - K) / (I1 I2)),
Y_next = Y - (2 L L_next - K (L + L_next)) / (I1 I2),

and, given L_next, two linear equations for Omega_next, whose determinant 1 + L**2 / (I1 I2) has no
zero. So l is accurate near the steady states l = 0, and the poles are those of the first line.

Y is stored as Z = c - Y as in `canonical_map`. M, P, Q, E and W are logarithms of the units of the
moments, the products of inertia, k, eps and the state.
"""

import numpy as np

from .._jit import formula, select, two_product
from .canonical_map import ZERO_TO_ROUNDING, shifted
from .coordinates import canonical_body, canonical_state, two_sum
from .elementary import exponent, larger, scaled, smaller, two_to_the
from .integrals import density, integral
from .units import fraction, normal_body, normal_state

# Longer steps are replaced by this power of two in the unit of the motion: products are then in
# range, and the next state is the same to rounding.
LONGEST = 400.0


@formula
def normal_gyrostat(I1, I2, I13, I23, k, eps):
    """A body and a step size in units of powers of two, and the logarithms of the units."""
    I1, I2, I13, I23, eps, M, P, E = normal_body(I1, I2, I13, I23, eps)
    P = select((I13 == 0.0) & (I23 == 0.0), -1e4, P)
    Q = select(k == 0.0, -1e4, exponent(k))
    return I1, I2, I13, I23, k * two_to_the(-exponent(k)), eps, M, P, Q, E


@formula
def with_rotor(I13, I23, k, P, Q, W, omega1, omega2):
    """l, to a few ulps despite cancellation, and the logarithm of its unit; then I13, I23 and
    k in that unit.
    """
    unit = larger(P + W, Q)
    of_products, of_k = fraction(P + W - unit), fraction(Q - unit)
    I13, I23, k = I13 * of_products, I23 * of_products, k * of_k
    p1, lost1 = two_product(I13, omega1)
    p2, lost2 = two_product(I23, omega2)
    x, lost = two_sum(p1, p2)
    total, more = two_sum(x, k)
    return total + (more + (lost + (lost1 + lost2))), unit, I13, I23, k


@formula
def vector_field(I1, I2, I13, I23, k, eps, M, P, Q, E, omega1, omega2):
    """Derivatives of Omega1 and Omega2."""
    omega1, omega2, W = normal_state(omega1, omega2)
    l, unit, _, _, _ = with_rotor(I13, I23, k, P, Q, W, omega1, omega2)
    return scaled(-omega2 * l / I1, unit + W - M), scaled(omega1 * l / I2, unit + W - M)


@formula
def first_integral(I1, I2, I13, I23, k, eps, M, P, Q, E, omega1, omega2):
    """F = (I1 Omega1**2 + I2 Omega2**2) / (4 I1 I2 + eps**2 l**2)."""
    omega1, omega2, W = normal_state(omega1, omega2)
    l, unit, _, _, _ = with_rotor(I13, I23, k, P, Q, W, omega1, omega2)
    return integral(I1, I2, eps, M, E, W, omega1, omega2, l, unit)


@formula
def invariant_density(I1, I2, I13, I23, k, eps, M, P, Q, E, omega1, omega2):
    """Density 1 / (l (4 I1 I2 + eps**2 l**2)) of the invariant measure."""
    omega1, omega2, W = normal_state(omega1, omega2)
    l, unit, _, _, _ = with_rotor(I13, I23, k, P, Q, W, omega1, omega2)
    return density(I1, I2, eps, M, E, l, unit)


@formula
def enter(I1, I2, I13, I23, k, eps, M, P, Q, E, omega1, omega2):
    """Constants 1 / I1, 1 / I2, K and c of an orbit, its state (L, Z, Omega1, Omega2) with Omega in
    the unit 2**W, and h I13, h I23 and W.
    """
    omega1, omega2, W = normal_state(omega1, omega2)
    l, unit, I13, I23, k = with_rotor(I13, I23, k, P, Q, W, omega1, omega2)
    step = scaled(eps, smaller(E + unit - M, LONGEST))
    _, Y, lost = canonical_state(I13, I23, *canonical_body(I1, I2, I13, I23), step, omega1, omega2)
    c, Z = shifted(Y, lost)
    h = 0.5 * step
    return 1.0 / I1, 1.0 / I2, h * k, c, h * l, Z, omega1, omega2, h * I13, h * I23, W


@formula
def denominator(b1, b2, K, c, L, Z):
    """Denominator of L_next; NaN if it is 0 to rounding."""
    first, second = (1.0 - c) + Z, (b1 * L) * (b2 * (2.0 * L - K))
    size = abs(first) + (b1 * abs(L)) * (b2 * (2.0 * abs(L) + abs(K)))
    d = first + second
    return select(abs(d) > ZERO_TO_ROUNDING * size, d, np.nan)


@formula
def step(b1, b2, K, c, L, Z, omega1, omega2):
    """Next state (L, Z, Omega1, Omega2); NaN if there is none."""
    below = denominator(b1, b2, K, c, L, Z)
    p, q, u = b1 * L, b2 * L, (b1 * L) * (b2 * K)
    next_L = L * (((1.0 + c) - Z + u) / below)
    # c - Y_next as one quotient: the two terms of Y_next cancel where L or K is large.
    next_Z = (Z * ((1.0 - c) + Z - u) + 2.0 * ((1.0 + c) * (p * q) - u)) / below
    # The second equation inserted into the first.
    next_p, next_q = b1 * next_L, b2 * next_L
    inverse = 1.0 / (1.0 + p * q)
    right1, right2 = omega1 - next_p * omega2, omega2 + next_q * omega1
    return next_L, next_Z, (right1 - p * right2) * inverse, (right2 + q * right1) * inverse


@formula
def jacobian(I1, I2, I13, I23, k, eps, M, P, Q, E, omega1, omega2):
    """Entries (11, 12, 21, 22) of A(omega; eps)**-1 A(omega_next; -eps), A = Id - h f'."""
    b1, b2, K, c, L, Z, omega1, omega2, h13, h23, _ = enter(
        I1, I2, I13, I23, k, eps, M, P, Q, E, omega1, omega2
    )
    next_L, _, next1, next2 = step(b1, b2, K, c, L, Z, omega1, omega2)
    inverse = 1.0 / denominator(b1, b2, K, c, L, Z)  # of det A
    a11, a12 = 1.0 + b1 * h13 * omega2, b1 * (L + h23 * omega2)
    a21, a22 = -b2 * (L + h13 * omega1), 1.0 - b2 * h23 * omega1
    r11, r12 = 1.0 - b1 * h13 * next2, -b1 * (next_L + h23 * next2)
    r21, r22 = b2 * (next_L + h13 * next1), 1.0 + b2 * h23 * next1
    return (
        (a22 * r11 - a12 * r21) * inverse,
        (a22 * r12 - a12 * r22) * inverse,
        (a11 * r21 - a21 * r11) * inverse,
        (a11 * r22 - a21 * r12) * inverse,
    )
