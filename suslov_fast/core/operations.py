"""A step of a field as a list of operations on rows of numbers, planned from its pattern of zeros.

With h = eps / 2 and N(x) = h f'(x) a step solves (1 - N) delta = h f(x), x_next = x + 2 delta
(theory, section 7). Which entries of N are zero is known from the terms of the field alone, so
elimination is planned once, here, on the pattern. For pivots k, in an order with little fill-in,

pivot_k = 1 - N_kk,   m_ik = N_ik / pivot_k,   N_ij += m_ik N_kj,   g_i += m_ik g_k,

for i and j that come later, where g = h f(x) at first; then, backwards,

delta_k = (g_k + sum_j N_kj delta_j) / pivot_k.

All of these are sums of products, the same for all states. They become a list of

operations   (code, d, s, a, c, e, g, times): a code, the row d that it writes, rows that it reads,
             and for how many columns.

One kernel carries them out for all fields, each operation as a loop over a row of lanes; nothing is
compiled for a field. An operation never writes to a row that it reads, so LLVM vectorizes it. A row
is reused after the last use of its value, so all rows remain in the caches. The Lorenz system
takes 28 operations, three of them divisions, on 25 rows.
"""

from collections import defaultdict
from functools import lru_cache
from typing import NamedTuple

import numpy as np

# d = a c; d = a c + e g; d = s + a c; d = s + a c + e g; d = 1 / (1 - a), where s was a before
# elimination; d += 2 s, while s becomes what d was; new tests, where s = 1 if a pivot is 1, and
# a = 1 if a component does not change.
MUL, MUL_2, ADD, ADD_2, INVERSE, ADVANCE, BEGIN = range(7)
# Rows: the least and largest pivots; how far components are from losing digits; 1 if the trajectory
# has ended (see `steps_field.is_accurate`); 1. Then the components, x (D), from FIRST on, h v of
# the terms (T), and what is computed.
LEAST, LARGEST, NEAR, FAR, ENDED, ONE, FIRST = range(7)
NUMBERS = 8  # of an operation
PLANS = 32  # patterns whose plans are remembered


class Plan(NamedTuple):
    """A list of operations, as arrays for kernels."""

    operations: np.ndarray  # (n, 8)
    rows: int  # numbers of a lane


class TangentPlan(NamedTuple):
    """Lists of operations for a step and its derivative.

    With M(x) = -h f'(x) the derivative is (1 - N(x))**-1 (1 - M(x_next)). The operations of `step`
    are followed by those of `back`, which are M(x_next) and its elimination. Those of `columns`
    replace D columns q by -DPhi q, all columns by each: component i of column r is in the row
    `first` + `width` i + r, and a `d`, `s`, `c` or `g` is the row of column 0.
    """

    step: np.ndarray  # (n, 8)
    back: np.ndarray
    columns: np.ndarray
    first: int
    width: int
    rows: int
    pivots: np.ndarray  # (4, at most D): N_kk and M_kk after elimination, inverse pivots of both


class _Values:
    """Values by number, in the order in which they are computed; rows come later."""

    def __init__(self, fixed):
        self.fixed = fixed  # the first values, which have these rows
        self.operations = []  # (code, value d, then the values that are read)
        self.count = self.fixed

    def emit(self, code, *sources):
        self.operations.append((code, self.count, sources))
        self.count += 1
        return self.count - 1

    def redirect(self, number):
        """Let the latest operation write to the row of a fixed value."""
        code, _, sources = self.operations.pop()
        self.operations.append((code, number, sources))

    def total(self, start, products):
        """Return the value start + sum of products (a, c), two at a time; start may be None."""
        n = 0
        while n < len(products):
            pair = products[n : n + 2]
            n += len(pair)
            numbers = [number for product in pair for number in product]
            code = MUL if len(pair) == 1 else MUL_2
            if start is not None:
                code += ADD - MUL
                numbers.insert(0, start)
            start = self.emit(code, *numbers)
        return start


class _Matrix:
    """The terms of N(x) and f(x) by entry, and the values made of them."""

    def __init__(self, indices, D, values, halves):
        self.D, self.values = D, values
        self.linear, self.constant, self.entries = {}, {}, {}
        self.products = defaultdict(list)
        self.x = [FIRST + i for i in range(D)]
        cross = []
        for t, (i, j, k) in enumerate(indices.T.tolist()):
            half = halves + t
            if j == D:
                self.constant[i] = half
            elif k == D:
                self.linear[i, j] = half
            else:
                cross.append((i, j, k, half))
                self.products[i, j].append((half, self.x[k]))
                self.products[i, k].append((half, self.x[j]))
        # h v x_j x_k of f is a product of x_j and of an early part of N_ij, or of x_k and of N_ik.
        self.early = defaultdict(list)
        for i, j, k, half in cross:
            sizes = [len(self.products[i, m]) + ((i, m) in self.linear) for m in (j, k)]
            column, other = (j, k) if sizes[0] < sizes[1] else (k, j)
            product = half, self.x[other]
            self.early[i, column].append(product)
            self.products[i, column].remove(product)
        self.pattern = {*self.linear, *self.products, *self.early}
        self.columns = defaultdict(set)
        for i, j in self.pattern:
            self.columns[i].add(j)

    def entry(self, i, j):
        """Return the value N_ij, None where it is 0; and its early part."""
        if (i, j) not in self.entries:
            early = self.values.total(None, self.early.get((i, j), []))
            rest, linear = self.products.get((i, j), []), self.linear.get((i, j))
            if early is None:
                value = self.values.total(linear, rest)
            else:
                more = [] if linear is None else [(ONE, linear)]
                value = self.values.total(early, rest + more)
            self.entries[i, j] = value, early
        return self.entries[i, j]

    def right_side(self, i):
        """Return the value h f_i, None where it is 0."""
        products = []
        for j in sorted(self.columns[i]):
            early = self.entry(i, j)[1]
            if early is not None:
                products.append((early, self.x[j]))
            if (i, j) in self.linear:
                products.append((self.linear[i, j], self.x[j]))
        return self.values.total(self.constant.get(i), products)


class _Factors:
    """The values of elimination in a matrix 1 - N: pivots, multipliers and upper triangle.

    With `right` the right sides h f are eliminated, too.
    """

    def __init__(self, matrix, order, right=None):
        self.order, self.values = order, matrix.values
        self.diagonal, self.inverse, self.lower, self.upper = {}, {}, {}, {}
        self.before, self.after = filled(matrix.pattern, order)
        for n, k in enumerate(order):
            if right is not None:
                right[k] = self._forward(k, matrix.right_side(k), right)
            for i in [k, *(i for i in order[n + 1 :] if k in self.before[i])]:
                original = matrix.entry(i, k)[0]
                value = self._eliminated(original, i, k)
                if i == k:
                    self.diagonal[k] = value
                    if value is not None:
                        same = original if original is not None else value
                        self.inverse[k] = self.values.emit(INVERSE, same, value)
                elif k in self.inverse:
                    self.lower[i, k] = self.values.emit(MUL, value, self.inverse[k])
                else:
                    self.lower[i, k] = value
            for j in self.after[k]:
                self.upper[k, j] = self._eliminated(matrix.entry(k, j)[0], k, j)

    def _eliminated(self, start, i, j):
        return self.values.total(
            start,
            [(self.lower[i, k], self.upper[k, j]) for k in self.before[i] if (k, j) in self.upper],
        )

    def _forward(self, k, start, right):
        """Return right side k after elimination, from those of earlier pivots."""
        earlier = [(self.lower[k, i], right[i]) for i in self.before[k] if right[i] is not None]
        return self.values.total(start, earlier)

    def backward(self, k, right):
        """Return unknown k, from the later ones."""
        later = [(self.upper[k, j], right[j]) for j in self.after[k] if right[j] is not None]
        value = self.values.total(right[k], later)
        if value is None or k not in self.inverse:
            return value
        return self.values.emit(MUL, value, self.inverse[k])


def elimination_order(pattern, D):
    """Return an order of pivots with little fill-in: the next pivot is always one of least degree.

    The degree is the number of unknowns that occur in equations together with the pivot's.
    """
    neighbours = [set() for _ in range(D)]
    for i, j in pattern:
        if i != j:
            neighbours[i].add(j)
            neighbours[j].add(i)
    order, left = [], set(range(D))
    while left:
        k = min(left, key=lambda i: (len(neighbours[i]), i))
        order.append(k)
        left.remove(k)
        for i in neighbours[k]:
            neighbours[i] |= neighbours[k]
            neighbours[i] -= {i, k}
    return order


def filled(pattern, order):
    """Return the columns of earlier and of later pivots that each row has after elimination."""
    place = {k: n for n, k in enumerate(order)}
    rows, columns = defaultdict(set), defaultdict(set)
    for i, j in pattern:
        rows[i].add(j)
        columns[j].add(i)
    for k in order:
        later = [j for j in rows[k] if place[j] > place[k]]
        for i in columns[k]:
            if place[i] > place[k]:
                rows[i].update(later)
                for j in later:
                    columns[j].add(i)
    before, after = {}, {}
    for k in order:
        ordered = sorted(rows[k] - {k}, key=place.get)
        before[k] = [j for j in ordered if place[j] < place[k]]
        after[k] = [j for j in ordered if place[j] > place[k]]
    return before, after


def in_rows(values, kept):
    """Return operations on rows (n, 8), the number of rows, and the row of each value.

    A row is reused after the last use of its value. `kept` has values that are needed longer, with
    the number of the operation until which they are.
    """
    last = {}
    for n, (_, number, sources) in enumerate(values.operations):
        for each in (number, *sources):
            last[each] = max(n, kept.get(each, 0))
    rows, free, count = {each: each for each in range(values.fixed)}, [], values.fixed
    array = np.zeros((len(values.operations), NUMBERS), np.uint32)
    for n, (code, number, sources) in enumerate(values.operations):
        if number not in rows:
            rows[number] = free.pop() if free else count
            count = max(count, rows[number] + 1)
        where = slice(2, None) if code not in (MUL, MUL_2) else slice(3, None)
        array[n, [0, 1, 7]] = code, rows[number], 1
        array[n, where][: len(sources)] = [rows[each] for each in sources]
        for each in {number, *sources}:
            if each >= values.fixed and last[each] == n:
                free.append(rows[each])
    return array, count, rows


def plan_step(indices, D):
    """Return the plan of a step of fields with terms at these indices (3, T)."""
    return _plan_step(np.ascontiguousarray(indices, np.int64).tobytes(), D)


@lru_cache(PLANS)
def _plan_step(places, D):
    indices = np.frombuffer(places, np.int64).reshape(3, -1)
    values = _Values(FIRST + D + indices.shape[1])
    increments = _step(_Matrix(indices, D, values, FIRST + D), values)[1]
    return Plan(*in_rows(values, dict.fromkeys(increments, len(values.operations)))[:2])


def _step(matrix, values):
    """Emit a step; return its factors, and the values of the increments."""
    order = elimination_order(matrix.pattern, matrix.D)
    begin = len(values.operations)
    values.operations.append((BEGIN, LEAST, ()))
    right = {}
    factors = _Factors(matrix, order, right)
    for k in reversed(order):
        right[k] = factors.backward(k, right)
    moved = [k for k in range(matrix.D) if right[k] is not None]
    increments = [
        right[k] if right[k] >= values.fixed else values.emit(MUL, right[k], ONE) for k in moved
    ]
    for k, increment in zip(moved, increments, strict=True):
        values.operations.append((ADVANCE, FIRST + k, (increment,)))
    flags = len(factors.inverse) < matrix.D, len(moved) < matrix.D
    values.operations[begin] = BEGIN, LEAST, tuple(map(int, flags))
    return factors, increments


def plan_tangent(indices, D):
    """Return the plan of a step and of its derivative."""
    return _plan_tangent(np.ascontiguousarray(indices, np.int64).tobytes(), D)


@lru_cache(PLANS)
def _plan_tangent(places, D):
    indices = np.frombuffer(places, np.int64).reshape(3, -1)
    T = indices.shape[1]
    minus_one = FIRST + D + 2 * T
    values = _Values(minus_one + 1)
    step, increments = _step(_Matrix(indices, D, values, FIRST + D), values)
    split = len(values.operations)
    values.operations.append((BEGIN, LEAST, (1, 1)))
    matrix = _Matrix(indices, D, values, FIRST + D + T)
    back = _Factors(matrix, step.order)
    pivots = [
        (step.diagonal[k], back.diagonal[k], step.inverse[k], back.inverse[k])
        for k in sorted(step.inverse)
    ]
    M = {(i, j): matrix.entry(i, j)[0] for i, j in sorted(matrix.pattern)}
    factors = step.inverse, step.lower, step.upper
    parts = [increments, *pivots, M.values(), *(each.values() for each in factors)]
    needed = {number for part in parts for number in part}
    operations, first, row_of = in_rows(values, dict.fromkeys(needed, len(values.operations)))
    factors = [{key: row_of[number] for key, number in each.items()} for each in factors]
    products = [[(minus_one, first + i)] for i in range(D)]
    for (i, j), number in M.items():
        products[i].append((row_of[number], first + j))
    columns, rows = _columns(step, *factors, products, first)
    # Rows of an odd number of rows: components of a column do not compete for lines of a cache.
    width = D | 1
    columns[:, 7], numbers = D, columns[:, 1:7]
    numbers[numbers >= first] = first + width * (numbers[numbers >= first] - first)
    table = np.array([[row_of[number] for number in each] for each in pivots], np.uint32)
    pivots = np.ascontiguousarray(table.reshape(-1, 4).T)
    rows = first + width * (rows - first)
    return TangentPlan(operations[:split], operations[split:], columns, first, width, rows, pivots)


def _columns(step, inverse, lower, upper, products, first):
    """Return operations for q = -DPhi q, with rows for one column, and their number.

    All values are given by their rows; `products` are those of the rows of 1 - M.
    """
    values = _Values(first + len(products))
    v = {}
    for k in step.order:
        v[k] = values.total(None, products[k])
        v[k] = values.total(v[k], [(lower[k, i], v[i]) for i in step.before[k]])
    for k in reversed(step.order):
        value = values.total(v[k], [(upper[k, j], v[j]) for j in step.after[k]])
        values.emit(MUL, inverse.get(k, ONE), value)
        v[k] = first + k
        values.redirect(v[k])
    return in_rows(values, {})[:2]
