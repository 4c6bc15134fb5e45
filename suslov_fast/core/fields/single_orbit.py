"""Short runs of one orbit of a field, without NumPy's objects: users call `step` in loops.

What a run prepares beside its state, its code, tables and arguments, is kept from call to call.
"""

import functools
from array import array

import numpy as np

from ..code.compiler import address_of, code_of
from .driver import NOT_READY, SLOT, DriverArguments, text_of_steps
from .stages import distinct

PLANS = 32  # of fields, whose tables are kept
SHORT = 256  # steps of a short run


@functools.lru_cache(PLANS)  # because it takes long beside a few steps
def common_table(step, stages, eps, values):
    """Return the halves and the table (fractions, 1, n, 1) of one field, from bytes of numbers."""
    values, fractions = np.frombuffer(values), distinct(stages.fractions)[0]
    halves = 0.5 * np.frombuffer(eps) * values
    table = step.table_of(np.outer(halves, fractions))
    return halves[np.newaxis, :, np.newaxis], np.ascontiguousarray(table.T)[
        :, np.newaxis, :, np.newaxis
    ]


def plan_of(stages, table, halves=None):
    """Return the plan (stages, 2) of `DriverArguments`; without a table, of the halves h v."""
    plan = np.empty((len(stages.fractions), 2))
    plan[:, 1] = stages.fractions
    if table is None:
        plan.view(np.int64)[:, 0] = halves.ctypes.data
    else:
        places = distinct(stages.fractions)[1]
        plan.view(np.int64)[:, 0] = table.ctypes.data + table.strides[0] * places
    return plan


def compares_signs(step):
    """Return whether signs are compared over whole steps of several stages."""
    return bool(step.of_one_sign and not step.keeps_signs)


@functools.lru_cache(PLANS)
def _prepared(step, stages, eps, values, saves):
    """Return code and arguments for one orbit, and what has to stay alive; None if it has none."""
    if not step.usual or step.is_long:
        return None
    address = code_of(text_of_steps, step, 1, False, 8 if saves else 0, compares_signs(step))
    if address is None:
        return None
    table = common_table(step, stages, eps, values)[1]
    plan = plan_of(stages, table)
    numbers = dict.fromkeys(DriverArguments._fields, 0) | {
        "lines": 1, "block": 1, "plan": plan.ctypes.data, "stages": len(plan), "trajectories": 1,
        "budget": 1,
    }  # fmt: skip
    marks = 0  # after the arguments
    return address, array("q", [*DriverArguments(**numbers), marks]), (table, plan)


def take_one(arguments, state, status, final, steps, saved):
    """Take the steps of a short run of one orbit; return False if others have to take them."""
    ((step, stages), values, eps), (start, stop, every, row) = arguments, steps
    if not 0 < stop - start <= SHORT or status.item():
        return False
    found = _prepared(step, stages, eps.tobytes(), values.tobytes(), every > 0)
    if found is None:
        return False
    (address, template, _), count = found, len(stages.fractions)
    x, numbers, bases = array("d", state.tobytes()), template[:], None
    at, _ = numbers.buffer_info()
    numbers[SLOT.x], _ = x.buffer_info()
    if compares_signs(step):
        bases = x[:]
        numbers[SLOT.bases], _ = bases.buffer_info()
    numbers[SLOT.ended] = numbers[SLOT.passed] = at + 8 * len(SLOT)
    numbers[SLOT.steps] = (stop - start) * count
    numbers[SLOT.first_until] = numbers[SLOT.until] = -1
    if every:
        if start == 0:
            saved[row] = state
            row += 1
        numbers[SLOT.first_until] = numbers[SLOT.until] = (every - start % every) * count - 1
        numbers[SLOT.between] = every * count - 1
        if row < len(saved):
            numbers[SLOT.first_row] = numbers[SLOT.row] = address_of(saved[row])
            numbers[SLOT.row_bytes] = saved.strides[0]
    if address.call(at) == NOT_READY:  # a step needs `careful`
        return False
    final[0] = x
    return True
