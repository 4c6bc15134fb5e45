"""Kahan's map of any quadratic field f (theory, section 7), lanes side by side.

x_next = x + eps A(x)**-1 f(x), where A(x) = 1 - (eps/2) f'(x). A field is a list of terms: with one
more component, x_D = 1, all are quadratic, and f_i is the sum of its v x_j x_k, j <= k. So one
kernel serves all fields. Where the increment cancels the state, or elimination loses digits, a lane
solves A(x) x_next = x + (eps/2) l x + eps c, where l and c are the linear and constant parts.

parameters   indices (3, T), the i, j and k of terms; values (1 or B, T); eps (1 or B,)
final        (B, D), the states that a run continues from; there is no carry

A block of lanes is four arrays:

x       (D, lanes)   the states, NaN after the end of a trajectory
a       (D, D + 1, lanes)   A, and minus half the step size times f as the right side
fixed   (D, D + 1, lanes)   the part of `a` that does not depend on the state
half    (T, lanes)   half the step size times v
"""

import numpy as np

from .codes import NONFINITE, OK
from .elimination import TO_SOLVE, accept, eliminate, memory_of_one, solve
from .numba import formula, function, inlined, kernel, lesser, select, share

# A state has lost digits if one component falls below the small part of half its increment, or if
# all fall below the large part.
SMALL_PART, LARGE_PART = 2.0**-10, 2.0**-4


@formula
def lanes_of(D, count):
    """Return how many trajectories go side by side: the matrices stay in the caches."""
    lanes = 128 if D <= 8 else 64 if D <= 24 else 32
    return lesser(lanes, ((count or 1) + 7) // 8 * 8)


@formula
def fill(indices, half, fixed, x, a, begin, lanes):
    """Fill A(x), and in column D minus half the step size times f(x), for lanes from `begin` on."""
    D = len(fixed)
    for i in range(D):
        for j in range(D + 1):
            for l in range(begin, begin + lanes):
                a[i, j, l - begin] = fixed[i, j, l]
    for t in range(indices.shape[1]):
        i, j, k = indices[0, t], indices[1, t], indices[2, t]
        if j < D:  # for k = D a term of f
            for l in range(begin, begin + lanes):
                a[i, k, l - begin] -= half[t, l] * x[j, l]
        if k < D:
            for l in range(begin, begin + lanes):
                a[i, j, l - begin] -= half[t, l] * x[k, l]
            for l in range(begin, begin + lanes):
                a[i, D, l - begin] -= half[t, l] * x[k, l] * x[j, l]


@formula
def next_component(x, half):
    """Return a component of the next state, from minus half its increment; and 0 if it keeps its
    digits, 1 if it loses some, which is accepted unless all components do, else infinity.
    """
    following = x - 2.0 * half
    size, part = abs(following), abs(half)
    loss = select(size >= LARGE_PART * part, 0.0, select(size >= SMALL_PART * part, 1.0, np.inf))
    return following, select(size < np.inf, loss, np.inf)


@inlined
def advance(a, x, b, lanes):
    """Take the step where the next states are finite and accurate; return how many are not."""
    D = len(a)
    eliminate(a, b, lanes)
    for l in range(lanes):
        b[TO_SOLVE, l] = 0.0
    for i in range(D):
        for l in range(lanes):
            a[i, D, l], loss = next_component(x[i, l], a[i, D, l])
            b[TO_SOLVE, l] += loss
    return accept(a, x, b, lanes)


@inlined
def advance_one(indices, x, fixed, half, l, one):
    """Take the step of lane l by `solve`, as in the head of this file; return its status."""
    a, units = one
    D = len(a)
    fill(indices, half, fixed, x, a, l, 1)
    for i in range(D):
        right = x[i, l] - 2.0 * fixed[i, D, l]
        for j in range(D):
            right -= (fixed[i, j, l] - (1.0 if i == j else 0.0)) * x[j, l]
        a[i, D, 0] = right
    status = solve(a, units)
    for i in range(D):
        x[i, l] = a[i, D, 0] if status == OK else np.nan
    return status


@inlined
def advance_failed(indices, x, fixed, half, b, one, begin, end, n, status, failed_at):
    """Take step n in the lanes where `advance` did not; record the trajectories that fail."""
    for l in range(x.shape[1]):
        if b[TO_SOLVE, l] > 0.0:
            code = advance_one(indices, x, fixed, half, l, one)
            if code != OK and begin + l < end:
                status[begin + l], failed_at[begin + l] = code, n


@function
def step_of_one(system, given, out, memory):
    """Write the state that follows `given` to `out`; return its status. For `compiled`."""
    (fixed, half, indices), (block, b, one) = system, memory
    D, x, status = len(fixed), block[0], OK
    for i in range(D):
        x[i, 0] = given[i]
    fill(indices, half, fixed, x, one[0], 0, 1)
    if advance(one[0], x, b, 1) > 0 or np.isnan(given[0]):
        status = advance_one(indices, x, fixed, half, 0, one)
    for i in range(D):
        out[i] = x[i, 0]
    return status


@function
def enter(parameters, x0, x, fixed, half, begin, end, start, status, failed_at):
    """Fill a block with trajectories, fields and step sizes; lanes beyond the last repeat it."""
    indices, values, eps = parameters
    for l in range(x.shape[1]):
        k, undefined = lesser(begin + l, end - 1), 0.0
        for i in range(len(x)):
            x[i, l] = x0[k, i]
            undefined += 0.0 * x[i, l]
            for j in range(len(x) + 1):
                fixed[i, j, l] = 1.0 if i == j else 0.0
        for t in range(len(half)):
            i, j = indices[0, t], indices[1, t]
            half[t, l] = 0.5 * eps[k % len(eps)] * values[k % len(values), t]
            if indices[2, t] == len(x):
                fixed[i, j, l] -= half[t, l]
        if start == 0 and np.isnan(undefined):
            status[k], failed_at[k] = NONFINITE, 0
        for i in range(len(x) if status[k] < 0 else 0):
            x[i, l] = np.nan


@kernel
def steps(part, parts, parameters, omega0, carry, span, saved, final, status, failed_at):
    """Iterate the trajectories of a part, as `steps_3d.steps`."""
    indices = parameters[0]
    first, last, start, stop, every, next_row = span
    T, D = indices.shape[1], omega0.shape[1]
    lanes = lanes_of(D, last - first)
    x, b = np.empty((D, lanes)), np.empty((TO_SOLVE + 1, lanes))
    a, fixed, half = np.empty((D, D + 1, lanes)), np.empty((D, D + 1, lanes)), np.empty((T, lanes))
    one = memory_of_one(D)
    first_block, last_block = share((last - first + lanes - 1) // lanes, part, parts)
    for block in range(first_block, last_block):
        begin, row = first + block * lanes, next_row
        end = lesser(begin + lanes, last)
        states = omega0 if start == 0 else final
        enter(parameters, states, x, fixed, half, begin, end, start, status, failed_at)
        for n in range(start, stop + 1):
            if n > start:
                fill(indices, half, fixed, x, a, 0, lanes)
                if advance(a, x, b, lanes) > 0:
                    advance_failed(
                        indices, x, fixed, half, b, one, begin, end, n, status, failed_at
                    )
            if every > 0 and n % every == 0 and (n > start or start == 0):
                write(x, begin, end, saved[row])
                row += 1
        write(x, begin, end, final)


@function
def write(x, begin, end, target):
    """Write the states of a block to target (B, D)."""
    for l in range(end - begin):
        for i in range(target.shape[1]):
            target[begin + l, i] = x[i, l]
