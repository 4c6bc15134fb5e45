"""Derivatives of fields of many variables along orbits: one trajectory, columns side by side.

Columns q of a trajectory become -DPhi q, as in `tangent`. Of sparse fields the lists of
`lists.step.Tangent` are carried out by runs, LANES columns at once; dense fields have loops.
"""

from typing import NamedTuple

import numpy as np
from numba import types

from ..code.runs import program_of
from ..code.runs_code import add_runs, truth_of
from ..code.text import Code
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
# Columns are orthonormalised after `pace` steps. It begins with 1, doubles where they have lost
# less than the square root of LIMIT, and halves where they have lost more than LIMIT. The row
# VOLUME of a line has the number of steps since then, plus PACE times the pace.
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
        self.column, numbers = program_of(tangent.column, shared, columns, tangent.products)
        self.gather = self.step.results[len(results) - len(shared) :][numbers.order]
        self.has_signs = tangent.changed is not None

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


def text_of_runs(_, name, *_others):
    """Return the text of i64 name(line, table, kept, plan, ignored, steps), for any `Plan`.

    It takes steps of a trajectory as that of `generated_tangent.text_of_tangent`.
    """
    text, columns = Code(1), Code(LANES)
    inner, integer = Code(LANES, text), text.integer
    add_runs(text, f"{name}_runs", False)
    add_runs(columns, f"{name}_columns", False, only_sums=True)
    text.begin(name, "line", "table", "kept", "plan", "ignored", "steps")
    a = Plan(*(text.load("i64", text.at("%plan", k)) for k in SLOT))
    last = text.memory(1)
    text.store("i64", 0, last)

    def of_line(k):
        """Return the address of number D + k of the line."""
        return text.at("%line", integer("add", a.D, k))

    def result(k):
        row = text.load("i64", text.at(a.results, integer("add", a.D, k)))
        return text.row("%kept", 0, row)

    with text.when(text.compare_integers("ne", integer("and", "%ignored", 1), 0)):
        text.leave("i64 %steps")
    with text.repeat() as goes_on:
        n = text.load("i64", last)
        text.copy("%line", "%kept", text.plus(a.D, LENGTHS))
        numbers = ", ".join(f"i64 {x}" for x in ("%kept", "%table", a.heads, a.places, a.runs))
        text.add(f"  call void @{name}_runs({numbers})")
        near_1, far = result(0), result(1)
        accurate, derived, negative, changed = (truth_of(text, result(2 + k)) for k in range(4))
        is_good = text.new(f"and i1 {accurate}, {derived}")
        with text.when(text.new(f"xor i1 {is_good}, true")):
            text.leave(f"i64 {integer('or', n, 1 << STEP)}")
        own, of_columns = integer("add", "%kept", a.numbers), integer("add", "%kept", a.columns)

        def gather(k):
            row = text.load("i64", text.at(a.gather, k))
            text.put(text.row("%kept", 0, row), own, 0, k)

        text.fold(a.gathered, {}, gather)
        first = of_line(text.plus(a.D, LENGTHS))
        zero = inner.constant(0.0)

        def multiply(k, squares):
            begin = integer("add", first, integer("mul", k, 8 * LANES))

            def place(i):
                return text.at(begin, integer("mul", i, a.width))

            def copy(i):
                inner.put(inner.load(inner.V, place(i)), of_columns, 0, i)

            inner.fold(a.D, {}, copy)
            numbers = of_columns, own, a.column_heads, a.column_places, a.column_runs
            text.add(f"  call void @{name}_columns({', '.join(f'i64 {x}' for x in numbers)})")

            def put(i, total):
                row = text.load("i64", text.at(a.column_results, i))
                value = inner.row(of_columns, 0, row)
                inner.store(inner.V, value, place(i))
                return {"total": inner.operate("fadd", total, inner.operate("fmul", value, value))}

            return {"squares": inner.fold(a.D, {"total": squares}, put)["total"]}

        count = integer("udiv", text.plus(a.D, LANES - 1), LANES)
        squares = inner.fold(count, {"squares": zero}, multiply)["squares"]
        length = text.constant(0.0)
        for k in range(LANES):
            square = text.new(f"extractelement {inner.V} {squares}, i32 {k}")
            length = text.operate("fadd", length, square)

        def put_state(i):
            row = text.load("i64", text.at(a.results, i))
            text.put(text.row("%kept", 0, row), "%line", 0, i)

        text.fold(a.D, {}, put_state)
        since = text.operate("fadd", text.load("double", of_line(VOLUME)), text.constant(1.0))
        for k, value in ((VOLUME, since), (NEAR_1, near_1), (FAR_FROM_1, far)):
            text.store("double", value, of_line(k))
        pace = text.operate("fmul", since, text.constant(1.0 / PACE))
        pace = text.floor(pace)
        since = text.operate("fsub", since, text.operate("fmul", pace, text.constant(PACE)))
        fine = [
            text.compare("olt", since, pace),
            text.compare("ogt", length, text.constant(LEAST_SIZE)),
            text.compare("olt", length, text.constant(LARGEST_SIZE)),
        ]
        inside = [
            text.compare("ogt", near_1, text.constant(NEAR_1_LEAST)),
            text.compare("olt", near_1, text.constant(NEAR_1_LARGEST)),
            text.compare("ogt", far, text.constant(LEAST_LENGTH)),
            text.compare("olt", far, text.constant(LARGEST_LENGTH)),
        ]
        flags = 0
        for truths, place in ((fine, DUE), (inside, OUTSIDE)):
            is_not = integer("xor", text.bits(text.joined("and", truths)), 1)
            flags = integer("or", flags, integer("shl", is_not, place))
        for truth, place in ((negative, NEGATIVE), (changed, CHANGED)):
            flags = integer("or", flags, integer("shl", text.bits(truth), place))
        taken = integer("add", n, 1)
        text.store("i64", taken, last)
        is_clear = text.compare_integers("eq", flags, 0)
        has_more = text.compare_integers("ult", taken, "%steps")
        goes_on.append(text.new(f"and i1 {is_clear}, {has_more}"))
    text.add(f"  ret i64 {integer('or', taken, flags)}")
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
    """Orthonormalise the columns of a trajectory, as `generated_tangent`, and set the pace."""
    p = _integers(plan, (2,))
    D, width = p[0], p[1]
    basis, part = _numbers(kept, (D, D)), _numbers(kept + 8 * D * D, (2, BLOCK))
    products = _numbers(carried, (LENGTHS + D,))
    loss = orthonormalise_columns(_numbers(columns, (D, width)), products, basis, part)
    since, pace = products[VOLUME] % PACE, products[VOLUME] // PACE
    if loss > LIMIT * LIMIT:
        pace //= 2
    elif loss < LIMIT and since >= pace:
        pace *= 2
    products[VOLUME] = PACE * min(max(pace, 1.0), LONGEST_PACE)
    return 0
