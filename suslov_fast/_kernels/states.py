"""Quantities of states: one loop over states, which takes a formula.

States stand one after the other. Those of a whole run repeat the batch at each time, and with it
the bodies. A task takes blocks of LANES bodies, and of each block all times: what is made of bodies
alone is made once.

parameters   the body's and eps: arrays of `period` numbers each, or of one that serves all.
omega        (count, 2), the states.
out          (count, size), the results.
report       (tasks, 3), at first 0: see MISSING, FIRST, INFINITE.
"""

import types

import numpy as np
from numba import prange

from .._formulas import continuous, coordinates, integrals, linearised, section4
from .._formulas.elementary import larger
from .._formulas.units import normal_body
from .._jit import carray, formula, inner, kernel, stack

LANES = 128
# Rows of a block: the parameters, and the body in units of powers of two.
GIVEN, NORMAL, OMEGA, RESULT = 6, 10, 3, 4
ROOM_GIVEN, ROOM_NORMAL, ROOM_OMEGA, ROOM_RESULT = GIVEN * LANES, NORMAL * LANES, OMEGA * LANES, RESULT * LANES
# Columns of the report: the states that have no result, the first of them, and whether there is an
# infinite state.
MISSING, FIRST, INFINITE = range(3)


@formula
def spread(parameter, first, width, row):
    """Fill one row of a block."""
    if parameter.size == 1:
        for l in range(width):
            row[l] = parameter[0]
    else:
        numbers = parameter[first : first + width]
        for l in range(width):
            row[l] = numbers[l]


@formula
def enter_states(flat, first, width, states):
    """Fill the rows of states, and of the largest number in them so far."""
    numbers = flat[2 * first : 2 * (first + width)]
    for l in range(width):
        omega1, omega2 = numbers[2 * l], numbers[2 * l + 1]
        states[0, l] = omega1
        states[1, l] = omega2
        states[2, l] = max(max(abs(omega1), abs(omega2)), states[2, l])


@formula
def count_missing(results, states, width):
    """Return how many states have no result, and the lane of the first."""
    lost = 0
    for l in range(width):
        total = states[0, l] + states[1, l]
        lost += (results[0, l] != results[0, l]) & (total == total)
    l = 0
    if lost > 0:
        while results[0, l] == results[0, l] or np.isnan(states[0, l] + states[1, l]):
            l += 1
    return lost, l


@formula
def any_infinite(states):
    infinite = False
    for l in range(LANES):
        infinite |= states[2, l] == np.inf
    return infinite


@formula
def enter(given, body, l):
    """Enter the body of a lane."""
    (
        body[0, l],
        body[1, l],
        body[2, l],
        body[3, l],
        body[4, l],
        body[5, l],
        body[6, l],
        body[7, l],
    ) = normal_body(given[0, l], given[1, l], given[2, l], given[3, l], given[4, l])


def of_body(quantity):
    @formula
    def at_lane(body, states, l):
        return quantity(
            body[0, l],
            body[1, l],
            body[2, l],
            body[3, l],
            body[4, l],
            body[5, l],
            body[6, l],
            body[7, l],
            states[0, l],
            states[1, l],
        )
    return at_lane


@formula
def enter_moments(given, body, l):
    """Enter the moments of inertia alone, in their own unit."""
    body[0, l], body[1, l] = given[0, l], given[1, l]


@formula
def energy_at_lane(body, states, l):
    return integrals.energy(body[0, l], body[1, l], states[0, l], states[1, l])


@formula
def put_1(results, l, value):
    results[0, l] = value


@formula
def put_2(results, l, values):
    results[0, l], results[1, l] = values


@formula
def put_4(results, l, values):
    results[0, l], results[1, l], results[2, l], results[3, l] = values


@formula
def write_1(results, width, out):
    for l in range(width):
        out[1 * l + 0] = results[0, l]


@formula
def write_2(results, width, out):
    for l in range(width):
        out[2 * l + 0], out[2 * l + 1] = results[0, l], results[1, l]


@formula
def write_4(results, width, out):
    for l in range(width):
        out[4 * l + 0], out[4 * l + 1] = results[0, l], results[1, l]
        out[4 * l + 2], out[4 * l + 3] = results[2, l], results[3, l]


OF_SIZE = {1: (put_1, write_1), 2: (put_2, write_2), 4: (put_4, write_4)}


def all_states(parameters, omega, out, period, report):
    """Evaluate a quantity, `evaluate`, of all states."""
    for task in prange(len(report)):
        evaluate(parameters, omega, out, period, task, report)  # noqa: F821


def quantity(name, at_lane, size=1, enter=enter):
    put, write = OF_SIZE[size]

    @inner
    def evaluate(parameters, omega, out, period, task, report):
        """What one task does."""
        given = carray(stack(ROOM_GIVEN), (GIVEN, LANES))
        body = carray(stack(ROOM_NORMAL), (NORMAL, LANES))
        states = carray(stack(ROOM_OMEGA), (OMEGA, LANES))
        results = carray(stack(ROOM_RESULT), (RESULT, LANES))
        for l in range(LANES):
            states[2, l] = 0.0
        count, missing = len(omega), 0
        flat, flat_out = omega.reshape(omega.size), out.reshape(out.size)
        times = (count + period - 1) // period
        parts, tasks = (period + LANES - 1) // LANES * times, len(report)
        entered = -1
        for part in range(task * parts // tasks, (task + 1) * parts // tasks):
            block, time = part // times, part % times
            width = min(LANES, period - block * LANES)
            if block != entered:
                for k in range(len(parameters)):
                    spread(parameters[k], block * LANES, width, given[k])
                for l in range(width):
                    enter(given, body, l)
                entered = block
            first = time * period + block * LANES
            width = max(min(width, count - first), 0)  # of the last time there may be less
            enter_states(flat, first, width, states)
            for l in range(width):
                put(results, l, at_lane(body, states, l))
            write(results, width, flat_out[size * first : size * (first + width)])
            lost, lane = count_missing(results, states, width)
            if lost > 0 and missing == 0:
                report[task, FIRST] = first + lane
            missing += lost
        report[task, MISSING], report[task, INFINITE] = missing, any_infinite(states)

    # Numba names cache files after functions, and caches none that has a closure.
    code, names = all_states.__code__, globals() | {"evaluate": evaluate}
    return kernel(types.FunctionType(code, names, name))


energy = quantity("energy", energy_at_lane, enter=enter_moments)
first_integral = quantity("first_integral", of_body(integrals.first_integral))
vector_field = quantity("vector_field", of_body(continuous.vector_field), 2)
jacobian = quantity("jacobian", of_body(linearised.jacobian), 4)
