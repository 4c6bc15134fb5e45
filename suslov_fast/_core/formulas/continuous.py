"""The continuous problem in 3D, equation (s1), and the reaction of its constraint."""

from ..jit import formula
from .coordinates import sum_of_products


@formula
def vector_field(I1, I2, I13, I23, omega1, omega2):
    """Equation (s1) solved for the derivatives of Omega1 and Omega2."""
    x = sum_of_products(I13, omega1, I23, omega2)
    return -omega2 * x / I1, omega1 * x / I2


@formula
def reaction(I1, I2, I13, I23, omega1, omega2, next1, next2):
    """The multiplier of (s1), made discrete as its other terms are; for next = omega it is (s1)'s.

    The difference quotient of x = I13 Omega1 + I23 Omega2 is taken by equation (xy1), whose right
    side neither cancels nor is divided by eps.
    """
    x = sum_of_products(I13, omega1, I23, omega2)
    x_next = sum_of_products(I13, next1, I23, next2)
    slope1 = -0.5 * (next2 * x + omega2 * x_next) / I1
    slope2 = 0.5 * (next1 * x + omega1 * x_next) / I2
    return I13 * slope1 + I23 * slope2 - 0.5 * (I1 - I2) * (omega1 * next2 + next1 * omega2)
