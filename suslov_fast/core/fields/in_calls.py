"""Steps of fields of many variables: Python calls for a line of lanes, many stages at a time."""

import numpy as np

from ..code.compiler import call, call_procedure
from ..code.runs import programs_of
from ..code.runs_code import SLOT, ListArguments
from ..compiling.codes import CHANGED
from .careful import arguments_of, careful
from .dense import dense_steps, spans_of
from .lines import zeros
from .stages import distinct


def in_calls(lines, take, arrays, start, steps, saved, until, between, abandoned):
    """Take so many stages of all lines; save states.

    take(line, stage, most) takes up to `most` stages of a line from this one on, and returns how
    many it took, with bits of lanes: bad + 256 negative, as of `step_carefully`, in the last. Other
    arguments are those of `_Lines.take` and `CodeArguments`; `arrays` are those of `careful`.
    """
    W, own, at_once = lines.W, arguments_of(arrays, start), _stages_at_once(lines, steps)
    stages = len(at_once)
    for line in range(lines.count):
        n, row, saves_at = 0, 0, until
        lanes = slice(line * W, min((line + 1) * W, lines.B))
        while n < steps and not abandoned:
            stage = n % stages
            most = min(at_once[stage], steps - n)
            if saves_at >= 0:
                most = min(most, saves_at - n + 1)
            taken, bits = take(line, stage, most)
            n += taken
            stage = (n - 1) % stages
            if bits >> 8:  # first, because a lane may also be one of those that took no step
                call_procedure(careful.address, own, line, 0, bits >> 8, n - 1)
            if bits & 255:
                call_procedure(careful.address, own, line, bits & 255, 0, n - 1)
            if lines.bases is not None and stage == stages - 1:
                [told] = lines.changed(slice(line, line + 1))
                if told:
                    call_procedure(careful.address, own, line, 0, int(told) << CHANGED, n - 1)
                lines.bases[line] = lines.x[line]
            if n - 1 == saves_at:
                saved[row, lanes] = lines.x[line].T[: lanes.stop - lanes.start]
                row, saves_at = row + 1, saves_at + between + 1


def _stages_at_once(lines, steps):
    """Return, for each stage, how many may be taken at once from there on.

    They have the same fraction if loops over terms take them, and end with the whole step if signs
    are compared over it.
    """
    fractions = lines.scheme.stages.fractions
    count, has_lists = len(fractions), bool(lines.scheme.step.usual)
    if count == 1 or (has_lists and lines.bases is None):
        return [steps] * count
    counts = [1] * count
    for k in range(count - 2, -1, -1):
        if fractions[k] == fractions[k + 1] or has_lists:
            counts[k] += counts[k + 1]
    return counts


def taker_without_plan(lines):
    """Return the function that takes steps of a line of a dense field, see `in_calls`."""
    (step, stages), (ended, passed) = lines.scheme, lines.marks
    W, D = lines.W, lines.D
    (fractions, places), kept = distinct(stages.fractions), {}
    tells_signs, taken = int(len(stages.fractions) == 1), np.zeros(2, np.int64)
    field, shapes = spans_of(step), ((D, D + 1), (D + 1, D), (D + 1,))
    memory = tuple(np.empty((W, *shape)) for shape in shapes)

    def take(line, stage, most):
        of_line, place = line % len(lines.halves), places[stage]
        if (of_line, place) not in kept:
            if lines.for_each:
                kept.clear()  # coefficients of all members would fill the memory
            half = fractions[place] * lines.halves[of_line]
            kept[of_line, place] = np.ascontiguousarray(half[field.terms].T)
        marks = int(ended[line]), int(passed[line]), tells_signs
        taken[:] = most, 0
        dense_steps.serial(field, kept[of_line, place], marks, lines.x[line], memory, taken)
        return map(int, taken)

    return take


def taker_of(lines, address):
    """Return the function that takes steps of a line with `listed_code`, see `in_calls`."""
    (step, stages), W, D = lines.scheme, lines.W, lines.D
    programs, (ended, passed) = programs_of(step), lines.marks
    places, tables = distinct(stages.fractions)[1], {}
    numbers = dict.fromkeys(ListArguments._fields, 0) | {
        "changed": 2 if step.changed is None else 3, "D": D, "stages": len(places),
    }  # fmt: skip
    arguments, ready, rows = np.array(ListArguments(**numbers), np.int64), [], []

    def prepare(program, first):
        """Give the code a program, from this slot on, and rows for all programs."""
        # `programs_of` may forget them, and does not keep those of all threads that begin at once.
        ready.append(program)
        heads, of_runs = program.runs
        of_program = heads.ctypes.data, of_runs.ctypes.data, len(heads), program.results.ctypes.data
        arguments[first : first + 4] = of_program
        rows[:] = [zeros(max(each.rows for each in ready), W)]
        arguments[SLOT.rows] = rows[0].ctypes.data
        tables.clear()

    def tables_of(line):
        """Return for each program the addresses of the numbers of all stages."""
        if line not in tables:
            tables.clear()  # of one line, because those of all may fill the memory
            own = [[each.numbers.of(table[line]) for table in lines.table] for each in ready]
            addresses = [[each[k].ctypes.data for k in places] for each in own]
            tables[line] = np.array(addresses, np.int64), own
        return tables[line][0]

    def take(line, stage, most):
        of_stages = tables_of(line % lines.table.shape[1])
        arguments[SLOT.tables] = of_stages[0].ctypes.data
        arguments[SLOT.rare_tables] = of_stages[-1].ctypes.data
        rows[0][:D], arguments[SLOT.stage] = lines.x[line], stage
        arguments[SLOT.ended], arguments[SLOT.passed] = ended[line], passed[line]
        arguments[SLOT.steps] = most
        bits = call(address, arguments)
        lines.x[line], taken = rows[0][:D], int(arguments[SLOT.n])
        if bits < 0:  # a step needs the other program for the first time
            prepare(programs.rare, SLOT.rare_heads)
            return (taken, 0) if taken else take(line, stage, most)
        return taken, bits

    prepare(programs.usual, SLOT.heads)
    return take
