"""Products of matrices, decomposed as Q R, for Lyapunov exponents."""

import numpy as np

from .._jit import kernel, share


@kernel
def orthonormalise(part, parts, derivatives, frames, diagonals, scratch):
    """Multiply frames by matrices in turn, and replace each product Q R by Q.

    derivatives   (N, B, D, D), the matrices
    frames        (B, D, D), read and written
    diagonals     (N, B, D), the diagonals of R; the columns of a Q are 0 where they are
    scratch       (parts, D), any
    """
    steps, batch, D, _ = derivatives.shape
    column = scratch[part]
    first, last = share(batch, part, parts)
    for b in range(first, last):
        for n in range(steps):
            for k in range(D):
                for i in range(D):
                    column[i] = 0.0
                    for j in range(D):
                        column[i] += derivatives[n, b, i, j] * frames[b, j, k]
                for c in range(k):  # the modified Gram-Schmidt method
                    along = 0.0
                    for i in range(D):
                        along += frames[b, i, c] * column[i]
                    for i in range(D):
                        column[i] -= along * frames[b, i, c]
                square = 0.0
                for i in range(D):
                    square += column[i] * column[i]
                diagonals[n, b, k] = length = np.sqrt(square)
                for i in range(D):
                    frames[b, i, k] = column[i] / (length if length > 0.0 else 1.0)
