"""A step of a map x -> f(x) as an expression program, with columns of derivatives.

The kernel of steps runs it like a step of a field; the parameters of f stand where a field has its
coefficients times eps / 2. A step exists if all components of f(x) are finite; else the orbit ends.
"""

import functools

from ..cached import cached_property
from ..expressions.numpy_evaluation import OF_TRUTH_VALUES
from ..expressions.programs import Expressions, Program, Values, emitted, united
from ..expressions.values import joined
from .kahan_step import ExtendedStep
from .tolerances import LONGEST_MAP, WORK_OF_DERIVATIVES

# Operands that pass NaN on, in functions where some do not: max and min return one number if the
# other is NaN, and NaN**0 = 1**NaN = 1.
_PASSES_NAN_ON = {"select": slice(1, None), **dict.fromkeys(("max", "min", "pow"), slice(0))}


class MapStep(ExtendedStep):
    """The program of a step x_next = f(x), f a `RightHandSide`; an `ExtendedStep` if `columns`."""

    def __init__(self, f, columns=False):
        self.of = f
        D = f.D
        size = D * (2 + D) if columns else D
        self.D, self.T = size, f.P
        self.is_sparse = True
        self.of_one_sign = set()
        self.fixed, self.table, self.usual, self.rare, self.places = [], [], [], [], {}
        self.values = values = Expressions(size + f.P, range(size, size + f.P))
        work = D * (len(f.pattern) + 2 * D * D) * columns
        if work > WORK_OF_DERIVATIVES or len(f.rates.operations) > LONGEST_MAP:
            return
        known = {i: i for i in range(D)} | {D + k: size + k for k in range(f.P)}
        programs = (Program(f.fixed, []), f.rates, f.derivative)[: 2 + columns]
        results = emitted(values, united(programs), known)
        # `after` lists numbers of values, so a constant becomes a value: 1 times the constant.
        of_x = (Values.emit(values, "fmul", 1.0, a) if type(a) is float else a for a in results[:D])
        self.after = [*of_x, *range(D, size)]
        if columns:
            self._add_columns(dict(zip(f.pattern, results[D:], strict=True)), D)
        self._add_test(D)
        self.after_rare = self.after
        self._separate_fixed()

    @cached_property
    def extended(self):
        return MapStep(self.of, True)

    def _separate_fixed(self):
        super()._separate_fixed()
        # Selections in `fixed` need comparisons; `usual` has these, too: tables store no truths.
        both = self.values.fixed | self.values.fixed_truths
        self.fixed = [operation for operation in self.values.operations if operation[1] in both]

    def _add_columns(self, entries, D):
        """Add D columns f'(x) q, orthonormalised; `entries` are {(i, j): f'_ij}."""
        number, columns = self.values.number, []
        for c in range(D):
            q = [number(D * (1 + c) + j) for j in range(D)]
            rows = [[number(a) * q[j] for (k, j), a in entries.items() if k == i] for i in range(D)]
            columns.append([joined("fadd", row) if row else number(0.0) for row in rows])
        columns = self._orthonormal(columns, D)
        self.after[D : D * (1 + D)] = [a.number for q in columns for a in q]

    def _add_test(self, D):
        """Add the tests `accurate` and `good` of f(x).

        `accurate`: all f_i(x) are finite, and x is not NaN. `good`: the sum of f_i(x) is finite, or
        x is NaN because the lane has ended. This takes less time, but the sum may overflow, so
        that `accurate` decides where `good` is false.
        """
        number = self.values.number
        tested = [number(a) for a in self.after[:D]]
        stays = self._stays_nan(D)
        if not any(stays):  # f may be finite where x is NaN, as if it selects constants
            tested += [0.0 * number(i) for i in range(D)]
        accurate = joined("fadd", [a - a for a in tested]).equals(0.0)
        good = abs(joined("fadd", tested)) < float("inf")
        good = good | ~number(0).equals(number(0)) if all(stays) else good
        self.accurate, self.good = accurate.number, good.number

    def _stays_nan(self, D):
        """Return, for each component of f(x), True if it is NaN whenever all of x are NaN."""
        are_nan = {*range(D)}
        for name, number, operands in self.values.operations:
            of = operands[_PASSES_NAN_ON.get(name, slice(None))]
            is_nan = [not isinstance(a, float) and a in are_nan for a in of]
            if name not in OF_TRUTH_VALUES and (all if name == "select" else any)(is_nan) and of:
                are_nan.add(number)
        return [a in are_nan for a in self.after[:D]]

    @cached_property
    def key(self):
        return repr((self.D, self.values.operations, self.after, self.table))


map_step = functools.lru_cache(64)(MapStep)
