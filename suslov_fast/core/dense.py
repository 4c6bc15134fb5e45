"""Steps of fields whose elimination fills most of the matrix, such as dense or Galerkin systems.

Lanes solve A(x) x_next = x + (eps/2) l x + eps c (see `careful`) without row exchanges. A(x) is
filled from spans: parts of a row that one component of x multiplies, in which columns follow each
other. Lanes that lose digits take the step by `careful`.
"""

import functools
from typing import Any, NamedTuple

import numpy as np

from .careful import CHANGED, crosses_0
from .elimination import LEAST_PIVOT, simd_max, simd_min
from .llvm import uncounted
from .numba import function, kernel
from .operations import of_one_sign


class Spans(NamedTuple):
    """The terms of a field as spans of rows of f'(x); component D of x is 1."""

    spans: Any  # (S, 5): row, component, first column, number of columns, first coefficient
    terms: Any  # (n,), of which a coefficient is this many times h v
    weights: Any  # (n,)
    linear: Any  # (L, 3): row, component, term, for the right sides
    constant: Any  # (C, 2): row, term
    of_one_sign: Any  # (D,), true for components that keep their sign along the motion


@functools.lru_cache(8)
def spans_of(step):
    """Return the `Spans` of a step."""
    (i, j, k), D, terms = step.indices, step.D, np.arange(step.T)
    is_constant, is_linear = j == D, (j < D) & (k == D)
    first, second = j < D, k < D  # terms with a derivative by x_j, and by x_k
    rows = np.concatenate([i[first], i[second]])
    factors = np.concatenate([k[first], j[second]])
    columns = np.concatenate([j[first], k[second]])
    of = np.concatenate([terms[first], terms[second]])
    order = np.lexsort((columns, factors, rows))
    rows, factors, columns, of = (each[order] for each in (rows, factors, columns, of))
    square = np.zeros(len(of), bool)  # x_j**2, whose two derivatives are equal
    square[1:] = (of[1:] == of[:-1]) & (columns[1:] == columns[:-1]) & (rows[1:] == rows[:-1])
    weights = np.ones(len(of))
    weights[:-1] += square[1:]
    rows, factors, columns, of, weights = (
        each[~square] for each in (rows, factors, columns, of, weights)
    )
    begins = np.ones(len(of), bool)
    begins[1:] = (
        (rows[1:] != rows[:-1]) | (factors[1:] != factors[:-1]) | (columns[1:] != columns[:-1] + 1)
    )
    [at] = np.nonzero(begins)
    lengths = np.diff(np.append(at, len(of)))
    spans = np.stack([rows[at], factors[at], columns[at], lengths, at], axis=1)
    linear = np.stack([i, j, terms], axis=1)[is_linear]
    constant = np.stack([i, terms], axis=1)[is_constant]
    keep = np.isin(np.arange(D), [*of_one_sign(step.indices)])
    return Spans(spans, of, weights, linear, constant, keep)


@function
def fill(spans, coefficients, states, a):
    """Fill a (W, D, D + 1) with A(x) of lanes, and the last columns with x; x_D is 1.

    Lanes take turns, because coefficients, the most of all memory, then are read once.
    """
    W, D, _ = a.shape
    for l in range(W):
        for i in range(D):
            for j in range(D):
                a[l, i, j] = 0.0
            a[l, i, i], a[l, i, D] = 1.0, states[l, i]
    s = 0
    while s < len(spans):
        i, m, begin, n, at = spans[s, 0], spans[s, 1], spans[s, 2], spans[s, 3], spans[s, 4]
        t = s + 1
        is_pair = t < len(spans) and spans[t, 0] == i and spans[t, 2] == begin and spans[t, 3] == n
        for l in range(W):
            row, values = a[l, i, begin : begin + n], coefficients[l % len(coefficients), at:]
            first = states[l, m]
            if is_pair:  # half of the loads and stores
                second, others = states[l, spans[t, 1]], values[n:]
                for c in range(n):
                    row[c] = row[c] - values[c] * first - others[c] * second
            else:
                for c in range(n):
                    row[c] -= values[c] * first
        s += 2 if is_pair else 1


@function
def solve_rows(a):
    """Replace the last column of a (D, D + 1) by the solution, with pivots on the diagonal.

    Return whether this kept digits, as `elimination.keeps_digits`, and the sign of det A < 0. One
    row after the other is eliminated, because a row stays in the first cache.
    """
    D, least, largest, negative = len(a), np.inf, 1.0, False
    for i in range(D):
        largest = simd_max(abs(a[i, i]), largest)
    for i in range(D):
        for k in range(0, i - 1, 2):
            first = a[i, k] * a[k, k]
            second = (a[i, k + 1] - first * a[k, k + 1]) * a[k + 1, k + 1]
            row, upper, lower = a[i, k + 2 :], a[k, k + 2 :], a[k + 1, k + 2 :]
            for j in range(D - k - 1):
                row[j] = row[j] - first * upper[j] - second * lower[j]
        if i % 2:
            first, row, upper = a[i, i - 1] * a[i - 1, i - 1], a[i, i:], a[i - 1, i:]
            for j in range(D + 1 - i):
                row[j] -= first * upper[j]
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
def advance_lane(x, l, after, of_one_sign, is_good, negative, marks):
    """Set lane l of x (D, W) to its next state, if that is accurate; return bits.

    The bits are those of `listed_code.text_of_listed_steps`.
    """
    (ended, passed, tells_signs), bit = marks, np.int64(1) << l
    changes, size, bits = False, 0.0, np.int64(0)
    for i in range(len(x)):
        size += 0.0 * after[i]
        changes |= of_one_sign[i] and crosses_0(x[i, l], after[i])
    if is_good and size == 0.0:
        for i in range(len(x)):
            x[i, l] = after[i]
        if passed & bit == 0:
            bits |= (bit << 8) if negative else 0
            bits |= (bit << (8 + CHANGED)) if changes and tells_signs else 0
    elif ended & bit == 0:
        bits |= bit
    return bits


@kernel
def dense_steps(part, parts, field, coefficients, half, marks, x, memory, taken):
    """Take up to taken[0] steps of a line x (D, W), whose `half` is eps / 2 times values (T, W).

    `coefficients` are (1 or W, n). Write how many steps it took, and bits of lanes, as
    `listed_code.text_of_listed_steps` returns them: the last step was not accurate in some lanes,
    or from det A < 0, or changed a sign.
    """
    field, coefficients, memory = uncounted(field), uncounted(coefficients), uncounted(memory)
    (D, W), (a, states) = x.shape, memory
    for n in range(taken[0]):
        bits = np.int64(0)
        for l in range(W):
            states[l, D] = 1.0
            for i in range(D):
                states[l, i] = x[i, l]
        fill(field.spans, coefficients, states, a)
        for l in range(W):
            own = l % half.shape[1]
            for s in range(len(field.linear)):
                i, j, t = field.linear[s, 0], field.linear[s, 1], field.linear[s, 2]
                a[l, i, D] += half[t, own] * states[l, j]
            for s in range(len(field.constant)):
                a[l, field.constant[s, 0], D] += 2.0 * half[field.constant[s, 1], own]
            is_good, negative = solve_rows(a[l])
            bits |= advance_lane(x, l, a[l, :, D], field.of_one_sign, is_good, negative, marks)
        if bits != 0 or n + 1 == taken[0]:
            taken[0], taken[1] = n + 1, bits
            break
