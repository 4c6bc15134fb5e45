"""Gaussian elimination with partial pivoting of several systems of equations side by side."""

import numpy as np

from .._formulas.elementary import larger
from .._jit import LINE, carray, copy_line, formula, inner, select, stack, subtract_product

# Number of systems side by side. 32 are no faster.
WIDTH = 16
SIZE, LARGEST, INVERSE, SUM = range(4)
ROOM = (SUM + 2) * WIDTH
# A pivot is 0 to rounding if it is below the previous ones times this and the number of equations.
ZERO_TO_ROUNDING = 2.0**-50


@inner
def exchange_rows(matrix, k, width):
    """Exchange rows in each system: the largest entry of column k below row k goes to row k."""
    m = matrix.shape[0] - 1
    for l in range(width):
        pivot = k
        for i in range(k + 1, m):
            if abs(matrix[i, k, l]) > abs(matrix[pivot, k, l]):
                pivot = i
        if pivot != k:
            for j in range(m + 1):
                matrix[k, j, l], matrix[pivot, j, l] = matrix[pivot, j, l], matrix[k, j, l]


@formula
def reduce(matrix, i, j, further, count, s):
    """Subtract from entry (i, j) the first `count` products of entries of row i and column j, and
    likewise for the entry `further` columns to the right.
    """
    i2, j2 = i + further[0], j + further[1]
    for l in range(0, WIDTH, LINE):
        copy_line(s, (SUM, l), matrix, (i, j, l))
        copy_line(s, (SUM + 1, l), matrix, (i2, j2, l))
    for t in range(count):
        for l in range(0, WIDTH, LINE):
            subtract_product(s, (SUM, l), matrix, (i, t, l), matrix, (t, j, l))
            subtract_product(s, (SUM + 1, l), matrix, (i2, t, l), matrix, (t, j2, l))
    for l in range(0, WIDTH, LINE):
        copy_line(matrix, (i, j, l), s, (SUM, l))
        copy_line(matrix, (i2, j2, l), s, (SUM + 1, l))


@inner
def eliminate(matrix):
    """Solve some systems in Crout's order: all products of an entry are subtracted together.

    matrix    (m + 1, m + 2, WIDTH), the coefficients, and right sides as column m, which become the
              solutions, NaN if a matrix is singular. The last row and column are padding for
              pairs.
    """
    m, width = matrix.shape[0] - 1, matrix.shape[2]
    s = carray(stack(ROOM), (SUM + 2, WIDTH))
    for l in range(width):
        s[SIZE, l] = 0.0
    for k in range(m):
        for i in range(k, m, 2):
            reduce(matrix, i, k, (1, 0), k, s)
        for l in range(width):
            s[LARGEST, l] = abs(matrix[k, k, l])
        for i in range(k + 1, m):
            for l in range(width):
                # The sum avoids masked stores, which are slow.
                s[LARGEST, l] = larger(abs(matrix[i, k, l]), s[LARGEST, l]) + 0.0
        smaller_pivots = 0.0
        for l in range(width):
            smaller_pivots += select(abs(matrix[k, k, l]) < s[LARGEST, l], 1.0, 0.0)
        # Usually no rows are exchanged: A is near the identity.
        if smaller_pivots > 0.0:
            exchange_rows(matrix, k, width)
        for l in range(width):
            s[SIZE, l] = larger(s[LARGEST, l], s[SIZE, l])
            regular = s[LARGEST, l] > ZERO_TO_ROUNDING * m * s[SIZE, l]
            s[INVERSE, l] = select(regular, 1.0 / matrix[k, k, l], np.nan)
            matrix[k, k, l] = s[INVERSE, l]
        for i in range(k + 1, m):
            for l in range(width):
                matrix[i, k, l] *= s[INVERSE, l]
        for j in range(k + 1, m + 1, 2):
            reduce(matrix, k, j, (0, 1), k, s)
    for i in range(m - 1, -1, -1):
        for l in range(0, WIDTH, LINE):
            copy_line(s, (SUM, l), matrix, (i, m, l))
        for j in range(m - 1, i, -1):
            for l in range(0, WIDTH, LINE):
                subtract_product(s, (SUM, l), matrix, (i, j, l), matrix, (j, m, l))
        for l in range(width):
            matrix[i, m, l] = s[SUM, l] * matrix[i, i, l]
