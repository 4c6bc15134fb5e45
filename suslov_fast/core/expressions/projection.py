"""The projection of a state onto given values c of invariants I(x): Newton steps, as formulas.

With J = I'(x), and W = diag(w_j**2) with the allowed errors w_j of the components, a step is

x <- x - W J^T (J W J^T)**-1 (I(x) - c).

Constraints of mechanics come first: a step moves coordinates q alone to g(q) = 0, and a step moves
velocities v alone to phi(q, v) = 0. If there are first integrals, a step with all invariants
follows. An integral that depends on the invariants before it, up to rounding, is left out: its
pivot is ZERO_PIVOT of its diagonal entry or less. So is an I - c that may be rounding, as it is at
most ROUNDING_OF_INTEGRALS of the moduli of I_j x_j, if the allowed errors change I by less. This
last step is left out if it is longer than MOST_MOVE_TO_LEVELS allowed errors, or changes a sign
that f keeps, as near states where J loses rank. Then `left_out_of` tells if I - c is larger than
the change of I by the allowed errors. Functions that are not proved to be first integrals are
tested along f, too (`changes_of`).

Constraints must be independent along the motion: the matrix A = phi_v must keep its rank. Let A_0
and A_1 be A at the ends of a step, and c_a and p_a the pivots of A_0 A_1^T and A_1 A_1^T. If the
step passes a state where A loses rank, a pivot c_a has the wrong sign. If it ends near such a
state, c_a / p_a - 1 is about its length over the distance that is left.
"""

import functools
import operator
from typing import Any, NamedTuple

from .programs import Expressions, dot, emitted, program_of
from .rounding import sizes_in
from .symbolic_elimination import elimination_order
from .tolerances import (
    CANCELLED_BY_PROJECTION,
    CHANGE_OF_INTEGRALS,
    FALL_OF_RANK,
    LEAST_WEIGHT,
    MOST_MOVE_TO_LEVELS,
    NEAR_LOSS_OF_RANK,
    OFF_CONSTRAINTS,
    PART_OF_CHANGE,
    ROUNDING_OF_CHANGES,
    ROUNDING_OF_INTEGRALS,
    ROUNDING_OF_PIVOTS,
    ROUNDING_OF_RESIDUALS,
    ZERO_PIVOT,
)
from .values import joined, larger, smaller


class Invariants(NamedTuple):
    """The invariants of equations: constraints phi, then g of holonomic ones, then first integrals.

    operands     their values
    constraints  how many of them are constraints
    positions    how many components, the first ones, are coordinates
    tested       numbers of the first integrals that are not proved, which steps test
    """

    operands: Any = ()
    constraints: int = 0
    positions: int = 0
    tested: tuple[int, ...] = ()


NOTHING = Invariants()


class _Formulas:
    """Formulas of a program that reads `inputs` numbers and f's table; `slopes` are rows of J."""

    def __init__(self, f, inputs, with_steady=False):
        self.f, self.values = f, Expressions(inputs + len(f.table))
        self.table = {a: inputs + place for a, place in f.places.items()}
        self.slopes = [{} for _ in range(f.invariants_count)]
        for (a, j), slope in zip(
            f.invariants_places, f.invariants.results[f.invariants_count :], strict=True
        ):
            if with_steady or j not in f.steady:
                self.slopes[a][j] = slope

    def halves(self):
        """Return (rows, components): constraints g and coordinates, then phi and velocities."""
        q = range(self.f.positions)
        v = {*range(self.f.positions, self.f.D)}.difference(self.f.clocks)
        rows = range(self.f.constraints_count)
        phi = [a for a in rows if any(j in v for j in self.slopes[a])]
        return ([a for a in rows if a not in phi], q), (phi, v)

    def at(self, x, rows, moving):
        """Return values of invariants at x, and their slopes {j: operand} by some components."""
        places = [(k, j) for k, a in enumerate(rows) for j in self.slopes[a] if j in moving]
        results = [self.f.invariants.results[a] for a in rows]
        results += [self.slopes[rows[k]][j] for k, j in places]
        program = program_of(self.f.invariants.operations, results)
        found = emitted(self.values, program, dict(enumerate(x)) | self.table)
        J = [{} for _ in rows]
        for (k, j), slope in zip(places, found[len(rows) :], strict=True):
            J[k][j] = slope
        return found[: len(rows)], J

    def weights(self, moving):
        """Return {j: w_j} for the components `moving`, at least LEAST_WEIGHT of the largest."""
        w = {j: self.values.number(self.f.D + j) for j in sorted(moving)}
        least = LEAST_WEIGHT * joined("max", w.values()) if w else None
        return {j: larger(a, least) for j, a in w.items()}

    def moves(self, r, J, w, noise=()):
        """Return {j: the move of component j in units of w[j]} for I - c = r, and their square.

        All are `Number`s. The square is the sum of their squares, r . mu. `noise` has what may be
        rounding in the last of r.
        """
        emit = self.values.emit
        scaled = [{j: emit("fmul", slope, w[j]) for j, slope in row.items()} for row in J]
        elimination = _Elimination(self.values, scaled, scaled)
        noise = dict(enumerate(noise, len(J) - len(noise)))
        mu, moves = elimination.solution(r, noise), {}
        for j in sorted({j for row in J for j in row}):
            pairs = [(row[j], mu[a]) for a, row in enumerate(scaled) if j in row]
            moves[j] = self.values.number(dot(emit, pairs))
        square = dot(emit, zip(r, mu, strict=True)) if r else 0.0
        return moves, self.values.number(square)


class _Elimination:
    """The elimination in G = A B^T, for rows A and B {j: operand} with the same places.

    pivots, diagonal  operands, in the order of elimination
    """

    def __init__(self, values, A, B):
        self.values, emit, k = values, values.emit, len(A)
        self.is_symmetric, self.G = A is B, [{} for _ in A]
        for a in range(k):
            for b in range(a if A is B else 0, k):
                common = [(A[a][j], B[b][j]) for j in A[a] if j in B[b]]
                if common or a == b:
                    self.G[a][b] = dot(emit, common) if common else 0.0
                    if A is B:
                        self.G[b][a] = self.G[a][b]
        self.order = elimination_order([(a, b) for a, row in enumerate(self.G) for b in row], k)
        self.diagonal = [self.G[a][a] for a in self.order]
        self.pivots, self.steps = [], []
        for n, a in enumerate(self.order):
            self.pivots.append(self.G[a][a])
            if n < k - 1 or A is B:
                self._eliminate(n, a)

    def _eliminate(self, n, a):
        """Subtract multiples of row a from the rows that follow it in the order."""
        G, emit, number = self.G, self.values.emit, self.values.number
        pivot, least = number(G[a][a]), number(self.diagonal[n]) * ZERO_PIVOT
        inverse = (pivot > least).select(1.0 / pivot, 0.0).number
        later = [b for b in self.order[n + 1 :] if b in G[a]]
        factors = [emit("fmul", G[b][a], inverse) for b in later]
        for m, (b, factor) in enumerate(zip(later, factors, strict=True)):
            for c in later[m:] if self.is_symmetric else later:
                G[b][c] = emit("fsub", G[b].get(c, 0.0), emit("fmul", factor, G[a][c]))
                if self.is_symmetric:
                    G[c][b] = G[b][c]
        self.steps.append((a, inverse, [*zip(later, factors, strict=True)]))

    def solution(self, r, noise):
        """Return the solution mu of G mu = r for a symmetric G; 0 where the pivot is ZERO_PIVOT.

        An entry of r up to `noise` {row: `Number`} counts as 0, if the pivot is below its square.
        """
        emit, r, mu = self.values.emit, [*r], [None] * len(r)
        for pivot, (a, _, later) in zip(self.pivots, self.steps, strict=True):
            if a in noise:
                own = self.values.number(r[a])
                counts = (self.values.number(pivot) > noise[a] * noise[a]) | (abs(own) > noise[a])
                r[a] = counts.select(own, 0.0).number
            for b, factor in later:
                r[b] = emit("fsub", r[b], emit("fmul", factor, r[a]))
        for a, inverse, later in reversed(self.steps):
            known = dot(emit, [(self.G[a][b], mu[b]) for b, _ in later])
            rest = r[a] if known is None else emit("fsub", r[a], known)
            mu[a] = emit("fmul", rest, inverse)
        return mu


def projection_of(f):
    """Return the `Program` that projects x, and reads x, w (D each), c, and f's table.

    If there are first integrals, x is followed by 1 if I - c of any was larger than the change of I
    by the allowed errors w, else 0; then by I - c of the integrals `f.tested`.
    """
    D, k = f.D, f.invariants_count
    formulas, x = _Formulas(f, 2 * D + k), [*range(D)]
    number, allowed = formulas.values.number, range(D, 2 * D)
    for rows, moving in formulas.halves():
        r, J = formulas.at(x, rows, moving)
        w = formulas.weights({j for row in J for j in row})
        parts, _ = formulas.moves(r, J, {j: a.number for j, a in w.items()})
        for j, part in parts.items():
            new = number(x[j]) - part * w[j]
            x[j] = (abs(new) > CANCELLED_BY_PROJECTION * abs(number(x[j]))).select(new, 0.0).number
    if k > f.constraints_count:
        values, J = formulas.at(x, range(k), range(D))
        r = [formulas.values.emit("fsub", a, 2 * D + n) for n, a in enumerate(values)]
        emit, integrals = formulas.values.emit, range(f.constraints_count, k)
        noise = [_terms(formulas.values, J[a], x) * ROUNDING_OF_INTEGRALS for a in integrals]
        parts, square = formulas.moves(r, J, allowed, noise)
        is_right, new = square <= MOST_MOVE_TO_LEVELS * MOST_MOVE_TO_LEVELS, {}
        for j, part in parts.items():
            new[j] = number(x[j]) - part * number(allowed[j])
            if j in f.of_one_sign:
                is_right = is_right & (new[j] * number(x[j]) >= 0.0)
        for j, a in new.items():
            x[j] = is_right.select(a, number(x[j])).number
        is_far = []
        for a in integrals:
            changes = [emit("fmul", slope, allowed[j]) for j, slope in J[a].items()]
            square = dot(emit, zip(changes, changes, strict=True), 0.0)
            is_far.append(number(r[a]) * number(r[a]) > number(square))
        x += [_any(is_far), *(r[integrals[a]] for a in f.tested)]
    return program_of(formulas.values.operations, x)


def _terms(values, row, x):
    """Return the sum of moduli of the products of entries {j: operand} and operands x[j]."""
    terms = [abs(values.number(a) * values.number(x[j])) for j, a in row.items()]
    return joined("fadd", terms or [values.number(0.0)])


def _any(truths):
    """Return the operand of a number: 1 if any of these truth values is true, else 0."""
    return functools.reduce(operator.or_, truths).select(1.0, 0.0).number


def left_out_of(f):
    """Return the `Program` that tests if the projection to x has left out an integral.

    Inputs are those of the projection. The result is 1 if I - c is larger than rounding and the
    change of I by the allowed errors w, with the gradients at x, and at x + w and x - w; else 0.
    """
    D, rows = f.D, range(f.constraints_count, f.invariants_count)
    formulas = _Formulas(f, 2 * D + f.invariants_count)
    number, emit, x = formulas.values.number, formulas.values.emit, range(D)
    values, J = formulas.at(x, rows, x)
    size = sizes_in(formulas.values)
    beside = [
        formulas.at([j if j in f.steady else emit(name, j, D + j) for j in x], rows, x)[1]
        for name in ("fadd", "fsub")
    ]

    def change(row):
        changes = [abs(number(a)) * number(D + j) for j, a in row.items()]
        return joined("fadd", changes or [number(0.0)])

    is_far = []
    for k, (row, a) in enumerate(zip(rows, values, strict=True)):
        own, *others = (change(each[k]) for each in (J, *beside))
        allowed = larger(0.5 * joined("fadd", others), own) + ROUNDING_OF_CHANGES * size(a)
        is_far.append(abs(number(a) - number(2 * D + row)) > allowed)
    return program_of(formulas.values.operations, [_any(is_far)])


def change_along(emit, row, rates):
    """Return dI/dt along `rates`, and the moduli of its terms; `row` {j: operand} is I'(x)."""
    terms = [emit("fmul", a, rates[j]) for j, a in row.items()]
    moduli = [emit("fabs", a) for a in terms]
    return tuple(dot(emit, [(1.0, a) for a in each], 0.0) for each in (terms, moduli))


def changes_of(f):
    """Return the `Program` that tests if integrals change along f in a step from x.

    It reads x, the length h of the step, I - c at its end for the integrals `f.tested`, and f's
    table. Its result is 1 + the number of the first of these integrals that changes, else 0.
    """
    D, x, count = f.D, range(f.D), len(f.tested)
    formulas = _Formulas(f, D + 1 + count, with_steady=True)
    values, number = formulas.values, formulas.values.number
    rates = emitted(values, f.rates, dict(enumerate(x)) | formulas.table)
    integrals, J = formulas.at(x, [f.constraints_count + k for k in f.tested], x)
    changes = [change_along(values.emit, row, rates) for row in J]
    size, found = sizes_in(values), number(0.0)
    for n in reversed(range(count)):
        (change, terms), of_step = changes[n], abs(number(D + 1 + n))
        rate = abs(number(change))
        changes_now = (rate > CHANGE_OF_INTEGRALS * number(terms)) & (
            rate > ROUNDING_OF_CHANGES * size(change)
        )
        changes_now = changes_now & (of_step > PART_OF_CHANGE * abs(number(change) * number(D)))
        changes_now = changes_now & (of_step > ROUNDING_OF_CHANGES * size(integrals[n]))
        found = changes_now.select(1.0 + f.tested[n], found)
    return program_of(values.operations, [found.number])


def regular_of(f):
    """Return the `Program` that reads x, w (D each), c, the state x_0 before x, and f's table.

    Its result is 1 if constraints are independent from x_0 to x, see above. Otherwise it is -1 if
    the coordinates that A reads differ by less than the allowed errors, else 0.
    """
    D, before = f.D, 2 * f.D + f.invariants_count
    formulas, before = _Formulas(f, before + D), range(before, before + D)
    number, (_, (rows, moving)) = formulas.values.number, formulas.halves()
    A_0, A = (formulas.at(x, rows, moving)[1] for x in (before, range(D)))
    between, at_end = (_Elimination(formulas.values, each, A) for each in (A_0, A))
    read = {j for row in rows for j in formulas.slopes[row] if j < f.positions}
    w = formulas.weights(read or range(f.positions))
    steps = [abs(number(j) - number(before[j])) / a for j, a in w.items()]
    length = joined("max", [larger(each, 0.0) for each in steps])  # 0 for 0 / 0
    fall = smaller(length / NEAR_LOSS_OF_RANK, FALL_OF_RANK)
    is_regular = number(0.0).equals(0.0)
    for c, p, entry in zip(between.pivots, at_end.pivots, at_end.diagonal, strict=True):
        c, p = number(c), number(p)
        is_regular = is_regular & (c > 0.0)
        is_regular = is_regular & (c - p <= fall * p + ROUNDING_OF_PIVOTS * number(entry))
    found = is_regular.select(1.0, (length < 1.0).select(-1.0, 0.0))
    return program_of(formulas.values.operations, [found.number])


def test_of_start(f):
    """Return the `Program` that reads x and f's table, and tests a start on constraints.

    Its results are 1 if x is on the constraints, else 0; 1 if they are independent there, else 0;
    and the largest modulus of a residual.
    """
    formulas = _Formulas(f, f.D)
    number, rows, x = formulas.values.number, range(f.constraints_count), range(f.D)
    residuals, slopes = formulas.at(x, rows, x)
    residuals = [abs(number(a)) for a in residuals]
    sizes = [_terms(formulas.values, row, x) for row in slopes]
    largest, is_true = joined("max", sizes), number(0.0).equals(0.0)
    is_on, is_regular = is_true, is_true
    for residual, size in zip(residuals, sizes, strict=True):
        most = larger(OFF_CONSTRAINTS * size, ROUNDING_OF_RESIDUALS * largest)
        is_on = is_on & (residual <= most)
    phi, v = formulas.halves()[1]
    A = [{j: a for j, a in slopes[row].items() if j in v} for row in phi]
    elimination = _Elimination(formulas.values, A, A)
    for pivot, entry in zip(elimination.pivots, elimination.diagonal, strict=True):
        is_regular = is_regular & (number(pivot) > ZERO_PIVOT * number(entry))
    tests = [each.select(1.0, 0.0).number for each in (is_on, is_regular)]
    return program_of(formulas.values.operations, [*tests, joined("max", residuals).number])
