"""Elimination in the matrix of a step, planned on its pattern of zeros: see `operations`."""

from collections import defaultdict

import numpy as np

# Elimination has lost digits if a pivot is below this part of the largest.
LEAST_PIVOT = 2.0**-6


class Matrix:
    """The terms of N(x) and f(x) by entry, and the values made of them."""

    def __init__(self, indices, D, values, x, halves):
        self.D, self.values, self.x = D, values, x
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
            value = self.values.total(linear if early is None else early, rest)
            if early is not None and linear is not None:
                value = self.values.emit("fadd", value, linear)
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


class Factors:
    """The values of elimination in a matrix 1 - N: pivots, multipliers and upper triangle.

    With `right` the right sides h f are eliminated, too.
    """

    def __init__(self, matrix, order, right=None):
        self.order, self.values = order, matrix.values
        self.diagonal, self.original, self.pivot, self.inverse = {}, {}, {}, {}
        self.lower, self.upper = {}, {}
        self.before, self.after = filled(matrix.pattern, order)
        for n, k in enumerate(order):
            if right is not None:
                right[k] = self._forward(k, matrix.right_side(k), right)
            for i in [k, *(i for i in order[n + 1 :] if k in self.before[i])]:
                original = matrix.entry(i, k)[0]
                value = self._eliminated(original, i, k)
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
        return self.values.emit("fmul", value, self.inverse[k])

    def least_and_limit(self, most=np.inf):
        """Return the least modulus of pivots, and the value below which it is small: beside all
        pivots, and the diagonal before elimination.
        """
        emit, least, largest = self.values.emit, min(most, self._no_pivot()), 1.0
        for k in self._fixed_first():
            size = emit("fabs", self.pivot[k])
            least, largest = emit("lesser", size, least), emit("larger", size, largest)
            if self.original[k] not in (None, self.diagonal[k]):
                before = emit("fabs", emit("fsub", 1.0, self.original[k]))
                largest = emit("larger", before, largest)
        return least, emit("fmul", LEAST_PIVOT, largest)

    def bounds(self, most=np.inf):
        """Return the least pivot, and a value that is not below the limit if that is positive."""
        emit, least, largest = self.values.emit, min(most, self._no_pivot()), 0.0
        for k in self._fixed_first():
            least = emit("lesser", self.pivot[k], least)
            largest = emit("larger", self.pivot[k], largest)
            if self.original[k] not in (None, self.diagonal[k]):
                largest = emit("larger", emit("fabs", self.original[k]), largest)
        return least, emit("fmul", LEAST_PIVOT, emit("fadd", 1.0, largest))

    def _no_pivot(self):
        """Return the least of the pivots that are 1 for all states; infinity without any."""
        return 1.0 if len(self.pivot) < len(self.order) else np.inf

    def _fixed_first(self):
        """Return the places of pivots, of which those of parameters alone are compared first."""
        return sorted(self.pivot, key=lambda k: self.pivot[k] not in self.values.fixed)


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


def work_of(pattern, order):
    """Return how many products elimination takes."""
    before, after = filled(pattern, order)
    return sum(len(after[k]) for i in order for k in before[i])
