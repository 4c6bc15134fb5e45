"""Records of crossings: surfaces whose crossings change nothing, so that steps do not end there.

After a step, values of the surfaces at the ends of SECTION_PARTS of it, where `surfaces` says that
the state is, and at its end tell which are crossed. Where the error of these points is as large as
values there, as within fast ripples, states come from shorter steps (`inside`). A crossing is then
found by Newton's method along steps from the same state, as accurate as the step itself, of which
short ones lead on, and lies on the side to which the motion goes. Steps and states stay those of a
motion without the surfaces.
"""

from math import inf, nan

import numpy as np

from ..code.text import Carried
from ..lists.numbers import larger, smaller
from .columns import EXPLICIT, IMPLICIT, weights
from .inside import put_points
from .records import record
from .rows import State
from .rules import AT_ONCE, TINY, rule
from .scope import weighted
from .surfaces import find_quartic, put_point

# Of crossings that are recorded: parts of a step at whose ends signs are compared, and part of the
# step beside a part where its crossing may lie; steps that look for it; its width, or the part of
# the step from where Newton's method goes to it at once; the part within which short steps of
# order 4 have an error of some 2**-45; parts of the time by which its state goes on, each four
# times the one before, to lie beyond.
SECTION_PARTS, MARGIN, MOST_LOOKS = 8, 2.0**-5, 70
FOUND, WIDTH, WITHIN, NUDGE, NUDGES = 2.0**-29, 2.0**-48, 2.0**-10, 2.0**-54, 20
# A step is looked at more closely where OF_POINTS times the error of its points is as large as the
# least of the values there.
OF_POINTS = 4.0
# Of a surface that comes near 0 and goes back: how near, beside its bend over a part of the step,
# that a step looks whether it is crossed; how many such steps at most; and what is almost 0 beside
# the values at both neighbours of a point.
CLOSE, LOWER, ALMOST_0 = 0.5, 4, 2.0**-10
# Where the least of three values may lie, in parts from the middle one: nearest to that, or in the
# first or last part of the step.
_LIMITS = [
    (-1.0 if part == 0 else -0.5, 1.0 if part == SECTION_PARTS - 2 else 0.5)
    for part in range(SECTION_PARTS - 1)
]


@rule
def FIRST_VALUE(value, rate, sign):
    """The value of a surface at the start, on which a trajectory lies where it goes.

    Where it rests there, the first part of a step tells.
    """
    is_on, ahead = value.equals(0.0), sign * rate
    on = ahead.equals(0.0).select(nan, (ahead < 0.0).select(-TINY, 0.0))
    return {"first": is_on.select(on, value)}


@rule
def IS_ROUGH(error, least, rough):
    """Whether errors of points in a step may hide a crossing."""
    return {"rough": (abs(error) * OF_POINTS > least).select(1.0, rough)}


@rule
def KNOWN(value, before, after):
    """A value of a surface, the one before it, and whether they differ in sign.

    Where the one before is no number nothing is crossed.

    One that is almost 0 between two of the other sign counts as one of theirs: whether it lies
    beyond 0 is for `DIP` to find out.
    """
    before = (abs(before) < inf).select(before, value)
    is_above = before >= 0.0
    is_alone = ((value >= 0.0) ^ is_above) & ((value >= 0.0) ^ (after >= 0.0))
    is_alone = is_alone & (abs(value) <= ALMOST_0 * smaller(abs(before), abs(after)))
    value = is_alone.select(is_above.select(0.0, -TINY), value)
    return {"value": value, "before": before, "differs": (value >= 0.0) ^ (before >= 0.0)}


@rule
def IN_PART(a, b, direction, first, accepted):
    """Whether a surface with these values at both ends is crossed in a part, and where."""
    is_above = b >= 0.0
    crosses = (accepted > 0.0) & (is_above ^ (a >= 0.0)) & (abs(a) < inf) & (abs(b) < inf)
    crosses = crosses & (is_above.select(1.0, -1.0) * direction >= 0.0)
    low = larger(first - MARGIN, 0.0)
    high = smaller(first + (1.0 / SECTION_PARTS + MARGIN), 1.0)
    part = a / (a - b)
    part = ((part >= 0.0) & (part <= 1.0)).select(part, 0.5)
    return {
        "crosses": crosses,
        "up": is_above.select(1.0, 0.0),
        "u": first + part * (1.0 / SECTION_PARTS),
        "low": low,
        "high": high,
        "a": a,
        "b": b,
    }


@rule
def DIP(a, b, c, first, last, accepted):
    """Whether a surface with these values at the ends of two parts comes near 0 in between.

    The parabola through them has its least value at `place` parts from the middle, which is from
    `first` to `last`; `bend` is its second difference, with the sign of b.
    """
    side = (b >= 0.0).select(1.0, -1.0)
    before, here, after = side * a, side * b, side * c
    slope, bend = 0.5 * (after - before), (before - here) + (after - here)
    # Where they come near 0: here - slope**2 / (2 * bend) <= CLOSE * bend, without a division.
    is_near = bend * (here - CLOSE * bend) <= 0.5 * (slope * slope)
    is_inside = (-slope >= first * bend) & (-slope < last * bend)
    dips = (before >= 0.0) & (after >= 0.0) & (bend > 0.0) & is_inside & is_near & (accepted > 0.0)
    return {"dips": dips & (bend < inf), "place": -slope / bend, "bend": side * bend}


@rule
def DEEPER(value, rate, bend, u, middle, left, taken, sign):
    """Whether a surface is beyond 0 at a part u of the step, and where its least value may be."""
    side = (bend >= 0.0).select(1.0, -1.0)
    is_beyond = (left > 0.0) & (side * value < 0.0)
    ahead = side * (sign * rate) * taken
    next_ = u - ahead / (abs(bend) * float(SECTION_PARTS**2))
    part = 1.0 / SECTION_PARTS
    next_ = larger(smaller(next_, middle + part), middle - part)
    goes_on = (left > 0.0) & (side * value >= 0.0) & (next_ < inf)
    return {
        "u": goes_on.select(next_, u),
        "left": goes_on.select(1.0, 0.0),
        "found": is_beyond,
        "half": (abs(value / bend) * 2.0).sqrt() * (1.0 / SECTION_PARTS),
    }


@rule
def BESIDE_LEAST(u, middle, half):
    """Brackets of both crossings beside a value at u beyond 0, and guesses."""
    part = 1.0 / SECTION_PARTS + MARGIN
    low, high = larger(middle - part, 0.0), smaller(middle + part, 1.0)
    return {
        "u_before": larger(u - half, 0.5 * (low + u)),
        "low_before": low,
        "high_before": u,
        "u_after": smaller(u + half, 0.5 * (high + u)),
        "low_after": u,
        "high_after": high,
    }


@rule
def NEWTON(value, rate, up, a, b, u, low, high, left, taken, start, sign):
    """The next place to look for a crossing, or the crossing.

    Where the surface has no slope it is the upper end of a bracket, unless values grow there. No
    number counts as beyond the surface, so a bracket shrinks to the beginning of a gap.
    """
    ahead = sign * rate
    is_right = (up > 0.5).select(ahead, -ahead) > 0.0
    move = -value / ahead
    known = (abs(value) < inf).select(value, (up > 0.5).select(1.0, -1.0))
    is_beyond = (known >= 0.0) ^ (up < 0.5)
    low, high = is_beyond.select(low, u), is_beyond.select(u, high)
    part = move / taken
    next_ = u + part
    is_near = is_right & (abs(part) <= FOUND)
    is_narrow = high - low <= WIDTH
    is_end = is_narrow & is_beyond & (ALMOST_0 * abs(value) <= larger(abs(a), abs(b)))
    is_found = (left > 0.0) & (is_near | is_end)
    is_inside = (next_ > low) & (next_ < high) & is_right
    is_last = (is_narrow & is_beyond) | (low >= high)
    goes_on = (is_last | is_found).select(0.0, left)
    move = is_near.select(move, 0.0)
    return {
        "u": is_inside.select(next_, is_narrow.select(high, 0.5 * (low + high))),
        "low": low,
        "high": high,
        "left": goes_on,
        "found": is_found,
        "move": move,
        "moment": start + (u * taken + move),
    }


@rule
def COUNTS(truth, up, direction, moment, latest, since):
    """Whether a crossing counts: not one that follows another at once, as where f slides."""
    way = (up > 0.5).select(1.0, -1.0) * direction
    counts = (truth > 0.0) & (way >= 0.0) & (moment > since)
    counts = counts & (abs(moment - latest) > AT_ONCE * moment)  # pairs follow in any order
    return {"counts": counts, "latest": (truth > 0.0).select(larger(moment, latest), latest)}


def begin_sections(lines, begins):
    """Keep the values of surfaces where trajectories of these lanes begin, with their sides."""
    count, work = lines.half.changes.sections, lines.work
    if count:
        _rates(lines, work.new, work.f_new)
        for k in lines.text.each(count):
            values = {"value": work.rates[k * 2], "rate": work.rates.after(1)[k * 2]}
            first = lines.apply(FIRST_VALUE, **values)["first"]
            lines.line.section.choose(begins, k, first)
            lines.line.latest.choose(begins, k, -np.inf)


def find_crossings(lines):
    """Record the crossings in steps that are taken."""
    text, line, work, parts = lines.text, lines.line, lines.work, SECTION_PARTS
    count, values = lines.half.changes.sections, work.values
    accepted = work.accepted[0] > 0.0
    _restore_length(lines)
    text.copy(line.section, values, count)
    quartic = None
    if not lines.half.is_implicit:
        quartic = work.quartic
        find_quartic(lines, "sections")
    for part in range(1, parts):
        put_point(lines, text.value(part / parts), work.start, "sections", quartic)
        lines.call("sections", work.start, lines.table, values.after(part * count))
    lines.call("sections", work.new, lines.table, values.after(parts * count))
    if not lines.half.is_implicit:
        _look_closer(lines, accepted)
    found = Carried(some=0.0)
    for part in range(1, parts + 1):
        own, before = values.after(part * count), values.after((part - 1) * count)
        for k in text.each(count, found):
            if part == parts:
                line.section.choose(accepted, k, own[k])
            after = values.after(min(part + 1, parts) * count)[k]
            known = lines.apply(KNOWN, value=own[k], before=before[k], after=after)
            own[k], before[k] = known["value"], known["before"]
            found.some = known["differs"].select(1.0, found.some)
            if part > 1:
                dip = _dip(lines, (part - 2) * count + k, *_LIMITS[part - 2])
                found.some = dip["dips"].select(1.0, found.some)
    crosses = accepted & (found.some > 0.0)
    with text.when(crosses.any(), likely=False):
        directions = _directions(lines)
        first = text.constants([part / parts for part in range(parts)])
        limits = text.constants(_LIMITS)
        for k in text.each(count):
            # Where a solution slides all its crossings tell which of them count.
            direction = 0.0 if lines.f.conditions else directions[k]
            for now in text.rounds(Carried(last=-1.0)):
                found = _first_after(lines, k, now.last, first, direction)
                crosses = found.first < np.inf
                with text.when(crosses.any(), likely=False):
                    _find(lines, k, crosses, found)
                now.last, now.goes_on = found.first, crosses.any()
            for part in text.each(len(_LIMITS)):
                least = limits[part * 2], limits.after(1)[part * 2]
                dip = _dip(lines, part * count + k, *least)
                with text.when(dip["dips"].any(), likely=False):
                    _find_pair(lines, k, dip, first[part] + 1.0 / parts)


def _look_closer(lines, accepted):
    """Find values at the parts of steps anew, by shorter steps, where points are not known."""
    text, work, parts = lines.text, lines.work, SECTION_PARTS
    count, values = lines.half.changes.sections, work.values
    put_point(lines, text.value(0.5), work.start, "sections")
    lines.call("sections", work.start, lines.table, work.rates)
    found = Carried(rough=0.0)
    for k in text.each(count, found):
        least = abs(values.after(count)[k])
        for part in range(2, parts + 1):
            value = abs(values.after(part * count)[k])
            least = (value < least).select(value, least)
        error = work.rates[k] - values.after(parts // 2 * count)[k]
        found.update(lines.apply(IS_ROUGH, error=error, least=least, **vars(found)))
    is_rough = accepted & (found.rough > 0.0)
    with text.when(is_rough.any(), likely=False):
        work.signed[0] = is_rough.select(0.25 * work.signed[0], 0.0)
        for part in put_points(lines):
            lines.call("sections", work.start, lines.table, work.rates)
            for k in text.each(count):
                values.after(part * count).choose(is_rough, k, work.rates[k])
        _restore_length(lines)


def _first_after(lines, k, last, first, direction):
    """Return the first part after `last` in which surface k is crossed, in each lane its own.

    So one search along steps is that of all lanes.
    """
    text, values, count = lines.text, lines.work.values, lines.half.changes.sections
    found = Carried(first=np.inf, u=0.0, low=0.0, high=1.0, a=0.0, b=0.0, up=0.0)
    for part in text.each(SECTION_PARTS, found):
        inputs = {"a": values[part * count + k], "b": values[(part + 1) * count + k]}
        inputs |= {"first": first[part], "accepted": lines.work.accepted[0]}
        inside = lines.apply(IN_PART, direction=direction, **inputs)
        is_first = inside.pop("crosses") & (found.first >= np.inf) & (first[part] > last)
        for name, value in (inside | {"first": first[part]}).items():
            setattr(found, name, is_first.select(value, getattr(found, name)))
    return found


def _dip(lines, i, first, last):
    """Return what `DIP` says of the values of a surface from row i on."""
    values, count = lines.work.values, lines.half.changes.sections
    a, b, c = (values.after(j * count)[i] for j in range(3))
    inputs = {"a": a, "b": b, "c": c, "first": first, "last": last}
    return lines.apply(DIP, **inputs)


def record_jumps(lines, is_there):
    """Record the crossings that changes of the state have made in these lanes."""
    text, line, work, half = lines.text, lines.line, lines.work, lines.half
    lines.call("sections", work.new, lines.table, work.values)
    work.moment[0] = line.t[0]
    text.copy(work.new, work.before, lines.D)
    for k in text.each(half.changes.sections):
        accepted = is_there.select(1.0, 0.0)
        inputs = {"a": line.section[k], "b": work.values[k], "first": 0.0, "accepted": accepted}
        inputs |= {"direction": 0.0}
        found = lines.apply(IN_PART, **inputs)
        with text.when(found["crosses"].any(), likely=False):
            _note(lines, k, found["crosses"], found["up"])
        line.section.choose(is_there, k, work.values[k])


def _directions(lines):
    """Return the directions of surfaces, as numbers that are part of the text."""
    return lines.text.constants(np.array(lines.half.changes.of_sections, float))


def _restore_length(lines):
    """Write the length of the step to `signed`, which shorter steps may have changed."""
    lines.work.signed[0] = lines.number("sign") * lines.work.taken[0]


def _rates(lines, x, f):
    """Find the values of surfaces at a state, and their rates."""
    work, D = lines.work, lines.half.block.D
    lines.text.copy(x, work.pair, D)
    lines.text.copy(f, work.pair.after(D), D)
    lines.call("section_rates", work.pair, lines.table, work.rates)


def _find_pair(lines, k, dip, middle):
    """Find both crossings of surface k beside its least value, if that lies beyond 0."""
    text, part = lines.text, 1.0 / SECTION_PARTS
    begin = {"u": middle + part * dip["place"], "left": dip["dips"].select(1.0, 0.0)}
    for now in text.rounds(Carried(**begin, deep=0.0, half=0.0, value=0.0, round=0)):
        _step_to(lines, now.u, now.left)
        value, rate = _look(lines, k)
        inputs = {"value": value, "rate": rate, "bend": dip["bend"], "middle": middle}
        found = lines.apply(DEEPER, u=now.u, left=now.left, **inputs)
        is_found = found["found"]
        now.deep = is_found.select(1.0, now.deep)
        now.half = is_found.select(found["half"], now.half)
        now.value = is_found.select(value, now.value)
        now.u, now.left = found["u"], found["left"]
        now.round = now.round + 1
        now.goes_on = (now.left > 0.0).any() & (now.round < LOWER)
    crosses, value = now.deep > 0.0, now.value
    up = (dip["bend"] > 0.0).select(0.0, 1.0)
    ends = lines.apply(BESIDE_LEAST, middle=middle, u=now.u, half=now.half)
    before, after = ({key: ends[f"{key}_{side}"] for key in ("u", "low", "high")}
                     for side in ("before", "after"))  # fmt: skip
    with text.when(crosses.any()):
        for now in text.rounds(Carried(**before, up=up, a=value, b=value, round=0)):
            _find(lines, k, crosses, now)
            now.update(after)
            now.up = 1.0 - up
            now.round = now.round + 1
            now.goes_on = now.round < 2


def _look(lines, k):
    """Return the value of surface k at the state `start`, and its rate; f there is in `f`."""
    work = lines.work
    lines.call("f", work.start, lines.table, work.f)
    _rates(lines, work.start, work.f)
    return work.rates[k * 2], work.rates.after(1)[k * 2]


def _step_to(lines, u, left):
    """Take a step to a part u of this one, in the lanes that are left, which ends at `start`."""
    work, line = lines.work, lines.line
    columns, p = (IMPLICIT, 1) if lines.half.is_implicit else (EXPLICIT, 2)
    own, sign = weights(columns, p), lines.number("sign")
    work.signed[0] = (left > 0.0).select(sign * (u * work.taken[0]), 0.0)
    lines.columns(line.x, line.f, len(columns))
    for i in lines.text.each(lines.D):
        new = line.x[i] + weighted(own, lines.of_columns(work.ends, i))
        work.start[i] = new


def _go_near(lines, signed):
    """Take a short step of the method of Runge and Kutta from `before`, which ends at `start`."""
    text, work, rates = lines.text, lines.work, lines.work.f_before
    text.copy(rates, work.a, lines.D)
    for part, weight in ((0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
        for i in text.each(lines.D):
            work.start[i] = work.before[i] + part * signed * rates[i]
        rates = work.f
        lines.call("f", work.start, lines.table, rates)
        for i in text.each(lines.D):
            work.a[i] = work.a[i] + weight * rates[i]
    for i in text.each(lines.D):
        work.start[i] = work.before[i] + signed * (1.0 / 6.0) * work.a[i]


def _find(lines, k, crosses, found):
    """Find crossings of surface k in parts of the step, from a guess u, and record them.

    The first look is a step from its start. Where the next ones are WITHIN a part of the step from
    there, they are steps from there, because short ones need f a few times only.
    """
    text, work, taken = lines.text, lines.work, lines.work.taken[0]
    up, sign = found.up, lines.number("sign")
    within = 0.0 if lines.half.is_implicit else WITHIN
    bracket = {"u": found.u, "low": found.low, "high": found.high}
    left = crosses.select(1.0, 0.0)
    work.moment[0] = 0.0
    work.ok[0] = 0.0
    for now in text.rounds(Carried(**bracket, left=left, base=np.inf, round=0)):
        is_left, part = now.left > 0.0, now.u - now.base
        is_near = is_left & (abs(part) <= within)
        is_far = is_left & ~is_near
        with text.when(is_far.any()):
            _step_to(lines, now.u, is_far.select(1.0, 0.0))
            for i in text.each(lines.D):
                work.before.choose(is_far, i, work.start[i])
        if within:
            with text.when(is_near.any()):
                _go_near(lines, is_near.select(sign * (part * taken), 0.0))
        now.base = is_far.select(now.u, now.base)
        value, rate = _look(lines, k)
        for i in text.each(lines.D):
            work.f_before.choose(is_far, i, work.f[i])
        inputs = {"value": value, "rate": rate, "up": up, "taken": taken, "start": work.t[0]}
        inputs |= {"a": found.a, "b": found.b}
        result = lines.apply(NEWTON, **inputs, **vars(now))
        is_found, move, moment = (result.pop(name) for name in ("found", "move", "moment"))
        with text.when(is_found.any()):
            move = move * sign
            for i in text.each(lines.D):
                work.before.choose(is_found, i, work.start[i] + move * work.f[i])
                work.f_before.choose(is_found, i, work.f[i])
            work.moment.choose(is_found, 0, moment)
            work.ok.choose(is_found, 0, 1.0)
        now.update(result)
        now.round = now.round + 1
        now.goes_on = (now.left > 0.0).any() & (now.round < MOST_LOOKS)
    is_found = work.ok[0] > 0.0
    is_known = _go_beyond(lines, k, is_found, up)
    _note(lines, k, is_found & is_known, up)


def _go_beyond(lines, k, truth, up):
    """Let states move on along their rates beyond the surface; return where it has a value."""
    text, work = lines.text, lines.work
    step = (work.t[0] + work.taken[0]) * NUDGE
    for now in text.rounds(Carried(step=step, known=0.0, round=0)):
        lines.call("sections", work.before, lines.table, work.rates)
        value = work.rates[k]
        is_known, is_above = abs(value) < inf, value >= 0.0
        now.known = is_known.select(1.0, 0.0)
        is_short = truth & is_known & (is_above ^ (up > 0.5))
        length = is_short.select(now.step, 0.0)
        work.moment[0] = work.moment[0] + length
        signed = length * lines.number("sign")
        for i in text.each(lines.D):
            moved = work.before[i] + signed * work.f_before[i]
            work.before.choose(is_short, i, moved)
        now.step = now.step * 4.0
        now.round = now.round + 1
        now.goes_on = is_short.any() & (now.round < NUDGES)
    return now.known > 0.0


def _note(lines, k, truth, up):
    """Record a crossing of surface k, and count it; a trajectory with enough of them stops."""
    text, line, work, changes = lines.text, lines.line, lines.work, lines.half.changes
    inputs = {"truth": truth.select(1.0, 0.0), "up": up, "direction": _directions(lines)[k]}
    inputs |= {"moment": work.moment[0], "latest": line.latest[k]}
    found = lines.apply(COUNTS, **inputs)
    line.latest.put_chosen(k, found["latest"])
    counts = found["counts"]
    with text.when(counts.any()):
        number = k + (len(changes.most) - changes.sections)
        record(lines, counts, number, work.moment, work.before, work.before)
        recorded = lines.of_changes.recorded[0] + counts.select(1.0, 0.0)
        lines.of_changes.recorded[0] = recorded
        line.tries.choose(counts, 0, 0.0)
        line.state.choose(counts & (recorded >= lines.number("enough")), 0, float(State.STOPPED))
