"""The columns of an explicit step: Gragg's midpoint rule with smoothing, in three forms of code.

A column takes N sub-steps of the length s = h / N:

y_1 = x + s f(x),     y_m+1 = y_m-1 + 2 s f(y_m),     end (y_N-1 + y_N + s f(y_N)) / 2.

Without the smoothing at the end, jumps of f give errors of 15 % at every tolerance. Two states
alternate: a is y_m for even m, and b for odd m. A pair of sub-steps is

a = a + 2 s f(b),     b = b + 2 s f(a),     at the end of the column b = b + s f(a),

so that a column ends at (a + b) / 2. The difference a - b has an expansion like that of the end,
and is 0 in the limit. But only f connects a and b: if it has a layer thinner than a sub-step, they
may stay on its two sides, and all columns agree on a false end. A weighted sum of a - b shows it.

All forms have the same bits: a loop over pairs of sub-steps, one column after the other
(`in_turn`); straight-line code of all columns if f is short (`side_by_side`); and, for one
trajectory of an f with dense matrices, columns in the lanes of vectors (`in_lanes`). For results
see `memory.rows_of_work`; `stormer` has half of this rule.
"""

import functools

from ..llvm.compiler import numbers_in_register
from ..llvm.text import Array, Code, Index, Shared, Value
from . import allowed_errors, step_length
from .codegen import FunctionCode, larger_of, weighted
from .memory import LaneState
from .rule import Rule
from .tolerances import MOST_INLINED, MOST_UNROLLED
from .weights import explicit_columns, lanes_of


class Gragg(Rule):
    """Gragg's rule. With n columns the order of its steps is 2 n."""

    mode, p = LaneState.EXPLICIT, 2
    interpolates, damps, predicts = True, False, True
    columns_for = staticmethod(explicit_columns)
    floor, grows, sums = "floor", 0.25, ("rates", "states")

    def __init__(self, f, columns):
        super().__init__(f, columns)
        self.order = 2 * len(columns)
        self.power = self.order - 1  # of the estimate, which has one column less
        self.loses = len(columns) + 3, self.order
        self.nodes = len(columns) - 1  # parts of a step with states for `dense_output`
        self.lanes = len(lanes_of(columns))

    def rows(self):
        D = self.f.D
        # A sum for each column shows false ends; states inside a step, with f (`dense_output`).
        return {"apart": len(self.columns) * D, "nodes": 2 * (self.nodes - 1) * D}

    def add(self, text, integrator, name, for_each):
        ExplicitColumns(text, integrator, name, for_each).add()

    def add_errors(self, code, i, sums, inverse):
        inputs = {"last": code.work.a[i], "inverse": inverse, "taken": code.work.taken[0]}
        found = code.apply(allowed_errors.DIFFERENCES, i, **vars(sums) | inputs)
        return found | {"apart": larger_of(abs(self._apart(code, i)) * inverse, sums.apart)}

    def _apart(self, code, i):
        return weighted(self.weights, code.of_columns(code.work.apart, i))

    def begin_trial(self, code):
        return lambda i: self._apart(code, i)

    def turn(self, code, errors):
        looks = code.apply(step_length.LOOKS, **errors)["looks"]
        with code.text.when(looks.any(), likely=False):
            code.keep(code.line, code.apply(step_length.TURN_EXPLICIT, **errors))


class ExplicitColumns(FunctionCode):
    """Writer of the function `columns` (`Rule.add`) by Gragg's midpoint rule."""

    names = "f", "f"  # functions for the rates of the components in `a` and in `b`

    def __init__(self, text, integrator, name, for_each):
        super().__init__(text, integrator, name, for_each)
        self.functions = {name: integrator.functions[name] for name in self.names}
        self.columns = integrator.rule.columns
        self.length = sum(function.length for function in self.functions.values())
        self.is_inlined = self.length <= MOST_INLINED
        self.rows = range(self.D), range(self.D)  # components that `a` and `b` hold

    def add(self):
        lanes = Code(len(lanes_of(self.columns)), self.text.target)
        inner, all_columns = self.narrower(), None
        if self.f.products and self.text.W == 1 and len(self.functions) == 1:
            self.functions["f"].add(lanes, f"{self.name}_lanes", False)
            all_columns = functools.partial(self.in_lanes, lanes)
        elif self.work_of_pair() <= MOST_UNROLLED and not self._have("calls_by_lane"):
            all_columns = functools.partial(self.side_by_side, inner)
        with self.text.function(f"{self.name}_columns", ("x", "f", "table", "work", "count")):
            self.of_a, self.of_b = map(self.text.listed, self.rows)
            if all_columns is not None:
                count = len(self.columns)
                with self.text.when(Index(self.text, "%count").equals(count)):
                    all_columns()
                    self.text.leave("void")
            self.in_turn(inner)

    def work_of_pair(self):
        """Return an estimate of a sub-step's operations; if they are few, columns are unrolled."""
        return self.length + 3 * self.D

    def _have(self, name):
        return any(getattr(function, name) for function in self.functions.values())

    def narrower(self):
        """Return `Code` for one register of lanes if f is inlined without calls, else for all."""
        W = numbers_in_register()
        if self.is_inlined and W < self.text.W and not self._have("calls"):
            return self.text.lanes(W)
        return self.text

    def parts(self, inner):
        """Add a loop over parts of a pack, as wide as `inner`; yield x, f, work, table of each."""
        for part in self.text.each(self.text.W // inner.W):
            offset = part * (8 * inner.W)
            x, f, work = (Index(self.text, f"%{name}") + offset for name in ("x", "f", "work"))
            table = Index(self.text, "%table")
            table = table + offset if self.for_each else table
            yield inner.array(x), inner.array(f), work, table

    # ------------------------------------------------------------------------------------- in turn
    def in_turn(self, inner):
        """Add a loop over pairs of sub-steps, column by column, for lanes of the `Code` `inner`."""
        text, work, D = self.text, self.integrator.work, self.D
        numbered = enumerate(self.columns)
        pairs = [(c, N, m) for c, N in numbered for m in range(N // 2)]
        columns = text.constants([c for c, _, _ in pairs])
        inverses = text.constants([1.0 / N for _, N, _ in pairs])
        begins = text.constants([int(m == 0) for _, _, m in pairs])
        ends = text.constants([int(m == N // 2 - 1) for _, N, m in pairs])
        for k in text.each(len(pairs)):
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
                        self.begin(of_work.a, of_work.b, x, f, s, *self.loops())
                    of_b = self.pair(of_work, table, double, factor)
                    with text.when(is_end):
                        ends = inner.array(of_work.ends.at(column * D))
                        apart = inner.array(of_work.apart.at(column * D))
                        self.end(of_work.a, of_work.b, x, ends, apart, *self.loops())
                        for i, value in of_b.items():
                            of_work.f_last[i] = value
        if len(self.functions) > 1:
            with text.when(Index(text, "%count").equals(len(self.columns))):
                for _, _, lanes, table in self.parts(inner):
                    own = inner.arrays(lanes, work)
                    self.put_rates_at_end(own.a, own.b, table, self.of_b(), own.f_last)

    def put_rates_at_end(self, a, b, table, of_b, f):
        """Write rates at the end to f that sub-steps do not evaluate: Gragg's rule has none."""

    def loops(self):
        """Return two loops, over the components in the row `a` and over the components in `b`."""
        return self.of_a(), self.of_b()

    def begin(self, a, b, x, f, s, of_a, of_b):
        """Begin a column of sub-steps s: a = x for components `of_a`, b = x + s f for `of_b`."""
        for i in of_a:
            a[i] = x[i]
        for i in of_b:
            b[i] = x[i] + s * f[i]

    def end(self, a, b, x, ends, apart, of_a, of_b):
        """For i in `of_a` write the end minus x, (a + b) / 2 - x, to `ends`; a - b to `apart`."""
        for i in of_a:
            ends[i], apart[i] = (a[i] + b[i]) * 0.5 - x[i], a[i] - b[i]

    def pair(self, work, table, double, factor):
        """Add two sub-steps to the rows a and b of `work`: a += double f(b), b += factor f(a).

        Return {i: rate} of f(a); or, if a call of f writes f(a) to the row `f_last`, return {}.
        """
        a, b, f = work.a, work.b, work.f_last
        if self.is_inlined:
            return self.pair_of_rows(a, b, table, double, factor)
        for name, of, to, length, own in zip(
            self.names, (b, a), (a, b), (double, factor), (self.of_a, self.of_b), strict=True
        ):
            self.call(name, of, table, f)
            for i in own():
                product = length * f[i]
                to[i] = to[i] + product
        return {}

    def pair_of_rows(self, rows_a, rows_b, table, double, factor):
        """Add the two sub-steps of `pair` with inlined f; return the rates f(a) as {i: rate}."""
        (of_a, of_b), (A, B) = self.names, self.rows
        b = {i: rows_b[i] for i in B}
        f = self.value(of_a, b, table)
        a = added({i: rows_a[i] for i in A}, double, f)
        for i in A:  # stored before f(a) is computed, because registers are few
            rows_a[i] = a[i]
        f = self.value(of_b, a, table)
        for i, value in added(b, factor, f).items():
            rows_b[i] = value
        return f

    def value(self, name, x, table):
        """Return {i: rate} at the state x by inlined code of the function `name`, such as "f"."""
        text = x.text if isinstance(x, Array) else next(iter(x.values())).text
        for_each = self.for_each and self.text.W > 1
        values = self.integrator.functions[name].values(text, lambda k: x[k], table, for_each)
        return {i: Value(text, value) for i, value in values.items() if i < self.D}

    # ------------------------------------------------------------------------------------- in lanes
    def in_lanes(self, lanes):
        """Add code that computes all columns of one trajectory, in lanes of `lanes` (a `Code`).

        So columns that `lanes_of` puts side by side share each entry of a matrix that is loaded.
        """
        text, work, D = self.text, self.work, self.D
        x, f, own = text.array("%x"), text.array("%f"), work.lanes.at()
        a, b, rates = (lanes.array(own, k * D) for k in range(3))
        in_turn = lanes_of(self.columns)
        pairs = ([(N, m) for N in of for m in range(N // 2)] for of in in_turn)
        rounds = [*zip(*pairs, strict=True)]
        rows = [[1.0 / N for N, _ in now] for now in rounds]
        rows += [[float(m == 0) for _, m in now] for now in rounds]
        rows += [[float(2 * m + 2 == N) for N, m in now] for now in rounds]
        numbers, signed = lanes.array(lanes.constants(rows).base), lanes.splat(work.signed[0])

        def of_lane(rows, k):
            return Code(1, text.target, lanes.size).array(rows.at() + 8 * k)

        left = {*self.columns}  # columns that have not ended; a lane may repeat one
        for r, now in enumerate(rounds):
            s, begins, ends = (numbers[r + len(rounds) * k] for k in range(3))
            s, begins, ends = signed * s, begins > 0.5, ends > 0.5
            double = s + s
            for i in text.each(D):
                start, rate = lanes.splat(x[i]), lanes.splat(f[i])
                a[i] = begins.select(start, a[i])
                b[i] = begins.select(start + s * rate, b[i])
            for of, to, factor in ((b, a, double), (a, b, ends.select(s, double))):
                text.invoke(f"{self.name}_lanes", of, "%table", rates, work.scratch)
                for i in text.each(D):
                    to[i] = to[i] + factor * rates[i]
            for k, (N, m) in enumerate(now):
                if 2 * m + 2 == N and N in left:
                    left.remove(N)
                    first = self.columns.index(N) * D
                    to = work.ends.after(first), work.apart.after(first)
                    self.end(of_lane(a, k), of_lane(b, k), x, *to, *self.loops())
        text.copy(of_lane(a, 0), work.a, D)
        text.copy(of_lane(rates, 0), work.f_last, self.extended)

    # --------------------------------------------------------------------------------- side by side
    def side_by_side(self, inner):
        """Add all columns as straight-line code; `inner` is the `Code` for a register of lanes."""
        D = self.D
        of_a, of_b = self.names
        for x, f, lanes, table in self.parts(inner):
            x, f = ({i: rows[i] for i in range(D)} for rows in (x, f))
            work = inner.arrays(lanes, self.integrator.work)
            h, states = work.signed[0], {}
            columns = self.columns
            rounds = range(max(columns) // 2)
            for m, N in ((m, N) for m in rounds for N in columns if 2 * m < N):
                s = h * (1.0 / N)
                double, is_end = s + s, 2 * m + 2 == N
                a, b = states.get(N, ({}, {}))
                if m == 0:
                    self.begin(a, b, x, f, s, *self.rows)
                a = added(a, double, self.value(of_a, b, table))
                f_last = self.value(of_b, a, table)
                b = added(b, s if is_end else double, f_last)
                states[N] = a, b
                if is_end:
                    first = self.columns.index(N) * D
                    ends, apart = work.ends.after(first), work.apart.after(first)
                    self.end(a, b, x, ends, apart, *self.rows)
            self.put_rates_at_end(a, b, table, self.rows[1], f_last)
            for i in range(D):
                work.a[i] = a[i]
                work.f_last[i] = f_last[i]


def added(x, factor, change):
    """Return {i: x_i + factor * change_i} for the components i of the dict `change`."""
    products = {i: factor * each for i, each in change.items()}
    return {i: x[i] + product for i, product in products.items()}
