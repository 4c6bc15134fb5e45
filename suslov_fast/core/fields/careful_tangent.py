"""Derivatives of lanes whose list of operations, or step, loses digits: elimination with pivoting.

`Arguments` and `Memory` are those of `tangent`.
"""

import numpy as np

from ..compiling.codes import OK
from ..compiling.elimination import parts_of_determinant, solve
from ..compiling.numba import function
from .careful import changes_sign, fill_system, solve_lane
from .generated_tangent import FAR_FROM_1, LENGTHS, NEAR_1, VOLUME


@function
def multiply_columns(indices, half, before, after, columns, system, units):
    """Replace each q = columns[r] by -DPhi q, by `solve`; return det DPhi."""
    D = len(before)
    fill_system(indices, half, -1.0, after, system)
    for i in range(D):
        for r in range(D):
            system[i, D + r] = 0.0
            for j in range(D):
                system[i, D + r] -= system[i, j] * columns[r, j]
    for r in range(D):
        for i in range(D):
            columns[r, i] = system[i, D + r]
            system[i, D + r] = 0.0
    solve(system, units)
    of_back, power_of_back = parts_of_determinant(system, units)
    fill_system(indices, half, 1.0, before, system)
    for i in range(D):
        for r in range(D):
            system[i, D + r] = columns[r, i]
    solve(system, units)
    for i in range(D):
        for r in range(D):
            columns[r, i] = system[i, D + r]
    mantissa, power = parts_of_determinant(system, units)
    # In Python 1 / 0 raises.
    return np.ldexp(of_back / np.float64(mantissa), power_of_back - power)


@function
def copy_lanes(arguments, memory, lanes):
    """Copy the states, columns and products of lanes before a step to the memory of `solve`."""
    line, D = memory.line, len(memory.after)
    first = 2 * D + LENGTHS
    for l in range(arguments.W):
        for i in range(D if (lanes >> l) & 1 else 0):
            memory.before[l, i] = line[i, l]
            for r in range(D):
                memory.columns[l, r, i] = line[first + i * arguments.room + r, l]
        memory.products[l, 0], memory.products[l, 1] = line[D + NEAR_1, l], line[D + FAR_FROM_1, l]


@function
def solve_lanes(arguments, memory, place, stage, step, lanes):
    """Compute the derivative of lanes by `solve`, and the step of lanes in `step`.

    Return the bits of lanes whose step was from det A < 0, and in which a component changed its
    sign that keeps it along the motion.
    """
    line, half, after, D = memory.line, memory.half, memory.after, len(memory.after)
    first, indices, halves = 2 * D + LENGTHS, arguments.indices, arguments.halves
    negative, changed = 0, 0
    for l in range(arguments.W):
        if (lanes >> l) & 1 == 0:
            continue
        for t in range(len(half)):
            value = halves[place % len(halves), t, l % halves.shape[2]]
            half[t] = arguments.fractions[stage] * value
        status = OK
        for i in range(D):
            after[i] = memory.before[l, i] if (step >> l) & 1 else line[i, l]
        if (step >> l) & 1:
            status, beyond = solve_lane(indices, half, after, memory.matrix, memory.units)
            negative |= (1 << l) if beyond else 0
            changed |= (1 << l) if changes_sign(indices, memory.before[l], after) else 0
        memory.statuses[l] = status
        before, columns = memory.before[l], memory.columns[l]
        tangent, units = memory.tangent, memory.units
        det = multiply_columns(indices, half, before, after, columns, tangent, units)
        for i in range(D):
            line[i, l] = after[i]
            for r in range(D):
                line[first + i * arguments.room + r, l] = columns[r, i]
        line[D + VOLUME, l], line[D + NEAR_1, l] = 0.0, memory.products[l, 0]
        line[D + FAR_FROM_1, l] = memory.products[l, 1] * abs(det)
    return negative, changed
