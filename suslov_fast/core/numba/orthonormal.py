"""Orthonormal columns by reflections, whose bits depend on neither the processor nor the batch.

LAPACK adds in an order that depends on the processor. Here each sum has one order, and each
operation is rounded by itself. The functions compute with one matrix, or in NumPy with all matrices
of a batch, which are then the last axis of all arrays.
"""

import math

import numpy as np

from .decorators import function, kernel
from .intrinsics import select


@function
def reflect(columns, normal, row, column, along):
    """Reflect `columns` (n, n), from a row and a column on, in the plane with this normal (n,).

    If the normal is 0, nothing changes. `along` (n,) is memory.
    """
    n, square = len(columns), 0.0
    for i in range(row, n):
        square = square + normal[i] * normal[i]
    factor = 2.0 / select(square > 0.0, square, 1.0)
    for j in range(column, n):
        along[j] = normal[row] * columns[row, j]
    for i in range(row + 1, n):
        for j in range(column, n):
            along[j] = along[j] + normal[i] * columns[i, j]
    for j in range(column, n):
        along[j] = along[j] * factor
    for i in range(row, n):
        for j in range(column, n):
            columns[i, j] = columns[i, j] - normal[i] * along[j]


@function
def decompose(A, Q, diagonal, normals, along):
    """Write Q (n, n) and the moduli (n,) of the diagonal of R, Q R = A; A is overwritten.

    Columns of Q are orthonormal for any finite A. `normals` (n, n) and `along` (n,) are memory.
    """
    n = len(A)
    for i in range(n):
        for j in range(n):
            Q[i, j] = 1.0 if i == j else 0.0
    for k in range(n):
        largest, square = abs(A[k, k]), 0.0
        for i in range(k + 1, n):
            largest = select(abs(A[i, k]) > largest, abs(A[i, k]), largest)
        exponent = math.frexp(largest)[1]
        for i in range(k, n):
            normals[k, i] = math.ldexp(A[i, k], -exponent)
            square = square + normals[k, i] * normals[k, i]
        length = math.sqrt(square)
        diagonal[k] = math.ldexp(length, exponent)
        normals[k, k] = normals[k, k] + math.copysign(length, normals[k, k])
        reflect(A, normals[k], k, k + 1, along)
    for k in range(n - 1, -1, -1):
        reflect(Q, normals[k], k, k, along)


@kernel
def decompose_each(part, parts, A, Q, diagonal, normals, along):
    """Decompose part `part` of `parts` of the matrices A (K, n, n), see `decompose`."""
    K = len(A)
    for k in range(K * part // parts, K * (part + 1) // parts):
        decompose(A[k], Q[k], diagonal[k], normals[part], along[part])


def _by_numpy(part, parts, A, Q, diagonal, normals, along):
    """Do what `decompose_each` does for all matrices side by side."""
    K, n, _ = A.shape
    first, of_Q, of_R = (np.ascontiguousarray(np.moveaxis(a, 0, -1)) for a in (A, Q, diagonal))
    decompose.of_arrays(first, of_Q, of_R, np.empty((n, n, K)), np.empty((n, K)))
    Q[:], diagonal[:] = np.moveaxis(of_Q, -1, 0), of_R.T


decompose_each.in_python = _by_numpy
