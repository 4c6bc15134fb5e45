"""Machine code of the motion: the whole step of a line of lanes as LLVM's text, for each half.

The two halves share everything but their columns and the rule for the next step. Lists of
operations (`RightHandSide`, `Elimination`, `rules`) are straight-line code; this file has the
control around them. Rows stand in memory, and loops over components are written out for few.
"""

from typing import NamedTuple

import numpy as np

from ..code.text import Code, bits_of
from . import rules
from .columns import (
    EXPLICIT,
    IMPLICIT,
    weights,
    weights_of_errors,
    weights_of_few,
)
from .rows import BEGINS, State

INLINED = 160  # operations of f that stand within the loop of sub-steps, rather than a call


class Arguments(NamedTuple):
    """The integers of an array that the code takes."""

    rows: int  # address of the lines (lines, rows, W)
    lines: int
    line: int  # the first line to take; the code writes where it stopped
    budget: int  # steps of lines, after which the code returns
    table: int  # address of the table (n,) or (lines, n, W)
    table_bytes: int  # from line to line, 0 if all have the same
    work: int  # address of the rows of `Work`
    numbers: int  # address of `Numbers`
    extra: int  # address of what is added to the allowed errors: atol, infinity for clocks (D)
    counts: int  # address of 1 for components, 0 for clocks (D)
    keeps: int  # address of 1 for components that keep their sign, else 0 (D)
    seeds: int  # address of what is added to vectors of the power iteration (D)
    times: int  # address of the moduli of times, ascending (count,)
    count: int
    states: int  # address of the states at these times (count, trajectories, D)
    state_bytes: int  # of one time


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


LANES = 4  # of columns of one trajectory
# For each pair of sub-steps: the inverse lengths of the columns in lanes, the factor of the second
# sub-step, 1 where a column begins, and for each column the pair and the lane in which it ends.
_PARTS = [[1 / 10, 1 / 8, 1 / 6, 1 / 10]] * 3 + [
    [1 / 10, 1 / 8, 1 / 4, 1 / 10],
    [1 / 10, 1 / 2, 1 / 4, 1 / 10],
]
_LAST = [[2, 2, 2, 2], [2, 2, 2, 2], [2, 2, 1, 2], [2, 1, 2, 2], [1, 1, 1, 1]]
_BEGIN = [[1, 1, 1, 1], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0]]
_ENDS = [(4, 1), (4, 2), (2, 2), (3, 1), (4, 0)]
SLOT, NUMBER = Arguments(*range(len(Arguments._fields))), Numbers(*range(len(Numbers._fields)))


def lane_numbers(half):
    """Return how many numbers columns in lanes need, after the rows of `Work` of one trajectory."""
    own = 8 * half.f.D + len(half.f.denominators)
    return LANES * (own + half.functions["f"].scratch)


def text_of_half(half, name, W, for_each):
    """Return the text of i64 name(arguments), see `Arguments`, for a `Half`.

    It takes steps of all lines, as long as a lane is in this half, and returns 1; or 0 when the
    budget is spent, to go on in the next call.
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
        text = self.text.finished()
        return "\n".join([*self.text.constants, text])

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
        text, work, self.base = self.text, self.work, "%work"
        text.add(f"define internal void @{self.name}_columns(i64 %x, i64 %f, i64 %table, "
                 "i64 %work, i64 %count) #0 {")  # fmt: skip
        text.label("entry")
        lengths = text.integers(f"{self.name}_lengths", np.array(self.columns))
        inverses = text.numbers(f"{self.name}_inverses", 1.0 / np.array(self.columns))
        with text.times("%count") as c:
            N = text.load("i64", text.at(lengths, c))
            s = text.operate("fmul", text.row("%work", work.signed),
                             text.shared(text.at(inverses, c)))  # fmt: skip
            ends = text.place("%work", work.ends, text.integer("mul", c, self.D))
            if self.half.is_implicit:
                self.implicit_column(N, s, ends)
            else:
                self.explicit_column(N, s, ends)
        text.add("  ret void")
        text.add("}")

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
        parts, last, begin = (
            text.numbers(f"{self.name}_{name}", np.array(table, float))
            for name, table in (("parts", _PARTS), ("last", _LAST), ("begin", _BEGIN))
        )
        rows = text.place("%work", work.size)  # a, b and f of all lanes, then ends
        first_a, first_b, first_f, ends = 0, D, 2 * D, 2 * D + self.extended
        scratch = inner.place(rows, ends + len(_PARTS) * D)
        signed = inner.splat(text.row("%work", work.signed), LANES)

        def shared(base, i):
            return inner.splat(text.row(base, 0, i), LANES)

        with text.times(len(_PARTS)) as m:
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
                self.pair(inner, rows, (first_a, first_b, first_f), (double, factor))
            else:
                for of, to, length in ((first_b, first_a, double), (first_a, first_b, factor)):
                    places = inner.place(rows, of), "%table", inner.place(rows, first_f)
                    self.call_with("f_lanes", *places, scratch)
                    text.fold(D, {}, lambda i, to=to, length=length: add(i, to, length))
            of_pair = text.integer("add", ends, text.integer("mul", m, D))

            def end(i):
                total = inner.operate(
                    "fadd", inner.row(rows, first_a, i), inner.row(rows, first_b, i)
                )
                change = inner.operate(
                    "fsub", inner.operate("fmul", total, inner.constant(0.5)), shared("%x", i)
                )
                inner.put(change, rows, 0, text.integer("add", of_pair, i))

            text.fold(D, {}, end)

        def lane(row, i, number):
            place = inner.place(rows, row, i)
            return text.load("double", text.plus(place, 8 * number))

        def copy(i):
            for c, (pair, number) in enumerate(_ENDS):
                text.put(lane(ends + pair * D, i, number), "%work", work.ends + c * D, i)
            text.put(lane(first_a, i, 0), "%work", work.a, i)
            text.put(lane(first_f, i, 0), "%work", work.f_last, i)

        text.fold(D, {}, copy)
        text.add("  ret void")
        text.add("}")

    def explicit_column(self, N, s, ends):
        """Add Gragg's midpoint rule with smoothing; y_N stays in the rows `a`."""
        text, work, D = self.text, self.work, self.D
        double = text.operate("fadd", s, s)

        def start(i):
            x = text.row("%x", 0, i)
            text.put(x, "%work", work.a, i)
            text.put(self.plus(x, s, text.row("%f", 0, i)), "%work", work.b, i)

        def end(i):
            total = text.operate("fadd", text.row("%work", work.a, i), text.row("%work", work.b, i))
            end = text.operate("fmul", total, text.constant(0.5))
            text.put(text.operate("fsub", end, text.row("%x", 0, i)), ends, 0, i)

        text.fold(D, {}, start)
        pairs = text.integer("lshr", N, 1)
        with text.times(pairs) as m:
            is_last = text.compare_integers("eq", text.integer("add", m, 1), pairs)
            factor = text.new(f"select i1 {is_last}, {text.V} {s}, {text.V} {double}")
            if self.is_inlined:
                of_a = self.pair(text, "%work", (work.a, work.b), (double, factor))
                with text.when(is_last):
                    for i in range(D):
                        text.put(of_a[i], "%work", work.f_last, i)
            else:
                self.sub_step(work.b, work.a, double)
                self.sub_step(work.a, work.b, factor)
        text.fold(D, {}, end)

    def sub_step(self, of, to, factor):
        """Add factor f(y) to rows, by a call; `f_last` keeps the value of f."""
        text, work = self.text, self.work
        self.call("f", text.place("%work", of), "%table", text.place("%work", work.f_last))

        def add(i):
            value = self.plus(text.row("%work", to, i), factor, text.row("%work", work.f_last, i))
            text.put(value, "%work", to, i)

        text.fold(self.D, {}, add)

    def plus(self, a, factor, b):
        return self.text.operate("fadd", a, self.text.operate("fmul", factor, b))

    def pair(self, text, base, rows, factors):
        """Add two sub-steps with f within the code; return f at the state after the first.

        `rows` are those of a, of b, and of f at the new a, if it is wanted.
        """
        function, D = self.half.functions["f"], self.D

        def value(x):
            return function.values(text, lambda k: x[k], "%table", self.for_each and text.W > LANES)

        def added(a, factor, change):
            return text.operate("fadd", a, text.operate("fmul", factor, change))

        b = [text.row(base, rows[1], i) for i in range(D)]
        of_b = value(b)
        a = [added(text.row(base, rows[0], i), factors[0], of_b[i]) for i in range(D)]
        for i in range(D):
            text.put(a[i], base, rows[0], i)
        of_a = value(a)
        for i in range(D):
            text.put(added(b[i], factors[1], of_a[i]), base, rows[1], i)
        for i in range(D if len(rows) > 2 else 0):
            text.put(of_a[i], base, rows[2], i)
        return of_a

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
        """Add the function that takes steps of all lines."""
        text = self.text
        text.add(f"define i64 @{self.name}(i64 %arguments) #0 {{")
        text.label("entry")
        self.of = Arguments(*(text.load("i64", text.plus("%arguments", 8 * k)) for k in SLOT))
        self.base = self.of.work
        with text.repeat() as more_lines:
            number = text.load("i64", text.plus("%arguments", 8 * SLOT.line))
            offset = text.integer("mul", number, self.rows.size * text.size)
            self.line = text.integer("add", self.of.rows, offset)
            self.table = text.integer(
                "add", self.of.table, text.integer("mul", number, self.of.table_bytes)
            )
            state = text.row(self.line, self.rows.state)
            with text.when(text.any(text.compare("olt", state, text.constant(0.0)))):
                self.begin()
            with text.repeat() as more_steps:
                self.choose_length()
                is_active = text.compare("ogt", text.row(self.of.work, self.work.taken),
                                         text.constant(0.0))  # fmt: skip
                is_active = text.any(is_active)
                with text.when(is_active, likely=True):
                    self.pause_if_spent()
                    self.step()
                more_steps.append(is_active)
            following = text.integer("add", number, 1)
            text.store("i64", following, text.plus("%arguments", 8 * SLOT.line))
            more_lines.append(text.compare_integers("ult", following, self.of.lines))
        text.add("  ret i64 1")

    def pause_if_spent(self):
        """Return 0 where the budget is spent."""
        text, slot = self.text, self.text.plus("%arguments", 8 * SLOT.budget)
        left = text.load("i64", slot)
        with text.when(text.compare_integers("sle", left, 0)):
            text.add("  ret i64 0")
            text.label(text._name("never"))
        text.store("i64", text.integer("sub", left, 1), slot)

    def number(self, name):
        """Return one of `Numbers`."""
        return self.text.shared(self.text.plus(self.of.numbers, 8 * getattr(NUMBER, name)))

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

    def begin(self):
        """Begin the trajectories of a line: f, the largest moduli, the first length."""
        text, rows = self.text, self.rows
        zero, one = text.constant(0.0), text.constant(1.0)
        self.call("f", self.line, self.table, text.place(self.line, rows.f))

        def component(i, size, rate, total):
            x, f = text.row(self.line, rows.x, i), text.row(self.line, rows.f, i)
            text.put(text.absolute(x), self.line, rows.largest, i)
            text.put(one, self.line, rows.mode, i)
            counts = text.shared(text.at(self.of.counts, i))
            return text.apply(
                rules.BEGIN_COMPONENT, x=x, f=f, counts=counts, size=size, rate=rate, total=total
            )

        sums = text.fold(self.D, dict.fromkeys(("size", "rate", "total"), zero), component)
        found = text.apply(rules.BEGIN, **self.inputs(rules.BEGIN, **sums))
        # Lanes that fill up the last line are done.
        is_new = text.compare("oeq", text.row(self.line, rows.state), text.constant(BEGINS))
        done = text.constant(float(State.DONE))
        found["state"] = text.select(is_new, found["state"], done)
        self.keep_rows(found)

    def mode(self):
        """Return the `State` of lanes that this half takes."""
        mode = State.IMPLICIT if self.half.is_implicit else State.EXPLICIT
        return self.text.constant(float(mode))

    def outer(self):
        """Return the row `outer`, infinity where no surface ends steps."""
        text = self.text
        return text.row(self.line, self.rows.outer) if self.half.watched else text.constant(np.inf)

    def choose_length(self):
        inputs = self.inputs(rules.LENGTH, mode=self.mode(), outer=self.outer())
        self.keep_work(self.text.apply(rules.LENGTH, **inputs))

    def step(self):
        """Take a step in the lanes that do so."""
        text, rows, work, D = self.text, self.rows, self.work, self.D
        base, zero, one = self.of.work, text.constant(0.0), text.constant(1.0)
        rate = self.derive() if self.half.is_implicit else None
        x, f = text.place(self.line, rows.x), text.place(self.line, rows.f)
        self.call_with("columns", x, f, self.table, base, len(self.columns))
        own, of_error = weights(self.columns, self.p), weights_of_errors(self.columns, self.p)

        def next_state(i, top, moved, kept):
            start, largest = text.row(self.line, rows.x, i), text.row(self.line, rows.largest, i)
            new = text.operate("fadd", start, self.sum_of_ends(own, i))
            counts = text.shared(text.at(self.of.counts, i))
            if self.f.of_one_sign:
                found = text.apply(
                    rules.KEPT, x=start, new=new, kept=kept, rtol=self.number("rtol"),
                    keeps=text.shared(text.at(self.of.keeps, i)),
                    extra=text.shared(text.at(self.of.extra, i)),
                    size=text.absolute(start) if self.half.has_atol else largest,
                )  # fmt: skip
                new, kept = found["new"], found["kept"]
            text.put_chosen(new, base, work.new, i)
            text.put(self.sum_of_ends(of_error, i), base, work.error, i)
            found = text.apply(
                rules.LARGEST, x=start, new=new, largest=largest, counts=counts, top=top,
                moved=moved,
            )  # fmt: skip
            return found | {"kept": kept}

        sizes = text.fold(D, {"top": zero, "moved": zero, "kept": one}, next_state)
        kept = sizes.pop("kept")
        self.call("f", text.place(base, work.new), self.table, text.place(base, work.f_new))
        for k in range(D, self.extended):  # denominators of clocks
            of_old, of_new = text.row(self.line, rows.f, k), text.row(base, work.f_new, k)
            kept = text.apply(rules.SAME_SIGN, x=of_old, new=of_new, kept=kept)["kept"]
        sums = ["ratio", "total"] + ([] if self.half.is_implicit else ["rates", "states"])
        sums = text.fold(
            D, dict.fromkeys(sums, zero), lambda i, **sums: self.add_error(i, own, sizes, sums)
        )
        rule = rules.CHOOSE_IMPLICIT if self.half.is_implicit else rules.CHOOSE_EXPLICIT
        inputs = sums | {"kept": kept, "taken": self.work_row("taken"), "rate": rate}
        inputs["outer"] = self.outer()
        found = text.apply(rule, **self.inputs(rule, **inputs))
        before = text.row(self.line, rows.t)
        if self.half.watched:
            found |= self.cut(before=before, total=sums["total"], **found)
        self.keep_work({"accepted": found.pop("accepted"), "t": before})
        self.keep_rows(found)
        self.save_inside()
        self.move()

    def cut(self, **found):
        """Return what changes in lanes whose step crosses a surface, or is on the way to one."""
        text, rows, work, base = self.text, self.rows, self.work, self.of.work
        watched, taken = self.half.watched, self.work_row("taken")
        line, seen = text.place(base, work.line), text.place(base, work.seen)
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
        is_far = text.compare("olt", self.outer(), text.constant(np.inf))
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

    def add_error(self, i, own, sizes, sums):
        """Return sums with the error of a component; `error` becomes the inverse of the allowed."""
        text, rows, work = self.text, self.rows, self.work
        base, is_implicit = self.of.work, self.half.is_implicit
        if self.half.has_atol:
            rule = rules.IMPLICIT_ERROR_WITH_ATOL if is_implicit else rules.ERROR_WITH_ATOL
        else:
            rule = rules.IMPLICIT_ERROR if is_implicit else rules.ERROR
        inputs = {
            "x": lambda: text.row(self.line, rows.x, i),
            "largest": lambda: text.row(self.line, rows.largest, i),
            "last": lambda: text.row(base, work.a, i),
            "extra": lambda: text.shared(text.at(self.of.extra, i)),
            "top": lambda: sizes["top"],
            "moved": lambda: sizes["moved"],
            "rtol": lambda: self.number("rtol"),
            "noise": lambda: self.noise(own, i),
        }

        def value(name):
            if name in sums:
                return sums[name]
            return inputs[name]() if name in inputs else text.row(base, getattr(work, name), i)

        found = text.apply(rule, **{name: value(name) for name in rule.inputs})
        text.put(found.pop("inverse"), base, work.error, i)
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
        if self.half.kinks:  # choices at the end of the step, as `watch` has found them
            ends = text.compare("ogt", self.work_row("at_surface"), text.constant(0.0))
            ends = text.new(f"and {text.M} {ends}, {accepted}")
            first = self.f.conditions.P + self.f.conditions.jumps
            for k in range(self.half.kinks):
                now, old = text.row(base, work.seen + 3, k), text.row(self.table, first, k)
                text.put_chosen(text.select(ends, now, old), self.table, first, k)

    # ------------------------------------------------------------------------------- implicit lanes
    def derive(self):
        """Write the entries of f'; return its rate by a step of the power iteration."""
        text, rows, work = self.text, self.rows, self.work
        base, zero, entries = self.of.work, text.constant(0.0), self.f.entries
        jacobian, right = text.place(base, work.jacobian), text.place(base, work.right)
        self.call("j", text.place(self.line, rows.x), self.table, jacobian)

        def finite(k):
            entry = text.apply(rules.FINITE, entry=text.row(jacobian, 0, k))["entry"]
            text.put(entry, jacobian, 0, k)

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
                seed=text.shared(text.at(self.of.seeds, i)),
            )  # fmt: skip
            text.put_chosen(found["mode"], self.line, rows.mode, i)

        if entries:
            text.fold(entries, {}, finite)
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
        with text.when(text.any(self.pending())):
            if not self.half.is_implicit:
                few = self.ratios_of_few()
            with text.repeat() as more:
                if self.half.is_implicit:
                    self.shorter_implicit_step()
                else:
                    self.shorter_step(few)
                pending = self.pending()
                with text.when(text.any(pending)):
                    self.save_lanes(text.bits(pending))
                more.append(text.any(self.pending()))

    def pending(self):
        """Return which lanes have a time within their step."""
        text, rows = self.text, self.rows
        next_, after = (text.row(self.line, k) for k in (rows.next, rows.t))
        accepted = text.compare("ogt", self.work_row("accepted"), text.constant(0.0))
        return text.new(f"and {text.M} {accepted}, {text.compare('oge', after, next_)}")

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
        x, keeps = text.row(self.line, self.rows.x, i), text.shared(text.at(self.of.keeps, i))
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
            value = text.select(is_inside, value, text.row(base, work.new, i))
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

    def save_lanes(self, pending):
        """Save the state in `start` of the lanes with these bits, and go to their next time."""
        text, rows, work, of = self.text, self.rows, self.work, self.of
        with text.times(text.W) as lane:
            bit = text.integer("and", text.integer("lshr", pending, lane), 1)
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
                    number = text.load("double", text.place(of_work, work.start, i))
                    text.store("double", number, text.at(to, i))

                text.fold(self.D, {}, copy)
                following = text.integer("add", place, 1)
                text.store("i64", following, place_at)
                next_at = text.plus(line, text.size * rows.next)
                text.store("double", bits_of(float("inf")), next_at)
                with text.when(text.compare_integers("ult", following, of.count)):
                    text.store("double", text.load("double", text.at(of.times, following)), next_at)
                text.store("double", bits_of(0.0), text.plus(line, text.size * rows.tries))
