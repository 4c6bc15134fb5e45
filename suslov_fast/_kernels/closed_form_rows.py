"""States by the closed form, in rows of equal steps or at arbitrary times.

A row of the output is a state of each trajectory, and a lane of a block is a trajectory at a row or
a time: few trajectories fill it with several rows. At equal steps (c, s) is computed directly every
GROUP rows, and multiplied twice in between: a state depends only on its orbit and its index.

An argument that is a constant at the call, as `any_kind`, makes two loops of one: if it is False,
all orbits pass or rest, and the loop computes no sines.

Arguments of kernels, over a batch of B trajectories:

motion       1, or -1 for the inverse map and the flow backward in time, since all times are >= 0;
             and True for the flow, else False
parameters   I1, I2, I13, I23, k and eps: (B,) each, or (1,) if common to all; for the flow eps is
             the unit of times
omega        (B, 2), the states at time 0
trajectories the first to compute, and the one after the last
out          (N, B, 2), the states; NaN if a state does not exist
ends         status, failed_at and the last step of a run whose trajectories end at a pole; for
             empty arrays the closed form continues past it
missing      (parts, 3), incremented by the numbers of NaN states of orbits whose state 0 is not
             NaN, in columns: at a step, between two steps, and out of the range of float64
"""

from collections import namedtuple

import numpy as np

from .._formulas import closed_form as formulas
from .._formulas.closed_form import (
    EXACT,
    LONGEST_PHASE,
    OUT_OF_RANGE,
    PASSES,
    REGULAR,
    RESTS,
    SUPERCRITICAL,
    TURNS,
    UNKNOWN,
    Body,
    Forms,
    Levels,
    Start,
    Steps,
)
from .._formulas.coordinates import NEGLIGIBLE
from .._formulas.elementary import exponent, scaled, smaller
from .._formulas.units import Problem
from .._jit import allocation, formula, inner, kernel, lane, put, rows_of, select, share, stack
from . import codes
from .lanes import all_share, spread, whole
from .tiles import lead_of, shortening_of_first_block, write_row

BASE, GROUP = 8, 64  # rows; GROUP = BASE**2
# A block of 64 orbits takes 60 KB.
LANES = 64
_TILE = 2 * LANES
# States of one task.
TASK = 2**16
# Exponent of the largest state that certainly is finite.
LARGEST_EXPONENT = 1022.0

# What is known of the orbit of each lane: tuples of arrays. A `lane` of it is called an orbit.
Block = namedtuple("Block", "problem body start levels steps forms")
# The division of the work into tasks, some rows of the trajectories of a block each.
#
# abreast   number of rows, or times, side by side in a block
# shift     number of lanes by which the first block is shorter
Plan = namedtuple("Plan", "tasks tasks_per_block rows_per_task abreast shift")
# Numbers of each lane.
#
# place, offset    how many rows of the block precede its own in the output, and in time
# number           the number of steps, or the time
# recompute_from   see the formula
# power_left       exponent of what multiplies states last, see the formula
# fails            the first step without a state
# c, s             the pair at the last multiple of BASE rows; `c_or_0` is `squarable(c)`
# seed_...         that at the last multiple of GROUP rows; `table_...` those of several groups
RowLanes = namedtuple(
    "RowLanes",
    "place offset number recompute_from power_left fails c c_or_0 s seed_c seed_s table_c table_s",
)
# The `growth` of (c, s) in multiples of BASE rows, and in fewer: (BASE, LANES) each. Row BASE a + b
# of a group is its seed times eights[a] times ones[b]; both include the offset of the lane.
Growth = namedtuple("Growth", "eights_c eights_s ones_c ones_s")


@allocation
def block():
    return Block(
        rows_of(Problem, LANES),
        rows_of(Body, LANES),
        rows_of(Start, LANES),
        rows_of(Levels, LANES),
        rows_of(Steps, LANES),
        rows_of(Forms, LANES),
    )


@formula
def plan_of(trajectories, out, count, length):
    """Return the `Plan` of `count` rows or times.

    length   number of rows of one seed, or 1
    """
    batch, shift, abreast = trajectories[1] - trajectories[0], 0, 1
    # Rows lie side by side only if they are neighbours in the output.
    while 2 * abreast * batch <= LANES and abreast < count and batch == out.shape[1]:
        abreast *= 2
    if abreast == 1:
        shift = shortening_of_first_block(lead_of(out), out.shape[1], 2)
    blocks = (batch + shift + LANES - 1) // LANES
    at_once = abreast * length
    rows_per_task = max(TASK // (at_once * max(min(batch, LANES), 1)), 1) * at_once
    tasks_per_block = (count + rows_per_task - 1) // rows_per_task
    return Plan(blocks * tasks_per_block, tasks_per_block, rows_per_task, abreast, shift)


@formula
def task_of(task, plan, trajectories):
    """Return the first trajectory of a task, their number, and how many rows precede its own."""
    begin, end = trajectories
    block, part = task // plan.tasks_per_block, task % plan.tasks_per_block
    first = begin + max(block * LANES - plan.shift, 0)
    width = min(begin + (block + 1) * LANES - plan.shift, end) - first
    return first, width, part * plan.rows_per_task


@formula
def fill_lanes(b, lanes, omega, first, width, abreast, direction):
    """Give each lane a trajectory and a row, in the order of the output; return how many are used.

    Lanes beyond the last are copies of the first.
    """
    used, states = whole(width * abreast), omega[first : first + width]
    omega1, omega2 = b.problem.omega1, b.problem.omega2
    for l in range(width):
        omega1[l], omega2[l] = states[l, 0], states[l, 1]
    for l in range(width, used):
        omega1[l], omega2[l] = omega1[l - width], omega2[l - width]
    for l in range(used):
        place = smaller(np.floor(l / width), abreast - 1.0)
        lanes.place[l], lanes.offset[l] = place, select(direction > 0, place, abreast - 1.0 - place)
    return used


@formula
def enter_bodies(b, parameters, first, width, used, entered):
    """Give each lane the body and the step size of its trajectory; return how many have one.

    If all trajectories share them, lanes `entered` by the block before keep theirs.
    """
    if used <= entered and all_share(parameters):
        return entered
    for k in range(len(parameters)):
        row = b.problem[k]
        spread(parameters[k], first, width, row)
        for l in range(width, used):
            row[l] = row[l - width]
    for l in range(used):
        put(b.body, l, formulas.body(lane(b.problem, l)))
    return used


@formula
def enter(b, lanes, motion, used):
    """Fill the orbits of a block; return `any_kind`, and True if some states may have to be
    corrected.
    """
    back, flows = motion
    for l in range(used):
        body, omega1, omega2 = lane(b.body, l), b.problem.omega1[l], b.problem.omega2[l]
        put(b.start, l, formulas.start(back, flows, body, omega1, omega2))
    others, turning, recomputed = 0, 0, 0
    for l in range(used):
        put(b.levels, l, formulas.levels(lane(b.start, l)))
    for l in range(used):
        put(b.steps, l, formulas.steps(lane(b.start, l), lane(b.levels, l)))
    for l in range(0 if flows else used):
        found = formulas.logarithm(lane(b.start, l), lane(b.levels, l), lane(b.steps, l))
        b.steps.log_r[l], b.steps.log_lost[l] = found
    for l in range(used):
        start, levels, steps = lane(b.start, l), lane(b.levels, l), lane(b.steps, l)
        put(b.forms, l, formulas.forms(start, levels, steps, lane(b.problem, l)))
        size = formulas.recompute_from(start, levels, steps)
        power_left = select(steps.kind == RESTS, 0.0, formulas.power_left(start.power))
        lanes.recompute_from[l], lanes.power_left[l], lanes.fails[l] = size, power_left, np.inf
        others += select(steps.kind > PASSES, 1, 0)
        turning += select(steps.kind == TURNS, 1, 0)
        recomputed += select((size < np.inf) | (power_left != 0.0), 1, 0)
    if turning > 0:  # in three loops: a processor overlaps the lanes of a short one
        for l in range(used):
            start, levels, steps = lane(b.start, l), lane(b.levels, l), lane(b.steps, l)
            found = formulas.turning_levels(start, levels, steps)
            b.levels.square[l], b.levels.root[l], b.levels.root_lost[l] = found
        for l in range(used):
            lanes.c[l], lanes.s[l] = formulas.turning_tangent(lane(b.levels, l))
        for l in range(used):
            start, levels, steps = lane(b.start, l), lane(b.levels, l), lane(b.steps, l)
            found = formulas.turning(start, levels, steps, (lanes.c[l], lanes.s[l]))
            b.steps.root[l], b.steps.m_square[l], b.steps.turns[l], b.steps.turns_lost[l] = found
    if others > 0:
        for l in range(used):
            start, levels, steps = lane(b.start, l), lane(b.levels, l), lane(b.steps, l)
            turns = formulas.turning_forms(start, levels, steps)
            near = formulas.near_forms(start, levels, False)
            moves = formulas.select_forms(steps.kind == TURNS, turns, near)
            put(b.forms, l, formulas.select_forms(steps.kind > PASSES, moves, lane(b.forms, l)))
    return others > 0, recomputed > 0


@inner
def state_at(orbit, power_left, n):
    """Return state n of an orbit: infinite or NaN if it does not exist."""
    forms = forms_of(orbit, n % 2.0 == 1.0)
    c, s = formulas.pair(n, orbit.steps, True)
    omega1, omega2 = formulas.omega_of(c, formulas.squarable(c), s, forms)
    if formulas.is_pole(c, s, forms):
        omega1, omega2 = np.nan, np.nan
    return scaled(omega1, power_left), scaled(omega2, power_left)


@formula
def forms_of(orbit, odd):
    """Return the forms of an even or odd number of steps."""
    if formulas.has_two_forms(orbit.steps):
        return formulas.near_forms(orbit.start, orbit.levels, odd)
    return orbit.forms


@formula
def first_missing(orbit, power_left, stop):
    """Return the index of the first state of an orbit with T >= 1 that does not exist, and True if
    it is infinite.
    """
    fails, infinite = np.inf, False
    for case in range(4):  # both zeros, for even and odd n
        forms = forms_of(orbit, case > 1)
        nearest = np.floor(formulas.step_to_pole(forms, orbit.steps, case % 2) + 0.5)
        for n in (nearest - 1.0, nearest, nearest + 1.0):
            if 1.0 <= n <= min(stop, fails - 1.0):
                omega1, omega2 = state_at(orbit, power_left, n)
                size = abs(omega1) + abs(omega2)
                if not size < np.inf:
                    fails, infinite = n, size == np.inf
    return fails, infinite


@inner
def end_of(orbit, power_left, stop):
    """Return the status of an orbit at step `stop`, and the index of its first missing state."""
    problem, _, start, levels, steps, _ = orbit
    if start.fate < 0.0:
        if start.fate == OUT_OF_RANGE:
            return codes.NEEDS_STEPS, np.inf
        return (codes.NONFINITE, 0.0) if start.fate == UNKNOWN else (codes.SINGULAR, 1.0)
    if start.fate == SUPERCRITICAL:
        if steps.kind == RESTS:
            return codes.SUPERCRITICAL, np.inf
        if steps.kind == TURNS:  # which of its steps comes next to a pole is not known
            return codes.NEEDS_STEPS, np.inf
        fails, infinite = first_missing(orbit, power_left, stop)
        code = codes.NONFINITE if infinite else codes.SINGULAR
        return code if fails < np.inf else codes.SUPERCRITICAL, fails
    if start.power > 0.0 and steps.kind != RESTS:
        # |z| = R sqrt(1 + X**2), and X is largest where Y = 0.
        T = start.order * levels.T
        X = start.order * (start.K + T) / ((1.0 - T) * (1.0 + T))
        least = min(problem.I1, problem.I2) / max(problem.I1, problem.I2)
        largest = levels.R * (1.0 + X) / np.sqrt(least)
        if exponent(largest) + 3.0 + start.power > LARGEST_EXPONENT:
            return codes.NEEDS_STEPS, np.inf
    return codes.OK, np.inf


@formula
def write_ends(b, lanes, first, width, used, ends):
    """Write statuses of trajectories; return True if any ends before the last step."""
    status, failed_at, stop = ends
    any_fails = False
    for l in range(width if len(status) else 0):
        code = codes.OK
        if b.start.fate[l] != REGULAR or b.start.power[l] > 0.0:
            code, lanes.fails[l] = end_of(lane(b, l), lanes.power_left[l], stop)
        status[first + l] = code
        if lanes.fails[l] < np.inf:
            failed_at[first + l] = int(lanes.fails[l])
            any_fails = True
    # The other rows of these trajectories.
    for l in range(width, used if any_fails else 0):
        lanes.fails[l] = lanes.fails[l - width]
    return any_fails


@formula
def count_unusual(lanes, used, tile):
    """Return how many states are missing, state 0, or large enough to be computed again."""
    count = 0
    for l in range(used):
        usual = abs(tile[2 * l]) + abs(tile[2 * l + 1]) < lanes.recompute_from[l]
        usual = usual & (lanes.power_left[l] == 0.0)
        usual = usual & (lanes.number[l] > 0.0) & (lanes.number[l] < lanes.fails[l])
        count += select(usual, 0, 1)
    return count


@inner
def corrected(orbit, at, omega1, omega2):
    """Return the state of a lane, computed again if it is unusual, and the column of `missing` that
    counts it if it is missing, else -1.
    """
    start, steps, n, column = orbit.start, orbit.steps, at.number, -1
    if n == 0.0:
        omega1, omega2 = orbit.problem.omega1, orbit.problem.omega2
    elif abs(omega1) + abs(omega2) < at.recompute_from:
        omega1, omega2 = scaled(omega1, at.power_left), scaled(omega2, at.power_left)
    elif start.fate >= 0.0 and steps.kind != RESTS:
        omega1, omega2 = state_at(orbit, at.power_left, n)
    size = abs(omega1) + abs(omega2)
    if at.fails <= n < np.inf:
        omega1, omega2 = np.nan, np.nan
    elif not size < np.inf:
        omega1, omega2 = np.nan, np.nan
        unknown_phase = steps.kind == TURNS and LONGEST_PHASE <= n * steps.turns < np.inf
        if start.fate == OUT_OF_RANGE or size == np.inf or unknown_phase:
            column = 2
        elif start.fate != UNKNOWN:
            column = 0 if np.floor(n) == n and n <= EXACT else 1
    return omega1, omega2, column


@formula
def correct(b, lanes, l, tile, missing):
    """Compute the state of a lane if it is unusual; count it if it is missing."""
    omega1, omega2, column = corrected(lane(b, l), lane(lanes, l), tile[2 * l], tile[2 * l + 1])
    tile[2 * l], tile[2 * l + 1] = omega1, omega2
    if column >= 0:
        missing[column] += 1.0


@formula
def not_negligible(v):
    """Return v, or 0 if it would soon be subnormal."""
    return select(abs(v) < NEGLIGIBLE, 0.0, v)


@formula
def enter_growth(b, lanes, growth, used, abreast, every, any_kind):
    """Fill the entries of the growth that blocks of `abreast` rows use."""
    for a in range(0, BASE, max(abreast // BASE, 1)):
        for l in range(used):
            rows = BASE * (a + np.floor(lanes.offset[l] / BASE))
            c, s = formulas.growth(rows * every, lane(b.steps, l), any_kind)
            growth.eights_c[a, l] = not_negligible(c)
            if any_kind:
                growth.eights_s[a, l] = s
    for a in range(0, BASE, min(abreast, BASE)):
        for l in range(used):
            rows = a + lanes.offset[l] - BASE * np.floor(lanes.offset[l] / BASE)
            c, s = formulas.growth(rows * every, lane(b.steps, l), any_kind)
            growth.ones_c[a, l] = not_negligible(c)
            if any_kind:
                growth.ones_s[a, l] = s


@formula
def enter_table(b, lanes, used, first_number, every, top, any_kind):
    """Fill the seeds of the groups of rows from `top` on: lanes at place i hold those of group i.

    Return True if a seed is not finite: unknown, or a ratio too large for one number.
    """
    unusual = 0
    for l in range(used):
        steps, number = lane(b.steps, l), first_number + every * (top + GROUP * lanes.place[l])
        c, s = formulas.pair(number, steps, any_kind)
        c = select((steps.kind == PASSES) & (s < 1.0), np.inf, c)
        lanes.table_c[l], lanes.table_s[l] = not_negligible(c), s
        lanes.seed_c[l], lanes.seed_s[l] = not_negligible(c), s  # of the only group if abreast == 1
        unusual += select(abs(c) < np.inf, 0, 1)
    return unusual > 0


@formula
def take_seeds(lanes, group, width, abreast, used, any_kind):
    """Take the seeds of one group of rows from the tables."""
    for i in range(width):
        c = lanes.table_c[group * width + i]
        for place in range(abreast):
            lanes.seed_c[place * width + i] = c
    for i in range(width if any_kind else 0):
        s = lanes.table_s[group * width + i]
        for place in range(abreast):
            lanes.seed_s[place * width + i] = s
    for l in range(width * abreast, used):
        lanes.seed_c[l], lanes.seed_s[l] = 0.0, 0.0


@formula
def fill_tile(b, lanes, growth, used, row, any_kind, tile):
    """Compute the states of a row of a group, and of those beside it."""
    if row % BASE == 0:
        for l in range(used):
            next_c = growth.eights_c[row // BASE, l]
            seed_c, seed_s = lanes.seed_c[l], lanes.seed_s[l]
            c = seed_c * next_c
            if any_kind:
                next_s, square = growth.eights_s[row // BASE, l], b.steps.m_square[l]
                c, lanes.s[l] = formulas.combined(seed_c, seed_s, next_c, next_s, square)
            lanes.c[l], lanes.c_or_0[l] = not_negligible(c), formulas.squarable(c)
    for l in range(used):
        next_c, s = growth.ones_c[row % BASE, l], 1.0
        c, c_or_0 = lanes.c[l] * next_c, lanes.c_or_0[l] * next_c
        if any_kind:
            next_s, square = growth.ones_s[row % BASE, l], b.steps.m_square[l]
            c, s = formulas.combined(lanes.c[l], lanes.s[l], next_c, next_s, square)
            c_or_0 = formulas.squarable(c)
        tile[2 * l], tile[2 * l + 1] = formulas.omega_of(c, c_or_0, s, lane(b.forms, l))


@formula
def fill_tile_at_times(b, lanes, used, any_kind, tile):
    """Compute the states at the times of the lanes."""
    for l in range(used):
        c, s = formulas.pair(lanes.number[l], lane(b.steps, l), any_kind)
        omega = formulas.omega_of(c, formulas.squarable(c), s, lane(b.forms, l))
        tile[2 * l], tile[2 * l + 1] = omega


@formula
def write_asked(tile, flat, lead, batch, rows, i, abreast, first, width):
    """Write the rows of a tile, from row i on, that are asked for."""
    begin, end, origin, direction = rows
    low, high = max(i, begin), min(i + abreast, end)
    # The first of them in the output, and its place in the tile.
    upper, place = (low, low - i) if direction > 0 else (high - 1, i + abreast - high)
    target = 2 * ((origin + direction * upper) * batch + first)
    size, stride = 2 * width * (high - low), 2 * direction * batch * abreast
    for j in range(size if place > 0 else 0):
        tile[j] = tile[2 * width * place + j]
    write_row(tile, flat, target, size, stride, lead)


@kernel
def fill_rows(
    part, parts, motion, parameters, omega, steps, rows, trajectories, out, ends, missing
):
    """Fill rows: state number first + every i goes to row origin + direction i, begin <= i < end.

    steps   first, every
    rows    begin, end, origin, direction
    """
    first_number, every = steps
    begin, end, _, direction = rows
    first_group = begin // GROUP * GROUP
    plan = plan_of(trajectories, out, end - first_group, GROUP)
    abreast = plan.abreast
    b, lanes = block(), rows_of(RowLanes, LANES)
    growth = Growth(stack(BASE, LANES), stack(BASE, LANES), stack(BASE, LANES), stack(BASE, LANES))
    flat, lead, tile = out.reshape(out.size), lead_of(out), stack(_TILE)
    counts, (first_task, last_task) = missing[part], share(plan.tasks, part, parts)
    entered = 0
    for task in range(first_task, last_task):
        first, width, skipped = task_of(task, plan, trajectories)
        used = fill_lanes(b, lanes, omega, first, width, abreast, direction)
        entered = enter_bodies(b, parameters, first, width, used, entered)
        any_kind, any_recomputed = enter(b, lanes, motion, used)
        any_recomputed |= write_ends(b, lanes, first, width, used, ends)
        if any_kind:
            enter_growth(b, lanes, growth, used, abreast, every, True)
        else:
            enter_growth(b, lanes, growth, used, abreast, every, False)
        start = first_group + skipped
        for top in range(start, min(start + plan.rows_per_task, end), GROUP * abreast):
            if any_kind:
                unusual = enter_table(b, lanes, used, first_number, every, top, True)
            else:
                unusual = enter_table(b, lanes, used, first_number, every, top, False)
            for i in range(top, min(top + GROUP * abreast, end), abreast):
                row = (i - top) % GROUP
                if row == 0 and abreast > 1:
                    take_seeds(lanes, (i - top) // GROUP, width, abreast, used, any_kind)
                if any_kind:
                    fill_tile(b, lanes, growth, used, row, True, tile)
                else:
                    fill_tile(b, lanes, growth, used, row, False, tile)
                if i + abreast <= begin:
                    continue
                if any_recomputed or unusual or (i == 0 and first_number == 0.0):
                    for l in range(used):
                        lanes.number[l] = first_number + every * (i + lanes.offset[l])
                    for l in range(width * abreast if count_unusual(lanes, used, tile) else 0):
                        if begin <= i + lanes.offset[l] < end:
                            correct(b, lanes, l, tile, counts)
                write_asked(tile, flat, lead, out.shape[1], rows, i, abreast, first, width)


@kernel
def fill_states(
    part, parts, motion, parameters, omega, times, to, trajectories, out, ends, missing
):
    """Fill row to[j] with the states at times[j], which are numbers of steps of the map."""
    plan = plan_of(trajectories, out, times.size, 1)
    abreast = plan.abreast
    b, lanes, tile = block(), rows_of(RowLanes, LANES), stack(_TILE)
    flat, lead = out.reshape(out.size), lead_of(out)
    counts, (first_task, last_task) = missing[part], share(plan.tasks, part, parts)
    entered = 0
    for task in range(first_task, last_task):
        first, width, skipped = task_of(task, plan, trajectories)
        used = fill_lanes(b, lanes, omega, first, width, abreast, 1)
        entered = enter_bodies(b, parameters, first, width, used, entered)
        any_kind, _ = enter(b, lanes, motion, used)
        write_ends(b, lanes, first, width, used, ends)
        for j in range(skipped, min(skipped + plan.rows_per_task, times.size), abreast):
            for l in range(used):
                lanes.number[l] = times[min(j + int(lanes.offset[l]), times.size - 1)]
            if any_kind:
                fill_tile_at_times(b, lanes, used, True, tile)
            else:
                fill_tile_at_times(b, lanes, used, False, tile)
            count = width * min(abreast, times.size - j)
            for l in range(count if count_unusual(lanes, used, tile) else 0):
                correct(b, lanes, l, tile, counts)
            for i in range(count // width):
                target = 2 * (to[j + i] * out.shape[1] + first)
                write_row(tile[2 * width * i :], flat, target, 2 * width, 0, lead)
