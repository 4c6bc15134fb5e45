"""Steps of one state of a field or a map, for loops of users.

`step_of_one` takes a step in a loop of Python, `compiled.step_system` in a compiled loop.
"""

import functools
import math
from array import array
from typing import Any, NamedTuple

import numpy as np

from ..llvm.compiler import address_of, code_of, known_codes
from ..numba.decorators import function
from ..numba.intrinsics import call_code, with_address
from ..numba.status_codes import NONFINITE, OK, PASSED_POLE
from .driver import DONE, SLOT, DriverArguments, text_of_steps
from .kernel import scheme_of
from .packs import common_table, plan_of
from .pivoting import changes_sign, solve_lane
from .stage_code import text_of_stage
from .tolerances import FIELDS_IN_MEMORY, OPERATIONS_WITHOUT_PAUSE


@functools.lru_cache(FIELDS_IN_MEMORY)
def _prepared(step, stages, eps, values, saves):
    """Return a step's code, its `DriverArguments`, and arrays that must stay alive."""
    table = common_table(step, stages, eps, values)[1]
    plan = plan_of(stages, table)
    numbers = DriverArguments(
        x=0, lines=1, block=1, steps=len(plan), plan=address_of(plan), stages=len(plan), until=-1,
        budget=1,
    )  # fmt: skip
    code = code_of(text_of_steps, step, 1, False, saves)
    return code, array("q", [*numbers, 0]), (table, plan)


def steps_of_one(arguments, x, count=1, every=0, saved=None):
    """Return state number `count` from x (D,); None if only the kernel of steps can take the steps.

    States with multiples of `every` as numbers go to `saved`, unless `every` is 0. A call takes a
    sixth of the time of the kernel.
    """
    (step, stages), values, eps = arguments
    parts = len(stages.fractions)
    work = count * parts * (step.length or 1)
    if not (step.usual and 0 < work <= OPERATIONS_WITHOUT_PAUSE and math.isfinite(sum(x.tolist()))):
        return None
    code, template, _ = _prepared(step, stages, eps.tobytes(), values.tobytes(), every > 0)
    x, numbers = x.copy(), template[:]
    numbers[SLOT.steps] = count * parts
    if every:
        saved[0] = x
        numbers[SLOT.row] = address_of(saved) + saved.strides[0]
        numbers[SLOT.row_bytes] = saved.strides[0]
        numbers[SLOT.until] = numbers[SLOT.between] = min(every, count + 1) * parts - 1
    at, _ = numbers.buffer_info()
    numbers[SLOT.x] = address_of(x)
    numbers[SLOT.ended] = numbers[SLOT.passed] = at + 8 * len(SLOT)
    return x if code.call(at) == DONE else None


@with_address
class FieldSystem(NamedTuple):
    """A field and a step size, or a map, for compiled loops; unpickling makes its code again."""

    address: int  # address of the code of `stage_code.text_of_stage`, 0 if there is none
    half: Any  # (stages, T), eps / 2 of a stage times coefficients of terms; (1, 0) for a map
    table: Any  # (stages, n), a row for each stage: the n numbers listed in `Step.table`
    indices: Any  # (3, T), i, j and k of the terms
    dimension: int
    is_map: bool

    def __reduce__(self):
        if not self.is_map:
            return system_of, (self.indices, self.half, self.dimension)
        step = next(code.step for code in [*known_codes.values()] if code == self.address)
        return _with_table, (step, self.table)


def system_of(indices, half, D):
    """Return a field and a step size, for compiled loops; `half` (stages, T) is v eps_stage / 2."""
    step = scheme_of(indices, D).step
    table = np.ascontiguousarray(step.table_of(half.T).T)
    # The code is never freed, because users may store the system, with its address, anywhere.
    address = code_of(text_of_stage, step, lasts=True) if step.usual else None
    return FieldSystem(int(address or 0), half, table, step.indices, D, False)


def map_system_of(step, parameters):
    """Return the `FieldSystem` of a `MapStep` with these parameters (P,)."""
    return _with_table(step, np.ascontiguousarray(step.table_of(parameters))[np.newaxis])


def _with_table(step, table):
    code = code_of(text_of_stage, step, lasts=True)
    code.step = step  # `FieldSystem.__reduce__` pickles it
    return FieldSystem(int(code), np.empty((1, 0)), table, np.empty((3, 0), np.int64), step.D, True)


@function
def field_memory(system):
    """Return the arrays (matrix, units, state) in which all calls of `field_step_of_one` work."""
    D = system.dimension
    return np.empty((D, D + 1)), np.empty((2, D)), np.empty((D,))


@function
def field_step_of_one(system, state, out, memory):
    """Write the state after `state` to `out`; return its status."""
    matrix, units, x = memory
    status, passed = OK, False
    for i in range(len(x)):
        x[i] = state[i]
    for stage in range(len(system.half)):
        for i in range(len(x)):
            out[i] = x[i]
        bits = np.int64(1)  # 1: not accurate, or there is no code; 256: det A < 0
        if system.address != 0:
            table = system.table[stage].ctypes.data
            bits = call_code(system.address, (x.ctypes.data, table))
        negative = bits & 256 != 0
        if bits & 1 and system.is_map:
            status = NONFINITE
        elif bits & 1:
            status, negative = solve_lane(system.indices, system.half[stage], x, matrix, units)
        passed |= negative
        if status != OK:
            break
        if not system.is_map:
            passed |= changes_sign(system.indices, out, x)
    for i in range(len(x)):
        out[i] = x[i] if status == OK else np.nan
    return PASSED_POLE if passed and status == OK else status


# Functions that `compiled` calls for a `FieldSystem`.
FieldSystem.memory, FieldSystem.one_step = field_memory, field_step_of_one
