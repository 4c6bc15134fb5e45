"""Machine code for the steps of a field: text in LLVM's language, made from a list of operations.

A list (`operations.Step`) becomes straight-line code for a line of W lanes, whose values stay in
registers, in loops over lines and steps. LLVM forms no FMA and keeps the order of operations, so
that the numbers are those of `operations.evaluate`, to the bit. Compiling takes 0.3 to 0.5 ms an
operation. Machine code stays until the process ends, since addresses of it may be anywhere.

The code takes addresses as integers: versions of LLVM write the types of pointers differently.
"""

from .machine_code import Text, pointer

WIDTH = 8  # lanes of a line
# Slots of a job, the integers that `steps` takes: the states x (lines, D, W), how many lines there
# are, and in a block; how many steps of the list, and the values of `table`, of each stage in turn,
# (stages, n) or (stages, lines, n, W); the first saved state, bytes from one to the next, steps
# until the first, and from one to the next; how many trajectories there are; for each line bits of
# lanes that have ended, and of those that have passed a pole or ended; the function that is called
# for steps that are not good, 0 before it is compiled; memory for values between pieces of a long
# list. The code returns when the budget of calls of this function is spent, and goes on where it
# was when it is called again: at line LINE, step NOW, a stage, steps until a saved state, and its
# place. `careful` has slots of its own after these.
(X, LINES, BLOCK, STEPS, TABLE, STAGE, STAGES) = range(7)
(SAVED, ROW, UNTIL, EVERY, COUNT, ENDED, PASSED, CALL, KEPT) = range(7, 16)
(BUDGET, LINE, NOW, STAGE_NOW, UNTIL_NOW, ROW_NOW, SLOTS) = range(16, 23)


def text_of_steps(step, name, W, for_each, align):
    """Return the text of i64 name(job): steps of lines of W lanes, see the slots of a job.

    It returns 1; or 0 as soon as it would have to call a function that is not compiled yet.

    The table is that of all lanes, or `for_each` of them. Saved states begin at multiples of
    `align` bytes: they go past the caches if that is more than 8, and 0 means that none are saved.
    """
    t, D = Text(W), step.D
    new, integer, size, every = t.new, t.integer, 8 * W, (1 << W) - 1
    (*before, usual), _ = step.pieces
    for k, piece in enumerate(before):
        _piece(t, step, f"{name}_{k}", piece, for_each)
    t.add(f"define i64 @{name}(i64 %job) #0 {{")
    t.label("entry")
    slots = [t.load("i64", t.plus("%job", 8 * k)) for k in range(SLOTS)]
    t.add("  br label %blocks")

    t.label("blocks")
    t.add(f"  %lo = phi i64 [ {slots[LINE]}, %entry ], [ %hi, %after ]")
    for each, now, begin in (
        ("n", NOW, "0"),
        ("stage", STAGE_NOW, "0"),
        ("until", UNTIL_NOW, slots[UNTIL]),
        ("row", ROW_NOW, slots[SAVED]),
    ):
        t.add(f"  %{each}0 = phi i64 [ {slots[now]}, %entry ], [ {begin}, %after ]")
    end = integer("add", "%lo", slots[BLOCK])
    less = t.compare("ult", end, slots[LINES])
    t.add(f"  %hi = select i1 {less}, i64 {end}, i64 {slots[LINES]}")
    one = [t.load(t.V, t.plus(slots[X], size * i)) for i in range(D if W == 1 else 0)]
    t.add("  br label %steps")

    t.label("steps")
    for each in ("n", "stage", "until", "row"):
        t.add(f"  %{each} = phi i64 [ %{each}0, %blocks ], [ %{each}1, %more ]")
    for i, each in enumerate(one):  # a single line: what was stored is not waited for
        t.add(f"  %x{i} = phi {t.V} [ {each}, %blocks ], [ %final{i}, %more ]")
    saves = t.compare("eq", "%until", 0)
    table = integer("add", slots[TABLE], integer("mul", "%stage", slots[STAGE]))
    t.add("  br label %lines")

    t.label("lines")
    t.add("  %line = phi i64 [ %lo, %steps ], [ %line1, %next ]")
    place = integer("add", slots[X], integer("mul", "%line", D * size))
    places = [t.plus(place, size * i) for i in range(D)]
    x = [f"%x{i}" if W == 1 else t.load(t.V, each) for i, each in enumerate(places)]
    if for_each:
        table = integer("add", table, integer("mul", "%line", len(step.table) * size))

    for k in range(len(before)):
        t.add(f"  call void @{name}_{k}(i64 {place}, i64 {table}, i64 {slots[KEPT]})")
    get, values = _getter(t, step, for_each, place, table, slots[KEPT]), dict(enumerate(x))
    t.carry_out(usual, values, get)
    after = [values[k] if k in values else get(k) for k in step.after]
    t.add(f"  br i1 {t.all_true(values[step.good])}, label %finish, label %rare, !prof !0")

    t.label("rare")
    t.carry_out(step.rare, values, get)
    accurate = values[step.accurate]
    kept = [
        new(f"select {t.M} {accurate}, {t.V} {one}, {t.V} {other}")
        for one, other in zip(after, x, strict=True)
    ]
    for k in range(D):
        t.store(t.V, kept[k], places[k])
    ended, passed = (
        new(f"zext i8 {t.load('i8', integer('add', slots[k], '%line'), 1)} to i64")
        for k in (ENDED, PASSED)
    )
    good, negative = t.bits(accurate), t.bits(values[step.negative])
    bad = integer("and", integer("xor", good, every), integer("xor", ended, every))
    negative = integer("and", negative, integer("and", good, integer("xor", passed, every)))
    some = t.compare("ne", integer("or", bad, negative), 0)
    t.add(f"  br i1 {some}, label %careful, label %finish")

    t.label("careful")
    t.add(f"  br i1 {t.compare('eq', slots[CALL], 0)}, label %unable, label %call")
    t.label("unable")
    t.add("  ret i64 0")
    t.label("call")
    kind = "void (i64, i64, i64, i64, i64)"
    function = new(f"inttoptr i64 {slots[CALL]} to {pointer(kind)}")
    t.add(f"  call void {function}(i64 %job, i64 %line, i64 {bad}, i64 {negative}, i64 %n)")
    again = [t.load(t.V, places[k]) for k in range(D)]
    t.add("  br label %finish")

    t.label("finish")
    final = [f"%final{k}" for k in range(D)]
    for k in range(D):
        ways = f"[ {after[k]}, %lines ], [ {kept[k]}, %rare ], [ {again[k]}, %call ]"
        t.add(f"  {final[k]} = phi {t.V} {ways}")
    for k in range(D):
        if step.after[k] != k:
            t.store(t.V, final[k], places[k])
    t.add(f"  br i1 {saves}, label %save, label %next" if align else "  br label %next")
    if align:
        _save(t, final, D, slots[COUNT], align)

    t.label("next")
    t.add("  %line1 = add i64 %line, 1")
    t.add(f"  br i1 {t.compare('ult', '%line1', '%hi')}, label %lines, label %done")

    t.label("done")
    t.add("  %n1 = add i64 %n, 1")
    later = integer("add", "%stage", 1)
    last = t.compare("eq", later, slots[STAGES])
    t.add(f"  %stage1 = select i1 {last}, i64 0, i64 {later}")
    sooner = integer("sub", "%until", 1)
    t.add(f"  %until1 = select i1 {saves}, i64 {slots[EVERY]}, i64 {sooner}")
    below = integer("add", "%row", slots[ROW])
    t.add(f"  %row1 = select i1 {saves}, i64 {below}, i64 %row")
    t.add(f"  br i1 {t.compare('ult', '%n1', slots[STEPS])}, label %more, label %after")

    t.label("more")
    left = t.load("i64", t.plus("%job", 8 * BUDGET))
    t.add(f"  br i1 {t.compare('sgt', left, 0)}, label %steps, label %pause")

    t.label("pause")
    now = {LINE: "%lo", NOW: "%n1", STAGE_NOW: "%stage1", UNTIL_NOW: "%until1", ROW_NOW: "%row1"}
    for slot, value in now.items():
        t.store("i64", value, t.plus("%job", 8 * slot))
    t.add("  ret i64 1")

    t.label("after")
    t.add(f"  br i1 {t.compare('ult', '%hi', slots[LINES])}, label %blocks, label %end")
    t.label("end")
    t.store("i64", "%hi", t.plus("%job", 8 * LINE))
    t.add("  ret i64 1")
    return t.whole()


def _getter(t, step, for_each, place, table, kept):
    """Return the function that loads a value: of the state, of the table, or of a piece before."""
    rows, size = step.pieces[1], 8 * t.W

    def get(number):
        if number < step.D:
            return t.load(t.V, t.plus(place, size * number))
        if number in rows:
            return t.load(t.V, t.plus(kept, size * rows[number]))
        address = t.plus(table, (size if for_each else 8) * step.places[number])
        if for_each or t.W == 1:
            return t.load(t.V, address)
        return t.splat(t.load("double", address), t.W)

    return get


def _piece(t, step, name, operations, for_each):
    """Add the function of a piece of the usual operations, for one line."""
    rows, values = step.pieces[1], {}
    t.add(f"define internal void @{name}(i64 %place, i64 %table, i64 %kept) #0 {{")
    t.carry_out(operations, values, _getter(t, step, for_each, "%place", "%table", "%kept"))
    for _, number, _ in operations:
        if number in rows:
            t.store(t.V, values[number], t.plus("%kept", 8 * t.W * rows[number]))
    t.add("  ret void")
    t.add("}")


def _save(t, states, D, count, align):
    """Add the block `save`: the states of a line, component by component, to the row."""
    new, integer, W = t.new, t.integer, t.W
    t.label("save")
    place = integer("add", "%row", integer("mul", "%line", 8 * W * D))
    if W == 1:
        for k in range(D):
            t.store("double", states[k], t.plus(place, 8 * k))
        t.add("  br label %next")
        return
    rows = []
    for first in range(0, W * D, W):
        row, taken = "undef", [divmod(n, D) for n in range(first, first + W)]
        for k in dict.fromkeys(k for _, k in taken):
            order = [W + lane if i == k else n for n, (lane, i) in enumerate(taken)]
            order = ", ".join(f"i32 {n}" for n in order)
            row = new(f"shufflevector {t.V} {row}, {t.V} {states[k]}, <{W} x i32> <{order}>")
        rows.append(row)
    last = integer("mul", integer("add", "%line", 1), W)
    t.add(f"  br i1 {t.compare('ule', last, count)}, label %whole, label %part")
    t.label("whole")
    mark = ", !nontemporal !1" if align > 8 else ""
    for k, row in enumerate(rows):
        t.store(t.V, row, t.plus(place, 8 * W * k), align, mark)
    t.add("  br label %next")
    # Of the last line, number by number.
    t.label("part")
    left = integer("mul", integer("sub", count, integer("mul", "%line", W)), D)
    t.add("  br label %number0")
    for n in range(W * D):
        t.label(f"number{n}")
        t.add(f"  br i1 {t.compare('ult', n, left)}, label %put{n}, label %next")
        t.label(f"put{n}")
        one = new(f"extractelement {t.V} {rows[n // W]}, i32 {n % W}")
        t.store("double", one, t.plus(place, 8 * n))
        t.add(f"  br label %number{n + 1}")
    t.label(f"number{W * D}")
    t.add("  br label %next")


def text_of_step(step, name, *_):
    """Return the text of i64 name(x, table): one step of a state (D,), in place.

    It returns 1 if the step is not accurate, and then leaves the state; else 2 if det A < 0, or 0.
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
    return t.whole()
