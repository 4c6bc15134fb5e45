"""Lengths of the columns that `tangent` multiplies: orthonormal columns, products, logarithms."""

import numpy as np

from ..compiling.llvm import for_size, lesser
from ..compiling.numba import function
from .generated_tangent import (
    LARGEST_LENGTH,
    LEAST_LENGTH,
    LENGTHS,
    NEAR_1,
    NEAR_1_LARGEST,
    NEAR_1_LEAST,
    VOLUME,
)


@function
def orthonormalise(q, g, room, due):
    """Orthonormalise the columns q[i room + r, lane] of the lanes in `due` (modified Gram-Schmidt).

    The products of lengths in g are multiplied by the lengths. VOLUME becomes 1; or 0 if a column
    is 0, because then it does not show how the other columns grow.
    """
    for_size()
    D = len(g) - LENGTHS
    for l in range(q.shape[1]):
        if (due >> l) & 1 == 0:
            continue
        g[VOLUME, l] = 1.0
        for r in range(D):
            product = 0.0
            for i in range(D):
                product += q[i * room, l] * q[i * room + r, l]
            for s in range(r):
                part, product = product, 0.0
                for i in range(D):
                    x = q[i * room + r, l] - part * q[i * room + s, l]
                    q[i * room + r, l] = x
                    product += q[i * room + s + 1, l] * x
            length = np.sqrt(product)  # now that of column r with itself
            g[LENGTHS + r, l] *= length
            g[VOLUME, l] *= 0.0 if length == 0.0 else 1.0
            inverse = 0.0 if length == 0.0 else 1.0 / length
            for i in range(D):
                q[i * room + r, l] *= inverse


@function
def take_logarithms(g, sums, of_det, begin, of_all):
    """Add the logarithms of products that leave their range, or of all, and begin new products."""
    for_size()
    for row in range(NEAR_1, len(g)):
        near = row == NEAR_1
        low, high = (NEAR_1_LEAST, NEAR_1_LARGEST) if near else (LEAST_LENGTH, LARGEST_LENGTH)
        for l in range(lesser(g.shape[1], len(of_det) - begin)):
            if of_all or g[row, l] <= low or g[row, l] >= high:
                logarithm = np.log1p(g[row, l]) if near else np.log(g[row, l])
                g[row, l] = 0.0 if near else 1.0
                if row < LENGTHS:
                    of_det[begin + l] += logarithm
                else:
                    sums[begin + l, row - LENGTHS] += logarithm
