"""Derivatives of Kahan's map of a quadratic field, and the growth of lengths under their products.

With h = eps / 2, N(x) = h f'(x) and M(x) = -N(x), the derivative is

DPhi(x) = (1 - N(x))**-1 (1 - M(x_next))    (theory, section 7).

Fields have terms as in `fields.steps`, and so have the fields of bodies. Machine code
(`generated_tangent`) takes the steps of a line of lanes, multiplies columns q by -DPhi, and tells
which lanes need logarithms, orthonormal columns, or elimination with pivoting.

jacobians   a kernel: DPhi at states
growth      a kernel: logarithms of lengths and determinants along orbits

With the sums (B, D) and of_det (B,) of `growth`, the first D - 1 Lyapunov exponents after N steps
are sums[:, :-1] / N, and the last one is (of_det - sums[:, :-1].sum(axis=1)) / N. So the sum of all
is the mean of log |det DPhi|, to rounding. (If one of the first is -inf, the last is
sums[:, -1] / N.)
"""

import functools
import math
from typing import Any, NamedTuple

import numpy as np

from ..code.compiler import code_of, common_code_of
from ..compiling.arrays import keep, uncounted
from ..compiling.codes import NONFINITE, OK, PASSED_POLE
from ..compiling.llvm import call_code, lesser
from ..compiling.numba import function, inlined, kernel, share
from ..lists import sizes
from ..lists.step import Tangent, length_of
from . import long_tangent
from .careful import changes_sign
from .careful_tangent import copy_lanes, solve_lanes
from .driver import WIDTH
from .generated_tangent import (
    CHANGED,
    DERIVATIVE,
    DUE,
    LARGEST_LENGTH,
    LEAST_LENGTH,
    LENGTHS,
    NEAR_1,
    NEAR_1_LARGEST,
    NEAR_1_LEAST,
    NEGATIVE,
    OUTSIDE,
    SOON,
    STEP,
    VOLUME,
    room_of,
    text_of_orthonormalise,
    text_of_tangent,
)
from .lines import tables_of
from .stages import Scheme, distinct

# Steps, after which columns that lose digits soon are orthonormalised, too: those of several lanes
# at once, which takes no longer than those of one.
INTERVAL = 8


class Arguments(NamedTuple):
    """The arguments of `growth` and `jacobians` for trajectories in lines of W lanes."""

    step: int  # address of the code of `text_of_tangent` or `long_tangent`
    orthonormalise: int  # that of `text_of_orthonormalise` or `long_tangent`; `growth` needs it
    plan: int  # address of a `long_tangent.Plan`, 0 for the other code
    W: int
    room: int  # see `room_of`
    kept: int  # numbers of memory for `long_tangent`
    indices: Any  # (3, T)
    table: Any  # (fractions, 1 or lines, n, 1 or W)
    halves: Any  # (1 or lines, T, 1 or W)
    fractions: Any  # (stages,)
    tables: Any  # (stages,), places in `table`
    has_signs: int  # 1 if components keep their signs along the motion
    unable: Any  # (1,), 1 after a lane needed `solve`
    solves: Any  # True if the kernels compute such lanes, None if they are compiled without `solve`


@functools.lru_cache(32)
def tangent_of(step):
    """Return the `Tangent` of a step, empty if it has no plan."""
    return Tangent(step.indices, step.D, step.keeps_signs)


_lists_of = functools.lru_cache(8)(long_tangent.Lists)


def _long_arguments(scheme, values, eps, has_list):
    """Return the first fields of `Arguments` for `long_tangent`, and what has to stay alive."""
    step = scheme.step
    if has_list:
        tangent = tangent_of(step)
        lists = _lists_of(tangent)
        plan, kept = lists.plan(step.D)
        code = common_code_of(long_tangent.text_of_runs)
        halves, table = tables_of(Scheme(tangent, scheme.stages), values, eps, 1)
        table = np.array([[lists.numbers.of(line) for line in lines] for lines in table])
    else:
        plan, terms, kept, lists = long_tangent.dense_plan(step)
        code = long_tangent.take_dense_steps.address
        halves = (0.5 * eps[:, np.newaxis] * values)[..., np.newaxis]
        fractions = distinct(scheme.stages.fractions)[0][:, np.newaxis, np.newaxis, np.newaxis]
        table = np.ascontiguousarray(fractions * halves[:, [*terms, *terms]])
        table[:, :, len(terms) :] *= -1.0
    kept = max(kept, step.D**2 + 2 * long_tangent.BLOCK)
    codes = code, long_tangent.orthonormalise.address
    fixed = plan.ctypes.data, 1, int(plan[1]), kept, step.indices, table, halves
    return (*map(int, codes), *fixed), (codes, plan, lists)


def arguments_of(scheme, values, eps, count, in_lines=False):
    """Return the arguments of the kernels for `count` trajectories, and what has to stay alive.

    With `in_lines` each row of the values is for a whole line of trajectories, and the rows repeat.
    """
    (step, stages), fractions = scheme, scheme.stages.fractions
    of_stages = np.array(fractions), distinct(fractions)[1]
    of_stages = *of_stages, int(bool(step.of_one_sign)), np.zeros(1, np.int64), None
    tangent = tangent_of(step)
    length = tangent.length + length_of(tangent.columns)
    if length > sizes.CODE_OF_TANGENT or not tangent.usual:
        fixed, alive = _long_arguments(scheme, values, eps, bool(step.usual))
        return Arguments(*fixed, *of_stages), alive
    W = WIDTH if count > 1 else 1
    halves, table = tables_of(Scheme(tangent, stages), values, eps, 1 if in_lines else W)
    D, is_each = step.D, halves.shape[2] > 1
    room = room_of(D, W)
    of_D = common_code_of(text_of_orthonormalise, D, W)
    codes = code_of(text_of_tangent, tangent, W, is_each), of_D
    fixed = W, room, 0, step.indices, table, halves, *of_stages
    return Arguments(*map(int, codes), 0, *fixed), codes


def able(arguments):
    """Return the arguments of kernels that compute lanes by `solve` if one was found to need it.

    Few fields have such lanes, and `solve` takes a third of the time of compiling.
    """
    return arguments._replace(solves=True) if arguments.unable[0] else arguments


def operations_of(scheme):
    """Return the number of operations of a step, its derivative, and orthonormal columns."""
    step, D = scheme.step, scheme.step.D
    tangent = tangent_of(step)
    if not tangent.usual:
        return 3 * D**3
    return tangent.length + D * length_of(tangent.columns) + D**3 // 4


# ------------------------------------------------------------------------------------ single lanes
class Memory(NamedTuple):
    """The memory of a thread: the rows of a line, and all that steps by `solve` need."""

    line: Any  # (2 D + LENGTHS + D room, W), see `generated_tangent`
    kept: Any  # (kept, W)
    before: Any  # (W, D), states before the step
    columns: Any  # (W, D, D)
    products: Any  # (W, 2), NEAR_1 and FAR_FROM_1 before the step
    statuses: Any  # (W,)
    half: Any  # (T,), eps / 2 times the values of a lane
    after: Any  # (D,)
    matrix: Any  # (D, D + 1)
    tangent: Any  # (D, 2 D)
    units: Any  # (2, D)


@inlined
def memory_of(arguments, D):
    """Return the memory of a thread."""
    T, W = arguments.indices.shape[1], arguments.W
    return Memory(
        np.empty((2 * D + LENGTHS + D * arguments.room, W)),
        np.empty((arguments.kept, W)), np.empty((W, D)), np.empty((W, D, D)), np.empty((W, 2)),
        np.zeros(W, np.int64), np.empty((T,)), np.empty((D,)),
        np.empty((D, D + 1)), np.empty((D, 2 * D)), np.empty((2, D)),
    )  # fmt: skip


@function
def take_steps(arguments, memory, place, stage, ignored, steps, solves):
    """Take up to so many steps of line `place`, and none after a step that leaves bits of lanes.

    Return how many were taken, and bits of lanes: from det A < 0, in which a component changed its
    sign, with columns to be orthonormalised, with such that need it soon, with logarithms to be
    taken, and that took the last step by `solve`. If `solves` is None, Numba compiles no `solve`; a
    step that needs it is not taken, and sets `unable`.
    """
    line, all_lanes, address = memory.line, (1 << arguments.W) - 1, arguments.step
    table = arguments.table[arguments.tables[stage], place % arguments.table.shape[1]].ctypes.data
    kept = memory.kept.ctypes.data
    code = call_code(address, (line.ctypes.data, table, kept, arguments.plan, ignored, steps))
    taken, step = code & ((1 << STEP) - 1), (code >> STEP) & all_lanes
    solved, negative = step | (code >> DERIVATIVE) & all_lanes, (code >> NEGATIVE) & all_lanes
    changed = (code >> CHANGED) & all_lanes
    if solved != 0:
        if solves is None:
            arguments.unable[0] = 1
        else:
            copy_lanes(arguments, memory, solved)
            one = np.int64(ignored | solved), np.int64(1)  # the other lanes take this step, too
            code = call_code(address, (line.ctypes.data, table, kept, arguments.plan, *one))
            negative |= (code >> NEGATIVE) & all_lanes
            changed |= (code >> CHANGED) & all_lanes
            beyond, over_0 = solve_lanes(arguments, memory, place, stage, step, solved)
            negative, changed = negative | beyond, changed | over_0
        taken += 1
    due, soon = (code >> DUE) & all_lanes | solved, (code >> SOON) & all_lanes | solved
    return taken, negative, changed, due, soon, (code >> OUTSIDE) & all_lanes | solved, solved


# ------------------------------------------------------------------------------------------ kernels
@function
def fill_line(W, room, line, x, place):
    """Fill the W lanes of line `place` with trajectories and their columns.

    Lanes beyond the last trajectory repeat it.
    """
    B, D = x.shape
    first = 2 * D + LENGTHS
    line[:] = 0.0
    for l in range(W):
        k = lesser(place * W + l, B - 1)
        for i in range(D):
            line[i, l] = x[k, i]
            for r in range(D):
                line[first + i * room + r, l] = 1.0 if i == r else 0.0
        for j in range(LENGTHS + D):
            line[D + j, l] = 0.0 if j == NEAR_1 else 1.0


@function
def copy(target, source):
    """Copy rows to an array of two dimensions."""
    for i in range(len(target)):
        for l in range(source.shape[1]):
            target[i, l] = source[i, l]


@function
def take_logarithms(g, sums, of_det, begin, of_all):
    """Add the logarithms of products that leave their range, or of all, and begin new products."""
    for row in range(NEAR_1, len(g)):
        near = row == NEAR_1
        low, high = (NEAR_1_LEAST, NEAR_1_LARGEST) if near else (LEAST_LENGTH, LARGEST_LENGTH)
        for l in range(lesser(g.shape[1], len(of_det) - begin)):
            if of_all or g[row, l] <= low or g[row, l] >= high:
                # By `math`, because the logarithms of NumPy have other digits; it raises at 0.
                x = g[row, l]
                logarithm = math.log1p(x) if near else math.log(x) if x != 0.0 else -np.inf
                g[row, l] = 0.0 if near else 1.0
                if row < LENGTHS:
                    of_det[begin + l] += logarithm
                else:
                    sums[begin + l, row - LENGTHS] += logarithm


@inlined
def lanes_beyond(W, B, place):
    """Return the bits of the lanes of line `place` beyond the last of B trajectories."""
    used = lesser(W, B - place * W)
    return np.int64((1 << W) - (1 << used))


def carry_of(arguments, B, D):
    """Return the memory in which `growth` keeps the lines of B trajectories between calls.

    For `long_tangent` there follows what `growth` had when columns were orthonormalised last: the
    line, with the number of stages in place of VOLUME; the sum for |det DPhi|; and `base`.
    """
    W, rows = arguments.W, 2 * D + LENGTHS + D * arguments.room
    return np.empty((-(-B // W), 2 * rows + 1 + D if arguments.plan else rows, W))


@kernel
def jacobians(part, parts, arguments, x, out):
    """Fill out (B, D, D) with DPhi at the states x (B, D), NaN where it does not exist."""
    (B, D), W, arguments = x.shape, arguments.W, uncounted(arguments)
    counted, first = memory_of(arguments, D), 2 * D + LENGTHS
    memory, room = uncounted(counted), arguments.room
    stages, (begin, end) = len(arguments.fractions), share((B + W - 1) // W, part, parts)
    for place in range(begin, end):
        fill_line(W, room, memory.line, x, place)
        ignored = lanes_beyond(W, B, place)
        for stage in range(stages):  # columns become -DPhi q, and the number of stages is odd
            take_steps(arguments, memory, place, stage, ignored, np.int64(1), arguments.solves)
        for l in range(lesser(W, B - place * W)):
            for i in range(D):
                for r in range(D):
                    value = memory.line[first + i * room + r, l]
                    out[place * W + l, i, r] = 0.0 * memory.line[i, l] - value
    keep(counted)


@kernel
def growth(part, parts, arguments, x0, carry, span, sums, of_det, status, failed_at, by_signs):
    """Add the logarithms of the growth of D lengths, and of |det DPhi|, along orbits.

    Products of derivatives are decomposed as Q R, from Q = 1 on; the lengths are the diagonals of
    R. Steps at which this is done depend on the trajectory and on the number of the step alone,
    and `carry` has all that a trajectory continues from. So its bits depend neither on other
    trajectories, nor on where a run is divided. (Columns become -DPhi q; signs do not matter.)

    arguments    `Arguments`
    x0, carry    (B, D), read if start = 0; `carry_of`, read otherwise, and written
    span         (start, stop, last): steps from state `start` to state `stop`, and the state at
                 which all logarithms are taken
    sums, of_det   (B, D) and (B,), to which logarithms are added; NaN after a failure
    status, failed_at   (B,), as in `suslov.steps.steps`
    by_signs     (B,), true where a change of sign, and not det A < 0, told the pole
    """
    arguments, sums, of_det = uncounted(arguments), uncounted(sums), uncounted(of_det)
    (start, stop, last), (B, D), W = span, x0.shape, arguments.W
    counted, stages = memory_of(arguments, D), len(arguments.fractions)
    memory = uncounted(counted)
    line, first, all_lanes = memory.line, 2 * D + LENGTHS, (1 << W) - 1
    base = np.empty((D, W))  # the states before the first of several stages
    begin, end = share((B + W - 1) // W, part, parts)
    for place in range(begin, end):
        if start == 0:
            fill_line(W, arguments.room, line, x0, place)
        else:
            copy(line, carry[place])
        kept, of_base = carry[place, len(line) :], carry[place, 2 * len(line) + 1 :]
        if start == 0 and arguments.plan:
            copy(kept[: len(line)], line)
            kept[D + VOLUME] = 0.0
        if arguments.plan and kept[D + VOLUME, 0] == start * stages:  # sums may begin anew here
            kept[len(line)] = of_det[place]
        ignored, n = lanes_beyond(W, B, place), start
        stage = np.int64(0)  # a literal would have a type, and functions, of its own
        for l in range(lesser(W, B - place * W)):
            k, undefined = place * W + l, 0.0
            for i in range(D):
                undefined += 0.0 * line[i, l]
            if start == 0 and np.isnan(undefined):
                status[k], failed_at[k] = NONFINITE, 0
            if status[k] < 0:
                ignored |= 1 << l
                line[:D, l] = np.nan
        while n < stop:
            steps = np.int64(1)
            if stages == 1:
                steps = np.int64(lesser(stop, (n // INTERVAL + 1) * INTERVAL) - n)
            if stages > 1 and stage == 0 and arguments.has_signs:
                for i in range(D):
                    for l in range(W):
                        base[i, l] = line[i, l]
            taken, negative, changed, due, soon, outside, solved = take_steps(
                arguments, memory, place, stage, ignored, steps, arguments.solves
            )
            if solved != 0 and arguments.solves is None:  # the caller begins anew
                break
            state = n + taken if stages == 1 else n + 1
            stage = (stage + taken) % stages
            n = state if stage == 0 else n
            if stages > 1:  # a stage may change signs where the whole step does not
                changed = np.int64(0)
                for l in range(W if stage == 0 and arguments.has_signs else 0):
                    over_0 = changes_sign(arguments.indices, base[:, l], line[:D, l])
                    changed |= (1 << l) if over_0 else 0
            changed &= ~ignored
            for l in range(W if negative | changed | solved else 0):
                k = place * W + l
                if (solved >> l) & 1 and memory.statuses[l] != OK:
                    status[k], failed_at[k] = memory.statuses[l], state
                    ignored |= 1 << l
                elif ((negative | changed) >> l) & 1 and status[k] == OK:
                    status[k], failed_at[k] = PASSED_POLE, state
                    by_signs[k] = not (negative >> l) & 1
            is_last = stage == 0 and n == last
            if is_last:
                due = all_lanes
            elif stage == 0 and n % INTERVAL == 0:
                due |= soon
            due &= ~ignored
            if due:
                addresses = line[first:].ctypes.data, line[D:].ctypes.data
                memory_of_code = memory.kept.ctypes.data, arguments.plan
                again = call_code(arguments.orthonormalise, (*addresses, due, *memory_of_code))
                if again:  # columns lost digits; go back
                    copy(line, kept)
                    copy(base, of_base)
                    of_det[place], taken = kept[len(line), 0], np.int64(kept[D + VOLUME, 0])
                    n, stage, line[D + VOLUME] = taken // stages, taken % stages, again
                    continue
            if is_last or due | outside:
                rows = line[D : 2 * D + LENGTHS]
                take_logarithms(rows, sums, of_det, place * W, is_last)
            if due and arguments.plan:
                copy(kept[: len(line)], line)
                copy(of_base, base)
                kept[D + VOLUME], kept[len(line)] = n * stages + stage, of_det[place]
        for l in range(lesser(W, B - place * W)):
            k = place * W + l
            of_det[k] += 0.0 * line[0, l]
            for i in range(D):
                sums[k, i] += 0.0 * line[i, l]
        copy(carry[place, : len(line)], line)
    keep(counted)
