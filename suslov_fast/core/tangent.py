"""Derivatives of Kahan's map of a quadratic field, and how lengths grow under their products.

A(x) = 1 - (eps/2) f'(x), and DPhi(x) = A(x)**-1 (1 + (eps/2) f'(x_next)); the second factor is
2 - A(x_next) (theory, section 7). Every map of the package is one of these: `body.terms` are its
indices (3, T) and values (..., T), see `steps_field`.

derive   products of DPhi with columns, for one lane, with pivots
growth   a kernel: logarithms of lengths and determinants along orbits

With the sums (B, D) and of_det (B,) of `growth`, the Lyapunov exponents after N steps are
sums[:, :-1] / N and, as the last, (of_det - sums[:, :-1].sum(axis=1)) / N: so their sum is the
mean of log |det DPhi|, to rounding. (Where another one is -inf, the last is sums[:, -1] / N.)
"""

import numpy as np

from .elimination import (
    TO_SOLVE,
    determinant_of,
    eliminate,
    keeps_digits,
    memory_of_one,
    solve,
    substitute,
)
from .numba import function, kernel, lesser, select, share
from .steps_field import advance, advance_failed, enter, fill, lanes_of

# Rows of b after those of `elimination`: the product of the factors of |det DPhi| that are near 1,
# less 1; that of the others; and, from LENGTHS on, the products of lengths.
NEAR_1, FAR, LENGTHS = range(TO_SOLVE + 1, TO_SOLVE + 4)
# Logarithms are taken of products that leave these ranges: what lies within keeps its digits.
NEAR_1_LEAST, NEAR_1_LARGEST, LEAST, LARGEST = -0.999, 1e3, 1e-100, 1e100


@function
def derive(indices, x, fixed, half, after, q, v, l, system, units):
    """Replace columns v of lane l by DPhi q, with partial pivoting; return det DPhi.

    x holds the states, and `after` A of the next ones; `system` and `units` are memory for `solve`.
    """
    D = len(q)
    fill(indices, half, fixed, x, system, l, 1)
    for i in range(D):
        for r in range(D):
            system[i, D + r, 0] = 2.0 * q[i, r, l]
            for j in range(D):
                system[i, D + r, 0] -= after[i, j, l] * q[j, r, l]
    solve(system, units)
    determinant = np.float64(determinant_of(system, units))  # 1 / 0 is no error in Python, too
    for i in range(D):
        for r in range(D):
            v[i, r, l] = system[i, D + r, 0]
            system[i, r, 0] = (2.0 if i == r else 0.0) - after[i, r, l]
    solve(system, units)
    return determinant_of(system, units) / determinant


@kernel
def growth(part, parts, parameters, x0, carry, span, sums, of_det, status, failed_at):
    """Add the logarithms of the growth of D lengths, and of |det DPhi|, along orbits.

    The derivatives of the steps are multiplied, and the product is decomposed as Q R after each
    step, beginning with Q = 1: these are the logarithms of the diagonal of R.

    parameters   those of `steps_field.steps`
    x0, carry    (B, D), read if the steps begin at 0; (B, D + D D), read otherwise, and written
    span         trajectories, from one to before the other, and steps, likewise
    sums, of_det   (B, D) and (B,), to which logarithms are added; NaN after a failure
    status, failed_at   (B,), as of `steps_field.steps`
    """
    indices = parameters[0]
    first, last, start, stop = span
    T, D = indices.shape[1], x0.shape[1]
    lanes = lanes_of(D, last - first)
    x, before, half = np.empty((D, lanes)), np.empty((D, lanes)), np.empty((T, lanes))
    fixed = np.empty((D, D + 1, lanes))
    a, after = np.empty_like(fixed), np.empty_like(fixed)
    b, of_back = np.empty((LENGTHS + D, lanes)), np.empty((TO_SOLVE, lanes))
    q, v, back = np.empty((D, D, lanes)), np.empty((D, D, lanes)), np.empty((D, D, lanes))
    more, one, system = np.empty((2, D, lanes)), memory_of_one(D), np.empty((D, 2 * D, 1))
    first_block, last_block = share((last - first + lanes - 1) // lanes, part, parts)
    for block in range(first_block, last_block):
        begin = first + block * lanes
        end = lesser(begin + lanes, last)
        states = x0 if start == 0 else carry
        enter(parameters, states, x, fixed, half, begin, end, start, status, failed_at)
        for l in range(lanes):
            k = lesser(begin + l, end - 1)
            b[NEAR_1, l], b[FAR, l] = 0.0, 1.0
            for i in range(D):
                b[LENGTHS + i, l] = 1.0
                for j in range(D):
                    unit = 1.0 if i == j else 0.0
                    q[i, j, l] = unit if start == 0 else carry[k, D + D * i + j]
        fill(indices, half, fixed, x, a, 0, lanes)
        for n in range(start + 1, stop + 1):
            for i in range(D):
                for l in range(lanes):
                    before[i, l] = x[i, l]
            fill_diagonals(indices, half, x, more[0], -1.0)
            if advance(a, x, b, lanes) > 0:
                advance_failed(indices, x, fixed, half, b, one, begin, end, n, status, failed_at)
            fill(indices, half, fixed, x, after, 0, lanes)
            fill_diagonals(indices, half, x, more[1], 1.0)
            fill_right_sides(after, q, v, back)
            substitute(a, v)
            eliminate(back, of_back, lanes)
            for l in range(lanes):
                good = keeps_digits(of_back, l) & (b[TO_SOLVE, l] == 0.0) | np.isnan(x[0, l])
                b[TO_SOLVE, l] = 0.0 if good else 1.0
            multiply_determinants(a, back, more, b)
            for l in range(lanes):
                if b[TO_SOLVE, l] > 0.0:
                    b[FAR, l] *= abs(
                        derive(indices, before, fixed, half, after, q, v, l, system, one[1])
                    )
            orthonormalise(v, b)
            take_logarithms(b, sums, of_det, begin, end, False)
            a, after, q, v = after, a, v, q
        take_logarithms(b, sums, of_det, begin, end, True)
        for l in range(end - begin):
            k = begin + l
            of_det[k] += 0.0 * x[0, l]
            for i in range(D):
                carry[k, i] = x[i, l]
                sums[k, i] += 0.0 * x[i, l]
                for j in range(D):
                    carry[k, D + D * i + j] = q[i, j, l]


@function
def fill_diagonals(indices, half, x, diagonal, sign):
    """Fill sign (eps/2) f'(x)_ii, to rounding."""
    D, lanes = x.shape
    diagonal[:] = 0.0
    for t in range(indices.shape[1]):
        i, j, k = indices[0, t], indices[1, t], indices[2, t]
        for l in range(lanes):
            if j == i:
                diagonal[i, l] += sign * half[t, l] * (x[k, l] if k < D else 1.0)
            if k == i:
                diagonal[i, l] += sign * half[t, l] * x[j, l]


@function
def fill_right_sides(after, q, v, back):
    """Fill (2 - A) q and 2 - A, for A in `after`."""
    D, _, lanes = q.shape
    for i in range(D):
        for r in range(D):
            unit = 2.0 if i == r else 0.0
            for l in range(lanes):
                back[i, r, l] = unit - after[i, r, l]
            for l in range(lanes):
                v[i, r, l] = 2.0 * q[i, r, l]
            for j in range(D):
                for l in range(lanes):
                    v[i, r, l] -= after[i, j, l] * q[j, r, l]


@function
def multiply_determinants(a, back, more, b):
    """Multiply by |det DPhi| = prod |p_i / q_i|, with pivots p of 2 - A(x_next) and q of A(x).

    `more` is what the diagonals of A(x) and 2 - A(x_next) have beyond 1. Less the products of L and
    U it is what the pivots have beyond 1; short steps need p_i / q_i - 1 = (p_i - q_i) / q_i.
    """
    D, lanes = a.shape[0], a.shape[2]
    for i in range(D):
        for k in range(i):
            for l in range(lanes):
                more[0, i, l] -= a[i, k, l] * a[k, i, l]
            for l in range(lanes):
                more[1, i, l] -= back[i, k, l] * back[k, i, l]
        for l in range(lanes):
            change = (more[1, i, l] - more[0, i, l]) * a[i, i, l]
            near, good = abs(change) < 0.5, b[TO_SOLVE, l] == 0.0
            quotient = select(good & ~near, a[i, i, l] / back[i, i, l], 1.0)
            change = select(good & near, change, 0.0)
            b[NEAR_1, l] += change + b[NEAR_1, l] * change
            b[FAR, l] *= abs(quotient)


@function
def orthonormalise(v, b):
    """Make the columns v orthonormal, and multiply the lengths; columns of length 0 remain."""
    D, _, lanes = v.shape
    length, along = np.empty(lanes), np.empty(lanes)
    for r in range(D):
        for s in range(r):  # the modified Gram-Schmidt method
            for l in range(lanes):
                along[l] = 0.0
            for i in range(D):
                for l in range(lanes):
                    along[l] += v[i, s, l] * v[i, r, l]
            for i in range(D):
                for l in range(lanes):
                    v[i, r, l] -= along[l] * v[i, s, l]
        for l in range(lanes):
            along[l] = 0.0
        for i in range(D):
            for l in range(lanes):
                along[l] += v[i, r, l] * v[i, r, l]
        for l in range(lanes):
            length[l] = np.sqrt(along[l])
            b[LENGTHS + r, l] *= length[l]
            length[l] = select(length[l] == 0.0, 0.0, 1.0 / length[l])
        for i in range(D):
            for l in range(lanes):
                v[i, r, l] *= length[l]


@function
def take_logarithms(b, sums, of_det, begin, end, always):
    """Add the logarithms of products that leave their range, or of all, and begin new ones."""
    for row in range(NEAR_1, LENGTHS + sums.shape[1]):
        near, outside = row == NEAR_1, 0
        low, high = (NEAR_1_LEAST, NEAR_1_LARGEST) if near else (LEAST, LARGEST)
        for l in range(b.shape[1]):
            outside += 1 if (b[row, l] <= low) | (b[row, l] >= high) else 0
        for l in range(end - begin if always or outside > 0 else 0):
            if always or b[row, l] <= low or b[row, l] >= high:
                logarithm = np.log1p(b[row, l]) if near else np.log(b[row, l])
                b[row, l] = 0.0 if near else 1.0
                if row < LENGTHS:
                    of_det[begin + l] += logarithm
                else:
                    sums[begin + l, row - LENGTHS] += logarithm
