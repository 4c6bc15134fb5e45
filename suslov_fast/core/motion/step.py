"""A step of all lanes of a line: its length, the next state, and whether it is taken.

From the ends y_c of columns, with the weights of `columns`,

x_next = x + sum_c w_c (y_c - x),     e = sum_c (w_c - v_c) (y_c - x),

where v_c are the weights without the first column. The step is taken if

max_i |e_i| / allowed_i <= 1,     max_i |d_i| / allowed_i <= MOST_APART,

where d = sum_c w_c (a_c - b_c) or 0, see `explicit`, or what `implicit` says. `rules` say what is
allowed, how long the next step is, and which half takes it. Lanes that take no step in this half
have length 0 and stay as they are.
"""

from math import inf

import numpy as np

from ..code.text import Carried, Value
from . import changes, choosing, inside, rules, sections, surfaces
from .columns import EXPLICIT, IMPLICIT, weights, weights_of_errors
from .implicit import derive, find_apart
from .scope import weighted
from .stormer import is_rough


def choose_length(lines):
    """Choose the length of the next step in each lane."""
    # An implicit step aside goes to each time, because a fast mode may decay within a step.
    second = np.inf if lines.half.is_implicit else lines.line.second[0]
    inputs = lines.near() | lines.goal()
    found = lines.apply(rules.LENGTH, mode=lines.mode, second=second, **inputs)
    lines.keep(lines.work, found)


def take_step(lines):
    """Take a step in the lanes that do so."""
    text, half, line, work = lines.text, lines.half, lines.line, lines.work
    columns, p = (IMPLICIT, 1) if half.is_implicit else (EXPLICIT, 2)
    own, of_error = weights(columns, p), weights_of_errors(columns, p)
    if half.sets:
        of_error = [rules.CAUTION * w for w in of_error]
    rate = derive(lines) if half.is_implicit else None
    lines.columns(line.x, line.f, len(columns))
    if half.is_implicit and half.looks_inside:  # shorter steps overwrite them
        text.copy(work.nodes.after(3 * lines.D), work.nodes, 3 * lines.D)
    kept, sizes = _next_states(lines, own, of_error)
    if half.is_implicit:
        find_apart(lines)
    sums = _errors(lines, own, sizes)
    if half.sets:
        sums["apart"] = _apart_of_rough(lines, own)
        sums |= _differences_of_sets(lines)
    sums |= {"on_trial": text.value(0.0), "of_length": sums["ratio"]}
    sums |= _second_trial(lines, own, of_error, sums)
    sums |= {"kept": kept, "taken": work.taken[0], "rate": rate, **lines.near()}
    before = line.t[0]
    found = lines.apply(rules.AFTER, **sums, **lines.goal())
    sums["accepted"], served = found.pop("accepted"), found.pop("served")
    lines.keep(work, {"accepted": sums["accepted"], "served": served, "t": before})
    if half.changes:
        own = {"before": line.wanted[0], "state_before": line.state[0]}
        own |= {name: found[name] for name in ("t", "wanted", "state")}
        found |= lines.apply(rules.AT_STOP, accepted=sums["accepted"], **own)
    lines.keep(line, found)
    if half.sets:
        lines.keep(line, lines.apply(rules.REFUSALS, ratio=sums["ratio"]))
    if half.is_implicit:
        lines.keep(line, lines.apply(rules.TURN_IMPLICIT, **sums))
    else:
        looks = lines.apply(rules.LOOKS, **sums)["looks"]
        with text.when(looks.any(), likely=False):
            lines.keep(line, lines.apply(rules.TURN_EXPLICIT, **sums))
    if half.watched:
        surfaces.cut(lines, before, sums["total"])
    inside.save_states(lines)
    if half.changes and half.changes.sections:
        sections.find_crossings(lines)  # by the choices of the step
    if half.kinks:
        choosing.choose(lines)
    if half.low:
        _watch_small(lines)
    if half.changes:
        changes.change(lines)
        inside.save_at_end(lines)
    if lines.f.conditions:
        choosing.renew(lines)
    move(lines)


def _next_states(lines, own, of_error):
    """Write the next states, f there, and errors; return which are kept, and sizes of parts."""
    text, half, line, work = lines.text, lines.half, lines.line, lines.work
    names = [*half.largest.results] + (["fallen"] if half.low else [])
    sums, sizes = Carried(**dict.fromkeys(names, 0.0), kept=1.0), []
    for first, count in half.parts:
        for i in text.each(count, sums):
            i = i + first
            x, ends = line.x[i], lines.of_columns(work.ends, i)
            new = x + weighted(own, ends)
            if lines.f.clocks:
                signed = {"f": line.f[i], "signed": work.signed[0]}
                new = lines.apply(rules.CLOCK, i, x=x, new=new, **signed)["new"]
            if lines.f.of_one_sign:
                size = abs(x) if half.has_atol else line.largest[i]
                found = lines.apply(rules.KEPT, i, x=x, new=new, kept=sums.kept, size=size)
                new, sums.kept = found["new"], found["kept"]
            work.new.put_chosen(i, new)
            work.error[i] = weighted(of_error, ends)
            sums.update(lines.apply(half.largest, i, **vars(sums) | {"new": new}))
            if half.low and first == 0:
                sums.update(lines.apply(rules.FALLEN, i, new=new, fallen=sums.fallen))
        size = {name: getattr(sums, name) for name in half.largest.results}
        if size:
            smallest = rules.SMALLEST if first == 0 else rules.SMALLEST_OF_COLUMNS
            size |= lines.apply(rules.LEAST_ALLOWED, smallest=smallest, **size)
        sizes.append(size)
    kept = sums.kept
    if half.low:
        work.fallen[0] = sums.fallen
    lines.call("f", work.new, lines.table, work.f_new)
    for k in range(lines.D, lines.extended):  # denominators of clocks
        kept = lines.apply(rules.SAME_SIGN, x=line.f[k], new=work.f_new[k], kept=kept)["kept"]
    return kept, sizes


def _errors(lines, own, sizes):
    """Return sums over components: the largest ratio of an error by what is allowed, and others.

    The inverse of what is allowed takes the place of the error.
    """
    text, half, work = lines.text, lines.half, lines.work
    names = ["ratio", "total", "apart"] + ([] if half.is_implicit else ["rates", "states"])
    names += [] if half.has_atol else ["large"]
    sums, taken = Carried(**dict.fromkeys(names, 0.0)), work.taken[0]
    for (first, count), of_part in zip(half.parts, sizes, strict=True):
        for i in text.each(count, sums):
            i, inputs = i + first, dict(of_part)
            if half.has_atol:
                inputs["noise"] = _noise(lines, own, i)
            inverse = lines.apply(half.allowed, i, **inputs)["inverse"]
            found = lines.apply(rules.RATIO, i, inverse=inverse, **vars(sums))
            if not half.has_atol:
                own_sums = {"inverse": inverse, "large": sums.large, "noisy": of_part["noisy"]}
                found |= lines.apply(rules.LARGE, i, **own_sums)
            if not (half.is_implicit or half.sets):
                inputs = {"last": work.a[i], "inverse": inverse, "taken": taken}
                found |= lines.apply(rules.DIFFERENCES, i, **vars(sums) | inputs)
            if not half.sets:
                inputs = {"error": _apart(lines, own, i), "inverse": inverse, "ratio": sums.apart}
                found["apart"] = lines.apply(rules.LARGER_RATIO, **inputs)["ratio"]
            sums.update(found)
            work.error[i] = inverse
    return vars(sums)


def _differences_of_sets(lines):
    """Return products of the sums of `DIFFERENCES` of both sets, and the limit for their quotient.

    That does not depend on how large components of either are allowed to be.
    """
    text, work, sums = lines.text, lines.work, []
    for components in lines.half.sets:
        own = Carried(rates=0.0, states=0.0)
        for i in text.listed(components)(own):
            inputs = {"last": work.a[i], "inverse": work.error[i], "taken": work.taken[0]}
            own.update(lines.apply(rules.DIFFERENCES, i, **vars(own) | inputs))
        sums.append(own)
    A, B = sums
    limit = lines.number("limit")
    return {"rates": A.rates * B.rates, "states": A.states * B.states, "limit": limit * limit}


def _second_trial(lines, own, of_error, sums):
    """Return ratios, those of a second trial where there is one (see `rules`), and 1 there."""
    text, line, work, half = lines.text, lines.line, lines.work, lines.half
    again = text.value(rules.AFTER_TRIAL) >= line.longer[0]
    refused = (sums["ratio"] > 1.0) | (sums["apart"] > rules.MOST_APART)
    is_finite = sums["total"] < inf
    refused = tried = refused & is_finite & again
    if not half.has_atol:
        is_noisy = lines.apply(rules.IS_NOISY, **sums)["is_noisy"]
        tried = refused | (is_noisy > 0.0) & is_finite
    names = ["ratio", "of_length", "apart", "on_trial"] + ([] if half.is_implicit else ["rates"])

    def trial():
        if half.is_implicit:
            text.copy(work.right, work.b, lines.D)
        top = Carried(top=0.0)
        for i in text.each(lines.D, top):
            top.top = lines.apply(rules.TOP, i, top=top.top)["top"]
        others = Carried(large=0.0)
        for i in text.each(lines.D, others):
            inputs = {"error": weighted(of_error, lines.of_columns(work.ends, i))}
            inputs |= {"inverse": work.error[i], "noisy": rules.NOISY * top.top}
            others.large = lines.apply(rules.LARGE, i, large=others.large, **inputs)["large"]
        least, largest, second = _changes_beside(lines, tried & (others.large < sums["ratio"]))
        found = Carried(ratio=0.0, of_length=0.0, of_apart=0.0)
        for i in text.each(lines.D, found):
            apart = work.b[i] if half.is_implicit else _apart(lines, own, i)
            inputs = {"error": weighted(of_error, lines.of_columns(work.ends, i)), "apart": apart}
            inputs |= {"inverse": work.error[i], "least": least[i], "largest": largest[i]}
            inputs |= {"second": second[i], "top": top.top}
            inputs |= {"t": line.t[0], "taken": work.taken[0]}
            inputs["grows"] = rules.GROWS[half.is_implicit]
            now = lines.apply(rules.SECOND, i, **inputs, **vars(found))
            work.error.choose(tried, i, now.pop("inverse"))
            found.update(now)
        # Rounding, if it decides, does not make equations stiff: rates are 0.
        counts = refused | tried & (found.of_length < sums["ratio"])
        others = found.ratio, found.of_length, found.of_apart, text.value(1.0), text.value(0.0)
        pairs = zip(names, others, strict=False)
        return [counts.select(value, sums[name]) for name, value in pairs]

    found = text.otherwise(~tried.any(), [sums[name] for name in names], trial)
    return {name: Value(text, value) for name, value in zip(names, found, strict=True)}


def _changes_beside(lines, is_noise):
    """Return arrays of changes of f beside points of the step, see `rules.BESIDE_POINTS`.

    Lanes whose error may be noise look at all points and states beside them, others at one state
    beside each end.
    """
    text, line, work, half = lines.text, lines.line, lines.work, lines.half
    change = work.right if half.is_implicit else work.f
    parts, firsts = map(text.constants, (rules.BESIDES, rules.FIRST))
    along, ends = map(text.constants, (rules.ALONG, rules.ENDS))
    base, state, most, *found = (work.beside.after(k * lines.extended) for k in range(6))
    least, largest, second = found
    for i in text.each(lines.D):
        least[i], largest[i], second[i] = inf, 0.0, 0.0
    points = is_noise.any().select(text.value(len(rules.ALONG)), text.value(2))
    samples = is_noise.any().select(text.value(len(rules.BESIDES)), text.value(1))
    for point in text.each(points, most=0):
        for i in text.each(lines.D):
            on_line = lines.apply(rules.ON_LINE, i, x=line.x[i], u=along[point])
            state.put_chosen(i, on_line["point"])
            most[i] = 0.0
        lines.call("f", state, lines.table, base)
        for k in text.each(samples, most=0):
            counts = is_noise | (ends[point] * firsts[k] > 0.0)
            for i in text.each(lines.D):
                of_line = {"t": line.t[0], "x": line.x[i], "f": line.f[i], "state": state[i]}
                of_line |= {"part": parts[k], "is_end": ends[point]}
                work.start.put_chosen(i, lines.apply(rules.BESIDE, i, **of_line)["beside"])
            lines.call("f", work.start, lines.table, work.f)
            for i in text.each(lines.D):
                change.put_chosen(i, work.f[i] - base[i])
            if half.is_implicit:
                lines.call("solve", work.factors, lines.table, change)
            for i in text.each(lines.D):
                of_lane = {"change": counts.select(change[i], 0.0), "most": most[i]}
                most.put_chosen(i, text.apply(rules.MOST, **of_lane)["most"])
        for i in text.each(lines.D):
            of_point = {"most": most[i], "least": least[i], "largest": largest[i]}
            of_point |= {"second": second[i], "is_end": ends[point]}
            now = text.apply(rules.BESIDE_POINTS, **of_point)
            for array, name in zip(found, ("least", "largest", "second"), strict=True):
                array.put_chosen(i, now[name])
    return found


def _apart(lines, own, i):
    """Return what shows in component i that all columns agree on a false end."""
    if lines.half.is_implicit:
        return lines.work.right[i]
    apart = weighted(own, lines.of_columns(lines.work.apart, i))
    if lines.half.sets:
        return is_rough(lines.work, lines.half).select(apart, 0.0)
    return apart


def _apart_of_rough(lines, own):
    """Return what `_errors` has of `apart`, after it, of rough lanes, which alone have that."""
    text, work = lines.text, lines.work

    def largest():
        found = Carried(ratio=0.0)
        for i in text.each(lines.D, found):
            inputs = {"error": _apart(lines, own, i), "inverse": work.error[i]}
            found.update(lines.apply(rules.LARGER_RATIO, **inputs, **vars(found)))
        return [found.ratio]

    is_smooth = ~is_rough(work, lines.half).any()
    (found,) = text.otherwise(is_smooth, [text.value(0.0)], largest)
    return Value(text, found)


def _noise(lines, own, i):
    """Return the sum of moduli of what is added up for the next state."""
    ends = lines.of_columns(lines.work.ends, i)
    return weighted([abs(factor) for factor in own], [abs(end) for end in ends])


def _watch_small(lines):
    """Note which components have fallen below what is allowed, and grown again."""
    text, line, work = lines.text, lines.line, lines.work
    accepted = work.accepted[0] > 0.0
    looks = accepted & ((work.fallen[0] > 0.0) | (line.watches[0] > 0.0))
    with text.when(looks.any(), likely=False):
        largest = Carried(watches=0.0)
        for i in text.each(lines.half.low, largest):
            inputs = {"inverse": work.error[i], "watches": largest.watches}
            found = lines.apply(rules.LOW, i, **inputs)
            line.low.choose(accepted, i, found["low"])
            largest.watches = found["watches"]
        line.watches.choose(accepted, 0, largest.watches)


def move(lines):
    """Move the lanes whose step is taken to their next state."""
    text, line, work = lines.text, lines.line, lines.work
    accepted = work.accepted[0] > 0.0
    for i in text.each(lines.D):
        new, largest = work.new[i], line.largest[i]
        line.x.choose(accepted, i, new)
        modulus = abs(new)
        line.largest.choose(accepted, i, (modulus > largest).select(modulus, largest))
    for i in text.each(lines.extended):
        line.f.choose(accepted, i, work.f_new[i])
