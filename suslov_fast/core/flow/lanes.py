"""The trajectories in lanes: which lane takes the next, where it begins, and the budget of steps.

When the trajectory of a lane ends, it is copied to memory, and the lane starts the next one that
waits. In memory the rows of a trajectory are consecutive; the rows of a lane are W numbers apart.

A trajectory takes as long to begin as W of them. So the next W trajectories begin together, in a
line `waiting`; free lanes take them from there. If f has events or branches, which act on lanes,
trajectories begin in their lanes.
"""

from math import inf

from ..llvm.text import Integers, Shared
from . import dense_output, projected_states, step_length
from .code_arguments import SLOT
from .codegen import StepCode
from .events import actions, branch_choice
from .memory import LaneState
from .next_state import move


def begin_together(text, integrator):
    """Return True if the trajectories for W lanes begin together."""
    return text.W > 1 and not (integrator.f.hybrid.acts or integrator.f.hybrid.chooses)


def take_next(code, free):
    """Write back trajectories of lanes with bit 1 in `free`; begin the next trajectories there."""
    text, loaded = code.text, code.loaded
    together = begin_together(text, code.integrator)
    for offset in code.lanes_with(free):
        own = Integers(text, code.work.own.at() + offset)
        _write_back(code, offset)
        number = code.arguments[SLOT.following]
        own[0] = 0
        with text.when(number < loaded.count):
            own[0] = number + 1
            if together:
                _take_waiting(code, number & (text.W - 1), offset)
            else:
                _load(code, number, offset)
            code.arguments[SLOT.following] = number + 1
    if not together:
        begins = code.line.state[0] < 0.0
        with text.when(begins.any()):
            _begin(code, begins)


def _take_waiting(code, place, offset):
    """Copy the trajectory at a `place` of the line `waiting` to the lane at byte `offset`."""
    text, work, size = code.text, code.work, code.text.size
    with text.when(place.equals(0)):
        text.invoke(f"{code.name}_begin", code.arguments)
    parts = [(work.waiting, code.line.x, code.integrator.rows.size)]
    if code.for_each:
        parts.append((work.table_waiting, work.table, len(code.f.table)))
    for source, target, rows in parts:
        text.copy_numbers(source.at() + place * 8, size, target.at() + offset, size, rows)


def begin_waiting(code):
    """Load the next trajectories into the line `waiting`, for all lanes, and begin them."""
    text, count, number = code.text, code.loaded.count, code.arguments[SLOT.following]
    waiting = StepCode(text, code.integrator, code.name, code.for_each, waiting=True)
    for lane in text.each(text.W):
        own = number + lane
        _load(waiting, (own < count).select(own, number), lane * 8)
    _begin(waiting, waiting.line.state[0] < 0.0)


def _load(code, number, offset):
    """Copy rows and table of the trajectory `number` to the lane at byte `offset`."""
    text, loaded, size = code.text, code.loaded, code.integrator.rows.size
    line = code.line.x.at() + offset
    text.copy_numbers(loaded.rows + number * (8 * size), 8, line, text.size, size)
    if code.for_each:
        at = loaded.table + number * loaded.table_bytes
        text.copy_numbers(at, 8, code.table + offset, text.size, len(code.f.table))


def _write_back(code, offset):
    """Write rows and table of the lane at byte `offset` to its trajectory, if it has one."""
    text, loaded, integrator = code.text, code.loaded, code.integrator
    number_plus_1 = Integers(text, code.work.own.at() + offset)[0]
    parts = [(code.line.x.at(), loaded.rows, 8 * integrator.rows.size, integrator.rows.size)]
    if integrator.f.hybrid.chooses:  # the code writes the branches it chooses to the table
        parts.append((code.table, loaded.table, loaded.table_bytes, len(integrator.f.table)))
    with text.when(number_plus_1.differs(0)):
        number = number_plus_1 - 1
        for source, target, size, count in parts:
            at = target + number * size
            text.copy_numbers(source + offset, text.size, at, 8, count)


def pause_if_spent(code):
    """Let the code return 0, to pause, if the budget is spent or the buffer of records is full."""
    text, left = code.text, code.arguments[SLOT.budget]
    is_spent = left.equals(0)
    if code.f.hybrid.acts:  # the buffer of records may be too full for the next step
        is_spent = is_spent | (code.arguments[SLOT.recorded] > code.loaded.full)
    with text.when(is_spent, likely=False):
        for lane in text.each(text.W):
            _write_back(code, lane * 8)
        text.leave("i64 0")
    code.arguments[SLOT.budget] = left - 1


def _begin(code, begins):
    """Begin trajectories in lanes `begins`: find f, the largest moduli, and the first length."""
    text, line, f_new = code.text, code.line, code.work.f_new
    if code.f.hybrid.chooses:
        text.copy(line.x, code.work.new, code.D)
        branch_choice.update_branches(code, begins)
    projected_states.keep_levels(code, begins, line.x)
    code.call("f", line.x, code.table, f_new)
    for i in text.each(code.extended):
        line.f_x.choose(begins, i, f_new[i])
    for i in text.each(code.D):
        line.largest.choose(begins, i, abs(line.x[i]))
        line.power_vector.choose(begins, i, 1.0)
    sums, times = step_length.sizes_of(code, line.x, f_new), Shared(text, code.loaded.times)
    stays = code.integrator.rule.damps  # long implicit steps damp what bends the solution
    bend = 0.0 if stays else step_length.bend_of(code, line.x, f_new, sums)
    inputs = vars(sums) | {"bend": bend, "first_next": times[0], "second_next": times[1]}
    found = code.apply(step_length.BEGIN, **inputs)
    if code.integrator.searches:
        found["outer"] = inf
    code.keep(line, found, begins)
    if code.f.hybrid.acts:
        _begin_with_events(code, begins)


def _begin_with_events(code, begins):
    """Let events at time 0 act in lanes `begins`, and save the states at that time."""
    text, line, work = code.text, code.line, code.work
    running = begins & line.state[0].equals(code.mode)
    work.accepted[0] = running.select(1.0, 0.0)
    work.at_surface[0] = work.f_ends[0] = 0.0
    work.taken.choose(begins, 0, line.wanted[0])
    is_over = running & (code.number("last") <= 0.0)
    line.state.choose(is_over, 0, float(LaneState.DONE))
    text.copy(line.x, work.new, code.D)
    actions.find_sides(code, begins)
    work.taken.choose(begins, 0, 0.0)
    actions.act(code)
    dense_output.save_at_end(code)
    move(code)
