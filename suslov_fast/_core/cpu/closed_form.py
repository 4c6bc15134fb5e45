"""Loops over trajectories and times of the closed form.

Common arguments, flat over the batch of B trajectories:

I1 ... eps   five arrays of B numbers, or of one that serves all; for the flow, eps is the unit of
             the times.
omega        (B, 2), the initial states.
out          (N, B, 2), the states; NaN where there is none.
missing      (tasks, 2): how many of them are NaN though their trajectory is not, at a step of the
             map, and between two.

Arrays of a block of up to WIDTH trajectories, lanes last:

given   (7, WIDTH), as in `blocks`.
orbit   (ORBIT, WIDTH): what the rows named below hold of each orbit.
work    (WORK_ROWS, WIDTH): the numbers of steps, and what is made of them.
tile    flat: rows of pairs of numbers, which are written to `out` together.
"""

import numpy as np
from numba import prange

from ..codes import NONFINITE, OK, SUPERCRITICAL
from ..formulas.closed_form import (
    FAR_OUT,
    LONG_TIME,
    combined,
    far_point,
    first_of_sequence,
    growth,
    in_own_units,
    level_of_flow,
    level_of_map,
    logarithm_of_ratio,
    near_state,
    orbit_point,
    out_of_range,
    ratio_of_map,
)
from ..formulas.coordinates import at_rest, from_canonical, to_canonical
from ..formulas.elementary import exponent, scaled
from ..jit import Loop, formula, part
from . import intrinsics  # noqa: F401  (compiles what is imported from vector)
from .blocks import TASKS, gather_bodies, gather_states, in_whole_vectors
from .vector import (
    VECTOR,
    borrowed,
    expect_store,
    fence,
    on_stack,
    scatter_pairs,
    select,
    splat,
    store_at,
    store_pairs,
    stream,
    stream_pairs,
    to_cache_line,
    vector_at,
)

# What a state at any time costs, in steps of the map.
WORK = 8
# Trajectories of a block, and numbers of its tile: both tables and tile stay in the first cache.
WIDTH = 64
TILE = 1024
# Rows from one exact power of r on, in a run of equal steps.
GROUP = 64
# States that one part of a task takes, of few trajectories.
FEW_STATES = 2**16
# Saved states of so many numbers are written past the caches.
BEYOND_CACHES = 2**21

# Rows of `orbit`: omega = (A1 A + B1 B, A2 A + B2 B); then what A and B are made of, as the
# formulas of the closed form say; the unit of time as a product; whether the first state is far
# out; and whether it is a number.
A1, B1, A2, B2, KAPPA, V, K, LAG, R, LOG, LOG_LOST, G, H, UNIT1, UNIT2, FAR, KNOWN = range(17)
ORBIT = 17
# Rows of `work`. While an orbit is entered they hold other things.
N, STEPS, F, E, A, B, OMEGA1, OMEGA2 = range(8)
WORK_ROWS = 8
X, Y, LOST, T, T_LOST, RATIO, SCALE = range(7)

GIVEN_AT, ORBIT_AT = 0, 7
WORK_AT = ORBIT_AT + 2 * ORBIT
TABLES_AT = WORK_AT + WORK_ROWS
TILE_AT = TABLES_AT + 22
ALONG_AT = TILE_AT + TILE // WIDTH
ROOM = ALONG_AT + 2


@part
def rows_of(room, first, rows):
    return room[first * WIDTH : (first + rows) * WIDTH].reshape((rows, WIDTH))


# Short passes with few results each: one loop over all of this would not be vectorised.


@part
def enter_units(flow, given, orbit, work, lanes):
    """X, Y and what it lost; the unit of time, and the exponent of the unit of omega / (X, Y)."""
    for l in range(lanes):
        work[T, l], work[T_LOST, l] = in_own_units(given[4, l], given[5, l], given[6, l])
    for l in range(lanes):
        e, o = work[T, l], work[T_LOST, l]
        work[X, l], work[Y, l], work[LOST, l] = to_canonical(
            given[0, l],
            given[1, l],
            given[2, l],
            given[3, l],
            scaled(given[4, l], -e),
            scaled(given[5, l], -o),
            scaled(given[6, l], -o),
        )
    for l in range(lanes):
        e, o = work[T, l], work[T_LOST, l]
        own = -exponent(max(abs(work[X, l]), abs(work[Y, l])))
        unit = own if flow else max(min(e + o, 2000.0), -2000.0)
        work[SCALE, l] = o - own if flow else -e
        time = max(min(e + o - own, 2000.0), -2000.0) if flow else 0.0
        orbit[UNIT1, l] = scaled(1.0, max(min(time, 1000.0), -1000.0))
        orbit[UNIT2, l] = scaled(1.0, time - max(min(time, 1000.0), -1000.0))
        for k in (X, Y, LOST):
            work[k, l] = scaled(work[k, l], unit)


@part
def enter_levels(flow, work, orbit, lanes):
    """T or K as a sum, log |r| as a sum, and r."""
    if flow:
        for l in range(lanes):
            work[T, l], work[T_LOST, l] = level_of_flow(work[X, l], work[Y, l], work[LOST, l])
            orbit[R, l] = 1.0
            orbit[LOG, l], orbit[LOG_LOST, l] = -2.0 * work[T, l], -2.0 * work[T_LOST, l]
        return
    for l in range(lanes):
        work[T, l], orbit[R, l] = ratio_of_map(work[X, l], work[Y, l], work[LOST, l])
    for l in range(lanes):
        work[T, l], work[T_LOST, l] = level_of_map(
            work[X, l], work[Y, l], work[LOST, l], work[T, l], orbit[R, l]
        )
    for l in range(lanes):
        orbit[LOG, l], orbit[LOG_LOST, l] = logarithm_of_ratio(
            work[T, l], work[T_LOST, l], orbit[R, l]
        )


@part
def enter_sequences(flow, back, given, orbit, work, lanes):
    for l in range(lanes):
        one, lag = (1.0, 0.0) if flow else (1.0 + work[T, l], 1.0)
        orbit[V, l], orbit[K, l], orbit[LAG, l] = first_of_sequence(
            work[X, l], work[Y, l], work[T, l], one, lag
        )
    for l in range(lanes):
        orbit[KAPPA, l] = 2.0 * orbit[R, l]
        orbit[H, l] = work[Y, l] / work[T, l]
        orbit[G, l] = 0.5 * work[X, l] * (1.0 / work[T, l] + 1.0)
        far = (orbit[R, l] <= 0.0) & (abs(work[Y, l]) > FAR_OUT * work[T, l])
        orbit[FAR, l] = 1.0 if far else 0.0
    for l in range(lanes):
        m11, m12, m21, m22 = from_canonical(
            given[0, l], given[1, l], given[2, l], given[3, l], work[RATIO, l]
        )
        share = 4.0 * (work[T, l] if flow else work[T, l] / (1.0 + work[T, l]))
        level = back * work[T, l]
        scale = work[SCALE, l]
        orbit[A1, l], orbit[B1, l] = scaled(m11 * share, scale), scaled(m12 * level, scale)
        orbit[A2, l], orbit[B2, l] = scaled(m21 * share, scale), scaled(m22 * level, scale)


@formula
def has_no_step(I13, I23, eps, X, Y):
    """Whether the map leaves a state where it is, or has no next one at (0, 1)."""
    return (X == 0.0) | at_rest(I13, I23, eps, X, Y)


@part
def enter_rest(flow, given, orbit, work, lanes):
    """States that do not move are what their B alone makes; next to (0, 1) none follows."""
    for l in range(lanes):
        x, y = work[X, l], work[Y, l]
        known = given[5, l] + given[6, l]
        rests = x == 0.0
        if not flow:
            rests = has_no_step(given[2, l], given[3, l], given[4, l], x, y)
        ends = (not flow) & rests & ((1.0 - y) - work[LOST, l] == 0.0)
        largest = max(abs(given[5, l]), abs(given[6, l]))
        of1, of2 = np.sqrt(given[0, l]), np.sqrt(given[1, l])
        spread = max(of1, of2) / min(of1, of2)
        ends |= (not flow) & (not rests) & out_of_range(x, largest * spread)
        orbit[KNOWN, l] = 1.0 if known == known else 0.0
        orbit[A1, l], orbit[A2, l] = 0.0 if rests else orbit[A1, l], 0.0 if rests else orbit[A2, l]
        orbit[B1, l] = -given[5, l] if rests else orbit[B1, l]
        orbit[B2, l] = -given[6, l] if rests else orbit[B2, l]
        orbit[B1, l] = np.nan if ends else orbit[B1, l]
        orbit[B2, l] = np.nan if ends else orbit[B2, l]
        orbit[R, l] = 1.0 if rests else orbit[R, l]
        for k in (KAPPA, V, K, LAG, LOG, LOG_LOST, FAR):
            orbit[k, l] = 0.0 if rests else orbit[k, l]


@part
def enter_orbits(flow, back, given, orbit, work, lanes):
    """All that is known of the orbits before any time is: forward, or back in time."""
    enter_units(flow, given, orbit, work, lanes)
    enter_moving(flow, back, given, orbit, work, lanes)


@part
def enter_moving(flow, back, given, orbit, work, lanes):
    """The same after `enter_units`."""
    for l in range(lanes):
        work[RATIO, l] = scaled(given[4, l], -exponent(given[4, l]))
        work[Y, l], work[LOST, l] = back * work[Y, l], back * work[LOST, l]
    enter_levels(flow, work, orbit, lanes)
    enter_sequences(flow, back, given, orbit, work, lanes)
    enter_rest(flow, given, orbit, work, lanes)


@part
def any_of(row, lanes):
    """Whether a number of a row is not 0; `any` of a comparison would allocate."""
    total = 0.0
    for l in range(lanes):
        total = max(total, abs(row[l]))
    return total != 0.0


@part
def states_at(orbit, work, lanes):
    """The states of a block at the numbers of steps |n| in its row N, one for each lane."""
    for l in range(lanes):
        work[STEPS, l] = min(abs(work[N, l]) * orbit[UNIT1, l] * orbit[UNIT2, l], LONG_TIME)
    for l in range(lanes):
        work[F, l], work[E, l] = growth(
            work[STEPS, l],
            orbit[LAG, l],
            orbit[R, l],
            orbit[LOG, l],
            orbit[LOG_LOST, l],
            orbit[V, l],
            orbit[K, l],
        )
    for l in range(lanes):
        work[A, l], work[B, l] = orbit_point(work[F, l], work[E, l], orbit[KAPPA, l])
    if any_of(orbit[FAR], lanes):
        for l in range(lanes):
            work[F, l], work[E, l] = far_point(
                work[STEPS, l],
                orbit[R, l],
                orbit[LOG, l],
                orbit[LOG_LOST, l],
                orbit[G, l],
                orbit[H, l],
            )
        for l in range(lanes):
            work[A, l] = work[F, l] if orbit[FAR, l] != 0.0 else work[A, l]
            work[B, l] = work[E, l] if orbit[FAR, l] != 0.0 else work[B, l]
    for l in range(lanes):
        work[OMEGA1, l], work[OMEGA2, l] = combined(
            orbit[A1, l], orbit[B1, l], orbit[A2, l], orbit[B2, l], work[A, l], work[B, l]
        )


@part
def count_missing(orbit, work, lanes, missing):
    """Count states that are NaN without a reason before time 0."""
    for l in range(lanes):
        if (work[OMEGA1, l] + work[OMEGA2, l] != work[OMEGA1, l] + work[OMEGA2, l]) & (
            orbit[KNOWN, l] != 0.0
        ):
            missing[0 if np.floor(work[N, l]) == work[N, l] else 1] += 1


@part
def enter_block(I1, I2, I13, I23, eps, omega, first, width, given):
    """Gather the trajectories of a block; lanes beyond its width hold harmless numbers."""
    lanes = in_whole_vectors(width)
    gather_bodies(I1, I2, I13, I23, eps, first, width, lanes, given)
    gather_states(omega, first, width, lanes, given)
    return lanes


@part
def write_numbers(source, begin, flat, target, size, line, past_caches):
    """Write numbers of a tile from `begin` on to `target`, whole lines past the caches if asked."""
    head = min((line - target) % VECTOR, size) if past_caches else 0
    stop = head + (size - head) // VECTOR * VECTOR
    for k in range(head):
        flat[target + k] = source[begin + k]
    if past_caches:
        for k in range(head, stop, VECTOR):
            stream(flat, target + k, vector_at(source, begin + k))
    else:
        for k in range(head, stop, VECTOR):
            store_at(flat, target + k, vector_at(source, begin + k))
    for k in range(stop, size):
        flat[target + k] = source[begin + k]


@part
def write_rows(tile, row, rows, width, flat, place, batch, first, line):
    """Write rows of a tile from `row` on to the rows of the result from `place` on."""
    past_caches = flat.size >= BEYOND_CACHES
    if width == batch:
        write_numbers(
            tile, 2 * row * width, flat, 2 * place * batch, 2 * rows * width, line, past_caches
        )
        return
    for k in range(rows):
        begin, target = 2 * (row + k) * width, 2 * ((place + k) * batch + first)
        write_numbers(tile, begin, flat, target, 2 * width, line, past_caches)


@part
def expect_rows(flat, place, direction, rows, batch, first, width):
    """Fetch the lines at the ends of rows: a store to part of a line waits for it."""
    for k in range(rows):
        begin = 2 * ((place + direction * k) * batch + first)
        expect_store(flat, begin)
        expect_store(flat, begin + 2 * width - 1)


@part
def put_pairs(row1, row2, tile, place, width):
    """Write lanes of two rows to a tile as pairs."""
    if width < VECTOR:
        for l in range(width):
            tile[place + 2 * l], tile[place + 2 * l + 1] = row1[l], row2[l]
        return
    for k in range(0, width, VECTOR):
        l = min(k, width - VECTOR)  # the last vector of a row stays within it
        store_pairs(tile, place + 2 * l, vector_at(row1, l), vector_at(row2, l))


@part
def shift_of_blocks(line):
    """Trajectories that the first block lacks, for the others to begin where cache lines do."""
    return -(line // 2) % (VECTOR // 2)


@part
def blocks_of(lanes, shift, batch):
    """The blocks of some lanes, which begin at a multiple of WIDTH."""
    begin, end = lanes
    return begin // WIDTH, end // WIDTH if end < batch else (batch + shift + WIDTH - 1) // WIDTH


@part
def first_and_width(block, shift, batch):
    """Blocks begin where cache lines do, if those of all rows lie alike."""
    first = max(block * WIDTH - shift, 0)
    return first, min((block + 1) * WIDTH - shift, batch) - first


# States at any times, in any order.


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
    batch, whole = omega.shape[0], out.reshape(out.size)
    line = to_cache_line(whole, 0)
    shift = shift_of_blocks(line)
    first_block, last_block = blocks_of(lanes_asked, shift, batch)
    chunk = min(max(FEW_STATES // min(batch, WIDTH), VECTOR), times.size)
    chunks = (times.size + chunk - 1) // chunk
    n_parts = (last_block - first_block) * chunks
    n_tasks = min(n_parts, missing.shape[0])
    for task in prange(n_tasks):
        room, flat = on_stack(ROOM, WIDTH).reshape(ROOM * WIDTH), borrowed(whole)
        given = rows_of(room, GIVEN_AT, 7)
        orbits = rows_of(room, ORBIT_AT, 2 * ORBIT).reshape((2, ORBIT, WIDTH))
        work, spread = rows_of(room, WORK_AT, WORK_ROWS), rows_of(room, TABLES_AT, ORBIT)
        tile = room[TILE_AT * WIDTH :]
        entered = -1
        for k in range(task * n_parts // n_tasks, (task + 1) * n_parts // n_tasks):
            block, begin = first_block + k // chunks, k % chunks * chunk
            first, width = first_and_width(block, shift, batch)
            if block != entered:
                entered = block
                lanes = enter_block(I1, I2, I13, I23, eps, omega, first, width, given)
                for side in range(2):
                    if any_time(times, side):
                        enter_orbits(flow, 1.0 - 2.0 * side, given, orbits[side], work, lanes)
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


def _jump(I1, I2, I13, I23, eps, omega, n, known, final, status):
    """State n > 0 of the map, of each orbit that cannot meet a pole on its way there.

    Y decreases along an orbit, and the poles, where 1 - Y + X**2 = 0, lie at Y >= 1.

    known    whether `final` holds the states already: then it stays as it is.
    final    (B, 2), the states; NaN for the other orbits.
    status   (B,): OK or SUPERCRITICAL; NONFINITE for the other orbits.
    """
    n_blocks = (omega.shape[0] + WIDTH - 1) // WIDTH
    n_tasks = min(n_blocks, TASKS)
    for task in prange(n_tasks):
        room = on_stack(ROOM, WIDTH).reshape(ROOM * WIDTH)
        given, orbit = rows_of(room, GIVEN_AT, 7), rows_of(room, ORBIT_AT, ORBIT)
        work = rows_of(room, WORK_AT, WORK_ROWS)
        begin = rows_of(room, TABLES_AT, 1)[0]
        for block in range(task * n_blocks // n_tasks, (task + 1) * n_blocks // n_tasks):
            first, width = first_and_width(block, 0, omega.shape[0])
            lanes = enter_block(I1, I2, I13, I23, eps, omega, first, width, given)
            enter_units(False, given, orbit, work, lanes)
            for l in range(lanes):
                rests = has_no_step(given[2, l], given[3, l], given[4, l], work[X, l], work[Y, l])
                begin[l] = 0.0 if rests else work[Y, l]
            if not known:
                enter_moving(False, 1.0, given, orbit, work, lanes)
                work[N, :lanes] = n
                states_at(orbit, work, lanes)
                for l in range(width):
                    final[first + l, 0] = work[OMEGA1, l] if begin[l] < 1.0 else np.nan
                    final[first + l, 1] = work[OMEGA2, l] if begin[l] < 1.0 else np.nan
            for l in range(width):
                code = SUPERCRITICAL if abs(begin[l]) >= 1.0 else OK
                exists = (begin[l] < 1.0) & (abs(final[first + l, 0]) < np.inf)
                status[first + l] = code if exists else NONFINITE


# Runs of equal steps. Row i has n = first + every i, and i = 64 s + 8 a + b: at the rows 64 s there
# is an exact seed, and w = (seed r**(8 a every)) r**(b every) between them. Lanes are trajectories
# or, of few, the rows b; the arithmetic is the same.

TABLE_A, TABLE_B, SEED, SLOW, START, APART, HALF_U, KAPPA_U = (
    0,
    8,
    16,
    17,
    18,
    19,
    20,
    21,
)
TABLES = 22
# Seeds w so large are taken one by one, as are those so near a pole: |k| w**2 above 1/4.
LARGE_SEED, NEAR_POLE = 400.0, 0.25
# omega is the difference of two numbers up to twice as large; float64 ends at 1.8e308.
LARGEST = 1e307
# A w this small becomes 0: subnormals are slow. Its square does not count long before.
NO_SQUARE, NEGLIGIBLE = 2.0**-300, 2.0**-960


@part
def enter_run(orbit, work, tables, first, every, lanes):
    """The powers of r between seeds, and which orbits have no state between others."""
    whole = (np.floor(first) == first) & (np.floor(every) == every)
    for table, steps in ((TABLE_A, 8.0 * every), (TABLE_B, every)):
        tables[table, :lanes] = 1.0
        for a in (1, 2, 4):
            row = tables[table + a]
            for l in range(lanes):
                work[STEPS, l] = min(a * steps * orbit[UNIT1, l] * orbit[UNIT2, l], LONG_TIME)
            for l in range(lanes):
                r = orbit[R, l]
                work[F, l], work[E, l] = growth(
                    work[STEPS, l], 0.0, r, orbit[LOG, l], orbit[LOG_LOST, l], 1.0, 0.0
                )
            for l in range(lanes):
                power = scaled(work[F, l], max(work[E, l], -1000.0))
                row[l] = power if abs(power) > NEGLIGIBLE else 0.0 * power
            for k in range(1, a):
                for l in range(lanes):
                    power = row[l] * tables[table + k, l]
                    tables[table + a + k, l] = power if abs(power) > NEGLIGIBLE else 0.0 * power
    for l in range(lanes):
        usual = (whole | (orbit[R, l] > 0.0)) & (
            abs(orbit[A1, l]) + abs(orbit[A2, l]) + abs(orbit[B1, l]) + abs(orbit[B2, l]) < LARGEST
        )
        tables[APART, l] = 0.0 if usual | (orbit[KNOWN, l] == 0.0) else 1.0


@part
def enter_seeds(orbit, work, tables, begin, end):
    """The w at the numbers in row N, of some lanes; and which must be taken row by row."""
    for l in range(begin, end):
        since = max(work[N, l] - tables[START, l], 0.0)
        work[STEPS, l] = min(since * orbit[UNIT1, l] * orbit[UNIT2, l], LONG_TIME)
    for l in range(begin, end):
        work[F, l], work[E, l] = growth(
            work[STEPS, l],
            orbit[LAG, l],
            orbit[R, l],
            orbit[LOG, l],
            orbit[LOG_LOST, l],
            orbit[V, l],
            orbit[K, l],
        )
    for l in range(begin, end):
        k = work[E, l]
        w = scaled(work[F, l], max(min(k, LARGE_SEED), -1000.0))
        w = w if abs(w) > NEGLIGIBLE else 0.0 * w
        poles = (orbit[R, l] < 0.0) & (abs(orbit[KAPPA, l] * w * w) > NEAR_POLE)
        slow = (k >= LARGE_SEED) | poles | (tables[APART, l] != 0.0)
        tables[SEED, l] = w
        tables[SLOW, l] = 1.0 if slow | (work[N, l] < tables[START, l]) else 0.0


@part
def make_lanes_of_seeds(orbit, tables, along, width):
    """Of few trajectories, each has VECTOR more lanes, for the seeds of as many groups of rows.

    along   receives the tables of each trajectory, numbers side by side: B, then A.
    """
    for l in range(width):
        for j in range(VECTOR):
            lane = VECTOR * (l + 1) + j
            for k in range(ORBIT):
                orbit[k, lane] = orbit[k, l]
            for k in (START, APART):
                tables[k, lane] = tables[k, l]
            along[VECTOR * l + j] = tables[TABLE_B + j, l]
            along[VECTOR * (VECTOR + l) + j] = tables[TABLE_A + j, l]


@part
def enter_group(orbit, work, tables, first, every, group, anew, width, lanes):
    """The seeds of a group of rows; of few trajectories, those of VECTOR groups if `anew`."""
    if width >= VECTOR:
        for l in range(lanes):
            work[N, l] = first + every * (group * GROUP)
        enter_seeds(orbit, work, tables, 0, lanes)
        return
    if anew or group % VECTOR == 0:
        for l in range(width):
            for j in range(VECTOR):
                number = first + every * ((group - group % VECTOR + j) * GROUP)
                work[N, VECTOR * (l + 1) + j] = number
        enter_seeds(orbit, work, tables, VECTOR, VECTOR * (width + 1))
    for l in range(width):
        for k in (SEED, SLOW):
            tables[k, l] = tables[k, VECTOR * (l + 1) + group % VECTOR]


@part
def number_among(row, number, lanes):
    found = 0.0
    for l in range(lanes):
        found = 1.0 if row[l] == number else found
    return found != 0.0


@formula
def not_subnormal(u, kappa):
    """A vector of w, and k, or 0 in its place: whatever is so small that it does not count."""
    u = select(abs(u) > NEGLIGIBLE, u, 0.0 * u)
    return u, select(abs(u) > NO_SQUARE, kappa, 0.0 * kappa)


@part
def rows_across(straight, orbit, tables, a, stop, tile, place, stride, width):
    """Rows 8 a ... 8 stop - 1 after a seed, of vectors of trajectories.

    straight        whether they go to their last place, past the caches.

    orbit, tables   flat: a view of a row would count references each time.
    """
    for c in range(a, stop):
        for k in range(0, width, VECTOR):
            l = min(k, width - VECTOR)
            u = vector_at(tables, SEED * WIDTH + l) * vector_at(tables, (TABLE_A + c) * WIDTH + l)
            u, kappa = not_subnormal(u, vector_at(orbit, KAPPA * WIDTH + l))
            store_at(tables, HALF_U * WIDTH + l, 0.5 * u)
            store_at(tables, KAPPA_U * WIDTH + l, 4.0 * kappa)
        for b in range(8):
            for k in range(0, width, VECTOR):
                l = min(k, width - VECTOR)
                half = vector_at(tables, HALF_U * WIDTH + l)
                omega1, omega2 = near_state(
                    half * vector_at(tables, (TABLE_B + b) * WIDTH + l),
                    vector_at(tables, KAPPA_U * WIDTH + l),
                    vector_at(orbit, A1 * WIDTH + l),
                    vector_at(orbit, B1 * WIDTH + l),
                    vector_at(orbit, A2 * WIDTH + l),
                    vector_at(orbit, B2 * WIDTH + l),
                )
                if straight:
                    stream_pairs(tile, place + 2 * l, omega1, omega2)
                else:
                    store_pairs(tile, place + 2 * l, omega1, omega2)
            place += stride


@part
def rows_along(orbit, tables, along, a, stop, tile, place, stride, width):
    """The same of vectors of rows; `along` holds both tables of each trajectory, side by side."""
    for l in range(width):
        a1, b1 = splat(orbit[A1 * WIDTH + l]), splat(orbit[B1 * WIDTH + l])
        a2, b2 = splat(orbit[A2 * WIDTH + l]), splat(orbit[B2 * WIDTH + l])
        powers = vector_at(along, VECTOR * l)
        u = tables[SEED * WIDTH + l] * vector_at(along, VECTOR * (VECTOR + l))
        u, kappa = not_subnormal(u, splat(orbit[KAPPA * WIDTH + l]))
        store_at(tables, HALF_U * WIDTH, 0.5 * u)
        store_at(tables, KAPPA_U * WIDTH, 4.0 * kappa)
        target = place + 2 * l
        for c in range(a, stop):
            half, kappa_of_u = tables[HALF_U * WIDTH + c], tables[KAPPA_U * WIDTH + c]
            omega1, omega2 = near_state(half * powers, kappa_of_u, a1, b1, a2, b2)
            if stride == 2:
                store_pairs(tile, target, omega1, omega2)
            else:
                scatter_pairs(tile, target, stride, omega1, omega2)
            target += VECTOR * stride


@part
def one_by_one(given, orbit, spread, work, tables, l, n, every, rows, tile, place, stride, missing):
    """Eight rows of one trajectory by the general formula, of which some rows are asked for."""
    start = tables[START, l]
    for k in range(ORBIT):
        spread[k, :VECTOR] = orbit[k, l]
    for b in range(VECTOR):
        work[N, b] = max(n + every * b - start, 0.0)
    states_at(spread, work, VECTOR)
    for b in range(VECTOR):
        since = n + every * b - start
        if b < rows[0] or b >= rows[1] or since <= 0.0:
            work[OMEGA1, b], work[OMEGA2, b] = given[5, l], given[6, l]
        if since >= 0.0:
            tile[place + b * stride + 2 * l] = work[OMEGA1, b]
            tile[place + b * stride + 2 * l + 1] = work[OMEGA2, b]
    count_missing(spread, work, VECTOR, missing)


@part
def keep_rows(tables, l, n, every, rows, tile, place, stride, flat, target, step):
    """Put the rows of a trajectory before its start into a tile as they are."""
    for b in range(rows[0], rows[1]):
        if n + every * b < tables[START, l]:
            for k in range(2):
                tile[place + b * stride + 2 * l + k] = flat[target + b * step + k]


@part
def spread_starts(start, first, width, lanes, row):
    for l in range(lanes):
        row[l] = start[0] if start.size == 1 else start[first + min(l, width - 1)]


def _fill_run(
    flow, back, I1, I2, I13, I23, eps, omega, start, run, lanes_asked, rows, out, missing
):
    """States at n = first + every i >= 0, i in a range of rows.

    The states of a row are the same bit for bit whatever rows and trajectories are asked for.

    back          1, or -1 for states at -n.
    start         (B,) or (1,): the number n that omega has, 0 in most cases. Rows of numbers below
                  stay as they are.
    run           first, every: floats of at least 0, n being integers for the map if r < 0.
    lanes_asked   the first trajectory wanted, a multiple of WIDTH, and the one after the last.
    rows          begin, end, origin and direction: the rows begin <= i < end go to those numbered
                  origin + direction i of `out`, direction being 1 or -1.
    """
    first, every = run
    begin, end, origin, direction = rows
    batch, whole = omega.shape[0], out.reshape(out.size)
    line = to_cache_line(whole, 0)
    shift = shift_of_blocks(line)
    first_block, last_block = blocks_of(lanes_asked, shift, batch)
    chunk = max(FEW_STATES // max(min(batch, WIDTH), 1), GROUP)
    chunks = (end + chunk - 1) // chunk - begin // chunk
    n_parts = (last_block - first_block) * chunks
    n_tasks = min(n_parts, missing.shape[0])
    for task in prange(n_tasks):
        room, flat = on_stack(ROOM, WIDTH).reshape(ROOM * WIDTH), borrowed(whole)
        given, orbit = rows_of(room, GIVEN_AT, 7), rows_of(room, ORBIT_AT, ORBIT)
        spread = rows_of(room, ORBIT_AT + ORBIT, ORBIT)
        work, tables = rows_of(room, WORK_AT, WORK_ROWS), rows_of(room, TABLES_AT, TABLES)
        flat_orbit, flat_tables = orbit.reshape(orbit.size), tables.reshape(tables.size)
        tile = room[TILE_AT * WIDTH : TILE_AT * WIDTH + TILE]
        along = room[ALONG_AT * WIDTH :]
        entered = -1
        for k in range(task * n_parts // n_tasks, (task + 1) * n_parts // n_tasks):
            block, part_of_rows = first_block + k // chunks, begin // chunk + k % chunks
            top, bottom = max(begin, part_of_rows * chunk), min(end, (part_of_rows + 1) * chunk)
            lane, width = first_and_width(block, shift, batch)
            if block != entered:
                entered = block
                lanes = enter_block(I1, I2, I13, I23, eps, omega, lane, width, given)
                enter_orbits(flow, back, given, orbit, work, lanes)
                spread_starts(start, lane, width, lanes, tables[START])
                enter_run(orbit, work, tables, first, every, lanes)
                if width < VECTOR:
                    make_lanes_of_seeds(orbit, tables, along, width)
            height = GROUP if width < VECTOR else max(TILE // (2 * width) // 8 * 8, 8)
            in_line = flat.size >= BEYOND_CACHES and batch % (VECTOR // 2) == 0
            in_line = in_line and width % VECTOR == 0 and (line - 2 * lane) % VECTOR == 0
            seeded, filled, any_slow, begins = -1, 0, False, False
            row = top // 8 * 8
            while row < bottom:
                n = first + every * row
                if row // GROUP != seeded:
                    anew, seeded = seeded < 0, row // GROUP
                    enter_group(orbit, work, tables, first, every, seeded, anew, width, lanes)
                    any_slow = any_of(tables[SLOW], width)
                    begins = number_among(tables[START], n, width)
                a = row % GROUP // 8
                stop = a + min(min(8 - a, (height - filled) // 8), (bottom - row + 7) // 8)
                if filled == 0 and width != batch and not in_line:
                    upper = max(row, top)
                    ahead = min(height, bottom - upper)
                    place = origin + direction * upper
                    expect_rows(flat, place, direction, ahead, batch, lane, width)
                place = 2 * width * (filled if direction > 0 else height - 1 - filled)
                stride = 2 * width * direction
                straight = in_line and row >= top and bottom - row >= 8
                if straight and not any_slow and not (a == 0 and begins):
                    stop = a + min(8 - a, (bottom - row) // 8)
                    target = 2 * ((origin + direction * row) * batch + lane)
                    step = 2 * direction * batch
                    rows_across(True, flat_orbit, flat_tables, a, stop, flat, target, step, width)
                    row += 8 * (stop - a)
                    continue
                if in_line:
                    stop = a + 1
                if width < VECTOR:
                    rows_along(flat_orbit, flat_tables, along, a, stop, tile, place, stride, width)
                else:
                    rows_across(False, flat_orbit, flat_tables, a, stop, tile, place, stride, width)
                if a == 0:
                    for l in range(width):
                        if n == tables[START, l]:
                            tile[place + 2 * l] = given[5, l]
                            tile[place + 2 * l + 1] = given[6, l]
                for later in range(row, row + 8 * (stop - a) if any_slow else row, 8):
                    n = first + every * later
                    eight = place + (later - row) * stride
                    asked = max(top - later, 0), min(bottom - later, 8)
                    for l in range(width):
                        if tables[SLOW, l] != 0.0:
                            one_by_one(
                                given,
                                orbit,
                                spread,
                                work,
                                tables,
                                l,
                                n,
                                every,
                                asked,
                                tile,
                                eight,
                                stride,
                                missing[task],
                            )
                        if n < tables[START, l]:
                            target = 2 * ((origin + direction * later) * batch + lane + l)
                            step = 2 * direction * batch
                            keep_rows(
                                tables, l, n, every, asked, tile, eight, stride, flat, target, step
                            )
                filled, row = filled + 8 * (stop - a), row + 8 * (stop - a)
                if filled == height or row >= bottom or in_line:
                    upper, lower = max(row - filled, top), min(row, bottom)
                    in_tile, in_out = upper - (row - filled), origin + upper
                    if direction < 0:
                        in_tile, in_out = height - (lower - (row - filled)), origin - (lower - 1)
                    write_rows(tile, in_tile, lower - upper, width, flat, in_out, batch, lane, line)
                    filled = 0
        fence()


fill = Loop(_fill)
fill_run = Loop(_fill_run)
jump = Loop(_jump)
