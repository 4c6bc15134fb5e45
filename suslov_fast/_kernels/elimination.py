"""Gaussian elimination with partial pivoting of several systems of equations side by side."""

import numpy as np

from .._formulas.elementary import larger
from .._jit import inner, select

# Systems side by side.
WIDTH = 8
# A pivot this much smaller than those before it, times the number of equations, is 0 to rounding.
ZERO_TO_ROUNDING = 2.0**-50


@inner
def exchange_rows(matrix, k, width):
    """Bring the largest number of column k, from row k on, into row k, lane by lane."""
    m = matrix.shape[0]
    for l in range(width):
        pivot = k
        for i in range(k + 1, m):
            if abs(matrix[i, k, l]) > abs(matrix[pivot, k, l]):
                pivot = i
        if pivot != k:
            for j in range(k, m + 1):
                matrix[k, j, l], matrix[pivot, j, l] = matrix[pivot, j, l], matrix[k, j, l]


@inner
def eliminate(matrix, width):
    """Solve in place: column m of matrix, (m, m + 1, WIDTH), becomes the solution.

    The solution is NaN where the matrix is singular.
    """
    m = matrix.shape[0]
    size = np.empty(WIDTH)
    for l in range(width):
        size[l] = 0.0
    for k in range(m):
        exchange_rows(matrix, k, width)
        for l in range(width):
            pivot = matrix[k, k, l]
            size[l] = larger(abs(pivot), size[l])
            regular = abs(pivot) > ZERO_TO_ROUNDING * m * size[l]
            matrix[k, k, l] = select(regular, 1.0 / pivot, np.nan)
        for i in range(k + 1, m):
            for l in range(width):
                matrix[i, k, l] *= matrix[k, k, l]
            for j in range(k + 1, m + 1):
                for l in range(width):
                    matrix[i, j, l] -= matrix[i, k, l] * matrix[k, j, l]
    for i in range(m - 1, -1, -1):
        for j in range(m - 1, i, -1):
            for l in range(width):
                matrix[i, m, l] -= matrix[i, j, l] * matrix[j, m, l]
        for l in range(width):
            matrix[i, m, l] *= matrix[i, i, l]
