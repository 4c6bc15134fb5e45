"""Gaussian elimination of a matrix of vectors: VECTOR systems of m equations side by side.

matrix   (rows, columns, VECTOR), as `matrix_shape` says: the coefficients, then the right side in
         column m.
"""

import numpy as np

from ..staged import apart, staged
from . import intrinsics  # noqa: F401  (compiles what `vector` defines)
from .vector import VECTOR, all_lanes, larger, load, select, splat, store

# A pivot this much smaller than those before it, times m, is zero to rounding.
ZERO_TO_ROUNDING = 2.0**-50
# Rows or columns that are reduced at once.
ABREAST = 4


def matrix_shape(m: int) -> tuple[int, int, int]:
    """Room for m equations, and for ABREAST rows or columns from any on; zeros to begin with.

    The number of columns is odd, so that the rows of a column are spread over the cache.
    """
    return m + ABREAST, (m + ABREAST) // 2 * 2 + 1, VECTOR


@staged
def of_vectors(matrix):
    """The same, with its last length known beforehand."""
    return matrix.reshape((matrix.shape[0], matrix.shape[1], VECTOR))


@staged
def reduce_column(matrix, first, k):
    """Eliminate in column k what the columns before it stand for, ABREAST rows from `first` on."""
    i0, i1, i2, i3 = first, first + 1, first + 2, first + 3
    a0, a1 = load(matrix, i0, k), load(matrix, i1, k)
    a2, a3 = load(matrix, i2, k), load(matrix, i3, k)
    for t in range(k):
        above = load(matrix, t, k)
        a0 = a0 - load(matrix, i0, t) * above
        a1 = a1 - load(matrix, i1, t) * above
        a2 = a2 - load(matrix, i2, t) * above
        a3 = a3 - load(matrix, i3, t) * above
    store(matrix, i0, k, a0)
    store(matrix, i1, k, a1)
    store(matrix, i2, k, a2)
    store(matrix, i3, k, a3)


@staged
def reduce_row(matrix, k, first):
    """The same in row k, ABREAST columns from `first` on."""
    j0, j1, j2, j3 = first, first + 1, first + 2, first + 3
    a0, a1 = load(matrix, k, j0), load(matrix, k, j1)
    a2, a3 = load(matrix, k, j2), load(matrix, k, j3)
    for t in range(k):
        factor = load(matrix, k, t)
        a0 = a0 - factor * load(matrix, t, j0)
        a1 = a1 - factor * load(matrix, t, j1)
        a2 = a2 - factor * load(matrix, t, j2)
        a3 = a3 - factor * load(matrix, t, j3)
    store(matrix, k, j0, a0)
    store(matrix, k, j1, a1)
    store(matrix, k, j2, a2)
    store(matrix, k, j3, a3)


@staged
def exchange_rows(matrix, m, k):
    """Bring the largest number of column k, from row k on, into row k, a lane at a time."""
    for l in range(VECTOR):
        pivot = k
        for i in range(k + 1, m):
            larger_yet = abs(matrix[i, k, l]) > abs(matrix[pivot, k, l])
            pivot = i if larger_yet else pivot
        for j in range(m + 1):
            other = matrix[pivot, j, l]
            matrix[pivot, j, l] = matrix[k, j, l]
            matrix[k, j, l] = other


@apart
def eliminate(matrix, m):
    """Gaussian elimination with partial pivoting, in place, in Crout's order.

    A number is loaded when its row or column is due and takes all its products at once. The right
    side becomes the solution, NaN where the matrix is singular.
    """
    size = splat(0.0)
    for k in range(m):
        for i in range(k, m, ABREAST):
            reduce_column(matrix, i, k)
        diagonal = abs(load(matrix, k, k))
        largest = diagonal
        for i in range(k + 1, m):
            largest = larger(abs(load(matrix, i, k)), largest)
        # Most often no lane exchanges rows: A is near the identity.
        if not all_lanes(diagonal >= largest):
            exchange_rows(matrix, m, k)
        size = larger(largest, size)
        regular = largest > ZERO_TO_ROUNDING * m * size
        inverse = select(regular, 1.0 / load(matrix, k, k), splat(np.nan))
        store(matrix, k, k, inverse)
        for i in range(k + 1, m):
            store(matrix, i, k, load(matrix, i, k) * inverse)
        for j in range(k + 1, m + 1, ABREAST):
            reduce_row(matrix, k, j)
    for i in range(m - 1, -1, -1):
        solution = load(matrix, i, m)
        for j in range(m - 1, i, -1):
            solution = solution - load(matrix, i, j) * load(matrix, j, m)
        store(matrix, i, m, solution * load(matrix, i, i))
