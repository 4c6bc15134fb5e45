"""Loops over the steps of the orientation of the body."""

import numpy as np
from numba import prange

from ..formulas.rotation import matrix, turned
from ..jit import Loop


def _reconstruct(omega, eps, out):
    """Orientations along trajectories, from the identity on.

    omega   (B, N, 2), the states.
    eps     (B,) or (1,), the time between two of them.
    out     (B, N, 3, 3); NaN from the first state on that is NaN.
    """
    for i in prange(omega.shape[0]):
        half = 0.5 * (eps[i] if eps.size > 1 else eps[0])
        w, x, y, z = 1.0, 0.0, 0.0, 0.0
        for k in range(omega.shape[1]):
            if k > 0:
                w, x, y, z = turned(
                    w,
                    x,
                    y,
                    z,
                    half * (omega[i, k - 1, 0] + omega[i, k, 0]),
                    half * (omega[i, k - 1, 1] + omega[i, k, 1]),
                    0.0,
                )
            (
                out[i, k, 0, 0],
                out[i, k, 0, 1],
                out[i, k, 0, 2],
                out[i, k, 1, 0],
                out[i, k, 1, 1],
                out[i, k, 1, 2],
                out[i, k, 2, 0],
                out[i, k, 2, 1],
                out[i, k, 2, 2],
            ) = matrix(w, x, y, z)


# In n dimensions rounding is undone after so many turns.
CLEAN_EVERY = 16


def _reconstruct_nd(omega, eps, out):
    """The same in n dimensions; out is (B, N, n, n)."""
    m = omega.shape[2]
    n = m + 1
    for i in prange(omega.shape[0]):
        half = 0.5 * (eps[i] if eps.size > 1 else eps[0])
        angle, image = np.empty(m), np.empty(n)
        gram, cleaned = np.empty((n, n)), np.empty((n, n))
        for r in range(n):
            for c in range(n):
                out[i, 0, r, c] = 1.0 if r == c else 0.0
        for k in range(1, omega.shape[1]):
            square = 0.0
            for j in range(m):
                angle[j] = half * (omega[i, k - 1, j] + omega[i, k, j])
                square += angle[j] * angle[j]
            scale = 1.0 / (1.0 + 0.25 * square)
            # cay(S) = Id + (S + S**2 / 2) / (1 + |angle|**2 / 4), S = angle e_n^T - e_n angle^T.
            for r in range(n):
                image[r] = 0.0
                for j in range(m):
                    image[r] += out[i, k - 1, r, j] * angle[j]
            for r in range(n):
                last = out[i, k - 1, r, m]
                for j in range(m):
                    out[i, k, r, j] = (
                        out[i, k - 1, r, j] - scale * (last + 0.5 * image[r]) * angle[j]
                    )
                out[i, k, r, m] = last + scale * (image[r] - 0.5 * square * last)
            if k % CLEAN_EVERY == 0:
                # One step of Newton's method for the nearest orthogonal matrix.
                for r in range(n):
                    for c in range(n):
                        gram[r, c] = 1.5 if r == c else 0.0
                        for j in range(n):
                            gram[r, c] -= 0.5 * out[i, k, r, j] * out[i, k, c, j]
                for r in range(n):
                    for c in range(n):
                        cleaned[r, c] = 0.0
                        for j in range(n):
                            cleaned[r, c] += gram[r, j] * out[i, k, j, c]
                for r in range(n):
                    for c in range(n):
                        out[i, k, r, c] = cleaned[r, c]


reconstruct = Loop(_reconstruct)
reconstruct_nd = Loop(_reconstruct_nd)
