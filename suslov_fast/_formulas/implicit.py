"""The implicit equations between two states, as a test that one follows the other.

These are equation (15) of the paper, of which equation (4) is a case: J = (I1, I2) and
I = (I23, -I13) in the components (Omega1, Omega2). A rotor adds a term.
"""

from .._jit import formula, select

# A state follows another if the equations hold to this part of the step between them,
# which is more than rounding and less than any other method or step size leaves,
OF_THE_STEP = 1e-6
# and to this part of their own terms: what steps near poles lose.
OF_THE_TERMS = 1e-10
# States of this size and its inverse are brought to the order of 1 first.
OUT_OF_RANGE = 2.0**300


@formula
def rotor_term(j, k, other, next_other):
    """Component j of what a rotor adds to the right side, over eps."""
    mean = 0.5 * k * (other + next_other)
    return -mean if j == 0 else mean


@formula
def mismatch(h_i, I_i, omega_i, next_i, p, p_next, product, rotor_i):
    """Component i of (dsn) over J_i: what is left of it, the step, and the size of its terms.

    h_i = eps / J_i, p = I.omega, p_next = I.omega_next and product = omega.omega_next.
    """
    step = next_i - omega_i
    first, second = 0.5 * h_i * p * next_i, 0.5 * h_i * p_next * omega_i
    across = h_i * (I_i * product - rotor_i)
    size = abs(omega_i) + abs(next_i) + abs(first) + abs(second) + abs(across)
    return abs(step - (first + second) + across), abs(step), size


@formula
def unit_of(largest):
    """The factor by which states whose largest component is this are multiplied before."""
    return select(1.0 / OUT_OF_RANGE < largest < OUT_OF_RANGE, 1.0, 1.0 / (largest + 1e-307))


@formula
def strays(left, step, size):
    """Test that a state does not follow, by sums over all components; False where one is NaN."""
    return left > OF_THE_STEP * step + OF_THE_TERMS * size
