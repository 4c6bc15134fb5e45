"""Steps of a field by elimination with pivoting, for lanes whose list of operations loses digits.

Such a lane solves A(x) x_next = x + (eps/2) l x + eps c, A(x) = 1 - (eps/2) f'(x), where l and c
are the linear and constant parts of the field f.
"""

import math
from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np
from numba import types

from ..numba.arrays import array_at
from ..numba.decorators import c_function, function
from ..numba.gauss import solve
from ..numba.status import CHANGED, OK, PASSED_POLE
from .kahan_step import SIGNIFICANT

ENDED, PASSED = range(2)  # rows of `LineArrays.marks`


@function
def fill_system(indices, half, sign, x, system):
    """Fill A(x), for eps or, if the sign is -1, for -eps; `half` is eps / 2 times the values."""
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
    """Replace x (D,) by the next state, NaN if there is none; return its status, and det A < 0."""
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
    """Return whether a component changes its sign, by more than rounding may."""
    return (x < 0.0 and after > SIGNIFICANT) or (x > 0.0 and after < -SIGNIFICANT)


@function
def changes_sign(indices, x, after):
    """Return whether a component changes its sign that keeps it along the motion.

    It does if each term of its equation contains it; see `kahan_step.of_one_sign`.
    """
    for i in range(len(x)):
        if crosses_0(x[i], after[i]):
            keeps = True
            for t in range(indices.shape[1]):
                if indices[0, t] == i:
                    keeps &= indices[1, t] == i or indices[2, t] == i
            if keeps:
                return True
    return False


class LineArrays(NamedTuple):
    """The arrays of trajectories in lines of W lanes."""

    x: Any  # (lines, D, W)
    halves: Any  # (1 or lines, T, 1 or W), half the step size times the values of the terms
    fractions: Any  # (stages,), of eps
    indices: Any  # (3, T)
    status: Any  # (B,)
    failed_at: Any  # (B,)
    poles: Any  # (B,), the first state beyond a pole, negative if a change of sign told it
    marks: Any  # (2, lines), bits of lanes that have ended, and that have passed a pole or ended
    memory: Any  # (D (D + 4) + T,), and (D + 1) D for columns
    own_D: Any  # components of x, without columns


@function
def take_columns(arrays, line, l, half, after, tangent, units):
    """Multiply the columns of a lane by DPhi, and orthonormalise them, before its state changes."""
    D, x = len(after), arrays.x[line, :, l]
    fill_system(arrays.indices, half, -1.0, after, tangent)
    for i in range(D):
        for r in range(D):
            tangent[i, D + r] = 0.0
            for j in range(D):
                tangent[i, D + r] += tangent[i, j] * x[D * (1 + r) + j]
    fill_system(arrays.indices, half, 1.0, x[:D], tangent)
    solve(tangent, units)
    for r in range(D):
        for s in range(r if len(x) > D * (1 + D) else 0):
            part = 0.0
            for i in range(D):
                part += tangent[i, D + s] * tangent[i, D + r]
            for i in range(D):
                tangent[i, D + r] -= part * tangent[i, D + s]
        length = 1.0
        if len(x) > D * (1 + D):
            square = 0.0
            for i in range(D):
                square += tangent[i, D + r] * tangent[i, D + r]
            length = math.sqrt(square)
            x[D * (1 + D) + r] += math.log(length) if length > 0.0 else -np.inf
        for i in range(D):
            tangent[i, D + r] = tangent[i, D + r] / length if length > 0.0 else 0.0
            x[D * (1 + r) + i] = tangent[i, D + r]


@function
def step_carefully(arrays, first, line, bad, negative, n):
    """Take step n of the lanes of a line whose bits are in `bad`; note failures and poles.

    A step is one stage; steps are counted from state `first` on. Bits in `negative` mark lanes that
    took this step from det A < 0, and from CHANGED on lanes in which a component changed its sign.
    """
    D, W, T = arrays.own_D, arrays.x.shape[2], arrays.halves.shape[1]
    stages = len(arrays.fractions)
    fraction, n = arrays.fractions[n % stages], first + n // stages + 1
    memory, halves = arrays.memory, arrays.halves
    system = memory[: D * (D + 1)].reshape((D, D + 1))
    units = memory[D * (D + 1) : D * (D + 3)].reshape((2, D))
    state, half = memory[D * (D + 3) : D * (D + 4)], memory[D * (D + 4) : D * (D + 4) + T]
    tangent = memory[D * (D + 4) + T :].reshape((D, 2 * D))
    for l in range(W):
        bit, i = 1 << l, line * W + l
        beyond, changed, status = negative & bit != 0, (negative >> CHANGED) & bit != 0, OK
        if bad & bit:
            for j in range(D):
                state[j] = arrays.x[line, j, l]
            for t in range(T):
                half[t] = fraction * halves[line % len(halves), t, l % halves.shape[2]]
            status, beyond = solve_lane(arrays.indices, half, state, system, units)
            if stages == 1:
                changed = changes_sign(arrays.indices, arrays.x[line, :D, l], state)
            if arrays.x.shape[1] > D:
                take_columns(arrays, line, l, half, state, tangent, units)
            for j in range(D):
                arrays.x[line, j, l] = state[j]
        if status != OK:
            arrays.status[i], arrays.failed_at[i] = status, n
            arrays.marks[ENDED, line] |= bit
            arrays.marks[PASSED, line] |= bit
        elif (beyond or changed) and not arrays.marks[PASSED, line] & bit:
            arrays.poles[i] = n if beyond else -n
            arrays.status[i], arrays.failed_at[i] = PASSED_POLE, n
            arrays.marks[PASSED, line] |= bit


# Integers of the array of `pivoting_step`: addresses of `LineArrays`; lengths, of which `own_W` is
# the last one of `halves`; and the number of the state before the first step.
_NUMBERS = ("own_D", "lines", "D", "W", "T", "own_W", "stages", "B", "first")
Arguments = namedtuple("Arguments", (*LineArrays._fields[:-1], *_NUMBERS))
PLACE = Arguments(*range(len(Arguments._fields)))
_COUNT = len(PLACE)


def arguments_of(arrays, first):
    """Return the array for `pivoting_step`; it holds addresses of these `LineArrays`."""
    addresses = [array.ctypes.data for array in arrays[:-1]]
    counts = len(arrays.fractions), len(arrays.status), first
    _, T, own_W = arrays.halves.shape
    return np.array([*addresses, arrays.own_D, *arrays.x.shape, T, own_W, *counts], np.int64)


@c_function(types.void(*[types.int64] * 5))
def pivoting_step(address, line, bad, negative, n):
    """Call `step_carefully` for machine code, with the address of its `Arguments`."""
    a = array_at(address, (_COUNT,), np.int64)
    count, D, W, T, B = a[PLACE.lines], a[PLACE.D], a[PLACE.W], a[PLACE.T], a[PLACE.B]
    own = a[PLACE.own_D]
    shape = count if a[PLACE.own_W] > 1 else 1, T, a[PLACE.own_W]
    lines = LineArrays(
        array_at(a[PLACE.x], (count, D, W), np.float64),
        array_at(a[PLACE.halves], shape, np.float64),
        array_at(a[PLACE.fractions], (a[PLACE.stages],), np.float64),
        array_at(a[PLACE.indices], (3, T), np.int64),
        array_at(a[PLACE.status], (B,), np.int8),
        array_at(a[PLACE.failed_at], (B,), np.int64),
        array_at(a[PLACE.poles], (B,), np.float64),
        array_at(a[PLACE.marks], (2, count), np.uint8),
        array_at(a[PLACE.memory], (own * (3 * own + 4) + T,), np.float64),
        own,
    )
    step_carefully(lines, a[PLACE.first], line, bad, negative, n)
