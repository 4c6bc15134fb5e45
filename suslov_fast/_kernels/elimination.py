"""Gaussian elimination of many systems side by side, in the order of their unknowns.

No rows are exchanged, so the units of the unknowns change no digit. The pivots tell which systems
lose digits in this order; these are for `one_system.solve_system`.
"""

import numpy as np

from .._formulas.elementary import larger, smaller
from .._jit import LINE, inner, stack, subtract_product

# Usual and largest numbers of systems side by side. 128 take 0.6 of the time for 3 equations, and
# 0.9 for 12; matrices of 64 then leave the second cache.
WIDTH, WIDEST = 32, 128
# Elimination side by side is accurate if the ratio of `eliminate` is above this.
ACCURATE = 2.0**-8


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
