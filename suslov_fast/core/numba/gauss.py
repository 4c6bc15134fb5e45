"""Gaussian elimination for systems A y = b, where A is the identity plus other terms.

`eliminate` solves the systems of all lanes without row exchanges, so that loops over lanes are
SIMD, and units of the unknowns that are powers of two change no digit. Its pivots show which
systems lose digits (`keeps_digits`); `solve` solves those one at a time, with pivoting.

A block of systems is a[row, column, lane], the columns of A followed by right sides, and
b[LEAST, LARGEST or TO_SOLVE, lane]; a single system is a matrix. The number of lanes is an
argument, so that LLVM removes loops over one lane.
"""

import math

import numpy as np

from ..expressions.tolerances import LEAST_PIVOT
from .decorators import ZERO, formula, function, inlined, lesser
from .intrinsics import select
from .status_codes import NONFINITE, OK, SINGULAR

# Rows of b: the least modulus of a pivot; the largest modulus that the diagonal had, at least 1;
# and 1.0 for lanes that need `solve`, else 0.0.
LEAST, LARGEST, TO_SOLVE = range(3)
# One of m pivots counts as 0 up to m * ZERO_TO_ROUNDING times the sum of the moduli of its terms.
ZERO_TO_ROUNDING = 2.0**-50
ROUNDS = 20  # the most rounds of `balance`; 6 full equations with units 2**120 apart took 4 or 5


# Adding 0.0 keeps LLVM from turning `select` and a store into a masked store, which is slow.
@formula
def simd_max(v, w):
    """Return the larger number; w if v or w is NaN."""
    return select(v > w, v, w) + 0.0


@formula
def simd_min(v, w):
    """Return the smaller number; w if v or w is NaN."""
    return select(v < w, v, w) + 0.0


@formula
def keeps_digits(b, l):
    """Return True if `eliminate` lost no digits in lane l: b[LEAST] is not far below b[LARGEST]."""
    return b[LEAST, l] > LEAST_PIVOT * b[LARGEST, l]


@function
def eliminate(a, b, lanes):
    """Solve the systems of all lanes in place, without row exchanges; fill rows LEAST and LARGEST.

    Solutions replace right sides. L and U replace A, with inverse pivots on the diagonal.
    """
    m, columns, _ = a.shape
    for l in range(lanes):
        b[LEAST, l], b[LARGEST, l] = np.inf, 1.0
    for i in range(m):
        for l in range(lanes):
            b[LARGEST, l] = simd_max(abs(a[i, i, l]), b[LARGEST, l])
    for k in range(0, m, 2):  # pairs of pivots halve the number of loads
        for second in range(k, lesser(k + 2, m)):
            if second > k:
                for l in range(lanes):
                    a[second, k, l] *= a[k, k, l]
                for j in range(second, columns):
                    for l in range(lanes):
                        a[second, j, l] -= a[second, k, l] * a[k, j, l]
            for l in range(lanes):
                pivot = a[second, second, l]
                b[LEAST, l] = simd_min(abs(pivot), b[LEAST, l])
                b[LARGEST, l] = simd_max(abs(pivot), b[LARGEST, l])
                a[second, second, l] = 1.0 / pivot
        for i in range(k + 2, m):
            for l in range(lanes):
                a[i, k, l] *= a[k, k, l]
            for l in range(lanes):
                a[i, k + 1, l] = (a[i, k + 1, l] - a[i, k, l] * a[k, k + 1, l]) * a[k + 1, k + 1, l]
            for j in range(k + 2, columns):
                for l in range(lanes):
                    first = a[i, j, l] - a[i, k, l] * a[k, j, l]
                    a[i, j, l] = first - a[i, k + 1, l] * a[k + 1, j, l]
    for i in range(m - 1, -1, -1):
        for r in range(m, columns):
            for j in range(m - 1, i, -1):
                for l in range(lanes):
                    a[i, r, l] -= a[i, j, l] * a[j, r, l]
            for l in range(lanes):
                a[i, r, l] *= a[i, i, l]


@inlined
def memory_of_one(m):
    """Return arrays `a` and `units` for `solve`: for m unknowns and one right side."""
    return np.empty((m, m + 1, 1)), np.empty((2, m))


@function
def solve(a, units):
    """Solve one system (m, columns) in place, by scaling and partial pivoting; return its status.

    Solutions replace right sides, and pivots replace the diagonal; their product has the sign of
    det A. If a pivot is 0 to rounding, the status is SINGULAR. `units` (2, m) is workspace.
    """
    weights = units[1]
    undefined, size = 0.0, 0.0
    m, columns = a.shape
    balance(a, units[0])
    for i in range(m):
        largest = 1.0
        for j in range(m):
            largest = simd_max(abs(a[i, j]), largest)
        weights[i] = 1.0 / largest
        for j in range(columns):
            undefined += 0.0 * a[i, j]
            a[i, j] /= largest
    for k in range(m):
        pivot = k
        for i in range(k + 1, m):
            if abs(a[i, k]) > abs(a[pivot, k]):
                pivot = i
        if pivot != k:
            weights[k], weights[pivot] = weights[pivot], weights[k]
            for j in range(columns):  # the sign keeps the determinant
                a[k, j], a[pivot, j] = a[pivot, j], -a[k, j]
        # The size of the pivot's terms: the scaled 1 of the identity, the pivot itself, products.
        terms = weights[k] + abs(a[k, k])
        for j in range(k):
            terms += abs(a[k, j] * a[j, k])
        if abs(a[k, k]) <= m * ZERO_TO_ROUNDING * terms:
            a[k, k] = np.nan
        for i in range(k + 1, m):
            a[i, k] /= a[k, k]
            for j in range(k + 1, columns):
                a[i, j] -= a[i, k] * a[k, j]
    for i in range(m - 1, -1, -1):
        size += 0.0 * a[i, i]
        for r in range(m, columns):
            for j in range(i + 1, m):
                a[i, r] -= a[i, j] * a[j, r]
            a[i, r] /= a[i, i]
    for i in range(m):
        for r in range(m, columns):
            a[i, r] *= units[0, i]
            size += abs(a[i, r])
    if size < np.inf:
        return OK
    return SINGULAR if undefined == 0.0 and np.isnan(size) else NONFINITE


@inlined
def balance(a, units):
    """Rescale the unknowns of a system (m, columns) by powers of two, written to `units` (m,).

    The largest off-diagonal entries in the row and in the column of an unknown become about equal.
    """
    m, columns = a.shape
    for i in range(m):
        units[i] = 1.0
    for _ in range(ROUNDS):
        changes = ZERO
        for i in range(m):
            of_row, of_column = 0.0, 0.0
            for j in range(m):
                if j != i:
                    of_row = simd_max(abs(a[i, j]), of_row)
                    of_column = simd_max(abs(a[j, i]), of_column)
            power = math.frexp(of_row)[1] - math.frexp(of_column)[1]
            if of_row > 0.0 and of_column > 0.0:
                power = power // 2
            if power != 0 and abs(power) <= 500 and of_row + of_column < np.inf:
                changes += 1
                factor = math.ldexp(1.0, power)
                units[i] *= factor
                for j in range(columns):
                    a[i, j] /= factor
                for j in range(m):  # restores the diagonal, too
                    a[j, i] *= factor
        if changes == 0:
            break
