"""The motion of one state to a tolerance, without NumPy's objects, which cost more than its steps.

What is prepared beside the state, its code and arguments, is kept from call to call. Steps and bits
are those of `flow`.
"""

import functools
from array import array

import numpy as np

from .flow import BUDGET, DIFFERENCE, plan_of
from .generated_flow import SLOT, FlowArguments, rows_of, text_of_flow
from .machine_code import code_of
from .single_orbit import PLANS
from .tolerance import AT_FIRST, MOST_STEPS

_SIZE = 8  # bytes of a number


@functools.lru_cache(PLANS)
def _prepared(step, values, rtol, direction):
    """Return code, arguments, `Rows`, and what stays alive; None without code for one state."""
    if not step.usual or step.pieces[1]:
        return None
    if (address := code_of(text_of_flow, step)) is None:
        return None
    # Numbers of one line, in the order of the arguments: rtol, and the values of the terms.
    kept = np.frombuffer(array("d", [rtol, *np.frombuffer(values).tolist()]).tobytes()).copy()
    plan, at = plan_of(direction), kept.ctypes.data
    numbers = dict.fromkeys(FlowArguments._fields, 0) | {
        "lines": 1, "plan": plan.ctypes.data, "columns": len(plan), "trajectories": 1,
        "difference": DIFFERENCE.ctypes.data, "rtol": at, "values": at + _SIZE,
        "state_bytes": _SIZE * step.D, "beginning": 1, "taking": 1, "next": 1,
    }  # fmt: skip
    return address, array("q", FlowArguments(**numbers)), rows_of(step), (kept, plan)


def motion_of_one(step, values, x, rtol, direction, times):
    """Return the states at ascending moduli of times, as one list, and those of `Motion.ends`.

    Return None if others have to compute the motion. `x` and `times` are lists of numbers; `values`
    (T,) are those of the terms.
    """
    found = _prepared(step, values.tobytes(), rtol, direction)
    if found is None:
        return None
    address, template, places, _ = found
    rows, n = array("d", bytes(_SIZE * places.size)), len(x)
    rows[places.base : places.base + n] = array("d", x)
    rows[places.wanted], rows[places.longer] = times[-1], AT_FIRST
    ends, states = array("d", times), array("d", bytes(_SIZE * n * len(times)))
    numbers, lines = template[:], array("q", [0, 0])  # the number of the line, and its next time
    numbers[SLOT.rows], _ = rows.buffer_info()
    numbers[SLOT.times], numbers[SLOT.count] = ends.buffer_info()
    numbers[SLOT.states], _ = states.buffer_info()
    numbers[SLOT.active], _ = lines.buffer_info()
    numbers[SLOT.place] = numbers[SLOT.active] + _SIZE
    at, _ = numbers.buffer_info()
    while True:
        numbers[SLOT.budget] = max(BUDGET // len(step.usual), 1)
        if address.call(at):
            break
    ends = rows[places.wanted] == 0.0, rows[places.time], rows[places.steps] >= MOST_STEPS
    return states, ends
