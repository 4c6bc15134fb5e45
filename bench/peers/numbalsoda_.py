"""numbalsoda: the motion (s1) by LSODA, called from compiled code."""

import formulas
import numba
import numpy as np
from numbalsoda import lsoda, lsoda_sig

_velocity = numba.njit(formulas.velocity)


@numba.cfunc(lsoda_sig)
def _right(t, w, dw, parameters):
    dw[0], dw[1] = _velocity(w[0], w[1])


@numba.njit(parallel=True)
def _motion(address, omega0, time):
    final = np.empty_like(omega0)
    times = np.array([0.0, time])
    for i in numba.prange(len(omega0)):
        states, _ = lsoda(address, omega0[i], times, rtol=1e-12, atol=1e-13)
        final[i] = states[1]
    return final


def motion(omega0, time, threads):
    """A call for each trajectory, `prange` over them."""
    return _motion(_right.address, omega0, time)
