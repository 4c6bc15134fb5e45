"""Functions of rows, of which the steps of the motion are made: f, f', elimination, products.

Each is a function void name(from, table, to, scratch) of a text: it reads rows at one address, and
writes rows at another. Short lists of operations are straight-line code, long ones are runs
(`code.runs`), and dense matrices have loops. `numbers(table)` are the `reads` numbers that it reads
after the table of f, and `scratch` the rows that it needs for itself.
"""

import math
from collections import defaultdict

import numpy as np

from ..code.runs import program_of
from ..code.runs_code import add_runs
from ..code.sparse_code import ARRAYS, Arrays, add_factors, add_solution, lengths_of
from ..code.text import WRITTEN_OUT, Carried, Index, Shared
from ..lists.right_hand_side import renumbered
from ..lists.step import OF_LIBRARY, OF_LISTS

INLINED = 160  # operations of f that stand within the loop of sub-steps, rather than a call
BLOCK = 64  # operations of a block of straight-line code
# Operations of straight-line code: 20 us each to compile, 80 with optimisation. Steps take 2 to 4
# times as long with runs, or with loops over banded matrices.
LONGEST = 20_000


class OfList:
    """A list of operations as straight-line code; its first values are rows.

    Results that are None are not there: their rows stay as they are.
    """

    scratch, reads, called = 0, 0, frozenset()

    def __init__(self, list_, inputs, places):
        self.list_, self.inputs, self.places = list_, inputs, places
        self.length = len(list_.operations)
        instructions = {instruction for instruction, *_ in list_.operations}
        self.calls = not instructions.isdisjoint(OF_LISTS)
        self.calls_by_lane = not instructions.isdisjoint(OF_LIBRARY)

    def numbers(self, table):
        return table[:0]

    def values(self, text, row, table, for_each):
        """Return the results by their places, where row(k) is the k-th input."""
        found = {}
        load = self._loader(text, row, table, for_each)
        text.carry_out(self.list_.operations, found, load)
        results = enumerate(self.list_.results)
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

    def add(self, text, name, for_each, first):
        """Add the function, in blocks of operations: LLVM's time grows with the square of a block.

        Inputs are read anew in each block, and results written where they are found.
        """
        operations, rows, given = self.list_.operations, defaultdict(list), []
        own = {number for _, number, _ in operations}
        for k, a in enumerate(self.list_.results):
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
            copies = [(a, k) for a, k in given if type(a) is int and a < self.inputs]
            if len(copies) > BLOCK:
                sources, targets = map(text.constants, zip(*copies, strict=True))
                for k in text.each(len(copies)):
                    to[targets[k]] = x[sources[k]]
                given = [(a, k) for a, k in given if isinstance(a, float) or a >= self.inputs]
            for begin in range(0, len(given), BLOCK):
                if begin:
                    text.next_block()
                for a, k in given[begin : begin + BLOCK]:
                    to[k] = self._result(text, a, {}, load)


class OfLongList:
    """A list of operations that runs carry out, on rows of their own."""

    length = np.inf  # it has no code of its own

    def __init__(self, list_, inputs, places):
        self.list_, self.inputs, self.results = list_, inputs, list_.results
        table, operations = sorted(places, key=places.get), [*list_.operations]
        # Constants among the results are values, too: LLVM takes long to compile a store of each.
        values = {
            k: a.hex() if isinstance(a, float) else a
            for k, a in enumerate(self.results)
            if a is not None
        }
        constants = dict.fromkeys(a for a in values.values() if isinstance(a, str))
        first = 1 + max([inputs, *places, *(number for _, number, _ in operations)])
        for number, a in enumerate(constants, first):
            constants[a] = number
            operations.append(("fadd", number, (float.fromhex(a), -0.0)))
        values = {k: constants.get(a, a) for k, a in values.items()}
        distinct = [*dict.fromkeys(values.values())]
        self.program, self._numbers = program_of(range(inputs), table, operations, distinct)
        row = dict(zip(distinct, self.program.results.tolist(), strict=True))
        self._rows = {k: row[a] for k, a in values.items()}
        self.scratch, self.in_table = self.program.rows, len(table)
        self.reads = self._numbers.count
        self.called = {instruction for instruction, *_ in list_.operations}

    def numbers(self, table):
        shape = table.shape[1:]
        own = table[: self.in_table].reshape(self.in_table, math.prod(shape))
        return self._numbers.of(own).reshape(-1, *shape)

    def add(self, text, name, for_each, first):
        if not text.has_runs:
            text.has_runs = True
            add_runs(text, "runs", for_each, text.called)
        runs, size = self.program.runs, text.size if for_each else 8
        rows, to = text.array("%scratch"), text.array("%to")
        with text.function(name):
            heads, places = (text.constants(each).base for each in runs)
            table = Index(text, "%table") + size * first
            text.copy("%from", rows, self.inputs)
            text.invoke("runs", rows, table, heads, places, len(runs.heads))
            places = text.constants([*self._rows.values()])
            targets = text.constants([*self._rows])
            for k in text.each(len(self._rows)):
                to[targets[k]] = rows[places[k]]


def of_list(list_, inputs, places=None):
    """Return the function of a list of any length, by runs if it is long."""
    kind = OfList if len(list_.operations) <= LONGEST else OfLongList
    return kind(list_, inputs, places or {})


_ADDRESSES = "%from", "%table", "%to", "%scratch"


class _Loops:
    """A function that is written as loops; it may call others, `parts`, by their names.

    `own` are the rows of its scratch before those of the parts.
    """

    length, own, parts = np.inf, 0, {}
    scratch = property(
        lambda self: self.own + max((a.scratch for a in self.parts.values()), default=0)
    )
    reads = property(lambda self: sum(part.reads for part in self.parts.values()))
    called = property(lambda self: frozenset().union(*(a.called for a in self.parts.values())))

    def numbers(self, table):
        return np.concatenate([table[:0], *(part.numbers(table) for part in self.parts.values())])

    def add(self, text, name, for_each, first):
        """Add the parts as functions name_part, and the function itself, whose text is `write`."""
        for key, part in self.parts.items():
            part.add(text, f"{name}_{key}", for_each, first)
            first += part.reads
        with text.function(name):
            self.write(text, name, for_each)


class Tangents(_Loops):
    """f of a `Variational`: its base list, then f' times each column, from rows in between.

    Of each block of components it has those in `own`, and leaves others as they are.
    """

    def __init__(self, f, base, product, own):
        self.f, self.inputs, self.rows = f, f.of.D, own
        first = of_list(base, self.inputs, f.places)
        product = of_list(product, f.entries + 1 + self.inputs)
        self.parts = {"first": first, "product": product}
        self.own = len(f.base.results) + 1 + self.inputs
        self.length = max(INLINED + 1, first.length, product.length)

    def write(self, text, name, for_each):
        f, D = self.f, self.inputs
        extended, of_parameters = D + len(f.denominators), f.before - f.q * D
        x, found, to = (text.array(f"%{each}") for each in ("from", "scratch", "to"))
        entries, vector = f.before, f.before + f.entries + 1
        inner = found.at(self.own)
        text.invoke(f"{name}_first", x, "%table", found, inner)
        own = text.listed(self.rows)
        for i in own():
            to[i] = found[i]
        for k in range(D, extended):
            to[f.D - D + k] = found[k]
        for c in text.each(f.columns, most=WRITTEN_OUT):
            place = (c + 1) * D
            text.copy(x.at(place), found.at(vector), D)
            text.invoke(f"{name}_product", found.at(entries), "%table", to.at(place), inner)
        last = to.after(f.D - 2 * f.has_trace - f.q * D)
        for c in text.each(f.q, most=WRITTEN_OUT):
            for i in own():
                k = i + c * D
                a = found.after(of_parameters)[k]
                last[k] = last[k] + a
        if f.has_trace:
            to[f.D - 2] = 0.0
            to[f.D - 1] = x[f.D - 2] * found[extended]


class TangentEntries(_Loops):
    """The derivative of a `Variational` for implicit steps: f', and the couplings.

    Entries of f' come first, those of the couplings from the row `after` on.
    """

    def __init__(self, f, after):
        D, second = f.of.D, f.of.second
        self.f, self.D, self.after = f, D, after
        of_table = {number: 2 * D + place for number, place in f.of.places.items()}
        given = {i: i for i in range(D)} | of_table
        given |= {number: D + k for k, number in enumerate(second.directions)}
        places = {number: number - 2 * D for number in of_table.values()}
        second = of_list(renumbered(second.entries, given), 2 * D, places)
        self.parts = {"first": of_list(f.derivative, D, f.places), "second": second}
        self.own = len(f.derivative.results) + 2 * D

    def write(self, text, name, for_each):
        f, D, entries = self.f, self.D, self.f.entries
        x, found, to = (text.array(f"%{each}") for each in ("from", "scratch", "to"))
        pair = len(f.derivative.results)
        inner = found.at(self.own)
        text.invoke(f"{name}_first", x, "%table", found, inner)
        text.copy(found, to, entries)
        line = found.from_here(pair)
        text.copy(x, line, D)
        for c in text.each(f.columns):
            own = x.after(D).at(c * D)
            text.copy(own, line.at(D), D)
            of_column = to.after(self.after).at(c * f.coupling)
            text.invoke(f"{name}_second", line, "%table", of_column, inner)
        last = to.after(self.after + (f.columns - f.q) * f.coupling)
        for k in text.each(f.q * f.coupling):
            a = found.after(entries)[k]
            last[k] = last[k] + a


class TangentFactors(_Loops):
    """The factors of a block, and s times the entries of the couplings from the row `to` on.

    The entries of f' come first, those of the couplings from the row `after` on.
    """

    def __init__(self, factors, to, entries, after, couplings):
        self.parts, self.to, self.entries = {"block": factors}, to, entries
        self.after, self.couplings = after, couplings

    def write(self, text, name, for_each):
        text.invoke(f"{name}_block", *_ADDRESSES)
        entries = text.array("%from")
        own, to = entries.after(self.after), text.array("%to", self.to)
        s = entries[self.entries]
        for k in text.each(self.couplings):
            to[k] = s * own[k]


class FirstBlock(_Loops):
    """A function of the first of equal blocks, and 0 for the others, `rows` in all."""

    def __init__(self, function, D, rows):
        self.parts, self.D, self.rows = {"block": function}, D, rows

    def write(self, text, name, for_each):
        text.invoke(f"{name}_block", *_ADDRESSES)
        for k in text.each(self.rows - self.D):
            text.array("%to", self.D)[k] = 0.0


class Blocks(_Loops):
    """The solution for x, and for columns beside it, in place of the right-hand side.

    `count` factors of a block stand before the right-hand side, and s times the entries of the
    couplings after it; products of these and the solution for x are added to the columns first.
    Rows after the blocks stay as they are.
    """

    def __init__(self, solution, count, f, pattern):
        self.parts, self.count, self.columns = {"block": solution}, count, f.columns
        self.own = self.D = f.of.D
        self.pattern, self.after = pattern, count + f.D

    def write(self, text, name, for_each):
        """Write the loops; solutions read a block at `%to`."""
        D, size = self.D, len(self.pattern)
        kept, to = text.array("%scratch"), text.array("%to")
        couplings = text.array("%from", self.after)

        def solve(right):
            text.invoke(f"{name}_block", "%from", "%table", right, kept.after(D))

        solve("%to")
        text.copy(to, kept, D)
        for c in text.each(self.columns):
            own = to.at((c + 1) * D)
            text.copy(own, to, D)
            entries = couplings.from_here(c * size)
            for k, (i, j) in enumerate(self.pattern):
                product = entries[k] * kept[j]
                to[i] = to[i] + product
            solve(own)
        text.copy(kept, to, D)


class SparseFactors(_Loops):
    """The factors of 1 - s J by loops, for entries of J in some places, see `sparse_code`."""

    add_function = staticmethod(add_factors)

    def __init__(self, plan):
        self.plan, self.own = plan, len(plan.order)

    def add(self, text, name, for_each, first):
        plan = self.plan

        def arrays_of(*names):
            lengths = [Index(text, n) for n in lengths_of(plan)]
            arrays = {k: text.constants(getattr(plan, k)).base for k in names}
            return Arrays(*lengths, *(arrays.get(k) for k in ARRAYS))

        self.add_function(text, name, arrays_of)


class SparseSolution(SparseFactors):
    """The solution of (1 - s J) v = g from these factors, in place of g."""

    add_function = staticmethod(add_solution)


class DenseQuadratic(_Loops):
    """f, or f', of a dense quadratic field: sums over all its coefficients.

    f_i = c_i + sum_j x_j (l_ij + sum_k q_ijk x_k) with symmetric q; in the table each component has
    c_i, l_ij for all j, and q_ijk for all j and k.
    """

    def __init__(self, D, is_derivative):
        self.D, self.is_derivative = D, is_derivative

    def write(self, text, name, for_each):
        D, x, f = self.D, text.array("%from"), text.array("%to")
        numbers = text.array("%table") if for_each else Shared(text, "%table")

        def linear_and_sum(own, j):
            """Return l_ij, and the sum of q_ijk x_k."""
            q, sums = own.from_here(j * D + (1 + D)), Carried(total=0.0)
            for k in text.each(D, sums):
                sums.total = sums.total + q[k] * x[k]
            return own.after(1)[j], sums.total

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


class DenseProduct(_Loops):
    """f' times a vector, for all entries of f' in rows, s, and the vector."""

    def __init__(self, D):
        self.D = D

    def write(self, text, name, for_each):
        D, f = self.D, text.array("%to")
        entries, vector = text.array("%from"), text.array("%from", D * D + 1)
        for i in text.each(D):
            sums = Carried(total=0.0)
            for j in text.each(D, sums):
                sums.total = sums.total + entries[i * D + j] * vector[j]
            f[i] = sums.total
