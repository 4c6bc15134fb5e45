"""The motion of one trajectory without NumPy's objects, which cost more than its steps.

What is prepared beside the state, its code and arguments, is kept from call to call. Steps and bits
are those of `engine.Motion`.
"""

import functools
from array import array
from math import inf, nan

import numpy as np

from .arguments import NUMBER, SLOT, Arguments
from .engine import (
    BUDGET,
    NO_TIMES,
    code_of_half,
    components_of,
    first_steps,
    half_of,
    numbers_of,
    records_at_once,
    set_times,
)
from .explicit import lane_numbers
from .rows import BEGINS, OF_CHANGES, State

PLANS = 256  # that are kept
_SIZE = 8  # bytes of a number


class _Code:
    """The code of a half for one trajectory; after `last` steps it is to be renewed."""

    def __init__(self, half):
        self.half = half
        self.renew()

    def renew(self):
        """Take the code that is worth its time by now."""
        half, most = self.half, first_steps(self.half, 1)
        self.code = code_of_half(half, 1, half.f.conditions is not None)
        self.last = most if half.steps <= most else inf

    def count(self, steps):
        """Note steps that were taken."""
        self.half.steps += steps
        if self.half.steps > self.last:
            self.renew()


@functools.lru_cache(PLANS)
def _plan(f, table, settings, sign):
    """Return code, arguments, numbers and rows of one trajectory.

    `table` has the bytes of the table of f. The arguments point to arrays that the plan keeps.
    """
    half = half_of(f, bool(settings.stiff), settings.atol is not None)
    code = _Code(half)
    own = array("d", half.table_of(np.frombuffer(table)))
    components = components_of(f, settings.atol)
    arguments = Arguments(
        rows=0, count=1, following=0, budget=0, table=own.buffer_info()[0], table_bytes=0, work=0,
        numbers=0, components=components.ctypes.data, times=0, states=0,
        state_bytes=_SIZE * f.D,
    )  # fmt: skip
    numbers = array("d", numbers_of(settings, sign))
    rows = array("d", bytes(_SIZE * half.rows.size))
    rows[half.rows.state] = BEGINS
    rows = rows[f.D :]  # those after x
    work = array("d", bytes(_SIZE * (half.work.size + lane_numbers(half))))
    budget = max(BUDGET // f.work, 1)
    return code, array("q", arguments), numbers, rows, work, half.rows, budget, (components, own)


def motion_of_one(f, table, x, times, sign, settings, stops=None, enough=inf, since=-1.0):
    """Return states at ascending moduli of times, an array of numbers, t, steps, state and `grown`.

    `table` of f, `x` and `times` are the bytes of their numbers. The result is None if a step would
    be implicit and the trajectory has to choose, or the solution ends: then `engine.Motion`
    computes the motion. With `Stops` states are NaN where there are none, and arrays of records
    come last.
    """
    plan = _plan(f, table, settings, sign)
    code, arguments, numbers, rows, work, places, budget, _ = plan
    arguments, numbers, work = arguments[:], numbers[:], work[:]
    rows, times = array("d", x) + rows, array("d", times)
    count, last = len(times), times[-1]
    times.extend(NO_TIMES)
    set_times(numbers, f, times[0], times[1], last)
    if f.conditions:  # the code writes choices to the table
        table = plan[-1][1][:]
        arguments[SLOT.table] = table.buffer_info()[0]
    if stops is None:
        states = array("d", bytes(count * len(x)))
    else:
        states = array("d", [nan]) * (count * f.D)
        of_stops, equal = stops.array()
        first = places.of_changes
        rows[first + OF_CHANGES.stop], rows[first + OF_CHANGES.stop_which] = of_stops[0, 0].tolist()
        numbers[NUMBER.enough], numbers[NUMBER.since] = enough, since
        at_once, found = records_at_once(f.changes, equal), []
        buffer = np.empty((4 * at_once, f.changes.record(f.D)))
        arguments[SLOT.stops], arguments[SLOT.records] = of_stops.ctypes.data, buffer.ctypes.data
        arguments[SLOT.full] = 3 * at_once
    arguments[SLOT.rows] = rows.buffer_info()[0]
    arguments[SLOT.work] = work.buffer_info()[0]
    arguments[SLOT.numbers] = numbers.buffer_info()[0]
    arguments[SLOT.times] = times.buffer_info()[0]
    arguments[SLOT.states] = states.buffer_info()[0]
    at, before = arguments.buffer_info()[0], 0.0
    while True:
        arguments[SLOT.budget] = budget
        is_done = code.code.call(at)
        if code.last < inf:
            taken = rows[places.steps]
            code.count(taken - before)
            before = taken
        if stops is not None and (recorded := arguments[SLOT.recorded]):
            found.append(buffer[:recorded].copy())
            arguments[SLOT.recorded] = 0
        if is_done:
            break
    state = int(rows[places.state])
    if state < State.DONE or state == State.ENDED:  # the other half goes on, or looks for the cause
        return None
    low = rows[places.low : places.far]
    grown = low.index(3.0) if 3.0 in low else -1
    if stops is None:
        return states, rows[places.t], int(rows[places.steps]), state, grown
    t = rows[places.t if state != State.ACCUMULATES else first + OF_CHANGES.at]
    return states, t, int(rows[places.steps]), state, grown, found
