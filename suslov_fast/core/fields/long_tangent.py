"""Derivatives of fields of many variables along orbits: one trajectory, columns side by side.

Columns q of a trajectory become -DPhi q, as in `tangent`. Of sparse fields the lists of
`lists.step.Tangent` are carried out by runs, LANES columns at once; dense fields have loops.
"""

from typing import NamedTuple

import numpy as np
from numba import types

from ..code.runs import program_of
from ..code.runs_code import add_runs, truth_of
from ..code.text import Carried, Code, Index, Integers, Value
from ..compiling.arrays import array_at
from ..compiling.elimination import simd_max
from ..compiling.llvm import lesser
from ..compiling.numba import c_function, function, inlined
from .careful import crosses_0
from .dense import fill, solve_rows, spans_of
from .generated_tangent import (
    CHANGED,
    DUE,
    FAR_FROM_1,
    LARGEST_LENGTH,
    LARGEST_SIZE,
    LEAST_LENGTH,
    LEAST_SIZE,
    LENGTHS,
    LIMIT,
    NEAR_1,
    NEAR_1_LARGEST,
    NEAR_1_LEAST,
    NEGATIVE,
    OUTSIDE,
    STEP,
    VOLUME,
)

LANES = 16  # columns that runs multiply at once
BLOCK = 64  # columns that loops multiply at once, because their rows stay in the caches
# Columns are orthonormalised after `pace` steps. It begins with 1, and doubles where they have lost
# less than the square root of LIMIT. Where they have lost more than LIMIT, these steps are taken
# again, half as many at once, down to 1. (The rule of `generated_tangent` bounds the loss of all
# columns together: of 64 on a chaotic orbit it is that of one to the power of 10.) The row VOLUME
# of a line has the number of steps since then, plus PACE times the pace.
PACE, LONGEST_PACE = 32.0, 16.0


def width_of(D):
    """Return the numbers of a row of columns: its lines of the caches are in different sets."""
    return LANES * (-(-D // LANES) | 1)


# --------------------------------------------------------------------------- sparse fields, by runs
class Plan(NamedTuple):
    """The integers of the array that the code of `text_of_runs` takes."""

    D: int
    width: int  # numbers of a row of columns
    heads: int  # of the program of a step: addresses of its `Runs`, and their number
    places: int
    runs: int
    results: int  # address of the rows of its results, see `Lists`
    column_heads: int  # the same of the program of columns
    column_places: int
    column_runs: int
    column_results: int
    gather: int  # address of the rows, of a step, of the numbers that columns read
    gathered: int  # how many
    columns: int  # where in the memory `kept` the rows of columns begin, in bytes
    numbers: int  # and where these numbers


SLOT = Plan(*range(len(Plan._fields)))


class Lists:
    """The programs of a step with its derivative, and of a column.

    The results of the first are the next state, NEAR_1, FAR_FROM_1, the truth values `accurate`,
    `derived`, `negative` and `changed`, and the numbers that columns read.
    """

    def __init__(self, tangent):
        D, first = tangent.D, tangent.D + tangent.T
        columns, constants = [], {}
        number = 1 + max(number for _, number, _ in tangent.columns)
        for instruction, own, operands in tangent.columns:
            for a in operands:
                if isinstance(a, float):
                    constants.setdefault(a, number + len(constants))
            columns.append((instruction, own, tuple(constants.get(a, a) for a in operands)))
        of_columns = {*tangent.column, *(own for _, own, _ in columns)}
        shared = dict.fromkeys(a for *_, operands in columns for a in operands)
        shared = [a for a in shared if a not in of_columns]
        operations = [*tangent.usual, *tangent.rare]
        operations += [("fadd", own, (a, -0.0)) for a, own in constants.items()]
        changed = tangent.negative if tangent.changed is None else tangent.changed
        results = [*tangent.after_rare, *tangent.scaled[NEAR_1:], tangent.accurate]
        results += [tangent.derived, tangent.negative, changed, *shared]
        rows = [*range(D), *range(first, first + LENGTHS)]
        self.step, self.numbers = program_of(rows, tangent.table, operations, results)
        self.column, _ = program_of(tangent.column, shared, columns, tangent.products)
        self.gather = self.step.results[len(results) - len(shared) :]

    def plan(self, D):
        """Return the array that the code takes, and the numbers of memory that it needs."""
        programs, numbers = (self.step, self.column), []
        for program in programs:
            heads, places = program.runs
            numbers += heads.ctypes.data, places.ctypes.data, len(heads)
            numbers.append(program.results.ctypes.data)
        columns = -(-self.step.rows // LANES) * LANES
        last = columns + self.column.rows * LANES
        where = self.gather.ctypes.data, len(self.gather), 8 * columns, 8 * last
        return np.array(Plan(D, width_of(D), *numbers, *where), np.int64), last + len(self.gather)


def text_of_runs(name):
    """Return the text of i64 name(line, table, kept, plan, ignored, steps), for any `Plan`.

    It takes steps of a trajectory as that of `generated_tangent.text_of_tangent`.
    """
    text, columns = Code(1), Code(LANES)
    inner = Code(LANES, text)
    add_runs(text, f"{name}_runs", False)
    add_runs(columns, f"{name}_columns", False, only_sums=True)
    text.begin(name, "line", "table", "kept", "plan", "ignored", "steps")
    plan, line, kept = Integers(text, "%plan"), text.array("%line"), text.array("%kept")
    a = Plan(*(plan[k] for k in SLOT))
    results, of_column = Integers(text, a.results), Integers(text, a.column_results)
    gathered, numbers = Integers(text, a.gather), text.array(kept.at() + a.numbers)
    of_columns, numbers_of_line = inner.array(kept.at() + a.columns), line.from_here(a.D)
    first = line.at(a.D + a.D) + 8 * LENGTHS
    with text.when((Index(text, "%ignored") & 1).differs(0)):
        text.leave("i64 %steps")
    for now in text.rounds(Carried(n=0)):
        text.copy(line, kept, a.D + LENGTHS)
        text.invoke(f"{name}_runs", kept, "%table", a.heads, a.places, a.runs)
        others = [kept[results[a.D + k]] for k in range(6)]
        near_1, far = others[:2]
        accurate, derived, negative, changed = (truth_of(text, x) for x in others[2:])
        with text.when(~(accurate & derived)):
            text.leave(f"i64 {now.n | 1 << STEP}")
        for k in text.each(a.gathered):
            numbers[k] = kept[gathered[k]]
        squares = Carried(of_lanes=inner.value(0.0))
        for k in text.each((a.D + (LANES - 1)) // LANES, squares):
            begin = first + k * (8 * LANES)

            def part_of_row(i, begin=begin):
                return inner.array(begin + i * a.width * 8)

            for i in text.each(a.D):
                of_columns[i] = part_of_row(i)[0]
            given = numbers, a.column_heads, a.column_places, a.column_runs
            text.invoke(f"{name}_columns", of_columns, *given)
            for i in text.each(a.D, squares):
                value = of_columns[of_column[i]]
                part_of_row(i)[0] = value
                squares.of_lanes = squares.of_lanes + value * value
        length = text.value(0.0)
        for k in range(LANES):
            lane = text.new(f"extractelement {inner.V} {squares.of_lanes}, i32 {k}")
            length = length + Value(text, lane)
        for i in text.each(a.D):
            line[i] = kept[results[i]]
        since = numbers_of_line[VOLUME] + 1.0
        for k, value in ((VOLUME, since), (NEAR_1, near_1), (FAR_FROM_1, far)):
            numbers_of_line[k] = value
        pace = (since * (1.0 / PACE)).floor()
        fine = since - pace * PACE < pace
        fine = fine & (length > LEAST_SIZE) & (length < LARGEST_SIZE)
        inside = (near_1 > NEAR_1_LEAST) & (near_1 < NEAR_1_LARGEST)
        inside = inside & (far > LEAST_LENGTH) & (far < LARGEST_LENGTH)
        flags = (~fine).bits() << DUE | (~inside).bits() << OUTSIDE
        flags = flags | negative.bits() << NEGATIVE | changed.bits() << CHANGED
        now.n = now.n + 1
        now.goes_on = flags.equals(0) & (now.n < "%steps")
    text.add(f"  ret i64 {now.n | flags}")
    return "\n".join([*columns.lines, text.finished()])


# --------------------------------------------------------------------------------- dense fields
@inlined
def _numbers(address, shape):
    return array_at(address, shape, np.float64)


@inlined
def _integers(address, shape):
    return array_at(address, shape, np.int64)


class DensePlan(NamedTuple):
    """The integers of the array for `take_dense_steps`; the first two are those of `Plan`."""

    D: int
    width: int
    spans: int  # address of `Spans.spans`, and their number
    count: int
    T: int
    of_one_sign: int  # address of `Spans.of_one_sign`


PLACE = DensePlan(*range(len(DensePlan._fields)))


def dense_plan(step):
    """Return the array for `take_dense_steps`, the order of its terms, and what stays alive.

    And the numbers of memory that it needs.
    """
    spans, terms, of_one_sign = alive = spans_of(step)
    D, lengths = step.D, (len(spans), step.T)
    plan = DensePlan(D, width_of(D), spans.ctypes.data, *lengths, of_one_sign.ctypes.data)
    kept = 3 * D * (D + 1) + D * (D + 1) + (D + 1)
    return np.array(plan, np.int64), terms, kept + D * width_of(D), alive


@function
def subtract(target, factor, source):
    """Subtract a multiple of an array."""
    for c in range(len(target)):
        target[c] -= factor * source[c]


@function
def multiply(factors, matrix, columns, new):
    """Replace columns q (D, -) by -(1 - N)**-1 (1 - M) q; `new` is memory of the same shape.

    `factors` (D, D + 1) are those of `solve_rows` of 1 - N, and `matrix` is 1 - M.
    """
    D = len(factors)
    for begin in range(0, D, BLOCK):
        end = lesser(begin + BLOCK, D)
        for i in range(D):
            row = new[i, begin:end]
            for c in range(len(row)):
                row[c] = 0.0
            for j in range(D):
                subtract(row, matrix[i, j], columns[j, begin:end])
            for k in range(i):
                subtract(row, factors[i, k], new[k, begin:end])
        for i in range(D - 1, -1, -1):
            row, result = new[i, begin:end], columns[i, begin:end]
            for j in range(i + 1, D):
                subtract(row, factors[i, j], columns[j, begin:end])
            for c in range(len(row)):
                result[c] = row[c] * factors[i, i]


@c_function(types.int64(*[types.int64] * 6))
def take_dense_steps(line, table, kept, plan, ignored, steps):
    """Take steps of a trajectory with columns, as the code of `text_of_runs`.

    The table has h v of the terms, in the order of the plan, and -h v after them.
    """
    if ignored & 1:
        return steps
    p = _integers(plan, (len(PLACE),))
    D, width, T = p[PLACE.D], p[PLACE.width], p[PLACE.T]
    spans = _integers(p[PLACE.spans], (p[PLACE.count], 5))
    of_one_sign = array_at(p[PLACE.of_one_sign], (D,), np.bool_)
    half, minus = _numbers(table, (1, T)), _numbers(table + 8 * T, (1, T))
    size = 8 * D * (D + 1)
    factors, back = _numbers(kept, (1, D, D + 1)), _numbers(kept + size, (1, D, D + 1))
    matrix, memory = _numbers(kept + 2 * size, (D, D + 1)), _numbers(kept + 3 * size, (1, D + 1, D))
    states = _numbers(kept + 4 * size, (1, D + 1))
    new = _numbers(kept + 4 * size + 8 * (D + 1), (D, width))
    x, products = _numbers(line, (D,)), _numbers(line + 8 * D, (LENGTHS + D,))
    columns = _numbers(line + 8 * (2 * D + LENGTHS), (D, width))
    for n in range(steps):
        states[0, D] = 1.0
        for i in range(D):
            states[0, i] = x[i]
        fill(spans, half, states, memory, factors)
        good, negative = solve_rows(factors[0], np.inf)
        finite = 0.0
        for i in range(D):
            states[0, i] = factors[0, i, D]
            finite += 0.0 * states[0, i]
        fill(spans, minus, states, memory, back)
        for i in range(D):
            for j in range(D):
                matrix[i, j] = back[0, i, j]
        derived, _ = solve_rows(back[0], 1.0)
        if not (good and derived and finite == 0.0):
            return n | 1 << STEP
        multiply(factors[0], matrix, columns, new)
        length, changed, quotient = 0.0, False, 1.0
        for i in range(D):
            quotient *= abs(factors[0, i, i] / back[0, i, i])
            changed |= of_one_sign[i] and crosses_0(x[i], states[0, i])
            x[i] = states[0, i]
            for r in range(D):
                length += columns[i, r] * columns[i, r]
        products[FAR_FROM_1] *= quotient
        products[VOLUME] += 1.0
        since, pace = products[VOLUME] % PACE, products[VOLUME] // PACE
        flags = np.int64(negative) << NEGATIVE | np.int64(changed) << CHANGED
        if since >= pace or not (LEAST_SIZE < length < LARGEST_SIZE):
            flags |= 1 << DUE
        if not (LEAST_LENGTH < products[FAR_FROM_1] < LARGEST_LENGTH):
            flags |= 1 << OUTSIDE
        if flags:
            return (n + 1) | flags
    return steps


# ---------------------------------------------------------------------------- orthonormal columns
@function
def orthonormalise_columns(columns, products, basis, part):
    """Orthonormalise columns (modified Gram-Schmidt), and multiply products by their lengths.

    Return the square of the largest part of a column's length that it lost. `basis` (D, D) receives
    the columns as rows; `part` (2, BLOCK) is memory. Blocks of columns stay in the caches, which
    those of `generated_tangent`, for few variables, do anyway.
    """
    D, loss, before = len(basis), 1.0, part[0]
    for begin in range(0, D, BLOCK):
        end = lesser(begin + BLOCK, D)
        for c in range(end - begin):
            before[c] = 0.0
        for i in range(D):
            row = columns[i, begin:end]
            for c in range(len(row)):
                before[c] += row[c] * row[c]
        for s in range(end):
            q = basis[s]
            if s >= begin:
                square = 0.0
                for i in range(D):
                    square += columns[i, s] * columns[i, s]
                length = np.sqrt(square)
                products[LENGTHS + s] *= length
                inverse = 0.0 if length == 0.0 else 1.0 / length
                loss = simd_max(before[s - begin] / square, loss) if square > 0.0 else np.inf
                for i in range(D):
                    columns[i, s] *= inverse
                    q[i] = columns[i, s]
            first = s + 1 if s >= begin else begin
            dots = part[1, : end - first]
            for c in range(len(dots)):
                dots[c] = 0.0
            for i in range(D):
                subtract(dots, -q[i], columns[i, first:end])
            for i in range(D):
                subtract(columns[i, first:end], q[i], dots)
    return loss


@c_function(types.int64(*[types.int64] * 5))
def orthonormalise(columns, carried, due, kept, plan):
    """Orthonormalise the columns of a trajectory, as `generated_tangent`, and set the pace.

    Return what the row VOLUME shall be where the steps since then are taken again, else 0.
    """
    p = _integers(plan, (2,))
    D, width = p[0], p[1]
    basis, part = _numbers(kept, (D, D)), _numbers(kept + 8 * D * D, (2, BLOCK))
    products = _numbers(carried, (LENGTHS + D,))
    loss = orthonormalise_columns(_numbers(columns, (D, width)), products, basis, part)
    since, pace = products[VOLUME] % PACE, products[VOLUME] // PACE
    if loss > LIMIT * LIMIT:
        pace = since // 2
    elif loss < LIMIT and since >= pace:
        pace *= 2
    products[VOLUME] = PACE * min(max(pace, 1.0), LONGEST_PACE)
    return np.int64(products[VOLUME]) if loss > LIMIT * LIMIT and since > 1 else 0
