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

from ..jit import Loop, part
from ..lanewise import lanewise, select
from .blocks import TASKS, scatter_pairs
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
from .vector import VECTOR, borrowed, fence, on_stack, to_cache_line

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


@part
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


@part
def any_time(times, side):
    """Whether any time is on a side: 0 where they are >= 0, 1 where they are negative."""
    found = False
    for j in range(times.size):
        found |= (times[j] < 0.0) if side else (times[j] >= 0.0)
    return found


@part
def fill_along(given, orbits, spread, work, times, tile, width, missing):
    """The same where lanes are times."""
    size = times.size
    lanes = in_whole(size)
    for l in range(width):
        for side in range(2):
            if not any_time(times, side):
                continue
            for k in range(0, ORBIT, WIDTH):
                spread[k : k + lanes] = orbits[ORBIT * side + k + l]
            for j in range(lanes):
                work[N + j] = times[min(j, size - 1)]
            any_missing = states_at(spread, work, lanes)
            for j in range(size):
                n = times[j]
                if (n < 0.0) == (side == 1):
                    if n == 0.0:
                        work[OMEGA1 + j], work[OMEGA2 + j] = given[GIVEN1 + l], given[GIVEN2 + l]
                    tile[2 * (j * width + l)] = work[OMEGA1 + j]
                    tile[2 * (j * width + l) + 1] = work[OMEGA2 + j]
                else:
                    work[OMEGA1 + j], work[OMEGA2 + j] = 0.0, 0.0
            if any_missing:
                count_missing(spread, work, size, missing)


def _fill(flow, I1, I2, I13, I23, eps, omega, times, lanes_asked, out, missing):
    """States of the map at step numbers `times`, or of the flow at times `times`, (N,).

    lanes_asked   the first trajectory wanted, a multiple of WIDTH, and the one after the last.
    """
    batch, line = omega.shape[0], to_cache_line(borrowed(out), 0)
    shift = shift_of_blocks(line)
    first_block, last_block = blocks_of(lanes_asked, shift, batch)
    chunk = min(max(FEW_STATES // min(batch, WIDTH), VECTOR), times.size)
    chunks = (times.size + chunk - 1) // chunk
    n_parts = (last_block - first_block) * chunks
    n_tasks = min(n_parts, missing.shape[0])
    for task in prange(n_tasks):
        room, flat, states = on_stack(1, ROOM)[0], borrowed(out), borrowed(omega)
        bodies = borrowed(I1), borrowed(I2), borrowed(I13), borrowed(I23), borrowed(eps)
        given, body, orbits = room[:BODY_AT], room[BODY_AT:ORBIT_AT], room[ORBIT_AT:WORK_AT]
        work, spread, tile = room[WORK_AT:SPREAD_AT], room[SPREAD_AT:TILE_AT], room[TILE_AT:]
        moments, counts = borrowed(times), borrowed(missing[task])
        entered = -1
        for k in range(task * n_parts // n_tasks, (task + 1) * n_parts // n_tasks):
            block, begin = first_block + k // chunks, k % chunks * chunk
            first, width = first_and_width(block, shift, batch)
            if block != entered:
                lanes, step = enter_block(bodies, states, first, width, entered, given, body)
                entered = block
                for side in range(2):
                    if any_time(moments, side):
                        orbit, back = orbits[ORBIT * side :], 1.0 - 2.0 * side
                        enter_orbits(flow, back, given, body, orbit, lanes, step)
            end = min(begin + chunk, times.size)
            height = max(min(TILE // (2 * width), WIDTH), 1)
            for j in range(begin, end, height):
                some = moments[j : min(j + height, end)]
                if width < VECTOR:
                    fill_along(given, orbits, spread, work, some, tile, width, counts)
                else:
                    fill_across(given, orbits, work, some, tile, width, lanes, counts)
                write_rows(tile, 0, some.size, width, flat, j, batch, first, line)
        fence()


@lanewise
def nowhere_unless_safe(orbit, work, l):
    """Orbits that may meet a pole get no state."""
    safe = lanes_at(orbit, CODE + l) >= 0.0
    for row in (OMEGA1, OMEGA2):
        store_lanes(work, row + l, select(safe, lanes_at(work, row + l), np.nan))


def _jump(I1, I2, I13, I23, eps, omega, n, final, status):
    """State n > 0 of the map, of each orbit that cannot meet a pole on its way there.

    final    (B, 2), the states; NaN for the other orbits.
    status   (B,): OK or SUPERCRITICAL; NONFINITE for the other orbits.
    """
    batch = omega.shape[0]
    n_blocks = (batch + WIDTH - 1) // WIDTH
    n_tasks = min(n_blocks, TASKS)
    for task in prange(n_tasks):
        room, states = on_stack(1, ROOM)[0], borrowed(omega)
        bodies = borrowed(I1), borrowed(I2), borrowed(I13), borrowed(I23), borrowed(eps)
        results, codes = borrowed(final), borrowed(status)
        given, body = room[:BODY_AT], room[BODY_AT:ORBIT_AT]
        orbit, work = room[ORBIT_AT:WORK_AT], room[WORK_AT:SPREAD_AT]
        entered = -1
        for block in range(task * n_blocks // n_tasks, (task + 1) * n_blocks // n_tasks):
            first, width = first_and_width(block, 0, batch)
            lanes, step = enter_block(bodies, states, first, width, entered, given, body)
            entered = block
            enter_orbits(False, 1.0, given, body, orbit, lanes, step)
            work[N : N + lanes] = n
            states_at(orbit, work, lanes)
            for l in range(0, lanes, ABREAST):
                nowhere_unless_safe(orbit, work, l)
            omega1, omega2 = work[OMEGA1 : OMEGA1 + WIDTH], work[OMEGA2 : OMEGA2 + WIDTH]
            scatter_pairs(omega1, omega2, first, width, results)
            write_codes(orbit, first, width, codes)


fill = Loop(_fill)
jump = Loop(_jump)
