"""What the 3D flow and the 3D map conserve."""

import numpy as np

from ..jit import formula


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
    # In units in which the sums of squares are in range.
    size = abs(X) + abs(Y) + 1e-300
    above, below = 1.0 / size, 1.0 / (abs(X) + 1.0)
    X1, Y1, X2 = X * above, Y * above, X * below
    squares = (X1 * X1 + 2.0 * Y1 * Y1) / (X2 * X2 + 2.0 * below * below)
    return size * below * np.sqrt(squares)
