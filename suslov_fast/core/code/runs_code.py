"""Machine code that carries out any `runs.Program`, for lines of W lanes."""

import functools
from typing import NamedTuple

from ..compiling.codes import CHANGED
from ..lists.step import OF_NUMBERS
from .runs import CALLED, JOINING, KINDS
from .text import Carried, Code, Index, Integers, Truth, Value


class StagePlan(NamedTuple):
    """The integers of an array that the code of `text_of_stage_by_runs` takes."""

    rows: int  # address of memory for the rows of both programs
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
    is_rare: int  # 1 if the last stage was rare; the next one then begins with the rare runs


SLOT = StagePlan(*range(len(StagePlan._fields)))


def text_of_stage_by_runs(name, W, for_each):
    """Return the text of i64 name(x, tables, plan): a stage of a line x (D, W), in place.

    `tables` is the address of the addresses of the numbers of both programs, (n,) or (n, W), and
    `plan` that of a `StagePlan`. The code returns bits of lanes: bad + 256 told. Lanes in `bad` did
    not take the stage, because it is not accurate. Of others those in `told` took it from
    det A < 0, or from CHANGED on a component changed its sign. It returns -1, and does nothing,
    where it needs the rare runs while they are not there.
    """
    text = Code(W)
    add_runs(text, f"{name}_runs", for_each)
    text.begin(name, "x", "tables", "plan")
    x, tables, plan = text.array("%x"), Integers(text, "%tables"), Integers(text, "%plan")
    a = StagePlan(*(plan[k] for k in SLOT))
    rows = text.array(a.rows)

    def run(program, heads, places, count, results):
        """Carry out a program; return the function that finds its results."""
        text.copy(x, rows, a.D)
        text.invoke(f"{name}_runs", rows, tables[program], heads, places, count)
        of = Integers(text, results)
        return lambda k: rows[of[k]]

    with text.when(a.is_rare.equals(0), likely=True):
        take_if_good(text, x, a.D, run(0, a.heads, a.places, a.runs, a.results))
        plan[SLOT.is_rare] = 1
    with text.when(a.rare_heads.equals(0)):
        text.leave("i64 -1")
    result = run(1, a.rare_heads, a.rare_places, a.rare_runs, a.rare_results)
    plan[SLOT.is_rare] = truth_of(text, result(a.D)).all().select(0, 1)
    take_accurate(text, x, a.D, result, a.D + 1, a.D + a.changed)
    return text.finished()


def take_if_good(text, x, D, result):
    """Add the stage of lanes that are all `good`, whose next state and `good` are results."""
    with text.when(truth_of(text, result(D)).all(), likely=True):
        for k in text.each(D):
            x[k] = result(k)
        text.leave("i64 0")


def take_accurate(text, x, D, result, first, changed):
    """Add the stage of lanes that are `accurate`, and return bits, see `text_of_stage_by_runs`.

    `first` is the place of `accurate` and `negative` among the results, that of `changed` is given.
    """
    accurate = truth_of(text, result(first))
    good, told = accurate.bits(), truth_of(text, result(first + 1)).bits()
    told = told | truth_of(text, result(changed)).bits() << CHANGED
    for k in text.each(D):
        x[k] = accurate.select(result(k), x[k])
    told = told & good * (1 | 1 << CHANGED)
    text.add(f"  ret i64 {good ^ ((1 << text.W) - 1) | told << 8}")


def truth_of(text, value):
    """Return truth values from a row, in which all bits of a lane are equal."""
    value = text.new(f"bitcast {text.V} {value} to {text.I}")
    zero = "zeroinitializer" if text.W > 1 else 0
    return Truth(text, text.new(f"icmp slt {text.I} {value}, {zero}"))


def add_runs(text, name, for_each, called=(), only_sums=False):
    """Add the function void name(rows, table, heads, places, count), which carries out runs.

    Of the functions in CALLED it has these alone, because each takes longer to compile than all
    others; with `only_sums` it has sums alone.
    """
    own_kinds = [k for k, kind in enumerate(KINDS) if kind[0] in called or kind[0] not in CALLED]
    if only_sums:
        own_kinds = [k for k in own_kinds if KINDS[k][0].startswith("sum")]
    with text.function(name, ("rows", "table", "heads", "places", "count")):
        first, places, count = (Index(text, f"%{key}") for key in ("heads", "places", "count"))
        end = first + count * 24
        with text.when(count.equals(0), likely=False):
            text.leave("void")
        for now in text.rounds(Carried(head=first, places=places)):
            head = Integers(text, now.head)
            kind, own, size = (head[k] for k in range(3))
            last, cases = now.places + size, {}
            given = own, for_each, now.places, last
            for k in own_kinds:
                cases[k] = functools.partial(_add_run, text, k, *given)
            text.switch(kind, cases)
            now.head, now.places = now.head + 24, last
            now.goes_on = now.head < end


def _add_run(text, number, size, for_each, begin, end):
    """Add the loop of a run of a kind, whose operations have places of this size in bytes."""
    for now in text.rounds(Carried(place=begin)):
        place, following = now.place, now.place + size

        def operand(k, kind, at=place):
            return _load(text, kind, _address(text, kind, at, k, for_each), for_each)

        value = _value(text, number, operand, place, following)
        text.store(text.V, value, _address(text, "r", place, 0, for_each))
        now.place, now.goes_on = following, following < end


def _address(text, kind, at, k, for_each):
    """Return the address of an operand, whose place is the k-th number at an address."""
    place, base = text.short(at, k), Index(text, "%rows" if kind == "r" else "%table")
    return base + place * (text.size if kind == "r" or for_each else 8)


def _load(text, kind, address, for_each):
    """Return a row at an address, or a number of the table for all lanes."""
    if kind == "r" or for_each:
        return Value(text, text.load(text.V, address))
    return text.splat(text.load("double", address))


def _value(text, number, operand, begin, end):
    """Return the value of an operation of a kind; truth values are numbers with equal bits.

    operand(k, kind) is its k-th operand, and operand(k, kind, at) the one whose place is the k-th
    number at an address. Its places are between the addresses `begin` and `end`.
    """
    instruction, operands = KINDS[number]
    if instruction.startswith("sum"):
        return _sum(text, number, operand, begin, end)
    operands = [operand(k, kind) for k, kind in enumerate(operands, 1)]
    if instruction in (*JOINING, "select"):
        count = 1 if instruction == "select" else 2
        operands = [truth_of(text, value) for value in operands[:count]] + operands[count:]
    values = dict(enumerate(operands))
    text.carry_out([(instruction, -1, tuple(values))], values, None)
    if instruction in OF_NUMBERS:
        return values[-1]
    bits = text.new(f"sext {text.M} {values[-1]} to {text.I}")
    return text.new(f"bitcast {text.I} {bits} to {text.V}")


def _sum(text, number, operand, begin, end):
    """Return the sum of an optional start and of products."""
    instruction, kinds = KINDS[number]
    start, (one, other) = kinds[:-2], kinds[-2:]
    total, first = operand(1, start) if start else None, 1 + len(start)
    for k in range(first, first + 2 * (int(instruction[-1]) or not start), 2):
        term = operand(k, one) * operand(k + 1, other)
        total = term if total is None else total + term
    if instruction != "sum0":
        return total
    at = begin + 4 * (first + 2 * (not start))
    for now in text.rounds(Carried(at=at, total=total)):  # it has more products
        term = operand(0, one, now.at) * operand(1, other, now.at)
        now.at, now.total = now.at + 8, now.total + term
        now.goes_on = now.at < end
    return now.total
