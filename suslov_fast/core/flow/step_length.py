"""The length of the next step, and which integrator takes it.

The next length is this length times SAFETY ratio**(-1 / power), within 5 to 9 percent, by the bits
of the ratio. The estimate of an explicit step is one order lower, so `Rule.power` is order - 1. A
rejected step is repeated with the next length, and the step after that is not longer. If f has a
layer thinner than the sub-steps, all columns may agree on a wrong end; then the step is false. A
sum shows this (`step`).

In close passages the error that a length has grows from step to step by more than SAFETY allows. So
explicit steps predict: with `best`, this length times ratio**(-1 / power), of this and of the last
step, the next length is also multiplied by STEADY_TREND best / best_of_last if that is less than 1.
The first length is a part of the shorter of two times, |x| / |f| and |f| / |f' f|.

If the next step would pass one requested time, a step from the same state ends there first. It is
called a step aside: its end is tested and saved, but the trajectory stays. Each time in an implicit
step has a step aside; a polynomial gives several times in an explicit step (`dense_output`).

The explicit integrator is stable if h |mu| < 6 for eigenvalues mu of f' with negative real parts.
The difference quotient of f between the next state and the end of the last column shows the largest
|mu| at no cost. After `patience` steps with h |mu| above `limit` a lane becomes implicit. A step
with a false end counts as COUNT_OF_FALSE such steps, because the shorter next step looks less
stiff. In implicit steps power iteration on f' finds |mu|. A lane is explicit again after EASY_STEPS
steps with h |mu| < EASY_LIMIT limit.
"""

import functools
from math import inf, sqrt
from typing import Any, NamedTuple

from ..expressions.elementary import from_bits
from ..expressions.tolerances import TINY
from ..expressions.values import larger, smaller
from ..llvm.text import Carried
from .codegen import larger_of
from .memory import LaneState
from .scalar_kernels import scalar_kernel
from .tolerances import (
    APART_OF_BOUNCE,
    COUNT_OF_BOUNCE,
    COUNT_OF_FALSE,
    EASY_IN_TRIAL,
    EASY_LIMIT,
    EASY_STEPS,
    FACTOR_AFTER_REFUSED,
    FACTOR_AFTER_TRIAL,
    FACTOR_AT_FIRST,
    FACTOR_OF_FALSE,
    FACTOR_OF_NAN,
    FACTOR_OF_REFUSED,
    FIRST_AT_REST,
    FIRST_CHANGE,
    FIRST_OF_TIME,
    LEAST_ADVANCE,
    LEAST_FACTOR,
    LEAST_LIMIT,
    LEAST_PREDICTED,
    LIMIT_OF_ROOT,
    MORE_PATIENCE,
    MOST_APART,
    MOST_FACTOR,
    MOST_LIMIT,
    MOST_STIFF_STEPS,
    PROBE_OF_BEND,
    REACH_OF_STEP,
    SAFETY,
    SHORTEST_STEP,
    STEADY_TREND,
    STEPS_TO_FORGET,
    STIFF_STEPS,
    TRIAL_STEPS,
)


class Lane(NamedTuple):
    """Rows of a lane that each step changes."""

    t: Any  # modulus of the time
    wanted: Any  # length of the next step
    longer: Any  # largest factor to the length after it
    state: Any  # a `LaneState`


class Errors(NamedTuple):
    """Errors of a step, relative to allowed errors."""

    ratio: Any  # the largest error
    total: Any  # a sum that is finite if all errors and rates are
    kept: Any  # 0 if a sign or constraints are lost, else 1
    apart: Any  # the largest sum that shows false ends
    on_trial: Any  # 1 after a second trial, else 0
    of_length: Any  # the ratio that gives the next length


class Differences(NamedTuple):
    """Sums of `allowed_errors.DIFFERENCES`, which show (h |mu|)**2 = rates / states."""

    rates: Any
    states: Any


class Turning(NamedTuple):
    """Rows of a lane that decide about the change of the integrator."""

    stiff: Any  # steps of an explicit lane that look stiff
    easy: Any  # steps in a row that do not look stiff; if implicit: that could be explicit
    patience: Any  # number of stiff steps after which a lane becomes implicit
    trial: Any  # steps that are left of the trial of implicit steps


class Bounds(NamedTuple):
    """Bounds of steps, and of what looks stiff."""

    shortest: Any  # the shortest step, as a part of the time
    limit: Any  # h |mu| above which a step looks stiff
    switches: Any  # 1 if lanes may change to the other integrator, else 0


def first_part(rtol, order):
    """Return the relative change of x in the first step: 5 rtol**(1/8) for order 10; at most 1."""
    return min(FIRST_CHANGE * _root(rtol, order), 1.0)


def limit_of(rtol, order):
    """Return the h |mu| above which a step of length h looks stiff; mu are eigenvalues of f'."""
    return min(max(LIMIT_OF_ROOT * _root(rtol, order), LEAST_LIMIT), MOST_LIMIT)


def _halvings(order):
    """Return pairs (k, sign); the sum of sign / 2**k is 1 / order, rounded to 64ths."""
    left, k, found = round(64 / order), 6, []
    while left:
        if left % 2:
            sign = 2 - left % 4
            left -= sign
            found.append((k, sign))
        left, k = left // 2, k - 1
    return found


def _root(a, order):
    """Return a**(1 / (order - 2)), the exponent rounded to a multiple of 1/64."""
    result = 1.0
    for k, sign in _halvings(order - 2):
        root = a
        for _ in range(k):
            root = sqrt(root)
        result = result * root if sign > 0 else result / root
    return result


@scalar_kernel
def BEGIN_COMPONENT(x, f, counts, size, rate, total):
    """Update `size` = max |x| and `rate` = max |f|, without clocks; and `total` = sum |x| + |f|."""
    size, rate = larger(abs(x) * counts, size), larger(abs(f) * counts, rate)
    return {"size": size, "rate": rate, "total": total + abs(f) + abs(x)}


def sizes_of(code, x, f):
    """Return the sums of `BEGIN_COMPONENT` over all components of a state x with rates f."""
    sums = Carried(size=0.0, rate=0.0, total=0.0)
    for i in code.text.each(code.D, sums):
        sums.update(code.apply(BEGIN_COMPONENT, i, x=x[i], f=f[i], **vars(sums)))
    return sums


def first_length(size, rate, part, last):
    """Return `part` * `size` / `rate`, from max |x_i| and max |f_i|; part of `last` if x = 0."""
    guess = larger(size / rate, FIRST_OF_TIME * last)
    return part * (size > 0.0).select(guess, FIRST_AT_REST * last)


def bend_of(code, x, f, sums):
    """Return the largest change of f along f by PROBE_OF_BEND |x| / |f|, from `sizes_of` both."""
    text, work, found = code.text, code.work, Carried(bend=0.0)
    length = PROBE_OF_BEND * (sums.size / sums.rate) * code.number("sign")
    for i in text.each(code.D):
        work.start[i] = x[i] + length * f[i]
    code.call("f", work.start, code.table, work.f_start)
    for i in text.each(code.D, found):
        change = abs(work.f_start[i] - f[i]) * code.component("counts", i)
        found.bend = larger_of(change, found.bend)
    return found.bend


@scalar_kernel
def BEGIN(size, rate, total, bend, part, last, longest, first_next, second_next, first_state):
    """Return rows of a new trajectory: its first length, and NO_VALUE if x or f is not finite."""
    wanted = (rate > 0.0).select(first_length(size, rate, part, last), last)
    of_bend = part * (PROBE_OF_BEND * (size / bend))
    is_bent = (bend > 0.0) & (bend < inf) & (size > 0.0)
    wanted = is_bent.select(smaller(of_bend, wanted), wanted)
    has_value = total < inf
    return {
        "wanted": smaller(smaller(wanted, last), longest),
        "longer": FACTOR_AT_FIRST,
        "next": first_next,
        "second": second_next,
        "state": has_value.select(first_state, float(LaneState.NO_VALUE)),
        "patience": STIFF_STEPS,
    }


def limits_of(code):
    """Return REACH_OF_STEP, SHORTEST_STEP; 1 and 0 in a search for a surface, of any length."""
    reach, shortest = map(code.text.value, (REACH_OF_STEP, SHORTEST_STEP))
    if code.integrator.searches:
        is_near = code.line.outer[0] < inf
        reach, shortest = is_near.select(1.0, reach), is_near.select(0.0, shortest)
    return {"reach": reach, "shortest": shortest}


@scalar_kernel
def LENGTH(t, wanted, state, reach, mode, last, next, second, sign):
    """Return the length `taken` of the next step; it is 0 in lanes of the other integrator.

    A step that would pass the requested time `next`, but not `second`, is a step aside: it ends at
    `next`. `last` is `StepCode.goal`. If a lane is at this time, but an event has yet to act there,
    it takes one more step, of length TINY.
    """
    rest, to_next, to_second = larger(last - t, TINY), larger(next - t, TINY), second - t
    is_within = wanted < reach * rest

    def not_past(length):
        return (length > to_second).select(length, smaller(length, to_next))

    taken = is_within.select(not_past(wanted), not_past(rest))
    is_aside = taken < is_within.select(wanted, rest)
    taken = state.equals(mode).select(taken, 0.0)
    signed = taken.then("copysign", sign)
    return {"taken": taken, "signed": signed, "aside": is_aside.select(1.0, 0.0)}


def _factor(ratio, power):
    """Return ratio**(-1 / power), within 9 percent for factors of 0.2 to 4; 5.1 if power is 9.

    The bits of a number are nearly its logarithm; 0.05 makes the errors of both signs equal.
    """
    halvings = _halvings(power)
    exponent = sum(sign / 2**k for k, sign in halvings)
    bits = from_bits(round((1023 * (1 + exponent) - 0.05) * 2**52))
    for k, sign in halvings:
        part = ratio.then("bits_lshr", from_bits(k))
        bits = ratio._of("bits_sub" if sign > 0 else "bits_add", bits, part)
    return bits


def _is_false(ratio, apart):
    """Return whether columns agree (error `ratio` <= 1) on a false end, as large `apart` shows."""
    return (apart > MOST_APART) & (ratio <= 1.0)


def _after(
    lane: Lane, taken, aside, steps, tries, errors: Errors, reach, last, longest, best, *,
    power, predicts,
):  # fmt: skip
    """Decide whether a step is accepted, and whether a step aside is; return the rows after it."""
    is_finite = errors.total < inf
    is_active = taken > 0.0
    sees = is_finite & (errors.kept > 0.0)  # the error estimate is valid
    accepted = is_active & sees & (errors.apart <= MOST_APART) & (errors.ratio <= 1.0)
    # Operations that do not need the factor come first, because the others wait for the factor.
    of_refused = _is_false(errors.ratio, errors.apart).select(
        smaller(lane.longer, FACTOR_OF_FALSE), smaller(lane.longer, FACTOR_OF_REFUSED)
    )
    most = accepted.select(lane.longer, of_refused)
    factor = _factor(errors.of_length, power)
    of_best, factor = smaller(factor, MOST_FACTOR), SAFETY * factor
    if predicts:  # the quotient does not wait for the factor
        shrinks = larger(smaller(of_best * (STEADY_TREND * taken / best), 1.0), LEAST_PREDICTED)
        factor = factor * (accepted & (lane.longer < FACTOR_AT_FIRST)).select(shrinks, 1.0)
    factor = sees.select(larger(smaller(factor, most), LEAST_FACTOR), FACTOR_OF_NAN)
    served, moved = accepted & (aside > 0.0), accepted & (aside <= 0.0)
    changes = is_active & ~served
    reaches = (lane.wanted < reach * (last - lane.t)).select(lane.t + taken, last)
    after = moved.select(reaches, lane.t)
    longer_now = (errors.on_trial > 0.0).select(FACTOR_AFTER_TRIAL, MOST_FACTOR)
    after_this = accepted.select(longer_now, FACTOR_AFTER_REFUSED)
    return {
        "accepted": moved.select(1.0, 0.0),
        "served": served.select(1.0, 0.0),
        "t": after,
        "wanted": changes.select(smaller(factor * taken, longest), lane.wanted),
        "longer": changes.select(after_this, lane.longer),
        "best": moved.select(of_best * taken if predicts else 0.0, best),
        "state": (is_active & (after >= last)).select(float(LaneState.DONE), lane.state),
        "steps": steps + moved.select(1.0, 0.0),
        "tries": tries + is_active.select(1.0, 0.0),
    }


@functools.cache
def after(power, predicts):
    """Return the scalar kernel `_after` of steps with this `Rule.power` and `Rule.predicts`."""
    return scalar_kernel(functools.partial(_after, power=power, predicts=predicts))


def _ends(lane, taken, shortest):
    """Return which lanes run, and their state, which is ENDED if `wanted` is too short."""
    runs = (taken > 0.0) & (lane.state < LaneState.DONE)
    is_short = runs & (lane.wanted < larger(shortest * lane.t, TINY))
    return runs, is_short.select(float(LaneState.ENDED), lane.state)


def _is_stiff(differences, limit):
    """Return whether h |mu| > limit, as `Differences` show."""
    rates, states = differences
    return (rates > limit * limit * states) & (states > 0.0)


@scalar_kernel
def LOOKS(t, taken, wanted, differences: Differences, stiff, apart, shortest, limit):
    """Return True if `TURN_EXPLICIT` may change a lane: its step looks stiff, or it may end."""
    is_stiff = _is_stiff(differences, limit) | (stiff > 0.0) | (apart > APART_OF_BOUNCE)
    is_short = wanted < larger(shortest * t, TINY)
    return {"looks": (taken > 0.0) & (is_stiff | is_short)}


@scalar_kernel
def TURN_EXPLICIT(
    lane: Lane, taken, turning: Turning, accepted, differences: Differences, errors: Errors,
    bounds: Bounds,
):  # fmt: skip
    """Count steps that look stiff; after `patience` of them an explicit lane turns implicit.

    `easy` counts the accepted steps since the last stiff one. At STEPS_TO_FORGET of them the count
    `stiff` becomes 0. The lane ends if its next step would be too short (`_ends`).
    """
    _, state = _ends(lane, taken, bounds.shortest)
    is_stiff, accepted = _is_stiff(differences, bounds.limit), accepted > 0.0
    more = is_stiff.select(1.0, (errors.apart > APART_OF_BOUNCE).select(COUNT_OF_BOUNCE, 0.0))
    easy_now = (more > 0.0).select(0.0, (turning.stiff > 0.0).select(turning.easy + 1.0, 0.0))
    count = turning.stiff
    stiff_now = (more > 0.0).select(count + more, (easy_now < STEPS_TO_FORGET).select(count, 0.0))
    easy = accepted.select((stiff_now > 0.0).select(easy_now, 0.0), turning.easy)
    is_false = (taken > 0.0) & _is_false(errors.ratio, errors.apart)
    stiff = accepted.select(stiff_now, is_false.select(count + COUNT_OF_FALSE, count))
    turns = (stiff >= turning.patience) & (bounds.switches > 0.0) & (state < LaneState.IMPLICIT)
    return {
        "longer": turns.select(FACTOR_AT_FIRST, lane.longer),
        "state": turns.select(float(LaneState.IMPLICIT), state),
        "stiff": turns.select(0.0, stiff),
        "easy": turns.select(0.0, easy),
        "trial": turns.select(TRIAL_STEPS, turning.trial),
    }


@scalar_kernel
def TURN_IMPLICIT(lane: Lane, taken, turning: Turning, accepted, rate, bounds: Bounds):
    """Count easy steps in a row; after EASY_STEPS of them an implicit lane turns explicit.

    A step is easy if h |mu| < EASY_LIMIT limit, so that an explicit step could be as long. In the
    trial, the first TRIAL_STEPS steps, this bound is lower. A lane that turns explicit in its trial
    has more `patience` afterwards, so that it does not change back and forth.
    """
    runs, state = _ends(lane, taken, bounds.shortest)
    accepted = accepted > 0.0
    left = larger(turning.trial - 1.0, 0.0)
    is_trial = left > 0.0
    product = rate * lane.wanted
    is_easy = product < EASY_LIMIT * bounds.limit
    is_easy = is_easy & (product < is_trial.select(EASY_IN_TRIAL * bounds.limit, inf))
    easy_now = is_easy.select(turning.easy + 1.0, 0.0)
    patient = (is_easy | is_trial).select(turning.patience, STIFF_STEPS)
    easy = accepted.select(easy_now, turning.easy)
    patience = accepted.select(patient, turning.patience)
    turns = (
        (easy >= EASY_STEPS) & (bounds.switches > 0.0) & runs & accepted & (state < LaneState.DONE)
    )
    after_trial = is_trial.select(smaller(MORE_PATIENCE * patience, MOST_STIFF_STEPS), patience)
    explicit = smaller(lane.wanted, bounds.limit / larger(rate, TINY))
    return {
        "wanted": turns.select(explicit, lane.wanted),
        "state": turns.select(float(LaneState.EXPLICIT), state),
        "easy": turns.select(0.0, easy),
        "patience": turns.select(after_trial, patience),
        "trial": accepted.select(left, turning.trial),
    }


@scalar_kernel
def COUNT(t, state, tries, counted_from, last, most):
    """Return rows of a lane: after more than `most` tries it ends, unless it has moved on.

    It has moved on if the time is LEAST_ADVANCE times the last time later than at the last such
    test.
    """
    is_over = tries > most
    stands = is_over & (state < LaneState.DONE) & (t - counted_from < LEAST_ADVANCE * last)
    return {
        "state": stands.select(float(LaneState.TOO_MANY), state),
        "tries": is_over.select(0.0, tries),
        "counted_from": is_over.select(t, counted_from),
    }


def count(code):
    """End the trajectories that take too many tries without moving on (`COUNT`)."""
    is_over = code.line.tries[0] > code.number("most")
    with code.text.when(is_over.any(), likely=False):
        code.keep(code.line, code.apply(COUNT))


def choose_length(code):
    """Add code that writes the length of the next step in each lane, or 0, to the row `taken`."""
    # Without dense output a step aside ends at each requested time.
    second = code.line.second[0] if code.integrator.rule.interpolates else inf
    reach = limits_of(code)["reach"]
    found = code.apply(LENGTH, mode=code.mode, second=second, reach=reach, last=code.goal())
    code.keep(code.work, found)
