"""The variational equations of a right-hand side: x, and columns of derivatives beside it."""

import functools

import numpy as np

from .dense_product import ENTRY
from .programs import Expressions, Program, dot, emitted
from .right_hand_side import RightHandSide

# Surfaces, branches and events depend on x alone.
_OF_X = (
    "clocks steady of_one_sign branches branch_program watch watched double_crossings aim events "
    "offsets derived"
).split()


class Variational(RightHandSide):
    """The right-hand side of x, of columns v' = f'(x) v, and of s' = u trace f' with u' = 0.

    A column has D components. The last q columns are derivatives by the parameters `by` of f, times
    scales: v' = f'(x) v + scale df/dp. The parameters are the table of f, then the scales. u and s
    exist if `has_trace`; s / u is the integral of trace f', and u is the size of the columns.

    of       the right-hand side of x
    columns  how many columns there are
    """

    of = None

    def __init__(self, f, columns, has_trace=False):
        self.of, self.columns, self.has_trace, self.q = (
            f,
            columns,
            has_trace,
            len(f.by) // f.rows_by,
        )
        D, P = f.D, len(f.table) + self.q
        n = D * (1 + columns) + 2 * has_trace
        values, table = Expressions(n + P), range(n, n + P)
        known = {i: i for i in range(D)} | dict(zip(f.table, table, strict=False))
        lists = f.f, f.derivative, f.of_parameters
        operations = {each[1]: each for program in lists for each in program.operations}
        wanted = [*f.f.results, *f.denominators, *f.derivative.results, *f.by]
        found = emitted(values, Program([operations[k] for k in sorted(operations)], wanted), known)
        rates, found = found[:D], found[D:]
        poles, found = found[: len(f.denominators)], found[len(f.denominators) :]
        entries, by = dict(zip(f.linked, found, strict=False)), found[len(f.linked) :]
        rows = f.rows_by
        for c in range(columns):
            q, first = c - columns + self.q, D * (1 + c)
            totals, v = [None] * rows, {j: first + j for j in range(D)}
            if q >= 0:
                own = by[q * rows : (q + 1) * rows]
                totals = [values.emit("fmul", table[q - self.q], a) for a in own]

            def add(begin, end, totals=totals, v=v):
                for (i, j), a in entries.items():
                    if begin <= i < end:
                        totals[i] = dot(values.emit, [(a, v[j])], totals[i])
                return [0.0 if a is None else a for a in totals[begin:end]]

            begin = D
            for matrix, number, operands in f.products:
                whole = values.emit(matrix, *add(begin, begin + len(operands)))
                begin += len(operands)
                own = [(a, i) for a, (of, i) in f.entry_of.items() if of == number]
                v |= {a: values.emit(ENTRY, whole, i) for a, i in own}
            rates += add(0, D)
        if has_trace:
            diagonal = _diagonal(values.emit, f, entries)
            rates += [0.0, dot(values.emit, [(n - 2, a) for a in diagonal]) or 0.0]
        super().__init__(values, rates, P, kept=table)
        for name in _OF_X:
            setattr(self, name, getattr(f, name, None))
        self.denominators = poles
        self.f = Program(values.operations, self.f.results)
        self.with_denominators = Program(self.f.operations, [*self.f.results, *poles])

    def table_of(self, table, scales=()):
        """Return the table (n, ...): first the table of f, then the scales (q, ...)."""
        rows = [np.broadcast_to(a, table.shape[1:]) for a in scales]
        return np.concatenate([table, np.reshape(rows, (len(rows), *table.shape[1:]))])

    def table_with(self, parameters, table):
        """Return the table (n, ...) for new parameters of f; scales are from the old `table`."""
        return self.table_of(self.of.table_of(parameters), table[len(self.of.table) :])


def _diagonal(emit, f, entries):
    """Return the operands whose sum is the trace of f'; no operand of a product has another one."""
    found, firsts, first = [], {}, f.D
    for matrix, number, operands in f.products:
        firsts[number], first = (matrix.matrix, first), first + len(operands)
    by_column = {}
    for (l, j), a in entries.items():
        if l >= f.D:
            by_column.setdefault(j, []).append((l, a))
    for (i, j), a in entries.items():
        if i < f.D and i == j:
            found.append(a)
        elif i < f.D <= j:
            vector, row = f.entry_of[j]
            matrix, first = firsts[vector]
            for l, b in by_column.get(i, ()):
                if first <= l < first + matrix.shape[1]:
                    c = float(matrix[int(row), l - first])
                    found.append(emit("fmul", emit("fmul", c, a), b))
    return found


variational = functools.lru_cache(64)(Variational)
