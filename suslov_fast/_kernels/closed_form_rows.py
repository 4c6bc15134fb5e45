"""States by the closed form, in rows of equal steps or at arbitrary times.

A row of the output is a state of each trajectory, and a lane of a block is a trajectory at a row or
a time: few trajectories fill it with several rows. At equal steps (c, s) is computed directly every
GROUP rows, and multiplied twice in between: a state depends only on its orbit and its index.

A kernel is called first for orbits that rest or pass, and leaves blocks that contain any other. For
these it is called again, with `others`, and computes the same bits for orbits that rest or pass.
Numba compiles it separately for each call, without what follows `others is None` or does not: so
most batches do not need the code of `other_orbits`.

Arguments of kernels, for a batch of B trajectories:

batch        a tuple of these:
  motion       1, or -1 for the inverse map and the flow backward in time, since all times are >= 0;
               and True for the flow, else False
  parameters   I1, I2, I13, I23, k and eps: (B,) each, or (1,) if common to all; for the flow eps is
               the unit of times
  omega        (B, 2), the states at time 0
  ends         status, failed_at and the last step of a run whose trajectories end at a pole; for
               empty arrays the closed form continues past it
  left         (B,), 1 for trajectories of the blocks that are left, at first 0
trajectories the first to compute, and the one after the last
out          (N, B, 2), the states; NaN if a state does not exist
missing      (parts, 3), incremented by the numbers of NaN states of orbits whose state 0 is not
             NaN, in columns: at a step, between two steps, and out of the range of float64 or of
             known phases
others       None for orbits that rest or pass, and then True for the blocks that are left
"""

from collections import namedtuple

import numpy as np

from .._formulas import closed_form
from .._formulas import other_orbits as other_formulas
from .._formulas.closed_form import PASSES, omega_of
from .._formulas.coordinates import NEGLIGIBLE
from .._jit import formula, kernel, lane, put, rows_of, select, share, stack
from . import other_orbits
from .orbits import ROW_LANES, RowLanes, block, enter
from .tiles import lead_of, shortening_of_first_block, write_row

BASE, GROUP = 8, 64  # rows; GROUP = BASE**2
_TILE = 2 * ROW_LANES
_ENTRIES = 2 * BASE  # of the growth
# States of one task.
TASK = 2**16

# The division of the work into tasks, some rows of the trajectories of a block each.
#
# abreast   number of rows, or times, side by side in a block
# shift     number of lanes by which the first block is shorter
Plan = namedtuple("Plan", "tasks tasks_per_block rows_per_task abreast shift")
# The `growth` of (c, s), (_ENTRIES, ROW_LANES): entries b < BASE are those over b rows, and entries
# BASE + a those over BASE a rows. The (c, s) of row GROUP g + BASE a + b is
# seed[g] growth[BASE + a] growth[b], products as in `combined`. The growth includes the offset of
# the lane: what is left modulo BASE is added to b, the rest to BASE a.
GrowthTable = namedtuple("GrowthTable", "c s")


@formula
def plan_of(trajectories, out, count, length):
    """Return the `Plan` of `count` rows or times.

    length   number of rows of one seed, or 1
    """
    batch, shift, abreast = trajectories[1] - trajectories[0], 0, 1
    # Rows lie side by side only if they are neighbours in the output.
    while 2 * abreast * batch <= ROW_LANES and abreast < count and batch == out.shape[1]:
        abreast *= 2
    if abreast == 1:
        shift = shortening_of_first_block(lead_of(out), out.shape[1], 2)
    blocks = (batch + shift + ROW_LANES - 1) // ROW_LANES
    at_once = abreast * length
    rows_per_task = max(TASK // (at_once * max(min(batch, ROW_LANES), 1)), 1) * at_once
    tasks_per_block = (count + rows_per_task - 1) // rows_per_task
    return Plan(blocks * tasks_per_block, tasks_per_block, rows_per_task, abreast, shift)


@formula
def task_of(task, plan, trajectories):
    """Return the first trajectory of a task, their number, and how many rows precede its own."""
    begin, end = trajectories
    block, part = task // plan.tasks_per_block, task % plan.tasks_per_block
    first = begin + max(block * ROW_LANES - plan.shift, 0)
    width = min(begin + (block + 1) * ROW_LANES - plan.shift, end) - first
    return first, width, part * plan.rows_per_task


@formula
def pair(n, steps, others):
    """(c, s) after n steps."""
    return closed_form.pair(n, steps) if others is None else other_formulas.pair(n, steps)


@formula
def growth_of(n, steps, others):
    """The pair that takes (c, s) n steps further by `combined`."""
    return closed_form.growth(n, steps) if others is None else other_formulas.growth(n, steps)


@formula
def combined(c, s, growth, k, l, square, others):
    """(c, s) of lane l after the steps of entry k of the growth."""
    if others is None:
        return c * growth.c[k, l], 1.0
    return other_formulas.combined(c, s, growth.c[k, l], growth.s[k, l], square)


@formula
def not_negligible(v):
    """Return v, or 0 if it would soon be subnormal."""
    return select(abs(v) < NEGLIGIBLE, 0.0, v)


@formula
def take_seeds(lanes, group, width, abreast, used):
    """Take the seeds of one group of rows from the tables."""
    for i in range(width):
        c, s = lanes.table_c[group * width + i], lanes.table_s[group * width + i]
        for place in range(abreast):
            lanes.seed_c[place * width + i], lanes.seed_s[place * width + i] = c, s
    for l in range(width * abreast, used):
        lanes.seed_c[l], lanes.seed_s[l] = 0.0, 0.0


@formula
def take_states_0(b, used, lanes, tile):
    """Take the states that are given as those at step 0."""
    for l in range(used):
        is_0 = lanes.number[l] == 0.0
        tile[2 * l] = select(is_0, b.problem.omega1[l], tile[2 * l])
        tile[2 * l + 1] = select(is_0, b.problem.omega2[l], tile[2 * l + 1])


@formula
def write_asked(tile, flat, lead, batch, rows, i, abreast, first, width):
    """Write the rows of a tile, from row i on, that are asked for."""
    begin, end, origin, direction = rows
    low, high = max(i, begin), min(i + abreast, end)
    # The first of them in the output, and its place in the tile.
    upper, skip = (low, low - i) if direction > 0 else (high - 1, i + abreast - high)
    target = 2 * ((origin + direction * upper) * batch + first)
    size, stride = 2 * width * (high - low), 2 * direction * batch * abreast
    write_row(tile, 2 * width * skip, flat, target, size, stride, lead)


@kernel
def rows(part, parts, batch, trajectories, numbering, rows, out, missing, others):
    """Fill rows: state number first + every i goes to row origin + direction i, begin <= i < end.

    numbering   first, every
    rows        begin, end, origin, direction
    """
    first_number, every = numbering
    begin, end, _, direction = rows
    first_group = begin // GROUP * GROUP
    plan = plan_of(trajectories, out, end - first_group, GROUP)
    abreast = plan.abreast
    b, lanes = block(), rows_of(RowLanes, ROW_LANES)
    growth = GrowthTable(stack(_ENTRIES, ROW_LANES), stack(_ENTRIES, ROW_LANES))
    flat, lead, tile = out.reshape(out.size), lead_of(out), stack(_TILE)
    counts, (first_task, last_task) = missing[part], share(plan.tasks, part, parts)
    entered = 0
    for task in range(first_task, last_task):
        first, width, skipped = task_of(task, plan, trajectories)
        used = enter(b, lanes, batch, (first, width, abreast, direction), entered, others)
        if used == 0:
            continue
        entered = max(entered, used)
        corrects = False if others is None else other_orbits.corrects(b, lanes, used)
        for k in range(_ENTRIES):  # those that blocks of `abreast` rows use
            if k % (min(abreast, BASE) if k < BASE else max(abreast // BASE, 1)) == 0:
                for l in range(used):
                    offset, eights = lanes.offset[l], BASE * np.floor(lanes.offset[l] / BASE)
                    after = select(k < BASE, k + (offset - eights), BASE * (k - BASE) + eights)
                    c, growth.s[k, l] = growth_of(after * every, lane(b.steps, l), others)
                    growth.c[k, l] = not_negligible(c)
        first_row = first_group + skipped
        for top in range(first_row, min(first_row + plan.rows_per_task, end), GROUP * abreast):
            unusual = 0  # seeds: unknown, or a ratio too large for one number
            for l in range(used):  # that of group i in the lanes at place i
                steps, group = lane(b.steps, l), top + GROUP * lanes.place[l]
                c, s = pair(first_number + every * group, steps, others)
                c = not_negligible(select((steps.kind == PASSES) & (s < 1.0), np.inf, c))
                lanes.table_c[l], lanes.table_s[l] = c, s
                lanes.seed_c[l], lanes.seed_s[l] = c, s  # of the only group if abreast == 1
                unusual += select(abs(c) < np.inf, 0, 1)
            for i in range(top, min(top + GROUP * abreast, end), abreast):
                row = (i - top) % GROUP
                if row == 0 and abreast > 1:
                    take_seeds(lanes, (i - top) // GROUP, width, abreast, used)
                if row % BASE == 0:
                    for l in range(used):
                        k, square = BASE + row // BASE, b.steps.square[l]
                        c, s = lanes.seed_c[l], lanes.seed_s[l]
                        c, lanes.s[l] = combined(c, s, growth, k, l, square, others)
                        lanes.c[l] = not_negligible(c)
                for l in range(used):
                    k, square = row % BASE, b.steps.square[l]
                    c, s = combined(lanes.c[l], lanes.s[l], growth, k, l, square, others)
                    put(tile, 2 * l, omega_of(c, s, lane(b.forms, l)))
                if i + abreast <= begin:  # these only advance c and s
                    continue
                if corrects or unusual > 0 or i == 0:
                    for l in range(used):
                        lanes.number[l] = first_number + every * (i + lanes.offset[l])
                    if i == 0:
                        take_states_0(b, used, lanes, tile)
                    if others is not None:
                        asked, count = (begin - i, end - i), width * abreast
                        other_orbits.correct(b, lanes, asked, count, tile, counts)
                write_asked(tile, flat, lead, out.shape[1], rows, i, abreast, first, width)


@kernel
def states(part, parts, batch, trajectories, times, to, out, missing, others):
    """Fill row to[j] with the states at times[j]: numbers of steps, or times of the flow."""
    plan = plan_of(trajectories, out, times.size, 1)
    abreast = plan.abreast
    b, lanes, tile = block(), rows_of(RowLanes, ROW_LANES), stack(_TILE)
    flat, lead = out.reshape(out.size), lead_of(out)
    counts, (first_task, last_task) = missing[part], share(plan.tasks, part, parts)
    entered = 0
    for task in range(first_task, last_task):
        first, width, skipped = task_of(task, plan, trajectories)
        used = enter(b, lanes, batch, (first, width, abreast, 1), entered, others)
        if used == 0:
            continue
        entered = max(entered, used)
        for j in range(skipped, min(skipped + plan.rows_per_task, times.size), abreast):
            for l in range(used):
                lanes.number[l] = times[min(j + int(lanes.offset[l]), times.size - 1)]
            for l in range(used):
                c, s = pair(lanes.number[l], lane(b.steps, l), others)
                put(tile, 2 * l, omega_of(c, s, lane(b.forms, l)))
            take_states_0(b, used, lanes, tile)
            count = width * min(abreast, times.size - j)
            if others is not None:
                other_orbits.correct(b, lanes, (0, abreast), count, tile, counts)
            for i in range(count // width):
                target = 2 * (to[j + i] * out.shape[1] + first)
                write_row(tile, 2 * width * i, flat, target, 2 * width, 0, lead)
