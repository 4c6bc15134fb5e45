"""Test by the implicit equations that one state is the image of another.

These are equation (15) of the paper. Equation (4) is the case J = (I1, I2) and
I = (I23, -I13) in the components (Omega1, Omega2). A rotor adds a term.
"""

from .._jit import formula, select

# A state is the image of another if the residual is below this part of the step between them,
# which is above rounding and below the residual of any other method or step size,
OF_THE_STEP = 1e-6
# plus this part of the terms: steps near poles lose these digits.
OF_THE_TERMS = 1e-10
# States larger than this or smaller than its inverse are first scaled to the order of 1.
OUT_OF_RANGE = 2.0**300


@formula
def rotor_term(j, k, other, next_other):
    """Component j of the rotor's term on the right side, divided by eps."""
    mean = 0.5 * k * (other + next_other)
    return -mean if j == 0 else mean


@formula
def mismatch(h_i, I_i, omega_i, next_i, p, p_next, product, rotor_i):
    """Component i of equation (15) over J_i: its residual, the step, and the size of its terms.

    h_i = eps / J_i, p = I.omega, p_next = I.omega_next and product = omega.omega_next.
    """
    step = next_i - omega_i
    first, second = 0.5 * h_i * p * next_i, 0.5 * h_i * p_next * omega_i
    across = h_i * (I_i * product - rotor_i)
    size = abs(omega_i) + abs(next_i) + abs(first) + abs(second) + abs(across)
    return abs(step - (first + second) + across), abs(step), size


@formula
def unit_of(largest):
    """Scale factor for states whose largest component is `largest`."""
    return select(1.0 / OUT_OF_RANGE < largest < OUT_OF_RANGE, 1.0, 1.0 / (largest + 1e-307))


@formula
def strays(left, step, size):
    """Test that a state is not the image, by sums over all components; False if one is NaN."""
    return left > OF_THE_STEP * step + OF_THE_TERMS * size
