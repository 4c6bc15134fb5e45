"""Iteration of Kahan's map of any quadratic field: x_next = x + eps A(x)**-1 f(x).

A(x) = 1 - (eps/2) f'(x). A block of trajectories, up to WIDEST, advances together. A field is a
list of its nonzero terms, so that one build serves all fields:

quadratic (3, T)   i, j, k: f_i has the term v x_j x_k
linear (2, T)      i, j: f_i has the term v x_j
constant (1, T)    i: f_i has the term v

and v for each: (T,) for a single field, or (T, B) for a batch, B a multiple of WIDEST.

Lanes store x in a unit of length 2**k, in which products of coefficients, step size and states are
in range if their result is. Lanes that have ended have the state 0 in the unit NaN.
"""

from typing import NamedTuple

import numpy as np

from .._formulas.elementary import exponent, larger, scaled, two_to_the
from .._formulas.kahan import unit_of_length
from .._jit import LINE, copy_line, formula, inner, kernel, select, share, subtract_product
from .codes import NONFINITE, OK, SINGULAR
from .elimination import eliminate, row

# States whose components add up to less than this are finite.
LARGEST = 1e307


class Block(NamedTuple):
    """A block of trajectories: numbers of each lane, and the equations of a step."""

    quadratic: np.ndarray  # half the step size, times the unit of length
    linear: np.ndarray  # half the step size
    constant: np.ndarray  # half the step size over the unit of length
    unit: np.ndarray
    bound: np.ndarray  # LARGEST in the unit of length
    size: np.ndarray  # the sum of the absolute values of the components of the next state
    factor: np.ndarray
    slopes: np.ndarray  # half the step size times linear coefficients, (T, lanes)
    fixed: np.ndarray  # the equations, without what depends on the state, (D, D + 1, lanes)
    matrix: np.ndarray  # A, and minus half the step size times f as the right side


@formula
def block_of(slopes, systems):
    """Return a block with memory for the equations, (2, D, D + 1, lanes)."""
    return Block(
        row(), row(), row(), row(), row(), row(), row(), slopes, systems[0], systems[1]
    )  # fmt: skip


@formula
def value(values, t, i):
    """Return the coefficient of term t for trajectory i."""
    return values[t] if values.ndim == 1 else values[t, i]


@inner
def prepare(terms, b, first):
    """Fill the part of the equations that is the same in each step."""
    (_, linear, constant), (_, of_linear, of_constant) = terms
    D, _, width = b.fixed.shape
    for i in range(D):
        for j in range(D + 1):
            for l in range(width):
                b.fixed[i, j, l] = 1.0 if i == j else 0.0
    for t in range(linear.shape[1]):
        for l in range(width):
            b.slopes[t, l] = b.linear[l] * value(of_linear, t, first + l)
            b.fixed[linear[0, t], linear[1, t], l] -= b.slopes[t, l]
    for t in range(constant.shape[1]):
        for l in range(width):
            b.fixed[constant[0, t], D, l] -= b.constant[l] * value(of_constant, t, first + l)


@inner
def build(terms, b, first, x):
    """Fill the equations of a step."""
    (quadratic, linear, _), (of_quadratic, _, _) = terms
    matrix = b.matrix
    D, _, width = matrix.shape
    for i in range(D):
        for j in range(D + 1):
            for l in range(0, width, LINE):
                copy_line(matrix, (i, j, l), b.fixed, (i, j, l))
    for t in range(quadratic.shape[1]):
        i, j, k = quadratic[0, t], quadratic[1, t], quadratic[2, t]
        for l in range(width):
            b.factor[l] = b.quadratic[l] * value(of_quadratic, t, first + l)
        for l in range(0, width, LINE):
            subtract_product(matrix, (i, j, l), b.factor, (l,), x, (k, l))
            subtract_product(matrix, (i, k, l), b.factor, (l,), x, (j, l))
        for l in range(width):
            b.factor[l] *= x[k, l]
        for l in range(0, width, LINE):
            subtract_product(matrix, (i, D, l), b.factor, (l,), x, (j, l))
    for t in range(linear.shape[1]):
        for l in range(0, width, LINE):
            subtract_product(matrix, (linear[0, t], D, l), b.slopes, (t, l), x, (linear[1, t], l))


@formula
def next_of(x, half):
    """Return the next component, x itself at rest; `half` is minus half the increment."""
    return select(half == 0.0, x, x - 2.0 * half)


@formula
def take_step(terms, b, first, x, after):
    """Find the next states; return how many are not finite."""
    build(terms, b, first, x)
    eliminate(b.matrix)
    D, _, width = b.matrix.shape
    for l in range(width):
        b.size[l] = 0.0
    for i in range(D):
        for l in range(width):
            after[i, l] = next_of(x[i, l], b.matrix[i, D, l])
            b.size[l] += abs(after[i, l])
    failed = 0
    for l in range(width):
        failed += select(b.size[l] <= b.bound[l], 0, 1)
    return failed


@inner
def repeat_step(terms, b, first, end, x, after, n, status, failed_at):
    """Repeat the step to state n of lanes that failed, and end them if they fail again.

    Elimination takes matrices for singular whose rows are of very different size: here the largest
    entries of all rows are alike.
    """
    D = b.matrix.shape[0]
    build(terms, b, first, x)
    for l in range(x.shape[1]):
        b.factor[l] = 0.0
        for i in range(D):
            largest = 0.0
            for j in range(D + 1):
                b.factor[l] += 0.0 * b.matrix[i, j, l]
                largest = larger(select(j < D, abs(b.matrix[i, j, l]), 0.0), largest)
            shrink = two_to_the(-exponent(largest))
            for j in range(D + 1):
                b.matrix[i, j, l] *= shrink
    eliminate(b.matrix)
    for l in range(x.shape[1]):
        if not b.size[l] <= b.bound[l]:
            size = 0.0
            for i in range(D):
                after[i, l] = next_of(x[i, l], b.matrix[i, D, l])
                size += abs(after[i, l])
            if not size <= b.bound[l]:
                if first + l < end:
                    singular = np.isnan(size) and not np.isnan(b.factor[l])
                    status[first + l] = SINGULAR if singular else NONFINITE
                    failed_at[first + l] = n
                stop(b, after, l)


@inner
def stop(b, x, l):
    """End a trajectory: from now on it rests at 0, which is written as NaN."""
    D = x.shape[0]
    b.quadratic[l], b.unit[l], b.bound[l] = 0.0, np.nan, np.inf
    for t in range(b.slopes.shape[0]):
        b.slopes[t, l] = 0.0
    for i in range(D):
        x[i, l] = 0.0
        for j in range(D + 1):
            b.fixed[i, j, l] = 1.0 if i == j else 0.0


@inner
def enter(terms, parameters, start, kept, first, end, b, x):
    """Enter trajectories at state `start`; lanes beyond the last repeat it."""
    eps, largest, initial = parameters
    _, status, failed_at, state = kept
    for l in range(x.shape[1]):
        i = min(first + l, end - 1)
        step, q = eps[min(i, eps.size - 1)], largest[min(i, largest.size - 1)]
        k = unit_of_length(step, q)
        b.quadratic[l], b.linear[l] = scaled(0.5 * step, k), 0.5 * step
        b.constant[l], b.unit[l] = scaled(0.5 * step, -k), scaled(1.0, k)
        b.bound[l], b.size[l] = scaled(LARGEST, -k), 0.0
        for c in range(x.shape[0]):
            x[c, l] = scaled(initial[i, c], -k) if start == 0 else state[i, c]
            b.size[l] += 0.0 * initial[i, c]
    prepare(terms, b, first)
    for l in range(x.shape[1]):
        i = min(first + l, end - 1)
        if start == 0 and first + l < end:
            # A trajectory whose state 0 is NaN ends at step 0.
            status[i], failed_at[i] = (OK, -1) if b.size[l] == 0.0 else (NONFINITE, 0)
        if status[i] < 0:
            stop(b, x, l)


@inner
def write(initial, b, x, first, end, n, target):
    """Write the states n of a block; the first are copies of the input."""
    for l in range(end - first):
        for c in range(x.shape[0]):
            target[first + l, c] = initial[first + l, c] if n == 0 else x[c, l] * b.unit[l]


@kernel
def iterate_field(part, parts, indices, values, parameters, span, saved, turning, kept, room):
    """Iterate the trajectories of a part of the tasks.

    indices, values : of the quadratic, the linear and the constant terms, see above
    parameters : the step size, and the largest absolute value of a quadratic coefficient, (B,) or
        (1,); the states at step 0, (B, D)
    span : begin and end of the trajectories; start, stop; every, first_row of the saved states
    saved : (rows, B, D)
    turning : None
    kept : final (B, D); status, failed_at (B,); the states in the units of lanes (B, D). All but
        `final` are read if start is not 0.
    room : for the equations (tasks, 2, D, D + 1, lanes), for states (tasks, 2, D, lanes), and for
        linear terms (tasks, T, lanes)
    """
    terms = indices, values
    first_one, last_one, start, stop_at, every, first_row = span
    final, status, failed_at, state = kept
    systems, states, slopes = room
    tasks, initial = len(systems), parameters[2]
    D, lanes = initial.shape[1], systems.shape[4]
    blocks = (last_one - first_one + lanes - 1) // lanes
    first_task, last_task = share(tasks, part, parts)
    for task in range(first_task, last_task):
        x, after = states[task, 0], states[task, 1]
        b = block_of(slopes[task], systems[task])
        for block in range(task * blocks // tasks, (task + 1) * blocks // tasks):
            first = first_one + block * lanes
            end = min(first + lanes, last_one)
            enter(terms, parameters, start, kept, first, end, b, x)
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
                    if take_step(terms, b, first, x, after) > 0:
                        repeat_step(terms, b, first, end, x, after, n, status, failed_at)
                    x, after = after, x
            write(initial, b, x, first, end, stop_at, final)
            for l in range(end - first):
                for c in range(D):
                    state[first + l, c] = x[c, l]


@kernel
def equations(part, parts, indices, values, parameters, kept, solves, out, room):
    """Find the equations of a step of all states: rows of A, and minus half the step size times f.

    The arguments are those of `iterate_field`. If `solves`, f is multiplied by the inverse of A.
    out : (B, D, D + 1)
    """
    terms, states = (indices, values), parameters[2]
    systems, vectors, slopes = room
    tasks, size, D = len(systems), len(states), states.shape[1]
    lanes = systems.shape[4]
    blocks = (size + lanes - 1) // lanes
    first_task, last_task = share(tasks, part, parts)
    for task in range(first_task, last_task):
        x = vectors[task, 0]
        b = block_of(slopes[task], systems[task])
        for block in range(task * blocks // tasks, (task + 1) * blocks // tasks):
            first = block * lanes
            end = min(first + lanes, size)
            enter(terms, parameters, 0, kept, first, end, b, x)
            build(terms, b, first, x)
            if solves:
                eliminate(b.matrix)
            for l in range(end - first):
                for i in range(D):
                    for j in range(D):
                        out[first + l, i, j] = b.matrix[i, j, l] + 0.0 * b.unit[l]
                    out[first + l, i, D] = b.matrix[i, D, l] * b.unit[l]
