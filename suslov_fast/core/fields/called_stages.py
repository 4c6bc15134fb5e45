"""Stages that the driver calls: those of long lists, by runs, and of dense fields, by loops.

Each has the address of its code and of its plan, and makes the tables of a line. `prepare` makes
what the code lacked where it stopped.
"""

import numpy as np

from ..code.runs import programs_of
from ..code.runs_code import StagePlan, stage_by_runs
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
        self.code, step = stage_by_runs(lines.W, lines.for_each), lines.scheme.step
        # Kept here, because `programs_of` may forget them.
        self.programs, self.rare, self.line = programs_of(step), None, 0
        program = self.programs.usual
        heads, places = program.runs
        numbers = dict.fromkeys(StagePlan._fields, 0) | {
            "heads": heads.ctypes.data, "places": places.ctypes.data, "runs": len(heads),
            "results": program.results.ctypes.data, "D": step.D,
            "changed": 2 if step.changed is None else 3,
        }  # fmt: skip
        self.numbers = StagePlan(**numbers)
        self.own = np.array(self.numbers, np.int64)
        self.give_rows(program.rows)

    def give_rows(self, count):
        self.rows = zeros(count, self.lines.W)
        self.own[StagePlan._fields.index("rows")] = self.rows.ctypes.data

    def prepare(self):
        """Make the second program."""
        self.rare = self.programs.rare
        heads, places = self.rare.runs
        self.numbers = self.numbers._replace(
            rare_heads=heads.ctypes.data,
            rare_places=places.ctypes.data,
            rare_runs=len(heads),
            rare_results=self.rare.results.ctypes.data,
            is_rare=1,
        )
        self.own[:] = self.numbers
        self.give_rows(max(self.programs.usual.rows, self.rare.rows))
        self.tables_of(self.line)

    def tables_of(self, line):
        """Make the tables of a line."""
        self.line, ready = line, [self.programs.usual, *([self.rare] if self.rare else [])]
        tables = [of_fraction[line] for of_fraction in self.lines.table]
        self.tables = [[each.numbers.of(table) for each in ready] for table in tables]
        self.pairs = np.zeros((len(tables), 2), np.int64)
        for pair, of_fraction in zip(self.pairs, self.tables, strict=True):
            pair[: len(ready)] = [table.ctypes.data for table in of_fraction]
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
    """Return the stage of a long list or of a dense field; None where LLVM refuses its code."""
    stage = StageByRuns(lines) if lines.scheme.step.usual else StageByLoops(lines)
    return None if stage.code is None else stage
