"""Iteration of Kahan's map of any quadratic field: x_next = x + eps A(x)**-1 f(x).

A(x) = 1 - (eps/2) f'(x). A field is a list of its nonzero terms, so that one build serves all
fields. With one more component, x_D = 1, all terms are quadratic: f_i has the terms v x_j x_k.

indices (3, T)   i, j and k, where j <= k; those with k = D are last
values           v: (T,) for a single field, or (T, B) for a batch, B a multiple of WIDEST

A block of trajectories, up to WIDEST, advances together. Lanes store x in a unit of length 2**k, in
which products of coefficients, step size and states are in range if their result is. Lanes that
have ended have the state 0 in the unit NaN.
"""

from typing import NamedTuple

import numpy as np

from .._formulas.elementary import exponent, larger, scaled, two_to_the, within
from .._jit import LINE, formula, inner, kernel, select, share, subtract_product
from .codes import NONFINITE, OK, SINGULAR
from .elimination import eliminate, row
from .lanes import entry

# States whose components add up to less than this are finite.
LARGEST = 1e307
# |eps q| lies between the inverse of 2 to this power and that power, where q is the largest
# quadratic coefficient: products of eps, q and states are in range if eps q x is.
FAR = 500.0


class Block(NamedTuple):
    """A block of trajectories: numbers of each lane, and the equations of a step."""

    half: np.ndarray  # half the step size times the unit of length
    unit: np.ndarray
    bound: np.ndarray  # LARGEST in the unit of length
    size: np.ndarray  # the sum of the absolute values of the components of the next state
    factor: np.ndarray
    slopes: np.ndarray  # half the step size times the terms with k = D, (D, D + 1, lanes)
    matrix: np.ndarray  # A, and minus half the step size times f as the right side


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
def build(indices, values, b, first, x):
    """Fill the equations of a step."""
    matrix = b.matrix
    D, _, width = matrix.shape
    for i in range(D):
        for j in range(D + 1):
            unit = 1.0 if i == j else 0.0
            for l in range(width):
                matrix[i, j, l] = unit - b.slopes[i, j, l]
    for t in range(len(values)):
        i, j, k = indices[0, t], indices[1, t], indices[2, t]
        if k < D:
            for l in range(width):
                b.factor[l] = b.half[l] * value(values, t, first + l)
            for l in range(0, width, LINE):
                subtract_product(matrix, (i, j, l), b.factor, (l,), x, (k, l))
                subtract_product(matrix, (i, k, l), b.factor, (l,), x, (j, l))
            for l in range(width):
                b.factor[l] *= x[k, l]
            for l in range(0, width, LINE):
                subtract_product(matrix, (i, D, l), b.factor, (l,), x, (j, l))
        elif j < D:
            for l in range(0, width, LINE):
                subtract_product(matrix, (i, D, l), b.slopes, (i, j, l), x, (j, l))


@formula
def even_out(b):
    """Make the largest entries of all rows of A alike; `factor` becomes NaN unless all are finite.

    Elimination takes matrices for singular whose rows are of very different size.
    """
    D, _, width = b.matrix.shape
    for l in range(width):
        b.factor[l] = 0.0
        for i in range(D):
            largest = 0.0
            for j in range(D + 1):
                b.factor[l] += 0.0 * b.matrix[i, j, l]
                largest = larger(select(j < D, abs(b.matrix[i, j, l]), 0.0), largest)
            shrink = two_to_the(-exponent(largest))
            for j in range(D + 1):
                b.matrix[i, j, l] *= shrink


@formula
def take_step(indices, values, b, first, x, after, evenly):
    """Find the next states; return how many are not finite."""
    build(indices, values, b, first, x)
    if evenly:
        even_out(b)
    eliminate(b.matrix)
    D, _, width = b.matrix.shape
    for l in range(width):
        b.size[l] = 0.0
    for i in range(D):
        for l in range(width):
            half = b.matrix[i, D, l]  # of the increment, with the other sign
            after[i, l] = select(half == 0.0, x[i, l], x[i, l] - 2.0 * half)
            b.size[l] += abs(after[i, l])
    failed = 0
    for l in range(width):
        failed += select(b.size[l] <= b.bound[l], 0, 1)
    return failed


@formula
def is_finite(b, x, l):
    """Test a state."""
    size = 0.0
    for i in range(x.shape[0]):
        size += abs(x[i, l])
    return size <= b.bound[l]


@inner
def replace_failed(b, after, again, n, first, end, status, failed_at):
    """Replace states n that are not finite by those of the repeated step, or end their lanes."""
    for l in range(after.shape[1]):
        if not is_finite(b, after, l):
            undefined = False
            for i in range(after.shape[0]):
                after[i, l] = again[i, l]
                undefined |= again[i, l] != again[i, l]
            if not is_finite(b, after, l):
                if first + l < end:
                    singular = undefined and not np.isnan(b.factor[l])
                    status[first + l] = SINGULAR if singular else NONFINITE
                    failed_at[first + l] = n
                stop(b, after, l)


@inner
def stop(b, x, l):
    """End a trajectory: from now on it rests at 0, which is written as NaN."""
    b.half[l], b.unit[l], b.bound[l] = 0.0, np.nan, np.inf
    for i in range(x.shape[0]):
        x[i, l] = 0.0
        for j in range(x.shape[0] + 1):
            b.slopes[i, j, l] = 0.0


@inner
def enter(parameters, start, results, first, end, b, x):
    """Enter trajectories at state `start`; lanes beyond the last repeat it."""
    indices, values, eps, largest, initial = parameters
    _, status, failed_at, state = results
    D, width = x.shape
    for l in range(width):
        stop(b, x, l)
        i = min(first + l, end - 1)
        half, undefined = 0.5 * entry(eps, i), False
        k = unit_of_length(2.0 * half, entry(largest, i))
        for c in range(D):
            x[c, l] = scaled(initial[i, c], -k) if start == 0 else state[i, c]
            undefined |= x[c, l] != x[c, l]
        if start == 0 and first + l < end:
            # A trajectory whose state 0 is NaN ends at step 0.
            status[i], failed_at[i] = (NONFINITE, 0) if undefined else (OK, -1)
        if status[i] < 0:
            stop(b, x, l)
            continue
        b.half[l], b.unit[l], b.bound[l] = scaled(half, k), scaled(1.0, k), scaled(LARGEST, -k)
        for t in range(len(values)):
            j = indices[1, t]
            if indices[2, t] == D:
                of_term = scaled(half, -k) if j == D else half
                b.slopes[indices[0, t], j, l] = of_term * value(values, t, first + l)


@inner
def write(initial, b, x, first, end, n, target):
    """Write the states n of a block; the first are copies of the input."""
    for l in range(end - first):
        for c in range(initial.shape[1]):
            target[first + l, c] = initial[first + l, c] if n == 0 else x[c, l] * b.unit[l]


@kernel
def iterate_field(part, parts, parameters, stretch, saved, results, scratch):
    """Iterate the trajectories of a part of the tasks.

    parameters : indices and values of the terms, see above; the step size, and the largest
        absolute value of a quadratic coefficient, (B,) or (1,); the states at step 0, (B, D)
    stretch : begin and end of the trajectories; start, stop; every, first_row of the saved states
    saved : (rows, B, D)
    results : final (B, D); status, failed_at (B,); the states in the units of lanes (B, D). All but
        `final` are read if start is not 0.
    scratch : for equations (tasks, 2, D, D + 1, lanes), and for states (tasks, 3, D, lanes)
    """
    indices, values, _, _, initial = parameters
    begin, last, start, stop_at, every, first_row = stretch
    final, status, failed_at, state = results
    systems, states = scratch
    tasks, _, D, lanes = states.shape
    blocks = (last - begin + lanes - 1) // lanes
    first_task, last_task = share(tasks, part, parts)
    for task in range(first_task, last_task):
        system = systems[task]
        b = Block(row(), row(), row(), row(), row(), system[0], system[1])
        for block in range(task * blocks // tasks, (task + 1) * blocks // tasks):
            x, after, again = states[task, 0], states[task, 1], states[task, 2]
            first = begin + block * lanes
            end = min(first + lanes, last)
            enter(parameters, start, results, first, end, b, x)
            n, place, next_saved = start, 0, stop_at + 1
            if saved.shape[0] > 0:
                place = start // every + 1 - first_row if start > 0 else 0
                next_saved = (start // every + 1) * every if start > 0 else 0
            while True:
                if n == next_saved:
                    write(initial, b, x, first, end, n, saved[place])
                    place, next_saved = place + 1, next_saved + every
                if n == stop_at:
                    break
                while n < min(next_saved, stop_at):
                    n += 1
                    for repeated in (False, True):
                        target = again if repeated else after
                        failed = take_step(indices, values, b, first, x, target, repeated)
                        if repeated:
                            replace_failed(b, after, again, n, first, end, status, failed_at)
                        elif failed == 0:
                            break
                    x, after = after, x
            write(initial, b, x, first, end, stop_at, final)
            for l in range(end - first):
                for c in range(D):
                    state[first + l, c] = x[c, l]
