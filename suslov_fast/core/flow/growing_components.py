"""The alarm: a component has become small, has lost its digits, and grows again by itself.

Without `atol` a step may have errors that are large beside a small component. These do no harm if
the component decays for good, or if other components feed it, that is, make most of its rate. If
the component grows by itself, its errors grow with it. Then the trajectory is computed again, with
relative digits of this component (`lost` is RELATIVE) and a closer rtol.

`lost` is the relative error that a component carries: the sum of |error / component| over steps in
which the component is small and the error is above `some_of`. Most steps only compare two products
(`alert`); a function of its own (`find_alarms`) updates `lost`. It becomes 0 if the component is
large and its error is not, or if components with digits feed it: |g_i| > |f_i| / 2, where g is f
with 0 for all components without digits. At an unstable equilibrium `lost` stays. The alarm comes

- if the component grows, and its error is `many` allowed errors, or WITHOUT_DIGITS of its size;
- if components below their allowed errors are about to grow. Implicit steps damp exp(a t) to
  (1 - a h / n)**-n, which is no growth if a h is large, and explicit steps multiply by a polynomial
  in a h. To find growth, f is evaluated where these components have trial values u_i, at first
  their allowed errors. A component grows if h (f_i - g_i) > GROWTH_OF_IMPLICIT u_i (explicit steps:
  GROWTH_OF_EXPLICIT u_i). If some grow, u_i of the others is reduced, and f is evaluated again,
  until all grow or none does;
- if the surface of an event hangs on components whose errors are `many` allowed errors: with 0 in
  their places s changes by more than half of itself. Their errors would move the event;
- if the solution ends while a component has no digits.

If all components are RELATIVE, only those below 2**-990 lose digits. Then the alarm is a warning.
"""

import functools
from math import inf
from typing import Any, NamedTuple

import numpy as np

from ..expressions.values import larger
from ..llvm.text import Carried
from .memory import LaneState
from .scalar_kernels import scalar_kernel
from .tolerances import (
    ALARMING,
    COSTS_DIGITS,
    COSTS_IN_IMPLICIT,
    GROWTH_OF_EXPLICIT,
    GROWTH_OF_IMPLICIT,
    LESS_OF_TRIAL,
    LITTLE_LESS_OF_TRIAL,
    LOOKED_AT,
    LOOSE_SIGN,
    ROUNDS_OF_TRIAL,
    SMALL_COMPONENT,
    UNDERFLOW,
    WITHOUT_DIGITS,
    WITHOUT_DIGITS_OF_RTOL,
)

RELATIVE = -1.0  # a mark in the row `lost`: the allowed error is relative to the component's value


class Try(NamedTuple):
    """A computation after an alarm, with `batch_solver.closer` settings."""

    of_all: bool  # allowed errors of all components are RELATIVE, else of those that alarms marked
    acts: bool  # another alarm ends it, and leads to the next try

    def marks(self, lost):
        """Return the row `lost` at its start, from `lost` at the alarm."""
        return np.where((lost < 0.0) | self.of_all, RELATIVE, 0.0)


# After an alarm `flow`, exponents and compiled loops compute a trajectory again, and after each
# other alarm by the next try. If a solution then ends sooner than before, the result of `flow` and
# of loops is a last computation, in which no component is RELATIVE and no alarm ends it.
TRIES = Try(False, True), Try(False, True), Try(True, False)


class Component(NamedTuple):
    """A component of a step from x to the state `new`."""

    x: Any
    new: Any
    f_new: Any
    error: Any
    inverse: Any  # 1 / allowed error
    lost: Any  # relative error that it carries, or the mark RELATIVE
    keeps: Any  # 1 if it keeps its sign, else 0


class Alerts(NamedTuple):
    """Maxima over components."""

    most_lost: Any
    near: Any
    doubts: Any


def many_of(rtol):
    """Return how many allowed errors are alarming."""
    return ALARMING * rtol ** (-1 / 3)


def some_of(rtol, keeps):
    """Return the least relative error in an explicit step with which a component loses digits.

    If the component keeps its sign (`keeps` is 1), this is 1e-4 rtol**(1/3), or rtol if that is
    larger. Otherwise it is 1 / COSTS_IN_IMPLICIT = 8 times as large. Implicit steps use an eighth
    of it.
    """
    least = rtol * max(COSTS_DIGITS * many_of(rtol) ** 2, 1.0)
    return least if keeps else least / COSTS_IN_IMPLICIT


def _loses(x, new, error, some, lost):
    return (abs(error) > some * (abs(x) + abs(new))) & (lost < 1.0)


def _rate(new, f_new, signed):
    """Return by how much |new| would grow in a step of the length `signed`."""
    return (new < 0.0).select(-1.0 * f_new, f_new) * signed


def _power(a, n):
    """Return a**n."""
    power = a * a * (a * a) if n > 3 else a
    for _ in range(n - 4 if n > 3 else n - 1):
        power = power * a
    return power


def _begins_to_grow(x, new, f_new, signed, lost):
    return (lost > 0.0) & ((abs(new) >= abs(x)) | (_rate(new, f_new, signed) > 0.0))


def alert(code, i):
    """Return where component i may lose digits or, in implicit steps, grow without digits."""
    line, work = code.line, code.work
    x, new, error, lost = line.x[i], work.new[i], work.error[i], line.lost[i]
    own = _loses(x, new, error, _some(code, i), lost)
    if code.integrator.rule.damps:  # the next, longer step may damp the growth
        own = own | _begins_to_grow(x, new, work.f_new[i], work.signed[0], lost)
    return own


def _some(code, i):
    some = code.component("some", i)
    return COSTS_IN_IMPLICIT * some if code.integrator.rule.damps else some


def _lost(
    component: Component, signed, rtol, some, many, acts, damps, reads, alerts: Alerts, *, loses
):
    """Return the new `lost` of a component, max `lost`, and `near`, 1 if there may be an alarm.

    `doubts` becomes 1 if surfaces of events read the component (`reads`), and its errors are many.

    `lost` increases by the relative error of the step. If the component keeps its sign, `lost` also
    increases by the error that extrapolation has if the component grows fast in the step. A `lost`
    of 1 means that no digit is right. It replaces every `lost` above a bound: the larger of
    WITHOUT_DIGITS and 100 rtol, or 1 for components that may change their sign.
    """
    x, new, error, lost = component.x, component.new, component.error, component.lost
    both, size = abs(x) + abs(new), abs(new) * component.inverse
    is_small = both * component.inverse * rtol < SMALL_COMPONENT
    rate, has_sign = _rate(new, component.f_new, signed), component.keeps > 0.0
    part = 1.0 / has_sign.select(abs(new), LOOSE_SIGN * both)  # a division takes long
    base, power = loses
    growth = larger(component.keeps * (rate * part), 0.0) * (1.0 / base)
    root = _power(growth, power // 2)
    own = larger(lost, 0.0) + abs(error) * part + root * root
    most = has_sign.select(larger(WITHOUT_DIGITS, WITHOUT_DIGITS_OF_RTOL * rtol), 1.0)
    own = (own > most).select(1.0, own)
    counts = is_small & ((acts > 0.0) | (abs(new) < UNDERFLOW))
    lost = (counts & _loses(x, new, error, some, lost)).select(own, lost)
    is_many = lost * size > LOOKED_AT * many
    lost = ((lost > 0.0) & ~(is_small | is_many)).select(0.0, lost)
    is_fast = (size < 1.0) & (rate > GROWTH_OF_EXPLICIT * abs(new))
    grows = is_fast | is_many | ((size > 1.0) & (lost > WITHOUT_DIGITS))
    grows = grows & (abs(new) >= abs(x)) & (lost > LOOKED_AT * many * rtol)
    begins = _begins_to_grow(x, new, component.f_new, signed, lost)
    is_near = grows | ((damps > 0.0) & begins)
    return {
        "most_lost": larger(lost, alerts.most_lost),
        "near": is_near.select(1.0, alerts.near),
        "doubts": ((reads > 0.0) & (lost > many * rtol)).select(1.0, alerts.doubts),
        "lost": lost,
    }


@functools.cache
def lost_of(loses):
    """Return the scalar kernel `_lost` for steps that lose growth as `Rule.loses` tells."""
    return scalar_kernel(functools.partial(_lost, loses=loses))


@scalar_kernel
def FED(new, f_new, fed, signed, lost, changes, left):
    """Set `lost` of a component to 0, and `changes` to 1, if components with `lost` <= 0 feed it.

    `fed` is the rate of the component with 0 in place of all components with `lost` > 0. `left`
    becomes the largest `lost` that remains.
    """
    stays = _rate(new, f_new - fed, signed) > GROWTH_OF_IMPLICIT * abs(new)
    stays = stays & (abs(f_new) < abs(fed))  # true at an unstable equilibrium
    is_fed = (abs(fed) > 0.5 * abs(f_new)) & (abs(fed) < inf) & (lost > 0.0) & ~stays
    lost = is_fed.select(0.0, lost)
    return {"lost": lost, "changes": is_fed.select(1.0, changes), "left": larger(lost, left)}


@scalar_kernel
def ALARMS(component: Component, fed, signed, rtol, many, most_lost, grows, below):
    """Return `lost` and its maximum `most_lost`; for an alarm these are RELATIVE and infinity.

    `grows` and `below` are about components that are smaller than their allowed errors: `grows`
    becomes 1 if such a component has lost digits and grows by itself by more than
    exp(GROWTH_OF_EXPLICIT) in this step, and `below` is the largest `lost` of such components.
    `fed` is as in `FED`.
    """
    x, new, lost = component.x, component.new, component.lost
    size, signed = abs(new) * component.inverse, (new < 0.0).select(-signed, signed)
    is_deep = (size > 1.0) & (lost > larger(WITHOUT_DIGITS, WITHOUT_DIGITS_OF_RTOL * rtol))
    # Steps of a decay may rise by chance.
    is_deep = is_deep & (component.keeps * signed * component.f_new > 0.0)
    is_grown = (abs(new) >= abs(x)) & ((lost * size > many) | is_deep)
    own_growth = signed * (component.f_new - fed)
    is_fast = (lost > 0.0) & (size < 1.0) & (own_growth > GROWTH_OF_EXPLICIT * abs(new))
    return {
        "lost": is_grown.select(RELATIVE, lost),
        "most_lost": is_grown.select(inf, larger(lost, most_lost)),
        "grows": is_fast.select(1.0, grows),
        "below": (size < 1.0).select(larger(lost, below), below),
    }


@scalar_kernel
def GROWS(value, f, fed, signed, least, part, grow, fall):
    """Return the trial `value` of a component if it grows, else `part` of it; count both cases.

    Components with trial values are a group. A component grows if the group adds more than `least`
    times `value` to it in the step. f is the rate of the component with the trial values, and `fed`
    its rate with 0 in place of them.
    """
    is_in, grows = value > 0.0, signed * (f - fed) > least * value
    return {
        "value": grows.select(value, part * value),
        "grow": grow + (is_in & grows).select(1.0, 0.0),
        "fall": fall + (is_in & ~grows).select(1.0, 0.0),
    }


@scalar_kernel
def RAISED(before, new, some, lost):
    """Return `lost` after an event has moved a component from `before` to `new`."""
    now = (abs(new) > abs(before)).select(lost * abs(before / new), lost)
    return {"lost": (lost > 0.0).select((now > some).select(now, 0.0), lost)}


def find_alarms(code):
    """Update `lost` in lanes where the row `alerts` is 1, and find alarms."""
    text, line, work = code.text, code.line, code.work
    found = Carried(most_lost=0.0, near=0.0, doubts=0.0)
    of_events = code.integrator.read_by_events
    reads = text.constants([float(i in of_events) for i in range(code.f.of_x.D)])
    looks = work.alerts[0] > 0.0
    for i in text.each(code.f.of_x.D, found):
        some = _some(code, i)
        inputs = {"some": some, "damps": float(code.integrator.rule.damps), "reads": reads[i]}

        def update(i=i, inputs=inputs):
            own = code.apply(lost_of(code.integrator.rule.loses), i, **inputs, **vars(found))
            line.lost.choose(looks, i, own.pop("lost"))
            return list(own.values())

        x, new, error, lost = line.x[i], work.new[i], work.error[i], line.lost[i]
        concerns = (lost > 0.0) | _loses(x, new, error, some, lost)
        values = text.otherwise(~concerns.any(), [*vars(found).values()], update)
        found.most_lost, found.near, found.doubts = values
    line.most_lost.choose(looks, 0, found.most_lost)
    near, doubts = looks & (found.near > 0.0), looks & (found.doubts > 0.0)
    looks = near | doubts
    with text.when(looks.any(), likely=False):
        _look(code, looks)
        near = near & (line.most_lost[0] > 0.0)
        with text.when(near.any()):
            _alarm(code, near)
        if of_events:
            doubts = doubts & (line.most_lost[0] > 0.0)
            with text.when(doubts.any()):
                _doubt(code, doubts, reads)


def _doubt(code, looks, reads):
    """Raise the alarm in lanes `looks` where an event hangs on components without digits."""
    text, line, work, integrator = code.text, code.line, code.work, code.integrator
    least = code.number("many") * code.number("rtol")
    count, points = integrator.surface_count, work.points
    text.copy(work.new, work.start, code.D)
    for i in text.each(code.f.of_x.D):
        work.start[i] = (line.lost[i] > least).select(0.0, work.new[i])
    code.call("surfaces", work.new, code.table, points)
    code.call("surfaces", work.start, code.table, points.after(count))
    hangs = text.value(0.0) > 0.0
    for k in integrator.events.plain:
        k += count - integrator.event_surface_count
        s, other = points[k], points[count + k]
        hangs = hangs | ~(abs(other - s) <= 0.5 * abs(s))
    looks = looks & hangs
    for i in text.each(code.f.of_x.D):
        line.lost.choose(looks & (line.lost[i] > least) & (reads[i] > 0.0), i, RELATIVE)
    line.most_lost.choose(looks, 0, inf)


def watch_digits(code, alerts, on_trial):
    """Watch components after a step: in lanes `alerts`, and where some have lost digits.

    Explicit steps watch lost digits in every second step, and in the last step of a solution. Their
    `alerts` do not count in lanes `on_trial`: `second_trial` has allowed these errors as rounding.
    """
    line, work, text = code.line, code.work, code.text
    most_lost, accepted = line.most_lost[0] > 0.0, work.accepted[0] > 0.0
    with text.when(((alerts > 0.0) | most_lost).any(), likely=False):
        looks = alerts > 0.0
        if not code.integrator.rule.damps:
            half = line.steps[0] * 0.5
            is_due = half.floor().equals(half) | (line.state[0] >= float(LaneState.DONE))
            looks = (looks & (on_trial <= 0.0)) | (most_lost & is_due)
        looks = looks & accepted & (line.most_lost[0] < inf)
        work.alerts[0] = looks.select(1.0, 0.0)
        with text.when(looks.any()):
            text.invoke(f"{code.name}_small", code.arguments)


def _look(code, looks):
    """Find which components others feed (`FED`), in lanes `looks`."""
    text, line, work, D = code.text, code.line, code.work, code.f.of_x.D
    text.copy(work.new, work.start, code.D)
    for now in text.rounds(Carried()):
        for i in text.each(D):
            new = work.new[i]
            work.start[i] = (line.lost[i] > 0.0).select(0.0, new)
        code.call("f", work.start, code.table, work.f_start)
        found = Carried(changes=0.0, left=0.0)
        for i in text.each(D, found):
            own = code.apply(FED, i, fed=work.f_start[i], **vars(found))
            line.lost.choose(looks, i, own.pop("lost"))
            found.update(own)
        line.most_lost.choose(looks, 0, found.left)
        now.goes_on = (looks & (found.changes > 0.0) & (found.left > 0.0)).any()


def _alarm(code, looks):
    """Raise the alarm in lanes `looks` that need it; row `f` is f with 0 for lost components."""
    text, line, work, D = code.text, code.line, code.work, code.f.of_x.D
    found = Carried(most_lost=0.0, grows=0.0, below=0.0)
    for i in text.each(D, found):
        own = code.apply(ALARMS, i, fed=work.f_start[i], **vars(found))
        line.lost.choose(looks, i, own.pop("lost"))
        found.update(own)
    line.most_lost.choose(looks, 0, found.most_lost)
    least = code.number("many") * code.number("rtol")
    if code.integrator.rule.damps:
        waits = (found.most_lost > least) | (found.below > LOOKED_AT * least)
    else:
        waits = (found.most_lost > least) & (found.grows > 0.0)
    waits = looks & waits & (found.most_lost < inf)
    with text.when(waits.any(), likely=False):
        _find_group(code, waits)


def _find_group(code, looks):
    """Raise the alarm in lanes `looks` with a group of components that would grow together."""
    text, line, work, D = code.text, code.line, code.work, code.f.of_x.D
    known, group = work.start, work.a
    least = text.value(GROWTH_OF_IMPLICIT if code.integrator.rule.damps else GROWTH_OF_EXPLICIT)
    for i in text.each(D):
        is_in = looks & (line.lost[i] > 0.0)
        group[i] = is_in.select(1.0 / work.inverse[i], 0.0)
    found = Carried(grow=0.0, rounds=0.0, differs=1.0)
    for now in text.rounds(found):
        sums = Carried(grow=0.0, fall=0.0)
        part = (now.rounds < 0.5 * ROUNDS_OF_TRIAL).select(LESS_OF_TRIAL, LITTLE_LESS_OF_TRIAL)
        text.copy(work.new, work.b, code.D)
        for i in text.each(D):
            work.b[i] = known[i] + group[i]
        code.call("f", work.b, code.table, work.f_last)
        for i in text.each(D, sums):
            inputs = {"value": group[i], "f": work.f_last[i], "fed": work.f_start[i]}
            inputs |= {"least": least, "part": part}
            own = code.apply(GROWS, i, **inputs, **vars(sums))
            group.choose(now.differs > 0.0, i, own["value"])  # other lanes are done
            sums.grow, sums.fall = own["grow"], own["fall"]
        differs = (now.differs > 0.0) & (sums.grow > 0.0) & (sums.fall > 0.0)
        grow = (sums.fall > 0.0).select(0.0, sums.grow)
        now.grow = (now.differs > 0.0).select(grow, now.grow)
        now.differs, now.rounds = differs.select(1.0, 0.0), now.rounds + 1.0
        now.goes_on = (differs & (now.rounds < ROUNDS_OF_TRIAL)).any()
    sounds = looks & (found.grow > 0.0)
    line.most_lost.choose(sounds, 0, inf)
    for i in text.each(D):
        line.lost.choose(sounds & (group[i] > 0.0), i, RELATIVE)


def sound(code):
    """End the trajectories of lanes that have an alarm."""
    line, acts = code.line, code.number("acts") > 0.0
    most_lost = line.most_lost[0] > 0.0
    with code.text.when(most_lost.any(), likely=False):
        ends = line.state[0].equals(float(LaneState.ENDED)) | line.most_lost[0].equals(inf)
        line.state.choose(acts & most_lost & ends, 0, float(LaneState.AGAIN))
