"""Changes of the state at which steps end, at given times and on surfaces.

At an instant changes at times act first, in the order of their list. The code is a function of its
own, because changes at time 0 act before the first step.
"""

import numpy as np

from ..code.text import Carried, Integers, Shared
from . import rules
from .arguments import SLOT
from .rows import OF_CHANGES, State
from .scope import Lines


def add_change(text, half, name, for_each):
    """Add the function void change(arguments), which changes `new` and `f_new` of lanes.

    It acts in lanes with `accepted` 1 that are at the time of a change.
    """
    with text.function(f"{name}_change", ("arguments",)):
        lines = Lines(text, half, name, for_each)
        _change(lines)


def change(lines):
    """Let changes act on the next states of lanes whose step is taken."""
    with lines.text.when(_is_at_stop(lines).any(), likely=False):
        lines.text.invoke(f"{lines.name}_change", lines.arguments)


def _is_at_stop(lines):
    """Return which lanes have reached the next time of a change."""
    accepted = lines.work.accepted[0] > 0.0
    return accepted & (lines.line.t[0] >= lines.of_changes.stop[0])


def _change(lines):
    text, work = lines.text, lines.work
    work.noted[0] = 0.0
    _keep_largest(lines, work.accepted[0] > 0.0)
    surfaces = lines.half.changes.surfaces
    with text.when(_is_at_stop(lines).any()):
        for now in text.rounds(Carried()):
            acts = _is_at_stop(lines)
            for k in range(surfaces, len(lines.half.changes.most)):
                own = acts & lines.of_changes.stop_which[0].equals(float(k))
                with text.when(own.any()):
                    _act(lines, k, own)
            _next_stop(lines, acts.bits())
            now.goes_on = _is_at_stop(lines).any()
        lines.call("f", work.new, lines.table, work.f_new)
    _go_on(lines)


def _act(lines, k, truth):
    """Let change k act in these lanes."""
    text, work, half = lines.text, lines.work, lines.half
    own = half.changes.components[k]
    text.copy(work.new, work.before, lines.D)
    if own:
        lines.call(f"to{k}", work.new, lines.table, work.changed)
        if own == tuple(range(lines.D)):
            for i in text.each(lines.D):
                work.new.choose(truth, i, work.changed[i])
        else:
            for n, i in enumerate(own):
                work.new.choose(truth, i, work.changed[n])
    one = truth.select(1.0, 0.0)
    work.noted[0] = work.noted[0] + one
    counts = lines.line.counts[k] + one
    lines.line.counts[k] = counts
    if half.changes.most[k] < np.inf:
        is_over = truth & (counts >= float(half.changes.most[k]))
        lines.line.state.choose(is_over, 0, float(State.STOPPED))
    _record(lines, truth, k)


def _record(lines, truth, k):
    """Write a record of change k: trajectory, k, time, and the states before and after."""
    text, of, work, D = lines.text, lines.of, lines.work, lines.D
    one = text.lanes(1)
    for offset in lines.lanes_with(truth.bits()):
        line = one.arrays(lines.line.x.at() + offset, lines.half.rows)
        of_work = work.line.at() + offset
        number = lines.arguments[SLOT.recorded]
        to = of.records + number * (8 * (3 + 2 * D))
        integers, numbers = Integers(text, to), Shared(one, to)
        integers[0] = Integers(text, line.trajectory.at())[0]
        integers[1] = k
        numbers[2] = line.t[0]
        for first, states in ((3, work.before), (3 + D, work.new)):
            source, target = one.array(of_work, states.first), numbers.after(first)
            for i in text.each(D):
                target[i] = source[i]
        lines.arguments[SLOT.recorded] = number + 1


def _next_stop(lines, bits):
    """Go to the next time of a change in lanes with these bits."""
    text, of = lines.text, lines.of
    one = text.lanes(1)
    for offset in lines.lanes_with(bits):
        own = one.arrays(lines.line.of_changes.at() + offset, OF_CHANGES)
        trajectory = Integers(text, lines.line.trajectory.at() + offset)[0]
        place_at = Integers(text, own.stop_place.at())
        place = place_at[0] + 1
        place_at[0] = place
        numbers = Shared(one, of.stops + trajectory * of.stop_bytes + place * 16)
        own.stop[0], own.stop_which[0] = numbers[0], numbers[1]


def _keep_largest(lines, truth):
    """Let the largest moduli of components include those before a change."""
    for i in lines.text.each(lines.D):
        largest, modulus = lines.line.largest[i], abs(lines.work.new[i])
        larger = (modulus > largest).select(modulus, largest)
        lines.line.largest.choose(truth, i, larger)


def _go_on(lines):
    """Choose the next length in lanes with changes, as that of a first step."""
    work = lines.work
    sums = Carried(size=0.0, rate=0.0, total=0.0)
    for i in lines.text.each(lines.D, sums):
        inputs = {"x": work.new[i], "f": work.f_new[i]}
        sums.update(lines.apply(rules.BEGIN_COMPONENT, i, **inputs, **vars(sums)))
    inputs = {"number": work.noted[0], "endless": 0.0, **vars(sums)}
    for name, value in lines.apply(rules.CHANGED_STATE, **inputs).items():
        rows = lines.of_changes if hasattr(lines.of_changes, name) else lines.line
        getattr(rows, name).put_chosen(0, value)


def is_full(lines):
    """Return whether records of a step may have no place any more."""
    return lines.arguments[SLOT.recorded] > lines.of.full
