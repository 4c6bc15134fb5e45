"""Kahan's map of two quadratic fields: NumPy, and C written for them.

Functions of (x, steps, threads) return the last states; x has 3 components for the Lorenz system,
and more for the Volterra chain.
"""

import numpy as np
from native import call
from problem import EPS_FIELD as EPS


def slopes(x):
    """The field and its derivative at states (batch, D)."""
    batch, D = x.shape
    jacobian = np.zeros((batch, D, D))
    if D == 3:
        a, b, c = 10.0, 28.0, 8 / 3
        u, v, w = x.T
        jacobian[:, 0, 0], jacobian[:, 0, 1] = -a, a
        jacobian[:, 1, 0], jacobian[:, 1, 1], jacobian[:, 1, 2] = b - w, -1.0, -u
        jacobian[:, 2, 0], jacobian[:, 2, 1], jacobian[:, 2, 2] = v, u, -c
        return np.stack([a * (v - u), b * u - v - u * w, u * v - c * w], axis=-1), jacobian
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


def in_c(x, steps, threads):
    """C: the Lorenz system written out; elimination for the chain."""
    final, (batch, D) = np.empty_like(x), x.shape
    name, sizes = ("lorenz", (batch,)) if D == 3 else ("volterra", (batch, D))
    call("peers/fields.c", name, x, final, *sizes, int(steps), EPS, int(threads))
    return final
