"""Surfaces on which conditions of f change: steps end just beyond them, and choices are made anew.

A step looks for surfaces at the ends of PARTS of its length, where the state is (`rules.POINT`)

x + u d + u (u - 1) ((1 - 2 u) d + (u - 1) h f(x) + u h f(x_next)),     d = x_next - x,

and `watch` of the half compares both ends of each part. A step that crosses a surface is taken
again, shorter, until it ends just beyond (`rules.CUT`).
"""

import numpy as np

from ..code.text import Carried
from ..lists.conditions import choices_of
from ..lists.tables import Table, is_table
from . import rules


def cut(lines, before, total):
    """Take a step again that crosses a surface, or is on the way to one, with a better length."""
    text, line, work, watched = lines.text, lines.line, lines.work, lines.half.watched
    taken = work.taken[0]
    pair, point, seen = work.between, work.between.after(watched), work.seen
    x, far, new = line.x, line.far, work.new

    def look(*names):
        lines.call("watch", pair, lines.table, seen)
        return {name: seen[k] for k, name in enumerate(names)}

    def keep_far(truth):
        for i in text.each(watched):
            far.put_chosen(i, truth.select(point[i], far[i]))

    text.copy(x, pair, watched)
    if lines.half.changes and lines.half.changes.surfaces:
        text.copy(line.side, work.sides, 2 * lines.half.changes.surfaces)
    parts = dict.fromkeys(("crossed", "place", "end"), text.value(0.0))
    outer = line.outer[0]
    is_far = ~(outer < np.inf)
    for k in range(1, rules.PARTS + 1):
        u = text.value(k / rules.PARTS)
        if k < rules.PARTS:
            put_point(lines, u, point)
        else:
            text.copy(new, point, watched)
        inputs = look("part", "crosses") | parts | {"u": u, "taken": taken}
        parts = lines.apply(rules.LOOK, **inputs)
        keep_far((parts.pop("is_first") > 0.0) & is_far)
        text.copy(point, pair, watched)
    inputs = {"total": total, "before": before, "taken": taken}
    inputs |= parts | {"mode": lines.mode}
    text.copy(far, point, watched)
    inputs |= look("part")
    text.copy(x, pair, watched)
    text.copy(new, point, watched)
    inputs |= look("whole_part", "crosses", "jumps")
    found = lines.apply(rules.CUT, **inputs)
    keep_far(found.pop("beyond") > 0.0)
    lines.keep(work, {name: found.pop(name) for name in ("at_surface", "accepted", "served")})
    lines.keep(line, found)


def put_point(lines, u, to):
    """Write the state at a part u of the step."""
    text, work = lines.text, lines.work
    rule = rules.POINT_IMPLICIT if lines.half.is_implicit else rules.POINT
    signed = work.signed[0]
    for i in text.each(lines.half.block.D):
        to[i] = lines.apply(rule, i, signed=signed, u=u)["point"]


def choose(lines):
    """Make the choices of kinks anew where the step ends on a surface, and f with them.

    A table may be so steep that f changes much where it is continuous.
    """
    work, conditions = lines.work, lines.f.conditions
    accepted, at_surface = work.accepted[0], work.at_surface[0]
    ends = (accepted > 0.0) & (at_surface > 0.0)
    with lines.text.when(ends.any(), likely=False):
        place = conditions.P + conditions.jumps
        _put_choices(lines, ends, lines.half.kinks, work.seen.after(3), place)


def choose_all(lines, truth):
    """Make all choices anew at the new state of these lanes, and f with them."""
    work, conditions = lines.work, lines.f.conditions
    lines.call("choices", work.new, lines.table, work.chosen)
    _put_choices(lines, truth, conditions.kinds, work.chosen, conditions.P)


def _put_choices(lines, truth, kinds, found, place):
    """Write choices, which rows have, or arguments of tables, to the table of lanes; renew f."""
    text, f = lines.text, lines.half.block
    first = len(f.conditions.kinds) - len(kinds)
    for k, kind in enumerate(kinds):
        if is_table(kind):
            _put_interval(lines, kind, truth.bits(), found.after(k), place, shift_of(f, first + k))
        else:
            now = found[k]
            text.array(lines.table, place).choose(truth, 0, now)
        place += choices_of(kind)
    lines.call("f", lines.work.new, lines.table, lines.work.f_new)


def shift_of(f, number):
    """Return the place of the shift of a table, see `Table.interval_of`, None without one."""
    conditions = f.conditions
    if number not in conditions.shifts:
        return None
    return f.places[f.surfaces.results[len(conditions.kinds) + conditions.shifts.index(number)]]


def _put_interval(lines, table, bits, argument, place, shift):
    """Write the interval of a table that holds an argument to the table of lanes with bits.

    The interval is found by bisection among a number of knots that is a power of 2.
    """
    text, count = lines.text, table.rows.shape[1]
    one = text.lanes(1)
    half = max(2 ** (count - 1).bit_length() // 2, 1)
    numbers = np.full((Table.ROWS, 2 * half), np.inf)
    numbers[:, :count] = table.rows
    numbers = text.numbers(f"{lines.name}_interval_{len(text.target.constants)}", numbers)
    for offset in lines.lanes_with(bits):
        x = one.array(lines.work.line.at() + offset, argument.first)[0]
        of_lane = one.array(lines.table + offset)
        less = one.value(0.0) if shift is None else of_lane[shift]
        for now in text.rounds(Carried(at=numbers.base, half=half)):
            above = now.at + now.half * 8
            is_above = x >= one.array(above)[0] - less
            now.half = now.half >> 1
            now.at = is_above.select(above, now.at)
            now.goes_on = now.half.differs(0)
        to = text.place(lines.table + offset, place)
        text.copy_numbers(now.at, 16 * half, to, text.size, Table.ROWS)
        if shift is not None:
            for k in range(2):  # low and high
                of_lane[place + k] = of_lane[place + k] - less
