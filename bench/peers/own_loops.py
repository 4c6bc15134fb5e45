"""Loops of users over `suslov_fast.compiled`; without a cache, which Numba would not renew."""

import numba
from problem import EPS_FIELD

from suslov_fast.compiled import step_system, system, work


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


def of_field(field, x, steps):
    return _of_system(system(field, EPS_FIELD), x, steps)


def of_one(field, x, steps):
    """Last states, one orbit after the other."""
    given, final = system(field, EPS_FIELD), x.copy()
    for orbit in final:
        _of_one(given, orbit, steps)
    return final
