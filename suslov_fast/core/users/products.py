"""The growth of tangent vectors by derivatives that others computed, for maps without `tangent`."""

import numpy as np

from ..compiling.elimination import eliminate_below, exchange
from ..compiling.numba import function, kernel, share


@function
def logarithm_of_det(a):
    """Return log(abs(det a)) by elimination with pivoting, which overwrites a (D, D)."""
    total = 0.0
    for k in range(len(a)):
        exchange(a, k, 1.0)
        if a[k, k] == 0.0:
            return -np.inf
        total += np.log(abs(a[k, k]))
        eliminate_below(a, k)
    return total


@function
def orthonormalise(q, sums):
    """Orthonormalise the columns of q (D, D), and add the logarithms of their lengths to sums (D,).

    By modified Gram-Schmidt, twice, because columns that are almost parallel lose digits the first
    time. A column that is 0 stays 0, and its logarithm is -inf.
    """
    D = len(q)
    for r in range(D):
        length = 0.0
        for _ in range(2):
            for s in range(r):
                part = 0.0
                for i in range(D):
                    part += q[i, s] * q[i, r]
                for i in range(D):
                    q[i, r] -= part * q[i, s]
        for i in range(D):
            length += q[i, r] * q[i, r]
        if length == 0.0:
            sums[r] = -np.inf
            continue
        length = np.sqrt(length)
        sums[r] += np.log(length)
        for i in range(D):
            q[i, r] /= length


@kernel
def growth_of_products(part, parts, slopes, q, sums, of_det):
    """Add the logarithms of the growth of D lengths, and of |det|, over steps with these slopes.

    slopes       (n, B, D, D), the derivatives of the steps
    q            (B, D, D), the orthonormal columns before the steps, replaced by those after them
    sums, of_det   (B, D) and (B,), to which logarithms are added
    """
    n, B, D, _ = slopes.shape
    before, first, last = np.empty((D, D)), *share(B, part, parts)
    for b in range(first, last):
        for k in range(n):
            for i in range(D):
                for j in range(D):
                    before[i, j] = q[b, i, j]
                    q[b, i, j] = 0.0
            for i in range(D):
                for m in range(D):
                    for j in range(D):
                        q[b, i, j] += slopes[k, b, i, m] * before[m, j]
            orthonormalise(q[b], sums[b])
            for i in range(D):
                for j in range(D):
                    before[i, j] = slopes[k, b, i, j]
            of_det[b] += logarithm_of_det(before)
