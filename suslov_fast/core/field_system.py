"""Steps of one state of a field, for compiled loops of users (`compiled.step_system`)."""

from typing import Any, NamedTuple

import numpy as np

from .careful import changes_sign, solve_lane
from .codes import NONFINITE, OK, PASSED_POLE
from .column_stage import column_stage_of
from .generated import text_of_stage, text_of_step
from .listed import programs_of
from .listed_code import text_of_listed_step
from .llvm import call_code, with_address
from .machine_code import code_of
from .numba import function
from .stages import weights_of
from .steps_field import scheme_of


@with_address
class FieldSystem(NamedTuple):
    """A field and a step size. Unpickling it finds the address in that process."""

    address: int  # of the code of `generated.text_of_step`, 0 if there is none
    half: Any  # (stages, T), half of the step size times the values of the terms
    table: Any  # (stages, n), see `Step.table`
    weights: Any  # (stages,), at the ends of columns, else 0
    sums: bool  # see `Scheme.sums_increments`
    indices: Any  # (3, T)
    dimension: int

    def __reduce__(self):
        return with_weights, (self.indices, self.half, self.weights, self.dimension)


def system_of(indices, half, stages, D):
    """Return the system of a field, from eps / 2 times its values for each stage (stages, T)."""
    return with_weights(indices, half, np.ascontiguousarray(weights_of(stages)[:, 0]), D)


def with_weights(indices, half, weights, D):
    """Return the system with these weights of stages."""
    step, text_of = scheme_of(indices, D).step, text_of_step
    if weights[-1] != 0.0:  # the last column of an extrapolated step
        step, text_of = column_stage_of(step.indices.tobytes(), D), text_of_stage
    table = np.ascontiguousarray(step.table_of(half.T).T)
    if step.is_long:
        text_of, table = text_of_listed_step, programs_of(step).numbers.of(table.T).T.copy()
    # The code lasts, because users may store the system anywhere.
    address = code_of(text_of, step, lasts=True) if step.usual else None
    sums = bool(address) and text_of is text_of_stage
    return FieldSystem(int(address or 0), half, table, weights, sums, step.indices, D)


@function
def field_memory(system):
    """The memory of `field_step_of_one`."""
    D = system.dimension
    return np.empty((D, D + 1, 1)), np.empty((2, D)), np.empty((3, D)), np.empty((D,))


@function
def take_stages(system, base, rows, total, matrix, units):
    """Replace x, which is the state `base`, by the next state; return its status, and det A < 0.

    `rows` has x, the sum of increments of a column, and a state before a stage.
    """
    status, passed, D = OK, False, len(total)
    x, change, before = rows[0], rows[1], rows[2]
    for i in range(D):
        total[i], change[i] = 0.0, 0.0
    for stage in range(len(system.half)):
        code = np.int64(1)  # of `text_of_step`: 1 if the step is not accurate, 2 if det A < 0
        if system.address != 0:
            code = call_code(system.address, (x.ctypes.data, system.table[stage].ctypes.data))
        negative = code == 2
        if code == 1:
            for i in range(D):
                before[i] = x[i]
            status, negative = solve_lane(system.indices, system.half[stage], x, matrix, units)
            for i in range(D):
                change[i] += x[i] - before[i]
        passed |= negative
        if status != OK:
            break
        weight = system.weights[stage]
        if weight != 0.0:
            for i in range(D):
                total[i] += weight * (change[i] if system.sums else x[i] - base[i])
                x[i], change[i] = base[i], 0.0
    if system.weights[-1] != 0.0 and status == OK:  # the last column of an extrapolated step
        for i in range(D):
            x[i] += total[i]
            status = OK if abs(x[i]) < np.inf and status == OK else NONFINITE
    return status, passed


@function
def field_step_of_one(system, state, out, memory):
    """Write the state that follows `state` to `out`; return its status. For `compiled`."""
    matrix, units, rows, total = memory
    x = rows[0]
    for i in range(len(x)):
        x[i] = state[i]
    status, passed = take_stages(system, state, rows, total, matrix, units)
    passed |= changes_sign(system.indices, state, x)  # now, because `out` may be `state`
    for i in range(len(x)):
        out[i] = x[i] if status == OK else np.nan
    return PASSED_POLE if passed and status == OK else status


# What `compiled` calls for a system of this kind.
FieldSystem.memory, FieldSystem.one_step = field_memory, field_step_of_one
