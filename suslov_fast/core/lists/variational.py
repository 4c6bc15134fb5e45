"""The variational equations of a right-hand side: x, and columns of derivatives beside it."""

import functools
import itertools

import numpy as np

from .right_hand_side import List


class Variational:
    """The right-hand side of x, of columns v' = f'(x) v, and of s' = u trace f' with u' = 0.

    A column has D components. The last ones are derivatives by the parameters of `f.by`, times
    scales that stand in the table after that of f: v' = f'(x) v + scale df/dp. `trace` says whether
    u and s are there; u is a size that columns have, because they and s should count as much as x
    in the error. What implicit steps take for the derivative has one block for x, the same for each
    column, and beside it the derivative of v' by x, the coupling. Without the coupling errors of
    stiff equations decide on the steps, which become a hundred times shorter.

    It has what steps of the motion read of a `RightHandSide`.

    of       the right-hand side of x
    columns  their number
    base     `List` of f, its denominators, trace f' or nothing, scale df/dp and the entries of f'
    derivative   `List` of the entries of f', and of scale d2f/dxdp for each of the last columns
    coupling     entries of the coupling of a column, 0 without it
    """

    is_dense = False

    def __init__(self, f, columns, has_trace=False):
        self.of, self.columns, self.has_trace = f, columns, has_trace
        self.D = f.D * (1 + columns) + 2 * has_trace
        self.clocks, self.of_one_sign = f.clocks, f.of_one_sign
        self.denominators, self.entries = f.denominators, f.entries
        self.conditions, self.watch, self.changes = f.conditions, f.watch, f.changes
        self.hidden, self.watched, self.aim = f.hidden, f.watched, f.aim
        self.offsets = f.offsets
        self.q = len(f.by) // f.D
        lists = f.f, f.derivative, f.of_parameters
        operations = {each[1]: each for list_ in lists for each in list_.operations}
        later = [] if f.second is None else [each[1] for each in f.second.mixed.operations]
        numbers = itertools.count(max([f.D, *f.table, *operations, *later]) + 1)

        def emit(instruction, *operands):
            number = next(numbers)
            operations[number] = instruction, number, operands
            return number

        scales = [next(numbers) for _ in range(self.q)]
        self.table = [*f.table, *scales]
        self.places = {number: place for place, number in enumerate(self.table)}
        entries = dict(zip(f.pattern, f.derivative.results, strict=True))
        diagonal = [entries[i, i] for i in range(f.D) if (i, i) in entries]
        trace = functools.reduce(lambda a, b: emit("fadd", a, b), diagonal or [0.0])

        def scaled(operands, count):
            """Return operands times scales, each of which is for so many of them."""
            return [
                emit("fmul", scales[k // count], a) if a or type(a) is int else 0.0
                for k, a in enumerate(operands)
            ]

        by = scaled(f.by, f.D)
        results = [*f.f.results, *f.denominators, *[trace] * has_trace, *by]
        self.before = len(results)
        self.base = List([*operations.values()], [*results, *f.derivative.results])
        self.work = len(operations) + columns * len(f.pattern) + 16
        self.coupling = 0
        if f.second is not None:
            self.coupling, mixed = len(f.second.pattern), f.second.mixed
            operations = {each[1]: each for each in [*f.derivative.operations, *mixed.operations]}
            results = [*f.derivative.results, *scaled(mixed.results, self.coupling)]
            self.derivative = List([*operations.values()], results)
        else:
            self.derivative = f.derivative
        self.key = repr(("variational", f.key, columns, has_trace, f.of_parameters))

    def table_of(self, table, scales=()):
        """Return the table (n, ...) for that of f and scales (q, ...)."""
        rows = [np.broadcast_to(a, table.shape[1:]) for a in scales]
        return np.concatenate([table, np.reshape(rows, (len(rows), *table.shape[1:]))])

    def table_with(self, parameters, table):
        """Return the table (n, ...) for other parameters, with the scales of `table`."""
        return self.table_of(self.of.table_of(parameters), table[len(self.of.table) :])


variational = functools.lru_cache(64)(Variational)
