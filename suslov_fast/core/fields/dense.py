"""Steps of fields whose elimination fills most of the matrix, such as dense or Galerkin systems.

Lanes solve A(x) x_next = x + (eps/2) l x + eps c (see `careful`) without row exchanges. A(x) is
filled by columns, so that each coefficient is read once. Lanes that lose digits take the step as
those of `careful` do.
"""

import functools
from typing import Any, NamedTuple

import numpy as np

from ..compiling.codes import OK, PASSED_POLE
from ..compiling.elimination import simd_max, simd_min
from ..compiling.llvm import lesser
from ..compiling.numba import function, kernel, pick, share
from ..lists.planned_elimination import LEAST_PIVOT
from ..lists.step import of_one_sign
from .careful import crosses_0, solve_lane
from .lines import note_undefined

LANES = np.int64(8)  # that read the same coefficients


class Dense(NamedTuple):
    """Dense fields, and the stages of a step.

    The terms v x_j x_k stand in spans, of rows that follow each other; x_D is 1.
    """

    spans: Any  # (S, 5): j, k, first row, number of rows, first coefficient
    terms: Any  # (T,), the term of each coefficient
    of_one_sign: Any  # (D,), true for components that keep their sign along the motion
    indices: Any  # (3, T), of the terms
    fractions: Any  # (stages,), of eps
    values: Any  # (1 or B, T)
    eps: Any  # (1 or B,)


@functools.lru_cache(8)
def _spans_of(step):
    i, j, k = step.indices
    terms = np.lexsort((i, k, j))
    i, j, k = i[terms], j[terms], k[terms]
    follows = np.zeros(len(i), bool)
    follows[1:] = (j[1:] == j[:-1]) & (k[1:] == k[:-1]) & (i[1:] == i[:-1] + 1)
    [at] = np.nonzero(~follows)
    spans = np.stack([j[at], k[at], i[at], np.diff(np.append(at, len(i))), at], axis=1)
    return spans, terms, np.isin(np.arange(step.D), [*of_one_sign(step.indices)]), step.indices


def dense_steps_of(arguments, omega0, carry, span, saved, final, status, failed_at):
    """Return the arguments of `take_dense_steps` for those of `suslov.steps.steps`."""
    (scheme, *parameters), (begin, end, start, stop, every, row) = arguments, span
    own = slice(begin, end)
    if start == 0:
        final[own] = omega0[own]
        note_undefined(final[own], (status[own], failed_at[own], carry[0, own]))
        final[own][status[own] < 0] = np.nan
        if every:
            saved[row, own] = final[own]
            row += 1
    field = Dense(*_spans_of(scheme.step), np.array(scheme.stages.fractions), *parameters)
    return field, carry, (begin, end, start, stop, every, row), saved, final, status, failed_at


@function
def fill(spans, coefficients, states, columns, a):
    """Fill a (W, D, D + 1) with A(x) of lanes, and the last columns with right sides; x_D is 1.

    `columns` (W, D + 1, D) is memory. A term h v x_j x_k of row i adds h v x_k to N_ij and h v x_j
    to N_ik, where column D of N is the right side less x. Lanes take turns, because coefficients,
    the most of all memory, then are read once.
    """
    W, D, _ = a.shape
    for l in range(W):
        for j in range(D + 1):
            for i in range(D):
                columns[l, j, i] = states[l, i] if j == D else 0.0
    for s in range(len(spans)):
        j, k, begin, n, at = spans[s, 0], spans[s, 1], spans[s, 2], spans[s, 3], spans[s, 4]
        for l in range(W):
            values = coefficients[l % len(coefficients), at : at + n]
            one, other = columns[l, j, begin : begin + n], columns[l, k, begin : begin + n]
            x_j, x_k = states[l, j], states[l, k]
            for c in range(n):
                one[c] += values[c] * x_k
                other[c] += values[c] * x_j
    for l in range(W):
        for i in range(D):
            for j in range(D):
                a[l, i, j] = -columns[l, j, i]
            a[l, i, i], a[l, i, D] = 1.0 + a[l, i, i], columns[l, D, i]


@function
def solve_rows(a, most):
    """Replace the last column of a (D, D + 1) by the solution, with pivots on the diagonal.

    A is replaced by its factors, with inverse pivots on the diagonal. Return whether this kept
    digits, as `elimination.keeps_digits` (a pivot of `most` counts, too), and det A < 0. One row
    after the other is eliminated, because a row stays in the first cache.
    """
    D, least, largest, negative = len(a), most, 1.0, False
    for i in range(D):
        largest = simd_max(abs(a[i, i]), largest)
    for i in range(D):
        for k in range(0, i - 1, 2):
            first = a[i, k] * a[k, k]
            second = (a[i, k + 1] - first * a[k, k + 1]) * a[k + 1, k + 1]
            row, upper, lower = a[i, k + 2 :], a[k, k + 2 :], a[k + 1, k + 2 :]
            for j in range(D - k - 1):
                row[j] = row[j] - first * upper[j] - second * lower[j]
            a[i, k], a[i, k + 1] = first, second
        if i % 2:
            first, row, upper = a[i, i - 1] * a[i - 1, i - 1], a[i, i:], a[i - 1, i:]
            for j in range(D + 1 - i):
                row[j] -= first * upper[j]
            a[i, i - 1] = first
        pivot = a[i, i]
        least, largest = simd_min(abs(pivot), least), simd_max(abs(pivot), largest)
        negative ^= pivot < 0.0
        a[i, i] = 1.0 / pivot
    for i in range(D - 1, -1, -1):
        for j in range(D - 1, i, -1):
            a[i, D] -= a[i, j] * a[j, D]
        a[i, D] *= a[i, i]
    return least > LEAST_PIVOT * largest, negative


@function
def step_lane(indices, half, a, x, system, units):
    """Replace x (D,) by the next state, where `fill` has filled a; return status, and det A < 0."""
    D, undefined = len(x), 0.0
    is_good, negative = solve_rows(a, np.inf)
    for i in range(D):
        undefined += 0.0 * a[i, D]
    if not is_good or undefined != 0.0:
        return solve_lane(indices, half, x, system, units)
    for i in range(D):
        x[i] = a[i, D]
    return OK, negative


@function
def prepare(field, i, l, halves, coefficients):
    """Write h v of the terms of trajectory i, lane l, for each stage, in both orders."""
    values, eps = field.values[i if len(field.values) > 1 else 0], pick(field.eps, i)
    for s in range(len(field.fractions)):
        for t in range(len(values)):
            halves[s, l, t] = field.fractions[s] * (0.5 * eps * values[t])
        for t in range(len(values)):
            coefficients[s, l, t] = halves[s, l, field.terms[t]]


@kernel
def take_dense_steps(part, parts, field, carry, span, saved, final, status, failed_at):
    """Iterate the trajectories of a part from the states in `final`; see `suslov.steps.steps`."""
    begin, end, start, stop, every, row = span
    D, T, stages = final.shape[1], len(field.terms), len(field.fractions)
    for_each, abreast = len(field.values) > 1 or len(field.eps) > 1, lesser(LANES, end - begin)
    own = abreast if for_each else np.int64(1)
    halves, coefficients = np.empty((stages, own, T)), np.empty((stages, own, T))
    states, bases = np.empty((abreast, D + 1)), np.empty((abreast, D))
    columns, a = np.empty((abreast, D + 1, D)), np.empty((abreast, D, D + 1))
    system, units = np.empty((D, D + 1)), np.empty((2, D))
    first, last = share((end - begin + abreast - 1) // abreast, part, parts)
    if first < last and not for_each:
        prepare(field, 0, 0, halves, coefficients)
    for lo in range(begin + first * abreast, lesser(begin + last * abreast, end), abreast):
        W, at = lesser(abreast, end - lo), row
        for l in range(W):
            states[l, D] = 1.0
            for k in range(D):
                states[l, k] = final[lo + l, k]
            if for_each:
                prepare(field, lo + l, l, halves, coefficients)
        for n in range(start + 1, stop + 1):
            for l in range(W):
                for k in range(D):
                    bases[l, k] = states[l, k]
            for s in range(stages):
                fill(field.spans, coefficients[s], states[:W], columns, a[:W])
                for l in range(W):
                    i, x = lo + l, states[l, :D]
                    if status[i] >= 0:
                        half = halves[s, l % own]
                        new, beyond = step_lane(field.indices, half, a[l], x, system, units)
                        if new != OK:
                            status[i], failed_at[i] = new, n
                        elif beyond and carry[0, i] == 0.0:
                            carry[0, i], status[i], failed_at[i] = n, PASSED_POLE, n
            for l in range(W):
                i = lo + l
                for k in range(D if status[i] >= 0 and carry[0, i] == 0.0 else 0):
                    if field.of_one_sign[k] and crosses_0(bases[l, k], states[l, k]):
                        carry[0, i], status[i], failed_at[i] = -n, PASSED_POLE, n
                for k in range(D if every and n % every == 0 else 0):
                    saved[at, i, k] = states[l, k]
            at += every > 0 and n % every == 0
        for l in range(W):
            for k in range(D):
                final[lo + l, k] = states[l, k]
