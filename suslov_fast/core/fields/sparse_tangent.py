"""Derivatives of fields of many variables along orbits, by the loops of `sparse`.

Columns q of a trajectory become -DPhi q, DPhi = (1 - N(x))**-1 (1 - M(x_next)), as in `tangent`.
"""

from collections import namedtuple

import numpy as np
from numba import types

from ..compiling.arrays import array_at
from ..compiling.elimination import simd_max
from ..compiling.llvm import QUAD, lesser
from ..compiling.numba import c_function, function, inlined
from .careful import crosses_0
from .generated_tangent import (
    CHANGED,
    DUE,
    LARGEST_SIZE,
    LEAST_SIZE,
    LENGTHS,
    LIMIT,
    NEAR_1,
    NEGATIVE,
    STEP,
    VOLUME,
)
from .sparse import Pattern, eliminate, numbers_of, pattern_of, room_of, size_of, step_once

BLOCK = 64  # columns that are multiplied at once, because their rows stay in the caches
# Columns are orthonormalised after `pace` steps. It begins with 1, doubles where they have lost
# less than the square root of LIMIT, and halves where they have lost more than LIMIT. The row
# VOLUME of a line has the number of steps since then, plus PACE times the pace; the row NEAR_1 has
# the sum of log(abs(det DPhi)).
PACE, LONGEST_PACE = 32.0, 16.0


@function
def subtract(target, factor, source):
    """Subtract a multiple of an array."""
    for c in range(len(target)):
        target[c] -= factor * source[c]


@function
def multiply(pattern, room, back, columns, new):
    """Replace the columns q (D, -) by -DPhi q; `new` is memory of the same shape.

    `room` has the factors of 1 - N(x), and `back` the entries of 1 - M(x_next).
    """
    D, order = len(pattern.order), pattern.order
    for begin in range(0, D, BLOCK):
        end = lesser(begin + BLOCK, D)
        for i in range(D):
            row, unit = new[order[i], begin:end], columns[order[i], begin:end]
            for c in range(len(row)):
                row[c] = -unit[c]
            for e in range(pattern.given_starts[i], pattern.given_starts[i + 1]):
                subtract(row, back.given[e * QUAD], columns[order[pattern.given[e]], begin:end])
            for e in range(pattern.starts[i], pattern.diagonal[i]):
                subtract(row, room.entries[e * QUAD], new[order[pattern.columns[e]], begin:end])
        for i in range(D - 1, -1, -1):
            row, result = new[order[i], begin:end], columns[order[i], begin:end]
            for e in range(pattern.diagonal[i] + 1, pattern.starts[i + 1]):
                subtract(row, room.entries[e * QUAD], columns[order[pattern.columns[e]], begin:end])
            for c in range(len(row)):
                result[c] = row[c] * room.inverse[i * QUAD]


@function
def logarithm_of_det(room, back):
    """Return log(abs(det DPhi)), see `operations.Tangent`: many factors may leave their range."""
    logarithm = 0.0
    for i in range(0, len(room.row), QUAD):
        change = (back.pivots[i] - room.pivots[i]) * room.inverse[i]
        if abs(change) < 0.5:
            logarithm += np.log1p(change)
        else:
            logarithm += np.log(abs(room.inverse[i] / back.inverse[i]))
    return logarithm


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
Plan = namedtuple("Plan", (*Pattern._fields, "D", "E", "F", "G", "L", "T", "room"))
PLACE = Plan(*range(len(Plan._fields)))


def plan_of(pattern, T, room):
    """Return the array that `take_steps` takes; it holds addresses of the `Pattern`."""
    lengths = [len(pattern.order), *(len(pattern[k]) for k in (2, 5, 7, 8)), T, room]
    return np.array([*(array.ctypes.data for array in pattern), *lengths], np.int64)


def width_of(D):
    """Return the numbers of a row of columns: its lines of the caches are in different sets."""
    return 8 * (-(-D // 8) | 1)


def arguments_of(step, values, eps, fractions):
    """Return the `tangent.Arguments` of codes, sizes and tables, and what has to stay alive."""
    pattern, width = pattern_of(step.indices.tobytes(), step.D), width_of(step.D)
    kept = 2 * size_of(pattern) + step.D * width + 2 * BLOCK
    halves = (0.5 * eps[:, np.newaxis] * values)[..., np.newaxis]
    table = fractions[:, np.newaxis, np.newaxis, np.newaxis] * halves
    plan = plan_of(pattern, step.T, width)
    codes = take_steps.address, orthonormalise.address, plan.ctypes.data
    return (*codes, 1, width, kept, step.indices, table, halves), (pattern, plan)


def operations_of(step):
    """Return the number of operations of a step and its derivative."""
    pattern = pattern_of(step.indices.tobytes(), step.D)
    return step.D * (len(pattern.columns) + len(pattern.given))


@inlined
def _numbers(address, shape):
    return array_at(address, shape, np.float64)


@inlined
def _integers(address, shape):
    return array_at(address, shape, np.int64)


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
        _integers(a[PLACE.fill_starts], (D + 1,)),
        _integers(a[PLACE.fills], (F, 3)),
        _integers(a[PLACE.given_starts], (D + 1,)),
        _integers(a[PLACE.given], (G,)),
        _integers(a[PLACE.right], (a[PLACE.L], 3)),
        array_at(a[PLACE.of_one_sign], (D,), np.bool_),
    )
    size, width = numbers_of(D, G, E), a[PLACE.room]
    memory = _numbers(kept, (2 * size + D * width,))
    room = room_of(memory, D, G, E)
    back = room_of(memory[size:], D, G, E)
    new = _numbers(kept + 8 * 2 * size, (D, width))
    half, x = _numbers(table, (1, T)), _numbers(line, (D, 1))
    products = _numbers(line + 8 * D, (LENGTHS + D,))
    columns = _numbers(line + 8 * (2 * D + LENGTHS), (D, width))
    first = np.int64(0)  # a literal would have a type, and functions, of its own
    for n in range(steps):
        back.right[:] = 0.0
        good, negative = step_once(pattern, half, x, first, room, back.y)
        back.y[D * QUAD :] = 1.0
        good &= eliminate(pattern, half, first, -1.0, 1.0, back)[0]
        if good & 1 == 0:
            return n | 1 << STEP
        multiply(pattern, room, back, columns, new)
        products[NEAR_1] += logarithm_of_det(room, back)
        length, changed = 0.0, False
        for i in range(D):
            changed |= pattern.of_one_sign[i] and crosses_0(x[i, 0], back.y[i * QUAD])
            x[i, 0] = back.y[i * QUAD]
            for r in range(D):
                length += columns[i, r] * columns[i, r]
        products[VOLUME] += 1.0
        since, pace = products[VOLUME] % PACE, products[VOLUME] // PACE
        flags = (negative & 1) << NEGATIVE | np.int64(changed) << CHANGED
        if since >= pace or not (LEAST_SIZE < length < LARGEST_SIZE):
            flags |= 1 << DUE
        if flags:
            return (n + 1) | flags
    return steps


@c_function(types.int64(*[types.int64] * 5))
def orthonormalise(columns, carried, due, kept, plan):
    """Orthonormalise the columns of a trajectory, as `lengths.orthonormalise`, and set the pace."""
    a = _integers(plan, (len(PLACE),))
    D, width = a[PLACE.D], a[PLACE.room]
    size = 2 * numbers_of(D, a[PLACE.G], a[PLACE.E])
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
