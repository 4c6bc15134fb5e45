"""The continuous problem of both bodies in three dimensions, and the reaction of its constraint.

A formula gets a problem in the units of `units`; k = 0 is the body without a rotor.
"""

from .._jit import formula
from .coordinates import dimensionless, rotor, sum_of_products
from .linearised import denominator


@formula
def vector_field(I1, I2, I13, I23, k, eps, omega1, omega2):
    """Derivatives of Omega1 and Omega2, from equation (2): -l Omega2 / I1 and l Omega1 / I2."""
    l = rotor(I13, I23, k, omega1, omega2)
    return -omega2 * l / I1, omega1 * l / I2


@formula
def reaction(I1, I2, I13, I23, k, eps, omega1, omega2):
    """The terms l' and (I1 - I2) Omega1 Omega2 of equation (2), whose difference the multiplier is.

    l' = I13 Omega1' + I23 Omega2', with l as a factor.
    """
    l = rotor(I13, I23, k, omega1, omega2)
    return l * (I23 * omega1 / I2 - I13 * omega2 / I1), (I1 - I2) * (omega1 * omega2)


@formula
def discrete_reaction(I1, I2, I13, I23, k, eps, omega1, omega2):
    """Terms of equation (4), as those above: (l_next - l) / eps and
    (I1 - I2) (Omega1 Omega2_next + Omega1_next Omega2) / 2.

    Both are rational functions of the state with the denominator of the next state, and in these
    no terms cancel that do not cancel in the result.
    """
    X, Y, lost, K = dimensionless(I1, I2, I13, I23, k, eps, omega1, omega2)
    D = denominator(X, Y, lost, K)
    a, half = I1 * I2, 0.5 * eps
    l, x = rotor(I13, I23, k, omega1, omega2), sum_of_products(I13, omega1, I23, omega2)
    y = sum_of_products(I23 * I1, omega1, -I13 * I2, omega2)
    slope = l * ((y - half * l * x) / a) / D
    of_1 = I1 * omega1 * omega1 * (I13 * omega1 + k)
    of_2 = I2 * omega2 * omega2 * (I23 * omega2 + k)
    mean = (omega1 * omega2 * (1.0 - 0.5 * K * X) + half * (of_1 - of_2) / a) / D
    return slope, (I1 - I2) * mean
