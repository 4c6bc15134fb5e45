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
    SMALL,
    bounds,
    matrix_row,
    slope_of_itself,
    solve2,
    solve_bordered,
)
from .._jit import Kernel, allocation, formula, inner, namespace, select, share, stack
from .codes import NEEDS_ELIMINATION, NONFINITE, OK, SINGULAR
from .elimination import eliminate
from .turning_nd import turn_lanes, write_turns
from .units_nd import unit_of, unit_of_moments

method = namespace("method")  # of steps: `step`

# Trajectories of a block, at most: enough to prevent sums over components from stalling on memory
# just written. Blocks of a run that eliminates have fewer: see `elimination`.
LANES = 64
# A step in a lane: solved by `solve2`, solved if no d is small, open, or done by the bordered
# system.
SOLVED, SOLVED_IF_FAR, OPEN, DONE = 0.0, 1.0, 2.0, 3.0
# Components i and M/2 + i are added up in pairs, which halves the stores. If m is odd, M = m + 1,
# and the last component has J = infinity, I = omega = 0. They are not 2 i and 2 i + 1: at i and
# M/2 + i LLVM tests once, for all i, whether written rows overlap others.


class Block(NamedTuple):
    """A block of trajectories: M components of each lane, and numbers of each lane."""

    J: object  # (M, lanes), or (M,) if common to all lanes
    I: object
    omega: object  # (M, lanes)
    inverse: object  # 1 / d
    eps_input: object  # 0 if all states are fixed
    of_body: object  # exponent of the unit of I over that of J
    near: object  # (1 - FAR) times the least J: d is far from 0 where eps p / 2 is below this
    reach: object  # see `bounds`
    eps: object  # in the unit of omega; 0 for fixed states
    exponent: object  # of the unit of omega
    unit: object  # 2**exponent; NaN if the lane has ended
    longest: object  # bounds of |omega|**2, see `bounds`
    low: object
    high: object
    status: object  # of trajectories that have ended, else OK
    p: object  # I . omega
    square: object  # |omega|**2
    half: object  # eps p / 2
    alpha: object  # sums, see `solve2`
    beta: object
    gamma: object
    of_omega: object  # factors in delta, see `solve2`
    of_I: object
    outcome: object  # SOLVED, SOLVED_IF_FAR, OPEN or DONE


@allocation
def row():
    """Return a number of each lane, on the stack."""
    return stack(LANES)


@allocation
def block(bodies, states):
    """Return a block whose components are in the memory of a task."""
    return Block(
        bodies[0], bodies[1], states[0], states[1],
        row(), row(), row(), row(), row(), row(), row(), row(), row(), row(),
        row(), row(), row(), row(), row(), row(), row(), row(), row(), row(),
    )  # fmt: skip


@formula
def at(values, i, l):
    """Return an entry of J or I."""
    return values[i] if values.ndim == 1 else values[i, l]


@formula
def set_at(values, i, l, number):
    """Set an entry of J or I."""
    if values.ndim == 1:
        values[i] = number
    else:
        values[i, l] = number


@formula
def step(b, matrices, task):
    """Take a step in O(n) in all lanes."""
    sums(b)
    if not solve(b):
        repair(b, matrices, task)
    add(b)
    measure(b)


@formula
def step_by_elimination(b, matrices, task):
    """Take a step by elimination in all lanes."""
    for l in range(b.omega.shape[1]):
        b.half[l], b.outcome[l] = 0.5 * b.eps[l] * b.p[l], OPEN
    eliminate_lanes(b, matrices[task])
    measure(b)


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
            # Not +=, which adds the terms to each other first.
            b.alpha[l] = b.alpha[l] + I_i * r_i * w_i + I_j * r_j * w_j
            b.beta[l] = b.beta[l] + I_i * r_i * I_i + I_j * r_j * I_j
            b.gamma[l] = b.gamma[l] + w_i * r_i * w_i + w_j * r_j * w_j


@formula
def solve(b):
    """Solve for the factors in the increment; return True if it is accurate in all lanes."""
    unsolved = 0  # an integer: a sum of floats is one addition after the other
    for l in range(b.omega.shape[1]):
        of_omega, of_I, det, size = solve2(
            b.eps[l], b.p[l], b.square[l], b.alpha[l], b.beta[l], b.gamma[l]
        )
        accurate = (det > FAR * FAR * size) & (b.square[l] < b.longest[l])
        solved = accurate & (b.half[l] < b.near[l])
        unsolved += select(solved, 0, 1)
        b.outcome[l] = select(solved, SOLVED, select(accurate, SOLVED_IF_FAR, OPEN))
        b.of_omega[l], b.of_I[l] = of_omega, of_I
    return unsolved == 0


@formula
def add(b):
    """Add the increment."""
    M, lanes = b.omega.shape
    for i in range(M):
        for l in range(lanes):
            w = b.omega[i, l]
            b.omega[i, l] = w + (b.of_omega[l] * w - b.of_I[l] * at(b.I, i, l)) * b.inverse[i, l]


@formula
def measure(b):
    """Find p and |omega|**2."""
    half, lanes = b.omega.shape[0] // 2, b.omega.shape[1]
    for l in range(lanes):
        b.p[l], b.square[l] = 0.0, 0.0
    for i in range(half):
        j = half + i
        for l in range(lanes):
            w_i, w_j = b.omega[i, l], b.omega[j, l]
            b.p[l] = b.p[l] + at(b.I, i, l) * w_i + at(b.I, j, l) * w_j
            b.square[l] = b.square[l] + w_i * w_i + w_j * w_j


@inner
def repair(b, matrices, task):
    """Take the step in lanes that are not solved, and set their increments to 0.

    Without matrices, trajectories that need elimination end; another run restarts them.
    """
    M, lanes = b.omega.shape
    any_open = False
    for l in range(lanes):
        if b.outcome[l] != SOLVED:
            b.outcome[l] = bordered(b, l)
            any_open |= b.outcome[l] == OPEN
    if matrices is None:
        for l in range(lanes):
            if b.outcome[l] == OPEN:
                # By NaN `units_serve` fails, and `renew_units` ends the lane.
                b.status[l], b.omega[0, l] = NEEDS_ELIMINATION, np.nan
    elif any_open:
        eliminate_lanes(b, matrices[task])
    for l in range(lanes):
        if b.outcome[l] != SOLVED:
            b.of_omega[l], b.of_I[l] = 0.0, 0.0
            for i in range(M):
                b.inverse[i, l] = 0.0


@inner
def bordered(b, l):
    """Take the step in a lane by the bordered system, unless `solve2` is accurate after all; return
    the outcome, OPEN if neither is accurate.
    """
    M = b.omega.shape[0]
    eps, half, p, square = b.eps[l], b.half[l], b.p[l], b.square[l]
    j, least, second = 0, np.inf, np.inf
    for i in range(M):
        ratio = abs(1.0 - half / at(b.J, i, l))
        if ratio < least:
            j, least, second = i, ratio, least
        else:
            second = min(second, ratio)
    if b.outcome[l] == SOLVED_IF_FAR and least > FAR:
        return SOLVED
    alpha, beta, gamma = 0.0, 0.0, 0.0
    for i in range(M):
        if i != j:
            I_i, w, r = at(b.I, i, l), b.omega[i, l], b.inverse[i, l]
            alpha += I_i * r * w
            beta += I_i * r * I_i
            gamma += w * r * w
    of_omega, of_I, delta, regular = solve_bordered(
        at(b.J, j, l), at(b.I, j, l), b.omega[j, l], eps, p, square, alpha, beta, gamma
    )
    if not (regular and second > FAR_ENOUGH and square < b.longest[l]):
        return OPEN
    for i in range(M):
        if i != j:
            b.omega[i, l] += (of_omega * b.omega[i, l] - of_I * at(b.I, i, l)) * b.inverse[i, l]
    b.omega[j, l] += delta
    return DONE


@inner
def eliminate_lanes(b, matrix):
    """Take the step by elimination in open lanes."""
    m, _, lanes = matrix.shape
    fill_matrix(b, matrix)
    eliminate(matrix)
    for i in range(m):
        for l in range(lanes):
            b.omega[i, l] = select(b.outcome[l] == OPEN, matrix[i, m, l], b.omega[i, l])


@inner
def fill_matrix(b, matrix):
    """Fill A(omega), and omega as the right side."""
    m, _, lanes = matrix.shape
    c, g, diagonal, others = row(), row(), row(), row()
    for l in range(lanes):
        others[l] = 0.0
    for i in range(m - 1, -1, -1):
        for l in range(lanes):
            matrix[i, m, l] = others[l]  # terms of p after component i
            others[l] = others[l] + b.I[i, l] * b.omega[i, l]
    for l in range(lanes):
        others[l] = 0.0  # and before it
    for i in range(m):
        for l in range(lanes):
            J_i, I_i, w_i, eps = b.J[i, l], b.I[i, l], b.omega[i, l], b.eps[l]
            c[l], g[l] = matrix_row(J_i, I_i, w_i, eps)
            diagonal[l] = 1.0 - slope_of_itself(J_i, others[l] + matrix[i, m, l], eps)
            others[l] = others[l] + I_i * w_i
            matrix[i, m, l] = w_i
        for j in range(m):
            for l in range(lanes):
                matrix[i, j, l] = -c[l] * b.omega[j, l] - g[l] * b.I[j, l]
        for l in range(lanes):
            matrix[i, i, l] = diagonal[l]


@formula
def units_serve(b):
    """Return True if all states are finite and in the range of their units."""
    outside = 0
    for l in range(b.omega.shape[1]):
        outside += select((b.square[l] > b.low[l]) & (b.square[l] < b.high[l]), 0, 1)
    return outside == 0


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
                # NaN from finite terms is a pole, otherwise an overflow.
                finite = b.half[l] - b.half[l] == 0.0
                b.status[l] = SINGULAR if undefined and finite else NONFINITE
            if b.status[l] != OK and begin + l < end and failed_at[begin + l] < 0:
                failed_at[begin + l] = n
            take_unit(b, l, unit_of_state(largest, b.exponent[l]))
    measure(b)


@formula
def unit_of_state(largest, before):
    """Return the exponent of the unit for numbers up to `largest`, in the unit 2**before."""
    power = select((largest > 0.0) & (largest < np.inf), exponent(largest) + 1.0, 0.0)
    return larger(smaller(power + before, 1023.0), -1022.0)


@formula
def take_unit(b, l, power):
    """Change to the unit 2**power in a lane, or to the state 0 if the trajectory has ended."""
    change, ended, unit, largest = b.exponent[l] - power, b.status[l] != OK, two_to_the(power), 0.0
    for i in range(b.omega.shape[0]):
        b.omega[i, l] = 0.0 if ended else scaled(b.omega[i, l], change)
        largest = larger(abs(b.omega[i, l]), largest)
    b.exponent[l], b.unit[l] = power, np.nan if ended else unit
    b.eps[l] = 0.0 if ended else scaled(b.eps_input[l], power + b.of_body[l])
    b.longest[l], b.low[l], b.high[l] = bounds(b.reach[l], b.eps[l], largest, unit)


@formula
def enter_body(b, l, J, I, eps):
    """Enter a body and a step size, 0 if every state is fixed."""
    of_J = unit_of_moments(J)
    of_I = unit_of(I, of_J)
    factor_J, factor_I = two_to_the(-of_J), two_to_the(-of_I)
    smallest, I_square = np.inf, 0.0
    for i in range(b.omega.shape[0]):
        J_i, I_i = np.inf, 0.0
        if i < J.size:
            J_i, I_i = J[i] * factor_J, I[i] * factor_I
        set_at(b.J, i, l, J_i)
        set_at(b.I, i, l, I_i)
        smallest = smaller(J_i, smallest)
        I_square += I_i * I_i
    b.near[l], b.reach[l] = (1.0 - FAR) * smallest, SMALL * smallest / np.sqrt(I_square)
    b.eps_input[l], b.of_body[l] = 0.0 if I_square == 0.0 else eps, of_I - of_J


@inner
def enter(b, parameters, start, results, begin, end):
    """Enter trajectories at state `start`; lanes beyond the last repeat it."""
    J, I, eps, initial = parameters
    _, status, failed_at, state, exponents = results
    for l in range(b.omega.shape[1]):
        k = min(begin + l, end - 1)
        enter_body(b, l, J[min(k, len(J) - 1)], I[min(k, len(I) - 1)], eps[min(k, eps.size - 1)])
        largest, undefined = 0.0, False
        for i in range(b.omega.shape[0]):
            w = 0.0
            if i < initial.shape[1]:
                w = initial[k, i] if start == 0 else state[k, i]
            b.omega[i, l] = w
            largest = larger(abs(w), largest)
            undefined |= w != w
        if start == 0:
            # A trajectory whose state 0 is NaN ends at step 0.
            status[k], failed_at[k] = (NONFINITE, 0) if undefined else (OK, -1)
            exponents[k] = unit_of_state(largest, 0.0)
        b.status[l] = status[k] if failed_at[k] >= 0 else OK
        b.exponent[l] = 0.0 if start == 0 else exponents[k]
        take_unit(b, l, exponents[k])
    measure(b)


@inner
def write(b, initial, begin, end, n, target):
    """Write the states n of a block; fixed states and the first are copies of the input."""
    for l in range(end - begin):
        k = begin + l
        if (n == 0 or b.eps_input[l] == 0.0) and b.status[l] == OK:
            for i in range(initial.shape[1]):
                target[k, i] = initial[k, i]
        else:
            for i in range(initial.shape[1]):
                target[k, i] = b.omega[i, l] * b.unit[l]


@inner
def leave(b, initial, begin, end, stop, results):
    """Write the last states, in the unit of the input and in those of the lanes."""
    final, status, _, state, exponents = results
    write(b, initial, begin, end, stop, final)
    for l in range(end - begin):
        k = begin + l
        status[k], exponents[k] = b.status[l], b.exponent[l]
        for i in range(initial.shape[1]):
            state[k, i] = b.omega[i, l]


def run_tasks(part, parts, parameters, stretch, saved, turning, results, scratch, matrices):
    """Iterate the trajectories of a part of the tasks.

    parameters   J, I (B, m) or (1, m); eps (B,) or (1,); the states at step 0 (B, m)
    stretch      begin and end of the trajectories; start, stop; every, first_row of `saved`
    saved        (rows, B, m)
    turning      None, or the step size in the unit of time of omega (B,) or (1,); the transposed
                 orientations (B, n, n), updated; turns (rows, B, n, n); scratch (tasks, m, lanes)
                 and (tasks, 2 n + 2, n)
    results      final (B, m); status, failed_at (B,); the states in units of 2**exponent (B, m),
                 and exponent (B,). All but `final` are read if start is not 0.
    scratch      for J and I (tasks, 2, M, lanes), or (tasks, 2, M) if there is only one body;
                 (tasks, 2, M, lanes)
    matrices     (tasks, m, m + 1, lanes), where lanes is WIDTH; None if trajectories that need
                 elimination end with the status NEEDS_ELIMINATION
    """
    first, last, start, stop, every, first_row = stretch
    bodies, states = scratch
    initial, failed_at = parameters[3], results[2]
    tasks, lanes = states.shape[0], states.shape[3]
    blocks = (last - first + lanes - 1) // lanes
    first_task, last_task = share(tasks, part, parts)
    for task in range(first_task, last_task):
        b = block(bodies[task], states[task])
        for number in range(task * blocks // tasks, (task + 1) * blocks // tasks):
            begin = first + number * lanes
            end = min(begin + lanes, last)
            enter(b, parameters, start, results, begin, end)
            n, saved_row, next_saved = start, 0, stop + 1
            if saved.shape[0] > 0:
                saved_row = start // every + 1 - first_row if start > 0 else 0
                next_saved = (start // every + 1) * every if start > 0 else 0
            while True:
                if turning is not None:
                    turn_lanes(b, turning, task, begin, end, n, start)
                if n == next_saved:
                    write(b, initial, begin, end, n, saved[saved_row])
                    if turning is not None:
                        write_turns(turning, begin, end, saved_row)
                    saved_row, next_saved = saved_row + 1, next_saved + every
                if n == stop:
                    break
                until = min(next_saved, stop) if turning is None else n + 1
                while n < until:
                    method.step(b, matrices, task)
                    n += 1
                    if not units_serve(b):
                        renew_units(b, begin, end, n, failed_at)
            leave(b, initial, begin, end, stop, results)


iterate = Kernel(run_tasks, "iterate_nd", method=namespace("rank2", step=step))
iterate_by_elimination = Kernel(
    run_tasks, "iterate_by_elimination", method=namespace("gauss", step=step_by_elimination)
)
