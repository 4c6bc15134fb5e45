"""The columns of an explicit step: Gragg's midpoint rule with smoothing, in three forms of code.

A column takes N sub-steps of the length s = h / N:

y_1 = x + s f(x),     y_m+1 = y_m-1 + 2 s f(y_m),     end (y_N-1 + y_N + s f(y_N)) / 2.

Without the smoothing at the end, jumps of f give errors of 15 % at every tolerance. Two states take
turns: a is y_m for even m, and b for odd m. A pair of sub-steps is

a = a + 2 s f(b),     b = b + 2 s f(a),     at the end of the column b = b + s f(a),

so that a column ends at (a + b) / 2. What a and b lie apart has an expansion as the end has, and is
0 in the limit. But f alone joins both: where it has a layer thinner than a sub-step, they may stay
at its two sides, and all columns agree on a false end. The weighted sum of a - b shows that.

The forms have the same bits. Of a line of lanes columns are carried out

- in turn: a loop over pairs of sub-steps, one column after the other;
- side by side: straight-line code of all columns, where f is short.

Of one trajectory columns are the lanes. Ends less x stand in the row `ends` of `Work`, a - b in
`apart`, y_N of the last column and f there in `a` and `f_last`.
"""

import numpy as np

from ..code.compiler import numbers_in_register
from ..code.text import Code, Index, Shared, Value
from .columns import CHAINS, EXPLICIT, in_turn
from .functions import INLINED
from .scope import Scope

# Operations of f, and three for each component, up to which all sub-steps are written out: that
# spares branches, but more of them would leave the cache for code.
SHORT = 25
LANES = 1 + len(CHAINS)  # of columns of one trajectory: a chain each, and the first one again


def lane_numbers(half):
    """Return how many numbers columns in lanes need, after the rows of `Work` of one trajectory."""
    own = (3 + 2 * len(in_turn(CHAINS))) * half.f.D + len(half.f.denominators)
    return LANES * (1 + own + half.functions["f"].scratch)  # 1 to begin at a multiple


class ExplicitColumns(Scope):
    """The function void columns(x, f, table, work, count): the ends y_c - x of first columns.

    `x` and `f` are the addresses of the rows of a state and of f there. The length of the step is
    in the row `signed` of `work`.
    """

    def __init__(self, text, half, name, for_each):
        super().__init__(text, half, name, for_each, "%work")
        self.of_f = half.functions["f"]
        self.is_inlined = self.of_f.length <= INLINED

    def add(self):
        """Add the function."""
        are_lanes = self.text.W == 1 and self.of_f.length < np.inf
        inner = Code(LANES, self.text) if are_lanes else self.narrower()
        if are_lanes and not self.is_inlined:
            self.of_f.add(inner, f"{self.name}_f_lanes", False, 0)
        with self.text.function(f"{self.name}_columns", ("x", "f", "table", "work", "count")):
            if are_lanes:
                self.in_lanes(inner)
                return
            if self.of_f.length + 3 * self.D <= SHORT and not self.of_f.calls_by_lane:
                are_all = Index(self.text, "%count").equals(len(EXPLICIT))
                with self.text.when(are_all):
                    self.side_by_side(inner)
                    self.text.leave("void")
            self.in_turn(inner)

    def narrower(self):
        """Return the code of sub-steps.

        Where f is within the code and calls no function, lanes of one register take turns, because
        registers are few.
        """
        W = numbers_in_register()
        if self.is_inlined and W < self.text.W and not self.of_f.calls:
            return self.text.lanes(W)
        return self.text

    def parts(self, inner):
        """Add a loop over the registers of a line; yield x, f, the address of `work`, and table."""
        for part in self.text.each(self.text.W // inner.W, most=0):
            offset = part * (8 * inner.W)
            x, f, work, table = (
                Index(self.text, f"%{name}") for name in ("x", "f", "work", "table")
            )
            x, f, work = x + offset, f + offset, work + offset
            table = table + offset if self.for_each else table
            yield inner.array(x), inner.array(f), work, table

    # ------------------------------------------------------------------------------------- in turn
    def in_turn(self, inner):
        """Add the first `count` columns, pair by pair of sub-steps."""
        text, work, D = self.text, self.half.work, self.D
        pairs = [pair for [pair] in in_turn((EXPLICIT,))]
        columns = self.constants("column", [EXPLICIT.index(pair.N) for pair in pairs])
        inverses = self.constants("inverse", [1.0 / pair.N for pair in pairs])
        begins = self.constants("begins", [int(pair.begins) for pair in pairs])
        ends = self.constants("ends", [int(pair.ends) for pair in pairs])
        for k in text.each(len(pairs), most=0):
            column, begin, end = columns[k], begins[k], ends[k]
            inverse = Shared(inner, inverses.base)[k]
            is_end = end.differs(0)
            with text.when(column < "%count"):
                for x, f, lanes, table in self.parts(inner):
                    of_work = inner.arrays(lanes, work)
                    s = of_work.signed[0] * inverse
                    double = s + s
                    factor = is_end.select(s, double)
                    with text.when(begin.differs(0)):
                        for i in text.each(D):
                            of_work.a[i] = start = x[i]
                            of_work.b[i] = start + s * f[i]
                    of_a = self.pair(of_work, table, double, factor)
                    with text.when(is_end):
                        ends, apart = (
                            inner.array(rows.at(column * D))
                            for rows in (of_work.ends, of_work.apart)
                        )
                        for i in text.each(D):
                            ends[i], apart[i] = end_of_column(of_work.a[i], of_work.b[i], x[i])
                        for i, value in enumerate(of_a):
                            of_work.f_last[i] = value

    def pair(self, work, table, double, factor):
        """Add two sub-steps; return f at the state after the first, [] if it is in its rows."""
        a, b, f = work.a, work.b, work.f_last
        if self.is_inlined:
            return self.pair_of_rows(a, b, table, double, factor)
        for of, to, length in ((b, a, double), (a, b, factor)):
            self.call("f", of, table, f)
            for i in self.text.each(self.D):
                product = length * f[i]
                to[i] = to[i] + product
        return []

    def pair_of_rows(self, rows_a, rows_b, table, double, factor):
        """Add two sub-steps with f within the code; return f at the state after the first."""
        D = self.D
        b = [rows_b[i] for i in range(D)]
        f = self.value(b, table)
        a = added([rows_a[i] for i in range(D)], double, f)
        for i in range(D):  # before f there: registers are few
            rows_a[i] = a[i]
        f = self.value(a, table)
        for i, value in enumerate(added(b, factor, f)):
            rows_b[i] = value
        return f

    def value(self, x, table):
        """Return f at a state, with f within the code."""
        text, for_each = x[0].text, self.for_each and self.text.W > 1
        values = self.of_f.values(text, lambda k: x[k], table, for_each)
        return [Value(text, value) for value in values[: self.D]]

    # --------------------------------------------------------------------------------- side by side
    def side_by_side(self, inner):
        """Add all columns as straight-line code for a register of lanes."""
        D = self.D
        for x, f, lanes, table in self.parts(inner):
            x, f, work = (
                [x[i] for i in range(D)],
                [f[i] for i in range(D)],
                inner.arrays(lanes, self.half.work),
            )
            h, states = work.signed[0], {}
            for m, N in ((m, N) for m in range(max(EXPLICIT) // 2) for N in EXPLICIT if 2 * m < N):
                s = h * (1.0 / N)
                double, is_end = s + s, 2 * m + 2 == N
                if m == 0:
                    states[N] = x, added(x, s, f)
                a, b = states[N]
                a = added(a, double, self.value(b, table))
                of_a = self.value(a, table)
                states[N] = a, added(b, s if is_end else double, of_a)
                if is_end:
                    first = EXPLICIT.index(N) * D
                    for i, each in enumerate(zip(*states[N], x, strict=True)):
                        work.ends[first + i], work.apart[first + i] = end_of_column(*each)
            for i, (a, f) in enumerate(zip(states[N][0], of_a, strict=True)):
                work.a[i] = a
                work.f_last[i] = f

    # ------------------------------------------------------------------------------------- in lanes
    def in_lanes(self, inner):
        """Add the columns of one trajectory, which are lanes.

        Columns of 8 and 2 share a lane, as those of 6 and 4, so that ten values of f are computed
        one after the other in place of thirty.
        """
        text, work, D = self.text, self.work, self.D
        rounds = [(*each, each[0]) for each in in_turn(CHAINS)]
        parts = self.constants("parts", [[1.0 / pair.N for pair in each] for each in rounds])
        last = self.constants(
            "last", [[1.0 if pair.ends else 2.0 for pair in each] for each in rounds]
        )
        begin = self.constants("begin", [[float(pair.begins) for pair in each] for each in rounds])
        has_end = self.constants("ends", [int(any(pair.ends for pair in each)) for each in rounds])
        # a, b and f of all lanes, then ends, and how far they lie apart; none lies across two lines
        # of the cache, where memory of one trajectory may begin anywhere
        rows = (work.size.at() + (8 * LANES - 1)) & -(8 * LANES)
        first_ends, rounds_D = 2 * D + self.extended, len(rounds) * D
        a, b, f, ends = (inner.array(rows, k) for k in (0, D, 2 * D, first_ends))
        apart = ends.after(rounds_D)
        parts, last, begin = (inner.array(each.base) for each in (parts, last, begin))
        scratch = apart.at(rounds_D)
        signed = in_all_lanes(inner, work.signed[0])
        x_of_one, f_of_one = text.array("%x"), text.array("%f")
        for m in text.each(len(rounds), most=0):
            s = signed * parts[m]
            double, factor = s + s, s * last[m]
            begins = begin[m] > 0.0
            with text.when(begins.any()):
                for i in text.each(D):
                    x = in_all_lanes(inner, x_of_one[i])
                    first = x + s * in_all_lanes(inner, f_of_one[i])
                    a.choose(begins, i, x)
                    b.choose(begins, i, first)
            if self.is_inlined:
                for i, value in enumerate(self.pair_of_rows(a, b, "%table", double, factor)):
                    f[i] = value
            else:
                for of, to, length in ((b, a, double), (a, b, factor)):
                    text.invoke(f"{self.name}_f_lanes", of, "%table", f, scratch)
                    for i in text.each(D):
                        product = length * f[i]
                        to[i] = to[i] + product
            with text.when(has_end[m].differs(0)):
                of_pair = m * D
                for i in text.each(D):
                    found = end_of_column(a[i], b[i], in_all_lanes(inner, x_of_one[i]))
                    ends[of_pair + i], apart[of_pair + i] = found
        for i in text.each(D):
            for m, each in enumerate(rounds):
                for lane, pair in enumerate(each[:-1]):
                    if pair.ends:
                        of_column = EXPLICIT.index(pair.N) * D
                        for source, target in ((ends, work.ends), (apart, work.apart)):
                            number = text.array(source.after(m * D).at(i), lane)[0]
                            target.after(of_column)[i] = number
            work.a[i] = text.array(a.at(i))[0]
            work.f_last[i] = text.array(f.at(i))[0]


def in_all_lanes(text, number):
    """Return a number of one lane in all lanes of another text."""
    return Value(text, text.splat(number, text.W))


def added(x, factor, change):
    """Return x + factor * change for all components."""
    products = [factor * each for each in change]
    return [a + product for a, product in zip(x, products, strict=True)]


def end_of_column(a, b, x):
    """Return the end of a column, less x, of a component, and how far its two halves lie apart."""
    return (a + b) * 0.5 - x, a - b
