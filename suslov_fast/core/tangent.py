"""Derivatives of Kahan's map of a quadratic field, and how lengths grow under their products.

With h = eps / 2, N(x) = h f'(x) and M(x) = -N(x), the derivative is
DPhi(x) = (1 - N(x))**-1 (1 - M(x_next)) (theory, section 7). Every map of the package is one of
these: `body.terms` are its indices (3, T) and values (..., T), see `steps_field`. The operations of
a step are followed by those of M and of its pivots, and by products with columns (`operations`).

derive      products of DPhi with columns, for one lane, with pivots
jacobians   a kernel: DPhi at states
densities   a kernel: 1 / det A at states
growth      a kernel: logarithms of lengths and determinants along orbits

With the sums (B, D) and of_det (B,) of `growth`, the Lyapunov exponents after N steps are
sums[:, :-1] / N and, as the last, (of_det - sums[:, :-1].sum(axis=1)) / N: so their sum is the
mean of log |det DPhi|, to rounding. (Where another one is -inf, the last is sums[:, -1] / N.)
"""

import numpy as np

from .codes import OK
from .elimination import determinant_of, solve
from .numba import function, inlined, kernel, lesser, select, share
from .operations import ADD, ADD_2, FIRST, MUL, MUL_2
from .steps_field import (
    advance_block,
    enter_fields,
    execute,
    execute_one,
    fill_system,
    is_accurate,
    lanes_of_fields,
    memory_of_lane,
    restore,
    solve_lane,
)

# Rows of g: 1 if a lane is left to `derive`; the status of its step; the product of the factors of
# |det DPhi| that are near 1, less 1; that of the others; and, from LENGTHS on, products of lengths.
TO_SOLVE, CODE, NEAR_1, FAR_FROM_1, LENGTHS = range(5)
# Logarithms are taken of products that leave these ranges: what lies within keeps its digits.
NEAR_1_LEAST, NEAR_1_LARGEST, LEAST_LENGTH, LARGEST_LENGTH = -0.999, 1e3, 1e-100, 1e100


@inlined
def memory_of_tangents(rows, D, count):
    """Return b and g, numbers of lanes; w, where w[i] is row i of q, and w[D + i] row i of v; and
    the memory of `solve_lane` and of `derive`.
    """
    lanes = lanes_of_fields(rows + 2 * D * D, count)
    b, g, w = np.empty((rows, lanes)), np.empty((LENGTHS + D, lanes)), np.empty((2 * D, D, lanes))
    return b, g, w, memory_of_lane(D, 1), memory_of_lane(D, D)


@function
def multiply_columns(operations, b, w):
    """Carry out operations on columns: v = -DPhi q."""
    _, D, lanes = w.shape
    for n in range(len(operations)):
        code, d = operations[n, 0], operations[n, 1]
        a, c = operations[n, 3], operations[n, 4]
        e, g = operations[n, 5], operations[n, 6]
        for r in range(D):
            if code == ADD_2:
                for l in range(lanes):
                    w[d, r, l] = w[d, r, l] + b[a, l] * w[c, r, l] + b[e, l] * w[g, r, l]
            elif code == ADD:
                for l in range(lanes):
                    w[d, r, l] = w[d, r, l] + b[a, l] * w[c, r, l]
            elif code == MUL_2:
                for l in range(lanes):
                    w[d, r, l] = b[a, l] * w[c, r, l] + b[e, l] * w[g, r, l]
            elif code == MUL:
                for l in range(lanes):
                    w[d, r, l] = b[a, l] * w[c, r, l]
            else:
                for l in range(lanes):
                    w[d, r, l] *= b[a, l]


@inlined
def derive(indices, operations, split, b, w, l, memory):
    """Replace v of lane l by -DPhi q, with partial pivoting; return det DPhi."""
    system, units, x = memory
    D = len(x)
    for i in range(D):
        x[i] = b[FIRST + i, l]
    fill_system(indices, b, l, -1.0, x, system)
    for i in range(D):
        for r in range(D):
            w[D + i, r, l] = 0.0
            system[i, D + r, 0] = 0.0
            for j in range(D):
                w[D + i, r, l] -= system[i, j, 0] * w[j, r, l]
    solve(system, units)
    determinant = determinant_of(system, units)
    restore(operations, split, b, l, x)
    fill_system(indices, b, l, 1.0, x, system)
    for i in range(D):
        for r in range(D):
            system[i, D + r, 0] = w[D + i, r, l]
    solve(system, units)
    for i in range(D):
        for r in range(D):
            w[D + i, r, l] = system[i, D + r, 0]
    # 1 / 0 is no error in Python, too
    return determinant / np.float64(determinant_of(system, units))


@inlined
def tangent_step(indices, plan, b, g, w, of_step):
    """Take the step of all lanes, and compute v = -DPhi q where this keeps digits."""
    operations, _, split, columns, _ = plan
    lanes = b.shape[1]
    to_solve = advance_block(operations, split, b)
    for l in range(lanes):
        g[TO_SOLVE, l], g[CODE, l] = 0.0, OK
        if to_solve > 0 and not is_accurate(b, l):
            g[CODE, l] = solve_lane(indices, operations, split, b, l, of_step)
            g[TO_SOLVE, l] = 1.0
    if lanes == 1:
        execute_one(operations, split, len(operations), b)
    else:
        execute(operations, split, len(operations), b)
    for l in range(lanes):
        g[TO_SOLVE, l] = select(is_accurate(b, l), g[TO_SOLVE, l], 1.0)
    multiply_columns(columns, b, w)


@inlined
def enter_tangents(values, eps, states, b, begin, end, start, status, failed_at):
    """Fill a block as `enter_fields`; and the rows of -h v and of -1."""
    half, T, lanes = FIRST + states.shape[1], values.shape[1], b.shape[1]
    enter_fields(values, eps, states, b, begin, end, start, status, failed_at)
    for t in range(half, half + T):
        for l in range(lanes):
            b[t + T, l] = -b[t, l]
    for l in range(lanes):
        b[half + 2 * T, l] = -1.0


@kernel
def jacobians(part, parts, arguments, x, out):
    """Fill out (B, D, D) with DPhi at the states x (B, D), NaN where it does not exist."""
    (indices, plan, values, eps), (B, D) = arguments, x.shape
    operations, rows, split, _, _ = plan
    b, g, w, of_step, of_tangent = memory_of_tangents(rows, D, B)
    lanes, status, failed_at = b.shape[1], np.zeros(B, np.int8), np.empty(B, np.int64)
    first_block, last_block = share((B + lanes - 1) // lanes, part, parts)
    for begin in range(first_block * lanes, lesser(last_block * lanes, B), lanes):
        end = lesser(begin + lanes, B)
        enter_tangents(values, eps, x, b, begin, end, 0, status, failed_at)
        for i in range(D):
            for r in range(D):
                for l in range(lanes):
                    w[i, r, l] = 1.0 if i == r else 0.0
        tangent_step(indices, plan, b, g, w, of_step)
        for l in range(end - begin):
            if g[TO_SOLVE, l] > 0.0:
                derive(indices, operations, split, b, w, l, of_tangent)
            for i in range(D):
                for r in range(D):
                    out[begin + l, i, r] = 0.0 * b[FIRST + i, l] - w[D + i, r, l]


@kernel
def densities(part, parts, arguments, x, out):
    """Fill out (B,) with 1 / det A at the states x (B, D), infinite where it is 0 to rounding."""
    (indices, plan, values, eps), (B, D) = arguments, x.shape
    operations, rows, split, _, pivots = plan
    b, _, _, of_step, _ = memory_of_tangents(rows, D, B)
    lanes, status, failed_at = b.shape[1], np.zeros(B, np.int8), np.empty(B, np.int64)
    first_block, last_block = share((B + lanes - 1) // lanes, part, parts)
    for begin in range(first_block * lanes, lesser(last_block * lanes, B), lanes):
        end = lesser(begin + lanes, B)
        enter_tangents(values, eps, x, b, begin, end, 0, status, failed_at)
        advance_block(operations, split, b)
        for l in range(end - begin):
            density = 1.0
            if is_accurate(b, l):
                for k in range(pivots.shape[1]):
                    density *= b[pivots[2, k], l]
            else:
                solve_lane(indices, operations, split, b, l, of_step)
                density = 1.0 / np.float64(determinant_of(of_step[0], of_step[1]))
            for i in range(D):
                density += 0.0 * x[begin + l, i]
            out[begin + l] = density


@kernel
def growth(part, parts, arguments, x0, carry, span, sums, of_det, status, failed_at):
    """Add the logarithms of the growth of D lengths, and of |det DPhi|, along orbits.

    The derivatives of the steps are multiplied, and the product is decomposed as Q R after each
    step, beginning with Q = 1: these are the logarithms of the diagonal of R. (v = -DPhi q, as
    signs of columns do not matter.)

    arguments   indices (3, T); a `TangentPlan`; values (1 or B, T); eps (1 or B,)
    x0, carry    (B, D), read if the steps begin at 0; (B, D + D D), read otherwise, and written
    span         trajectories, from one to before the other, and steps, likewise
    sums, of_det   (B, D) and (B,), to which logarithms are added; NaN after a failure
    status, failed_at   (B,), as of `steps_field.field_steps`
    """
    indices, plan, values, eps = arguments
    operations, rows, split, _, pivots = plan
    first, last, start, stop = span
    D = x0.shape[1]
    count = (last - first + parts - 1) // parts
    b, g, w, of_step, of_tangent = memory_of_tangents(rows, D, count)
    lanes = b.shape[1]
    length, along = np.empty(lanes), np.empty(lanes)
    first_block, last_block = share((last - first + lanes - 1) // lanes, part, parts)
    for block in range(first_block, last_block):
        begin = first + block * lanes
        end = lesser(begin + lanes, last)
        states = x0 if start == 0 else carry[:, :D]
        enter_tangents(values, eps, states, b, begin, end, start, status, failed_at)
        for l in range(lanes):
            k = lesser(begin + l, end - 1)
            g[NEAR_1, l], g[FAR_FROM_1, l] = 0.0, 1.0
            for i in range(D):
                g[LENGTHS + i, l] = 1.0
                for r in range(D):
                    unit = 1.0 if i == r else 0.0
                    w[i, r, l] = unit if start == 0 else carry[k, D + D * i + r]
        for n in range(start + 1, stop + 1):
            tangent_step(indices, plan, b, g, w, of_step)
            multiply_determinants(pivots, b, g)
            for l in range(lanes):
                if g[TO_SOLVE, l] > 0.0:
                    det = derive(indices, operations, split, b, w, l, of_tangent)
                    g[FAR_FROM_1, l] *= abs(det)
                    if g[CODE, l] != OK and begin + l < end:
                        status[begin + l], failed_at[begin + l] = int(g[CODE, l]), n
            orthonormalise(w, g, length, along)
            take_logarithms(g, sums, of_det, begin, end, False)
        take_logarithms(g, sums, of_det, begin, end, True)
        for l in range(end - begin):
            k = begin + l
            of_det[k] += 0.0 * b[FIRST, l]
            for i in range(D):
                carry[k, i] = b[FIRST + i, l]
                sums[k, i] += 0.0 * b[FIRST + i, l]
                for r in range(D):
                    carry[k, D + D * i + r] = w[i, r, l]


@function
def multiply_determinants(pivots, b, g):
    """Multiply by |det DPhi| = prod |p_k / q_k|, with pivots p of 1 - M(x_next) and q of 1 - N(x).

    Short steps need p_k / q_k - 1 = (N_kk - M_kk) / q_k, after elimination.
    """
    for k in range(pivots.shape[1]):
        N_kk, M_kk, per_q, per_p = pivots[0, k], pivots[1, k], pivots[2, k], pivots[3, k]
        for l in range(b.shape[1]):
            change = (b[N_kk, l] - b[M_kk, l]) * b[per_q, l]
            near, good = abs(change) < 0.5, g[TO_SOLVE, l] == 0.0
            quotient = select(good & ~near, b[per_q, l] / b[per_p, l], 1.0)
            change = select(good & near, change, 0.0)
            g[NEAR_1, l] += change + g[NEAR_1, l] * change
            g[FAR_FROM_1, l] *= abs(quotient)


@function
def orthonormalise(w, g, length, along):
    """Fill q with the orthonormalised columns of v; multiply the lengths. Columns may be 0."""
    _, D, lanes = w.shape
    for r in range(D):
        for s in range(r):  # the modified Gram-Schmidt method
            for l in range(lanes):
                along[l] = 0.0
            for i in range(D):
                for l in range(lanes):
                    along[l] += w[i, s, l] * w[D + i, r, l]
            for i in range(D):
                for l in range(lanes):
                    w[D + i, r, l] -= along[l] * w[i, s, l]
        for l in range(lanes):
            along[l] = 0.0
        for i in range(D):
            for l in range(lanes):
                along[l] += w[D + i, r, l] * w[D + i, r, l]
        for l in range(lanes):
            length[l] = np.sqrt(along[l])
            g[LENGTHS + r, l] *= length[l]
            length[l] = select(length[l] == 0.0, 0.0, 1.0 / length[l])
        for i in range(D):
            for l in range(lanes):
                w[i, r, l] = w[D + i, r, l] * length[l]


@function
def take_logarithms(g, sums, of_det, begin, end, always):
    """Add the logarithms of products that leave their range, or of all, and begin new ones."""
    for row in range(NEAR_1, LENGTHS + sums.shape[1]):
        near, outside = row == NEAR_1, 0
        low, high = (NEAR_1_LEAST, NEAR_1_LARGEST) if near else (LEAST_LENGTH, LARGEST_LENGTH)
        for l in range(g.shape[1]):
            outside += 1 if (g[row, l] <= low) | (g[row, l] >= high) else 0
        for l in range(end - begin if always or outside > 0 else 0):
            if always or g[row, l] <= low or g[row, l] >= high:
                logarithm = np.log1p(g[row, l]) if near else np.log(g[row, l])
                g[row, l] = 0.0 if near else 1.0
                if row < LENGTHS:
                    of_det[begin + l] += logarithm
                else:
                    sums[begin + l, row - LENGTHS] += logarithm
