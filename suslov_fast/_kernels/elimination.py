"""Gaussian elimination with partial pivoting of several systems of equations side by side."""

import numpy as np

from .._formulas.elementary import larger
from .._jit import carray, inner, select, stack

# Systems side by side at most: sums over columns wait for the memory they were just written to if
# there are fewer, and more leave the caches.
WIDTH = 32
ROOM = 4 * WIDTH
SIZE, LARGEST, INVERSE, FACTOR = range(4)
# A pivot this much smaller than those before it, times the number of equations, is 0 to rounding.
ZERO_TO_ROUNDING = 2.0**-50


@inner
def exchange_rows(matrix, k, width):
    """Bring the largest number of column k, from row k on, into row k, system by system."""
    m = matrix.shape[0]
    for l in range(width):
        pivot = k
        for i in range(k + 1, m):
            if abs(matrix[i, k, l]) > abs(matrix[pivot, k, l]):
                pivot = i
        if pivot != k:
            for j in range(m + 1):
                matrix[k, j, l], matrix[pivot, j, l] = matrix[pivot, j, l], matrix[k, j, l]


@inner
def eliminate(matrix, row, width):
    """Solve some systems: matrix (m, m + 1, WIDTH) holds coefficients, and right sides as column m.

    The solutions come to `row`, (m + 1, WIDTH), NaN where a matrix is singular. (Rows that others
    are reduced by are copied there too: LLVM tests whether what it reads overlaps what it writes.)
    """
    m = matrix.shape[0]
    s = carray(stack(ROOM), (4, WIDTH))
    for l in range(width):
        s[SIZE, l] = 0.0
    for k in range(m):
        for l in range(width):
            s[LARGEST, l] = abs(matrix[k, k, l])
        for i in range(k + 1, m):
            for l in range(width):
                s[LARGEST, l] = larger(abs(matrix[i, k, l]), s[LARGEST, l])
        smaller_pivots = 0.0
        for l in range(width):
            smaller_pivots += select(abs(matrix[k, k, l]) < s[LARGEST, l], 1.0, 0.0)
        # Most often no rows are exchanged: A is near the identity.
        if smaller_pivots > 0.0:
            exchange_rows(matrix, k, width)
        for l in range(width):
            s[SIZE, l] = larger(s[LARGEST, l], s[SIZE, l])
            regular = s[LARGEST, l] > ZERO_TO_ROUNDING * m * s[SIZE, l]
            s[INVERSE, l] = select(regular, 1.0 / matrix[k, k, l], np.nan)
            matrix[k, k, l] = s[INVERSE, l]
        for j in range(k + 1, m + 1):
            for l in range(width):
                row[j, l] = matrix[k, j, l]
        for i in range(k + 1, m):
            for l in range(width):
                s[FACTOR, l] = matrix[i, k, l] * s[INVERSE, l]
            for j in range(k + 1, m + 1):
                for l in range(width):
                    matrix[i, j, l] -= s[FACTOR, l] * row[j, l]
    for i in range(m - 1, -1, -1):
        for l in range(width):
            s[FACTOR, l] = matrix[i, m, l]
        for j in range(m - 1, i, -1):
            for l in range(width):
                s[FACTOR, l] -= matrix[i, j, l] * row[j, l]
        for l in range(width):
            row[i, l] = s[FACTOR, l] * matrix[i, i, l]
