"""Steps of a field by elimination with pivoting, for lanes in which the usual program loses digits.

Such a lane solves A(x) x_next = x + (eps/2) l x + eps c, A(x) = 1 - (eps/2) f'(x), where l and c
are the linear and constant parts of the field f. Functions take f as arrays `indices` (3, T), which
are i, j and k of the terms v x_j x_k of f_i, and `half` (T,), which are eps v / 2.
"""

import math
from typing import NamedTuple

import numpy as np

from ..numba.arrays import array_at
from ..numba.decorators import c_function, function
from ..numba.gauss import solve
from ..numba.status_codes import CHANGED, OK, PASSED_POLE
from .tolerances import LEAST_WITH_SIGN

ENDED, PASSED = range(2)  # rows of `LineArguments.marks`


@function
def fill_system(indices, half, sign, x, system):
    """Fill the first D columns of `system` with the matrix 1 - sign (eps / 2) f'(x)."""
    D = len(x)
    for i in range(D):
        for j in range(D):
            system[i, j] = 1.0 if i == j else 0.0
    for t in range(indices.shape[1]):
        i, j, k, v = indices[0, t], indices[1, t], indices[2, t], sign * half[t]
        if j < D:
            system[i, j] -= v * (x[k] if k < D else 1.0)
        if k < D:
            system[i, k] -= v * x[j]


@function
def solve_lane(indices, half, x, system, units):
    """Replace x by x_next, NaN if there is none; return the status, and True if det A < 0."""
    D, negative = len(x), False
    fill_system(indices, half, 1.0, x, system)
    for i in range(D):
        system[i, D] = x[i]
    for t in range(indices.shape[1]):
        i, j, k = indices[0, t], indices[1, t], indices[2, t]
        if k == D:
            system[i, D] += half[t] * x[j] if j < D else 2.0 * half[t]
    status = solve(system, units)
    for i in range(D):
        x[i] = system[i, D] if status == OK else np.nan
        negative ^= system[i, i] < 0.0
    return status, negative


@function
def crosses_0(x, after):
    """Return True if a component changes its sign from x to `after`, by more than rounding."""
    return (x < 0.0 and after > LEAST_WITH_SIGN) or (x > 0.0 and after < -LEAST_WITH_SIGN)


@function
def changes_sign(indices, x, after):
    """Return True if an x_i changes its sign in a step, although all terms of f_i contain it."""
    for i in range(len(x)):
        if crosses_0(x[i], after[i]):
            keeps = True
            for t in range(indices.shape[1]):
                if indices[0, t] == i:
                    keeps &= indices[1, t] == i or indices[2, t] == i
            if keeps:
                return True
    return False


@function
def take_columns(indices, half, x, after, tangent, units):
    """Multiply the columns in x by the derivative of the step to `after`; orthonormalise them.

    x is the state before the step, with the columns and sums of an `ExtendedStep`. `tangent`
    (D, 2 D) and `units` (2, D) are memory.
    """
    D = len(after)
    fill_system(indices, half, -1.0, after, tangent)
    for i in range(D):
        for r in range(D):
            tangent[i, D + r] = 0.0
            for j in range(D):
                tangent[i, D + r] += tangent[i, j] * x[D * (1 + r) + j]
    fill_system(indices, half, 1.0, x[:D], tangent)
    solve(tangent, units)
    for r in range(D):
        for s in range(r):
            part = 0.0
            for i in range(D):
                part += tangent[i, D + s] * tangent[i, D + r]
            for i in range(D):
                tangent[i, D + r] -= part * tangent[i, D + s]
        square = 0.0
        for i in range(D):
            square += tangent[i, D + r] * tangent[i, D + r]
        length = math.sqrt(square)
        x[D * (1 + D) + r] += math.log(length) if length > 0.0 else -np.inf
        for i in range(D):
            tangent[i, D + r] = tangent[i, D + r] / length if length > 0.0 else 0.0
            x[D * (1 + r) + i] = tangent[i, D + r]


class LineArguments(NamedTuple):
    """The integers of the array that `pivoting_step` takes: addresses of arrays, and lengths."""

    x: int  # (lines, D, W), states
    halves: int  # (sets, T, of_set), half the step size times the values of the terms
    fractions: int  # (stages,), step sizes of stages as fractions of eps
    indices: int  # (3, T), i, j and k of the terms
    status: int  # (B,)
    failed_at: int  # (B,)
    poles: int  # (B,), number n of the first state beyond a pole, -n if only a sign changed, else 0
    marks: int  # (2, lines), bits of lanes that have ended, and that have passed a pole or ended
    memory: int  # (state_D (3 state_D + 4) + T,), workspace for one lane
    lines: int
    D: int
    W: int
    sets: int  # `lines` if each lane has its own parameters, else 1
    T: int
    of_set: int  # W if each lane has its own parameters, else 1
    stages: int
    B: int
    state_D: int  # number of components without columns of derivatives; D counts these, too
    first: int  # number of the state before the first step


PLACE = LineArguments(*range(len(LineArguments._fields)))
_COUNT = len(PLACE)


def arguments_of(arrays, state_D, first):
    """Return `LineArguments` as an array: the addresses of `arrays`, and the other fields."""
    x, halves, fractions, _, status, *_ = arrays
    lengths = *x.shape, *halves.shape, len(fractions), len(status), state_D, first
    return np.array([*(array.ctypes.data for array in arrays), *lengths], np.int64)


@c_function
def pivoting_step(address, line, bad, signs, n):
    """Take stage n of the lanes of a line with bits in `bad`; record failures and poles of all.

    `address` is that of the `LineArguments`. `signs` of the other lanes are from `take_rare`.
    """
    a = array_at(address, (_COUNT,), np.int64)
    lines, W, T = a[PLACE.lines], a[PLACE.W], a[PLACE.T]
    stages, D = a[PLACE.stages], a[PLACE.state_D]
    x = array_at(a[PLACE.x], (lines, a[PLACE.D], W), np.float64)
    halves = array_at(a[PLACE.halves], (a[PLACE.sets], T, a[PLACE.of_set]), np.float64)
    fractions = array_at(a[PLACE.fractions], (stages,), np.float64)
    indices = array_at(a[PLACE.indices], (3, T), np.int64)
    statuses = array_at(a[PLACE.status], (a[PLACE.B],), np.int8)
    failed_at = array_at(a[PLACE.failed_at], (a[PLACE.B],), np.int64)
    poles = array_at(a[PLACE.poles], (a[PLACE.B],), np.float64)
    marks = array_at(a[PLACE.marks], (2, lines), np.uint8)
    memory = a[PLACE.memory]
    system = array_at(memory, (D, D + 1), np.float64)
    units = array_at(memory + 8 * D * (D + 1), (2, D), np.float64)
    state = array_at(memory + 8 * D * (D + 3), (D,), np.float64)
    half = array_at(memory + 8 * D * (D + 4), (T,), np.float64)
    tangent = array_at(memory + 8 * (D * (D + 4) + T), (D, 2 * D), np.float64)
    fraction = fractions[n % stages]
    n = a[PLACE.first] + n // stages + 1
    for l in range(W):
        bit, i = 1 << l, line * W + l
        beyond = signs & bit != 0
        changed = (signs >> CHANGED) & bit != 0
        status = OK
        if bad & bit:
            for j in range(D):
                state[j] = x[line, j, l]
            for t in range(T):
                half[t] = fraction * halves[line % len(halves), t, l % halves.shape[2]]
            status, beyond = solve_lane(indices, half, state, system, units)
            changed = changes_sign(indices, x[line, :D, l], state)
            if x.shape[1] > D:
                take_columns(indices, half, x[line, :, l], state, tangent, units)
            for j in range(D):
                x[line, j, l] = state[j]
        if status != OK:
            statuses[i] = status
            failed_at[i] = n
            marks[ENDED, line] |= bit
            marks[PASSED, line] |= bit
        elif (beyond or changed) and not marks[PASSED, line] & bit:
            poles[i] = n if beyond else -n
            statuses[i] = PASSED_POLE
            failed_at[i] = n
            marks[PASSED, line] |= bit
