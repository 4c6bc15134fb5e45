"""Loops over states: quantities that depend on a state, its body and a step size.

States stand one after the other. Those of a whole run repeat the batch at each time, and with it
the bodies: parameters are arrays of one number that serves all, or of a period of them.

A task takes blocks of LANES states. It goes through all repetitions of the bodies of a block
before the next block, so that what is made of bodies alone is made once.

Common arguments:

I1 ... eps   five arrays of `period` numbers, or of one that serves all.
omega        the states, flat: two numbers each.
out          the results, flat: the same number of them for each state.
report       (tasks, 3), at first 0: how many states had no result, and the first of them, where a
             loop counts them; whether there was an infinite state.
"""

import numpy as np
from numba import prange

from ..formulas import continuous, coordinates, integrals, linearised, section4, units
from ..jit import Loop
from ..staged import formula, staged
from . import intrinsics  # noqa: F401  (compiles what is imported from vector)
from .blocks import LANES, gather_pairs, spread
from .vector import on_stack

# Rows of a block: parameters as given, in units of powers of two, the state, results, and
# the largest number in a state so far.
GIVEN, I1, I2, I13, I23, EPS, OMEGA, RESULT, LARGEST = 0, 5, 6, 7, 8, 9, 10, 12, 16
ROWS = 17
# Rows of the logarithms of the units.
M, P, E = range(3)
LOGARITHMS = 3
# Columns of the report.
MISSING, FIRST, INFINITE = range(3)


@staged
def enter_bodies(parameters, first, width, rows, logarithms):
    for k, parameter in enumerate(parameters):
        spread(parameter, first, width, width, rows[GIVEN + k])
    for l in range(width):
        (
            rows[I1, l],
            rows[I2, l],
            rows[I13, l],
            rows[I23, l],
            rows[EPS, l],
            logarithms[M, l],
            logarithms[P, l],
            logarithms[E, l],
        ) = units.normal_body(rows[0, l], rows[1, l], rows[2, l], rows[3, l], rows[4, l])


@staged
def enter_states(omega, first, width, rows):
    gather_pairs(omega, first, width, rows[OMEGA], rows[OMEGA + 1])
    for l in range(width):
        size = units.larger(abs(rows[OMEGA, l]), rows[LARGEST, l])
        rows[LARGEST, l] = units.larger(abs(rows[OMEGA + 1, l]), size)


@staged
def count_missing(omega, first, width, rows, report):
    """States that are, and have no result."""
    for l in range(width):
        state_sum = omega[2 * (first + l)] + omega[2 * (first + l) + 1]
        if rows[RESULT, l] != rows[RESULT, l] and state_sum == state_sum:
            if report[MISSING] == 0 or first + l < report[FIRST]:
                report[FIRST] = first + l
            report[MISSING] += 1


@staged
def any_infinite(rows):
    infinite = False
    for l in range(LANES):
        infinite |= rows[LARGEST, l] == np.inf
    return infinite


def _of_body(function):
    """A formula of a body in units of powers of two and a state, at one lane of a block."""

    @formula
    def value(rows, logarithms, l):
        return function(
            rows[I1, l],
            rows[I2, l],
            rows[I13, l],
            rows[I23, l],
            rows[EPS, l],
            logarithms[M, l],
            logarithms[P, l],
            logarithms[E, l],
            rows[OMEGA, l],
            rows[OMEGA + 1, l],
        )

    return value


def _observable(name, value, size, counts=False):
    """A loop that evaluates a formula of `size` results at one lane for all states.

    With `counts` it counts the states that have no result.
    """
    places = tuple(range(size))

    @staged
    def find(rows, logarithms, width):
        for l in range(width):
            found = value(rows, logarithms, l)
            results = (found,) if size == 1 else found
            for k in places:
                rows[RESULT + k, l] = results[k]

    @staged
    def write(rows, first, width, out):
        for l in range(width):
            for k in places:
                out[size * (first + l) + k] = rows[RESULT + k, l]

    @staged
    def evaluate(task, tasks, I1, I2, I13, I23, eps, omega, out, period, report):
        """What one task does."""
        shared = I1.size * I2.size * I13.size * I23.size * eps.size == 1
        states = omega.size // 2
        repetitions = (states + period - 1) // period
        parts = (period + LANES - 1) // LANES * repetitions
        rows = on_stack(ROWS, LANES)
        logarithms = on_stack(LOGARITHMS, LANES).view(np.int64)
        for l in range(LANES):
            rows[LARGEST, l] = 0.0
        begin = task * parts // tasks
        for k in range(begin, (task + 1) * parts // tasks):
            body, time = k // repetitions * LANES, k % repetitions
            lanes = min(LANES, period - body)
            if k == begin or (time == 0 and not shared):
                enter_bodies((I1, I2, I13, I23, eps), body, lanes, rows, logarithms)
            first = time * period + body
            # The last repetition may end before this block.
            width = max(min(lanes, states - first), 0)
            enter_states(omega, first, width, rows)
            find(rows, logarithms, width)
            write(rows, first, width, out)
            if counts:
                count_missing(omega, first, width, rows, report[task])
        report[task, INFINITE] = any_infinite(rows)

    def loop(I1, I2, I13, I23, eps, omega, out, period, report):
        tasks = report.shape[0]
        for task in prange(tasks):
            evaluate(task, tasks, I1, I2, I13, I23, eps, omega, out, period, report)

    loop.__name__ = name
    return Loop(loop)


@formula
def _energy(rows, logarithms, l):
    # Its terms need no other unit.
    return integrals.energy(rows[0, l], rows[1, l], rows[OMEGA, l], rows[OMEGA + 1, l])


energy = _observable("energy", _energy, 1)
first_integral = _observable("first_integral", _of_body(integrals.first_integral), 1)
modified_energy = _observable("modified_energy", _of_body(integrals.modified_energy), 1)
criticality = _observable("criticality", _of_body(integrals.criticality), 1)
invariant_density = _observable("invariant_density", _of_body(integrals.invariant_density), 1)
to_xy = _observable("to_xy", _of_body(coordinates.xy_of_state), 2)
from_xy = _observable("from_xy", _of_body(coordinates.state_of_xy), 2)
vector_field = _observable("vector_field", _of_body(continuous.vector_field), 2)
reaction = _observable("reaction", _of_body(continuous.reaction), 1)
discrete_reaction = _observable(
    "discrete_reaction", _of_body(continuous.discrete_reaction), 1, True
)
jacobian = _observable("jacobian", _of_body(linearised.jacobian), 4, True)
matrix = _observable("matrix", _of_body(linearised.matrix), 4)
constants = _observable("constants", _of_body(section4.constants), 4)
