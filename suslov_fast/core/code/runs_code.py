"""Machine code that carries out any `listed.Program`, for lines of W lanes."""

from typing import NamedTuple

import numpy as np

from ..compiling.codes import CHANGED
from ..lists.step import OF_NUMBERS, Step
from .compiler import Text, code_of
from .runs import CALLED, JOINING, KINDS, REGULAR, operand_kinds, programs_of
from .text import Code


class ListArguments(NamedTuple):
    """The integers of an array that the code of `text_of_listed_steps` takes."""

    rows: int  # address of the rows (-, W), of which the first D have the state
    tables: int  # address of the address of the numbers (n,) or (n, W) for each stage
    rare_tables: int  # the same of the rare program
    heads: int  # addresses of the usual `Runs`, and their number
    places: int
    runs: int
    results: int  # address of the rows of `Step.after` and `good`
    rare_heads: int  # 0 while they are not there
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
    bits: int  # of lanes, after a step


SLOT = ListArguments(*range(len(ListArguments._fields)))


def text_of_listed_steps(_, name, W, for_each, *_others):
    """Return the text of i64 name(arguments), see `ListArguments`: steps of one line of W lanes.

    A step is one stage. It ends after a step that is not accurate in some lane, or from det A < 0,
    and returns bits of these lanes: bad + 256 negative, as of `step_carefully`. Lanes in `bad` did
    not take the step. It ends with -1 before a step that needs rare runs which are not there.
    """
    text, all_lanes = Code(W), (1 << W) - 1
    integer = text.integer
    add_runs(text, f"{name}_runs", for_each)
    text.add(f"define i64 @{name}(i64 %arguments) #0 {{")
    text.label("entry")
    a = ListArguments(*(text.load("i64", text.plus("%arguments", 8 * k)) for k in SLOT))

    def get(slot):
        return text.load("i64", text.plus("%arguments", 8 * slot))

    def put(value, slot):
        text.store("i64", value, text.plus("%arguments", 8 * slot))

    def run(tables, heads, places, count):
        table = text.load("i64", text.at(tables, get(SLOT.stage)))
        numbers = ", ".join(f"i64 {value}" for value in (a.rows, table, heads, places, count))
        text.add(f"  call void @{name}_runs({numbers})")

    def truth(results, k):
        row = text.load("i64", text.at(results, integer("add", a.D, k)))
        return truth_of(text, text.row(a.rows, 0, row))

    def replace(results, choose):
        """Replace components by choose(result, component)."""

        def component(k):
            row = text.load("i64", text.at(results, k))
            value = text.row(a.rows, 0, row)
            text.put(choose(value, k), a.rows, 0, k)

        text.fold(a.D, {}, component)

    def take_usual():
        run(a.tables, a.heads, a.places, a.runs)
        is_usual = text.all_true(truth(a.results, 0))
        with text.when(is_usual, likely=True):
            replace(a.results, lambda value, k: value)
        put(text.new(f"select i1 {is_usual}, i64 0, i64 1"), SLOT.is_rare)

    def take_rare():
        run(a.rare_tables, a.rare_heads, a.rare_places, a.rare_runs)
        is_usual, accurate = text.all_true(truth(a.rare_results, 0)), truth(a.rare_results, 1)
        put(text.new(f"select i1 {is_usual}, i64 0, i64 1"), SLOT.is_rare)
        good, negative = text.bits(accurate), text.bits(truth(a.rare_results, 2))
        bad = integer("and", integer("xor", good, all_lanes), integer("xor", a.ended, all_lanes))
        told = integer("and", good, integer("xor", a.passed, all_lanes))
        changed = text.bits(truth(a.rare_results, a.changed))
        negative = integer("or", negative, integer("shl", changed, CHANGED))
        told = integer("mul", told, 1 | 1 << CHANGED)
        told = integer("shl", integer("and", negative, told), 8)
        put(integer("or", bad, told), SLOT.bits)
        replace(a.rare_results, lambda x, k: text.select(accurate, x, text.row(a.rows, 0, k)))

    put(0, SLOT.n)
    with text.repeat() as goes_on:
        put(0, SLOT.bits)
        with text.when(text.compare_integers("eq", get(SLOT.is_rare), 0)):
            take_usual()
        with text.when(text.compare_integers("ne", get(SLOT.is_rare), 0)):
            has_rare = text.compare_integers("ne", a.rare_heads, 0)
            put(text.new(f"select i1 {has_rare}, i64 0, i64 -1"), SLOT.bits)
            with text.when(has_rare):
                take_rare()
        bits = get(SLOT.bits)
        taken = text.new(f"zext i1 {text.compare_integers('sge', bits, 0)} to i64")
        n, following = (integer("add", get(slot), taken) for slot in (SLOT.n, SLOT.stage))
        is_last = text.compare_integers("eq", following, a.stages)
        put(text.new(f"select i1 {is_last}, i64 0, i64 {following}"), SLOT.stage)
        put(n, SLOT.n)
        is_clear = text.compare_integers("eq", bits, 0)
        has_more = text.compare_integers("ult", n, a.steps)
        goes_on.append(text.new(f"and i1 {is_clear}, {has_more}"))
    text.add(f"  ret i64 {bits}")
    return text.finished()


def truth_of(text, value):
    """Return truth values from a row, in which all bits of a lane are equal."""
    integers = f"<{text.W} x i64>" if text.W > 1 else "i64"
    value = text.new(f"bitcast {text.V} {value} to {integers}")
    return text.new(f"icmp slt {integers} {value}, {'zeroinitializer' if text.W > 1 else 0}")


def add_runs(text, name, for_each, called=(), only=None):
    """Add the function void name(rows, table, heads, places, count), which carries out runs.

    Of the functions in CALLED it has these alone, because each takes longer to compile than all
    others; and of all instructions only those that begin with one of `only`, if it is given.
    """
    integer = text.integer
    own_kinds = [k for k, kind in enumerate(KINDS) if kind[0] in called or kind[0] not in CALLED]
    if only is not None:
        own_kinds = [k for k in own_kinds if KINDS[k][0].startswith(only)]
    regular = [k for k in REGULAR if k in own_kinds]
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
    ways += [f"i64 {len(KINDS) + number}, label %regular{number}" for number in regular]
    text.add(f"  switch i64 {kind}, label %next [ {' '.join(ways)} ]")
    for number in own_kinds:
        _add_run(text, number, own, for_each)
    for number in regular:
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
        operands = [truth_of(text, value) for value in operands[:count]] + operands[count:]
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
    """Return the text of `generated.text_of_step` for a long list; its table is `numbers_of`."""
    programs, text = programs_of(step), Code(1)
    text.add(f"define i64 @{name}(i64 %x, i64 %table) #0 {{")
    text.label("entry")
    rows = text.memory(max(programs.usual.rows, programs.rare.rows))
    own, tables = text.memory(len(SLOT)), text.memory(2)
    text.store("i64", "%table", tables)
    text.store("i64", text.plus("%table", 8 * programs.usual.numbers.count), text.plus(tables, 8))
    numbers = {
        "rows": rows, "tables": tables, "rare_tables": text.plus(tables, 8), "changed": 2,
        "D": step.D, "steps": 1, "stages": 1,
    }  # fmt: skip
    for prefix, program in (("", programs.usual), ("rare_", programs.rare)):
        for key, array in zip(("heads", "places"), program.runs, strict=True):
            numbers[prefix + key] = text.integers(f"{name}_{prefix}{key}", array)
        numbers[f"{prefix}runs"] = len(program.runs.heads)
        numbers[f"{prefix}results"] = text.integers(f"{name}_{prefix}results", program.results)
    for slot, key in enumerate(SLOT._fields):
        text.store("i64", numbers.get(key, 0), text.plus(own, 8 * slot))
    text.copy("%x", rows, step.D)
    bits = text.new(f"call i64 @{name}_steps(i64 {own})")
    good = text.compare_integers("eq", text.integer("and", bits, 1), 0)
    with text.when(good):
        text.copy(rows, "%x", step.D)
    negative = text.integer("and", text.integer("lshr", bits, 7), 2)
    text.add(f"  ret i64 {text.new(f'select i1 {good}, i64 {negative}, i64 1')}")
    steps = text_of_listed_steps(None, f"{name}_steps", 1, False)
    return "\n".join([*text.constants, *text.lines, "}", steps])


def numbers_of(step, table):
    """Return the numbers (-, W) that both programs of a long list read, from its table (n, W)."""
    programs = programs_of(step)
    return np.concatenate([each.numbers.of(table) for each in (programs.usual, programs.rare)])


ANY = Step(np.empty((3, 0), np.int64), 1)  # the code does not depend on it


def listed_code(W, for_each):
    """Return the address of the code of `text_of_listed_steps`, None where LLVM refuses it."""
    return code_of(text_of_listed_steps, ANY, W, for_each)
