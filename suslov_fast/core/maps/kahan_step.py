"""A step of a field as an expression program, planned from its pattern of zeros.

With h = eps / 2 and N(x) = h f'(x) a step solves (1 - N) delta = h f(x), x_next = x + 2 delta
(theory, section 7). If an increment cancels a component, the same matrix gives all digits by

(1 - N) x_next = x + h l x + 2 h c,

with the linear and constant parts l and c of f. Elimination is planned once, because the terms of
the field alone decide which entries of N are 0. For pivots k, in an order with little fill-in,

pivot_k = 1 - N_kk,   m_ik = N_ik / pivot_k,   N_ij += m_ik N_kj,   g_i += m_ik g_k,

for i and j that come later, where g = h f(x) at first; then, backwards,

delta_k = (g_k + sum_j N_kj delta_j) / pivot_k.

The derivative is (1 - N(x))**-1 (1 - M(x_next)) with M(x) = -h f'(x). These sums of products, and
the tests that they keep their digits, are the same for all states. They form a program of
operations (instruction, number, operands); each computes the value with this number. `stage_code`
makes machine code of it; `evaluate` runs it in NumPy, with the same bits. Values that depend on
parameters alone are computed once a run. A step of the Lorenz system takes 81 operations with its
tests, two of them divisions; here products and additions in a sum count singly.
"""

import numpy as np

from ..cached import cached_property
from ..expressions.numpy_evaluation import evaluate
from ..expressions.programs import Values, length_of
from ..expressions.symbolic_elimination import (
    Factors,
    Matrix,
    elimination_order,
    filled,
    places_of,
    work_of,
)
from ..expressions.values import joined, larger
from .tolerances import (
    COMPONENTS_WITH_COLUMNS,
    LARGE_BESIDE_INCREMENT,
    LEAST_WITH_SIGN,
    MOST_OF_DENSE,
    MOST_OF_PARAMETERS,
    MOST_OF_SPARSE,
    MOST_OPTIMISED,
    PART_OF_DENSE,
    SMALL_BESIDE_INCREMENT,
    WORK_WITH_COLUMNS,
)


def of_one_sign(indices):
    """Return the i of the x_i that keep their signs: all terms v x_j x_k of f_i contain x_i."""
    i, j, k = indices
    return {*i.tolist()} - {*i[(i != j) & (i != k)].tolist()}


def _plan_of(indices, D):
    """Return the order of pivots in 1 - N(x), places after fill-in, and places that depend on x."""
    pattern, varying = places_of(indices, D)
    order = elimination_order(pattern, D)
    return order, filled(pattern, order), varying


class Step:
    """The operations of a step of fields with terms v x_j x_k of f_i at `indices` (3, T): i, j, k.

    h, N and A = 1 - N are as in the head of this file. Values 0 to D - 1 are the state x, and the
    next T are h v of the terms. If elimination needs too many products, there are no operations.
    Then loops compute all steps (`maps.dense`), or SuperLU for large sparse fields
    (`maps.superlu`).

    fixed       operations on parameters alone
    table       the values of parameters alone that other operations need
    usual       operations for all states
    rare        operations for states where `good` is false
    after       the next state
    after_rare  the next state after the operations `rare`; the same if `after` keeps its digits
    good        true if `after` is accurate and all pivots are positive
    accurate    true if `after_rare` is accurate
    negative    true if the number of negative pivots is odd, det A(x) < 0
    changed     true if a component that keeps its sign along the motion changes it in the step;
                None if no component keeps its sign. These three are computed by `rare`
    factors     `Factors` of A(x)
    is_long     true if there are many operations, which LLVM does not optimise
    is_sparse   true if elimination fills little of the matrix
    of_one_sign   components that keep their signs along the motion
    """

    good = accurate = negative = changed = factors = None  # None if there are no operations
    of = None  # the function of a map; None for a field

    def __init__(self, indices, D):
        self._begin(indices, D)
        order, fill, varying = _plan_of(indices, D)
        work, of_state = work_of(order, fill, varying)
        of_state += int((indices[2] < D).sum())
        self.is_sparse = work < PART_OF_DENSE * D**3
        most = MOST_OF_SPARSE if self.is_sparse else MOST_OF_DENSE
        if work - of_state > MOST_OF_PARAMETERS or of_state > most:
            return
        self._add_tests(self._increments(indices, D, range(D, D + self.T), order, fill))
        self._separate_fixed()

    def _begin(self, indices, D):
        self.indices, self.T = indices, indices.shape[1]
        self.D = self.state_D = D  # numbers of components: with columns of derivatives, and of x
        self.of_one_sign = of_one_sign(indices)
        self.values = Values(D + self.T, range(D, D + self.T))
        self.fixed, self.table, self.usual, self.rare = [], [], [], []
        self.after, self.after_rare = [*range(D)], [*range(D)]
        self.places = {}

    def _increments(self, indices, D, halves, order, fill):
        """Add the operations of elimination and of x_next = x + 2 delta; return {k: delta_k}.

        Components in which delta is always 0 are missing. `halves` are the numbers of the values
        h v; `order` and `fill` are from `_plan_of`.
        """
        right = {}
        self.matrix = Matrix(indices, D, self.values, range(D), halves)
        self.factors = Factors(self.matrix, order, fill, right)
        for k in reversed(order):
            right[k] = self.factors.backward(k, right)
        increments = {k: half for k, half in sorted(right.items()) if half is not None}
        for k, half in increments.items():
            self.after[k] = self.values.total(k, [(2.0, half)])
        return increments

    @cached_property
    def key(self):
        """A key that identifies the operations of this step."""
        return type(self), self.indices.tobytes(), self.D

    @cached_property
    def extended(self):
        """The `ExtendedStep`, with derivatives; it has no operations if it is too long."""
        return ExtendedStep(self.indices, self.D)

    length = cached_property(lambda self: length_of(self.usual))
    is_long = property(lambda self: self.length > MOST_OPTIMISED)

    def _add_tests(self, increments):
        """Add the operations `rare`, for steps that are not `good`, and the tests of steps.

        A step is `good` or `accurate` if increments do not cancel x and pivots are not small.
        `good` asks for more than `accurate`, but takes fewer operations.
        """
        number = self.values.number
        after = {k: number(self.after[k]) for k in {*increments, *self.of_one_sign}}
        sizes = {k: abs(after[k]) for k in increments}
        parts = {k: abs(number(half)) for k, half in increments.items()}
        limits = {k: SMALL_BESIDE_INCREMENT * part for k, part in parts.items()}
        common = [sizes[k] >= limits[k] for k in increments]
        tests = [*common, self.factors.is_good()]
        tested = sorted(self.of_one_sign)
        tests += [(number(k) < 0.0) ^ (after[k] >= 0.0) for k in tested]
        if increments:
            size, part = (joined("fadd", each.values()) for each in (sizes, parts))
            tests.append(size < np.inf)
            if len(increments) == self.D:
                tests.append(size > LARGE_BESIDE_INCREMENT * part)
        self.good = joined("and", tests).number
        first_rare, tests = len(self.values.operations), []
        self.after_rare = [*self.after]
        if increments:
            beyond = [sizes[k] - LARGE_BESIDE_INCREMENT * parts[k] for k in increments]
            excess = joined("fadd", [larger(0.0, each) for each in beyond])  # NaN stays NaN
            common.append(excess < np.inf)
            if len(increments) == self.D:  # a component that stays 0 is accurate: size = limit = 0
                at_limit = [sizes[k].equals(limits[k]) for k in increments]
                common.append(joined("or", [excess > 0.0, *at_limit]))
            keeps, following = joined("and", common), self._following()
            for k in increments:
                self.after_rare[k] = keeps.select(after[k], number(following[k])).number
            tests.append(joined("fadd", [abs(number(following[k])) for k in increments]) < np.inf)
        self.accurate = joined("and", [*tests, self.factors.is_accurate()]).number
        negative = [number(pivot) < 0.0 for pivot in self.factors.pivot.values()]
        self.negative = joined("xor", negative or [number(1.0) < 0.0]).number
        changes = []
        for k in tested:
            x, following = number(k), number(self.after_rare[k])
            changes.append((x < 0.0) & (following > LEAST_WITH_SIGN))
            changes.append((x > 0.0) & (following < -LEAST_WITH_SIGN))
        self.changed = joined("or", changes).number if changes else None
        self.rare = self.values.operations[first_rare:]

    def _following(self):
        """Return {k: x_next_k} by a system for x_next itself, where x + 2 delta would cancel."""
        values, matrix, right = self.values, self.matrix, {}
        for k in self.factors.order:
            right[k] = self.factors.forward(k, values.total(k, matrix.linear_part(k)), right)
        for k in reversed(self.factors.order):
            right[k] = self.factors.backward(k, right)
        return right

    def _separate_fixed(self):
        """Move operations on parameters alone to `fixed`; list their values in use in `table`."""
        fixed = self.values.fixed
        table = {}
        rare = {number for _, number, _ in self.rare}
        self.fixed = [operation for operation in self.values.operations if operation[1] in fixed]
        others = [operation for operation in self.values.operations if operation[1] not in fixed]
        for _, _, operands in others:
            table |= dict.fromkeys(a for a in operands if type(a) is int and a in fixed)
        table |= dict.fromkeys(a for a in (*self.after, *self.after_rare) if a in fixed)
        self.table = [*table]
        self.places = {number: place for place, number in enumerate(self.table)}
        self.usual = [operation for operation in others if operation[1] not in rare]
        self.rare = [operation for operation in others if operation[1] in rare]

    def table_of(self, halves):
        """Return the values (n, ...) of parameters alone that steps read; `halves`: eps v / 2."""
        values = dict(enumerate(halves, self.D))
        with np.errstate(all="ignore"):  # a pivot of parameters alone may be 0
            evaluate(self.fixed, values)
        table = np.empty((len(self.table), *np.shape(halves)[1:]))
        for k, number in enumerate(self.table):
            table[k] = values[number]
        return table


class ExtendedStep(Step):
    """The operations of a step of x, of D columns q of derivatives, and of their lengths.

    Kahan's method is a Runge-Kutta method, so that the derivative of its map is its map of the
    variational equations x' = f(x), q' = f'(x) q. With N(x) = (eps / 2) f'(x), all columns share
    the elimination of x: q_next = (1 - N(x))**-1 (1 + N(x_next)) q. Columns are orthonormalised in
    each step, by Gram and Schmidt, and the logarithms of their lengths are added to D more values.
    """

    def __init__(self, indices, D):
        size = D * (2 + D)
        self._begin(indices, size)
        order, fill, varying = _plan_of(indices, D)
        self.state_D = D
        halves = range(size, size + self.T)
        if D > COMPONENTS_WITH_COLUMNS or work_of(order, fill, varying)[0] * D > WORK_WITH_COLUMNS:
            return
        increments = self._increments(indices, D, halves, order, fill)
        columns = self._columns(Matrix(indices, D, self.values, self.after[:D], halves), D)
        columns = self._orthonormal(columns, D)
        self.after[D : D * (1 + D)] = [a.number for q in columns for a in q]
        self.D = D
        self._add_tests(increments)
        self.D = size
        self.after_rare[D:] = self.after[D:]
        self._separate_fixed()

    def _columns(self, back, D):
        """Return (1 - N(x))**-1 (1 + N(x_next)) q for D columns q; N = h f'; `back`: N(x_next)."""
        values, step, columns = self.values, self.factors, []
        entries = {place: back.entry(*place)[0] for place in sorted(back.pattern)}
        for c in range(D):
            q = range(D * (1 + c), D * (2 + c))
            v = {}
            for k in step.order:
                products = [(a, q[j]) for (i, j), a in entries.items() if i == k]
                v[k] = values.total(q[k], products)
                v[k] = values.total(v[k], [(step.lower[k, i], v[i]) for i in step.before[k]])
            for k in reversed(step.order):
                v[k] = values.total(v[k], [(step.upper[k, j], v[j]) for j in step.after[k]])
                if k in step.inverse:
                    v[k] = values.emit("fmul", step.inverse[k], v[k])
            columns.append([values.number(v[k]) for k in range(D)])
        return columns

    def _orthonormal(self, columns, D):
        """Return the columns orthonormalised; add logarithms of lengths to the sums in `after`."""
        units, first = [], D * (1 + D)
        for c, q in enumerate(columns):
            for p in units:
                part = joined("fadd", [a * b for a, b in zip(p, q, strict=True)])
                q = [b - part * a for a, b in zip(p, q, strict=True)]
            length = joined("fadd", [a * a for a in q]).sqrt()
            inverse = length.equals(0.0).select(0.0, 1.0 / length)
            units.append([inverse * a for a in q])
            self.after[first + c] = (self.values.number(first + c) + length.then("log")).number
        return units
