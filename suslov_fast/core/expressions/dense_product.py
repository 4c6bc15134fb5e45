"""Products of a constant dense matrix and values of a program, as one operation.

The operation (`DenseMatrix`, number, operands) has a vector of numbers; ("entry", number, (vector,
float(i))) is its component i. So a list has n operations for n**2 products; machine code has loops.
Each component is 0 + a_i0 v_0 + a_i1 v_1 + ..., added in this order: the bits of the written sum.
"""

import hashlib

import numpy as np

from .function_records import FUNCTIONS
from .programs import Expressions, renamed

ENTRY = "entry"
AT_ONCE = 16  # rows that machine code may take at once
# Below so many entries, or with fewer entries that are not 0, sums are written out: see `is_large`.
LEAST, LEAST_PART = 24 * 24, 0.25


class DenseMatrix(str):
    """A constant matrix; as a text it is its name in expression programs."""

    def __new__(cls, matrix):
        matrix = np.ascontiguousarray(matrix, np.float64)
        digest = hashlib.blake2b(matrix.tobytes(), digest_size=16).hexdigest()
        own = super().__new__(cls, f"matrix {digest} {matrix.shape[0]} {matrix.shape[1]}")
        own.matrix = matrix
        return own

    def __reduce__(self):
        return DenseMatrix, (self.matrix,)

    def __call__(self, *operands):
        """Return the product (n, ...) with numbers or arrays, in the order of the machine code."""
        operands = [np.asarray(a, np.float64) for a in operands]
        total = np.zeros((len(self.matrix), *np.broadcast_shapes(*map(np.shape, operands))))
        columns = self.matrix.T.reshape(*self.matrix.T.shape, *[1] * (total.ndim - 1))
        for column, a in zip(columns, operands, strict=True):
            total += column * a
        return total

    def packed(self, rows):
        """Return the entries in blocks of so many rows, each column by column; the last is filled.

        With rows = 1, it is the matrix itself.
        """
        n, m = self.matrix.shape
        full = np.zeros((-(-n // rows) * rows, m))
        full[:n] = self.matrix
        return np.ascontiguousarray(full.reshape(-1, rows, m).transpose(0, 2, 1))


def is_matrix(instruction):
    """Return True if an instruction is a product with a `DenseMatrix`."""
    return isinstance(instruction, DenseMatrix)


def is_large(matrix):
    """Return True if loops are faster than a written sum of the entries that are not 0."""
    return matrix.size >= LEAST and np.count_nonzero(matrix) >= max(LEAST, LEAST_PART * matrix.size)


def expanded(values, operands):
    """Return `Expressions` with written sums in place of products, and the operands there."""
    if not any(is_matrix(name) for name, *_ in values.operations):
        return values, operands
    given = values.count - len(values.operations)
    new, known = Expressions(given, [a for a in values.fixed if a < given]), {}
    vectors, known = {}, {a: a for a in range(given)}
    add, multiply = (FUNCTIONS[name].rule for name in ("add", "multiply"))
    for name, number, of in values.operations:
        if name == ENTRY:
            row, factors = vectors[of[0]]
            total = 0.0
            for c, a in zip(row[int(of[1])].tolist(), factors, strict=True):
                total = add(new, total, multiply(new, c, a))
            known[number] = total
        elif is_matrix(name):
            vectors[number] = name.matrix, renamed(of, known)
        else:
            known[number] = new.emit(name, *renamed(of, known))
    new.take_written(values, known)
    return new, renamed(operands, known)


class Chain:
    """The chain rule through the products of a `RightHandSide` f: how f' follows from parts of it.

    The parts are derivatives of rates, and of operands of products, by components and by entries of
    products. T has a row for each entry of a product, its derivatives by the components:

    T_i += a_il g_lj e_j (`plain`), T_i += a_il g_lr T_r (`nested`) of each product; then f' alike.

    products   (`DenseMatrix`, first row of T, plain, nested) in order; lists have (l, j or r, k),
               where the k-th part is g
    plain, nested  such lists of rates: l is the number of the rate
    rows       of T
    """

    def __init__(self, f):
        self.D, self.parts, self.rows, firsts, owner = f.D, len(f.linked), 0, {}, []
        own = [([], []) for _ in f.products]
        for q, (name, number, operands) in enumerate(f.products):
            owner += [(q, l) for l in range(len(operands))]
            firsts[number] = self.rows
            self.rows += len(name.matrix)
        self.plain, self.nested = rates = [], []
        for k, (target, source) in enumerate(f.linked):
            q, l = owner[target - f.D] if target >= f.D else (None, target)
            lists = rates if q is None else own[q]
            if source < f.D:
                lists[0].append((l, source, k))
            else:
                vector, i = f.entry_of[source]
                lists[1].append((l, firsts[vector] + int(i), k))
        names = [(name, firsts[number]) for name, number, _ in f.products]
        self.products = [(*each, *of) for each, of in zip(names, own, strict=True)]

    def matrix(self, parts, of=np.asarray):
        """Return f' (D, D, ...) of its parts (n, ...), with the bits of the machine code.

        `of` is a function of all matrices; np.abs finds where f' may differ from 0.
        """
        T, J = (np.zeros((n, self.D, *parts.shape[1:])) for n in (self.rows, self.D))
        for name, first, plain, nested in self.products:
            own = T[first : first + len(name.matrix)]
            columns = of(name.matrix.T)
            columns = columns.reshape(*columns.shape, *[1] * (parts.ndim - 1))
            for l, j, k in plain:
                own[:, j] += columns[l] * parts[k]
            for l, row, k in nested:
                own += (columns[l] * parts[k])[:, np.newaxis] * T[row]
        for i, j, k in self.plain:
            J[i, j] += parts[k]
        for i, row, k in self.nested:
            J[i] += parts[k] * T[row]
        return J
