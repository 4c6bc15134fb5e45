"""Gaussian elimination of one system, scaled, with partial pivoting and one refinement."""

import numpy as np

from .._formulas.coordinates import ZERO_TO_ROUNDING
from .._formulas.elementary import exponent, larger, two_to_the
from .._jit import inlined, inner
from .codes import NONFINITE, OK, SINGULAR

# Rounds of `balance`, at most: two or three do, unless unknowns are coupled in one direction.
ROUNDS = 20


@inner
def solve_system(system, scales):
    """Solve one system of m equations, with a small error in each of its coefficients.

    The matrix is the identity and other terms, as in `eliminate`. Unknowns and equations are scaled
    by powers of two; pivots are chosen for rows of equal size; and each solution is refined once.
    Returns the status of the first solution: SINGULAR if it is NaN and all numbers given are
    finite, NONFINITE if it is infinite or they are not.

    system   (2, m, m + r): in system[0] the coefficients and r right sides; these become the
             solutions, and the diagonal the pivots, 0 or, if they are 0 to rounding, NaN. Solutions
             are NaN then. system[1] is scratch.
    scales   (2, m), scratch
    """
    matrix, original, units, weights = system[0], system[1], scales[0], scales[1]
    m, columns = matrix.shape
    balance(matrix, units)
    poison = 0.0
    for i in range(m):
        largest = 0.0
        for j in range(m):
            largest = larger(abs(matrix[i, j]), largest)
        weights[i] = 1.0 / largest
        for j in range(columns):
            original[i, j] = matrix[i, j]
            poison += 0.0 * matrix[i, j]
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
    size = 0.0
    for r in range(m, columns):
        for i in range(m):
            matrix[i, r] = 0.0
        for refined in range(2):
            for i in range(m):
                weights[i] = original[i, r]
                for j in range(m):
                    weights[i] -= original[i, j] * matrix[j, r]
            substitute(matrix, weights)
            for i in range(m):
                keep = refined == 1 and not abs(weights[i]) < np.inf
                matrix[i, r] += 0.0 if keep else weights[i]
        for i in range(m):
            matrix[i, r] *= units[i]
            size += abs(matrix[i, r]) if r == m else 0.0
    if size < np.inf:
        return OK
    return SINGULAR if poison == 0.0 and np.isnan(size) else NONFINITE


@inlined
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


@inlined
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


@inlined
def substitute(factors, right):
    """Replace a right side by the solution, NaN if a pivot is 0."""
    m = len(right)
    for i in range(m):
        for j in range(i):
            right[i] -= factors[i, j] * right[j]
    for i in range(m - 1, -1, -1):
        for j in range(i + 1, m):
            right[i] -= factors[i, j] * right[j]
        pivot = factors[i, i]
        right[i] = right[i] / pivot if pivot != 0.0 else np.nan
