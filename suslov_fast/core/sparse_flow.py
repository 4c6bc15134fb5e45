"""Steps of `flow` for fields of many variables, by loops in place of code for each field.

Stages are those of `sparse`, and the list of operations that chooses the next length (`tolerance`)
is carried out as a long list (`listed`).
"""

import functools
from typing import Any, NamedTuple

import numpy as np

from .arrays import uncounted
from .elimination import simd_min
from .listed import Numbers, Program
from .listed_code import carry_out, runs_code
from .llvm import QUAD
from .numba import kernel
from .operations import of_one_sign
from .sparse import pattern_of, room_of, size_of, step_once
from .tolerance import Choice


@kernel
def sparse_stages(part, parts, pattern, halves, rows, least, memory):
    """Take a stage of all lanes; halves are (lines, W, T).

    The lines are rows[line, row, lane], whose first D rows are the states; the row `least` has the
    least pivot so far.
    """
    pattern, halves, rows = uncounted(pattern), uncounted(halves), uncounted(rows)
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
def sums_of_terms(part, parts, indices, values, x, sums):
    """Set the sums (D, W) of |terms of f_i|, of values (T, 1 or W) and states (D, W)."""
    (D, W), own = x.shape, int(values.shape[1] > 1)
    sums[:] = 0.0
    for t in range(len(values)):
        i, j, k = indices[0, t], indices[1, t], indices[2, t]
        for l in range(W):
            term = values[t, own * l]
            term *= x[j, l] if j < D else 1.0
            sums[i, l] += abs(term * x[k, l] if k < D else term)


class _Inputs(NamedTuple):
    """The attributes of a list that `Program` reads: how many inputs it has, and an empty table."""

    D: int
    places: Any
    table: Any


@functools.lru_cache(8)
def _choice_of(step):
    """Return the number of inputs of the `Choice` of sums, its `Program`, and the `Numbers`."""
    inputs, choice = 6 * step.D + 8, Choice(None, step.D, step.D, of_one_sign(step.indices))
    of_list = _Inputs(inputs, {}, [])
    numbers = Numbers(of_list)
    program = Program(of_list, choice.operations, choice.results, numbers)
    return inputs, program, numbers.of(np.empty((0, 1)))


class Loops:
    """The loops for motions with one `tolerance.Stage`, in lines of W lanes."""

    def __init__(self, step, W):
        self.pattern, self.D = pattern_of(step.indices.tobytes(), step.D), step.D
        self.indices = step.indices
        self.memory = np.empty(size_of(self.pattern))
        self.inputs, self.program, self.constants = _choice_of(step)
        self.code = runs_code(W)
        self.numbers = np.empty((self.program.rows, W))

    @staticmethod
    def halves(half, values):
        """Return h v of the terms (lines, W, T), from h (lines, W) and v (1 or lines, T, -)."""
        return np.ascontiguousarray(half[:, :, np.newaxis] * values.swapaxes(1, 2))

    def take_stage(self, rows, halves, places):
        """Take a stage of all lanes."""
        sparse_stages.serial(self.pattern, halves, rows, places.least, self.memory)

    def choose(self, rows, places, values, end, rtol):
        """Write the next state, largest moduli, time and length of all lanes."""
        D, numbers, sums = self.D, self.numbers, self.numbers[5 * self.D : 6 * self.D]
        for line, of_line in enumerate(rows):
            numbers[: 5 * D] = of_line[places.base : places.base + 5 * D]
            sums_of_terms.serial(self.indices, values[line % len(values)], numbers[:D], sums)
            numbers[6 * D : self.inputs - 2] = of_line[places.time : places.least + 1]
            numbers[self.inputs - 2], numbers[self.inputs - 1] = end, rtol
            carry_out(self.code, self.program.runs, numbers, self.constants)
            found = numbers[self.program.results]
            of_line[places.base : places.base + D] = found[:D]
            of_line[places.largest : places.largest + D] = found[D : 2 * D]
            of_line[places.time : places.time + 3] = found[2 * D :]
