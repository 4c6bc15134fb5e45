"""The text of the machine code of an integrator: a loop of steps (`step`) of lines of lanes.

`codegen` has the arrays that all parts read and write, and `llvm.text` the operations.
"""

from ..llvm.text import Carried, Code
from .branch_choice import add_branches
from .codegen import StepCode
from .dense_output import add_between
from .event_actions import add_actions
from .gragg import ExplicitColumns
from .growing_components import add_watch
from .lanes import pause_if_spent, take_next
from .linearly_implicit import ImplicitColumns
from .step import take_step
from .step_length import choose_length
from .stormer import StormerColumns


def text_of_integrator(integrator, name, W, for_each):
    """Return LLVM's text of an `Integrator` for W lanes: a function i64 name(arguments).

    Its argument is the address of `CodeArguments`. The function takes all steps with this
    integrator, and returns 1; or 0 if the budget of steps is spent, and the next call continues. If
    `for_each` is True, each lane has its own table.
    """
    text = Code(W)
    for key, function in integrator.functions.items():
        function.add(text, f"{name}_{key}", for_each)
    explicit = StormerColumns if integrator.sets else ExplicitColumns
    columns = ImplicitColumns if integrator.is_implicit else explicit
    columns(text, integrator, name, for_each).add()
    add_watch(text, integrator, name, for_each)
    if integrator.f.branches:
        add_branches(text, integrator, name, for_each)
    if integrator.events:
        add_actions(text, integrator, name, for_each)
    if not integrator.is_implicit:
        add_between(text, integrator, name, for_each)
    text.begin(name, "arguments")
    code = StepCode(text, integrator, name, for_each)
    taken = code.work.taken
    for now in text.rounds(Carried()):
        if integrator.events:  # trajectories that end at time 0 have records, and take no step
            pause_if_spent(code)
        choose_length(code)
        free = ~(taken[0] > 0.0)
        with text.when(free.any(), likely=False):
            take_next(code, free.bits())
            choose_length(code)
        is_active = taken[0] > 0.0
        with text.when(is_active.any(), likely=True):
            if not integrator.events:
                pause_if_spent(code)
            take_step(code)
        now.goes_on = code.has_trajectories()
    text.add("  ret i64 1")
    return text.finished()
