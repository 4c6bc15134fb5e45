"""Functions of rows, of which the steps of the motion are made: f, f', elimination, products.

Each is a function void name(from, table, to, scratch) of a text: it reads rows at one address, and
writes rows at another. Short lists of operations are straight-line code, long ones are runs
(`listed`), and dense matrices have loops. `numbers(table)` are those that a function reads after
the table of f, and `scratch` the rows that it needs for itself.
"""

import math
from collections import defaultdict

import numpy as np

from ..code.runs import program_of
from ..code.runs_code import add_runs
from ..lists.right_hand_side import renumbered
from ..lists.step import OF_LIBRARY, OF_LISTS, evaluate

INLINED = 160  # operations of f that stand within the loop of sub-steps, rather than a call
BLOCK = 64  # operations of a block of straight-line code
LONGEST = 4000  # operations of straight-line code: a longer list takes seconds to compile


def carried_out(list_, rows):
    """Return the results (-, ...) of a list for its inputs (-, ...), by NumPy."""
    values = dict(enumerate(rows))
    evaluate(list_.operations, values)
    shape = np.shape(rows[0])
    return np.array([np.full(shape, a) if isinstance(a, float) else values[a]
                     for a in list_.results])  # fmt: skip


class OfList:
    """A list of operations as straight-line code; its first values are rows."""

    scratch, called = 0, frozenset()

    def __init__(self, list_, inputs, places):
        self.list_, self.inputs, self.places = list_, inputs, places
        self.length = len(list_.operations)
        instructions = {instruction for instruction, *_ in list_.operations}
        self.calls = not instructions.isdisjoint(OF_LISTS)
        self.calls_by_lane = not instructions.isdisjoint(OF_LIBRARY)

    def numbers(self, table):
        return table[:0]

    def in_numpy(self, rows):
        """Return the results (-, ...) for rows (-, ...), without a table."""
        return carried_out(self.list_, rows)

    def values(self, text, row, table, for_each):
        """Return the results, where row(k) is the k-th input."""
        found = {}
        load = self._loader(text, row, table, for_each)
        text.carry_out(self.list_.operations, found, load)
        return [self._result(text, a, found, load) for a in self.list_.results]

    def _loader(self, text, row, table, for_each):
        def load(number):
            if number < self.inputs:
                return row(number)
            place = self.places[number]
            return text.row(table, place) if for_each else text.shared(text.plus(table, 8 * place))

        return load

    def _result(self, text, a, found, load):
        if isinstance(a, float):
            return text.constant(a)
        return found[a] if a in found else load(a)

    def add(self, text, name, for_each, first):
        """Add the function, in blocks of operations: LLVM's time grows with the square of a block.

        Inputs are read anew in each block, and results written where they are found.
        """
        operations, results = self.list_.operations, self.list_.results
        rows, constants = defaultdict(list), []  # 1 is a number of a value, 1.0 a constant
        for k, a in enumerate(results):
            if isinstance(a, float):
                constants.append((a, [k]))
            else:
                rows[a].append(k)
        with text.function(name):
            load = self._loader(text, lambda k: text.row("%from", k), "%table", for_each)
            computed = {}
            for begin in range(0, len(operations), BLOCK):
                if begin:
                    text.next_block()
                block, found = operations[begin : begin + BLOCK], computed.copy()
                text.carry_out(block, found, load)
                for _, number, _ in block:
                    computed[number] = found[number]
                    for k in rows.pop(number, ()):
                        text.put(found[number], "%to", k)
            for a, places in [*rows.items(), *constants]:
                for k in places:
                    text.put(self._result(text, a, {}, load), "%to", k)


class OfLongList:
    """A list of operations that runs carry out, on rows of their own."""

    length = np.inf  # it has no code of its own

    def __init__(self, list_, inputs, places):
        self.list_, self.inputs, self.results = list_, inputs, list_.results
        of_values = [*dict.fromkeys(a for a in self.results if not isinstance(a, float))]
        table = sorted(places, key=places.get)
        self.program, self._numbers = program_of(range(inputs), table, list_.operations, of_values)
        self._row = dict(zip(of_values, self.program.results.tolist(), strict=True))
        self.scratch, self.in_table = self.program.rows, len(table)
        self.called = {instruction for instruction, *_ in list_.operations}

    def numbers(self, table):
        shape = table.shape[1:]
        own = table[: self.in_table].reshape(self.in_table, math.prod(shape))
        return self._numbers.of(own).reshape(-1, *shape)

    def in_numpy(self, rows):
        return carried_out(self.list_, rows)

    def add(self, text, name, for_each, first):
        if not text.has_runs:
            text.has_runs = True
            add_runs(text, "runs", for_each, text.called)
        runs, size = self.program.runs, text.size if for_each else 8
        with text.function(name):
            heads, places = (
                text.integers(f"{name}_{k}", array).base for k, array in enumerate(runs)
            )
            table = text.plus("%table", size * first)
            text.copy("%from", "%scratch", self.inputs)
            numbers = ", ".join(f"i64 {a}" for a in ("%scratch", table, heads, places))
            text.add(f"  call void @runs({numbers}, i64 {len(runs.heads)})")
            is_value = [not isinstance(a, float) for a in self.results]
            if all(is_value):
                rows = np.array([self._row[a] for a in self.results])
                rows = text.integers(f"{name}_rows", rows).base

                def move(k):
                    row = text.load("i64", text.at(rows, k))
                    text.put(text.row("%scratch", 0, row), "%to", 0, k)

                text.fold(len(self.results), {}, move)
                return
            for k, a in enumerate(self.results):
                constant = isinstance(a, float)
                value = text.constant(a) if constant else text.row("%scratch", self._row[a])
                text.put(value, "%to", k)


def of_list(list_, inputs, places=None):
    """Return the function of a list of any length."""
    kind = OfList if len(list_.operations) <= LONGEST else OfLongList
    return kind(list_, inputs, places or {})


_ADDRESSES = "i64 %from, i64 %table, i64 %to, i64 %scratch"


class _Loops:
    """A function that is written as loops."""

    length, scratch, called = np.inf, 0, frozenset()

    def numbers(self, table):
        return table[:0]


class Tangents(_Loops):
    """f of a `Variational`: its base list, then f' times each column, from rows in between."""

    def __init__(self, f, product):
        self.f, self.inputs = f, f.of.D
        self.first = of_list(f.base, self.inputs, f.places)
        self.product = of_list(product, f.entries + 1 + self.inputs)
        self.own = len(f.base.results) + 1 + self.inputs
        parts = self.first, self.product
        self.scratch = self.own + max(part.scratch for part in parts)
        self.called = {name for part in parts for name in part.called}
        self.length = max(INLINED + 1, *(part.length for part in parts))

    def numbers(self, table):
        return np.concatenate([self.first.numbers(table), self.product.numbers(table)])

    def add(self, text, name, for_each, first):
        f, D, integer = self.f, self.inputs, text.integer
        self.first.add(text, f"{name}_first", for_each, first)
        later = first + len(self.first.numbers(np.zeros(len(f.table))))
        self.product.add(text, f"{name}_product", for_each, later)
        entries, vector = f.before, f.before + f.entries + 1
        extended, of_parameters = D + len(f.denominators), f.before - f.q * D

        def call(function, *addresses):
            numbers = ", ".join(f"i64 {a}" for a in (*addresses, inner))
            text.add(f"  call void @{name}_{function}({numbers})")

        with text.function(name):
            inner = text.place("%scratch", self.own)
            call("first", "%from", "%table", "%scratch")
            text.copy("%scratch", "%to", D)
            for k in range(D, extended):
                text.put(text.row("%scratch", k), "%to", f.D - D + k)

            def column(c):
                place = integer("mul", integer("add", c, 1), D)
                at = text.place("%scratch", vector)
                text.copy(text.place("%from", 0, place), at, D)
                call(
                    "product",
                    text.place("%scratch", entries),
                    "%table",
                    text.place("%to", 0, place),
                )

            text.fold(f.columns, {}, column)
            own = f.D - 2 * f.has_trace - f.q * D

            def add(k):
                a = text.row("%scratch", of_parameters, k)
                text.put(text.operate("fadd", text.row("%to", own, k), a), "%to", own, k)

            if f.q:
                text.fold(f.q * D, {}, add)
            if f.has_trace:
                text.put(text.constant(0.0), "%to", f.D - 2)
                s = text.operate("fmul", text.row("%from", f.D - 2), text.row("%scratch", extended))
                text.put(s, "%to", f.D - 1)


class TangentEntries(_Loops):
    """What implicit steps take for the derivative of a `Variational`: f', and the couplings.

    Entries of f' come first, those of the couplings from the row `after` on.
    """

    def __init__(self, f, after):
        D, second = f.of.D, f.of.second
        self.f, self.D, self.after = f, D, after
        self.first = of_list(f.derivative, D, f.places)
        of_table = {number: 2 * D + place for number, place in f.of.places.items()}
        given = {i: i for i in range(D)} | of_table
        given |= {number: D + k for k, number in enumerate(second.directions)}
        places = {number: number - 2 * D for number in of_table.values()}
        self.second = of_list(renumbered(second.entries, given), 2 * D, places)
        self.own = len(f.derivative.results) + 2 * D
        parts = self.first, self.second
        self.scratch = self.own + max(part.scratch for part in parts)
        self.called = {name for part in parts for name in part.called}

    def numbers(self, table):
        return np.concatenate([self.first.numbers(table), self.second.numbers(table)])

    def add(self, text, name, for_each, first):
        f, D, integer, entries = self.f, self.D, text.integer, self.f.entries
        self.first.add(text, f"{name}_first", for_each, first)
        later = first + len(self.first.numbers(np.zeros(len(f.table))))
        self.second.add(text, f"{name}_second", for_each, later)
        pair = len(f.derivative.results)
        with text.function(name):
            inner = text.place("%scratch", self.own)
            call = f"  call void @{name}_{{}}(i64 {{}}, i64 %table, i64 {{}}, i64 {inner})"
            text.add(call.format("first", "%from", "%scratch"))
            text.copy("%scratch", "%to", entries)
            line = text.place("%scratch", pair)
            text.copy("%from", line, D)

            def column(c):
                own = text.place("%from", D, integer("mul", c, D))
                text.copy(own, text.place(line, D), D)
                to = text.place("%to", self.after, integer("mul", c, f.coupling))
                text.add(call.format("second", line, to))

            text.fold(f.columns, {}, column)
            last = self.after + (f.columns - f.q) * f.coupling

            def add(k):
                a = text.row("%scratch", entries, k)
                text.put(text.operate("fadd", text.row("%to", last, k), a), "%to", last, k)

            if f.q:
                text.fold(f.q * f.coupling, {}, add)


class TangentFactors(_Loops):
    """The factors of a block, and s times the entries of the couplings from the row `to` on.

    The entries of f' come first, those of the couplings from the row `after` on.
    """

    def __init__(self, factors, to, entries, after, couplings):
        self.factors, self.to, self.entries = factors, to, entries
        self.after, self.couplings = after, couplings
        self.scratch, self.called = factors.scratch, factors.called

    def numbers(self, table):
        return self.factors.numbers(table)

    def in_numpy(self, rows):
        """Return both for the entries of f', those of the couplings, and s, as rows."""
        *own, s = rows
        factors = self.factors.in_numpy([*own[: self.entries], s])
        return np.concatenate([factors, s * np.array(own[self.entries :])])

    def add(self, text, name, for_each, first):
        self.factors.add(text, f"{name}_block", for_each, first)
        with text.function(name):
            text.add(f"  call void @{name}_block({_ADDRESSES})")
            s = text.row("%from", self.entries)

            def scale(k):
                product = text.operate("fmul", s, text.row("%from", self.after, k))
                text.put(product, "%to", self.to, k)

            text.fold(self.couplings, {}, scale)


class FirstBlock(_Loops):
    """A function of the first of equal blocks, and 0 for the others, `rows` in all."""

    def __init__(self, function, D, rows):
        self.function, self.D, self.rows = function, D, rows
        self.scratch, self.called = function.scratch, function.called

    def numbers(self, table):
        return self.function.numbers(table)

    def in_numpy(self, rows):
        found = np.zeros((self.rows, *np.shape(rows[0])))
        found[: self.D] = self.function.in_numpy(rows)
        return found

    def add(self, text, name, for_each, first):
        self.function.add(text, f"{name}_block", for_each, first)
        with text.function(name):
            text.add(f"  call void @{name}_block({_ADDRESSES})")
            zero = text.constant(0.0)
            text.fold(self.rows - self.D, {}, lambda k: text.put(zero, "%to", self.D, k))


class Blocks(_Loops):
    """The solution for x, and for columns beside it, in place of the right-hand side.

    `count` factors of a block stand before the right-hand side, and s times the entries of the
    couplings after it; products of these and the solution for x are added to the columns first.
    Rows after the blocks stay as they are.
    """

    def __init__(self, solution, count, f, pattern):
        self.solution, self.count, self.D, self.columns = solution, count, f.of.D, f.columns
        self.pattern, self.after = pattern, count + f.D
        self.scratch, self.called = self.D + solution.scratch, solution.called

    def numbers(self, table):
        return self.solution.numbers(table)

    def in_numpy(self, rows):
        """Return the solution for factors, couplings and the right-hand side, as rows."""
        D, size = self.D, len(self.pattern)
        end = self.count + size * self.columns
        factors, couplings, right = rows[: self.count], rows[self.count : end], np.array(rows[end:])
        right[:D] = x = self.solution.in_numpy([*factors, *right[:D]])
        for c in range(self.columns):
            own = right[D * (1 + c) : D * (2 + c)]
            for (i, j), entry in zip(self.pattern, couplings[c * size :], strict=False):
                own[i] = own[i] + entry * x[j]
            own[:] = self.solution.in_numpy([*factors, *own])
        return right

    def add(self, text, name, for_each, first):
        """Add the function; solutions read a block at `%to`."""
        self.solution.add(text, f"{name}_block", for_each, first)
        D, kept, integer, size = self.D, "%scratch", text.integer, len(self.pattern)

        def solve(to):
            inner = text.place("%scratch", D)
            text.add(f"  call void @{name}_block(i64 %from, i64 %table, i64 {to}, i64 {inner})")

        def block(c):
            own = text.place("%to", 0, integer("mul", integer("add", c, 1), D))
            text.copy(own, "%to", D)
            entries = text.place("%from", self.after, integer("mul", c, size))
            for k, (i, j) in enumerate(self.pattern):
                product = text.operate("fmul", text.row(entries, k), text.row(kept, j))
                text.put(text.operate("fadd", text.row("%to", i), product), "%to", i)
            solve(own)

        with text.function(name):
            solve("%to")
            text.copy("%to", kept, D)
            text.fold(self.columns, {}, block)
            text.copy(kept, "%to", D)


class DenseFactors(_Loops):
    """The factors of 1 - s J in a dense matrix, by rows, for entries of J in some places.

    After the matrix (D D) come the inverses of pivots (D).
    """

    def __init__(self, pattern, D):
        self.places, self.D = np.array([i * D + j for i, j in pattern], np.int64), D

    def in_numpy(self, rows):
        """Return the factors for entries of J and s, as rows."""
        D, (*entries, s) = self.D, rows
        a = np.zeros((D, D, *np.shape(s)))
        for place, entry in zip(self.places.tolist(), entries, strict=True):
            a[divmod(place, D)] = 0.0 - s * entry
        inverse = np.empty((D, *np.shape(s)))
        for i in range(D):
            a[i, i] = 1.0 + a[i, i]
            for k in range(i):
                a[i, k] = a[i, k] * inverse[k]
                a[i, k + 1 :] = a[i, k + 1 :] - a[i, k] * a[k, k + 1 :]
            inverse[i] = 1.0 / a[i, i]
        return np.concatenate([a.reshape(D * D, *np.shape(s)), inverse])

    def add(self, text, name, for_each, first):
        D, zero, one = self.D, text.constant(0.0), text.constant(1.0)
        integer = text.integer

        def entry(i, j):
            return text.place("%to", 0, integer("add", integer("mul", i, D), j))

        with text.function(name):
            text.fold(D * D, {}, lambda k: text.put(zero, "%to", 0, k))
            if len(self.places):
                s = text.row("%from", len(self.places))
                places = text.integers(f"{name}_places", self.places).base

                def put(k):
                    place = text.load("i64", text.at(places, k))
                    product = text.operate("fmul", s, text.row("%from", 0, k))
                    text.put(text.operate("fsub", zero, product), "%to", 0, place)

                text.fold(len(self.places), {}, put)

            def row(i):
                diagonal = entry(i, i)
                text.store(text.V, text.operate("fadd", one, text.load(text.V, diagonal)), diagonal)

                def eliminate(k):
                    place = entry(i, k)
                    inverse = text.row("%to", D * D, k)
                    factor = text.operate("fmul", text.load(text.V, place), inverse)
                    text.store(text.V, factor, place)
                    own, other = entry(i, k), entry(k, k)

                    def subtract(j):
                        offset = integer("mul", integer("add", j, 1), text.size)
                        at = integer("add", own, offset)
                        a = text.load(text.V, integer("add", other, offset))
                        product = text.operate("fmul", factor, a)
                        value = text.operate("fsub", text.load(text.V, at), product)
                        text.store(text.V, value, at)

                    text.fold(integer("sub", D - 1, k), {}, subtract)

                with text.when(text.compare_integers("ne", i, 0)):
                    text.fold(i, {}, eliminate)
                inverse = text.operate("fdiv", one, text.load(text.V, entry(i, i)))
                text.put(inverse, "%to", D * D, i)

            text.fold(D, {}, row)


class DenseSolution(_Loops):
    """The solution of (1 - s J) v = g from dense factors, in place of g."""

    def __init__(self, D):
        self.D = D

    def in_numpy(self, rows):
        """Return v for the factors and g, as rows."""
        D = self.D
        a, inverse, v = rows[: D * D], rows[D * D : D * D + D], np.array(rows[D * D + D :])
        for i in range(1, D):
            for j in range(i):
                v[i] = v[i] - a[i * D + j] * v[j]
        for i in reversed(range(D)):
            for j in range(i + 1, D):
                v[i] = v[i] - a[i * D + j] * v[j]
            v[i] = v[i] * inverse[i]
        return v

    def add(self, text, name, for_each, first):
        D, integer = self.D, text.integer

        def less(i, start, count, begin):
            """Return g_i less the products of a row, from its column `begin` on."""

            def product(k, total):
                j = integer("add", begin, k)
                place = integer("add", integer("mul", i, D), j)
                a = text.operate("fmul", text.row("%from", 0, place), text.row("%to", 0, j))
                return {"total": text.operate("fsub", total, a)}

            return text.fold(count, {"total": start}, product)["total"]

        def forward(n):
            i = integer("add", n, 1)
            text.put(less(i, text.row("%to", 0, i), i, 0), "%to", 0, i)

        def backward(n):
            i = integer("sub", D - 2, n)
            count = integer("add", n, 1)
            value = less(i, text.row("%to", 0, i), count, integer("add", i, 1))
            text.put(text.operate("fmul", value, text.row("%from", D * D, i)), "%to", 0, i)

        with text.function(name):
            if D > 1:
                text.fold(D - 1, {}, forward)
            last = text.operate("fmul", text.row("%to", D - 1), text.row("%from", D * D + D - 1))
            text.put(last, "%to", D - 1)
            if D > 1:
                text.fold(D - 1, {}, backward)


class DenseQuadratic(_Loops):
    """f, or f', of a dense quadratic field: sums over all its coefficients.

    f_i = c_i + sum_j x_j (l_ij + sum_k q_ijk x_k) with symmetric q; in the table each component has
    c_i, l_ij for all j, and q_ijk for all j and k.
    """

    def __init__(self, D, is_derivative):
        self.D, self.is_derivative = D, is_derivative

    def add(self, text, name, for_each, first):
        D, size, integer = self.D, text.size if for_each else 8, text.integer
        load = (lambda at: text.load(text.V, at)) if for_each else text.shared

        def component(i):
            start = integer("mul", integer("mul", i, 1 + D + D * D), size)
            start = integer("add", "%table", start)

            def inner(j):
                at = integer("add", start, integer("mul", integer("add", j, 1), size))
                offset = integer("mul", integer("add", integer("mul", j, D), 1 + D), size)
                products = integer("add", start, offset)

                def add(k, total):
                    q = load(integer("add", products, integer("mul", k, size)))
                    product = text.operate("fmul", q, text.row("%from", 0, k))
                    return {"total": text.operate("fadd", total, product)}

                total = text.fold(D, {"total": text.constant(0.0)}, add)["total"]
                return load(at), total

            if self.is_derivative:

                def entry(j):
                    linear, total = inner(j)
                    value = text.operate("fadd", linear, text.operate("fadd", total, total))
                    place = integer("add", integer("mul", i, D), j)
                    text.put(value, "%to", 0, place)

                text.fold(D, {}, entry)
                return

            def term(j, f):
                linear, total = inner(j)
                value = text.operate("fadd", linear, total)
                product = text.operate("fmul", value, text.row("%from", 0, j))
                return {"f": text.operate("fadd", f, product)}

            text.put(text.fold(D, {"f": load(start)}, term)["f"], "%to", 0, i)

        with text.function(name):
            text.fold(D, {}, component)


class DenseProduct(_Loops):
    """f' times a vector, for all entries of f' in rows, s, and the vector."""

    def __init__(self, D):
        self.D = D

    def in_numpy(self, rows):
        """Return the products, as rows."""
        D, totals = self.D, []
        for i in range(D):
            total = 0.0
            for j in range(D):
                total = total + rows[i * D + j] * rows[D * D + 1 + j]
            totals.append(total)
        return np.array(totals)

    def add(self, text, name, for_each, first):
        D, integer = self.D, text.integer

        def component(i):
            def add(j, total):
                a = text.row("%from", 0, integer("add", integer("mul", i, D), j))
                product = text.operate("fmul", a, text.row("%from", D * D + 1, j))
                return {"total": text.operate("fadd", total, product)}

            text.put(text.fold(D, {"total": text.constant(0.0)}, add)["total"], "%to", 0, i)

        with text.function(name):
            text.fold(D, {}, component)
