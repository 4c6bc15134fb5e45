"""Forces that hold constraints: where a solution slides along a surface, or a body rests on it.

A constraint fixes the rate n . x' of a surface with the gradient n, by a force along a direction d.
Without forces the rates x' are y. With the forces of all constraints that hold they become

x' = y + sum_a w_a d_a,     n_a . (x' - y) = r_a for each constraint a,

where r_a is the change of the rate n_a . x' that is needed, -n_a . y for a rate 0. The factors w
solve the linear equations sum_b (n_a . d_b) w_b = r_a.
"""

from functools import reduce
from typing import NamedTuple

from ..expressions.derivative import gradients
from ..expressions.function_records import same
from ..expressions.programs import Expressions, dot, emitted, needed_for, program_of
from ..expressions.rounding import moved_by_projection, sizes_of, with_phases
from ..expressions.values import Number, operand_of


class Constraint(NamedTuple):
    """A constraint, by values of a program."""

    holds: Number  # the truth value that the constraint holds
    gradient: dict  # {component: operand} of n, the gradient of the surface
    direction: list  # operands (D) of d, the direction of its force


class ExtendedState(Expressions):
    """`Expressions` of D components, then of `modes` further components, then of P parameters."""

    rows = moved = {}  # noqa: RUF012  (never changed)

    def __init__(self, D, modes, P):
        first = D + modes
        super().__init__(first + P, range(first, first + P))
        self.D, self.modes, self.parameters = D, range(D, first), range(first, first + P)
        self.inputs = {i: i for i in range(D)} | dict(enumerate(self.parameters, D))
        self.true = self.number(0.0).equals(0.0)

    def slopes(self, results):
        """Return the gradient {component: operand} of each operand in `results`."""
        return gradients(self, needed_for(self.operations, results), results, self.D)

    def project(self, invariants, constraints):
        """Set `rows`, and `moved_by_projection`, for operands of invariants; constraints are first.

        rows   {number of a constraint: its gradient}
        """
        rows = self.slopes(invariants)
        self.rows = dict(enumerate(rows[:constraints]))
        self.moved = moved_by_projection(self, rows)

    def tangent(self, v):
        """Return v (D operands) without its parts along the gradients of constraints."""
        if not self.rows:
            return v
        v, rows = dict(enumerate(v)), self.rows
        products = {(a, b): self.dot(rows[a], _filled(rows[b], self.D)) for a in rows for b in rows}
        matrix = {place: a for place, a in products.items() if not same(a.number, 0.0)}
        parts = _solved(matrix, {a: self.dot(row, [*v.values()]) for a, row in rows.items()})
        for a, row in rows.items():
            for i, slope in row.items():
                v[i] = (self.number(v[i]) - parts[a] * self.number(slope)).number
        return [*v.values()]

    def difference(self, a, b):
        """Return the operand of a - b; the constant 0 if both operands are the same."""
        if same(b, 0.0):
            return a
        return 0.0 if same(a, b) else self.emit("fsub", a, b)

    def dot(self, row, f):
        """Return the `Number` of the scalar product of a gradient `row` and f (D)."""
        pairs = [(row[i], a) for i, a in enumerate(f) if i in row and not same(a, 0.0)]
        return self.number(dot(self.emit, pairs) if pairs else 0.0)

    def at(self, x, wanted, phases=False):
        """Return `Number`s: the operands `wanted` at the state x, and the sizes of their terms.

        With `phases`, sizes include rounding errors of the arguments of sin and cos.
        """
        wanted = [*map(operand_of, wanted)]
        copy = dict(enumerate(x)) | {p: p for p in self.parameters}
        program = program_of(self.operations, wanted)
        results = emitted(self, program, copy)
        sizes = sizes_of(self, program.operations, copy)
        if phases:
            sizes = with_phases(self, program.operations, copy, sizes)
        sizes = [self.number(abs(a)) if isinstance(a, float) else sizes[a] for a in wanted]
        return [*map(self.number, results)], sizes

    def with_forces(self, y, constraints, changes):
        """Return the rates y (D) with forces, the factors {mode: w_a}, and the matrix of n_a . d_b.

        Letters are as in the head of this file: `constraints` is {mode: `Constraint` with n_a and
        d_a}, and `changes` is {mode: r_a}.
        """
        number, matrix, right, y = self.number, {}, {}, [*y]
        for a, (holds, gradient, _) in constraints.items():
            right[a] = holds.select(changes[a], 0.0)
            for b, other in constraints.items():
                product = self.dot(gradient, other.direction)
                if a == b:
                    # A force of size 0 has the factor r_a; one that moves other surfaces has not.
                    moves = [self.dot(c.gradient, other.direction) for c in constraints.values()]
                    moves = [c for c in moves if not same(c.number, 0.0)]
                    is_0 = [c.equals(0.0) for c in moves or [product]]
                    is_0 = reduce(Number.__and__, is_0)
                    matrix[a, a] = (holds & ~is_0).select(product, 1.0)
                elif not same(product.number, 0.0):
                    matrix[a, b] = (holds & other.holds).select(product, 0.0)
        factors = _solved(matrix, right)
        for a, (holds, _, direction) in constraints.items():
            for i, d in enumerate(direction):
                if not same(d, 0.0):
                    y[i] = (number(y[i]) + holds.select(factors[a] * number(d), 0.0)).number
        return y, factors, matrix


def _filled(row, D):
    return [row.get(i, 0.0) for i in range(D)]


def _solved(matrix, right):
    """Return the solution {a: `Number`} of linear equations {(a, b): entry} and {a: right side}."""
    if not right:
        return {}
    (a, of_a), *others = right.items()
    matrix, right = dict(matrix), dict(others)
    for b in right:  # elimination without exchanges; entries that are 0 are missing
        if (b, a) in matrix:
            factor = matrix[b, a] / matrix[a, a]
            right[b] = right[b] - factor * of_a
            for c in right:
                if (a, c) in matrix:
                    matrix[b, c] = matrix.get((b, c), 0.0) - factor * matrix[a, c]
    solution = _solved(matrix, right)
    for b in right:
        if (a, b) in matrix:
            of_a = of_a - matrix[a, b] * solution[b]
    return solution | {a: of_a / matrix[a, a]}
