"""Elimination in the matrix 1 - N of a step as expression programs, planned on the pattern of N.

`core.maps.kahan_step` has the equations. Operands here may be None, which stands for 0.
"""

from collections import defaultdict
from heapq import heapify, heappop, heappush
from types import SimpleNamespace

import numpy as np

from .programs import Program, Values, dot, emitted, program_of
from .tolerances import LEAST_PIVOT
from .values import joined


def places_of(indices, D):
    """Return two sets of places (i, j) in N = h f': all entries, and entries that depend on x."""

    def of(i, j):
        numbers = np.unique(i * D + j)
        return {*zip((numbers // D).tolist(), (numbers % D).tolist(), strict=True)}

    i, j, k = indices
    products, linear = k < D, (j < D) & (k == D)
    varying = of(i[products], j[products]) | of(i[products], k[products])
    return varying | of(i[linear], j[linear]), varying


class Matrix:
    """Operands of the matrix N = h f'(x) and of h f(x), for terms v x_j x_k of f_i, where x_D = 1.

    `indices` (3, n) has i, j, k of the terms, `halves` the operands of h v with h = eps / 2, and
    `x` the operands of the state. Operations are added to `values`.
    """

    def __init__(self, indices, D, values, x, halves):
        self.values, self.x = values, x
        self.linear, self.constant, self.entries = {}, {}, {}
        self.products = defaultdict(list)
        cross = []
        for half, (i, j, k) in zip(halves, indices.T.tolist(), strict=True):
            if j == D:
                self.constant[i] = half
            elif k == D:
                self.linear[i, j] = half
            else:
                cross.append((i, j, k, half))
                self.products[i, j].append((half, self.x[k]))
                self.products[i, k].append((half, self.x[j]))
        # A term h v x_j x_k of h f_i is x_j times a part of N_ij, or x_k times a part of N_ik. The
        # sum of an entry begins with these `early` parts, so that the right side can use them.
        self.early = defaultdict(list)
        for i, j, k, half in cross:
            sizes = [len(self.products[i, m]) + ((i, m) in self.linear) for m in (j, k)]
            column, other = (j, k) if sizes[0] < sizes[1] else (k, j)
            product = half, self.x[other]
            self.early[i, column].append(product)
            self.products[i, column].remove(product)
        self.pattern = places_of(indices, D)[0]
        self.columns = defaultdict(set)
        for i, j in self.pattern:
            self.columns[i].add(j)

    def entry(self, i, j):
        """Return two operands, N_ij and its part that `right_side` multiplies by x_j; None is 0."""
        if (i, j) not in self.entries:
            early = self.values.total(None, self.early.get((i, j), []))
            others, linear = self.products.get((i, j), []), self.linear.get((i, j))
            value = self.values.total(linear if early is None else early, others)
            if early is not None and linear is not None:
                value = self.values.emit("fadd", value, linear)
            self.entries[i, j] = value, early
        return self.entries[i, j]

    def right_side(self, i):
        """Return the operand of h f_i(x); None is 0."""
        products = []
        for j in sorted(self.columns[i]):
            early = self.entry(i, j)[1]
            if early is not None:
                products.append((early, self.x[j]))
            if (i, j) in self.linear:
                products.append((self.linear[i, j], self.x[j]))
        return self.values.total(self.constant.get(i), products)

    def linear_part(self, i):
        """Return operand pairs (a, b) with sum a b = h (l x + 2 c)_i, for f = q(x) + l x + c."""
        products = [
            (self.linear[i, j], self.x[j]) for j in sorted(self.columns[i]) if (i, j) in self.linear
        ]
        if i in self.constant:
            products.append((2.0, self.constant[i]))
        return products


class Factors:
    """The factors of 1 - N: pivots, their inverses, multipliers and the upper triangle of N.

    `matrix` is a `Matrix`, or has `values` and `entry`. `order` has the unknowns in the order of
    pivots, and `fill` is from `filled`. If the dict `right` is given, it gets the g_k after
    elimination.

    diagonal, original   N_kk after and before elimination
    pivot, inverse       1 - N_kk after elimination, and its inverse; missing if N_kk is 0
    lower, upper         multipliers m_ik, and N_kj after elimination
    before, after        for each row, the columns of earlier and of later pivots
    """

    def __init__(self, matrix, order, fill, right=None):
        self.order, self.values = order, matrix.values
        self.diagonal, self.original, self.pivot, self.inverse = {}, {}, {}, {}
        self.lower, self.upper = {}, {}
        self.before, self.after, below = {}, {}, defaultdict(list)
        for n, (i, columns) in enumerate(zip(order, fill[0], strict=True)):
            places = [*bits_of(columns)]
            self.before[i] = [order[m] for m in places if m < n]
            self.after[i] = [order[m] for m in places if m > n]
            for k in self.before[i]:
                below[k].append(i)
        # {i: {j: [m_ik, N_kj, ...]}}: factors of the products that elimination adds to N_ij
        products = {i: defaultdict(list) for i in order}
        for k in order:
            if right is not None:
                right[k] = self.forward(k, matrix.right_side(k), right)
            # Column k from the diagonal down, then row k to the right of it.
            for i in [k, *below[k]]:
                original = matrix.entry(i, k)[0]
                value = self.values.total_of(original, products[i].pop(k, ()))
                if i == k:
                    if value is not None:
                        self.diagonal[k], self.original[k] = value, original
                        self.pivot[k] = self.values.emit("fsub", 1.0, value)
                        self.inverse[k] = self.values.emit("fdiv", 1.0, self.pivot[k])
                elif k in self.inverse:
                    self.lower[i, k] = self.values.emit("fmul", value, self.inverse[k])
                else:
                    self.lower[i, k] = value
            for j in self.after[k]:
                entry = matrix.entry(k, j)[0]
                self.upper[k, j] = self.values.total_of(entry, products[k].pop(j, ()))
            later = [(j, self.upper[k, j]) for j in self.after[k]]
            for i in below[k]:
                lower, row = self.lower[i, k], products[i]
                for j, upper in later:
                    row[j] += (lower, upper)

    def forward(self, k, start, right):
        """Return g_k = start + sum_i m_ki g_i over earlier pivots i; `right` is {i: g_i}."""
        products = [(self.lower[k, i], right[i]) for i in self.before[k] if right[i] is not None]
        return self.values.total(start, products)

    def backward(self, k, right):
        """Return v_k = (g_k + sum_j N_kj v_j) / pivot_k; `right` has g_k, and v_j for later j."""
        products = [(self.upper[k, j], right[j]) for j in self.after[k] if right[j] is not None]
        value = self.values.total(right[k], products)
        if value is None or k not in self.inverse:
            return value
        return self.values.emit("fmul", value, self.inverse[k])

    def is_accurate(self):
        """Return the truth value that no pivot is too small for elimination without row exchanges.

        The least modulus of a pivot is above LEAST_PIVOT times the largest modulus of a pivot, or
        of a diagonal entry before elimination.
        """
        number, sizes, largest = self.values.number, [], [1.0]
        for k, pivot in self.pivot.items():
            sizes.append(abs(number(pivot)))
            if self.original[k] not in (None, self.diagonal[k]):
                largest.append(abs(1.0 - number(self.original[k])))
        limit = LEAST_PIVOT * self._extreme("max", [*largest, *sizes])
        return self._extreme("min", [self._least_constant(), *sizes]) > limit

    def is_good(self):
        """Return a truth value that implies `is_accurate` and pivots > 0, by fewer operations."""
        pivots, largest = [*map(self.values.number, self.pivot.values())], [0.0]
        for k in self.pivot:
            if self.original[k] not in (None, self.diagonal[k]):
                largest.append(abs(self.values.number(self.original[k])))
        largest = 1.0 + self._extreme("max", [*largest, *pivots])
        return self._extreme("min", [self._least_constant(), *pivots]) > LEAST_PIVOT * largest

    def _extreme(self, instruction, numbers):
        """Return the "min" or "max" (`instruction`) of numbers; constant ones are joined first."""
        fixed, others = [], []
        for a in numbers:
            a = self.values.number(a) if isinstance(a, float) else a
            (fixed if self.values.is_fixed(a.number) else others).append(a)
        return joined(instruction, [joined(instruction, fixed), *others])

    def _least_constant(self):
        """Return 1 if the pattern fixes some pivot at 1, else infinity, for use in a minimum."""
        return 1.0 if len(self.pivot) < len(self.order) else np.inf


def elimination_order(pattern, D):
    """Return an order of pivots with little fill-in: the next pivot always has the least degree.

    The degree of an unknown is the number of other unknowns that are left in its row or column.
    Among equal degrees the next pivot has the shortest chain of pivots that it depends on, because
    processors evaluate independent operations in parallel. `pattern` has places (i, j).
    """
    neighbours, depth = [0] * D, [0] * D  # sets as bits; lengths of chains of pivots
    order, left = [], set(range(D))
    for i, j in pattern:
        if i != j:
            neighbours[i] |= 1 << j
            neighbours[j] |= 1 << i
    degree = [of.bit_count() for of in neighbours]
    keys = [(degree[i], 0, i) for i in range(D)]
    heapify(keys)
    while left:
        key = heappop(keys)
        k = key[-1]
        if k not in left or key != (degree[k], depth[k], k):
            continue  # an outdated key of the unknown k
        order.append(k)
        left.remove(k)
        others = neighbours[k]
        for i in bits_of(others):
            others_of_i = neighbours[i] = (neighbours[i] | others) ^ (1 << i | 1 << k)
            degree[i], depth[i] = others_of_i.bit_count(), max(depth[i], depth[k] + 1)
            heappush(keys, (degree[i], depth[i], i))
    return order


def bits_of(number):
    """Yield the places of the bits that are 1 in an integer, from the lowest on."""
    while number:
        least = number & -number
        yield least.bit_length() - 1
        number ^= least


def filled(pattern, order):
    """Return the entries after elimination: columns of each row, and rows of each column, as bits.

    `pattern` has places (i, j). Rows and columns are numbered by their places in `order`, the
    unknowns in the order of pivots.
    """
    place, D = {k: n for n, k in enumerate(order)}, len(order)
    rows, columns = [0] * D, [0] * D
    for i, j in pattern:
        rows[place[i]] |= 1 << place[j]
        columns[place[j]] |= 1 << place[i]
    for k in range(D):
        later, below = (of[k] >> (k + 1) << (k + 1) for of in (rows, columns))
        for i in bits_of(below):
            rows[i] |= later
        for j in bits_of(later):
            columns[j] |= below
    return rows, columns


def work_of(order, fill, varying):
    """Return the number of products in elimination, and of products with `varying` factors."""
    place, count, of_state = {k: n for n, k in enumerate(order)}, 0, 0
    rows = [0] * len(order)
    for i, j in varying:
        rows[place[i]] |= 1 << place[j]
    for k, (row, column) in enumerate(zip(*fill, strict=True)):
        later, below = row >> (k + 1) << (k + 1), column >> (k + 1) << (k + 1)
        count += later.bit_count() * below.bit_count()
        upper = rows[k] & later
        for i in bits_of(below):
            # The multiplier depends on the state if its entry or the pivot does.
            changed = later if (rows[i] | rows[k]) >> k & 1 else upper
            rows[i] |= changed
            of_state += changed.bit_count()
    return count, of_state


class Elimination:
    """The programs that factorise 1 - s J and solve (1 - s J) v = g, in implicit steps.

    factors   `Program` that reads the entries of J (in the order of `pattern`) and s; its results
              are the inverse pivots, and the numbers below and above the diagonal
    solution  `Program` that reads these results and g (D); its results are v (D)

    `order` has the unknowns in the order of pivots, and `fill` is from `filled`. A pivot that is
    too small makes results infinite or the error estimate large, so the step is rejected.
    """

    def __init__(self, pattern, order, fill):
        D, s = len(order), len(pattern)
        values, first = _Products(s + 1 + D, ()), s + 1
        places = {place: k for k, place in enumerate(pattern)}

        def entry(i, j):
            return (values.emit("fmul", s, places[i, j]) if (i, j) in places else None), None

        factors = Factors(SimpleNamespace(values=values, entry=entry), order, fill)
        numbers = [*factors.inverse.values(), *factors.lower.values(), *factors.upper.values()]
        self.factors = program_of(values.operations, numbers)
        values.operations, v = [], {}
        for k in order:
            v[k] = factors.forward(k, first + k, v)
        for k in reversed(order):
            v[k] = factors.backward(k, v)
        given = {number: place for place, number in enumerate(numbers)}
        given |= {first + i: len(numbers) + i for i in range(D)}
        renumbered = Values(len(numbers) + D, ())
        v = emitted(renumbered, Program(values.operations, [v[i] for i in range(D)]), given)
        self.solution = Program(renumbered.operations, v)


class _Products(Values):
    """Values that write each sum as products and additions: LLVM compiles short blocks of them."""

    def total_of(self, start, factors):
        return dot(self.emit, zip(factors[::2], factors[1::2], strict=True), start)


def operations_of(fill):
    """Return about how many operations the factors take; `fill` is from `filled`."""
    count = 0
    for k, (row, column) in enumerate(zip(*fill, strict=True)):
        later, below = (row >> (k + 1)).bit_count(), (column >> (k + 1)).bit_count()
        count += 2 * (later * below + later + below)
    return count
