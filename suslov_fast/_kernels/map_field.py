"""Kahan's map of any quadratic field, for `blocks_nd`: x_next = x + eps A(x)**-1 f(x).

A(x) = 1 - (eps/2) f'(x). A field is a list of its nonzero terms, so that one build serves all
fields. With one more component, x_D = 1, all terms are quadratic: f_i has the terms v x_j x_k.

Lanes store x in a unit of length 2**k, in which products of coefficients, step size and states are
in range if their result is. Lanes that have ended have the state 0 in the unit NaN.

parameters   indices (3, T), i, j and k, where j <= k, and those with k = D are last; values (T,) of
             v for a single field, or (T, B) for a batch, B a multiple of WIDEST; the step size, and
             the largest absolute value of a quadratic coefficient, (B,) or (1,); the states at
             step 0, (B, D)
memory       for equations (tasks, 2, D, D + 1, lanes), for states (tasks, 2, D, lanes), and for
             `solve_system` (tasks, 2, D, D + 1) and (tasks, 2, D)
"""

from typing import NamedTuple

import numpy as np

from .._formulas.elementary import exponent, larger, scaled, within
from .._jit import LINE, formula, inlined, inner, rows_of, select, subtract_product
from .codes import NONFINITE, OK
from .elimination import ACCURATE, WIDEST, eliminate
from .lanes import entry
from .one_system import solve_system

# States whose components add up to less than this are finite.
LARGEST_SUM = 1e307
# |eps q| lies between the inverse of 2 to this power and that power, where q is the largest
# quadratic coefficient: products of eps, q and states are in range if eps q x is.
FAR = 500.0
# A component that falls below this part of its increment has lost digits.
CANCELLED = 2.0**-10


class FieldComponents(NamedTuple):
    """The field, states (D, lanes), and the equations of a step."""

    indices: object  # see above
    values: object
    x: object  # the states
    after: object  # the next states
    slopes: object  # half the step size times the terms with k = D, (D, D + 1, lanes)
    matrix: object  # A, and minus half the step size times f as the right side
    system: object  # scratch of `solve_system`
    scales: object


class FieldLanes(NamedTuple):
    """Numbers of each lane."""

    half: object  # half the step size times the unit of length
    unit: object
    bound: object  # LARGEST_SUM in the unit of length
    size: object  # the sum of the absolute values of the components of the next state
    lost: object  # above 0 if a component is cancelled by its increment
    factor: object
    ratio: object  # of pivots, see `eliminate`


@inlined
def block(parameters, memory, task):
    """Return a block whose components are in the memory of a task."""
    (indices, values, _, _, _), (equations, states, systems, all_scales) = parameters, memory
    x, after, slopes = states[task, 0], states[task, 1], equations[task, 0]
    matrix, system, scales = equations[task, 1], systems[task], all_scales[task]
    c = FieldComponents(indices, values, x, after, slopes, matrix, system, scales)
    return c, rows_of(FieldLanes, WIDEST)


@formula
def unit_of_length(eps, q):
    """Return k, 0 unless |eps q| is out of range with it: quadratic coefficients are multiplied by
    2**k, and constant ones by 2**-k.
    """
    size = exponent(eps) + exponent(q)
    return select((eps != 0.0) & (q != 0.0), within(size, FAR) - size, 0.0)


@formula
def value(values, t, i):
    """Return the coefficient of term t for trajectory i."""
    return values[t] if values.ndim == 1 else values[t, i]


@formula
def advance(c, b, begin):
    """Make a step."""
    fill_lanes(c, b, begin)
    eliminate(c.matrix, b.ratio)
    if fill_next_states(c, b) > 0:
        return False
    take(c)
    return True


@inlined
def fill_lanes(c, b, begin):
    """Fill the equations of a step."""
    indices, values, matrix, x = c.indices, c.values, c.matrix, c.x
    D, _, width = matrix.shape
    for i in range(D):
        for j in range(D + 1):
            unit = 1.0 if i == j else 0.0
            for l in range(width):
                matrix[i, j, l] = unit - c.slopes[i, j, l]
    for t in range(len(values)):
        i, j, k = indices[0, t], indices[1, t], indices[2, t]
        if k < D:
            for l in range(width):
                b.factor[l] = b.half[l] * value(values, t, begin + l)
            for l in range(0, width, LINE):
                subtract_product(matrix, (i, j, l), b.factor, (l,), x, (k, l))
                subtract_product(matrix, (i, k, l), b.factor, (l,), x, (j, l))
            for l in range(width):
                b.factor[l] *= x[k, l]
            for l in range(0, width, LINE):
                subtract_product(matrix, (i, D, l), b.factor, (l,), x, (j, l))
        elif j < D:
            for l in range(0, width, LINE):
                subtract_product(matrix, (i, D, l), c.slopes, (i, j, l), x, (j, l))


@formula
def after_increment(x, half):
    """Return the sum of a component and its increment, minus twice `half`; -0.0 remains."""
    return select(half == 0.0, x, x - 2.0 * half)


@inlined
def fill_next_states(c, b):
    """Fill the next states; return how many are not finite, or not accurate."""
    D, width = c.x.shape
    for l in range(width):
        b.size[l], b.lost[l] = 0.0, 0.0
    for i in range(D):
        for l in range(width):
            half = c.matrix[i, D, l]
            c.after[i, l] = after_increment(c.x[i, l], half)
            size = abs(c.after[i, l])
            b.size[l] += size
            b.lost[l] = larger(CANCELLED * abs(half) - size, b.lost[l]) + 0.0
    failed = 0
    for l in range(width):
        failed += select(is_accurate(b, l), 0, 1)
    return failed


@formula
def is_accurate(b, l):
    """Test that a next state is finite, and that neither elimination nor the sums of components and
    their increments lose digits.
    """
    return (b.size[l] <= b.bound[l]) & (b.lost[l] <= 0.0) & (b.ratio[l] > ACCURATE)


@inlined
def take(c):
    """Go on to the next states."""
    for i in range(c.x.shape[0]):
        for l in range(c.x.shape[1]):
            c.x[i, l] = c.after[i, l]


@inner
def settle(c, b, n, results, begin, end):
    """Solve one by one for next states that are not accurate, and end lanes without one."""
    _, status, failed_at, _ = results
    D = len(c.x)
    for l in range(c.x.shape[1]):
        if not is_accurate(b, l):
            x, slopes, matrix, size = c.x[:, l], c.slopes[:, :, l], c.system[0], 0.0
            fill_equations(c.indices, c.values, begin + l, b.half[l], slopes, x, matrix)
            fill_next(slopes, x, matrix)
            # Not in a function of its own, which LLVM would optimise once more.
            code = solve_system(c.system, c.scales)
            for i in range(D):
                c.after[i, l] = matrix[i, D]
                size += abs(c.after[i, l])
            if not size <= b.bound[l]:
                if begin + l < end:
                    status[begin + l] = code if code != OK else NONFINITE
                    failed_at[begin + l] = n
                stop(c, b, l)
    take(c)


@inlined
def fill_equations(indices, values, number, half, slopes, x, matrix):
    """Fill A(x) of trajectory `number`, and minus half the step size times f(x) as right side."""
    D = len(x)
    for i in range(D):
        right = -slopes[i, D]
        for j in range(D):
            matrix[i, j] = -slopes[i, j]
            right -= slopes[i, j] * x[j]
        matrix[i, i] += 1.0
        matrix[i, D] = right
    for t in range(len(values)):
        i, j, k = indices[0, t], indices[1, t], indices[2, t]
        if k < D:
            factor = half * value(values, t, number)
            matrix[i, j] -= factor * x[k]
            matrix[i, k] -= factor * x[j]
            matrix[i, D] -= factor * x[k] * x[j]


@inlined
def fill_next(slopes, x, matrix):
    """Fill the right side of A x_next = x + (eps/2) l x + eps c, whose solution no increment
    cancels.
    """
    D = len(x)
    for i in range(D):
        matrix[i, D] = x[i] + 2.0 * slopes[i, D]
        for j in range(D):
            matrix[i, D] += slopes[i, j] * x[j]


@inner
def stop(c, b, l):
    """End a trajectory: from now on it rests at 0, which is written as NaN."""
    b.half[l], b.unit[l], b.bound[l] = 0.0, np.nan, np.inf
    for i in range(c.x.shape[0]):
        c.x[i, l], c.after[i, l] = 0.0, 0.0
        for j in range(c.x.shape[0] + 1):
            c.slopes[i, j, l] = 0.0


@inner
def enter(c, b, parameters, start, results, begin, end):
    """Enter trajectories at state `start`; lanes beyond the last repeat it."""
    indices, values, eps, largest, initial = parameters
    _, status, failed_at, state = results
    D, width = c.x.shape
    for l in range(width):
        stop(c, b, l)
        k = min(begin + l, end - 1)
        half, undefined = 0.5 * entry(eps, k), False
        power = unit_of_length(2.0 * half, entry(largest, k))
        for i in range(D):
            c.x[i, l] = scaled(initial[k, i], -power) if start == 0 else state[k, i]
            undefined |= c.x[i, l] != c.x[i, l]
        if start == 0 and begin + l < end:
            # A trajectory whose state 0 is NaN ends at step 0.
            status[k], failed_at[k] = (NONFINITE, 0) if undefined else (OK, -1)
        if status[k] < 0:
            stop(c, b, l)
            continue
        b.half[l], b.unit[l] = scaled(half, power), scaled(1.0, power)
        b.bound[l] = scaled(LARGEST_SUM, -power)
        for t in range(len(values)):
            j = indices[1, t]
            if indices[2, t] == D:
                of_term = scaled(half, -power) if j == D else half
                c.slopes[indices[0, t], j, l] = of_term * value(values, t, begin + l)


@inner
def write(c, b, parameters, begin, end, n, target):
    """Write the states n; the first are copies of the input."""
    initial = parameters[4]
    for l in range(end - begin):
        k = begin + l
        for i in range(initial.shape[1]):
            target[k, i] = initial[k, i] if n == 0 else c.x[i, l] * b.unit[l]


@inner
def leave(c, b, results, begin, end):
    """Write the states in the units of lanes."""
    state = results[3]
    for l in range(end - begin):
        for i in range(state.shape[1]):
            state[begin + l, i] = c.x[i, l]
