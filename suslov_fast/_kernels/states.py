"""Quantities of states: one loop over states for all formulas.

States are contiguous. Those of a run repeat the batch, and with it the bodies, at each time. A task
processes blocks of LANES bodies, and for each block all times, so that data of the bodies are
computed once. Arguments of a kernel:

parameters   parameters of the body, and eps: arrays of `period` numbers each, or of one for all
omega        (count, 2), the states
out          (count, size), the results
period       number of states after which the bodies repeat
report       (tasks, 3), at first 0; columns MISSING, FIRST and INFINITE
"""

import numpy as np

from .._formulas import continuous, coordinates, gyrostat, integrals, linearised, section4, units
from .._jit import Kernel, carray, formula, share, stack
from .lanes import LANES

# Rows of a block: parameters; the body; the state and its largest component so far; results.
GIVEN, BODY, STATE, RESULT = 6, 10, 3, 4
_GIVEN, _BODY, _STATE, _RESULT = GIVEN * LANES, BODY * LANES, STATE * LANES, RESULT * LANES
LARGEST = 2
# The number of states without a result that are not NaN, the first of them, and 1 if a state is
# infinite.
MISSING, FIRST, INFINITE = range(3)


@formula
def spread(parameter, first, width, row):
    """Fill a row with a parameter of the bodies of a block."""
    if parameter.size == 1:
        for l in range(width):
            row[l] = parameter[0]
    else:
        # LLVM knows that indices from 0 on are not negative.
        numbers = parameter[first : first + width]
        for l in range(width):
            row[l] = numbers[l]


@formula
def enter_states(flat, first, width, s):
    """Fill the rows of states, and update that of the largest components."""
    numbers = flat[2 * first : 2 * (first + width)]
    for l in range(width):
        omega1, omega2 = numbers[2 * l], numbers[2 * l + 1]
        s[0, l] = omega1
        s[1, l] = omega2
        s[LARGEST, l] = max(max(abs(omega1), abs(omega2)), s[LARGEST, l])


@formula
def count_missing(r, s, width):
    """Return the number of states without a result, and the lane of the first."""
    count = 0
    for l in range(width):
        total = s[0, l] + s[1, l]
        count += (r[0, l] != r[0, l]) & (total == total)
    l = 0
    if count > 0:
        while r[0, l] == r[0, l] or np.isnan(s[0, l] + s[1, l]):
            l += 1
    return count, l


@formula
def any_infinite(s):
    """Test that a state so far was infinite."""
    infinite = False
    for l in range(LANES):
        infinite |= s[LARGEST, l] == np.inf
    return infinite


@formula
def write(r, first, width, size, flat):
    """Write the results of a block."""
    numbers = flat[size * first : size * (first + width)]
    if size == 1:
        for l in range(width):
            numbers[l] = r[0, l]
    elif size == 2:
        for l in range(width):
            numbers[2 * l] = r[0, l]
            numbers[2 * l + 1] = r[1, l]
    else:
        for l in range(width):
            numbers[4 * l] = r[0, l]
            numbers[4 * l + 1] = r[1, l]
            numbers[4 * l + 2] = r[2, l]
            numbers[4 * l + 3] = r[3, l]


@formula
def put_one(r, l, value):
    r[0, l] = value


@formula
def put_pair(r, l, values):
    r[0, l], r[1, l] = values


@formula
def put_matrix(r, l, values):
    r[0, l], r[1, l], r[2, l], r[3, l] = values


def evaluate(part, parts, parameters, omega, out, period, report):
    """Evaluate a quantity in a part of the tasks."""
    g, b = carray(stack(_GIVEN), (GIVEN, LANES)), carray(stack(_BODY), (BODY, LANES))
    s, r = carray(stack(_STATE), (STATE, LANES)), carray(stack(_RESULT), (RESULT, LANES))
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
            s[LARGEST, l] = 0.0
        for piece in range(task * pieces // tasks, (task + 1) * pieces // tasks):
            block, time = piece // times, piece % times
            width = min(LANES, period - block * LANES)
            if entered < 0 or (block != entered and not shared):
                for k in range(len(parameters)):
                    spread(parameters[k], block * LANES, width, g[k])
                for l in range(width):
                    enter(g, b, l)
                entered = block
            first = time * period + block * LANES
            width = max(min(width, count - first), 0)  # the last repetition may be incomplete
            enter_states(states, first, width, s)
            for l in range(width):
                put(r, l, at_lane(b, s, l))
            write(r, first, width, size, results)
            lost, lane = count_missing(r, s, width)
            if lost > 0 and missing == 0:
                report[task, FIRST] = first + lane
            missing += lost
        report[task, MISSING], report[task, INFINITE] = missing, any_infinite(s)


def quantity(name, enter, at_lane, size=1):
    """Make the kernel of a quantity of `size` numbers, from formulas for one lane."""
    put = {1: put_one, 2: put_pair, 4: put_matrix}[size]
    return Kernel(evaluate, name, enter=enter, at_lane=at_lane, put=put, size=size)


@formula
def enter_moments(g, b, l):
    b[0, l], b[1, l] = g[0, l], g[1, l]


@formula
def energy_at_lane(b, s, l):
    return integrals.energy(b[0, l], b[1, l], s[0, l], s[1, l])


@formula
def enter_body(g, b, l):
    b[0, l], b[1, l], b[2, l], b[3, l], b[4, l], b[5, l], b[6, l], b[7, l] = units.normal_body(
        g[0, l], g[1, l], g[2, l], g[3, l], g[4, l]
    )


def of_body(name, quantity_of, size=1):
    """Build the kernel of a formula of a body in 3D and a state."""

    @formula
    def at_lane(b, s, l):
        return quantity_of(
            b[0, l], b[1, l], b[2, l], b[3, l], b[4, l], b[5, l], b[6, l], b[7, l], s[0, l], s[1, l]
        )  # fmt: skip

    return quantity(name, enter_body, at_lane, size)


@formula
def enter_gyrostat(g, b, l):
    (
        b[0, l], b[1, l], b[2, l], b[3, l], b[4, l], b[5, l], b[6, l], b[7, l], b[8, l], b[9, l]
    ) = gyrostat.normal_gyrostat(g[0, l], g[1, l], g[2, l], g[3, l], g[4, l], g[5, l])  # fmt: skip


def of_gyrostat(name, quantity_of, size=1):
    """Build the kernel of a formula of a gyrostat and a state."""

    @formula
    def at_lane(b, s, l):
        return quantity_of(
            b[0, l], b[1, l], b[2, l], b[3, l], b[4, l], b[5, l], b[6, l], b[7, l], b[8, l],
            b[9, l], s[0, l], s[1, l]
        )  # fmt: skip

    return quantity(name, enter_gyrostat, at_lane, size)


energy = quantity("energy", enter_moments, energy_at_lane)
first_integral = of_body("first_integral", integrals.first_integral)
modified_energy = of_body("modified_energy", integrals.modified_energy)
criticality = of_body("criticality", integrals.criticality)
invariant_density = of_body("invariant_density", integrals.invariant_density)
to_xy = of_body("to_xy", coordinates.xy_of_state, 2)
from_xy = of_body("from_xy", coordinates.state_of_xy, 2)
vector_field = of_body("vector_field", continuous.vector_field, 2)
reaction = of_body("reaction", continuous.reaction)
discrete_reaction = of_body("discrete_reaction", continuous.discrete_reaction)
jacobian = of_body("jacobian", linearised.jacobian, 4)
matrix = of_body("matrix", linearised.matrix, 4)
constants = of_body("constants", section4.constants, 4)

gyrostat_first_integral = of_gyrostat("gyrostat_first_integral", gyrostat.first_integral)
gyrostat_invariant_density = of_gyrostat("gyrostat_invariant_density", gyrostat.invariant_density)
gyrostat_vector_field = of_gyrostat("gyrostat_vector_field", gyrostat.vector_field, 2)
gyrostat_jacobian = of_gyrostat("gyrostat_jacobian", gyrostat.jacobian, 4)
