"""The n-dimensional map, one component at a time.

p = I.omega; square = |omega|**2; J_i = I_ii + I_nn; I_i = I_in; d_i = J_i - (eps/2) p; delta =
omega_next - omega.
"""

from .._jit import formula, select
from .elementary import smaller

# The O(n) step loses less than two digits where all |d_i| / J_i are above this, and the determinant
# of its two equations is above the square of this in units of its terms.
FAR_FROM_0 = 0.25
# A step is small if eps |I| |omega| / min J is below this, which limits cancellation between omega
# and its increment.
SMALL_STEP = 64.0
# A unit remains valid while |omega|**2 lies between the inverse of this and this: products of four
# components are in range.
SPREAD = 2.0**200
# Bound of |omega| below which states are finite.
LARGEST_NORM = 2.0**1023


@formula
def matrix_row(J_i, I_i, omega_i, eps):
    """Return c and g for which A_ij = delta_ij (1 - eps p / (2 J_i)) - c omega_j - g I_j.

    A = Id - (eps/2) f'(omega) is diagonal plus rank two, and A(omega) omega_next = omega.
    """
    return -eps * I_i / J_i, 0.5 * eps * omega_i / J_i


@formula
def slope_of_itself(J_i, others, eps):
    """Return 1 - A_ii of `matrix_row` without the terms of component i, whose sum is 0.

    others = p - I_i omega_i, without cancellation.
    """
    return 0.5 * eps * others / J_i


@formula
def sum_terms(J_i, I_i, omega_i, half):
    """Return 1 / d_i, and the terms of component i in the sums of `solve2`; half = eps p / 2."""
    inverse = 1.0 / (J_i - half)
    along = I_i * inverse
    return inverse, along * omega_i, along * I_i, omega_i * inverse * omega_i


@formula
def next_component(I_i, omega_i, inverse, of_omega, of_I):
    """Return component i of the next state, from 1 / d_i and the factors of `solve2`."""
    return omega_i + (of_omega * omega_i - of_I * I_i) * inverse


@formula
def solve2(eps, p, square, alpha, beta, gamma):
    """Solve the two equations of the rank-two form for I.delta and omega.delta.

    alpha = sum I omega / d, beta = sum I**2 / d, gamma = sum omega**2 / d. Returns the factors of
    omega_i / d_i and -I_i / d_i in delta_i, and |det| with the size of the terms it consists of.
    """
    h = 0.5 * eps
    a11, a12, b1 = 1.0 - h * alpha, eps * beta, eps * (p * alpha - square * beta)
    a21, a22, b2 = -h * gamma, 1.0 + eps * alpha, eps * (p * gamma - square * alpha)
    det = a11 * a22 - a12 * a21
    size = (1.0 + abs(h * alpha)) * (1.0 + abs(eps * alpha)) + abs(a12 * a21)
    r = 1.0 / det
    I_delta, omega_delta = (a22 * b1 - a12 * b2) * r, (a11 * b2 - a21 * b1) * r
    return h * (2.0 * p + I_delta), eps * (square + omega_delta), abs(det), size


@formula
def bounds(reach, eps, largest, unit):
    """Bounds of |omega|**2: the upper one of small steps, and both of a valid unit.

    reach = SMALL_STEP min J / |I|; largest = max |omega_i|; any unit is valid if omega = 0.
    """
    longest, finite = reach / eps, LARGEST_NORM / unit
    low = select(largest > 0.0, 1.0 / SPREAD, -1.0)
    return longest * longest, low, smaller(finite * finite, SPREAD)
