"""Equations that tests of several rooms take."""

import numpy as np

from suslov_fast import Field, QuadraticField


def lorenz(x, rho=28):
    return 10 * (x[1] - x[0]), x[0] * (rho - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]


def henon_heiles(x):
    """A Hamiltonian, of two coordinates and their momenta."""
    return (x[2] ** 2 + x[3] ** 2 + x[0] ** 2 + x[1] ** 2) / 2 + x[0] ** 2 * x[1] - x[1] ** 3 / 3


def field(f, names="x t", **parameters):
    return Field.from_function(f, names, **parameters)


LORENZ = QuadraticField.from_function(lorenz, 3)
HENON_HEILES = QuadraticField.from_hamiltonian(henon_heiles, 4)
FRICTION = Field.from_function(lambda s, mu: (s[1], -s[0] - mu * np.sign(s[1])), "x v", mu=0.15)
# A ball that falls on a spring.
SPRING = Field.from_function(lambda s: (s[1], -9.81 - np.where(s[0] < 0, 1000 * s[0], 0.0)), "h v")
