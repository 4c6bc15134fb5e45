"""Loops over trajectories, steps and components of the n-dimensional map.

A block of a few groups of VECTOR trajectories advances together: while one group waits for a
division another works. A trajectory's arithmetic never depends on its block, nor on how its steps
are cut into calls.

GAUSS solves A(omega) omega_next = omega, equation (dsn). RANK2 solves for the increment in O(n):
then little is rounded while steps are small. Where they are not, where a d_i nearly vanishes or
omega shrinks by orders of magnitude, it goes over to other ways, in the lanes concerned.

Arrays of a block are flat, with rows of VECTOR lanes:

cells   group by group and component by component, four rows: J, I, omega, and work: 1/d, then the
        next omega. All but the last are in units of powers of two in which they are of the order
        of 1; new ones where omega has left that.
sums    group by group, what the rows named below hold of each trajectory.
tile    rows of the components of a trajectory, as they lie in arrays of users.

Lanes that are not in use, and those of trajectories that have ended, rest at 0, in a unit that
makes it NaN.
"""

from typing import NamedTuple

import numpy as np
from numba import prange

from ..codes import NEEDS_ELIMINATION, NONFINITE, OK, SINGULAR
from ..formulas.elementary import TO_INTEGER, exponent, two_to_the
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
from ..jit import Loop
from ..lanewise import any_lane, larger, select, smaller
from ..staged import apart, staged
from . import intrinsics  # noqa: F401  (compiles what `vector` defines)
from .elimination import eliminate, of_vectors
from .tiles import BEYOND_CACHES, write_numbers
from .turning_nd import CLEAN_EVERY, clean_up, turn
from .vector import (
    VECTOR,
    all_lanes,
    copy_transposed,
    fence,
    load,
    splat,
    store,
    store_at,
    store_rows,
    to_cache_line,
    vector_at,
)

GAUSS, RANK2 = range(2)

# Trajectories of a block at most, and of one that is made smaller for threads to share the work.
LANES, SHARED = 128, 64

# Where the rows of a component lie.
CELL = 4 * VECTOR
J_, I_, OMEGA, WORK = range(0, CELL, VECTOR)
# Those of a group: the logarithms of units, in the places of what has them; eps in the unit of the
# user, and in those of the lane; the unit of omega; bounds of |omega|**2 for steps to be small and
# for units to serve; p, |omega|**2, eps p / 2; what `increment` needs; 1 where the O(n) step is
# accurate, where a trajectory has ended, and where it never moves, else 0; the sums over
# components, and how large the determinant of the two unknowns must be; how a trajectory ends now.
GROUP = 22 * VECTOR
(
    GIVEN_EPS,
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
    CODE,
) = range(3 * VECTOR, GROUP, VECTOR)
# Numbers that the groups of a block have together, unless it is one group: they stay in L1.
ROOM = 688 * VECTOR

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


class Block(NamedTuple):
    """Trajectories that advance together, at positions begin to end, in so many groups."""

    cells: np.ndarray
    sums: np.ndarray
    tile: np.ndarray
    m: int
    begin: int
    end: int
    groups: int


class Turning(NamedTuple):
    """Room for orientations.

    before   (trajectories, m), the states before the step.
    room     (2 n + 2, n), two matrices and two vectors.
    """

    before: np.ndarray
    room: np.ndarray


@staged
def block_size(m):
    """The trajectories that share a block, in whole groups."""
    return max(VECTOR, min(LANES, ROOM // (m * CELL + GROUP) * VECTOR))


@staged
def trajectory(chosen, position):
    b = position
    if chosen.size > 0:
        b = chosen[position]
    return b


def rows_at(array, index, *rows):
    return (vector_at(array, index + row) for row in rows)


def scaled(number, k):
    """2**k times a number, infinite beyond float64; k is a sum of the exponents of three units."""
    third = (k * (1.0 / 3.0) + TO_INTEGER) - TO_INTEGER
    root = two_to_the(third)
    return number * root * root * two_to_the(k - 2.0 * third)


def unit_of(largest, before):
    """The exponent of the unit for numbers up to this; it and its inverse are in range."""
    size = select((largest > 0.0) & (largest < np.inf), exponent(largest) + 1.0, 0.0)
    return larger(smaller(size + before, 1023.0), -1022.0)


# Rows of components become rows of lanes, and the reverse, in squares of VECTOR. What a square has
# beyond the last component is written over by what follows.


@apart
def gather(values, chosen, block, which):
    """Rows of values, or one row for all; lanes beyond the end repeat the last."""
    m, tile = block.m, block.tile
    for g in range(block.groups):
        for l in range(VECTOR):
            position = min(block.begin + g * VECTOR + l, block.end - 1)
            b = 0
            if values.shape[0] > 1:
                b = trajectory(chosen, position)
            for i in range(m):
                tile[l * m + i] = values[b, i]
        for i in range(0, m, VECTOR):
            row = (g * m + i) * CELL + which
            copy_transposed(block.cells, row, CELL, tile, i, m, splat(1.0))


@apart
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


def largest_yet(cells, place, largest):
    return larger(abs(vector_at(cells, place)), largest)


def find_unit(sums, place, largest):
    """Keep its logarithm; returns its inverse."""
    number = unit_of(largest, 0.0)
    store_at(sums, place, number)
    return 1.0 / two_to_the(number)


def multiply(cells, place, factor):
    store_at(cells, place, vector_at(cells, place) * factor)


@apart
def enter(values, chosen, block, which):
    """Gather numbers and find units of them."""
    gather(values, chosen, block, which)
    cells, size = block.cells, block.m * CELL
    for g in range(block.groups):
        largest = splat(0.0)
        for c in range(g * size, (g + 1) * size, CELL):
            largest = largest_yet(cells, c + which, largest)
        inverse = find_unit(block.sums, g * GROUP + which, largest)
        for c in range(g * size, (g + 1) * size, CELL):
            multiply(cells, c + which, inverse)


def settle_units(sums, s):
    """eps in the units of a lane, and that of omega; whether the trajectory goes on."""
    of_J, of_I, of_omega, eps, ended, rests = rows_at(
        sums, s, J_, I_, OMEGA, GIVEN_EPS, ENDED, RESTS
    )
    # (dsn) keeps its form: only eps I omega / J counts.
    own_eps = scaled(eps, of_omega + of_I - of_J)
    goes_on = ended == 0.0
    store_at(sums, s + EPS, select(goes_on & (rests == 0.0), own_eps, 0.0))
    store_at(sums, s + UNIT, select(goes_on, two_to_the(of_omega), np.nan))
    return goes_on


def settle_component(cells, c, goes_on, smallest, coupling, p, square):
    J, I, omega = rows_at(cells, c, J_, I_, OMEGA)
    omega = select(goes_on, omega, 0.0)
    store_at(cells, c + OMEGA, omega)
    return smaller(J, smallest), coupling + I * I, p + I * omega, square + omega * omega


def settle_bounds(sums, s, smallest, coupling, p, square):
    eps, unit = rows_at(sums, s, EPS, UNIT)
    longest, largest = SMALL * smallest / eps, LARGEST / unit
    store_at(sums, s + SMALL_STEPS, longest * longest / coupling)
    store_at(sums, s + LOW, select(square > 0.0, 1.0 / SPREAD, -1.0))
    store_at(sums, s + HIGH, smaller(largest * largest, SPREAD))
    take_norms(sums, s, p, square)


@apart
def settle(cells, sums, first, last, s):
    """What depends on the units of omega, and on which lanes have ended, in a group."""
    goes_on = settle_units(sums, s)
    smallest, coupling, p, square = splat(np.inf), splat(0.0), splat(0.0), splat(0.0)
    for c in range(first, last, CELL):
        smallest, coupling, p, square = settle_component(
            cells, c, goes_on, smallest, coupling, p, square
        )
    settle_bounds(sums, s, smallest, coupling, p, square)


def look_through(cells, c, coupled, undefined):
    """Whether I is not 0, and whether some component is no number."""
    I, omega = rows_at(cells, c, I_, OMEGA)
    return larger(abs(I), coupled), undefined + 0.0 * omega


@staged
def start_block(bodies, omega, span, kept, block, is_first):
    """Returns whether some trajectories never move.

    is_first   Whether a body that serves all is not there yet.
    """
    chosen, cells, sums, some_rest = span.chosen, block.cells, block.sums, False
    for which, parameter in ((J_, bodies.J), (I_, bodies.I)):
        if is_first or parameter.shape[0] > 1:
            enter(parameter, chosen, block, which)
    if span.start == 0:
        enter(omega, chosen, block, OMEGA)
    else:
        gather(kept.state, chosen, block, OMEGA)
    for g in range(block.groups):
        first, last, s = g * block.m * CELL, (g + 1) * block.m * CELL, g * GROUP
        coupled, undefined = splat(0.0), splat(0.0)
        for c in range(first, last, CELL):
            coupled, undefined = look_through(cells, c, coupled, undefined)
        store_at(sums, s + RESTS, coupled)
        store_at(sums, s + UNIT, undefined)
        for l in range(s, s + VECTOR):
            position = block.begin + g * VECTOR + l - s
            b = trajectory(chosen, min(position, block.end - 1))
            # NaN is no state: such a trajectory ends before it begins.
            if span.start == 0 and position < block.end and np.isnan(sums[l + UNIT]):
                kept.status[b], kept.failed_at[b] = NONFINITE, 0
            eps = bodies.eps[b if bodies.eps.size > 1 else 0]
            rests = eps == 0.0 or sums[l + RESTS] == 0.0
            some_rest |= rests
            sums[l + GIVEN_EPS], sums[l + RESTS] = eps, 1.0 if rests else 0.0
            sums[l + ENDED] = 1.0 if position >= block.end or kept.failed_at[b] >= 0 else 0.0
            if span.start > 0:
                sums[l + OMEGA] = kept.exponent[b]
        settle(cells, sums, first, last, s)
    return some_rest


def find_half(sums, s):
    """eps p / 2"""
    eps, p = rows_at(sums, s, EPS, P)
    half = 0.5 * eps * p
    store_at(sums, s + HALF, half)
    return half


def row_of_matrix(cells, c, eps, half):
    """What row i of A is made of: its diagonal, two columns, and the right side."""
    J, I, omega = rows_at(cells, c, J_, I_, OMEGA)
    of_omega, of_I = column_of_omega(J, I, eps), column_of_coupling(J, omega, eps)
    return entry(1.0 - half / J, of_omega, of_I, I, omega), of_omega, of_I, omega


def entry_of_matrix(cells, c, of_omega, of_I):
    I, omega = rows_at(cells, c, I_, OMEGA)
    return entry(0.0, of_omega, of_I, I, omega)


@staged
def solve(cells, sums, first, m, s, matrix):
    """The next states of a group, as column m of the matrix."""
    half, eps = find_half(sums, s), vector_at(sums, s + EPS)
    for i in range(m):
        diagonal, of_omega, of_I, omega = row_of_matrix(cells, first + i * CELL, eps, half)
        for j in range(m):
            store(matrix, i, j, entry_of_matrix(cells, first + j * CELL, of_omega, of_I))
        store(matrix, i, i, diagonal)
        store(matrix, i, m, omega)
    eliminate(matrix, m)


def take_component(cells, c, omega, p, square):
    store_at(cells, c + OMEGA, omega)
    return p + vector_at(cells, c + I_) * omega, square + omega * omega


def take_norms(sums, s, p, square):
    """p and |omega|**2 of each lane; whether units serve."""
    store_at(sums, s + P, p)
    store_at(sums, s + SQUARE, square)
    return serving(sums, s)


def serving(sums, s):
    low, square, high = rows_at(sums, s, LOW, SQUARE, HIGH)
    return (square > low) & (square < high)


@staged
def step_by_elimination(cells, sums, first, m, s, matrix):
    """Returns whether units serve."""
    solve(cells, sums, first, m, s, matrix)
    p, square = splat(0.0), splat(0.0)
    for i in range(m):
        p, square = take_component(cells, first + i * CELL, load(matrix, i, m), p, square)
    return all_lanes(take_norms(sums, s, p, square))


def begin_sums(sums, s):
    """eps p / 2, and whether the step is small."""
    square, bound = rows_at(sums, s, SQUARE, SMALL_STEPS)
    return find_half(sums, s), square < bound


def sum_up(cells, c, half, alpha, beta, gamma, accurate):
    """The sums of the O(n) step, with 1/d as work."""
    J, I, omega = rows_at(cells, c, J_, I_, OMEGA)
    d = J - half
    r = 1.0 / d
    of_alpha, of_beta, of_gamma = summands(I, omega, r)
    store_at(cells, c + WORK, r)
    accurate = accurate & (abs(d) > FAR * J)
    return alpha + of_alpha, beta + of_beta, gamma + of_gamma, accurate


def keep_sums(sums, s, alpha, beta, gamma, accurate):
    least = select(accurate, FAR * FAR, np.inf)
    for row, value in ((ALPHA, alpha), (BETA, beta), (GAMMA, gamma), (LEAST, least)):
        store_at(sums, s + row, value)


def find_unknowns(sums, s):
    """The two unknowns of the O(n) step, after `keep_sums`; whether it is accurate."""
    eps, p, square, *of_components = rows_at(sums, s, EPS, P, SQUARE, ALPHA, BETA, GAMMA)
    of_omega, of_I, det, size = solve2(eps, p, square, *of_components)
    accurate = det > vector_at(sums, s + LEAST) * size
    store_at(sums, s + OF_OMEGA, of_omega)
    store_at(sums, s + OF_I, of_I)
    store_at(sums, s + ACCURATE, select(accurate, 1.0, 0.0))
    return accurate


def next_component(cells, c, of_omega, of_I):
    I, omega, r = rows_at(cells, c, I_, OMEGA, WORK)
    return omega + increment(I, omega, of_omega, of_I, r)


def step_component(cells, c, of_omega, of_I, p, square):
    return take_component(cells, c, next_component(cells, c, of_omega, of_I), p, square)


@staged
def step(cells, sums, first, last, s):
    """The O(n) step of a group whose unknowns are accurate; returns whether units serve."""
    of_omega, of_I = vector_at(sums, s + OF_OMEGA), vector_at(sums, s + OF_I)
    p, square = splat(0.0), splat(0.0)
    for c in range(first, last, CELL):
        p, square = step_component(cells, c, of_omega, of_I, p, square)
    return all_lanes(take_norms(sums, s, p, square))


def find_small(cells, c, half, number, k, smallest, second, J_k, I_k, omega_k):
    """The component of the smallest |d_i| / J_i so far, what it is, and the second smallest."""
    J, I, omega = rows_at(cells, c, J_, I_, OMEGA)
    ratio = abs(1.0 - half / J)
    found = ratio < smallest
    return (
        select(found, number, k),
        select(found, ratio, smallest),
        select(found, smallest, smaller(ratio, second)),
        select(found, J, J_k),
        select(found, I, I_k),
        select(found, omega, omega_k),
    )


def sum_others(cells, c, number, k, alpha, beta, gamma):
    """The sums without component k."""
    I, omega, r = rows_at(cells, c, I_, OMEGA, WORK)
    sums = zip((alpha, beta, gamma), summands(I, omega, r), strict=True)
    return tuple(select(number == k, total, total + each) for total, each in sums)


def find_three_unknowns(sums, s, k, second, J_k, I_k, omega_k, alpha, beta, gamma):
    """The increment of component k, whose d is small, as an unknown, in lanes that need it.

    Returns k in these lanes, and its increment; and whether some lanes are left, which are not
    ACCURATE.
    """
    eps, p, square, bound, accurate, ended, of_omega, of_I = rows_at(
        sums, s, EPS, P, SQUARE, SMALL_STEPS, ACCURATE, ENDED, OF_OMEGA, OF_I
    )
    equations = bordered(J_k, I_k, omega_k, eps, p, square, alpha, beta, gamma)
    I_delta, omega_delta, delta_k, pivot1, pivot2, pivot3 = solve3(*equations)
    serve = (square < bound) & (second > FAR_ENOUGH)
    serve = serve & (pivot2 > TOO_SMALL * pivot1) & (pivot3 > TOO_SMALL * larger(pivot1, pivot2))
    needed = (accurate == 0.0) & (ended == 0.0)
    taken, left = needed & serve, select(serve, 0.0, 1.0) * select(needed, 1.0, 0.0)
    of_three = weights(eps, p, square, I_delta, omega_delta)
    store_at(sums, s + OF_OMEGA, select(taken, of_three[0], of_omega))
    store_at(sums, s + OF_I, select(taken, of_three[1], of_I))
    store_at(sums, s + ACCURATE, 1.0 - left)
    return select(taken, k, -1.0), delta_k, any_lane(left > 0.0)


def find_next(cells, c, number, k, of_omega, of_I, delta_k):
    """The next component, as work."""
    omega = next_component(cells, c, of_omega, of_I)
    omega = select(number == k, vector_at(cells, c + OMEGA) + delta_k, omega)
    store_at(cells, c + WORK, omega)


def take_next(cells, c, p, square):
    return take_component(cells, c, vector_at(cells, c + WORK), p, square)


def replace_next(cells, c, sums, s, omega):
    """Take what elimination gives where the O(n) step is not accurate."""
    accurate, others = vector_at(sums, s + ACCURATE), vector_at(cells, c + WORK)
    store_at(cells, c + WORK, select(accurate == 0.0, omega, others))


@staged
def step_with_care(cells, sums, first, last, s, matrix):
    """The step of a group where some lane needs care, by elimination where that is not enough.

    Returns whether there is no room for that; then the lanes concerned are not ACCURATE.
    """
    half, zero, number = vector_at(sums, s + HALF), splat(0.0), 0.0
    k, smallest, second, J_k, I_k, omega_k = zero, splat(np.inf), splat(np.inf), zero, zero, zero
    for c in range(first, last, CELL):
        k, smallest, second, J_k, I_k, omega_k = find_small(
            cells, c, half, number, k, smallest, second, J_k, I_k, omega_k
        )
        number += 1.0
    alpha, beta, gamma, number = zero, zero, zero, 0.0
    for c in range(first, last, CELL):
        alpha, beta, gamma = sum_others(cells, c, number, k, alpha, beta, gamma)
        number += 1.0
    k, delta_k, some_left = find_three_unknowns(
        sums, s, k, second, J_k, I_k, omega_k, alpha, beta, gamma
    )
    of_omega, of_I, number = vector_at(sums, s + OF_OMEGA), vector_at(sums, s + OF_I), 0.0
    for c in range(first, last, CELL):
        find_next(cells, c, number, k, of_omega, of_I, delta_k)
        number += 1.0
    if matrix is not None:
        if some_left:
            m = (last - first) // CELL
            solve(cells, sums, first, m, s, matrix)
            for i in range(m):
                replace_next(cells, first + i * CELL, sums, s, load(matrix, i, m))
        some_left = False
    p, square = zero, zero
    for c in range(first, last, CELL):
        p, square = take_next(cells, c, p, square)
    take_norms(sums, s, p, square)
    return some_left


def end_inaccurate(sums, s):
    """End the lanes that are not ACCURATE."""
    accurate, ended = rows_at(sums, s, ACCURATE, ENDED)
    code = select(accurate == 0.0, float(NEEDS_ELIMINATION), 0.0)
    store_at(sums, s + CODE, code)
    store_at(sums, s + ENDED, select(accurate == 0.0, 1.0, ended))


@staged
def write_codes(sums, s, chosen, position, kept, n):
    """How trajectories have ended, from `position` on, of which state n does not exist."""
    for l in range(VECTOR):
        code = sums[s + CODE + l]
        if code != 0.0:
            b = trajectory(chosen, position + l)
            kept.status[b] = np.int8(code)
            kept.failed_at[b] = kept.failed_at[b] if code == NEEDS_ELIMINATION else n


@apart
def advance(block, n, stop):
    """Steps of a block by RANK2 to state stop, or to where something must be seen to.

    Returns the number of the state, whether units serve, and whether the step from there, of which
    unknowns are found, is accurate.
    """
    cells, sums, groups, size = block.cells, block.sums, block.groups, block.m * CELL
    serve, accurate = True, True
    while n < stop and serve and accurate:
        # Of all groups first, and little at a time: then what several groups wait for overlaps.
        for g in range(groups):
            alpha, beta, gamma = splat(0.0), splat(0.0), splat(0.0)
            half, far = begin_sums(sums, g * GROUP)
            for c in range(g * size, (g + 1) * size, CELL):
                alpha, beta, gamma, far = sum_up(cells, c, half, alpha, beta, gamma, far)
            keep_sums(sums, g * GROUP, alpha, beta, gamma, far)
        for g in range(groups):
            accurate &= all_lanes(find_unknowns(sums, g * GROUP))
        if accurate:
            for g in range(groups):
                serve &= step(cells, sums, g * size, (g + 1) * size, g * GROUP)
            n += 1
    return n, serve, accurate


@apart
def advance_by_elimination(block, n, stop, matrix):
    """The same by GAUSS; returns the number of the state, and whether units serve."""
    m, serve = block.m, True
    while n < stop and serve:
        for g in range(block.groups):
            serve &= step_by_elimination(
                block.cells, block.sums, g * m * CELL, m, g * GROUP, matrix
            )
        n += 1
    return n, serve


def is_accurate(sums, s):
    return vector_at(sums, s + ACCURATE) > 0.0


@staged
def advance_with_care(span, kept, block, n, matrix):
    """The step of a block where some lane needs care, after `find_unknowns`."""
    cells, sums, size = block.cells, block.sums, block.m * CELL
    for g in range(block.groups):
        first, last, s = g * size, (g + 1) * size, g * GROUP
        if all_lanes(is_accurate(sums, s)):
            step(cells, sums, first, last, s)
        elif step_with_care(cells, sums, first, last, s, matrix):
            # A call that has room for elimination takes them.
            end_inaccurate(sums, s)
            write_codes(sums, s, span.chosen, block.begin + g * VECTOR, kept, n)
            settle(cells, sums, first, last, s)


def units_serve(sums, s):
    return serving(sums, s)


def examine(cells, c, unit, infinite, undefined, largest):
    """Whether users see a number that is not finite, and whether it is NaN; and how large all are.

    Both are NaN where it is so.
    """
    omega = vector_at(cells, c + OMEGA)
    infinite = infinite + 0.0 * (omega * unit)
    undefined = undefined + select(omega == omega, 0.0, omega)
    return infinite, undefined, larger(abs(omega), largest)


def end_and_renew(sums, s, infinite, undefined, largest):
    """End the lanes whose state is not finite in the unit of the user; find new units.

    Returns the logarithms of those before over the new ones.
    """
    half, ended, before = rows_at(sums, s, HALF, ENDED, OMEGA)
    code = select(
        (undefined != undefined) & (half - half == 0.0), float(SINGULAR), float(NONFINITE)
    )
    ends = (infinite != infinite) & (ended == 0.0)
    ended = select(ends, 1.0, ended)
    store_at(sums, s + CODE, select(ends, code, 0.0))
    store_at(sums, s + ENDED, ended)
    kept = select(serving(sums, s), 1.0, ended) != 0.0
    after = select(kept, before, unit_of(largest, before))
    store_at(sums, s + OMEGA, after)
    return before - after


def take_unit(cells, c, k):
    store_at(cells, c + OMEGA, scaled(vector_at(cells, c + OMEGA), k))


@staged
def see_to_units(span, kept, block, n):
    """After the step to state n: end what is not finite, and find new units."""
    cells, sums, size = block.cells, block.sums, block.m * CELL
    for g in range(block.groups):
        first, last, s = g * size, (g + 1) * size, g * GROUP
        if not all_lanes(units_serve(sums, s)):
            infinite, undefined, largest = splat(0.0), splat(0.0), splat(0.0)
            unit = vector_at(sums, s + UNIT)
            for c in range(first, last, CELL):
                infinite, undefined, largest = examine(cells, c, unit, infinite, undefined, largest)
            k = end_and_renew(sums, s, infinite, undefined, largest)
            write_codes(sums, s, span.chosen, block.begin + g * VECTOR, kept, n)
            for c in range(first, last, CELL):
                take_unit(cells, c, k)
            settle(cells, sums, first, last, s)


def show_few(m, cells, c, unit, tile, place):
    """The states of a group of few components."""
    rows = rows_at(cells, c + OMEGA, *range(0, m * CELL, CELL))
    store_rows(tile, place, [omega * unit for omega in rows])


@apart
def show(block):
    """The states of a block in the unit of the user, in the tile; but see `show_given`."""
    cells, tile, m = block.cells, block.tile, block.m
    for g in range(block.groups):
        c, place, unit = g * m * CELL, g * VECTOR * m, vector_at(block.sums, g * GROUP + UNIT)
        for few in (1, 2, 3, 4):
            if m == few:
                show_few(few, cells, c, unit, tile, place)
        if m > 4:
            for i in range((m - 1) // VECTOR * VECTOR, -1, -VECTOR):
                row = c + i * CELL + OMEGA
                copy_transposed(tile, place + i, m, cells, row, CELL, unit)


@staged
def show_given(omega, chosen, block, n):
    """Where nothing has moved, users see what was given."""
    m, tile = block.m, block.tile
    for k in range(block.end - block.begin):
        l = k // VECTOR * GROUP + k % VECTOR
        if block.sums[l + ENDED] == 0.0 and (n == 0 or block.sums[l + RESTS] > 0.0):
            b = trajectory(chosen, block.begin + k)
            for i in range(m):
                tile[k * m + i] = omega[b, i]


@staged
def orient(bodies, span, kept, block, turning, n):
    """Turn the orientations to state n, which is shown."""
    begin, tile = block.begin, block.tile
    before, room = turning
    size = kept.columns.shape[1]
    m = size - 1
    gram, cleaned = room[:size], room[size : 2 * size]
    image, middle = room[2 * size], room[2 * size + 1][:m]
    for k in range(block.end - begin):
        b = trajectory(span.chosen, begin + k)
        if n > span.start:
            for i in range(m):
                middle[i] = mean(before[k, i], tile[k * m + i])
            step = bodies.time_step[b if bodies.time_step.size > 1 else 0]
            turn(kept.columns[b], middle, step, image)
            if n % CLEAN_EVERY == 0:
                clean_up(kept.columns[b], gram, cleaned)
        elif block.sums[k // VECTOR * GROUP + ENDED + k % VECTOR] > 0.0:
            kept.columns[b] = np.nan
        for i in range(m):
            before[k, i] = tile[k * m + i]


@staged
def save_turns(chosen, columns, begin, end, row):
    for position in range(begin, end):
        b = trajectory(chosen, position)
        for r in range(row.shape[1]):
            for c in range(row.shape[1]):
                row[b, r, c] = columns[b, c, r]


@staged
def leave_block(omega, span, kept, block):
    """Write what is left at state stop."""
    begin, end, m, sums, tile = block.begin, block.end, block.m, block.sums, block.tile
    show(block)
    show_given(omega, span.chosen, block, span.stop)
    write(tile, span.chosen, begin, end, m, kept.final.reshape(kept.final.size), 0)
    for g in range(block.groups):
        store_at(sums, g * GROUP + UNIT, splat(1.0))
    show(block)
    for k in range(end - begin):
        b, l = trajectory(span.chosen, begin + k), k // VECTOR * GROUP + k % VECTOR
        if kept.status[b] != NEEDS_ELIMINATION:
            kept.status[b] = kept.status[b] if sums[l + ENDED] > 0.0 else OK
            kept.exponent[b] = sums[l + OMEGA]
            for i in range(m):
                kept.state[b, i] = tile[k * m + i]


@staged
def run_block(
    method, bodies, omega, span, saved, kept, begin, end, is_first, scratch, matrix, turning
):
    """All steps of the trajectories at some positions."""
    cells, sums, tile = scratch
    m, groups = omega.shape[1], (end - begin + VECTOR - 1) // VECTOR
    block = Block(cells, sums, tile, m, begin, end, groups)
    chosen, flat = span.chosen, saved.omega.reshape(saved.omega.size)
    turns, next_saved = turning is not None, -1
    if saved.omega.shape[0] > 0:
        next_saved = 0 if span.start == 0 else (span.start // span.every + 1) * span.every
    row = 0 if span.start == 0 else span.start // span.every + 1 - span.first_row
    some_rest = start_block(bodies, omega, span, kept, block, is_first)
    n, goes_on = span.start, True
    while goes_on:
        if turns or n == next_saved:
            show(block)
            if n == 0 or some_rest:
                show_given(omega, chosen, block, n)
            if turns:
                orient(bodies, span, kept, block, turning, n)
        if n == next_saved:
            write(tile, chosen, begin, end, m, flat, row * omega.size)
            if turns:
                save_turns(chosen, kept.columns, begin, end, saved.turns[row])
            next_saved += span.every
            row += 1
        goes_on = n < span.stop
        if goes_on:
            until, serve = n + 1 if turns else span.stop, True
            if next_saved > n:
                until = min(until, next_saved)
            if matrix is not None and method == GAUSS:
                n, serve = advance_by_elimination(block, n, until, matrix)
            else:
                n, serve, accurate = advance(block, n, until)
                if not accurate:
                    n, serve = n + 1, False
                    advance_with_care(span, kept, block, n, matrix)
            if not serve:
                see_to_units(span, kept, block, n)
    leave_block(omega, span, kept, block)


@staged
def blocks_of(span, m, rooms):
    """The trajectories of a block, how many blocks there are, and how many tasks.

    What each task has is cut into as many blocks: one with more of them would be waited for.
    """
    asked = Span(*span)
    count, most = asked.end - asked.begin, block_size(m)
    least = min(most, SHARED)
    tasks = max(min((count + least - 1) // least, rooms), 1)
    groups = (count + VECTOR - 1) // VECTOR
    share = (groups + tasks - 1) // tasks
    cuts = max((share * VECTOR + most - 1) // most, 1)
    size = max((share + cuts - 1) // cuts, 1) * VECTOR
    blocks = (count + size - 1) // size
    return size, blocks, min(blocks, tasks)


@staged
def run_blocks(task, method, bodies, omega, span, saved, kept, scratch, matrices, turning):
    """What one task of `iterate` does."""
    cells, sums, tile = scratch
    size, blocks, tasks = blocks_of(span, omega.shape[1], cells.shape[0])
    asked, first_block = Span(*span), task * blocks // tasks
    for block in range(first_block, (task + 1) * blocks // tasks):
        begin = asked.begin + block * size
        run_block(
            method,
            Bodies(*bodies),
            omega,
            asked,
            Saved(*saved),
            Kept(*kept),
            begin,
            min(begin + size, asked.end),
            block == first_block,
            (cells[task], sums[task], tile[task]),
            None if matrices is None else of_vectors(matrices[task]),
            None if turning is None else Turning(turning[0][task], turning[1][task]),
        )
    fence()


def _iterate(method, bodies, omega, span, saved, kept, scratch, matrices, turning):
    """Iterate from the states `omega`, (B, m), at step 0, or from what is kept of state start.

    What has names here comes in plain tuples: Numba looks through named ones in Python, at every
    call. Room is an array each, of which the first axis is that of tasks: each has several blocks.

    scratch    for all: cells, (tasks, room for a block, and VECTOR components more); sums, (tasks,
               room for a block); tile, (tasks, room for a block, and a vector more).
    matrices   (tasks, rows, columns, VECTOR), see `elimination`; None if there is no room for it.
    turning    arrays as of a Turning; None if no orientations are wanted.

    What is None is not compiled: most calls want neither.
    """
    _, _, tasks = blocks_of(span, omega.shape[1], scratch[0].shape[0])
    for task in prange(tasks):
        run_blocks(task, method, bodies, omega, span, saved, kept, scratch, matrices, turning)


iterate = Loop(_iterate)
