"""Loops over runs of the closed form: states at equal steps.

Row i of a run has n = first + every i, and i = 64 s + 8 a + b: at the rows 64 s there is an exact
seed, and w = (seed r**(8 a every)) r**(b every) between them. Lanes are trajectories or, of few,
the rows b; the arithmetic is the same.

Arguments and arrays are those of `closed_form`; in addition

tables   rows as in `orbits`: what the rows named below hold of each orbit.
along    the tables of few trajectories, numbers side by side.
"""

import numpy as np
from numba import prange

from ..formulas.closed_form import (
    logarithm_of_power,
    near_state,
    power_of_logarithm,
    sign_of_power,
)
from ..formulas.elementary import scaled, two_to_the
from ..jit import Loop
from ..lanewise import lanewise, larger, select, smaller
from ..staged import apart, staged
from .blocks import spread as spread_numbers
from .closed_form import FEW_STATES
from .orbits import (
    A1,
    A2,
    ABREAST,
    B1,
    B2,
    BODY,
    GIVEN,
    GIVEN1,
    GIVEN2,
    KAPPA,
    KNOWN,
    LOG,
    LOG_LOST,
    OMEGA1,
    OMEGA2,
    ORBIT,
    UNIT1,
    UNIT2,
    WIDTH,
    WORK,
    N,
    R,
    after,
    count_missing,
    enter_block,
    enter_orbits,
    in_whole,
    lanes_at,
    states_at,
    store_lanes,
)
from .tiles import (
    BEYOND_CACHES,
    TILE,
    blocks_of,
    expect_rows,
    first_and_width,
    shift_of_blocks,
    write_codes,
    write_numbers,
    write_rows,
)
from .vector import (
    VECTOR,
    fence,
    on_stack,
    splat,
    store_at,
    store_pairs,
    store_pairs_apart,
    stream_pairs,
    to_cache_line,
    vector_at,
)

# Rows from one exact power of r on.
GROUP = 64

# Where the rows of `tables` lie: r**(8 a every) for a = 0 ... 7, r**(b every) likewise; the w of
# the seed, and whether the rows after it must be taken one by one; the number of the given state;
# whether all rows must; and what `rows_across` and `rows_along` keep of a group.
TABLES = 22 * WIDTH
TABLE_A, TABLE_B = 0, 8 * WIDTH
SEED, SLOW, START, APART, HALF_U, KAPPA_U = range(16 * WIDTH, TABLES, WIDTH)

BODY_AT = GIVEN
ORBIT_AT = BODY_AT + BODY
SPREAD_AT = ORBIT_AT + ORBIT
WORK_AT = SPREAD_AT + ORBIT
TABLES_AT = WORK_AT + WORK
TILE_AT = TABLES_AT + TABLES
ALONG_AT = TILE_AT + TILE
ROOM = ALONG_AT + 2 * WIDTH

# Where `along` has the numbers of lanes, of a single trajectory.
NUMBERS = 2 * VECTOR

# Seeds w so large are taken one by one, as are those so near a pole: |k| w**2 above 1/4.
LARGE_SEED, NEAR_POLE = 400.0, 0.25
# omega is the difference of two numbers up to twice as large; float64 ends at 1.8e308.
LARGEST = 1e307
# A w this small becomes 0: subnormals are slow. Its square does not count long before.
NO_SQUARE, NEGLIGIBLE = 2.0**-300, 2.0**-960


@lanewise
def not_negligible(v):
    """v, or 0 in the place of what would soon be subnormal."""
    return select(abs(v) > NEGLIGIBLE, v, 0.0 * v)


@lanewise
def enter_run(every, whole, orbit, tables, l):
    """The powers of r between seeds, and which orbits have no state between others."""
    r, log_r, lost = (lanes_at(orbit, row + l) for row in (R, LOG, LOG_LOST))
    steps = every * lanes_at(orbit, UNIT1 + l) * lanes_at(orbit, UNIT2 + l)
    log_r, lost = logarithm_of_power(steps, log_r, lost)
    for table, eights in ((TABLE_A, 8.0), (TABLE_B, 1.0)):
        powers = [1.0]
        for a in (1.0, 2.0, 4.0):
            p, k = power_of_logarithm(a * eights * log_r, a * eights * lost)
            sign = select(r > 0.0, 1.0, sign_of_power(a * eights * every, -1.0))
            power = not_negligible(sign * (1.0 + p) * two_to_the(larger(k, -1000.0)))
            powers += [power, *(not_negligible(power * other) for other in powers[1:])]
        for row, power in enumerate(powers):
            store_lanes(tables, table + row * WIDTH + l, power)
    a1, b1, a2, b2 = (abs(lanes_at(orbit, row + l)) for row in (A1, B1, A2, B2))
    usual = ((r > 0.0) | whole) & (a1 + a2 + b1 + b2 < LARGEST)
    usual = usual | (lanes_at(orbit, KNOWN + l) == 0.0)
    store_lanes(tables, APART + l, select(usual, 0.0, 1.0))


@lanewise
def enter_seed(orbit, work, tables, l):
    """The w at the numbers in row N; and which must be taken row by row."""
    n, start = lanes_at(work, N + l), lanes_at(tables, START + l)
    f, k = after(larger(n - start, 0.0), orbit, l)
    w = not_negligible(scaled(f, larger(smaller(k, LARGE_SEED), -1000.0)))
    pole = abs(lanes_at(orbit, KAPPA + l) * w * w) > NEAR_POLE
    slow = (k >= LARGE_SEED) | (lanes_at(orbit, R + l) < 0.0) & pole
    slow = slow | (lanes_at(tables, APART + l) != 0.0) | (n < start)
    store_lanes(tables, SEED + l, w)
    store_lanes(tables, SLOW + l, select(slow, 1.0, 0.0))


@staged
def make_lanes_of_seeds(orbit, tables, along, width, abreast):
    """Spread few trajectories over the lanes of the seeds of groups of rows.

    abreast   how many groups have their seeds made at once: trajectory l has so many lanes, from
              that number times l on.
    along     receives the tables of each trajectory, numbers side by side: B, then A; of a
              single one B twice, and the numbers of lanes.
    """
    for l in range(width - 1, -1, -1):
        for j in range(VECTOR):
            along[VECTOR * l + j] = tables[TABLE_B + j * WIDTH + l]
            along[VECTOR * (VECTOR + l) + j] = tables[TABLE_A + j * WIDTH + l]
        for lane in range(abreast * l, abreast * (l + 1)):
            for k in range(0, ORBIT, WIDTH):
                orbit[k + lane] = orbit[k + l]
            for k in (START, APART):
                tables[k + lane] = tables[k + l]
    if width == 1:
        for j in range(VECTOR):
            along[VECTOR + j], along[NUMBERS + j] = along[j], j


@staged
def enter_group(orbit, work, tables, first, every, group, width, lanes, abreast):
    """The seeds of a group of rows; of few trajectories, those of `abreast` groups."""
    if abreast == 1:
        work[N : N + lanes] = first + every * (group * GROUP)
    for j in range(abreast if abreast > 1 else 0):
        number = first + every * ((group - group % abreast + j) * GROUP)
        for l in range(width):
            work[N + abreast * l + j] = number
    for l in range(0, lanes if abreast == 1 else abreast * width, ABREAST):
        enter_seed(orbit, work, tables, l)


@staged
def any_is(value, tables, index, stride, width):
    """Whether any of some numbers of the tables has a value."""
    found = False
    for l in range(width):
        found |= tables[index + stride * l] == value
    return found


@lanewise
def not_subnormal(u, kappa):
    """w, and k, or 0 in their place: whatever is so small that it does not count."""
    u = not_negligible(u)
    return u, select(abs(u) > NO_SQUARE, kappa, 0.0 * kappa)


@lanewise
def enter_eighth(orbit, tables, c, l):
    """What row 8 c after a seed has of lanes l, l + 1, ..., into HALF_U and KAPPA_U."""
    u = vector_at(tables, SEED + l) * vector_at(tables, TABLE_A + c * WIDTH + l)
    u, kappa = not_subnormal(u, vector_at(orbit, KAPPA + l))
    store_at(tables, HALF_U + l, 0.5 * u)
    store_at(tables, KAPPA_U + l, 4.0 * kappa)


@lanewise
def state_across(orbit, tables, b, l):
    """The states b rows later."""
    half = vector_at(tables, HALF_U + l) * vector_at(tables, TABLE_B + b * WIDTH + l)
    a1, b1, a2, b2 = (vector_at(orbit, row + l) for row in (A1, B1, A2, B2))
    return near_state(half, vector_at(tables, KAPPA_U + l), a1, b1, a2, b2)


@staged
def rows_across(straight, orbit, tables, a, stop, tile, place, stride, width):
    """Rows 8 a ... 8 stop - 1 after a seed, of vectors of trajectories.

    straight   whether they go to their last place, past the caches.
    """
    for c in range(a, stop):
        for k in range(0, width, VECTOR):
            enter_eighth(orbit, tables, c, min(k, width - VECTOR))
        for b in range(8):
            for k in range(0, width, VECTOR):
                l = min(k, width - VECTOR)
                omega1, omega2 = state_across(orbit, tables, b, l)
                if straight:
                    stream_pairs(tile, place + 2 * l, omega1, omega2)
                else:
                    store_pairs(tile, place + 2 * l, omega1, omega2)
            place += stride


@lanewise
def enter_along(orbit, tables, along, l, lane, held):
    """The w / 2 and 4 k of the eighths of a group of rows, into HALF_U and KAPPA_U from 8 on.

    held   Where those of the eighth before them lie, which are moved there.
    """
    u = tables[SEED + lane] * vector_at(along, VECTOR * (VECTOR + l))
    u, kappa = not_subnormal(u, orbit[KAPPA + lane])
    for row in (HALF_U, KAPPA_U):
        tables[row + 7] = tables[row + held]
    store_at(tables, HALF_U + 8, 0.5 * u)
    store_at(tables, KAPPA_U + 8, 4.0 * kappa)


@staged
def rows_along(orbit, tables, along, a, stop, tile, place, stride, width, abreast, among):
    """The same of vectors of rows; `along` holds both tables of each trajectory, side by side."""
    for l in range(width):
        lane = abreast * l + among
        a1, b1 = splat(orbit[A1 + lane]), splat(orbit[B1 + lane])
        a2, b2 = splat(orbit[A2 + lane]), splat(orbit[B2 + lane])
        powers = vector_at(along, VECTOR * l)
        enter_along(orbit, tables, along, l, lane, 7)
        target = place + 2 * l
        for c in range(a, stop):
            half, kappa_of_u = tables[HALF_U + 8 + c], tables[KAPPA_U + 8 + c]
            omega1, omega2 = near_state(half * powers, kappa_of_u, a1, b1, a2, b2)
            if stride == 2:
                store_pairs(tile, target, omega1, omega2)
            else:
                store_pairs_apart(tile, target, stride, omega1, omega2)
            target += VECTOR * stride


@staged
def rows_of_one(orbit, tables, along, a, stop, tile, flat, target, line, among, held):
    """The same of a single trajectory to their last place, past the caches.

    A vector begins where a cache line does, and so holds the last rows of one eighth and the first
    of the next. What is left of the last eighth is written with the next, or by `rest_of_one`.

    target   where row 8 a goes.
    held     where HALF_U has the eighth before, if rows of it are left, or 0.
    returns  the same for the next.
    """
    a1, b1 = splat(orbit[A1 + among]), splat(orbit[B1 + among])
    a2, b2 = splat(orbit[A2 + among]), splat(orbit[B2 + among])
    enter_along(orbit, tables, along, 0, among, held)
    head = (line - target) % VECTOR // 2
    begin, end = a, stop
    if head > 0:
        end = stop - 1
        if held > 0:
            begin = a - 1
        else:
            half, kappa = splat(tables[HALF_U + 8 + a]), splat(tables[KAPPA_U + 8 + a])
            omega1, omega2 = near_state(half * vector_at(along, 0), kappa, a1, b1, a2, b2)
            store_pairs(tile, 0, omega1, omega2)
            write_numbers(tile, 0, flat, target, 2 * head, line, True)
    powers = vector_at(along, head)
    of_next = vector_at(along, NUMBERS) >= 1.0 * (VECTOR - head)
    target += 2 * (VECTOR * (begin - a) + head)
    for c in range(8 + begin, 8 + end):
        half = splat(tables[HALF_U + c])
        half = select(of_next, splat(tables[HALF_U + c + 1]), half)
        kappa = splat(tables[KAPPA_U + c])
        kappa = select(of_next, splat(tables[KAPPA_U + c + 1]), kappa)
        omega1, omega2 = near_state(half * powers, kappa, a1, b1, a2, b2)
        stream_pairs(flat, target, omega1, omega2)
        target += 2 * VECTOR
    return 7 + stop if head > 0 else 0


@staged
def rest_of_one(orbit, tables, along, tile, flat, target, line, held):
    """What `rows_of_one` left of the eighth that ends where row `target` begins."""
    a1, b1 = splat(orbit[A1]), splat(orbit[B1])
    a2, b2 = splat(orbit[A2]), splat(orbit[B2])
    half, kappa = tables[HALF_U + held], tables[KAPPA_U + held]
    omega1, omega2 = near_state(half * vector_at(along, 0), kappa, a1, b1, a2, b2)
    store_pairs(tile, 0, omega1, omega2)
    head = (line - target) % VECTOR
    write_numbers(tile, head, flat, target - 2 * VECTOR + head, 2 * VECTOR - head, line, True)


@staged
def one_by_one(
    given, orbit, spread, work, tables, l, lane, n, every, rows, tile, place, stride, missing
):
    """Eight rows of one trajectory by the general formula, of which some rows are asked for."""
    start = tables[START + lane]
    for k in range(0, ORBIT, WIDTH):
        spread[k : k + ABREAST] = orbit[k + lane]
    for b in range(ABREAST):
        work[N + b] = max(n + every * b - start, 0.0)
    any_missing = states_at(spread, work, VECTOR)
    for b in range(VECTOR):
        since = n + every * b - start
        if b < rows[0] or b >= rows[1] or since <= 0.0:
            work[OMEGA1 + b], work[OMEGA2 + b] = given[GIVEN1 + l], given[GIVEN2 + l]
        if since >= 0.0:
            tile[place + b * stride] = work[OMEGA1 + b]
            tile[place + b * stride + 1] = work[OMEGA2 + b]
    if any_missing:
        count_missing(spread, work, VECTOR, missing)


@staged
def eight_apart(arrays, lanes, numbers, asked, tile_place, stride, flat, flat_place, step, missing):
    """Eight rows, of which some trajectories are taken by themselves.

    numbers   that of the first row, and by how much they grow.
    """
    given, orbit, spread, work, tables, tile, _ = arrays
    (width, abreast, among), (n, every) = lanes, numbers
    for l in range(width):
        one, place = abreast * l + among, tile_place + 2 * l
        if tables[SLOW + one] != 0.0:
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
                place,
                stride,
                missing,
            )
        if n < tables[START + one]:
            for b in range(asked[0], asked[1]):
                if n + every * b < tables[START + one]:
                    for k in range(2):
                        tile[place + b * stride + k] = flat[flat_place + 2 * l + b * step + k]


@staged
def parts_of_run(omega, lanes_asked, rows, out):
    """The parts that tasks share: some rows of a block each.

    Returns the first block, how many rows a part has, how many parts a block has, and all of them.
    """
    batch, (begin, end, _, _) = omega.shape[0], rows
    first_block, last_block = blocks_of(lanes_asked, shift_of_blocks(to_cache_line(out, 0)), batch)
    chunk = max(FEW_STATES // max(min(batch, WIDTH), 1), GROUP)
    chunks = (end + chunk - 1) // chunk - begin // chunk
    return first_block, chunk, chunks, (last_block - first_block) * chunks


@staged
def fill_part(arrays, block, run, part, rows, flat, batch, line, missing):
    """Some rows of a block that is entered, from one on and below another: `part`."""
    (given, orbit, _, work, tables, tile, along), (lane, width, abreast, lanes) = arrays, block
    (first, every), (top, bottom), (_, _, origin, direction) = run, part, rows
    height = GROUP if width < VECTOR else max(TILE // (2 * width) // 8 * 8, 8)
    large = flat.size >= BEYOND_CACHES
    in_line = large and batch % (VECTOR // 2) == 0 and width % VECTOR == 0
    in_line = in_line and (line - 2 * lane) % VECTOR == 0
    alone = large and batch == 1 and direction > 0 and line % 2 == 0
    step = 2 * direction * batch
    seeded, among, held, filled, slow, begins = -1, 0, 0, 0, False, False
    row = top // 8 * 8
    while row < bottom:
        n, group = first + every * row, row // GROUP
        if group != seeded:
            among = group % abreast
            if seeded < 0 or among == 0:
                enter_group(orbit, work, tables, first, every, group, width, lanes, abreast)
            seeded = group
            slow = any_is(1.0, tables, SLOW + among, abreast, width)
            begins = any_is(n, tables, START, abreast, width)
        a = row % GROUP // 8
        target = 2 * ((origin + direction * row) * batch + lane)
        straight = (in_line or alone) and row >= top and bottom - row >= 8
        if straight and not slow and not (a == 0 and begins):
            stop = a + min(8 - a, (bottom - row) // 8)
            if alone:
                held = rows_of_one(
                    orbit, tables, along, a, stop, tile, flat, target, line, among, held
                )
            else:
                rows_across(True, orbit, tables, a, stop, flat, target, step, width)
            row += 8 * (stop - a)
            continue
        if held > 0:
            rest_of_one(orbit, tables, along, tile, flat, target, line, held)
            held = 0
        if filled == 0 and width != batch and not in_line:
            upper = max(row, top)
            ahead, place = min(height, bottom - upper), origin + direction * upper
            expect_rows(flat, place, direction, ahead, batch, lane, width)
        stop = a + min(min(8 - a, (height - filled) // 8), (bottom - row + 7) // 8)
        stop = a + 1 if in_line or alone else stop
        place = 2 * width * (filled if direction > 0 else height - 1 - filled)
        stride = 2 * width * direction
        if width < VECTOR:
            rows_along(orbit, tables, along, a, stop, tile, place, stride, width, abreast, among)
        else:
            rows_across(False, orbit, tables, a, stop, tile, place, stride, width)
        if a == 0:
            for l in range(width):
                if n == tables[START + abreast * l]:
                    tile[place + 2 * l] = given[GIVEN1 + l]
                    tile[place + 2 * l + 1] = given[GIVEN2 + l]
        for later in range(row, row + 8 * (stop - a) if slow else row, 8):
            asked = max(top - later, 0), min(bottom - later, 8)
            in_tile, in_flat = place + (later - row) * stride, target + (later - row) * step
            eight_apart(
                arrays,
                (width, abreast, among),
                (first + every * later, every),
                asked,
                in_tile,
                stride,
                flat,
                in_flat,
                step,
                missing,
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
        rest_of_one(orbit, tables, along, tile, flat, 2 * (origin + row), line, held)


@apart
def fill_parts(
    task,
    flow,
    back,
    I1,
    I2,
    I13,
    I23,
    eps,
    omega,
    start,
    run,
    lanes_asked,
    rows,
    out,
    status,
    missing,
):
    """What one task of `fill_run` does."""
    room, (first, every) = on_stack(ROOM), run
    given, body, orbit = room[:BODY_AT], room[BODY_AT:ORBIT_AT], room[ORBIT_AT:SPREAD_AT]
    spread, work, tables = room[SPREAD_AT:WORK_AT], room[WORK_AT:TABLES_AT], room[TABLES_AT:]
    tile, along = room[TILE_AT:ALONG_AT], room[ALONG_AT:]
    states, batch, line = omega.reshape(omega.size), omega.shape[0], to_cache_line(out, 0)
    n_tasks = missing.shape[0]
    first_block, chunk, chunks, n_parts = parts_of_run(omega, lanes_asked, rows, out)
    # Few trajectories leave lanes to seeds, but not to more than there are groups of rows.
    groups = in_whole((rows[1] + GROUP - 1) // GROUP - rows[0] // GROUP)
    entered, lanes, step_of_body = -1, 0, 0
    for k in range(task * n_parts // n_tasks, (task + 1) * n_parts // n_tasks):
        block, part_of_rows = first_block + k // chunks, rows[0] // chunk + k % chunks
        lane, width = first_and_width(block, shift_of_blocks(line), batch)
        abreast = min(WIDTH // width // VECTOR * VECTOR, groups) if width < VECTOR else 1
        if block != entered:
            bodies = I1, I2, I13, I23, eps
            lanes, step_of_body = enter_block(bodies, states, lane, width, entered, given, body)
            entered = block
            enter_orbits(flow, back, given, body, orbit, lanes, step_of_body)
            if status.size > 0:
                write_codes(orbit, lane, width, status)
            spread_numbers(start, lane, width, lanes, tables[START:])
            whole = (np.floor(first) == first) & (np.floor(every) == every)
            for l in range(0, lanes, ABREAST):
                enter_run(every, whole, orbit, tables, l)
            if width < VECTOR:
                make_lanes_of_seeds(orbit, tables, along, width, abreast)
        fill_part(
            (given, orbit, spread, work, tables, tile, along),
            (lane, width, abreast, lanes),
            run,
            (max(rows[0], part_of_rows * chunk), min(rows[1], (part_of_rows + 1) * chunk)),
            rows,
            out.reshape(out.size),
            batch,
            line,
            missing[task],
        )
    fence()


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
    for task in prange(missing.shape[0]):
        fill_parts(
            task,
            flow,
            back,
            I1,
            I2,
            I13,
            I23,
            eps,
            omega,
            start,
            run,
            lanes_asked,
            rows,
            out,
            status,
            missing,
        )


fill_run = Loop(_fill_run)
