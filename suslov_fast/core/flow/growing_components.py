"""The alarm: a component that grows again from where steps had larger errors than its size allows.

Without `atol` a step may have errors that are large beside a component that has become small. They
do no harm if the component decays for good, or if others feed it: then it forgets them. If it grows
by itself, its errors grow with it. `BatchSolver` then computes the trajectory again, with atol = 0.

A component loses its digits in a step whose error is more than `many` times rtol max(|x|, |x_next|)
(`many_of`). It has digits again where others that have theirs feed it: |g_i| > |f_i| / 2, where g
is f with 0 for all components without digits, but not at an unstable equilibrium. The alarm comes

- if the error that such a component carries, which grows with it, is `many` allowed errors;
- if components without digits would grow, but implicit steps damp exp(a t) to (1 - a h / n)**-n,
  which is no growth if a h is large. They would grow if h (f_i - g_i) > NEXT u_i for all of them,
  with f at a state in which they have some values u_i > 0. These are their allowed errors at first,
  and become less where a component does not grow, until all grow or none does;
- if the solution ends while a component has no digits.

With atol = 0 only components below 2**-1000 lose digits. Then the alarm is a warning.
"""

from math import inf

from ..expressions.values import larger, smaller
from ..llvm.text import Carried
from .codegen import weighted
from .memory import LaneState
from .scalar_kernels import scalar_kernel

NEXT = 0.25  # of the growth in a step that is looked at: the next step is four times as long
# A component that is to grow has a part LESS of its value in the next round, of at most ROUNDS.
LESS, ROUNDS = 0.25, 24.0
# Measured on 798 problems with rtol 1e-4, 1e-6 and 1e-9: 100 at 1e-9, 25 at 1e-6, 10 at 1e-4. With
# half of it more stiff oscillators and Lorenz orbits at 1e-4 and 1e-6 are computed again in vain,
# and 15 in place of 21 of 720 foxes and rabbits are off by 0.1 %, or 100 rtol, without an alarm.
MANY, POWER = 1.6, -0.2
UNDERFLOW = 2.0**-990


def many_of(rtol):
    """Return how many times `rtol` an error beside its component is large."""
    return MANY * rtol**POWER


def _is_large(x, new, error, inverse, rtol, many, acts):
    """Return whether `error` is large beside a component, in a step from x to `new`."""
    size = larger(abs(x), abs(new))
    counts = (inverse > 0.0) & ((acts > 0.0) | (size < UNDERFLOW))  # it is no clock
    return counts & (abs(error) > many * rtol * size)


@scalar_kernel
def LOSES(x, new, error, inverse, rtol, many, acts, loses):
    """Return `loses` = 1 if the `error` of a step is large beside a component, else `loses`."""
    return {"loses": _is_large(x, new, error, inverse, rtol, many, acts).select(1.0, loses)}


@scalar_kernel
def LOST(x, new, error, inverse, rtol, many, acts, lost):
    """Return `lost`, the largest error beside the component, at most 1, since it lost digits."""
    own = smaller(abs(error) / larger(abs(x), abs(new)), 1.0)
    is_large = _is_large(x, new, error, inverse, rtol, many, acts)
    return {"lost": is_large.select(larger(own, lost), lost)}


@scalar_kernel
def KNOWN(new, lost):
    """Return `known`, the component `new`, or 0 if it has lost digits."""
    return {"known": (lost > 0.0).select(0.0, new)}


@scalar_kernel
def FED(new, f_new, fed, signed, lost, changes):
    """Return `lost`, or 0 if others that have their digits feed a component; then it `changes`."""
    grows = signed * (f_new - fed) / new > NEXT
    stays = grows & (abs(f_new) < abs(fed))  # at an unstable equilibrium
    is_fed = (abs(fed) > 0.5 * abs(f_new)) & (lost > 0.0) & ~stays
    return {"lost": is_fed.select(0.0, lost), "changes": is_fed.select(1.0, changes)}


@scalar_kernel
def WATCHES(new, inverse, many, lost, watches):
    """Return `watches`, more than 0 if a component has lost digits, infinite for an alarm."""
    is_grown = lost * abs(new) * inverse > many
    return {"watches": is_grown.select(inf, larger(lost, watches))}


@scalar_kernel
def GROWS(value, f, fed, signed, grow, fall):
    """Return `value`, of a member of a group, less if it does not grow; count it in `grow`, `fall`.

    f is its rate in the group, `fed` the same without the group, `signed` the length of the step.
    """
    is_in, grows = value > 0.0, signed * (f - fed) > NEXT * value
    return {
        "value": grows.select(value, LESS * value),
        "grow": grow + (is_in & grows).select(1.0, 0.0),
        "fall": fall + (is_in & ~grows).select(1.0, 0.0),
    }


@scalar_kernel
def RAISED(before, new, rtol, many, lost):
    """Return `lost` after an event has moved a component from `before` to `new`."""
    now = (abs(new) > abs(before)).select(lost * abs(before / new), lost)
    return {"lost": (now > many * rtol).select(now, 0.0)}


def watch(code, loses):
    """Update `lost` and `watches` after a step; `loses` is 1 where a component has lost digits."""
    text, line, work, D = code.text, code.line, code.work, code.f.of.D
    looks = (work.accepted[0] > 0.0) & ((loses > 0.0) | (line.watches[0] > 0.0))
    looks = looks & (line.watches[0] < inf)
    with text.when(looks.any(), likely=False):
        for i in text.each(D):
            error = weighted(code.integrator.error_weights, code.of_columns(work.ends, i))
            found = code.apply(LOST, i, error=error, inverse=work.error[i])
            line.lost.choose(looks, i, found["lost"])
        text.copy(work.new, work.start, code.D)
        for now in text.rounds(Carried()):
            for i in text.each(D):
                work.start[i] = code.apply(KNOWN, i)["known"]
            code.call("f", work.start, code.table, work.f)
            found = Carried(changes=0.0)
            for i in text.each(D, found):
                own = code.apply(FED, i, fed=work.f[i], **vars(found))
                line.lost.choose(looks, i, own["lost"])
                found.changes = looks.select(own["changes"], 0.0)
            now.goes_on = (found.changes > 0.0).any()
        found = code.reduce(WATCHES, lambda i: {"inverse": work.error[i]}, D, watches=0.0)
        line.watches.choose(looks, 0, found.watches)
        if code.integrator.is_implicit:
            damps = looks & (found.watches > 0.0) & (found.watches < inf)
            with text.when(damps.any()):
                _find_group(code, damps)


def _find_group(code, looks):
    """Set `watches` to infinity in lanes `looks` with a group of components that would grow."""
    text, line, work, D = code.text, code.line, code.work, code.f.of.D
    known, group = work.start, work.a
    for i in text.each(D):
        is_in = looks & (line.lost[i] > 0.0)
        group[i] = is_in.select(1.0 / work.error[i], 0.0)
    found = Carried(grow=0.0, rounds=0.0)
    for now in text.rounds(found):
        sums = Carried(grow=0.0, fall=0.0)
        text.copy(work.new, work.b, code.D)
        for i in text.each(D):
            work.b[i] = known[i] + group[i]
        code.call("f", work.b, code.table, work.f_last)
        for i in text.each(D, sums):
            inputs = {"value": group[i], "f": work.f_last[i], "fed": work.f[i]}
            own = code.apply(GROWS, i, **inputs, **vars(sums))
            group[i], sums.grow, sums.fall = own["value"], own["grow"], own["fall"]
        differs = (sums.grow > 0.0) & (sums.fall > 0.0)
        now.grow = (sums.fall > 0.0).select(0.0, sums.grow)
        now.rounds = now.rounds + 1.0
        now.goes_on = (differs & (now.rounds < ROUNDS)).any()
    line.watches.choose(found.grow > 0.0, 0, inf)


def sound(code):
    """End the trajectories of lanes that have an alarm."""
    line, acts = code.line, code.number("acts") > 0.0
    ends = line.state[0].equals(float(LaneState.ENDED)) & (line.watches[0] > 0.0)
    line.state.choose(acts & (ends | line.watches[0].equals(inf)), 0, float(LaneState.AGAIN))
