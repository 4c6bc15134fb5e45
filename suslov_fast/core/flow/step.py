"""The step: from x to the next state x_next, a length h later, or to a shorter length.

1. Columns. Column c takes N_c sub-steps of the length h / N_c, and ends at y_c (`gragg`, `stormer`,
   and `linearly_implicit`, which computes f' first).

2. Extrapolation with the weights w_c (`weights`, `next_state`):

       x_next = x + sum_c w_c (y_c - x),     f_next = f(x_next).

3. Error estimate, where v_c are the weights without the first column (`allowed_errors`,
  `second_trial`):

       e = sum_c (w_c - v_c) (y_c - x),     ratio = max_i |e_i| / allowed_i.

   All columns may agree on a wrong end. A sum d, which is 0 up to the error otherwise, shows this:
   for `gragg` d = sum_c w_c (a_c - b_c), with the last values of the sequences a and b in column c.
   The largest |d_i| / allowed_i is `apart`.

4. Acceptance and step-length rule (`step_length`). The step is accepted if

       ratio <= 1,     apart <= MOST_APART,

   f_next is finite, and components keep the signs that the equations keep. Accepted or not,

       h_next = 0.75 ratio**(-1 / power) h,     power = order - 1 in explicit steps, else 9.

5. Choice of the explicit or the implicit integrator for the next step (`step_length`).

6. Event cut (`events.location`): if a surface is crossed, the step is refused, and h_next leads to
   the surface, until a step ends there.

7. Output at the times that the step has passed (`dense_output`), actions of events at its end
   (`events.actions`), and new branches of f (`events.branch_choice`).

8. x = x_next, f(x) = f_next, where the step is accepted.

The code works on a vector of lanes, with a trajectory in each. Lanes without a step of this
integrator have h = 0.
"""

from math import inf

from . import (
    allowed_errors,
    dense_output,
    growing_components,
    projected_states,
    second_trial,
    step_length,
)
from .codegen import larger_of
from .events import actions, branch_choice, location
from .next_state import find_next_state, move


def take_step(code):
    """Add a step to a function `code` (`StepCode`), for lanes where the row `taken` is not 0."""
    integrator = code.integrator
    found = integrator.rule.find_columns(code)
    kept, sizes = find_next_state(code)
    errors = _estimate_errors(code, kept, sizes) | found | step_length.limits_of(code)
    before = code.line.t[0]
    _accept(code, errors, before)
    integrator.rule.turn(code, errors)
    if integrator.D_of_surfaces:
        location.cut(code, before, errors["total"])
    growing_components.watch_digits(code, errors["alerts"], errors["on_trial"])
    dense_output.save_states(code)
    if integrator.kinks:
        branch_choice.choose(code)
    if integrator.f.hybrid.acts:
        actions.act(code)
        dense_output.save_at_end(code)
    if code.f.hybrid.chooses:
        branch_choice.renew(code)
    growing_components.sound(code)
    step_length.count(code)
    projected_states.note(code)
    move(code)


def _estimate_errors(code, kept, sizes):
    """Return inputs of `step_length.after` by name, such as `ratio`, the error / allowed error.

    `kept` and `sizes` are results of `find_next_state`.
    """
    rule = code.integrator.rule
    rule.begin_errors(code)
    errors = allowed_errors.find_errors(code, sizes)
    errors |= rule.end_errors(code, errors)
    # `on_trial` is 1 after a second trial; `of_length` is the ratio that gives the next length.
    errors |= {"on_trial": code.text.value(0.0), "of_length": errors["ratio"]}
    errors |= second_trial.try_again(code, errors)
    return errors | {"kept": kept, "taken": code.work.taken[0]}


def _accept(code, errors, t):
    """Decide which lanes accept the step, also in `errors`, and how long the next step is."""
    line, work = code.line, code.work
    rule = code.integrator.rule
    kernel = step_length.after(rule.power, rule.predicts)
    found = code.apply(kernel, **errors, last=code.goal())
    if code.f.of_x.regular:
        found["wanted"] = (errors["kept"] < 0.0).select(0.0, found["wanted"])
    errors["accepted"], served = found.pop("accepted"), found.pop("served")
    code.keep(work, {"accepted": errors["accepted"], "served": served, "began": t})
    if code.f.hybrid.acts:  # a step cut at an event's given time does not shorten the next step
        is_there = (errors["accepted"] > 0.0) & (found["t"] >= line.stop[0])
        wanted = larger_of(found["wanted"], line.wanted[0])
        found["wanted"] = is_there.select(wanted, found["wanted"])
        is_before = found["t"] < code.number("last")
        found["state"] = is_before.select(line.state[0], found["state"])
    code.keep(line, found)
    if code.integrator.rule.interpolates:
        # If f has no value at the end of a step aside, a later step passes that time.
        misses = (work.taken[0] * work.aside[0] > 0.0) & ~(errors["total"] < inf)
        with code.text.when(misses.any(), likely=False):
            line.second.choose(misses, 0, line.next[0])
