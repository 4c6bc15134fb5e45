"""Machine code of what follows a whole step of several stages.

And the arguments of the code, see `generated`.
"""

from typing import NamedTuple

from ..code.compiler import pointer
from ..compiling.codes import CHANGED
from ..lists.step import SIGNIFICANT


class CodeArguments(NamedTuple):
    """The integers of an array that the code of `text_of_steps` takes."""

    x: int  # address of the states (lines, D, W)
    lines: int
    block: int  # lines of a block, which takes all steps before the next block begins
    steps: int  # of all stages
    # Address of two numbers of 8 bytes for each stage: the address of its `Step.table`, (n,) or
    # (lines, n, W), or of h v (lines, T, W) of a whole step; and its fraction.
    plan: int
    stages: int
    bases: int  # address of the states before a whole step (lines, D, W), 0 if they are not kept
    first_row: int  # address of the first saved states
    row_bytes: int  # from one saved row to the next
    first_until: int  # steps before the one that makes the first saved state
    between: int  # steps between those that make two saved states
    trajectories: int
    marks: int  # address of bits of lanes (2, lines): that have ended; passed a pole or ended
    careful: int  # address of `careful.careful`, 0 if it is not ready
    careful_arguments: int  # address of its array
    # Where the code is. It returns when the budget is spent, and goes on there in the next call.
    budget: int  # calls of `careful` that are left
    line: int  # the first of a block
    n: int  # the next step
    stage: int  # of this step
    until: int  # steps before the next one that makes a saved state
    row: int  # address of the next saved states


SLOT = CodeArguments(*range(len(CodeArguments._fields)))  # places in the array


def marks_of(text, marks):
    """Return the bits of lanes of a line in an array of `marks`, given by its address."""
    return text.new(f"zext i8 {text.load('i8', text.integer('add', marks, '%line'), 1)} to i64")


def others(text, bits, marks):
    """Return the bits of lanes that are neither in `bits` nor have ended."""
    both = text.integer("or", bits, marks_of(text, marks))
    return text.integer("xor", both, (1 << text.W) - 1)


def call_careful(text, arguments, bad, negative, places):
    """Call `careful` for bits of lanes; return the state of the line after it."""
    kind = "void (i64, i64, i64, i64, i64)"
    function = text.new(f"inttoptr i64 {arguments.careful} to {pointer(kind)}")
    line_arrays = f"i64 {arguments.careful_arguments}"
    text.add(f"  call void {function}({line_arrays}, i64 %line, i64 {bad}, i64 {negative}, i64 %n)")
    left = text.load("i64", text.plus("%arguments", 8 * SLOT.budget))
    text.store("i64", text.integer("sub", left, 1), text.plus("%arguments", 8 * SLOT.budget))
    return [text.load(text.V, place) for place in places]


def end_composition(text, step, arguments, places, final, is_last):
    """Add what follows a stage of a composition that tells changes of signs over whole steps."""
    D, size = len(final), 8 * text.W
    text.branch(text.new(f"xor i1 {is_last}, true"), "stored", "ended", likely=True)
    text.label("ended")
    line = text.integer("mul", "%line", D * size)
    line = text.integer("add", arguments.bases, line)
    rows = {k: text.plus(line, size * k) for k in step.of_one_sign}
    base = {k: text.load(text.V, place) for k, place in rows.items()}
    tell_changes(text, step, arguments, base, final, places)
    for k, place in rows.items():
        text.store(text.V, final[k], place)
    text.jump("stored")
    text.label("stored")


def tell_changes(text, step, arguments, base, after, places):
    """Tell `careful` of lanes in which a component changed its sign that keeps it along the motion.

    `base` and `after` are the states before and after the whole step. The block `told` is open
    after it.
    """
    zero, significant, minus = map(text.constant, (0.0, SIGNIFICANT, -SIGNIFICANT))
    signs = sorted(step.of_one_sign)
    kept = [
        text.joined(
            "xor", [text.compare("olt", base[k], zero), text.compare("oge", after[k], zero)]
        )
        for k in signs
    ]
    text.branch(text.all_true(text.joined("and", kept)), "told", "changed", likely=True)
    text.label("changed")
    changes = [
        text.joined(
            "and", [text.compare(first, base[k], zero), text.compare(second, after[k], least)]
        )
        for k in signs
        for first, second, least in (("olt", "ogt", significant), ("ogt", "olt", minus))
    ]
    # Lanes that have passed a pole have nothing more to tell.
    alive = others(text, 0, text.integer("add", arguments.marks, arguments.lines))
    changed = text.integer("and", text.bits(text.joined("or", changes)), alive)
    text.branch(text.compare_integers("eq", changed, 0), "told", "tell")
    text.label("tell")
    text.branch(text.compare_integers("eq", arguments.careful, 0), "unable", "telling")
    text.label("telling")
    call_careful(text, arguments, 0, text.integer("shl", changed, CHANGED), places)
    text.jump("told")
    text.label("told")
