"""Products, orthonormal columns and eigenvectors, with the same bits on all processors.

LAPACK and BLAS add in an order that depends on the processor, and NumPy's sums in one that depends
on the shape. Tangent vectors take part in the choice of steps, so a chaotic motion would depend on
the last digits of their decomposition. Here each operation is rounded by itself, in one order.
"""

from itertools import combinations

import numpy as np

from ..checks import FloatArray
from ..core.numba.orthonormal import decompose_each
from .tolerances import ENTRIES_OF_CALL, MOST_SWEEPS, ROUNDING_OF_JACOBI, TIME_OF_FRAME_IN_NUMPY


def product(A: FloatArray, B: FloatArray) -> FloatArray:
    """Return A B of matrices A (..., n, m) and B (..., m, l)."""
    batch = np.broadcast_shapes(A.shape[:-2], B.shape[:-2])
    total = np.zeros((*batch, A.shape[-2], B.shape[-1]))
    for i in range(A.shape[-1]):
        total += A[..., i, np.newaxis] * B[..., i, np.newaxis, :]
    return total


def dual_product(A: FloatArray, B: FloatArray) -> FloatArray:
    """Return A^T B of matrices A (..., n, m) and B (..., n, l)."""
    return product(np.swapaxes(A, -2, -1), B)


def orthonormal(V: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Q and the moduli of the diagonal of R, where Q R = V (K, n, n), by reflections.

    Columns of Q are orthonormal for any finite V, also where columns of V depend on others.
    """
    K, n, _ = V.shape
    Q, diagonal = np.empty((K, n, n)), np.empty((K, n))
    seconds = TIME_OF_FRAME_IN_NUMPY * n**3 * (K + ENTRIES_OF_CALL)
    memory = np.empty((1, n, n)), np.empty((1, n))
    decompose_each.interpreted_or_serial(seconds, np.array(V, order="C"), Q, diagonal, *memory)
    return Q, diagonal


def eigenvectors(A: FloatArray) -> FloatArray:
    """Return orthonormal eigenvectors, as columns, of symmetric matrices A (..., n, n).

    Jacobi's rotations of two axes at a time begin with the coordinate axes.
    """
    A = A.copy()
    n = A.shape[-1]
    V = np.broadcast_to(np.eye(n), A.shape).copy()
    pairs = [*combinations(range(n), 2)]
    with np.errstate(all="ignore"):
        for _ in range(MOST_SWEEPS if pairs else 0):
            for p, q in pairs:
                _rotate(A, V, p, q)
            if not any(A[..., p, q].any() for p, q in pairs):
                break
    return V


def _rotate(A: FloatArray, V: FloatArray, p: int, q: int) -> None:
    """Rotate axes p and q of matrices A, and the columns of V, so that A_pq is 0."""
    a, b, c = A[..., p, p], A[..., q, q], A[..., p, q]
    half = (b - a) / (2.0 * c)
    slope = np.copysign(1.0, half) / (abs(half) + np.sqrt(1.0 + half * half))
    slope = np.where(abs(c) > ROUNDING_OF_JACOBI * np.sqrt(abs(a * b)), slope, 0.0)
    cos = (1.0 / np.sqrt(1.0 + slope * slope))[..., np.newaxis]
    sin = cos * slope[..., np.newaxis]
    for M in (A.swapaxes(-2, -1), A, V.swapaxes(-2, -1)):  # columns of A, its rows, columns of V
        P, Q = M[..., p, :].copy(), M[..., q, :].copy()
        M[..., p, :], M[..., q, :] = cos * P - sin * Q, sin * P + cos * Q
    A[..., p, q] = A[..., q, p] = 0.0
