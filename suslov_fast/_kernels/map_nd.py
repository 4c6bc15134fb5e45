"""Iteration of the n-dimensional map.

A block of trajectories advances together: lanes are trajectories, and components are rows of lanes.
A step in O(n) solves for the increment by `solve2`; lanes where that is not accurate take
`solve_bordered` or elimination. The arithmetic of a lane never depends on the other lanes.

Lanes hold omega in a unit, a power of two, in which it is of the order of 1; they get a new unit
when omega has left that range. Lanes that have ended rest at 0 in a unit that is NaN.
"""

import numpy as np
from numba import prange

from .._formulas.elementary import exponent, larger, scaled, smaller, two_to_the
from .._formulas.nd_map import FAR, FAR_ENOUGH, bounds, matrix_row, solve2, solve_bordered
from .._formulas.rotation import mean
from .._jit import carray, formula, inner, kernel, select, stack
from .codes import NEEDS_ELIMINATION, NONFINITE, OK, SINGULAR
from .elimination import WIDTH, eliminate
from .turning_nd import CLEAN_EVERY, clean_up, turn

# Trajectories of a block: enough for sums over components not to wait for the memory they were
# just written to.
LANES = 64
FIELDS = 19  # numbers of a lane
ROOM = FIELDS * LANES


# A block consists of cells (4, m, lanes), rows of components, and lane (FIELDS, LANES), rows of
# numbers. WORK holds 1/d, and the next omega where ACCURATE is not 1.
J_, I_, OMEGA, WORK = range(4)
(
    EPS_INPUT,
    EPS,  # in the unit of omega; 0 where nothing moves
    EXPONENT,  # of the unit of omega
    UNIT,
    LOW,  # bounds of |omega|**2, see `bounds`
    HIGH,
    LONGEST,
    RESTS,  # 1 where eps or I is 0, else 0
    STATUS,  # of trajectories that have ended, else OK
    P,
    SQUARE,
    HALF,  # eps p / 2
    ALPHA,  # sums, see `solve2`
    BETA,
    GAMMA,
    NEAREST,  # the least |d_i| - FAR J_i
    OF_OMEGA,  # factors in delta, see `solve2`
    OF_I,
    ACCURATE,  # 1 where the step by `solve2` is accurate
) = range(19)
FIELDS = 19
ROOM = FIELDS * LANES


@formula
def units_serve(cells, lane):
    """Return whether the units of all lanes serve."""
    left = 0.0
    for l in range(cells.shape[2]):
        square = lane[SQUARE, l]
        serves = (square > lane[LOW, l]) & (square < lane[HIGH, l])
        left += select(serves, 0.0, 1.0)
    return left == 0.0


@inner
def solve_lanes(cells, lane, first, matrix):
    """Solve A(omega) omega_next = omega in some lanes from `first` on, as column m of `matrix`."""
    _, m, lanes = cells.shape
    width = min(WIDTH, lanes - first)
    for i in range(m):
        for l in range(width):
            b = first + l
            c, g = matrix_row(cells[J_, i, b], cells[I_, i, b], cells[OMEGA, i, b], lane[EPS, b])
            for j in range(m):
                matrix[i, j, l] = -c * cells[OMEGA, j, b] - g * cells[I_, j, b]
            matrix[i, i, l] = (1.0 - lane[HALF, b] / cells[J_, i, b]) + matrix[i, i, l]
            matrix[i, m, l] = cells[OMEGA, i, b]
    eliminate(matrix, width)


@formula
def step_gauss(cells, lane, matrix):
    """Take a step by elimination."""
    _, m, lanes = cells.shape
    for l in range(lanes):
        lane[HALF, l] = 0.5 * lane[EPS, l] * lane[P, l]
    for first in range(0, lanes, WIDTH):
        solve_lanes(cells, lane, first, matrix)
        for i in range(m):
            for l in range(first, min(first + WIDTH, lanes)):
                cells[OMEGA, i, l] = matrix[i, m, l - first]
    for l in range(lanes):
        lane[P, l], lane[SQUARE, l] = 0.0, 0.0
    for i in range(m):
        for l in range(lanes):
            omega = cells[OMEGA, i, l]
            lane[P, l] += cells[I_, i, l] * omega
            lane[SQUARE, l] += omega * omega


@inner
def step_bordered(cells, lane, l):
    """Put the next state of a lane into `work`, the increment of one component as an unknown.

    Returns whether that is accurate.
    """
    m = cells.shape[1]
    eps, half, p, square = lane[EPS, l], lane[HALF, l], lane[P, l], lane[SQUARE, l]
    k, smallest, second = 0, np.inf, np.inf
    for i in range(m):
        ratio = abs(1.0 - half / cells[J_, i, l])
        if ratio < smallest:
            k, smallest, second = i, ratio, smallest
        else:
            second = min(second, ratio)
    alpha, beta, gamma = 0.0, 0.0, 0.0
    for i in range(m):
        if i != k:
            I, omega, r = cells[I_, i, l], cells[OMEGA, i, l], cells[WORK, i, l]
            alpha += I * r * omega
            beta += I * r * I
            gamma += omega * r * omega
    of_omega, of_I, delta_k, regular = solve_bordered(
        cells[J_, k, l], cells[I_, k, l], cells[OMEGA, k, l], eps, p, square, alpha, beta, gamma
    )
    if not (regular and second > FAR_ENOUGH and square < lane[LONGEST, l]):
        return False
    for i in range(m):
        I, omega, r = cells[I_, i, l], cells[OMEGA, i, l], cells[WORK, i, l]
        cells[WORK, i, l] = omega + (of_omega * omega - of_I * I) * r
    cells[WORK, k, l] = cells[OMEGA, k, l] + delta_k
    return True


@inner
def step_with_care(cells, lane, matrix):
    """Take the step in lanes where that by `solve2` is not accurate; let its increment be 0."""
    _, m, lanes = cells.shape
    for first in range(0, lanes, WIDTH):
        last, left = min(first + WIDTH, lanes), False
        for l in range(first, last):
            if lane[ACCURATE, l] == 0.0 and not step_bordered(cells, lane, l):
                lane[ACCURATE, l], left = -1.0, True
        if left and matrix.size > 0:
            solve_lanes(cells, lane, first, matrix)
        for l in range(first, last):
            if lane[ACCURATE, l] < 0.0 and matrix.size == 0:
                lane[STATUS, l], lane[HALF, l] = NEEDS_ELIMINATION, np.inf
            if lane[ACCURATE, l] < 1.0:
                for i in range(m):
                    omega = cells[WORK, i, l]
                    if lane[ACCURATE, l] < 0.0 and matrix.size > 0:
                        omega = matrix[i, m, l - first]
                    if abs(omega) == np.inf:  # which an increment of 0 makes NaN
                        lane[HALF, l] = np.inf
                    cells[OMEGA, i, l], cells[WORK, i, l] = omega, 0.0
                lane[OF_OMEGA, l], lane[OF_I, l] = 0.0, 0.0


@formula
def step_rank2(cells, lane, matrix):
    """Take a step in O(n)."""
    _, m, lanes = cells.shape
    for l in range(lanes):
        lane[HALF, l] = 0.5 * lane[EPS, l] * lane[P, l]
        lane[ALPHA, l], lane[BETA, l], lane[GAMMA, l] = 0.0, 0.0, 0.0
        lane[NEAREST, l] = np.inf
    for i in range(m):
        for l in range(lanes):
            J, I, omega = cells[J_, i, l], cells[I_, i, l], cells[OMEGA, i, l]
            d = J - lane[HALF, l]
            r = 1.0 / d
            I_r = I * r
            cells[WORK, i, l] = r
            lane[ALPHA, l] += I_r * omega
            lane[BETA, l] += I_r * I
            lane[GAMMA, l] += omega * r * omega
            lane[NEAREST, l] = smaller(abs(d) - FAR * J, lane[NEAREST, l])
    left = 0.0
    for l in range(lanes):
        p, square = lane[P, l], lane[SQUARE, l]
        of_omega, of_I, det, size = solve2(
            lane[EPS, l], p, square, lane[ALPHA, l], lane[BETA, l], lane[GAMMA, l]
        )
        far = (lane[NEAREST, l] > 0.0) & (square < lane[LONGEST, l])
        accurate = select(far & (det > FAR * FAR * size), 1.0, 0.0)
        left += 1.0 - accurate
        lane[OF_OMEGA, l], lane[OF_I, l], lane[ACCURATE, l] = of_omega, of_I, accurate
    if left > 0.0:
        step_with_care(cells, lane, matrix)
    for l in range(lanes):
        lane[P, l], lane[SQUARE, l] = 0.0, 0.0
    for i in range(m):
        for l in range(lanes):
            I, omega = cells[I_, i, l], cells[OMEGA, i, l]
            omega += (lane[OF_OMEGA, l] * omega - lane[OF_I, l] * I) * cells[WORK, i, l]
            cells[OMEGA, i, l] = omega
            lane[P, l] += I * omega
            lane[SQUARE, l] += omega * omega


@formula
def unit_of(largest, before):
    """Return the exponent of the unit for numbers up to this one in a unit of 2**before."""
    size = select((largest > 0.0) & (largest < np.inf), exponent(largest) + 1.0, 0.0)
    return larger(smaller(size + before, 1023.0), -1022.0)


@inner
def take_unit(cells, lane, l, size):
    """Go over to the unit 2**size in a lane, or to rest where the trajectory has ended."""
    change, ended = lane[EXPONENT, l] - size, lane[STATUS, l] != OK
    smallest, I_square, p, square = np.inf, 0.0, 0.0, 0.0
    for i in range(cells.shape[1]):
        I = cells[I_, i, l]
        omega = 0.0 if ended else scaled(cells[OMEGA, i, l], change)
        cells[OMEGA, i, l] = omega
        smallest = min(cells[J_, i, l], smallest)
        I_square += I * I
        p += I * omega
        square += omega * omega
    rests = ended or lane[RESTS, l] > 0.0
    lane[EXPONENT, l] = size
    lane[EPS, l] = 0.0 if rests else scaled(lane[EPS_INPUT, l], size)
    lane[UNIT, l] = np.nan if ended else two_to_the(size)
    lane[P, l], lane[SQUARE, l] = p, square
    lane[LONGEST, l], lane[LOW, l], lane[HIGH, l] = bounds(
        smallest, I_square, lane[EPS, l], square, two_to_the(size)
    )


@inner
def renew_units(cells, lane):
    """End the lanes whose states are not finite; find new units for those that need them.

    Returns whether a lane has ended.
    """
    _, m, lanes = cells.shape
    ended = False
    for l in range(lanes):
        if not (lane[LOW, l] < lane[SQUARE, l] < lane[HIGH, l]):
            largest, undefined, infinite = 0.0, False, False
            for i in range(m):
                omega = abs(cells[OMEGA, i, l])
                undefined |= omega != omega
                infinite |= omega * lane[UNIT, l] == np.inf
                largest = larger(omega, largest)
            if (undefined or infinite) and lane[STATUS, l] == OK:
                regular = undefined and lane[HALF, l] - lane[HALF, l] == 0.0
                lane[STATUS, l] = SINGULAR if regular else NONFINITE
            ended |= lane[STATUS, l] != OK
            take_unit(cells, lane, l, unit_of(largest, lane[EXPONENT, l]))
    return ended


@inner
def enter(cells, lane, parameters, omega, span, kept):
    """Take trajectories up at state start; lanes beyond the last repeat it."""
    (J, I, eps), (begin, end, start) = parameters, span
    _, status, failed_at, state, exponents = kept
    _, m, lanes = cells.shape
    for l in range(lanes):
        b = min(begin + l, end - 1)
        body, largest, coupled = b if J.shape[0] > 1 else 0, 0.0, 0.0
        of_I, undefined = b if I.shape[0] > 1 else 0, False
        for i in range(m):
            cells[J_, i, l], cells[I_, i, l] = J[body, i], I[of_I, i]
            cells[OMEGA, i, l] = omega[b, i] if start == 0 else state[b, i]
            largest = larger(abs(cells[OMEGA, i, l]), largest)
            undefined |= cells[OMEGA, i, l] != cells[OMEGA, i, l]
            coupled = larger(abs(cells[I_, i, l]), coupled)
        lane[EPS_INPUT, l] = eps[b if eps.size > 1 else 0]
        lane[RESTS, l] = 1.0 if lane[EPS_INPUT, l] == 0.0 or coupled == 0.0 else 0.0
        if start == 0:
            # NaN is no state: such a trajectory ends before it begins.
            lane[STATUS, l] = NONFINITE if undefined else OK
            if begin + l < end:
                status[b], failed_at[b] = lane[STATUS, l], 0 if undefined else -1
            lane[EXPONENT, l] = 0.0
            take_unit(cells, lane, l, unit_of(largest, 0.0))
        else:
            lane[STATUS, l] = status[b] if failed_at[b] >= 0 else OK
            lane[EXPONENT, l] = exponents[b]
            take_unit(cells, lane, l, exponents[b])


@inner
def write(cells, lane, omega, begin, end, n, target):
    """Write the states n of a block; those that never move, and the first, as they were given."""
    m = cells.shape[1]
    for l in range(end - begin):
        if (n == 0 or lane[RESTS, l] > 0.0) and lane[STATUS, l] == OK:
            for i in range(m):
                target[begin + l, i] = omega[begin + l, i]
        else:
            for i in range(m):
                target[begin + l, i] = cells[OMEGA, i, l] * lane[UNIT, l]


@inner
def orient(cells, lane, turning, task, begin, end, n, start):
    """Turn the orientations to state n, before which `before` holds the states."""
    time_step, columns, _, before, room = turning
    m, size = cells.shape[1], columns.shape[1]
    for l in range(end - begin):
        b = begin + l
        if n > start:
            middle = room[task, 2 * size + 1]
            for i in range(m):
                omega = cells[OMEGA, i, l] * lane[UNIT, l]
                middle[i] = mean(before[task, i, l], omega)
            eps = time_step[b if time_step.size > 1 else 0]
            turn(columns[b], middle[:m], eps, room[task, 2 * size])
            if n % CLEAN_EVERY == 0:
                clean_up(columns[b], room[task, :size], room[task, size : 2 * size])
        elif lane[STATUS, l] != OK:
            for r in range(size):
                for c in range(size):
                    columns[b, r, c] = np.nan
        for i in range(m):
            before[task, i, l] = cells[OMEGA, i, l] * lane[UNIT, l]


@inner
def leave(cells, lane, omega, begin, end, stop, kept):
    """Write the last states, in the unit of the user and in those of the lanes."""
    final, status, _, state, exponents = kept
    write(cells, lane, omega, begin, end, stop, final)
    for l in range(end - begin):
        b = begin + l
        status[b] = lane[STATUS, l]
        exponents[b] = lane[EXPONENT, l]
        for i in range(omega.shape[1]):
            state[b, i] = cells[OMEGA, i, l]


@inner
def save(cells, lane, omega, begin, end, n, saved, turning, row):
    """Write the states n of a block, and the orientations, to a row."""
    write(cells, lane, omega, begin, end, n, saved[row])
    if turning is not None:
        _, columns, turns, _, _ = turning
        for b in range(begin, end):
            for r in range(columns.shape[1]):
                for c in range(columns.shape[1]):
                    turns[row, b, r, c] = columns[b, c, r]


@inner
def see_to_units(cells, lane, begin, end, n, failed_at):
    """Find new units after the step to state n, and note which lanes have ended."""
    if renew_units(cells, lane):
        for l in range(end - begin):
            if lane[STATUS, l] != OK and failed_at[begin + l] < 0:
                failed_at[begin + l] = n


@inner
def iterate_blocks(gauss, parameters, omega, span, saved, turning, kept, room, task):
    """Take all steps of the blocks of a task."""
    (first, last, start, stop, every, first_row), (tasks, _, _, lanes) = span, room[0].shape
    cells, matrix = room[0][task], room[1][task]
    lane = carray(stack(ROOM), (FIELDS, LANES))
    blocks = (last - first + lanes - 1) // lanes
    for k in range(task * blocks // tasks, (task + 1) * blocks // tasks):
        begin = first + k * lanes
        end = min(begin + lanes, last)
        enter(cells, lane, parameters, omega, (begin, end, start), kept)
        n, row, next_saved = start, 0, stop + 1
        if saved.shape[0] > 0 and start == 0:
            next_saved = 0
        elif saved.shape[0] > 0:
            row = start // every + 1 - first_row
            next_saved = (start // every + 1) * every
        while True:
            if turning is not None:
                orient(cells, lane, turning, task, begin, end, n, start)
            if n == next_saved:
                save(cells, lane, omega, begin, end, n, saved, turning, row)
                row, next_saved = row + 1, next_saved + every
            if n == stop:
                break
            until = min(next_saved, stop) if turning is None else n + 1
            while n < until:
                if gauss:
                    step_gauss(cells, lane, matrix)
                else:
                    step_rank2(cells, lane, matrix)
                n += 1
                if not units_serve(cells, lane):
                    see_to_units(cells, lane, begin, end, n, kept[2])
        leave(cells, lane, omega, begin, end, stop, kept)


@kernel
def iterate(gauss, parameters, omega, span, saved, turning, kept, room):
    """Iterate states omega (B, m), by elimination alone or in O(n) steps.

    parameters : J, I (B, m) or (1, m); eps (B,) or (1,)
    span : begin and end of the trajectories; start, stop; every, first_row of the saved states
    saved : (rows, B, m)
    turning : None, or the step size in the unit of time of omega (B,) or (1,); the transposed
        orientations (B, n, n), updated; turns (rows, B, n, n); room (tasks, m, lanes) and
        (tasks, 2 n + 2, n)
    kept : final (B, m); status, failed_at (B,); the states in units of 2**exponent (B, m), and
        exponent (B,). Those but `final` are read where start is not 0.
    room : (tasks, 4, m, lanes), and (tasks, m, m + 1, WIDTH) for elimination, or m = 0 in its place
    """
    for task in prange(room[0].shape[0]):
        iterate_blocks(gauss, parameters, omega, span, saved, turning, kept, room, task)
