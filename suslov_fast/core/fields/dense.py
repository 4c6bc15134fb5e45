"""Steps of fields whose elimination fills most of the matrix, such as dense or Galerkin systems.

Lanes solve A(x) x_next = x + (eps/2) l x + eps c (see `careful`) without row exchanges. A(x) is
filled by columns, so that each coefficient is read once. Lanes that lose digits take the step by
`careful`.
"""

import functools
from typing import Any, NamedTuple

import numpy as np
from numba import types

from ..compiling.arrays import array_at
from ..compiling.codes import CHANGED
from ..compiling.elimination import simd_max, simd_min
from ..compiling.numba import c_function, function
from ..lists.planned_elimination import LEAST_PIVOT
from ..lists.step import of_one_sign
from .careful import crosses_0


class Spans(NamedTuple):
    """The terms v x_j x_k of a field as spans, of rows that follow each other; x_D is 1."""

    spans: Any  # (S, 5): j, k, first row, number of rows, first coefficient
    terms: Any  # (T,), the term of each coefficient
    of_one_sign: Any  # (D,), true for components that keep their sign along the motion


@functools.lru_cache(8)
def spans_of(step):
    """Return the `Spans` of a step."""
    i, j, k = step.indices
    terms = np.lexsort((i, k, j))
    i, j, k = i[terms], j[terms], k[terms]
    follows = np.zeros(len(i), bool)
    follows[1:] = (j[1:] == j[:-1]) & (k[1:] == k[:-1]) & (i[1:] == i[:-1] + 1)
    [at] = np.nonzero(~follows)
    spans = np.stack([j[at], k[at], i[at], np.diff(np.append(at, len(i))), at], axis=1)
    return Spans(spans, terms, np.isin(np.arange(step.D), [*of_one_sign(step.indices)]))


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


class DenseStage(NamedTuple):
    """The integers of the array that `take_dense_stage` takes."""

    D: int
    W: int
    spans: int  # address of `Spans.spans`, and their number
    count: int
    T: int
    for_each: int  # 1 if lanes have coefficients of their own
    of_one_sign: int  # address of `Spans.of_one_sign`
    tells_signs: int  # 1 if the stage is a whole step
    memory: int


PLACE = DenseStage(*range(len(DenseStage._fields)))


def memory_of_stage(D, W):
    """Return how many numbers of memory `take_dense_stage` needs."""
    return W * (2 * D * (D + 1) + D + 1)


@c_function(types.int64(*[types.int64] * 3))
def take_dense_stage(address, table, plan):
    """Take a stage of a line x (D, W), in place, as `runs_code.text_of_stage_by_runs`.

    The table has eps / 2 times the values of terms (1 or W, T); `plan` is that of a `DenseStage`.
    """
    p = array_at(plan, (len(PLACE),), np.int64)
    D, W = p[PLACE.D], p[PLACE.W]
    spans = array_at(p[PLACE.spans], (p[PLACE.count], 5), np.int64)
    of_one_sign = array_at(p[PLACE.of_one_sign], (D,), np.bool_)
    lanes, size = W if p[PLACE.for_each] else 1, 8 * W * D * (D + 1)
    coefficients = array_at(table, (lanes, p[PLACE.T]), np.float64)
    x = array_at(address, (D, W), np.float64)
    a = array_at(p[PLACE.memory], (W, D, D + 1), np.float64)
    columns = array_at(p[PLACE.memory] + size, (W, D + 1, D), np.float64)
    states = array_at(p[PLACE.memory] + 2 * size, (W, D + 1), np.float64)
    for l in range(W):
        states[l, D] = 1.0
        for i in range(D):
            states[l, i] = x[i, l]
    fill(spans, coefficients, states, columns, a)
    bits = np.int64(0)
    for l in range(W):
        is_good, negative = solve_rows(a[l], np.inf)
        bit, changes, undefined = np.int64(1) << l, False, 0.0
        for i in range(D):
            undefined += 0.0 * a[l, i, D]
            changes |= of_one_sign[i] and crosses_0(x[i, l], a[l, i, D])
        if is_good and undefined == 0.0:
            for i in range(D):
                x[i, l] = a[l, i, D]
            bits |= (bit << 8) if negative else 0
            bits |= (bit << (8 + CHANGED)) if changes and p[PLACE.tells_signs] else 0
        else:
            bits |= bit
    return bits
