"""Words of states of lifted fields, and whether a step from there passes a pole."""

import functools

import numpy as np

from .lift import needed_for
from .listed import program_of
from .listed_code import carry_out, runs_code
from .operations import OF_LIBRARY, evaluate


def words_of(step, x, table):
    """Return the words (lines, D - given, W) of states (lines, D, W), and truth values (lines, W).

    `table` (1 or lines, -, W) has the values of `step.table`. A field without a plan has a long
    list of operations, which a loop carries out; NumPy carries out others.
    """
    lines, _, W = x.shape
    code = None if step.usual else runs_code(W)
    if code is not None:
        found = [
            _long_list(step).carry_out(code, x[k], table[k % len(table)]) for k in range(lines)
        ]
        return np.array([words for words, _ in found]), np.array([turned for _, turned in found])
    values = dict(enumerate(x[:, : step.given].swapaxes(0, 1)))
    values.update(zip(step.table, table.swapaxes(0, 1), strict=True))
    evaluate(step.prologue, values)
    words = [np.broadcast_to(values[number], (lines, W)) for number in step.lifted]
    return np.stack(words, axis=1), np.broadcast_to(values[step.turned], (lines, W))


class _LongList:
    """The prologue of a step: what functions of the C library need by NumPy, the rest in runs."""

    def __init__(self, step):
        operations = step.prologue
        library = [number for instruction, number, _ in operations if instruction in OF_LIBRARY]
        self.step, self.first = step, needed_for(library, operations)
        known = [*range(step.given), *step.table, *(number for _, number, _ in self.first)]
        rest = [operation for operation in operations if operation[1] not in {*known}]
        used = {a for *_, operands in rest for a in operands if not isinstance(a, float)}
        self.inputs = [number for number in known if number in used]
        names = {number: k for k, number in enumerate(self.inputs)}
        renamed = []
        for instruction, number, operands in rest:
            operands = tuple(a if isinstance(a, float) else names[a] for a in operands)
            names[number] = len(names)
            renamed.append((instruction, names[number], operands))
        # As a number, because rows of lanes have no truth values.
        turned = len(names)
        renamed.append(("select", turned, (names[step.turned], 1.0, 0.0)))
        made = {number for _, number, _ in rest}
        self.words = [number for number in step.lifted if number in made]
        results = [*(names[number] for number in self.words), turned]
        self.program, self.constants = program_of(len(self.inputs), renamed, results)

    def carry_out(self, code, x, table):
        """Return the words (D - given, W) of states (D, W), and truth values (W,)."""
        values = dict(enumerate(x[: self.step.given]))
        values.update(zip(self.step.table, table, strict=True))
        evaluate(self.first, values)
        rows = np.empty((self.program.rows, x.shape[1]))
        for k, number in enumerate(self.inputs):
            rows[k] = values[number]
        carry_out(code, self.program.runs, rows, self.constants)
        *words, turned = rows[self.program.results]
        values.update(zip(self.words, words, strict=True))
        words = [np.broadcast_to(values[number], turned.shape) for number in self.step.lifted]
        return np.array(words), turned == 1.0


@functools.lru_cache(8)
def _long_list(step):
    return _LongList(step)
