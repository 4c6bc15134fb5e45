"""Gaussian elimination: of many systems side by side, and of one system.

Many systems are eliminated in the order of their unknowns. No rows are exchanged, so the units of
the unknowns change no digit. Their pivots tell which systems lose digits in this order; these are
solved again one by one, scaled, with partial pivoting.
"""

import numpy as np

from .._formulas.coordinates import ZERO_TO_ROUNDING
from .._formulas.elementary import exponent, larger, smaller, two_to_the
from .._jit import LINE, inner, select, stack, subtract_product

# Usual and largest numbers of systems side by side. 128 take 0.6 of the time for 3 equations, and
# 0.9 for 12; matrices of 64 then leave the second cache.
WIDTH, WIDEST = 32, 128
# Elimination side by side is accurate if the ratio of `eliminate` is above this.
ACCURATE = 2.0**-8
# Rounds of `balance`, at most: two or three do, unless unknowns are coupled in one direction.
ROUNDS = 20


@inner
def eliminate(matrix, ratio, beyond_1=None):
    """Solve systems of m equations in place, with the diagonal as pivots.

    matrix      (m, m + r, width): the coefficients, and r right sides, which become the solutions;
                the diagonal becomes that of inverse pivots, and the other coefficients are lost.
                width is a multiple of WIDTH up to WIDEST.
    ratio       (width,), filled with the ratio of the least pivot to the largest number that was
                on the diagonal, or to 1 if that is larger: the matrices are sums of the identity
                and other terms. Both are independent of the units of the unknowns.
    beyond_1    None, or (m, width): the diagonal less 1, more accurate than the diagonal itself if
                that is near 1; it becomes the pivots less 1
    """
    m, columns, width = matrix.shape
    largest, least, inverse, factor = stack(WIDEST), stack(WIDEST), stack(WIDEST), stack(WIDEST)
    for l in range(width):
        largest[l], least[l] = 1.0, np.inf
    for i in range(m):
        for l in range(width):
            # The sum avoids masked stores, which are slow.
            largest[l] = larger(abs(matrix[i, i, l]), largest[l]) + 0.0
    for k in range(m):
        for l in range(width):
            least[l] = smaller(abs(matrix[k, k, l]), least[l]) + 0.0
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
                largest[l] = larger(abs(matrix[i, i, l]), largest[l]) + 0.0
    for l in range(width):
        ratio[l] = least[l] / largest[l]
    for i in range(m - 1, -1, -1):
        for r in range(m, columns):
            for first in range(0, width, WIDTH):
                for j in range(m - 1, i, -1):
                    for l in range(first, first + WIDTH, LINE):
                        subtract_product(matrix, (i, r, l), matrix, (i, j, l), matrix, (j, r, l))
            for l in range(width):
                matrix[i, r, l] *= matrix[i, i, l]


@inner
def solve_system(system, scales):
    """Solve one system of m equations, with a small error in each of its coefficients.

    The matrix is the identity and other terms, as in `eliminate`. Unknowns and equations are scaled
    by powers of two; pivots are chosen for rows of equal size; and each solution is refined once.

    system   (2, m, m + r): in system[0] the coefficients and r right sides; these become the
             solutions, and the diagonal the pivots, 0 or, if they are 0 to rounding, NaN. Solutions
             are NaN then. system[1] is scratch.
    scales   (2, m), scratch
    """
    matrix, original, units, weights = system[0], system[1], scales[0], scales[1]
    m, columns = matrix.shape
    balance(matrix, units)
    for i in range(m):
        largest = 0.0
        for j in range(m):
            largest = larger(abs(matrix[i, j]), largest)
        weights[i] = 1.0 / largest
        for j in range(columns):
            original[i, j] = matrix[i, j]
    for k in range(m):
        exchange_rows(matrix, original, weights, k)
        terms = 1.0 + abs(matrix[k, k])
        for j in range(k):
            terms += abs(matrix[k, j] * matrix[j, k])
        if 0.0 < abs(matrix[k, k]) <= m * ZERO_TO_ROUNDING * terms:
            matrix[k, k] = np.nan
        for i in range(k + 1, m):
            factor = matrix[i, k] / matrix[k, k]
            matrix[i, k] = factor
            for j in range(k + 1, m):
                matrix[i, j] -= factor * matrix[k, j]
    for r in range(m, columns):
        substitute(matrix, matrix, r)
        for i in range(m):
            for j in range(m):
                original[i, r] -= original[i, j] * matrix[j, r]
        substitute(matrix, original, r)
        for i in range(m):
            change = original[i, r]
            matrix[i, r] = (matrix[i, r] + select(abs(change) < np.inf, change, 0.0)) * units[i]


@inner
def balance(matrix, units):
    """Change to units of the unknowns, powers of two, in which the largest entries beside the
    diagonal are alike in the row and the column of each unknown.
    """
    m, columns = matrix.shape
    for i in range(m):
        units[i] = 1.0
    for _ in range(ROUNDS):
        changed = False
        for i in range(m):
            of_row, of_column = 0.0, 0.0
            for j in range(m):
                if j != i:
                    of_row = larger(abs(matrix[i, j]), of_row)
                    of_column = larger(abs(matrix[j, i]), of_column)
            power = exponent(of_row) - exponent(of_column)
            if of_row > 0.0 and of_column > 0.0:
                power = np.floor(0.5 * power)
            elif of_row > 0.0 or of_column > 0.0:
                power = exponent(of_row) if of_row > 0.0 else -exponent(of_column)
            if power != 0.0 and abs(power) <= 500.0:
                changed = True
                factor, inverse = two_to_the(power), two_to_the(-power)
                units[i] *= factor
                for j in range(columns):
                    if j != i:
                        matrix[i, j] *= inverse
                for j in range(m):
                    if j != i:
                        matrix[j, i] *= factor
        if not changed:
            break


@inner
def exchange_rows(matrix, original, weights, k):
    """Exchange row k with the one that has the largest entry of column k, relative to its row."""
    pivot = k
    for i in range(k + 1, len(weights)):
        if abs(matrix[i, k]) * weights[i] > abs(matrix[pivot, k]) * weights[pivot]:
            pivot = i
    if pivot != k:
        weights[k], weights[pivot] = weights[pivot], weights[k]
        for j in range(matrix.shape[1]):
            matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
            original[k, j], original[pivot, j] = original[pivot, j], original[k, j]


@inner
def substitute(factors, matrix, r):
    """Replace a right side, column r, by its solution, NaN if a pivot is 0."""
    m = len(factors)
    for i in range(m):
        for j in range(i):
            matrix[i, r] -= factors[i, j] * matrix[j, r]
    for i in range(m - 1, -1, -1):
        for j in range(i + 1, m):
            matrix[i, r] -= factors[i, j] * matrix[j, r]
        pivot = factors[i, i]
        matrix[i, r] = select(pivot == 0.0, np.nan, matrix[i, r] / pivot)
