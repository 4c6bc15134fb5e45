"""Quantities of states in three dimensions: one loop over states for all formulas.

A body without a rotor is one with k = 0. States are contiguous. Those of a run repeat the batch,
and with it the bodies, at each time. A task processes blocks of LANES bodies, and for each block
all times, so that data of the bodies are computed once. Arguments of a kernel:

parameters   I1, I2, I13, I23, k and eps: arrays of `period` numbers each, or of one for all
omega        (count, 2), the states
out          (count, size), the results
period       number of states after which the bodies repeat
report       (tasks, 3), at first 0; columns MISSING, FIRST and INFINITE
"""

from typing import NamedTuple

import numpy as np

from .._formulas import continuous, coordinates, integrals, linearised, section4, units
from .._formulas.elementary import exponent, larger, scaled
from .._jit import Kernel, formula, namespace, rows_of, share
from .lanes import LANES

# The number of states without a result that are not NaN, the first of them, and 1 if a state is
# infinite.
MISSING, FIRST, INFINITE = range(3)

# What a quantity provides: its size; enter, which fills `own`; at_lane; and put.
quantity = namespace("quantity")


class Given(NamedTuple):
    """Parameters of the bodies of a block."""

    I1: object
    I2: object
    I13: object
    I23: object
    k: object
    eps: object


class States(NamedTuple):
    """States of a block, and the largest component so far."""

    omega1: object
    omega2: object
    largest: object


class Result(NamedTuple):
    """Results of a block: one, two, or the four entries of a matrix."""

    first: object
    second: object
    third: object
    fourth: object


@formula
def spread(parameter, first, width, lanes):
    """Fill lanes with a parameter of the bodies of a block."""
    if parameter.size == 1:
        for l in range(width):
            lanes[l] = parameter[0]
    else:
        # LLVM knows that indices from 0 on are not negative.
        numbers = parameter[first : first + width]
        for l in range(width):
            lanes[l] = numbers[l]


@formula
def enter_parameters(parameters, first, width, given):
    """Fill the lanes of the bodies of a block."""
    I1, I2, I13, I23, k, eps = parameters
    spread(I1, first, width, given.I1)
    spread(I2, first, width, given.I2)
    spread(I13, first, width, given.I13)
    spread(I23, first, width, given.I23)
    spread(k, first, width, given.k)
    spread(eps, first, width, given.eps)


@formula
def enter_states(flat, first, width, s):
    """Fill the lanes of states, and update the largest components."""
    numbers = flat[2 * first : 2 * (first + width)]
    for l in range(width):
        omega1, omega2 = numbers[2 * l], numbers[2 * l + 1]
        s.omega1[l] = omega1
        s.omega2[l] = omega2
        s.largest[l] = max(max(abs(omega1), abs(omega2)), s.largest[l])


@formula
def count_missing(r, s, width):
    """Return the number of states without a result, and the lane of the first."""
    count = 0
    for l in range(width):
        total = s.omega1[l] + s.omega2[l]
        count += (r.first[l] != r.first[l]) & (total == total)
    l = 0
    if count > 0:
        while r.first[l] == r.first[l] or np.isnan(s.omega1[l] + s.omega2[l]):
            l += 1
    return count, l


@formula
def any_infinite(s):
    """Test that a state so far was infinite."""
    infinite = False
    for l in range(LANES):
        infinite |= s.largest[l] == np.inf
    return infinite


@formula
def write(r, first, width, size, flat):
    """Write the results of a block."""
    numbers = flat[size * first : size * (first + width)]
    if size == 1:
        for l in range(width):
            numbers[l] = r.first[l]
    elif size == 2:
        for l in range(width):
            numbers[2 * l] = r.first[l]
            numbers[2 * l + 1] = r.second[l]
    else:
        for l in range(width):
            numbers[4 * l] = r.first[l]
            numbers[4 * l + 1] = r.second[l]
            numbers[4 * l + 2] = r.third[l]
            numbers[4 * l + 3] = r.fourth[l]


@formula
def put_one(r, l, value):
    r.first[l] = value


@formula
def put_two(r, l, values):
    r.first[l], r.second[l] = values


@formula
def put_four(r, l, values):
    r.first[l], r.second[l], r.third[l], r.fourth[l] = values


def evaluate(part, parts, parameters, omega, out, period, report):
    """Evaluate a quantity in a part of the tasks."""
    given, own = rows_of(Given, LANES), rows_of(units.Body, LANES)
    s, r = rows_of(States, LANES), rows_of(Result, LANES)
    states, results = omega.reshape(omega.size), out.reshape(out.size)
    count, tasks, shared = len(omega), len(report), True
    for k in range(len(parameters)):
        shared &= parameters[k].size == 1
    times = (count + period - 1) // period
    pieces = (period + LANES - 1) // LANES * times
    first_task, last_task = share(tasks, part, parts)
    for task in range(first_task, last_task):
        missing, entered = 0, -1
        for l in range(LANES):
            s.largest[l] = 0.0
        for piece in range(task * pieces // tasks, (task + 1) * pieces // tasks):
            block, time = piece // times, piece % times
            width = min(LANES, period - block * LANES)
            if entered < 0 or (block != entered and not shared):
                bodies = LANES if shared else width
                enter_parameters(parameters, block * LANES, bodies, given)
                for l in range(bodies):
                    quantity.enter(given, own, l)
                entered = block
            first = time * period + block * LANES
            width = max(min(width, count - first), 0)  # the last repetition may be incomplete
            enter_states(states, first, width, s)
            for l in range(width):
                quantity.put(r, l, quantity.at_lane(own, s, l))
            write(r, first, width, quantity.size, results)
            lost, lane = count_missing(r, s, width)
            if lost > 0 and missing == 0:
                report[task, FIRST] = first + lane
            missing += lost
        report[task, MISSING], report[task, INFINITE] = missing, any_infinite(s)


@formula
def enter_body(given, own, l):
    body = units.of_body(
        given.I1[l], given.I2[l], given.I13[l], given.I23[l], given.k[l], given.eps[l]
    )
    own.I1[l], own.I2[l], own.I13[l], own.I23[l] = body.I1, body.I2, body.I13, body.I23
    own.k[l], own.eps[l] = body.k, body.eps
    own.M[l], own.P[l], own.Q[l], own.E[l] = body.M, body.P, body.Q, body.E


@formula
def body_at(own, l):
    return units.Body(
        own.I1[l], own.I2[l], own.I13[l], own.I23[l], own.k[l], own.eps[l],
        own.M[l], own.P[l], own.Q[l], own.E[l],
    )  # fmt: skip


def of_body(name, evaluated, *dimensions):
    """Build the kernel of a formula of a problem in its own units.

    A result has a dimension: its exponents of moments, of products of inertia and of omega.
    """
    leave = _leaving[len(dimensions)](*dimensions)

    @formula
    def at_lane(own, s, l):
        problem, unit = units.of_state(body_at(own, l), s.omega1[l], s.omega2[l])
        return leave(evaluated(*problem), unit)

    return of_formulas(name, len(dimensions), enter_body, at_lane)


def of_formulas(name, size, enter, at_lane):
    """Build the kernel of a quantity from what `enter` and `at_lane` do in one lane."""
    put = {1: put_one, 2: put_two, 4: put_four}[size]
    contents = namespace(name, size=size, enter=enter, at_lane=at_lane, put=put)
    return Kernel(evaluate, name, quantity=contents)


def leave_one(dimension):
    """Return the formula of the way out for one result."""
    moment, product, omega = dimension

    @formula
    def leave(value, unit):
        return units.leave(value, unit, moment, product, omega)

    @formula
    def as_it_is(value, unit):
        return value

    return leave if any(dimension) else as_it_is


def leave_two(*dimensions):
    one, two = map(leave_one, dimensions)

    @formula
    def leave(values, unit):
        return one(values[0], unit), two(values[1], unit)

    return leave


def leave_four(*dimensions):
    one, two, three, four = map(leave_one, dimensions)

    @formula
    def leave(values, unit):
        return (
            one(values[0], unit), two(values[1], unit), three(values[2], unit),
            four(values[3], unit),
        )  # fmt: skip

    return leave


_leaving = {1: leave_one, 2: leave_two, 4: leave_four}


@formula
def enter_moments(given, own, l):
    own.I1[l], own.I2[l] = given.I1[l], given.I2[l]


@formula
def energy_at_lane(own, s, l):
    """In the units of the user: no product is out of range unless the result is."""
    return integrals.energy(own.I1[l], own.I2[l], s.omega1[l], s.omega2[l])


def of_two_terms(name, evaluated, *dimensions):
    """`of_body` for a difference of terms, each with a dimension of its own."""
    leave = leave_two(*dimensions)

    @formula
    def at_lane(own, s, l):
        problem, unit = units.of_state(body_at(own, l), s.omega1[l], s.omega2[l])
        first, second = leave(evaluated(*problem), unit)
        return first - second

    return of_formulas(name, 1, enter_body, at_lane)


@formula
def from_xy_at_lane(own, s, l):
    """A state from (x, y), of the dimensions of `to_xy`."""
    body, x, y = body_at(own, l), s.omega1[l], s.omega2[l]
    W = larger(exponent(x) - body.P, exponent(y) - body.P - body.M)
    x, y = scaled(x, -W - body.P), scaled(y, -W - body.P - body.M)
    omega1, omega2 = coordinates.from_xy(body.I1, body.I2, body.I13, body.I23, x, y)
    return scaled(omega1, W), scaled(omega2, W)


energy = of_formulas("energy", 1, enter_moments, energy_at_lane)
_REACTION = (-1, 2, 2), (1, 0, 2)
reaction = of_two_terms("reaction", continuous.reaction, *_REACTION)
discrete_reaction = of_two_terms("discrete_reaction", continuous.discrete_reaction, *_REACTION)
from_xy = of_formulas("from_xy", 2, enter_body, from_xy_at_lane)

first_integral = of_body("first_integral", integrals.first_integral, (-1, 0, 2))
modified_energy = of_body("modified_energy", integrals.modified_energy, (1, 0, 2))
criticality = of_body("criticality", integrals.criticality, (0, 0, 0))
rotation_number = of_body("rotation_number", integrals.rotation_number, (0, 0, 0))
invariant_density = of_body("invariant_density", integrals.invariant_density, (-2, -1, -1))
to_xy = of_body("to_xy", coordinates.xy_of_problem, (0, 1, 1), (1, 1, 1))
vector_field = of_body("vector_field", continuous.vector_field, (-1, 1, 2), (-1, 1, 2))
jacobian = of_body("jacobian", linearised.jacobian, *[(0, 0, 0)] * 4)
matrix = of_body("matrix", linearised.matrix, *[(0, 0, 0)] * 4)
constants = of_body("constants", section4.constants, (0, 2, 2), (-1, 1, 1), (0, 0, 0), (0, 0, 0))
