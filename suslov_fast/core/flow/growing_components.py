"""The alarm: a component that has become small, has lost its digits, and grows again by itself.

Without `atol` a step may have errors that are large beside a component that has become small. They
do no harm if the component decays for good, or if others feed it: then it forgets them. If it grows
by itself, its errors grow with it. Then the trajectory is computed again, with relative digits of
this component, `lost` = RELATIVE, and with rtol / TIGHT, because growth makes all errors larger.

`lost` carries the relative error of a component: a sum over steps with errors that are more than
`some` times its size (`some_of`). It is 0 again where others that have their digits feed it:
|g_i| > |f_i| / 2, where g is f with 0 for all components that have lost digits. At an unstable
equilibrium it is not. The alarm comes

- if such a component grows, and has an error of `many` allowed errors, or of DEEP of its size;
- if components below their allowed errors would grow. Implicit steps damp exp(a t) to
  (1 - a h / n)**-n, which is no growth if a h is large, and explicit steps multiply by a polynomial
  in a h. They would grow if h (f_i - g_i) > NEXT u_i (explicit steps: LONG u_i) for all of them,
  with f at a state in which they have some values u_i > 0. These are their allowed errors at first,
  and become less where a component does not grow, until all grow or none does;
- if the solution ends while a component has no digits.

If all components are RELATIVE, only those below 2**-990 lose digits. Then the alarm is a warning.
"""

from math import inf

from ..expressions.values import larger, smaller
from ..llvm.text import Carried
from .memory import LaneState
from .scalar_kernels import scalar_kernel

RELATIVE = -1.0  # in place of `lost`
TIGHT, LATER = 4.0, 1.001  # times another end: both may be at the same pole
# Growth in a step, by the exponent: of the next implicit step, which is four times as long, and of
# an explicit step that has lost 5e-6 of it. Explicit steps lose (a h / MOST)**10 of exp(a h).
NEXT, LONG, MOST = 0.25, 2.0, 8.0
# A component that is to grow has a part LESS of its value in the next round, of at most ROUNDS.
LESS, ROUNDS = 0.25, 24.0
# An error of `many_of` allowed errors is alarming. Errors of a component that may pass through 0
# count `loose_of` times less, because they are large beside it there. PART of an alarming error is
# a reason to look at f. A component is small if it is SMALL of its largest value. The error of a
# step counts from 25 rtol on at 1e-9, and from rtol on at 1e-6 (`some_of`). Measured on 553
# problems with rtol 1e-4, 1e-6 and 1e-9. If LOOSE is half as large, 14 in place of 3 of 256 orbits
# of Van der Pol's equation (mu = 1000) are computed again in vain at 1e-4.
MANY, LOOSE, LEAST, PART, SMALL, SOME = 0.25, 160.0, 4.0, 0.1, 0.1, 4e-4
DEEP = 1e-3  # or 100 rtol: part of a component that keeps its sign
UNDERFLOW = 2.0**-990


def many_of(rtol):
    """Return how many allowed errors are alarming."""
    return MANY * rtol ** (-1 / 3)


def loose_of(rtol):
    """Return by how much less errors of components count that may pass through 0."""
    return max(LOOSE * rtol**0.25, LEAST)


def some_of(rtol, keeps):
    """Return the least error of a step, beside a component, that counts.

    `keeps` is 1 if the component keeps its sign.
    """
    return rtol * max(SOME * many_of(rtol) ** 2 * (1.0 if keeps else loose_of(rtol)), 1.0)


def _is_large(x, new, error, inverse, rtol, some, lost):
    size = larger(abs(x), abs(new))
    return (abs(error) > some * size) & (rtol * size * inverse < SMALL) & (lost < 1.0)


@scalar_kernel
def LOSES(x, new, error, inverse, rtol, some, lost, loses):
    """Return `loses` = 1 if the `error` of a step is large beside a component, else `loses`."""
    return {"loses": _is_large(x, new, error, inverse, rtol, some, lost).select(1.0, loses)}


@scalar_kernel
def LOST(x, new, f_new, signed, error, inverse, rtol, some, loose, acts, keeps, lost, watches):
    """Return `lost`, at most 1, after a step from x to `new`, and `watches`, the largest."""
    size = larger(abs(x), abs(new))
    part = 1.0 / (keeps > 0.0).select(abs(new), loose * size)  # a division takes long
    rate = (new < 0.0).select(-f_new, f_new) * signed
    growth = larger(keeps * (rate * part), 0.0) * (1.0 / MOST)
    fifth = growth * growth * (growth * growth) * growth
    own = smaller(larger(lost, 0.0) + abs(error) * part + fifth * fifth, 1.0)
    counts = (acts > 0.0) | (size < UNDERFLOW)
    counts = counts & _is_large(x, new, error, inverse, rtol, some, lost)
    lost = counts.select(own, lost)
    return {"lost": lost, "watches": larger(lost, watches)}


@scalar_kernel
def RISES(x, new, f_new, signed, inverse, rtol, many, lost, rises):
    """Return `rises` = 1 if a component may be near an alarm: it has lost digits and grows."""
    size, rate = abs(new) * inverse, (new < 0.0).select(-f_new, f_new) * signed
    is_fast = (size < 1.0) & (rate > LONG * abs(new))
    is_near = is_fast | (lost * size > PART * PART * many) | ((size > 1.0) & (lost > DEEP))
    own = is_near & (lost > PART * many * rtol) & (abs(new) >= abs(x))
    return {"rises": own.select(1.0, rises)}


@scalar_kernel
def KNOWN(new, lost):
    """Return `known`, the component `new`, or 0 if it has lost digits."""
    return {"known": (lost > 0.0).select(0.0, new)}


@scalar_kernel
def FED(new, f_new, fed, signed, lost, changes, left):
    """Return `lost`, or 0 if others that have their digits feed a component; then it `changes`.

    `left` is the largest `lost`.
    """
    own = f_new - fed
    stays = (new < 0.0).select(-own, own) * signed > NEXT * abs(new)
    stays = stays & (abs(f_new) < abs(fed))  # at an unstable equilibrium
    is_fed = (abs(fed) > 0.5 * abs(f_new)) & (abs(fed) < inf) & (lost > 0.0) & ~stays
    lost = is_fed.select(0.0, lost)
    return {"lost": lost, "changes": is_fed.select(1.0, changes), "left": larger(lost, left)}


@scalar_kernel
def WATCHES(x, new, f_new, fed, signed, inverse, rtol, many, keeps, lost, watches, grows, below):
    """Return `lost`, RELATIVE for an alarm, and `watches`, more than 0 if digits are lost.

    `watches` is infinite for an alarm. Of components below their allowed errors, `grows` is 1 if
    one grows by more than exp(LONG) in such a step, and `below` is their largest `lost`.
    """
    size, signed = abs(new) * inverse, (new < 0.0).select(-signed, signed)
    is_deep = (size > 1.0) & (lost > larger(DEEP, 100.0 * rtol))
    is_deep = is_deep & (keeps * signed * f_new > 0.0)  # steps of a decay may rise by chance
    is_grown = (abs(new) >= abs(x)) & ((lost * size > many) | is_deep)
    is_fast = (lost > 0.0) & (size < 1.0) & (signed * (f_new - fed) > LONG * abs(new))
    return {
        "lost": is_grown.select(RELATIVE, lost),
        "watches": is_grown.select(inf, larger(lost, watches)),
        "grows": is_fast.select(1.0, grows),
        "below": (size < 1.0).select(larger(lost, below), below),
    }


@scalar_kernel
def GROWS(value, f, fed, signed, least, grow, fall):
    """Return `value`, of a member of a group, less if it does not grow; count it in `grow`, `fall`.

    f is its rate in the group, `fed` the same without the group, `signed` the length of the step.
    """
    is_in, grows = value > 0.0, signed * (f - fed) > least * value
    return {
        "value": grows.select(value, LESS * value),
        "grow": grow + (is_in & grows).select(1.0, 0.0),
        "fall": fall + (is_in & ~grows).select(1.0, 0.0),
    }


@scalar_kernel
def RAISED(before, new, some, lost):
    """Return `lost` after an event has moved a component from `before` to `new`."""
    now = (abs(new) > abs(before)).select(lost * abs(before / new), lost)
    return {"lost": (lost > 0.0).select((now > some).select(now, 0.0), lost)}


def watch(code, loses):
    """Update `lost` and `watches` after a step; `loses` is 1 where a component loses digits."""
    text, line, work, D = code.text, code.line, code.work, code.f.of.D
    accepted = (work.accepted[0] > 0.0) & (line.watches[0] < inf)
    loses = accepted & (loses > 0.0)
    with text.when(loses.any(), likely=False):
        found = Carried(watches=line.watches[0])
        for i in text.each(D, found):
            own = code.apply(LOST, i, **vars(found))
            line.lost.choose(loses, i, own.pop("lost"))
            found.update(own)
        line.watches.choose(loses, 0, found.watches)
    is_implicit = code.integrator.is_implicit  # if not, `RISES` is 0 below this
    least = 0.0 if is_implicit else PART * code.number("many") * code.number("rtol")
    looks = accepted & (line.watches[0] > least)
    with text.when(looks.any(), likely=False):
        if not is_implicit:
            found = code.reduce(RISES, rises=0.0, count=D)
            looks = looks & (found.rises > 0.0)
        with text.when(looks.any(), likely=False):
            _look(code, looks)


def _look(code, looks):
    """Find which components are fed, and whether there is an alarm, in lanes `looks`."""
    text, line, work, D = code.text, code.line, code.work, code.f.of.D
    text.copy(work.new, work.start, code.D)
    for now in text.rounds(Carried()):
        for i in text.each(D):
            work.start[i] = code.apply(KNOWN, i)["known"]
        code.call("f", work.start, code.table, work.f)
        found = Carried(changes=0.0, left=0.0)
        for i in text.each(D, found):
            own = code.apply(FED, i, fed=work.f[i], **vars(found))
            line.lost.choose(looks, i, own.pop("lost"))
            found.update(own)
        line.watches.choose(looks, 0, found.left)
        now.goes_on = (looks & (found.changes > 0.0) & (found.left > 0.0)).any()
    looks = looks & (line.watches[0] > 0.0)
    with text.when(looks.any()):
        _alarm(code, looks)


def _alarm(code, looks):
    """Find whether there is an alarm, in lanes `looks`; row `f` is f without lost components."""
    text, line, work, D = code.text, code.line, code.work, code.f.of.D
    found = Carried(watches=0.0, grows=0.0, below=0.0)
    for i in text.each(D, found):
        own = code.apply(WATCHES, i, fed=work.f[i], **vars(found))
        line.lost.choose(looks, i, own.pop("lost"))
        found.update(own)
    line.watches.choose(looks, 0, found.watches)
    least = code.number("many") * code.number("rtol")
    if code.integrator.is_implicit:
        waits = (found.watches > least) | (found.below > PART * least)
    else:
        waits = (found.watches > least) & (found.grows > 0.0)
    waits = looks & waits & (found.watches < inf)
    with text.when(waits.any(), likely=False):
        _find_group(code, waits)


def _find_group(code, looks):
    """Set `watches` to infinity in lanes `looks` with a group of components that would grow."""
    text, line, work, D = code.text, code.line, code.work, code.f.of.D
    known, group = work.start, work.a
    least = text.value(NEXT if code.integrator.is_implicit else LONG)
    for i in text.each(D):
        is_in = looks & (line.lost[i] > 0.0)
        group[i] = is_in.select(1.0 / work.inverse[i], 0.0)
    found = Carried(grow=0.0, rounds=0.0, differs=1.0)
    for now in text.rounds(found):
        sums = Carried(grow=0.0, fall=0.0)
        text.copy(work.new, work.b, code.D)
        for i in text.each(D):
            work.b[i] = known[i] + group[i]
        code.call("f", work.b, code.table, work.f_last)
        for i in text.each(D, sums):
            inputs = {"value": group[i], "f": work.f_last[i], "fed": work.f[i], "least": least}
            own = code.apply(GROWS, i, **inputs, **vars(sums))
            group.choose(now.differs > 0.0, i, own["value"])  # other lanes are done
            sums.grow, sums.fall = own["grow"], own["fall"]
        differs = (now.differs > 0.0) & (sums.grow > 0.0) & (sums.fall > 0.0)
        grow = (sums.fall > 0.0).select(0.0, sums.grow)
        now.grow = (now.differs > 0.0).select(grow, now.grow)
        now.differs, now.rounds = differs.select(1.0, 0.0), now.rounds + 1.0
        now.goes_on = (differs & (now.rounds < ROUNDS)).any()
    sounds = looks & (found.grow > 0.0)
    line.watches.choose(sounds, 0, inf)
    for i in text.each(D):
        line.lost.choose(sounds & (group[i] > 0.0), i, RELATIVE)


def sound(code):
    """End the trajectories of lanes that have an alarm."""
    line, acts = code.line, code.number("acts") > 0.0
    watches = line.watches[0] > 0.0
    with code.text.when(watches.any(), likely=False):
        ends = line.state[0].equals(float(LaneState.ENDED)) | line.watches[0].equals(inf)
        line.state.choose(acts & watches & ends, 0, float(LaneState.AGAIN))
