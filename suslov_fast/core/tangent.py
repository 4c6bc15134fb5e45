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
from .llvm import LINE, for_size, line_of, load, room, store, uncounted
from .numba import function, inlined, keep, kernel, lesser, select, share
from .operations import ENDED, FIRST
from .steps_field import (
    count_inaccurate,
    enter_fields,
    execute,
    execute_one,
    fill_system,
    is_accurate,
    memory_of_lane,
    restore,
    solve_lane,
)

# Rows of g: 1 if a lane is left to `derive`; the status of its step; |det DPhi| of that; 1 if its
# columns are to be orthonormalised; two for the test whether they are; a length. From VOLUME on
# they are carried: |det| of the columns; the product of the factors of |det DPhi| that are near 1,
# less 1; that of the others; and, from LENGTHS on, products of lengths.
TO_SOLVE, CODE, SOLVED, DUE, SIZE, POWER, LENGTH, VOLUME, NEAR_1, FAR_FROM_1, LENGTHS = range(11)
# Logarithms are taken of products that leave these ranges: what lies within keeps its digits.
NEAR_1_LEAST, NEAR_1_LARGEST, LEAST_LENGTH, LARGEST_LENGTH = -0.999, 1e3, 1e-100, 1e100
# Columns are orthonormalised after every INTERVAL steps, and earlier where they may lose digits. Of
# D columns with |det| = d, whose squared lengths have the mean m, d**2 <= m**D, and equality means
# that they are orthogonal and equally long. A column of length p with a part t across the others
# has d**2 <= t**2 ((D m - p**2) / (D - 1))**(D - 1) <= m**D (t / p)**2. So while m**D is below
# LIMIT**2 d**2, p / t is below LIMIT, by which errors of rounding are multiplied at most.
INTERVAL, LIMIT, LEAST_SIZE, LARGEST_SIZE = 16, 64.0, 1e-100, 1e100


@inlined
def memory_of_tangents(rows, D, count):
    """Return b and g, numbers of lanes; derivatives by `derive`; its memory and `solve_lane`'s."""
    most, lanes = 128 if rows <= 250 else 64 if rows <= 1200 else 32, LINE
    while lanes < lesser(count, most):
        lanes *= 2
    b, g, solved = room((rows, lanes)), room((LENGTHS + D, lanes)), room((lanes, D, D))
    return b, g, solved, memory_of_lane(D, 1), memory_of_lane(D, D)


@inlined
def derive(indices, plan, b, l, memory, out):
    """Fill out[r] with -DPhi q, for column r of lane l, by partial pivoting; return det DPhi."""
    step, _, _, first, width, _, _ = plan
    system, units, x = memory
    D = len(x)
    for i in range(D):
        x[i] = b[FIRST + i, l]
    fill_system(indices, b, l, -1.0, x, system)
    for i in range(D):
        for r in range(D):
            out[r, i] = 0.0
            system[i, D + r, 0] = 0.0
            for j in range(D):
                out[r, i] -= system[i, j, 0] * b[first + width * j + r, l]
    solve(system, units)
    determinant = determinant_of(system, units)
    restore(step, b, l, x)
    fill_system(indices, b, l, 1.0, x, system)
    for i in range(D):
        for r in range(D):
            system[i, D + r, 0] = out[r, i]
    solve(system, units)
    for i in range(D):
        for r in range(D):
            out[r, i] = system[i, D + r, 0]
    # 1 / 0 is no error in Python, too
    return determinant / np.float64(determinant_of(system, units))


@inlined
def carry_out(operations, b, alone):
    """Carry out operations for all lanes, or for lane 0 alone."""
    if alone:
        execute_one(operations, b)
    else:
        execute(operations, b)


@inlined
def tangent_step(indices, plan, b, g, solved, of_step, of_tangent, alone):
    """Take the step of all lanes, or of lane 0 alone; and replace their columns q by -DPhi q."""
    step, back, columns, first, width, _, _ = plan
    lanes, D = b.shape[1], solved.shape[1]
    carry_out(step, b, alone)
    to_solve = count_inaccurate(b)
    for l in range(lanes):
        g[TO_SOLVE, l], g[CODE, l] = 0.0, OK
        if to_solve > 0 and not is_accurate(b, l):
            g[CODE, l] = solve_lane(indices, step, b, l, of_step)
            g[TO_SOLVE, l] = 1.0
    carry_out(back, b, alone)
    to_solve = 0
    for l in range(lanes):
        g[TO_SOLVE, l] = select(is_accurate(b, l), g[TO_SOLVE, l], 1.0)
        to_solve += select(g[TO_SOLVE, l] > 0.0, 1, 0)
    for l in range(lanes if to_solve > 0 else 0):
        if g[TO_SOLVE, l] > 0.0:
            g[SOLVED, l] = abs(derive(indices, plan, b, l, of_tangent, solved[l]))
    execute(columns, b)
    for l in range(lanes if to_solve > 0 else 0):
        for i in range(D if g[TO_SOLVE, l] > 0.0 else 0):
            for r in range(D):
                b[first + width * i + r, l] = solved[l, r, i]


@inlined
def enter_tangents(values, eps, states, b, begin, end, start, status, failed_at):
    """Fill a block as `enter_fields`; and the rows of -h v and of -1. Lanes beyond the last end."""
    half, T, lanes = FIRST + states.shape[1], values.shape[1], b.shape[1]
    enter_fields(values, eps, states, b, begin, end, start, status, failed_at)
    for t in range(half, half + T):
        for l in range(lanes):
            b[t + T, l] = -b[t, l]
    for l in range(lanes):
        b[half + 2 * T, l] = -1.0
    for l in range(end - begin, lanes):
        b[ENDED, l] = 1.0


@inlined
def enter_units(b, first, width, D):
    """Let the columns be those of the identity."""
    for i in range(D):
        for r in range(D):
            for l in range(b.shape[1]):
                b[first + width * i + r, l] = 1.0 if i == r else 0.0


@kernel
def jacobians(part, parts, arguments, x, out):
    """Fill out (B, D, D) with DPhi at the states x (B, D), NaN where it does not exist."""
    for_size()
    (indices, plan, values, eps), (B, D) = arguments, x.shape
    _, _, _, first_row, width, rows, _ = plan
    memory = memory_of_tangents(rows, D, B)
    b, g, solved, of_step, of_tangent = uncounted(memory)
    lanes, status, failed_at = b.shape[1], np.zeros(B, np.int8), np.empty(B, np.int64)
    first_block, last_block = share((B + lanes - 1) // lanes, part, parts)
    for begin in range(first_block * lanes, lesser(last_block * lanes, B), lanes):
        end = lesser(begin + lanes, B)
        enter_tangents(values, eps, x, b, begin, end, 0, status, failed_at)
        enter_units(b, first_row, width, D)
        tangent_step(indices, plan, b, g, solved, of_step, of_tangent, end - begin == 1)
        for l in range(end - begin):
            for i in range(D):
                for r in range(D):
                    out[begin + l, i, r] = 0.0 * b[FIRST + i, l] - b[first_row + width * i + r, l]
    keep(memory)


@kernel
def densities(part, parts, arguments, x, out):
    """Fill out (B,) with 1 / det A at the states x (B, D), infinite where it is 0 to rounding."""
    (indices, plan, values, eps), (B, D) = arguments, x.shape
    step, _, _, _, _, rows, pivots = plan
    b, _, _, of_step, _ = memory_of_tangents(rows, D, B)
    lanes, status, failed_at = b.shape[1], np.zeros(B, np.int8), np.empty(B, np.int64)
    first_block, last_block = share((B + lanes - 1) // lanes, part, parts)
    for begin in range(first_block * lanes, lesser(last_block * lanes, B), lanes):
        end = lesser(begin + lanes, B)
        enter_tangents(values, eps, x, b, begin, end, 0, status, failed_at)
        execute(step, b)
        for l in range(end - begin):
            density = 1.0
            if is_accurate(b, l):
                for k in range(pivots.shape[1]):
                    density *= b[pivots[2, k], l]
            else:
                solve_lane(indices, step, b, l, of_step)
                density = 1.0 / np.float64(determinant_of(of_step[0], of_step[1]))
            for i in range(D):
                density += 0.0 * x[begin + l, i]
            out[begin + l] = density


@kernel
def growth(part, parts, arguments, x0, carry, span, sums, of_det, status, failed_at):
    """Add the logarithms of the growth of D lengths, and of |det DPhi|, along orbits.

    The derivatives of the steps are multiplied, and the product is decomposed as Q R, beginning
    with Q = 1: these are the logarithms of the diagonal of R. When that happens depends on the
    trajectory and on the number of the step alone, and all that a trajectory needs is carried: its
    bits do not depend on others, nor on where a run is divided. (Columns become -DPhi q, as their
    signs do not matter.)

    arguments   indices (3, T); a `TangentPlan`; values (1 or B, T); eps (1 or B,)
    x0, carry    (B, D), read if the steps begin at 0; (B, 2 D + D D + 3), read otherwise, and
                 written
    span         trajectories, from one to before the other, and steps, likewise; the last of all
    sums, of_det   (B, D) and (B,), to which logarithms are added; NaN after a failure
    status, failed_at   (B,), as of `steps_field.field_steps`
    """
    for_size()
    indices, plan, values, eps = uncounted(arguments)
    sums, of_det = uncounted((sums, of_det))
    _, _, _, first_row, width, rows, pivots = plan
    first, last, start, stop, steps = span
    D = x0.shape[1]
    count = (last - first + parts - 1) // parts
    memory = memory_of_tangents(rows, D, count)
    b, g, solved, of_step, of_tangent = uncounted(memory)
    lanes, carried = b.shape[1], D + D * D
    first_block, last_block = share((last - first + lanes - 1) // lanes, part, parts)
    for block in range(first_block, last_block):
        begin = first + block * lanes
        end = lesser(begin + lanes, last)
        states = x0 if start == 0 else carry[:, :D]
        enter_tangents(values, eps, states, b, begin, end, start, status, failed_at)
        enter_units(b, first_row, width, D)
        for k in range(VOLUME, LENGTHS + D):
            for l in range(lanes):
                g[k, l] = 0.0 if k == NEAR_1 else 1.0
        for l in range(lanes if start > 0 else 0):
            k = lesser(begin + l, end - 1)
            for i in range(D):
                for r in range(D):
                    b[first_row + width * i + r, l] = carry[k, D + D * i + r]
            for j in range(VOLUME, LENGTHS + D):
                g[j, l] = carry[k, carried + j - VOLUME]
        for n in range(start + 1, stop + 1):
            tangent_step(indices, plan, b, g, solved, of_step, of_tangent, end - begin == 1)
            multiply_determinants(pivots, b, g, end - begin)
            for l in range(end - begin):
                if g[CODE, l] != OK:
                    status[begin + l], failed_at[begin + l] = int(g[CODE, l]), n
            is_last = n == steps
            if count_due(b, first_row, width, D, g, is_last or n % INTERVAL == 0) > 0:
                orthonormalise(b, first_row, width, D, g)
            take_logarithms(g, sums, of_det, begin, end, is_last)
        for l in range(end - begin):
            i = begin + l
            of_det[i] += 0.0 * b[FIRST, l]
            for k in range(D):
                sums[i, k] += 0.0 * b[FIRST + k, l]
        for l in range(end - begin if stop < steps else 0):
            k = begin + l
            for i in range(D):
                carry[k, i] = b[FIRST + i, l]
                for r in range(D):
                    carry[k, D + D * i + r] = b[first_row + width * i + r, l]
            for j in range(VOLUME, LENGTHS + D):
                carry[k, carried + j - VOLUME] = g[j, l]
    keep(memory)


@function
def multiply_determinants(pivots, b, g, lanes):
    """Multiply by |det DPhi| = prod |p_k / q_k|, with pivots p of 1 - M(x_next) and q of 1 - N(x).

    Short steps need p_k / q_k - 1 = (N_kk - M_kk) / q_k, after elimination.
    """
    for k in range(pivots.shape[1]):
        N_kk, M_kk, per_q, per_p = pivots[0, k], pivots[1, k], pivots[2, k], pivots[3, k]
        for l in range(lanes):
            change = (b[N_kk, l] - b[M_kk, l]) * b[per_q, l]
            near, good = abs(change) < 0.5, g[TO_SOLVE, l] == 0.0
            quotient = select(good & ~near, abs(b[per_q, l] / b[per_p, l]), 1.0)
            change = select(good & near, change, 0.0)
            g[NEAR_1, l] += change + g[NEAR_1, l] * change
            g[FAR_FROM_1, l] *= quotient
            g[VOLUME, l] *= quotient + quotient * change
    for l in range(lanes):
        g[FAR_FROM_1, l] *= select(g[TO_SOLVE, l] == 0.0, 1.0, g[SOLVED, l])
        g[VOLUME, l] *= select(g[TO_SOLVE, l] == 0.0, 1.0, 0.0)


@function
def count_due(b, first, width, D, g, always):
    """Mark the lanes whose columns are to be orthonormalised, and count them."""
    lanes, due = b.shape[1], 0
    for l in range(0, lanes, LINE):
        size, power = line_of(0.0), line_of(1.0)
        for r in range(D):
            square = line_of(0.0)
            for i in range(D):
                x = load(b, first + width * i + r, l)
                square = square + x * x
            size = size + square
        mean = line_of(1.0 / D) * size
        for _ in range(D):
            power = power * mean
        store(g, SIZE, l, size)
        store(g, POWER, l, power)
    for l in range(lanes):
        size, most = g[SIZE, l], LIMIT * g[VOLUME, l]
        good = (size > LEAST_SIZE) & (size < LARGEST_SIZE) & (g[POWER, l] < most * most)
        g[DUE, l] = select((always | ~good) & (b[ENDED, l] == 0.0), 1.0, 0.0)
        due += select(g[DUE, l] > 0.0, 1, 0)
    return due


@function
def orthonormalise(b, first, width, D, g):
    """Orthonormalise the columns of lanes that are due; multiply the lengths. Columns may be 0."""
    lanes = b.shape[1]
    for l in range(lanes):
        g[VOLUME, l] = select(g[DUE, l] > 0.0, 1.0, g[VOLUME, l])
    for r in range(D):
        for l in range(0, lanes, LINE):  # the modified Gram-Schmidt method
            product = line_of(0.0)
            for i in range(D):
                row = first + width * i
                product = product + load(b, row, l) * load(b, row + r, l)
            for s in range(r):
                part, product = product * load(g, DUE, l), line_of(0.0)
                for i in range(D):
                    row = first + width * i
                    x = load(b, row + r, l) - part * load(b, row + s, l)
                    store(b, row + r, l, x)
                    product = product + load(b, row + s + 1, l) * x
            store(g, LENGTH, l, product)  # in the end, that of the column with itself
        for l in range(lanes):
            length = select(g[DUE, l] > 0.0, np.sqrt(g[LENGTH, l]), 1.0)
            g[LENGTHS + r, l] *= length
            # No volume shows how columns beside one that is 0 grow together.
            g[VOLUME, l] *= select(length == 0.0, 0.0, 1.0)
            g[LENGTH, l] = select(length == 0.0, 0.0, 1.0 / length)
        for i in range(D):
            row = first + width * i + r
            for l in range(0, lanes, LINE):
                store(b, row, l, load(b, row, l) * load(g, LENGTH, l))


@function
def take_logarithms(g, sums, of_det, begin, end, always):
    """Add the logarithms of products that leave their range, or of all, and begin new ones."""
    for row in range(NEAR_1, LENGTHS + sums.shape[1]):
        near, outside = row == NEAR_1, 0
        low, high = (NEAR_1_LEAST, NEAR_1_LARGEST) if near else (LEAST_LENGTH, LARGEST_LENGTH)
        for l in range(end - begin):
            outside += 1 if (g[row, l] <= low) | (g[row, l] >= high) else 0
        for l in range(end - begin if always or outside > 0 else 0):
            if always or g[row, l] <= low or g[row, l] >= high:
                logarithm = np.log1p(g[row, l]) if near else np.log(g[row, l])
                g[row, l] = 0.0 if near else 1.0
                if row < LENGTHS:
                    of_det[begin + l] += logarithm
                else:
                    sums[begin + l, row - LENGTHS] += logarithm


# At a prompt they run as Python does: lines are not checked.
count_due._for_calls = count_due.py_func
orthonormalise._for_calls = orthonormalise.py_func
