"""The second trial of a step whose error may be due to rounding of the state.

Rounding of the state changes f. The effect is large if components cancel, or if f is steep in time
or begins at 0. So a step that would be rejected has a second trial. The trial allows an error of
|h (f(x') - f(x))|, where x is an end of the step and x' a state beside it. Of both ends, the one
with the smaller change counts. In an implicit step A**-1 (`linearly_implicit`) multiplies the
allowed error, because fast modes forget it. In x' clocks are later by 2**-50 of their values and
starts, and other components differ by about 2**-49 of their values. A trial takes time, so only
steps after a rejected step or another trial have one.

If terms of the rate of a component cancel, the component may be 0 up to rounding. Then no step has
digits of it, and shorter steps would not help. So an error below NOISE_OF_STEP times the largest
component may be as large as such changes of f at the points ALONG the step, and does not shorten
the next step. If such errors would shorten steps that are accepted, every eighth step has the
trial, too.
"""

from math import inf
from typing import Any, NamedTuple

from ..expressions.values import larger, smaller
from ..llvm.text import Carried, Shared
from .allowed_errors import LARGE
from .codegen import larger_of
from .scalar_kernels import scalar_kernel
from .tolerances import (
    BESIDE_SIZE,
    FACTOR_AFTER_TRIAL,
    MOST_APART,
    NOISE_OF_STEP,
    NOISE_OF_TRIAL,
    ROUNDING_OF_CLOCKS,
    SHORTENS,
    STEP_OF_ROUNDING,
)

# f is evaluated beside points x + ALONG (x_next - x) of a step. Each of the BESIDES, multiplied by
# `ComponentNumbers.seeds`, gives a direction: several, because changes of f in one may cancel by
# chance, as for a symmetric state. In every other one the state is also MOVED by h times the last
# change of f: so the noise of a force reaches positions. ENDS is 1 at the ends of the step, which
# come first: if the error cannot be noise, the ends and the first direction suffice.
BESIDES = 1e6, 1.3e6, 1.7e6, 1.9e6, 2.3e6, 2.9e6, 3.1e6, 3.7e6
MOVED = [0.0, 1.0] * 4
ALONG = 0.0, 1.0, 0.2, 0.4, 0.6, 0.8
ENDS = tuple(float(u in (0.0, 1.0)) for u in ALONG)


class Changes(NamedTuple):
    """Changes of f at points of the step: the smaller one of both ends, and the two largest."""

    least: Any
    largest: Any
    second: Any


class Maxima(NamedTuple):
    """Maxima over components, relative to allowed errors of the trial."""

    ratio: Any
    of_apart: Any
    of_length: Any


@scalar_kernel
def BESIDE(t, state, x, new, f_x, counts, seeds, multiple, is_end, move):
    """Return a component beside a `state` of the step, displaced by about its rounding.

    A clock, such as time, is moved to a later time, by about its rounding. Other components are
    displaced by BESIDE_SIZE times a part of their size, and then by `move`. The part, from -1/2 to
    1/2, is as good as random; `seeds` and `multiple` determine it. The size is |state| at the ends
    of the step. Between the ends, where the state may be 0, the size is the larger of both.
    """
    later = state + ROUNDING_OF_CLOCKS * larger(abs(state), t * abs(f_x))
    size = (is_end > 0.0).select(abs(state), larger(abs(x), abs(new)))
    place = multiple * seeds
    part = place - place.then("floor") - 0.5  # as good as a random number
    return {"beside": (counts > 0.0).select(state + BESIDE_SIZE * part * size + move, later)}


@scalar_kernel
def BESIDE_POINTS(most, changes: Changes, is_end):
    """Update three changes of f with `most`, the largest change of f at one more point of the step.

    A change is |f(x') - f(x)| for a state x' `BESIDE` the point x. `least` is the smaller change of
    the two ends of the step; `largest` and `second` are the two largest changes of all points.
    """
    return {
        "least": (is_end > 0.0).select(smaller(most, changes.least), changes.least),
        "largest": larger(most, changes.largest),
        "second": larger(smaller(most, changes.largest), changes.second),
    }


@scalar_kernel
def SECOND(t, taken, error, apart, inverse, changes: Changes, top, grows, so_far: Maxima):
    """Return `error` and `apart` of a component relative to its allowed error in the trial.

    `ratio` and `of_apart` are maxima over components; `inverse` is 1 / allowed error. The allowed
    error is the largest of three: the one before the trial; `grows` h `least`; and NOISE_OF_TRIAL h
    `second`, but at most NOISE_OF_STEP `top`. h is the length `taken`, `top` the largest component.
    `least`, `largest` and `second` are changes of f, as in `BESIDE_POINTS`. If the step is hardly
    longer than the rounding of time, `largest` replaces `least`, because sub-steps contain little
    except rounding. `of_length`, the ratio for the next length, omits errors that are within an
    allowed error that the trial has raised, because these do not shrink with the step.
    """
    is_short = taken <= STEP_OF_ROUNDING * t
    at_ends = grows * (taken * is_short.select(changes.largest, changes.least))
    of_rounding = larger(
        smaller(NOISE_OF_TRIAL * (taken * changes.second), NOISE_OF_STEP * top), at_ends
    )
    own = (of_rounding < inf).select(smaller(1.0 / of_rounding, inverse), inverse)
    found = abs(error) * own
    counts = ((own < inverse) & (found <= 1.0)).select(0.0, found)
    return {
        "ratio": larger(found, so_far.ratio),
        "of_length": larger(counts, so_far.of_length),
        "of_apart": larger(is_short.select(0.0, abs(apart) * own), so_far.of_apart),
        "inverse": own,
    }


def try_again(code, sums):
    """Test again, with larger allowed errors, steps with errors that may be rounding.

    Return by name what replaces results of `find_errors` (`sums`).
    """
    text, line, work, integrator = code.text, code.line, code.work, code.integrator
    again = text.value(FACTOR_AFTER_TRIAL) >= line.longer[0]
    refused = (sums["ratio"] > 1.0) | (sums["apart"] > MOST_APART)
    is_finite = sums["total"] < inf
    refused = tried = refused & is_finite & again
    if not integrator.has_atol:
        # An accepted step may have a trial, too: every eighth step, and each step after a trial.
        eighth, ratio = line.steps[0] * 0.125, sums["ratio"]
        is_due = eighth.floor().equals(eighth) | line.longer[0].equals(FACTOR_AFTER_TRIAL)
        is_noisy = is_due & (ratio > SHORTENS) & (sums["large"] < ratio)
        tried = refused | is_noisy & is_finite
    names = "ratio", "of_length", "apart", "on_trial", "rates"
    before = {name: sums[name] for name in names if name in sums}

    def trial():
        apart = integrator.rule.begin_trial(code)
        top = Carried(top=0.0)  # the largest |x_i| so far, without clocks
        for i in text.each(code.D, top):
            size = larger_of(larger_of(abs(line.x[i]), line.largest[i]), top.top)
            top.top = (code.component("counts", i) > 0.0).select(size, top.top)
        others = Carried(large=0.0)
        for i in text.each(code.D, others):
            noisy = NOISE_OF_STEP * top.top
            others.large = code.apply(LARGE, i, large=others.large, noisy=noisy)["large"]
        least, largest, second = _changes_beside(code, tried & (others.large < sums["ratio"]))
        found = Carried(ratio=0.0, of_length=0.0, of_apart=0.0)
        for i in text.each(code.D, found):
            inputs = {"least": least[i], "largest": largest[i], "second": second[i]}
            inputs |= {"apart": apart(i), "top": top.top, "grows": integrator.rule.grows}
            now = code.apply(SECOND, i, **inputs, **vars(found))
            work.inverse.choose(tried, i, now.pop("inverse"))
            found.update(now)
        # Where the trial counts, `rates`, which show |mu|, are rounding: 0 does not count as stiff.
        counts = refused | tried & (found.of_length < sums["ratio"])
        after = {"ratio": found.ratio, "of_length": found.of_length, "apart": found.of_apart}
        after |= {"on_trial": 1.0, "rates": 0.0}
        return [counts.select(after[name], value) for name, value in before.items()]

    return dict(zip(before, text.otherwise(~tried.any(), before.values(), trial), strict=True))


def _changes_beside(code, is_noise):
    """Return the least, largest and second largest changes of f beside points of a step, as rows.

    Lanes `is_noise`, with an error that may be noise, evaluate all points in all directions. Other
    lanes evaluate one state beside each end of the step.
    """
    text, line, work, rule = code.text, code.line, code.work, code.integrator.rule
    change = rule.row_of_change(code)
    multiples, moved = map(text.constants, (BESIDES, MOVED))
    along, ends = map(text.constants, (ALONG, ENDS))
    base, state, most, *found = (work.beside.after(k * code.extended) for k in range(6))
    least, largest, second = found
    offsets, f = code.f.hybrid.offsets, code.f.of_x
    table = text.array(code.table) if code.for_each else Shared(text, code.table)
    starts = {clock: abs(table[f.places[number]]) for clock, number in offsets.items()}
    for i in text.each(code.D):
        least[i], largest[i], second[i] = inf, 0.0, 0.0
    points = is_noise.any().select(text.value(len(ALONG)), text.value(2))
    samples = is_noise.any().select(text.value(len(BESIDES)), text.value(1))
    for point in text.each(points):
        for i in text.each(code.D):
            state.put_chosen(i, line.x[i] + along[point] * (work.new[i] - line.x[i]))
            most[i] = 0.0
        code.call("f", state, code.table, base)
        for k in text.each(samples):
            counts = is_noise | (k.equals(0).select(ends[point], 0.0) > 0.0)
            for i in text.each(code.D):
                move = (moved[k] > 0.0).select(work.signed[0] * change[i], 0.0)
                inputs = {"state": state[i], "multiple": multiples[k], "is_end": ends[point]}
                beside = code.apply(BESIDE, i, move=move, **inputs)["beside"]
                work.start.put_chosen(i, beside)
            for clock, start in starts.items():  # f reads the clock plus its start value
                work.start[clock] = work.start[clock] + ROUNDING_OF_CLOCKS * start
            code.call("f", work.start, code.table, work.f_start)
            for i in text.each(code.D):
                change.put_chosen(i, work.f_start[i] - base[i])
            rule.propagate(code)
            for i in text.each(code.D):
                most.put_chosen(i, larger_of(abs(counts.select(change[i], 0.0)), most[i]))
        for i in text.each(code.D):
            of_point = {"most": most[i], "least": least[i], "largest": largest[i]}
            of_point |= {"second": second[i], "is_end": ends[point]}
            now = text.apply(BESIDE_POINTS, **of_point)
            for array, name in zip(found, ("least", "largest", "second"), strict=True):
                array.put_chosen(i, now[name])
    return found
