"""Matrices with orthonormal columns, with the same bits on all processors.

LAPACK and BLAS add in an order that depends on the processor, and NumPy's sums in one that depends
on the shape. Tangent vectors take part in the choice of steps, so a chaotic motion would depend on
the last digits of their decomposition. Here each operation is rounded by itself, in one order.
"""

import numpy as np

from ..checks import FloatArray
from ..core.numba.orthonormal import decompose_each

# Before `decompose_each` is compiled, NumPy takes _IN_NUMPY n**3 (K + _CALL) seconds.
_IN_NUMPY, _CALL = 4e-9, 500


def dual_product(A: FloatArray, B: FloatArray) -> FloatArray:
    """Return A^T B of matrices A (K, n, m) and B (K, n, l)."""
    total = np.zeros((max(len(A), len(B)), A.shape[2], B.shape[2]))
    for i in range(A.shape[1]):
        total += A[:, i, :, np.newaxis] * B[:, i, np.newaxis]
    return total


def orthonormal(V: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Q and the moduli of the diagonal of R, where Q R = V (K, n, n), by reflections.

    Columns of Q are orthonormal for any finite V, also where columns of V depend on others.
    """
    K, n, _ = V.shape
    Q, diagonal = np.empty((K, n, n)), np.empty((K, n))
    seconds = _IN_NUMPY * n**3 * (K + _CALL)
    memory = np.empty((1, n, n)), np.empty((1, n))
    decompose_each.interpreted_or_serial(seconds, np.array(V, order="C"), Q, diagonal, *memory)
    return Q, diagonal
