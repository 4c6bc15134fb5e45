"""The parameter-free map in Numba: blocks of trajectories, which become vectors."""

import numba
import numpy as np
from formulas import Formulas

LANES = 64


@numba.njit(parallel=True, error_model="numpy", cache=True)
def _iterate(X, Y, steps):
    for block in numba.prange((len(X) + LANES - 1) // LANES):
        part = slice(block * LANES, (block + 1) * LANES)
        x, y = X[part].copy(), Y[part].copy()
        for _ in range(steps):
            for l in range(len(x)):
                after = x[l] * (1.0 + y[l]) / (1.0 - y[l] + x[l] * x[l])
                y[l] -= x[l] * after
                x[l] = after
        X[part], Y[part] = x, y


def final(omega0, steps, threads):
    """Last states."""
    states = Formulas().enter(*omega0.T)
    _iterate(*states, steps)
    return np.stack(Formulas().leave(*states), axis=-1)
