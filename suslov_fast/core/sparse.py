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

from .dense import advance_lane
from .elimination import LEAST_PIVOT, simd_max, simd_min
from .llvm import uncounted
from .numba import function, kernel
from .operations import of_one_sign
from .planned_elimination import elimination_order, filled


class Pattern(NamedTuple):
    """The terms of a field, and the entries of 1 - N(x) after elimination, row by row."""

    order: Any  # (D,), the unknown at each place
    starts: Any  # (D + 1,), of rows in `columns`
    columns: Any  # (E,), places
    diagonal: Any  # (D,), of rows in `columns`
    run_starts: Any  # (D + 1,), of rows in `runs`
    runs: Any  # (R, 3): place, number and index in `columns` of neighbours right of the diagonal
    fill_starts: Any  # (D + 1,), of rows in `fills`
    fills: Any  # (F, 3), by rows: entry among `given`, component, term
    given_starts: Any  # (D + 1,), of rows in `given`
    given: Any  # (G,), places of entries before elimination
    right: Any  # (L, 3): place, component, term, for the right sides
    of_one_sign: Any  # (D,), true for unknowns that keep their sign along the motion


def is_sparse(indices, D):
    """Return whether rows of f' have few entries: otherwise `dense` is faster."""
    i, j, k = indices
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
    runs, counts = [], []
    for begin, end in zip(diagonal + 1, starts[1:], strict=True):
        own = found[begin:end]
        breaks = np.flatnonzero(np.diff(own, prepend=-2) != 1)
        lengths = np.diff(np.append(breaks, len(own)))
        runs.append(np.stack([own[breaks], lengths, begin + breaks], 1))
        counts.append(len(breaks))
    is_right = k == D
    keeps = np.zeros(D, bool)
    keeps[[*of_one_sign(indices)]] = True
    return Pattern(
        np.array(order, np.int64), starts, found, diagonal,
        _starts(counts), np.concatenate(runs), _starts(np.bincount(rows, minlength=D)), fills,
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
    """Memory for a lane."""

    y: Any  # (D + 1,), the state and 1
    row: Any  # (D,), a row of the matrix, by places
    given: Any  # (G,), entries before elimination
    entries: Any  # (E,): multipliers, and the rows right of the diagonal
    pivots: Any  # (D,), less 1
    inverse: Any  # (D,), of the pivots
    right: Any  # (D,), by places


def size_of(pattern):
    """Return how many numbers `room_of` takes, and a state."""
    return 6 * len(pattern.order) + 1 + len(pattern.given) + len(pattern.columns)


@function
def room_of(memory, D, G, E):
    """Return the `Room` in an array of `size_of` numbers."""
    a, b = 2 * D + 1, 2 * D + 1 + G
    return Room(
        memory[: D + 1], memory[D + 1 : a], memory[a:b], memory[b : b + E],
        memory[b + E : b + E + D], memory[b + E + D : b + E + 2 * D],
        memory[b + E + 2 * D : b + E + 3 * D],
    )  # fmt: skip


@function
def subtract(target, factor, source):
    """Subtract a multiple of an array."""
    for c in range(len(target)):
        target[c] -= factor * source[c]


@function
def eliminate(pattern, half, sign, most, room):
    """Eliminate 1 - sign N(y), and the right sides; keep the entries before elimination.

    Return whether this kept digits (see `elimination.keeps_digits`; pivots of `most` count, too),
    and whether an odd number of pivots is negative.
    """
    row, entries, least, largest, negative = room.row, room.entries, most, 1.0, False
    for i in range(len(row)):
        for e in range(pattern.given_starts[i], pattern.given_starts[i + 1]):
            room.given[e] = 0.0
        for f in range(pattern.fill_starts[i], pattern.fill_starts[i + 1]):
            e, m, t = pattern.fills[f, 0], pattern.fills[f, 1], pattern.fills[f, 2]
            room.given[e] -= sign * half[t] * room.y[m]
        begin, middle, end = pattern.starts[i], pattern.diagonal[i], pattern.starts[i + 1]
        for e in range(begin, end):
            row[pattern.columns[e]] = 0.0
        for e in range(pattern.given_starts[i], pattern.given_starts[i + 1]):
            row[pattern.given[e]] = room.given[e]
        largest = simd_max(abs(1.0 + row[i]), largest)
        for e in range(begin, middle):
            k = pattern.columns[e]
            multiplier = row[k] * room.inverse[k]
            entries[e] = multiplier
            room.right[i] -= multiplier * room.right[k]
            for r in range(pattern.run_starts[k], pattern.run_starts[k + 1]):
                first, n, at = pattern.runs[r, 0], pattern.runs[r, 1], pattern.runs[r, 2]
                subtract(row[first : first + n], multiplier, entries[at : at + n])
        pivot = 1.0 + row[i]
        least, largest = simd_min(abs(pivot), least), simd_max(abs(pivot), largest)
        negative ^= pivot < 0.0
        room.pivots[i], room.inverse[i] = row[i], 1.0 / pivot
        for e in range(middle + 1, end):
            entries[e] = row[pattern.columns[e]]
    return least > LEAST_PIVOT * largest, negative


@function
def step_once(pattern, half, room, after):
    """Write the state after `room.y` to `after` (D,); return if it is accurate, and if det A < 0.

    `half` (T,) is eps / 2 times the values of the terms.
    """
    D, size = len(room.row), 0.0
    room.y[D] = 1.0
    for i in range(D):
        room.right[i] = room.y[pattern.order[i]]
    for t in range(len(pattern.right)):
        i, j, v = pattern.right[t, 0], pattern.right[t, 1], half[pattern.right[t, 2]]
        room.right[i] += v * room.y[j] if j < D else 2.0 * v
    good, negative = eliminate(pattern, half, 1.0, np.inf, room)
    for i in range(D - 1, -1, -1):
        value = room.right[i]
        for e in range(pattern.diagonal[i] + 1, pattern.starts[i + 1]):
            value -= room.entries[e] * room.right[pattern.columns[e]]
        value *= room.inverse[i]
        room.right[i] = after[pattern.order[i]] = value
        size += 0.0 * value
    return good and size == 0.0, negative


@kernel
def sparse_steps(part, parts, pattern, half, marks, x, memory, taken):
    """Take up to taken[0] steps of a line x (D, W), as `dense.dense_steps`.

    `half` (1 or W, T) is eps / 2 times the values of the terms; `memory` has `size_of` numbers.
    """
    pattern, half, memory = uncounted(pattern), uncounted(half), uncounted(memory)
    (D, W), G, E = x.shape, len(pattern.given), len(pattern.columns)
    room, after = room_of(memory[D:], D, G, E), memory[:D]
    for n in range(taken[0]):
        bits = np.int64(0)
        for l in range(W):
            for i in range(D):
                room.y[i] = x[i, l]
            good, negative = step_once(pattern, half[l % len(half)], room, after)
            bits |= advance_lane(x, l, after, pattern.of_one_sign, good, negative, marks)
        if bits != 0 or n + 1 == taken[0]:
            taken[0], taken[1] = n + 1, bits
            break
