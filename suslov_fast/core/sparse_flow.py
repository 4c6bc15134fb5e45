"""Steps of `flow` for fields of many variables, by loops in place of code for each field.

Stages are those of `sparse`, or long lists (`listed`) if there is a plan. So are the lists that
choose lengths (`tolerance`), and those of the words of lifted fields.
"""

import functools
from typing import Any, NamedTuple

import numpy as np

from .arrays import uncounted
from .elimination import simd_min
from .lines import zeros
from .listed import program_of
from .listed_code import SLOT, ListArguments, carry_out, listed_code, runs_code
from .llvm import QUAD
from .machine_code import call
from .numba import kernel
from .operations import Values, of_one_sign
from .sparse import pattern_of, room_of, size_of, step_once
from .tolerance import Beginning, Choice, with_constant_rates

LONGEST = 10  # stages of the longest column


@kernel
def sparse_stages(part, parts, pattern, halves, rows, least, memory):
    """Take a stage of all lanes; halves are (lines, W, T).

    The lines are rows[line, row, lane], whose first D rows are the states; the row `least` has the
    least pivot so far, which stages of lifted fields, with `least` below 0, do not tell.
    """
    pattern, halves, rows, memory = uncounted((pattern, halves, rows, memory))
    D, G, E = len(pattern.order), len(pattern.given), len(pattern.columns)
    room, after = room_of(memory[D * QUAD :], D, G, E), memory[: D * QUAD]
    for line in range(len(rows)):
        x = rows[line, :D]
        for lane in range(x.shape[1]):
            l = lane % QUAD
            if l == 0:
                step_once(pattern, halves[line], x, lane, room, after)
            pivot = 1.0
            for i in range(D):
                x[i, lane] = after[i * QUAD + l]
                pivot = simd_min(1.0 + room.pivots[i * QUAD + l], pivot)
            if least >= 0:
                rows[line, least, lane] = simd_min(pivot, rows[line, least, lane])


@kernel
def sums_of_terms(part, parts, indices, values, x, sums, of_moduli):
    """Set the sums (D, W) of terms, or of moduli, of values (T, 1 or W) and states (D, W)."""
    indices, values, x, sums = uncounted((indices, values, x, sums))
    (D, W), own = x.shape, int(values.shape[1] > 1)
    for i in range(D):
        for l in range(W):
            sums[i, l] = 0.0
    for t in range(len(values)):
        i, j, k = indices[0, t], indices[1, t], indices[2, t]
        for l in range(W):
            term = values[t, own * l]
            term *= x[j, l] if j < D else 1.0
            term *= x[k, l] if k < D else 1.0
            sums[i, l] += abs(term) if of_moduli else term


class _Programs(NamedTuple):
    """The programs of a `tolerance.Stage`, each with its numbers; None where there is no list."""

    beginning: Any
    choice: Any
    words: Any  # of a lifted field, and the least pivot
    fixed: Any  # `Step.table`
    column: Any  # a stage, see `_column_of`


@functools.lru_cache(8)
def _programs_of(step):
    D, n, parameters = step.D, step.given, range(step.D, step.D + step.parameters)
    words, fixed, column = None, None, None
    if step.lift is None:
        signs, even = of_one_sign(step.indices), with_constant_rates(step.indices, D)
        beginning, choice = Beginning(None, D, D), Choice(None, D, D, signs, even)
    else:
        beginning, choice = step.beginning, step.choice
        operations, results = [*step.fixed, *step.prologue], [*step.lifted, step.least]
        words = program_of([*range(n), *parameters], (), operations, results)
    if step.usual:
        fixed = program_of(parameters, (), step.fixed, step.table)
        column = _column_of(step)
    beginning, choice = (
        program_of(range(each.inputs), (), each.operations, each.results)
        for each in (beginning, choice)
    )
    return _Programs(beginning, choice, words, fixed, column)


def _column_of(step):
    """Return the program of a stage of a column, on rows that `listed_code` steps as a state.

    They have the state x, the least pivot, the state before the step, the sum of factors times
    x_next - x, and the factors, which move on by one place.
    """
    D, n, values = step.D, step.given, Values(step.values.count + 1, ())
    least, *before = range(values.count - 1, values.count + n)
    values.count += n
    sums, factors = (
        range(values.count + k, values.count + k + m) for k, m in ((0, n), (n, LONGEST))
    )
    values.count += n + LONGEST
    lower = least if step.lift is not None else step.least
    is_less = values.emit("olt", lower, least)
    results = [*step.after, values.emit("select", is_less, lower, least), *before]
    for k, total in enumerate(sums):
        change = values.emit("fsub", step.after[k], before[k])
        term = values.emit("fmul", factors[0], change)
        results.append(values.emit("fadd", total, term))
    results += [*factors[1:], factors[0], values.emit("olt", 0.0, 1.0)]
    rows, operations = [*range(D), least, *before, *sums, *factors], values.operations
    return program_of(rows, step.table, [*step.usual, *operations], results)


class Loops:
    """The loops for motions with one `tolerance.Stage`, in lines of W lanes.

    Lines are rows[line, row, lane]; `places` are their `generated_flow.Rows`, and `values` (1 or
    lines, parameters, 1 or W) those of the terms and of the lift. Without machine code, where
    `code` is None, there are stages of fields without a plan alone.
    """

    def __init__(self, step, W, places, values):
        self.step, self.W, self.places, self.values = step, W, places, values
        self.code = runs_code(W, step.prologue)
        if not step.usual:
            self.pattern = pattern_of(step.indices.tobytes(), step.D)
            self.memory = np.empty(size_of(self.pattern))
        self.sums = np.empty((step.given, W))
        if self.code is not None:
            self.programs = _programs_of(step)
            rows = max(program.rows for program, _ in filter(None, self.programs))
            self.numbers = zeros(rows, W)
        if self.code is not None and step.usual:
            self.steps_code = listed_code(W, W > 1)
            self.arguments = self._arguments()

    def _arguments(self):
        """Return the arguments of `listed_code` for stages of a column, without table and steps."""
        (heads, places), results = self.programs.column[0].runs, self.programs.column[0].results
        arguments = dict.fromkeys(ListArguments._fields, 0) | {
            "rows": self.numbers.ctypes.data, "stages": 1, "D": len(results) - 1,
            "heads": heads.ctypes.data, "places": places.ctypes.data, "runs": len(heads),
            "results": results.ctypes.data,
        }  # fmt: skip
        return np.array(ListArguments(**arguments), np.int64)

    def prepare(self, half):
        """Prepare stages of all lanes without a plan, with h / 2 (lines, W)."""
        values = self.values[:, : self.step.T].swapaxes(1, 2)
        self.halves = np.ascontiguousarray(half[:, :, np.newaxis] * values)

    def _table(self, line, half):
        return self._carry_out(self.programs.fixed, [self._scaled(line, half)])

    def take_stage(self, rows):
        """Take a stage of all lanes without a plan."""
        least = self.places.least if self.step.lift is None else -1
        sparse_stages.serial(self.pattern, self.halves, rows, least, self.memory)

    def take_column(self, rows, half, stages, factors):
        """Take the stages of a column of all lanes, with h / 2 (lines, W).

        The factors (LONGEST, 1) are those of the states in `generated_flow.Rows.difference`.
        """
        places, (D, n), of = self.places, (self.step.D, self.step.given), self.numbers
        least, base, sums = D, slice(D + 1, D + 1 + n), slice(D + 1 + n, D + 1 + 2 * n)
        self.arguments[SLOT.steps], (_, numbers) = stages, self.programs.column
        for line, of_line in enumerate(rows):
            table = numbers.of(self._table(line, half[line]))
            address = np.array([table.ctypes.data], np.int64)
            of[:D], of[least] = of_line[:D], of_line[places.least]
            of[base], of[sums] = of_line[places.base : places.base + n], 0.0
            of[sums.stop : sums.stop + LONGEST] = factors
            self.arguments[SLOT.tables] = address.ctypes.data
            call(self.steps_code, self.arguments)
            of_line[:D], of_line[places.least] = of[:D], of[least]
            of_line[places.difference : places.difference + n] = of[sums]

    def begin(self, rows, rtol):
        """Write the largest moduli and first lengths of all lanes."""
        places, D, T = self.places, self.step.D, self.step.T
        if self.step.lift is not None:
            self.lift(rows, np.ones((len(rows), self.W)))
        for line, of_line in enumerate(rows):
            x = of_line[places.base : places.base + D]
            is_given = self.step.lift is None
            of_terms = self._sums(line, x, False) if is_given else self._values(line)[:T]
            inputs = x, of_terms, of_line[[places.wanted]], self._row(rtol)
            found = self._carry_out(self.programs.beginning, inputs)
            self._write(of_line, found, [places.wanted, places.first])

    def lift(self, rows, half):
        """Write the words of all lanes, and the least pivots of a step, with h / 2 (lines, W)."""
        D, n, places = self.step.D, self.step.given, self.places
        for line, of_line in enumerate(rows):
            inputs = of_line[places.base : places.base + n], self._scaled(line, half[line])
            *words, least = self._carry_out(self.programs.words, inputs)
            of_line[places.base + n : places.base + D], of_line[places.least] = words, least

    def choose(self, rows, end, rtol):
        """Write the next state, largest moduli, time and length of all lanes."""
        places, (D, n, T) = self.places, (self.step.D, self.step.given, self.step.T)
        for line, of_line in enumerate(rows):
            base = of_line[places.base : places.base + D + 4 * n]
            scalars = of_line[places.time : places.least + 1], self._row(end), self._row(rtol)
            if self.step.lift is None:
                inputs = base, self._sums(line, base[:D], True), *scalars
            else:
                values, words = self._values(line), of_line[places.x + n : places.x + D]
                inputs = base, values[:T], *scalars, words, values[T:]
            found = self._carry_out(self.programs.choice, inputs)
            self._write(of_line, found, [*range(places.time, places.taken)])

    def _row(self, number):
        return np.full((1, self.W), number)

    def _values(self, line):
        own = self.values[line % len(self.values)]
        return np.broadcast_to(own, (len(own), self.W))

    def _scaled(self, line, half):
        """Return h v of the terms, and the coefficients of the lift."""
        values = self._values(line).copy()
        values[: self.step.T] *= half
        return values

    def _sums(self, line, x, of_moduli):
        """Return sums of the terms of each component of the state, or of their moduli."""
        own, indices = self.values[line % len(self.values)], self.step.indices
        sums_of_terms.serial(indices, own, np.ascontiguousarray(x), self.sums, of_moduli)
        return self.sums

    def _carry_out(self, of_list, inputs):
        """Return the results of a list on rows of numbers."""
        program, numbers = of_list
        np.concatenate(inputs, out=self.numbers[: sum(map(len, inputs))])
        carry_out(self.code, program.runs, self.numbers, numbers.of(np.empty((0, self.W))))
        return self.numbers[program.results]

    def _write(self, of_line, found, after):
        """Write the state and largest moduli of a line, and the rows `after`."""
        n, places = self.step.given, self.places
        of_line[places.base : places.base + n] = found[:n]
        of_line[places.largest : places.largest + n] = found[n : 2 * n]
        of_line[after] = found[2 * n :]
