"""Words of states of lifted fields, and whether a step from there passes a pole."""

import numpy as np

from .lines import zeros
from .listed import words_program
from .listed_code import carry_out, runs_code
from .operations import evaluate


class Words:
    """The words of states in lines of W lanes, by a loop over the list of their operations.

    `table` (1 or lines, n, 1 or W) has the values of `step.table`.
    """

    def __init__(self, step, W, table):
        self.step, self.W, self.table, self.code = step, W, table, runs_code(W, step.prologue)
        if self.code is not None:
            self.program, self.numbers = words_program(step)
            self.rows = zeros(self.program.rows, W)
            self.last = None, None  # a line, and its numbers

    def _numbers_of(self, line):
        if self.last[0] != line:
            table = self.table[line]
            self.last = line, self.numbers.of(np.broadcast_to(table, (len(table), self.W)))
        return self.last[1]

    def at(self, x, lines):
        """Return the words (n, D - given, W) of states x (n, D, W), and truth values (n, W).

        `lines` is the range of the numbers of these lines. Without machine code NumPy does it.
        """
        if self.code is not None:
            return self._by_code(x, lines)
        step = self.step
        table = self.table[lines.start : lines.stop] if len(self.table) > 1 else self.table
        values = dict(enumerate(x[:, : step.given].swapaxes(0, 1)))
        values.update(zip(step.table, table.swapaxes(0, 1), strict=True))
        evaluate(step.prologue, values)
        words = [np.broadcast_to(values[number], x[:, 0].shape) for number in step.lifted]
        return np.stack(words, axis=1), np.broadcast_to(values[step.turned], x[:, 0].shape)

    def _by_code(self, x, lines):
        step = self.step
        words, turned = np.empty((len(x), len(step.lifted), self.W)), np.empty(x[:, 0].shape, bool)
        for k, line in enumerate(lines):
            self.rows[: step.given] = x[k, : step.given]
            numbers = self._numbers_of(line % len(self.table))
            carry_out(self.code, self.program.runs, self.rows, numbers)
            found = self.rows[self.program.results]
            words[k], turned[k] = found[:-1], np.signbit(found[-1])
        return words, turned
