"""Steps of a field whose digits operations do not keep: one lane at a time, by `solve`.

A lane solves A(x) x_next = x + (eps/2) l x + eps c, where l and c are the linear and constant parts
of the field.
"""

import numpy as np
from numba import carray, types

from .codes import OK, PASSED_POLE
from .elimination import solve
from .generated import BUDGET, COUNT, ENDED, LINES, PASSED, SLOTS, STAGES, X
from .llvm import address_as_pointer
from .numba import c_function, function, inlined

# Slots of a job for `careful`, after those of the machine code, and their number.
(HALVES, FRACTIONS, INDICES, STATUS, FAILED_AT, POLES, MEMORY) = range(SLOTS, SLOTS + 7)
(LANES, D_, T_, FIRST, EACH, ALL) = range(SLOTS + 7, SLOTS + 13)


@function
def fill_system(indices, half, sign, x, system):
    """Fill A(x), for eps or, if the sign is -1, for -eps; `half` is eps / 2 times the values."""
    D = len(x)
    for i in range(D):
        for j in range(D):
            system[i, j, 0] = 1.0 if i == j else 0.0
    for t in range(indices.shape[1]):
        i, j, k, v = indices[0, t], indices[1, t], indices[2, t], sign * half[t]
        if j < D:
            system[i, j, 0] -= v * (x[k] if k < D else 1.0)
        if k < D:
            system[i, k, 0] -= v * x[j]


@function
def solve_lane(indices, half, x, system, units):
    """Take the step from x (D,) by `solve`; x becomes the next state, NaN if there is none.

    Return its status; and whether det A < 0.
    """
    D, negative = len(x), False
    fill_system(indices, half, 1.0, x, system)
    for i in range(D):
        system[i, D, 0] = x[i]
    for t in range(indices.shape[1]):
        i, j, k = indices[0, t], indices[1, t], indices[2, t]
        if k == D:
            system[i, D, 0] += half[t] * x[j] if j < D else 2.0 * half[t]
    status = solve(system, units)
    for i in range(D):
        x[i] = system[i, D, 0] if status == OK else np.nan
        negative ^= system[i, i, 0] < 0.0
    return status, negative


@function
def step_carefully(arrays, first, line, bad, negative, n):
    """Take the steps of the lanes of a line whose bits are in `bad`, by `solve`; note what fails.

    Lanes in `negative` took their step from det A < 0. `n` is the number of the stage, from the
    one after state `first` on.
    """
    x, halves, fractions, indices, status, failed_at, poles, ended, passed, memory = arrays
    D, W, T = x.shape[1], x.shape[2], halves.shape[1]
    stages = len(fractions)
    fraction, n = fractions[n % stages], first + n // stages + 1
    system = memory[: D * (D + 1)].reshape((D, D + 1, 1))
    units = memory[D * (D + 1) : D * (D + 3)].reshape((2, D))
    state, half = memory[D * (D + 3) : D * (D + 4)], memory[D * (D + 4) :]
    for k in range(W):
        bit, i = 1 << k, line * W + k
        beyond, code = negative & bit != 0, OK
        if bad & bit:
            for j in range(D):
                state[j] = x[line, j, k]
            for t in range(T):
                half[t] = fraction * halves[line % len(halves), t, k % halves.shape[2]]
            code, beyond = solve_lane(indices, half, state, system, units)
            for j in range(D):
                x[line, j, k] = state[j]
        if code != OK:
            status[i], failed_at[i] = code, n
            ended[line] |= bit
            passed[line] |= bit
        elif beyond and not passed[line] & bit:
            poles[i] = n
            status[i], failed_at[i] = PASSED_POLE, n
            passed[line] |= bit


@inlined
def _array(address, shape, kind):
    return carray(address_as_pointer(address), shape, kind)


@c_function(types.void(*[types.int64] * 5))
def careful(job, line, bad, negative, n):
    """Call `step_carefully` by addresses, for machine code whose steps are not good."""
    a = _array(job, (ALL,), np.int64)
    lines, stages, B, each = a[LINES], a[STAGES], a[COUNT], a[EACH]
    D, T, W = a[D_], a[T_], a[LANES]
    arrays = (
        _array(a[X], (lines, D, W), np.float64),
        _array(a[HALVES], (lines if each else 1, T, W if each else 1), np.float64),
        _array(a[FRACTIONS], (stages,), np.float64),
        _array(a[INDICES], (3, T), np.int64),
        _array(a[STATUS], (B,), np.int8),
        _array(a[FAILED_AT], (B,), np.int64),
        _array(a[POLES], (B,), np.float64),
        _array(a[ENDED], (lines,), np.uint8),
        _array(a[PASSED], (lines,), np.uint8),
        _array(a[MEMORY], (D * (D + 4) + T,), np.float64),
    )
    a[BUDGET] -= 1
    step_carefully(arrays, a[FIRST], line, bad, negative, n)
