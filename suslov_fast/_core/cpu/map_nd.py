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
tile     flat, (trajectories, m): rows of the block, as they lie in arrays of users.

Lanes that are not in use, and those of trajectories that have ended, rest at 0, in a unit that
makes it NaN.
"""

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
from ..formulas.units import exponent, power
from ..jit import Loop, inlined_part, part
from . import intrinsics  # noqa: F401  (compiles what `vector` defines)
from .elimination import eliminate
from .tiles import BEYOND_CACHES, write_numbers
from .turning_nd import CLEAN_EVERY, clean_up, turn
from .vector import (
    VECTOR,
    all_lanes,
    copy_transposed,
    fence,
    larger,
    load,
    scatter_pairs,
    select,
    smaller,
    splat,
    store,
    to_cache_line,
)

GAUSS, RANK2 = range(2)

LANES = 64
# Components that the groups of a block have together, unless it is one group: cells that fit in L1.
ROOM = 128

CELLS = 4
J_, I_, OMEGA, WORK = range(CELLS)
# eps; the unit of omega; bounds of |omega|**2 for steps to be small and for units to serve; p,
# |omega|**2, eps p / 2; what `increment` needs; 1 where the O(n) step is accurate, where a
# trajectory has ended, and where it never moves, else 0; the sums over components, and how large
# the determinant of the two unknowns must be.
SUMS = 20
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
    ALPHA,
    BETA,
    GAMMA,
    LEAST,
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
    status        (B,): OK, SINGULAR, NONFINITE, or NEEDS_ELIMINATION where all but `final` is as it
                  was.
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

    cells    (tasks, groups, m, CELLS, VECTOR), and the same as flat_cells, (tasks, their size).
    sums     (tasks, groups, SUMS, VECTOR)
    tile     (tasks, room for a block, and a vector more)
    """

    cells: np.ndarray
    flat_cells: np.ndarray
    sums: np.ndarray
    tile: np.ndarray


class Turning(NamedTuple):
    """Room for orientations, a part for each task.

    before   (tasks, trajectories, m), the states before the step.
    room     (tasks, 2 n + 2, n), two matrices and two vectors.
    """

    before: np.ndarray
    room: np.ndarray


@part
def block_size(m):
    """The trajectories that share a block, in whole groups."""
    return max(VECTOR, min(LANES, ROOM // m * VECTOR))


@part
def trajectory(chosen, position):
    return chosen[position] if chosen.size > 0 else position


@part
def scaled(number, k):
    """2**k times a number, infinite beyond float64; k is a sum of the exponents of three units."""
    third = (k + 1) // 3
    root = power(third)
    return number * root * root * power(k - 2 * third)


@part
def unit_of(largest, before):
    """The exponent of the unit for numbers up to this; it and its inverse are in range."""
    size = exponent(largest) + 1 if 0.0 < largest < np.inf else 0
    return min(max(size + before, -1022), 1023)


# Rows of components become rows of lanes, and the reverse: in pairs where components are few, else
# in squares of VECTOR. The last pair or square overlaps the one before.


@part
def gather(values, chosen, begin, end, cells, which, flat_cells, tile):
    """Rows of values, or one row for all; lanes beyond the end repeat the last."""
    m = values.shape[1]
    if values.shape[0] == 1:
        for g in range(cells.shape[0]):
            for i in range(m):
                store(cells, g, i, which, splat(values[0, i]))
        return
    for k in range(cells.shape[0] * VECTOR):
        b, g, l = trajectory(chosen, min(begin + k, end - 1)), k // VECTOR, k % VECTOR
        if m < VECTOR:
            for i in range(m):
                cells[g, i, which, l] = values[b, i]
        else:
            for i in range(m):
                tile[k * m + i] = values[b, i]
            if l == VECTOR - 1:
                for i in range(0, m, VECTOR):
                    first = min(i, m - VECTOR)
                    row = ((g * m + first) * CELLS + which) * VECTOR
                    square = g * VECTOR * m + first
                    copy_transposed(flat_cells, row, CELLS * VECTOR, tile, square, m)


@part
def write(tile, chosen, begin, end, m, flat, target):
    """Write the rows of a block to those of trajectories, of which that of 0 lies at `target`."""
    if chosen.size == 0:
        past_caches, line = flat.size >= BEYOND_CACHES, to_cache_line(flat, 0)
        size = (end - begin) * m
        write_numbers(tile, 0, flat, target + begin * m, size, line, past_caches)
    else:
        for k in range(end - begin):
            row = target + trajectory(chosen, begin + k) * m
            for i in range(m):
                flat[row + i] = tile[k * m + i]


@part
def normalise(cells, sums, which, alike):
    """Find units; their logarithms go to `sums`. `alike`: all lanes are."""
    number = 0
    for g in range(cells.shape[0]):
        largest = splat(0.0)
        for i in range(cells.shape[1]):
            largest = larger(abs(load(cells, g, i, which)), largest)
        store(sums, g, UNIT, largest)
        for l in range(VECTOR):
            if g + l == 0 or not alike:
                number = unit_of(sums[g, UNIT, l], 0)
            sums[g, which, l], sums[g, UNIT, l] = number, 1.0 / power(number)
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
            of_eps = int(sums[g, OMEGA, l] + sums[g, I_, l] - sums[g, J_, l])
            moves = sums[g, RESTS, l] == 0.0
            sums[g, EPS, l] = scaled(eps[b], of_eps) if moves else 0.0
            sums[g, UNIT, l] = power(int(sums[g, OMEGA, l]))


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
def end_undefined(span, kept, begin, end, cells, sums):
    """NaN is no state: such a trajectory ends before it begins."""
    for g in range(cells.shape[0]):
        undefined = splat(0.0)
        for i in range(cells.shape[1]):
            undefined = undefined + 0.0 * load(cells, g, i, OMEGA)
        store(sums, g, UNIT, undefined)
    for k in range(end - begin):
        if np.isnan(sums[k // VECTOR, UNIT, k % VECTOR]):
            b = trajectory(span.chosen, begin + k)
            kept.status[b], kept.failed_at[b] = NONFINITE, 0


@part
def start_block(bodies, omega, span, kept, begin, end, is_first, cells, flat_cells, sums, tile):
    """Returns whether some trajectories never move.

    is_first   Whether a body that serves all is not there yet.
    """
    chosen, some_rest = span.chosen, False
    for which, parameter in ((J_, bodies.J), (I_, bodies.I)):
        if is_first or parameter.shape[0] > 1:
            gather(parameter, chosen, begin, end, cells, which, flat_cells, tile)
            normalise(cells, sums, which, parameter.shape[0] == 1)
    if span.start == 0:
        gather(omega, chosen, begin, end, cells, OMEGA, flat_cells, tile)
        end_undefined(span, kept, begin, end, cells, sums)
        normalise(cells, sums, OMEGA, omega.shape[0] == 1)
    else:
        gather(kept.state, chosen, begin, end, cells, OMEGA, flat_cells, tile)
    for g in range(cells.shape[0]):
        coupled = splat(0.0)
        for i in range(cells.shape[1]):
            coupled = larger(abs(load(cells, g, i, I_)), coupled)
        store(sums, g, RESTS, coupled)
        for l in range(VECTOR):
            position = begin + g * VECTOR + l
            b = trajectory(chosen, min(position, end - 1))
            eps = bodies.eps[b if bodies.eps.size > 1 else 0]
            rests = eps == 0.0 or sums[g, RESTS, l] == 0.0
            some_rest |= rests
            sums[g, RESTS, l] = 1.0 if rests else 0.0
            sums[g, ENDED, l] = 1.0 if position >= end or kept.failed_at[b] >= 0 else 0.0
            if span.start > 0:
                sums[g, OMEGA, l] = kept.exponent[b]
    settle(bodies.eps, chosen, begin, cells, sums, range(cells.shape[0]))
    return some_rest


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
    """The sums of the O(n) step, with 1/d as work."""
    square, half = load(sums, g, SQUARE), 0.5 * load(sums, g, EPS) * load(sums, g, P)
    alpha, beta, gamma = splat(0.0), splat(0.0), splat(0.0)
    accurate = square < load(sums, g, SMALL_STEPS)
    for i in range(cells.shape[1]):
        J, I, omega = load(cells, g, i, J_), load(cells, g, i, I_), load(cells, g, i, OMEGA)
        d = J - half
        r = 1.0 / d
        accurate = accurate & (abs(d) > FAR * J)
        of_alpha, of_beta, of_gamma = summands(I, omega, r)
        alpha = alpha + of_alpha
        beta = beta + of_beta
        gamma = gamma + of_gamma
        store(cells, g, i, WORK, r)
    store(sums, g, HALF, half)
    store(sums, g, ALPHA, alpha)
    store(sums, g, BETA, beta)
    store(sums, g, GAMMA, gamma)
    store(sums, g, LEAST, select(accurate, splat(FAR * FAR), splat(np.inf)))


@inlined_part
def find_unknowns(sums, g):
    """The two unknowns of the O(n) step, after `sum_up`; whether it is accurate in all lanes."""
    eps, p, square = load(sums, g, EPS), load(sums, g, P), load(sums, g, SQUARE)
    alpha, beta, gamma = load(sums, g, ALPHA), load(sums, g, BETA), load(sums, g, GAMMA)
    of_omega, of_I, det, size = solve2(eps, p, square, alpha, beta, gamma)
    accurate = det > load(sums, g, LEAST) * size
    store(sums, g, OF_OMEGA, of_omega)
    store(sums, g, OF_I, of_I)
    store(sums, g, ACCURATE, select(accurate, splat(1.0), splat(0.0)))
    return all_lanes(accurate)


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
def step_each(cells, sums, g, width, task, matrices):
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
    if matrices is not None:
        if some_left:
            matrix = matrices[task]
            assemble(cells, sums, g, matrix)
            eliminate(matrix, cells.shape[1])
            for l in range(width):
                if sums[g, ACCURATE, l] == 0.0:
                    for i in range(cells.shape[1]):
                        cells[g, i, WORK, l] = matrix[i, cells.shape[1], l]
        some_left = False
    take_next_states(cells, sums, g)
    return some_left


@part
def set_aside(bodies, span, kept, begin, width, cells, sums, g):
    """Leave the lanes that are not ACCURATE to a call that has room for their elimination."""
    for l in range(width):
        if sums[g, ACCURATE, l] == 0.0:
            sums[g, ENDED, l] = 1.0
            kept.status[trajectory(span.chosen, begin + g * VECTOR + l)] = NEEDS_ELIMINATION
    settle(bodies.eps, span.chosen, begin, cells, sums, range(g, g + 1))


@inlined_part
def units_serve(sums, g):
    square = load(sums, g, SQUARE)
    return all_lanes((square > load(sums, g, LOW)) & (square < load(sums, g, HIGH)))


@part
def advance(cells, sums, n, stop):
    """Steps of a block by RANK2 to state stop, or to where something must be seen to.

    Returns the number of the state, whether units serve, and whether the step from there, of which
    unknowns are found, is accurate.
    """
    serve, accurate = True, True
    while n < stop and serve:
        # Of all groups first, and little at a time: then what several groups wait for overlaps.
        for g in range(cells.shape[0]):
            sum_up(cells, sums, g)
        for g in range(cells.shape[0]):
            accurate &= find_unknowns(sums, g)
        if not accurate:
            break
        for g in range(cells.shape[0]):
            step_all(cells, sums, g)
            serve &= units_serve(sums, g)
        n += 1
    return n, serve, accurate


@part
def advance_by_elimination(cells, sums, n, stop, matrix):
    """The same by GAUSS; returns the number of the state, and whether units serve."""
    serve = True
    while n < stop and serve:
        for g in range(cells.shape[0]):
            step_by_elimination(cells, sums, g, matrix)
            serve &= units_serve(sums, g)
        n += 1
    return n, serve


@part
def advance_with_care(bodies, span, kept, begin, end, cells, sums, task, matrices):
    """The step of a block where some lane needs care, after `find_unknowns`."""
    for g in range(cells.shape[0]):
        width = min(VECTOR, end - begin - g * VECTOR)
        if all_lanes(load(sums, g, ACCURATE) > 0.0):
            step_all(cells, sums, g)
        elif step_each(cells, sums, g, width, task, matrices):
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
            after = unit_of(largest, before)
            sums[g, OMEGA, l] = after
            for i in range(cells.shape[1]):
                cells[g, i, OMEGA, l] = scaled(cells[g, i, OMEGA, l], before - after)
    settle(bodies.eps, span.chosen, begin, cells, sums, range(g, g + 1))


@part
def show(cells, flat_cells, sums, tile):
    """The states of a block in the unit of the user, in the tile; but see `show_given`."""
    m = cells.shape[1]
    for g in range(cells.shape[0]):
        begin, unit = g * VECTOR * m, load(sums, g, UNIT)
        if m < VECTOR:
            for i in range(0, m, 2):
                first = max(min(i, m - 2), 0)
                one = load(cells, g, first, OMEGA) * unit
                other = load(cells, g, min(first + 1, m - 1), OMEGA) * unit
                scatter_pairs(tile, begin + first, m, one, other)
        else:
            for i in range(m):
                store(cells, g, i, WORK, load(cells, g, i, OMEGA) * unit)
            for i in range(0, m, VECTOR):
                first = min(i, m - VECTOR)
                row = ((g * m + first) * CELLS + WORK) * VECTOR
                copy_transposed(tile, begin + first, m, flat_cells, row, CELLS * VECTOR)


@part
def show_given(omega, chosen, begin, end, sums, tile, n):
    """Where nothing has moved, users see what was given."""
    m = omega.shape[1]
    for k in range(end - begin):
        g, l = k // VECTOR, k % VECTOR
        if sums[g, ENDED, l] == 0.0 and (n == 0 or sums[g, RESTS, l] > 0.0):
            b = trajectory(chosen, begin + k)
            for i in range(m):
                tile[k * m + i] = omega[b, i]


@part
def orient(bodies, span, kept, begin, end, sums, tile, task, turning, n):
    """Turn the orientations to state n, which is shown."""
    before, room = turning.before[task], turning.room[task]
    size = kept.columns.shape[1]
    m = size - 1
    gram, cleaned = room[:size], room[size : 2 * size]
    image, middle = room[2 * size], room[2 * size + 1, :m]
    for k in range(end - begin):
        b = trajectory(span.chosen, begin + k)
        if n > span.start:
            for i in range(m):
                middle[i] = mean(before[k, i], tile[k * m + i])
            step = bodies.time_step[b if bodies.time_step.size > 1 else 0]
            turn(kept.columns[b], middle, step, image)
            if n % CLEAN_EVERY == 0:
                clean_up(kept.columns[b], gram, cleaned)
        elif sums[k // VECTOR, ENDED, k % VECTOR] > 0.0:
            kept.columns[b] = np.nan
        for i in range(m):
            before[k, i] = tile[k * m + i]


@part
def save_turns(chosen, columns, begin, end, row):
    for position in range(begin, end):
        b = trajectory(chosen, position)
        for r in range(row.shape[1]):
            for c in range(row.shape[1]):
                row[b, r, c] = columns[b, c, r]


@part
def leave_block(omega, span, kept, begin, end, cells, flat_cells, sums, tile):
    """Write what is left at state stop."""
    m = cells.shape[1]
    show(cells, flat_cells, sums, tile)
    show_given(omega, span.chosen, begin, end, sums, tile, span.stop)
    write(tile, span.chosen, begin, end, m, kept.final.reshape(kept.final.size), 0)
    for g in range(cells.shape[0]):
        store(sums, g, UNIT, splat(1.0))
    show(cells, flat_cells, sums, tile)
    for k in range(end - begin):
        b, g, l = trajectory(span.chosen, begin + k), k // VECTOR, k % VECTOR
        if kept.status[b] != NEEDS_ELIMINATION:
            kept.status[b] = kept.status[b] if sums[g, ENDED, l] > 0.0 else OK
            kept.exponent[b] = sums[g, OMEGA, l]
            for i in range(m):
                kept.state[b, i] = tile[k * m + i]


@part
def run_block(
    method, bodies, omega, span, saved, kept, begin, end, is_first, task, scratch, matrices, turning
):
    """All steps of the trajectories at some positions."""
    groups = (end - begin + VECTOR - 1) // VECTOR
    cells, sums = scratch.cells[task, :groups], scratch.sums[task, :groups]
    flat_cells, tile = scratch.flat_cells[task], scratch.tile[task]
    chosen, m = span.chosen, omega.shape[1]
    flat = saved.omega.reshape(saved.omega.size)
    turns, next_saved = turning is not None, -1
    if saved.omega.shape[0] > 0:
        next_saved = 0 if span.start == 0 else (span.start // span.every + 1) * span.every
    row = 0 if span.start == 0 else span.start // span.every + 1 - span.first_row
    some_rest = start_block(
        bodies, omega, span, kept, begin, end, is_first, cells, flat_cells, sums, tile
    )
    n = span.start
    while True:
        if turns or n == next_saved:
            show(cells, flat_cells, sums, tile)
            if n == 0 or some_rest:
                show_given(omega, chosen, begin, end, sums, tile, n)
            if turning is not None:
                orient(bodies, span, kept, begin, end, sums, tile, task, turning, n)
        if n == next_saved:
            write(tile, chosen, begin, end, m, flat, row * omega.size)
            if turning is not None:
                save_turns(chosen, kept.columns, begin, end, saved.turns[row])
            next_saved += span.every
            row += 1
        if n == span.stop:
            break
        until = n + 1 if turns else span.stop
        if next_saved > n:
            until = min(until, next_saved)
        if method == GAUSS and matrices is not None:
            n, serve = advance_by_elimination(cells, sums, n, until, matrices[task])
        else:
            n, serve, accurate = advance(cells, sums, n, until)
            if not accurate:
                advance_with_care(bodies, span, kept, begin, end, cells, sums, task, matrices)
                n, serve = n + 1, False
        if not serve:
            see_to_units(bodies, span, kept, begin, end, cells, sums, n)
    leave_block(omega, span, kept, begin, end, cells, flat_cells, sums, tile)


def _iterate(method, bodies, omega, span, saved, kept, scratch, matrices, turning):
    """Iterate from the states `omega`, (B, m), at step 0, or from what is kept of state start.

    What has names here comes in plain tuples: Numba looks through named ones in Python, at every
    call.

    matrices   (tasks, rows, columns, VECTOR), see `elimination`; None if there is no room for it.
    turning    a Turning, or None if no orientations are wanted.

    What is None is not compiled: most calls want neither.
    """
    bodies, span, saved = Bodies(*bodies), Span(*span), Saved(*saved)
    kept, scratch = Kept(*kept), Scratch(*scratch)
    size = block_size(omega.shape[1])
    blocks = (span.end - span.begin + size - 1) // size
    tasks = min(blocks, scratch.cells.shape[0])
    for task in prange(tasks):
        first_block = task * blocks // tasks
        for block in range(first_block, (task + 1) * blocks // tasks):
            begin = span.begin + block * size
            end = min(begin + size, span.end)
            is_first = block == first_block
            run_block(
                method,
                bodies,
                omega,
                span,
                saved,
                kept,
                begin,
                end,
                is_first,
                task,
                scratch,
                matrices,
                turning,
            )
        fence()


iterate = Loop(_iterate)
