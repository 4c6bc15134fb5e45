"""Iteration of the n-dimensional map.

A block of trajectories advances together: lanes are trajectories, and components are rows of lanes.
A step in O(n) solves for the increment by `solve2`; lanes where this is inaccurate use
`solve_bordered` or elimination. The arithmetic of a lane never depends on the other lanes.

Lanes store J, I and omega in units, powers of two, in which they are of the order of 1; that of
omega changes when omega leaves this range. Lanes that have ended have the state 0 in the unit NaN.
"""

from typing import NamedTuple

import numpy as np

from .._formulas.elementary import exponent, larger, scaled, smaller, two_to_the
from .._formulas.nd_map import (
    FAR,
    FAR_ENOUGH,
    bounds,
    matrix_diagonal,
    matrix_row,
    solve2,
    solve_bordered,
)
from .._formulas.rotation import mean
from .._jit import (
    Kernel,
    formula,
    inner,
    namespace,
    select,
    share,
    stack,
)
from .codes import NEEDS_ELIMINATION, NONFINITE, OK, SINGULAR
from .elimination import eliminate
from .turning_nd import CLEAN_EVERY, clean_up, turn
from .units_nd import unit_of, unit_of_moments

method = namespace("method")  # of steps: `step`

# Trajectories of a block: enough to prevent sums over components from stalling on memory just
# written.
LANES = 64
# Is the step by `solve2` accurate? If not, it is taken by the bordered system, or remains to be.
SURE, DEPENDS_ON_D, DONE, NOT_AT_ALL = 3.0, 2.0, 1.0, 0.0
# Components i and M/2 + i are added up in pairs, which halves the stores. If m is odd, M = m + 1,
# and the last component has J = infinity, I = omega = 0. (LLVM tests once for all i for
# overlap of written rows with others: the pairs must lie in two halves, not side by side.)


class Block(NamedTuple):
    """A block of trajectories: M components of each lane, and numbers of each lane."""

    J: object  # (M, lanes), or (M,) if common to all lanes
    I: object
    omega: object  # (M, lanes)
    inverse: object  # 1 / d
    eps_input: object
    of_body: object  # exponent of the unit of I over that of J
    eps: object  # in the unit of omega; 0 for fixed states
    exponent: object  # of the unit of omega
    unit: object
    low: object  # bounds of |omega|**2, see `bounds`
    high: object
    longest: object
    near: object  # (1 - FAR) times the least J: d is far from 0 where eps p / 2 is below this
    rests: object  # 1 if eps or I is 0, else 0
    status: object  # of trajectories that have ended, else OK
    p: object
    square: object
    half: object  # eps p / 2
    alpha: object  # sums, see `solve2`
    beta: object
    gamma: object
    of_omega: object  # factors in delta, see `solve2`
    of_I: object
    accurate: object  # of the step by `solve2`: see SURE


@formula
def row():
    """Return a number of each lane, on the stack."""
    return stack(LANES)


@formula
def block(bodies, states):
    """Return a block whose components are in the memory of a task."""
    return Block(
        bodies[0], bodies[1], states[0], states[1],
        row(), row(), row(), row(), row(), row(), row(), row(), row(), row(), row(),
        row(), row(), row(), row(), row(), row(), row(), row(), row(),
    )  # fmt: skip


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
def add_pair(b, l, I_i, I_j, w_i, w_j):
    """Add the terms of two components to p and |omega|**2."""
    b.p[l] = b.p[l] + I_i * w_i + I_j * w_j
    b.square[l] = b.square[l] + w_i * w_i + w_j * w_j


@formula
def sums(b):
    """Find 1 / d and the sums of `solve2`."""
    half, lanes = b.omega.shape[0] // 2, b.omega.shape[1]
    for l in range(lanes):
        b.half[l] = 0.5 * b.eps[l] * b.p[l]
        b.alpha[l], b.beta[l], b.gamma[l] = 0.0, 0.0, 0.0
    for i in range(half):
        j = half + i
        for l in range(lanes):
            I_i, I_j, w_i, w_j = at(b.I, i, l), at(b.I, j, l), b.omega[i, l], b.omega[j, l]
            r_i, r_j = 1.0 / (at(b.J, i, l) - b.half[l]), 1.0 / (at(b.J, j, l) - b.half[l])
            b.inverse[i, l], b.inverse[j, l] = r_i, r_j
            b.alpha[l] = b.alpha[l] + I_i * r_i * w_i + I_j * r_j * w_j
            b.beta[l] = b.beta[l] + I_i * r_i * I_i + I_j * r_j * I_j
            b.gamma[l] = b.gamma[l] + w_i * r_i * w_i + w_j * r_j * w_j


@formula
def solve(b):
    """Solve for the factors in the increment; return True if it is accurate in all lanes."""
    left = 0
    for l in range(b.omega.shape[1]):
        square = b.square[l]
        of_omega, of_I, det, size = solve2(
            b.eps[l], b.p[l], square, b.alpha[l], b.beta[l], b.gamma[l]
        )
        accurate = (det > FAR * FAR * size) & (square < b.longest[l])
        sure = accurate & (b.half[l] < b.near[l])
        left += select(sure, 0, 1)
        b.accurate[l] = select(sure, SURE, select(accurate, DEPENDS_ON_D, NOT_AT_ALL))
        b.of_omega[l], b.of_I[l] = of_omega, of_I
    return left == 0


@formula
def add(b):
    """Add the increment, and update p and |omega|**2."""
    half, lanes = b.omega.shape[0] // 2, b.omega.shape[1]
    for l in range(lanes):
        b.p[l], b.square[l] = 0.0, 0.0
    for i in range(half):
        j = half + i
        for l in range(lanes):
            of_omega, of_I, w_i, w_j = b.of_omega[l], b.of_I[l], b.omega[i, l], b.omega[j, l]
            I_i, I_j = at(b.I, i, l), at(b.I, j, l)
            w_i += (of_omega * w_i - of_I * I_i) * b.inverse[i, l]
            w_j += (of_omega * w_j - of_I * I_j) * b.inverse[j, l]
            b.omega[i, l], b.omega[j, l] = w_i, w_j
            add_pair(b, l, I_i, I_j, w_i, w_j)


@inner
def bordered(b, l):
    """Take the step in a lane by the bordered system, unless the step by `solve2` is accurate.

    Returns what was done: SURE if the step by `solve2` remains, DONE, or NOT_AT_ALL.
    """
    M = b.omega.shape[0]
    eps, half, p, square = b.eps[l], b.half[l], b.p[l], b.square[l]
    k, smallest, second = 0, np.inf, np.inf
    for i in range(M):
        ratio = abs(1.0 - half / at(b.J, i, l))
        if ratio < smallest:
            k, smallest, second = i, ratio, smallest
        else:
            second = min(second, ratio)
    if b.accurate[l] == DEPENDS_ON_D and smallest > FAR:
        return SURE
    alpha, beta, gamma = 0.0, 0.0, 0.0
    for i in range(M):
        if i != k:
            I_i, w, r = at(b.I, i, l), b.omega[i, l], b.inverse[i, l]
            alpha += I_i * r * w
            beta += I_i * r * I_i
            gamma += w * r * w
    of_omega, of_I, delta_k, regular = solve_bordered(
        at(b.J, k, l), at(b.I, k, l), b.omega[k, l], eps, p, square, alpha, beta, gamma
    )
    if not (regular and second > FAR_ENOUGH and square < b.longest[l]):
        return NOT_AT_ALL
    for i in range(M):
        if i != k:
            b.omega[i, l] += (of_omega * b.omega[i, l] - of_I * at(b.I, i, l)) * b.inverse[i, l]
    b.omega[k, l] += delta_k
    return DONE


@inner
def fill_matrix(b, matrix):
    """Fill A(omega), with omega as the right side."""
    m, _, lanes = matrix.shape
    c, g, diagonal, rest = row(), row(), row(), row()
    for l in range(lanes):
        rest[l] = 0.0
    for i in range(m - 1, -1, -1):
        for l in range(lanes):
            matrix[i, m, l] = rest[l]  # terms of p after component i
            rest[l] = rest[l] + b.I[i, l] * b.omega[i, l]
    for l in range(lanes):
        rest[l] = 0.0
    for i in range(m):
        for l in range(lanes):
            J_i, I_i, w_i = b.J[i, l], b.I[i, l], b.omega[i, l]
            c[l], g[l] = matrix_row(J_i, I_i, w_i, b.eps[l])
            diagonal[l] = matrix_diagonal(J_i, rest[l] + matrix[i, m, l], b.eps[l])
            rest[l] = rest[l] + I_i * w_i
            matrix[i, m, l] = w_i
        for j in range(m):
            for l in range(lanes):
                matrix[i, j, l] = -c[l] * b.omega[j, l] - g[l] * b.I[j, l]
        for l in range(lanes):
            matrix[i, i, l] = diagonal[l]


@inner
def eliminate_lanes(b, matrix):
    """Take the step by elimination in lanes where it was not taken at all."""
    m, _, lanes = matrix.shape
    fill_matrix(b, matrix)
    eliminate(matrix)
    for i in range(m):
        for l in range(lanes):
            chosen = b.accurate[l] == NOT_AT_ALL
            b.omega[i, l] = select(chosen, matrix[i, m, l], b.omega[i, l])


@inner
def repair(b, matrices, task):
    """Take the step in lanes where `solve2` is inaccurate, and set its increment to 0.

    Without matrices, trajectories that need elimination end; another run restarts them.
    """
    M, lanes = b.omega.shape
    left = False
    for l in range(lanes):
        if b.accurate[l] != SURE:
            b.accurate[l] = bordered(b, l)
            left |= b.accurate[l] == NOT_AT_ALL
    if matrices is None:
        for l in range(lanes):
            if b.accurate[l] == NOT_AT_ALL:
                b.status[l], b.omega[0, l] = NEEDS_ELIMINATION, np.nan
    elif left:
        eliminate_lanes(b, matrices[task])
    for l in range(lanes):
        if b.accurate[l] != SURE:
            b.of_omega[l], b.of_I[l] = 0.0, 0.0
            for i in range(M):
                b.inverse[i, l] = 0.0


@formula
def step_rank2(b, matrices, task):
    """Take a step in O(n)."""
    sums(b)
    if not solve(b):
        repair(b, matrices, task)
    add(b)


@inner
def step_gauss(b, matrices, task):
    """Take a step by elimination; the increment is 0."""
    M, lanes = b.omega.shape
    for l in range(lanes):
        b.half[l], b.accurate[l] = 0.5 * b.eps[l] * b.p[l], NOT_AT_ALL
    eliminate_lanes(b, matrices[task])
    for l in range(lanes):
        b.of_omega[l], b.of_I[l] = 0.0, 0.0
    for i in range(M):
        for l in range(lanes):
            b.inverse[i, l] = 0.0
    add(b)


@formula
def units_serve(b, lanes):
    """Return True if the units of all lanes remain valid."""
    left = 0
    for l in range(lanes):
        square = b.square[l]
        left += select((square > b.low[l]) & (square < b.high[l]), 0, 1)
    return left == 0


@formula
def unit_of_state(largest, before):
    """Return the exponent of the unit for numbers up to `largest`, in the unit 2**before."""
    size = select((largest > 0.0) & (largest < np.inf), exponent(largest) + 1.0, 0.0)
    return larger(smaller(size + before, 1023.0), -1022.0)


@inner
def take_unit(b, l, size):
    """Change to the unit 2**size in a lane, or to the state 0 if the trajectory has ended."""
    change, ended = b.exponent[l] - size, b.status[l] != OK
    smallest, I_square = np.inf, 0.0
    for i in range(b.omega.shape[0]):
        b.omega[i, l] = 0.0 if ended else scaled(b.omega[i, l], change)
        smallest = min(at(b.J, i, l), smallest)
        I_square += at(b.I, i, l) * at(b.I, i, l)
    b.p[l], b.square[l], half = 0.0, 0.0, b.omega.shape[0] // 2
    for i in range(half):
        j = half + i
        add_pair(b, l, at(b.I, i, l), at(b.I, j, l), b.omega[i, l], b.omega[j, l])
    rests = ended or b.rests[l] > 0.0
    b.exponent[l] = size
    b.eps[l] = 0.0 if rests else scaled(b.eps_input[l], size + b.of_body[l])
    b.unit[l] = np.nan if ended else two_to_the(size)
    b.near[l] = (1.0 - FAR) * smallest
    b.longest[l], b.low[l], b.high[l] = bounds(
        smallest, I_square, b.eps[l], b.square[l], two_to_the(size)
    )


@inner
def renew_units(b, begin, end, n, failed_at):
    """After the step to state n, end lanes that are not finite, and renew units if needed."""
    for l in range(b.omega.shape[1]):
        if not (b.low[l] < b.square[l] < b.high[l]):
            largest, undefined, infinite = 0.0, False, False
            for i in range(b.omega.shape[0]):
                size = abs(b.omega[i, l])
                undefined |= size != size
                infinite |= size * b.unit[l] == np.inf
                largest = larger(size, largest)
            if (undefined or infinite) and b.status[l] == OK:
                regular = undefined and b.half[l] - b.half[l] == 0.0
                b.status[l] = SINGULAR if regular else NONFINITE
            if b.status[l] != OK and begin + l < end and failed_at[begin + l] < 0:
                failed_at[begin + l] = n
            take_unit(b, l, unit_of_state(largest, b.exponent[l]))


@inner
def enter(parameters, start, kept, begin, end, b):
    """Enter trajectories at state `start`; lanes beyond the last repeat it."""
    all_J, all_I, eps, initial = parameters
    _, status, failed_at, state, exponents = kept
    m, lanes = initial.shape[1], b.omega.shape[1]
    for l in range(lanes):
        k = min(begin + l, end - 1)
        of_J, of_I = k if len(all_J) > 1 else 0, k if len(all_I) > 1 else 0
        M = unit_of_moments(all_J[of_J])
        P = unit_of(all_I[of_I], M)
        of_moments, of_products = two_to_the(-M), two_to_the(-P)
        largest, coupled, undefined = 0.0, 0.0, False
        for i in range(b.omega.shape[0]):
            J_i, I_i, w = np.inf, 0.0, 0.0
            if i < m:
                J_i, I_i = all_J[of_J, i] * of_moments, all_I[of_I, i] * of_products
                w = initial[k, i] if start == 0 else state[k, i]
            put(b.J, i, l, J_i)
            put(b.I, i, l, I_i)
            b.omega[i, l] = w
            largest, coupled = larger(abs(w), largest), larger(abs(I_i), coupled)
            undefined |= w != w
        b.eps_input[l], b.of_body[l] = eps[k if eps.size > 1 else 0], P - M
        b.rests[l] = 1.0 if b.eps_input[l] == 0.0 or coupled == 0.0 else 0.0
        if start == 0:
            # A trajectory whose state 0 is NaN ends at step 0.
            status[k], failed_at[k] = (NONFINITE, 0) if undefined else (OK, -1)
        b.status[l] = status[k] if failed_at[k] >= 0 else OK
        b.exponent[l] = 0.0 if start == 0 else exponents[k]
        size = unit_of_state(largest, 0.0) if start == 0 else exponents[k]
        take_unit(b, l, size)


@inner
def write(initial, b, begin, end, n, target):
    """Write the states n of a block; fixed states and the first are copies of the input."""
    for l in range(end - begin):
        k = begin + l
        as_given = (n == 0 or b.rests[l] > 0.0) and b.status[l] == OK
        if as_given:
            for i in range(initial.shape[1]):
                target[k, i] = initial[k, i]
        else:
            for i in range(initial.shape[1]):
                target[k, i] = b.omega[i, l] * b.unit[l]


@inner
def leave(initial, b, begin, end, stop, kept):
    """Write the last states, in the unit of the input and in those of the lanes."""
    final, status, _, state, exponents = kept
    write(initial, b, begin, end, stop, final)
    for l in range(end - begin):
        k = begin + l
        status[k], exponents[k] = b.status[l], b.exponent[l]
        for i in range(initial.shape[1]):
            state[k, i] = b.omega[i, l]


@inner
def orient(b, turning, task, begin, end, n, start):
    """Rotate the orientations to state n; `before` holds the previous states."""
    time_step, columns, _, before, room = turning
    size = columns.shape[1]
    middle, image = room[task, 2 * size], room[task, 2 * size + 1]
    for l in range(end - begin):
        k = begin + l
        for i in range(size - 1):
            w = b.omega[i, l] * b.unit[l]
            middle[i], before[task, i, l] = mean(before[task, i, l], w), w
        if n > start:
            eps = time_step[k if time_step.size > 1 else 0]
            turn(columns[k], middle[: size - 1], eps, image)
            if n % CLEAN_EVERY == 0:
                clean_up(columns[k], room[task, :size], room[task, size : 2 * size])
        elif b.status[l] != OK:
            for r in range(size):
                for c in range(size):
                    columns[k, r, c] = np.nan


@inner
def save_turns(turning, begin, end, row):
    """Write the orientations of a block to a row."""
    _, columns, turns, _, _ = turning
    for k in range(begin, end):
        for r in range(columns.shape[1]):
            for c in range(columns.shape[1]):
                turns[row, k, r, c] = columns[k, c, r]


def run_tasks(part, parts, parameters, span, saved, turning, kept, room, matrices):
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
        (tasks, 2, M, lanes)
    matrices : (tasks, m, m + 1, lanes), where lanes is WIDTH; None if trajectories
        that need elimination end with the status NEEDS_ELIMINATION
    """
    first, last, start, stop, every, first_row = span
    bodies, states = room
    initial, failed_at = parameters[3], kept[2]
    tasks, lanes = states.shape[0], states.shape[3]
    blocks = (last - first + lanes - 1) // lanes
    first_task, last_task = share(tasks, part, parts)
    for task in range(first_task, last_task):
        b = block(bodies[task], states[task])
        for k in range(task * blocks // tasks, (task + 1) * blocks // tasks):
            begin = first + k * lanes
            end = min(begin + lanes, last)
            enter(parameters, start, kept, begin, end, b)
            n, row, next_saved = start, 0, stop + 1
            if saved.shape[0] > 0:
                row = start // every + 1 - first_row if start > 0 else 0
                next_saved = (start // every + 1) * every if start > 0 else 0
            while True:
                if turning is not None:
                    orient(b, turning, task, begin, end, n, start)
                if n == next_saved:
                    write(initial, b, begin, end, n, saved[row])
                    if turning is not None:
                        save_turns(turning, begin, end, row)
                    row, next_saved = row + 1, next_saved + every
                if n == stop:
                    break
                until = min(next_saved, stop) if turning is None else n + 1
                while n < until:
                    method.step(b, matrices, task)
                    n += 1
                    if not units_serve(b, lanes):
                        renew_units(b, begin, end, n, failed_at)
            leave(initial, b, begin, end, stop, kept)


iterate = Kernel(run_tasks, "iterate_nd", method=namespace("rank2", step=step_rank2))
iterate_by_elimination = Kernel(
    run_tasks, "iterate_by_elimination", method=namespace("gauss", step=step_gauss)
)
