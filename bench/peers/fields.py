"""Kahan's map of two quadratic fields: NumPy, Numba over trajectories, and C written for them.

Functions of (x, steps, threads) return the last states; x has 3 components for the Lorenz system,
and more for the Volterra chain.
"""

import numba
import numpy as np
from native import call
from problem import EPS_FIELD as EPS

SPEEDS = (10.0, 28.0, 8 / 3)


def lorenz(x, y, z):
    a, b, c = SPEEDS
    return a * (y - x), b * x - y - x * z, x * y - c * z


def slopes(x):
    """The field and its derivative at states (batch, D)."""
    batch, D = x.shape
    jacobian = np.zeros((batch, D, D))
    if D == 3:
        u, v, w = x.T
        a, b, c = SPEEDS
        jacobian[:, 0, 0], jacobian[:, 0, 1] = -a, a
        jacobian[:, 1, 0], jacobian[:, 1, 1], jacobian[:, 1, 2] = b - w, -1.0, -u
        jacobian[:, 2, 0], jacobian[:, 2, 1], jacobian[:, 2, 2] = v, u, -c
        return np.stack(lorenz(u, v, w), axis=-1), jacobian
    i = np.arange(D)
    rate = np.roll(x, -1, axis=-1) - np.roll(x, 1, axis=-1)
    jacobian[:, i, i], jacobian[:, i, (i + 1) % D], jacobian[:, i, i - 1] = rate, x, -x
    return x * rate, jacobian


def in_numpy(x, steps, threads):
    """The batched solver of NumPy."""
    unit = np.eye(x.shape[-1])
    for _ in range(steps):
        f, jacobian = slopes(x)
        x = x + EPS * np.linalg.solve(unit - EPS / 2 * jacobian, f[..., np.newaxis])[..., 0]
    return x


@numba.njit(parallel=True, cache=True)
def _in_numba(states, steps):
    batch, D = states.shape
    final = np.empty_like(states)
    a, b, c = SPEEDS
    for k in numba.prange(batch):
        x, f, A = states[k].copy(), np.empty(D), np.empty((D, D))
        for _ in range(steps):
            A[:] = 0.0
            if D == 3:
                u, v, w = x
                f[0], f[1], f[2] = a * (v - u), b * u - v - u * w, u * v - c * w
                A[0, 0], A[0, 1] = -a, a
                A[1, 0], A[1, 1], A[1, 2] = b - w, -1.0, -u
                A[2, 0], A[2, 1], A[2, 2] = v, u, -c
            else:
                for i in range(D):
                    rate = x[(i + 1) % D] - x[i - 1]
                    f[i], A[i, i], A[i, (i + 1) % D], A[i, i - 1] = x[i] * rate, rate, x[i], -x[i]
            A *= -EPS / 2
            for i in range(D):
                A[i, i] += 1.0
            x += EPS * np.linalg.solve(A, f)
        final[k] = x
    return final


def in_numba(x, steps, threads):
    """A loop over trajectories in Numba, with its solver."""
    return _in_numba(x, steps)


def in_c(x, steps, threads):
    """C: the Lorenz system written out; elimination for the chain."""
    final, (batch, D) = np.empty_like(x), x.shape
    name, sizes = ("lorenz", (batch,)) if D == 3 else ("volterra", (batch, D))
    call("peers/fields.c", name, x, final, *sizes, int(steps), EPS, int(threads))
    return final
