"""Right-hand sides of x' = f(x) as expression programs, with derivatives and properties."""

import numpy as np

from ..cached import cached_property
from .dense_product import along, products_in
from .derivative import gradients
from .hybrid import Hybrid
from .numpy_evaluation import results_at
from .programs import Expressions, Program, needed_for
from .projection import (
    NOTHING,
    changes_of,
    left_out_of,
    projection_of,
    regular_of,
    test_of_start,
)
from .properties import properties_of
from .pulses import longest_step
from .symbolic_elimination import bits_of


class RightHandSide:
    """The right-hand side f of D equations with P parameters.

    Values 0 to D - 1 are the state, the next P the parameters. Operations on parameters alone,
    `fixed`, are carried out once for a run, in NumPy. Other programs read a table of parameters and
    results of `fixed`: `table` has their numbers, and `places` is {number: place in the table}.

    rates        `Program` of the D rates
    derivative   `Program` of f' alone; its results are the entries at the places (i, j) in `linked`
    products     `products_in` f. If there are some, `derivative` has rows i for `height` values:
                 first the operands of products, then f. j is a component or an entry of a product
    of_parameters  `Program` of df/dp for the parameters `by`, with `height` results for each
    reads        for each component, as bits, the components that its rate depends on
    steady       components of constant rate, not 0
    clocks       the steady components that others depend on
    of_one_sign  components that keep their sign, because f_i contains the factor x_i
    denominators  numbers of values of `rates` that change sign at poles, see `properties`
    surface_values  `Program` of the functions s of surfaces at which steps end, then of the shifts
                 q of tables (functions of parameters, see `Branches.shifts`)
    slopes       `Program` of ds_k/dx_j at `slope_places` (k, j), for surfaces s_k at which f jumps;
                 j = D, ... are the parameters `by`
    projection   `Program` of the projection of a state onto invariants (constraints, then first
                 integrals), or None; `levels` is the `Program` of their values, 0 for constraints;
                 `regular` tests the constraints along a step, and `start` at its begin; `changes`
                 tests first integrals at its begin, and `left_out` at its end
    longest      operand of the longest step, a function of parameters, see `pulses`
    of_x, columns  f and 0; in a `Variational`, the right-hand side of x and how many columns
    is_written   False if no user wrote f: warnings on its size would mean nothing
    hybrid       `Hybrid`; only a `branches.HybridRightHandSide` has surfaces and events
    """

    is_dense, columns, hybrid = False, 0, Hybrid()
    invariants_count = constraints_count = positions = 0
    tested = ()
    of_x = property(lambda self: self)
    entries = property(lambda self: len(self.pattern))

    def __init__(
        self, values, results, P=0, by=(), *, surface_values=(), jumps=0, table=(),
        invariants=NOTHING, is_written=True,
    ):  # fmt: skip
        """Plan f with the D rates `results`, operands in the `Expressions` `values`.

        `by` are the numbers of parameters to differentiate f by. `surface_values` are other
        operands to evaluate; the first `jumps` of them are differentiated, too. f's table begins
        with the values that have the numbers `table`.
        """
        D, fixed, of_f = len(results), values.fixed, [*values.operations]
        self.D, self.P, self.products, self.is_written = D, P, products_in(of_f), is_written
        wanted = [*(a for _, of, _ in self.products for a in of), *results]
        self.height = len(wanted)
        of_invariants, constraints, self.positions, self.tested = invariants
        differentiated = [*wanted, *surface_values[:jumps], *of_invariants]
        rows = gradients(values, of_f, differentiated, D, by)
        slopes, at_surfaces = rows[: self.height], rows[self.height : self.height + jumps]
        at_invariants = [
            {j: a for j, a in row.items() if j < D} for row in rows[self.height + jumps :]
        ]
        self.by = [row.pop(p, 0.0) for p in by for row in slopes]
        self.linked = [(i, j) for i, row in enumerate(slopes) for j in sorted(row)]
        place = {p: D + k for k, p in enumerate(by)} | {j: j for j in range(D)}
        at_surfaces = [{place[j]: a for j, a in row.items() if j in place} for row in at_surfaces]
        self.slope_places = [(k, j) for k, row in enumerate(at_surfaces) for j in row]

        def program_of(results, others=()):
            varying = [operation for operation in values.operations if operation[1] not in fixed]
            return Program(needed_for(varying, [*results, *others]), results)

        rates = program_of([*results])
        found = properties_of(values, rates, D)
        self.reads, self.steady, self.clocks, self.of_one_sign, self.denominators = found
        self.longest = longest_step(values, rates, self.steady)
        self.rates = program_of(rates.results, self.denominators)
        self.with_denominators = Program(self.rates.operations, [*results, *self.denominators])
        self.derivative = program_of([slopes[i][j] for i, j in self.linked])
        self.surface_values = program_of([*surface_values])
        self.of_parameters = program_of(self.by)
        self.slopes = program_of([a for row in at_surfaces for a in row.values()])
        self.invariants_count, self.constraints_count = len(of_invariants), constraints
        self.invariants_places = [(k, j) for k, row in enumerate(at_invariants) for j in row]
        entries = [at_invariants[k][j] for k, j in self.invariants_places]
        self.invariants = program_of([*of_invariants, *entries])
        self.levels = program_of([*[0.0] * constraints, *of_invariants[constraints:]])
        self._plan_table(values, table)

    def _plan_table(self, values, first):
        """Set `table`, which begins with the numbers `first`, `places`, and `fixed`."""
        programs = self.rates, self.derivative, self.surface_values, self.of_parameters, self.slopes
        programs += (self.invariants,) * bool(self.invariants_count)
        used = [a for each in programs for _, _, of in each.operations for a in of]
        used += [a for each in programs for a in each.results] + [self.longest]
        used = [*first, *(a for a in used if type(a) is int and a in values.fixed)]
        self.table = [*dict.fromkeys(used)]
        self.places = {number: place for place, number in enumerate(self.table)}
        both = values.fixed | values.fixed_truths
        of_parameters = [operation for operation in values.operations if operation[1] in both]
        self.fixed = needed_for(of_parameters, self.table)

    @cached_property
    def projection(self):
        return projection_of(self) if self.invariants_count else None

    @cached_property
    def regular(self):
        return regular_of(self) if self.constraints_count else None

    @cached_property
    def left_out(self):
        return left_out_of(self) if self.invariants_count > self.constraints_count else None

    @cached_property
    def changes(self):
        return changes_of(self) if self.tested else None

    @cached_property
    def start(self):
        return test_of_start(self)

    @cached_property
    def cost(self):
        """About how many operations f takes."""
        return len(self.rates.operations) + sum(each[0].matrix.size for each in self.products) + 16

    @cached_property
    def pattern(self):
        """The places (i, j) of f' where an entry may differ from 0, in order."""
        if not self.products:
            return self.linked
        return [(i, j) for i, mask in enumerate(self.reads) for j in bits_of(mask)]

    def rows_of(self, parts):
        """Return the rows {j: entry} of f' from its entries at the places `linked`, `parts`."""
        rows = [{} for _ in range(self.height)]
        for (i, j), a in zip(self.linked, parts, strict=True):
            rows[i][j] = a
        return rows

    @cached_property
    def column(self):
        """The `Program` of f' v (D) from the parts of f' at the places `linked`, and v (D)."""
        parts, D = range(len(self.linked)), self.D
        values, v = Expressions(len(parts) + D), {j: len(parts) + j for j in range(D)}
        changes, _ = along(values.emit, self.products, self.rows_of(parts), v)
        return Program(values.operations, [0.0 if a is None else a for a in changes])

    @cached_property
    def key(self):
        """A text that is different for right-hand sides with different machine code."""
        lists = self.rates, self.fixed, self.derivative, self.linked
        lists += self.slopes, self.slope_places, self.surface_values, self.denominators
        lists += self.of_one_sign, self.steady
        lists += (self.projection, self.levels, self.tested) if self.projection else ()
        columns = () if self.of_x is self else (self.columns, self.has_trace, self.of_x.key)
        return repr((self.D, self.table, *self.hybrid, *lists, columns))

    def table_of(self, parameters):
        """Return the table (n, ...), the numbers that f and f' read, for parameters (P, ...)."""
        parameters = np.asarray(parameters, np.float64)
        given = dict(enumerate(parameters, self.D))
        return results_at(Program(self.fixed, self.table), given, parameters.shape[1:])

    def table_with(self, parameters, table):
        """Return the table for new parameters; only `Variational` reads `table`, the old one."""
        return self.table_of(parameters)

    def value(self, x, table):
        """Return f (D, ...) at states x (D, ...), for a `table` (n, ...) from `table_of`."""
        return self._at(self.rates, x, table)

    def jacobian(self, x, table):
        """Return f' (D, D, ...) at states x (D, ...), for a `table` (n, ...) from `table_of`."""
        return self.matrix_of(self._at(self.derivative, x, table))

    def matrix_of(self, entries):
        """Return f' (D, D, ...) from the results of `derivative`."""
        if self.products:
            unit = np.eye(self.D).reshape(self.D, self.D, *[1] * (entries.ndim - 1))
            given = dict(enumerate([*entries[:, np.newaxis], *unit]))
            return results_at(self.column, given, (self.D, *entries.shape[1:]))
        matrix = np.zeros((self.D, self.D, *entries.shape[1:]))
        for place, entry in zip(self.pattern, entries, strict=True):
            matrix[place] = entry
        return matrix

    def _at(self, program, x, table):
        """Return results of a `Program` of f at states x (D, ...), for a table (n, ...)."""
        shape = np.broadcast_shapes(np.shape(x)[1:], np.shape(table)[1:])
        given = dict(zip([*range(self.D), *self.table], [*x, *table], strict=True))
        return results_at(program, given, shape)
