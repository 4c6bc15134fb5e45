"""Gaussian elimination with partial pivoting: of several systems of equations side by side, and of
one system with twice the digits, for systems that lose too many of them.
"""

import numpy as np

from .._formulas.elementary import exponent, larger, smaller, two_to_the
from .._formulas.twofold import difference, product, quotient
from .._jit import LINE, formula, inner, select, stack, subtract_product

# Usual and largest numbers of systems side by side. 128 take 0.6 of the time for 3 equations, and
# 0.9 for 12; matrices of 64 then leave the second cache.
WIDTH, WIDEST = 32, 128
# Elimination loses less than three digits if the ratio of the least to the largest pivot, and that
# of the sizes of the unknowns, are above this.
ACCURATE = 2.0**-10


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
def eliminate(matrix, ratio, beyond_1=None):
    """Solve systems of m equations in place.

    matrix      (m, m + r, width): the coefficients, and r right sides, which become the solutions;
                the diagonal becomes that of inverse pivots, and the other coefficients are lost.
                width is a multiple of WIDTH up to WIDEST.
    ratio       (width,), filled with the ratio of the least pivot to the largest, or to 1 if that
                is larger: the matrices are sums of the identity and other terms
    beyond_1    None, or (m, width): the diagonal less 1, more accurate than the diagonal itself if
                that is near 1; it becomes the pivots less 1, NaN if rows were exchanged
    """
    m, columns, width = matrix.shape
    largest, pivots, least = stack(WIDEST), stack(WIDEST), stack(WIDEST)
    inverse, factor = stack(WIDEST), stack(WIDEST)
    for l in range(width):
        pivots[l], least[l] = 1.0, np.inf
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
            pivots[l], least[l] = larger(largest[l], pivots[l]), smaller(largest[l], least[l])
            inverse[l] = 1.0 / matrix[k, k, l]
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
    for l in range(width):
        ratio[l] = least[l] / pivots[l]
    for i in range(m - 1, -1, -1):
        for r in range(m, columns):
            for first in range(0, width, WIDTH):
                for j in range(m - 1, i, -1):
                    for l in range(first, first + WIDTH, LINE):
                        subtract_product(matrix, (i, r, l), matrix, (i, j, l), matrix, (j, r, l))
            for l in range(width):
                matrix[i, r, l] *= matrix[i, i, l]


@formula
def twofold(matrix, i, j):
    return matrix[i, j, 0], matrix[i, j, 1]


@formula
def subtract(matrix, i, j, v):
    """Subtract a number of twice the digits from an entry, see `eliminate_twofold`."""
    matrix[i, j, 0], matrix[i, j, 1] = difference(twofold(matrix, i, j), v)
    matrix[i, j, 2] += abs(v[0])


@inner
def eliminate_twofold(matrix, tolerance):
    """Solve a system of m equations in place, with twice the digits; return k, for which |det| is
    the product of the magnitudes of the diagonal and 2**k.

    matrix      (m, m + r, 3 or more): numbers and their rounding errors, of coefficients and right
                sides, and the sums of the magnitudes of their terms; the right sides become the
                solutions, NaN if a pivot is 0, or below its terms times m and the tolerance: then
                it is NaN
    """
    m, columns, _ = matrix.shape
    power = 0.0
    for i in range(m):
        largest = 0.0
        for j in range(m):
            largest = larger(abs(matrix[i, j, 0]), largest)
        power += exponent(largest)
        for j in range(columns):
            for part in range(3):
                matrix[i, j, part] *= two_to_the(-exponent(largest))
    for k in range(m):
        pivot = k
        for i in range(k + 1, m):
            if abs(matrix[i, k, 0]) > abs(matrix[pivot, k, 0]):
                pivot = i
        for j in range(columns):
            for part in range(3):
                above = matrix[k, j, part]
                matrix[k, j, part], matrix[pivot, j, part] = matrix[pivot, j, part], above
        if 0.0 < abs(matrix[k, k, 0]) <= m * tolerance * matrix[k, k, 2]:
            matrix[k, k, 0] = np.nan
        for i in range(k + 1, m):
            factor = quotient(twofold(matrix, i, k), twofold(matrix, k, k))
            for j in range(k + 1, columns):
                subtract(matrix, i, j, product(factor, twofold(matrix, k, j)))
    for r in range(m, columns):
        for i in range(m - 1, -1, -1):
            for j in range(i + 1, m):
                subtract(matrix, i, r, product(twofold(matrix, i, j), twofold(matrix, j, r)))
            x = quotient(twofold(matrix, i, r), twofold(matrix, i, i))
            matrix[i, r, 0], matrix[i, r, 1] = x
    return power
