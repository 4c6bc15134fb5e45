"""The motion of one state over a given time, for users' compiled loops, in memory that they hold.

Steps and bits are the same as in `BatchSolver`. A call may change the integrator.
"""

import math
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from ..numba import status_codes
from ..numba.decorators import function
from ..numba.intrinsics import call_code, with_address
from ..numba.status_codes import NONFINITE, NOT_KEPT, OK
from . import batch_solver
from .code_arguments import COMPONENT, NUMBER, SLOT
from .events.actions import most_records
from .events.records import size_of
from .growing_components import TRIES
from .memory import BEGINS, LaneState
from .program_code import TABLE, code_of_program
from .tolerances import LONGEST_PART, SAME_END

# Status by `LaneState`; the last entry is for a run that was ended before its first step (-1).
STATUS = np.full(LaneState.AGAIN + 2, status_codes.TOO_MANY_STEPS, np.int8)
STATUS[LaneState.DONE], STATUS[LaneState.NO_VALUE] = OK, NONFINITE
for _name in ("ENDED", "SLIDING", "STOPPED", "ACCUMULATES"):
    STATUS[getattr(LaneState, _name)] = getattr(status_codes, _name)
_IMPLICIT, _DONE = LaneState.IMPLICIT, LaneState.DONE
_STOPPED, _ACCUMULATES, _AGAIN = LaneState.STOPPED, LaneState.ACCUMULATES, LaneState.AGAIN
_ENDED, _TOO_MANY, _NO_VALUE = LaneState.ENDED, LaneState.TOO_MANY, LaneState.NO_VALUE
_LAST, _WITHOUT = len(TRIES), len(TRIES) + 1  # numbers of tries; the first computation has 0
_OF_ALL = (False, *(each.of_all for each in TRIES), False)
OF_ANOTHER = -128  # returned as a status if the memory belongs to another system
HALF = math.sqrt(0.5)
_ENDLESS = 2**62  # steps of the budget: compiled loops do not pause for Ctrl-C
_kept = {}  # codes by their addresses: a code in this dictionary stays in memory


class Plan(NamedTuple):
    """Integers of a `MotionSystem`: addresses, and where parts begin in `constants` and memory."""

    implicit: int  # address of the code of the implicit integrator, unused if `stiff` is False
    first_again: int  # address of the code that begins a motion again after digits were lost
    implicit_again: int  # address of the code of the implicit integrator for motions begun again
    of_table: int  # address of the code for the table of f, 0 if the table is the parameters
    of_constraints: int  # address of the code that tests if x is on constraints, 0 without any
    is_bounded: int  # 1 if steps are at most LONGEST_PART of the time
    by_starts: int  # number of columns of derivatives by x0, which come first: D or 0
    columns: int  # number of all columns of derivatives
    D: int  # number of components of x
    clocks: int  # place in the plan where pairs (`_CLOCKS`) end, and parameters of columns begin
    # In `constants`, after the rows of `ComponentNumbers`:
    components_again: int  # rows of `ComponentNumbers` for motions that are computed again
    numbers_again: int  # `SharedNumbers` for motions that are computed again
    event_times: int  # pairs (time, event); 0 without events
    template: int  # content of the memory from `numbers` to `table` before a motion
    # In memory, after `CodeArguments` and the address of the code:
    ended: int  # the time at which the motion ended, then the scale of columns of x0, a power of 2
    state: int  # the state after the given time
    numbers: int  # `SharedNumbers`
    times: int  # the given time, and two infinite times
    rows: int  # rows of the trajectory, see `memory`
    inputs: int  # all parameters of f
    table: int  # the table of f, which follows the parameters
    work: int  # workspace of the first integrator
    other: int  # workspace of the implicit integrator
    records: int
    start: int  # the state at the start and the table of f, then what `of_constraints` finds
    size: int
    size_of_record: int
    size_of_table: int
    # Places in the rows:
    t: int
    lane_state: int
    at: int  # the time at which actions of events accumulate
    lost: int  # relative errors of components, see `growing_components`
    unkept: int  # results of tests of first integrals, see `projected_states`; 0 without integrals


PLAN = Plan(*range(len(Plan._fields)))
_ARGUMENTS = len(SLOT) + 1
# After `Plan` there are pairs: a clock, and the number of the parameter with its start value.
_CLOCKS = len(PLAN)


@with_address
class MotionSystem(NamedTuple):
    """A field and a time, for compiled loops."""

    # Few fields, because a call from Python takes 0.1 us for each.
    address: int  # address of the code of the integrator with which a motion begins
    plan: Any  # `Plan`, as an array
    constants: Any
    parameters: Any  # (n,), the first n parameters of f
    time: float
    dimension: int  # number of all components: of x, and of its columns of derivatives


PARAMETERS, TIME = map(MotionSystem._fields.index, ("parameters", "time"))


def motion_system_of(f, settings, event_times, given, parameters, time, by=()):
    """Return the motion of f over a time as a `MotionSystem`; its machine code stays in memory.

    `given` (P,) are all parameters of f; the first ones are `parameters`, which may change. If f
    has columns of derivatives, the last ones belong to the parameters with the numbers `by`.
    """
    again = batch_solver.closer(settings)
    integrators, codes = _integrators_of(f, settings, again)
    first, rows = integrators[0], integrators[0].rows
    times, equal = (event_times or batch_solver.NO_EVENT_TIMES).array
    template = _template_of(f, settings, rows, times, given)
    constants, places = _constants_of(f, settings, again, times, template)
    size = size_of(f)
    records = 2 * most_records(f.hybrid.events, equal) * size if f.hybrid.acts else 0
    pairs = [each for clock, n in f.hybrid.offsets.items() for each in (clock, n - f.of_x.D)]
    plan = Plan(
        **codes,
        **places,
        **_memory_of(f, integrators, template, records),
        is_bounded=first.is_bounded,
        by_starts=f.columns - len(by),
        columns=f.columns,
        D=f.of_x.D,
        clocks=_CLOCKS + len(pairs),
        size_of_record=size,
        size_of_table=len(f.of_x.table) if f.of_x.constraints_count else 0,
        t=rows.t,
        lane_state=rows.state,
        at=rows.at,
        lost=rows.lost,
        unkept=rows.unkept * bool(f.of_x.left_out),
    )
    address = int(batch_solver.code_of(first, 1, f.hybrid.chooses))
    own = np.array(parameters, np.float64)
    return MotionSystem(address, np.array([*plan, *pairs, *by]), constants, own, float(time), f.D)


def _integrators_of(f, settings, again):
    """Return the integrators of f, and the fields of `Plan` that are addresses of code.

    Those of a first computation come before those with settings `again`. Within both, the explicit
    one comes before the implicit one, if f needs both.
    """
    explicit, implicit = LaneState.EXPLICIT, LaneState.IMPLICIT
    of_stiff = {True: (implicit,), False: (explicit,), None: (explicit, implicit)}
    modes = of_stiff[settings.stiff]
    # Integrators with `is_relative` compute motions again, see `growing_components`.
    both = [(mode, each, each is again) for each in (settings, again) for mode in modes]
    integrators = [batch_solver.integrator_of(f, *each) for each in both]
    codes = [batch_solver.code_of(each, 1, f.hybrid.chooses) for each in integrators]
    of_again = codes[-len(modes) :]
    found = {
        "implicit": codes[len(modes) - 1],
        "first_again": of_again[0],
        "implicit_again": of_again[-1],
        "of_table": 0 if f.is_dense else code_of_program(f.of_x, TABLE)[0],
        "of_constraints": code_of_program(f.of_x, "start")[0] if f.of_x.constraints_count else 0,
    }
    _kept.update((int(code), code) for code in (*codes, *found.values()))
    return integrators, found


def _template_of(f, settings, rows, times, given):
    """Return parts of the memory as they are before a motion: numbers, times, rows, parameters."""
    row, numbers = np.zeros(rows.size), np.array(batch_solver.numbers_of(f, settings, 1))
    row[rows.state], numbers[NUMBER.longest] = BEGINS, settings.max_step or np.inf
    if f.hybrid.acts:
        row[rows.stop : rows.stop + 2] = times[0, 0]
    return [numbers, np.array([0.0, np.inf, np.inf]), row, np.array(given)]


def _constants_of(f, settings, again, times, template):
    """Return `constants` of a `MotionSystem`, and the fields of `Plan` that are places in them."""
    parts = [batch_solver.components_of(f, each) for each in (settings, again)]
    parts += [np.array(batch_solver.numbers_of(f, again, 1)), times]
    components, numbers, of_times, of_template = np.cumsum([each.size for each in parts]).tolist()
    return np.concatenate([*parts, *template], axis=None), {
        "components_again": components,
        "numbers_again": numbers,
        "event_times": of_times * f.hybrid.acts,
        "template": of_template,
    }


def _memory_of(f, integrators, template, records):
    """Return the fields of `Plan` that are places in memory; `records` need as many numbers."""
    of_table = 0 if f.is_dense else code_of_program(f.of_x, TABLE)[2]
    of_start = code_of_program(f.of_x, "start")[2] if f.of_x.constraints_count else 0
    work = max(of_table, *(integrator.work.size for integrator in integrators))
    sizes = {"arguments": _ARGUMENTS, "ended": 2, "state": f.D}
    sizes |= zip(("numbers", "times", "rows", "inputs"), map(len, template), strict=True)
    sizes |= {"table": len(f.table), "work": work, "other": work, "records": records}
    sizes["start"] = of_start
    places = dict(zip([*sizes, "size"], accumulate(sizes.values(), initial=0), strict=True))
    del places["arguments"]
    return places


@function
def motion_memory(system):
    """Return the array in which all calls of `motion_of_one` work."""
    plan = system.plan
    memory = np.zeros(plan[PLAN.size])
    arguments, at = memory[:_ARGUMENTS].view(np.int64), memory.ctypes.data
    arguments[len(SLOT)] = system.address
    arguments[SLOT.rows], arguments[SLOT.count] = at + 8 * plan[PLAN.rows], 1
    arguments[SLOT.table] = at + 8 * plan[PLAN.table]
    arguments[SLOT.numbers] = at + 8 * plan[PLAN.numbers]
    arguments[SLOT.times] = at + 8 * plan[PLAN.times]
    arguments[SLOT.states] = at + 8 * plan[PLAN.state]
    arguments[SLOT.records] = at + 8 * plan[PLAN.records]
    return memory


@function
def _begin(system, x0, memory, tries):
    """Fill `memory` for a motion that begins, or that begins again after an alarm (`tries` > 0)."""
    plan, constants, time = system.plan, system.constants, abs(system.time)
    x, D, size = memory[plan[PLAN.rows] :], plan[PLAN.D], 0.0
    relative = memory[plan[PLAN.state] :]  # keeps the marks RELATIVE of `lost`, overwritten below
    for i in range(D):
        is_relative = (x[plan[PLAN.lost] + i] < 0.0) | _OF_ALL[tries]
        relative[i] = -1.0 if is_relative and tries != _WITHOUT else 0.0
    first, numbers = plan[PLAN.numbers], memory[plan[PLAN.numbers] :]
    for k in range(plan[PLAN.table] - first):
        memory[first + k] = constants[plan[PLAN.template] + k]
    for i in range(D):
        x[i], size = x0[i], max(size, abs(x0[i]))
    size = _power_of_2(size)
    for j in range(plan[PLAN.by_starts]):
        x[D + j * D + j] = size
    memory[plan[PLAN.ended] + 1] = size
    inputs = memory[plan[PLAN.inputs] : plan[PLAN.table]]
    for k in range(min(len(system.parameters), len(inputs))):
        inputs[k] = system.parameters[k]
    for k in range(_CLOCKS, plan[PLAN.clocks], 2):  # clocks of pairs begin at 0; f adds their start
        inputs[plan[k + 1]], x[plan[k]] = x[plan[k]], 0.0
    if plan[PLAN.of_table] != 0:
        call_code(plan[PLAN.of_table], (inputs.ctypes.data,))
    else:
        for k in range(len(inputs)):
            memory[plan[PLAN.table] + k] = inputs[k]
    sizes = memory[plan[PLAN.work] - (len(plan) - plan[PLAN.clocks]) : plan[PLAN.work]]
    for q in range(len(sizes)):  # f's table ends with scales of columns of parameters
        sizes[q] = _power_of_2(inputs[plan[plan[PLAN.clocks] + q]])
    numbers[NUMBER.last], memory[plan[PLAN.times]] = time, time
    numbers[NUMBER.sign] = -1.0 if system.time < 0.0 else 1.0
    if plan[PLAN.is_bounded]:
        numbers[NUMBER.longest] = min(numbers[NUMBER.longest], LONGEST_PART * time)
    if tries == 0:
        return
    for k in (NUMBER.rtol, NUMBER.part, NUMBER.limit, NUMBER.many):
        numbers[k] = constants[plan[PLAN.numbers_again] + k]
    if tries >= _LAST:
        numbers[NUMBER.acts] = 0.0
    counts = constants[plan[PLAN.components_again] + COMPONENT.counts * system.dimension :]
    for i in range(system.dimension):
        x[plan[PLAN.lost] + i] = relative[i % D] * counts[i % D]


@function
def _is_on_constraints(system, memory):
    """Return False if the state from which a motion begins violates constraints of f."""
    plan, D = system.plan, system.plan[PLAN.D]
    if plan[PLAN.of_constraints] == 0:
        return True
    start, n = memory[plan[PLAN.start] :], plan[PLAN.size_of_table]
    for i in range(D):
        start[i] = memory[plan[PLAN.rows] + i]
    for k in range(n):
        start[D + k] = memory[plan[PLAN.table] + k]
    call_code(plan[PLAN.of_constraints], (start.ctypes.data,))
    return start[D + n] * start[D + n + 1] == 1.0


@function
def _take_all_steps(system, memory, is_relative):
    """Take steps, explicit and implicit ones in turn, until the motion ends; return its state."""
    plan, arguments = system.plan, memory[:_ARGUMENTS].view(np.int64)
    state = np.int64(-1)
    while state < _DONE:
        code, work = system.address, plan[PLAN.work]
        if is_relative:
            code = plan[PLAN.first_again]
        if state == _IMPLICIT:
            code = plan[PLAN.implicit_again if is_relative else PLAN.implicit]
            work = plan[PLAN.other]
        arguments[SLOT.work] = memory.ctypes.data + 8 * work
        arguments[SLOT.following] = 0
        is_done = np.int64(0)
        while is_done == 0:  # as `full` is 0, the code pauses after records of events
            written = arguments[SLOT.recorded]
            arguments[SLOT.budget], arguments[SLOT.recorded] = _ENDLESS, 0
            is_done = call_code(code, (arguments.ctypes.data,))
            if arguments[SLOT.recorded] == 0:
                arguments[SLOT.recorded] = written
        state = np.int64(memory[plan[PLAN.rows] + plan[PLAN.lane_state]])
    return state


@function
def motion_of_one(system, x0, out, memory):
    """Write the state `time` after x0, or at a terminal event, to `out`; return its status."""
    plan, constants, arguments = system.plan, system.constants, memory[:_ARGUMENTS].view(np.int64)
    if (len(memory) != plan[PLAN.size]) | (arguments[len(SLOT)] != system.address):
        return OF_ANOTHER
    D, time, sign = plan[PLAN.D], abs(system.time), -1.0 if system.time < 0.0 else 1.0
    x, is_finite = memory[plan[PLAN.rows] :], time - time == 0.0
    for i in range(D):
        is_finite &= x0[i] - x0[i] == 0.0
    if not is_finite or (time == 0.0 and plan[PLAN.event_times] == 0):
        memory[plan[PLAN.ended]] = 0.0
        for i in range(D):
            out[i] = x0[i] if is_finite else np.nan
        out[D:] = 0.0 if time == 0.0 else np.nan
        for i in range(plan[PLAN.by_starts] * (time == 0.0)):
            out[D + i * plan[PLAN.columns] + i] = 1.0
        return OK if is_finite else NONFINITE
    arguments[SLOT.event_times] = constants.ctypes.data + 8 * plan[PLAN.event_times]
    tries, end, before = 0, 0.0, np.int64(0)
    while True:
        _begin(system, x0, memory, tries)
        if tries == 0 and not _is_on_constraints(system, memory):
            memory[plan[PLAN.ended]], out[: system.dimension] = 0.0, np.nan
            return NONFINITE
        components = plan[PLAN.components_again] if tries > 0 else 0
        arguments[SLOT.components] = constants.ctypes.data + 8 * components
        state = _take_all_steps(system, memory, 0 < tries < _WITHOUT)
        has_ended = (state == _ENDED) | (state == _TOO_MANY) | (state == _NO_VALUE)
        if tries == _WITHOUT or (state != _AGAIN and not (has_ended and tries > 0)):
            break
        # Compute the motion again (`motions.integration`); after an early end with each `lost` 0.
        tries, end, before = _WITHOUT if has_ended else tries + 1, x[plan[PLAN.t]], state
    memory[plan[PLAN.ended]] = system.time
    if state != _DONE:
        memory[plan[PLAN.ended]] = sign * x[plan[PLAN.at if state == _ACCUMULATES else PLAN.t]]
    if tries == _WITHOUT and state not in (_DONE, _STOPPED) and x[plan[PLAN.t]] <= SAME_END * end:
        state, memory[plan[PLAN.ended]] = before, sign * end
    if state in (_DONE, _STOPPED):
        _write(system, state, memory, out)
    else:
        out[: system.dimension] = np.nan
    unkept = plan[PLAN.unkept]
    if state == _DONE and unkept > 0 and (x[unkept] > 0.0 or x[unkept + 2] > 0.0):
        return NOT_KEPT
    return np.int64(STATUS[state])


@function
def _write(system, state, memory, out):
    """Write the state at the last time, or after the event that ended the motion, to `out`."""
    plan, D, C = system.plan, system.plan[PLAN.D], system.plan[PLAN.columns]
    x, tau, rates = memory[plan[PLAN.state] :], memory, memory
    inputs = memory[plan[PLAN.inputs] :]
    if state == _STOPPED:  # the event has written the last record
        number = memory[:_ARGUMENTS].view(np.int64)[SLOT.recorded] - 1
        record = memory[plan[PLAN.records] + number * plan[PLAN.size_of_record] + 3 :]
        x, tau = record[system.dimension :], record[2 * system.dimension :]
        rates = tau[C + D :]
    for i in range(D):
        out[i] = x[i]
    for k in range(_CLOCKS, plan[PLAN.clocks], 2):
        if inputs[plan[k + 1]] != 0.0:
            out[plan[k]] += inputs[plan[k + 1]]
    for c in range(C):
        size = memory[plan[PLAN.ended] + 1]
        if c >= plan[PLAN.by_starts]:
            size = memory[plan[PLAN.work] - C + c]
        for i in range(D):
            column = x[D + c * D + i]
            if state == _STOPPED:
                column -= tau[c] * rates[i]
            out[D + i * C + c] = column / size


@function
def _power_of_2(value):
    """Return the power of 2 nearest to a number, as `sensitivities` does; 1 for 0."""
    fraction, exponent = math.frexp(abs(value))
    return 1.0 if value == 0.0 else math.ldexp(1.0, exponent - (fraction < HALF))


@function
def end_of_motion(system, memory):
    """Return the time at which the last motion in this memory ended."""
    return memory[system.plan[PLAN.ended]]


# Functions that `compiled` calls for a `MotionSystem`.
MotionSystem.memory, MotionSystem.one_step = motion_memory, motion_of_one
MotionSystem.end = end_of_motion
