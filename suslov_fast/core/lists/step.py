"""A step of a field as a list of operations on numbers, planned from its pattern of zeros.

With h = eps / 2 and N(x) = h f'(x) a step solves (1 - N) delta = h f(x), x_next = x + 2 delta
(theory, section 7). Where an increment cancels a component, digits are kept by the same matrix and

(1 - N) x_next = x + h l x + 2 h c,

with the linear and constant parts l and c of f. Elimination is planned once, because the terms of
the field alone decide which entries of N are 0. For pivots k, in an order with little fill-in,

pivot_k = 1 - N_kk,   m_ik = N_ik / pivot_k,   N_ij += m_ik N_kj,   g_i += m_ik g_k,

for i and j that come later, where g = h f(x) at first; then, backwards,

delta_k = (g_k + sum_j N_kj delta_j) / pivot_k.

The derivative is (1 - N(x))**-1 (1 - M(x_next)) with M(x) = -h f'(x). These sums of products, and
the tests that they keep their digits, are the same for all states. They form a list of operations
(instruction, number, operands), each of which computes the value with this number. `stage_code`
makes machine code of a list; `evaluate` carries it out in NumPy, with the same bits. A run computes
only once what depends on parameters alone. A step of the Lorenz system takes 81 operations with its
tests, two of them divisions; sums of products count as products and additions there.
"""

import functools
import math
from itertools import chain

import numpy as np

from . import sizes
from .far import PARTS
from .functions import ELEMENTARY
from .numbers import Number, joined, larger
from .planned_elimination import (
    Factors,
    Given,
    Matrix,
    elimination_order,
    filled,
    places_of,
    work_of,
)
from .sparse import Sparse

# A state has lost digits if one component falls below SMALL_PART of half its increment, or if all
# components fall below LARGE_PART of theirs.
SMALL_PART, LARGE_PART = 2.0**-10, 2.0**-4
SIGNIFICANT = 2.0**-1000  # rounding may change the signs of smaller components
AT_MOST = 8  # factors of abs(det DPhi) near 1, after which their product may be far from 1


def _of_library(function):
    """Return a function of Python's `math`, that is of the C library, for arrays of numbers."""

    def of_number(*numbers):
        try:
            return function(*numbers)
        except ValueError:
            is_infinite = function is math.atanh and abs(numbers[0]) == 1.0
            return math.copysign(math.inf, numbers[0]) if is_infinite else math.nan

    def of_arrays(*arrays):
        columns = np.broadcast_arrays(*arrays)
        rows = zip(*(column.ravel().tolist() for column in columns), strict=True)
        values = [of_number(*row) for row in rows]
        return np.array(values, np.float64).reshape(columns[0].shape)

    return of_arrays


def _of_bits(function):
    """Return a function of the bits of doubles, which are integers without sign."""

    def of_arrays(*arrays):
        integers = (np.atleast_1d(np.asarray(array, float)).view(np.uint64) for array in arrays)
        values = function(*integers).view(float)
        return values.reshape(np.broadcast_shapes(*map(np.shape, arrays)))

    return of_arrays


def _sum(*operands):
    """Return the sum of a start, if there is one, and of products of pairs, in this order."""
    odd = len(operands) % 2
    products = (a * b for a, b in zip(operands[odd::2], operands[odd + 1 :: 2], strict=True))
    return sum(products, operands[0] if odd else next(products))


def _of_list(name):
    """Return an elementary function of arrays, which carries out its list."""

    def of_arrays(*arrays):
        operations, result = list_of(name)
        values = dict(enumerate(arrays))
        with np.errstate(all="ignore"):
            evaluate(operations, values)
        return values[result]

    return of_arrays


# Functions of the C library, by their names there, which a lane calls alone.
_NAMES = "asin acos atan asinh acosh atanh atan2 erf".split()
OF_LIBRARY = {name: _of_library(getattr(math, name)) for name in _NAMES}
# Integer instructions, whose names in LLVM follow "bits_".
OF_BITS = {
    "bits_and": _of_bits(np.bitwise_and),
    "bits_or": _of_bits(np.bitwise_or),
    "bits_xor": _of_bits(np.bitwise_xor),
    "bits_add": _of_bits(np.add),
    "bits_sub": _of_bits(np.subtract),
    "bits_shl": _of_bits(np.left_shift),
    "bits_lshr": _of_bits(np.right_shift),
}
OF_LISTS = {name: _of_list(name) for name in ELEMENTARY}
# Instructions by their names in LLVM. "max" and "min" are a comparison and a `select` there: the
# second operand where one of them is NaN.
OF_NUMBERS = {
    "fadd": np.add,
    "fsub": np.subtract,
    "fmul": np.multiply,
    "fdiv": np.divide,
    "sum": _sum,
    "fabs": np.absolute,
    "sqrt": np.sqrt,
    "floor": np.floor,
    "copysign": np.copysign,
    "select": np.where,
    "max": lambda a, b: np.where(a > b, a, b),
    "min": lambda a, b: np.where(a < b, a, b),
    **OF_BITS,
    **PARTS,
    **OF_LISTS,
    **OF_LIBRARY,
}
OF_TRUTH_VALUES = {
    "olt": np.less,
    "ogt": np.greater,
    "oge": np.greater_equal,
    "oeq": np.equal,
    "and": np.logical_and,
    "or": np.logical_or,
    "xor": np.logical_xor,
}


class _Functions(dict):
    def __missing__(self, instruction):
        return instruction  # a `Table`


FUNCTIONS = _Functions(OF_NUMBERS | OF_TRUTH_VALUES)


def evaluate(operations, values):
    """Carry out operations on numbers or arrays; add their results to the dict `values`."""
    for instruction, number, operands in operations:
        numbers = (a if isinstance(a, float) else values[a] for a in operands)
        values[number] = FUNCTIONS[instruction](*numbers)


def length_of(operations):
    """Return the number of instructions of straight-line code, in which sums are several."""
    return sum(len(of) - 1 if instruction == "sum" else 1 for instruction, _, of in operations)


class Values:
    """Values by number, in the order in which they are computed, and the operations that do so.

    The first `count` values need no operation. Operands are numbers of values, which are integers,
    and constants, which are floats. `fixed` has the numbers of values that depend on parameters
    alone.
    """

    def __init__(self, count, fixed):
        self.count, self.fixed, self.operations = count, set(fixed), []

    def emit(self, instruction, *operands):
        """Add an operation; return the number of its value."""
        number = self.count
        self.count += 1
        self.operations.append((instruction, number, operands))
        if instruction in OF_NUMBERS and all(map(self.is_fixed, operands)):
            self.fixed.add(number)
        return number

    def is_fixed(self, operand):
        """Return whether an operand depends on parameters alone."""
        return isinstance(operand, float) or operand in self.fixed

    def total(self, start, products):
        """Return the value start + sum of a c over the pairs (a, c), in this order.

        It is None if `start` is None and there are no pairs. Pairs of a "sum" are of one kind: the
        first factors depend on parameters alone, or none does; other products are values of fixed.
        """
        return self.total_of(start, [*chain.from_iterable(products)])

    def total_of(self, start, factors):
        """Return `total` of the pairs whose factors these are, one after the other."""
        own, kind = [] if start is None else [start], None
        if factors and self.fixed.isdisjoint(factors) and float not in map(type, factors):
            return self.emit("sum", *own, *factors)
        for a, c in zip(factors[::2], factors[1::2], strict=True):
            of_pair = self.is_fixed(a) + self.is_fixed(c)
            if len(own) > 1 and of_pair != kind:
                own = [self.emit("sum", *own)]
            if of_pair == 2:
                product = self.emit("fmul", a, c)
                own = [self.emit("fadd", *own, product) if own else product]
            else:
                own += (c, a) if self.is_fixed(c) else (a, c)
            kind = of_pair
        if len(own) > 1:
            return self.emit("sum", *own)
        return own[0] if own else None

    def number(self, operand):
        """Return the `Number` of an operand."""
        return Number(self.emit, operand)


def dot(emit, pairs, total=None):
    """Return the sum of a start and of products of pairs, each an operation; None without any."""
    for a, b in pairs:
        product = emit("fmul", a, b)
        total = product if total is None else emit("fadd", total, product)
    return total


@functools.cache
def list_of(name):
    """Return the operations of an elementary function on values 0, ..., and the number of f(x)."""
    function, count = ELEMENTARY[name]
    values = Values(count, ())
    return values.operations, function(*map(values.number, range(count))).number


def of_one_sign(indices):
    """Return the components i that each term of f_i contains, so that x_i keeps its sign."""
    i, j, k = indices
    return {*i.tolist()} - {*i[(i != j) & (i != k)].tolist()}


class Step:
    """The operations of a step of fields with terms at these indices (3, T).

    Values 0 to D - 1 are the state x, and the next T are h v of the terms. If elimination takes
    too many products, the lists are empty: then loops over arrays take it, between the lists of
    `by_columns`; or loops over its terms (`fields.dense`) take all steps of a dense field.

    fixed       operations on parameters alone
    table       the values of parameters alone that other operations need
    usual       operations for all states
    rare        operations for states where `good` is false
    after       the next state
    after_rare  the next state after the operations `rare`; the same where `after` keeps its digits
    good        true if `after` is accurate and all pivots are positive
    accurate    true if `after_rare` is accurate; a value of `rare`
    negative    true if the number of negative pivots is odd, det A(x) < 0; a value of `rare`
    changed     true if a component that keeps its sign along the motion does not; a value of
                `rare`, None if there is no such component or `keeps_signs` is false
    factors     `Factors` of 1 - N(x)
    is_long     true if loops carry out the operations, because there are many
    of_one_sign   components that keep their signs along the motion
    keeps_signs   true if the operations are a whole step, so that they test these signs
    """

    good = accurate = negative = changed = factors = by_columns = None  # without a plan

    def __init__(self, indices, D, carried=0, keeps_signs=False):
        values = self._begin(indices, D, carried, keeps_signs)
        pattern, varying = places_of(indices, D)
        order, right = elimination_order(pattern, D), {}
        fill = filled(pattern, order)
        work, of_state = work_of(order, fill, varying)
        of_state += int((indices[2] < D).sum())
        if work - of_state > sizes.LONGEST_ONCE or not self._has_list(work, of_state):
            if type(self) is Step and work < sizes.BY_COLUMNS * D**3:
                self.by_columns = StepByColumns(indices, D, keeps_signs, order, fill)
                self.fixed, self.table = self.by_columns.fixed, self.by_columns.table
            return
        matrix = self.matrix = Matrix(indices, D, values, range(D), range(D, D + self.T))
        self.factors = Factors(matrix, order, fill, right)
        for k in reversed(order):
            right[k] = self.factors.backward(k, right)
        halves = {k: half for k, half in sorted(right.items()) if half is not None}
        for k, half in halves.items():
            self.after[k] = values.total(k, [(2.0, half)])
        self._add_tests(halves)
        self._separate_fixed()

    def _has_list(self, work, of_state):
        """Return whether elimination is a list, by its products."""
        is_sparse = work < sizes.BY_COLUMNS * self.D**3
        most = max(sizes.OF_LATTICE, sizes.OF_CHAIN * self.D) if is_sparse else sizes.PRODUCTS
        return of_state <= most

    def _begin(self, indices, D, carried, keeps_signs):
        self.indices, self.D, self.T = indices, D, indices.shape[1]
        self.of_one_sign, self.keeps_signs = of_one_sign(indices), keeps_signs
        self.values = Values(D + self.T + carried, range(D, D + self.T))
        self.fixed, self.table, self.usual, self.rare = [], [], [], []
        self.after, self.after_rare, self.places = [*range(D)], [*range(D)], {}
        return self.values

    length = functools.cached_property(lambda self: length_of(self.usual))
    is_long = property(lambda self: self.length > sizes.CODE)

    def _add_tests(self, halves):
        """Add the tests that increments do not cancel the state, and that pivots are not small.

        `good` asks for more than `accurate`, because this takes fewer operations.
        """
        number = self.values.number
        after = {k: number(self.after[k]) for k in {*halves, *self.of_one_sign}}
        sizes = {k: abs(after[k]) for k in halves}
        parts = {k: abs(number(half)) for k, half in halves.items()}
        limits = {k: SMALL_PART * part for k, part in parts.items()}
        common = [sizes[k] >= limits[k] for k in halves]
        tests = [*common, *self._good_pivots()]
        tested = sorted(self.of_one_sign) if self.keeps_signs else []
        tests += [(number(k) < 0.0) ^ (after[k] >= 0.0) for k in tested]
        if halves:
            size, part = (joined("fadd", each.values()) for each in (sizes, parts))
            tests.append(size < np.inf)
            if len(halves) == self.D:
                tests.append(size > LARGE_PART * part)
        self.good = joined("and", tests).number
        first_rare, tests = len(self.values.operations), []
        self.after_rare = [*self.after]
        if halves:
            beyond = [sizes[k] - LARGE_PART * parts[k] for k in halves]
            far = joined("fadd", [larger(0.0, excess) for excess in beyond])  # NaN stays NaN
            common.append(far < np.inf)
            if len(halves) == self.D:  # or a component equals its limit, such as 0 that stays 0
                at_limit = [sizes[k].equals(limits[k]) for k in halves]
                common.append(joined("or", [far > 0.0, *at_limit]))
            keeps, following = joined("and", common), self._following()
            for k in halves:
                self.after_rare[k] = keeps.select(after[k], number(following[k])).number
            tests.append(joined("fadd", [abs(number(following[k])) for k in halves]) < np.inf)
        self.accurate = joined("and", [*tests, *self._accurate_pivots()]).number
        negative = [number(pivot) < 0.0 for pivot in self.factors.pivot.values()]
        self.negative = joined("xor", negative or [number(1.0) < 0.0]).number
        changes = []
        for k in tested:
            x, following = number(k), number(self.after_rare[k])
            changes.append((x < 0.0) & (following > SIGNIFICANT))
            changes.append((x > 0.0) & (following < -SIGNIFICANT))
        self.changed = joined("or", changes).number if changes else None
        self.rare = self.values.operations[first_rare:]

    def _following(self):
        """Return x_next, in whose equations no increment cancels the state."""
        values, matrix, right = self.values, self.matrix, {}
        for k in self.factors.order:
            right[k] = self.factors.forward(k, values.total(k, matrix.linear_part(k)), right)
        for k in reversed(self.factors.order):
            right[k] = self.factors.backward(k, right)
        return right

    def _good_pivots(self):
        """Return the tests of the pivots for `good`."""
        return [self.factors.is_good()]

    def _accurate_pivots(self):
        """Return the tests of the pivots for `accurate`."""
        return [self.factors.is_accurate()]

    def _separate_fixed(self):
        """Separate the operations on parameters alone, and list which of their values are used."""
        fixed, table = self.values.fixed, {}
        rare = {number for _, number, _ in self.rare}
        self.fixed = [operation for operation in self.values.operations if operation[1] in fixed]
        others = [operation for operation in self.values.operations if operation[1] not in fixed]
        for _, _, operands in others:
            if not fixed.isdisjoint(operands):
                table.update(dict.fromkeys(a for a in operands if a in fixed))
        table.update(dict.fromkeys(number for number in self._results() if number in fixed))
        self.table = [*table]
        self.places = {number: place for place, number in enumerate(self.table)}
        self.usual = [operation for operation in others if operation[1] not in rare]
        self.rare = [operation for operation in others if operation[1] in rare]

    def _results(self):
        """Return the numbers of values that are read after the operations."""
        return [*self.after, *self.after_rare]

    def table_of(self, halves):
        """Return the values of the table (n, ...), for h v of the terms (T, ...)."""
        values = dict(enumerate(halves, self.D))
        with np.errstate(all="ignore"):  # a pivot of parameters alone may be 0
            evaluate(self.fixed, values)
        table = np.empty((len(self.table), *np.shape(halves)[1:]))
        for k, number in enumerate(self.table):
            table[k] = values[number]
        return table


class StepByColumns(Step):
    """The lists before and after elimination by columns.

    `usual` computes the `entries` of N; h f, the `right` sides; and the sides `of_next`, for
    x_next. `given` are D values each: x, the solution delta, pivots, the diagonal of N, and the
    solution x_next, from which the lists after elimination compute `after`, `good` and so on.

    is_constant   true if no entry depends on the state
    on_diagonal   (D,) numbers of the entries on the diagonal; that of all entries for 0
    """

    def __init__(self, indices, D, keeps_signs, order, fill):
        values = self._begin(indices, D, 0, keeps_signs)
        pattern, varying = places_of(indices, D)
        places, self.is_constant = sorted(pattern), not varying
        self.sparse = Sparse(places, order, fill)
        matrix = Matrix(indices, D, values, range(D), range(D, D + self.T))
        entries = {place: matrix.entry(*place)[0] for place in places}
        numbers = {place: number for number, place in enumerate(places)}
        numbers = [numbers.get((k, k), len(places)) for k in range(D)]
        self.on_diagonal = np.array(numbers, np.int64)
        sides = [matrix.right_side(k) for k in range(D)]
        self.entries = [*entries.values()]
        self.right = [values.emit("fmul", 0.0, k) if a is None else a for k, a in enumerate(sides)]
        self.of_next = [values.total(k, matrix.linear_part(k)) for k in range(D)]
        self.before = {number for _, number, _ in values.operations}
        self.given = [*range(D), *range(values.count, values.count + 4 * D)]
        values.count += 4 * D
        halves, pivots, diagonal, self.next = (self.given[n * D : (n + 1) * D] for n in range(1, 5))
        original = {k: diagonal[k] if (k, k) in entries else None for k in range(D)}
        self.factors = Given(values, dict(enumerate(pivots)), original)
        halves = {k: halves[k] for k in range(D) if sides[k] is not None}
        for k, half in halves.items():
            self.after[k] = values.total(k, [(2.0, half)])
        self._add_tests(halves)
        self._separate_fixed()

    def _following(self):
        return self.next

    def _results(self):
        return [*super()._results(), *self.entries, *self.right, *self.of_next]


class Tangent(Step):
    """The operations of a step and of its derivative, which multiplies columns q.

    Three values come after x (D) and h v (T): VOLUME, NEAR_1 and FAR_FROM_1 of `generated_tangent`.
    A step multiplies VOLUME by abs(det DPhi), NEAR_1 + 1 by the factors of it that are near 1, and
    FAR_FROM_1 by the others.

    derived     true if the elimination of the derivative is accurate; a value of `rare`
    columns     operations for -DPhi q in place of q, whose values follow those of the step
    column      the D values of a column q
    products    the D values of -DPhi q
    scaled      the values of VOLUME, NEAR_1 and FAR_FROM_1 after the step
    back        `Factors` of 1 - M(x_next)
    """

    derived = back = None  # without a plan
    column = products = scaled = ()

    def __init__(self, indices, D, keeps_signs=False):
        self.columns = []
        super().__init__(indices, D, carried=3, keeps_signs=keeps_signs)

    def _has_list(self, work, of_state):
        dense = max(sizes.PRODUCTS, sizes.PART_OF_DENSE * self.D**3)
        return work <= sizes.LONGEST and of_state <= dense

    def _add_tests(self, halves):
        values = self.values
        minus = [values.emit("fmul", -1.0, half) for half in range(self.D, self.D + self.T)]
        matrix = Matrix(self.indices, self.D, values, self.after, minus)
        self.back = Factors(matrix, self.factors.order, self.factors.fill)
        entries = {place: matrix.entry(*place)[0] for place in sorted(matrix.pattern)}
        for k in range(self.D):  # of M(x_next) - 1
            is_there = (k, k) in entries
            entries[k, k] = values.emit("fadd", -1.0, entries[k, k]) if is_there else -1.0
        self._scale()
        super()._add_tests(halves)
        self._add_columns(entries)

    def _good_pivots(self):
        return [*super()._good_pivots(), self.back.is_good(1.0)]

    def _accurate_pivots(self):
        self.derived = self.back.is_accurate(1.0).number
        return super()._accurate_pivots()

    def _scale(self):
        """Multiply VOLUME, NEAR_1 and FAR_FROM_1 by abs(det DPhi).

        This is prod abs(p_k / q_k), with pivots p of 1 - M(x_next) and q of 1 - N(x). Near 1 digits
        need p_k / q_k - 1 = (N_kk - M_kk) / q_k, with N and M after elimination.
        """
        number, first = self.values.number, self.D + self.T
        volume, near_1, far = (number(first + k) for k in range(3))
        for n, k in enumerate(sorted(self.factors.inverse)):
            if n and n % AT_MOST == 0:  # many factors near 1 have a product that is not
                is_near = abs(near_1) < 0.5
                factor = is_near.select(1.0, 1.0 + near_1)
                near_1, far = is_near.select(near_1, 0.0), far * factor
            per_q, per_p = (number(of.inverse[k]) for of in (self.factors, self.back))
            N, M = (number(of.diagonal[k]) for of in (self.factors, self.back))
            change = (N - M) * per_q
            is_near = abs(change) < 0.5
            quotient = is_near.select(1.0, abs(per_q / per_p))
            change = is_near.select(change, 0.0)
            near_1 = near_1 + (change + near_1 * change)
            far = far * quotient
            volume = volume * (quotient + quotient * change)
        self.scaled = volume.number, near_1.number, far.number

    def _add_columns(self, entries):
        """Add the operations for -DPhi q, with the entries of M(x_next) - 1."""
        values, step, first = self.values, self.factors, len(self.values.operations)
        self.column, v = [*range(values.count, values.count + self.D)], {}
        values.count += self.D
        for k in step.order:
            products = [(number, self.column[j]) for (i, j), number in entries.items() if i == k]
            v[k] = values.total(None, products)
            v[k] = values.total(v[k], [(step.lower[k, i], v[i]) for i in step.before[k]])
        for k in reversed(step.order):
            v[k] = values.total(v[k], [(step.upper[k, j], v[j]) for j in step.after[k]])
            if k in step.inverse:
                v[k] = values.emit("fmul", step.inverse[k], v[k])
        self.products = [v[k] for k in range(self.D)]
        self.columns = values.operations[first:]
        del values.operations[first:]

    def _results(self):
        operands = [a for *_, operands in self.columns for a in operands if isinstance(a, int)]
        return [*super()._results(), *self.scaled, *operands]
