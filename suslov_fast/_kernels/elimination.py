"""Gaussian elimination with partial pivoting of several systems of equations side by side."""

import numpy as np

from .._formulas.elementary import larger
from .._jit import LINE, inner, select, stack, subtract_product

# Usual and largest numbers of systems side by side. 128 take 0.6 of the time for 3 equations, and
# 0.9 for 12; matrices of 64 then leave the second cache.
WIDTH, WIDEST = 32, 128
# The tolerance of systems that are singular to rounding.
ZERO_TO_ROUNDING = 2.0**-50


@inner
def exchange_rows(matrix, k, beyond_1):
    """Exchange rows in each system: the largest entry of column k below row k goes to row k."""
    m, columns, width = matrix.shape
    for l in range(width):
        pivot = k
        for i in range(k + 1, m):
            if abs(matrix[i, k, l]) > abs(matrix[pivot, k, l]):
                pivot = i
        if pivot != k:
            for j in range(k, columns):
                matrix[k, j, l], matrix[pivot, j, l] = matrix[pivot, j, l], matrix[k, j, l]
            if beyond_1 is not None:
                beyond_1[k, l] = beyond_1[pivot, l] = np.nan


@inner
def eliminate(matrix, tolerance=ZERO_TO_ROUNDING, beyond_1=None):
    """Solve systems of m equations in place.

    matrix      (m, m + r, width): the coefficients, and r right sides, which become the solutions,
                NaN if a system is singular; the diagonal becomes that of inverse pivots, and the
                other coefficients are lost. width is a multiple of WIDTH up to WIDEST.
    tolerance   a pivot is 0 if it is below the previous ones times this and m
    beyond_1    None, or (m, width): the diagonal less 1, more accurate than the diagonal itself if
                that is near 1; it becomes the pivots less 1, NaN if rows were exchanged
    """
    m, columns, width = matrix.shape
    largest, pivots = stack(WIDEST), stack(WIDEST)
    inverse, factor = stack(WIDEST), stack(WIDEST)
    for l in range(width):
        pivots[l] = 0.0
    for k in range(m):
        for l in range(width):
            largest[l] = abs(matrix[k, k, l])
        for i in range(k + 1, m):
            for l in range(width):
                # The sum avoids masked stores, which are slow.
                largest[l] = larger(abs(matrix[i, k, l]), largest[l]) + 0.0
        smaller_pivots = 0  # an integer: a sum of floats is one addition after the other
        for l in range(width):
            smaller_pivots += select(abs(matrix[k, k, l]) < largest[l], 1, 0)
        # Near the identity no rows are exchanged.
        if smaller_pivots > 0:
            exchange_rows(matrix, k, beyond_1)
        for l in range(width):
            pivots[l] = larger(largest[l], pivots[l])
            regular = largest[l] > tolerance * m * pivots[l]
            inverse[l] = select(regular, 1.0 / matrix[k, k, l], np.nan)
            matrix[k, k, l] = inverse[l]
        for i in range(k + 1, m):
            for l in range(width):
                factor[l] = matrix[i, k, l] * inverse[l]
            if beyond_1 is not None:
                for l in range(width):
                    beyond_1[i, l] -= factor[l] * matrix[k, i, l]
            # The loop over WIDTH systems is unrolled, and factors stay in registers: one over all
            # systems takes 1.4 times as long.
            for first in range(0, width, WIDTH):
                for j in range(k + 1, columns):
                    for l in range(first, first + WIDTH, LINE):
                        subtract_product(matrix, (i, j, l), factor, (l,), matrix, (k, j, l))
    for i in range(m - 1, -1, -1):
        for r in range(m, columns):
            for first in range(0, width, WIDTH):
                for j in range(m - 1, i, -1):
                    for l in range(first, first + WIDTH, LINE):
                        subtract_product(matrix, (i, r, l), matrix, (i, j, l), matrix, (j, r, l))
            for l in range(width):
                matrix[i, r, l] *= matrix[i, i, l]
