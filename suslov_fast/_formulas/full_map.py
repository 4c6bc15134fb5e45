"""The three-component scheme, equation (ds), in which Omega3 need not vanish."""

from .._jit import formula
from .canonical_map import nan_at_zero


@formula
def full_coefficients(I1, I2, I13, I23, eps, I3):
    """The numbers through which the body and the step size enter (ds)."""
    h = 0.5 * eps
    return (
        h * (I13 / I1),
        h * (I23 / I2),
        eps * (I23 / I1),
        eps * (I13 / I2),
        h * ((I3 - I2) / I1),
        h * ((I1 - I3) / I2),
        2.0 * (I13 / I1),
        2.0 * (I23 / I2),
    )


@formula
def full_matrix(k1, k2, k3, k4, k5, k6, omega1, omega2, omega3):
    """The matrix (m11, m12; m21, m22) of the equations for Omega1 and Omega2, and its determinant.

    Each equation is divided by its own moment of inertia. The determinant is NaN where it is zero
    to rounding.
    """
    k1_omega2, k2_omega1 = k1 * omega2, k2 * omega1
    m11, m22 = 1.0 + k1_omega2, 1.0 - k2_omega1
    m12 = k5 * omega3 + (k1 * omega1 + k3 * omega2)
    m21 = k6 * omega3 - (k2 * omega2 + k4 * omega1)
    # Where the determinant is 0, its two terms are equally large.
    size = (1.0 + abs(k1_omega2)) * (1.0 + abs(k2_omega1))
    return m11, m12, m21, m22, nan_at_zero(m11 * m22 - m12 * m21, size)


@formula
def full_step(k1, k2, k3, k4, k5, k6, k7, k8, omega1, omega2, omega3):
    """Equation (ds): Omega3 changes sign, and Omega1, Omega2 solve two linear equations.

    NaN, all three, where there is no next state.
    """
    m11, m12, m21, m22, det = full_matrix(k1, k2, k3, k4, k5, k6, omega1, omega2, omega3)
    r1 = omega1 + omega3 * (k7 + (k5 * omega2 - k3 * omega3))
    r2 = omega2 + omega3 * (k8 + (k6 * omega1 + k4 * omega3))
    next1, next2 = (m22 * r1 - m12 * r2) / det, (m11 * r2 - m21 * r1) / det
    poison = 0.0 * next1 + 0.0 * next2
    return next1 + poison, next2 + poison, poison - omega3
