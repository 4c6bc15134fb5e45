"""Vector functions of the steps of a motion: f, f', elimination.

Each is a function void name(from, table, to, scratch) of a text: it reads rows at one address, and
writes rows at another. Expression programs are straight-line code, in blocks if they are long, and
dense matrices have loops. `scratch` are rows for temporary results.
"""

from collections import defaultdict

import numpy as np

from ..expressions.numpy_evaluation import OF_LIBRARY, OF_LISTS
from ..llvm.text import Carried, Shared

INLINED = 160  # operations of f that stand within the loop of sub-steps, rather than a call
BLOCK = 64  # operations of a block of straight-line code
# Operations of straight-line code: 20 us each to compile, 80 with optimisation. Steps take 2 to 4
# times as long with runs, or with loops over banded matrices.
LONGEST = 20_000


class ProgramFunction:
    """An expression program as straight-line code; its first `inputs` numbers are input rows.

    `places` is {number: place in the table} of other inputs. A result None leaves its row as it is.
    """

    scratch = 0

    def __init__(self, program, inputs, places=None):
        self.program, self.inputs, self.places = program, inputs, places or {}
        self.length = len(program.operations)
        instructions = {instruction for instruction, *_ in program.operations}
        self.calls = not instructions.isdisjoint(OF_LISTS)
        self.calls_by_lane = not instructions.isdisjoint(OF_LIBRARY)

    def values(self, text, row, table, for_each):
        """Add the operations to `text`; return {place: result} for the results that are not None.

        row(k) returns input k. `table` is the address of a table, one for each lane if `for_each`.
        """
        found = {}
        load = self._loader(text, row, table, for_each)
        text.carry_out(self.program.operations, found, load)
        results = enumerate(self.program.results)
        return {k: self._result(text, a, found, load) for k, a in results if a is not None}

    def _loader(self, text, row, table, for_each):
        numbers = text.array(table) if for_each else Shared(text, table)

        def load(number):
            return row(number) if number < self.inputs else numbers[self.places[number]]

        return load

    def _result(self, text, a, found, load):
        if isinstance(a, float):
            return text.value(a)
        return found[a] if a in found else load(a)

    def add(self, text, name, for_each):
        """Add the function `name` to `text`, in blocks of operations.

        LLVM's time grows with the square of a block. Each block reads its inputs again, and writes
        each result as soon as it is computed. If `for_each` is True, each lane has a table.
        """
        operations, rows, given = self.program.operations, defaultdict(list), []
        own = {number for _, number, _ in operations}
        for k, a in enumerate(self.program.results):
            if type(a) is int and a in own:
                rows[a].append(k)
            elif a is not None:  # an input, a number of the table, or a constant
                given.append((a, k))
        x, to, computed = text.array("%from"), text.array("%to"), {}
        with text.function(name):
            load = self._loader(text, lambda k: x[k], "%table", for_each)
            for begin in range(0, len(operations), BLOCK):
                if begin:
                    text.next_block()
                block = operations[begin : begin + BLOCK]
                used = {a for *_, operands in block for a in operands}
                found = {a: computed[a] for a in used if a in computed}
                text.carry_out(block, found, load)
                for _, number, _ in block:
                    computed[number] = found[number]
                    for k in rows[number]:
                        to[k] = found[number]
            for begin in range(0, len(given), BLOCK):
                if begin:
                    text.next_block()
                for a, k in given[begin : begin + BLOCK]:
                    to[k] = self._result(text, a, {}, load)


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
        with text.function(name):
            self._write(text, for_each)

    def _write(self, text, for_each):
        D, x, f = self.D, text.array("%from"), text.array("%to")
        numbers = text.array("%table") if for_each else Shared(text, "%table")

        def linear_and_sum(coefficients, j):
            """Return l_ij and sum_k q_ijk x_k, factors of x_j in f_i with these `coefficients`."""
            q, sums = coefficients.from_here(j * D + (1 + D)), Carried(total=0.0)
            for k in text.each(D, sums):
                sums.total = sums.total + q[k] * x[k]
            return coefficients.after(1)[j], sums.total

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
