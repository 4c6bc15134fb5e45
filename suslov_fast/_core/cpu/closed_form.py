"""Loops over trajectories and times of the closed form.

Common arguments, flat over the batch of B trajectories:

I1 ... eps   five arrays of B numbers, or of one that serves all; for the flow, eps is the unit of
             the times.
omega        (B, 2), the initial states.
out          (N, B, 2), the states; NaN where there is none.
missing      (tasks, 2): how many of them are NaN though their trajectory is not, at a step of the
             map, and between two.

Arrays of a block are those of `orbits` and `tiles`.
"""

import numpy as np
from numba import prange

from ..jit import Loop
from ..staged import staged
from .blocks import scatter_pairs, tasks_for
from .orbits import (
    ABREAST,
    BODY,
    CODE,
    GIVEN,
    GIVEN1,
    GIVEN2,
    OMEGA1,
    OMEGA2,
    ORBIT,
    WIDTH,
    WORK,
    N,
    count_missing,
    enter_block,
    enter_orbits,
    in_whole,
    lanes_at,
    states_at,
    store_lanes,
)
from .tiles import (
    TILE,
    blocks_of,
    first_and_width,
    put_pairs,
    shift_of_blocks,
    write_codes,
    write_rows,
)
from .vector import (
    VECTOR,
    fence,
    on_stack,
    select,
    splat,
    store_at,
    store_pairs_apart,
    to_cache_line,
    vector_at,
)

# What it costs to enter an orbit, and a state of it at any time, in steps of the map.
ENTERING, EVALUATING = 64, 8
# States that one part of a task takes, of few trajectories.
FEW_STATES = 2**16

BODY_AT = GIVEN
ORBIT_AT = BODY_AT + BODY
WORK_AT = ORBIT_AT + 2 * ORBIT
SPREAD_AT = WORK_AT + WORK
TILE_AT = SPREAD_AT + ORBIT
ROOM = TILE_AT + TILE


@staged
def fill_across(given, orbits, work, times, tile, width, lanes, missing):
    """Rows of a tile: the states of a block at some times."""
    for j in range(times.size):
        n = times[j]
        if n == 0.0:
            put_pairs(given, GIVEN1, tile, 2 * j * width, width)
        else:
            orbit = orbits[ORBIT if n < 0.0 else 0 :]
            work[N : N + lanes] = n
            if states_at(orbit, work, lanes):
                count_missing(orbit, work, width, missing)
            put_pairs(work, OMEGA1, tile, 2 * j * width, width)


@staged
def any_time(times, side):
    """Whether any time is on a side: 0 where they are >= 0, 1 where they are negative."""
    found = False
    for j in range(times.size):
        found |= (times[j] < 0.0) == (side == 1)
    return found


@staged
def spread_orbit(orbits, l, times, lanes, spread):
    """What is known of one orbit, forward or back, in the lanes of times."""
    for row in range(0, ORBIT, WIDTH):
        forward, back = splat(orbits[row + l]), splat(orbits[ORBIT + row + l])
        for k in range(0, lanes, VECTOR):
            store_at(spread, row + k, select(vector_at(times, k) < 0.0, back, forward))


@staged
def fill_along(given, orbits, spread, work, times, tile, width, missing):
    """The same where lanes are times, whose signs may come in any order."""
    size = times.size
    lanes = in_whole(size)
    for j in range(lanes):
        work[N + j] = times[min(j, size - 1)]
    for l in range(width):
        spread_orbit(orbits, l, work[N:], lanes, spread)
        any_missing = states_at(spread, work, lanes)
        for k in range(0, lanes, VECTOR):
            for row, start in ((OMEGA1, GIVEN1), (OMEGA2, GIVEN2)):
                at_start = vector_at(work, N + k) == 0.0
                omega = select(at_start, splat(given[start + l]), vector_at(work, row + k))
                store_at(work, row + k, omega)
            omega1, omega2 = vector_at(work, OMEGA1 + k), vector_at(work, OMEGA2 + k)
            store_pairs_apart(tile, 2 * (k * width + l), 2 * width, omega1, omega2)
        if any_missing:
            count_missing(spread, work, size, missing)


@staged
def parts_of_times(omega, times, lanes_asked, out):
    """The parts that tasks share: some times of a block each.

    Returns the first block, how many times a part has, how many parts a block has, and all of them.
    """
    batch = omega.shape[0]
    first_block, last_block = blocks_of(lanes_asked, shift_of_blocks(to_cache_line(out, 0)), batch)
    chunk = min(max(FEW_STATES // min(batch, WIDTH), VECTOR), times.size)
    chunks = (times.size + chunk - 1) // chunk
    return first_block, chunk, chunks, (last_block - first_block) * chunks


@staged
def fill_parts(task, flow, I1, I2, I13, I23, eps, omega, times, lanes_asked, out, missing):
    """What one task of `fill` does."""
    room = on_stack(ROOM)
    given, body, orbits = room[:BODY_AT], room[BODY_AT:ORBIT_AT], room[ORBIT_AT:WORK_AT]
    work, spread, tile = room[WORK_AT:SPREAD_AT], room[SPREAD_AT:TILE_AT], room[TILE_AT:]
    states, batch, line = omega.reshape(omega.size), omega.shape[0], to_cache_line(out, 0)
    flat, counts = out.reshape(out.size), missing[task]
    n_tasks = missing.shape[0]
    first_block, chunk, chunks, n_parts = parts_of_times(omega, times, lanes_asked, out)
    # `sides`: 1 where orbits are entered forward, and 2 where back.
    entered, sides, lanes, step = -1, 0, 0, 0
    for k in range(task * n_parts // n_tasks, (task + 1) * n_parts // n_tasks):
        block, begin = first_block + k // chunks, k % chunks * chunk
        first, width = first_and_width(block, WIDTH, shift_of_blocks(line), batch)
        if block != entered:
            bodies = I1, I2, I13, I23, eps
            lanes, step = enter_block(bodies, states, first, width, entered < 0, given, body)
            entered, sides = block, 0
        end = min(begin + chunk, times.size)
        for side in range(2):
            if (sides & (1 + side)) == 0 and any_time(times[begin:end], side):
                orbit, back = orbits[ORBIT * side :], 1.0 - 2.0 * side
                enter_orbits(flow, back, given, body, orbit, lanes, step)
                sides |= 1 + side
        height = max(min(TILE // (2 * width), WIDTH), 1)
        for j in range(begin, end, height):
            some = times[j : min(j + height, end)]
            if width < VECTOR:
                fill_along(given, orbits, spread, work, some, tile, width, counts)
            else:
                fill_across(given, orbits, work, some, tile, width, lanes, counts)
            write_rows(tile, 0, some.size, width, flat, j, batch, first, line)
    fence()


def _fill(flow, I1, I2, I13, I23, eps, omega, times, lanes_asked, out, missing):
    """States of the map at step numbers `times`, or of the flow at times `times`, (N,).

    lanes_asked   the first trajectory wanted, a multiple of WIDTH, and the one after the last.
    """
    for task in prange(missing.shape[0]):
        fill_parts(task, flow, I1, I2, I13, I23, eps, omega, times, lanes_asked, out, missing)


def nowhere_unless_safe(orbit, work, l):
    """Orbits that may meet a pole get no state."""
    safe = lanes_at(orbit, CODE + l) >= 0.0
    for row in (OMEGA1, OMEGA2):
        store_lanes(work, row + l, select(safe, lanes_at(work, row + l), np.nan))


@staged
def jump_blocks(task, n_tasks, I1, I2, I13, I23, eps, omega, n, final, status):
    """What one task of `jump` does."""
    room = on_stack(ROOM)
    given, body = room[:BODY_AT], room[BODY_AT:ORBIT_AT]
    orbit, work = room[ORBIT_AT:WORK_AT], room[WORK_AT:SPREAD_AT]
    states, batch, results = omega.reshape(omega.size), omega.shape[0], final.reshape(final.size)
    n_blocks = (batch + WIDTH - 1) // WIDTH
    entered = -1
    for block in range(task * n_blocks // n_tasks, (task + 1) * n_blocks // n_tasks):
        first, width = first_and_width(block, WIDTH, 0, batch)
        bodies = I1, I2, I13, I23, eps
        lanes, step = enter_block(bodies, states, first, width, entered < 0, given, body)
        entered = block
        enter_orbits(False, 1.0, given, body, orbit, lanes, step)
        work[N : N + lanes] = n
        states_at(orbit, work, lanes)
        for l in range(0, lanes, ABREAST):
            nowhere_unless_safe(orbit, work, l)
        omega1, omega2 = work[OMEGA1 : OMEGA1 + WIDTH], work[OMEGA2 : OMEGA2 + WIDTH]
        scatter_pairs(omega1, omega2, first, width, results)
        write_codes(orbit, first, width, status)


def _jump(I1, I2, I13, I23, eps, omega, n, final, status):
    """State n > 0 of the map, of each orbit that cannot meet a pole on its way there.

    final    (B, 2), the states; NaN for the other orbits.
    status   (B,): OK or SUPERCRITICAL; NONFINITE for the other orbits.
    """
    n_tasks = tasks_for((omega.shape[0] + WIDTH - 1) // WIDTH)
    for task in prange(n_tasks):
        jump_blocks(task, n_tasks, I1, I2, I13, I23, eps, omega, n, final, status)


fill = Loop(_fill)
jump = Loop(_jump)
