"""Numba: straightforward `prange` over trajectories, and blocks of them, which become vectors."""

import formulas
import numba
import numpy as np
from formulas import Formulas

LANES = 64
_step = numba.njit(formulas.step_as_printed)


@numba.njit(parallel=True, cache=True)
def final(omega0, steps, threads):
    """Last states by the map as printed."""
    final = np.empty_like(omega0)
    for i in numba.prange(len(omega0)):
        p, q = omega0[i]
        for _ in range(steps):
            p, q = _step(p, q)
        final[i] = p, q
    return final


@numba.njit(parallel=True, cache=True)
def _stored(omega0, steps, out):
    for i in numba.prange(len(omega0)):
        p, q = omega0[i]
        out[i, 0] = p, q
        for n in range(steps):
            p, q = _step(p, q)
            out[i, n + 1] = p, q


def stored(omega0, steps, threads, out):
    """All states into (batch, steps + 1, 2), the faster order for this loop."""
    out = out.reshape(len(omega0), steps + 1, 2)
    _stored(omega0, steps, out)
    return out.swapaxes(0, 1)


@numba.njit(parallel=True, error_model="numpy", cache=True)
def _in_blocks(X, Y, steps):
    for block in numba.prange((len(X) + LANES - 1) // LANES):
        part = slice(block * LANES, (block + 1) * LANES)
        x, y = X[part].copy(), Y[part].copy()
        for _ in range(steps):
            for l in range(len(x)):
                after = x[l] * (1.0 + y[l]) / (1.0 - y[l] + x[l] * x[l])
                y[l] -= x[l] * after
                x[l] = after
        X[part], Y[part] = x, y


def in_blocks(omega0, steps, threads):
    """Last states by the parameter-free map."""
    states = Formulas().enter(*omega0.T)
    _in_blocks(*states, steps)
    return np.stack(Formulas().leave(*states), axis=-1)
