"""Iteration of the n-dimensional map.

A block of trajectories advances together: lanes are trajectories, and components are rows of lanes.
A step in O(n) solves for the increment by `solve2`; lanes where this is inaccurate use
`solve_bordered` or, in `iterate_with_elimination`, elimination. The arithmetic of a lane never
depends on the other lanes.

Lanes store omega in a unit, a power of two, in which it is of the order of 1; the unit changes when
omega leaves that range. Lanes that have ended have the state 0 in the unit NaN.
"""

import numpy as np

from .._formulas.elementary import exponent, larger, scaled, smaller, two_to_the
from .._formulas.nd_map import FAR, FAR_ENOUGH, bounds, matrix_row, solve2, solve_bordered
from .._formulas.rotation import mean
from .._jit import (
    LINE,
    Kernel,
    carray,
    copy_line,
    formula,
    inner,
    select,
    share,
    stack,
    subtract_product,
)
from .codes import NEEDS_ELIMINATION, NONFINITE, OK, SINGULAR
from .elimination import WIDTH, eliminate
from .turning_nd import CLEAN_EVERY, clean_up, turn

# Trajectories of a block: enough to prevent sums over components from stalling on memory just
# written.
LANES = 64

# A block consists of J and I, (M,) if common to all lanes, else (M, lanes); of omega and work,
# (M, lanes), where work holds 1/d; and of numbers of each lane, in rows:
(
    EPS_INPUT,
    EPS,  # in the unit of omega; 0 for fixed states
    EXPONENT,  # of the unit of omega
    UNIT,
    LOW,  # bounds of |omega|**2, see `bounds`
    HIGH,
    LONGEST,
    NEAR,  # (1 - FAR) times the least J: d is far from 0 where eps p / 2 is below this
    RESTS,  # 1 if eps or I is 0, else 0
    STATUS,  # status of trajectories that have ended, else OK
    P,
    SQUARE,
    HALF,  # eps p / 2
    ALPHA,  # sums, see `solve2`
    BETA,
    GAMMA,
    OF_OMEGA,  # factors in delta, see `solve2`
    OF_I,
    ACCURATE,  # 1 if the step by `solve2` is accurate, 0.5 if this depends on d, else 0
    CHOSEN,  # the indices of lanes that need elimination
) = range(20)
FIELDS = 20
# Rows of `of` in `solve_lanes`: eps, eps p / 2, and, of a row of A, the factors c and g, the
# diagonal entry of d, and the entry being computed.
STEP, HALF_STEP, C, G, DIAGONAL, ENTRY = range(6)
ROOM, ROOM_OF_ROW = FIELDS * LANES, 6 * WIDTH
# Components i and M/2 + i are added up in pairs, which halves the stores. If m is odd, M = m + 1,
# and the last component has J = infinity, I = omega = 0. (LLVM tests once for all i for
# overlap of written rows with others: the pairs must lie in two halves, not side by side.)


@formula
def at(values, i, l):
    """Return an entry of J or I."""
    return values[i] if values.ndim == 1 else values[i, l]


@formula
def put(values, i, l, number):
    """Set an entry of J or I."""
    if values.ndim == 1:
        values[i] = number
    else:
        values[i, l] = number


@formula
def add_pair(lane, l, I_i, I_j, w_i, w_j):
    """Add the terms of two components to p and |omega|**2."""
    lane[P, l] = lane[P, l] + I_i * w_i + I_j * w_j
    lane[SQUARE, l] = lane[SQUARE, l] + w_i * w_i + w_j * w_j


@formula
def units_serve(lane, lanes):
    """Return True if the units of all lanes remain valid."""
    left = 0.0
    for l in range(lanes):
        square = lane[SQUARE, l]
        left += select((square > lane[LOW, l]) & (square < lane[HIGH, l]), 0.0, 1.0)
    return left == 0.0


@inner
def solve_lanes(J, I, omega, lane, chosen, room):
    """Replace omega by the solution of A(omega) omega_next = omega in lanes lane[CHOSEN, :chosen].

    room (m + 3, m + 1, WIDTH) holds A, with omega as column m, and from row m on J, I, omega.
    """
    m = room.shape[1] - 1
    matrix, all_J, all_I, w = room[:m], room[m], room[m + 1], room[m + 2]
    of = carray(stack(ROOM_OF_ROW), (6, WIDTH))
    for first in range(0, chosen, WIDTH):
        last = min(first + WIDTH, chosen) - 1  # repeated in the lanes beyond it
        for k in range(WIDTH):
            l = int(lane[CHOSEN, min(first + k, last)])
            of[STEP, k], of[HALF_STEP, k] = lane[EPS, l], lane[HALF, l]
        for i in range(m):
            for k in range(WIDTH):
                l = int(lane[CHOSEN, min(first + k, last)])
                all_J[i, k], all_I[i, k], w[i, k] = at(J, i, l), at(I, i, l), omega[i, l]
        for i in range(m):
            for k in range(WIDTH):
                c, g = matrix_row(all_J[i, k], all_I[i, k], w[i, k], of[STEP, k])
                of[C, k], of[G, k] = c, g
                of[DIAGONAL, k] = 1.0 - of[HALF_STEP, k] / all_J[i, k]
                matrix[i, m, k] = w[i, k]
            for j in range(m):
                for k in range(WIDTH):
                    of[ENTRY, k] = 0.0
                for k in range(0, WIDTH, LINE):
                    subtract_product(of, (ENTRY, k), of, (C, k), w, (j, k))
                    subtract_product(of, (ENTRY, k), of, (G, k), all_I, (j, k))
                    copy_line(matrix, (i, j, k), of, (ENTRY, k))
            for k in range(WIDTH):
                matrix[i, i, k] = of[DIAGONAL, k] + matrix[i, i, k]
        eliminate(matrix)
        for i in range(m):
            for k in range(last + 1 - first):
                omega[i, int(lane[CHOSEN, first + k])] = matrix[i, m, k]


@inner
def leave_out(J, I, omega, lane, chosen, room):
    """End trajectories that need elimination; another kernel restarts them."""
    for k in range(chosen):
        l = int(lane[CHOSEN, k])
        lane[STATUS, l], omega[0, l] = NEEDS_ELIMINATION, np.nan


@formula
def step_gauss(J, I, omega, work, lane, count, room):
    """Take a step by elimination in lanes up to `count`."""
    for l in range(count):
        lane[HALF, l] = 0.5 * lane[EPS, l] * lane[P, l]
        lane[CHOSEN, l] = l
    solve_lanes(J, I, omega, lane, count, room)
    for l in range(count):
        lane[P, l], lane[SQUARE, l] = 0.0, 0.0
    half = omega.shape[0] // 2
    for i in range(half):
        j = half + i
        for l in range(count):
            add_pair(lane, l, at(I, i, l), at(I, j, l), omega[i, l], omega[j, l])


@inner
def step_bordered(J, I, omega, work, lane, l):
    """Take the step in a lane by the bordered system; return True if it is accurate.

    If no d is small, the step by `solve2` remains.
    """
    eps, half, p, square = lane[EPS, l], lane[HALF, l], lane[P, l], lane[SQUARE, l]
    k, smallest, second = 0, np.inf, np.inf
    for i in range(omega.shape[0]):
        ratio = abs(1.0 - half / at(J, i, l))
        if ratio < smallest:
            k, smallest, second = i, ratio, smallest
        else:
            second = min(second, ratio)
    if lane[ACCURATE, l] > 0.0 and smallest > FAR:
        lane[ACCURATE, l] = 1.0
        return True
    lane[ACCURATE, l] = 0.0
    alpha, beta, gamma = 0.0, 0.0, 0.0
    for i in range(omega.shape[0]):
        if i != k:
            I_i, w, r = at(I, i, l), omega[i, l], work[i, l]
            alpha += I_i * r * w
            beta += I_i * r * I_i
            gamma += w * r * w
    of_omega, of_I, delta_k, regular = solve_bordered(
        at(J, k, l), at(I, k, l), omega[k, l], eps, p, square, alpha, beta, gamma
    )
    if not (regular and second > FAR_ENOUGH and square < lane[LONGEST, l]):
        return False
    for i in range(omega.shape[0]):
        if i != k:
            omega[i, l] += (of_omega * omega[i, l] - of_I * at(I, i, l)) * work[i, l]
    omega[k, l] += delta_k
    return True


@formula
def find_increment(J, I, omega, work, lane):
    """Find the increment of a step in O(n); return 0 if it is accurate in all lanes."""
    half, lanes = omega.shape[0] // 2, omega.shape[1]
    for l in range(lanes):
        lane[HALF, l] = 0.5 * lane[EPS, l] * lane[P, l]
        lane[ALPHA, l], lane[BETA, l], lane[GAMMA, l] = 0.0, 0.0, 0.0
    for i in range(half):
        j = half + i
        for l in range(lanes):
            I_i, I_j, w_i, w_j = at(I, i, l), at(I, j, l), omega[i, l], omega[j, l]
            r_i, r_j = 1.0 / (at(J, i, l) - lane[HALF, l]), 1.0 / (at(J, j, l) - lane[HALF, l])
            work[i, l], work[j, l] = r_i, r_j
            lane[ALPHA, l] = lane[ALPHA, l] + I_i * r_i * w_i + I_j * r_j * w_j
            lane[BETA, l] = lane[BETA, l] + I_i * r_i * I_i + I_j * r_j * I_j
            lane[GAMMA, l] = lane[GAMMA, l] + w_i * r_i * w_i + w_j * r_j * w_j
    left = 0.0
    for l in range(lanes):
        square = lane[SQUARE, l]
        of_omega, of_I, det, size = solve2(
            lane[EPS, l], lane[P, l], square, lane[ALPHA, l], lane[BETA, l], lane[GAMMA, l]
        )
        accurate = (det > FAR * FAR * size) & (square < lane[LONGEST, l])
        far = select(lane[HALF, l] < lane[NEAR, l], 1.0, 0.5)
        accuracy = select(accurate, far, 0.0)
        left += select(accuracy == 1.0, 0.0, 1.0)
        lane[OF_OMEGA, l], lane[OF_I, l], lane[ACCURATE, l] = of_omega, of_I, accuracy
    return left


@formula
def add_increment(I, omega, work, lane):
    """Add the increment of a step in O(n)."""
    half, lanes = omega.shape[0] // 2, omega.shape[1]
    for l in range(lanes):
        lane[P, l], lane[SQUARE, l] = 0.0, 0.0
    for i in range(half):
        j = half + i
        for l in range(lanes):
            of_omega, of_I, w_i, w_j = lane[OF_OMEGA, l], lane[OF_I, l], omega[i, l], omega[j, l]
            I_i, I_j = at(I, i, l), at(I, j, l)
            w_i += (of_omega * w_i - of_I * I_i) * work[i, l]
            w_j += (of_omega * w_j - of_I * I_j) * work[j, l]
            omega[i, l], omega[j, l] = w_i, w_j
            add_pair(lane, l, I_i, I_j, w_i, w_j)


def rank2_step(solve):
    """Build the step in O(n); `solve` handles the lanes that need elimination."""

    @inner
    def step_with_care(J, I, omega, work, lane, room):
        """Take the step in lanes where `solve2` is inaccurate; set its increment to 0."""
        left = 0
        for l in range(omega.shape[1]):
            if lane[ACCURATE, l] < 1.0 and not step_bordered(J, I, omega, work, lane, l):
                lane[CHOSEN, left] = l
                left += 1
        solve(J, I, omega, lane, left, room)
        for l in range(omega.shape[1]):
            if lane[ACCURATE, l] < 1.0:
                lane[OF_OMEGA, l], lane[OF_I, l] = 0.0, 0.0
                for i in range(omega.shape[0]):
                    work[i, l] = 0.0

    @formula
    def step(J, I, omega, work, lane, count, room):
        if find_increment(J, I, omega, work, lane) > 0.0:
            step_with_care(J, I, omega, work, lane, room)
        add_increment(I, omega, work, lane)

    return step


@formula
def unit_of(largest, before):
    """Return the exponent of the unit for numbers up to `largest`, in the unit 2**before."""
    size = select((largest > 0.0) & (largest < np.inf), exponent(largest) + 1.0, 0.0)
    return larger(smaller(size + before, 1023.0), -1022.0)


@inner
def take_unit(J, I, omega, lane, l, size):
    """Change to the unit 2**size in a lane, or to the state 0 if the trajectory has ended."""
    change, ended = lane[EXPONENT, l] - size, lane[STATUS, l] != OK
    smallest, I_square = np.inf, 0.0
    for i in range(omega.shape[0]):
        omega[i, l] = 0.0 if ended else scaled(omega[i, l], change)
        smallest = min(at(J, i, l), smallest)
        I_square += at(I, i, l) * at(I, i, l)
    lane[P, l], lane[SQUARE, l], half = 0.0, 0.0, omega.shape[0] // 2
    for i in range(half):
        j = half + i
        add_pair(lane, l, at(I, i, l), at(I, j, l), omega[i, l], omega[j, l])
    rests = ended or lane[RESTS, l] > 0.0
    lane[EXPONENT, l] = size
    lane[EPS, l] = 0.0 if rests else scaled(lane[EPS_INPUT, l], size)
    lane[UNIT, l] = np.nan if ended else two_to_the(size)
    lane[NEAR, l] = (1.0 - FAR) * smallest
    lane[LONGEST, l], lane[LOW, l], lane[HIGH, l] = bounds(
        smallest, I_square, lane[EPS, l], lane[SQUARE, l], two_to_the(size)
    )


@inner
def renew_units(J, I, omega, lane, begin, end, n, failed_at):
    """After the step to state n, end lanes that are not finite, and renew units if needed."""
    for l in range(omega.shape[1]):
        if not (lane[LOW, l] < lane[SQUARE, l] < lane[HIGH, l]):
            largest, undefined, infinite = 0.0, False, False
            for i in range(omega.shape[0]):
                size = abs(omega[i, l])
                undefined |= size != size
                infinite |= size * lane[UNIT, l] == np.inf
                largest = larger(size, largest)
            if (undefined or infinite) and lane[STATUS, l] == OK:
                regular = undefined and lane[HALF, l] - lane[HALF, l] == 0.0
                lane[STATUS, l] = SINGULAR if regular else NONFINITE
            if lane[STATUS, l] != OK and begin + l < end and failed_at[begin + l] < 0:
                failed_at[begin + l] = n
            take_unit(J, I, omega, lane, l, unit_of(largest, lane[EXPONENT, l]))


@inner
def enter(parameters, start, kept, begin, end, block):
    """Enter trajectories at state `start`; lanes beyond the last repeat it."""
    (all_J, all_I, eps, initial), (J, I, omega, lane) = parameters, block
    _, status, failed_at, state, exponents = kept
    m, lanes = initial.shape[1], omega.shape[1]
    for l in range(lanes):
        b = min(begin + l, end - 1)
        of_J, of_I = b if len(all_J) > 1 else 0, b if len(all_I) > 1 else 0
        largest, coupled, undefined = 0.0, 0.0, False
        for i in range(omega.shape[0]):
            J_i, I_i, w = np.inf, 0.0, 0.0
            if i < m:
                J_i, I_i = all_J[of_J, i], all_I[of_I, i]
                w = initial[b, i] if start == 0 else state[b, i]
            put(J, i, l, J_i)
            put(I, i, l, I_i)
            omega[i, l] = w
            largest, coupled = larger(abs(w), largest), larger(abs(I_i), coupled)
            undefined |= w != w
        lane[EPS_INPUT, l] = eps[b if eps.size > 1 else 0]
        lane[RESTS, l] = 1.0 if lane[EPS_INPUT, l] == 0.0 or coupled == 0.0 else 0.0
        if start == 0:
            # A trajectory whose state 0 is NaN ends at step 0.
            status[b], failed_at[b] = (NONFINITE, 0) if undefined else (OK, -1)
        lane[STATUS, l] = status[b] if failed_at[b] >= 0 else OK
        lane[EXPONENT, l] = 0.0 if start == 0 else exponents[b]
        size = unit_of(largest, 0.0) if start == 0 else exponents[b]
        take_unit(J, I, omega, lane, l, size)


@inner
def write(initial, omega, lane, begin, end, n, target):
    """Write the states n of a block; fixed states and the first are copies of the input."""
    for l in range(end - begin):
        b = begin + l
        as_given = (n == 0 or lane[RESTS, l] > 0.0) and lane[STATUS, l] == OK
        if as_given:
            for i in range(initial.shape[1]):
                target[b, i] = initial[b, i]
        else:
            for i in range(initial.shape[1]):
                target[b, i] = omega[i, l] * lane[UNIT, l]


@inner
def leave(initial, omega, lane, begin, end, stop, kept):
    """Write the last states, in the unit of the input and in those of the lanes."""
    final, status, _, state, exponents = kept
    write(initial, omega, lane, begin, end, stop, final)
    for l in range(end - begin):
        b = begin + l
        status[b], exponents[b] = lane[STATUS, l], lane[EXPONENT, l]
        for i in range(initial.shape[1]):
            state[b, i] = omega[i, l]


@inner
def orient(omega, lane, turning, task, begin, end, n, start):
    """Rotate the orientations to state n; `before` holds the previous states."""
    time_step, columns, _, before, room = turning
    size = columns.shape[1]
    middle, image = room[task, 2 * size], room[task, 2 * size + 1]
    for l in range(end - begin):
        b = begin + l
        for i in range(size - 1):
            w = omega[i, l] * lane[UNIT, l]
            middle[i], before[task, i, l] = mean(before[task, i, l], w), w
        if n > start:
            eps = time_step[b if time_step.size > 1 else 0]
            turn(columns[b], middle[: size - 1], eps, image)
            if n % CLEAN_EVERY == 0:
                clean_up(columns[b], room[task, :size], room[task, size : 2 * size])
        elif lane[STATUS, l] != OK:
            for r in range(size):
                for c in range(size):
                    columns[b, r, c] = np.nan


@inner
def save_turns(turning, begin, end, row):
    """Write the orientations of a block to a row."""
    _, columns, turns, _, _ = turning
    for b in range(begin, end):
        for r in range(columns.shape[1]):
            for c in range(columns.shape[1]):
                turns[row, b, r, c] = columns[b, c, r]


def run_tasks(part, parts, parameters, span, saved, turning, kept, room):
    """Iterate the trajectories of a part of the tasks.

    parameters : J, I (B, m) or (1, m); eps (B,) or (1,); the states at step 0 (B, m)
    span : begin and end of the trajectories; start, stop; every, first_row of the saved states
    saved : (rows, B, m)
    turning : None, or the step size in the unit of time of omega (B,) or (1,); the transposed
        orientations (B, n, n), updated; turns (rows, B, n, n); room (tasks, m, lanes) and
        (tasks, 2 n + 2, n)
    kept : final (B, m); status, failed_at (B,); the states in units of 2**exponent (B, m), and
        exponent (B,). All but `final` are read if start is not 0.
    room : for J and I (tasks, 2, M, lanes), or (tasks, 2, M) if there is only one body;
        (tasks, 2, M, lanes); for elimination (tasks, m + 3, m + 1, WIDTH)
    """
    first, last, start, stop, every, first_row = span
    bodies, states, matrices = room
    lane = carray(stack(ROOM), (FIELDS, LANES))
    initial, failed_at = parameters[3], kept[2]
    tasks, lanes = states.shape[0], states.shape[3]
    blocks = (last - first + lanes - 1) // lanes
    first_task, last_task = share(tasks, part, parts)
    for task in range(first_task, last_task):
        J, I, omega, work = bodies[task, 0], bodies[task, 1], states[task, 0], states[task, 1]
        for k in range(task * blocks // tasks, (task + 1) * blocks // tasks):
            begin = first + k * lanes
            end = min(begin + lanes, last)
            enter(parameters, start, kept, begin, end, (J, I, omega, lane))
            n, row, next_saved = start, 0, stop + 1
            if saved.shape[0] > 0:
                row = start // every + 1 - first_row if start > 0 else 0
                next_saved = (start // every + 1) * every if start > 0 else 0
            while True:
                if turning is not None:
                    orient(omega, lane, turning, task, begin, end, n, start)
                if n == next_saved:
                    write(initial, omega, lane, begin, end, n, saved[row])
                    if turning is not None:
                        save_turns(turning, begin, end, row)
                    row, next_saved = row + 1, next_saved + every
                if n == stop:
                    break
                until = min(next_saved, stop) if turning is None else n + 1
                while n < until:
                    step(J, I, omega, work, lane, end - begin, matrices[task])
                    n += 1
                    if not units_serve(lane, lanes):
                        renew_units(J, I, omega, lane, begin, end, n, failed_at)
            leave(initial, omega, lane, begin, end, stop, kept)


# Steps in O(n), where trajectories that need elimination end with NEEDS_ELIMINATION or are
# eliminated; and steps by elimination only.
iterate = Kernel(run_tasks, "iterate_nd", step=rank2_step(leave_out))
iterate_with_elimination = Kernel(
    run_tasks, "iterate_with_elimination", step=rank2_step(solve_lanes)
)
iterate_by_elimination = Kernel(run_tasks, "iterate_by_elimination", step=step_gauss)
