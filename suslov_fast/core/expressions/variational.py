"""The variational equations of a right-hand side: x, and columns of derivatives beside it."""

import functools

import numpy as np

from .dense_product import along
from .programs import Expressions, Program, dot, emitted, united
from .right_hand_side import RightHandSide


class Variational(RightHandSide):
    """The right-hand side of x, of columns v' = f'(x) v, and of s' = u trace f' with u' = 0.

    The last q columns are derivatives by the parameters `by` of f, times scales: v' = f'(x) v +
    scale df/dp. The table has the numbers of the table of f, then the scales. If `has_trace`, the
    state ends with u, a constant as large as the columns, and s; s / u is the integral of trace f'.
    If f has products of dense matrices, s' is 0, and s is of no use.
    """

    of_x = None

    def __init__(self, f, columns, has_trace=False):
        self.of_x, self.columns, self.has_trace = f, columns, has_trace
        self.q = len(f.by) // f.height
        D, P = f.D, len(f.table) + self.q
        n = D * (1 + columns) + 2 * has_trace
        values, table = Expressions(n + P), range(n, n + P)
        known = {i: i for i in range(D)} | dict(zip(f.table, table, strict=False))
        programs = f.with_denominators, f.derivative, f.of_parameters
        results = emitted(values, united(programs), known)
        rates, results = results[:D], results[D:]
        poles, results = results[: len(f.denominators)], results[len(f.denominators) :]
        rows, by = f.rows_of(results[: len(f.linked)]), results[len(f.linked) :]
        for c in range(columns):
            q, first, totals = c - columns + self.q, D * (1 + c), []
            if q >= 0:
                slopes = by[q * f.height : (q + 1) * f.height]
                totals = [values.emit("fmul", table[q - self.q], a) for a in slopes]
            v = {j: first + j for j in range(D)}
            changes, _ = along(values.emit, f.products, rows, v, totals)
            rates += [0.0 if a is None else a for a in changes]
        if has_trace:  # u' = 0 and s' = u trace f'; s' = 0 if f has products of matrices
            diagonal = [row[i] for i, row in enumerate(rows) if i in row and not f.products]
            rates += [0.0, dot(values.emit, [(n - 2, a) for a in diagonal]) or 0.0]
        super().__init__(values, rates, P, table=table)
        # These depend on x alone, not on the columns.
        self.clocks, self.steady, self.of_one_sign = f.clocks, f.steady, f.of_one_sign
        self.longest, self.hybrid = f.longest, f.hybrid
        self.invariants_count = f.invariants_count
        if f.invariants_count:
            self.projection, self.levels, self.regular = f.projection, f.levels, f.regular
            self.left_out, self.changes, self.tested = f.left_out, f.changes, f.tested
        self.denominators = poles
        self.rates = Program(values.operations, self.rates.results)
        self.with_denominators = Program(self.rates.operations, [*self.rates.results, *poles])

    def table_of(self, table, scales=()):
        """Return the table (n, ...): first the table of f, then the scales (q, ...)."""
        rows = [np.broadcast_to(a, table.shape[1:]) for a in scales]
        return np.concatenate([table, np.reshape(rows, (len(rows), *table.shape[1:]))])

    def table_with(self, parameters, table):
        """Return the table (n, ...) for new parameters of f; scales are from the old `table`."""
        return self.table_of(self.of_x.table_of(parameters), table[len(self.of_x.table) :])


variational = functools.lru_cache(64)(Variational)
