"""One step of the three-component scheme, equation (ds), in which Omega3 need not vanish."""

from ..jit import formula
from .canonical_map import nan_at_zero


@formula
def full_step(I1, I2, I13, I23, eps, I3, omega1, omega2, omega3):
    """Equation (ds): Omega3 changes sign, and Omega1, Omega2 solve two linear equations."""
    h = 0.5 * eps
    # Each equation divided by its own moment of inertia: (m11, m12; m21, m22) omega_next = r.
    k1, k2 = h * I13 * omega2 / I1, h * I23 * omega1 / I2
    m11, m22 = 1.0 + k1, 1.0 - k2
    m12 = h * ((I3 - I2) * omega3 + I13 * omega1 + 2.0 * I23 * omega2) / I1
    m21 = h * ((I1 - I3) * omega3 - I23 * omega2 - 2.0 * I13 * omega1) / I2
    r1 = omega1 + omega3 * (2.0 * I13 + h * ((I3 - I2) * omega2 - 2.0 * I23 * omega3)) / I1
    r2 = omega2 + omega3 * (2.0 * I23 + h * ((I1 - I3) * omega1 + 2.0 * I13 * omega3)) / I2
    product = m12 * m21
    det = nan_at_zero(m11 * m22 - product, (1.0 + abs(k1)) * (1.0 + abs(k2)) + abs(product))
    return (m22 * r1 - m12 * r2) / det, (m11 * r2 - m21 * r1) / det, -omega3
