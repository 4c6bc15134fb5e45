"""What decides on a step of the motion: allowed errors, lengths, and which half takes the next one.

A step has the estimated error e_i in component i. It is taken if

ratio = max_i e_i / allowed_i <= 1,

if f has a value at the next state, and if no component changes a sign that the motion keeps. By
default the allowed error is rtol max(s_i, 2**-20 max_j s_j), where s_i is the largest |x_i| so far:
a component that is reached through m others begins as t**m, and no step has relative digits of it
for m > 10. Clocks, which have constant rates, have no error, and count there with their change in
the step, because time may be large where all others are small. With `atol` it is
atol_i + rtol max(|x_i|, |x_next,i|), or what rounding leaves of the weighted sum of columns, if
that is more.

The next length is 0.8 ratio**(-1/8) times this one, by square roots, which have the same bits on
every processor. A step that is refused is taken again with it, and a step after that is not longer.

The explicit half is stable where h |mu| < 6 for eigenvalues mu of f' on the left. The difference
quotient of f between the next state and the end of the last column shows the largest |mu| for
nothing. After `patience` steps with h |mu| above `limit` a lane becomes implicit; it leaves this
half if h |mu| stays below twice the limit for EASY steps, with |mu| by the power iteration on f'.

Steps end on surfaces where f jumps or has a kink. Where one is crossed between the ends of PARTS of
a step, the step is taken again and again from the same state, with lengths between `inner`, at
whose end none is crossed, and `outer`. Points inside a step are rough, so the first length is that
of the part. The next ones are where a straight line between states at both sides crosses the
surface. If it is always the same side that comes nearer, the other one counts half, a quarter, ...
(the rule of Illinois); after ROUNDS it is the middle. Once both lengths differ by less than PLACE
of the time, the step of length `outer` is taken.

Each rule below is a list of operations on the numbers of one lane.
"""

import inspect
from math import inf, sqrt
from typing import NamedTuple

from ..lists.numbers import Number, larger, smaller
from ..lists.step import Values, evaluate
from .rows import State

# OF_CLOCK: a drive that begins at rest is noise at first, differences of numbers near 1.
SMALLEST, OF_ROUNDING, OF_CLOCK = 2.0**-20, 2.0**-52, 2.0**-50
SAFETY, SHORTER, LONGER, AT_FIRST, AFTER_REFUSED, OF_NAN = 0.8, 0.2, 4.0, 10.0, 1.0, 0.25
REFUSED = 0.9  # a refused step becomes shorter at least by this factor
REACH = 0.92  # a step reaches the end of time if its length is this part of what is left
SHORTEST, LEAST = 2.0**-44, 2.0**-1000  # of a step: part of the time, and length
SMALLEST_SCALE = 2.0**-60
PARTS = 4
# Of a surface: part of the time, of all the time, and of the time for a kink, where the error of f
# is as small as that of the place.
PLACE, PLACE_AT_0, OF_KINK = 2.0**-51, 2.0**-90, 2.0**-32
LEAST_PART, MOST_PART, MOST_WEIGHT = 2.0**-40, 1.0 - 2.0**-10, 2.0**60
ROUNDS = 14.0
TINY = 2.0**-1000  # in place of an allowed error of 0
FIRST_PART, FIRST_OF_TIME, FIRST_AT_REST = 5.0, 2.0**-40, 1e-6
MOST_STEPS = 250_000  # between two times that are asked for
# Steps that look stiff before a lane becomes implicit, those in between that make it forget them;
# implicit steps that are a trial, those that explicit ones would do as well, and the most patience.
PATIENCE, FORGET, TRIAL, EASY, MOST_PATIENCE = 5.0, 6.0, 8.0, 3.0, 100.0


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


def _rule(function):
    """Return the rule that a function of `Number` describes."""
    inputs = [*inspect.signature(function).parameters]
    values = Values(len(inputs), ())
    found = function(*(Number(values.emit, k) for k in range(len(inputs))))
    results = {name: a.number if isinstance(a, Number) else a for name, a in found.items()}
    return Rule(inputs, values.operations, results)


def carried_out(rule, **inputs):
    """Return the results of a rule by name, for numbers or arrays."""
    values = {k: inputs[name] for k, name in enumerate(rule.inputs)}
    evaluate(rule.operations, values)
    return {name: a if isinstance(a, float) else values[a] for name, a in rule.results.items()}


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
def SAME_SIGN(x, new, kept):
    """Whether a denominator that depends on clocks alone has kept its sign."""
    changes = ((x < 0.0) & (new > 0.0)) | ((x > 0.0) & (new < 0.0))
    return {"kept": changes.select(0.0, kept)}


@_rule
def LARGEST(x, new, largest, counts, top, moved):
    """The largest modulus of a component; a clock counts with its change in the step."""
    change = (counts > 0.0).select(0.0, abs(new - x))
    size = (counts > 0.0).select(larger(abs(new), largest), change)
    return {"top": larger(size, top), "moved": larger(change, moved)}


def _ratio(error, allowed, f_new, ratio, total):
    """Return the inverse of an allowed error, and the largest ratio and the total with one more."""
    inverse = 1.0 / larger(allowed, TINY)
    own = abs(error) * inverse
    found = {"ratio": larger(own, ratio), "total": total + own + abs(f_new), "inverse": inverse}
    return inverse, found


def _differences(inverse, new, f_new, last, f_last, rates, states):
    """Return the squared differences of f and of states with one more."""
    of_f, of_states = (f_new - f_last) * inverse, (new - last) * inverse
    return {"rates": rates + of_f * of_f, "states": states + of_states * of_states}


def _by_largest(new, largest, top, moved, extra, rtol):
    allowed = extra + rtol * larger(larger(abs(new), largest), SMALLEST * top)
    return larger(allowed, OF_CLOCK * moved)


def _by_both(x, new, noise, extra, rtol):
    return larger(extra + rtol * larger(abs(x), abs(new)), OF_ROUNDING * noise)


@_rule
def ERROR(
    new, error, largest, f_new, last, f_last, extra, top, moved, rtol, ratio, total, rates, states
):
    allowed = _by_largest(new, largest, top, moved, extra, rtol)
    inverse, found = _ratio(error, allowed, f_new, ratio, total)
    return found | _differences(inverse, new, f_new, last, f_last, rates, states)


@_rule
def ERROR_WITH_ATOL(
    x, new, error, noise, f_new, last, f_last, extra, rtol, ratio, total, rates, states
):
    inverse, found = _ratio(error, _by_both(x, new, noise, extra, rtol), f_new, ratio, total)
    return found | _differences(inverse, new, f_new, last, f_last, rates, states)


@_rule
def IMPLICIT_ERROR(new, error, largest, f_new, extra, top, moved, rtol, ratio, total):
    allowed = _by_largest(new, largest, top, moved, extra, rtol)
    return _ratio(error, allowed, f_new, ratio, total)[1]


@_rule
def IMPLICIT_ERROR_WITH_ATOL(x, new, error, noise, f_new, extra, rtol, ratio, total):
    return _ratio(error, _by_both(x, new, noise, extra, rtol), f_new, ratio, total)[1]


# -------------------------------------------------------------------------------- one for each lane
@_rule
def BEGIN(size, rate, total, part, last, longest, first_next, first_state):
    """Of the first step: |x| changes by a part of itself, or x at rest by a part of the time."""
    relative = size / rate
    guess = (size > 0.0).select(larger(relative, FIRST_OF_TIME * last), FIRST_AT_REST * last)
    wanted = (rate > 0.0).select(part * guess, last)
    has_value = total < inf
    return {
        "wanted": smaller(smaller(wanted, last), longest),
        "longer": AT_FIRST,
        "next": first_next,
        "state": has_value.select(first_state, float(State.NO_VALUE)),
        "stiff": 0.0,
        "easy": 0.0,
        "patience": PATIENCE,
        "trial": 0.0,
        "steps": 0.0,
        "tries": 0.0,
        "t": 0.0,
        "inner": 0.0,
        "outer": inf,
        "weight": 0.0,
        "rounds": 0.0,
        "whole": 0.0,
    }


def _is_inside(t, wanted, outer, last):
    """Whether a step ends before the last time; near a surface it may end just before."""
    return wanted < (outer < inf).select(1.0, REACH) * (last - t)


@_rule
def LENGTH(t, wanted, state, outer, mode, last, sign):
    """Of this step, 0 in lanes that do not take it."""
    taken = _is_inside(t, wanted, outer, last).select(wanted, last - t)
    taken = state.equals(mode).select(taken, 0.0)
    return {"taken": taken, "signed": sign * taken}


def _after(
    t, taken, wanted, longer, state, steps, tries, outer, ratio, total, kept, last, longest, most
):  # fmt: skip
    """Return what both halves have in common: numbers, truth values and the next length.

    `stops` is where a lane has no steps left, unless the other half takes the next one.
    """
    is_finite = total < inf
    factor = larger(smaller(SAFETY / ratio.sqrt().sqrt().sqrt(), longer), SHORTER)
    accepted = (taken > 0.0) & is_finite & (kept > 0.0) & (ratio <= 1.0)
    sees = is_finite & (kept > 0.0)  # the estimate means something
    factor = sees.select(factor, OF_NAN)
    factor = accepted.select(factor, smaller(factor, REFUSED))
    is_active = taken > 0.0
    reaches = _is_inside(t, wanted, outer, last).select(0.0, 1.0) > 0.0
    length = smaller(factor * taken, longest)
    after = accepted.select(reaches.select(last, t + taken), t)
    tried = tries + is_active.select(1.0, 0.0)
    shortest = (outer < inf).select(0.0, larger(SHORTEST * after, LEAST))
    is_short = (length < shortest) & is_active
    # A state keeps its number unless one of these happens.
    state = is_short.select(float(State.ENDED), state)
    state = (is_active & (after >= last)).select(float(State.DONE), state)
    stops = is_active & (tried > most) & (state < State.DONE)
    return accepted, is_active, length, state, stops, {
        "accepted": accepted.select(1.0, 0.0),
        "t": after,
        "longer": is_active.select(accepted.select(LONGER, AFTER_REFUSED), longer),
        "steps": steps + accepted.select(1.0, 0.0),
        "tries": tried,
    }  # fmt: skip


@_rule
def CHOOSE_EXPLICIT(
    t, taken, wanted, longer, state, stiff, easy, patience, trial, steps, tries, outer, ratio,
    total, kept, rates, states, last, longest, limit, switches, most,
):  # fmt: skip
    accepted, is_active, length, state, stops, found = _after(
        t,
        taken,
        wanted,
        longer,
        state,
        steps,
        tries,
        outer,
        ratio,
        total,
        kept,
        last,
        longest,
        most,
    )
    is_stiff = (taken * taken * rates > limit * limit * states) & (states > 0.0)
    easy_now = is_stiff.select(0.0, easy + 1.0)
    stiff_now = is_stiff.select(stiff + 1.0, (easy_now < FORGET).select(stiff, 0.0))
    easy, stiff = accepted.select(easy_now, easy), accepted.select(stiff_now, stiff)
    turns = (stiff >= patience) & (switches > 0.0) & (state < State.IMPLICIT)
    return found | {
        "wanted": is_active.select(length, wanted),
        "longer": turns.select(AT_FIRST, found["longer"]),
        "state": turns.select(float(State.IMPLICIT), stops.select(float(State.TOO_MANY), state)),
        "stiff": turns.select(0.0, stiff),
        "easy": turns.select(0.0, easy),
        "patience": patience,
        "trial": turns.select(TRIAL, trial),
    }


@_rule
def CHOOSE_IMPLICIT(
    t, taken, wanted, longer, state, stiff, easy, patience, trial, steps, tries, outer, ratio,
    total, kept, rate, last, longest, limit, switches, most,
):  # fmt: skip
    accepted, is_active, length, state, stops, found = _after(
        t,
        taken,
        wanted,
        longer,
        state,
        steps,
        tries,
        outer,
        ratio,
        total,
        kept,
        last,
        longest,
        most,
    )
    left = larger(trial - 1.0, 0.0)
    is_trial = left > 0.0
    product = rate * length
    is_easy = (product < 2.0 * limit) & (product < is_trial.select(0.6 * limit, inf))
    easy_now = is_easy.select(easy + 1.0, 0.0)
    patient = (is_easy | is_trial).select(patience, PATIENCE)
    easy, patience = accepted.select(easy_now, easy), accepted.select(patient, patience)
    runs = (state < State.DONE) & is_active
    turns = (easy >= EASY) & (switches > 0.0) & runs & accepted
    after_trial = is_trial.select(smaller(4.0 * patience, MOST_PATIENCE), patience)
    explicit = smaller(length, limit / larger(rate, LEAST))
    return found | {
        "wanted": is_active.select(turns.select(explicit, length), wanted),
        "state": turns.select(float(State.EXPLICIT), stops.select(float(State.TOO_MANY), state)),
        "stiff": turns.select(0.0, stiff),
        "easy": turns.select(0.0, easy),
        "patience": turns.select(after_trial, patience),
        "trial": accepted.select(left, trial),
    }


# ------------------------------------------------------------------- surfaces on which steps end
@_rule
def POINT(x, new, f, f_new, signed, u):
    """A component at a part u of an explicit step: the cubic with values and rates at the ends."""
    change = new - x
    bend = (1.0 - 2.0 * u) * change + (u - 1.0) * (signed * f) + u * (signed * f_new)
    return {"point": x + u * change + bend * (u * (u - 1.0))}


@_rule
def POINT_IMPLICIT(x, new, u):
    """The same in an implicit step, whose rates tell of fast modes: on a straight line."""
    return {"point": x + u * (new - x)}


@_rule
def LOOK(crossed, place, end, part, crosses, u, taken, inner):
    """Where in a step a surface is crossed first, from what `watch` finds in the part before u."""
    is_first = ((u * taken > inner).select(crosses, 0.0)) > crossed
    return {
        "crossed": is_first.select(1.0, crossed),
        "place": is_first.select(u - (1.0 - part) / PARTS, place),
        "end": is_first.select(u, end),
        "is_first": is_first.select(1.0, 0.0),
    }


@_rule
def CUT(
    before, t, taken, accepted, state, wanted, steps, tries, total, crossed, place, end, crosses,
    jumps, whole_part, part, inner, outer, weight, rounds, whole, stops, mode, most, last,
):  # fmt: skip
    """A step that crosses a surface: is it taken, and how long is the next one?

    A straight line to the end of this step crosses the surface at `whole_part`, one from there to
    the state at `outer` at `part`.
    """
    is_near = outer < inf
    is_kink = (crosses > 0.0) & (jumps <= 0.0)
    sought = is_kink.select(OF_KINK, PLACE) * (before + taken) + PLACE_AT_0 * last
    seen = is_near.select(crosses, crossed) > 0.0
    seen = seen & (stops > 0.0) & (taken > 0.0) & (total < inf)
    is_last = is_near & (taken >= outer) & (outer - inner <= sought)
    cut = seen & (is_last.select(0.0, 1.0) > 0.0)
    holds = is_near & (seen.select(0.0, accepted) > 0.0) & (taken < larger(outer, 0.25 * whole))
    misses = holds & (taken >= outer)  # the surface lies farther
    searches = cut | holds
    moved = searches.select(0.0, accepted) > 0.0
    forgets = (searches.select(0.0, 1.0) > 0.0) & (taken > 0.0)
    outer_now = cut.select(is_near.select(1.0, end) * taken, misses.select(4.0 * taken, outer))
    inner_now = holds.select(taken, inner)
    width = outer_now - inner_now
    of_step = (crossed > 0.0).select(place, whole_part)
    own = cut.select((of_step * taken - inner_now) / width, part)
    own = smaller(larger(own, LEAST_PART), MOST_PART)
    heavier = smaller(2.0 * abs(weight), MOST_WEIGHT)
    of_inner, of_outer = (weight >= 1.0).select(heavier, 1.0), (weight <= -1.0).select(heavier, 1.0)
    a, b = cut.select(1.0, of_outer) * own, cut.select(of_inner, 1.0) * (1.0 - own)
    guess = inner_now + width * (rounds > ROUNDS).select(0.5, a / (a + b))
    guess = smaller(larger(guess, inner_now + 0.25 * sought), outer_now - 0.25 * sought)
    is_rough = misses | ((end < 1.0) & (is_near.select(0.0, 1.0) > 0.0))
    guess = is_rough.select(outer_now, (width > sought).select(guess, outer_now))
    running = (tries > most).select(float(State.TOO_MANY), mode)
    stopped = (state >= State.DONE).select(running, state)
    after = (moved & seen & (jumps > 0.0)).select(mode + float(State.CHANGED), state)
    return {
        "accepted": moved.select(1.0, 0.0),
        "t": searches.select(before, t),
        "steps": searches.select(steps - accepted, steps),
        "state": searches.select(stopped, after),
        "wanted": searches.select(guess, (moved & is_near).select(whole, wanted)),
        "inner": forgets.select(0.0, inner_now),
        "outer": forgets.select(inf, outer_now),
        "weight": cut.select(of_inner, holds.select(-of_outer, forgets.select(0.0, weight))),
        "rounds": forgets.select(0.0, searches.select(rounds + 1.0, rounds)),
        "whole": is_near.select(whole, wanted),
        "beyond": (cut & is_near).select(1.0, 0.0),
        "at_surface": (moved & seen).select(1.0, 0.0),
    }


# ---------------------------------------------------------- states at times inside an explicit step
# A step with the first k columns from the nearer end, of the part u of its length: its error is
# that of k columns over the whole step times u**(2 k + 1).
OF_ALLOWED = 0.25


@_rule
def INSIDE(t, after, taken, next, accepted, sign):
    """Of the shorter step to the next time: from which end, and its length."""
    offset = next - t
    is_pending = (accepted > 0.0) & (next <= after)
    is_forward = offset <= 0.5 * taken
    length = is_forward.select(offset, offset - taken)
    length = (is_pending & (next < after)).select(length, 0.0)
    return {
        "forward": (is_pending & is_forward & (next < after)).select(1.0, 0.0),
        "signed": sign * length,
        "part": abs(length) / larger(taken, LEAST),
    }


@_rule
def FEW(part, ratio1, ratio2, ratio3):
    """How many columns such a step needs."""
    square = part * part
    cube = square * part
    fifth = cube * square
    more = (ratio3 * (fifth * square) <= OF_ALLOWED).select(3.0, 4.0)
    more = (ratio2 * fifth <= OF_ALLOWED).select(2.0, more)
    return {"few": (ratio1 * cube <= OF_ALLOWED).select(1.0, more)}


@_rule
def WITH_SIGN(value, x, keeps):
    """A component inside a step: 0 may lie within its error, but it keeps the sign of x."""
    signed = x.equals(0.0).select(0.0, abs(value).then("copysign", x))
    return {"value": (keeps > 0.0).select(signed, value)}


@_rule
def LARGER_RATIO(error, inverse, ratio):
    return {"ratio": larger(abs(error) * inverse, ratio)}


# ------------------------------------------- states at times inside an implicit step, and its rates
@_rule
def INSIDE_IMPLICIT(t, after, taken, next, accepted, sign):
    """Of the shorter step from the state before the step to the next time."""
    is_pending = (accepted > 0.0) & (next <= after)
    length = (is_pending & (next < after)).select(next - t, 0.0)
    return {"length": length, "signed": sign * length}


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
