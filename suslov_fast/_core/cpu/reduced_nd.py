"""Loops over n-dimensional bodies whose problem is solved, which move as bodies in three do.

three    (5, B): I1, I2, I13, I23 of the 3D bodies, and the step sizes, in the units of time in
         which states are of the order of 1.
state    (B, 2), the states of these bodies.
along,   (B, m): omega is along times the first component of such a state, plus across times the
across   second.
"""

import numpy as np
from numba import prange

from ..formulas.coordinates import sum_of_products
from ..formulas.elementary import exponent, scaled, within
from ..formulas.reduction import as_product, orthogonal, state_nd, sum_in_two
from ..jit import Loop
from ..lanewise import larger, select
from ..staged import apart, staged
from . import intrinsics  # noqa: F401  (compiles what is imported from vector)
from .equal_steps import fill_blocks
from .orbits import WIDTH
from .seeds import GROUP
from .tiles import BEYOND_CACHES, write_numbers
from .vector import (
    VECTOR,
    copy_transposed,
    shuffled,
    splat,
    store_at,
    stream,
    to_cache_line,
    vector_at,
)

# States that one part of a task takes, and numbers of a row of a block in n dimensions, if it has
# more lanes than a vector.
STATES, ROW = 2**15, 2**10
# Where vectors of a group of few components begin.
MULTIPLES = tuple(range(0, VECTOR * VECTOR, VECTOR))

# The largest exponents of states, of step sizes and of J over J that are taken here: nothing comes
# near the ends of float64 then, at poles neither.
LARGEST, LONGEST, FARTHEST = 900.0, 200.0, 300.0


# Rows of a group of VECTOR trajectories, one for each component: omega; I, then along; across.


@staged
def rows_of(m):
    """The numbers of such rows, and of what squares have beyond the last component."""
    return (m + VECTOR) * VECTOR


@staged
def room_to_reduce(m):
    """The numbers that a task works in: these rows, room to turn them, and three vectors."""
    return 4 * rows_of(m) + 3 * VECTOR


@apart
def take_rows(values, first, width, room, place):
    """Rows of values, or one row for all; lanes beyond the width repeat the last."""
    m = values.shape[1]
    tile = room[3 * rows_of(m) :]
    for l in range(VECTOR):
        b = first + min(l, width - 1) if values.shape[0] > 1 else 0
        for i in range(m):
            tile[l * m + i] = values[b, i]
    for i in range(0, m, VECTOR):
        copy_transposed(room, place + i * VECTOR, VECTOR, tile, i, m, splat(1.0))


@apart
def give_rows(values, first, width, room, place):
    """The reverse."""
    m = values.shape[1]
    tile = room[3 * rows_of(m) :]
    for i in range((m - 1) // VECTOR * VECTOR, -1, -VECTOR):
        copy_transposed(tile, i, m, room, place + i * VECTOR, VECTOR, splat(1.0))
    for l in range(width):
        for i in range(m):
            values[first + l, i] = tile[l * m + i]


def rows_at(room, r, size):
    return (vector_at(room, r + k * size) for k in range(3))


def look_through(room, r, size, number, k, I_k, omega_k, largest, undefined):
    """The largest component of I so far, with that of omega; and of omega, NaN if one is."""
    omega, I, _ = rows_at(room, r, size)
    found = abs(I) > abs(I_k)
    undefined = undefined + select(omega == omega, 0.0, omega)
    largest = larger(abs(omega), largest)
    k, I_k, omega_k = (select(found, *pair) for pair in ((number, k), (I, I_k), (omega, omega_k)))
    return k, I_k, omega_k, largest, undefined


def find_units(eps, largest):
    """The exponent of the unit of omega, and the step size in that of time."""
    own = select(largest > 0.0, exponent(largest), 0.0)
    return own, scaled(eps, within(own, 1000.0))


def is_in_range(own, step, largest, of_k, of_others):
    """Whether numbers are in a range that is taken here: 1, or 0."""
    apart = abs(exponent(of_k) - exponent(of_others))
    in_range = (apart <= FARTHEST) & (abs(own) + apart <= LARGEST) & (largest == largest)
    return select(in_range & (exponent(step) <= LONGEST), 1.0, 0.0)


def take_differences(room, r, size, own, I_k, omega_k, p, p_lost, square, of_differences, coupled):
    """I_k omega_i - I_i omega_k, accurate next to the steady states, where all of them vanish."""
    omega, I, _ = rows_at(room, r, size)
    w, w_k = scaled(omega, -own), scaled(omega_k, -own)
    p, p_lost = sum_in_two(p, p_lost, I, w)
    difference = sum_of_products(I_k, w, -I, w_k)
    store_at(room, r + 2 * size, difference)
    coupled = coupled + select(I == 0.0, 0.0, 1.0)
    return p, p_lost, square + I * I, of_differences + I * difference, coupled


def take_orthogonal(room, r, size, I_k, square, of_differences, largest, undefined):
    """The part of omega orthogonal to I, and its largest component, NaN if one is."""
    _, I, across = rows_at(room, r, size)
    across = orthogonal(across, I, of_differences / square, I_k)
    store_at(room, r + 2 * size, across)
    undefined = undefined + select(across == across, 0.0, across)
    return larger(abs(across), largest), undefined


def take_unit(room, place, largest, length):
    across = scaled(vector_at(room, place), -exponent(largest))
    store_at(room, place, across)
    return length + across * across


def split(p, p_lost, coupled, own, step, omega_k, I_k, largest, length, square):
    """I23 and the state of the 3D body; the factors of I and of across; where nothing moves: 1."""
    alone = coupled == 0.0
    rests = alone | (length == 0.0) | (step == 0.0)
    length, norm, total = np.sqrt(length), np.sqrt(square), p + p_lost
    omega1, I23 = as_product(total, p_lost - (total - p))
    omega1 = select(coupled == 1.0, scaled(omega_k, -own), omega1)
    I23 = select(coupled == 1.0, I_k, I23)
    omega2 = scaled(norm * length / I23, exponent(largest))
    return (
        select(rests, select(alone, 0.0, p), I23),
        select(rests, 1.0, omega1),
        select(rests, 0.0, omega2),
        I23,
        length,
        norm,
        select(rests, 1.0, 0.0),
    )


def take_parts(room, r, size, own, square, I23, length, norm, rests):
    """Along and across; a state that does not move is along as itself."""
    omega, I, across = rows_at(room, r, size)
    along = scaled(I23 * I / square, own)
    across = scaled(across / length * (I23 / norm), own)
    store_at(room, r + size, select(rests == 1.0, omega, along))
    store_at(room, r + 2 * size, select(rests == 1.0, 0.0, across))


@staged
def give_numbers(numbers, first, width, row, room):
    """Write a vector, but for lanes beyond the width."""
    place = room.size - VECTOR
    store_at(room, place, numbers)
    for l in range(width):
        row[first + l] = room[place + l]


@staged
def reduce_group(J, I, eps, omega, first, width, three, state, along, across, fits, room):
    """VECTOR trajectories, or fewer at the end."""
    m, zero = omega.shape[1], splat(0.0)
    size, end = rows_of(m), m * VECTOR
    take_rows(omega, first, width, room, 0)
    take_rows(I, first, width, room, size)
    place = 4 * size
    for l in range(VECTOR):
        b = first + min(l, width - 1)
        room[place + l] = eps[b if eps.size > 1 else 0]
    k, I_k, omega_k, largest, undefined, number = zero, zero, vector_at(room, 0), zero, zero, 0.0
    for r in range(0, end, VECTOR):
        k, I_k, omega_k, largest, undefined = look_through(
            room, r, size, number, k, I_k, omega_k, largest, undefined
        )
        number += 1.0
    largest = largest + undefined
    own, step = find_units(vector_at(room, place), largest)
    store_at(room, place, k)
    for l in range(VECTOR):
        b = first + min(l, width - 1)
        of_body = J[b if J.shape[0] > 1 else 0]
        coupled = int(room[place + l])
        room[place + l] = of_body[coupled]
        room[place + VECTOR + l] = of_body[0 if coupled > 0 else m - 1]
    of_k, of_others = vector_at(room, place), vector_at(room, place + VECTOR)
    in_range = is_in_range(own, step, largest, of_k, of_others)
    give_numbers(of_k, first, width, three[0], room)
    give_numbers(of_others, first, width, three[1], room)
    give_numbers(zero, first, width, three[2], room)
    give_numbers(step, first, width, three[4], room)
    store_at(room, place, in_range)
    for l in range(width):
        fits[first + l] = 1 if room[place + l] != 0.0 else 0
    if m != 2:
        reduce_states(own, step, I_k, omega_k, first, width, three, state, along, across, room)


@staged
def reduce_states(own, step, I_k, omega_k, first, width, three, state, along, across, room):
    """The rest of it, unless the body is one of three dimensions."""
    m, zero = along.shape[1], splat(0.0)
    size, end = rows_of(m), m * VECTOR
    place = 4 * size
    p, p_lost, square, of_differences, coupled = zero, zero, zero, zero, zero
    for r in range(0, end, VECTOR):
        p, p_lost, square, of_differences, coupled = take_differences(
            room, r, size, own, I_k, omega_k, p, p_lost, square, of_differences, coupled
        )
    largest, undefined, length = zero, zero, zero
    for r in range(0, end, VECTOR):
        largest, undefined = take_orthogonal(
            room, r, size, I_k, square, of_differences, largest, undefined
        )
    largest = largest + undefined
    for r in range(2 * size, 2 * size + end, VECTOR):
        length = take_unit(room, r, largest, length)
    given, omega1, omega2, I23, length, norm, rests = split(
        p, p_lost, coupled, own, step, omega_k, I_k, largest, length, square
    )
    for r in range(0, end, VECTOR):
        take_parts(room, r, size, own, square, I23, length, norm, rests)
    give_numbers(given, first, width, three[3], room)
    store_at(room, place, omega1)
    store_at(room, place + VECTOR, omega2)
    for l in range(width):
        state[first + l, 0], state[first + l, 1] = room[place + l], room[place + VECTOR + l]
    give_rows(along, first, width, room, size)
    give_rows(across, first, width, room, 2 * size)


@staged
def reduce_groups(task, n_tasks, J, I, eps, omega, three, state, along, across, fits, room):
    """What one task of `reduce` does."""
    batch = omega.shape[0]
    groups = (batch + VECTOR - 1) // VECTOR
    for g in range(task * groups // n_tasks, (task + 1) * groups // n_tasks):
        first = g * VECTOR
        width = min(VECTOR, batch - first)
        reduce_group(J, I, eps, omega, first, width, three, state, along, across, fits, room[task])


def _reduce(J, I, eps, omega, three, state, along, across, fits, room):
    """The 3D problem of trajectories of bodies whose problem is solved; of n = 3, only `fits`.

    J, I    (B, m), or (1, m) where one body serves all.
    eps     (B,) or (1,)
    omega   (B, m), the states at step 0.
    fits    (B,), receives 1 where the trajectory is in a range that is taken here, else 0.
    room    (tasks, `room_to_reduce(m)`)
    """
    n_tasks = min((omega.shape[0] + VECTOR - 1) // VECTOR, room.shape[0])
    for task in prange(n_tasks):
        reduce_groups(task, n_tasks, J, I, eps, omega, three, state, along, across, fits, room)


@staged
def lanes_of(m):
    """The trajectories of a block, in whole vectors."""
    return max(min(WIDTH, ROW // m // VECTOR * VECTOR), VECTOR)


@staged
def padded(m):
    """The components of a trajectory and what fills their last vector, if they fill one."""
    return (m + VECTOR - 1) // VECTOR * VECTOR if m >= VECTOR else m


@staged
def beginning_of_row(m):
    """The numbers that a task works in before a row: coefficients."""
    return 2 * lanes_of(m) * padded(m)


@staged
def room_to_fill(m):
    """With a row at most, and what its last vectors may reach beyond it."""
    return beginning_of_row(m) + max(lanes_of(m) * m, ROW) + VECTOR * VECTOR


@staged
def take_coefficients(along, across, first, width, coefficients):
    """Those of each trajectory, a vector of along before one of across; of few components, those of
    all trajectories.

    A single trajectory is there as often as a vector has lanes.
    """
    m, step = along.shape[1], padded(along.shape[1])
    lanes = (width + VECTOR - 1) // VECTOR * VECTOR
    for l in range(lanes):
        b = first + min(l, width - 1)
        for i in range(step):
            if m < VECTOR:
                place, other = l * m + i, lanes * m
            else:
                place, other = 2 * step * l + i + i // VECTOR * VECTOR, VECTOR
            coefficients[place] = along[b, i] if i < m else 0.0
            coefficients[place + other] = across[b, i] if i < m else 0.0


def places_of_pairs(k, m):
    """Of components k, k + 1, ... of VECTOR states: where the pairs are that they are made of."""
    firsts = [2 * ((k + j) // m) for j in range(VECTOR)]
    return firsts, [each + 1 for each in firsts]


@staged
def put(into, place, vector):
    """Write a vector to a row, or where it begins a cache line straight to the result."""
    row, flat, target, straight = into
    if straight:
        stream(flat, target + place, vector)
    else:
        store_at(row, place, vector)


@staged
def expand(states, begin, rows, width, m, coefficients, into):
    """States of some rows, from those of 3D; what vectors of the last components have beyond them
    is written over.
    """
    place, whole = 0, 2 * padded(m)
    apart = whole if width > 1 else 0  # rows of a single one are as trajectories all alike
    for r in range(rows):
        omega = states[begin + 2 * r * width : begin + 2 * (r + 1) * width]
        for l in range(width):
            for k in range(0, whole, 2 * VECTOR):
                along = vector_at(coefficients, apart * l + k)
                across = vector_at(coefficients, apart * l + k + VECTOR)
                state = state_nd(along, across, omega[2 * l], omega[2 * l + 1])
                put(into, place + k // 2, state)
            place += m


@staged
def expand_few(states, begin, rows, width, m, coefficients, into):
    """`expand` of fewer components than a vector has lanes, m being known beforehand; what a group
    of VECTOR trajectories has beyond the last one is written over.
    """
    other = (width + VECTOR - 1) // VECTOR * VECTOR * m
    apart = VECTOR * m if width > 1 else 0
    if width == 1:
        rows, width = 1, rows
    for r in range(rows):
        for l in range(0, width, VECTOR):
            source, c = begin + 2 * (r * width + l), l // VECTOR * apart
            pairs = vector_at(states, source), vector_at(states, source + VECTOR)
            for k in MULTIPLES[:m]:
                firsts, seconds = places_of_pairs(k, m)
                along, across = (
                    vector_at(coefficients, c + k),
                    vector_at(coefficients, c + other + k),
                )
                omega1, omega2 = shuffled(*pairs, firsts), shuffled(*pairs, seconds)
                place = (r * width + l) * m + k
                put(into, place, state_nd(along, across, omega1, omega2))


@staged
def parts_of_fill(m, batch, lanes_asked, rows):
    """The parts that tasks share: some rows of a block each.

    Returns how many trajectories a block has, how many rows a part has at most, how many parts a
    block has, and all of them.
    """
    (first, last), (begin, end, _) = lanes_asked, rows
    lanes = lanes_of(m)
    height = max(STATES // min(lanes, batch) // GROUP, 1) * GROUP
    chunks = (end + height - 1) // height - begin // height
    return lanes, height, chunks, (last - first + lanes - 1) // lanes * chunks


@staged
def enter_coefficients(result, first, width):
    """What the block that follows has."""
    along, across, coefficients, _, _, _ = result
    take_coefficients(along, across, first, width, coefficients)


@staged
def put_expanded(result, tile, begin, rows, first, width, place):
    """Rows of a tile of three dimensions from `begin` on to those of `out` from `place` on."""
    along, _, coefficients, row, flat, line = result
    (batch, m), past_caches = along.shape, flat.size >= BEYOND_CACHES
    # Rows of all trajectories follow each other.
    abreast = max(ROW // (width * m), 1) if width == batch else 1
    for r in range(0, rows, abreast):
        count, source = min(abreast, rows - r), 2 * width * (begin + r)
        target, size = ((place + r) * batch + first) * m, count * width * m
        whole = (width if m < VECTOR else m) % VECTOR == 0
        straight = past_caches and whole and (line - target) % VECTOR == 0
        into = row, flat, target, straight
        for few in (1, 3, 4, 5, 6, 7):
            if m == few:
                expand_few(tile, source, count, width, few, coefficients, into)
        if m >= VECTOR:
            expand(tile, source, count, width, m, coefficients, into)
        if not straight:
            write_numbers(row, 0, flat, target, size, line, past_caches)


@staged
def fill_rows(
    task,
    n_tasks,
    three,
    state,
    along,
    across,
    start,
    run,
    lanes_asked,
    rows,
    out,
    status,
    missing,
    room,
):
    """What one task of `fill` does."""
    (batch, m), (begin, end, origin), own = along.shape, rows, room[task]
    coefficients, row = own[: beginning_of_row(m)], own[beginning_of_row(m) :]
    lanes, height, chunks, n_parts = parts_of_fill(m, batch, lanes_asked, rows)
    parts = task * n_parts // n_tasks, (task + 1) * n_parts // n_tasks, height, chunks
    bodies = three[0], three[1], three[2], three[3], three[4]
    common = False, 1.0, bodies, state.reshape(state.size), start, run
    result = along, across, coefficients, row, out.reshape(out.size), to_cache_line(out, 0)
    fill_blocks(
        parts,
        (0, lanes, -lanes_asked[0], lanes_asked[1]),
        common,
        (begin, end, -origin, 1),
        status,
        (enter_coefficients, put_expanded, result, None),
        missing[task],
    )


def _fill(three, state, along, across, start, run, lanes_asked, rows, out, status, missing, room):
    """States of n dimensions at the steps of rows begin to end.

    start         (1,): 0, the number of the given states.
    run           as in `equal_steps`: 0, and how many steps there are from row to row.
    lanes_asked   the first trajectory wanted, and the one after the last.
    rows          begin, end, origin: row i goes to row i - origin of `out`, (rows, B, m).
    status        (B,), as in `equal_steps`.
    missing       (tasks, 2), counts what nobody reads.
    room          (tasks, `room_to_fill(m)`), on cache lines.
    """
    batch, m = along.shape
    _, _, _, n_parts = parts_of_fill(m, batch, lanes_asked, rows)
    n_tasks = min(n_parts, room.shape[0])
    for task in prange(n_tasks):
        fill_rows(
            task,
            n_tasks,
            three,
            state,
            along,
            across,
            start,
            run,
            lanes_asked,
            rows,
            out,
            status,
            missing,
            room,
        )


reduce = Loop(_reduce)
fill = Loop(_fill)
