"""Elimination for fields of many variables, by loops over their pattern of zeros.

A list of operations for each field (`operations`) is faster for few variables, but takes long to
make or to compile for many. Here the matrix 1 - N(x) is eliminated row by row, in an order of
pivots with little fill-in, by loops that are common to all fields. With x_D = 1, a step solves

(1 - N(x)) x_next = x + h l x + 2 h c

as in `careful`, in which no increment cancels the state. Unknowns are numbered by their places in
the order of pivots.
"""

import functools
from typing import Any, NamedTuple

import numpy as np

from ..compiling.arrays import uncounted
from ..compiling.elimination import simd_max, simd_min
from ..compiling.llvm import QUAD, get, lesser, put
from ..compiling.numba import function, kernel
from ..lists.planned_elimination import LEAST_PIVOT, elimination_order, filled
from ..lists.step import of_one_sign
from .dense import advance_lane


class Pattern(NamedTuple):
    """The terms of a field, and the entries of 1 - N(x) after elimination, row by row."""

    order: Any  # (D,), the unknown at each place
    starts: Any  # (D + 1,), of rows in `columns`
    columns: Any  # (E,), places
    diagonal: Any  # (D,), of rows in `columns`
    fill_starts: Any  # (D + 1,), of rows in `fills`
    fills: Any  # (F, 3), by rows: entry among `given`, component, term
    given_starts: Any  # (D + 1,), of rows in `given`
    given: Any  # (G,), places of entries before elimination
    right: Any  # (L, 3): place, component, term, for the right sides
    of_one_sign: Any  # (D,), true for unknowns that keep their sign along the motion


@functools.lru_cache(8)
def is_sparse(step):
    """Return whether rows of f' have few entries: otherwise `dense` is faster."""
    (i, j, k), D = step.indices, step.D
    entries = np.unique(np.append(i * (D + 1) + j, i * (D + 1) + k))
    return len(entries) < D * D // 8


@functools.lru_cache(8)
def pattern_of(places, D):
    """Return the `Pattern` of fields with terms at these indices, given by their bytes."""
    i, j, k = indices = np.frombuffer(places, np.int64).reshape(3, -1)
    terms, one, two = np.arange(len(i)), j < D, k < D
    rows, columns = np.append(i[one], i[two]), np.append(j[one], k[two])
    fills = np.stack([columns, np.append(k[one], j[two]), np.append(terms[one], terms[two])], 1)
    pattern = {*zip(rows.tolist(), columns.tolist(), strict=True)}
    order = elimination_order(pattern, D)
    order = _by_branches(order, filled(pattern, order)[1])
    before, after = filled(pattern, order)
    place = np.empty(D, np.int64)
    place[order] = range(D)
    fills[:, 0], rows = place[fills[:, 0]], place[rows]
    sorting = np.lexsort((fills[:, 2], fills[:, 0], rows))
    fills, rows = fills[sorting], rows[sorting]
    entries, first = np.unique(rows * D + fills[:, 0], return_inverse=True)
    fills[:, 0] = first
    lines = [[*before[n], n, *after[n]] for n in order]
    starts, diagonal = _starts(map(len, lines)), [len(before[n]) for n in order]
    found = place[np.concatenate([np.empty(0, np.int64), *map(np.array, lines)]).astype(np.int64)]
    diagonal = starts[:-1] + diagonal
    is_right = k == D
    keeps = np.zeros(D, bool)
    keeps[[*of_one_sign(indices)]] = True
    return Pattern(
        np.array(order, np.int64), starts, found, diagonal,
        _starts(np.bincount(rows, minlength=D)), fills,
        _starts(np.bincount(entries // D, minlength=D)), entries % D,
        np.stack([place[i], j, terms], 1)[is_right], keeps,
    )  # fmt: skip


def _starts(counts):
    return np.cumsum([0, *counts]).astype(np.int64)


def _by_branches(order, after):
    """Return an order with the same fill-in, in which entries right of the diagonal adjoin.

    It is the postorder of the tree in which the first later neighbour of an unknown is its root.
    """
    branches, roots, found = {n: [] for n in order}, [], []
    for n in order:
        (branches[after[n][0]] if after[n] else roots).append(n)
    while roots:
        found.append(n := roots.pop())
        roots += branches[n]
    return found[::-1]


# ------------------------------------------------------------------------------------- elimination
class Room(NamedTuple):
    """Memory for QUAD lanes, whose numbers are neighbours."""

    y: Any  # (D + 1,), the state and 1
    row: Any  # (D,), a row of the matrix, by places
    given: Any  # (G,), entries before elimination
    entries: Any  # (E,): multipliers, and the rows right of the diagonal
    pivots: Any  # (D,), less 1
    inverse: Any  # (D,), of the pivots
    right: Any  # (D,), by places
    tests: Any  # (2,), the least and the largest modulus of a pivot


@function
def numbers_of(D, G, E):
    """Return how many numbers `room_of` takes, and a state."""
    return (6 * D + 3 + G + E) * QUAD


def size_of(pattern):
    """Return `numbers_of` a pattern."""
    return numbers_of.py_func(len(pattern.order), len(pattern.given), len(pattern.columns))


@function
def room_of(memory, D, G, E):
    """Return the `Room` in an array of `numbers_of` these lengths."""
    n, a, b = D * QUAD, (2 * D + 1) * QUAD, (2 * D + 1 + G) * QUAD
    c = b + E * QUAD
    return Room(
        memory[: n + QUAD], memory[n + QUAD : a], memory[a:b], memory[b:c], memory[c : c + n],
        memory[c + n : c + 2 * n], memory[c + 2 * n : c + 3 * n], memory[c + 3 * n :],
    )  # fmt: skip


@function
def eliminate(pattern, half, first, sign, most, room):
    """Eliminate 1 - sign N(y), and the right sides; keep the entries before elimination.

    `half` (W, T), or (1, T) for all lanes, is eps / 2 times the values of the terms; lanes begin
    with `first`. Return the bits of lanes in which this kept digits (`elimination.keeps_digits`;
    pivots of `most` count, too), and of lanes in which an odd number of pivots is negative.
    """
    row, given, entries, right, tests = room.row, room.given, room.entries, room.right, room.tests
    good, negative, last = np.int64(0), np.int64(0), len(half) - 1
    for l in range(QUAD):
        tests[l] = 0.0
    zero = get(tests, 0)
    for l in range(QUAD):
        tests[l], tests[QUAD + l] = most, 1.0
    for i in range(len(pattern.order)):
        for g in range(pattern.given_starts[i], pattern.given_starts[i + 1]):
            put(given, g, zero)
        for f in range(pattern.fill_starts[i], pattern.fill_starts[i + 1]):
            e, m, t = pattern.fills[f, 0] * QUAD, pattern.fills[f, 1] * QUAD, pattern.fills[f, 2]
            for l in range(QUAD):
                given[e + l] -= sign * half[lesser(first + l, last), t] * room.y[m + l]
        begin, middle, end = pattern.starts[i], pattern.diagonal[i], pattern.starts[i + 1]
        for e in range(begin, end):
            put(row, pattern.columns[e], zero)
        for g in range(pattern.given_starts[i], pattern.given_starts[i + 1]):
            put(row, pattern.given[g], get(given, g))
        for l in range(QUAD):
            tests[QUAD + l] = simd_max(abs(1.0 + row[i * QUAD + l]), tests[QUAD + l])
        for e in range(begin, middle):
            k = pattern.columns[e]
            multiplier = get(row, k) * get(room.inverse, k)
            put(entries, e, multiplier)
            put(right, i, get(right, i) - multiplier * get(right, k))
            for u in range(pattern.diagonal[k] + 1, pattern.starts[k + 1]):
                j = pattern.columns[u]
                put(row, j, get(row, j) - multiplier * get(entries, u))
        for l in range(QUAD):
            pivot = 1.0 + row[i * QUAD + l]
            tests[l] = simd_min(abs(pivot), tests[l])
            tests[QUAD + l] = simd_max(abs(pivot), tests[QUAD + l])
            negative ^= np.int64(pivot < 0.0) << l
            room.pivots[i * QUAD + l], room.inverse[i * QUAD + l] = row[i * QUAD + l], 1.0 / pivot
        for e in range(middle + 1, end):
            put(entries, e, get(row, pattern.columns[e]))
    for l in range(QUAD):
        good |= np.int64(tests[l] > LEAST_PIVOT * tests[QUAD + l]) << l
    return good, negative


@function
def step_once(pattern, half, x, first, room, after):
    """Write the states after those of QUAD lanes of x (D, W) to `after` (D * QUAD,).

    `half` and `first` are those of `eliminate`. Return the bits of lanes in which the step is
    accurate, and of lanes in which det A < 0.
    """
    (D, W), right, y = x.shape, room.right, room.y
    for i in range(D):
        for l in range(QUAD):
            y[i * QUAD + l] = x[i, lesser(first + l, W - 1)]
    for l in range(QUAD):
        y[D * QUAD + l] = 1.0
    for i in range(D):
        for l in range(QUAD):
            right[i * QUAD + l] = y[pattern.order[i] * QUAD + l]
    for t in range(len(pattern.right)):
        i, j, term = pattern.right[t, 0], pattern.right[t, 1], pattern.right[t, 2]
        for l in range(QUAD):
            v = half[lesser(first + l, len(half) - 1), term]
            right[i * QUAD + l] += v * y[j * QUAD + l] if j < D else 2.0 * v
    good, negative = eliminate(pattern, half, first, 1.0, np.inf, room)
    sizes = room.tests
    for l in range(QUAD):
        sizes[l] = 0.0
    for i in range(D - 1, -1, -1):
        value = get(right, i)
        for e in range(pattern.diagonal[i] + 1, pattern.starts[i + 1]):
            value = value - get(room.entries, e) * get(right, pattern.columns[e])
        value = value * get(room.inverse, i)
        put(right, i, value)
        put(after, pattern.order[i], value)
        for l in range(QUAD):
            sizes[l] += 0.0 * right[i * QUAD + l]
    for l in range(QUAD):
        good &= ~(np.int64(sizes[l] != 0.0) << l)
    return good, negative


@kernel
def sparse_steps(part, parts, pattern, half, marks, x, memory, taken):
    """Take up to taken[0] steps of a line x (D, W), as `dense.dense_steps`.

    `half` (1 or W, T) is eps / 2 times the values of the terms; `memory` has `size_of` numbers.
    """
    pattern, half, x, memory = uncounted((pattern, half, x, memory))
    (D, W), G, E = x.shape, len(pattern.given), len(pattern.columns)
    room, after = room_of(memory[D * QUAD :], D, G, E), memory[: D * QUAD]
    for n in range(taken[0]):
        bits = np.int64(0)
        for first in range(0, W, QUAD):
            good, negative = step_once(pattern, half, x, first, room, after)
            for l in range(lesser(QUAD, W - first)):
                told = (good >> l & 1 != 0), (negative >> l & 1 != 0), marks
                bits |= advance_lane(x, first + l, after[l::QUAD], pattern.of_one_sign, *told)
        if bits != 0 or n + 1 == taken[0]:
            taken[0], taken[1] = n + 1, bits
            break
