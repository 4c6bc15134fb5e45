"""A step of all lanes of a line: the next state, and whether it is taken.

From the ends y_c of columns, with weights (`weights`),

x_next = x + sum_c w_c (y_c - x),     e = sum_c (w_c - v_c) (y_c - x),

where v_c are the weights without the first column. The step is taken if

max_i |e_i| / allowed_i <= 1,     max_i |d_i| / allowed_i <= MOST_APART,

where d = sum_c w_c (a_c - b_c) or 0, see `gragg`, or what `linearly_implicit` says. `tolerance`
says what is allowed, and `step_length` how long the next step is and which half takes it. Lanes
that take no step in this half have length 0 and stay as they are.
"""

from ..llvm.text import Carried
from . import (
    branch_choice,
    dense_output,
    event_actions as changes,
    event_location,
    growing_components,
    second_trial,
    step_length,
    tolerance,
)
from .codegen import weighted
from .linearly_implicit import derive, find_apart
from .scalar_kernels import rule
from .weights import EXPLICIT, IMPLICIT, weights, weights_of_errors


@rule
def KEPT(x, new, keeps, kept, extra, rtol, size):
    """Return whether all components have their sign that have one to keep; `new` gets it back.

    A component that has decayed below its tolerance may have any sign after a long step.
    """
    changes = ((x < 0.0) & (new > 0.0)) | ((x > 0.0) & (new < 0.0))
    changes = changes & (keeps > 0.0)
    is_large = abs(new) > extra + rtol * size
    return {"kept": (changes & is_large).select(0.0, kept), "new": changes.select(-new, new)}


@rule
def CLOCK(x, new, f, signed, steady):
    """A component at the end of a step; of a constant rate x + h x', which columns round more."""
    return {"new": (steady > 0.0).select(x + signed * f, new)}


@rule
def SAME_SIGN(x, new, kept):
    """Return whether a denominator that depends on clocks alone has kept its sign."""
    changes = ((x < 0.0) & (new > 0.0)) | ((x > 0.0) & (new < 0.0))
    return {"kept": changes.select(0.0, kept)}


def take_step(lines):
    """Take a step in the lanes that do so."""
    text, half, line, work = lines.text, lines.half, lines.line, lines.work
    columns, p = (IMPLICIT, 1) if half.is_implicit else (EXPLICIT, 2)
    own, of_error = weights(columns, p), weights_of_errors(columns, p)
    if half.sets:
        of_error = [tolerance.CAUTION * w for w in of_error]
    rate = derive(lines) if half.is_implicit else None
    lines.columns(line.x, line.f, len(columns))
    if half.is_implicit and half.looks_inside:  # shorter steps overwrite them
        text.copy(work.nodes.after(3 * lines.D), work.nodes, 3 * lines.D)
    kept, sizes = _next_states(lines, own, of_error)
    if half.is_implicit:
        find_apart(lines)
    sums = tolerance.find_errors(lines, own, sizes)
    if half.sets:
        sums["apart"] = tolerance.apart_of_rough(lines, own)
        sums |= tolerance.differences_of_sets(lines)
    sums |= {"on_trial": text.value(0.0), "of_length": sums["ratio"]}
    sums |= second_trial.try_again(lines, own, of_error, sums)
    if half.is_implicit and lines.f.entries:
        least = growing_components.longest_step(lines)
        kept = (work.taken[0] > least).select(0.0, kept)
    sums |= {"kept": kept, "taken": work.taken[0], "rate": rate, **lines.near()}
    before = line.t[0]
    found = lines.apply(step_length.AFTER, **sums, **lines.goal())
    sums["accepted"], served = found.pop("accepted"), found.pop("served")
    lines.keep(work, {"accepted": sums["accepted"], "served": served, "t": before})
    if half.changes:
        own = {"before": line.wanted[0], "state_before": line.state[0]}
        own |= {name: found[name] for name in ("t", "wanted", "state")}
        found |= lines.apply(step_length.AT_STOP, accepted=sums["accepted"], **own)
    lines.keep(line, found)
    if half.sets:
        lines.keep(line, lines.apply(step_length.REFUSALS, ratio=sums["ratio"]))
    if half.is_implicit:
        lines.keep(line, lines.apply(step_length.TURN_IMPLICIT, **sums))
    else:
        looks = lines.apply(step_length.LOOKS, **sums)["looks"]
        with text.when(looks.any(), likely=False):
            lines.keep(line, lines.apply(step_length.TURN_EXPLICIT, **sums))
    if half.watched:
        event_location.cut(lines, before, sums["total"])
    dense_output.save_states(lines)
    if half.kinks:
        branch_choice.choose(lines)
    growing_components.watch_small(lines, sums["fallen"])
    if half.changes:
        changes.change(lines)
        dense_output.save_at_end(lines)
    if lines.f.conditions:
        branch_choice.renew(lines)
    move(lines)


def _next_states(lines, own, of_error):
    """Write the next states, f there, and errors; return which are kept, and sizes of parts."""
    text, half, line, work = lines.text, lines.half, lines.line, lines.work
    sums, sizes = Carried(**dict.fromkeys(half.largest.results, 0.0), kept=1.0), []
    for first, count in half.parts:
        for i in text.each(count, sums):
            i = i + first
            x, ends = line.x[i], lines.of_columns(work.ends, i)
            new = x + weighted(own, ends)
            if lines.f.steady:
                signed = {"f": line.f[i], "signed": work.signed[0]}
                new = lines.apply(CLOCK, i, x=x, new=new, **signed)["new"]
            if lines.f.of_one_sign:
                size = abs(x) if half.has_atol else line.largest[i]
                found = lines.apply(KEPT, i, x=x, new=new, kept=sums.kept, size=size)
                new, sums.kept = found["new"], found["kept"]
            work.new.put_chosen(i, new)
            work.error[i] = weighted(of_error, ends)
            sums.update(lines.apply(half.largest, i, **vars(sums) | {"new": new}))
        size = {name: getattr(sums, name) for name in half.largest.results}
        if size:
            smallest = tolerance.SMALLEST if first == 0 else tolerance.SMALLEST_OF_COLUMNS
            size |= lines.apply(tolerance.LEAST_ALLOWED, smallest=smallest, **size)
        sizes.append(size)
    kept = sums.kept
    lines.call("f", work.new, lines.table, work.f_new)
    for k in range(lines.D, lines.extended):  # denominators of clocks
        kept = lines.apply(SAME_SIGN, x=line.f[k], new=work.f_new[k], kept=kept)["kept"]
    return kept, sizes


def move(lines):
    """Move the lanes whose step is taken to their next state."""
    text, line, work = lines.text, lines.line, lines.work
    accepted = work.accepted[0] > 0.0
    for i in text.each(lines.D):
        new = work.new[i]
        line.x.choose(accepted, i, new)
        lines.keep_largest(accepted, i, new)
    for i in text.each(lines.extended):
        line.f.choose(accepted, i, work.f_new[i])
