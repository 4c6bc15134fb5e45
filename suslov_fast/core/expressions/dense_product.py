"""Products of a constant dense matrix and a vector of values, as one operation of a program.

The value of the operation (`DenseMatrix`, number, operands) is a vector, and ("entry", number,
(vector, float(i))) is component i of it. So a program has n operations for n**2 products, and
machine code has loops. Component i is 0 + a_i0 v_0 + a_i1 v_1 + ..., added in this order: it has
the bits of the written sum.
"""

import hashlib
from collections import Counter, defaultdict
from itertools import chain, count, islice, takewhile, zip_longest

import numpy as np

from .function_records import FUNCTIONS
from .programs import Expressions, dot, renamed
from .tolerances import LEAST_ENTRIES, LEAST_FILL

ENTRY, _SUMS = "entry", ("fadd", "fsub")
ROWS_AT_ONCE = 16  # rows of a matrix that machine code may take at once


class DenseMatrix(str):
    """A constant matrix; as a text it is its name in expression programs."""

    def __new__(cls, matrix):
        matrix = np.ascontiguousarray(matrix, np.float64)
        digest = hashlib.blake2b(matrix.tobytes(), digest_size=16).hexdigest()
        self = super().__new__(cls, f"matrix {digest} {matrix.shape[0]} {matrix.shape[1]}")
        self.matrix, self.packed = matrix, {}
        return self

    def __reduce__(self):
        return DenseMatrix, (self.matrix,)

    def __call__(self, *operands):
        """Return the product (n, ...) with numbers or arrays, added as machine code does."""
        operands = [np.asarray(a, np.float64) for a in operands]
        total = np.zeros((len(self.matrix), *np.broadcast_shapes(*map(np.shape, operands))))
        columns = self.matrix.T.reshape(*self.matrix.T.shape, *[1] * (total.ndim - 1))
        for column, a in zip(columns, operands, strict=True):
            total += column * a
        return total

    @property
    def height(self):
        """The number of rows, rounded up to ROWS_AT_ONCE."""
        return -(-len(self.matrix) // ROWS_AT_ONCE) * ROWS_AT_ONCE

    def address(self, rows):
        """Return the address of entries in blocks of `rows` rows, each block column by column."""
        if rows not in self.packed:  # kept, because machine code reads it; rows of 0 fill a block
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
    least = max(LEAST_ENTRIES, LEAST_FILL * matrix.size)
    return matrix.size >= LEAST_ENTRIES and np.count_nonzero(matrix) >= least


def expanded(values, operands):
    """Return `Expressions` with written sums in place of products, and the operands there."""
    if not any(is_matrix(name) for name, *_ in values.operations):
        return values, operands
    given = values.count - len(values.operations)
    new = Expressions(given, [a for a in values.fixed if a < given])
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


def roll(values):
    """Put products of dense matrices in place of written sums, in the dict `of` of `Expressions`.

    A row is a sum c_0 v_0 + c_1 v_1 + ... of values in the order of their numbers. Rows that share
    values become one matrix. If all constants of a row have the same parameters as factors or
    divisors, as in (g * W) @ x, the entry of the product is multiplied or divided by these.
    """
    if len(values.of) < 2 * LEAST_ENTRIES:
        return
    uses = Counter(a for _, of in values.of.values() for a in of if type(a) is int)
    sums = {number for number, (name, _) in values.of.items() if name in _SUMS}
    lefts = {a for number in sums if type(a := values.of[number][1][0]) is int}
    parts = {number for number in sums if uses[number] == 1 and number in lefts}
    groups, group_of = [], {}
    for number in sorted(sums - parts):
        row = _row(values, number, parts)
        if len(row) > 1:
            group = next((group_of[key] for key in row if key in group_of), None)
            if group is None:
                groups.append(group := [])
            group.append(row)
            group_of |= dict.fromkeys(row, group)
    new = count(-1, -1)  # numbers of new values, unlike all old numbers
    for group in groups:
        often = Counter(chain.from_iterable(group)).items()
        most = {key for key, n in often if n > LEAST_FILL * len(group)}
        rows = [[*takewhile(lambda a, most=most: a[0] in most, row.items())] for row in group]
        rows = [row for row in rows if len(row) > LEAST_FILL * len(most)]
        columns = {key: j for j, key in enumerate(sorted(most))}
        matrix = np.zeros((len(rows), len(columns)))
        for i, row in enumerate(rows):
            for key, (c, _) in row:
                matrix[i, columns[key]] = c
        if not is_large(matrix):
            continue
        whole = next(new)
        values.of[whole] = DenseMatrix(matrix), tuple(v for _, v in columns)
        for i, row in enumerate(rows):
            operation = ENTRY, (whole, float(i))
            (factors, _), (_, end) = row[-1]
            for name, g in factors:
                number = next(new)
                values.of[number], operation = operation, (name, (number, g))
            values.of[end] = operation


def _row(values, number, sums):
    """Return {(factors, v): (c, number of the partial sum up to c v)} for a sum of terms c v.

    `factors` are parameters that multiply or divide c, as g in (g * c) v. The row ends before the
    first term in which the number of v does not increase, or c has other factors than in the terms
    before. `sums` has the numbers of sums that are a part of one other sum.
    """
    terms, row, parts = [], {}, values.parts_of
    while not terms or number in sums:
        name, (left, a) = parts(number)
        terms.append((-1.0 if name == "fsub" else 1.0, a, number))
        number = left
    for sign, v, end in [(1.0, number, number), *reversed(terms)]:
        c, key = 1.0, ((), v)
        if parts(v)[0] == "fmul":
            c, v = parts(v)[1]
            c, v = (v, c) if type(v) is int and v in values.fixed else (c, v)
            factors = []
            while (name := parts(c)[0]) in ("fmul", "fdiv") and c in values.fixed:
                c, g = parts(c)[1]
                factors.insert(0, (name, g))
            key = tuple(factors), v
        last = next(reversed(row), (key[0], -1))
        if isinstance(v, float) or not isinstance(c, float) or key[0] != last[0] or v <= last[1]:
            break
        row[key] = sign * c, end
    return row


def products_in(operations):
    """Return (matrix, operands, {number of an entry: float(i)}) of each product, in order."""
    products, entries = [], defaultdict(dict)
    for name, number, operands in operations:
        if name == ENTRY:
            entries[operands[0]][number] = operands[1]
        elif is_matrix(name):
            products.append((name, operands, entries[number]))
    return products


def along(emit, products, rows, v, totals=()):
    """Return the changes of values along a direction v, and v extended by entries of `products`.

    v is {component: operand of its change}; the extended v also has the changes of the entries of
    `products`, products of dense matrices. `rows` are gradients: first those of the operands of
    `products`, then those of the values. `totals` are operands to add to the changes. None is 0.
    """
    v = dict(v)
    changes = (
        dot(emit, [(a, v[j]) for j, a in row.items() if j in v], total)
        for row, total in zip_longest(rows, totals)
    )
    for matrix, operands, entries in products:
        of_operands = [*islice(changes, len(operands))]
        if any(a is not None for a in of_operands):
            whole = emit(matrix, *(0.0 if a is None else a for a in of_operands))
            v |= {a: emit(ENTRY, whole, i) for a, i in entries.items()}
    return [*changes], v
