"""The n-dimensional map, for `blocks_nd`, in the symbols of `_formulas.nd_map`.

A step in O(n) is `sums`, `solve`, `add_increment` and `measure`. In lanes where `solve` is
inaccurate, as where a d is small, `repair` takes the step by elimination: `eliminate_lanes`, and
`solve_lane` where that is inaccurate, too. After that, `settle` ends lanes or renews their units.
States have m = n - 1 components, and arrays of a block M rows: m, and if m is odd one more
component, with J = infinity and I = omega = 0.

parameters   J, I (B, m) or (1, m); eps (B,) or (1,); the states at step 0 (B, m)
results      those of `blocks_nd`, with the states in units of 2**exponent, and exponent (B,)
memory       for J and I (tasks, 2, M, lanes), or (tasks, 2, M) of a single body if there are
             neither matrices nor orientations; for omega and 1 / d (tasks, 2, M, lanes); and for
             matrices (tasks, m, m + 1, lanes), or None if trajectories that need elimination end
             with the status NEEDS_ELIMINATION

Lanes store J, I and omega in units, powers of two, in which they are of the order of 1; that of
omega changes when omega leaves this range. Lanes that have ended have the state 0 in the unit NaN.
"""

from typing import NamedTuple

import numpy as np

from .._formulas.elementary import exponent, larger, scaled, smaller, two_to_the
from .._formulas.nd_map import (
    FAR_FROM_0,
    SMALL_STEP,
    bounds,
    matrix_row,
    next_component,
    slope_of_itself,
    solve2,
    sum_terms,
)
from .._jit import formula, inlined, inner, rows_of, select, stack
from .codes import NEEDS_ELIMINATION, NONFINITE, OK, SINGULAR
from .elimination import ACCURATE, WIDTH, eliminate
from .one_system import solve_system
from .units_nd import unit_of, unit_of_moments

# Trajectories of a block, at most: enough to prevent sums over components from stalling on memory
# just written. Blocks of a run that eliminates have `elimination.WIDTH`.
LANES_ND = 64
# Outcomes in a lane.
SOLVED = 0.0  # the increment of `solve2` is accurate
SOLVED_IF_FAR = 1.0  # the same, provided that no d is small
OPEN = 2.0  # neither
# Rounding errors that a |d| / J below this amplifies are removed, see `project`.
NEARLY_0 = 2.0**-10


class Components(NamedTuple):
    """Arrays of M components of each lane."""

    J: object  # (M, lanes), or (M,) if common to all lanes
    I: object
    omega: object  # (M, lanes)
    inverse: object  # 1 / d
    elimination: object  # of all tasks, or None, see `memory`
    task: int


class Lanes(NamedTuple):
    """Numbers of each lane."""

    eps_input: object  # 0 if all states are fixed
    body_exponent: object  # of the unit of I / J
    near: (
        object  # (1 - FAR_FROM_0) times the least J: d is far from 0 where eps p / 2 is below this
    )
    reach: object  # see `bounds`
    eps: object  # in the unit of omega; 0 for fixed states and ended lanes
    exponent: object  # of the unit of omega
    unit: object  # 2**exponent; NaN if the lane has ended
    longest: object  # this, `low` and `high` are bounds of |omega|**2, see `bounds`
    low: object
    high: object
    status: object  # of trajectories that have ended, else OK
    p: object  # I . omega
    square: object  # |omega|**2
    half: object  # eps p / 2
    alpha: object  # these three are the sums of `solve2`
    beta: object
    gamma: object
    of_omega: object  # this and `of_I` are the factors in delta, see `solve2`
    of_I: object
    outcome: object  # SOLVED, SOLVED_IF_FAR or OPEN
    ratio: object  # of pivots, see `eliminate`


@inlined
def block(parameters, memory, task):
    """Return the components, in the memory of a task, and the numbers of a block."""
    bodies, states, elimination = memory
    body, state = bodies[task], states[task]
    c = Components(body[0], body[1], state[0], state[1], elimination, task)
    return c, rows_of(Lanes, LANES_ND)


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
def advance(c, b, begin):
    """Make a step in O(n)."""
    sums(c, b)
    if not solve(c, b):
        repair(c, b, c.elimination)
    add_increment(c, b)
    measure(c, b)
    return units_fit(c, b)


@formula
def advance_by_elimination(c, b, begin):
    """Make a step by elimination."""
    for l in range(c.omega.shape[1]):
        b.half[l], b.outcome[l] = 0.5 * b.eps[l] * b.p[l], OPEN
    eliminate_lanes(c, b)
    measure(c, b)
    return units_fit(c, b)


@formula
def sums(c, b):
    """Find 1 / d and the sums of `solve2`.

    Terms i and M/2 + i are added in pairs, which halves the stores. (At 2 i and 2 i + 1 LLVM would
    test for each i whether written rows overlap others.)
    """
    half, lanes = c.omega.shape[0] // 2, c.omega.shape[1]
    for l in range(lanes):
        b.half[l] = 0.5 * b.eps[l] * b.p[l]
        b.alpha[l], b.beta[l], b.gamma[l] = 0.0, 0.0, 0.0
    for i in range(half):
        j = half + i
        for l in range(lanes):
            r_i, alpha_i, beta_i, gamma_i = sum_terms(
                at(c.J, i, l), at(c.I, i, l), c.omega[i, l], b.half[l]
            )
            r_j, alpha_j, beta_j, gamma_j = sum_terms(
                at(c.J, j, l), at(c.I, j, l), c.omega[j, l], b.half[l]
            )
            c.inverse[i, l], c.inverse[j, l] = r_i, r_j
            # Not +=, which adds the terms to each other first.
            b.alpha[l] = b.alpha[l] + alpha_i + alpha_j
            b.beta[l] = b.beta[l] + beta_i + beta_j
            b.gamma[l] = b.gamma[l] + gamma_i + gamma_j


@formula
def solve(c, b):
    """Solve for the factors in the increment; return True if it is accurate in all lanes."""
    unsolved = 0  # an integer: a sum of floats is one addition after the other
    for l in range(c.omega.shape[1]):
        of_omega, of_I, det, size = solve2(
            b.eps[l], b.p[l], b.square[l], b.alpha[l], b.beta[l], b.gamma[l]
        )
        accurate = (det > FAR_FROM_0 * FAR_FROM_0 * size) & (b.square[l] < b.longest[l])
        solved = accurate & (b.half[l] < b.near[l])
        unsolved += select(solved, 0, 1)
        b.outcome[l] = select(solved, SOLVED, select(accurate, SOLVED_IF_FAR, OPEN))
        b.of_omega[l], b.of_I[l] = of_omega, of_I
    return unsolved == 0


@formula
def add_increment(c, b):
    """Add the increment."""
    M, lanes = c.omega.shape
    for i in range(M):
        for l in range(lanes):
            c.omega[i, l] = next_component(
                at(c.I, i, l), c.omega[i, l], c.inverse[i, l], b.of_omega[l], b.of_I[l]
            )


@formula
def measure(c, b):
    """Find p and |omega|**2."""
    half, lanes = c.omega.shape[0] // 2, c.omega.shape[1]
    for l in range(lanes):
        b.p[l], b.square[l] = 0.0, 0.0
    for i in range(half):
        j = half + i
        for l in range(lanes):
            w_i, w_j = c.omega[i, l], c.omega[j, l]
            b.p[l] = b.p[l] + at(c.I, i, l) * w_i + at(c.I, j, l) * w_j
            b.square[l] = b.square[l] + w_i * w_i + w_j * w_j


@inner
def repair(c, b, elimination):
    """Take the step in lanes that are not solved, and set the increments that are added to 0.

    Without memory for elimination, trajectories that need it end; another driver restarts them.
    `elimination` is an argument of its own so that Numba removes the branches for None.
    """
    M, lanes = c.omega.shape
    any_open = False
    for l in range(lanes):
        if b.outcome[l] == SOLVED_IF_FAR:
            b.outcome[l] = SOLVED
            for i in range(M):
                if abs(1.0 - b.half[l] / at(c.J, i, l)) <= FAR_FROM_0:
                    b.outcome[l] = OPEN
        any_open |= b.outcome[l] == OPEN
    if elimination is None:
        for l in range(lanes):
            if b.outcome[l] == OPEN:
                # By NaN `units_fit` fails, and `settle` ends the lane.
                b.status[l], c.omega[0, l] = NEEDS_ELIMINATION, np.nan
    elif any_open:
        eliminate_lanes(c, b)
    for l in range(lanes):
        if b.outcome[l] == OPEN:
            b.of_omega[l], b.of_I[l] = 0.0, 0.0
            for i in range(M):
                c.inverse[i, l] = 0.0


@inner
def eliminate_lanes(c, b):
    """Take the step by elimination in open lanes."""
    matrix = c.elimination[0][c.task]
    m, _, lanes = matrix.shape
    fill_lanes(c, b)
    eliminate(matrix, b.ratio)
    inaccurate = 0
    for l in range(WIDTH):  # a constant; to `lanes`, the loop took a third of a step for small m
        inaccurate += select((b.ratio[l] > ACCURATE) | (b.outcome[l] != OPEN), 0, 1)
    for i in range(m):
        for l in range(lanes):
            solved = (b.outcome[l] == OPEN) & (b.ratio[l] > ACCURATE)
            c.omega[i, l] = select(solved, matrix[i, m, l], c.omega[i, l])
    if inaccurate > 0:
        fill_lanes(c, b)
        for l in range(lanes):
            if b.outcome[l] == OPEN and not b.ratio[l] > ACCURATE:
                solve_lane(c, b, l)


@inner
def solve_lane(c, b, l):
    """Take the step in a lane by `solve_system`."""
    matrix, system = c.elimination[0][c.task], c.elimination[1][c.task]
    m = len(matrix)
    for i in range(m):
        for j in range(m + 1):
            system[0, i, j] = matrix[i, j, l]
    solve_system(system, c.elimination[2][c.task])
    for i in range(m):
        if abs(1.0 - b.half[l] / c.J[i, l]) < NEARLY_0:
            project(c, l, system[0], i)
    for i in range(m):
        c.omega[i, l] = system[0, i, m]


@inner
def project(c, l, system, i):
    """Project the next components whose J is J_i, if i is the first of three or more, to the plane
    of those of I and omega, where they lie; A is nearly singular across it if d is small.
    """
    m, count = len(system), 0
    II, Iw, Ix, ww, wx = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(m):
        if c.J[j, l] == c.J[i, l]:
            count = count + 1 if j >= i else -m
            II += c.I[j, l] * c.I[j, l]
            Iw += c.I[j, l] * c.omega[j, l]
            Ix += c.I[j, l] * system[j, m]
    if count > 2:
        of_I, along = (Iw / II, Ix / II) if II > 0.0 else (0.0, 0.0)
        for turn in range(2):
            for j in range(m):
                if c.J[j, l] == c.J[i, l]:
                    w = c.omega[j, l] - of_I * c.I[j, l]
                    if turn == 0:
                        ww += w * w
                        wx += w * system[j, m]
                    else:
                        system[j, m] = along * c.I[j, l] + (wx / ww * w if ww > 0.0 else 0.0)


@inner
def fill_lanes(c, b):
    """Fill A(omega), and omega as the right side."""
    matrix = c.elimination[0][c.task]
    m, _, lanes = matrix.shape
    of_omega, of_I, others = stack(LANES_ND), stack(LANES_ND), stack(LANES_ND)
    for i in range(m):
        for l in range(lanes):
            of_omega[l], of_I[l] = matrix_row(c.J[i, l], c.I[i, l], c.omega[i, l], b.eps[l])
            others[l], matrix[i, m, l] = 0.0, c.omega[i, l]
        for j in range(m):
            if j != i:
                for l in range(lanes):
                    I_j, w_j = c.I[j, l], c.omega[j, l]
                    matrix[i, j, l] = -of_omega[l] * w_j - of_I[l] * I_j
                    others[l] = others[l] + I_j * w_j
        for l in range(lanes):
            matrix[i, i, l] = 1.0 - slope_of_itself(c.J[i, l], others[l], b.eps[l])


@formula
def units_fit(c, b):
    """Return True if all states are finite and in the range of their units."""
    outside = 0
    for l in range(c.omega.shape[1]):
        outside += select((b.square[l] > b.low[l]) & (b.square[l] < b.high[l]), 0, 1)
    return outside == 0


@inner
def settle(c, b, n, results, begin, end):
    """End lanes whose state n is not finite, and renew the units of those that need it."""
    failed_at = results[2]
    for l in range(c.omega.shape[1]):
        if not (b.low[l] < b.square[l] < b.high[l]):
            largest, undefined, infinite = 0.0, False, False
            for i in range(c.omega.shape[0]):
                size = abs(c.omega[i, l])
                undefined |= size != size
                infinite |= size * b.unit[l] == np.inf
                largest = larger(size, largest)
            if (undefined or infinite) and b.status[l] == OK:
                # NaN from finite terms is a pole, otherwise an overflow.
                finite = b.half[l] - b.half[l] == 0.0
                b.status[l] = SINGULAR if undefined and finite else NONFINITE
            if b.status[l] != OK and begin + l < end and failed_at[begin + l] < 0:
                failed_at[begin + l] = n
            take_unit(c, b, l, unit_of_state(largest, b.exponent[l]))
    measure(c, b)


@formula
def unit_of_state(largest, before):
    """Return the exponent of the unit of a state whose largest component is largest 2**before."""
    power = select((largest > 0.0) & (largest < np.inf), exponent(largest) + 1.0, 0.0)
    return larger(smaller(power + before, 1023.0), -1022.0)


@formula
def take_unit(c, b, l, power):
    """Change a lane to the unit 2**power, or to the state 0 if its trajectory has ended."""
    change, ended = b.exponent[l] - power, b.status[l] != OK
    unit, largest = two_to_the(power), 0.0
    for i in range(c.omega.shape[0]):
        c.omega[i, l] = 0.0 if ended else scaled(c.omega[i, l], change)
        largest = larger(abs(c.omega[i, l]), largest)
    b.exponent[l], b.unit[l] = power, np.nan if ended else unit
    b.eps[l] = 0.0 if ended else scaled(b.eps_input[l], power + b.body_exponent[l])
    b.longest[l], b.low[l], b.high[l] = bounds(b.reach[l], b.eps[l], largest, unit)


@formula
def enter_body(c, b, l, J, I, eps):
    """Enter a body and a step size, for which 0 is stored if every state is fixed."""
    exponent_J = unit_of_moments(J)
    exponent_I = unit_of(I, exponent_J)
    factor_J, factor_I = two_to_the(-exponent_J), two_to_the(-exponent_I)
    smallest, I_square = np.inf, 0.0
    for i in range(c.omega.shape[0]):
        J_i, I_i = np.inf, 0.0
        if i < J.size:
            J_i, I_i = J[i] * factor_J, I[i] * factor_I
        set_at(c.J, i, l, J_i)
        set_at(c.I, i, l, I_i)
        smallest = smaller(J_i, smallest)
        I_square += I_i * I_i
    b.near[l], b.reach[l] = (1.0 - FAR_FROM_0) * smallest, SMALL_STEP * smallest / np.sqrt(I_square)
    b.eps_input[l] = 0.0 if I_square == 0.0 else eps
    b.body_exponent[l] = exponent_I - exponent_J


@inner
def enter(c, b, parameters, start, results, begin, end):
    """Enter trajectories at state `start`; lanes beyond the last repeat it."""
    J, I, eps, initial = parameters
    _, status, failed_at, state, exponents = results
    for l in range(c.omega.shape[1]):
        k = min(begin + l, end - 1)
        enter_body(c, b, l, J[min(k, len(J) - 1)], I[min(k, len(I) - 1)], eps[min(k, eps.size - 1)])
        largest, undefined = 0.0, False
        for i in range(c.omega.shape[0]):
            w = 0.0
            if i < initial.shape[1]:
                w = initial[k, i] if start == 0 else state[k, i]
            c.omega[i, l] = w
            largest = larger(abs(w), largest)
            undefined |= w != w
        if start == 0:
            # A trajectory whose state 0 is NaN ends at step 0.
            status[k], failed_at[k] = (NONFINITE, 0) if undefined else (OK, -1)
            exponents[k] = unit_of_state(largest, 0.0)
        b.status[l] = status[k] if failed_at[k] >= 0 else OK
        b.exponent[l] = 0.0 if start == 0 else exponents[k]  # the input is in the unit 1
        take_unit(c, b, l, exponents[k])
    measure(c, b)


@inner
def write(c, b, parameters, begin, end, n, target):
    """Write the states n; fixed states and the first are copies of the input."""
    initial = parameters[3]
    for l in range(end - begin):
        k = begin + l
        if (n == 0 or b.eps_input[l] == 0.0) and b.status[l] == OK:
            for i in range(initial.shape[1]):
                target[k, i] = initial[k, i]
        else:
            for i in range(initial.shape[1]):
                target[k, i] = c.omega[i, l] * b.unit[l]


@inner
def leave(c, b, results, begin, end):
    """Write the states in the units of the lanes, and statuses."""
    _, status, _, state, exponents = results
    for l in range(end - begin):
        k = begin + l
        status[k], exponents[k] = b.status[l], b.exponent[l]
        for i in range(state.shape[1]):
            state[k, i] = c.omega[i, l]
