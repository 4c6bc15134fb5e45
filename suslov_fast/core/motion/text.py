"""Machine code of the motion: the whole step of a line of lanes as LLVM's text, for each half.

The two halves share everything but their columns and the rule for the next step. Lists of
operations (`RightHandSide`, `Elimination`, `rules`) are straight-line code; this file has the
control around them. Rows stand in memory, and loops over components are written out for few.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from ..code.compiler import numbers_in_register
from ..code.text import Code, bits_of
from ..lists.conditions import choices_of
from ..lists.tables import Table, is_table
from . import rules
from .columns import (
    CHAINS,
    EXPLICIT,
    IMPLICIT,
    ONE_CHAIN,
    in_turn,
    weights,
    weights_of_errors,
    weights_of_few,
)
from .rows import State

INLINED = 160  # operations of f that stand within the loop of sub-steps, rather than a call
# Operations of f, and three for each component, up to which all sub-steps are written out: that
# spares branches, but more of them would leave the cache for code.
SHORT = 25


class Arguments(NamedTuple):
    """The integers of an array that the code takes."""

    rows: int  # address of the rows of trajectories (count, rows)
    count: int
    following: int  # number of the trajectory that the next free lane takes; the code changes it
    budget: int  # steps of all lanes, after which the code returns
    table: int  # address of the table (n,) or (count, n)
    table_bytes: int  # from trajectory to trajectory
    work: int  # address of the rows of `Work`
    numbers: int  # address of `Numbers`
    components: int  # address of the rows of `Component` (4, D)
    times: int  # address of the moduli of times, ascending (times_count,)
    times_count: int
    states: int  # address of the states at these times (count, trajectories, D)
    state_bytes: int  # of one time


class Component(NamedTuple):
    """Numbers of a component that all lanes share."""

    extra: float  # what is added to the allowed error: atol, infinity for clocks
    counts: float  # 1, for clocks 0
    keeps: float  # 1 for components that keep their sign, else 0
    seeds: float  # what is added to the vector of the power iteration


class Numbers(NamedTuple):
    """The numbers that all lanes share."""

    rtol: float
    last: float  # modulus of the last time
    sign: float  # 1 or -1, forward or backward in time
    part: float  # see `rules.first_part`
    longest: float  # step
    limit: float  # see `rules.limit_of`
    switches: float  # 1 if lanes may change to the other half, else 0
    first_next: float  # the first time
    first_state: float  # `State.EXPLICIT` or `State.IMPLICIT`
    most: float  # steps, also refused ones, from one time to the next
    stops: float  # 1 if steps end on surfaces, else 0


LANES = 1 + len(CHAINS)  # of columns of one trajectory: a chain each, and the first one again
SLOT, NUMBER, COMPONENT = (
    kind(*range(len(kind._fields))) for kind in (Arguments, Numbers, Component)
)


def lane_numbers(half):
    """Return how many numbers columns in lanes need, after the rows of `Work` of one trajectory."""
    own = 8 * half.f.D + len(half.f.denominators)
    return LANES * (own + half.functions["f"].scratch)


def text_of_half(half, name, W, for_each):
    """Return the text of i64 name(arguments), see `Arguments`, for a `Half`.

    It takes steps of all trajectories in this half and returns 1; or 0 when the budget is spent, to
    go on in the next call. A lane whose trajectory ends takes the next one.
    """
    return _Steps(half, name, W, for_each).finished()


class _Steps:
    """The text of the steps of one half, block by block."""

    def __init__(self, half, name, W, for_each):
        self.half, self.name, self.for_each = half, name, for_each
        self.text, self.f, self.D = Code(W), half.f, half.f.D
        self.extended = self.D + len(self.f.denominators)
        self.rows, self.work = half.rows, half.work
        self.columns = IMPLICIT if half.is_implicit else EXPLICIT
        self.p = 1 if half.is_implicit else 2
        self.is_inlined = half.functions["f"].length <= INLINED

    def finished(self):
        """Return the whole text."""
        firsts, W = self.half.firsts(), self.text.W
        self.text.called = {a for each in self.half.functions.values() for a in each.called}
        for name, function in self.half.functions.items():
            function.add(self.text, f"{self.name}_{name}", self.for_each, firsts[name])
        function = self.half.functions["f"]
        self.columns_are_lanes = W == 1 and not self.half.is_implicit and function.length < np.inf
        if self.columns_are_lanes:
            self.columns_in_lanes()
        else:
            self.columns_function()
        self.main()
        return self.text.finished()

    def call(self, name, *addresses):
        """Call one of the functions, on rows; `base` is the address of the rows of `Work`."""
        scratch = self.text.place(self.base, self.work.scratch)
        self.call_with(name, *addresses, scratch)

    def call_with(self, name, *addresses):
        numbers = ", ".join(f"i64 {address}" for address in addresses)
        self.text.add(f"  call void @{self.name}_{name}({numbers})")

    # -------------------------------------------------------------------------------------- columns
    def columns_function(self):
        """Add void columns(x, f, table, work, count): the ends y_c - x of the first columns.

        `x` and `f` are the addresses of the rows of a state and of f there. The length of the step
        is in the row `signed` of `work`.
        """
        text, self.base = self.text, "%work"
        text.add(f"define internal void @{self.name}_columns(i64 %x, i64 %f, i64 %table, "
                 "i64 %work, i64 %count) #0 {")  # fmt: skip
        text.label("entry")
        if self.half.is_implicit:
            self.implicit_columns()
        else:
            self.explicit_columns()
        text.add("  ret void")
        text.add("}")

    def table(self, name, values):
        """Return the address of a table of integers or of numbers."""
        values = np.array(values)
        add = self.text.numbers if values.dtype == float else self.text.integers
        return add(f"{self.name}_{name}", values)

    def explicit_columns(self):
        """Add Gragg's midpoint rule with smoothing.

        y_N of the last column and f there stay in the rows `a` and `f_last`. Where f is within the
        code and calls no function, lanes of one register take turns, because registers are few.
        """
        inner, W, f = self.text, numbers_in_register(), self.half.functions["f"]
        if self.is_inlined and W < self.text.W and not f.calls:
            inner = Code(W, self.text)
            inner.size = self.text.size
        if f.length + 3 * self.D > SHORT or f.calls_by_lane:
            self.columns_in_turn(inner)
            return
        are_all = self.text.compare_integers("eq", "%count", len(EXPLICIT))
        with self.text.when(are_all):
            self.columns_side_by_side(inner)
            self.text.leave("void")
        self.columns_in_turn(inner)

    def columns_side_by_side(self, inner):
        """Add all columns as straight-line code for a register of lanes."""
        text, work, D = self.text, self.work, self.D
        with text.times(text.W // inner.W) as part:
            offset = text.integer("mul", part, 8 * inner.W)
            x, f, lanes = (text.integer("add", each, offset) for each in ("%x", "%f", "%work"))
            table = text.integer("add", "%table", offset) if self.for_each else "%table"
            x, f = ([inner.row(each, 0, i) for i in range(D)] for each in (x, f))
            h, states = inner.row(lanes, work.signed), {}
            for m, N in ((m, N) for m in range(max(EXPLICIT) // 2) for N in EXPLICIT if 2 * m < N):
                s = inner.operate("fmul", h, inner.constant(1.0 / N))
                double, ends = inner.operate("fadd", s, s), 2 * m + 2 == N
                if m == 0:
                    states[N] = x, added(inner, x, s, f)
                a, b = states[N]
                a = added(inner, a, double, self.value(inner, b, table))
                of_a = self.value(inner, a, table)
                states[N] = a, added(inner, b, s if ends else double, of_a)
                if ends:
                    to = work.ends + EXPLICIT.index(N) * D
                    for i, each in enumerate(zip(*states[N], x, strict=True)):
                        inner.put(end_of_column(inner, *each), lanes, to, i)
            for i, (a, f) in enumerate(zip(states[N][0], of_a, strict=True)):
                inner.put(a, lanes, work.a, i)
                inner.put(f, lanes, work.f_last, i)

    def columns_in_turn(self, inner):
        """Add the first `count` columns, pair by pair of sub-steps."""
        text, work, D = self.text, self.work, self.D
        rounds = in_turn(CHAINS if self.is_inlined else ONE_CHAIN)
        pairs = [pair for each in rounds for pair in each]
        columns = self.table("column", [EXPLICIT.index(pair.N) for pair in pairs])
        inverses = self.table("inverse", [1.0 / pair.N for pair in pairs])
        rows = self.table("rows", [pair.chain * (work.chains - work.a) for pair in pairs])
        begins = self.table("begins", [int(pair.begins) for pair in pairs])
        ends = self.table("ends", [int(pair.ends) for pair in pairs])
        with text.times(len(pairs)) as k:
            column, begin, end, row = (
                text.load("i64", text.at(each, k)) for each in (columns, begins, ends, rows)
            )
            inverse = inner.shared(text.at(inverses, k))
            end = text.compare_integers("ne", end, 0)
            is_wanted = text.compare_integers("ult", column, "%count")
            with text.when(is_wanted), text.times(text.W // inner.W) as part:
                offset = text.integer("mul", part, 8 * inner.W)
                x, f, lanes = (text.integer("add", each, offset) for each in ("%x", "%f", "%work"))
                chain = text.place(lanes, 0, row)
                table = text.integer("add", "%table", offset) if self.for_each else "%table"
                s = inner.operate("fmul", inner.row(lanes, work.signed), inverse)
                double = inner.operate("fadd", s, s)
                factor = inner.new(f"select i1 {end}, {inner.V} {s}, {inner.V} {double}")
                with text.when(text.compare_integers("ne", begin, 0)):
                    self.begin_column(inner, chain, x, f, s)
                of_a = self.pair(inner, chain, table, (double, factor))
                with text.when(end):
                    to = text.place(lanes, work.ends, text.integer("mul", column, D))
                    self.end_column(inner, chain, x, of_a, to)

    def begin_column(self, inner, chain, x, f, s):
        work = self.work

        def start(i):
            state = inner.row(x, 0, i)
            inner.put(state, chain, work.a, i)
            product = inner.operate("fmul", s, inner.row(f, 0, i))
            inner.put(inner.operate("fadd", state, product), chain, work.b, i)

        self.text.fold(self.D, {}, start)

    def end_column(self, inner, chain, x, of_a, to):
        work = self.work

        def end(i):
            a, b = inner.row(chain, work.a, i), inner.row(chain, work.b, i)
            inner.put(end_of_column(inner, a, b, inner.row(x, 0, i)), to, 0, i)

        self.text.fold(self.D, {}, end)
        for i, value in enumerate(of_a):
            inner.put(value, chain, work.f_last, i)

    def columns_in_lanes(self):
        """Add the function `columns` of one trajectory, whose columns are lanes, side by side.

        Columns of 8 and 2 share a lane, as those of 6 and 4, so that ten values of f are computed
        one after the other in place of thirty. Ends have the bits of the columns of a line.
        """
        text, work, D, f = self.text, self.work, self.D, self.half.functions["f"]
        inner = Code(LANES, text)
        if not self.is_inlined:
            f.add(inner, f"{self.name}_f_lanes", False, 0)
        text.add(f"define internal void @{self.name}_columns(i64 %x, i64 %f, i64 %table, "
                 "i64 %work, i64 %count) #0 {")  # fmt: skip
        text.label("entry")
        rounds = [(*each, each[0]) for each in in_turn(CHAINS)]
        parts = self.table("parts", [[1.0 / pair.N for pair in each] for each in rounds])
        last = self.table("last", [[1.0 if pair.ends else 2.0 for pair in each] for each in rounds])
        begin = self.table("begin", [[float(pair.begins) for pair in each] for each in rounds])
        rows = text.place("%work", work.size)  # a, b and f of all lanes, then ends
        first_a, first_b, first_f, ends = 0, D, 2 * D, 2 * D + self.extended
        scratch = inner.place(rows, ends + len(rounds) * D)
        signed = inner.splat(text.row("%work", work.signed), LANES)

        def shared(base, i):
            return inner.splat(text.row(base, 0, i), LANES)

        with text.times(len(rounds)) as m:
            s = inner.operate("fmul", signed, inner.row(parts, 0, m))
            double = inner.operate("fadd", s, s)
            factor = inner.operate("fmul", s, inner.row(last, 0, m))
            begins = inner.compare("ogt", inner.row(begin, 0, m), inner.constant(0.0))

            def start(i):
                x = shared("%x", i)
                first = inner.operate("fadd", x, inner.operate("fmul", s, shared("%f", i)))
                for place, value in ((first_a, x), (first_b, first)):
                    old = inner.row(rows, place, i)
                    inner.put_chosen(inner.select(begins, value, old), rows, place, i)

            def add(i, to, factor):
                product = inner.operate("fmul", factor, inner.row(rows, first_f, i))
                inner.put(inner.operate("fadd", inner.row(rows, to, i), product), rows, to, i)

            with text.when(inner.any(begins)):
                text.fold(D, {}, start)
            if self.is_inlined:
                self.pair_of_rows(
                    inner, rows, (first_a, first_b, first_f), "%table", (double, factor)
                )
            else:
                for of, to, length in ((first_b, first_a, double), (first_a, first_b, factor)):
                    places = inner.place(rows, of), "%table", inner.place(rows, first_f)
                    self.call_with("f_lanes", *places, scratch)
                    text.fold(D, {}, lambda i, to=to, length=length: add(i, to, length))
            of_pair = text.integer("add", ends, text.integer("mul", m, D))

            def end(i):
                a, b = inner.row(rows, first_a, i), inner.row(rows, first_b, i)
                change = end_of_column(inner, a, b, shared("%x", i))
                inner.put(change, rows, 0, text.integer("add", of_pair, i))

            text.fold(D, {}, end)

        def lane(row, i, number):
            place = inner.place(rows, row, i)
            return text.load("double", text.plus(place, 8 * number))

        def copy(i):
            for m, each in enumerate(rounds):
                for number, pair in enumerate(each[:-1]):
                    if pair.ends:
                        of_pair = lane(ends + m * D, i, number)
                        text.put(of_pair, "%work", work.ends + EXPLICIT.index(pair.N) * D, i)
            text.put(lane(first_a, i, 0), "%work", work.a, i)
            text.put(lane(first_f, i, 0), "%work", work.f_last, i)

        text.fold(D, {}, copy)
        text.add("  ret void")
        text.add("}")

    def pair(self, inner, chain, table, factors):
        """Add two sub-steps; return f at the state after the first, [] if it is in its rows."""
        work = self.work
        if self.is_inlined:
            return self.pair_of_rows(inner, chain, (work.a, work.b), table, factors)
        for of, to, factor in ((work.b, work.a, factors[0]), (work.a, work.b, factors[1])):
            self.call("f", inner.place(chain, of), table, inner.place(chain, work.f_last))

            def add(i, to=to, factor=factor):
                product = inner.operate("fmul", factor, inner.row(chain, work.f_last, i))
                inner.put(inner.operate("fadd", inner.row(chain, to, i), product), chain, to, i)

            self.text.fold(self.D, {}, add)
        return []

    def pair_of_rows(self, inner, base, rows, table, factors):
        """Add two sub-steps with f within the code; return f at the state after the first.

        `rows` are those of a, of b, and of f at the new a, if it is wanted.
        """
        first_a, first_b, *first_f = rows
        b = [inner.row(base, first_b, i) for i in range(self.D)]
        of_b = self.value(inner, b, table)
        a = added(inner, [inner.row(base, first_a, i) for i in range(self.D)], factors[0], of_b)
        for i in range(self.D):  # before f there: registers are few
            inner.put(a[i], base, first_a, i)
        of_a = self.value(inner, a, table)
        others = zip((first_b, *first_f), (added(inner, b, factors[1], of_a), of_a), strict=False)
        for row, values in others:
            for i, value in enumerate(values):
                inner.put(value, base, row, i)
        return of_a

    def value(self, inner, x, table):
        """Return f at a state, with f within the code."""
        function, for_each = self.half.functions["f"], self.for_each and self.text.W > 1
        return function.values(inner, lambda k: x[k], table, for_each)[: self.D]

    def implicit_columns(self):
        text, work = self.text, self.work
        lengths = self.table("lengths", self.columns)
        inverses = self.table("inverses", [1.0 / N for N in self.columns])
        with text.times("%count") as c:
            N = text.load("i64", text.at(lengths, c))
            s = text.operate("fmul", text.row("%work", work.signed),
                             text.shared(text.at(inverses, c)))  # fmt: skip
            self.implicit_column(
                N, s, text.place("%work", work.ends, text.integer("mul", c, self.D))
            )

    def implicit_column(self, N, s, ends):
        """Add the linearly implicit Euler rule, whose increments are added up."""
        text, work, D = self.text, self.work, self.D
        text.put(s, "%work", work.jacobian, self.f.entries)
        jacobian, factors, a, b, right = (
            text.place("%work", k)
            for k in (work.jacobian, work.factors, work.a, work.b, work.right)
        )
        self.call("factor", jacobian, "%table", factors)

        def scale(rates):
            def body(i):
                text.put(text.operate("fmul", s, text.row(rates, 0, i)), right, 0, i)

            text.fold(D, {}, body)
            self.call("solve", factors, "%table", right)

        def first(i):
            text.put(text.row(right, 0, i), ends, 0, i)

        def state(i):
            text.put(text.operate("fadd", text.row("%x", 0, i), text.row(ends, 0, i)), a, 0, i)

        def add(i):
            total = text.operate("fadd", text.row(ends, 0, i), text.row(right, 0, i))
            text.put(total, ends, 0, i)

        scale("%f")
        text.fold(D, {}, first)
        with text.times(text.integer("sub", N, 1)):
            text.fold(D, {}, state)
            self.call("f", a, "%table", b)
            scale(b)
            text.fold(D, {}, add)

    # ----------------------------------------------------------------------------------- whole step
    def main(self):
        """Add the function that takes steps of all trajectories."""
        text = self.text
        text.add(f"define i64 @{self.name}(i64 %arguments) #0 {{")
        text.label("entry")
        self.of = Arguments(*(text.load("i64", text.plus("%arguments", 8 * k)) for k in SLOT))
        self.base, self.line = self.of.work, text.place(self.of.work, self.work.line)
        self.table = self.of.table
        if self.for_each:
            self.table = text.place(self.of.work, self.work.table)
        with text.repeat() as more:
            self.choose_length()
            free = text.compare("ule", self.work_row("taken"), text.constant(0.0))
            with text.when(text.any(free), likely=False):
                self.take_next(text.bits(free))
            is_active = text.any(text.compare("ogt", self.work_row("taken"), text.constant(0.0)))
            with text.when(is_active, likely=True):
                self.pause_if_spent()
                self.step()
            own = text.load(text.I, self.own_at(0))
            zero = "0" if text.W == 1 else "zeroinitializer"
            more.append(text.any(text.new(f"icmp ne {text.I} {own}, {zero}")))
        text.add("  ret i64 1")

    def argument(self, name):
        """Return one of `Arguments` that the code changes."""
        return self.text.load("i64", self.text.plus("%arguments", 8 * getattr(SLOT, name)))

    def keep_argument(self, name, value):
        self.text.store("i64", value, self.text.plus("%arguments", 8 * getattr(SLOT, name)))

    def take_next(self, free):
        """Write back the trajectories of lanes with these bits, and let them take the next ones."""
        text, rows = self.text, self.rows
        with text.times(text.W) as lane:
            bit = text.integer("and", text.integer("lshr", free, lane), 1)
            with text.when(text.compare_integers("ne", bit, 0)):
                offset = text.integer("mul", lane, 8)
                line, own = text.integer("add", self.line, offset), self.own_at(offset)
                self.write_back(offset, text.load("i64", own))
                number = self.argument("following")
                text.store("i64", 0, own)
                with text.when(text.compare_integers("ult", number, self.of.count)):
                    following = text.integer("add", number, 1)
                    text.store("i64", following, own)
                    self.keep_argument("following", following)
                    size = 8 * rows.size
                    at = text.integer("add", self.of.rows, text.integer("mul", number, size))
                    self.copy_lane(at, 8, line, text.size, rows.size)
                    if self.for_each:
                        at = text.integer("mul", number, self.of.table_bytes)
                        at = text.integer("add", self.of.table, at)
                        to = text.integer("add", self.table, offset)
                        self.copy_lane(at, 8, to, text.size, self.half.numbers)
        begins = text.compare("olt", text.row(self.line, rows.state), text.constant(0.0))
        with text.when(text.any(begins)):
            self.begin(begins)
        self.choose_length()

    def own_at(self, offset):
        """Return where the number of the trajectory of a lane stands, plus 1; 0 is none."""
        return self.text.integer("add", self.text.place(self.of.work, self.work.own), offset)

    def write_back(self, offset, own):
        """Write the rows of a lane, and its table, to those of its trajectory, if it has one."""
        text, of = self.text, self.of
        parts = [(self.line, of.rows, 8 * self.rows.size, self.rows.size)]
        if self.half.kinks:  # whose choices stand in the table
            parts.append((self.table, of.table, of.table_bytes, self.half.numbers))
        with text.when(text.compare_integers("ne", own, 0)):
            number = text.integer("sub", own, 1)
            for source, target, size, count in parts:
                at = text.integer("add", target, text.integer("mul", number, size))
                self.copy_lane(text.integer("add", source, offset), text.size, at, 8, count)

    def copy_lane(self, source, step, target, other, count):
        """Copy so many numbers that stand so many bytes apart."""
        text = self.text
        with text.times(count) as k:
            number = text.load("i64", text.integer("add", source, text.integer("mul", k, step)))
            text.store("i64", number, text.integer("add", target, text.integer("mul", k, other)))

    def pause_if_spent(self):
        """Return 0 where the budget is spent."""
        text, left = self.text, self.argument("budget")
        with text.when(text.compare_integers("sle", left, 0), likely=False):
            with text.times(text.W) as lane:
                offset = text.integer("mul", lane, 8)
                self.write_back(offset, text.load("i64", self.own_at(offset)))
            text.leave("i64 0")
        self.keep_argument("budget", text.integer("sub", left, 1))

    def number(self, name):
        """Return one of `Numbers`."""
        return self.text.shared(self.text.plus(self.of.numbers, 8 * getattr(NUMBER, name)))

    def of_component(self, name, i):
        """Return one of `Component`."""
        row = self.text.plus(self.of.components, 8 * getattr(COMPONENT, name) * self.D)
        return self.text.shared(self.text.at(row, i))

    def inputs(self, rule, **others):
        """Return the inputs of a rule for lanes: rows of the line and of `work`, and numbers."""
        found = {}
        for name in rule.inputs:
            if name in others:
                found[name] = others[name]
            elif name in Numbers._fields:
                found[name] = self.number(name)
            else:
                found[name] = self.text.row(self.line, getattr(self.rows, name))
        return found

    def work_row(self, name):
        return self.text.row(self.of.work, getattr(self.work, name))

    def keep_rows(self, found):
        """Write results of a rule to the rows of the line with their names."""
        for name, value in found.items():
            self.text.put_chosen(value, self.line, getattr(self.rows, name))

    def keep_work(self, found):
        """Write results of a rule to the rows of `work` with their names."""
        for name, value in found.items():
            self.text.put_chosen(value, self.of.work, getattr(self.work, name))

    def begin(self, begins):
        """Begin the trajectories of some lanes: f, the largest moduli, the first length."""
        text, rows = self.text, self.rows
        zero, one = text.constant(0.0), text.constant(1.0)
        f_new = text.place(self.of.work, self.work.f_new)
        self.call("f", self.line, self.table, f_new)

        def chosen(value, row, i=0):
            value = text.select(begins, value, text.row(self.line, row, i))
            text.put_chosen(value, self.line, row, i)

        def component(i, size, rate, total):
            x, f = text.row(self.line, rows.x, i), text.row(f_new, 0, i)
            chosen(text.absolute(x), rows.largest, i)
            chosen(one, rows.mode, i)
            counts = self.of_component("counts", i)
            return text.apply(
                rules.BEGIN_COMPONENT, x=x, f=f, counts=counts, size=size, rate=rate, total=total
            )

        text.fold(self.extended, {}, lambda i: chosen(text.row(f_new, 0, i), rows.f, i))
        sums = text.fold(self.D, dict.fromkeys(("size", "rate", "total"), zero), component)
        found = text.apply(rules.BEGIN, **self.inputs(rules.BEGIN, **sums))
        for name, value in found.items():
            chosen(value, getattr(rows, name))

    def mode(self):
        """Return the `State` of lanes that this half takes."""
        mode = State.IMPLICIT if self.half.is_implicit else State.EXPLICIT
        return self.text.constant(float(mode))

    def near(self):
        """Return the results of `NEAR`, which are constants where no surface ends steps."""
        text = self.text
        if self.half.watched:
            return text.apply(rules.NEAR, outer=text.row(self.line, self.rows.outer))
        return {
            "reach": text.constant(rules.REACH),
            "shortest": text.constant(rules.SHORTEST),
        }

    def choose_length(self):
        inputs = self.inputs(rules.LENGTH, mode=self.mode(), **self.near())
        self.keep_work(self.text.apply(rules.LENGTH, **inputs))

    def step(self):
        """Take a step in the lanes that do so."""
        text, rows, work, D = self.text, self.rows, self.work, self.D
        base, zero, one = self.of.work, text.constant(0.0), text.constant(1.0)
        rate = self.derive() if self.half.is_implicit else None
        x, f = text.place(self.line, rows.x), text.place(self.line, rows.f)
        self.call_with("columns", x, f, self.table, base, len(self.columns))
        own, of_error = weights(self.columns, self.p), weights_of_errors(self.columns, self.p)

        sizes = dict.fromkeys(self.half.largest.results, zero)

        def next_state(i, kept, **sizes):
            start = text.row(self.line, rows.x, i)
            new = text.operate("fadd", start, self.sum_of_ends(own, i))
            if self.f.clocks:
                of_line = {"x": start, "f": text.row(self.line, rows.f, i)}
                of_line |= {"signed": self.work_row("signed")}
                new = self.apply(rules.CLOCK, i, new=new, **of_line)["new"]
            if self.f.of_one_sign:
                before = text.row(self.line, rows.largest, i)
                found = text.apply(
                    rules.KEPT, x=start, new=new, kept=kept, rtol=self.number("rtol"),
                    keeps=self.of_component("keeps", i), extra=self.of_component("extra", i),
                    size=text.absolute(start) if self.half.has_atol else before,
                )  # fmt: skip
                new, kept = found["new"], found["kept"]
            text.put_chosen(new, base, work.new, i)
            text.put(self.sum_of_ends(of_error, i), base, work.error, i)
            return self.apply(self.half.largest, i, new=new, **sizes) | {"kept": kept}

        carried, sizes_of = sizes | {"kept": one}, []
        for first, count in self.half.parts:
            carried = self.fold(first, count, carried, next_state)
            sizes_of.append({name: carried[name] for name in sizes})
        kept = carried["kept"]
        self.call("f", text.place(base, work.new), self.table, text.place(base, work.f_new))
        for k in range(D, self.extended):  # denominators of clocks
            of_old, of_new = text.row(self.line, rows.f, k), text.row(base, work.f_new, k)
            kept = text.apply(rules.SAME_SIGN, x=of_old, new=of_new, kept=kept)["kept"]
        sums = ["ratio", "total"] + ([] if self.half.is_implicit else ["rates", "states"])
        sums = dict.fromkeys(sums, zero)
        for part, sizes in zip(self.half.parts, sizes_of, strict=True):
            sums = self.fold(*part, sums, partial(self.add_error, own, sizes))
        sums |= {"kept": kept, "taken": self.work_row("taken"), "rate": rate, **self.near()}
        before = text.row(self.line, rows.t)
        found = text.apply(rules.AFTER, **self.inputs(rules.AFTER, **sums))
        sums["accepted"] = found.pop("accepted")
        self.keep_work({"accepted": sums["accepted"], "t": before})
        self.keep_rows(found)
        if self.half.is_implicit:
            self.turn(rules.TURN_IMPLICIT, sums)
        else:
            looks = text.apply(rules.LOOKS, **self.inputs(rules.LOOKS, **sums))["looks"]
            with text.when(text.any(looks), likely=False):
                self.turn(rules.TURN_EXPLICIT, sums)
        if self.half.watched:
            own = {"accepted": sums["accepted"], "total": sums["total"]}
            found = self.cut(before=before, **own)
            self.keep_work({"accepted": found.pop("accepted")})
            self.keep_rows(found)
        self.save_inside()
        if self.half.kinks:
            self.choose()
        self.move()

    def turn(self, rule, sums):
        """Let the motion of a lane end, or the other half take its next step."""
        self.keep_rows(self.text.apply(rule, **self.inputs(rule, **sums)))

    def apply(self, rule, i, **inputs):
        """Carry out a rule for a component; inputs that are not given are numbers and rows."""
        text = self.text
        for name in [name for name in rule.inputs if name not in inputs]:
            if name in Numbers._fields:
                inputs[name] = self.number(name)
            elif name in Component._fields:
                inputs[name] = self.of_component(name, i)
            elif name in ("x", "largest"):
                inputs[name] = text.row(self.line, getattr(self.rows, name), i)
            else:
                inputs[name] = text.row(self.of.work, getattr(self.work, name), i)
        return text.apply(rule, **inputs)

    def cut(self, **found):
        """Return what changes in lanes whose step crosses a surface, or is on the way to one."""
        text, rows, work, base = self.text, self.rows, self.work, self.of.work
        watched, taken = self.half.watched, self.work_row("taken")
        line, seen = text.place(base, work.between), text.place(base, work.seen)
        point, new = text.place(line, watched), text.place(base, work.new)
        x, far = text.place(self.line, rows.x), text.place(self.line, rows.far)

        def look(*names):
            self.call("watch", line, self.table, seen)
            return {name: text.row(seen, k) for k, name in enumerate(names)}

        def keep_far(truth):
            def keep(i):
                value = text.select(truth, text.row(point, 0, i), text.row(far, 0, i))
                text.put_chosen(value, far, 0, i)

            text.fold(watched, {}, keep)

        text.copy(x, line, watched)
        parts = dict.fromkeys(("crossed", "place", "end"), text.constant(0.0))
        outer = text.row(self.line, rows.outer)
        is_far = text.compare("olt", outer, text.constant(np.inf))
        is_far = text.new(f"xor {text.M} {is_far}, {self.all_lanes()}")
        for k in range(1, rules.PARTS + 1):
            u = text.constant(k / rules.PARTS)
            if k < rules.PARTS:
                self.put_point(u, point)
            else:
                text.copy(new, point, watched)
            inputs = look("part", "crosses") | parts | {"u": u, "taken": taken}
            parts = text.apply(rules.LOOK, **self.inputs(rules.LOOK, **inputs))
            is_first = text.compare("ogt", parts.pop("is_first"), text.constant(0.0))
            keep_far(text.new(f"and {text.M} {is_first}, {is_far}"))
            text.copy(point, line, watched)
        inputs = found | parts | {"mode": self.mode(), "taken": taken}
        text.copy(far, point, watched)
        inputs |= look("part")
        text.copy(x, line, watched)
        text.copy(new, point, watched)
        inputs |= look("whole_part", "crosses", "jumps")
        found = text.apply(rules.CUT, **self.inputs(rules.CUT, **inputs))
        keep_far(text.compare("ogt", found.pop("beyond"), text.constant(0.0)))
        self.keep_work({"at_surface": found.pop("at_surface")})
        return found

    def put_point(self, u, to):
        """Write the state at a part u of the step."""
        text, rows, work, base = self.text, self.rows, self.work, self.of.work
        rule = rules.POINT_IMPLICIT if self.half.is_implicit else rules.POINT
        signed = self.work_row("signed")

        def put(i):
            inputs = {
                "x": text.row(self.line, rows.x, i), "new": text.row(base, work.new, i),
                "f": text.row(self.line, rows.f, i), "f_new": text.row(base, work.f_new, i),
                "signed": signed, "u": u,
            }  # fmt: skip
            inputs = {name: inputs[name] for name in rule.inputs}
            text.put(text.apply(rule, **inputs)["point"], to, 0, i)

        text.fold(self.half.watched, {}, put)

    def sum_of_ends(self, factors, i):
        """Return the sum of factors times y_c - x of component i, in the order of columns."""
        text, total = self.text, None
        for c, factor in enumerate(factors):
            end = text.row(self.of.work, self.work.ends + c * self.D, i)
            product = text.operate("fmul", text.constant(factor), end)
            total = product if total is None else text.operate("fadd", total, product)
        return total

    def fold(self, first, count, carried, body):
        """Add a loop over components from the first one on, as `Text.fold`."""
        text = self.text

        def of_component(i, **values):
            i = first + i if isinstance(i, int) else text.integer("add", i, first)
            return body(i, **values)

        return text.fold(count, carried, of_component if first else body)

    def add_error(self, own, sizes, i, **sums):
        """Return sums with the error of a component; `error` becomes the inverse of the allowed."""
        allowed, inputs = self.half.allowed, dict(sizes)
        if "noise" in allowed.inputs:
            inputs["noise"] = self.noise(own, i)
        inverse = self.apply(allowed, i, **inputs)["inverse"]
        found = self.apply(
            rules.RATIO, i, inverse=inverse, ratio=sums["ratio"], total=sums["total"]
        )
        if not self.half.is_implicit:
            last = self.text.row(self.of.work, self.work.a, i)
            inputs = {"last": last, "inverse": inverse}
            inputs |= {name: sums[name] for name in ("rates", "states")}
            found |= self.apply(rules.DIFFERENCES, i, **inputs)
        self.text.put(inverse, self.of.work, self.work.error, i)
        return found

    def noise(self, own, i):
        """Return the sum of moduli of what is added up for the next state."""
        text, total = self.text, None
        for c, factor in enumerate(own):
            end = text.absolute(text.row(self.of.work, self.work.ends + c * self.D, i))
            product = text.operate("fmul", text.constant(abs(factor)), end)
            total = product if total is None else text.operate("fadd", total, product)
        return total

    def move(self):
        """Move the lanes whose step is taken to their next state."""
        text, rows, work, base = self.text, self.rows, self.work, self.of.work
        accepted = text.compare("ogt", self.work_row("accepted"), text.constant(0.0))

        def chosen(i, new, row):
            value = text.select(accepted, new, text.row(self.line, row, i))
            text.put_chosen(value, self.line, row, i)

        def component(i):
            new, largest = text.row(base, work.new, i), text.row(self.line, rows.largest, i)
            chosen(i, new, rows.x)
            modulus = text.absolute(new)
            larger = text.select(text.compare("ogt", modulus, largest), modulus, largest)
            chosen(i, larger, rows.largest)

        text.fold(self.D, {}, component)
        text.fold(self.extended, {}, lambda i: chosen(i, text.row(base, work.f_new, i), rows.f))

    def choose(self):
        """Make the choices of kinks anew where the step ends on a surface, and f with them.

        A table may be so steep that f changes much where it is continuous.
        """
        text, work, base = self.text, self.work, self.of.work
        accepted, at_surface = self.work_row("accepted"), self.work_row("at_surface")
        ends = (text.compare("ogt", each, text.constant(0.0)) for each in (accepted, at_surface))
        ends = text.new(f"and {text.M} {', '.join(ends)}")
        with text.when(text.any(ends), likely=False):
            place = self.f.conditions.P + self.f.conditions.jumps
            for k, kind in enumerate(self.half.kinks, work.seen + 3):
                if is_table(kind):
                    self.put_interval(kind, text.bits(ends), k, place)
                else:
                    now, old = text.row(base, k), text.row(self.table, place)
                    text.put_chosen(text.select(ends, now, old), self.table, place)
                place += choices_of(kind)
            self.call("f", text.place(base, work.new), self.table, text.place(base, work.f_new))

    def put_interval(self, table, bits, argument, place):
        """Write the interval of a table that holds an argument to the table of lanes with bits.

        The interval is found by bisection among a number of knots that is a power of 2.
        """
        text, count = self.text, table.rows.shape[1]
        half = max(2 ** (count - 1).bit_length() // 2, 1)
        numbers = np.full((Table.ROWS, 2 * half), np.inf)
        numbers[:, :count] = table.rows
        numbers = text.numbers(f"{self.name}_interval_{place}", numbers)
        with text.times(text.W) as lane:
            bit = text.integer("and", text.integer("lshr", bits, lane), 1)
            with text.when(text.compare_integers("eq", bit, 1)):
                of_lane = text.integer("mul", lane, 8)
                x = text.place(text.integer("add", self.of.work, of_lane), argument)
                x = text.load("double", x)

                def halve(at, half):
                    above = text.integer("add", at, text.integer("mul", half, 8))
                    is_above = text.new(f"fcmp oge double {x}, {text.load('double', above)}")
                    half = text.integer("lshr", half, 1)
                    found = {"at": text.choice("i64", is_above, above, at), "half": half}
                    return found, text.compare_integers("ne", half, 0)

                at = text.cycle({"at": ("i64", numbers), "half": ("i64", half)}, halve)["at"]
                to = text.place(text.integer("add", self.table, of_lane), place)
                self.copy_lane(at, 16 * half, to, text.size, Table.ROWS)

    # ------------------------------------------------------------------------------- implicit lanes
    def derive(self):
        """Write the entries of f'; return its rate by a step of the power iteration."""
        text, rows, work = self.text, self.rows, self.work
        base, zero, entries = self.of.work, text.constant(0.0), self.f.entries
        jacobian, right = text.place(base, work.jacobian), text.place(base, work.right)
        self.call("j", text.place(self.line, rows.x), self.table, jacobian)

        def finite(k, place=jacobian):
            entry = text.apply(rules.FINITE, entry=text.row(place, 0, k))["entry"]
            text.put(entry, place, 0, k)

        def largest(i, top):
            return text.apply(rules.SIZE, modulus=text.row(self.line, rows.largest, i), top=top)

        def scale(i):
            found = text.apply(
                rules.SCALE, largest=text.row(self.line, rows.largest, i), top=top,
                mode=text.row(self.line, rows.mode, i),
            )  # fmt: skip
            text.put(found["scale"], base, work.start, i)
            text.put(found["scaled"], jacobian, entries + 1, i)

        def rate(i, size):
            product, scale = text.row(right, 0, i), text.row(base, work.start, i)
            found = text.apply(rules.RATE, product=product, scale=scale, size=size)
            text.put(found.pop("product"), right, 0, i)
            return found

        def mode(i):
            found = text.apply(
                rules.MODE, product=text.row(right, 0, i), size=size,
                mode=text.row(self.line, rows.mode, i),
                seed=self.of_component("seeds", i),
            )  # fmt: skip
            text.put_chosen(found["mode"], self.line, rows.mode, i)

        if entries:
            text.fold(entries, {}, finite)
        if self.half.couplings:
            place = text.place(jacobian, entries + 1 + self.D)
            text.fold(self.half.couplings, {}, lambda k: finite(k, place))
        top = text.fold(self.D, {"top": zero}, largest)["top"]
        text.fold(self.D, {}, scale)
        self.call("power", jacobian, self.table, right)
        size = text.fold(self.D, {"size": zero}, rate)["size"]
        text.fold(self.D, {}, mode)
        return size

    # ------------------------------------------------------------------------------------ the times
    def save_inside(self):
        """Save the states at times that the step has passed."""
        text = self.text
        with text.when(text.any(self.passed("oge")), likely=False):
            with text.when(text.any(self.passed("ogt"))):
                if not self.half.is_implicit:
                    few = self.ratios_of_few()
                with text.repeat() as more:
                    if self.half.is_implicit:
                        self.shorter_implicit_step()
                    else:
                        self.shorter_step(few)
                    self.save_lanes(text.bits(self.passed("ogt")), self.work.start)
                    more.append(text.any(self.passed("ogt")))
            self.save_lanes(text.bits(self.passed("oeq")), self.work.new)

    def passed(self, how):
        """Return which lanes have taken a step to their next time, or beyond it."""
        text, rows = self.text, self.rows
        next_, after = (text.row(self.line, k) for k in (rows.next, rows.t))
        accepted = text.compare("ogt", self.work_row("accepted"), text.constant(0.0))
        return text.new(f"and {text.M} {accepted}, {text.compare(how, after, next_)}")

    def ratios_of_few(self):
        """Return the errors of the first 1, 2 and 3 columns by what is allowed."""
        text, work, base = self.text, self.work, self.of.work
        table, own = weights_of_few(EXPLICIT, 2), weights(EXPLICIT, 2)
        factors = [[few - w for few, w in zip(table[k], own, strict=True)] for k in range(3)]

        def component(i, **ratios):
            inverse = text.row(base, work.error, i)
            return {
                name: text.apply(rules.LARGER_RATIO, error=self.sum_of_ends(factors[k], i),
                                 inverse=inverse, ratio=ratio)["ratio"]
                for k, (name, ratio) in enumerate(ratios.items())
            }  # fmt: skip

        names = ("ratio1", "ratio2", "ratio3")
        return text.fold(self.D, dict.fromkeys(names, text.constant(0.0)), component)

    def shorter_step(self, ratios):
        """Compute the states at the next times, in `start`, by steps from the nearer end."""
        text, rows, work, D = self.text, self.rows, self.work, self.D
        base = self.of.work
        found = text.apply(rules.INSIDE, **self.inputs(
            rules.INSIDE, t=self.work_row("t"), after=text.row(self.line, rows.t),
            taken=self.work_row("taken"), accepted=self.work_row("accepted"),
        ))  # fmt: skip
        self.keep_work({"signed": found["signed"]})
        forward = text.compare("ogt", found["forward"], text.constant(0.0))
        few = text.apply(rules.FEW, part=found["part"], **ratios)["few"]

        def choose(i):
            for to, of_line, of_work in (
                (work.start, rows.x, work.new),
                (work.f, rows.f, work.f_new),
            ):
                ends = text.row(self.line, of_line, i), text.row(base, of_work, i)
                text.put_chosen(text.select(forward, *ends), base, to, i)

        text.fold(D, {}, choose)
        count, needs = "1", [text.compare("ogt", few, text.constant(k)) for k in (1.0, 2.0, 3.0)]
        for need in needs:
            count = text.integer("add", count, text.new(f"zext i1 {text.any(need)} to i64"))
        start, f = text.place(base, work.start), text.place(base, work.f)
        self.call_with("columns", start, f, self.table, base, count)
        table, factors = weights_of_few(EXPLICIT, 2), []
        for c in range(4):
            factor = text.constant(table[3, c])
            for k in (2, 1, 0):
                factor = text.select(needs[k], factor, text.constant(table[k, c]))
            factors.append(factor)

        def add(i):
            total = text.operate("fmul", factors[0], text.row(base, work.ends, i))
            for c in (1, 2, 3):  # columns that a lane does not need may not be there
                end = text.row(base, work.ends + c * D, i)
                end = text.select(needs[c - 1], end, text.constant(0.0))
                total = text.operate("fadd", total, text.operate("fmul", factors[c], end))
            value = text.operate("fadd", text.row(base, work.start, i), total)
            text.put_chosen(self.with_sign(value, i), base, work.start, i)

        text.fold(D, {}, add)

    def with_sign(self, value, i):
        """Return a component inside a step, with its sign if the motion keeps it."""
        text = self.text
        if not self.f.of_one_sign:
            return value
        x, keeps = text.row(self.line, self.rows.x, i), self.of_component("keeps", i)
        return text.apply(rules.WITH_SIGN, value=value, x=x, keeps=keeps)["value"]

    def shorter_implicit_step(self):
        """Compute the states at the next times by shorter steps; refuse the step if they fail.

        A fast mode may decay within the step, so that its end says nothing about the way. Then the
        step is taken again, to that time.
        """
        text, rows, work = self.text, self.rows, self.work
        base, zero, one = self.of.work, text.constant(0.0), text.constant(1.0)
        found = text.apply(rules.INSIDE_IMPLICIT, **self.inputs(
            rules.INSIDE_IMPLICIT, t=self.work_row("t"), after=text.row(self.line, rows.t),
            taken=self.work_row("taken"), accepted=self.work_row("accepted"),
        ))  # fmt: skip
        self.keep_work({"signed": found["signed"]})
        x, f = text.place(self.line, rows.x), text.place(self.line, rows.f)
        self.call_with("columns", x, f, self.table, base, len(self.columns))
        own, of_error = weights(self.columns, 1), weights_of_errors(self.columns, 1)
        is_inside = text.compare("ogt", found["length"], zero)

        def component(i, total, ratio):
            value = text.operate("fadd", text.row(self.line, rows.x, i), self.sum_of_ends(own, i))
            text.put_chosen(self.with_sign(value, i), base, work.start, i)
            own_ratio = text.operate("fmul", text.absolute(self.sum_of_ends(of_error, i)),
                                     text.row(base, work.error, i))  # fmt: skip
            larger = text.apply(rules.LARGER_RATIO, error=own_ratio, inverse=one, ratio=ratio)
            return {"total": text.operate("fadd", total, own_ratio), "ratio": larger["ratio"]}

        sums = text.fold(self.D, {"total": zero, "ratio": zero}, component)
        is_right = text.compare("oge", one, sums["ratio"])
        is_finite = text.compare("olt", sums["total"], text.constant(float("inf")))
        is_right = text.new(f"and {text.M} {is_right}, {is_finite}")
        fails = text.new(f"xor {text.M} {is_right}, {self.all_lanes()}")
        fails = text.new(f"and {text.M} {fails}, {is_inside}")
        with text.when(text.any(fails)):
            implicit = text.constant(float(State.IMPLICIT))
            for row, value in ((rows.wanted, found["length"]), (rows.t, self.work_row("t")),
                               (rows.state, implicit), (rows.longer, one)):  # fmt: skip
                chosen = text.select(fails, value, text.row(self.line, row))
                text.put_chosen(chosen, self.line, row)
            accepted = text.select(fails, zero, self.work_row("accepted"))
            self.keep_work({"accepted": accepted})

    def all_lanes(self):
        """Return the truth value that is true in all lanes."""
        W = self.text.W
        return "true" if W == 1 else f"<{', '.join(['i1 true'] * W)}>"

    def save_lanes(self, bits, row):
        """Save the states in rows of `Work` of the lanes with these bits; go to their next time."""
        text, rows, of = self.text, self.rows, self.of
        with text.times(text.W) as lane:
            bit = text.integer("and", text.integer("lshr", bits, lane), 1)
            with text.when(text.compare_integers("eq", bit, 1)):
                of_lane = text.integer("mul", lane, 8)
                line = text.integer("add", self.line, of_lane)
                of_work = text.integer("add", of.work, of_lane)
                place_at = text.plus(line, text.size * rows.place)
                place = text.load("i64", place_at)
                trajectory = text.load("i64", text.plus(line, text.size * rows.trajectory))
                to = text.integer("add", of.states, text.integer("mul", place, of.state_bytes))
                to = text.integer("add", to, text.integer("mul", trajectory, 8 * self.D))

                def copy(i):
                    number = text.load("double", text.place(of_work, row, i))
                    text.store("double", number, text.at(to, i))

                text.fold(self.D, {}, copy)
                text.prefetch(text.integer("add", to, text.integer("mul", of.state_bytes, 2)))
                following = text.integer("add", place, 1)
                text.store("i64", following, place_at)
                next_at = text.plus(line, text.size * rows.next)
                text.store("double", bits_of(float("inf")), next_at)
                with text.when(text.compare_integers("ult", following, of.times_count)):
                    text.store("double", text.load("double", text.at(of.times, following)), next_at)
                text.store("double", bits_of(0.0), text.plus(line, text.size * rows.tries))


def added(text, x, factor, change):
    """Return x + factor * change for all components."""
    products = [text.operate("fmul", factor, each) for each in change]
    return [text.operate("fadd", *each) for each in zip(x, products, strict=True)]


def end_of_column(text, a, b, x):
    """Return the end of a column, less x, of a component."""
    return text.operate(
        "fsub", text.operate("fmul", text.operate("fadd", a, b), text.constant(0.5)), x
    )
