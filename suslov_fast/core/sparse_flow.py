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
from .listed_code import carry_out, runs_code
from .llvm import QUAD
from .numba import kernel
from .operations import of_one_sign
from .sparse import pattern_of, room_of, size_of, step_once
from .tolerance import Beginning, Choice, with_constant_rates


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
    stage: Any


@functools.lru_cache(8)
def _programs_of(step):
    D, n, parameters = step.D, step.given, range(step.D, step.D + step.parameters)
    words, fixed, stage = None, None, None
    if step.lift is None:
        signs, even = of_one_sign(step.indices), with_constant_rates(step.indices, D)
        beginning, choice = Beginning(None, D, D), Choice(None, D, D, signs, even)
    else:
        beginning, choice = step.beginning, step.choice
        operations, results = [*step.fixed, *step.prologue], [*step.lifted, step.least]
        words = program_of([*range(n), *parameters], (), operations, results)
    if step.usual:
        results = [*step.after] if step.lift is not None else [*step.after, step.least]
        fixed = program_of(parameters, (), step.fixed, step.table)
        stage = program_of(range(D), step.table, step.usual, results)
    beginning, choice = (
        program_of(range(each.inputs), (), each.operations, each.results)
        for each in (beginning, choice)
    )
    return _Programs(beginning, choice, words, fixed, stage)


class Loops:
    """The loops for motions with one `tolerance.Stage`, in lines of W lanes.

    Lines are rows[line, row, lane]; `places` are their `generated_flow.Rows`, and `values` (1 or
    lines, parameters, 1 or W) those of the terms and of the lift. Without machine code, where
    `code` is None, there are stages of fields without a plan alone.
    """

    def __init__(self, step, W, places, values):
        self.step, self.W, self.places, self.values = step, W, places, values
        self.code = runs_code(W)
        if not step.usual:
            self.pattern = pattern_of(step.indices.tobytes(), step.D)
            self.memory = np.empty(size_of(self.pattern))
        self.sums = np.empty((step.given, W))
        if self.code is not None:
            self.programs = _programs_of(step)
            rows = max(program.rows for program, _ in filter(None, self.programs))
            self.numbers = zeros(rows, W)

    def prepare(self, half):
        """Prepare stages of all lanes, with h / 2 (lines, W)."""
        if self.step.usual:
            (_, numbers), lines = self.programs.stage, enumerate(half)
            self.tables = [numbers.of(self._table(line, of_line)) for line, of_line in lines]
            return
        values = self.values[:, : self.step.T].swapaxes(1, 2)
        self.halves = np.ascontiguousarray(half[:, :, np.newaxis] * values)

    def _table(self, line, half):
        return self._carry_out(self.programs.fixed, [self._scaled(line, half)])

    def take_stage(self, rows):
        """Take a stage of all lanes."""
        places, D, is_told = self.places, self.step.D, self.step.lift is None
        if not self.step.usual:
            least = places.least if is_told else -1
            sparse_stages.serial(self.pattern, self.halves, rows, least, self.memory)
            return
        program, _ = self.programs.stage
        for of_line, table in zip(rows, self.tables, strict=True):
            self.numbers[:D] = of_line[:D]
            carry_out(self.code, program.runs, self.numbers, table)
            found = self.numbers[program.results]
            of_line[:D] = found[:D]
            if is_told:
                least, lower = of_line[places.least], found[D]
                of_line[places.least] = np.where(lower < least, lower, least)

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
