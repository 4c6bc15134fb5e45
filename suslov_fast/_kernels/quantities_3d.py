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

import numpy as np

from .._formulas import coordinates, equations, integrals, units
from .._formulas.elementary import exponent, larger, scaled
from .._jit import Kernel, formula, lane, namespace, put, rows_of, share, stack
from .lanes import LANES, all_share, spread

# The number of states without a result that are not NaN, the first of them, and that of infinite
# states.
MISSING, FIRST, INFINITE = range(3)
_MOST = 4 * LANES  # results

# What a quantity provides: `size`, the number of its results; `enter`, from the parameters of a
# body to a `units.ScaledBody`; `at_state`, from that and a state to the results.
quantity = namespace("quantity")


def evaluate(part, parts, parameters, omega, out, period, counts):
    """Evaluate a quantity in a part of the tasks."""
    bodies, tile = rows_of(units.ScaledBody, LANES), stack(_MOST)
    flat, results = omega.reshape(omega.size), out.reshape(out.size)
    count, tasks, shared = len(omega), len(counts), all_share(parameters)
    times = (count + period - 1) // period
    pieces = (period + LANES - 1) // LANES * times
    first_task, last_task = share(tasks, part, parts)
    for task in range(first_task, last_task):
        missing, first_missing, infinite, entered = 0, count, 0, -1
        for piece in range(task * pieces // tasks, (task + 1) * pieces // tasks):
            block, time = piece // times, piece % times
            width = min(LANES, period - block * LANES)
            if entered < 0 or (block != entered and not shared):
                lanes = LANES if shared else width
                for k in range(len(parameters)):
                    spread(parameters[k], block * LANES, lanes, bodies[k])
                for l in range(lanes):
                    b = lane(bodies, l)
                    put(bodies, l, quantity.enter(b.I1, b.I2, b.I13, b.I23, b.k, b.eps))
                entered = block
            first = time * period + block * LANES
            width = max(min(width, count - first), 0)  # the last repetition may be incomplete
            states = flat[2 * first : 2 * (first + width)]
            for l in range(width):
                result = quantity.at_state(lane(bodies, l), states[2 * l], states[2 * l + 1])
                put(tile, quantity.size * l, result)
            numbers = results[quantity.size * first : quantity.size * (first + width)]
            for k in range(numbers.size):
                numbers[k] = tile[k]
            lost = 0
            for l in range(width):
                result, total = tile[quantity.size * l], abs(states[2 * l]) + abs(states[2 * l + 1])
                lost += (result != result) & (total == total)
                infinite += total == np.inf
            for l in range(width if lost > 0 else 0):
                result, total = tile[quantity.size * l], abs(states[2 * l]) + abs(states[2 * l + 1])
                if np.isnan(result) and not np.isnan(total):
                    first_missing = min(first_missing, first + l)
            missing += lost
        counts[task, MISSING], counts[task, FIRST] = missing, first_missing
        counts[task, INFINITE] = infinite


def of_formulas(name, size, enter, at_state):
    """Build the kernel of a quantity from a formula and a function that becomes one.

    Numba distinguishes closures by names, in the cache too.
    """
    at_state.__qualname__ = f"{name}_at_state"
    contents = namespace(name, size=size, enter=enter, at_state=formula(at_state))
    return Kernel(evaluate, name, quantity=contents)


def of_body(name, evaluated, *dimensions):
    """Build the kernel of a formula of a problem in its own units, for one result or two.

    The dimension of a result holds exponents of moments, of products of inertia and of omega.
    """
    first, second = (dimensions * 2)[:2]

    def one(body, omega1, omega2):
        problem, unit = units.of_state(body, omega1, omega2)
        return units.leave(evaluated(*problem), unit, *first)

    def two(body, omega1, omega2):
        problem, unit = units.of_state(body, omega1, omega2)
        value1, value2 = evaluated(*problem)
        return units.leave(value1, unit, *first), units.leave(value2, unit, *second)

    return of_formulas(name, len(dimensions), units.of_body, (one, two)[len(dimensions) - 1])


def of_numbers(name, size, evaluated):
    """`of_body` for results without a dimension."""

    def at_state(body, omega1, omega2):
        problem, _ = units.of_state(body, omega1, omega2)
        return evaluated(*problem)

    return of_formulas(name, size, units.of_body, at_state)


def of_reaction(name, evaluated):
    """`of_body` for the difference of two terms, each with a dimension of its own."""

    def at_state(body, omega1, omega2):
        problem, unit = units.of_state(body, omega1, omega2)
        first, second = evaluated(*problem)
        return units.leave(first, unit, -1, 2, 2) - units.leave(second, unit, 1, 0, 2)

    return of_formulas(name, 1, units.of_body, at_state)


@formula
def as_given(I1, I2, I13, I23, k, eps):
    """A body in the units of the user."""
    return units.ScaledBody(I1, I2, I13, I23, k, eps, 0.0, 0.0, 0.0, 0.0)


def energy_at_state(body, omega1, omega2):
    """In the units of the user: no product is out of range unless the result is."""
    return integrals.energy(body.I1, body.I2, omega1, omega2)


def from_xy_at_state(body, x, y):
    """A state from (x, y), of the dimensions of `to_xy`."""
    W = larger(exponent(x) - body.P, exponent(y) - body.P - body.M)
    x, y = scaled(x, -W - body.P), scaled(y, -W - body.P - body.M)
    omega1, omega2 = coordinates.from_xy(body.I1, body.I2, body.I13, body.I23, x, y)
    return scaled(omega1, W), scaled(omega2, W)


def constants_at_state(body, omega1, omega2):
    problem, unit = units.of_state(body, omega1, omega2)
    h, k1, k2, t = integrals.constants(*problem)
    return units.leave(h, unit, 0, 2, 2), units.leave(k1, unit, -1, 1, 1), k2, t


energy = of_formulas("energy", 1, as_given, energy_at_state)
from_xy = of_formulas("from_xy", 2, units.of_body, from_xy_at_state)
constants = of_formulas("constants", 4, units.of_body, constants_at_state)
reaction = of_reaction("reaction", equations.reaction)
discrete_reaction = of_reaction("discrete_reaction", equations.discrete_reaction)
criticality = of_numbers("criticality", 1, integrals.criticality)
rotation_number = of_numbers("rotation_number", 1, integrals.rotation_number)
jacobian = of_numbers("jacobian", 4, equations.jacobian)
matrix = of_numbers("matrix", 4, equations.matrix)

first_integral = of_body("first_integral", integrals.first_integral, (-1, 0, 2))
modified_energy = of_body("modified_energy", integrals.modified_energy, (1, 0, 2))
invariant_density = of_body("invariant_density", integrals.invariant_density, (-2, -1, -1))
to_xy = of_body("to_xy", coordinates.to_xy, (0, 1, 1), (1, 1, 1))
vector_field = of_body("vector_field", equations.vector_field, (-1, 1, 2), (-1, 1, 2))
