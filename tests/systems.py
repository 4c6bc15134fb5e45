"""Equations that tests of several rooms take."""

import numpy as np

from suslov_fast import Field, QuadraticField


def lorenz(x, rho=28):
    return 10 * (x[1] - x[0]), x[0] * (rho - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]


def henon_heiles(x):
    """A Hamiltonian, of two coordinates and their momenta."""
    return (x[2] ** 2 + x[3] ** 2 + x[0] ** 2 + x[1] ** 2) / 2 + x[0] ** 2 * x[1] - x[1] ** 3 / 3


def rates_of_henon_heiles(s, a=1.0):
    x, y, p, q = s
    return p, q, -x - 2 * a * x * y, -y - a * (x * x - y * y)


def robertson(s):
    x, y, z = s
    a, b, c = 0.04 * x, 1e4 * y * z, 3e7 * y * y
    return b - a, a - b - c, c


def three_bodies(s, mu):
    """The restricted three-body problem in space: positions, then velocities."""
    x, y, z, u, v, w = s
    a, b = x + mu, x + mu - 1
    r1, r2 = (a * a + y * y + z * z) ** 1.5, (b * b + y * y + z * z) ** 1.5
    return (
        u,
        v,
        w,
        2 * v + x - (1 - mu) * a / r1 - mu * b / r2,
        -2 * u + y - (1 - mu) * y / r1 - mu * y / r2,
        -(1 - mu) * z / r1 - mu * z / r2,
    )


def field(f, names="x t", **parameters):
    return Field.from_function(f, names, **parameters)


LORENZ = QuadraticField.from_function(lorenz, 3)
HENON_HEILES = QuadraticField.from_hamiltonian(henon_heiles, 4)
# Two populations. By DOP853 those that start from (0.05, 0.05) stay between 5e-4 and 48.
PREY = QuadraticField.from_function(
    lambda x: (x[0] * x[1] - 5 * x[0], -x[0] * x[1] + 4 * x[1]), "x y"
)
FRICTION = Field.from_function(lambda s, mu: (s[1], -s[0] - mu * np.sign(s[1])), "x v", mu=0.15)
# A ball that falls on a spring.
SPRING = Field.from_function(lambda s: (s[1], -9.81 - np.where(s[0] < 0, 1000 * s[0], 0.0)), "h v")
