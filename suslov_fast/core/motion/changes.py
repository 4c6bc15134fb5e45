"""Changes of the state at which steps end, at given times and on surfaces.

At an instant changes at times act first, in the order of their list, then those at surfaces that
the state has crossed, by the motion or by another change. A trajectory keeps on which side of each
surface it is. The code is a function of its own, because changes at time 0 act before the first
step.
"""

from math import inf

import numpy as np

from ..code.text import Carried, Integers, Shared
from ..lists.numbers import larger, smaller
from . import choosing, surfaces
from .lengths import AT_FIRST, BEGIN_COMPONENT
from .records import record
from .rows import OF_CHANGES, State
from .rules import AT_ONCE, TINY, rule
from .scope import Lines

# A trajectory ends where a change acts again within AT_ONCE of the time so often in a row, or where
# so many act at one instant beside one at each surface.
CHANGES_AT_ONCE, MOST_AT_ONCE, ROUNDING = 4.0, 64.0, 2.0**-50
SOON = 2.0**-20  # a state on a surface that jumps elsewhere has been beyond it for less of the time
FASTER = 4.0  # rate after changes, beside that where the step before them began


def _level(value, rate, is_above):
    """Return 0, or more below a surface on which a state rests, which counts as above otherwise."""
    rests = value.equals(0.0) & rate.equals(0.0)
    return rests.select(is_above.select(0.0, TINY), 0.0)


def _beyond(value):
    """Return a level that is more than the value of a surface, by rounding."""
    return value + (ROUNDING * abs(value) + TINY)


@rule
def FIRST_SIDE(value, rate, sign):
    """On which side of a surface a trajectory starts, on the surface that to which it goes."""
    is_above = (value > 0.0) | (value.equals(0.0) & (sign * rate > 0.0))
    return {"side": is_above.select(1.0, 0.0), "level": _level(value, rate, is_above)}


@rule
def LEVEL(value, rate, side):
    """The level of a surface after an instant in which its change has acted."""
    return {"level": _level(value, rate, side > 0.5)}


def _is_on(value, rate, last, jumps):
    """Return whether a value may be that of a state on the surface: not where the surface jumps."""
    return (abs(value) <= SOON * last * abs(rate)) | (jumps < 0.5)


@rule
def CROSSED(value, rate, side, level, is_here, by_motion, jumps, t, last, sign):
    """Whether a state is on another side of a surface, up or down.

    A change may leave the state beyond the surface by rounding, on its way back. A step ends there,
    too, but a crossing by the motion whose rate contradicts it is none: then the surface lies where
    the state is, until its next change, and just beyond where the state does not move any more. Nor
    is it one where a motion begins that rests on the surface at first.
    """
    is_above = value >= level
    differs = (is_here > 0.0) & (is_above ^ (side > 0.5))
    ahead = is_above.select(sign * rate, -(sign * rate))
    is_back = differs & (by_motion > 0.0) & (ahead < 0.0)
    is_back = is_back & _is_on(value - level, rate, last, jumps)
    stays = is_above & value.equals(level)
    crosses = differs & ~is_back
    begins = level.equals(TINY) & (by_motion > 0.0) & (t <= AT_ONCE * last)
    return {
        "side": crosses.select(is_above.select(1.0, 0.0), side),
        "level": is_back.select(stays.select(_beyond(value), value), level),
        "up": crosses & is_above & ~begins,
        "down": crosses & ~is_above,
    }


@rule
def AFTER_OWN(value, rate, before, rate_before, up, by_motion, jumps, last, sign):
    """The side and the level of a surface after its own change; `before` is its value before.

    A state that lies as near the surface as the crossing left it is on it: its side is that to
    which the rate leads, and within this instant the level is where it is not crossed again.
    """
    is_near = (by_motion > 0.0) & (abs(before) + abs(before) >= abs(value))
    is_near = is_near & _is_on(before, rate_before, last, jumps)
    is_on = value.equals(0.0) | is_near
    ahead = sign * rate
    goes_up = ahead.equals(0.0).select(1.0 - up, (ahead > 0.0).select(1.0, 0.0))
    level = (goes_up > 0.5).select(smaller(value, 0.0), _beyond(larger(value, 0.0)))
    return {
        "side": is_on.select(goes_up, (value >= 0.0).select(1.0, 0.0)),
        "level": is_on.select(level, 0.0),
    }


@rule
def AGAIN(fired, t, acted, pause, own, limit):
    """How much later than before a change acts, and the limit of such times, as by Aitken."""
    gap, is_fired = t - acted, fired > 0.0
    ends = t + (pause > gap).select(gap * gap / (pause - gap), 0.0)
    return {
        "own": is_fired.select(smaller(gap, own), own),
        "limit": is_fired.select(smaller(ends, limit), limit),
        "acted": is_fired.select(t, acted),
        "pause": is_fired.select(gap, pause),
    }


@rule
def CHANGED_STATE(
    size, rate, total, largest, rate_before, number, endless, own, limit, t, wanted, longer, state,
    stiff, easy, tries, at, often, since, part, last, longest,
):  # fmt: skip
    """The next length after changes of the state.

    It is that of a first step if that is more. Where the rate is FASTER times that at which the
    last step began, as after a dose, it is at most that of a first step of a state as large as the
    largest so far.

    Changes accumulate where one acts again at once, `own` after its last time; many others may act
    in between. A surface that has been crossed for longer, as far as its rate tells, shows that its
    value is rounding by now.
    """
    is_changed = number > 0.0
    guess = (size > 0.0).select(part * (size / rate), 0.0)
    of_largest = part * (larger(size, largest) / rate)
    least = (rate > FASTER * rate_before).select(smaller(wanted, of_largest), wanted)
    guess = smaller(smaller(larger((rate > 0.0).select(guess, 0.0), least), last), longest)
    now = larger(t, wanted)
    is_at_once = (own <= AT_ONCE * now) | ((since > own) & (own <= SOON * now))
    often_now = is_at_once.select(often + 1.0, 0.0)
    piles_up = ((often_now >= CHANGES_AT_ONCE) & (state < State.DONE)) | (endless > 0.0)
    after = piles_up.select(float(State.ACCUMULATES), state)
    after = (total < inf).select(after, float(State.ENDED))
    return {
        "wanted": is_changed.select(guess, wanted),
        "longer": is_changed.select(AT_FIRST, longer),
        "state": is_changed.select(after, state),
        "stiff": is_changed.select(0.0, stiff),
        "easy": is_changed.select(0.0, easy),
        "tries": is_changed.select(0.0, tries),
        "at": is_changed.select(piles_up.select(smaller(limit, last), t), at),
        "often": is_changed.select(often_now, often),
    }


def add_change(text, half, name, for_each):
    """Add the function void change(arguments), which changes `new` and `f_new` of lanes.

    It acts in lanes with `accepted` 1 that are at the time of a change.
    """
    with text.function(f"{name}_change", ("arguments",)):
        lines = Lines(text, half, name, for_each)
        _change(lines)


def change(lines):
    """Let changes act on the next states of lanes whose step is taken."""
    if lines.half.changes:
        with lines.text.when(_is_there(lines).any(), likely=False):
            lines.text.invoke(f"{lines.name}_change", lines.arguments)


def find_sides(lines, begins):
    """Find on which sides of surfaces the trajectories of these lanes begin."""
    if not lines.half.changes.surfaces:
        return
    toward, side = lines.work.toward, lines.line.side
    _look(lines)
    for k in lines.text.each(lines.half.changes.surfaces):
        values = {"value": toward[k * 2], "rate": toward.after(1)[k * 2]}
        found = lines.apply(FIRST_SIDE, **values)
        side.choose(begins, k * 2, found["side"])
        side.after(1).choose(begins, k * 2, found["level"])
        lines.line.acted.choose(begins, k * 2, -inf)


def _is_at_stop(lines):
    """Return which lanes have reached the next time of a change."""
    accepted = lines.work.accepted[0] > 0.0
    return accepted & (lines.line.t[0] >= lines.of_changes.stop[0])


def _is_there(lines):
    """Return in which lanes changes may act."""
    is_at_stop = _is_at_stop(lines)
    if not lines.half.changes.surfaces:
        return is_at_stop
    at_surface = lines.work.at_surface[0] > 0.0
    return is_at_stop | ((lines.work.accepted[0] > 0.0) & at_surface)


def _look(lines):
    """Find the values of surfaces at the new state, and their rates."""
    surfaces.look_at_changes(lines, lines.work.new, lines.work.f_new, lines.work.toward)


def _change(lines):
    text, work, changes = lines.text, lines.work, lines.half.changes
    is_there, is_at_stop = _is_there(lines), _is_at_stop(lines)
    work.noted[0] = 0.0
    _keep_largest(lines, is_there)
    if lines.half.block is not lines.f:
        for c in text.each(lines.f.columns):
            work.tau[c] = 0.0
    if changes.at_times:
        with text.when(is_at_stop.any()):
            _act_at_times(lines)
    again = Carried(own=inf, limit=inf)
    if changes.surfaces:
        by_motion = is_there & ~is_at_stop
        _act_at_surfaces(lines, is_there, by_motion, again)
    _go_on(lines, is_at_stop, again)


def _act_at_times(lines):
    """Let changes act whose times have come, in the order of the list."""
    text, changes = lines.text, lines.half.changes
    for now in text.rounds(Carried()):
        acts = _is_at_stop(lines)
        for k in range(changes.surfaces, changes.count):
            own = acts & lines.of_changes.stop_which[0].equals(float(k))
            with text.when(own.any()):
                _act(lines, k, own)
        _next_stop(lines, acts.bits())
        now.goes_on = _is_at_stop(lines).any()


def _most(changes):
    """Return how many changes at surfaces may act at one instant."""
    return MOST_AT_ONCE + changes.surfaces


def _act_at_surfaces(lines, is_there, by_motion, again):
    """Let changes act at the surfaces that a state has crossed, again and again until none does.

    `by_motion` are the lanes whose step has crossed one; another change may have crossed others.
    `again` is what `AGAIN` finds.
    """
    text, work, changes = lines.text, lines.work, lines.half.changes
    for k in text.each(changes.surfaces):
        work.fired[k] = 0.0
    _look(lines)
    if changes.count == 1:
        _cross(lines, 0, is_there, by_motion)
    else:
        for now in text.rounds(Carried()):
            noted = work.noted[0]
            few = is_there & (noted < _most(changes))
            for k in range(changes.surfaces):
                _cross(lines, k, few, by_motion & work.noted[0].equals(0.0))
            now.goes_on = (work.noted[0] > noted).any()
    for k in text.each(changes.surfaces, again):
        side, acted, place = lines.line.side, lines.line.acted, k * 2
        values = {"value": work.toward[place], "rate": work.toward.after(1)[place]}
        level = lines.apply(LEVEL, side=side[place], **values)["level"]
        side.after(1).choose(work.fired[k] > 0.0, place, level)
        own = {"acted": acted[place], "pause": acted.after(1)[place], "fired": work.fired[k]}
        found = lines.apply(AGAIN, **own, **vars(again))
        acted[place], acted.after(1)[place] = found.pop("acted"), found.pop("pause")
        again.update(found)


def _cross(lines, k, is_there, by_motion):
    """Let the change at surface k act in lanes whose state is on another side of it now."""
    text, work, line, half = lines.text, lines.work, lines.line, lines.half
    place, value = 2 * k, work.toward[2 * k]
    by_motion = by_motion.select(1.0, 0.0)
    inputs = {"value": value, "rate": work.toward[place + 1], "by_motion": by_motion}
    inputs |= {"side": line.side[place], "level": line.side[place + 1]}
    inputs["jumps"] = jumps = text.value(float(half.changes.jumps[k]))
    found = lines.apply(CROSSED, is_here=is_there.select(1.0, 0.0), **inputs)
    line.side.put_chosen(place, found["side"])
    line.side.put_chosen(place + 1, found["level"])
    up, direction = found["up"], half.changes.directions[k]
    fires = up if direction > 0 else found["down"] if direction < 0 else up | found["down"]
    if half.changes.only_records(k):
        _note(lines, k, fires, up | found["down"])
        return
    with text.when(fires.any()):
        work.fired.choose(fires, k, 1.0)
        work.noted[0] = work.noted[0] + fires.select(1.0, 0.0)
        _act(lines, k, fires, by_motion)
        if half.changes.components[k]:
            _look(lines)
            after = {"value": work.toward[place], "rate": work.toward[place + 1]}
            after |= {"before": value, "rate_before": inputs["rate"], "by_motion": by_motion}
            after |= {"up": up.select(1.0, 0.0), "jumps": jumps}
            own = lines.apply(AFTER_OWN, **after)
            line.side.choose(fires, place, own["side"])
            line.side.choose(fires, place + 1, own["level"])


def _note(lines, k, truth, crosses):
    """Record a crossing where nothing changes; a trajectory with enough of them stops."""
    line, work, of = lines.line, lines.work, lines.of_changes
    t, acted = line.t[0], line.acted[2 * k]  # where a solution slides it crosses again at once
    counts = truth & (t > lines.number("since")) & (t - acted > AT_ONCE * t)
    line.acted.choose(crosses, 2 * k, t)
    with lines.text.when(counts.any()):
        record(lines, counts, k, line.t, work.new, work.new)
        of.recorded[0] = recorded = of.recorded[0] + counts.select(1.0, 0.0)
        line.tries.choose(counts, 0, 0.0)
        line.state.choose(counts & (recorded >= lines.number("enough")), 0, float(State.STOPPED))


def _act(lines, k, truth, by_motion=None):
    """Let change k act in these lanes, in some because of the motion."""
    text, work, half = lines.text, lines.work, lines.half
    own, D = half.changes.components[k], half.block.D
    text.copy(work.new, work.before, lines.D)
    text.copy(work.f_new, work.f_before, D)
    if own:
        lines.call(f"to{k}", work.new, lines.table, work.changed)
        if own == tuple(range(D)):
            for i in text.each(D):
                work.new.choose(truth, i, work.changed[i])
        else:
            for n, i in enumerate(own):
                work.new.choose(truth, i, work.changed[n])
        if half.f.conditions:
            choosing.choose_all(lines, truth)
        lines.call("f", work.new, lines.table, work.f_new)
        if half.block is not half.f:
            _change_columns(lines, k, truth, by_motion)
            lines.call("f", work.new, lines.table, work.f_new)
    counts = lines.line.counts[k] + truth.select(1.0, 0.0)
    lines.line.counts[k] = counts
    if half.changes.most[k] < np.inf:
        is_over = truth & (counts >= float(half.changes.most[k]))
        lines.line.state.choose(is_over, 0, float(State.STOPPED))
    record(lines, truth, k, lines.line.t, work.before, work.new)


def _change_columns(lines, k, truth, by_motion):
    """Change the columns of a `Variational` with the state."""
    text, work, f, D = lines.text, lines.work, lines.f, lines.half.block.D
    parts = work.before, None, work.f_before, work.f_new
    for c in range(f.columns):
        q = c - (f.columns - f.q)
        end, column = f"_{q}" if q >= 0 else "", D * (1 + c)
        for n, part in enumerate(parts):
            source = work.before.after(column) if part is None else part
            text.copy(source, work.pair.after(n * D), D)
        if by_motion is not None:
            lines.call(f"tau{k}{end}", work.pair, lines.table, work.changed)
            work.tau.choose(truth & (by_motion > 0.0), c, work.changed[0])
        work.pair[4 * D] = work.tau[c]
        lines.call(f"column{k}{end}", work.pair, lines.table, work.changed)
        for i in text.each(D):
            work.new.after(column).choose(truth, i, work.changed[i])


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
    """Let the largest moduli of components include those before a change; forget which are low."""
    for i in lines.text.each(lines.half.low):
        low = lines.line.low[i]
        lines.line.low.choose(truth, i, (low >= 3.0).select(low, 0.0))
    for i in lines.text.each(lines.D):
        lines.keep_largest(truth, i, lines.work.new[i])


def _go_on(lines, is_at_stop, again):
    """Choose the next length in lanes with changes, as that of a first step."""
    work, conditions = lines.work, lines.f.conditions
    sums = Carried(size=0.0, rate=0.0, total=0.0)
    for i in lines.text.each(lines.D, sums):
        inputs = {"x": work.new[i], "f": work.f_new[i]}
        sums.update(lines.apply(BEGIN_COMPONENT, i, **inputs, **vars(sums)))
    before = Carried(size=0.0, rate=0.0, total=0.0)  # largest states, f where the step began
    for i in lines.text.each(lines.D, before):
        inputs = {"x": lines.line.largest[i], "f": lines.line.f[i]}
        before.update(lines.apply(BEGIN_COMPONENT, i, **inputs, **vars(before)))
    endless = (work.noted[0] >= _most(lines.half.changes)).select(1.0, 0.0)
    inputs = {"number": is_at_stop.select(1.0, work.noted[0]), "endless": endless} | vars(again)
    inputs |= {"since": work.aim[1], "largest": before.size, "rate_before": before.rate}
    if conditions and conditions.jumps:
        is_changed = (inputs["number"] > 0.0) & lines.line.state[0].equals(lines.mode)
        work.jumped.choose(is_changed, 0, 1.0)
    for name, value in lines.apply(CHANGED_STATE, **inputs, **vars(sums)).items():
        rows = lines.of_changes if hasattr(lines.of_changes, name) else lines.line
        getattr(rows, name).put_chosen(0, value)
