"""The integrators of a right-hand side: their functions and rows."""

from collections import Counter
from typing import Any

from ..cached import cached_property
from ..expressions.programs import program_of
from ..hybrid.double_crossings import POINTS, DoubleCrossings
from ..hybrid.event_formulas import read_by
from ..llvm.compiler import numbers_in_register
from ..llvm.tolerances import WIDTH
from . import vector_functions
from .code_arguments import ComponentNumbers, SharedNumbers
from .memory import LaneState, rows_of_trajectory, rows_of_work, scalars_of
from .tolerances import MOST_ROWS_OF_WIDE
from .vector_functions import ProgramFunction


class Integrator:
    """The integrator of a right-hand side f by a `Rule`.

    functions    `vector_functions` by name: `f`, which finds f(x), then `f.denominators`; functions
                 of surfaces, events and branches; functions of the rule
    has_atol     True if allowed errors do not depend on the sizes of other components
    is_relative  True if allowed errors of some components (RELATIVE in `lost`) are relative to them
    parts        (first component, how many) of x and of derivatives, which have different sizes:
                 large derivatives must not loosen the tolerance of x
    surface_count  how many surfaces f has at which steps end
    D_of_surfaces  the number of components of x if f has such surfaces, else 0
    searches     1 if steps may search for surfaces, else 0
    read         the numbers of the components on which these surfaces depend
    read_by_events   those of them on which surfaces of events depend at which no body rests
    double_crossings  `DoubleCrossings`, programs that find whether a step hides crossings; they
                 read `at_points` numbers at points of the step, such as values of surfaces
    events       `EventSet`, or None; `event_surface_count` of the surfaces are its surfaces
    kinks        the kinds of the surfaces at which f has a kink, see `Branches`
    rows, work   first rows of a trajectory's data and of the workspace, see `memory`; `scalars` are
                 the names of parts with one row
    is_bounded   True if steps are at most a part of the whole time, because f has clocks or may
                 jump
    spent        budgets of steps that batches have spent, see `batch_solver.width_of`
    codes        {(W, for_each): address of the machine code}, see `batch_solver.code_of`
    """

    on_new: Any = None  # a function of f and True if implicit, called before code is planned

    def __init__(self, rule, has_atol, is_relative=False):
        f = rule.f
        if Integrator.on_new:
            Integrator.on_new(f.of_x, rule.mode == LaneState.IMPLICIT)
        self.f, self.rule, self.has_atol, self.codes = f, rule, has_atol, {}
        self.is_relative, self.spent = is_relative, 0.0
        self.parts = [(0, f.of_x.D)] + [(f.of_x.D, f.D - f.of_x.D)] * (f.columns > 0)
        self.D_of_surfaces = f.of_x.D if f.hybrid.ends_steps else 0
        self.searches = int(f.hybrid.ends_steps or f.hybrid.chooses)
        self.is_bounded = bool(f.clocks) or f.hybrid.jumps
        self.kinks, self.events = f.hybrid.kinks, f.hybrid.events
        self.event_surface_count = f.hybrid.event_surface_count
        if f.is_dense:
            self.functions = {"f": vector_functions.DenseQuadratic(f.D, False)}
        else:
            self.functions = {"f": ProgramFunction(f.with_denominators, f.D, f.places)}
        self.surface_count = len(f.hybrid.surfaces.results) if self.D_of_surfaces else 0
        read = read_by(f.hybrid.surfaces, f.hybrid.surfaces.results) if self.D_of_surfaces else []
        self.read = sorted({*range(self.D_of_surfaces)}.intersection(read))
        self.read_by_events = self._read_by_events()
        self.double_crossings = f.hybrid.double_crossings or DoubleCrossings()
        of_point = self.surface_count + sum(self.double_crossings.inside)
        self.at_points = (1 + len(POINTS)) * of_point
        if self.D_of_surfaces:
            self._add_surfaces()
        if f.hybrid.acts:
            self._add_events()
        if f.hybrid.chooses:
            self._add_branches()
        if f.of_x.projection:
            self._add_invariants(f.of_x)
        rule.add_functions(self.functions)
        self.rows = rows_of_trajectory(self)
        self.work = rows_of_work(self)
        check_owners(self.rows, self.work)
        self.scalars = {*scalars_of(self.rows), *scalars_of(self.work)}

    def _read_by_events(self):
        """Return the components that surfaces of events at which no body rests depend on."""
        plain = self.events.plain if self.event_surface_count else ()
        first, surfaces = self.surface_count - self.event_surface_count, self.f.hybrid.surfaces
        results = [surfaces.results[first + k] for k in plain]
        read = read_by(program_of(surfaces.operations, results), results) if results else ()
        return {*read}.intersection(range(self.D_of_surfaces))

    def _add_surfaces(self):
        """Add functions of the surfaces at which steps end to the dict `functions`."""
        f, D = self.f, self.f.of_x.D
        sides = 2 * self.event_surface_count
        for name, program in (
            ("surfaces", f.hybrid.surfaces),
            ("phases", self.double_crossings.phases),
        ):
            if program:
                self.functions[name] = ProgramFunction(program, D, self.f.of_x.places)
        for name, program, first in (
            ("watch", f.hybrid.watch, 2 * self.surface_count + sides),
            ("aim", f.hybrid.aim[self.rule.damps], 2 * D + sides),
            ("double_crossings", self.double_crossings.decision, self.at_points + D + 1),
            ("rates", self.double_crossings.rates, 3 * D + 1),
        ):
            if program:
                places = {first + k: k for k in range(len(self.f.of_x.table))}
                self.functions[name] = ProgramFunction(program, first, places)

    def _add_events(self):
        """Add functions of events (surfaces, new states, new columns) to the dict `functions`."""
        P, of_x = self.events.P, self.f.of_x
        for name, (program, rows) in self.events.parts.items():
            if not self.f.columns and name.startswith(("tau", "column")):
                continue  # only columns of derivatives need these functions
            places = {rows + p: p for p in range(P)}
            if self.f.columns:  # scales of columns follow the table of f
                places |= {rows + P + q: len(of_x.table) + q for q in range(self.f.q)}
            self.functions[name] = ProgramFunction(program, rows, places)

    def _add_branches(self):
        """Add functions that find branches of f, and what depends on them, to `functions`."""
        f, branches = self.f.of_x, self.f.hybrid.branches
        places = {f.D + p: p for p in range(f.P)}
        self.functions["branches"] = ProgramFunction(f.hybrid.branch_program, f.D, places)
        if f.hybrid.derived.results:
            self.functions["derived"] = ProgramFunction(f.hybrid.derived, 0, places)
        if f is not self.f and branches.jumps:
            self.functions["slopes"] = ProgramFunction(f.slopes, f.D, f.places)

    def _add_invariants(self, f):
        """Add functions that find invariants of f, and that project states, to `functions`."""
        first = 2 * f.D + f.invariants_count
        places = {first + k: k for k in range(len(f.table))}
        self.functions["project"] = ProgramFunction(f.projection, first, places)
        if f.left_out:
            self.functions["left_out"] = ProgramFunction(f.left_out, first, places)
        if f.changes:
            last = f.D + 1 + len(f.tested)
            of_changes = {last + k: k for k in range(len(f.table))}
            self.functions["changes"] = ProgramFunction(f.changes, last, of_changes)
        if f.regular:
            first, places = first + f.D, {p + f.D: k for p, k in places.items()}
            self.functions["regular"] = ProgramFunction(f.regular, first, places)
        self.functions["invariants"] = ProgramFunction(f.levels, f.D, f.places)

    @cached_property
    def wide(self):
        """Numbers of lanes, above WIDTH, that code for many trajectories may have; most first."""
        f = self.f
        acts_on_lanes, is_dense = f.hybrid.acts or f.hybrid.chooses, f.products or f.is_dense
        if acts_on_lanes or is_dense or self.work.size > MOST_ROWS_OF_WIDE:
            return ()
        if numbers_in_register() < WIDTH:
            return ()
        return (4 * WIDTH, 2 * WIDTH) if self.functions["f"].calls else (2 * WIDTH,)

    @cached_property
    def key(self):
        """A tuple that identifies the code of this integrator."""
        return self.f.key, *self.rule.key, self.has_atol, self.is_relative


def check_owners(rows, work):
    """Assert that scalar kernels find each of their inputs, by its name, in one record alone."""
    of_rows = (name for each in (rows, work) for name in each._fields if name != "size")
    owners = Counter([*of_rows, *SharedNumbers._fields, *ComponentNumbers._fields])
    twice = [name for name, count in owners.items() if count > 1]
    assert not twice, f"numbers of a step with two owners: {', '.join(twice)}"
