"""Straightforward implementations of the paper's formulas for numbers, arrays and symbols.

The peers and the references in long doubles use them. They share no code with the package.
"""

import numpy as np

BODY, EPS = (4, 1, -0.5, -0.3), 0.2  # the paper's first figure
I1, I2, I13, I23 = map(float, BODY)
K1, K2, K3, K4 = EPS * I13 / (2 * I1), EPS * I23 / (2 * I2), EPS * I23 / I1, EPS * I13 / I2


def step_as_printed(p, q):
    """One step of the map as Section 4 prints it."""
    delta = (1.0 + K1 * q) * (1.0 - K2 * p) + (K1 * p + K3 * q) * (K4 * p + K2 * q)
    return (
        (p - K2 * p * p - K1 * p * q - K3 * q * q) / delta,
        (q + K1 * q * q + K2 * p * q + K4 * p * p) / delta,
    )


def advance(X, Y):
    """One step of the parameter-free map."""
    X_next = X * (1 + Y) / (1 - Y + X * X)
    return X_next, Y - X * X_next


class Formulas:
    """Formulas for states (p, q), with the constants of the body in a given type of number."""

    def __init__(self, number=float):
        self.I1, self.I2, self.I13, self.I23, self.eps = map(number, (*BODY, EPS))
        self.a = self.I1 * self.I2
        self.D = self.I13**2 * self.I2 + self.I23**2 * self.I1
        self.sx, self.sy = self.eps / (2 * self.a) ** number(0.5), self.eps / (2 * self.a)

    def to_xy(self, p, q):
        return self.I13 * p + self.I23 * q, self.I23 * self.I1 * p - self.I13 * self.I2 * q

    def from_xy(self, x, y):
        p, q = self.I13 * self.I2 * x + self.I23 * y, self.I23 * self.I1 * x - self.I13 * y
        return p / self.D, q / self.D

    def enter(self, p, q):
        """Variables of the parameter-free map."""
        x, y = self.to_xy(p, q)
        return self.sx * x, self.sy * y

    def leave(self, X, Y):
        return self.from_xy(X / self.sx, Y / self.sy)

    def flow(self, p, q, time):
        """The continuous motion x' = xy/a, y' = -x^2, for x != 0."""
        x, y = self.to_xy(p, q)
        root = np.sqrt(self.a)
        R = np.sqrt(self.a * x * x + y * y)
        angle = R * time / self.a - np.arcsinh(y / (root * np.abs(x)))
        with np.errstate(over="ignore"):  # 1 / cosh(angle) is 0 if cosh overflows
            return self.from_xy(np.sign(x) * R / root / np.cosh(angle), -R * np.tanh(angle))

    def vector_field(self, p, q):
        x = self.I13 * p + self.I23 * q
        return -x * q / self.I1, x * p / self.I2


def matrix_nd(J, I, eps, omega):
    """Matrix A(Omega) of the map in n dimensions for each state."""
    p = (omega * I).sum(-1)[:, None, None]
    h = (eps / (2 * J))[:, None]
    rank2 = 2 * I[:, None] * omega[:, None, :] - I * omega[:, :, None]
    return h * rank2 + np.eye(len(J)) * (1 - h * p)
