"""Steps of fields of many variables: Python calls for a line of lanes, many stages at a time."""

import numpy as np

from .careful import CHANGED, arguments_of, careful
from .dense import dense_steps, spans_of
from .generated_stages import BASE
from .machine_code import call_procedure
from .sparse import is_sparse, pattern_of, size_of, sparse_steps
from .stages import distinct, weights_of


def in_calls(lines, take, arrays, start, steps, saved, until, between, abandoned):
    """Take so many stages of all lines; save states.

    take(line, place, most) takes up to `most` stages of a line with the fraction of eps at `place`
    of `distinct`, and returns how many it took, with bits of lanes: bad + 256 negative, as of
    `step_carefully`, in the last. Other arguments are those of `_Lines.take` and `CodeArguments`;
    `arrays` are those of `careful`.
    """
    stages, W, own = lines.scheme.stages, lines.W, arguments_of(arrays, start)
    weights, places = weights_of(stages), distinct(stages.fractions)[1]
    is_lifted, ended = lines.given < lines.D, lines.marks[0]
    at_once = _stages_at_once(stages, 1 if is_lifted else steps)
    for line in range(lines.count):
        n, row, saves_at = 0, 0, until
        lanes = slice(line * W, min((line + 1) * W, lines.B))
        while n < steps and not abandoned:
            stage = n % len(weights)
            if is_lifted and stage == 0:
                lines.lift(arrays, start, n, slice(line, line + 1))
            most = min(at_once[stage], steps - n)
            if saves_at >= 0:
                most = min(most, saves_at - n + 1)
            taken, bits = take(line, places[stage], most)
            n += taken
            stage = (n - 1) % len(weights)
            if bits:
                call_procedure(careful.address, own, line, bits & 255, bits >> 8, n - 1)
            is_whole = lines.columns is not None and stage == len(weights) - 1
            if weights[stage, 0]:
                of = slice(line, line + 1)
                [finite] = lines.end_column(weights[stage], stage == len(weights) - 1, of)
                bad = int(~(finite | ended[line])) & (2**W - 1)
                if bad:
                    call_procedure(careful.address, own, line, bad, 0, n - 1)
            if is_whole:
                [told] = lines.changed(slice(line, line + 1))
                if told:
                    call_procedure(careful.address, own, line, 0, int(told) << CHANGED, n - 1)
                lines.columns[line, BASE] = lines.x[line]
            if n - 1 == saves_at:
                saved[row, lanes] = lines.x[line, : lines.given].T[: lanes.stop - lanes.start]
                row, saves_at = row + 1, saves_at + between + 1


def _stages_at_once(stages, steps):
    """Return, for each stage, how many have its fraction from there on; a column has its own."""
    fractions = stages.fractions
    if len(fractions) == 1:
        return [steps]
    counts = [1] * len(fractions)
    for k in range(len(fractions) - 2, -1, -1):
        if fractions[k] == fractions[k + 1]:
            counts[k] += counts[k + 1]
    return counts


def taker_without_plan(lines):
    """Return the function that takes steps of a line without a list of operations, see `in_calls`.

    Sparse fields are stepped by `sparse`, others by `dense`.
    """
    (step, stages), (ended, passed) = lines.scheme, lines.marks
    W, D = lines.W, lines.D
    fractions, kept = distinct(stages.fractions)[0], {}
    tells, taken = lines.given == D, np.zeros(2, np.int64)  # `lift` tells poles of lifted fields
    tells_signs = int(tells and len(stages.fractions) == 1)
    if is_sparse(step):
        pattern = pattern_of(step.indices.tobytes(), D)
        steps, memory = sparse_steps, np.empty(size_of(pattern))

        def prepared(half):
            return pattern, np.ascontiguousarray(half.T)
    else:
        field = spans_of(step)
        steps, shapes = dense_steps, ((D, D + 1), (D + 1, D), (D + 1,))
        memory = tuple(np.empty((W, *shape)) for shape in shapes)

        def prepared(half):
            return field, np.ascontiguousarray(half[field.terms].T)

    def take(line, place, most):
        of_line = line % len(lines.halves)
        if (of_line, place) not in kept:
            if lines.for_each:
                kept.clear()  # coefficients of all members would fill the memory
            kept[of_line, place] = prepared(fractions[place] * lines.halves[of_line])
        marks = int(ended[line]), int(passed[line]) if tells else 2**W - 1, tells_signs
        taken[:] = most, 0
        steps.serial(*kept[of_line, place], marks, lines.x[line], memory, taken)
        return map(int, taken)

    return take
