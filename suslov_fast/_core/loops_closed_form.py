"""Loops over trajectories and times of the closed form."""

import numpy as np
from numba import prange

from .closed_form import flow_point, map_point, rate
from .coordinates import at_rest, from_canonical, to_canonical
from .jit import Loop, part

# Times that one task takes.
CHUNK = 512


@part
def pick(parameter, i):
    """The parameter of trajectory i, or the one that serves all."""
    return parameter[i] if parameter.size > 1 else parameter[0]


def _fill(flow, I1, I2, I13, I23, eps, omega, times, out):
    """States of the map at step numbers `times`, or of the flow at times `times`.

    I1 ... eps   arrays of B numbers, or of one that serves all; for the flow, eps scales time.
    omega        (B, 2), the initial states.
    times        (N,).
    out          (B, N, 2); NaN where there is no state.
    """
    chunks = (times.size + CHUNK - 1) // CHUNK
    for task in prange(omega.shape[0] * chunks):
        i = task // chunks
        first = task % chunks * CHUNK
        I1_, I2_, I13_, I23_ = pick(I1, i), pick(I2, i), pick(I13, i), pick(I23, i)
        eps_ = pick(eps, i)
        X, Y, lost = to_canonical(I1_, I2_, I13_, I23_, eps_, omega[i, 0], omega[i, 1])
        m11, m12, m21, m22 = from_canonical(I1_, I2_, I13_, I23_, eps_)
        T, complement, r, log_r = rate(X, Y, lost)
        rests = X == 0.0 and Y == 0.0 if flow else at_rest(I13_, I23_, eps_, X, Y)
        for j in range(first, min(first + CHUNK, times.size)):
            if rests or times[j] == 0.0:
                omega1, omega2 = omega[i, 0], omega[i, 1]
            else:
                if flow:
                    X_n, Y_n = flow_point(X, Y, times[j])
                else:
                    X_n, Y_n = map_point(X, Y, T, complement, r, log_r, times[j])
                omega1, omega2 = m11 * X_n + m12 * Y_n, m21 * X_n + m22 * Y_n
                if not (np.isfinite(omega1) and np.isfinite(omega2)):
                    omega1, omega2 = np.nan, np.nan
            out[i, j, 0], out[i, j, 1] = omega1, omega2


fill = Loop(_fill)
