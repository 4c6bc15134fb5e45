"""Stages that the driver calls: those of long lists, by runs, and of dense fields, by loops.

Each has the address of its code and of its plan, and makes the tables of a line. `prepare` makes
what the code lacked where it stopped.
"""

import numpy as np

from ..code.runs import programs_of
from ..code.runs_code import SLOT, StagePlan, stage_by_runs
from .dense import DenseStage, memory_of_stage, spans_of, take_dense_stage
from .lines import zeros
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
        self.code, self.line = stage_by_runs(lines.W, lines.for_each), 0
        self.own = np.zeros(len(StagePlan._fields), np.int64)
        self.own[SLOT.D], self.own[SLOT.changed] = step.D, 2 if step.changed is None else 3
        self.all = programs_of(step)  # kept here, because `programs_of` may forget them
        self.programs = [self.all.usual]
        self.point()

    def point(self):
        """Write the addresses of the programs that there are, and of rows for each."""
        self.rows = zeros(max(program.rows for program in self.programs), self.lines.W)
        self.own[SLOT.rows] = self.rows.ctypes.data
        for first, program in zip((SLOT.heads, SLOT.rare_heads), self.programs, strict=False):
            heads, places = program.runs
            addresses = heads.ctypes.data, places.ctypes.data, len(heads)
            self.own[first : first + 4] = *addresses, program.results.ctypes.data  # as `StagePlan`

    def prepare(self):
        """Make the second program."""
        self.programs.append(self.all.rare)
        self.own[SLOT.is_rare] = 1
        self.point()
        self.tables_of(self.line)

    def tables_of(self, line):
        """Make the tables of a line."""
        self.line, programs = line, self.programs
        tables = [of_fraction[line] for of_fraction in self.lines.table]
        self.tables = [[each.numbers.of(table) for each in programs] for table in tables]
        self.pairs = np.zeros((len(tables), 2), np.int64)
        for pair, of_fraction in zip(self.pairs, self.tables, strict=True):
            pair[: len(programs)] = [table.ctypes.data for table in of_fraction]
        self.place(self.pairs.ctypes.data + self.pairs.strides[0] * np.arange(len(tables)))


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
        halves = self.lines.halves[line][self.field.terms].T
        self.tables = np.ascontiguousarray(self.fractions[:, np.newaxis, np.newaxis] * halves)
        self.place(self.tables.ctypes.data + self.tables.strides[0] * np.arange(len(self.tables)))


def called_stage_of(lines):
    """Return the stage of a long list or of a dense field."""
    return StageByRuns(lines) if lines.scheme.step.usual else StageByLoops(lines)
