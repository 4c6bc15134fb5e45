"""Straightforward Numba: `prange` over trajectories."""

import formulas
import numba
import numpy as np

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
