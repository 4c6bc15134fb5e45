"""Equations that tests of several rooms take."""

from suslov_fast import QuadraticField


def lorenz(x, rho=28):
    return 10 * (x[1] - x[0]), x[0] * (rho - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]


def henon_heiles(x):
    """A Hamiltonian, of two coordinates and their momenta."""
    return (x[2] ** 2 + x[3] ** 2 + x[0] ** 2 + x[1] ** 2) / 2 + x[0] ** 2 * x[1] - x[1] ** 3 / 3


LORENZ = QuadraticField.from_function(lorenz, 3)
HENON_HEILES = QuadraticField.from_hamiltonian(henon_heiles, 4)
