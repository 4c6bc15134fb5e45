"""Derivatives of fields of many variables along orbits, by loops over their pattern of zeros.

A list of operations for each field (`operations.Tangent`) is faster for few variables, but takes
long to compile for many. Here the matrix 1 - N(x) is eliminated row by row in the same order of
pivots, in loops that are common to all fields. With x_D = 1, a step solves

(1 - N(x)) x_next = x + h l x + 2 h c

as in `careful`, in which no increment cancels the state; and columns q become -DPhi q,

DPhi = (1 - N(x))**-1 (1 - M(x_next)).

Unknowns are numbered by their places in the order of pivots. Lanes take turns.
"""

import functools
from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np
from numba import carray, types

from .elimination import LEAST_PIVOT, simd_max, simd_min
from .generated_tangent import (
    DUE,
    FAR_FROM_1,
    LARGEST_LENGTH,
    LARGEST_SIZE,
    LEAST_LENGTH,
    LEAST_SIZE,
    LENGTHS,
    LIMIT,
    NEAR_1,
    NEAR_1_LARGEST,
    NEAR_1_LEAST,
    NEGATIVE,
    OUTSIDE,
    STEP,
    VOLUME,
)
from .llvm import address_as_pointer
from .numba import c_function, function, lesser
from .operations import of_one_sign
from .planned_elimination import elimination_order, filled

BLOCK = 64  # columns that are multiplied at once, because their rows stay in the caches
# Columns are orthonormalised after `pace` steps. It begins with 1, doubles where they have lost
# less than the square root of LIMIT, and halves where they have lost more than LIMIT. The row
# VOLUME of a line has the number of steps since then, plus PACE times the pace.
PACE, LONGEST_PACE = 32.0, 16.0


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
    of_one_sign: Any  # (D,), 1 for unknowns that keep their sign along the motion, else 0


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
    keeps = np.zeros(D, np.int64)
    keeps[[*of_one_sign(indices)]] = 1
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
    """Return how many numbers `room_of` takes."""
    return 5 * len(pattern.order) + 1 + len(pattern.given) + len(pattern.columns)


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


# ------------------------------------------------------------------------------------- derivatives
@function
def multiply(pattern, room, back, columns, new):
    """Replace the columns q (D, -) by -DPhi q; `new` is memory of the same shape.

    `room` has the factors of 1 - N(x), and `back` the entries of 1 - M(x_next).
    """
    D, order = len(room.row), pattern.order
    for begin in range(0, D, BLOCK):
        end = lesser(begin + BLOCK, D)
        for i in range(D):
            row, unit = new[order[i], begin:end], columns[order[i], begin:end]
            for c in range(len(row)):
                row[c] = -unit[c]
            for e in range(pattern.given_starts[i], pattern.given_starts[i + 1]):
                subtract(row, back.given[e], columns[order[pattern.given[e]], begin:end])
            for e in range(pattern.starts[i], pattern.diagonal[i]):
                subtract(row, room.entries[e], new[order[pattern.columns[e]], begin:end])
        for i in range(D - 1, -1, -1):
            row, result = new[order[i], begin:end], columns[order[i], begin:end]
            for e in range(pattern.diagonal[i] + 1, pattern.starts[i + 1]):
                subtract(row, room.entries[e], columns[order[pattern.columns[e]], begin:end])
            for c in range(len(row)):
                result[c] = row[c] * room.inverse[i]


@function
def scale(room, back, products):
    """Multiply NEAR_1 + 1 and FAR_FROM_1 by abs(det DPhi), see `operations.Tangent`."""
    for i in range(len(room.row)):
        change = (back.pivots[i] - room.pivots[i]) * room.inverse[i]
        if abs(change) < 0.5:
            products[NEAR_1] += change + products[NEAR_1] * change
        else:
            products[FAR_FROM_1] *= abs(room.inverse[i] / back.inverse[i])


@function
def orthonormalise_columns(columns, products, basis, part):
    """Orthonormalise columns (modified Gram-Schmidt), and multiply products by their lengths.

    Return the square of the largest part of a column's length that it lost. `basis` (D, D) receives
    the columns as rows; `part` (2, BLOCK) is memory.
    """
    D, loss, before = len(basis), 1.0, part[0]
    for begin in range(0, D, BLOCK):
        end = lesser(begin + BLOCK, D)
        for c in range(end - begin):
            before[c] = 0.0
        for i in range(D):
            row = columns[i, begin:end]
            for c in range(len(row)):
                before[c] += row[c] * row[c]
        for s in range(end):
            q = basis[s]
            if s >= begin:
                square = 0.0
                for i in range(D):
                    square += columns[i, s] * columns[i, s]
                length = np.sqrt(square)
                products[LENGTHS + s] *= length
                inverse = 0.0 if length == 0.0 else 1.0 / length
                loss = simd_max(before[s - begin] / square, loss) if square > 0.0 else np.inf
                for i in range(D):
                    columns[i, s] *= inverse
                    q[i] = columns[i, s]
            first = s + 1 if s >= begin else begin
            dots = part[1, : end - first]
            for c in range(len(dots)):
                dots[c] = 0.0
            for i in range(D):
                subtract(dots, -q[i], columns[i, first:end])
            for i in range(D):
                subtract(columns[i, first:end], q[i], dots)
    return loss


# Addresses of the arrays of `Pattern`, and lengths.
Plan = namedtuple("Plan", (*Pattern._fields, "D", "E", "R", "F", "G", "L", "T", "room"))
PLACE = Plan(*range(len(Plan._fields)))


def plan_of(pattern, T, room):
    """Return the array that `take_steps` takes; it holds addresses of the `Pattern`."""
    lengths = [len(pattern.order), *(len(pattern[k]) for k in (2, 5, 7, 9, 10)), T, room]
    return np.array([*(array.ctypes.data for array in pattern), *lengths], np.int64)


def width_of(D):
    """Return the numbers of a row of columns: its lines of the caches are in different sets."""
    return 8 * (-(-D // 8) | 1)


def kept_for(pattern, room):
    """Return how many numbers `take_steps` needs as memory."""
    return 2 * size_of(pattern) + len(pattern.order) * room + 2 * BLOCK


@function
def _numbers(address, shape):
    return carray(address_as_pointer(address), shape, np.float64)


@function
def _integers(address, shape):
    return carray(address_as_pointer(address), shape, np.int64)


@c_function(types.int64(*[types.int64] * 6))
def take_steps(line, table, kept, plan, ignored, steps):
    """Take steps of a trajectory with columns, as the code of `generated_tangent.text_of_tangent`.

    Bits are those of its only lane.
    """
    if ignored & 1:
        return steps
    a = _integers(plan, (len(PLACE),))
    D, E, F, G, T = a[PLACE.D], a[PLACE.E], a[PLACE.F], a[PLACE.G], a[PLACE.T]
    pattern = Pattern(
        _integers(a[PLACE.order], (D,)),
        _integers(a[PLACE.starts], (D + 1,)),
        _integers(a[PLACE.columns], (E,)),
        _integers(a[PLACE.diagonal], (D,)),
        _integers(a[PLACE.run_starts], (D + 1,)),
        _integers(a[PLACE.runs], (a[PLACE.R], 3)),
        _integers(a[PLACE.fill_starts], (D + 1,)),
        _integers(a[PLACE.fills], (F, 3)),
        _integers(a[PLACE.given_starts], (D + 1,)),
        _integers(a[PLACE.given], (G,)),
        _integers(a[PLACE.right], (a[PLACE.L], 3)),
        _integers(a[PLACE.of_one_sign], (D,)),
    )
    size, width = 5 * D + 1 + G + E, a[PLACE.room]
    memory = _numbers(kept, (2 * size + D * width,))
    room = room_of(memory, D, G, E)
    back = room_of(memory[size:], D, G, E)
    new = memory[2 * size :].reshape((D, width))
    half, x = _numbers(table, (T,)), _numbers(line, (D,))
    products = _numbers(line + 8 * D, (LENGTHS + D,))
    columns = _numbers(line + 8 * (2 * D + LENGTHS), (D, width))
    for n in range(steps):
        for i in range(D):
            room.y[i] = x[i]
            back.right[i] = 0.0
        good, negative = step_once(pattern, half, room, back.y)
        back.y[D] = 1.0
        if not (good and eliminate(pattern, half, -1.0, 1.0, back)[0]):
            return n | 1 << STEP
        multiply(pattern, room, back, columns, new)
        scale(room, back, products)
        length = 0.0
        for i in range(D):
            x[i] = back.y[i]
            for r in range(D):
                length += columns[i, r] * columns[i, r]
        products[VOLUME] += 1.0
        since, pace = products[VOLUME] % PACE, products[VOLUME] // PACE
        flags = np.int64(negative) << NEGATIVE
        if since >= pace or not (LEAST_SIZE < length < LARGEST_SIZE):
            flags |= 1 << DUE
        near, far = products[NEAR_1], products[FAR_FROM_1]
        if not (NEAR_1_LEAST < near < NEAR_1_LARGEST and LEAST_LENGTH < far < LARGEST_LENGTH):
            flags |= 1 << OUTSIDE
        if flags:
            return (n + 1) | flags
    return steps


@c_function(types.int64(*[types.int64] * 5))
def orthonormalise(columns, carried, due, kept, plan):
    """Orthonormalise the columns of a trajectory, as `tangent.orthonormalise`, and set the pace."""
    a = _integers(plan, (len(PLACE),))
    D, width = a[PLACE.D], a[PLACE.room]
    size = 2 * (5 * D + 1 + a[PLACE.G] + a[PLACE.E])
    part = _numbers(kept + 8 * (size + D * width), (2, BLOCK))
    basis = _numbers(kept + 8 * size, (D, D))
    products = _numbers(carried, (LENGTHS + D,))
    loss = orthonormalise_columns(_numbers(columns, (D, width)), products, basis, part)
    since, pace = products[VOLUME] % PACE, products[VOLUME] // PACE
    if loss > LIMIT * LIMIT:
        pace //= 2
    elif loss < LIMIT and since >= pace:
        pace *= 2
    products[VOLUME] = PACE * min(max(pace, 1.0), LONGEST_PACE)
    return 0
