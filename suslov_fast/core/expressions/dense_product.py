"""Products of a constant dense matrix and values of a program, as one operation.

The operation (`DenseMatrix`, number, operands) has a vector of numbers; ("entry", number, (vector,
float(i))) is its component i. So a list has n operations for n**2 products; machine code has loops.
Each component is 0 + a_i0 v_0 + a_i1 v_1 + ..., added in this order: the bits of the written sum.
"""

import hashlib
from collections import defaultdict
from itertools import islice, zip_longest

import numpy as np

from .function_records import FUNCTIONS
from .programs import Expressions, dot, renamed

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
        own.matrix, own.packed = matrix, {}
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

    @property
    def height(self):
        """The number of rows, rounded up to AT_ONCE."""
        return -(-len(self.matrix) // AT_ONCE) * AT_ONCE

    def address(self, rows):
        """Return the address of the entries in blocks of `rows` rows, each column by column.

        Rows of 0 follow the last ones. The entries stay in memory as long as this object.
        """
        if rows not in self.packed:
            full = np.zeros((self.height, self.matrix.shape[1]))
            full[: len(self.matrix)] = self.matrix
            blocks = full.reshape(-1, rows, full.shape[1]).transpose(0, 2, 1)
            self.packed[rows] = np.ascontiguousarray(blocks)
        return self.packed[rows].ctypes.data


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


def products_in(operations):
    """Return (matrix, operands, {number of an entry: its place}) of each product, in order."""
    found, entries = [], defaultdict(dict)
    for name, number, operands in operations:
        if name == ENTRY:
            entries[operands[0]][number] = operands[1]
        elif is_matrix(name):
            found.append((name, operands, entries[number]))
    return found


def along(emit, products, rows, v, totals=()):
    """Return changes of values along v, and v with changes of entries of `products_in` a list.

    v is {component: operand of its change}. `rows` are derivatives {component or entry: operand},
    as `gradients` returns them: of the operands of the products in order, then of other values,
    whose changes are the first result; None means 0. `totals` are operands to add, in this order.
    """
    v = dict(v)
    changes = (
        dot(emit, [(a, v[j]) for j, a in row.items() if j in v], total)
        for row, total in zip_longest(rows, totals)
    )
    for matrix, operands, entries in products:
        own = [*islice(changes, len(operands))]
        if any(a is not None for a in own):
            whole = emit(matrix, *(0.0 if a is None else a for a in own))
            v |= {a: emit(ENTRY, whole, i) for a, i in entries.items()}
    return [*changes], v
