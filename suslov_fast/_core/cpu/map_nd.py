"""Loops over trajectories, steps and components of the n-dimensional map.

A block of a few groups of VECTOR trajectories advances together: while one group waits for a
division another works. A trajectory's arithmetic never depends on its block, nor on how its steps
are cut into calls.

GAUSS solves A(omega) omega_next = omega, equation (dsn). RANK2 solves for the increment in O(n):
then little is rounded while steps are small. Where they are not, where a d_i nearly vanishes or
omega shrinks by orders of magnitude, it goes over to other ways, a lane at a time.

The arrays of a group are vectors of lanes:

cells    (groups, m, 4, VECTOR): J, I, omega, and work: 1/d, then the next omega, then what users
         see of it. All but the last are in units of powers of two in which they are of the order of
         1; new ones where omega has left that.
sums     (groups, SUMS, VECTOR): logarithms of these units, then what EPS and so on name.

Lanes that are not in use, and those of trajectories that have ended, rest at 0, in a unit that
makes it NaN.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from ..codes import NEEDS_ELIMINATION, NONFINITE, OK, SINGULAR
from ..formulas.nd_map import (
    bordered,
    column_of_coupling,
    column_of_omega,
    entry,
    increment,
    solve2,
    solve3,
    summands,
    weights,
)
from ..formulas.rotation import mean
from ..jit import Loop, inlined_part, part
from . import intrinsics  # noqa: F401  (compiles what `vector` defines)
from .elimination import eliminate
from .turning_nd import CLEAN_EVERY, clean_up, turn
from .vector import (
    VECTOR,
    all_lanes,
    copy_transposed,
    larger,
    load,
    select,
    smaller,
    splat,
    store,
)

GAUSS, RANK2 = range(2)

LANES = 32
# Components that the groups of a block have together, unless it is one group: cells that fit in L1.
ROOM = 160

CELLS = 4
J_, I_, OMEGA, WORK = range(CELLS)
# eps; the unit of omega; bounds of |omega|**2 for steps to be small and for units to serve; p,
# |omega|**2, eps p / 2; what `increment` needs; 1 where the O(n) step is accurate, where a
# trajectory has ended, and where it never moves, else 0.
SUMS = 16
(
    EPS,
    UNIT,
    SMALL_STEPS,
    LOW,
    HIGH,
    P,
    SQUARE,
    HALF,
    OF_OMEGA,
    OF_I,
    ACCURATE,
    ENDED,
    RESTS,
) = range(3, SUMS)

# Where all |d_i| / J_i are above this, and the determinant of the two sums is above its square, the
# O(n) step loses less than two digits.
FAR = 0.25
# With the component of the smallest |d_i| / J_i as a third unknown, the next may be this small.
FAR_ENOUGH = 0.1
# A pivot of the three equations this much smaller than those before it costs three digits.
TOO_SMALL = 1e-3
# Steps are small where eps |I| |omega| / min J is below this: increments cancel at most so much.
SMALL = 64.0
# Units serve while |omega|**2 is between the inverse of this and this, or 0 from the start: then
# products of four of its components are in range.
SPREAD = 2.0**200
# States whose |omega| is below this in the unit of the user are finite there.
LARGEST = 2.0**1023


class Bodies(NamedTuple):
    """J and I: (B, m), or (1, m) where one body serves all; eps: (B,) or (1,).

    time_step   (B,) or (1,), the step size in the unit of time of omega, for orientations.
    """

    J: np.ndarray
    I: np.ndarray
    eps: np.ndarray
    time_step: np.ndarray


class Span(NamedTuple):
    """What is computed: positions begin to end of `chosen`, from state start to state stop.

    chosen   Numbers of trajectories; (0,) if all are meant.
    every    States whose number is a multiple of this are saved, `first_row` of them are not here.
    """

    chosen: np.ndarray
    begin: int
    end: int
    start: int
    stop: int
    every: int
    first_row: int


class Saved(NamedTuple):
    """The saved states, (rows, B, m), and orientations, (rows, B, n, n); rows may be 0."""

    omega: np.ndarray
    turns: np.ndarray


class Kept(NamedTuple):
    """What is left at state stop; read where start is not 0.

    final         (B, m), the states, NaN where one does not exist.
    status        (B,): OK, SINGULAR, NONFINITE, or NEEDS_ELIMINATION where all else is as it was.
    failed_at     (B,), the first state that does not exist, or -1.
    state         (B, m), the states in units of 2**exponent; (0, m) if nobody will go on.
    exponent      (B,)
    columns       (B, n, n), the transposed orientations, or (0, n, n) if they are not wanted.
    """

    final: np.ndarray
    status: np.ndarray
    failed_at: np.ndarray
    state: np.ndarray
    exponent: np.ndarray
    columns: np.ndarray


class Scratch(NamedTuple):
    """The first axis is that of tasks, of which each has several blocks.

    cells    (tasks, groups, m, CELLS, VECTOR)
    sums     (tasks, groups, SUMS, VECTOR)
    matrix   (tasks, rows, columns, VECTOR), see `elimination`; no rows if there is no room for it.
    before   (tasks, groups, m, VECTOR), the states before the step, if turns are wanted.
    turning  (tasks, 2 n + 2, n), two matrices and two vectors, if turns are wanted.
    """

    cells: np.ndarray
    sums: np.ndarray
    matrix: np.ndarray
    before: np.ndarray
    turning: np.ndarray


@part
def block_size(m):
    """The trajectories that share a block, in whole groups."""
    return max(VECTOR, min(LANES, ROOM // m * VECTOR))


@part
def trajectory(chosen, position):
    return chosen[position] if chosen.size > 0 else position


@part
def scaled(number, exponent):
    """2**exponent times a number, infinite beyond float64; exponents are those of three units."""
    third = (exponent + 1) // 3
    root = math.ldexp(1.0, third)
    return number * root * root * math.ldexp(1.0, exponent - 2 * third)


@part
def unit_of(largest, before):
    """The exponent of the unit for numbers up to this; it and its inverse are in range."""
    return min(max(math.frexp(largest)[1] + before, -1022), 1023)


@part
def gather(values, chosen, begin, end, cells, which):
    """Rows of values, or one row for all; lanes beyond the end repeat the last."""
    m, alike = values.shape[1], values.shape[0] == 1
    for g in range(cells.shape[0]):
        if alike:
            for i in range(m):
                store(cells, g, i, which, splat(values[0, i]))
        else:
            for l in range(VECTOR):
                b = trajectory(chosen, min(begin + g * VECTOR + l, end - 1))
                for i in range(m):
                    cells[g, i, which, l] = values[b, i]


@part
def normalise(cells, sums, which, alike):
    """Find units; their logarithms go to `sums`. `alike`: all lanes are."""
    exponent = 0
    for g in range(cells.shape[0]):
        largest = splat(0.0)
        for i in range(cells.shape[1]):
            largest = larger(abs(load(cells, g, i, which)), largest)
        store(sums, g, UNIT, largest)
        for l in range(VECTOR):
            if g + l == 0 or not alike:
                exponent = unit_of(sums[g, UNIT, l], 0)
            sums[g, which, l], sums[g, UNIT, l] = exponent, math.ldexp(1.0, -exponent)
        inverse = load(sums, g, UNIT)
        for i in range(cells.shape[1]):
            store(cells, g, i, which, load(cells, g, i, which) * inverse)


@part
def add_up(cells, sums, g):
    """p and |omega|**2 of each lane."""
    p, square = splat(0.0), splat(0.0)
    for i in range(cells.shape[1]):
        I, omega = load(cells, g, i, I_), load(cells, g, i, OMEGA)
        p = p + I * omega
        square = square + omega * omega
    store(sums, g, P, p)
    store(sums, g, SQUARE, square)


@part
def settle_lanes(eps, chosen, first, cells, sums, g):
    """eps in the units of a lane, that of omega, and rest where the trajectory has ended."""
    for l in range(VECTOR):
        if sums[g, ENDED, l] > 0.0:
            sums[g, EPS, l], sums[g, UNIT, l] = 0.0, np.nan
            for i in range(cells.shape[1]):
                cells[g, i, OMEGA, l] = 0.0
        else:
            b = trajectory(chosen, first + l) if eps.size > 1 else 0
            # (dsn) keeps its form: only eps I omega / J counts.
            exponent = int(sums[g, OMEGA, l] + sums[g, I_, l] - sums[g, J_, l])
            moves = sums[g, RESTS, l] == 0.0
            sums[g, EPS, l] = scaled(eps[b], exponent) if moves else 0.0
            sums[g, UNIT, l] = math.ldexp(1.0, int(sums[g, OMEGA, l]))


@part
def settle(eps, chosen, begin, cells, sums, groups):
    """What depends on the units of omega, and on which lanes have ended."""
    for g in groups:
        settle_lanes(eps, chosen, begin + g * VECTOR, cells, sums, g)
        smallest, coupling = splat(np.inf), splat(0.0)
        for i in range(cells.shape[1]):
            smallest = smaller(load(cells, g, i, J_), smallest)
            coupling = coupling + load(cells, g, i, I_) * load(cells, g, i, I_)
        longest, largest = SMALL * smallest / load(sums, g, EPS), LARGEST / load(sums, g, UNIT)
        store(sums, g, SMALL_STEPS, longest * longest / coupling)
        add_up(cells, sums, g)
        moves = load(sums, g, SQUARE) > 0.0
        store(sums, g, LOW, select(moves, splat(1.0 / SPREAD), splat(-1.0)))
        store(sums, g, HIGH, smaller(largest * largest, splat(SPREAD)))


@part
def end_undefined(omega, span, kept, begin, end):
    """NaN is no state: such a trajectory ends before it begins."""
    for position in range(begin, end):
        b = trajectory(span.chosen, position)
        undefined = 0.0
        for i in range(omega.shape[1]):
            undefined += 0.0 * omega[b, i]
        if np.isnan(undefined):
            kept.status[b], kept.failed_at[b] = NONFINITE, 0


@part
def start_block(bodies, omega, span, kept, begin, end, cells, sums):
    chosen = span.chosen
    gather(bodies.J, chosen, begin, end, cells, J_)
    gather(bodies.I, chosen, begin, end, cells, I_)
    normalise(cells, sums, J_, bodies.J.shape[0] == 1)
    normalise(cells, sums, I_, bodies.I.shape[0] == 1)
    if span.start == 0:
        end_undefined(omega, span, kept, begin, end)
        gather(omega, chosen, begin, end, cells, OMEGA)
        normalise(cells, sums, OMEGA, omega.shape[0] == 1)
    else:
        gather(kept.state, chosen, begin, end, cells, OMEGA)
    for g in range(cells.shape[0]):
        coupled = splat(0.0)
        for i in range(cells.shape[1]):
            coupled = larger(abs(load(cells, g, i, I_)), coupled)
        store(sums, g, RESTS, coupled)
        for l in range(VECTOR):
            position = begin + g * VECTOR + l
            b = trajectory(chosen, min(position, end - 1))
            eps = bodies.eps[b if bodies.eps.size > 1 else 0]
            sums[g, RESTS, l] = 1.0 if eps == 0.0 or sums[g, RESTS, l] == 0.0 else 0.0
            sums[g, ENDED, l] = 1.0 if position >= end or kept.failed_at[b] >= 0 else 0.0
            if span.start > 0:
                sums[g, OMEGA, l] = kept.exponent[b]
    settle(bodies.eps, chosen, begin, cells, sums, range(cells.shape[0]))


@part
def assemble(cells, sums, g, matrix):
    """A and its right side."""
    m = cells.shape[1]
    eps = load(sums, g, EPS)
    half = 0.5 * eps * load(sums, g, P)
    store(sums, g, HALF, half)
    for i in range(m):
        J_i, I_i, omega_i = load(cells, g, i, J_), load(cells, g, i, I_), load(cells, g, i, OMEGA)
        of_omega, of_I = column_of_omega(J_i, I_i, eps), column_of_coupling(J_i, omega_i, eps)
        for j in range(m):
            I_j, omega_j = load(cells, g, j, I_), load(cells, g, j, OMEGA)
            store(matrix, i, j, entry(0.0, of_omega, of_I, I_j, omega_j))
        store(matrix, i, i, entry(1.0 - half / J_i, of_omega, of_I, I_i, omega_i))
        store(matrix, i, m, omega_i)


@part
def step_by_elimination(cells, sums, g, matrix):
    assemble(cells, sums, g, matrix)
    eliminate(matrix, cells.shape[1])
    p, square = splat(0.0), splat(0.0)
    for i in range(cells.shape[1]):
        omega = load(matrix, i, cells.shape[1])
        store(cells, g, i, OMEGA, omega)
        p = p + load(cells, g, i, I_) * omega
        square = square + omega * omega
    store(sums, g, P, p)
    store(sums, g, SQUARE, square)


@inlined_part
def sum_up(cells, sums, g):
    """The sums of the O(n) step, with 1/d as work, and the two unknowns that follow."""
    eps, p, square = load(sums, g, EPS), load(sums, g, P), load(sums, g, SQUARE)
    half = 0.5 * eps * p
    alpha, beta, gamma, margin = splat(0.0), splat(0.0), splat(0.0), splat(np.inf)
    for i in range(cells.shape[1]):
        J, I, omega = load(cells, g, i, J_), load(cells, g, i, I_), load(cells, g, i, OMEGA)
        d = J - half
        r = 1.0 / d
        margin = smaller(abs(d) - FAR * J, margin)
        of_alpha, of_beta, of_gamma = summands(I, omega, r)
        alpha = alpha + of_alpha
        beta = beta + of_beta
        gamma = gamma + of_gamma
        store(cells, g, i, WORK, r)
    of_omega, of_I, det, size = solve2(eps, p, square, alpha, beta, gamma)
    accurate = (margin > 0.0) & (det > FAR * FAR * size) & (square < load(sums, g, SMALL_STEPS))
    store(sums, g, HALF, half)
    store(sums, g, OF_OMEGA, of_omega)
    store(sums, g, OF_I, of_I)
    store(sums, g, ACCURATE, select(accurate, splat(1.0), splat(0.0)))


@part
def next_component(cells, g, i, of_omega, of_I):
    I, omega, r = load(cells, g, i, I_), load(cells, g, i, OMEGA), load(cells, g, i, WORK)
    return omega + increment(I, omega, of_omega, of_I, r)


@part
def next_states(cells, sums, g):
    of_omega, of_I = load(sums, g, OF_OMEGA), load(sums, g, OF_I)
    for i in range(cells.shape[1]):
        store(cells, g, i, WORK, next_component(cells, g, i, of_omega, of_I))


@part
def take_next_states(cells, sums, g):
    for i in range(cells.shape[1]):
        store(cells, g, i, OMEGA, load(cells, g, i, WORK))
    add_up(cells, sums, g)


@inlined_part
def step_all(cells, sums, g):
    """`next_states` and `take_next_states` at once, where no lane needs care."""
    of_omega, of_I = load(sums, g, OF_OMEGA), load(sums, g, OF_I)
    p, square = splat(0.0), splat(0.0)
    for i in range(cells.shape[1]):
        omega = next_component(cells, g, i, of_omega, of_I)
        store(cells, g, i, OMEGA, omega)
        p = p + load(cells, g, i, I_) * omega
        square = square + omega * omega
    store(sums, g, P, p)
    store(sums, g, SQUARE, square)


@part
def step_bordered(cells, sums, g, l, k):
    """The O(n) step of lane l with the increment of component k, whose d is small, as an unknown.

    Returns whether it is accurate.
    """
    eps, p, square = sums[g, EPS, l], sums[g, P, l], sums[g, SQUARE, l]
    alpha, beta, gamma = 0.0, 0.0, 0.0
    for i in range(cells.shape[1]):
        if i != k:
            r = 1.0 / (cells[g, i, J_, l] - sums[g, HALF, l])
            of_alpha, of_beta, of_gamma = summands(cells[g, i, I_, l], cells[g, i, OMEGA, l], r)
            alpha += of_alpha
            beta += of_beta
            gamma += of_gamma
            cells[g, i, WORK, l] = r
    J_k, I_k, omega_k = cells[g, k, J_, l], cells[g, k, I_, l], cells[g, k, OMEGA, l]
    first, second, third = bordered(J_k, I_k, omega_k, eps, p, square, alpha, beta, gamma)
    I_delta, omega_delta, delta_k, pivot1, pivot2, pivot3 = solve3(first, second, third)
    of_omega, of_I = weights(eps, p, square, I_delta, omega_delta)
    for i in range(cells.shape[1]):
        cells[g, i, WORK, l] = cells[g, i, OMEGA, l] + increment(
            cells[g, i, I_, l], cells[g, i, OMEGA, l], of_omega, of_I, cells[g, i, WORK, l]
        )
    cells[g, k, WORK, l] = omega_k + delta_k
    return pivot2 > TOO_SMALL * pivot1 and pivot3 > TOO_SMALL * max(pivot1, pivot2)


@part
def step_with_care(cells, sums, g, l):
    """The step of a lane where one d may be small; whether it is accurate."""
    if not sums[g, SQUARE, l] < sums[g, SMALL_STEPS, l]:
        return False
    half = sums[g, HALF, l]
    k, smallest, second = 0, np.inf, np.inf
    for i in range(cells.shape[1]):
        ratio = abs(1.0 - half / cells[g, i, J_, l])
        if ratio < smallest:
            k, smallest, second = i, ratio, smallest
        elif ratio < second:
            second = ratio
    return second > FAR_ENOUGH and step_bordered(cells, sums, g, l, k)


@part
def step_each(cells, sums, g, width, matrix):
    """The step of a group where some lane needs care, by elimination where that is not enough.

    Returns whether there is no room for that; then the lanes concerned are not ACCURATE.
    """
    next_states(cells, sums, g)
    some_left = False
    for l in range(width):
        left = (
            sums[g, ACCURATE, l] == 0.0
            and sums[g, ENDED, l] == 0.0
            and not step_with_care(cells, sums, g, l)
        )
        sums[g, ACCURATE, l] = 0.0 if left else 1.0
        some_left |= left
    if some_left and matrix.shape[0] > 0:
        assemble(cells, sums, g, matrix)
        eliminate(matrix, cells.shape[1])
        for l in range(width):
            if sums[g, ACCURATE, l] == 0.0:
                for i in range(cells.shape[1]):
                    cells[g, i, WORK, l] = matrix[i, cells.shape[1], l]
    take_next_states(cells, sums, g)
    return some_left and matrix.shape[0] == 0


@part
def set_aside(bodies, span, kept, begin, width, cells, sums, g):
    """Leave the lanes that are not ACCURATE to a call that has room for their elimination."""
    for l in range(width):
        if sums[g, ACCURATE, l] == 0.0:
            sums[g, ENDED, l] = 1.0
            kept.status[trajectory(span.chosen, begin + g * VECTOR + l)] = NEEDS_ELIMINATION
    settle(bodies.eps, span.chosen, begin, cells, sums, range(g, g + 1))


@inlined_part
def all_accurate(sums, g):
    return all_lanes(load(sums, g, ACCURATE) > 0.0)


@inlined_part
def units_serve(sums, g):
    square = load(sums, g, SQUARE)
    return all_lanes((square > load(sums, g, LOW)) & (square < load(sums, g, HIGH)))


@part
def advance(cells, sums, n, stop):
    """Steps of a block by RANK2 to state stop, or to where something must be seen to.

    Returns the number of the state, and whether the step from there, of which `sum_up` is done,
    needs care.
    """
    serve, accurate = True, True
    while n < stop and serve:
        # Of all groups first: one need not wait for the unknowns of the one before.
        for g in range(cells.shape[0]):
            sum_up(cells, sums, g)
            accurate &= all_accurate(sums, g)
        if not accurate:
            return n, True
        for g in range(cells.shape[0]):
            step_all(cells, sums, g)
            serve &= units_serve(sums, g)
        n += 1
    return n, False


@part
def advance_with_care(bodies, span, kept, begin, end, cells, sums, matrix):
    """The step of a block where some lane needs care, after `sum_up`."""
    for g in range(cells.shape[0]):
        width = min(VECTOR, end - begin - g * VECTOR)
        if all_accurate(sums, g):
            step_all(cells, sums, g)
        elif step_each(cells, sums, g, width, matrix):
            set_aside(bodies, span, kept, begin, width, cells, sums, g)


@part
def see_to_units(bodies, span, kept, begin, end, cells, sums, n):
    """After the step to state n: end what is not finite, and find new units."""
    for g in range(cells.shape[0]):
        width = min(VECTOR, end - begin - g * VECTOR)
        if not units_serve(sums, g):
            end_lanes(span, kept, begin, width, cells, sums, g, n)
            renew(bodies, span, begin, width, cells, sums, g)


@part
def end_lanes(span, kept, begin, width, cells, sums, g, n):
    """End the trajectories whose state n is not finite in the unit of the user."""
    for l in range(width):
        finite, undefined = True, False
        for i in range(cells.shape[1]):
            finite &= np.isfinite(cells[g, i, OMEGA, l] * sums[g, UNIT, l])
            undefined |= np.isnan(cells[g, i, OMEGA, l])
        if not finite and sums[g, ENDED, l] == 0.0:
            sums[g, ENDED, l] = 1.0
            b = trajectory(span.chosen, begin + g * VECTOR + l)
            in_range = np.isfinite(sums[g, HALF, l])
            kept.status[b] = SINGULAR if undefined and in_range else NONFINITE
            kept.failed_at[b] = n


@part
def renew(bodies, span, begin, width, cells, sums, g):
    """Find new units where they do not serve any more."""
    for l in range(width):
        serves = sums[g, LOW, l] < sums[g, SQUARE, l] < sums[g, HIGH, l]
        if not serves and sums[g, ENDED, l] == 0.0:
            largest, before = 0.0, int(sums[g, OMEGA, l])
            for i in range(cells.shape[1]):
                largest = max(largest, abs(cells[g, i, OMEGA, l]))
            exponent = unit_of(largest, before)
            sums[g, OMEGA, l] = exponent
            for i in range(cells.shape[1]):
                cells[g, i, OMEGA, l] = scaled(cells[g, i, OMEGA, l], before - exponent)
    settle(bodies.eps, span.chosen, begin, cells, sums, range(g, g + 1))


@inlined_part
def show(cells, sums, g):
    """What users see of the states of a group, as work; but see `show_given`."""
    unit = load(sums, g, UNIT)
    for i in range(cells.shape[1]):
        store(cells, g, i, WORK, load(cells, g, i, OMEGA) * unit)


@inlined_part
def all_move(sums, g):
    return all_lanes(load(sums, g, RESTS) < 1.0)


@part
def show_given(omega, chosen, first, width, cells, sums, g, n):
    """Where nothing has moved, users see what was given."""
    for l in range(width):
        if sums[g, ENDED, l] == 0.0 and (n == 0 or sums[g, RESTS, l] > 0.0):
            b = trajectory(chosen, first + l)
            for i in range(cells.shape[1]):
                cells[g, i, WORK, l] = omega[b, i]


@inlined_part
def write(flat_cells, m, g, first, flat, begin):
    """Write what is shown of a whole group to flat saved states; returns for how many components.

    Those of trajectory 0 lie at `begin`.
    """
    in_squares = m - m % VECTOR
    for i in range(0, in_squares, VECTOR):
        row = ((g * m + i) * CELLS + WORK) * VECTOR
        copy_transposed(flat, begin + first * m + i, m, flat_cells, row, CELLS * VECTOR)
    return in_squares


@inlined_part
def write_rest(cells, g, in_squares, chosen, first, width, flat, begin):
    """Write the other components, and those of groups that are not whole, one by one."""
    m = cells.shape[1]
    for l in range(width):
        target = begin + trajectory(chosen, first + l) * m
        for i in range(in_squares, m):
            flat[target + i] = cells[g, i, WORK, l]


@part
def orient(bodies, span, kept, first, width, cells, sums, g, turning, n):
    """Turn the orientations to state n, which is shown."""
    before, room = turning
    size = cells.shape[1] + 1
    gram, cleaned = room[:size], room[size : 2 * size]
    image, middle = room[2 * size], room[2 * size + 1, : size - 1]
    for l in range(width):
        b = trajectory(span.chosen, first + l)
        if n > span.start:
            for i in range(size - 1):
                middle[i] = mean(before[g, i, l], cells[g, i, WORK, l])
            step = bodies.time_step[b if bodies.time_step.size > 1 else 0]
            turn(kept.columns[b], middle, step, image)
            if n % CLEAN_EVERY == 0:
                clean_up(kept.columns[b], gram, cleaned)
        elif sums[g, ENDED, l] > 0.0:
            kept.columns[b] = np.nan
    for i in range(size - 1):
        store(before, g, i, load(cells, g, i, WORK))


@part
def save_turns(chosen, columns, begin, end, row):
    for position in range(begin, end):
        b = trajectory(chosen, position)
        for r in range(row.shape[1]):
            for c in range(row.shape[1]):
                row[b, r, c] = columns[b, c, r]


@part
def leave_block(omega, span, kept, begin, end, cells, sums):
    """Write what is left at state stop."""
    for g in range(cells.shape[0]):
        show(cells, sums, g)
        width = min(VECTOR, end - begin - g * VECTOR)
        if span.stop == 0 or not all_move(sums, g):
            first = begin + g * VECTOR
            show_given(omega, span.chosen, first, width, cells, sums, g, span.stop)
        for l in range(width):
            b = trajectory(span.chosen, begin + g * VECTOR + l)
            if kept.status[b] != NEEDS_ELIMINATION:
                kept.status[b] = kept.status[b] if sums[g, ENDED, l] > 0.0 else OK
                for i in range(cells.shape[1]):
                    kept.final[b, i] = cells[g, i, WORK, l]
                kept.exponent[b] = sums[g, OMEGA, l]
                for i in range(cells.shape[1]):
                    kept.state[b, i] = cells[g, i, OMEGA, l]


@part
def run_block(method, bodies, omega, span, saved, kept, begin, end, cells, sums, matrix, turning):
    """All steps of the trajectories at some positions."""
    chosen, m, groups = span.chosen, cells.shape[1], cells.shape[0]
    flat, flat_cells = saved.omega.reshape(saved.omega.size), cells.reshape(cells.size)
    turns, next_saved = kept.columns.shape[0] > 0, -1
    if saved.omega.shape[0] > 0:
        next_saved = 0 if span.start == 0 else (span.start // span.every + 1) * span.every
    row = 0 if span.start == 0 else span.start // span.every + 1 - span.first_row
    start_block(bodies, omega, span, kept, begin, end, cells, sums)
    n = span.start
    while True:
        if turns or n == next_saved:
            for g in range(groups):
                first = begin + g * VECTOR
                width = min(VECTOR, end - first)
                show(cells, sums, g)
                if n == 0 or not all_move(sums, g):
                    show_given(omega, chosen, first, width, cells, sums, g, n)
                if turns:
                    orient(bodies, span, kept, first, width, cells, sums, g, turning, n)
                if n == next_saved:
                    begin_of_row, written = row * omega.size, 0
                    if width == VECTOR and chosen.size == 0:
                        written = write(flat_cells, m, g, first, flat, begin_of_row)
                    write_rest(cells, g, written, chosen, first, width, flat, begin_of_row)
            if turns and n == next_saved:
                save_turns(chosen, kept.columns, begin, end, saved.turns[row])
        if n == next_saved:
            next_saved += span.every
            row += 1
        if n == span.stop:
            break
        if method == GAUSS:
            for g in range(groups):
                step_by_elimination(cells, sums, g, matrix)
            n += 1
        else:
            until = n + 1 if turns else span.stop
            if next_saved > n:
                until = min(until, next_saved)
            n, needs_care = advance(cells, sums, n, until)
            if needs_care:
                advance_with_care(bodies, span, kept, begin, end, cells, sums, matrix)
                n += 1
        see_to_units(bodies, span, kept, begin, end, cells, sums, n)
    leave_block(omega, span, kept, begin, end, cells, sums)


def _iterate(method, bodies, omega, span, saved, kept, scratch):
    """Iterate from the states `omega`, (B, m), at step 0, or from what is kept of state start."""
    size = block_size(omega.shape[1])
    blocks = (span.end - span.begin + size - 1) // size
    tasks = min(blocks, scratch.cells.shape[0])
    for task in prange(tasks):
        for block in range(task * blocks // tasks, (task + 1) * blocks // tasks):
            begin = span.begin + block * size
            end = min(begin + size, span.end)
            groups = (end - begin + VECTOR - 1) // VECTOR
            run_block(
                method,
                bodies,
                omega,
                span,
                saved,
                kept,
                begin,
                end,
                scratch.cells[task, :groups],
                scratch.sums[task, :groups],
                scratch.matrix[task],
                (scratch.before[task], scratch.turning[task]),
            )


iterate = Loop(_iterate)
