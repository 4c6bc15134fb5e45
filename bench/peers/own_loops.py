"""Loops of users over `suslov_fast.compiled`; without a cache, which Numba would not renew."""

import numba
import numpy as np
from formulas import EPS
from problem import BODY, EPS_FIELD

from suslov_fast.compiled import advance, enter, frame, leave, step_system, system, work

LANES = 64


@numba.njit(parallel=True, error_model="numpy")
def _in_lanes(frame, omega, steps):
    out = np.empty_like(omega)
    for block in numba.prange(len(omega) // LANES):
        u, v = np.empty(LANES), np.empty(LANES)
        for l in range(LANES):
            u[l], v[l] = enter(frame, omega[LANES * block + l, 0], omega[LANES * block + l, 1])
        for _ in range(steps):
            for l in range(LANES):
                u[l], v[l] = advance(frame, u[l], v[l])
        for l in range(LANES):
            k = LANES * block + l
            out[k, 0], out[k, 1] = leave(frame, u[l], v[l])
    return out


@numba.njit(parallel=True)
def _of_system(system, x, steps):
    out = x.copy()
    for k in numba.prange(len(x)):
        memory = work(system)
        for _ in range(steps):
            step_system(system, out[k], out[k], memory)
    return out


@numba.njit
def _of_one(system, x, steps):
    memory = work(system)
    for _ in range(steps):
        step_system(system, x, x, memory)


def in_lanes(omega0, steps):
    return _in_lanes(frame(BODY, EPS), omega0, steps)


def of_field(field, x, steps):
    return _of_system(system(field, EPS_FIELD), x, steps)


def of_one(field, x, steps):
    """Last states, one orbit after the other."""
    given, final = system(field, EPS_FIELD), x.copy()
    for orbit in final:
        _of_one(given, orbit, steps)
    return final
