"""The columns of an implicit step: the linearly implicit Euler rule, and the matrix of its steps.

With s = h / N and A = 1 - s J, where J is f' at x, a column is

c = A**-1 s f(x),     N - 1 times c = c + A**-1 s f(x + c),

and ends at x + c: the states are y_m+1 = y_m + A**-1 s f(y_m). The expansion of the ends is valid
for every J. As J is f' at x, a column does not show a layer of f that its first or last sub-step
crosses. Let c_1 and c_N be the increments in the first and last sub-step. Such layers show in

N (s f(x + c_1) - c_1)    and    N c_N - h f(x_next).

On true steps both vanish after extrapolation. A step is tested by A**-1 (first + second / 2), with
A of the last column, so that layers at both ends do not cancel. At a knee f' at the end is much
smaller than J. Then a step that has wrongly followed the slow motion of its start would pass,
because A**-1 makes its error small. So f is evaluated once more, at the end plus A**-1 (first +
second / 2). If f' at the end differs from J, A**-1 second / 2 is tested with f' of the end, too.

Columns with N = 4, 8, 12 and 16 pass the quarters of the step. States at the quarters are
extrapolated like the end, with order 4 and the same stability. They locate crossings of surfaces.

The power iteration on f' gives the largest rate |mu| of the motion: with components z_i relative to
their largest moduli S_i,

w = f' (S z) / S,     |mu| = max_i |w_i|,     z = w / |mu| + seed.
"""

from math import inf
from operator import add, mul

from ..expressions.compensated import compensated
from ..expressions.sparse_elimination import Sparse
from ..expressions.symbolic_elimination import Elimination, elimination_order, filled, operations_of
from ..expressions.tolerances import TINY
from ..llvm.sparse_solver import add_factors, add_solution
from ..llvm.text import Carried, Index
from . import vector_functions
from .codegen import FunctionCode, larger_of
from .memory import LaneState
from .rule import Rule
from .scalar_kernels import scalar_kernel
from .step_length import TURN_IMPLICIT
from .tolerances import ERRORS_OF_END, MOST_APART, MOST_IN_LINE, SMALLEST_SCALE
from .weights import OF_7, QUARTERS, implicit_columns, weights


@scalar_kernel
def DIFFERS(right, apart, at_end, f_beside, f_new, inverse, s, differs):
    """Set `differs` to 1 if f' at the end of a step, times `right`, differs from f' at its start.

    `apart`, `at_end` and `right` are the `first`, `second` / 2 and the test of the head of this
    file. With f' at the start, (1 - s f') right is `apart` + `at_end`. With f' at the end, it
    follows from `f_beside`, which is f at the state `right` beyond the end. f' differs if the
    second vector is below half of the first one. A first vector below MOST_APART / ERRORS_OF_END
    times the allowed errors does not matter.
    """
    whole, own = apart + at_end, right - s * (f_beside - f_new)
    is_large = ERRORS_OF_END * abs(whole) * inverse > MOST_APART
    return {"differs": (is_large & (abs(own) < 0.5 * abs(whole))).select(1.0, differs)}


@scalar_kernel
def POINT_IMPLICIT(x, new, quarter1, quarter2, quarter3, u):
    """Return a component at the fraction u of an implicit step, on the quartic through quarters.

    Rates at both ends are not used, because they contain fast modes of stiff equations.
    """
    v = [4.0 * u - float(k) for k in range(5)]
    of_new = v[0] * v[1] * v[2] * v[3] * (1.0 / 24.0)
    outer, inner = v[0] * v[2] * v[4] * (-1.0 / 6.0), v[0] * v[1] * v[3] * v[4] * 0.25
    sides = outer * v[3] * quarter1 + outer * v[1] * quarter3
    return {"point": x + (sides + inner * quarter2 + of_new * (new - x))}


class LinearlyImplicit(Rule):
    """The linearly implicit Euler rule. With k columns the order of its steps is k."""

    mode, p, power = LaneState.IMPLICIT, 1, 9
    interpolates, damps, has_points = False, True, True
    loses = 8, 10
    columns_for = staticmethod(implicit_columns)
    floor, grows, lanes = "floor_implicit", 4.0, 4  # weights enlarge rounding 16 times as much

    def add_functions(self, functions):
        f, D = self.f, self.f.D
        if self.columns != OF_7 and not f.is_dense:  # with a close rtol, rounding limits the steps
            program = compensated(f.with_denominators)
            functions["f"] = vector_functions.ProgramFunction(program, D, f.places)
        if f.is_dense:
            functions["j"] = vector_functions.DenseQuadratic(D, True)
        elif f.products:
            functions["j"] = vector_functions.JacobianColumns(f)
        else:
            functions["j"] = vector_functions.ProgramFunction(f.derivative, D, f.places)
        order = elimination_order(f.pattern, D)
        fill, of = filled(f.pattern, order), vector_functions
        if operations_of(fill) > MOST_IN_LINE:
            plan = Sparse(f.pattern, order, fill)
            functions["factor"] = of.SparseLoops(plan, add_factors)
            functions["solve"] = of.SparseLoops(plan, add_solution)
            self.factors = D + plan.size
        else:
            elimination = Elimination(f.pattern, order, fill)
            self.factors = len(elimination.factors.results)
            functions["factor"] = of.ProgramFunction(elimination.factors, f.entries + 1)
            functions["solve"] = of.ProgramFunction(elimination.solution, self.factors + D)

    def rows(self):
        D = self.f.D
        return {
            "apart": D,  # a sum that shows false ends
            "nodes": 6 * D,  # states at quarters minus x, then the sums that become these states
            "jacobian": self.f.entries + 1,  # entries of f', then s = h / N
            "factors": self.factors,  # factors of 1 - s f'
            "right": D,  # right side of equations, which `solve` reads after `factors`
            "of_end": self.factors,  # factors of 1 - s f' with f' at the end of a step
            "at_end": D,  # right side, which `solve` reads after `of_end`
        }

    def add(self, text, integrator, name, for_each):
        ImplicitColumns(text, integrator, name, for_each).add()

    def find_columns(self, code):
        rate = derive(code)
        super().find_columns(code)
        if code.integrator.read:  # states at 1/4, 1/2, 3/4 of the step, minus x
            code.text.copy(code.work.nodes.after(3 * code.D), code.work.nodes, 3 * code.D)
        return {"rate": rate}

    def begin_errors(self, code):
        find_apart(code)

    def add_errors(self, code, i, sums, inverse):
        return {"apart": larger_of(abs(code.work.right[i]) * inverse, sums.apart)}

    def end_errors(self, code, errors):
        return {"apart": find_apart_at_end(code, errors)}

    def begin_trial(self, code):
        code.text.copy(code.work.right, code.work.b, code.D)
        return lambda i: code.work.b[i]

    def row_of_change(self, code):
        return code.work.right

    def propagate(self, code):
        code.call("solve", code.work.factors, code.table, code.work.right)

    def turn(self, code, errors):
        code.keep(code.line, code.apply(TURN_IMPLICIT, **errors))

    def point(self, code, i, u):
        """Return component i at the fraction u of a step."""
        quarters = {f"quarter{k + 1}": code.work.nodes.after(k * code.D)[i] for k in range(3)}
        return code.apply(POINT_IMPLICIT, i, u=u, **quarters)["point"]


class ImplicitColumns(FunctionCode):
    """Writer of the function `columns` (`Rule.add`); the row `jacobian` has f'(x)."""

    def add(self):
        text, work = self.text, self.work
        with text.function(f"{self.name}_columns", ("x", "f", "table", "work", "count")):
            columns, own = self.integrator.rule.columns, self.integrator.rule.weights
            lengths = text.constants(columns)
            inverses = text.constants([1.0 / N for N in columns])
            of_rates = [N * w for N, w in zip(columns, own, strict=True)]
            of_rates = text.constants(of_rates)
            if self.integrator.read:
                self.begin_quarters()
            text.fill(work.apart, self.D, lambda: 0.0)
            text.fill(work.at_end, self.D, lambda: 0.0)
            for c in text.each(Index(text, "%count")):
                N = lengths[c]
                s = work.signed[0] * inverses[c]
                self.column(c, N, s, of_rates[c], work.ends.from_here(c * self.D))

    def column(self, c, N, s, weight, ends):
        """Add column c, N sub-steps of length s; write end - x to `ends`. `weight` is N w_c."""
        text, work, D = self.text, self.work, self.D
        x, f = text.array("%x"), text.array("%f")
        a, b, right, apart = work.a, work.b, work.right, work.apart
        work.jacobian[self.f.entries] = s
        self.call("factor", work.jacobian, "%table", work.factors)
        text.fill(right, D, mul, s, f)
        self.call("solve", work.factors, "%table", right)
        text.copy(right, ends, D)
        for m in text.each(N - 1):
            if self.integrator.read:  # states at quarters are weighted sums over columns
                number = self.numbers[self.firsts[c] + m]
                with text.when(number < 3, likely=False):
                    sums, of_column = self.sums.from_here(number * D), self.of_quarters[c]
                    text.fill(sums, D, _plus_part, sums, of_column, ends)
            text.fill(a, D, add, x, ends)
            self.call("f", a, "%table", b)
            text.fill(right, D, mul, s, b)
            with text.when(m.equals(0)):
                text.fill(apart, D, lambda a, w, c, b: a + w * (c - b), apart, weight, right, ends)
            self.call("solve", work.factors, "%table", right)
            text.fill(ends, D, add, ends, right)
        text.fill(work.at_end, D, _plus_part, work.at_end, weight * 0.5, right)

    def begin_quarters(self):
        """Begin sums for states at quarters of the step; list which sub-steps end at a quarter."""
        own = dict(zip(QUARTERS, weights(QUARTERS, 1), strict=True))
        columns = self.integrator.rule.columns
        numbers = [
            4 * m // N - 1 if N in own and 4 * m % N == 0 else 3
            for N in columns
            for m in range(1, N)
        ]
        self.numbers = self.text.constants(numbers)
        self.firsts = self.text.constants([sum(columns[:c]) - c for c in range(len(columns))])
        self.of_quarters = self.text.constants([own.get(N, 0.0) for N in columns])
        self.sums = self.work.nodes.after(3 * self.D)
        self.text.fill(self.sums, 3 * self.D, lambda: 0.0)


def _plus_part(a, part, b):
    return a + part * b


def find_apart(code):
    """Write to `right` sums that are about 0, but large where all columns agree on a wrong end."""
    text, work, D = code.text, code.work, code.D
    text.fill(work.at_end, D, _plus_part, work.at_end, work.signed[0] * -0.5, work.f_new)
    text.fill(work.right, D, add, work.apart, work.at_end)
    code.call("solve", work.factors, code.table, work.right)


def find_apart_at_end(code, errors):
    """Return the test of false steps, `apart`, in which f' at the end of the step counts, too."""
    text, work, D = code.text, code.work, code.D
    s = work.signed[0] * (1.0 / code.integrator.rule.columns[-1])
    text.fill(work.a, D, add, work.new, work.right)
    code.call("f", work.a, code.table, work.b)
    differs = Carried(differs=0.0)
    for i in text.each(D, differs):
        differs.update(code.apply(DIFFERS, i, f_beside=work.b[i], s=s, **vars(differs)))
    counts = (differs.differs > 0.0) & (errors["ratio"] <= 1.0) & (errors["apart"] <= MOST_APART)

    def with_end():
        _put_jacobian(code, work.new)
        work.jacobian[code.f.entries] = s
        code.call("factor", work.jacobian, code.table, work.of_end)
        code.call("solve", work.of_end, code.table, work.at_end)
        largest = Carried(ratio=errors["apart"])
        for i in text.each(D, largest):
            own = work.at_end[i] * ERRORS_OF_END
            work.right.choose(counts & (abs(own) > abs(work.right[i])), i, own)
            largest.ratio = larger_of(abs(work.right[i]) * work.inverse[i], largest.ratio)
        return [largest.ratio]

    return text.otherwise(~counts.any(), [errors["apart"]], with_end)[0]


def _finite(entry):
    """Return an entry of f', or 0 if it is not finite: the rule takes any matrix for f'."""
    return (abs(entry) < inf).select(entry, 0.0)


def _put_jacobian(code, x):
    """Write f'(x) to the row `jacobian`."""
    jacobian = code.work.jacobian
    code.call("j", x, code.table, jacobian)
    code.text.fill(jacobian, code.f.entries, _finite, jacobian)


def derive(code):
    """Write f'(x) to the row `jacobian`; return an estimate of |mu|, its largest eigenvalue."""
    text, line, work = code.text, code.line, code.work
    entries = code.f.entries
    jacobian, right, scale, scaled = work.jacobian, work.right, work.start, work.a
    _put_jacobian(code, line.x)
    largest = Carried(top=0.0)
    for i in text.each(code.D, largest):
        largest.top = larger_of(line.largest[i], largest.top)
    for i in text.each(code.D):
        scale[i] = own = larger_of(line.largest[i], SMALLEST_SCALE * largest.top) + TINY
        scaled[i] = own * line.power_vector[i]
    text.fill(right, code.D, lambda: 0.0)
    if entries:
        rows, columns = map(text.constants, zip(*code.f.pattern, strict=True))
        for k in text.each(entries):
            i = rows[k]
            right[i] = right[i] + jacobian[k] * scaled[columns[k]]
    size = Carried(size=0.0)
    for i in text.each(code.D, size):
        right[i] = own = right[i] / scale[i]
        size.size = larger_of(abs(own), size.size)
    has_rate = size.size > 0.0
    for i in text.each(code.D):
        turned = right[i] / size.size + code.component("seeds", i)
        line.power_vector.choose(has_rate, i, turned)
    return size.size
