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
from . import intrinsics  # noqa: F401  (compiles what is imported from vector)
from .blocks import TASKS, in_whole_vectors, scatter_pairs
from .orbits import (
    BODY,
    CODE,
    OMEGA1,
    OMEGA2,
    ORBIT,
    WIDTH,
    WORK_ROWS,
    N,
    count_missing,
    enter_block,
    enter_orbits,
    states_at,
)
from .tiles import (
    TILE,
    blocks_of,
    first_and_width,
    put_pairs,
    rows_of,
    shift_of_blocks,
    write_codes,
    write_rows,
)
from .vector import VECTOR, borrowed, fence, on_stack, to_cache_line

# What it costs to enter an orbit, and a state of it at any time, in steps of the map.
ENTERING, WORK = 64, 8
# States that one part of a task takes, of few trajectories.
FEW_STATES = 2**16

GIVEN_AT, BODY_AT = 0, 7
ORBIT_AT = BODY_AT + BODY
WORK_AT = ORBIT_AT + 2 * ORBIT
SPREAD_AT = WORK_AT + WORK_ROWS
TILE_AT = SPREAD_AT + ORBIT
ROOM = TILE_AT + TILE // WIDTH


@part
def fill_across(given, orbits, work, times, tile, width, lanes, missing):
    """Rows of a tile: the states of a block at some times."""
    for j in range(times.size):
        n = times[j]
        orbit = orbits[1 if n < 0.0 else 0]
        if n == 0.0:
            put_pairs(given[5], given[6], tile, 2 * j * width, width)
        else:
            work[N, :lanes] = n
            states_at(orbit, work, lanes)
            count_missing(orbit, work, width, missing)
            put_pairs(work[OMEGA1], work[OMEGA2], tile, 2 * j * width, width)


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
    lanes = in_whole_vectors(size)
    for l in range(width):
        for side in range(2):
            if not any_time(times, side):
                continue
            for k in range(ORBIT):
                spread[k, :lanes] = orbits[side, k, l]
            for j in range(lanes):
                work[N, j] = times[min(j, size - 1)]
            states_at(spread, work, lanes)
            for j in range(size):
                n = times[j]
                if (n < 0.0) == (side == 1):
                    if n == 0.0:
                        work[OMEGA1, j], work[OMEGA2, j] = given[5, l], given[6, l]
                    tile[2 * (j * width + l)] = work[OMEGA1, j]
                    tile[2 * (j * width + l) + 1] = work[OMEGA2, j]
                else:
                    work[OMEGA1, j], work[OMEGA2, j] = 0.0, 0.0
            count_missing(spread, work, size, missing)


def _fill(flow, I1, I2, I13, I23, eps, omega, times, lanes_asked, out, missing):
    """States of the map at step numbers `times`, or of the flow at times `times`, (N,).

    lanes_asked   the first trajectory wanted, a multiple of WIDTH, and the one after the last.
    """
    batch, whole, states = omega.shape[0], out.reshape(out.size), omega.reshape(omega.size)
    line = to_cache_line(whole, 0)
    shift = shift_of_blocks(line)
    first_block, last_block = blocks_of(lanes_asked, shift, batch)
    chunk = min(max(FEW_STATES // min(batch, WIDTH), VECTOR), times.size)
    chunks = (times.size + chunk - 1) // chunk
    n_parts = (last_block - first_block) * chunks
    n_tasks = min(n_parts, missing.shape[0])
    for task in prange(n_tasks):
        room, flat = on_stack(ROOM, WIDTH).reshape(ROOM * WIDTH), borrowed(whole)
        given, body = rows_of(room, GIVEN_AT, 7), rows_of(room, BODY_AT, BODY)
        orbits = rows_of(room, ORBIT_AT, 2 * ORBIT).reshape((2, ORBIT, WIDTH))
        work, spread = rows_of(room, WORK_AT, WORK_ROWS), rows_of(room, SPREAD_AT, ORBIT)
        tile = room[TILE_AT * WIDTH :]
        entered = -1
        for k in range(task * n_parts // n_tasks, (task + 1) * n_parts // n_tasks):
            block, begin = first_block + k // chunks, k % chunks * chunk
            first, width = first_and_width(block, shift, batch)
            if block != entered:
                lanes = enter_block(
                    I1, I2, I13, I23, eps, borrowed(states), first, width, entered, given, body
                )
                entered = block
                for side in range(2):
                    if any_time(times, side):
                        back = 1.0 - 2.0 * side
                        enter_orbits(flow, back, given, body, orbits[side], work, lanes)
            end = min(begin + chunk, times.size)
            height = max(min(TILE // (2 * width), WIDTH), 1)
            for j in range(begin, end, height):
                some = times[j : min(j + height, end)]
                if width < VECTOR:
                    fill_along(given, orbits, spread, work, some, tile, width, missing[task])
                else:
                    fill_across(given, orbits, work, some, tile, width, lanes, missing[task])
                write_rows(tile, 0, some.size, width, flat, j, batch, first, line)
        fence()


def _jump(I1, I2, I13, I23, eps, omega, n, final, status):
    """State n > 0 of the map, of each orbit that cannot meet a pole on its way there.

    final    (B, 2), the states; NaN for the other orbits.
    status   (B,): OK or SUPERCRITICAL; NONFINITE for the other orbits.
    """
    batch, states, ends = omega.shape[0], omega.reshape(omega.size), final.reshape(final.size)
    n_blocks = (batch + WIDTH - 1) // WIDTH
    n_tasks = min(n_blocks, TASKS)
    for task in prange(n_tasks):
        room = on_stack(ROOM, WIDTH).reshape(ROOM * WIDTH)
        given, body = rows_of(room, GIVEN_AT, 7), rows_of(room, BODY_AT, BODY)
        orbit, work = rows_of(room, ORBIT_AT, ORBIT), rows_of(room, WORK_AT, WORK_ROWS)
        entered = -1
        for block in range(task * n_blocks // n_tasks, (task + 1) * n_blocks // n_tasks):
            first, width = first_and_width(block, 0, batch)
            lanes = enter_block(
                I1, I2, I13, I23, eps, borrowed(states), first, width, entered, given, body
            )
            entered = block
            enter_orbits(False, 1.0, given, body, orbit, work, lanes)
            work[N, :lanes] = n
            states_at(orbit, work, lanes)
            for l in range(lanes):
                safe = orbit[CODE, l] >= 0.0
                work[OMEGA1, l] = work[OMEGA1, l] if safe else np.nan
                work[OMEGA2, l] = work[OMEGA2, l] if safe else np.nan
            scatter_pairs(work[OMEGA1], work[OMEGA2], first, width, borrowed(ends))
            write_codes(orbit[CODE], first, width, status)


fill = Loop(_fill)
jump = Loop(_jump)
