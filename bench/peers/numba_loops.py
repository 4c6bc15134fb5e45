"""Numba: loops over trajectories as one writes them, and blocks of them, which become vectors."""

import functools

import formulas
import numba
import numpy as np
from formulas import Formulas

LANES, MAP = 64, Formulas()
_step = numba.njit(formulas.step_as_printed)
_advance = numba.njit(error_model="numpy")(formulas.advance)


@numba.njit(parallel=True, cache=True)
def final(omega0, steps):
    """Last states by the map as printed."""
    final = np.empty_like(omega0)
    for i in numba.prange(len(omega0)):
        p, q = omega0[i]
        for _ in range(steps):
            p, q = _step(p, q)
        final[i] = p, q
    return final


@functools.cache
def _loop_of(f):
    """Return the loop over orbits of a map f."""
    f = numba.njit(error_model="numpy")(f)

    @numba.njit(parallel=True, error_model="numpy")
    def last(x, steps):
        out = np.empty_like(x)
        for k in numba.prange(len(x)):
            a, b = x[k]
            for _ in range(steps):
                a, b = f((a, b))
            out[k] = a, b
        return out

    return last


def own_map(f, x, steps):
    """Last states by a map of one's own."""
    return _loop_of(f)(x, steps)


@numba.njit(error_model="numpy", cache=True)
def _one_by_one(X, Y, steps, to_omega, out):
    (a, c), (b, d) = to_omega
    for i in range(len(X)):
        x, y = X[i], Y[i]
        for n in range(steps + 1):
            out[n, i, 0] = a * x + b * y
            out[n, i, 1] = c * x + d * y
            x, y = _advance(x, y)
            if abs(x) < 1e-290:  # numbers that lose digits as they decay are slow
                x = 0.0


def one_by_one(omega0, steps, every, out):
    """All states by the parameter-free map, one trajectory after the other."""
    to_omega = MAP.leave(1.0, 0.0), MAP.leave(0.0, 1.0)
    _one_by_one(*MAP.enter(*omega0.T), steps, to_omega, out)
    return out


@numba.njit(parallel=True, error_model="numpy", cache=True)
def _in_blocks(X, Y, steps):
    for block in numba.prange((len(X) + LANES - 1) // LANES):
        part = slice(block * LANES, (block + 1) * LANES)
        x, y = X[part].copy(), Y[part].copy()
        for _ in range(steps):
            for l in range(len(x)):
                x[l], y[l] = _advance(x[l], y[l])
        X[part], Y[part] = x, y


def in_blocks(omega0, steps):
    """Last states by the parameter-free map."""
    states = MAP.enter(*omega0.T)
    _in_blocks(*states, steps)
    return np.stack(MAP.leave(*states), axis=-1)
