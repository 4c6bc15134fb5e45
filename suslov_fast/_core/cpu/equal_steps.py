"""Loops over runs of the closed form: states at equal steps.

Row i of a run has n = first + every i, and i = 64 s + 8 a + b: at the rows 64 s there is an exact
seed, and w = (seed r**(8 a every)) r**(b every) between them. Lanes are trajectories or, of few,
the rows b; the arithmetic is the same.

Arguments and arrays are those of `closed_form` and `seeds`. The processor computes while it waits
for what it wrote to leave for memory, but looks only some thousand numbers ahead: so a block is
entered, and seeds are made, a few lanes at a time between the rows of what comes before.
"""

from numba import prange

from ..formulas.closed_form import near_state
from ..jit import Loop
from ..lanewise import any_lane, select
from ..staged import apart, staged
from .closed_form import FEW_STATES
from .orbits import (
    A1,
    A2,
    ABREAST,
    B1,
    B2,
    GIVEN1,
    GIVEN2,
    KAPPA,
    OMEGA1,
    OMEGA2,
    ORBIT,
    WIDTH,
    WORK,
    N,
    count_missing,
    in_whole,
    states_at,
)
from .seeds import (
    BLOCK,
    GROUP,
    HALF_U,
    KAPPA_U,
    NUMBERS,
    SEED,
    SLOW,
    START,
    TABLE_A,
    TABLE_B,
    enter_piece,
    enter_seeds_across,
    enter_seeds_along,
    known_of,
    make_lanes_of_seeds,
    not_negligible,
    pieces_of,
    seeds_of,
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
    all_lanes,
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

# Where a block's arrays lie, those of the next one, and others.
SPREAD_AT = 2 * BLOCK
WORK_AT = SPREAD_AT + ORBIT
TILE_AT = WORK_AT + WORK
ALONG_AT = TILE_AT + TILE
ROOM = ALONG_AT + 2 * WIDTH

# The square of a w this small does not count.
NO_SQUARE = 2.0**-300


@staged
def kinds_of_rows(n, tables, seeds, width, abreast, among):
    """Whether some trajectory must be taken row by row after a seed; whether any begins with number
    n, and all do.
    """
    slow, begins, all_begin = False, False, True
    if width < VECTOR:
        for l in range(0, abreast * width, abreast):
            slow |= seeds[SLOW + l + among] == 1.0
            begins |= tables[START + l] == n
            all_begin &= tables[START + l] == n
    else:
        for k in range(0, width, VECTOR):
            l = min(k, width - VECTOR)
            starts = vector_at(tables, START + l) == n
            slow |= any_lane(vector_at(seeds, SLOW + l) == 1.0)
            begins |= any_lane(starts)
            all_begin &= all_lanes(starts)
    return slow, begins, all_begin


def not_subnormal(u, kappa):
    """w, and k, or 0 in their place: whatever is so small that it does not count."""
    u = not_negligible(u)
    return u, select(abs(u) > NO_SQUARE, kappa, 0.0 * kappa)


def enter_eighth(orbit, tables, seeds, c, l):
    """What row 8 c after a seed has of lanes l, l + 1, ..., into HALF_U and KAPPA_U."""
    u = vector_at(seeds, SEED + l) * vector_at(tables, TABLE_A + c * WIDTH + l)
    u, kappa = not_subnormal(u, vector_at(orbit, KAPPA + l))
    store_at(tables, HALF_U + l, 0.5 * u)
    store_at(tables, KAPPA_U + l, 4.0 * kappa)


def state_across(orbit, tables, b, l):
    """The states b rows later."""
    half = vector_at(tables, HALF_U + l) * vector_at(tables, TABLE_B + b * WIDTH + l)
    a1, b1, a2, b2 = (vector_at(orbit, row + l) for row in (A1, B1, A2, B2))
    return near_state(half, vector_at(tables, KAPPA_U + l), a1, b1, a2, b2)


@staged
def rows_across(straight, orbit, tables, seeds, a, stop, some, tile, place, stride, width):
    """Rows 8 a ... 8 stop - 1 after a seed, of vectors of trajectories.

    straight   whether they go to their last place, past the caches.
    some       the first row of each eighth that is made, and the one after the last.
    """
    for c in range(a, stop):
        for k in range(0, width, VECTOR):
            enter_eighth(orbit, tables, seeds, c, min(k, width - VECTOR))
        for b in range(some[0], some[1]):
            target = place + (8 * (c - a) + b) * stride
            for k in range(0, width, VECTOR):
                l = min(k, width - VECTOR)
                omega1, omega2 = state_across(orbit, tables, b, l)
                if straight:
                    stream_pairs(tile, target + 2 * l, omega1, omega2)
                else:
                    store_pairs(tile, target + 2 * l, omega1, omega2)


def enter_along(orbit, tables, seeds, along, l, lane, held):
    """The w / 2 and 4 k of the eighths of a group of rows, into HALF_U and KAPPA_U from 8 on.

    held   Where those of the eighth before them lie, which are moved there.
    """
    u = seeds[SEED + lane] * vector_at(along, VECTOR * (VECTOR + l))
    u, kappa = not_subnormal(u, orbit[KAPPA + lane])
    for row in (HALF_U, KAPPA_U):
        tables[row + 7] = tables[row + held]
    store_at(tables, HALF_U + 8, 0.5 * u)
    store_at(tables, KAPPA_U + 8, 4.0 * kappa)


@staged
def rows_along(orbit, tables, seeds, along, a, stop, tile, place, stride, width, abreast, among):
    """The same of vectors of rows; `along` holds both tables of each trajectory, side by side."""
    for l in range(width):
        lane = abreast * l + among
        a1, b1 = splat(orbit[A1 + lane]), splat(orbit[B1 + lane])
        a2, b2 = splat(orbit[A2 + lane]), splat(orbit[B2 + lane])
        powers = vector_at(along, VECTOR * l)
        enter_along(orbit, tables, seeds, along, l, lane, 7)
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
def rows_of_one(orbit, tables, seeds, along, a, stop, tile, flat, target, line, among, held):
    """The same of a single trajectory to their last place, past the caches.

    A vector begins where a cache line does, and so holds the last rows of one eighth and the first
    of the next. What is left of the last eighth is written with the next, or by `rest_of_one`.

    target   where row 8 a goes.
    held     where HALF_U has the eighth before, if rows of it are left, or 0.
    returns  the same for the next.
    """
    a1, b1 = splat(orbit[A1 + among]), splat(orbit[B1 + among])
    a2, b2 = splat(orbit[A2 + among]), splat(orbit[B2 + among])
    enter_along(orbit, tables, seeds, along, 0, among, held)
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
    given, orbit, spread, work, tables, seeds, tile = arrays
    (width, abreast, among), (n, every) = lanes, numbers
    for l in range(width):
        one, place = abreast * l + among, tile_place + 2 * l
        if seeds[SLOW + one] != 0.0:
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
        if flat is not None and n < tables[START + one]:
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
def fill_block(arrays, lanes, run, part, rows, sink, pieces, of_next, missing):
    """Some rows of a block that is entered: `part`, from one on and below another.

    pieces    in how many the next block is entered, or 0.
    of_next   what `enter_piece` takes after their number.
    returns   how many of them were done.
    """
    given, orbit, spread, work, tables, tile, along = arrays
    (lane, width, abreast), (_, put, of_sink, straight) = lanes, sink
    (first, every), (top, bottom), (_, _, origin, direction) = run, part, rows
    flat, batch, line = straight if straight is not None else (None, 0, 0)
    height = GROUP if width < VECTOR else max(TILE // (2 * width) // 8 * 8, 8)
    large = straight is not None and flat.size >= BEYOND_CACHES
    whole = large and batch % (VECTOR // 2) == 0 and width % VECTOR == 0
    in_line = whole and (line - 2 * lane) % VECTOR == 0
    alone = large and batch == 1 and direction > 0 and line % 2 == 0
    step = 2 * direction * batch
    seeded, among, held, filled = -1, 0, 0, 0
    slow, begins, all_begin = False, False, False
    # Lanes that have the seeds of the group that is entered next.
    ready, piece, row = width, 0, top // 8 * 8
    while row < bottom:
        n, group = first + every * row, row // GROUP
        seeds = seeds_of(tables, group, abreast)
        if group != seeded:
            among = group % abreast
            if width >= VECTOR:
                number = first + every * (group * GROUP)
                for l in range(ready, width, ABREAST):
                    enter_seeds_across(number, orbit, work, tables, seeds, l)
                ready = 0 if (group + 1) * GROUP < bottom else width
            elif seeded < 0 or among == 0:
                enter_seeds_along(first, every, group, orbit, work, tables, seeds, width, abreast)
            seeded = group
            slow, begins, all_begin = kinds_of_rows(n, tables, seeds, width, abreast, among)
        elif ready < width:
            number = first + every * ((group + 1) * GROUP)
            seeds_of_next = seeds_of(tables, group + 1, abreast)
            enter_seeds_across(number, orbit, work, tables, seeds_of_next, ready)
            ready += ABREAST
        elif piece < pieces:
            enter_piece(piece, *of_next)
            piece += 1
        a = row % GROUP // 8
        target = 2 * ((origin + direction * row) * batch + lane)
        starts, left = a == 0 and begins, bottom - row
        if in_line and row >= top and not slow and (all_begin or not starts):
            if starts:
                for l in range(0, width, VECTOR):
                    omega1, omega2 = vector_at(given, GIVEN1 + l), vector_at(given, GIVEN2 + l)
                    stream_pairs(flat, target + 2 * l, omega1, omega2)
            wanted = 1 if starts else 0, min(left, 8)
            rows_across(True, orbit, tables, seeds, a, a + 1, wanted, flat, target, step, width)
            row += 8
            continue
        if alone and row >= top and left >= 8 and not slow and not starts:
            stop = a + min(8 - a, left // 8)
            held = rows_of_one(
                orbit, tables, seeds, along, a, stop, tile, flat, target, line, among, held
            )
            row += 8 * (stop - a)
            continue
        if alone and held > 0:
            rest_of_one(orbit, tables, along, tile, flat, target, line, held)
            held = 0
        if straight is not None and filled == 0 and width != batch and not in_line:
            upper = max(row, top)
            some, place = min(height, bottom - upper), origin + direction * upper
            expect_rows(flat, place, direction, some, batch, lane, width)
        stop = a + min(min(8 - a, (height - filled) // 8), (bottom - row + 7) // 8)
        stop = a + 1 if in_line or alone else stop
        place = 2 * width * (filled if direction > 0 else height - 1 - filled)
        stride = 2 * width * direction
        if width < VECTOR:
            rows_along(
                orbit, tables, seeds, along, a, stop, tile, place, stride, width, abreast, among
            )
        else:
            every_row = 0, 8
            rows_across(False, orbit, tables, seeds, a, stop, every_row, tile, place, stride, width)
        if a == 0:
            for l in range(width):
                if n == tables[START + abreast * l]:
                    tile[place + 2 * l] = given[GIVEN1 + l]
                    tile[place + 2 * l + 1] = given[GIVEN2 + l]
        for later in range(row, row + 8 * (stop - a) if slow else row, 8):
            asked = max(top - later, 0), min(bottom - later, 8)
            in_tile, in_flat = place + (later - row) * stride, target + (later - row) * step
            eight_apart(
                (given, orbit, spread, work, tables, seeds, tile),
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
            put(of_sink, tile, in_tile, lower - upper, lane, width, in_out)
            filled = 0
    if alone and held > 0:
        rest_of_one(orbit, tables, along, tile, flat, 2 * (origin + row), line, held)
    return piece


@staged
def fill_blocks(parts, blocks, common, rows, status, sink, missing):
    """Some parts of a run.

    parts    the first, the one after the last, how many rows each has, and how many a block has.
    blocks   the first, and what `first_and_width` takes after its number.
    common   what `enter_piece` takes for all blocks.
    sink     what is done with a block that is entered and with rows of a tile, what these two take
             first, and, if rows may go straight to a result of three dimensions, the result, its
             trajectories and `line`; else None.
    missing  (2,)
    """
    room, run = on_stack(ROOM), common[5]
    spread, work = room[SPREAD_AT:WORK_AT], room[WORK_AT:TILE_AT]
    tile, along = room[TILE_AT:ALONG_AT], room[ALONG_AT:]
    (begin, end, chunk, chunks), (first_block, lanes, shift, lanes_end) = parts, blocks
    # Few trajectories leave lanes to seeds, but not to more than there are groups of rows.
    groups = in_whole((rows[1] + GROUP - 1) // GROUP - rows[0] // GROUP)
    first, last, piece = begin // chunks, (end - 1) // chunks, 0
    for k in range(first, last + 1 if begin < end else first):
        lane, width = first_and_width(first_block + k, lanes, shift, lanes_end)
        abreast = min(WIDTH // width // VECTOR * VECTOR, groups) if width < VECTOR else 1
        top = rows[0] // chunk + max(begin - k * chunks, 0)
        bottom = rows[0] // chunk + min(end - k * chunks, chunks)
        top, bottom = max(rows[0], top * chunk), min(rows[1], bottom * chunk)
        block = room[k % 2 * BLOCK :]
        for left in range(piece, pieces_of(width)):
            enter_piece(left, k - first, common, lane, width, top, block, work)
        given, _, orbit, tables = known_of(block)
        if status.size > 0:
            write_codes(orbit, lane, width, status)
        if width < VECTOR:
            make_lanes_of_seeds(orbit, tables, along, width, abreast)
        sink[0](sink[2], lane, width)
        next_lane, next_width = first_and_width(first_block + k + 1, lanes, shift, lanes_end)
        next_block = room[(k + 1) % 2 * BLOCK :]
        piece = fill_block(
            (given, orbit, spread, work, tables, tile, along),
            (lane, width, abreast),
            run,
            (top, bottom),
            rows,
            sink,
            pieces_of(next_width) if k < last else 0,
            (k - first + 1, common, next_lane, next_width, rows[0], next_block, work),
            missing,
        )
    fence()


@staged
def enter_nothing(result, lane, width):
    """Rows of three dimensions need nothing else of a block."""


@staged
def put_rows(result, tile, row, rows, lane, width, place):
    """Rows of a tile from `row` on to those of a result from `place` on."""
    flat, batch, line = result
    write_rows(tile, row, rows, width, flat, place, batch, lane, line)


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
    states, batch, line = omega.reshape(omega.size), omega.shape[0], to_cache_line(out, 0)
    first_block, chunk, chunks, n_parts = parts_of_run(omega, lanes_asked, rows, out)
    n_tasks = missing.shape[0]
    begin, end = task * n_parts // n_tasks, (task + 1) * n_parts // n_tasks
    parts, blocks = (begin, end, chunk, chunks), (first_block, WIDTH, shift_of_blocks(line), batch)
    common = flow, back, (I1, I2, I13, I23, eps), states, start, run
    result = out.reshape(out.size), batch, line
    sink = enter_nothing, put_rows, result, result
    fill_blocks(parts, blocks, common, rows, status, sink, missing[task])


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
