"""Machine code of the steps of a field: LLVM's text, made from a list of operations.

A list (`operations.Step`) becomes straight-line code for a line of W lanes, in loops over lines and
steps. Its values stay in registers, and are those of `operations.evaluate`, to the bit.
"""

from .careful import CHANGED
from .generated_stages import (
    SLOT,
    CodeArguments,
    add_lift,
    call_careful,
    end_column,
    end_composition,
    marks_of,
    others,
    state_of,
)
from .lift import LiftedStep
from .machine_code import Text

WIDTH = 8  # lanes of a line
OF_HALVES = 2  # a value of `for_each`: the code computes the tables of stages


def text_of_extrapolated_steps(*arguments):
    """Return the text of `text_of_steps` for extrapolated steps."""
    return text_of_steps(*arguments, in_columns=True)


def text_of_compositions(*arguments):
    """Return the text of `text_of_steps` for whole steps of several stages that tell signs."""
    return text_of_steps(*arguments, tells_signs=True)


def text_of_steps(step, name, W, for_each, align, in_columns=False, tells_signs=False):
    """Return the text of i64 name(arguments): steps of lines of W lanes, see `CodeArguments`.

    It returns 1; or 0 at a step that needs `careful` while that is not ready. The table is common
    to all lanes, or `for_each` of them, or made of their h v at each stage. Saved states begin at
    multiples of `align` bytes, and go past the caches if that is more than 8; 0 means that none are
    saved.
    """
    text, D = Text(W), step.D
    is_lifted = isinstance(step, LiftedStep)
    given = step.lift[0].given if is_lifted else D
    integer, size, all_lanes = text.integer, 8 * W, (1 << W) - 1
    (*before, usual), _ = step.pieces
    for k, piece in enumerate(before):
        piece_function(text, step, f"{name}_{k}", piece, for_each)
    text.add(f"define i64 @{name}(i64 %arguments) #0 {{")
    text.label("entry")
    arguments = CodeArguments(*(text.load("i64", text.plus("%arguments", 8 * k)) for k in SLOT))
    text.jump("blocks")

    text.label("blocks")
    text.add(f"  %lo = phi i64 [ {arguments.line}, %entry ], [ %hi, %after ]")
    for register, resumed, at_first in (
        ("n", arguments.n, "0"),
        ("stage", arguments.stage, "0"),
        ("until", arguments.until, arguments.first_until),
        ("row", arguments.row, arguments.first_row),
    ):
        text.add(f"  %{register}0 = phi i64 [ {resumed}, %entry ], [ {at_first}, %after ]")
    end = integer("add", "%lo", arguments.block)
    less = text.compare_integers("ult", end, arguments.lines)
    text.add(f"  %hi = select i1 {less}, i64 {end}, i64 {arguments.lines}")
    single = [
        text.load(text.V, text.plus(arguments.x, size * i))
        for i in range(D if W == 1 and not is_lifted else 0)
    ]
    text.jump("steps")

    text.label("steps")
    for register in ("n", "stage", "until", "row"):
        text.add(f"  %{register} = phi i64 [ %{register}0, %blocks ], [ %{register}1, %more ]")
    # The state of a single orbit stays in registers: a load would wait for the store before it.
    for i, component in enumerate(single):
        text.add(f"  %x{i} = phi {text.V} [ {component}, %blocks ], [ %state{i}, %more ]")
    saves = text.compare_integers("eq", "%until", 0)
    plan = integer("add", arguments.plan, integer("mul", "%stage", 32))
    common_table = text.load("i64", plan)
    next_stage = integer("add", "%stage", 1)
    is_last = text.compare_integers("eq", next_stage, arguments.stages)
    weights = [text.load("double", text.plus(plan, 8 + 8 * k)) for k in range(2 * in_columns)]
    text.jump("lines")

    text.label("lines")
    text.add("  %line = phi i64 [ %lo, %steps ], [ %line1, %next ]")
    state = integer("add", arguments.x, integer("mul", "%line", D * size))
    places = [text.plus(state, size * i) for i in range(D)]
    table, numbers = common_table, step.T if for_each == OF_HALVES else len(step.table)
    if for_each:
        table = integer("add", table, integer("mul", "%line", numbers * size))
    if is_lifted:
        in_rows = in_columns or tells_signs
        load = loader(text, step, for_each, state, table, arguments.kept)
        add_lift(text, step, arguments, places, load, in_rows)
    x = [f"%x{i}" if single else text.load(text.V, place) for i, place in enumerate(places)]

    for k in range(len(before)):
        text.add(f"  call void @{name}_{k}(i64 {state}, i64 {table}, i64 {arguments.kept})")
    fixed, values = {}, dict(enumerate(x))
    if for_each == OF_HALVES:
        add_table(text, step, table, text.load("double", text.plus(plan, 24)), fixed)
    load = loader(text, step, for_each, state, table, arguments.kept, fixed)
    text.carry_out(usual, values, load)
    after = [values[k] if k in values else load(k) for k in step.after]
    increments = step.increments if in_columns else {}
    added = {k: values[n] if n in values else load(n) for k, n in increments.items()}
    text.branch(text.all_true(values[step.good]), "finish", "rare", likely=True)

    text.label("rare")
    if not single and not before:
        # Loaded and computed anew, so that the registers of usual lines need not be stored.
        values = {k: text.load(text.V, place) for k, place in enumerate(places)}
        x = [*values.values()]
        text.carry_out(usual, values, load)
    text.carry_out(step.rare, values, load)
    accurate = values[step.accurate]
    after_rare = [values[k] if k in values else load(k) for k in step.after_rare]
    advanced = [text.select(accurate, *both) for both in zip(after_rare, x, strict=True)]
    for k in range(D):
        text.store(text.V, advanced[k], places[k])
    passed = marks_of(text, integer("add", arguments.marks, arguments.lines))
    good, negative = text.bits(accurate), text.bits(values[step.negative])
    bad = others(text, good, arguments.marks)
    told = integer("and", good, integer("xor", passed, all_lanes))
    negative = integer("and", negative, told)
    if step.changed is not None:
        changed = integer("and", text.bits(values[step.changed]), told)
        negative = integer("or", negative, integer("shl", changed, CHANGED))
    rarely = increments_of(text, step, values, load, x) if in_columns else {}
    is_any = text.compare_integers("ne", integer("or", bad, negative), 0)
    text.branch(is_any, "careful", "finish")

    text.label("careful")
    text.branch(text.compare_integers("eq", arguments.careful, 0), "unable", "call")
    text.label("unable")
    text.add("  ret i64 0")
    text.label("call")
    solved = call_careful(text, arguments, bad, negative, places)
    carefully = {
        k: text.select(accurate, made, text.operate("fsub", solved[k], x[k]))
        for k, made in rarely.items()
    }
    text.jump("finish")

    text.label("finish")
    final = [f"%final{k}" for k in range(D)] if in_columns else state_of(D)
    begin = "lifted" if is_lifted else "lines"
    for k in range(D):
        ways = f"[ {after[k]}, %{begin} ], [ {advanced[k]}, %rare ], [ {solved[k]}, %call ]"
        text.add(f"  {final[k]} = phi {text.V} {ways}")
    for k in increments:
        ways = f"[ {added[k]}, %{begin} ], [ {rarely[k]}, %rare ], [ {carefully[k]}, %call ]"
        text.add(f"  %added{k} = phi {text.V} {ways}")
    if in_columns:
        added = {k: f"%added{k}" for k in increments}
        end_column(text, step, arguments, places, final, added, weights, is_last)
        final = state_of(D)
    else:
        for k in range(D):
            if step.after[k] != k:
                text.store(text.V, final[k], places[k])
        if tells_signs:
            final = end_composition(text, step, arguments, places, final, is_last)
    if align:
        text.branch(saves, "save", "next")
        save(text, final[:given], given, arguments.trajectories, align)
    else:
        text.jump("next")

    text.label("next")
    text.add("  %line1 = add i64 %line, 1")
    text.branch(text.compare_integers("ult", "%line1", "%hi"), "lines", "done")

    text.label("done")
    text.add("  %n1 = add i64 %n, 1")
    text.add(f"  %stage1 = select i1 {is_last}, i64 0, i64 {next_stage}")
    less = integer("sub", "%until", 1)
    text.add(f"  %until1 = select i1 {saves}, i64 {arguments.between}, i64 {less}")
    next_row = integer("add", "%row", arguments.row_bytes)
    text.add(f"  %row1 = select i1 {saves}, i64 {next_row}, i64 %row")
    text.branch(text.compare_integers("ult", "%n1", arguments.steps), "more", "after")

    text.label("more")
    left = text.load("i64", text.plus("%arguments", 8 * SLOT.budget))
    text.branch(text.compare_integers("sgt", left, 0), "steps", "pause")

    text.label("pause")
    for slot, register in (
        (SLOT.line, "%lo"),
        (SLOT.n, "%n1"),
        (SLOT.stage, "%stage1"),
        (SLOT.until, "%until1"),
        (SLOT.row, "%row1"),
    ):
        text.store("i64", register, text.plus("%arguments", 8 * slot))
    text.add("  ret i64 1")

    text.label("after")
    text.branch(text.compare_integers("ult", "%hi", arguments.lines), "blocks", "end")
    text.label("end")
    text.store("i64", "%hi", text.plus("%arguments", 8 * SLOT.line))
    text.add("  ret i64 1")
    return text.finished()


def increments_of(text, step, values, load, x):
    """Return the increments of states x in which `Step.accurate` is true, by component.

    They are differences of states where the list did not add `Step.increments`.
    """
    found = {}
    for k, number in step.increments.items():
        made, after, other = (
            values[n] if n in values else load(n)
            for n in (number, step.after[k], step.after_rare[k])
        )
        found[k] = made
        if other != after:
            difference = text.operate("fsub", other, x[k])
            found[k] = text.select(text.compare("oeq", other, after), made, difference)
    return found


def add_table(text, step, halves, fraction, fixed):
    """Compute the numbers of `Step.table` into the dict `fixed`.

    `halves` is the address of h v for one line, `fraction` the one of a stage.
    """
    fraction = fraction if text.W == 1 else text.splat(fraction, text.W)

    def half_of(number):
        half = text.load(text.V, text.plus(halves, 8 * text.W * (number - step.D)))
        return text.operate("fmul", half, fraction)

    text.carry_out(step.fixed, fixed, half_of)
    for number in step.table:
        if number not in fixed:
            fixed[number] = half_of(number)


def loader(text, step, for_each, state, table, kept, fixed=()):
    """Return the function that loads a value: of the state, of an earlier piece, or of the table.

    `state`, `table` and `kept` are the addresses of their rows for one line. Values in the dict
    `fixed` are there already.
    """
    rows, size = step.pieces[1], 8 * text.W

    def load(number):
        if number in fixed:
            return fixed[number]
        if number < step.D:
            return text.load(text.V, text.plus(state, size * number))
        if number in rows:
            return text.load(text.V, text.plus(kept, size * rows[number]))
        address = text.plus(table, (size if for_each else 8) * step.places[number])
        if for_each or text.W == 1:
            return text.load(text.V, address)
        return text.splat(text.load("double", address), text.W)

    return load


def piece_function(text, step, name, operations, for_each):
    """Add a function that carries out a piece of the usual operations, for one line."""
    rows, values = step.pieces[1], {}
    text.add(f"define internal void @{name}(i64 %state, i64 %table, i64 %kept) #0 {{")
    text.carry_out(operations, values, loader(text, step, for_each, "%state", "%table", "%kept"))
    for _, number, _ in operations:
        if number in rows:
            text.store(text.V, values[number], text.plus("%kept", 8 * text.W * rows[number]))
    text.add("  ret void")
    text.add("}")


def save(text, states, D, trajectories, align):
    """Add the block `save`, which writes the states of a line to the row, one after the other."""
    new, integer, W = text.new, text.integer, text.W
    text.label("save")
    place = integer("add", "%row", integer("mul", "%line", 8 * W * D))
    if W == 1:
        for k in range(D):
            text.store("double", states[k], text.plus(place, 8 * k))
        text.jump("next")
        return
    vectors = []
    for first in range(0, W * D, W):
        vector, sources = "undef", [divmod(n, D) for n in range(first, first + W)]
        for k in dict.fromkeys(component for _, component in sources):
            order = [
                W + lane if component == k else n for n, (lane, component) in enumerate(sources)
            ]
            order = ", ".join(f"i32 {n}" for n in order)
            vector = new(
                f"shufflevector {text.V} {vector}, {text.V} {states[k]}, <{W} x i32> <{order}>"
            )
        vectors.append(vector)
    last = integer("mul", integer("add", "%line", 1), W)
    text.branch(text.compare_integers("ule", last, trajectories), "whole", "part")
    text.label("whole")
    mark = ", !nontemporal !1" if align > 8 else ""
    for k, vector in enumerate(vectors):
        text.store(text.V, vector, text.plus(place, 8 * W * k), align, mark)
    text.jump("next")
    text.label("part")  # the last line has fewer trajectories, and is written number by number
    left = integer("mul", integer("sub", trajectories, integer("mul", "%line", W)), D)
    text.jump("number0")
    for n in range(W * D):
        text.label(f"number{n}")
        text.branch(text.compare_integers("ult", n, left), f"put{n}", "next")
        text.label(f"put{n}")
        number = new(f"extractelement {text.V} {vectors[n // W]}, i32 {n % W}")
        text.store("double", number, text.plus(place, 8 * n))
        text.jump(f"number{n + 1}")
    text.label(f"number{W * D}")
    text.jump("next")


def text_of_stage(*arguments):
    """Return the text of `text_of_step` for extrapolated steps."""
    return text_of_step(*arguments, in_columns=True)


def text_of_step(step, name, *_, in_columns=False):
    """Return the text of i64 name(x, table): one step of a state (D,), in place.

    It returns 1, and leaves the state, if the step is not accurate; else 2 if det A < 0, or 0. In
    columns it adds the increments to D numbers after the state.
    """
    text = Text(1)
    text.add(f"define i64 @{name}(i64 %x, i64 %table) #0 {{")
    text.label("entry")
    places = [text.plus("%x", 8 * i) for i in range(step.D)]
    values = {i: text.load("double", place) for i, place in enumerate(places)}

    def of_table(number):
        return text.load("double", text.plus("%table", 8 * step.places[number]))

    text.carry_out(step.usual, values, of_table)
    added = {
        k: values[n] if n in values else of_table(n)
        for k, n in (step.increments.items() if in_columns else ())
    }
    text.branch(values[step.good], "finish", "rare", likely=True)
    text.label("rare")
    rare = dict(values)
    text.carry_out(step.rare, rare, of_table)
    text.branch(rare[step.accurate], "accurate", "bad")
    text.label("bad")
    text.add("  ret i64 1")
    text.label("accurate")
    sign = text.integer("mul", 2, text.bits(rare[step.negative]))
    rarely = increments_of(text, step, rare, of_table, values) if in_columns else {}
    text.jump("finish")
    text.label("finish")
    text.add(f"  %code = phi i64 [ 0, %entry ], [ {sign}, %accurate ]")
    made = {
        k: text.new(f"phi double [ {added[k]}, %entry ], [ {value}, %accurate ]")
        for k, value in rarely.items()
    }
    both = [*zip(step.after, step.after_rare, strict=True)]
    final = {
        k: text.new(f"phi double [ {values[usual]}, %entry ], [ {rare[other]}, %accurate ]")
        for k, (usual, other) in enumerate(both)
        if usual != k
    }
    for k, value in final.items():
        text.store("double", value, places[k])
    for k, value in made.items():
        place = text.plus("%x", 8 * (step.D + k))
        text.store("double", text.operate("fadd", text.load("double", place), value), place)
    text.add("  ret i64 %code")
    return text.finished()
