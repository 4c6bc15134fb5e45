"""The event cut: a step that crosses a surface is repeated until a step ends just beyond it.

A step evaluates surfaces at POINTS of its length, at the states (`POINT`)

x + u d + u (u - 1) ((1 - 2 u) d + (u - 1) h f(x) + u h f(x_next)),     d = x_next - x,

and the program `watch` of f compares the signs of surfaces at both ends of each part. A step that
may hide two crossings between points (`double_crossings`) is repeated with less length. For this
test f at one point makes the states more accurate (`QUARTIC`). In implicit steps they are on the
polynomial of degree 4 through the quarters of the step.

A step that crosses a surface is repeated with other lengths from the same state (`SEARCH`). They
lie between `inner`, at which no surface is crossed, and `outer`, at which one is crossed. Newton's
method uses values and rates at the ends of these steps (`step_to_surface`). If it fails, a straight
line between the states at `inner` and `outer` is used: the next length is where it meets the
surface. If the same end moves each time, the other end gets half the weight, a quarter, ... (the
Illinois rule). After ROUNDS_OF_SEARCH tries the length is the midpoint. The step of length `outer`
is accepted if both lengths differ by less than ACCURACY_OF_CROSSING of the time, or if it ends less
than this time after the crossing. Points inside an implicit step are inaccurate, so the first
length leads to the end of the part. If a step begins on a surface (after a bounce), Newton's method
starts at its end.
"""

import functools
import itertools
from math import inf
from typing import Any, NamedTuple

from ...expressions.values import larger, smaller
from ...hybrid.double_crossings import MIDDLE, POINTS
from ..memory import LaneState
from ..scalar_kernels import scalar_kernel
from ..step_length import Lane
from ..tolerances import (
    ACCURACY_AT_0,
    ACCURACY_OF_CROSSING,
    BEGINS_ON,
    BESIDE_POINT,
    EDGE,
    FACTOR_AFTER_REFUSED,
    GROWTH_AFTER_SURFACE,
    HIDDEN_FROM,
    LEAST_CUT,
    MOST_CUT,
    MOST_WEIGHT,
    NEARLY,
    PART_AFTER_SURFACE,
    PART_OF_WAVE,
    ROUNDS_OF_SEARCH,
    SAFETY,
)


def _bend(d, f_x, f_new, h, u):
    """Return (1 - 2 u) d + (u - 1) h f_x + u h f_new, for a step of length h from x to x + d."""
    return (1.0 - 2.0 * u) * d + (u - 1.0) * (h * f_x) + u * (h * f_new)


def _point(x, new, f_x, f_new, signed, u, quartic):
    """Return a component at the fraction u of an explicit step; `quartic` is added to a cubic."""
    change, product = new - x, u * (u - 1.0)
    bend = _bend(change, f_x, f_new, signed, u)
    return {"point": x + u * change + (bend + product * quartic) * product}


POINT_WITH_QUARTIC = scalar_kernel(_point)
POINT = scalar_kernel(functools.partial(_point, quartic=0.0))


@scalar_kernel
def QUARTIC(x, new, f_x, f_new, signed, f_point):
    """Return `quartic`, with which the curve of `_point` has the slope `f_point` at POINTS[0]."""
    u = POINTS[0]
    change, slope = new - x, u * (u - 1.0)
    of_cubic = (
        change + (2.0 * u - 1.0) * _bend(change, f_x, f_new, signed, u)
        + slope * (signed * f_x + signed * f_new - 2.0 * change)
    )  # fmt: skip
    own = (signed * f_point - of_cubic) * (1.0 / (2.0 * slope * (2.0 * u - 1.0)))
    return {"quartic": (abs(own) < inf).select(own, 0.0)}


class Search(NamedTuple):
    """Rows of a search for the length of a step that ends at a surface."""

    inner: Any  # length of a step that does not cross it
    outer: Any  # length of a step that crosses it; infinity without a search
    weight: Any  # Illinois rule: weight of the end at `inner`, or minus that at `outer`
    rounds: Any  # number of lengths tried
    unlimited: Any  # the next length if there were no surface


class FirstCrossing(NamedTuple):
    """The first crossing between points of a step, see `LOOK`."""

    crossed: Any
    place: Any
    end: Any


class Crossings(NamedTuple):
    """Crossings that values of surfaces at points of a step show."""

    crosses: Any  # 1 if the values at both ends show a crossing
    twice: Any  # 1 if the values at points show two crossings
    starts: Any  # 1 if a search begins
    hidden: Any  # from 1 on the step may hide crossings
    waves: Any  # the change of a phase, in quarters of a turn


class Cut(NamedTuple):
    """Results of `CROSSES` that decide about a step."""

    crosses: Any
    searched: Any
    is_close: Any
    hides: Any
    has_waves: Any


class Outcome(NamedTuple):
    """Results of `OUTCOME`, which has their meanings."""

    cuts: Any
    holds: Any
    again: Any
    refused: Any
    ends: Any
    lands: Any
    moves: Any


@scalar_kernel
def LOOK(crossed, place, end, part, crosses, u, width, taken, inner):
    """Update the first crossing in a step with the next interval between two points of the step.

    The interval has the length `width`, and ends at the fraction u of the step. `crossed` becomes 1
    at the first crossing, `place` is its fraction of the step, and `end` is the u of its interval.
    In the first part of the step, of the length `inner`, no crossing is sought, because a step of
    this length has none.
    """
    is_first = ((u * taken > inner).select(crosses, 0.0)) > crossed
    return {
        "crossed": is_first.select(1.0, crossed),
        "place": is_first.select(u - (1.0 - part) * width, place),
        "end": is_first.select(u, end),
        "is_first": is_first.select(1.0, 0.0),
    }


@scalar_kernel
def CROSSES(before, taken, total, last, points: Crossings, search: Search, since):
    """Return whether a step crosses a surface, ends just beyond it, or may hide two crossings.

    In a search for the length that ends at a surface, a step crosses a surface if the values of s
    at its two ends show a crossing, or the values at its points show two (`twice`).
    """
    searched, is_long = search.outer < inf, taken > HIDDEN_FROM * last
    accuracy = ACCURACY_OF_CROSSING * (before + taken) + ACCURACY_AT_0 * last
    is_crossed = searched.select(larger(points.crosses, points.twice), points.starts) > 0.0
    has_waves = (points.waves > 1.0) & is_long & ~searched
    root = points.hidden.sqrt().sqrt()  # `hidden` is of order 4 in h
    shorter = taken * larger(SAFETY / root, 0.5)
    return {
        "crosses": is_crossed & (taken > 0.0) & (total < inf),
        "is_close": searched & ((taken - search.inner <= accuracy) | (since <= accuracy)),
        "accuracy": accuracy,
        "searched": searched,
        "is_long": is_long,
        "hides": (points.hidden >= 1.0) & is_long,
        "has_waves": has_waves,
        "shorter": smaller(taken * (PART_OF_WAVE / points.waves), has_waves.select(inf, shorter)),
    }


@scalar_kernel
def OUTCOME(before, t, taken, accepted, served, goal, left, ended, search: Search, found: Cut):
    """Decide whether a step is repeated or moves the state, and whether it ends on a surface."""
    is_right = accepted + served > 0.0
    cuts = found.crosses & ~found.is_close & ~found.has_waves
    ends = (ended > 0.0) & (left <= EDGE * before)
    arrives = is_right & ~(found.crosses | found.has_waves)
    arrives = arrives & (left <= NEARLY * (before + taken)) | ends
    lands = (arrives | (found.crosses & found.is_close & is_right)) & (served > 0.0)
    again = (found.hides & is_right & ~(cuts | arrives)) | found.has_waves
    holds = found.searched & is_right & ~(found.crosses | again | arrives)
    holds = holds & (taken < larger(search.outer, 0.25 * search.unlimited)) & (t < goal)
    refused = cuts | holds | again
    moves = ~refused & (accepted + lands.select(1.0, 0.0) > 0.0) | ends
    return {
        "cuts": cuts,  # the step crosses a surface, and ends too far away: a shorter step is next
        "holds": holds,  # the step ends before the surface that is sought: a longer step is next
        "again": again,  # the step may hide crossings: a shorter step is next
        "refused": refused,  # for one of the three reasons above
        "ends": ends,  # the solution ends where the step began: f has no value beyond s = 0
        "lands": lands,  # a step aside (`step_length`) ends on a surface: so it moves the state
        "moves": moves,
        "at_surface": (moves & (found.crosses | arrives)).select(1.0, 0.0),
        "serves": (cuts | again | lands).select(0.0, served),
    }


@scalar_kernel
def SEARCH(
    taken, first: FirstCrossing, whole_part, part, search: Search, aim, accuracy, has_points,
    searched, cuts, holds,
):  # fmt: skip
    """Return the next length in a search, between `inner` and `outer`, and the search's rows."""
    misses = holds & (taken >= search.outer)  # the surface lies beyond `outer`
    of_end = (first.crossed > 0.0).select(first.end, 1.0) * taken
    of_place = (first.crossed > 0.0).select(first.place, whole_part) * taken
    is_beyond = cuts & searched & ~((search.inner <= 0.0) & (first.crossed > 0.0))
    is_rough = misses | ((first.end < 1.0) & ~searched & (has_points > 0.0))
    outer = cuts.select(of_end, misses.select(4.0 * taken, search.outer))
    inner = holds.select(taken, search.inner)
    part = cuts.select((of_place - inner) / (outer - inner), part)

    heavier = smaller(2.0 * abs(search.weight), MOST_WEIGHT)
    # If the crossing lies at the start of the step, as after a jump, no straight line fits: bisect.
    starts_on = cuts & (inner <= 0.0) & (part < LEAST_CUT)
    part = smaller(larger(part, LEAST_CUT), (abs(search.weight) >= 2.0).select(MOST_CUT, 1.0))
    part, width = starts_on.select(0.5, part), outer - inner
    of_inner = (search.weight >= 1.0).select(heavier, 1.0)
    of_outer = (search.weight <= -1.0).select(heavier, 1.0)
    a, b = cuts.select(1.0, of_outer) * part, cuts.select(of_inner, 1.0) * (1.0 - part)
    guess = inner + width * (search.rounds > ROUNDS_OF_SEARCH).select(0.5, a / (a + b))
    has_aim = (aim > inner) & (aim < outer) & (search.rounds <= ROUNDS_OF_SEARCH)
    guess = has_aim.select(aim + 0.5 * accuracy, guess)
    guess = smaller(larger(guess, inner + 0.75 * accuracy), outer - 0.75 * accuracy)
    weight = holds.select(-of_outer, search.weight)
    weight = cuts.select(is_rough.select(0.0, of_inner), weight)
    return {
        "length": is_rough.select(outer, (width > accuracy).select(guess, outer)),
        "inner": inner,
        "outer": outer,
        "weight": weight,
        "is_beyond": is_beyond,
    }


@scalar_kernel
def NEXT_LENGTH(
    taken, lane: Lane, length, shorter, known, search: Search, searched, is_long, outcome: Outcome
):
    """Return the next length, and the rows of a search, which begins, goes on, or ends."""
    searches = outcome.cuts | outcome.holds
    forgets = ~searches & (taken > 0.0)
    unlimited = search.unlimited
    most = larger(GROWTH_AFTER_SURFACE * taken, PART_AFTER_SURFACE * unlimited)
    after_surface = smaller(unlimited, most)
    after_this = (outcome.moves & searched).select(after_surface, lane.wanted)
    after_this = (outcome.moves & is_long).select(smaller(after_this, shorter), after_this)
    after_this = searches.select(length, after_this)
    begins = is_long.select(smaller(lane.wanted, known), lane.wanted)
    return {
        "wanted": outcome.again.select(smaller(shorter, lane.wanted), after_this),
        "longer": outcome.again.select(FACTOR_AFTER_REFUSED, lane.longer),
        "inner": forgets.select(0.0, search.inner),
        "outer": forgets.select(inf, search.outer),
        "weight": forgets.select(0.0, search.weight),
        "rounds": forgets.select(0.0, searches.select(search.rounds + 1.0, search.rounds)),
        "unlimited": searched.select(unlimited, begins),
    }


@scalar_kernel
def LEVEL(value, side, level, accepted):
    """Return the level of a surface after a step; it is 0 once s is on its side by as much.

    Until then rounding errors of s may be as large as the level.
    """
    is_on_side = (side > 0.5).select(value, -value) >= abs(level)
    is_over = (accepted > 0.0) & is_on_side & (side.equals(1.0) | side.equals(0.0))
    return {"level": is_over.select(0.0, level)}


@scalar_kernel
def TIME_AND_STATE(
    before, lane: Lane, steps, accepted, next, last, mode, jumps, crosses, outcome: Outcome
):
    """Return the time, number of steps and state of a lane after a step, and if f `jumped`.

    If the step is to be repeated (`refused`), time and number of steps are as before it. Then, or
    if f jumps or ends at the end of the step, the lane runs on, even if the step had ended it.
    """
    jumped = outcome.moves & crosses & (jumps > 0.0) & (lane.t < last)
    stopped = (lane.state >= LaneState.DONE).select(mode, lane.state)
    return {
        "t": outcome.refused.select(before, outcome.lands.select(next, lane.t)),
        "steps": outcome.refused.select(steps - accepted, steps + outcome.lands.select(1.0, 0.0)),
        "state": outcome.refused.select(stopped, (jumped | outcome.ends).select(mode, lane.state)),
        "jumped": jumped.select(1.0, 0.0),
    }


def cut(code, before, total):
    """Repeat a step that crosses a surface, or seeks one, with a better length."""
    text, line, work, integrator = code.text, code.line, code.work, code.integrator
    taken, count, pair, points = work.taken[0], integrator.surface_count, work.between, work.points
    ended, surfaces = text.value(0.0) > 0.0, integrator.event_surface_count
    text.copy(line.side, work.sides, 2 * surfaces)
    if surfaces and not any(integrator.events.holds):  # a solution ends where its last step began
        ended = line.state[0].equals(float(LaneState.ENDED)) & (taken > 0.0)
        with text.when(ended.any(), likely=False):
            for i in text.each(code.D):
                work.new.choose(ended, i, line.x[i])
            for i in text.each(code.extended):
                work.f_new.choose(ended, i, line.f_x[i])
    searches = line.outer[0] < inf
    from_start = ~(line.inner[0] > 0.0)
    inputs = _look_at_points(code, taken, from_start)
    inputs |= {"total": total, "before": before, "taken": taken, "ended": ended.select(1.0, 0.0)}
    inputs |= {"mode": code.mode, "goal": code.goal()}
    inputs["has_points"] = float(integrator.rule.has_points)
    of_new = points.after(len(POINTS) * count)
    text.copy(of_new, pair, count)
    code.call("surfaces", line.beyond, code.table, pair.after(count))
    inputs |= _watch(code, "part")  # where a line from `new` to `beyond` crosses a surface
    text.copy(points, pair, count)
    text.copy(of_new, pair.after(count), count)
    inputs |= _watch(code, "whole_part", "crosses", "jumps")  # between both ends of the step
    inputs |= _double_crossings(code, inputs)
    inputs |= _aim(code, inputs, searches, from_start)
    for kernel in (CROSSES, OUTCOME, SEARCH):
        inputs |= code.apply(kernel, **inputs)
    _keep_beyond(code, inputs["is_beyond"], work.new)
    found = code.apply(NEXT_LENGTH, **inputs) | code.apply(TIME_AND_STATE, **inputs)
    of_step = {"accepted": inputs["moves"].select(1.0, 0.0), "served": inputs["serves"]}
    of_step |= {"at_surface": inputs["at_surface"], "f_ends": inputs["ends"].select(1.0, 0.0)}
    of_step["jumped"] = found.pop("jumped")
    code.keep(work, of_step)
    code.keep(line, found)
    for k in _with_levels(integrator):  # the surfaces of events are the last ones
        inputs = {"value": of_new.after(count - surfaces)[k], "side": line.side[2 * k]}
        inputs |= {"level": line.side[2 * k + 1], "accepted": work.accepted[0]}
        line.side[2 * k + 1] = code.apply(LEVEL, **inputs)["level"]


def _with_levels(integrator):
    """Return the numbers of events on surfaces that set the state, except those of modes."""
    events = integrator.events
    surfaces = range(integrator.event_surface_count)
    return [k for k in surfaces if events.components[k] and events.holds[k] < 2]


def _look_at_points(code, length, from_start):
    """Return the first crossing between POINTS of a step of this length: results of `LOOK`.

    In lanes `from_start` no length without a crossing is known (`inner` is 0). There the state
    beyond the crossing goes to the row `beyond`.
    """
    text, line, work, integrator = code.text, code.line, code.work, code.integrator
    count, pair, point, points = integrator.surface_count, work.between, work.point, work.points
    code.call("surfaces", line.x, code.table, points)
    found = dict.fromkeys(("crossed", "place", "end"), text.value(0.0))
    if _has_quartics(integrator):
        u = text.value(POINTS[0])
        for i in text.each(code.D):
            work.start[i] = code.apply(POINT, i, u=u)["point"]
        code.call("f", work.start, code.table, work.f_start)
        for i in _read(code):
            work.quartic[i] = code.apply(QUARTIC, i, f_point=work.f_start[i])["quartic"]
    _look_inside(code, 0, 0.0, line.x)
    for k, (begin, end) in enumerate(itertools.pairwise((0.0, *POINTS)), 1):
        state = point if end < 1.0 else work.new
        if end < 1.0:
            _put_point(code, text.value(end), point)
        code.call("surfaces", state, code.table, points.after(k * count))
        _look_inside(code, k, end, state)
        if integrator.double_crossings.decision and k == MIDDLE:
            text.copy(point, points.after(integrator.at_points), integrator.D_of_surfaces)
        text.copy(points.after((k - 1) * count), pair, 2 * count)
        inputs = _watch(code, "part", "crosses") | found | {"u": end, "width": end - begin}
        found = code.apply(LOOK, taken=length, **inputs)
        _keep_beyond(code, (found.pop("is_first") > 0.0) & from_start, state)
    return found


def _watch(code, *names):
    """Return results of `watch` by `names`: crossings of surfaces between two points."""
    code.call("watch", code.work.between, code.table, code.work.crossings)
    return {name: code.work.crossings[k] for k, name in enumerate(names)}


def _keep_beyond(code, truth, state):
    """Copy a state beyond a surface to the row `beyond`, in lanes where `truth` is true."""
    beyond = code.line.beyond
    for i in _read(code):
        beyond.put_chosen(i, truth.select(state[i], beyond[i]))


def _look_inside(code, k, u, x):
    """Write what `double_crossings` reads at point k of a step: state x at the fraction u."""
    work, integrator, moving = code.work, code.integrator, code.work.moving
    of, D, points = integrator.double_crossings, integrator.D_of_surfaces, 1 + len(POINTS)
    phases = work.points.after(points * integrator.surface_count)
    rates = phases.after(points * of.inside[0] + k * of.inside[1])
    if of.phases:
        code.call("phases", x, code.table, phases.after(k * of.inside[0]))
    if of.rates:
        beside = u - BESIDE_POINT if u == 1.0 else u + BESIDE_POINT
        _put_point(code, code.text.value(beside), work.start)
        for i in _read(code):
            moving[i] = x[i]
            moving.after(D)[i] = (work.start[i] - x[i]) * (1.0 / (beside - u))
            moving.after(2 * D)[i] = code.line.largest[i]
        moving[3 * D] = code.number("rtol")
        code.call("rates", moving, code.table, rates)


def _double_crossings(code, inputs):
    """Return the inputs of `CROSSES` that tell whether a step may cross a surface twice."""
    integrator, decision = code.integrator, code.work.decision
    of, points = integrator.double_crossings, code.work.points
    found = {"starts": inputs["crossed"], "hidden": 0.0, "twice": 0.0, "waves": 0.0, "known": inf}
    if of.decision:
        points[integrator.at_points + integrator.D_of_surfaces] = code.number("rtol")
        code.call("double_crossings", points, code.table, decision)
        found |= {"hidden": decision[0], "twice": decision[1], "waves": decision[2]}
        if of.of_clocks:  # after a search, a longer step could hide crossings of clocks
            found["known"] = inputs["taken"]
        if of.of_states:  # states at points have errors: not each change of sign is a crossing
            found["starts"] = (decision[1] > 0.0).select(1.0, inputs["crosses"])
    return found


def _aim(code, inputs, searches, from_start):
    """Return times to surfaces, by Newton's method, and a better `place` of the first crossing.

    If a step begins on a surface and returns to it early, `place` is where the step returns.
    """
    text, line, work, D = code.text, code.line, code.work, code.f.of_x.D
    taken, place, end = (inputs[name] for name in ("taken", "place", "end"))
    surfaces = code.integrator.event_surface_count
    comes_back = from_start & (inputs["crossed"] > 0.0) & (end <= POINTS[0])
    comes_back = comes_back & (place <= BEGINS_ON * end)
    looks = searches | comes_back
    if surfaces:
        t, is_over = line.t[0], work.accepted[0] > 0.0
        is_asked = is_over & ((t >= inputs["goal"]) | (t >= line.next[0]))
        is_asked = is_asked | (work.served[0] > 0.0) | (inputs["ended"] > 0.0)
        looks = looks | is_asked

    def by_newton():
        sign = code.number("sign")
        text.copy(work.new, work.end, D)
        for i in text.each(D):
            work.end.after(D)[i] = sign * work.f_new[i]
        text.copy(line.side, work.end.after(2 * D), 2 * surfaces)
        code.call("aim", work.end, code.table, work.aim)
        to_surface, since, left = (work.aim[k] for k in range(3))  # see `aim_of`
        aim, since = searches.select(taken + to_surface, inf), searches.select(since, 0.0)
        back = 1.0 + to_surface / taken  # where the step returns to the surface of its start
        back = ((back > 0.0) & (back < end)).select(back, 0.5 * end)
        return aim, since, comes_back.select(back, place), left

    found = text.otherwise(~looks.any(), (inf, 0.0, place, inf), by_newton)
    found = dict(zip(("aim", "since", "place", "left"), found, strict=True))
    return found | {"left": is_asked.select(found["left"], inf) if surfaces else inf}


def _has_quartics(integrator):
    """Return True if components inside a step are of degree 4 in its fraction, see `QUARTIC`."""
    return integrator.double_crossings.of_states and not integrator.rule.has_points


def _put_point(code, u, to):
    """Write the components that surfaces read, at a fraction u of the step, to the state `to`."""
    kernel = POINT_WITH_QUARTIC if _has_quartics(code.integrator) else POINT
    rule = code.integrator.rule
    for i in _read(code):
        to[i] = rule.point(code, i, u) if rule.has_points else code.apply(kernel, i, u=u)["point"]


def _read(code):
    """Return an iterator; a `for` over it adds a loop over the components that surfaces read."""
    return code.text.listed(code.integrator.read)()
