"""Test by the implicit equations that one state is the image of another.

These are equation (15) of the paper. Equation (4) is the case J = (I1, I2) and
I = (I23, -I13) in the components (Omega1, Omega2). A rotor adds a term.
"""

from .._jit import formula, select

# A state is the image of another if the residual is below this part of the step between them,
# which is above rounding and below the residual of any other method or step size,
OF_THE_STEP = 1e-6
# plus this part of the terms,
OF_THE_TERMS = 1e-10
# and, in three dimensions, this part divided by the distance to a pole: next to poles equation (5)
# and closed forms lose these digits.
NEXT_TO_POLES = 2.0**-47
# States larger than this or smaller than its inverse are first scaled to the order of 1.
OUT_OF_RANGE = 2.0**300


@formula
def rotor_term(j, k, other, next_other):
    """Component j of the rotor's term on the right side, divided by eps."""
    mean = 0.5 * k * (other + next_other)
    return -mean if j == 0 else mean


@formula
def mismatch(h_i, I_i, omega_i, next_i, sums, sizes):
    """Component i of equation (15) over J_i, the left side minus the right, and its size.

    h_i = eps / J_i; `sums` are I.omega, I.omega_next, omega.omega_next and the rotor's term, and
    `sizes` the sums of the magnitudes of their terms.
    """
    p, p_next, product, rotor = sums
    of_p, of_p_next, of_product, of_rotor = sizes
    to_next, to_omega = 0.5 * h_i * next_i, 0.5 * h_i * omega_i
    left = next_i - omega_i - (to_next * p + to_omega * p_next) + h_i * (I_i * product - rotor)
    size = abs(omega_i) + abs(next_i) + abs(to_next) * of_p + abs(to_omega) * of_p_next
    return left, size + abs(h_i) * (abs(I_i) * of_product + of_rotor)


@formula
def distance_to_pole(h1, h2, I_1, I_2, k, omega1, omega2):
    """|det A| over the sum of the magnitudes of its terms, for m = 2; 1 if it is not a number.

    A omega_next = omega + ... are the implicit equations.
    """
    minus11, minus22 = 0.5 * h1 * I_2 * omega2, 0.5 * h2 * I_1 * omega1
    a12 = h1 * (I_1 * omega2 - 0.5 * I_2 * omega1 + 0.5 * k)
    a21 = h2 * (I_2 * omega1 - 0.5 * I_1 * omega2 - 0.5 * k)
    product = a12 * a21
    size = (1.0 + abs(minus11)) * (1.0 + abs(minus22)) + abs(product)
    distance = abs((1.0 - minus11) * (1.0 - minus22) - product) / size
    return select(distance < 1.0, distance, 1.0)


@formula
def unit_of(largest):
    """Scale factor for states whose largest component is `largest`."""
    return select(1.0 / OUT_OF_RANGE < largest < OUT_OF_RANGE, 1.0, 1.0 / (largest + 1e-307))


@formula
def strays(left, step, size, distance):
    """Test that a state is not the image, by sums over all components; False if one is NaN."""
    rounding = OF_THE_TERMS * distance + NEXT_TO_POLES
    return distance * left > distance * OF_THE_STEP * step + rounding * size
