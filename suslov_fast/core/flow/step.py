"""A step of all lanes of a line: the next state, and whether it is taken.

From the ends y_c of columns, with weights (`weights`),

x_next = x + sum_c w_c (y_c - x),     e = sum_c (w_c - v_c) (y_c - x),

where v_c are the weights without the first column. The step is taken if

max_i |e_i| / allowed_i <= 1,     max_i |d_i| / allowed_i <= MOST_APART,

where d = sum_c w_c (a_c - b_c) or 0, see `gragg`, or what `linearly_implicit` says. `tolerance`
says what is allowed, and `step_length` how long the next step is and which integrator takes it.
Lanes that take no step with this integrator have length 0 and stay as they are.
"""

from ..llvm.text import Carried
from . import (
    branch_choice,
    dense_output,
    event_actions,
    event_location,
    growing_components,
    second_trial,
    step_length,
    tolerance,
)
from .codegen import weighted
from .linearly_implicit import derive, find_apart
from .scalar_kernels import scalar_kernel
from .weights import EXPLICIT, IMPLICIT, weights, weights_of_errors


@scalar_kernel
def KEPT(x, new, keeps, kept, extra, rtol, size):
    """Return whether all components have their sign that have one to keep; `new` gets it back.

    A component that has decayed below its tolerance may have any sign after a long step.
    """
    changes = ((x < 0.0) & (new > 0.0)) | ((x > 0.0) & (new < 0.0))
    changes = changes & (keeps > 0.0)
    is_large = abs(new) > extra + rtol * size
    return {"kept": (changes & is_large).select(0.0, kept), "new": changes.select(-new, new)}


@scalar_kernel
def CLOCK(x, new, f, signed, steady):
    """A component at the end of a step; of a constant rate x + h x', which columns round more."""
    return {"new": (steady > 0.0).select(x + signed * f, new)}


@scalar_kernel
def SAME_SIGN(x, new, kept):
    """Return whether a denominator that depends on clocks alone has kept its sign."""
    changes = ((x < 0.0) & (new > 0.0)) | ((x > 0.0) & (new < 0.0))
    return {"kept": changes.select(0.0, kept)}


def take_step(code):
    """Take a step in the lanes that do so."""
    text, integrator, line, work = code.text, code.integrator, code.line, code.work
    columns, p = (IMPLICIT, 1) if integrator.is_implicit else (EXPLICIT, 2)
    own, of_error = weights(columns, p), weights_of_errors(columns, p)
    if integrator.sets:
        of_error = [tolerance.CAUTION * w for w in of_error]
    rate = derive(code) if integrator.is_implicit else None
    code.columns(line.x, line.f, len(columns))
    if integrator.is_implicit and integrator.looks_inside:  # shorter steps overwrite them
        text.copy(work.nodes.after(3 * code.D), work.nodes, 3 * code.D)
    kept, sizes = _next_states(code, own, of_error)
    if integrator.is_implicit:
        find_apart(code)
    sums = tolerance.find_errors(code, own, sizes)
    if integrator.sets:
        sums["apart"] = tolerance.apart_of_rough(code, own)
        sums |= tolerance.differences_of_sets(code)
    sums |= {"on_trial": text.value(0.0), "of_length": sums["ratio"]}
    sums |= second_trial.try_again(code, own, of_error, sums)
    if integrator.is_implicit and code.f.entries:
        least = growing_components.longest_step(code)
        kept = (work.taken[0] > least).select(0.0, kept)
    sums |= {"kept": kept, "taken": work.taken[0], "rate": rate, **code.near()}
    before = line.t[0]
    found = code.apply(step_length.AFTER, **sums, **code.goal())
    sums["accepted"], served = found.pop("accepted"), found.pop("served")
    code.keep(work, {"accepted": sums["accepted"], "served": served, "t": before})
    if integrator.events:
        own = {"before": line.wanted[0], "state_before": line.state[0]}
        own |= {name: found[name] for name in ("t", "wanted", "state")}
        found |= code.apply(step_length.AT_STOP, accepted=sums["accepted"], **own)
    code.keep(line, found)
    if integrator.sets:
        code.keep(line, code.apply(step_length.REFUSALS, ratio=sums["ratio"]))
    if integrator.is_implicit:
        code.keep(line, code.apply(step_length.TURN_IMPLICIT, **sums))
    else:
        looks = code.apply(step_length.LOOKS, **sums)["looks"]
        with text.when(looks.any(), likely=False):
            code.keep(line, code.apply(step_length.TURN_EXPLICIT, **sums))
    if integrator.watched:
        event_location.cut(code, before, sums["total"])
    dense_output.save_states(code)
    if integrator.kinks:
        branch_choice.choose(code)
    growing_components.watch_small(code, sums["fallen"])
    if integrator.events:
        event_actions.act(code)
        dense_output.save_at_end(code)
    if code.f.conditions:
        branch_choice.renew(code)
    move(code)


def _next_states(code, own, of_error):
    """Write the next states, f there, and errors; return which are kept, and sizes of parts."""
    text, integrator, line, work = code.text, code.integrator, code.line, code.work
    sums, sizes = Carried(**dict.fromkeys(integrator.largest.results, 0.0), kept=1.0), []
    for first, count in integrator.parts:
        for i in text.each(count, sums):
            i = i + first
            x, ends = line.x[i], code.of_columns(work.ends, i)
            new = x + weighted(own, ends)
            if code.f.steady:
                signed = {"f": line.f[i], "signed": work.signed[0]}
                new = code.apply(CLOCK, i, x=x, new=new, **signed)["new"]
            if code.f.of_one_sign:
                size = abs(x) if integrator.has_atol else line.largest[i]
                found = code.apply(KEPT, i, x=x, new=new, kept=sums.kept, size=size)
                new, sums.kept = found["new"], found["kept"]
            work.new.put_chosen(i, new)
            work.error[i] = weighted(of_error, ends)
            sums.update(code.apply(integrator.largest, i, **vars(sums) | {"new": new}))
        size = {name: getattr(sums, name) for name in integrator.largest.results}
        if size:
            smallest = tolerance.SMALLEST if first == 0 else tolerance.SMALLEST_OF_COLUMNS
            size |= code.apply(tolerance.LEAST_ALLOWED, smallest=smallest, **size)
        sizes.append(size)
    kept = sums.kept
    code.call("f", work.new, code.table, work.f_new)
    for k in range(code.D, code.extended):  # denominators of clocks
        kept = code.apply(SAME_SIGN, x=line.f[k], new=work.f_new[k], kept=kept)["kept"]
    return kept, sizes


def move(code):
    """Move the lanes whose step is taken to their next state."""
    text, line, work = code.text, code.line, code.work
    accepted = work.accepted[0] > 0.0
    for i in text.each(code.D):
        new = work.new[i]
        line.x.choose(accepted, i, new)
        code.keep_largest(accepted, i, new)
    for i in text.each(code.extended):
        line.f.choose(accepted, i, work.f_new[i])
