"""Actions of events at the end of a step, at given times and on surfaces.

At one instant events with given times act first, in the order of their list. Then events act if a
step or an action has led the state across their surfaces. For this a trajectory stores its side of
each surface. The code is a function of its own, because events at time 0 act before the first step.

Scalar kernels read four numbers of a surface s = 0 at a state: `value` is s, `rate` is ds/dt, and
`size` and `rate_size` are the sums of the moduli of their terms. `sign` is the sign of time. A
state with |s| <= `near` is on the surface.
"""

from math import inf
from typing import Any, NamedTuple

from ...expressions.tolerances import TINY
from ...expressions.values import larger, smaller
from ...hybrid.event_formulas import GAP, OF_SURFACE
from ...hybrid.tolerances import NOISE_OF_SURFACE, ROUNDING_OF_SURFACE
from ...llvm.text import Carried, Integers, Shared
from ..codegen import larger_of
from ..growing_components import RAISED
from ..memory import LaneState
from ..projected_states import keep_levels
from ..scalar_kernels import scalar_kernel
from ..step_length import first_length, sizes_of
from ..tolerances import (
    ACTIONS_AT_ONCE,
    ACTIONS_AT_ONE_INSTANT,
    AT_ONCE,
    EDGE,
    FACTOR_AT_FIRST,
    FAR_FROM_SURFACE,
    FASTER_AFTER_ACTION,
    GROWTH_AFTER_SURFACE,
    GROWTH_TO_POLE,
    LOW_AFTER_ACTION,
    MOMENT,
    NEARLY,
    SLOW_AT_SURFACE,
)
from . import branch_choice
from .mode_search import find_modes, is_marked
from .records import record

LEAST_POSITIVE = 2.0**-1074  # the least positive number
STAYS = 0.25  # a mark in the row `side` (else 0, 1 or `GAP`): the state stays on the surface


class Surface(NamedTuple):
    """The numbers of a surface s = 0 at a state, as at the head of this file."""

    value: Any
    rate: Any
    size: Any
    rate_size: Any


class Place(NamedTuple):
    """The `side` of a surface on which a state is; it is above if s is at least `level`."""

    side: Any
    level: Any


class Kind(NamedTuple):
    """Properties of the function s of a surface, with `EventAction.holds`."""

    holds: Any
    may_be_flat: Any
    may_have_poles: Any


class StepEnd(NamedTuple):
    """The end of a step: its time, the last time, the sign of time, and the outcome of the step."""

    t: Any
    last: Any
    sign: Any
    accepted: Any
    f_ends: Any


class Following(NamedTuple):
    """Actions that follow one another: the carried results of `AGAIN`, and its two rows."""

    more: Any
    limit: Any
    hop: Any
    acted_at: Any
    pause: Any


def _level(is_above, value, rounding):
    """Return a level c for which s - c is on the side `is_above`, with s = `value`; 0 if s is."""
    below = (value < 0.0).select(0.0, value + (rounding + LEAST_POSITIVE))
    return is_above.select(smaller(value, 0.0), below)


def _side(value, rate, size, rate_size, near, t, sign, at=0.0):
    """Return `side` and `level` of a state at a surface s = 0, and whether it `is_on` the surface.

    The state is above if s >= `level`, usually 0. It is on the surface if |s| is rounding, or if s
    becomes 0 within the time NEARLY * t. The same holds if s - `at` is rounding: `at` is the level
    that an action has left. Then its side is the one to which the rate leads, and
    `level` becomes a number close to s, such that s is on this side of it. If the rate is rounding,
    the side is STAYS.
    """
    rounding = ROUNDING_OF_SURFACE * (size + rate_size * t)
    away = smaller(abs(value), abs(value - at))
    is_on = away <= larger(near, NEARLY * t * abs(rate)) + rounding
    stays = abs(rate) <= ROUNDING_OF_SURFACE * rate_size
    goes_up = sign * rate > 0.0
    level = _level(goes_up, value, rounding)
    side = stays.select(STAYS, goes_up.select(1.0, 0.0))
    beside = (value >= 0.0).select(1.0, value.equals(value).select(0.0, GAP))
    return {
        "side": is_on.select(side, beside),
        "level": is_on.select(stays.select(inf, level), 0.0),
        "is_on": is_on.select(1.0, 0.0),
    }


SIDE = scalar_kernel(_side)  # `_side` as a kernel, with the same inputs and results


@scalar_kernel
def SIDE_AT_START(value, rate, size, rate_size, near, t, sign, holds):
    """Return `side` and `level` as `_side`; with `EventAction.holds` 2, on the surface is above."""
    found = _side(value, rate, size, rate_size, near, t, sign)
    held = (holds > 1.0) & (found["is_on"] > 0.0)
    return {
        "side": held.select(1.0, found["side"]),
        "level": held.select(-abs(value) - ROUNDING_OF_SURFACE * size, found["level"]),
    }


@scalar_kernel
def TOUCHING_SIDE(
    place: Place, at: Surface, later, slopes, slopes_later, has_branches, at_start, fired, sign
):
    """Return `side` and `level` of a state at a surface s = 0; STAYS becomes a side in two cases.

    If s is 0 in a whole neighbourhood of the state, the side is above. Only an s with branches is,
    such as min(x, 0); cos(x) - 1 is 0 at one point. At a start the slopes where the motion leads
    decide. If an event has acted (`fired`), and the rate
    leads back a moment later, the side is the one from which the state came.
    """
    (side, level), (value, rate, size, rate_size) = place, at
    stays = side.equals(STAYS)
    is_flat = value.equals(0.0) & slopes_later.equals(0.0) & (has_branches > 0.5)
    is_flat = is_flat & ((stays & slopes.equals(0.0)) | (at_start > 0.5))
    lifts = stays & (-(fired * sign) * (later - rate) > ROUNDING_OF_SURFACE * rate_size)
    back = (fired < 0.0).select(1.0, 0.0)
    level_back = _level(fired < 0.0, value, ROUNDING_OF_SURFACE * size)
    return {
        "side": is_flat.select(1.0, lifts.select(back, side)),
        "level": is_flat.select(0.0, lifts.select(level_back, level)),
    }


@scalar_kernel
def LEVEL_AFTER_ACTION(side, level, value, rate, fired, holds, t, sign):
    """Return the level of a surface on which an event has acted (`fired`).

    The level is 0 again if the state, beyond s = 0 by rounding, reaches its side at once. But an
    action may leave the state so slow that it returns before. It returns to where it was.
    """
    leads = (side > 0.5).select(sign * rate, -(sign * rate))
    is_clear = ~side.equals(STAYS) & (abs(value) <= NEARLY * t * leads)
    is_clear = is_clear & (abs(fired) > 0.0) & (holds < 2.0)
    return {"level": is_clear.select(0.0, level)}


@scalar_kernel
def CROSSED(
    at: Surface, slopes, slopes_later, near, place: Place, crossed_at, is_here, by_motion,
    kind: Kind, s_start, end: StepEnd,
):  # fmt: skip
    """Return whether a state crossed a surface `up` or `down`, and the rows of the surface.

    A crossing is a change of the side, where events may act (`is_here`). A state on the surface has
    the side to which its rate leads, as in `_side`. If the rate is rounding, the side remains; but
    it changes if s has changed its sign along the step (`by_motion`). If only rounding led a state
    across, its return at once is no crossing. At a pole s, with the value `s_start` where the step
    began, changes its sign, though its rate leads back: this changes the side, and is no crossing.
    """
    (value, rate, size, _), (side, level) = at, place
    (holds, may_be_flat, may_have_poles), (t, last, sign, accepted, f_ends) = kind, end
    is_here, by_motion, stays = is_here > 0.0, by_motion > 0.0, side.equals(STAYS)
    has_side = ~(stays | side.equals(GAP))
    of_value = (value >= level).select(1.0, value.equals(value).select(0.0, GAP))
    near = (f_ends > 0.0).select(larger(near, EDGE * t * abs(rate)), near)
    of_terms = stays.select(LOW_AFTER_ACTION, NOISE_OF_SURFACE) * size
    left = (holds > 1.0).select(0.0, level)
    near_surface = _side(*at, larger(of_terms, near), t, sign, left)
    on = (near_surface["is_on"] > 0.0) & (abs(value) < inf)
    is_slow = SLOW_AT_SURFACE * last * abs(rate) <= ROUNDING_OF_SURFACE * size
    of_rest = is_slow | near_surface["side"].equals(STAYS)
    is_back = (side > 0.5).select(sign * rate, -(sign * rate)) > 0.0
    here = of_rest.select((by_motion & ~is_back).select(of_value, side), near_surface["side"])
    # Where s is 0 all around, the side is above as in `TOUCHING_SIDE`, even if `level` is above 0.
    # At a kink, where the slope may be that of the other side, the slope a moment later decides.
    is_0 = slopes.equals(0.0) | slopes_later.equals(0.0)
    here = (value.equals(0.0) & is_0 & (may_be_flat > 0.5)).select(1.0, here)
    has_grown = (abs(value) > GROWTH_TO_POLE * abs(s_start)) & (abs(s_start) > 0.0)
    is_pole = (on & is_back & has_grown) | abs(value).equals(inf)
    is_pole = is_pole & by_motion & (may_have_poles > 0.5)
    here = is_pole.select(of_value, here)
    # Just beyond the pole of log(abs(q)) the rate leads to 0 at once, but s is as large as a term.
    is_large = (abs(value) > FAR_FROM_SURFACE * size) & of_value.equals(side)
    here = (is_large & (may_have_poles > 0.5)).select(side, here)
    # With `EventAction.holds` 2, a rate alone changes no side: s must also have passed `level`.
    here = ((holds > 1.0) & ~is_back).select(of_value, here)
    now = has_side.select(on.select(here, of_value), stays.select(near_surface["side"], of_value))
    differs = is_here & has_side & ~(now.equals(GAP) | now.equals(side) | is_pole)
    again = (by_motion | on) & (t - crossed_at <= AT_ONCE * t)
    # A level lasts until s itself, at the level 0, is on the side of the state.
    lasts = has_side & now.equals(side) & of_value.equals(side)
    lasts = lasts & ((value >= 0.0) ^ (side > 0.5))
    moved = on & has_side & (by_motion | of_rest)
    own = _level(now > 0.5, value, ROUNDING_OF_SURFACE * size)
    moved = moved.select(own, lasts.select(level, 0.0))
    moved = (holds > 1.0).select(level, is_pole.select(0.0, moved))
    changes = is_here | (stays & (accepted > 0.0))
    return {
        "side": changes.select(now, side),
        "level": changes.select(stays.select(near_surface["level"], moved), level),
        "crossed_at": differs.select((by_motion | on).select(t, -inf), crossed_at),
        "up": differs & ~again & (now > 0.5),
        "down": differs & ~again & ~(now > 0.5),
        "near": on.select(larger(near, abs(value) + abs(value)), near),
    }


@scalar_kernel
def AGAIN(
    fired, near, rate_before, at: Surface, later, moment, t, wanted, so_far: Following, sign, rests
):
    """Return `more` > 0 if actions at s = 0 follow one another at once, and when they accumulate.

    With r = ds/dt and a = dr/dt after the action, s is 0 again after a time 2 |r / a|, and |s|
    rises to r**2 / (2 |a|). If each action reduces r by the factor q, the times of actions have the
    `limit` 2 |r / a| / (1 - q) later, when the state is at rest. If a does not lead back, `limit`
    is Aitken's extrapolation from the times of the last actions. If the action itself decides when
    a body rests (`rests`), only actions that do follow at once count.

    The next step is at most `hop`, twice the time 2 |r / a|. If s is a cubic that returns to 0 and
    becomes positive again, it is negative there: at the end of this step the return is seen.
    """
    (value, rate, size, rate_size), (more, limit, hop, acted_at, pause) = at, so_far
    is_fired, gap, now = abs(fired) > 0.0, t - acted_at, larger(t, wanted)
    is_on = abs(value) <= near + (ROUNDING_OF_SURFACE * size + TINY)
    stays = abs(rate) <= ROUNDING_OF_SURFACE * (rate_size + abs(rate_before))
    turn, change = -(fired * sign), later - rate
    bends = (abs(change) > ROUNDING_OF_SURFACE * rate_size) & (turn * change < 0.0)
    returns = is_on & bends & (stays | (turn * rate > 0.0))
    comes_back = returns & (abs(rate) < abs(rate_before))
    parabola = (abs(rate) + abs(rate)) * (moment / abs(change))
    rests = rests > 0.0
    away = (comes_back & ~rests).select(parabola, gap)
    of_terms = LOW_AFTER_ACTION * (size + rate_size * now)  # rounding errors of s at times near t
    is_low = is_on & (comes_back | ~stays) & (0.25 * (abs(rate) * away) <= of_terms)
    is_soon = (away <= AT_ONCE * rests.select(t, now)) | (is_low & ~rests)
    is_at_once = is_fired & is_soon
    counts = is_at_once.select((comes_back & ~rests).select(ACTIONS_AT_ONCE, 1.0), 0.0)
    of_gaps = (pause > gap).select(gap * gap / (pause - gap), 0.0)
    of_rates = parabola / (1.0 - abs(rate / rate_before))
    return {
        "more": larger(counts, more),
        "limit": is_at_once.select(smaller(t + comes_back.select(of_rates, of_gaps), limit), limit),
        "hop": (is_fired & returns & ~(stays | is_at_once)).select(
            smaller(2.0 * parabola, hop), hop
        ),
        "acted_at": is_fired.select(t, acted_at),
        "pause": is_fired.select(gap, pause),
    }


@scalar_kernel
def LENGTH_AFTER_ACTIONS(size, rate, largest, rate_before, wanted, part, last, longest, hop):
    """Return the next length: `wanted`, or the `first_length` at the new state if that is longer.

    If actions have made f more than FASTER_AFTER_ACTION times as large, `wanted` is first cut to
    the `first_length` for the largest values so far. The length is at most `hop`.
    """
    guess = first_length(size, rate, part, last)
    of_largest = first_length(larger(size, largest), rate, part, last)
    least = (rate > FASTER_AFTER_ACTION * rate_before).select(smaller(wanted, of_largest), wanted)
    guess = larger((rate > 0.0).select(guess, 0.0), least)
    return {"wanted": smaller(smaller(smaller(guess, last), longest), hop)}


@scalar_kernel
def STATE_AFTER_ACTIONS(total, endless, more, limit, t, state, often, last):
    """Return the time `at` of actions, `often`, how many followed at once, and the lane's `state`.

    Actions accumulate if they are `endless` at one instant, or if ACTIONS_AT_ONCE follow at once.
    Then `at` is the `limit` of their times.
    """
    often_now = (more > 0.0).select(often + more, 0.0)
    piles_up = (often_now >= ACTIONS_AT_ONCE) | (endless > 0.0)
    after = piles_up.select(float(LaneState.ACCUMULATES), state)
    after = (state < LaneState.DONE).select(after, state)
    after = (total < inf).select(after, float(LaneState.ENDED))
    end = (limit < inf).select(smaller(limit, last), t)
    return {
        "state": after,
        "at": after.equals(float(LaneState.ACCUMULATES)).select(end, t),
        "often": often_now,
    }


def change(code):
    """Let events act on the state `new`, at given times, then on surfaces; set what comes next."""
    text, work, events = code.text, code.work, code.integrator.events
    is_there, is_at_stop = _is_there(code), _is_at_stop(code)
    work.actions_now[0] = 0.0
    for i in text.each(code.D):  # the largest moduli include states before an action
        code.keep_largest(is_there, i, work.new[i])
    for c in text.each(code.f.columns):
        work.tau[c] = 0.0
    if events.at_times:
        with text.when(is_at_stop.any()):
            _act_at_times(code)
    again = Carried(more=0.0, limit=inf, hop=inf)
    if events.surface_count:
        _act_at_surfaces(code, is_there, is_there & ~is_at_stop, again)
    _go_on(code, is_at_stop, again)


def act(code):
    """Call `change` if in some lane the step is taken and events may act at its end."""
    is_there = _is_there(code)
    if code.integrator.events.surface_count:  # a state that stays on a surface may leave it
        is_there = is_there | (code.line.resting[0] * code.work.accepted[0] > 0.0)
    with code.text.when(is_there.any(), likely=False):
        code.text.invoke(f"{code.name}_change", code.arguments)


def find_sides(code, begins):
    """Add code that finds on which side of each surface trajectories begin, in lanes `begins`."""
    if not code.integrator.events.surface_count:
        return
    side, resting = code.line.side, Carried(resting=0.0)
    _look_at_end(code)
    _look_a_moment_later(code)
    for k in code.text.each(code.integrator.events.surface_count, resting):
        numbers = _at_surface(code.work.toward, k)
        numbers["holds"] = code.text.constants([*map(float, code.integrator.events.holds)])[k]
        start = code.apply(SIDE_AT_START, near=0.0, **numbers)
        start = _with_touching_side(code, k, start["side"], start["level"], 0.0, at_start=True)
        side.choose(begins, k * 2, start["side"])
        side.after(1).choose(begins, k * 2, start["level"])
        code.line.acted_at.choose(begins, k, -inf)
        code.line.crossed_at.choose(begins, k, -inf)
        resting.resting = resting.resting + start["side"].equals(STAYS).select(1.0, 0.0)
    code.line.resting.choose(begins, 0, resting.resting)


def _is_at_stop(code):
    """Return in which lanes the step has reached the next given time of an event."""
    return (code.work.accepted[0] > 0.0) & (code.line.t[0] >= code.line.stop[0])


def _is_running(code):
    """Return in which lanes no event has ended the trajectory; after its end no event acts."""
    return ~code.line.state[0].equals(float(LaneState.STOPPED))


def _is_there(code):
    """Return in which lanes events may act: the step ends at a given time or on a surface."""
    is_at_stop = _is_at_stop(code)
    if not code.integrator.events.surface_count:
        return is_at_stop
    at_surface = code.work.at_surface[0] > 0.0
    return is_at_stop | ((code.work.accepted[0] > 0.0) & at_surface)


def _look(code, x, f, to):
    """Write s, ds/dt and the other numbers of each surface at the state x to `to`; f is f(x)."""
    pair, D = code.work.pair, code.f.of_x.D
    code.text.copy(x, pair, D)
    code.text.copy(f, pair.after(D), D)
    code.call("toward", pair, code.table, to)


def _look_at_end(code):
    """Write the `OF_SURFACE` numbers of each surface at the next state to the row `toward`."""
    _look(code, code.work.new, code.work.f_new, code.work.toward)


def _look_a_moment_later(code):
    """Write what `_look` finds at surfaces a moment after the step to `ahead`; return this time."""
    work = code.work
    moment = MOMENT * larger_of(work.taken[0], 1.0 / GROWTH_AFTER_SURFACE * code.line.wanted[0])
    signed = code.number("sign") * moment
    for i in code.text.each(code.D):
        work.start[i] = work.new[i] + signed * work.f_new[i]
    code.call("f", work.start, code.table, work.f_start)
    _look(code, work.start, work.f_start, work.ahead)
    return moment


def _at_surface(rows, k):
    """Return {name: number} for surface k, such as its value and rate, from results of `toward`."""
    names = "value", "rate", "size", "rate_size", "slopes"
    return {name: rows.after(n)[k * OF_SURFACE] for n, name in enumerate(names)}


def _act_at_times(code):
    """Add code that lets events act at their given times, in the order of the list."""
    text, events = code.text, code.integrator.events
    for now in text.rounds(Carried()):
        acts = _is_at_stop(code)
        for k in range(events.surface_count, events.count):
            if k == events.search:
                continue
            acting = acts & _is_running(code) & code.line.stop_which[0].equals(float(k))
            with text.when(acting.any()):
                _act(code, k, acting)
        _next_stop(code, acts.bits())
        now.goes_on = _is_at_stop(code).any()


def _most(events):
    """Return how many actions on surfaces the events of an `EventSet` may make at one instant."""
    return ACTIONS_AT_ONE_INSTANT + events.surface_count


def most_records(events, equal):
    """Return how many records a trajectory may add at one instant; `equal` given times coincide.

    Events on surfaces act in rounds until none acts. Events that only record may record in each.
    """
    recorders = sum(map(events.only_records, range(events.surface_count)))
    if recorders == events.surface_count:
        return equal + recorders
    rounds = int(_most(events))
    return equal + rounds * (1 + recorders) + events.surface_count


def _act_at_surfaces(code, is_there, by_motion, again):
    """Let events act on the surfaces that a state has crossed, until no event acts.

    In lanes `by_motion` the step led to the surfaces, elsewhere an action. `again` gets results of
    `AGAIN`.
    """
    text, work, events = code.text, code.work, code.integrator.events
    _look_at_end(code)
    for k in text.each(events.surface_count):
        work.fired[k] = work.rate_before[k] = 0.0
        work.near[k] = NEARLY * code.line.t[0] * abs(_at_surface(code.work.toward, k)["rate"])
    if events.count == 1:
        _cross(code, 0, is_there, by_motion)
    else:
        for now in text.rounds(Carried()):
            before = work.actions_now[0]
            few = is_there & (before < _most(events))
            for k in range(events.surface_count):
                _cross(code, k, few, by_motion & work.actions_now[0].equals(0.0))
            now.goes_on = (work.actions_now[0] > before).any()
    again.resting = 0.0
    moment = _look_a_moment_later(code)
    for k in text.each(events.surface_count, again):
        side, level, place, fired = code.line.side, code.line.side.after(1), k * 2, work.fired[k]
        found = _with_touching_side(code, k, side[place], level[place], fired)
        side[place], level[place] = found["side"], found["level"]
        stays = found["side"].equals(STAYS)
        numbers = _at_surface(work.toward, k)
        given = {"side": found["side"], "level": found["level"], "fired": fired}
        given["holds"] = text.constants([*map(float, events.holds)])[k]
        level[place] = code.apply(LEVEL_AFTER_ACTION, **numbers, **given)["level"]
        inputs = numbers | {"later": _at_surface(work.ahead, k)["rate"]}
        inputs["moment"] = moment
        inputs["rests"] = text.constants([*map(float, events.rests)])[k]
        so_far = {name: getattr(again, name) for name in ("more", "limit", "hop")}
        found = code.apply(AGAIN, k, **inputs, **so_far)
        for name in ("acted_at", "pause"):
            getattr(code.line, name)[k] = found.pop(name)
        again.update(found | {"resting": again.resting + stays.select(1.0, 0.0)})
    code.line.resting[0] = vars(again).pop("resting")


def _with_touching_side(code, k, side, level, fired, at_start=False):
    """Return `side` and `level` of the state at surface k, mended by `TOUCHING_SIDE`."""
    inputs, ahead = _at_surface(code.work.toward, k), _at_surface(code.work.ahead, k)
    events = code.integrator.events
    plain = [float(at_start and g in events.plain) for g in range(events.surface_count)]
    inputs |= {"side": side, "level": level, "fired": fired}
    inputs["at_start"] = code.text.constants(plain)[k]
    inputs |= {"later": ahead["rate"], "slopes_later": ahead["slopes"]}
    inputs["has_branches"] = code.text.constants([*map(float, events.flats)])[k]
    return code.apply(TOUCHING_SIDE, **inputs)


def _slopes_a_moment_later(code, k):
    _look_a_moment_later(code)
    return _at_surface(code.work.ahead, k)["slopes"]


def _cross(code, k, is_there, by_motion):
    """Let event k act, or record it, in lanes where the state crossed surface k as it asks."""
    text, work, line, integrator = code.text, code.work, code.line, code.integrator
    place, numbers, events = 2 * k, _at_surface(code.work.toward, k), integrator.events
    is_there = is_there & _is_running(code)
    given = {"by_motion": by_motion.select(1.0, 0.0), "is_here": is_there.select(1.0, 0.0)}
    given |= {"side": line.side[place], "level": line.side[place + 1]}
    given["holds"] = text.value(float(events.holds[k]))
    is_plain = k in events.plain
    is_flat = events.flats[k] and is_plain and not events.slides[k]
    given["may_be_flat"] = text.value(float(is_flat))
    given["slopes_later"] = text.value(1.0)
    if is_flat:
        on_0 = (is_there & numbers["value"].equals(0.0)).any()
        later = text.otherwise(~on_0, (1.0,), lambda: (_slopes_a_moment_later(code, k),))
        [given["slopes_later"]] = later
    given["may_have_poles"] = text.value(float(events.poles[k] and is_plain))
    given["s_start"] = work.points[integrator.surface_count - events.surface_count + k]
    crossing = code.apply(CROSSED, k, **numbers, **given)
    line.side.put_chosen(place, crossing["side"])
    line.side.put_chosen(place + 1, crossing["level"])
    line.crossed_at.put_chosen(k, crossing["crossed_at"])
    work.near.put_chosen(k, crossing["near"])
    up, direction = crossing["up"], events.directions[k]
    fires = up if direction > 0 else crossing["down"] if direction < 0 else up | crossing["down"]
    if events.only_records(k):
        _record_crossing(code, k, fires, by_motion)
        return
    with text.when(fires.any()):
        work.fired.choose(fires, k, up.select(1.0, -1.0))
        work.rate_before.choose(fires, k, numbers["rate"])
        work.actions_now[0] = work.actions_now[0] + fires.select(1.0, 0.0)
        _act(code, k, fires, by_motion)
        if events.components[k]:
            _look_at_end(code)
            after = _at_surface(code.work.toward, k)  # the state was on this surface
            after["near"] = crossing["near"] + LOW_AFTER_ACTION * after["size"]
            own = after["rate_size"]
            after["rate_size"] = own + abs(numbers["rate"])
            now = code.apply(SIDE, **after)
            if events.holds[k]:
                is_above = after["value"] > 0.0
                level = is_above.select(0.0, after["value"])
                terms = own if events.holds[k] < 2 else after["rate_size"]
                level = level - ROUNDING_OF_SURFACE * (after["size"] + terms * line.t[0])
                now = {"side": text.value(1.0), "level": level}
            line.side.choose(fires, place, now["side"])
            line.side.choose(fires, place + 1, now["level"])
            line.crossed_at.choose(fires & now["side"].equals(given["side"]), k, -inf)


def _record_crossing(code, k, counts, by_motion):
    """Record a crossing of surface k in lanes `counts`; enough of these end a trajectory."""
    line, work = code.line, code.work
    counts = counts & (line.t[0] > code.number("since"))
    with code.text.when(counts.any()):
        _take_columns(code, k, counts, by_motion, work.new, work.f_new)
        record(code, counts, k, work.new, work.f_new)
        line.recorded[0] = recorded = line.recorded[0] + counts.select(1.0, 0.0)
        line.tries[0] = line.tries[0] + counts.select(1.0, 0.0)
        line.state.choose(counts & (recorded >= code.number("enough")), 0, float(LaneState.STOPPED))


def _act(code, k, truth, by_motion=None):
    """Let event k act in lanes `truth`: change the state, count the action and record it.

    In lanes `by_motion` the step led to the surface. `by_motion` is None for events at given times.
    """
    text, line, work, integrator = code.text, code.line, code.work, code.integrator
    text.copy(work.new, work.before, code.D)
    text.copy(work.f_new, work.f_before, integrator.f.of_x.D)
    _set(code, k, truth, by_motion, work.before, work.f_before)
    if integrator.events.components[k] and integrator.events.modes:
        with text.when(is_marked(code).any(), likely=False):
            text.invoke(f"{code.name}_settle", code.arguments)
    line.action_counts[k] = counts = line.action_counts[k] + truth.select(1.0, 0.0)
    line.tries[0] = line.tries[0] + truth.select(1.0, 0.0)
    if integrator.events.most[k] < inf:
        is_over = truth & (counts >= float(integrator.events.most[k]))
        line.state.choose(is_over, 0, float(LaneState.STOPPED))
    record(code, truth, k, work.before, work.f_before)


def _set(code, k, truth, by_motion, before, f_before):
    """Set the components and columns that event k sets, and f, in lanes `truth`.

    `before` and `f_before` are a copy of the state, and of f. `by_motion` is that of `_act`.
    """
    text, line, work, integrator = code.text, code.line, code.work, code.integrator
    components = integrator.events.components[k]
    if components:
        code.call(f"to{k}", work.new, code.table, work.changed)
        places = text.constants(components)
        for n in text.each(len(components)):
            work.new.choose(truth, places[n], work.changed[n])
        for i in text.each(integrator.f.of_x.D):
            line.lost.choose(truth, i, code.apply(RAISED, i)["lost"])
        if integrator.f.hybrid.chooses:
            branch_choice.update_branches(code, truth)
        code.call("f", work.new, code.table, work.f_new)
    _take_columns(code, k, truth, by_motion, before, f_before)
    if components and integrator.f.columns:
        code.call("f", work.new, code.table, work.f_new)


def settle(code):
    """Find modes of surfaces that meet, in lanes with marks; the state is moved onto surfaces."""
    text, work = code.text, code.work
    text.copy(work.new, work.start, code.D)
    text.copy(work.f_new, work.f_start, code.f.of_x.D)
    truth = find_modes(code)
    _set(code, code.integrator.events.search, truth, None, work.start, work.f_start)


def _take_columns(code, k, truth, by_motion, before, f_before):
    """Find how much earlier event k comes along each column of derivatives, and change columns.

    This time is tau; `event_formulas` has the formulas of both.
    In lanes `by_motion` tau is computed; an event caused by an action has the tau of that action.
    """
    text, work, f, D = code.text, code.work, code.f, code.f.of_x.D
    for c in range(f.columns):
        q, column = c - (f.columns - f.q), D * (1 + c)
        end, parts = f"_{q}" if q >= 0 else "", (before, before.after(column), f_before, work.f_new)
        for n, part in enumerate(parts):
            text.copy(part, work.pair.after(n * D), D)
        if by_motion is not None:
            code.call(f"tau{k}{end}", work.pair, code.table, work.changed)
            work.tau.choose(truth & by_motion, c, work.changed[0])
        if code.integrator.events.components[k]:
            work.pair[4 * D] = work.tau[c]
            code.call(f"column{k}{end}", work.pair, code.table, work.changed)
            for i in text.each(D):
                work.new.after(column).choose(truth, i, work.changed[i])


def _next_stop(code, bits):
    """Add code that reads the next given time of an event, in lanes with bit 1 in `bits`."""
    text, loaded = code.text, code.loaded
    one = text.lanes(1)
    for offset in code.lanes_with(bits):
        lane = one.arrays(code.line.x.at() + offset, code.integrator.rows)
        trajectory = Integers(text, code.line.trajectory.at() + offset)[0]
        place_at = Integers(text, lane.stop_place.at())
        place = place_at[0] + 1
        place_at[0] = place
        own = loaded.event_times + trajectory * loaded.event_time_bytes
        numbers = Shared(one, own + place * 16)
        lane.stop[0], lane.stop_which[0] = numbers[0], numbers[1]


def _go_on(code, at_given_time, again):
    """Set the next length and state of lanes after actions; `again` has results of `AGAIN`."""
    line, work = code.line, code.work
    sums = sizes_of(code, work.new, work.f_new)
    before = sizes_of(code, line.largest, line.f_x)  # `line.f_x` is f where the step began
    endless = (work.actions_now[0] >= _most(code.integrator.events)).select(1.0, 0.0)
    is_changed = at_given_time | (work.actions_now[0] > 0.0)
    if code.f.hybrid.jumps:
        work.jumped.choose(is_changed & line.state[0].equals(code.mode), 0, 1.0)
    inputs = vars(sums) | vars(again) | {"endless": endless}
    inputs |= {"largest": before.size, "rate_before": before.rate}
    found = code.apply(LENGTH_AFTER_ACTIONS, **inputs) | code.apply(STATE_AFTER_ACTIONS, **inputs)
    found |= {"longer": FACTOR_AT_FIRST, "stiff": 0.0, "easy": 0.0}
    code.keep(line, found, is_changed)
    keep_levels(code, is_changed, work.new)
