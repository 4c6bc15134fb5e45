"""Stages that the driver calls: of long lists, by runs; of lattices; of dense fields, by loops.

Each has the address of its code and of its plan, and makes the tables of a line. `prepare` makes
what the code lacked where it stopped.
"""

import functools

import numpy as np

from ..code.compiler import common_code_of
from ..code.runs import programs_of
from ..code.runs_code import SLOT, StagePlan, text_of_stage_by_runs
from ..code.sparse_code import ARRAYS, lengths_of
from .dense import DenseStage, memory_of_stage, spans_of, take_dense_stage
from .lines import zeros
from .stage_by_columns import (
    OF_PROGRAM,
    SLOT as COLUMNS,
    ColumnsPlan,
    parts_of,
    text_of_stage_by_columns,
)
from .stages import distinct


class CalledStage:
    """A stage of lines of one field; `plan` (stages, 2) is that of `DriverArguments`."""

    def __init__(self, lines):
        self.lines, fractions = lines, lines.scheme.stages.fractions
        self.fractions, self.places = distinct(fractions)
        self.plan = np.zeros((len(fractions), 2), np.int64)
        self.signs = np.array(sorted(lines.scheme.step.of_one_sign), np.int64)

    def place(self, addresses):
        """Write the addresses of the tables of fractions to the plan."""
        self.plan[:, 0] = addresses[self.places]


class StageByRuns(CalledStage):
    """The stage of a long list. Its second program is made when a state first needs it."""

    def __init__(self, lines):
        super().__init__(lines)
        step = lines.scheme.step
        self.code = common_code_of(text_of_stage_by_runs, lines.W, lines.for_each)
        self.own = np.zeros(len(StagePlan._fields), np.int64)
        self.own[SLOT.D], self.own[SLOT.changed] = step.D, 2 if step.changed is None else 3
        self.begin(programs_of, step, SLOT, SLOT.heads)

    def begin(self, programs_of, step, slots, first):
        """Begin with the usual programs, whose addresses stand in the plan from a place on."""
        self.rare = functools.partial(programs_of, step, True)
        self.programs, self.slots, self.first = programs_of(step, False), slots, first
        self.point()

    def point(self):
        """Write the addresses of the programs that there are, and of rows for each."""
        self.rows = zeros(max(program.rows for program in self.programs), self.lines.W)
        self.own[self.slots.rows], first = self.rows.ctypes.data, self.first
        for program in self.programs:
            heads, places = program.runs
            addresses = heads.ctypes.data, places.ctypes.data, len(heads)
            self.own[first : first + 4] = *addresses, program.results.ctypes.data
            first += 4

    def prepare(self):
        """Make the other programs."""
        self.programs = [*self.programs, *self.rare()]
        self.own[self.slots.is_rare] = 1
        self.point()
        self.tables_of(self.line)

    def tables_of(self, line):
        """Make the tables of a line."""
        self.line = line
        self.tables = [
            [each.numbers.of(table[line][: each.numbers.in_table]) for each in self.programs]
            for table in self.lines.table
        ]
        self.addresses = np.array([[own.ctypes.data for own in each] for each in self.tables])
        rows = self.addresses.strides[0] * np.arange(len(self.tables))
        self.place(self.addresses.ctypes.data + rows)


class StageByColumns(StageByRuns):
    """The stage of a lattice, with elimination by columns between its programs."""

    def __init__(self, lines):
        CalledStage.__init__(self, lines)
        step, W = lines.scheme.step.by_columns, lines.W
        D, sparse, count = step.D, step.sparse, len(step.entries)
        self.code = common_code_of(text_of_stage_by_columns, W, lines.for_each)
        memory = zeros(count + 1, W), zeros(D + sparse.size, W), zeros(D, W), step.on_diagonal
        memory[0][count] = 1.0
        self.memory = [*zeros(5, D, W), *memory, *(getattr(sparse, key) for key in ARRAYS)]
        addresses = [array.ctypes.data for array in self.memory]
        place = 5 + len(memory)
        numbers = ColumnsPlan(
            *addresses[:place],
            changed=1 if step.changed is None else 2,
            is_constant=step.is_constant,
            rows=0,
            is_rare=0,
            factorized=0,
        )
        programs = [0] * (4 * OF_PROGRAM)
        numbers = [*numbers, *lengths_of(sparse), *addresses[place:], *programs]
        self.own = np.array(numbers, np.int64)
        self.begin(parts_of, step, COLUMNS, len(numbers) - len(programs))

    def tables_of(self, line):
        """Make the tables of a line."""
        super().tables_of(line)
        self.own[COLUMNS.factorized] = 0


class StageByLoops(CalledStage):
    """The stage of a dense field, which has no list."""

    def __init__(self, lines):
        super().__init__(lines)
        W, D, step = lines.W, lines.D, lines.scheme.step
        self.code, self.field = take_dense_stage.address, spans_of(step)
        self.memory = np.empty(memory_of_stage(D, W))
        self.own = np.array(
            DenseStage(
                D=D,
                W=W,
                spans=self.field.spans.ctypes.data,
                count=len(self.field.spans),
                T=step.T,
                for_each=lines.halves.shape[2] > 1,
                of_one_sign=self.field.of_one_sign.ctypes.data,
                tells_signs=len(self.places) == 1,
                memory=self.memory.ctypes.data,
            ),
            np.int64,
        )

    def tables_of(self, line):
        """Make the coefficients of a line (fractions, 1 or W, T)."""
        if self.lines.halves.shape[2] == 1:
            self.tables = self.lines.table
        else:
            halves = self.lines.halves[line][self.field.terms].T
            self.tables = np.ascontiguousarray(self.fractions[:, np.newaxis, np.newaxis] * halves)
        self.place(self.tables.ctypes.data + self.tables.strides[0] * np.arange(len(self.tables)))


def called_stage_of(lines):
    """Return the stage of a long list, of a lattice or of a dense field."""
    step = lines.scheme.step
    kind = StageByRuns if step.usual else StageByColumns if step.by_columns else StageByLoops
    return kind(lines)
