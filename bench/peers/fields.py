"""Kahan's map of quadratic fields: NumPy for any of them; C, and heyoka, written for some."""

import functools

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


@functools.cache
def _lorenz_step():
    """The step of the Lorenz system, solved by hand, as a function of arrays (3, batch)."""
    import heyoka as hy

    x, y, z = hy.make_vars("x", "y", "z")
    h = EPS / 2
    # A d = f with d half of the increment: first the third unknown goes, then the first.
    f = 10 * (y - x), 28 * x - y - x * z, x * y - 8 / 3 * z
    a22 = 1 + h * 8 / 3
    a10, a11 = -h * (28 - z) + h * x * (h * y) / a22, 1 + h + h * x * (h * x) / a22
    g1 = f[1] - h * x * f[2] / a22
    a00, a01 = 1 + h * 10, -h * 10
    d1 = (g1 * a00 - a10 * f[0]) / (a11 * a00 - a10 * a01)
    d0 = (f[0] - a01 * d1) / a00
    d2 = (f[2] + h * y * d0 + h * x * d1) / a22
    return hy.cfunc([x + EPS * d0, y + EPS * d1, z + EPS * d2], vars=[x, y, z])


def in_heyoka(field, x, steps):
    """The Lorenz system by a function that heyoka compiles; blocks of states stay in the caches."""
    step, final = _lorenz_step(), np.empty_like(x)
    for begin in range(0, len(x), 256):
        now = np.ascontiguousarray(x[begin : begin + 256].T)
        other = np.empty_like(now)
        for _ in range(steps):
            now, other = step(inputs=now, outputs=other), now
        final[begin : begin + 256] = now.T
    return final


def in_c(field, x, steps):
    """The Lorenz system written out; elimination that does not know of zeros for a chain."""
    final, (batch, D) = np.empty_like(x), x.shape
    name, sizes = ("lorenz", (batch,)) if D == 3 else ("volterra", (batch, D))
    call("peers/fields.c", name, x, final, *sizes, int(steps), EPS, get_num_threads())
    return final
