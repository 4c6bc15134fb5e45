"""Kahan's map of any quadratic field f (theory, section 7), lanes side by side.

x_next = x + eps A(x)**-1 f(x), where A(x) = 1 - (eps/2) f'(x). A field is a list of terms: with one
more component, x_D = 1, all are quadratic, and f_i is the sum of its v x_j x_k, j <= k. So one
kernel serves all fields: it carries out a list of operations, planned from the indices of the terms
(`operations`). Where the increment cancels the state, or elimination loses digits, a lane solves
A(x) x_next = x + (eps/2) l x + eps c, where l and c are the linear and constant parts.

arguments   indices (3, T), the i, j and k of terms; operations (n, 8) and the number of rows;
            values (1 or B, T); eps (1 or B,)
final       (B, D), the states that a run continues from; there is no carry

A block is b[row, lane], with the rows of `operations`: tests, 1, the states x, half the step size
times the values, and what is computed. After its end a trajectory has NaN as states.
"""

from typing import Any, NamedTuple

import numpy as np

from .codes import NONFINITE, OK
from .elimination import LEAST_PIVOT, larger, smaller, solve
from .llvm import LINE, load, room, store, uncounted
from .numba import formula, function, inlined, keep, kernel, lesser, pick, select, share
from .operations import (
    ADD,
    ADD_2,
    ADVANCE,
    ENDED,
    FAR,
    FIRST,
    INVERSE,
    LARGEST,
    LEAST,
    MUL,
    MUL_2,
    NEAR,
    ONE,
)

# A state has lost digits if one component falls below the small part of half its increment, or if
# all fall below the large part.
SMALL_PART, LARGE_PART = 2.0**-10, 2.0**-4


@formula
def lanes_of_fields(rows, count):
    """Return how many of these trajectories go side by side: one, or whole lines."""
    lanes = 128 if rows <= 1200 else 64 if rows <= 4000 else 32  # their rows stay in the caches
    # Of an empty batch, too, the number of blocks is a quotient.
    return 1 if count <= 1 else lesser(lanes, (count + LINE - 1) // LINE * LINE)


@formula
def divide(diagonal, original, least, largest):
    """Return 1 / (1 - diagonal); and the least and the largest of the pivots and of what was there
    before elimination.
    """
    pivot = 1.0 - diagonal
    size = abs(pivot)
    return 1.0 / pivot, smaller(size, least), larger(larger(size, abs(1.0 - original)), largest)


@formula
def advance_component(x, half, near, far):
    """Return a component of the next state, from half its increment; and how far it is, with those
    before, from the small part, at least, and in all from the large part. (NaN and inf stay.)
    """
    following = x + 2.0 * half
    size, part = abs(following), abs(half)
    beyond = size - LARGE_PART * part
    return (
        following,
        smaller(size - SMALL_PART * part, near),
        far + select(beyond < 0.0, 0.0, beyond),
    )


@formula
def is_accurate(b, l):
    """True if the step of a lane is finite and accurate, or if its trajectory has ended."""
    near, far = b[NEAR, l], b[FAR, l]
    accurate = (near >= 0.0) & ((far > 0.0) | (near == 0.0)) & (far < np.inf)
    return accurate & (b[LEAST, l] > LEAST_PIVOT * b[LARGEST, l]) | (b[ENDED, l] > 0.0)


@function
def execute(operations, b):
    """Carry out operations for all lanes of a block, a multiple of LINE.

    An operation on columns, which lie side by side, is for all of them: if column came after
    column, each operation would wait for the one before it. Their lanes are a power of 2.
    """
    lanes = b.shape[1]
    for n in range(len(operations)):
        code, d, s = operations[n, 0], operations[n, 1], operations[n, 2]
        a, c = operations[n, 3], operations[n, 4]
        e, g = operations[n, 5], operations[n, 6]
        width = operations[n, 7] * lanes
        mask = -1 if width == lanes else lanes - 1  # a and e are the same for all columns
        if code == ADD_2:
            for m in range(0, width, LINE):
                product = load(b, a, m & mask) * load(b, c, m)
                more = load(b, e, m & mask) * load(b, g, m)
                store(b, d, m, load(b, s, m) + product + more)
        elif code == ADD:
            for m in range(0, width, LINE):
                product = load(b, a, m & mask) * load(b, c, m)
                store(b, d, m, load(b, s, m) + product)
        elif code == MUL_2:
            for m in range(0, width, LINE):
                product = load(b, a, m & mask) * load(b, c, m)
                more = load(b, e, m & mask) * load(b, g, m)
                store(b, d, m, product + more)
        elif code == MUL:
            for m in range(0, width, LINE):
                store(b, d, m, load(b, a, m & mask) * load(b, c, m))
        elif code == INVERSE:
            for l in range(lanes):
                b[d, l], b[LEAST, l], b[LARGEST, l] = divide(
                    b[a, l], b[s, l], b[LEAST, l], b[LARGEST, l]
                )
        elif code == ADVANCE:
            for l in range(lanes):
                x = b[d, l]
                b[d, l], b[NEAR, l], b[FAR, l] = advance_component(
                    x, b[s, l], b[NEAR, l], b[FAR, l]
                )
                b[s, l] = x
        else:
            for l in range(lanes):
                b[LEAST, l] = np.inf if s == 0 else 1.0
                b[NEAR, l] = np.inf if a == 0 else 0.0
                b[LARGEST, l], b[FAR, l] = 1.0, 0.0


# At a prompt it runs as Python does: wrong rows are an error, not a crash. (Lines are not checked.)
execute._for_calls = execute.py_func


@function
def execute_one(operations, b):
    """Carry out operations for a block of one lane: as `execute`, without loops."""
    for n in range(len(operations)):
        code, d, s = operations[n, 0], operations[n, 1], operations[n, 2]
        given, left, right = b[s, 0], b[operations[n, 3], 0], b[operations[n, 4], 0]
        more = b[operations[n, 5], 0] * b[operations[n, 6], 0]  # rows that do not count are 0
        if code == ADD_2:
            value = given + left * right + more
        elif code == ADD:
            value = given + left * right
        elif code == MUL_2:
            value = left * right + more
        elif code == MUL:
            value = left * right
        elif code == INVERSE:
            value, b[LEAST, 0], b[LARGEST, 0] = divide(left, given, b[LEAST, 0], b[LARGEST, 0])
        elif code == ADVANCE:
            b[s, 0] = b[d, 0]
            value, b[NEAR, 0], b[FAR, 0] = advance_component(b[d, 0], given, b[NEAR, 0], b[FAR, 0])
        else:
            value = np.inf if s == 0 else 1.0
            b[NEAR, 0] = np.inf if operations[n, 3] == 0 else 0.0
            b[LARGEST, 0], b[FAR, 0] = 1.0, 0.0
        b[d, 0] = value


@formula
def count_inaccurate(b):
    """Return how many lanes have lost digits by a step."""
    count = 0
    for l in range(b.shape[1]):
        count += select(is_accurate(b, l), 0, 1)
    return count


@inlined
def memory_of_lane(D, columns):
    """Return a system with these right sides, units and a state: the memory of `solve_lane`."""
    return room((D, D + columns, 1)), room((2, D)), room((D,))


@inlined
def restore(operations, b, l, x):
    """Fill x with the state of lane l before the operations of a step."""
    for i in range(len(x)):
        x[i] = b[FIRST + i, l]
    n = len(operations) - 1
    while operations[n, 0] == ADVANCE:
        x[operations[n, 1] - FIRST] = b[operations[n, 2], l]
        n -= 1


@inlined
def fill_system(indices, b, l, sign, x, system):
    """Fill A(x), for eps or, if the sign is -1, for -eps; of the field and step size of lane l."""
    D = len(x)
    for i in range(D):
        for j in range(D):
            system[i, j, 0] = 1.0 if i == j else 0.0
    for t in range(indices.shape[1]):
        i, j, k, half = indices[0, t], indices[1, t], indices[2, t], sign * b[FIRST + D + t, l]
        if j < D:
            system[i, j, 0] -= half * (x[k] if k < D else 1.0)
        if k < D:
            system[i, k, 0] -= half * x[j]


@inlined
def solve_lane(indices, operations, b, l, memory):
    """Take the step of lane l, after its operations, by `solve`; return its status."""
    system, units, x = memory
    D = len(x)
    restore(operations, b, l, x)
    fill_system(indices, b, l, 1.0, x, system)
    for i in range(D):
        system[i, D, 0] = x[i]
    for t in range(indices.shape[1]):
        i, j, k, half = indices[0, t], indices[1, t], indices[2, t], b[FIRST + D + t, l]
        if k == D:
            system[i, D, 0] += half * x[j] if j < D else 2.0 * half
    status = solve(system, units)
    for i in range(D):
        b[FIRST + i, l] = system[i, D, 0] if status == OK else np.nan
    b[ENDED, l] = 0.0 if status == OK else 1.0
    return status


@function
def field_step_of_one(system, given, out, memory):
    """Write the state that follows `given` to `out`; return its status. For `compiled`."""
    half, indices, operations, _, _ = system
    b, one = memory
    D, status = len(given), OK
    b[ONE, 0], b[ENDED, 0] = 1.0, 0.0
    for i in range(D):
        b[FIRST + i, 0] = given[i]
    for t in range(len(half)):
        b[FIRST + D + t, 0] = half[t]
    execute_one(operations, b)
    if not is_accurate(b, 0):
        status = solve_lane(indices, operations, b, 0, one)
    for i in range(D):
        out[i] = b[FIRST + i, 0]
    return status


@function
def field_memory(system):
    """The memory of `field_step_of_one`."""
    return room((system.rows, 1)), memory_of_lane(system.dimension, 1)


class FieldSystem(NamedTuple):
    """A field and a step size: half of it times the values of the terms, their indices, and the
    operations of a step. For `compiled`.
    """

    half: Any  # (T,)
    indices: Any  # (3, T)
    operations: Any
    rows: int
    dimension: int


# What `compiled` calls for a system of this kind.
FieldSystem.memory, FieldSystem.one_step = field_memory, field_step_of_one


@function
def enter_fields(values, eps, states, b, begin, end, start, status, failed_at):
    """Fill a block with trajectories, fields and step sizes; lanes beyond the last repeat it."""
    D, T = states.shape[1], values.shape[1]
    for l in range(b.shape[1]):
        k, undefined = lesser(begin + l, end - 1), 0.0
        for i in range(D):
            b[FIRST + i, l] = states[k, i]
            undefined += 0.0 * states[k, i]
        if start == 0 and np.isnan(undefined):
            status[k], failed_at[k] = NONFINITE, 0
        b[ONE, l], b[ENDED, l] = 1.0, 1.0 if status[k] < 0 else 0.0
        for i in range(D if status[k] < 0 else 0):
            b[FIRST + i, l] = np.nan
    for t in range(T):
        for l in range(b.shape[1]):
            k = lesser(begin + l, end - 1)
            v = values[k if len(values) > 1 else 0, t]
            b[FIRST + D + t, l] = 0.5 * pick(eps, k) * v


@kernel
def field_steps(part, parts, arguments, omega0, carry, span, saved, final, status, failed_at):
    """Iterate the trajectories of a part, as `steps_3d.steps`."""
    indices, (operations, rows), values, eps = uncounted(arguments)
    first, last, start, stop, every, next_row = span
    D = omega0.shape[1]
    lanes = lanes_of_fields(rows, (last - first + parts - 1) // parts)
    memory = room((rows, lanes)), memory_of_lane(D, 1)
    b, one = uncounted(memory)
    first_block, last_block = share((last - first + lanes - 1) // lanes, part, parts)
    for block in range(first_block, last_block):
        begin, row = first + block * lanes, next_row
        end = lesser(begin + lanes, last)
        states = omega0 if start == 0 else final
        enter_fields(values, eps, states, b, begin, end, start, status, failed_at)
        for n in range(start, stop + 1):
            if n > start:
                if lanes == 1:
                    execute_one(operations, b)
                else:
                    execute(operations, b)
                for l in range(lanes if count_inaccurate(b) > 0 else 0):
                    if not is_accurate(b, l):
                        code = solve_lane(indices, operations, b, l, one)
                        if code != OK and begin + l < end:
                            status[begin + l], failed_at[begin + l] = code, n
            if every > 0 and n % every == 0 and (n > start or start == 0):
                write_states(b[FIRST:], begin, end, saved[row])
                row += 1
        write_states(b[FIRST:], begin, end, final)
    keep(memory)


@function
def write_states(x, begin, end, target):
    """Write the states of a block, the first rows of x, to target (B, D)."""
    for l in range(end - begin):
        for i in range(target.shape[1]):
            target[begin + l, i] = x[i, l]
