"""Machine code of the steps of a field: LLVM's text, made from a list of operations.

A list (`operations.Step`) becomes straight-line code for a line of W lanes, in loops over lines and
steps. Its values stay in registers, and are those of `operations.evaluate`, to the bit.
"""

from typing import NamedTuple

from .machine_code import Text, pointer

WIDTH = 8  # lanes of a line


class CodeArguments(NamedTuple):
    """The integers of an array that the code of `text_of_steps` takes."""

    x: int  # address of the states (lines, D, W)
    lines: int
    block: int  # lines of a block, which takes all steps before the next block begins
    steps: int  # of all stages
    table: int  # address of `Step.table` for each stage: (stages, n) or (stages, lines, n, W)
    table_bytes: int  # of a stage
    stages: int
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
    budget: int  # calls of `careful` before it returns
    line: int
    n: int
    stage: int
    until: int
    row: int  # address


SLOT = CodeArguments(*range(len(CodeArguments._fields)))  # places in the array


def text_of_steps(step, name, W, for_each, align):
    """Return the text of i64 name(arguments): steps of lines of W lanes, see `CodeArguments`.

    It returns 1; or 0 at a step that needs `careful` while that is not ready. The table is common
    to all lanes, or `for_each` of them. Saved states begin at multiples of `align` bytes, and go
    past the caches if that is more than 8; 0 means that none are saved.
    """
    t, D = Text(W), step.D
    new, integer, size, every = t.new, t.integer, 8 * W, (1 << W) - 1
    (*before, usual), _ = step.pieces
    for k, piece in enumerate(before):
        _piece(t, step, f"{name}_{k}", piece, for_each)
    t.add(f"define i64 @{name}(i64 %arguments) #0 {{")
    t.label("entry")
    arguments = CodeArguments(*(t.load("i64", t.plus("%arguments", 8 * k)) for k in SLOT))
    t.add("  br label %blocks")

    t.label("blocks")
    t.add(f"  %lo = phi i64 [ {arguments.line}, %entry ], [ %hi, %after ]")
    for register, resumed, at_first in (
        ("n", arguments.n, "0"),
        ("stage", arguments.stage, "0"),
        ("until", arguments.until, arguments.first_until),
        ("row", arguments.row, arguments.first_row),
    ):
        t.add(f"  %{register}0 = phi i64 [ {resumed}, %entry ], [ {at_first}, %after ]")
    end = integer("add", "%lo", arguments.block)
    less = t.compare_integers("ult", end, arguments.lines)
    t.add(f"  %hi = select i1 {less}, i64 {end}, i64 {arguments.lines}")
    single = [t.load(t.V, t.plus(arguments.x, size * i)) for i in range(D if W == 1 else 0)]
    t.add("  br label %steps")

    t.label("steps")
    for register in ("n", "stage", "until", "row"):
        t.add(f"  %{register} = phi i64 [ %{register}0, %blocks ], [ %{register}1, %more ]")
    # The state of a single orbit stays in registers: a load would wait for the store before it.
    for i, component in enumerate(single):
        t.add(f"  %x{i} = phi {t.V} [ {component}, %blocks ], [ %final{i}, %more ]")
    saves = t.compare_integers("eq", "%until", 0)
    table = integer("add", arguments.table, integer("mul", "%stage", arguments.table_bytes))
    t.add("  br label %lines")

    t.label("lines")
    t.add("  %line = phi i64 [ %lo, %steps ], [ %line1, %next ]")
    state = integer("add", arguments.x, integer("mul", "%line", D * size))
    places = [t.plus(state, size * i) for i in range(D)]
    x = [f"%x{i}" if W == 1 else t.load(t.V, place) for i, place in enumerate(places)]
    if for_each:
        table = integer("add", table, integer("mul", "%line", len(step.table) * size))

    for k in range(len(before)):
        t.add(f"  call void @{name}_{k}(i64 {state}, i64 {table}, i64 {arguments.kept})")
    load, values = _loader(t, step, for_each, state, table, arguments.kept), dict(enumerate(x))
    t.carry_out(usual, values, load)
    after = [values[k] if k in values else load(k) for k in step.after]
    t.add(f"  br i1 {t.all_true(values[step.good])}, label %finish, label %rare, !prof !0")

    t.label("rare")
    t.carry_out(step.rare, values, load)
    accurate = values[step.accurate]
    advanced = [t.select(accurate, *both) for both in zip(after, x, strict=True)]
    for k in range(D):
        t.store(t.V, advanced[k], places[k])
    ended, passed = (
        new(f"zext i8 {t.load('i8', integer('add', bits, '%line'), 1)} to i64")
        for bits in (arguments.marks, integer("add", arguments.marks, arguments.lines))
    )
    good, negative = t.bits(accurate), t.bits(values[step.negative])
    bad = integer("and", integer("xor", good, every), integer("xor", ended, every))
    negative = integer("and", negative, integer("and", good, integer("xor", passed, every)))
    some = t.compare_integers("ne", integer("or", bad, negative), 0)
    t.add(f"  br i1 {some}, label %careful, label %finish")

    t.label("careful")
    t.add(f"  br i1 {t.compare_integers('eq', arguments.careful, 0)}, label %unable, label %call")
    t.label("unable")
    t.add("  ret i64 0")
    t.label("call")
    kind = "void (i64, i64, i64, i64, i64)"
    function = new(f"inttoptr i64 {arguments.careful} to {pointer(kind)}")
    line_arrays = f"i64 {arguments.careful_arguments}"
    t.add(f"  call void {function}({line_arrays}, i64 %line, i64 {bad}, i64 {negative}, i64 %n)")
    left = t.load("i64", t.plus("%arguments", 8 * SLOT.budget))
    t.store("i64", integer("sub", left, 1), t.plus("%arguments", 8 * SLOT.budget))
    solved = [t.load(t.V, places[k]) for k in range(D)]
    t.add("  br label %finish")

    t.label("finish")
    final = [f"%final{k}" for k in range(D)]
    for k in range(D):
        ways = f"[ {after[k]}, %lines ], [ {advanced[k]}, %rare ], [ {solved[k]}, %call ]"
        t.add(f"  {final[k]} = phi {t.V} {ways}")
    for k in range(D):
        if step.after[k] != k:
            t.store(t.V, final[k], places[k])
    t.add(f"  br i1 {saves}, label %save, label %next" if align else "  br label %next")
    if align:
        _save(t, final, D, arguments.trajectories, align)

    t.label("next")
    t.add("  %line1 = add i64 %line, 1")
    t.add(f"  br i1 {t.compare_integers('ult', '%line1', '%hi')}, label %lines, label %done")

    t.label("done")
    t.add("  %n1 = add i64 %n, 1")
    next_stage = integer("add", "%stage", 1)
    is_last = t.compare_integers("eq", next_stage, arguments.stages)
    t.add(f"  %stage1 = select i1 {is_last}, i64 0, i64 {next_stage}")
    less = integer("sub", "%until", 1)
    t.add(f"  %until1 = select i1 {saves}, i64 {arguments.between}, i64 {less}")
    next_row = integer("add", "%row", arguments.row_bytes)
    t.add(f"  %row1 = select i1 {saves}, i64 {next_row}, i64 %row")
    t.add(f"  br i1 {t.compare_integers('ult', '%n1', arguments.steps)}, label %more, label %after")

    t.label("more")
    left = t.load("i64", t.plus("%arguments", 8 * SLOT.budget))
    t.add(f"  br i1 {t.compare_integers('sgt', left, 0)}, label %steps, label %pause")

    t.label("pause")
    for slot, register in (
        (SLOT.line, "%lo"),
        (SLOT.n, "%n1"),
        (SLOT.stage, "%stage1"),
        (SLOT.until, "%until1"),
        (SLOT.row, "%row1"),
    ):
        t.store("i64", register, t.plus("%arguments", 8 * slot))
    t.add("  ret i64 1")

    t.label("after")
    t.add(f"  br i1 {t.compare_integers('ult', '%hi', arguments.lines)}, label %blocks, label %end")
    t.label("end")
    t.store("i64", "%hi", t.plus("%arguments", 8 * SLOT.line))
    t.add("  ret i64 1")
    return t.finished()


def _loader(t, step, for_each, state, table, kept):
    """Return the function that loads a value: of the state, of an earlier piece, or of the table.

    `state`, `table` and `kept` are the addresses of their rows for one line.
    """
    rows, size = step.pieces[1], 8 * t.W

    def load(number):
        if number < step.D:
            return t.load(t.V, t.plus(state, size * number))
        if number in rows:
            return t.load(t.V, t.plus(kept, size * rows[number]))
        address = t.plus(table, (size if for_each else 8) * step.places[number])
        if for_each or t.W == 1:
            return t.load(t.V, address)
        return t.splat(t.load("double", address), t.W)

    return load


def _piece(t, step, name, operations, for_each):
    """Add a function that carries out a piece of the usual operations, for one line."""
    rows, values = step.pieces[1], {}
    t.add(f"define internal void @{name}(i64 %state, i64 %table, i64 %kept) #0 {{")
    t.carry_out(operations, values, _loader(t, step, for_each, "%state", "%table", "%kept"))
    for _, number, _ in operations:
        if number in rows:
            t.store(t.V, values[number], t.plus("%kept", 8 * t.W * rows[number]))
    t.add("  ret void")
    t.add("}")


def _save(t, states, D, trajectories, align):
    """Add the block `save`, which writes the states of a line to the row, one after the other."""
    new, integer, W = t.new, t.integer, t.W
    t.label("save")
    place = integer("add", "%row", integer("mul", "%line", 8 * W * D))
    if W == 1:
        for k in range(D):
            t.store("double", states[k], t.plus(place, 8 * k))
        t.add("  br label %next")
        return
    vectors = []
    for first in range(0, W * D, W):
        vector, sources = "undef", [divmod(n, D) for n in range(first, first + W)]
        for k in dict.fromkeys(component for _, component in sources):
            order = [
                W + lane if component == k else n for n, (lane, component) in enumerate(sources)
            ]
            order = ", ".join(f"i32 {n}" for n in order)
            vector = new(f"shufflevector {t.V} {vector}, {t.V} {states[k]}, <{W} x i32> <{order}>")
        vectors.append(vector)
    last = integer("mul", integer("add", "%line", 1), W)
    t.add(f"  br i1 {t.compare_integers('ule', last, trajectories)}, label %whole, label %part")
    t.label("whole")
    mark = ", !nontemporal !1" if align > 8 else ""
    for k, vector in enumerate(vectors):
        t.store(t.V, vector, t.plus(place, 8 * W * k), align, mark)
    t.add("  br label %next")
    t.label("part")  # the last line has fewer trajectories, and is written number by number
    left = integer("mul", integer("sub", trajectories, integer("mul", "%line", W)), D)
    t.add("  br label %number0")
    for n in range(W * D):
        t.label(f"number{n}")
        t.add(f"  br i1 {t.compare_integers('ult', n, left)}, label %put{n}, label %next")
        t.label(f"put{n}")
        number = new(f"extractelement {t.V} {vectors[n // W]}, i32 {n % W}")
        t.store("double", number, t.plus(place, 8 * n))
        t.add(f"  br label %number{n + 1}")
    t.label(f"number{W * D}")
    t.add("  br label %next")


def text_of_step(step, name, *_):
    """Return the text of i64 name(x, table): one step of a state (D,), in place.

    It returns 1, and leaves the state, if the step is not accurate; else 2 if det A < 0, or 0.
    """
    t = Text(1)
    t.add(f"define i64 @{name}(i64 %x, i64 %table) #0 {{")
    t.label("entry")
    places = [t.plus("%x", 8 * i) for i in range(step.D)]
    values = {i: t.load("double", place) for i, place in enumerate(places)}

    def of_table(number):
        return t.load("double", t.plus("%table", 8 * step.places[number]))

    t.carry_out(step.usual, values, of_table)
    t.add(f"  br i1 {values[step.good]}, label %finish, label %rare, !prof !0")
    t.label("rare")
    rare = dict(values)
    t.carry_out(step.rare, rare, of_table)
    t.add(f"  br i1 {rare[step.accurate]}, label %accurate, label %bad")
    t.label("bad")
    t.add("  ret i64 1")
    t.label("accurate")
    sign = t.integer("mul", 2, t.bits(rare[step.negative]))
    t.add("  br label %finish")
    t.label("finish")
    t.add(f"  %code = phi i64 [ 0, %entry ], [ {sign}, %accurate ]")
    for k, number in enumerate(step.after):
        if number != k:
            t.store("double", values[number], places[k])
    t.add("  ret i64 %code")
    return t.finished()
