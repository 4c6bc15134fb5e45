"""Quantities of states in three dimensions as one writes them in NumPy, for any kind of floats."""

from typing import Any, NamedTuple

import numpy as np


class Constants(NamedTuple):
    """The numbers of a body and a step."""

    I1: Any
    I2: Any
    I13: Any
    I23: Any
    eps: Any

    @property
    def a(self):
        """The product that the paper writes as I1 I2."""
        return self.I1 * self.I2

    @property
    def D(self):
        """The determinant of the coordinates (x, y)."""
        return self.I13**2 * self.I2 + self.I23**2 * self.I1


def energy(c, p, q):
    return (c.I1 * p**2 + c.I2 * q**2) / 2


def first_integral(c, p, q):
    return (c.I1 * p**2 + c.I2 * q**2) / (4 * c.a + c.eps**2 * (c.I13 * p + c.I23 * q) ** 2)


def modified_energy(c, p, q):
    return 2 * c.a * first_integral(c, p, q)


def criticality(c, p, q):
    return c.eps * np.sqrt(c.D / c.a * first_integral(c, p, q))


def invariant_density(c, p, q):
    x = c.I13 * p + c.I23 * q
    return 1 / (x * (4 * c.a + c.eps**2 * x**2))


def to_xy(c, p, q):
    return np.stack([c.I13 * p + c.I23 * q, c.I23 * c.I1 * p - c.I13 * c.I2 * q], axis=-1)


def from_xy(c, x, y):
    return np.stack([c.I13 * c.I2 * x + c.I23 * y, c.I23 * c.I1 * x - c.I13 * y], axis=-1) / c.D


def vector_field(c, p, q):
    x = c.I13 * p + c.I23 * q
    return np.stack([-x * q / c.I1, x * p / c.I2], axis=-1)


def reaction(c, p, q):
    x = c.I13 * p + c.I23 * q
    return -c.I13 * x * q / c.I1 + c.I23 * x * p / c.I2 - (c.I1 - c.I2) * p * q


def step(c, p, q):
    """By the parameter-free form."""
    sx, sy = c.eps / np.sqrt(2 * c.a), c.eps / (2 * c.a)
    X, Y = sx * (c.I13 * p + c.I23 * q), sy * (c.I23 * c.I1 * p - c.I13 * c.I2 * q)
    X_next = X * (1 + Y) / (1 - Y + X**2)
    return from_xy(c, X_next / sx, (Y - X * X_next) / sy)


def discrete_reaction(c, p, q):
    p_next, q_next = np.moveaxis(step(c, p, q), -1, 0)
    change = c.I13 * (p_next - p) + c.I23 * (q_next - q)
    return change / c.eps - (c.I1 - c.I2) * (p * q_next + p_next * q) / 2


def jacobian(c, p, q):
    """That of the parameter-free form, between two changes of coordinates."""
    to = np.array([[c.I13, c.I23], [c.I23 * c.I1, -c.I13 * c.I2]])
    to = to * np.array([[c.eps / np.sqrt(2 * c.a)], [c.eps / (2 * c.a)]])
    back = np.array([[to[1, 1], -to[0, 1]], [-to[1, 0], to[0, 0]]])
    back = back / (to[0, 0] * to[1, 1] - to[0, 1] * to[1, 0])
    X, Y = to[0, 0] * p + to[0, 1] * q, to[1, 0] * p + to[1, 1] * q
    d = 1 - Y + X**2
    X_next, by_X, by_Y = X * (1 + Y) / d, (1 + Y) * (1 - Y - X**2) / d**2, X * (2 + X**2) / d**2
    rows = [[by_X, by_Y], [-X_next - X * by_X, 1 - X * by_Y]]
    derivative = np.moveaxis(np.array(rows), (0, 1), (-2, -1))
    return back @ derivative @ to
