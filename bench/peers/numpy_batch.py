"""NumPy over whole batches, step by step or by a closed form."""

import numpy as np
from formulas import Formulas, matrix_nd, step_as_printed


def final(omega0, steps):
    """Last states by the map as printed."""
    p, q = omega0.T.copy()
    for _ in range(steps):
        p, q = step_as_printed(p, q)
    return np.stack([p, q], axis=-1)


def flow(omega0, time):
    """State of the continuous motion by Suslov's solution, for x != 0."""
    return np.stack(Formulas().flow(*omega0.T, time), axis=-1)


def solve(body, omega0, eps, steps):
    """Last states in n dimensions by the batched solver."""
    omega = omega0
    for _ in range(steps):
        A = matrix_nd(body.J, body.I, eps, omega)
        omega = np.linalg.solve(A, omega[..., None])[..., 0]
    return omega
