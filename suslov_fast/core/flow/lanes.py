"""The trajectories in lanes: which takes the next one, where it begins, and the budget of steps.

A lane whose trajectory ends writes it back, and takes the next one that waits. In memory the rows
of a trajectory follow each other; those of a lane are W numbers apart.
"""

from ..llvm.text import Carried, Integers
from . import branch_choice, dense_output, event_actions, step_length
from .code_arguments import SLOT
from .memory import State
from .step import move


def take_next(lines, free):
    """Write back the trajectories of lanes with these bits, and let them take the next ones."""
    text, of = lines.text, lines.of
    for offset in lines.lanes_with(free):
        line, own = lines.line.x.at() + offset, Integers(text, lines.work.own.at() + offset)
        _write_back(lines, offset, own[0])
        number = lines.arguments[SLOT.following]
        own[0] = 0
        with text.when(number < of.count):
            following = number + 1
            own[0] = following
            lines.arguments[SLOT.following] = following
            size = lines.half.rows.size
            text.copy_numbers(of.rows + number * (8 * size), 8, line, text.size, size)
            if lines.for_each:
                at = of.table + number * of.table_bytes
                text.copy_numbers(at, 8, lines.table + offset, text.size, len(lines.f.table))
    begins = lines.line.state[0] < 0.0
    with text.when(begins.any()):
        _begin(lines, begins)


def _write_back(lines, offset, own):
    """Write the rows of a lane, and its table, to those of its trajectory, if it has one."""
    text, of, half = lines.text, lines.of, lines.half
    parts = [(lines.line.x.at(), of.rows, 8 * half.rows.size, half.rows.size)]
    if half.f.conditions:  # whose choices stand in the table
        parts.append((lines.table, of.table, of.table_bytes, len(half.f.table)))
    with text.when(own.differs(0)):
        number = own - 1
        for source, target, size, count in parts:
            at = target + number * size
            text.copy_numbers(source + offset, text.size, at, 8, count)


def pause_if_spent(lines):
    """Return 0 where the budget is spent."""
    text, left = lines.text, lines.arguments[SLOT.budget]
    is_spent = left.is_at_most(0)
    if lines.half.changes:  # whose records may have no place any more
        is_spent = is_spent | (lines.arguments[SLOT.recorded] > lines.of.full)
    with text.when(is_spent, likely=False):
        for lane in text.each(text.W):
            offset = lane * 8
            _write_back(lines, offset, Integers(text, lines.work.own.at() + offset)[0])
        text.leave("i64 0")
    lines.arguments[SLOT.budget] = left - 1


def _begin(lines, begins):
    """Begin the trajectories of some lanes: f, the largest moduli, the first length."""
    text, line, f_new = lines.text, lines.line, lines.work.f_new
    if lines.f.conditions:
        text.copy(line.x, lines.work.new, lines.D)
        branch_choice.choose_all(lines, begins)
    lines.call("f", line.x, lines.table, f_new)
    for i in text.each(lines.extended):
        line.f.choose(begins, i, f_new[i])
    sums = Carried(size=0.0, rate=0.0, total=0.0)
    for i in text.each(lines.D, sums):
        x, f = line.x[i], f_new[i]
        line.largest.choose(begins, i, abs(x))
        line.mode.choose(begins, i, 1.0)
        sums.update(lines.apply(step_length.BEGIN_COMPONENT, i, x=x, f=f, **vars(sums)))
    lines.keep(line, lines.apply(step_length.BEGIN, **vars(sums)), begins)
    if lines.half.changes:
        _begin_with_changes(lines, begins)


def _begin_with_changes(lines, begins):
    """Let changes at time 0 act, and save the states at that time."""
    text, line, work = lines.text, lines.line, lines.work
    running = begins & line.state[0].equals(lines.mode)
    work.accepted[0] = running.select(1.0, 0.0)
    work.at_surface[0] = 0.0
    work.taken.choose(begins, 0, line.wanted[0])
    is_over = running & (lines.number("last") <= 0.0)
    line.state.choose(is_over, 0, float(State.DONE))
    text.copy(line.x, work.new, lines.D)
    event_actions.find_sides(lines, begins)
    work.taken.choose(begins, 0, 0.0)
    event_actions.change(lines)
    dense_output.save_at_end(lines)
    move(lines)
