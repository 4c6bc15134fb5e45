"""The text of the machine code of a half of the motion: steps of lines of lanes.

The two halves share everything but their columns and the rule for the next step:

    vector_functions                    f, f', elimination, products, as functions of rows
    gragg, stormer, linearly_implicit   the function `columns` of a half
    lanes                               which trajectory a lane takes next
    step                                a step of all lanes, with `tolerance`, `second_trial`,
                                        `step_length`, `dense_output`, `event_location`,
                                        `branch_choice` and `event_actions`
    scalar_kernels                      lists of operations that decide, on the numbers of one lane
    codegen                             the arrays that all of these read and write, by name

`llvm.text` has the words in which they are written.
"""

from ..llvm.text import Carried, Code
from .branch_choice import add_choices
from .codegen import Lines
from .dense_output import add_between
from .event_actions import add_change
from .gragg import ExplicitColumns
from .lanes import pause_if_spent, take_next
from .linearly_implicit import ImplicitColumns
from .step import take_step
from .step_length import choose_length
from .stormer import StormerColumns


def text_of_half(half, name, W, for_each):
    """Return the text of i64 name(arguments), see `Arguments`, for a `Half`.

    It takes steps of all trajectories in this half and returns 1; or 0 when the budget is spent, to
    go on in the next call. A lane whose trajectory ends takes the next one.
    """
    text = Code(W)
    for key, function in half.functions.items():
        function.add(text, f"{name}_{key}", for_each)
    explicit = StormerColumns if half.sets else ExplicitColumns
    columns = ImplicitColumns if half.is_implicit else explicit
    columns(text, half, name, for_each).add()
    if half.f.conditions:
        add_choices(text, half, name, for_each)
    if half.changes:
        add_change(text, half, name, for_each)
    if not half.is_implicit:
        add_between(text, half, name, for_each)
    text.begin(name, "arguments")
    lines = Lines(text, half, name, for_each)
    taken = lines.work.taken
    for now in text.rounds(Carried()):
        if half.changes:  # trajectories that end at time 0 have records, and take no step
            pause_if_spent(lines)
        choose_length(lines)
        free = ~(taken[0] > 0.0)
        with text.when(free.any(), likely=False):
            take_next(lines, free.bits())
            choose_length(lines)
        is_active = taken[0] > 0.0
        with text.when(is_active.any(), likely=True):
            if not half.changes:
                pause_if_spent(lines)
            take_step(lines)
        now.goes_on = lines.has_trajectories()
    text.add("  ret i64 1")
    return text.finished()
