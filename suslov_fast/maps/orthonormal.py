"""Matrices with orthonormal columns, with the same bits on all processors.

LAPACK and BLAS add in an order that depends on the processor, and NumPy's sums in one that depends
on the shape. Tangent vectors take part in the choice of steps, so a chaotic motion would depend on
the last digits of their decomposition. NumPy's products of entries, and accumulated sums, round
each operation by itself, in one order.
"""

import numpy as np

from ..checks import FloatArray


def added(terms: FloatArray) -> FloatArray:
    """Return the sums of terms (n, ...) along the first axis, added in their order."""
    total: FloatArray = np.add.accumulate(terms)[-1]
    return total


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
    A = np.array(np.moveaxis(V, 0, -1), order="C")  # (row, column, K)
    Q = np.zeros((n, n, K))
    Q[range(n), range(n)] = 1.0
    diagonal, normals = np.empty((n, K)), []
    for k in range(n):
        exponent = np.frexp(abs(A[k:, k]).max(axis=0))[1]
        normal = np.ldexp(A[k:, k], -exponent)
        length = np.sqrt(added(normal * normal))
        diagonal[k] = np.ldexp(length, exponent)
        normal[0] += np.copysign(length, normal[0])
        normals.append(normal)
        _reflect(A[k:, k + 1 :], normal)
    for k in reversed(range(n)):
        _reflect(Q[k:, k:], normals[k])
    return np.moveaxis(Q, -1, 0), diagonal.T


def _reflect(columns: FloatArray, normal: FloatArray) -> None:
    """Reflect columns (m, c, K) in the planes with normals (m, K); in none where these are 0."""
    square = added(normal * normal)
    along = added(normal[:, np.newaxis] * columns) * (2.0 / np.where(square > 0.0, square, 1.0))
    columns -= normal[:, np.newaxis] * along
