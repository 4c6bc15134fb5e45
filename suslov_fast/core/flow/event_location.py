"""The event cut: a step that crosses a surface is taken again, until a step ends just beyond it.

A step evaluates surfaces at POINTS of its length, at the states (`POINT`)

x + u d + u (u - 1) ((1 - 2 u) d + (u - 1) h f(x) + u h f(x_next)),     d = x_next - x,

and `watch` of the integrator compares both ends of each part. A step that may hide two crossings
between points, see `double_crossings`, is taken again, shorter. Then states there are more
accurate, by f at one of them. In an implicit step they lie on the polynomial of degree 4 through
the states at its quarters.

A step that crosses a surface is taken again and again from the same state (`CUT`). Its lengths lie
between `inner`, at which no surface is crossed, and `outer`, at which one is. Newton's method uses
values and rates at the ends of these steps (`step_to_surface`). If it fails, the next length is
where a straight line between the states at `inner` and `outer` crosses the surface. If always the
same end moves, the other end gets half the weight, a quarter, ... (the Illinois rule); after ROUNDS
the length is the midpoint. Once both lengths differ by less than PLACE of the time, or a surface
was crossed less than that ago, the step of length `outer` is accepted. Points inside an implicit
step are inaccurate, so there the first length is that of the part. If a step begins on a surface,
as a ball after a bounce, Newton's method starts from its end (`BACK`).
"""

import itertools
from math import inf

from ..expressions.double_crossings import MIDDLE, POINTS
from ..expressions.values import larger, smaller
from .memory import LaneState
from .scalar_kernels import EDGE, NEARLY, scalar_kernel
from .step_length import AFTER_REFUSED, SAFETY

PLACE, PLACE_AT_0 = 2.0**-51, 2.0**-90  # of a surface: part of the time, and of all the time
HIDDEN_FROM = 2.0**-20  # part of the time, below which no step hides crossings
LEAST_PART, MOST_PART, MOST_WEIGHT = 2.0**-40, 1.0 - 2.0**-10, 2.0**60
ROUNDS = 14.0
# The longest step after one to a surface, relative to that step and to the step that crossed it:
# the next surface may be as near. With 64 x" = -sign(x) to 1e5 takes 9 tries a jump, 12 without;
# 6,000 random knots take 1 % more, with 8 as much as 8 %.
AFTER_THIS, AFTER_WHOLE = 64.0, 2.0**-8
OF_WAVES = 0.9  # of the longest step that waves allow, the length of the next one
BESIDE = 2.0**-12  # part of a step, over which a difference of states gives their rate
ON = 2.0**-8  # part of a step in which a straight line crosses the surface on which it begins


def _bend(d, f, f_new, h, u):
    """Return (1 - 2 u) d + (u - 1) h f + u h f_new, for a step of length h from x to x + d."""
    return (1.0 - 2.0 * u) * d + (u - 1.0) * (h * f) + u * (h * f_new)


def _point(x, new, f, f_new, signed, u, quartic=0.0):
    """Return `point`, a component at the fraction u of an explicit step, from both its ends.

    They are x with the rate f, and `new` with `f_new`; `signed` is the step length with its sign.
    The curve is a cubic, or of degree 4 with `quartic`, a result of `QUARTIC`.
    """
    change, product = new - x, u * (u - 1.0)
    bend = _bend(change, f, f_new, signed, u)
    return {"point": x + u * change + (bend + product * quartic) * product}


# `_point` as kernels: without and with the input `quartic`.
POINT, POINT_WITH_QUARTIC = scalar_kernel(_point), scalar_kernel(_point, "quartic")


@scalar_kernel
def QUARTIC(x, new, f, f_new, signed, f_point):
    """Return `quartic`, the factor of u**2 (1 - u)**2 that `_point` adds to the cubic, 0 for NaN.

    With it the rate at u = POINTS[0] is `f_point`. A step of length `signed` leads x to `new`.
    """
    u = POINTS[0]
    change, slope = new - x, u * (u - 1.0)
    of_cubic = (
        change + (2.0 * u - 1.0) * _bend(change, f, f_new, signed, u)
        + slope * (signed * f + signed * f_new - 2.0 * change)
    )  # fmt: skip
    own = (signed * f_point - of_cubic) * (1.0 / (2.0 * slope * (2.0 * u - 1.0)))
    return {"quartic": (abs(own) < inf).select(own, 0.0)}


@scalar_kernel
def POINT_IMPLICIT(x, new, quarter1, quarter2, quarter3, u):
    """Return `point`, a component at the fraction u of an implicit step, from its quarters minus x.

    The polynomial of degree 4 through x, these and `new` uses no rates: they contain fast modes.
    """
    v = [4.0 * u - float(k) for k in range(5)]
    of_new = v[0] * v[1] * v[2] * v[3] * (1.0 / 24.0)
    outer, inner = v[0] * v[2] * v[4] * (-1.0 / 6.0), v[0] * v[1] * v[3] * v[4] * 0.25
    sides = outer * v[3] * quarter1 + outer * v[1] * quarter3
    return {"point": x + (sides + inner * quarter2 + of_new * (new - x))}


@scalar_kernel
def LOOK(crossed, place, end, part, crosses, u, width, taken, inner):
    """Return the first crossing in a step: `crossed` (0 if none), its fraction `place`, and `end`.

    The inputs of these names are from parts of the step so far. The next part has the width `width`
    and ends at the fraction u. If `crosses` is 1, it has a crossing at its fraction `part`, and
    `end` becomes u. The step length is `taken`. Parts within the length `inner` do not count.
    """
    is_first = ((u * taken > inner).select(crosses, 0.0)) > crossed
    return {
        "crossed": is_first.select(1.0, crossed),
        "place": is_first.select(u - (1.0 - part) * width, place),
        "end": is_first.select(u, end),
        "is_first": is_first.select(1.0, 0.0),
    }


def _guess(cut, part, weight, rounds, lengths, aim, accuracy, is_rough):
    """Return the next length to try for a step to a surface, and the Illinois weights of `lengths`.

    `lengths` are (without a crossing of the surface, with a crossing). A line between the states
    there crosses it at the fraction `part`. `cut` is true if the last step crossed it. `weight` is
    the last weight, `rounds` is the number of tries, `aim` is the length by Newton's method. If
    both differ by less than `accuracy`, or if `is_rough`, the longer one is next.
    """
    (inner, outer), heavier = lengths, smaller(2.0 * abs(weight), MOST_WEIGHT)
    starts_on = cut & (inner <= 0.0) & (part < LEAST_PART)  # as after a jump: a line shows nothing
    part = smaller(larger(part, LEAST_PART), (abs(weight) >= 2.0).select(MOST_PART, 1.0))
    part, width = starts_on.select(0.5, part), outer - inner
    of_inner, of_outer = (weight >= 1.0).select(heavier, 1.0), (weight <= -1.0).select(heavier, 1.0)
    a, b = cut.select(1.0, of_outer) * part, cut.select(of_inner, 1.0) * (1.0 - part)
    guess = inner + width * (rounds > ROUNDS).select(0.5, a / (a + b))
    has_aim = (aim > inner) & (aim < outer) & (rounds <= ROUNDS)
    guess = has_aim.select(aim + 0.5 * accuracy, guess)
    guess = smaller(larger(guess, inner + 0.75 * accuracy), outer - 0.75 * accuracy)
    guess = is_rough.select(outer, (width > accuracy).select(guess, outer))
    return guess, of_inner, of_outer


@scalar_kernel
def CUT(
    before, t, taken, accepted, served, state, wanted, steps, tries, total, crossed, place, end,
    crosses, jumps, starts, hidden, twice, waves, known, whole_part, part, inner, outer, weight,
    rounds, whole, longer, mode, most, last, goal, aim, since, left, next, ended,
):  # fmt: skip
    """Return whether a step near a surface is `accepted`, and the next length, which leads to it.

    If `starts` is 1, a search starts: the step is taken again with other lengths, until it ends on
    the surface. A step aside, to a requested time, moves the state only if it ends on a surface.
    The results, and inputs that are not explained here, are rows of a lane (`memory`).

    before, total     time at the beginning of the step; finite if f at its end is
    crossed to end    results of `LOOK`: the first crossing between points of the step
    crosses, jumps    1 if a line from x to x_next crosses a surface, and if f jumps there
    hidden            from 1 on, two crossings may be hidden between points: a shorter step is next
    twice, waves      1: two crossings are seen; above 1: waves are too fast, a shorter step is next
    known             limit of `whole`, the length after a search, unless this step is very short
    whole_part, part  where lines cross, as fractions: x to x_next; x_next to the state at `outer`
    inner, outer      lengths without and with a crossing; 0 and infinity without a search
    aim               length of the step that ends on the surface, see `step_to_surface`
    since, goal       the longest time since a surface was crossed; the time that no step passes
    left              time to a surface of an event, less rounding; if it is NEARLY 0, the step ends
    ended             1 if the solution ends where the step began: f has no value beyond
    """
    is_near = outer < inf
    sought = PLACE * (before + taken) + PLACE_AT_0 * last
    seen = is_near.select(larger(crosses, twice), starts) > 0.0
    seen = seen & (taken > 0.0) & (total < inf)
    is_last = is_near & ((taken - inner <= sought) | (since <= sought))
    is_long = taken > HIDDEN_FROM * last
    is_right = accepted + served > 0.0
    has_waves = (waves > 1.0) & is_long & ~is_near
    cut = seen & ~is_last & ~has_waves
    ends = (ended > 0.0) & (left <= EDGE * before)  # f has no value beyond the surface
    arrives = is_right & ~(seen | has_waves) & (left <= NEARLY * (before + taken)) | ends
    is_aside = (arrives | (seen & is_last & is_right)) & (served > 0.0)
    again = ((hidden >= 1.0) & is_long & is_right & ~(cut | arrives)) | has_waves
    is_right = is_right & ~(seen | again | arrives)
    holds = is_near & is_right & (taken < larger(outer, 0.25 * whole)) & (t < goal)
    misses = holds & (taken >= outer)  # the surface lies farther
    searches = cut | holds
    told = taken * larger(SAFETY / hidden.sqrt().sqrt(), 0.5)  # the error there is of order 4
    told = smaller(taken * (OF_WAVES / waves), has_waves.select(inf, told))
    forgets = ~searches & (taken > 0.0)
    searches = searches | again
    moved = ~searches & (accepted + is_aside.select(1.0, 0.0) > 0.0) | ends
    first = (crossed > 0.0).select(end, 1.0) * taken
    outer_now = cut.select(first, misses.select(4.0 * taken, outer))
    inner_now = holds.select(taken, inner)
    of_step = (crossed > 0.0).select(place, whole_part)
    own = cut.select((of_step * taken - inner_now) / (outer_now - inner_now), part)
    is_known = (inner <= 0.0) & (crossed > 0.0)  # the state at the end of a part
    is_rough = misses | ((end < 1.0) & ~is_near & (mode > 0.0))
    lengths, aim = (inner_now, outer_now), is_near.select(aim, inf)
    guess, of_inner, of_outer = _guess(cut, own, weight, rounds, lengths, aim, sought, is_rough)
    after_surface = smaller(whole, larger(AFTER_THIS * taken, AFTER_WHOLE * whole))
    after_this = (moved & is_near).select(after_surface, wanted)
    after_this = (moved & is_long).select(smaller(after_this, told), after_this)
    of_hold = holds.select(-of_outer, forgets.select(0.0, weight))
    running = (tries > most).select(float(LaneState.TOO_MANY), mode)
    stopped = (state >= LaneState.DONE).select(running, state)
    jumped = moved & seen & (jumps > 0.0) & (t < last)
    after = (jumped | ends).select(running, state)
    return {
        "accepted": moved.select(1.0, 0.0),
        "served": (cut | again | is_aside).select(0.0, served),
        "t": searches.select(before, is_aside.select(next, t)),
        "steps": searches.select(steps - accepted, steps + is_aside.select(1.0, 0.0)),
        "state": searches.select(stopped, after),
        "wanted": again.select(smaller(told, wanted), searches.select(guess, after_this)),
        "longer": again.select(AFTER_REFUSED, longer),
        "inner": forgets.select(0.0, inner_now),
        "outer": forgets.select(inf, outer_now),
        "weight": cut.select(is_rough.select(0.0, of_inner), of_hold),
        "rounds": forgets.select(0.0, searches.select(rounds + 1.0, rounds)),
        "whole": is_near.select(whole, is_long.select(smaller(wanted, known), wanted)),
        "beyond": (cut & is_near & ~is_known).select(1.0, 0.0),
        "at_surface": (moved & (seen | arrives)).select(
            ends.select(3.0, arrives.select(2.0, 1.0)), 0.0
        ),
        "jumped": jumped.select(1.0, 0.0),
    }


@scalar_kernel
def BACK(found, taken, end):
    """Return `place`, the fraction of a step at which it returns to the surface of its start.

    It is 1 + `found` / `taken`: `found` is the time from the end of the step, `taken` its length.
    If it is not between 0 and `end`, the end of the part with a crossing, it is `end` / 2.
    """
    place = 1.0 + found / taken
    return {"place": ((place > 0.0) & (place < end)).select(place, 0.5 * end)}


def cut(code, before, total):
    """Repeat a step that crosses a surface, or seeks one, with a better length (`CUT`).

    `before` is the time at which the step begins; `total` is finite if f at its end is.
    """
    text, line, work, integrator = code.text, code.line, code.work, code.integrator
    taken, count, pair, points = work.taken[0], integrator.surfaces, work.between, work.points
    ended, surfaces = text.value(0.0) > 0.0, integrator.event_surfaces
    text.copy(line.side, work.sides, 2 * surfaces)
    if surfaces and not any(integrator.events.holds):
        ended = line.state[0].equals(float(LaneState.ENDED)) & (taken > 0.0)
        with text.when(ended.any(), likely=False):
            for i in text.each(code.D):
                work.new.choose(ended, i, line.x[i])
            for i in text.each(code.extended):
                work.f_new.choose(ended, i, line.f[i])
    has_no_search = ~(line.outer[0] < inf)
    from_start = ~(line.inner[0] > 0.0)
    inputs = _look_at_points(code, taken, from_start)
    inputs |= {"total": total, "before": before, "taken": taken, "ended": ended.select(1.0, 0.0)}
    inputs |= {"mode": code.mode, "goal": code.goal().get("last", code.number("last"))}
    of_new = points.after(len(POINTS) * count)
    text.copy(of_new, pair, count)
    code.call("surfaces", line.beyond, code.table, pair.after(count))
    inputs |= _watch(code, "part")
    text.copy(points, pair, count)
    text.copy(of_new, pair.after(count), count)
    inputs |= _watch(code, "whole_part", "crosses", "jumps")
    inputs |= _double_crossings(code, inputs)
    found = code.apply(CUT, **inputs | _aim(code, inputs, has_no_search, from_start))
    _keep_beyond(code, found.pop("beyond") > 0.0, work.new)
    own = "at_surface", "jumped", "accepted", "served"
    code.keep(work, {name: found.pop(name) for name in own})
    code.keep(line, found)


def _look_at_points(code, length, from_start):
    """Return the first crossing between POINTS of a step (results of `LOOK`).

    `length` is the length of the step. `from_start` marks lanes that know no shorter step without a
    crossing: there the state after the crossing becomes the row `beyond`.
    """
    text, line, work, integrator = code.text, code.line, code.work, code.integrator
    count, pair, point, points = integrator.surfaces, work.between, work.point, work.points
    code.call("surfaces", line.x, code.table, points)
    found = dict.fromkeys(("crossed", "place", "end"), text.value(0.0))
    if _has_quartics(integrator):
        _find_quartic(code)
    _look_inside(code, 0, 0.0, line.x)
    for k, (begin, end) in enumerate(itertools.pairwise((0.0, *POINTS)), 1):
        state = point if end < 1.0 else work.new
        if end < 1.0:
            _put_point(code, text.value(end), point)
        code.call("surfaces", state, code.table, points.after(k * count))
        _look_inside(code, k, end, state)
        if integrator.double_crossings.decision and k == MIDDLE:
            text.copy(point, points.after(integrator.at_points), integrator.watched)
        text.copy(points.after((k - 1) * count), pair, 2 * count)
        inputs = _watch(code, "part", "crosses") | found | {"u": end, "width": end - begin}
        found = code.apply(LOOK, taken=length, **inputs)
        _keep_beyond(code, (found.pop("is_first") > 0.0) & from_start, state)
    return found


def _watch(code, *names):
    """Return, by `names`, at which fraction, and if, a surface is crossed between two points."""
    code.call("watch", code.work.between, code.table, code.work.crossings)
    return {name: code.work.crossings[k] for k, name in enumerate(names)}


def _keep_beyond(code, truth, state):
    """Copy a state beyond a surface to the row `beyond`, in lanes where `truth` is true."""
    beyond = code.line.beyond
    for i in _read(code):
        beyond.put_chosen(i, truth.select(state[i], beyond[i]))


def _look_inside(code, k, u, x):
    """Write the arguments of sin, cos and tan, and rates of surfaces, at point k of a step.

    There the state is x, at the fraction u of the step.
    """
    work, integrator, moving = code.work, code.integrator, code.work.moving
    of, D, points = integrator.double_crossings, integrator.watched, 1 + len(POINTS)
    phases = work.points.after(points * integrator.surfaces)
    rates = phases.after(points * of.inside[0] + k * of.inside[1])
    if of.phases:
        code.call("phases", x, code.table, phases.after(k * of.inside[0]))
    if of.rates:
        beside = u - BESIDE if u == 1.0 else u + BESIDE
        _put_point(code, code.text.value(beside), work.start)
        for i in _read(code):
            moving[i] = x[i]
            moving.after(D)[i] = (work.start[i] - x[i]) * (1.0 / (beside - u))
        moving[2 * D] = code.number("rtol")
        code.call("rates", moving, code.table, rates)


def _double_crossings(code, inputs):
    """Return the inputs of `CUT` that tell whether a step may cross a surface twice."""
    integrator, decision = code.integrator, code.work.decision
    of, points = integrator.double_crossings, code.work.points
    found = {"starts": inputs["crossed"], "hidden": 0.0, "twice": 0.0, "waves": 0.0, "known": inf}
    if of.decision:
        points[integrator.at_points + integrator.watched] = code.number("rtol")
        code.call("double_crossings", points, code.table, decision)
        found |= {"hidden": decision[0], "twice": decision[1], "waves": decision[2]}
        if of.of_clocks:  # a longer step may fit the periods of a clock
            found["known"] = inputs["taken"]
        if of.of_states:  # differences within the errors of points are no crossings
            found["starts"] = (decision[1] > 0.0).select(1.0, inputs["crosses"])
    return found


def _aim(code, inputs, has_no_search, from_start):
    """Return the inputs of `CUT` that Newton's method finds: `aim`, `since`, `left` and `place`.

    These are the length of a step to the surface; the longest time since a surface was crossed; the
    time left to a surface; and the fraction of the step at the first crossing. `inputs` are inputs
    of `CUT` so far. `has_no_search` marks lanes that have looked for no surface before this step,
    `from_start` lanes that know no shorter step without a crossing.
    """
    text, line, work, D = code.text, code.line, code.work, code.f.of.D
    found, surfaces = work.aim.after(3), code.integrator.event_surfaces
    for k, value in {0: inf, 1: 0.0, 2: inputs["place"], 5: inf}.items():
        work.aim.put_chosen(k, value)
    comes_back = from_start & (inputs["crossed"] > 0.0) & (inputs["end"] <= POINTS[0])
    comes_back = comes_back & (inputs["place"] <= ON * inputs["end"])
    looks = ~has_no_search | comes_back
    if surfaces:
        t, is_over = line.t[0], work.accepted[0] > 0.0
        is_asked = is_over & ((t >= inputs["goal"]) | (t >= line.next[0]))
        is_asked = is_asked | (work.served[0] > 0.0) | (inputs["ended"] > 0.0)
        looks = looks | is_asked
    with text.when(looks.any(), likely=False):
        sign = code.number("sign")
        text.copy(work.new, work.end, D)
        for i in text.each(D):
            work.end.after(D)[i] = sign * work.f_new[i]
        text.copy(line.side, work.end.after(2 * D), 2 * surfaces)
        code.call("aim", work.end, code.table, found)
        work.aim.choose(~has_no_search, 0, inputs["taken"] + found[0])
        work.aim.choose(~has_no_search, 1, found[1])
        own = {name: inputs[name] for name in ("taken", "end")}
        place = code.apply(BACK, found=found[0], **own)["place"]
        work.aim.choose(comes_back, 2, place)
    found = {name: work.aim[k] for k, name in enumerate(("aim", "since", "place"))}
    return found | {"left": is_asked.select(work.aim[5], inf) if surfaces else inf}


def _has_quartics(integrator):
    """Return True if components inside a step are of degree 4 in its fraction, see `QUARTIC`."""
    return integrator.double_crossings.of_states and not integrator.is_implicit


def _put_point(code, u, to):
    """Write the components that surfaces read, at a fraction u of the step, to the state `to`."""
    inputs = {}
    of_point = POINT_WITH_QUARTIC if _has_quartics(code.integrator) else POINT
    quarters = [code.work.nodes.after(k * code.D) for k in range(3)]
    for i in _read(code):
        if code.integrator.is_implicit:
            of_point = POINT_IMPLICIT
            inputs = {f"quarter{k}": own[i] for k, own in enumerate(quarters, 1)}
        to[i] = code.apply(of_point, i, u=u, **inputs)["point"]


def _read(code):
    """Add a loop over the components that surfaces read, with the body of `for`."""
    return code.text.listed(code.integrator.read)()


def _find_quartic(code):
    """Write `QUARTIC`, factors of u**2 (1 - u)**2 in components inside a step, to `quartic`."""
    text, work = code.text, code.work
    u = text.value(POINTS[0])
    for i in text.each(code.D):
        work.start[i] = code.apply(POINT, i, u=u)["point"]
    code.call("f", work.start, code.table, work.f)
    for i in _read(code):
        work.quartic[i] = code.apply(QUARTIC, i, f_point=work.f[i])["quartic"]
