"""Steps of `flow` for fields of many variables, by loops in place of code for each field.

Stages are those of `sparse`, and the list of operations that chooses the next length (`tolerance`)
is carried out as a long list (`listed`).
"""

import functools

import numpy as np

from .arrays import uncounted
from .elimination import simd_min
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
    least pivot so far.
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
            pivot = rows[line, least, lane]
            for i in range(D):
                x[i, lane] = after[i * QUAD + l]
                pivot = simd_min(1.0 + room.pivots[i * QUAD + l], pivot)
            rows[line, least, lane] = pivot


@kernel
def sums_of_terms(part, parts, indices, values, x, sums, of_moduli):
    """Set the sums (D, W) of terms, or of moduli, of values (T, 1 or W) and states (D, W)."""
    (D, W), own = x.shape, int(values.shape[1] > 1)
    sums[:] = 0.0
    for t in range(len(values)):
        i, j, k = indices[0, t], indices[1, t], indices[2, t]
        for l in range(W):
            term = values[t, own * l]
            term *= x[j, l] if j < D else 1.0
            term *= x[k, l] if k < D else 1.0
            sums[i, l] += abs(term) if of_moduli else term


@functools.lru_cache(8)
def _programs_of(step):
    """Return the `Program` and its numbers, for the `Beginning` and the `Choice` of sums."""
    D = step.D
    even = with_constant_rates(step.indices, D)
    choice = Choice(None, D, D, of_one_sign(step.indices), even)
    lists = (2 * D + 2, Beginning(None, D, D)), (6 * D + 9, choice)
    return [program_of(inputs, each.operations, each.results) for inputs, each in lists]


class Loops:
    """The loops for motions with one `tolerance.Stage`, in lines of W lanes."""

    def __init__(self, step, W):
        self.pattern, self.D = pattern_of(step.indices.tobytes(), step.D), step.D
        self.indices = step.indices
        self.memory = np.empty(size_of(self.pattern))
        self.beginning, self.choice = _programs_of(step)
        self.code = runs_code(W)
        rows = max(program.rows for program, _ in (self.beginning, self.choice))
        self.numbers = np.empty((rows, W))

    @staticmethod
    def halves(half, values):
        """Return h v of the terms (lines, W, T), from h (lines, W) and v (1 or lines, T, -)."""
        return np.ascontiguousarray(half[:, :, np.newaxis] * values.swapaxes(1, 2))

    def take_stage(self, rows, halves, places):
        """Take a stage of all lanes."""
        sparse_stages.serial(self.pattern, halves, rows, places.least, self.memory)

    def begin(self, rows, places, values, rtol):
        """Write the largest moduli and first lengths of all lanes."""
        after = [places.wanted, places.first]
        self._carry_out(self.beginning, rows, places, values, 1, [places.wanted], [rtol], after)

    def choose(self, rows, places, values, end, rtol):
        """Write the next state, largest moduli, time and length of all lanes."""
        first, after = range(places.time, places.least + 1), range(places.time, places.taken)
        self._carry_out(self.choice, rows, places, values, 5, first, [end, rtol], after)

    def _carry_out(self, of_list, rows, places, values, count, first, others, after):
        """Carry out a list for all lanes.

        Its values are `count` numbers of each component from the state on, sums of terms, those of
        the rows `first`, and `others`; it writes the state, largest moduli, and rows `after`.
        """
        (program, constants), D, numbers = of_list, self.D, self.numbers
        sums, scalars = numbers[count * D : (count + 1) * D], numbers[(count + 1) * D :]
        for line, of_line in enumerate(rows):
            numbers[: count * D] = of_line[places.base : places.base + count * D]
            own = values[line % len(values)]
            sums_of_terms.serial(self.indices, own, numbers[:D], sums, of_list is self.choice)
            scalars[: len(first)] = of_line[first]
            scalars[len(first) : len(first) + len(others)] = np.reshape(others, (-1, 1))
            carry_out(self.code, program.runs, numbers, constants)
            found = numbers[program.results]
            of_line[places.base : places.base + D] = found[:D]
            of_line[places.largest : places.largest + D] = found[D : 2 * D]
            of_line[after] = found[2 * D :]
