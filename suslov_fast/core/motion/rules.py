"""What decides on a step of the motion: allowed errors, lengths, and which half takes the next one.

A step has the estimated error e_i in component i. It is taken if

ratio = max_i e_i / allowed_i <= 1,

if f has a value at the next state, and if no component changes a sign that the motion keeps. By
default the allowed error is rtol max(s_i, 2**-60 max_j s_j), where s_i is the largest |x_i| so far:
a component that is reached through m others begins as t**m, and no step has relative digits of it
for m > 10. For columns of derivatives it is 2**-20. Clocks, which have constant rates, have no
error, and count there with their change in the step, because time may be large where all others are
small. With `atol` it is atol_i + rtol max(|x_i|, |x_next,i|), or what rounding leaves of the
weighted sum of columns, if that is more.

The state is rounded, and f with it, which shows where components cancel, where f is steep in time
or begins at 0. So a step that would be refused has a second trial, where |h (f(x') - f(x))| is
allowed, for states x' beside those at both ends of the step, whichever is less; in an implicit step
A**-1 of that, see `implicit`, because fast modes forget it. There clocks are 2**-50 of their values
later, and others differ by some 2**-49 of theirs. It takes time, and so it is for steps after one
that was refused, or that was taken by such a trial.

A component that is 0 but for rounding, because terms of its rate cancel, has nothing but that: no
step has digits of it, and shorter ones would not help. So an error below NOISY of the largest
component may be as large as such changes of f at the points ALONG the step, and does not shorten
the next step. Where such an error decides on a step that is taken, each eighth has the trial.

A component that has been large, falls below its allowed error in two steps in a row, and grows to
GROWN times that again, or a tenth of its size, may have no digits, and is told of (`LOW`).

The next length is 0.75 ratio**(-7/64) times this one, within 3.4 percent, by the bits of the ratio:
the estimate of an explicit step is of order 9. A step that is refused is taken again with it, and a
step after that is not longer.

All columns may agree on a false end, because f changes between their sub-steps within a layer that
is thinner than they are. Each half has sums over its columns that vanish on true steps, to the
order of the method, and stay on false ones (`columns`): a step is refused where these exceed
MOST_APART times what is allowed.

A time that was asked for, and that the next step would pass alone, is reached first by a step aside
from the same state: it is tested as every step, and its end is saved, but the trajectory stays. In
the implicit half each time is. Where an explicit step passes several, they lie on a polynomial.

The explicit half is stable where h |mu| < 6 for eigenvalues mu of f' on the left. The difference
quotient of f between the next state and the end of the last column shows the largest |mu| for
nothing. After `patience` steps with h |mu| above `limit` a lane becomes implicit, and false steps
count OF_FALSE of these, because the shorter step after them looks less stiff; it leaves this
half if h |mu| stays below twice the limit for EASY steps, with |mu| by the power iteration on f'.

Steps end on surfaces where f jumps or has a kink. Where one is crossed between POINTS of a step,
the step is taken again and again from the same state, with lengths between `inner`, at whose end
none is crossed, and `outer`. To the surface Newton's method leads, by values and rates at the ends
of these steps (`lists.aim`). Where it does not, the next length is where a straight line between
states at both sides crosses the surface. If it is always the same side that comes nearer, the other
one counts half, a quarter, ... (the rule of Illinois); after ROUNDS it is the middle. Once both
lengths differ by less than PLACE of the time, or a surface has been crossed for less, the step of
length `outer` is taken. Points inside an implicit step are rough, so there the first length is that
of the part. A motion that starts on a surface of a change, as a ball after a bounce,
comes back where a parabola does (`START`).

Each rule below is a list of operations on the numbers of one lane.
"""

import inspect
from math import inf, prod, sqrt
from typing import NamedTuple

from ..lists.functions import from_bits
from ..lists.hidden import POINTS
from ..lists.numbers import Number, larger, operand_of, smaller
from ..lists.step import Values
from .rows import State

# OF_CLOCK: a drive that begins at rest is noise at first, differences of numbers near 1.
SMALLEST, SMALLEST_OF_COLUMNS, OF_ROUNDING, OF_CLOCK = 2.0**-60, 2.0**-20, 2.0**-52, 2.0**-50
OF_SEED = 2.0**-41  # of `Component.seeds`, which are below 2**-10
# f is looked at beside these points of a step, by these parts of `OF_SEED`. There are many, because
# at one of them noise may be the same by chance. ENDS is 1 at the ends of the step, which come
# first, and FIRST at the first part: steps whose error cannot be noise look there alone.
BESIDES, ALONG = (4.0, -4.0, 3.0, -3.0, 2.0, -2.0, 1.0, -1.0), (0.0, 1.0, 0.2, 0.4, 0.6, 0.8)
ENDS = tuple(float(u in (0.0, 1.0)) for u in ALONG)
FIRST = 1.0, *[0.0] * (len(BESIDES) - 1)
# What a change of f beside the ends allows, and one beside all points: the weights of columns make
# noise of f larger, those of implicit columns sixteen times as much.
GROWS, OF_NOISE = {False: 0.25, True: 4.0}, 8.0
# An error may be noise if it is less than NOISY of the largest component. A ratio above SHORTENS
# makes the next step shorter.
NOISY, SHORTENS = 2.0**-48, 0.05
TINY_STEP = 2.0**-40  # part of the time
HIDDEN_FROM = 2.0**-20  # part of the time, below which no step hides crossings
GROWN, STAYS = 1000.0, 0.125
# OF_NAN has many digits: steps that met a time without a value of f should not meet it again.
AFTER_TRIAL = 3.875  # less than LONGER, so that it tells
SAFETY, SHORTER, LONGER, AT_FIRST, AFTER_REFUSED, OF_NAN = 0.75, 0.2, 4.0, 10.0, 1.0, 0.2371
# Less 7/64 of the bits of a number they are those of its root, the error in both directions.
_ROOT = from_bits(round((1023 * 71 / 64 - 0.05) * 2**52))
REFUSED = 0.9  # a refused step becomes shorter at least by this factor
REACH = 0.92  # a step reaches the end of time if its length is this part of what is left
SHORTEST, LEAST = 2.0**-44, 2.0**-1000  # of a step: part of the time, and length
SMALLEST_SCALE = 2.0**-60
PLACE, PLACE_AT_0 = 2.0**-51, 2.0**-90  # of a surface: part of the time, and of all the time
LEAST_PART, MOST_PART, MOST_WEIGHT = 2.0**-40, 1.0 - 2.0**-10, 2.0**60
ROUNDS = 14.0
ON = 2.0**-8  # part of its value at the end of a part, by which a start on a surface is beside it
# Largest sum that vanishes on true steps, beside the allowed error, and the next length after a
# step that it refuses. With 30 some true steps are refused, with 100 more false ones are taken.
MOST_APART, OF_APART = 50.0, 0.5
CAUTION = 4.0  # see `stormer`: factor of its estimate of the error
# See `stormer`: when a lane is rough, what a step takes away, the most, and a large error.
ROUGH, CALMER, MOST_ROUGH, FAR = 2.0, 0.25, 3.0, 100.0
TINY = 2.0**-1000  # in place of an allowed error of 0
FIRST_PART, FIRST_OF_TIME, FIRST_AT_REST = 5.0, 2.0**-40, 1e-6
MOST_STEPS = 250_000  # between two times that are asked for
# Steps that look stiff before a lane becomes implicit, those in between that make it forget them;
# implicit steps that are a trial, those that explicit ones would do as well, and the most patience.
PATIENCE, FORGET, TRIAL, EASY, MOST_PATIENCE = 5.0, 6.0, 8.0, 3.0, 100.0
# Steps that look stiff, for one that is false, and for one that is taken with a sum above BOUNCES:
# it may bounce between both sides of a layer, where f looks flat.
OF_FALSE, OF_BOUNCE, BOUNCES = 2.0, 0.25, 10.0


def first_part(rtol):
    """Return the part by which |x| changes in the first step."""
    return min(FIRST_PART * _root8(rtol), 1.0)


def limit_of(rtol):
    """Return the h |mu| above which a step looks stiff."""
    return min(max(17.0 * _root8(rtol), 1.4), 4.8)


def _root8(a):
    return sqrt(sqrt(sqrt(a)))


class Rule(NamedTuple):
    """A list of operations with names for its inputs, which are its first values, and results."""

    inputs: list
    operations: list
    results: dict


def _rule(function, *others):
    """Return the rule that a function of `Number` describes, with others of its inputs."""
    parameters = inspect.signature(function).parameters.values()
    inputs = [each.name for each in parameters if each.default is each.empty or each.name in others]
    values = Values(len(inputs), ())
    found = function(**{name: Number(values.emit, k) for k, name in enumerate(inputs)})
    results = {name: operand_of(a) for name, a in found.items()}
    return Rule(inputs, values.operations, results)


# ------------------------------------------------------------------------- sums over the components
@_rule
def BEGIN_COMPONENT(x, f, counts, size, rate, total):
    size, rate = larger(abs(x) * counts, size), larger(abs(f) * counts, rate)
    return {"size": size, "rate": rate, "total": total + abs(f) + abs(x)}


@_rule
def KEPT(x, new, keeps, kept, extra, rtol, size):
    """Whether all components have their sign that have one to keep; `new` gets it back.

    A component that has decayed below its tolerance may have any sign after a long step.
    """
    changes = ((x < 0.0) & (new > 0.0)) | ((x > 0.0) & (new < 0.0))
    changes = changes & (keeps > 0.0)
    is_large = abs(new) > extra + rtol * size
    return {"kept": (changes & is_large).select(0.0, kept), "new": changes.select(-new, new)}


@_rule
def CLOCK(x, new, f, signed, counts):
    """A component at the end of a step; of a clock x + h x', which columns round more often."""
    return {"new": (counts > 0.0).select(new, x + signed * f)}


@_rule
def SAME_SIGN(x, new, kept):
    """Whether a denominator that depends on clocks alone has kept its sign."""
    changes = ((x < 0.0) & (new > 0.0)) | ((x > 0.0) & (new < 0.0))
    return {"kept": changes.select(0.0, kept)}


@_rule
def NO_SIZE():
    """With `atol` no component depends on others."""
    return {}


@_rule
def LARGEST(new, largest, top):
    """The largest modulus of all components."""
    return {"top": larger(larger(abs(new), largest), top)}


@_rule
def LARGEST_WITH_CLOCKS(x, new, largest, counts, top, moved):
    """The same where a clock counts with its change in the step."""
    change = (counts > 0.0).select(0.0, abs(new - x))
    size = (counts > 0.0).select(larger(abs(new), largest), change)
    return {"top": larger(size, top), "moved": larger(change, moved)}


@_rule
def LEAST_ALLOWED(top, rtol, smallest):
    """What is allowed in all components, because others are large; below what they may be noise."""
    return {"least": larger(rtol * (smallest * top), TINY), "noisy": NOISY * top}


@_rule
def ALLOWED(new, largest, least, rtol):
    """The inverse of the allowed error of a component."""
    return {"inverse": 1.0 / larger(rtol * larger(abs(new), largest), least)}


@_rule
def ALLOWED_WITH_CLOCKS(new, largest, least, moved, extra, rtol):
    allowed = extra + larger(rtol * larger(abs(new), largest), least)
    return {"inverse": 1.0 / larger(allowed, OF_CLOCK * moved)}


@_rule
def ALLOWED_WITH_ATOL(x, new, noise, extra, rtol):
    allowed = larger(extra + rtol * larger(abs(x), abs(new)), OF_ROUNDING * noise)
    return {"inverse": 1.0 / larger(allowed, TINY)}


@_rule
def ON_LINE(x, new, u):
    """A state on the straight line along the step."""
    return {"point": x + u * (new - x)}


@_rule
def BESIDE(t, state, x, new, f, counts, seeds, part, is_end):
    """A component beside its value, within some units in its last place; a clock is later.

    Between the ends they are those of the larger end: a component may begin at 0.
    """
    later = state + OF_CLOCK * larger(abs(state), t * abs(f))
    size = (is_end > 0.0).select(abs(state), larger(abs(x), abs(new)))
    return {"beside": (counts > 0.0).select(state + OF_SEED * part * seeds * size, later)}


@_rule
def MOST(change, most):
    """The largest change of f at states beside one, where f has a value."""
    return {"most": larger(abs(change), most)}


@_rule
def BESIDE_POINTS(most, least, largest, second, is_end):
    """The least of these numbers at both ends of a step, and the two largest at all its points."""
    return {
        "least": (is_end > 0.0).select(smaller(most, least), least),
        "largest": larger(most, largest),
        "second": larger(smaller(most, largest), second),
    }


@_rule
def TOP(x, largest, counts, top):
    """The largest modulus of all components but clocks before a step."""
    return {"top": (counts > 0.0).select(larger(larger(abs(x), largest), top), top)}


@_rule
def SECOND(
    t, taken, error, apart, inverse, least, largest, second, top, grows,
    ratio, of_apart, of_length,
):  # fmt: skip
    """The largest ratios of a second trial, and the inverse of what it allows.

    Where rounding is what is allowed, shorter steps have no less of it beside their length, so that
    the next length depends on other components alone.

    `least` is the change of f beside that end of the step where it is less: f may be steep at one.
    In a step that is not much longer than what time is rounded to the largest one counts, because
    its sub-steps see little but rounding, which `grows` in the sum of columns. An error that is
    rounding beside the largest component may be the change at other points, too: but at the one
    where it is largest.
    """
    is_short = taken <= TINY_STEP * t
    at_ends = grows * (taken * is_short.select(largest, least))
    of_rounding = larger(smaller(OF_NOISE * (taken * second), NOISY * top), at_ends)
    own = (of_rounding < inf).select(smaller(1.0 / of_rounding, inverse), inverse)
    found = abs(error) * own
    counts = ((own < inverse) & (found <= 1.0)).select(0.0, found)
    return {
        "ratio": larger(found, ratio),
        "of_length": larger(counts, of_length),
        "of_apart": larger(is_short.select(0.0, abs(apart) * own), of_apart),
        "inverse": own,
    }


def _grown(rtol):
    """Return the part of its allowed error to which a component has grown again."""
    return smaller(GROWN, 0.1 / rtol)


def _is_low(new, largest, f_new, inverse, last, rtol):
    """Whether a component that was large is below what is allowed, and does not just cross 0."""
    stays = abs(f_new) * inverse * (last * rtol) < STAYS
    return (abs(new) * inverse < 1.0) & (largest * inverse > _grown(rtol)) & stays


@_rule
def FALLEN(new, largest, rtol, fallen):
    """1 where a component may be low."""
    return {"fallen": (abs(new) < rtol * largest).select(1.0, fallen)}


@_rule
def LOW(new, largest, f_new, inverse, last, rtol, low, watches):
    """In how many steps in a row a component is low, 2 at most; 3 if it grew after that."""
    since = (low >= 2.0).select((abs(new) * inverse > _grown(rtol)).select(3.0, low), 0.0)
    is_low = _is_low(new, largest, f_new, inverse, last, rtol)
    now = (low >= 3.0).select(low, is_low.select(smaller(low + 1.0, 2.0), since))
    return {"low": now, "watches": larger((now < 3.0).select(now, 0.0), watches)}


@_rule
def RATIO(error, inverse, f_new, ratio, total):
    """The largest error by what is allowed, and a sum that shows what is not finite."""
    own = abs(error) * inverse
    return {"ratio": larger(own, ratio), "total": total + own + abs(f_new)}


@_rule
def LARGE(error, inverse, noisy, large):
    """The largest of these ratios whose error is more than rounding of the largest component."""
    return {"large": (abs(error) > noisy).select(larger(abs(error) * inverse, large), large)}


@_rule
def IS_NOISY(ratio, large, steps, longer):
    """1 where rounding may decide on a step: looked for at each eighth one, and after one such."""
    eighth = steps * 0.125
    is_due = eighth.then("floor").equals(eighth) | longer.equals(AFTER_TRIAL)
    return {"is_noisy": (is_due & (ratio > SHORTENS) & (large < ratio)).select(1.0, 0.0)}


@_rule
def DIFFERENCES(new, f_new, last, f_last, inverse, taken, rates, states):
    """The squared differences of h f and of states, between the next state and the last column."""
    of_f, of_states = taken * (f_new - f_last) * inverse, (new - last) * inverse
    return {"rates": rates + of_f * of_f, "states": states + of_states * of_states}


# -------------------------------------------------------------------------------- one for each lane
@_rule
def BEGIN(size, rate, total, part, last, longest, first_next, second_next, first_state):
    """Of the first step: |x| changes by a part of itself, or x at rest by a part of the time.

    Other rows are 0, as they were made.
    """
    relative = size / rate
    guess = (size > 0.0).select(larger(relative, FIRST_OF_TIME * last), FIRST_AT_REST * last)
    wanted = (rate > 0.0).select(part * guess, last)
    has_value = total < inf
    return {
        "wanted": smaller(smaller(wanted, last), longest),
        "longer": AT_FIRST,
        "next": first_next,
        "second": second_next,
        "state": has_value.select(first_state, float(State.NO_VALUE)),
        "patience": PATIENCE,
        "outer": inf,
    }


@_rule
def NEAR(outer):
    """Near a surface a step may end just before the last time, and be short."""
    is_near = outer < inf
    return {"reach": is_near.select(1.0, REACH), "shortest": is_near.select(0.0, SHORTEST)}


@_rule
def LENGTH(t, wanted, state, reach, mode, last, next, second, sign):
    """Of this step, 0 in lanes that do not take it, and whether it is a step aside.

    It is where it would pass the time `next` and not that of `second`.
    """
    rest, to_next, to_second = last - t, larger(next - t, LEAST), second - t
    is_within = wanted < reach * rest

    def not_past(length):
        return (length > to_second).select(length, smaller(length, to_next))

    taken = is_within.select(not_past(wanted), not_past(rest))
    is_aside = taken < is_within.select(wanted, rest)
    taken = state.equals(mode).select(taken, 0.0)
    signed = taken.then("copysign", sign)
    return {"taken": taken, "signed": signed, "aside": is_aside.select(1.0, 0.0)}


def _root(ratio):
    """Return ratio**(-7/64), within 3.4 percent: bits of a number are nearly its logarithm."""
    eighth, back = (ratio.then("bits_lshr", from_bits(k)) for k in (3, 6))
    return ratio._of("bits_sub", _ROOT, eighth.then("bits_sub", back))


def _is_false(ratio, apart):
    """Return whether all columns agree on a false end."""
    return (apart > MOST_APART) & (ratio <= 1.0)


@_rule
def AFTER(
    t, taken, aside, wanted, longer, state, steps, tries, ratio, total, kept, apart, on_trial,
    of_length, reach, last, longest,
):  # fmt: skip
    """Whether a step is taken, or has reached its time aside, and the length of the next one."""
    is_finite = total < inf
    is_active = taken > 0.0
    sees = is_finite & (kept > 0.0)  # the estimate means something
    accepted = is_active & sees & (apart <= MOST_APART) & (ratio <= 1.0)
    # All that follows waits for the factor: what can be known without it is known before.
    of_refused = _is_false(ratio, apart).select(smaller(longer, OF_APART), smaller(longer, REFUSED))
    most = accepted.select(longer, of_refused)
    factor = sees.select(larger(smaller(SAFETY * _root(of_length), most), SHORTER), OF_NAN)
    served, moved = accepted & (aside > 0.0), accepted & (aside <= 0.0)
    changes = served.select(0.0, taken) > 0.0
    reaches = (wanted < reach * (last - t)).select(t + taken, last)
    after = moved.select(reaches, t)
    longer_now = (on_trial > 0.0).select(AFTER_TRIAL, LONGER)
    after_this = accepted.select(longer_now, AFTER_REFUSED)
    return {
        "accepted": moved.select(1.0, 0.0),
        "served": served.select(1.0, 0.0),
        "t": after,
        "wanted": changes.select(smaller(factor * taken, longest), wanted),
        "longer": changes.select(after_this, longer),
        "state": (is_active & (after >= last)).select(float(State.DONE), state),
        "steps": steps + moved.select(1.0, 0.0),
        "tries": tries + is_active.select(1.0, 0.0),
    }


def _ends(t, taken, wanted, state, tries, shortest, most):
    """Return the state of lanes whose steps become too short, and which have taken too many."""
    runs = (taken > 0.0) & (state < State.DONE)
    is_short = runs & (wanted < larger(shortest * t, LEAST))
    state = is_short.select(float(State.ENDED), state)
    return runs, state, runs & (tries > most) & (state < State.DONE)


def _is_stiff(rates, states, limit):
    return (rates > limit * limit * states) & (states > 0.0)


@_rule
def REFUSALS(rough, ratio, taken, accepted, served):
    """How rough the way of a lane is: refusals, less a part of the steps since then.

    One with a small error, as on the way into a narrow bend, does not count by itself.
    """
    is_refused = (taken > 0.0) & (accepted + served <= 0.0)
    counts = is_refused & ((ratio > FAR) | (rough >= 1.0))
    calmer = (accepted > 0.0).select(larger(rough - CALMER, 0.0), rough)
    return {"rough": counts.select(smaller(rough + 1.0, MOST_ROUGH), calmer)}


@_rule
def LOOKS(t, taken, wanted, tries, rates, states, stiff, ratio, apart, shortest, limit, most):
    """Whether `TURN_EXPLICIT` changes anything."""
    is_stiff = _is_stiff(rates, states, limit) | (stiff > 0.0) | (apart > BOUNCES)
    is_over = (wanted < larger(shortest * t, LEAST)) | (tries > most)
    return {"looks": (taken > 0.0) & (is_stiff | is_over)}


@_rule
def TURN_EXPLICIT(
    t, taken, wanted, longer, state, stiff, easy, patience, trial, tries, accepted, rates, states,
    ratio, apart, shortest, limit, switches, most,
):  # fmt: skip
    """Whether the motion ends, or a lane becomes implicit, after `AFTER`."""
    _, state, stops = _ends(t, taken, wanted, state, tries, shortest, most)
    is_stiff, accepted = _is_stiff(rates, states, limit), accepted > 0.0
    more = is_stiff.select(1.0, (apart > BOUNCES).select(OF_BOUNCE, 0.0))
    easy_now = (more > 0.0).select(0.0, (stiff > 0.0).select(easy + 1.0, 0.0))
    stiff_now = (more > 0.0).select(stiff + more, (easy_now < FORGET).select(stiff, 0.0))
    easy = accepted.select((stiff_now > 0.0).select(easy_now, 0.0), easy)
    is_false = (taken > 0.0) & _is_false(ratio, apart)
    stiff = accepted.select(stiff_now, is_false.select(stiff + OF_FALSE, stiff))
    turns = (stiff >= patience) & (switches > 0.0) & (state < State.IMPLICIT)
    return {
        "longer": turns.select(AT_FIRST, longer),
        "state": turns.select(float(State.IMPLICIT), stops.select(float(State.TOO_MANY), state)),
        "stiff": turns.select(0.0, stiff),
        "easy": turns.select(0.0, easy),
        "trial": turns.select(TRIAL, trial),
    }


@_rule
def TURN_IMPLICIT(
    t, taken, wanted, state, easy, patience, trial, tries, accepted, rate, shortest, limit,
    switches, most,
):  # fmt: skip
    """The same for an implicit lane, which may become explicit."""
    runs, state, stops = _ends(t, taken, wanted, state, tries, shortest, most)
    accepted = accepted > 0.0
    left = larger(trial - 1.0, 0.0)
    is_trial = left > 0.0
    product = rate * wanted
    is_easy = (product < 2.0 * limit) & (product < is_trial.select(0.6 * limit, inf))
    easy_now = is_easy.select(easy + 1.0, 0.0)
    patient = (is_easy | is_trial).select(patience, PATIENCE)
    easy, patience = accepted.select(easy_now, easy), accepted.select(patient, patience)
    turns = (easy >= EASY) & (switches > 0.0) & runs & accepted & (state < State.DONE)
    after_trial = is_trial.select(smaller(4.0 * patience, MOST_PATIENCE), patience)
    explicit = smaller(wanted, limit / larger(rate, LEAST))
    return {
        "wanted": turns.select(explicit, wanted),
        "state": turns.select(float(State.EXPLICIT), stops.select(float(State.TOO_MANY), state)),
        "easy": turns.select(0.0, easy),
        "patience": turns.select(after_trial, patience),
        "trial": accepted.select(left, trial),
    }


# ------------------------------------------------------------------- surfaces on which steps end
def _point(x, new, f, f_new, signed, u, quartic=0.0):
    """A component at a part u of an explicit step: the cubic with values and rates at the ends.

    The rate at another point, see `QUARTIC`, makes it a polynomial of degree 4.
    """
    change, product = new - x, u * (u - 1.0)
    bend = (1.0 - 2.0 * u) * change + (u - 1.0) * (signed * f) + u * (signed * f_new)
    return {"point": x + u * change + (bend + product * quartic) * product}


POINT, POINT_WITH_QUARTIC = _rule(_point), _rule(_point, "quartic")


@_rule
def QUARTIC(x, new, f, f_new, signed, f_point):
    """What to add to the cubic, times u**2 (1 - u)**2, so that its rate at POINTS[0] is that of f.

    It is 0 where f has no value there.
    """
    u = POINTS[0]
    change, slope = new - x, u * (u - 1.0)
    of_bend = (1.0 - 2.0 * u) * change + (u - 1.0) * (signed * f) + u * (signed * f_new)
    of_cubic = (
        change + (2.0 * u - 1.0) * of_bend
        + slope * (signed * f + signed * f_new - 2.0 * change)
    )  # fmt: skip
    own = (signed * f_point - of_cubic) * (1.0 / (2.0 * slope * (2.0 * u - 1.0)))
    return {"quartic": (abs(own) < inf).select(own, 0.0)}


@_rule
def POINT_IMPLICIT(x, new, quarter1, quarter2, quarter3, u):
    """The same in an implicit step, whose rates tell of fast modes: by states at its quarters.

    The polynomial of degree 4 through them, which are given less x, has no rates.
    """
    v = [4.0 * u - float(k) for k in range(5)]
    of_new = v[0] * v[1] * v[2] * v[3] * (1.0 / 24.0)
    outer, inner = v[0] * v[2] * v[4] * (-1.0 / 6.0), v[0] * v[1] * v[3] * v[4] * 0.25
    sides = outer * v[3] * quarter1 + outer * v[1] * quarter3
    return {"point": x + (sides + inner * quarter2 + of_new * (new - x))}


@_rule
def LOOK(crossed, place, end, part, crosses, u, width, taken, inner):
    """Where in a step a surface is crossed first, from what `watch` finds in the part up to u."""
    is_first = ((u * taken > inner).select(crosses, 0.0)) > crossed
    return {
        "crossed": is_first.select(1.0, crossed),
        "place": is_first.select(u - (1.0 - part) * width, place),
        "end": is_first.select(u, end),
        "is_first": is_first.select(1.0, 0.0),
    }


@_rule
def CUT(
    before, t, taken, accepted, served, state, wanted, steps, tries, total, crossed, place, end,
    crosses, jumps, starts, hidden, twice, known, whole_part, part, inner, outer, weight, rounds,
    whole, longer, mode, most, last, goal, aim, since,
):  # fmt: skip
    """A step that crosses a surface: is it taken, and how long is the next one?

    One that may hide two crossings (`hidden`, see `lists.hidden`) is taken again with half of its
    length or more. Where points tell of two, `twice` is 1. A search starts by `starts`, and after
    it a step has at most the length `known`, within which values were told. At a `goal` steps end.

    A straight line to the end of this step crosses the surface at `whole_part`, one from there to
    the state at `outer` at `part`. A step aside on the way to a surface counts as all others. Once
    a step has ended near a surface `aim` is the length of that which ends there, and `since` the
    longest time since which one is crossed, see `lists.aim`.
    """
    is_near = outer < inf
    sought = PLACE * (before + taken) + PLACE_AT_0 * last
    seen = is_near.select(larger(crosses, twice), starts) > 0.0
    seen = seen & (taken > 0.0) & (total < inf)
    is_last = is_near & ((taken - inner <= sought) | (since <= sought))
    cut = seen & (is_last.select(0.0, 1.0) > 0.0)
    is_long = taken > HIDDEN_FROM * last
    again = (hidden >= 1.0) & is_long & (cut.select(0.0, accepted + served) > 0.0)
    is_right = (seen | again).select(0.0, accepted + served) > 0.0
    holds = is_near & is_right & (taken < larger(outer, 0.25 * whole)) & (t < goal)
    misses = holds & (taken >= outer)  # the surface lies farther
    searches = cut | holds
    told = taken * larger(SAFETY / hidden.sqrt().sqrt(), 0.5)  # the error there is of order 4
    forgets = (searches.select(0.0, 1.0) > 0.0) & (taken > 0.0)
    searches = searches | again
    moved = searches.select(0.0, accepted) > 0.0
    first = (crossed > 0.0).select(end, 1.0) * taken
    outer_now = cut.select(first, misses.select(4.0 * taken, outer))
    inner_now = holds.select(taken, inner)
    width = outer_now - inner_now
    of_step = (crossed > 0.0).select(place, whole_part)
    own = cut.select((of_step * taken - inner_now) / width, part)
    own = smaller(larger(own, LEAST_PART), (abs(weight) >= 2.0).select(MOST_PART, 1.0))
    heavier = smaller(2.0 * abs(weight), MOST_WEIGHT)
    of_inner, of_outer = (weight >= 1.0).select(heavier, 1.0), (weight <= -1.0).select(heavier, 1.0)
    a, b = cut.select(1.0, of_outer) * own, cut.select(of_inner, 1.0) * (1.0 - own)
    guess = inner_now + width * (rounds > ROUNDS).select(0.5, a / (a + b))
    has_aim = is_near & (aim > inner_now) & (aim < outer_now) & (rounds <= ROUNDS)
    guess = has_aim.select(aim + 0.5 * sought, guess)
    guess = smaller(larger(guess, inner_now + 0.75 * sought), outer_now - 0.75 * sought)
    is_rough = misses | ((end < 1.0) & (is_near.select(0.0, mode) > 0.0))
    guess = is_rough.select(outer_now, (width > sought).select(guess, outer_now))
    after_this = (moved & is_near).select(whole, wanted)
    after_this = (moved & is_long).select(smaller(after_this, told), after_this)
    of_hold = holds.select(-of_outer, forgets.select(0.0, weight))
    running = (tries > most).select(float(State.TOO_MANY), mode)
    stopped = (state >= State.DONE).select(running, state)
    jumped = moved & seen & (jumps > 0.0) & (t < last)
    after = jumped.select(running, state)
    return {
        "accepted": moved.select(1.0, 0.0),
        "served": (cut | again).select(0.0, served),
        "t": searches.select(before, t),
        "steps": searches.select(steps - accepted, steps),
        "state": searches.select(stopped, after),
        "wanted": again.select(told, searches.select(guess, after_this)),
        "longer": again.select(AFTER_REFUSED, longer),
        "inner": forgets.select(0.0, inner_now),
        "outer": forgets.select(inf, outer_now),
        "weight": cut.select(is_rough.select(0.0, of_inner), of_hold),
        "rounds": forgets.select(0.0, searches.select(rounds + 1.0, rounds)),
        "whole": is_near.select(whole, smaller(wanted, known)),
        "beyond": (cut & is_near).select(1.0, 0.0),
        "at_surface": (moved & seen).select(1.0, 0.0),
        "jumped": jumped.select(1.0, 0.0),
    }


@_rule
def START(value, rate, side, level, ahead, end, taken, first, sign):
    """Where a motion that starts on a surface comes back to it, in the first part of a step.

    It is where a parabola with this rate at the start, and the value `ahead` at the end of the
    part, crosses the surface.
    """
    a, b, of_rate = value - level, ahead - level, sign * rate * (end * taken)
    is_above = side > 0.5
    leads = is_above.select(of_rate, -of_rate) > 0.0
    is_on = ((b >= 0.0) ^ is_above) & leads & (abs(a) <= ON * abs(b)) & (end <= POINTS[0])
    return {"first": smaller(is_on.select(end * (of_rate / (of_rate - b)), inf), first)}


# ------------------------------------------------------------------------ choices that f makes
# A solution slides that changes its choices so often within AT_ONCE of the time. Parts of the time:
# within which a surface lies before which a solution ends, at first within NEAREST; and within
# which one that ends so again slides.
BACK_AND_FORTH, AT_ONCE = 12.0, 2.0**-36
NEAREST, AHEAD, AGAIN = 2.0**-44, 2.0**-38, 2.0**-28


@_rule
def CHOSEN(t, wanted, chosen_at, chosen_often, acted, state, mode):
    """Of a solution that has changed its choices; where changes of the state acted they count."""
    is_at_once = (t - chosen_at <= AT_ONCE * larger(t, wanted)) & acted.equals(0.0)
    often = is_at_once.select(chosen_often + 1.0, 0.0)
    slides = (often >= BACK_AND_FORTH) & (state.equals(mode) | state.equals(float(State.TOO_MANY)))
    return {
        "chosen_at": t,
        "chosen_often": often,
        "state": slides.select(float(State.SLIDING), state),
    }


@_rule
def LOOK_AHEAD(t, last, part, sign):
    """A part of the time, and with the sign of time."""
    ahead = part * (t > 0.0).select(t, last)
    return {"ahead": ahead, "signed": sign * ahead}


@_rule
def SEEK(wanted, ahead):
    """Of a solution that crosses a surface at once again: the next steps end on it."""
    return {
        "whole": wanted, "wanted": ahead, "inner": 0.0, "outer": ahead, "weight": 0.0,
        "rounds": 0.0,
    }  # fmt: skip


@_rule
def GOES_ON(t, ahead, chosen_at, chosen_often, first_state, last):
    """Of a solution that ends just before a surface, and goes on beyond it."""
    often = (t - chosen_at <= AGAIN * t).select(chosen_often + 1.0, 0.0)
    slides, after = often >= BACK_AND_FORTH, t + ahead
    state = slides.select(float(State.SLIDING), first_state)
    is_done = (after >= last) & (state < State.DONE)
    return {
        "chosen_at": t,
        "chosen_often": often,
        "slides": slides.select(1.0, 0.0),
        "wanted": 16.0 * ahead,
        "outer": inf,
        "t": is_done.select(last, after),
        "state": is_done.select(float(State.DONE), state),
    }


@_rule
def TRACE(before, after, jumps, u):
    """The change of the integral of u trace f', where f jumps and grad s . f is that."""
    of_jump = u * (abs(after / before)).then("log")
    return {"change": (jumps > 0.0).select(of_jump, 0.0)}


@_rule
def INFLOW(low, before, after):
    """Whether a component is low; not where the jump of f is an inflow of its own."""
    is_inflow = (abs(after - before) > GROWN * abs(before)) & (low < 3.0)
    return {"low": is_inflow.select(0.0, low)}


# ------------------------------------------------------------------------ changes of the state
# A trajectory ends whose changes follow one another so often within so small a part of the time, or
# so often at one instant.
CHANGES_AT_ONCE, MOST_AT_ONCE, ROUNDING = 12.0, 64.0, 2.0**-50
FASTER = 4.0  # rate after changes, beside that where the step before them began


@_rule
def GOAL(last, stop):
    """The time beyond which no step goes."""
    return {"last": smaller(last, stop)}


@_rule
def AT_STOP(t, accepted, wanted, state, before, state_before, stop, last):
    """After `AFTER`, where a step ends at a time of a change, which shortens no step after it."""
    is_there = (accepted > 0.0) & (t >= stop)
    return {
        "wanted": is_there.select(larger(wanted, before), wanted),
        "state": (t < last).select(state_before, state),
    }


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
NAN = float("nan")


@_rule
def FIRST_VALUE(value, rate, sign):
    """The value of a surface at the start, on which a trajectory lies where it goes.

    Where it rests there, the first part of a step tells.
    """
    is_on, ahead = value.equals(0.0), sign * rate
    on = ahead.equals(0.0).select(NAN, (ahead < 0.0).select(-LEAST, 0.0))
    return {"first": is_on.select(on, value)}


@_rule
def IS_ROUGH(error, least, rough):
    """Whether errors of points in a step may hide a crossing."""
    return {"rough": (abs(error) * OF_POINTS > least).select(1.0, rough)}


@_rule
def KNOWN(value, before, after):
    """A value of a surface, that before it if it is no number, and whether they differ in sign.

    One that is almost 0 between two of the other sign counts as one of theirs: whether it lies
    beyond 0 is for `DIP` to find out.
    """
    is_number = abs(value) < inf
    before = (abs(before) < inf).select(before, value)
    value = is_number.select(value, before)
    is_above = before >= 0.0
    is_alone = ((value >= 0.0) ^ is_above) & ((value >= 0.0) ^ (after >= 0.0))
    is_alone = is_alone & (abs(value) <= ALMOST_0 * smaller(abs(before), abs(after)))
    value = is_alone.select(is_above.select(0.0, -TINY), value)
    differs = is_number & ((value >= 0.0) ^ (before >= 0.0))
    return {"value": value, "before": before, "differs": differs}


@_rule
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


@_rule
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


@_rule
def DEEPER(value, rate, bend, u, middle, left, taken, sign):
    """Whether a surface is beyond 0 at a part u of the step, and where its least value may be."""
    side = (bend >= 0.0).select(1.0, -1.0)
    is_beyond = (left > 0.0) & (side * value < 0.0)
    ahead = side * (sign * rate) * taken
    next_ = u - ahead / (abs(bend) * float(SECTION_PARTS**2))
    part = 1.0 / SECTION_PARTS
    next_ = larger(smaller(next_, smaller(middle + part, 1.0)), larger(middle - part, 0.0))
    goes_on = (left > 0.0) & (side * value >= 0.0) & (next_ < inf)
    return {
        "u": goes_on.select(next_, u),
        "left": goes_on.select(1.0, 0.0),
        "found": is_beyond,
        "half": (abs(value / bend) * 2.0).sqrt() * (1.0 / SECTION_PARTS),
    }


@_rule
def BESIDE_LEAST(u, middle, half):
    """Where both crossings beside a value at u beyond 0 may lie, and a guess."""
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


@_rule
def NEWTON(value, rate, up, a, b, u, low, high, left, taken, start, sign):
    """Where to look next for a crossing, or the crossing.

    Where the surface has no slope it is the upper end of a bracket, unless values grow there.
    """
    ahead = sign * rate
    is_right = (up > 0.5).select(ahead, -ahead) > 0.0
    move = -value / ahead
    is_beyond = (value >= 0.0) ^ (up < 0.5)
    low, high = is_beyond.select(low, u), is_beyond.select(u, high)
    part = move / taken
    next_ = u + part
    is_near = is_right & (abs(part) <= FOUND)
    is_narrow = high - low <= WIDTH
    is_end = is_narrow & is_beyond & (abs(value) <= larger(abs(a), abs(b)))
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


@_rule
def COUNTS(truth, up, direction, moment, latest, since):
    """Whether a crossing counts: not one that follows another at once, as where f slides."""
    way = (up > 0.5).select(1.0, -1.0) * direction
    counts = (truth > 0.0) & (way >= 0.0) & (moment > since)
    counts = counts & (abs(moment - latest) > AT_ONCE * moment)  # pairs follow in any order
    return {"counts": counts, "latest": (truth > 0.0).select(larger(moment, latest), latest)}


def _level(value, rate, is_above):
    """Return 0, or more below a surface on which a state rests, which counts as above otherwise."""
    rests = value.equals(0.0) & rate.equals(0.0)
    return rests.select(is_above.select(0.0, TINY), 0.0)


def _beyond(value):
    """Return a level that is more than the value of a surface, by rounding."""
    return value + (ROUNDING * abs(value) + TINY)


@_rule
def FIRST_SIDE(value, rate, sign):
    """On which side of a surface a trajectory starts, on the surface that to which it goes."""
    is_above = (value > 0.0) | (value.equals(0.0) & (sign * rate > 0.0))
    return {"side": is_above.select(1.0, 0.0), "level": _level(value, rate, is_above)}


@_rule
def LEVEL(value, rate, side):
    """The level of a surface after an instant in which its change has acted."""
    return {"level": _level(value, rate, side > 0.5)}


@_rule
def CROSSED(value, rate, side, level, is_here, by_motion, sign):
    """Whether a state is on another side of a surface, up or down.

    A change may leave the state beyond the surface by rounding, on its way back. A step ends there,
    too, but a crossing by the motion whose rate contradicts it is none: then the surface lies where
    the state is, until its next change, and just beyond where the state does not move any more.
    """
    is_above = value >= level
    differs = (is_here > 0.0) & (is_above ^ (side > 0.5))
    ahead = is_above.select(sign * rate, -(sign * rate))
    is_back = differs & (by_motion > 0.0) & (ahead < 0.0)
    stays = is_above & value.equals(level)
    crosses = is_back.select(0.0, differs.select(1.0, 0.0)) > 0.0
    return {
        "side": crosses.select(is_above.select(1.0, 0.0), side),
        "level": is_back.select(stays.select(_beyond(value), value), level),
        "up": crosses & is_above,
        "down": is_above.select(0.0, crosses.select(1.0, 0.0)) > 0.0,
    }


@_rule
def AFTER_OWN(value, rate, before, up, by_motion, sign):
    """The side and the level of a surface after its own change; `before` is its value before.

    A state that lies as near the surface as the crossing left it is on it: its side is that to
    which the rate leads, and within this instant the level is where it is not crossed again.
    """
    is_near = (by_motion > 0.0) & (abs(before) + abs(before) >= abs(value))
    is_on = value.equals(0.0) | is_near
    ahead = sign * rate
    goes_up = ahead.equals(0.0).select(1.0 - up, (ahead > 0.0).select(1.0, 0.0))
    level = (goes_up > 0.5).select(smaller(value, 0.0), _beyond(larger(value, 0.0)))
    return {
        "side": is_on.select(goes_up, (value >= 0.0).select(1.0, 0.0)),
        "level": is_on.select(level, 0.0),
    }


@_rule
def CHANGED_STATE(
    size, rate, total, largest, rate_before, number, endless, t, wanted, longer, state, stiff,
    easy, tries, at, often, pause, since, part, last, longest,
):  # fmt: skip
    """The next length after changes of the state.

    It is that of a first step if that is more. Where the rate is FASTER times that at which the
    last step began, as after a dose, it is at most that of a first step of a state as large as the
    largest so far.

    Where changes accumulate, their limit follows from the last three times as by Aitken. A surface
    that has been crossed for longer than since the last change, as far as its rate tells, shows
    that its value is rounding by now.
    """
    is_changed = number > 0.0
    guess = (size > 0.0).select(part * (size / rate), 0.0)
    of_largest = part * (larger(size, largest) / rate)
    least = (rate > FASTER * rate_before).select(smaller(wanted, of_largest), wanted)
    guess = smaller(smaller(larger((rate > 0.0).select(guess, 0.0), least), last), longest)
    own = t - at
    is_at_once = (own <= AT_ONCE * larger(t, wanted)) | (since > own)
    limit = smaller(t + (pause > own).select(own * own / (pause - own), 0.0), last)
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
        "at": is_changed.select(piles_up.select(limit, t), at),
        "pause": is_changed.select(own, pause),
        "often": is_changed.select(often_now, often),
    }


# ---------------------------------------------------------- states at times inside an explicit step
# The defect of the polynomial (`inside`) at both TESTS, as parts of a quarter, times OF_DEFECT is
# its largest error. FEW columns reach its nodes, or one more where the error of FEW over the whole
# step is above OF_FEW times the allowed one. A time within AT_END of a step is its end.
FEW, OF_FEW, TESTS, OF_DEFECT, AT_END = 3, 2048.0, (0.2, 3.8), 0.274, 2.0**-30
_NODES = range(5)
_SCALES = [prod(j - k for k in _NODES if k != j) for j in _NODES]
_SLOPES = [2.0 * sum(1.0 / (j - k) for k in _NODES if k != j) for j in _NODES]


@_rule
def QUARTER(t, after, taken, next, accepted, sign):
    """The length of a quarter of a step that has passed a time, else 0."""
    is_inside = (accepted > 0.0) & (next < after)
    return {"signed": is_inside.select(0.25 * (sign * taken), 0.0)}


def weights_at(v):
    """Return the weights of states less x, and of rates times the length of a quarter, by name."""
    of_states, of_rates = {}, {}
    for j in _NODES:
        product = prod((v - float(k) for k in _NODES if k != j), start=1.0 / _SCALES[j])
        square, own = product * product, v - float(j)
        of_rates[f"rate{j}"] = own * square
        if j:
            of_states[f"state{j}"] = (1.0 - _SLOPES[j] * own) * square
    return of_states | of_rates


@_rule
def BETWEEN(t, taken, next):
    """The weights at the next time."""
    return weights_at(4.0 * ((next - t) / taken))


def weights_of_test(v):
    """Return the weights of the polynomial at v quarters, and those of its derivative by v."""
    weights = weights_at(complex(v, 2.0**-60)).items()  # f(v + i d) = f(v) + i d f'(v) + O(d**2)
    return (
        {name: weight.real for name, weight in weights},
        {name: weight.imag * 2.0**60 for name, weight in weights},
    )


@_rule
def INTERPOLATED(
    x, x1, x2, x3, x4, f, f1, f2, f3, f4, signed, state1, state2, state3, state4,
    rate0, rate1, rate2, rate3, rate4,
):  # fmt: skip
    """A component of the polynomial, or of its derivative, less x."""
    rates = rate0 * f + rate1 * f1 + rate2 * f2 + rate3 * f3 + rate4 * f4
    states = state1 * (x1 - x) + state2 * (x2 - x) + state3 * (x3 - x) + state4 * (x4 - x)
    return {"value": states + signed * rates}


@_rule
def DEFECT(slope, f, signed, inverse, ratio, total):
    """The largest error of the polynomial by what is allowed, as far as f tells."""
    ratio = larger(OF_DEFECT * abs(slope - signed * f) * inverse, ratio)
    return {"ratio": ratio, "total": total + abs(f)}


@_rule
def FAILS(t, taken, next, signed, ratio, total, steps, state):
    """Whether a step is taken again, to the next time, because its inside is not known.

    Where that is a long step, which goes on to the last time, a step aside reaches the next time.
    """
    length = next - t
    is_inside = (abs(signed) > 0.0) & (length > AT_END * taken) & (taken - length > AT_END * taken)
    is_known = (ratio <= 1.0) & (total < inf)
    return {
        "fails": is_inside.select(is_known.select(0.0, 1.0), 0.0),
        "wanted": length,
        "second": inf,
        "t": t,
        "steps": steps - 1.0,
        "state": state.equals(float(State.TOO_MANY)).select(state, float(State.EXPLICIT)),
        "longer": AFTER_REFUSED,
    }


@_rule
def WITH_SIGN(value, x, keeps):
    """A component inside a step: 0 may lie within its error, but it keeps the sign of x."""
    signed = x.equals(0.0).select(0.0, abs(value).then("copysign", x))
    return {"value": (keeps > 0.0).select(signed, value)}


@_rule
def LARGER_RATIO(error, inverse, ratio):
    return {"ratio": larger(abs(error) * inverse, ratio)}


# ---------------------------------------------------------------- f' and its rate, implicit half
@_rule
def FINITE(entry):
    """An entry of f' that is not finite counts as 0: J may be any matrix."""
    return {"entry": (abs(entry) < inf).select(entry, 0.0)}


# One step of the power iteration on f', with components measured by their largest moduli.
@_rule
def SIZE(modulus, top):
    return {"top": larger(modulus, top)}


@_rule
def SCALE(largest, top, mode):
    scale = larger(largest, SMALLEST_SCALE * top) + TINY
    return {"scale": scale, "scaled": scale * mode}


@_rule
def RATE(product, scale, size):
    own = product / scale
    return {"product": own, "size": larger(abs(own), size)}


@_rule
def MODE(product, size, seed, mode):
    """The next vector; `seed` keeps it from staying in a part of the space."""
    return {"mode": (size > 0.0).select(product / size + seed, mode)}
