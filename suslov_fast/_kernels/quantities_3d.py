"""Quantities of states in three dimensions: one loop over states for all formulas.

A body without a rotor is one with k = 0. States are contiguous. Those of a run repeat the batch,
and with it the bodies, at each time. A task processes blocks of LANES bodies, and for each block
all times, so that data of the bodies are computed once. Arguments of a kernel:

parameters   I1, I2, I13, I23, k and eps: arrays of `period` numbers each, or of one for all
omega        (count, 2), the states
out          (count, size), the results
period       number of states after which the bodies repeat
counts       (tasks, 3), at first 0; columns MISSING, FIRST and INFINITE
"""

from typing import NamedTuple

import numpy as np

from .._formulas import coordinates, equations, integrals, units
from .._formulas.elementary import exponent, larger, scaled
from .._jit import Kernel, formula, lane, namespace, put, rows_of, share, stack
from .lanes import LANES

# The number of states without a result that are not NaN, the first of them, and 1 if a state is
# infinite.
MISSING, FIRST, INFINITE = range(3)
_MOST = 4 * LANES  # results

# What a quantity provides: `size`, the number of its results; `enter`, from the parameters of a
# body to a `units.Body`; `at_state`, from that and a state to the results.
quantity = namespace("quantity")


class States(NamedTuple):
    """States of a block, and the largest component so far."""

    omega1: float
    omega2: float
    largest: float


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
def enter_bodies(parameters, first, width, bodies):
    """Fill lanes with the parameters of the bodies of a block."""
    I1, I2, I13, I23, k, eps = parameters
    spread(I1, first, width, bodies.I1)
    spread(I2, first, width, bodies.I2)
    spread(I13, first, width, bodies.I13)
    spread(I23, first, width, bodies.I23)
    spread(k, first, width, bodies.k)
    spread(eps, first, width, bodies.eps)


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
def first_missing(tile, size, s):
    """Return the lane of the first state without a result."""
    l = 0
    while not np.isnan(tile[size * l]) or np.isnan(s.omega1[l] + s.omega2[l]):
        l += 1
    return l


@formula
def any_infinite(s):
    """Test that a state so far was infinite."""
    infinite = False
    for l in range(LANES):
        infinite |= s.largest[l] == np.inf
    return infinite


def evaluate(part, parts, parameters, omega, out, period, counts):
    """Evaluate a quantity in a part of the tasks."""
    bodies, s = rows_of(units.Body, LANES), rows_of(States, LANES)
    tile, flat, results = stack(_MOST), omega.reshape(omega.size), out.reshape(out.size)
    count, tasks, shared = len(omega), len(counts), True
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
                lanes = LANES if shared else width
                enter_bodies(parameters, block * LANES, lanes, bodies)
                for l in range(lanes):
                    b = lane(bodies, l)
                    put(bodies, l, quantity.enter(b.I1, b.I2, b.I13, b.I23, b.k, b.eps))
                entered = block
            first = time * period + block * LANES
            width = max(min(width, count - first), 0)  # the last repetition may be incomplete
            enter_states(flat, first, width, s)
            for l in range(width):
                result = quantity.at_state(lane(bodies, l), s.omega1[l], s.omega2[l])
                put(tile, quantity.size * l, result)
            numbers = results[quantity.size * first : quantity.size * (first + width)]
            for k in range(numbers.size):
                numbers[k] = tile[k]
            lost = 0
            for l in range(width):
                result, total = tile[quantity.size * l], s.omega1[l] + s.omega2[l]
                lost += (result != result) & (total == total)
            if lost > 0 and missing == 0:
                counts[task, FIRST] = first + first_missing(tile, quantity.size, s)
            missing += lost
        counts[task, MISSING], counts[task, INFINITE] = missing, any_infinite(s)


def leaving(*dimensions):
    """Return the formula of the way out, for results of these dimensions.

    A dimension holds exponents of moments, of products of inertia and of omega. Of four results the
    last two have none.
    """
    (m1, p1, w1), (m2, p2, w2) = (dimensions * 2)[:2]

    def one(value, u):
        return units.leave(value, u, m1, p1, w1)

    def two(values, u):
        return units.leave(values[0], u, m1, p1, w1), units.leave(values[1], u, m2, p2, w2)

    def four(values, u):
        first, second = units.leave(values[0], u, m1, p1, w1), units.leave(values[1], u, m2, p2, w2)
        return first, second, values[2], values[3]

    def unchanged(values, u):
        return values

    scales = any(map(any, dimensions))
    return formula({1: one, 2: two, 4: four}[len(dimensions)] if scales else unchanged)


def of_body(name, evaluated, *dimensions):
    """Build the kernel of a formula of a problem in its own units."""
    leave = leaving(*dimensions)

    @formula
    def at_state(body, omega1, omega2):
        problem, unit = units.of_state(body, omega1, omega2)
        return leave(evaluated(*problem), unit)

    return of_formulas(name, len(dimensions), units.of_body, at_state)


def of_two_terms(name, evaluated, *dimensions):
    """`of_body` for a difference of terms, each with a dimension of its own."""
    leave = leaving(*dimensions)

    @formula
    def at_state(body, omega1, omega2):
        problem, unit = units.of_state(body, omega1, omega2)
        first, second = leave(evaluated(*problem), unit)
        return first - second

    return of_formulas(name, 1, units.of_body, at_state)


def of_formulas(name, size, enter, at_state):
    """Build the kernel of a quantity from its formulas."""
    contents = namespace(name, size=size, enter=enter, at_state=at_state)
    return Kernel(evaluate, name, quantity=contents)


@formula
def as_given(I1, I2, I13, I23, k, eps):
    """A body in the units of the user."""
    return units.Body(I1, I2, I13, I23, k, eps, 0.0, 0.0, 0.0, 0.0)


@formula
def energy_at_state(body, omega1, omega2):
    """In the units of the user: no product is out of range unless the result is."""
    return integrals.energy(body.I1, body.I2, omega1, omega2)


@formula
def from_xy_at_state(body, x, y):
    """A state from (x, y), of the dimensions of `to_xy`."""
    W = larger(exponent(x) - body.P, exponent(y) - body.P - body.M)
    x, y = scaled(x, -W - body.P), scaled(y, -W - body.P - body.M)
    omega1, omega2 = coordinates.from_xy(body.I1, body.I2, body.I13, body.I23, x, y)
    return scaled(omega1, W), scaled(omega2, W)


energy = of_formulas("energy", 1, as_given, energy_at_state)
from_xy = of_formulas("from_xy", 2, units.of_body, from_xy_at_state)
_REACTION = (-1, 2, 2), (1, 0, 2)
reaction = of_two_terms("reaction", equations.reaction, *_REACTION)
discrete_reaction = of_two_terms("discrete_reaction", equations.discrete_reaction, *_REACTION)

first_integral = of_body("first_integral", integrals.first_integral, (-1, 0, 2))
modified_energy = of_body("modified_energy", integrals.modified_energy, (1, 0, 2))
criticality = of_body("criticality", integrals.criticality, (0, 0, 0))
rotation_number = of_body("rotation_number", integrals.rotation_number, (0, 0, 0))
invariant_density = of_body("invariant_density", integrals.invariant_density, (-2, -1, -1))
to_xy = of_body("to_xy", coordinates.to_xy, (0, 1, 1), (1, 1, 1))
vector_field = of_body("vector_field", equations.vector_field, (-1, 1, 2), (-1, 1, 2))
jacobian = of_body("jacobian", equations.jacobian, *[(0, 0, 0)] * 4)
matrix = of_body("matrix", equations.matrix, *[(0, 0, 0)] * 4)
constants = of_body("constants", integrals.constants, (0, 2, 2), (-1, 1, 1), (0, 0, 0), (0, 0, 0))
