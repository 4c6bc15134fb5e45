"""The loop over steps of the orientation of the body."""

from numba import prange

from .jit import Loop
from .rotation import matrix, turned


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


reconstruct = Loop(_reconstruct)
