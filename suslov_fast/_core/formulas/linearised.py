"""The derivative of the 3D map."""

from ..jit import formula
from .canonical_map import nan_at_zero
from .printed_map import printed_coefficients


@formula
def jacobian(I1, I2, I13, I23, eps, omega1, omega2):
    """The entries (11, 12, 21, 22) of A(omega; eps)**-1 A(omega_next; -eps).

    A(omega; eps) is the matrix that the paper inverts above (ds2), and omega_next the solution of
    A(omega; eps) omega_next = omega.
    """
    k1, k2, k3, k4 = printed_coefficients(I1, I2, I13, I23, eps)
    a11, a12 = 1.0 + k1 * omega2, k1 * omega1 + k3 * omega2
    a21, a22 = -k4 * omega1 - k2 * omega2, 1.0 - k2 * omega1
    size = (1.0 + abs(k1 * omega2)) * (1.0 + abs(k2 * omega1)) + abs(a12 * a21)
    det = nan_at_zero(a11 * a22 - a12 * a21, size)
    next1 = (a22 * omega1 - a12 * omega2) / det
    next2 = (a11 * omega2 - a21 * omega1) / det
    b11, b12 = 1.0 - k1 * next2, -k1 * next1 - k3 * next2
    b21, b22 = k4 * next1 + k2 * next2, 1.0 + k2 * next1
    return (
        (a22 * b11 - a12 * b21) / det,
        (a22 * b12 - a12 * b22) / det,
        (a11 * b21 - a21 * b11) / det,
        (a11 * b22 - a21 * b12) / det,
    )


@formula
def multipliers(I1, I2, I13, I23, eps, c):
    """The eigenvalues of the derivative at omega = c (I23, -I13): along the line, and off it."""
    Y = 0.5 * eps * c * (I23 * I23 / I2 + I13 * I13 / I1)
    return 1.0 + 0.0 * Y, (1.0 + Y) / (1.0 - Y)
