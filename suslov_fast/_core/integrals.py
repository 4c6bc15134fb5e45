"""What the 3D flow and the 3D map conserve."""

import numpy as np

from .jit import formula


@formula
def energy(I1, I2, omega1, omega2):
    """The energy, conserved by equation (s1)."""
    return 0.5 * (I1 * omega1 * omega1 + I2 * omega2 * omega2)


@formula
def first_integral(I1, I2, X, omega1, omega2):
    """F of Lemma 1, equation (i1), divided above and below by I1 I2."""
    return (omega1 * (omega1 / I2) + omega2 * (omega2 / I1)) / (4.0 + 2.0 * X * X)


@formula
def modified_energy(E, X):
    """2 I1 I2 F, from the energy."""
    return E / (1.0 + 0.5 * X * X)


@formula
def level(X, Y):
    """T = sqrt((X**2 + 2 Y**2) / (2 + X**2)) = |eps| sqrt(h / (I1 I2)), conserved by the map."""
    X_over_root2 = X * np.sqrt(0.5)
    return np.hypot(X_over_root2, Y) / np.hypot(1.0, X_over_root2)
