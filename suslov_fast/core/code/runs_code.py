"""Machine code that carries out any `listed.Program`, for lines of W lanes."""

from typing import NamedTuple

import numpy as np

from ..compiling.codes import CHANGED
from ..lists.step import OF_NUMBERS, Step
from .compiler import Text, code_of, pointer
from .runs import CALLED, JOINING, KINDS, REGULAR, operand_kinds, programs_of


class ListArguments(NamedTuple):
    """The integers of an array that the code of `text_of_listed_steps` takes."""

    rows: int  # address of the rows (-, W), of which the first D have the state
    tables: int  # address of the address of a table (n,) or (n, W) for each stage
    heads: int  # addresses of the usual `Runs`, and their number
    places: int
    runs: int
    results: int  # address of the rows of `Step.after` and `good`
    rare_heads: int
    rare_places: int
    rare_runs: int
    rare_results: int  # of `after_rare`, `good`, `accurate`, `negative` and `changed`
    changed: int  # place of `changed` among the results, that of `negative` if there is none
    D: int
    ended: int  # bits of lanes, which are those of `generated.CodeArguments.marks`
    passed: int
    steps: int  # stages to take
    stages: int  # of a whole step
    stage: int  # the next one
    n: int  # stages taken
    is_rare: int  # 1 if the last step was; a step after it begins with the rare runs


SLOT = ListArguments(*range(len(ListArguments._fields)))


def text_of_listed_steps(_, name, W, for_each, *_others):
    """Return the text of i64 name(arguments), see `ListArguments`: steps of one line of W lanes.

    A step is one stage. It ends after a step that is not accurate in some lane, or from det A < 0,
    and returns bits of these lanes: bad + 256 negative, as of `step_carefully`. Lanes in `bad` did
    not take the step.
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

    def run(rows, table, heads, places, count):
        numbers = ", ".join(f"i64 {value}" for value in (rows, table, heads, places, count))
        text.add(f"  call void @{name}_runs({numbers})")

    text.label("step")
    text.add("  %n = phi i64 [ 0, %entry ], [ %n1, %taken ]")
    text.add(f"  %stage = phi i64 [ {a.stage}, %entry ], [ %stage1, %taken ]")
    text.add(f"  %was_rare = phi i64 [ {a.is_rare}, %entry ], [ %is_rare, %taken ]")
    table = text.load("i64", integer("add", a.tables, integer("mul", "%stage", 8)))
    text.branch(text.compare_integers("eq", "%was_rare", 0), "try_usual", "rare_from")
    text.label("try_usual")
    run(a.rows, table, a.heads, a.places, a.runs)
    text.branch(text.all_true(truth(a.results, 0)), "usual_from", "rare_from", likely=True)
    text.label("usual_from")
    copy("usual", a.results, "taken", lambda value, at: value)

    text.label("rare_from")
    run(a.rows, table, a.rare_heads, a.rare_places, a.rare_runs)
    not_usual = text.new(f"xor i1 {text.all_true(truth(a.rare_results, 0))}, true")
    remains_rare, accurate = text.new(f"zext i1 {not_usual} to i64"), truth(a.rare_results, 1)
    good, negative = text.bits(accurate), text.bits(truth(a.rare_results, 2))
    bad = integer("and", integer("xor", good, all_lanes), integer("xor", a.ended, all_lanes))
    told = integer("and", good, integer("xor", a.passed, all_lanes))
    changed = text.bits(truth(a.rare_results, a.changed))
    negative = integer("or", negative, integer("shl", changed, CHANGED))
    told = integer("mul", told, 1 | 1 << CHANGED)
    rare = integer("or", bad, integer("shl", integer("and", negative, told), 8))
    copy("rare", a.rare_results, "taken",
         lambda value, at: text.select(accurate, value, text.load(V, at)))  # fmt: skip

    text.label("taken")
    text.add(f"  %bits = phi i64 [ 0, %usual ], [ {rare}, %rare ]")
    text.add(f"  %is_rare = phi i64 [ 0, %usual ], [ {remains_rare}, %rare ]")
    text.add("  %n1 = add i64 %n, 1")
    following = integer("add", "%stage", 1)
    is_last = text.compare_integers("eq", following, a.stages)
    text.add(f"  %stage1 = select i1 {is_last}, i64 0, i64 {following}")
    is_clear = text.compare_integers("eq", "%bits", 0)
    goes_on = text.new(f"and i1 {is_clear}, {text.compare_integers('ult', '%n1', a.steps)}")
    text.branch(goes_on, "step", "end")
    text.label("end")
    text.store("i64", "%n1", text.plus("%arguments", 8 * SLOT.n))
    text.store("i64", "%is_rare", text.plus("%arguments", 8 * SLOT.is_rare))
    text.add("  ret i64 %bits")
    return text.finished()


def _truth(text, value):
    """Return truth values from a row, in which all bits of a lane are equal."""
    integers = f"<{text.W} x i64>" if text.W > 1 else "i64"
    value = text.new(f"bitcast {text.V} {value} to {integers}")
    return text.new(f"icmp slt {integers} {value}, {'zeroinitializer' if text.W > 1 else 0}")


def _add_runs(text, name, for_each, called=()):
    """Add the function void name(rows, table, heads, places, count), which carries out runs.

    Of the functions in CALLED it has these alone, because each takes longer to compile than all
    others.
    """
    integer = text.integer
    own_kinds = [k for k, kind in enumerate(KINDS) if kind[0] in called or kind[0] not in CALLED]
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
    ways = [f"i64 {number}, label %run{number}" for number in own_kinds]
    ways += [f"i64 {len(KINDS) + number}, label %regular{number}" for number in REGULAR]
    text.add(f"  switch i64 {kind}, label %next [ {' '.join(ways)} ]")
    for number in own_kinds:
        _add_run(text, number, own, for_each)
    for number in REGULAR:
        _add_regular_run(text, number, own, for_each)
    text.label("next")
    text.add("  %head1 = add i64 %head, 24")
    text.branch(text.compare_integers("ult", "%head1", end), "run", "end")
    text.label("end")
    text.add("  ret void")
    text.add("}")


def _add_run(text, number, size, for_each):
    """Add the loop of a run of a kind, whose operations have places of this size in bytes."""
    place, before = f"%at{number}", "done_run" if KINDS[number][0] == "sum0" else "run"
    text.label(f"run{number}")
    text.add(f"  {place} = phi i64 [ %first, %run ], [ {place}_1, %{before}{number} ]")
    text.add(f"  {place}_1 = add i64 {place}, {size}")

    def operand(k, kind, at=place):
        return _load(text, kind, _address(text, kind, at, k, for_each), for_each)

    value = _value(text, number, operand, place, f"{place}_1")
    text.store(text.V, value, _address(text, "r", place, 0, for_each))
    text.branch(text.compare_integers("ult", f"{place}_1", "%last"), f"run{number}", "next")


def _add_regular_run(text, number, count, for_each):
    """Add the loop of a regular run of a kind, whose operands are in rows that follow each other.

    It takes four operations of a single lane at once, and some of the last four twice.
    """
    integer, at_once = text.integer, 4 if text.W == 1 else 1
    inner, kinds = Text(max(text.W, at_once), text), f"r{operand_kinds(number)}"
    text.label(f"regular{number}")
    firsts = [_address(text, kind, "%first", k, for_each) for k, kind in enumerate(kinds)]
    last = integer("sub", count, at_once)
    times = integer("udiv", text.plus(count, at_once - 1), at_once)
    with text.loop(f"regular_{number}", times) as n:
        n = integer("mul", n, at_once)
        n = text.new(f"select i1 {text.compare_integers('ult', n, last)}, i64 {n}, i64 {last}")

        def following(kind, address):
            return integer("add", address, integer("mul", n, _size(text, kind, for_each)))

        def operand(k, kind, at=None):
            first = firsts[k] if at is None else _address(text, kind, at, k, for_each)
            return _load(inner, kind, following(kind, first), for_each)

        value = _value(inner, number, operand, "%first", "%last")
        inner.store(inner.V, value, following("r", firsts[0]))
    text.jump("next")


def _size(text, kind, for_each):
    """Return the bytes of a row, or of a number of the table for all lanes."""
    return 8 * text.W if kind == "r" or for_each else 8


def _address(text, kind, at, k, for_each):
    """Return the address of an operand, whose place is the k-th number at an address."""
    place = text.new(f"zext i32 {text.load('i32', text.plus(at, 4 * k), 4)} to i64")
    base = "%rows" if kind == "r" else "%table"
    return text.integer("add", base, text.integer("mul", place, _size(text, kind, for_each)))


def _load(text, kind, address, for_each):
    """Return a row at an address, or a number of the table for all lanes."""
    if kind == "r" or for_each or text.target.W == 1:
        return text.load(text.V, address)
    return text.splat(text.load("double", address), text.W)


def _value(text, number, operand, begin, end):
    """Return the value of an operation of a kind; truth values are numbers with equal bits.

    operand(k, kind) is its k-th operand, and operand(k, kind, at) the one whose place is the k-th
    number at an address. Its places are between the addresses `begin` and `end`.
    """
    instruction, operands = KINDS[number]
    if instruction.startswith("sum"):
        return _sum(text, number, operand, begin, end)
    operands = [operand(k, kind) for k, kind in enumerate(operands, 1)]
    if instruction == "copy":
        return operands[0]
    if instruction in (*JOINING, "select"):
        count = 1 if instruction == "select" else 2
        operands = [_truth(text, value) for value in operands[:count]] + operands[count:]
    values = dict(enumerate(operands))
    text.carry_out([(instruction, -1, tuple(values))], values, None)
    if instruction in OF_NUMBERS:
        return values[-1]
    kinds = f"<{text.W} x i64>" if text.W > 1 else "i64"
    bits = text.new(f"sext {text.M} {values[-1]} to {kinds}")
    return text.new(f"bitcast {kinds} {bits} to {text.V}")


def _sum(text, number, operand, begin, end):
    """Return the sum of an optional start and of products."""
    instruction, kinds = KINDS[number]
    start, (one, other), outer = kinds[:-2], kinds[-2:], text.target
    total, first, before = operand(1, start) if start else None, 1 + len(start), outer.block
    for k in range(first, first + 2 * (int(instruction[-1]) or not start), 2):
        term = text.operate("fmul", operand(k, one), operand(k + 1, other))
        total = term if total is None else text.operate("fadd", total, term)
    if instruction != "sum0":
        return total
    at, label = text.plus(begin, 4 * (first + 2 * (not start))), f"terms_{before}"
    outer.jump(label)  # a long sum has more products
    outer.label(label)
    text.add(f"  %at_{label} = phi i64 [ {at}, %{before} ], [ %at_{label}_1, %{label} ]")
    text.add(f"  %{label}_0 = phi {text.V} [ {total}, %{before} ], [ %{label}_1, %{label} ]")
    term = text.operate("fmul", operand(0, one, f"%at_{label}"), operand(1, other, f"%at_{label}"))
    text.add(f"  %{label}_1 = fadd {text.V} %{label}_0, {term}")
    text.add(f"  %at_{label}_1 = add i64 %at_{label}, 8")
    more = text.compare_integers("ult", f"%at_{label}_1", end)
    text.branch(more, label, f"done_{before}")
    outer.label(f"done_{before}")
    return f"%{label}_1"


def text_of_listed_step(step, name, *_):
    """Return the text of `generated.text_of_step` for a long list, on tables with constants."""
    programs, text, constants = programs_of(step), Text(1), []

    def constant(key, array):
        return _constant(text, f"{name}_{key}", array, constants)

    text.add(f"define i64 @{name}(i64 %x, i64 %table) #0 {{")
    text.label("entry")
    rows, own = (_memory(text, size) for size in (programs.rows, len(SLOT)))
    tables = _memory(text, 1)
    text.store("i64", "%table", tables)
    numbers = {"rows": rows, "tables": tables, "changed": 2, "D": step.D, "steps": 1, "stages": 1}
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
    text.add(f"  ret i64 {text.integer('and', text.integer('lshr', bits, 7), 2)}")
    steps = text_of_listed_steps(None, f"{name}_steps", 1, False)
    return "\n".join([*constants, *text.lines, "}", steps])


def _constant(text, name, array, constants):
    """Return the address of an array of integers, whose text is added to `constants`."""
    kind = f"[{array.size} x i{8 * array.itemsize}]"
    values = ", ".join(f"i{8 * array.itemsize} {value}" for value in array.ravel().tolist())
    constants.append(f"@{name} = internal constant {kind} [{values}]")
    return text.new(f"ptrtoint {pointer(kind)} @{name} to i64")


def _memory(text, size):
    """Return the address of memory for numbers, on the stack."""
    return text.new(f"ptrtoint {pointer('double')} {text.new(f'alloca double, i64 {size}')} to i64")


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
