"""Vector functions of the steps of a motion: f, f', elimination.

Each is a function void name(from, table, to, scratch) of a text: it reads rows at one address, and
writes rows at another. Expression programs are straight-line code, in blocks if they are long, and
dense matrices have loops. `scratch` are rows for temporary results.
"""

import functools
from collections import defaultdict

import numpy as np

from ..expressions.dense_product import ENTRY, ROWS_AT_ONCE, is_matrix
from ..expressions.numpy_evaluation import OF_LIBRARY, OF_LISTS
from ..expressions.tolerances import OPERATIONS_OF_BLOCK
from ..llvm.compiler import numbers_in_register
from ..llvm.text import Carried, Index, Shared


class ProgramFunction:
    """An expression program as straight-line code; its first `inputs` numbers are input rows.

    `places` is {number: place in the table} of the others. A result None leaves its row as it is.
    """

    scratch = 0

    def __init__(self, program, inputs, places=None):
        self.program, self.inputs, self.places = program, inputs, places or {}
        self.length, self.operations = len(program.operations), []
        self.entries, vectors = {}, {}  # {number: scratch row}: of entries (A v)_i, and of (A v)_0
        for name, number, operands in program.operations:
            if name == ENTRY:
                self.entries[number] = vectors[operands[0]] + int(operands[1])
                continue
            self.operations.append((name, number, operands))
            if is_matrix(name):
                vectors[number], self.length = self.scratch, np.inf
                self.scratch += name.height + len(operands)
        self.vectors = vectors
        instructions = {instruction for instruction, *_ in program.operations}
        self.calls = not instructions.isdisjoint(OF_LISTS)
        self.calls_by_lane = not instructions.isdisjoint(OF_LIBRARY)

    def values(self, text, row, table, for_each):
        """Add the operations to `text`; return {place: result} for the results that are not None.

        row(k) returns input k; `table` is the address of the table.
        """
        found = {}
        load = self._loader(text, row, table, for_each)
        text.carry_out(self.program.operations, found, load)
        results = enumerate(self.program.results)
        return {k: self._result(text, a, found, load) for k, a in results if a is not None}

    def _loader(self, text, row, table, for_each):
        numbers = text.array(table) if for_each else Shared(text, table)

        def load(number):
            if number in self.entries:
                return text.array("%scratch")[self.entries[number]]
            return row(number) if number < self.inputs else numbers[self.places[number]]

        return load

    def _result(self, text, a, found, load):
        if isinstance(a, float):
            return text.value(a)
        return found[a] if a in found else load(a)

    def add(self, text, name, for_each):
        """Add the function `name` to `text`, in blocks of operations.

        LLVM's time grows with the square of a block's length. Each block reads its inputs again,
        and writes each result as soon as it is computed.
        """
        operations, rows, given = self.operations, defaultdict(list), []
        own = {number for _, number, _ in operations}
        for k, a in enumerate(self.program.results):
            if type(a) is int and a in own:
                rows[a].append(k)
            elif a is not None:  # an input, a number of the table, or a constant
                given.append((a, k))
        x, to, computed = text.array("%from"), text.array("%to"), {}
        with text.function(name):
            load = self._loader(text, lambda k: x[k], "%table", for_each)
            for k, block in enumerate(_blocks(operations)):
                if k:
                    text.next_block()
                used = {a for *_, operands in block for a in operands}
                found = {a: computed[a] for a in used if a in computed}
                if block[0][1] in self.vectors:
                    [(matrix, number, operands)] = block
                    values = [self._result(text, a, found, load) for a in operands]
                    multiply(text, matrix, values, text.array("%scratch", self.vectors[number]))
                    continue
                text.carry_out(block, found, load)
                for _, number, _ in block:
                    computed[number] = found[number]
                    for k in rows[number]:
                        to[k] = found[number]
            for begin in range(0, len(given), OPERATIONS_OF_BLOCK):
                if begin:
                    text.next_block()
                for a, k in given[begin : begin + OPERATIONS_OF_BLOCK]:
                    to[k] = self._result(text, a, {}, load)


def _blocks(operations):
    """Yield lists of few operations; a product with a dense matrix is alone in its list."""
    block = []
    for each in operations:
        if block and (
            len(block) == OPERATIONS_OF_BLOCK or is_matrix(each[0]) or is_matrix(block[0][0])
        ):
            yield block
            block = []
        block.append(each)
    if block:
        yield block


def multiply(text, matrix, values, to):
    """Write the product of a `DenseMatrix` and `values`, then the values, to the `Array` `to`.

    For one trajectory ROWS_AT_ONCE rows of the matrix are computed at a time, in vectors of rows.
    For several trajectories as many rows are computed at a time as registers hold sums. An entry is
    0 + a_i0 v_0 + a_i1 v_1 + ..., added in this order.
    """
    n, m = matrix.matrix.shape
    v = to.from_here(matrix.height)
    for j, value in enumerate(values):
        v[j] = value
    wide, rows, step = text, 64 // text.W if numbers_in_register() == 8 else 4, 1
    if text.W == 1:
        wide, rows, step = text.lanes(8), ROWS_AT_ONCE, 8
    entries = Index(text, matrix.address(rows))
    for block in text.each(-(-n // rows)):
        sums = Carried(**{f"s{k}": wide.value(0.0) for k in range(0, rows, step)})
        own = entries + block * (8 * m * rows)
        for j in text.each(m, sums):
            at = own + j * (8 * rows)
            column = (wide.array if text.W == 1 else functools.partial(Shared, text))(at)
            a = wide.splat(v[j]) if text.W == 1 else v[j]
            sums.update({key: s + column[int(key[1:])] * a for key, s in vars(sums).items()})
        for key, s in vars(sums).items():
            wide.array(to.at(block * rows))[int(key[1:])] = s


class JacobianColumns:
    """f' of an f with products of dense matrices: a column f' v for each unit vector v."""

    def __init__(self, f):
        self.f = f
        self.parts = ProgramFunction(f.derivative, f.D, f.places)
        self.inputs = len(f.linked) + f.D
        self.column = ProgramFunction(f.column, self.inputs)
        inner = max(self.parts.scratch, self.column.scratch)
        self.scratch = self.inputs + f.D + f.D * f.D + inner

    def add(self, text, name, for_each):
        D = self.f.D
        self.parts.add(text, f"{name}_parts", for_each)
        self.column.add(text, f"{name}_column", False)
        with text.function(name):
            given = text.array("%scratch")
            v, column = given.after(self.inputs - D), given.after(self.inputs)
            whole, inner = column.after(D), column.after(D + D * D)
            text.invoke(f"{name}_parts", "%from", "%table", given, inner)
            text.fill(v, D, lambda: 0.0)
            for j in text.each(D):
                v[j] = 1.0
                text.invoke(f"{name}_column", given, "0", column, inner)
                v[j] = 0.0
                for i in text.each(D):
                    whole[i * D + j] = column[i]
            places = text.constants([i * D + j for i, j in self.f.pattern])
            for k in text.each(self.f.entries):
                text.array("%to")[k] = whole[places[k]]


class SparseLoops:
    """Loops for a large J, by its `Sparse` plan: factors of 1 - s J, or v in (1 - s J) v = g."""

    def __init__(self, plan, add):
        self.plan, self.add_function, self.scratch = plan, add, len(plan.order)

    def add(self, text, name, for_each):
        self.add_function(text, name, self.plan)


class DenseQuadratic:
    """f, or f' if `is_derivative`, of a dense quadratic field: sums over all its coefficients.

    f_i = c_i + sum_j x_j (l_ij + sum_k q_ijk x_k) with symmetric q; the table has, for each
    component, c_i, l_ij for all j, and q_ijk for all j and k.
    """

    length, scratch = np.inf, 0

    def __init__(self, D, is_derivative):
        self.D, self.is_derivative = D, is_derivative

    def add(self, text, name, for_each):
        D, x, f = self.D, text.array("%from"), text.array("%to")
        numbers = text.array("%table") if for_each else Shared(text, "%table")

        def linear_and_sum(coefficients, j):
            """Return l_ij and sum_k q_ijk x_k, factors of x_j in f_i with these `coefficients`."""
            q, sums = coefficients.from_here(j * D + (1 + D)), Carried(total=0.0)
            for k in text.each(D, sums):
                sums.total = sums.total + q[k] * x[k]
            return coefficients.after(1)[j], sums.total

        with text.function(name):
            for i in text.each(D):
                own = numbers.from_here(i * (1 + D + D * D))
                if self.is_derivative:
                    for j in text.each(D):
                        linear, total = linear_and_sum(own, j)
                        f[i * D + j] = linear + (total + total)
                    continue
                sums = Carried(f=own[0])
                for j in text.each(D, sums):
                    linear, total = linear_and_sum(own, j)
                    sums.f = sums.f + (linear + total) * x[j]
                f[i] = sums.f
