"""Derivatives of Kahan's map of a quadratic field, and how lengths grow under their products.

With h = eps / 2, N(x) = h f'(x) and M(x) = -N(x), the derivative is
DPhi(x) = (1 - N(x))**-1 (1 - M(x_next)) (theory, section 7). Every map of the package is one of
these: `body.terms` are its indices (3, T) and values (..., T), see `steps_field`. Machine code
(`generated.text_of_tangent`) takes steps of a line of lanes, multiplies columns q by -DPhi, and
finds where they are to be orthonormalised; here is what it leaves.

derive      products of DPhi with columns, for one lane, with pivots
jacobians   a kernel: DPhi at states
densities   1 / det A at states
growth      a kernel: logarithms of lengths and determinants along orbits

With the sums (B, D) and of_det (B,) of `growth`, the Lyapunov exponents after N steps are
sums[:, :-1] / N and, as the last, (of_det - sums[:, :-1].sum(axis=1)) / N: so their sum is the
mean of log |det DPhi|, to rounding. (Where another one is -inf, the last is sums[:, -1] / N.)
"""

import functools
from typing import Any, NamedTuple

import numpy as np

from .careful import fill_system, solve_lane
from .codes import NONFINITE, OK, PASSED_POLE
from .elimination import determinant_of, solve
from .generated import WIDTH
from .generated_tangent import (
    DERIVATIVE,
    DUE,
    FAR_FROM_1,
    LARGEST_LENGTH,
    LEAST_LENGTH,
    LENGTHS,
    NEAR_1,
    NEAR_1_LARGEST,
    NEAR_1_LEAST,
    NEGATIVE,
    OUTSIDE,
    STEP,
    VOLUME,
    columns_of,
    text_of_orthonormalise,
    text_of_tangent,
)
from .llvm import call_code, uncounted
from .machine_code import LARGE, code_of
from .numba import function, inlined, kernel, lesser, share
from .operations import Tangent, evaluate
from .steps_field import Method, tables_of

INTERVAL = 16  # steps after which columns are orthonormalised, unless they were before


class Arguments(NamedTuple):
    """The arguments of `growth` and `jacobians` for some trajectories, in lines of W lanes."""

    address: int  # of the code of steps, 0 if there is none
    orthonormalise: int  # of that for columns
    W: int
    room: int  # for columns
    indices: Any  # (3, T)
    table: Any  # (stages, 1 or lines, n, 1 or W)
    halves: Any  # (1 or lines, T, 1 or W)
    fractions: Any  # (stages,)


@functools.lru_cache(32)
def _tangent_of(places, D):
    return Tangent(np.frombuffer(places, np.int64).reshape(3, -1), D)


def arguments_of(method, values, eps, count):
    """Return the arguments of the kernels for `count` trajectories."""
    step, fractions = method
    tangent, W = _tangent_of(step.indices.tobytes(), step.D), WIDTH if count > 1 else 1
    halves, table = tables_of(Method(tangent, fractions), values, eps, W)
    address, size = 0, len(tangent.usual) + len(tangent.columns)
    if 0 < size < LARGE:
        address = code_of(text_of_tangent, tangent, W, halves.shape[2] > 1) or 0
    other = code_of(text_of_orthonormalise, tangent, W) or 0
    room = columns_of(tangent.D, W)[1]
    return Arguments(address, other, W, room, step.indices, table, halves, np.array(fractions))


def operations_of(method):
    """Return how many operations a step takes, with its derivative and orthonormal columns."""
    step = method.step
    tangent = _tangent_of(step.indices.tobytes(), step.D)
    D = step.D
    return len(tangent.usual) + D * len(tangent.columns) + D**3 // 4


# ------------------------------------------------------------------------------------ single lanes
class Memory(NamedTuple):
    """The memory of a thread for a line: its rows; of lanes that take a step by `solve` the state
    before, the columns and the status; half the values of a lane, its next state, and systems.
    """

    line: Any  # (2 D + LENGTHS + D room, W)
    before: Any  # (W, D)
    columns: Any  # (W, D, D)
    carried: Any  # (W, 2)
    codes: Any  # (W,)
    half: Any  # (T,)
    after: Any  # (D,)
    of_step: Any
    of_tangent: Any
    units: Any


@inlined
def memory_of(given, D):
    """Return the memory of a thread."""
    T, W = given.indices.shape[1], given.W
    return Memory(
        np.empty((2 * D + LENGTHS + D * given.room, W)),
        np.empty((W, D)), np.empty((W, D, D)), np.empty((W, 2)),
        np.zeros(W, np.int64), np.empty((T,)), np.empty((D,)),
        np.empty((D, D + 1, 1)), np.empty((D, 2 * D, 1)), np.empty((2, D)),
    )  # fmt: skip


@function
def derive(indices, half, before, after, columns, system, units):
    """Replace columns[r] by -DPhi q for q = columns[r], by partial pivoting; return det DPhi."""
    D = len(before)
    fill_system(indices, half, -1.0, after, system)
    for i in range(D):
        for r in range(D):
            system[i, D + r, 0] = 0.0
            for j in range(D):
                system[i, D + r, 0] -= system[i, j, 0] * columns[r, j]
    for r in range(D):
        for i in range(D):
            columns[r, i] = system[i, D + r, 0]
            system[i, D + r, 0] = 0.0
    solve(system, units)
    determinant = determinant_of(system, units)
    fill_system(indices, half, 1.0, before, system)
    for i in range(D):
        for r in range(D):
            system[i, D + r, 0] = columns[r, i]
    solve(system, units)
    for i in range(D):
        for r in range(D):
            columns[r, i] = system[i, D + r, 0]
    # 1 / 0 is no error in Python, too
    return determinant / np.float64(determinant_of(system, units))


@function
def take(given, memory, place, stage, ignored, steps):
    """Take up to so many steps of a line, and no further after one that leaves bits of lanes.

    Return how many; bits of lanes from det A < 0, of those with columns to be orthonormalised, and
    with logarithms to be taken; and of those that took the last step by `solve`, see
    `memory.codes`.
    """
    line, every, address = memory.line, (1 << given.W) - 1, given.address
    table = given.table[stage, place % given.table.shape[1]].ctypes.data
    found = np.int64(every & ~ignored) << STEP
    if address != 0:
        found = call_code(address, (line.ctypes.data, table, ignored, steps))
    elif found == 0:  # no lane is left
        found = steps
    taken, step = found & (2**STEP - 1), (found >> STEP) & every
    solved, negative = step | (found >> DERIVATIVE) & every, (found >> NEGATIVE) & every
    if solved != 0:
        copy_lanes(given, memory, solved)
        found = np.int64(0)
        if address != 0:  # the step of the others, too
            others = np.int64(ignored | solved)
            found = call_code(address, (line.ctypes.data, table, others, np.int64(1)))
        negative |= (found >> NEGATIVE) & every
        negative |= solve_lanes(given, memory, place, stage, step, solved)
        taken += 1
    due, outside = (found >> DUE) & every | solved, (found >> OUTSIDE) & every | solved
    return taken, negative, due, outside, solved


@function
def copy_lanes(given, memory, lanes):
    """Keep the states and columns of lanes before a step, and what is carried."""
    line, D = memory.line, len(memory.after)
    first = 2 * D + LENGTHS
    for l in range(given.W):
        for i in range(D if (lanes >> l) & 1 else 0):
            memory.before[l, i] = line[i, l]
            for r in range(D):
                memory.columns[l, r, i] = line[first + i * given.room + r, l]
        memory.carried[l, 0], memory.carried[l, 1] = line[D + NEAR_1, l], line[D + FAR_FROM_1, l]


@function
def solve_lanes(given, memory, place, stage, step, lanes):
    """Find the derivative of lanes by `solve`, and the step of those in `step`; return bits of
    those of them with det A < 0.
    """
    line, half, after, D = memory.line, memory.half, memory.after, len(memory.after)
    first, negative, halves = 2 * D + LENGTHS, 0, given.halves
    for l in range(given.W):
        if (lanes >> l) & 1 == 0:
            continue
        for t in range(len(half)):
            value = halves[place % len(halves), t, l % halves.shape[2]]
            half[t] = given.fractions[stage] * value
        code = OK
        for i in range(D):
            after[i] = line[i, l]
        if (step >> l) & 1:
            after[:] = memory.before[l]
            code, beyond = solve_lane(given.indices, half, after, memory.of_step, memory.units)
            negative |= (1 << l) if beyond else 0
        memory.codes[l] = code
        before, columns = memory.before[l], memory.columns[l]
        of_tangent, units = memory.of_tangent, memory.units
        size = abs(derive(given.indices, half, before, after, columns, of_tangent, units))
        for i in range(D):
            line[i, l] = after[i]
            for r in range(D):
                line[first + i * given.room + r, l] = columns[r, i]
        line[D + VOLUME, l], line[D + NEAR_1, l] = 0.0, memory.carried[l, 0]
        line[D + FAR_FROM_1, l] = memory.carried[l, 1] * size
    return negative


# ------------------------------------------------------------------------------------------ kernels
@function
def enter(given, memory, x, carry, place, start):
    """Fill a line with trajectories, in their own columns; return bits of lanes that are ignored:
    those beyond the last, which repeat it.
    """
    line, (B, D), W, ignored = memory.line, x.shape, given.W, 0
    first = 2 * D + LENGTHS
    line[:] = 0.0
    for l in range(W):
        k = lesser(place * W + l, B - 1)
        ignored |= (1 << l) if place * W + l >= B else 0
        for i in range(D):
            line[i, l] = x[k, i] if start == 0 else carry[k, i]
            for r in range(D):
                unit = 1.0 if i == r else 0.0
                value = unit if start == 0 else carry[k, D + D * i + r]
                line[first + i * given.room + r, l] = value
        for j in range(LENGTHS + D):
            value = 0.0 if j == NEAR_1 else 1.0
            line[D + j, l] = value if start == 0 else carry[k, D + D * D + j]
    return np.int64(ignored)


@kernel
def jacobians(part, parts, given, x, out):
    """Fill out (B, D, D) with DPhi at the states x (B, D), NaN where it does not exist."""
    (B, D), W = x.shape, given.W
    memory, first = memory_of(given, D), 2 * D + LENGTHS
    begin, end = share((B + W - 1) // W, part, parts)
    for place in range(begin, end):
        ignored = enter(given, memory, x, x, place, 0)
        for stage in range(len(given.fractions)):  # an odd number: columns become -DPhi q
            take(given, memory, place, stage, ignored, np.int64(1))
        for l in range(lesser(W, B - place * W)):
            for i in range(D):
                for r in range(D):
                    value = memory.line[first + i * given.room + r, l]
                    out[place * W + l, i, r] = 0.0 * memory.line[i, l] - value


@function
def determinants(indices, halves, x, out):
    """Fill out (B,) with det A at states x (B, D), by partial pivoting; 0 to rounding is 0."""
    D = x.shape[1]
    system, units = np.empty((D, D, 1)), np.empty((2, D))
    for k in range(len(x)):
        fill_system(indices, halves[k % len(halves)], 1.0, x[k], system)
        solve(system, units)
        out[k] = determinant_of(system, units)


def densities(method, values, eps, x):
    """Return 1 / det A at states x (B, D), infinite where det A is 0 to rounding."""
    step, halves = method.step, 0.5 * eps[:, np.newaxis] * values
    found = dict(enumerate(np.ascontiguousarray(x.T)))
    with np.errstate(all="ignore"):
        found.update(zip(step.table, step.table_of(halves.T), strict=True))
        evaluate(step.usual, found)
        evaluate(step.rare, found)
        density, left = np.ones(len(x)), np.ones(len(x), bool)
        if step.usual:
            for k in sorted(step.factors.inverse):
                density = density * found[step.factors.inverse[k]]
            left = ~np.broadcast_to(found[step.accurate], len(x))
        exact = np.empty(np.count_nonzero(left))
        own = halves[left] if len(halves) > 1 else halves
        determinants(step.indices, own, x[left], exact)
        density[left] = 1.0 / exact
        return density + 0.0 * x.sum(axis=1)


@kernel
def growth(part, parts, given, x0, carry, span, sums, of_det, status, failed_at):
    """Add the logarithms of the growth of D lengths, and of |det DPhi|, along orbits.

    The derivatives of the steps are multiplied, and the product is decomposed as Q R, beginning
    with Q = 1: these are the logarithms of the diagonal of R. When that happens depends on the
    trajectory and on the number of the step alone, and all that a trajectory needs is carried: its
    bits do not depend on others, nor on where a run is divided. (Columns become -DPhi q, as their
    signs do not matter.)

    given        `Arguments`
    x0, carry    (B, D), read if the steps begin at 0; (B, 2 D + D D + 3), read otherwise, and
                 written
    span         the number of the state where the steps begin, and end, and of that where all
                 logarithms are taken
    sums, of_det   (B, D) and (B,), to which logarithms are added; NaN after a failure
    status, failed_at   (B,), as of `steps_field.field_steps`
    """
    given, sums, of_det = uncounted(given), uncounted(sums), uncounted(of_det)
    (start, stop, last), (B, D), W = span, x0.shape, given.W
    memory, stages = memory_of(given, D), len(given.fractions)
    line, first, every = memory.line, 2 * D + LENGTHS, (1 << W) - 1
    begin, end = share((B + W - 1) // W, part, parts)
    for place in range(begin, end):
        ignored, n, stage = enter(given, memory, x0, carry, place, start), start, 0
        for l in range(lesser(W, B - place * W)):
            k, undefined = place * W + l, 0.0
            for i in range(D):
                undefined += 0.0 * line[i, l]
            if start == 0 and np.isnan(undefined):
                status[k], failed_at[k] = NONFINITE, 0
            if status[k] < 0:
                ignored |= 1 << l
                line[:D, l] = np.nan
        while n < stop:
            steps = np.int64(1)
            if stages == 1:
                steps = np.int64(lesser(stop, (n // INTERVAL + 1) * INTERVAL) - n)
            taken, negative, due, outside, solved = take(
                given, memory, place, stage, ignored, steps
            )
            state = n + taken if stages == 1 else n + 1
            stage = (stage + taken) % stages
            n = state if stage == 0 else n
            for l in range(W if negative | solved else 0):
                k = place * W + l
                if (solved >> l) & 1 and memory.codes[l] != OK:
                    status[k], failed_at[k] = memory.codes[l], state
                    ignored |= 1 << l
                elif (negative >> l) & 1 and status[k] == OK:
                    status[k], failed_at[k] = PASSED_POLE, state
            always = stage == 0 and n == last
            if stage == 0 and (always or n % INTERVAL == 0):
                due = every
            due &= ~ignored
            if due:
                if given.orthonormalise != 0:
                    both = line[first:].ctypes.data, line[D:].ctypes.data
                    call_code(given.orthonormalise, (*both, np.int64(due)))
                else:
                    orthonormalise(line[first:], line[D : 2 * D + LENGTHS], given.room, due)
            if always or due | outside:
                take_logarithms(line[D : 2 * D + LENGTHS], sums, of_det, place * W, always)
        for l in range(lesser(W, B - place * W)):
            k = place * W + l
            of_det[k] += 0.0 * line[0, l]
            for i in range(D):
                sums[k, i] += 0.0 * line[i, l]
            for i in range(D):
                carry[k, i] = line[i, l]
                for r in range(D):
                    carry[k, D + D * i + r] = line[first + i * given.room + r, l]
            for j in range(LENGTHS + D):
                carry[k, D + D * D + j] = line[D + j, l]


@function
def orthonormalise(q, g, room, due):
    """Orthonormalise the columns q[i room + r, lane] of lanes, and multiply the lengths in g.

    Columns may be 0; no volume shows how others grow beside such a column, so that it is 0.
    """
    D = len(g) - LENGTHS
    for l in range(q.shape[1]):
        if (due >> l) & 1 == 0:
            continue
        g[VOLUME, l] = 1.0
        for r in range(D):  # the modified Gram-Schmidt method
            product = 0.0
            for i in range(D):
                product += q[i * room, l] * q[i * room + r, l]
            for s in range(r):
                part, product = product, 0.0
                for i in range(D):
                    x = q[i * room + r, l] - part * q[i * room + s, l]
                    q[i * room + r, l] = x
                    product += q[i * room + s + 1, l] * x
            length = np.sqrt(product)  # of the column with itself
            g[LENGTHS + r, l] *= length
            g[VOLUME, l] *= 0.0 if length == 0.0 else 1.0
            inverse = 0.0 if length == 0.0 else 1.0 / length
            for i in range(D):
                q[i * room + r, l] *= inverse


@function
def take_logarithms(g, sums, of_det, begin, always):
    """Add the logarithms of products that leave their range, or of all, and begin new ones."""
    for row in range(NEAR_1, len(g)):
        near = row == NEAR_1
        low, high = (NEAR_1_LEAST, NEAR_1_LARGEST) if near else (LEAST_LENGTH, LARGEST_LENGTH)
        for l in range(lesser(g.shape[1], len(of_det) - begin)):
            if always or g[row, l] <= low or g[row, l] >= high:
                logarithm = np.log1p(g[row, l]) if near else np.log(g[row, l])
                g[row, l] = 0.0 if near else 1.0
                if row < LENGTHS:
                    of_det[begin + l] += logarithm
                else:
                    sums[begin + l, row - LENGTHS] += logarithm
