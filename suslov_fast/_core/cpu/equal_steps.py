"""Loops over runs of the closed form: states at equal steps.

Row i of a run has n = first + every i, and i = 64 s + 8 a + b: at the rows 64 s there is an exact
seed, and w = (seed r**(8 a every)) r**(b every) between them. Lanes are trajectories or, of few,
the rows b; the arithmetic is the same.

Arguments and arrays are those of `closed_form`; in addition

tables   (TABLES, WIDTH): what the rows named below hold of each orbit.
along    the tables of few trajectories, numbers side by side.
"""

import numpy as np
from numba import prange

from ..formulas.closed_form import LONG_TIME, growth, near_state
from ..formulas.elementary import scaled
from ..jit import Loop, formula, part
from . import intrinsics  # noqa: F401  (compiles what is imported from vector)
from .closed_form import FEW_STATES
from .orbits import (
    A1,
    A2,
    B1,
    B2,
    BODY,
    CODE,
    KAPPA,
    KNOWN,
    LOG,
    LOG_LOST,
    OMEGA1,
    OMEGA2,
    ORBIT,
    STEPS,
    UNIT1,
    UNIT2,
    WIDTH,
    WORK_ROWS,
    E,
    F,
    N,
    R,
    any_of,
    count_missing,
    enter_block,
    enter_orbits,
    grow,
    states_at,
)
from .tiles import (
    BEYOND_CACHES,
    TILE,
    blocks_of,
    expect_rows,
    first_and_width,
    rows_of,
    shift_of_blocks,
    write_codes,
    write_numbers,
    write_rows,
)
from .vector import (
    VECTOR,
    borrowed,
    fence,
    on_stack,
    scatter_pairs,
    select,
    splat,
    store_at,
    store_pairs,
    stream_pairs,
    to_cache_line,
    vector_at,
)

# Rows from one exact power of r on.
GROUP = 64

# Rows of `tables`: r**(8 a every) for a = 0 ... 7, r**(b every) likewise; the w of the seed, and
# whether the rows after it must be taken one by one; the number of the given state; whether all
# rows must; and what `rows_across` and `rows_along` keep of a group.
TABLE_A, TABLE_B = 0, 8
SEED, SLOW, START, APART, HALF_U, KAPPA_U = range(16, 22)
TABLES = 22

GIVEN_AT, BODY_AT = 0, 7
ORBIT_AT = BODY_AT + BODY
SPREAD_AT = ORBIT_AT + ORBIT
WORK_AT = SPREAD_AT + ORBIT
TABLES_AT = WORK_AT + WORK_ROWS
TILE_AT = TABLES_AT + TABLES
ALONG_AT = TILE_AT + TILE // WIDTH
ROOM = ALONG_AT + 2

# Where `along` has the numbers of lanes, of a single trajectory.
NUMBERS = 2 * VECTOR

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
def enter_seeds(orbit, work, tables, lanes):
    """The w at the numbers in row N; and which must be taken row by row."""
    for l in range(lanes):
        work[STEPS, l] = max(work[N, l] - tables[START, l], 0.0)
    grow(orbit, work, lanes)
    for l in range(lanes):
        k = work[E, l]
        w = scaled(work[F, l], max(min(k, LARGE_SEED), -1000.0))
        w = w if abs(w) > NEGLIGIBLE else 0.0 * w
        poles = (orbit[R, l] < 0.0) & (abs(orbit[KAPPA, l] * w * w) > NEAR_POLE)
        slow = (k >= LARGE_SEED) | poles | (tables[APART, l] != 0.0)
        tables[SEED, l] = w
        tables[SLOW, l] = 1.0 if slow | (work[N, l] < tables[START, l]) else 0.0


@part
def seeds_abreast(width):
    """The groups of rows whose seeds are made at once, of each of `width` trajectories.

    Trajectory l has so many lanes, from that number times l on.
    """
    return WIDTH // width // VECTOR * VECTOR if width < VECTOR else 1


@part
def make_lanes_of_seeds(orbit, tables, along, width):
    """Spread few trajectories over the lanes of the seeds of groups of rows.

    along   receives the tables of each trajectory, numbers side by side: B, then A; of a single
            one B twice, and the numbers of lanes.
    """
    abreast = seeds_abreast(width)
    for l in range(width - 1, -1, -1):
        for j in range(VECTOR):
            along[VECTOR * l + j] = tables[TABLE_B + j, l]
            along[VECTOR * (VECTOR + l) + j] = tables[TABLE_A + j, l]
        for lane in range(abreast * l, abreast * (l + 1)):
            for k in range(ORBIT):
                orbit[k, lane] = orbit[k, l]
            for k in (START, APART):
                tables[k, lane] = tables[k, l]
    if width == 1:
        for j in range(VECTOR):
            along[VECTOR + j], along[NUMBERS + j] = along[j], j


@part
def enter_group(orbit, work, tables, first, every, group, anew, width, lanes):
    """The seeds of a group of rows; of few trajectories, those of several groups if `anew`."""
    abreast = seeds_abreast(width)
    if abreast == 1:
        for l in range(lanes):
            work[N, l] = first + every * (group * GROUP)
        enter_seeds(orbit, work, tables, lanes)
    elif anew or group % abreast == 0:
        for l in range(width):
            for j in range(abreast):
                number = first + every * ((group - group % abreast + j) * GROUP)
                work[N, abreast * l + j] = number
        enter_seeds(orbit, work, tables, abreast * width)


@part
def any_slow(tables, width, abreast, among):
    """Whether a trajectory must be taken row by row in this group."""
    if abreast == 1:
        return any_of(tables[SLOW], width)
    slow = False
    for l in range(width):
        slow |= tables[SLOW, abreast * l + among] != 0.0
    return slow


@part
def any_begins(tables, number, width, abreast):
    """Whether a trajectory is given by its state of this number."""
    found = False
    if abreast == 1:
        for l in range(width):
            found |= tables[START, l] == number
    else:
        for l in range(width):
            found |= tables[START, abreast * l] == number
    return found


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
def enter_along(orbit, tables, along, l, lane, held):
    """The w / 2 and 4 k of the eighths of a group of rows, into HALF_U and KAPPA_U from 8 on.

    held   Where those of the eighth before them lie, which are moved there.
    """
    u = tables[SEED * WIDTH + lane] * vector_at(along, VECTOR * (VECTOR + l))
    u, kappa = not_subnormal(u, splat(orbit[KAPPA * WIDTH + lane]))
    for row in (HALF_U * WIDTH, KAPPA_U * WIDTH):
        tables[row + 7] = tables[row + held]
    store_at(tables, HALF_U * WIDTH + 8, 0.5 * u)
    store_at(tables, KAPPA_U * WIDTH + 8, 4.0 * kappa)


@part
def rows_along(orbit, tables, along, a, stop, tile, place, stride, width, abreast, among):
    """The same of vectors of rows; `along` holds both tables of each trajectory, side by side."""
    for l in range(width):
        lane = abreast * l + among
        a1, b1 = splat(orbit[A1 * WIDTH + lane]), splat(orbit[B1 * WIDTH + lane])
        a2, b2 = splat(orbit[A2 * WIDTH + lane]), splat(orbit[B2 * WIDTH + lane])
        powers = vector_at(along, VECTOR * l)
        enter_along(orbit, tables, along, l, lane, 7)
        target = place + 2 * l
        for c in range(a, stop):
            half, kappa_of_u = tables[HALF_U * WIDTH + 8 + c], tables[KAPPA_U * WIDTH + 8 + c]
            omega1, omega2 = near_state(half * powers, kappa_of_u, a1, b1, a2, b2)
            if stride == 2:
                store_pairs(tile, target, omega1, omega2)
            else:
                scatter_pairs(tile, target, stride, omega1, omega2)
            target += VECTOR * stride


@part
def rows_of_one(orbit, tables, along, a, stop, tile, flat, target, line, among, held):
    """The same of a single trajectory to their last place, past the caches.

    A vector begins where a cache line does, and so holds the last rows of one eighth and the first
    of the next. What is left of the last eighth is written with the next, or by `rest_of_one`.

    target   where row 8 a goes.
    held     where HALF_U has the eighth before, if rows of it are left, or 0.
    returns  the same for the next.
    """
    a1, b1 = splat(orbit[A1 * WIDTH + among]), splat(orbit[B1 * WIDTH + among])
    a2, b2 = splat(orbit[A2 * WIDTH + among]), splat(orbit[B2 * WIDTH + among])
    enter_along(orbit, tables, along, 0, among, held)
    head = (line - target) % VECTOR // 2
    begin, end = a, stop
    if head > 0:
        end = stop - 1
        if held > 0:
            begin = a - 1
        else:
            half, kappa = tables[HALF_U * WIDTH + 8 + a], tables[KAPPA_U * WIDTH + 8 + a]
            omega1, omega2 = near_state(half * vector_at(along, 0), kappa, a1, b1, a2, b2)
            store_pairs(tile, 0, omega1, omega2)
            write_numbers(tile, 0, flat, target, 2 * head, line, True)
    powers = vector_at(along, head)
    of_next = vector_at(along, NUMBERS) >= 1.0 * (VECTOR - head)
    target += 2 * (VECTOR * (begin - a) + head)
    for c in range(8 + begin, 8 + end):
        half = splat(tables[HALF_U * WIDTH + c])
        half = select(of_next, splat(tables[HALF_U * WIDTH + c + 1]), half)
        kappa = splat(tables[KAPPA_U * WIDTH + c])
        kappa = select(of_next, splat(tables[KAPPA_U * WIDTH + c + 1]), kappa)
        omega1, omega2 = near_state(half * powers, kappa, a1, b1, a2, b2)
        stream_pairs(flat, target, omega1, omega2)
        target += 2 * VECTOR
    return 7 + stop if head > 0 else 0


@part
def rest_of_one(orbit, tables, along, tile, flat, target, line, held):
    """What `rows_of_one` left of the eighth that ends where row `target` begins."""
    a1, b1 = splat(orbit[A1 * WIDTH]), splat(orbit[B1 * WIDTH])
    a2, b2 = splat(orbit[A2 * WIDTH]), splat(orbit[B2 * WIDTH])
    half, kappa = tables[HALF_U * WIDTH + held], tables[KAPPA_U * WIDTH + held]
    omega1, omega2 = near_state(half * vector_at(along, 0), kappa, a1, b1, a2, b2)
    store_pairs(tile, 0, omega1, omega2)
    head = (line - target) % VECTOR
    write_numbers(tile, head, flat, target - 2 * VECTOR + head, 2 * VECTOR - head, line, True)


@part
def one_by_one(
    given, orbit, spread, work, tables, l, lane, n, every, rows, tile, place, stride, missing
):
    """Eight rows of one trajectory by the general formula, of which some rows are asked for."""
    start = tables[START, lane]
    for k in range(ORBIT):
        spread[k, :VECTOR] = orbit[k, lane]
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
def keep_rows(start, l, n, every, rows, tile, place, stride, flat, target, step):
    """Put the rows of a trajectory before its start into a tile as they are."""
    for b in range(rows[0], rows[1]):
        if n + every * b < start:
            for k in range(2):
                tile[place + b * stride + 2 * l + k] = flat[target + b * step + k]


@part
def spread_starts(start, first, width, lanes, row):
    for l in range(lanes):
        row[l] = start[0] if start.size == 1 else start[first + min(l, width - 1)]


def _fill_run(
    flow, back, I1, I2, I13, I23, eps, omega, start, run, lanes_asked, rows, out, status, missing
):
    """States at n = first + every i >= 0, i in a range of rows.

    The states of a row are the same bit for bit whatever rows and trajectories are asked for.

    back          1, or -1 for states at -n.
    start         (B,) or (1,): the number n that omega has, 0 in most cases. Rows of numbers below
                  stay as they are.
    run           first, every: floats of at least 0, n being integers for the map if r < 0.
    lanes_asked   the first trajectory wanted, a multiple of WIDTH, and the one after the last.
    status        (B,), receives how trajectories end, as in `jump`, or (0,).
    rows          begin, end, origin and direction: the rows begin <= i < end go to those numbered
                  origin + direction i of `out`, direction being 1 or -1.
    """
    first, every = run
    begin, end, origin, direction = rows
    batch, whole, states = omega.shape[0], out.reshape(out.size), omega.reshape(omega.size)
    line = to_cache_line(whole, 0)
    shift = shift_of_blocks(line)
    first_block, last_block = blocks_of(lanes_asked, shift, batch)
    chunk = max(FEW_STATES // max(min(batch, WIDTH), 1), GROUP)
    chunks = (end + chunk - 1) // chunk - begin // chunk
    n_parts = (last_block - first_block) * chunks
    n_tasks = min(n_parts, missing.shape[0])
    for task in prange(n_tasks):
        room, flat = on_stack(ROOM, WIDTH).reshape(ROOM * WIDTH), borrowed(whole)
        given, body = rows_of(room, GIVEN_AT, 7), rows_of(room, BODY_AT, BODY)
        orbit, spread = rows_of(room, ORBIT_AT, ORBIT), rows_of(room, SPREAD_AT, ORBIT)
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
                lanes = enter_block(
                    I1, I2, I13, I23, eps, borrowed(states), lane, width, entered, given, body
                )
                entered = block
                enter_orbits(flow, back, given, body, orbit, work, lanes)
                if status.size > 0:
                    write_codes(orbit[CODE], lane, width, borrowed(status))
                spread_starts(start, lane, width, lanes, tables[START])
                enter_run(orbit, work, tables, first, every, lanes)
                if width < VECTOR:
                    make_lanes_of_seeds(orbit, tables, along, width)
            height = GROUP if width < VECTOR else max(TILE // (2 * width) // 8 * 8, 8)
            in_line = flat.size >= BEYOND_CACHES and batch % (VECTOR // 2) == 0
            in_line = in_line and width % VECTOR == 0 and (line - 2 * lane) % VECTOR == 0
            alone = batch == 1 and direction > 0 and flat.size >= BEYOND_CACHES and line % 2 == 0
            abreast, among, held = seeds_abreast(width), 0, 0
            seeded, filled, slow, begins = -1, 0, False, False
            row = top // 8 * 8
            while row < bottom:
                n = first + every * row
                if row // GROUP != seeded:
                    anew, seeded = seeded < 0, row // GROUP
                    among = seeded % abreast
                    enter_group(orbit, work, tables, first, every, seeded, anew, width, lanes)
                    slow = any_slow(tables, width, abreast, among)
                    begins = any_begins(tables, n, width, abreast)
                a = row % GROUP // 8
                stop = a + min(min(8 - a, (height - filled) // 8), (bottom - row + 7) // 8)
                if filled == 0 and width != batch and not in_line:
                    upper = max(row, top)
                    ahead = min(height, bottom - upper)
                    place = origin + direction * upper
                    expect_rows(flat, place, direction, ahead, batch, lane, width)
                place = 2 * width * (filled if direction > 0 else height - 1 - filled)
                stride = 2 * width * direction
                straight = (in_line or alone) and row >= top and bottom - row >= 8
                if straight and not slow and not (a == 0 and begins):
                    stop = a + min(8 - a, (bottom - row) // 8)
                    target = 2 * ((origin + direction * row) * batch + lane)
                    step = 2 * direction * batch
                    if alone:
                        held = rows_of_one(
                            flat_orbit,
                            flat_tables,
                            along,
                            a,
                            stop,
                            tile,
                            flat,
                            target,
                            line,
                            among,
                            held,
                        )
                    else:
                        rows_across(
                            True, flat_orbit, flat_tables, a, stop, flat, target, step, width
                        )
                    row += 8 * (stop - a)
                    continue
                if held > 0:
                    target = 2 * (origin + row)
                    rest_of_one(flat_orbit, flat_tables, along, tile, flat, target, line, held)
                    held = 0
                if in_line or alone:
                    stop = a + 1
                if width < VECTOR:
                    rows_along(
                        flat_orbit,
                        flat_tables,
                        along,
                        a,
                        stop,
                        tile,
                        place,
                        stride,
                        width,
                        abreast,
                        among,
                    )
                else:
                    rows_across(False, flat_orbit, flat_tables, a, stop, tile, place, stride, width)
                if a == 0:
                    for l in range(width):
                        if n == tables[START, abreast * l]:
                            tile[place + 2 * l] = given[5, l]
                            tile[place + 2 * l + 1] = given[6, l]
                for later in range(row, row + 8 * (stop - a) if slow else row, 8):
                    n = first + every * later
                    eight = place + (later - row) * stride
                    asked = max(top - later, 0), min(bottom - later, 8)
                    for l in range(width):
                        one = abreast * l + among
                        if tables[SLOW, one] != 0.0:
                            one_by_one(
                                given,
                                orbit,
                                spread,
                                work,
                                tables,
                                l,
                                one,
                                n,
                                every,
                                asked,
                                tile,
                                eight,
                                stride,
                                missing[task],
                            )
                        if n < tables[START, one]:
                            target = 2 * ((origin + direction * later) * batch + lane + l)
                            step = 2 * direction * batch
                            keep_rows(
                                tables[START, one],
                                l,
                                n,
                                every,
                                asked,
                                tile,
                                eight,
                                stride,
                                flat,
                                target,
                                step,
                            )
                filled, row = filled + 8 * (stop - a), row + 8 * (stop - a)
                if filled == height or row >= bottom or in_line or alone:
                    upper, lower = max(row - filled, top), min(row, bottom)
                    in_tile, in_out = upper - (row - filled), origin + upper
                    if direction < 0:
                        in_tile, in_out = height - (lower - (row - filled)), origin - (lower - 1)
                    write_rows(tile, in_tile, lower - upper, width, flat, in_out, batch, lane, line)
                    filled = 0
            if held > 0:
                target = 2 * (origin + row)
                rest_of_one(flat_orbit, flat_tables, along, tile, flat, target, line, held)
        fence()


fill_run = Loop(_fill_run)
