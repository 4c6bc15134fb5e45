"""Equation (ds2) as printed, for numbers, arrays and symbols."""

from problem import BODY, EPS

I1, I2, I13, I23 = map(float, BODY.parameters)
K1, K2, K3, K4 = EPS * I13 / (2 * I1), EPS * I23 / (2 * I2), EPS * I23 / I1, EPS * I13 / I2


def step(p, q):
    """The next state."""
    delta = (1.0 + K1 * q) * (1.0 - K2 * p) + (K1 * p + K3 * q) * (K4 * p + K2 * q)
    return (
        (p - K2 * p * p - K1 * p * q - K3 * q * q) / delta,
        (q + K1 * q * q + K2 * p * q + K4 * p * p) / delta,
    )


def velocity(p, q):
    """The right side of (s1): the derivatives of Omega1 and Omega2."""
    along = I13 * p + I23 * q
    return -along * q / I1, along * p / I2
