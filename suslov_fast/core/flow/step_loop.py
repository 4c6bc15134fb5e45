"""The text of the machine code of an integrator: a loop of steps (`step`) of lines of lanes.

`codegen` has the arrays that all parts read and write, and `llvm.text` the operations. Parts that
most steps skip are functions of their own: LLVM's time grows faster than the length of a function.
"""

from ..llvm.text import Carried, Code
from . import dense_output, growing_components
from .codegen import StepCode
from .events import actions, branch_choice
from .lanes import begin_together, begin_waiting, pause_if_spent, take_next
from .step import take_step
from .step_length import choose_length


def text_of_integrator(integrator, name, W, for_each):
    """Return LLVM's text of an `Integrator` for W lanes: a function i64 name(arguments).

    Its argument is the address of `CodeArguments`. The function takes all steps with this
    integrator, and returns 1; or 0 if the budget of steps is spent, and the next call continues. If
    `for_each` is True, each lane has its own table.
    """
    text = Code(W)
    for key, function in integrator.functions.items():
        function.add(text, f"{name}_{key}", for_each)
    integrator.rule.add(text, integrator, name, for_each)
    parts = {"small": growing_components.find_alarms}
    if integrator.f.hybrid.chooses:
        parts["choose"] = branch_choice.choose_branches
    if integrator.f.hybrid.acts:
        parts["change"] = actions.change
        if integrator.events.modes:
            parts["settle"] = actions.settle
    if integrator.rule.interpolates:
        parts["between"] = dense_output.save_between
    if begin_together(text, integrator):
        parts["begin"] = begin_waiting
    for part, add in parts.items():
        with text.function(f"{name}_{part}", ("arguments",)):
            add(StepCode(text, integrator, name, for_each))
    text.begin(name, "arguments")
    code = StepCode(text, integrator, name, for_each)
    taken = code.work.taken
    for now in text.rounds(Carried()):
        if integrator.f.hybrid.acts:  # events at time 0 fill the buffer of records without a step
            pause_if_spent(code)
        choose_length(code)
        free = ~(taken[0] > 0.0)
        with text.when(free.any(), likely=False):
            take_next(code, free.bits())
            choose_length(code)
        is_active = taken[0] > 0.0
        with text.when(is_active.any(), likely=True):
            if not integrator.f.hybrid.acts:
                pause_if_spent(code)
            take_step(code)
        now.goes_on = code.has_trajectories()
    text.add("  ret i64 1")
    return text.finished()
