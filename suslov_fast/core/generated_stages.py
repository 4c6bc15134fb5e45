"""Machine code of what follows a stage of a step: the end of a column, or of the whole step.

And the arguments of the code, see `generated`.
"""

from typing import NamedTuple

import numpy as np

from .careful import CHANGED
from .machine_code import pointer
from .operations import SIGNIFICANT


class CodeArguments(NamedTuple):
    """The integers of an array that the code of `text_of_steps` takes."""

    x: int  # address of the states (lines, D, W)
    lines: int
    block: int  # lines of a block, which takes all steps before the next block begins
    steps: int  # of all stages
    # Address of four numbers of 8 bytes for each stage: the address of its `Step.table`, (n,) or
    # (lines, n, W), or of h v (lines, T, W) of a whole step; its `weights_of`; its fraction.
    plan: int
    stages: int
    columns: int  # address of the rows of columns (lines, ROWS, D, W), 0 for compositions
    first_row: int  # address of the first saved states
    row_bytes: int  # from one saved row to the next
    first_until: int  # steps before the one that makes the first saved state
    between: int  # steps between those that make two saved states
    trajectories: int
    marks: int  # address of bits of lanes (2, lines): that have ended; passed a pole or ended
    careful: int  # address of `careful.careful`, 0 if it is not ready
    careful_arguments: int  # address of its array
    kept: int  # address of memory for values that later pieces of a long list need
    # Where the code is. It returns when the budget is spent, and goes on there in the next call.
    budget: int  # calls of `careful` that are left
    line: int  # the first of a block
    n: int  # the next step
    stage: int  # of this step
    until: int  # steps before the next one that makes a saved state
    row: int  # address of the next saved states


SLOT = CodeArguments(*range(len(CodeArguments._fields)))  # places in the array

# Rows of columns: the state before the whole step, sums with both weights, the sum of increments in
# a column, and the largest estimated error of a step so far, NaN before the first.
BASE, SUM, SECOND, CHANGE, LARGEST = range(5)
ROWS = 5


def state_of(D):
    """Return the names of the components of a line after a stage."""
    return [f"%state{k}" for k in range(D)]


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


def add_lift(text, step, arguments, places, load, has_columns):
    """Add what comes before the first stage of a whole step of a lifted field.

    It writes the added words of a line, and tells `careful` of lanes with det(1 - h f') < 0. The
    block `lifted` is open after it.
    """
    V, D, given = text.V, step.D, step.lift[0].given
    text.branch(text.compare_integers("eq", "%stage", 0), "lift", "lifted")
    text.label("lift")
    values = {i: text.load(V, places[i]) for i in range(given)}
    text.carry_out(step.prologue, values, load)
    words = [values[n] if n in values else load(n) for n in step.lifted]
    for word, place in zip(words, places[given:], strict=True):
        text.store(V, word, place)
    if has_columns:
        line = text.integer("mul", "%line", ROWS * D * 8 * text.W)
        line = text.integer("add", arguments.columns, line)
        for k, word in enumerate(words, given):
            text.store(V, word, text.plus(line, 8 * text.W * (BASE * D + k)))
    passed = text.integer("add", arguments.marks, arguments.lines)
    turned = text.integer("and", text.bits(values[step.turned]), others(text, 0, passed))
    text.branch(text.compare_integers("eq", turned, 0), "lifted", "turned")
    text.label("turned")
    text.branch(text.compare_integers("eq", arguments.careful, 0), "unable", "turning")
    text.label("turning")
    call_careful(text, arguments, 0, turned, places)
    text.jump("lifted")
    text.label("lifted")


def end_column(text, step, arguments, places, final, increments, weights, is_last):
    """Add what follows a stage of an extrapolated step: the end of a column, or of the step.

    The stage made the state `final` of a line by these increments. Then the line has `state_of`,
    and is stored.
    """
    V, D, size = text.V, len(final), 8 * text.W
    line = text.integer("mul", "%line", ROWS * D * size)
    line = text.integer("add", arguments.columns, line)
    rows = [[text.plus(line, size * (row * D + k)) for k in range(D)] for row in range(ROWS)]
    changes = {
        k: text.operate("fadd", text.load(V, rows[CHANGE][k]), increment)
        for k, increment in increments.items()
    }
    text.branch(text.new(f"fcmp une double {weights[0]}, 0.0"), "column", "inside")

    text.label("inside")
    for value, place in zip(final, places, strict=True):
        text.store(V, value, place)
    for k, change in changes.items():
        text.store(V, change, rows[CHANGE][k])
    text.jump("stored")

    text.label("column")
    zero = "zeroinitializer" if text.W > 1 else "0.0"
    base = [text.load(V, place) for place in rows[BASE]]
    for k in changes:
        text.store(V, zero, rows[CHANGE][k])
    changes = [changes.get(k, zero) for k in range(D)]
    sums = []
    for row, weight in zip((SUM, SECOND), weights, strict=True):
        weight = weight if text.W == 1 else text.splat(weight, text.W)
        terms = [text.operate("fmul", weight, change) for change in changes]
        sums.append([
            text.operate("fadd", text.load(V, place), term)
            for place, term in zip(rows[row], terms, strict=True)
        ])  # fmt: skip
    text.branch(is_last, "last", "restart")

    text.label("restart")
    for k in range(D):
        text.store(V, base[k], places[k])
        text.store(V, sums[0][k], rows[SUM][k])
        text.store(V, sums[1][k], rows[SECOND][k])
    text.jump("stored")

    text.label("last")
    after = [text.operate("fadd", base[k], sums[0][k]) for k in range(D)]
    errors = [text.absolute(text.operate("fsub", *both)) for both in zip(*sums, strict=True)]
    infinite = text.constant(np.inf)
    finite = [text.compare("olt", text.absolute(value), infinite) for value in after]
    finite = text.joined("and", finite)
    for value, place in zip(after, places, strict=True):
        text.store(V, value, place)
    text.branch(text.all_true(finite), "taken", "beyond", likely=True)
    text.label("beyond")
    lost = others(text, text.bits(finite), arguments.marks)
    text.branch(text.compare_integers("eq", lost, 0), "taken", "note")
    text.label("note")  # `careful` notes that a state that is not finite has no next one
    text.branch(text.compare_integers("eq", arguments.careful, 0), "unable", "lost")
    text.label("lost")
    nothing = call_careful(text, arguments, lost, 0, places)
    text.jump("taken")

    text.label("taken")
    for k in range(D):
        ways = f"[ {after[k]}, %last ], [ {after[k]}, %beyond ], [ {nothing[k]}, %lost ]"
        text.add(f"  %taken{k} = phi {V} {ways}")
    for k in range(D):
        largest = text.load(V, rows[LARGEST][k])
        is_larger = text.compare("ogt", largest, errors[k])
        error = text.select(is_larger, largest, errors[k])
        text.store_chosen(text.select(finite, error, largest), rows[LARGEST][k])
        text.store(V, "zeroinitializer" if text.W > 1 else "0.0", rows[SUM][k])
        text.store(V, "zeroinitializer" if text.W > 1 else "0.0", rows[SECOND][k])
    taken = [f"%taken{k}" for k in range(D)]
    taken = tell_changes(text, step, arguments, base, taken, places)
    for k in range(D):
        text.store(V, taken[k], rows[BASE][k])
    text.jump("stored")

    text.label("stored")
    for k, state in enumerate(state_of(D)):
        ways = f"[ {final[k]}, %inside ], [ {base[k]}, %restart ], [ {taken[k]}, %told ]"
        text.add(f"  {state} = phi {V} {ways}")


def end_composition(text, step, arguments, places, final, is_last):
    """Add what follows a stage of a composition that tells changes of signs over whole steps.

    Return the state of the line.
    """
    D, size, before = len(final), 8 * text.W, text.block
    text.branch(text.new(f"xor i1 {is_last}, true"), "stored", "ended", likely=True)
    text.label("ended")
    line = text.integer("mul", "%line", ROWS * D * size)
    line = text.integer("add", arguments.columns, line)
    rows = {k: text.plus(line, size * (BASE * D + k)) for k in step.of_one_sign}
    base = {k: text.load(text.V, place) for k, place in rows.items()}
    told = tell_changes(text, step, arguments, base, final, places)
    for k, place in rows.items():
        text.store(text.V, told[k], place)
    text.jump("stored")
    text.label("stored")
    if step.lift is None:
        return final
    for k in step.of_one_sign:
        ways = f"[ {final[k]}, %{before} ], [ {told[k]}, %told ]"
        text.add(f"  %kept{k} = phi {text.V} {ways}")
    return [f"%kept{k}" if k in step.of_one_sign else value for k, value in enumerate(final)]


def tell_changes(text, step, arguments, base, after, places):
    """Tell `careful` of lanes in which a component changed its sign that keeps it along the motion.

    `base` and `after` are the states before and after the whole step, which are stored. Return the
    state after it, in which components of lifted fields have their signs back that rounding had
    changed. The block `told` is open after it.
    """
    zero, significant, minus = map(text.constant, (0.0, SIGNIFICANT, -SIGNIFICANT))
    signs = sorted(step.of_one_sign)
    if not signs:
        text.jump("told")
        text.label("told")
        return after
    before = text.block
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
    marks = arguments.marks
    if step.lift is None:  # lanes that have passed a pole have nothing more to tell
        marks = text.integer("add", marks, arguments.lines)
    alive = others(text, 0, marks)
    changed = text.integer("and", text.bits(text.joined("or", changes)), alive)
    text.branch(text.compare_integers("eq", changed, 0), "told", "tell")
    text.label("tell")
    text.branch(text.compare_integers("eq", arguments.careful, 0), "unable", "telling")
    text.label("telling")
    kept = call_careful(text, arguments, 0, text.integer("shl", changed, CHANGED), places)
    text.jump("told")
    text.label("told")
    if step.lift is None:
        return after
    for k in signs:
        same = ", ".join(f"[ {after[k]}, %{block} ]" for block in (before, "changed"))
        text.add(f"  %signed{k} = phi {text.V} {same}, [ {kept[k]}, %telling ]")
    return [f"%signed{k}" if k in signs else value for k, value in enumerate(after)]
