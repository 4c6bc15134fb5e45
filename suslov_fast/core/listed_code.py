"""Machine code that carries out any `listed.Program`, for lines of W lanes."""

from typing import NamedTuple

import numpy as np

from .careful import CHANGED
from .listed import JOINING, KINDS, programs_of
from .machine_code import Text, call, code_of, pointer
from .operations import OF_NUMBERS, Step


class ListArguments(NamedTuple):
    """The integers of an array that the code of `text_of_listed_steps` takes."""

    rows: int  # address of the rows (-, W), of which the first D have the state
    table: int  # address of the table (n,) or (n, W)
    heads: int  # addresses of the usual `Runs`, and their number
    places: int
    runs: int
    results: int  # address of the rows of `Step.after` and `good`
    rare_heads: int
    rare_places: int
    rare_runs: int
    rare_results: int  # of `after_rare`, `accurate`, `negative` and `changed`
    changed: int  # place of `changed` among the results, 0 if there is none
    D: int
    ended: int  # bits of lanes, which are those of `generated.CodeArguments.marks`
    passed: int
    steps: int
    n: int  # steps taken


SLOT = ListArguments(*range(len(ListArguments._fields)))


def text_of_listed_steps(_, name, W, for_each, *_others):
    """Return the text of i64 name(arguments), see `ListArguments`: steps of one line of W lanes.

    It ends after a step that is not accurate in some lane, or from det A < 0, and returns bits of
    these lanes: bad + 256 negative, as of `step_carefully`. Lanes in `bad` did not take the step.
    """
    text, size, all_lanes = Text(W), 8 * W, (1 << W) - 1
    integer, V = text.integer, text.V
    _add_runs(text, f"{name}_runs", for_each)
    text.add(f"define i64 @{name}(i64 %arguments) #0 {{")
    text.label("entry")
    a = ListArguments(*(text.load("i64", text.plus("%arguments", 8 * k)) for k in SLOT))
    text.jump("step")

    def place(row):
        return integer("add", a.rows, integer("mul", row, size))

    def truth(results, k):
        row = text.load("i64", integer("add", results, integer("mul", integer("add", a.D, k), 8)))
        return _truth(text, text.load(V, place(row)))

    def copy(label, rows, following, choose):
        """Add a loop that replaces components by choose(result, address of the component)."""
        text.jump(label)
        text.label(label)
        text.add(f"  %{label}_k = phi i64 [ 0, %{label}_from ], [ %{label}_k1, %{label} ]")
        row = text.load("i64", integer("add", rows, integer("mul", f"%{label}_k", 8)))
        at = place(f"%{label}_k")
        text.store(V, choose(text.load(V, place(row)), at), at)
        text.add(f"  %{label}_k1 = add i64 %{label}_k, 1")
        text.branch(text.compare_integers("ult", f"%{label}_k1", a.D), label, following)

    def run(heads, places, count):
        numbers = ", ".join(f"i64 {value}" for value in (a.rows, a.table, heads, places, count))
        text.add(f"  call void @{name}_runs({numbers})")

    text.label("step")
    text.add("  %n = phi i64 [ 0, %entry ], [ %n1, %taken ]")
    run(a.heads, a.places, a.runs)
    text.branch(text.all_true(truth(a.results, 0)), "usual_from", "rare_from", likely=True)
    text.label("usual_from")
    copy("usual", a.results, "taken", lambda value, at: value)

    text.label("rare_from")
    run(a.rare_heads, a.rare_places, a.rare_runs)
    accurate = truth(a.rare_results, 0)
    good, negative = text.bits(accurate), text.bits(truth(a.rare_results, 1))
    bad = integer("and", integer("xor", good, all_lanes), integer("xor", a.ended, all_lanes))
    told = integer("and", good, integer("xor", a.passed, all_lanes))
    changed = text.bits(truth(a.rare_results, a.changed))
    is_told = text.compare_integers("ne", a.changed, 0)
    changed = text.new(f"select i1 {is_told}, i64 {changed}, i64 0")
    negative = integer("or", negative, integer("shl", changed, CHANGED))
    told = integer("mul", told, 1 | 1 << CHANGED)
    rare = integer("or", bad, integer("shl", integer("and", negative, told), 8))
    copy("rare", a.rare_results, "taken",
         lambda value, at: text.select(accurate, value, text.load(V, at)))  # fmt: skip

    text.label("taken")
    text.add(f"  %bits = phi i64 [ 0, %usual ], [ {rare}, %rare ]")
    text.add("  %n1 = add i64 %n, 1")
    is_clear = text.compare_integers("eq", "%bits", 0)
    goes_on = text.new(f"and i1 {is_clear}, {text.compare_integers('ult', '%n1', a.steps)}")
    text.branch(goes_on, "step", "end")
    text.label("end")
    text.store("i64", "%n1", text.plus("%arguments", 8 * SLOT.n))
    text.add("  ret i64 %bits")
    return text.finished()


def _truth(text, value):
    """Return truth values from a row, in which all bits of a lane are equal."""
    integers = f"<{text.W} x i64>" if text.W > 1 else "i64"
    value = text.new(f"bitcast {text.V} {value} to {integers}")
    return text.new(f"icmp slt {integers} {value}, {'zeroinitializer' if text.W > 1 else 0}")


def _add_runs(text, name, for_each):
    """Add the function void name(rows, table, heads, places, count), which carries out runs."""
    integer = text.integer
    text.add(f"define internal void @{name}(i64 %rows, i64 %table, i64 %heads, i64 %places, "
             "i64 %count) #0 {")  # fmt: skip
    text.label("entry")
    end = integer("add", "%heads", integer("mul", "%count", 24))
    text.jump("run")
    text.label("run")
    text.add("  %head = phi i64 [ %heads, %entry ], [ %head1, %next ]")
    text.add("  %first = phi i64 [ %places, %entry ], [ %last, %next ]")
    kind, own, size = (text.load("i64", text.plus("%head", 8 * k)) for k in range(3))
    text.add(f"  %last = add i64 %first, {size}")
    ways = " ".join(f"i64 {number}, label %kind{number}" for number in range(len(KINDS)))
    text.add(f"  switch i64 {kind}, label %next [ {ways} ]")
    for number, (instruction, operands) in enumerate(KINDS):
        text.label(f"kind{number}")
        back = f"done{number}" if instruction == "sum0" else f"kind{number}"
        text.add(f"  %at{number} = phi i64 [ %first, %run ], [ %at{number}_1, %{back} ]")
        text.add(f"  %at{number}_1 = add i64 %at{number}, {own}")
        place = f"%at{number}"

        def operand(kind, at):
            return text.load(text.V, _at(text, "%rows", at)) if kind == "r" else _number(
                text, for_each, at)  # fmt: skip

        def operands_of(kinds, first, place=place):
            return [operand(kind, text.plus(place, 4 * k)) for k, kind in enumerate(kinds, first)]

        if instruction.startswith("sum"):
            value = _sum(text, number, instruction, operands, operands_of)
        else:
            value = _value(text, instruction, operands_of(operands, 1))
        text.store(text.V, value, _at(text, "%rows", place))
        text.branch(
            text.compare_integers("ult", f"%at{number}_1", "%last"), f"kind{number}", "next"
        )
    text.label("next")
    text.add("  %head1 = add i64 %head, 24")
    text.branch(text.compare_integers("ult", "%head1", end), "run", "end")
    text.label("end")
    text.add("  ret void")
    text.add("}")


def _at(text, rows, at):
    """Return the address of the row whose number is at an address."""
    row = text.new(f"zext i32 {text.load('i32', at, 4)} to i64")
    return text.integer("add", rows, text.integer("mul", row, 8 * text.W))


def _number(text, for_each, at):
    """Return a number of the table, whose place is at an address, for all lanes."""
    if for_each or text.W == 1:
        return text.load(text.V, _at(text, "%table", at))
    place = text.new(f"zext i32 {text.load('i32', at, 4)} to i64")
    place = text.integer("add", "%table", text.integer("mul", place, 8))
    return text.splat(text.load("double", place), text.W)


def _sum(text, number, instruction, kinds, operands_of):
    """Return the sum of an optional start and of products."""
    start, pair, place = kinds[:-2], kinds[-2:], f"%at{number}"
    total = operands_of(start, 1)[0] if start else None
    first = 1 + len(start)
    for n in range(int(instruction[-1]) or not start):
        term = text.operate("fmul", *operands_of(pair, first + 2 * n))
        total = term if total is None else text.operate("fadd", total, term)
    if instruction != "sum0":
        return total
    at = text.plus(place, 4 * (first + 2 * (not start)))  # a long sum has more products
    text.jump(f"terms{number}")
    text.label(f"terms{number}")
    text.add(f"  %at_term{number} = phi i64 [ {at}, %kind{number} ], "
             f"[ %at_term{number}_1, %terms{number} ]")  # fmt: skip
    text.add(f"  %sum{number} = phi {text.V} [ {total}, %kind{number} ], "
             f"[ %sum{number}_1, %terms{number} ]")  # fmt: skip
    term = text.operate("fmul", *operands_of(pair, 0, f"%at_term{number}"))
    text.add(f"  %sum{number}_1 = fadd {text.V} %sum{number}, {term}")
    text.add(f"  %at_term{number}_1 = add i64 %at_term{number}, 8")
    more = text.compare_integers("ult", f"%at_term{number}_1", f"{place}_1")
    text.branch(more, f"terms{number}", f"done{number}")
    text.label(f"done{number}")
    return f"%sum{number}_1"


def _value(text, instruction, operands):
    """Return the value of an instruction; truth values are numbers with equal bits."""
    kinds = f"<{text.W} x i64>" if text.W > 1 else "i64"
    if instruction in (*JOINING, "select"):
        count = 1 if instruction == "select" else 2
        operands = [_truth(text, value) for value in operands[:count]] + operands[count:]
    numbers = iter(range(len(operands)))
    values = dict(enumerate(operands))
    text.carry_out([(instruction, -1, tuple(numbers))], values, None)
    if instruction in OF_NUMBERS:
        return values[-1]
    bits = text.new(f"sext {text.M} {values[-1]} to {kinds}")
    return text.new(f"bitcast {kinds} {bits} to {text.V}")


def text_of_listed_step(step, name, *_):
    """Return the text of `generated.text_of_step` for a long list, on tables with constants."""
    programs, text, constants = programs_of(step), Text(1), []

    def constant(key, array):
        kind = f"[{array.size} x i{8 * array.itemsize}]"
        values = ", ".join(f"i{8 * array.itemsize} {value}" for value in array.ravel().tolist())
        constants.append(f"@{name}_{key} = internal constant {kind} [{values}]")
        return text.new(f"ptrtoint {pointer(kind)} @{name}_{key} to i64")

    text.add(f"define i64 @{name}(i64 %x, i64 %table) #0 {{")
    text.label("entry")
    rows, own = (
        text.new(f"ptrtoint {pointer('double')} {text.new(f'alloca double, i64 {size}')} to i64")
        for size in (programs.rows, len(SLOT))
    )
    numbers = {"rows": rows, "table": "%table", "D": step.D, "steps": 1}
    for prefix, program in (("", programs.usual), ("rare_", programs.rare)):
        numbers[f"{prefix}heads"] = constant(f"{prefix}heads", program.runs.heads)
        numbers[f"{prefix}places"] = constant(f"{prefix}places", program.runs.places)
        numbers[f"{prefix}runs"] = len(program.runs.heads)
        numbers[f"{prefix}results"] = constant(f"{prefix}results", program.results)
    for slot, key in enumerate(SLOT._fields):
        text.store("i64", numbers.get(key, 0), text.plus(own, 8 * slot))
    _copy(text, "before", "%x", rows, step.D)
    bits = text.new(f"call i64 @{name}_steps(i64 {own})")
    bad = text.compare_integers("ne", text.integer("and", bits, 1), 0)
    text.branch(bad, "bad", "good")
    text.label("bad")
    text.add("  ret i64 1")
    text.label("good")
    _copy(text, "after", rows, "%x", step.D)
    text.add(f"  ret i64 {text.integer('lshr', bits, 7)}")
    steps = text_of_listed_steps(None, f"{name}_steps", 1, False)
    return "\n".join([*constants, *text.lines, "}", steps])


def _copy(text, label, source, target, count):
    """Add a loop that copies numbers."""
    text.jump(f"{label}_from")
    text.label(f"{label}_from")
    text.jump(label)
    text.label(label)
    text.add(f"  %{label}_k = phi i64 [ 0, %{label}_from ], [ %{label}_k1, %{label} ]")
    offset = text.integer("mul", f"%{label}_k", 8)
    value = text.load("double", text.integer("add", source, offset))
    text.store("double", value, text.integer("add", target, offset))
    text.add(f"  %{label}_k1 = add i64 %{label}_k, 1")
    more = text.compare_integers("ult", f"%{label}_k1", count)
    text.branch(more, label, f"{label}_end")
    text.label(f"{label}_end")


_ANY = Step(np.empty((3, 0), np.int64), 1)  # the code does not depend on it


def listed_code(W, for_each):
    """Return the address of the code of `text_of_listed_steps`, None where LLVM refuses it."""
    return code_of(text_of_listed_steps, _ANY, W, for_each)


def text_of_runs(_, name, W, for_each, *_others):
    """Return the text of i64 name(arguments), which carries out runs once.

    The arguments are the first five integers of `ListArguments`. It returns 0.
    """
    text = Text(W)
    _add_runs(text, f"{name}_runs", for_each)
    text.add(f"define i64 @{name}(i64 %arguments) #0 {{")
    text.label("entry")
    numbers = [text.load("i64", text.plus("%arguments", 8 * k)) for k in range(5)]
    text.add(f"  call void @{name}_runs({', '.join(f'i64 {number}' for number in numbers)})")
    text.add("  ret i64 0")
    return text.finished()


def runs_code(W):
    """Return the address of the code of `text_of_runs`, None where LLVM refuses it."""
    return code_of(text_of_runs, _ANY, W)


def carry_out(address, runs, rows, table):
    """Carry out `listed.Runs` on rows of lanes, with numbers of a table."""
    of_runs = runs.heads.ctypes.data, runs.places.ctypes.data, len(runs.heads)
    call(address, np.array([rows.ctypes.data, table.ctypes.data, *of_runs], np.int64))


def taker_of(lines, address):
    """Return the function that takes steps of a line with `listed_code`, see `in_calls`."""
    step, W, D = lines.scheme.step, lines.W, lines.D
    programs, (ended, passed) = programs_of(step), lines.marks
    table = with_constants(lines.table, programs.constants)
    rows, addresses = _aligned(programs.rows, W), []
    for program in (programs.usual, programs.rare):
        heads, of_runs = program.runs
        addresses += heads.ctypes.data, of_runs.ctypes.data, len(heads), program.results.ctypes.data
    changed = 0 if step.changed is None else 2
    arguments = ListArguments(rows.ctypes.data, 0, *addresses, changed, D, 0, 0, 0, 0)
    arguments = np.array(arguments, np.int64)

    # `programs_of` may forget them, and does not keep those of all threads that begin at once.
    def take(line, place, most, _kept_alive=programs):
        rows[:D] = lines.x[line]
        arguments[SLOT.table] = table[place, line % table.shape[1]].ctypes.data
        arguments[SLOT.ended], arguments[SLOT.passed] = ended[line], passed[line]
        arguments[SLOT.steps] = most
        bits = call(address, arguments)
        lines.x[line] = rows[:D]
        return int(arguments[SLOT.n]), bits

    return take


def with_constants(table, constants):
    """Return a table (stages, lines, n, W) with constants after its numbers."""
    stages, lines, _, W = table.shape
    shape = stages, lines, len(constants), W
    constants = np.broadcast_to(constants[:, np.newaxis], shape)
    return np.ascontiguousarray(np.concatenate([table, constants], axis=2))


def _aligned(rows, W):
    """Return memory for rows, each of which is in as few cache lines as possible."""
    memory = np.empty(rows * W + 8)
    first = -memory.ctypes.data // 8 % 8
    return memory[first : first + rows * W].reshape(rows, W)
