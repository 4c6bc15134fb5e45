"""Kahan's map of two quadratic fields: NumPy for any of them, and C written for each."""

import numpy as np
from native import call
from numba import get_num_threads
from problem import EPS_FIELD as EPS


def in_numpy(field, x, steps):
    """The batched solver of NumPy; fields without a constant."""
    linear, D = np.asarray(field.linear, float), x.shape[1]
    table = np.asarray(field.quadratic, float).reshape(D * D, D).T
    for _ in range(steps):
        half = (x @ table).reshape(-1, D, D)  # of the derivative of the quadratic part
        f = (half + linear) @ x[..., np.newaxis]
        x = x + EPS * np.linalg.solve(np.eye(D) - EPS * (half + linear / 2), f)[..., 0]
    return x


def in_c(field, x, steps):
    """The Lorenz system written out; elimination for the chain."""
    final, (batch, D) = np.empty_like(x), x.shape
    name, sizes = ("lorenz", (batch,)) if D == 3 else ("volterra", (batch, D))
    call("peers/fields.c", name, x, final, *sizes, int(steps), EPS, get_num_threads())
    return final
