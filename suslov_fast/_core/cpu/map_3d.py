"""Loops over trajectories and steps of the 3D map.

A block of up to LANES trajectories advances together, step by step, so that the compiler puts the
lanes side by side in vector registers; blocks are independent. A trajectory's arithmetic never
depends on its block, nor on how its steps are cut into calls.

Common arguments, flat over the batch of B trajectories:

method       PRINTED or CANONICAL.
I1 ... eps   five arrays of B numbers, or of one that serves all.
omega        (B, 2), the initial states.

Arrays of a block, lanes last, beside `given` of `loops_blocks`:

state          (2, LANES): (omega1, omega2) where the method is PRINTED, else (X, Z).
shift          (LANES,): c, where Z = c - Y.
bound          (LANES,): for |X| + |Z|, beyond which omega would overflow.
wild           (LANES,): whether the trajectory is not tame; `beyond`: whether t >= 1.
frame          (6, LANES): m11, m12, m21, m22, rest1, rest2, where omega = m state + rest.
coefficients   (4, LANES): those of (ds2).
tile           (TILE, 2, LANES): angular velocities to be written.
"""

import numpy as np
from numba import prange

from ..codes import NONFINITE, OK, SINGULAR, SUPERCRITICAL
from ..formulas.canonical_map import canonical_step, denominator, guarded_step, shifted, tame
from ..formulas.coordinates import angular_velocity, at_rest, from_canonical, to_canonical
from ..formulas.printed_map import printed_coefficients, printed_denominator, printed_step
from ..jit import Loop, formula, part
from . import intrinsics  # noqa: F401  (compiles what is imported from vector)
from .blocks import (
    LANES,
    TASKS,
    gather_bodies,
    gather_states,
    in_whole_vectors,
    rows_of_lanes,
    scatter_pairs,
)
from .vector import (
    VECTOR,
    aligned,
    copy_transposed,
    expect_store,
    load,
    publish,
    store,
    store_at,
    store_past_caches,
    to_cache_line,
    vector_at,
)

PRINTED, CANONICAL = range(2)

# States of each trajectory that are written at a time: 256 bytes where they lie side by side, and
# fewer where rows of lanes do, so that the memory and the arithmetic work at once.
TILE, TILE_ACROSS = 16, 4
# Saved states of so many numbers are written past the caches.
BEYOND_CACHES = 2**21

# A state X this small on its way to a fixed point becomes 0: subnormals are four times slower.
NEGLIGIBLE = 2.0**-960
FLUSH_EVERY = 256


# Short passes with few results each: one loop over all of this would not be vectorised.


@part
def enter_canonical(given, state, frame, shift, bound, wild, beyond, lanes):
    for l in range(lanes):
        state[0, l], state[1, l], shift[l] = to_canonical(
            given[0, l],
            given[1, l],
            given[2, l],
            given[3, l],
            given[4, l],
            given[5, l],
            given[6, l],
        )
    for l in range(lanes):
        frame[0, l], frame[1, l], frame[2, l], frame[3, l] = from_canonical(
            given[0, l], given[1, l], given[2, l], given[3, l], given[4, l]
        )
    # The identity map (I13 = I23 = 0, or eps = 0) has no frame: the state rests where it is.
    for l in range(lanes):
        rests = at_rest(given[2, l], given[3, l], given[4, l], state[0, l], state[1, l])
        for k in range(2):
            state[k, l] = 0.0 if rests else state[k, l]
        shift[l] = 0.0 if rests else shift[l]
        for k in range(4):
            frame[k, l] = 0.0 if rests else frame[k, l]
        for k in range(2):
            frame[4 + k, l] = given[5 + k, l] if rests else 0.0
    for l in range(lanes):
        beyond[l] = abs(state[1, l]) >= 1.0
        shift[l], state[1, l] = shifted(state[1, l], shift[l])
        wild[l] = not tame(state[0, l], state[1, l], shift[l])
    for l in range(lanes):
        bound[l] = 1e307 / max(
            max(abs(frame[0, l]), abs(frame[1, l])), max(abs(frame[2, l]), abs(frame[3, l]))
        )
        frame[4, l] += frame[1, l] * shift[l]
        frame[5, l] += frame[3, l] * shift[l]
        frame[1, l], frame[3, l] = -frame[1, l], -frame[3, l]


@part
def enter_printed(given, state, frame, coefficients, lanes):
    for l in range(lanes):
        state[0, l], state[1, l] = given[5, l], given[6, l]
        frame[0, l], frame[1, l], frame[2, l], frame[3, l] = 1.0, 0.0, 0.0, 1.0
        frame[4, l], frame[5, l] = 0.0, 0.0
    for l in range(lanes):
        coefficients[0, l], coefficients[1, l], coefficients[2, l], coefficients[3, l] = (
            printed_coefficients(given[0, l], given[1, l], given[2, l], given[3, l], given[4, l])
        )


@part
def advance_printed(state, coefficients, steps, lanes):
    for _ in range(steps):
        for l in range(lanes):
            state[0, l], state[1, l] = printed_step(
                coefficients[0, l],
                coefficients[1, l],
                coefficients[2, l],
                coefficients[3, l],
                state[0, l],
                state[1, l],
            )


@part
def advance_guarded(state, shift, bound, steps, lanes):
    for _ in range(steps):
        for l in range(lanes):
            state[0, l], state[1, l] = guarded_step(state[0, l], state[1, l], shift[l], bound[l])


@part
def advance_tame(state, steps, lanes):
    for _ in range(steps):
        for l in range(lanes):
            state[0, l], state[1, l] = canonical_step(state[0, l], state[1, l], 0.0)


@part
def flush_negligible(state, shift, lanes):
    for l in range(lanes):
        X = state[0, l]
        state[0, l] = 0.0 if abs(X) < NEGLIGIBLE and state[1, l] > shift[l] else X


@part
def show(frame, state, tile, row, lanes):
    """Put the angular velocities of a block into a row of its tile."""
    for l in range(lanes):
        tile[row, 0, l], tile[row, 1, l] = angular_velocity(
            frame[0, l],
            frame[1, l],
            frame[2, l],
            frame[3, l],
            frame[4, l],
            frame[5, l],
            state[0, l],
            state[1, l],
        )


@part
def write_across(flat_tile, rows, flat, line, n_saved, batch, row, first, width):
    """Write the first rows of a tile to the saved states (2, n_saved, B) from `row` on.

    flat holds them in one row, and line is the first start of a cache line in it.
    """
    for k in range(2 * rows):
        source = k * LANES
        target = (k % 2 * n_saved + row + k // 2) * batch + first
        begin = end = width
        if flat.size >= BEYOND_CACHES:
            begin = min((line - target) % VECTOR, width)
            end = width - (width - begin) % VECTOR
        for l in range(begin):
            flat[target + l] = flat_tile[source + l]
        for l in range(begin, end, VECTOR):
            store_past_caches(flat, target + l, vector_at(flat_tile, source + l))
        for l in range(end, width):
            flat[target + l] = flat_tile[source + l]


@part
def write_along(flat_tile, rows, flat, n_saved, row, first, width):
    """The same where they are (B, n_saved, 2)."""
    whole_width, whole_rows = width - width % VECTOR, rows - rows % (VECTOR // 2)
    for l in range(0, whole_width, VECTOR):
        for r in range(0, whole_rows, VECTOR // 2):
            target = 2 * ((first + l) * n_saved + row + r)
            copy_transposed(flat, target, 2 * n_saved, flat_tile, 2 * r * LANES + l, LANES)
    for l in range(width):
        target = 2 * ((first + l) * n_saved + row)
        for k in range(2 * whole_rows if l < whole_width else 0, 2 * rows):
            flat[target + k] = flat_tile[k * LANES + l]


@part
def expect_write_along(flat, n_saved, row, first, share):
    """Fetch the memory that will be written from `row` on, for one of TILE shares of the lanes."""
    for l in range(share * LANES // TILE, (share + 1) * LANES // TILE):
        for k in range(0, 2 * TILE, VECTOR):
            expect_store(flat, 2 * ((first + l) * n_saved + row) + k)


@formula
def advance_vector(state, frame, g):
    """A step of a vector of tame trajectories; their angular velocities."""
    X, Z = canonical_step(load(state, 0, g), load(state, 1, g), 0.0)
    store(state, 0, g, X)
    store(state, 1, g, Z)
    return angular_velocity(
        load(frame, 0, g),
        load(frame, 1, g),
        load(frame, 2, g),
        load(frame, 3, g),
        load(frame, 4, g),
        load(frame, 5, g),
        X,
        Z,
    )


# Most often the trajectories of a whole block are tame, and each state is saved. Then the following
# do all steps in one place, so that the memory and the arithmetic work at once.


@part
def advance_across(state, frame, flat, index, rows, batch, steps):
    """Steps of a block, the first saved at `index`, where a cache line starts."""
    for n in range(steps):
        for g in range(LANES // VECTOR):
            omega1, omega2 = advance_vector(state, frame, g)
            store_past_caches(flat, index + n * batch + g * VECTOR, omega1)
            store_past_caches(flat, index + (rows + n) * batch + g * VECTOR, omega2)


@part
def stream_along(flat_tile, kept, flat, line, n_saved, row, first, begins):
    """Write a tile as `write_along` does, but past the caches.

    kept   flat (LANES, 2 TILE + VECTOR): the last vector that each lane wrote to it before, and
           its tile. Of this the whole lines of `flat` are written; `finish_stream` must follow.
    """
    width = 2 * TILE + VECTOR
    for l in range(0, LANES, VECTOR):
        for r in range(0, TILE, VECTOR // 2):
            target = l * width + VECTOR + 2 * r
            copy_transposed(kept, target, width, flat_tile, 2 * r * LANES + l, LANES)
        for lane in range(l, l + VECTOR):
            start, source = 2 * ((first + lane) * n_saved + row), lane * width
            to_line = (line - start) % VECTOR
            if begins:
                for k in range(to_line):
                    flat[start + k] = kept[source + VECTOR + k]
            for k in range(VECTOR if begins else 0, 2 * TILE, VECTOR):
                vector = vector_at(kept, source + to_line + k)
                store_past_caches(flat, start - VECTOR + to_line + k, vector)
            store_at(kept, source, vector_at(kept, source + 2 * TILE))


@part
def finish_stream(kept, flat, line, n_saved, row, first):
    """Write what `stream_along` has kept, up to `row`."""
    for lane in range(LANES):
        stop = 2 * ((first + lane) * n_saved + row)
        left = VECTOR - (line - stop) % VECTOR
        for k in range(left):
            flat[stop - left + k] = kept[lane * (2 * TILE + VECTOR) + VECTOR - left + k]


@part
def advance_along(state, frame, tile, flat_tile, kept, flat, line, n_saved, row, first, tiles):
    """Steps of a block, as many as fill some tiles, the first saved in `row`."""
    past_caches = flat.size >= BEYOND_CACHES
    for t in range(tiles):
        for r in range(TILE):
            for g in range(LANES // VECTOR):
                omega1, omega2 = advance_vector(state, frame, g)
                store(tile, 2 * r, g, omega1)
                store(tile, 2 * r + 1, g, omega2)
        if past_caches:
            stream_along(flat_tile, kept, flat, line, n_saved, row + t * TILE, first, t == 0)
        else:
            write_along(flat_tile, TILE, flat, n_saved, row + t * TILE, first, LANES)
    if past_caches:
        finish_stream(kept, flat, line, n_saved, row + tiles * TILE, first)


def _iterate(
    method, I1, I2, I13, I23, eps, omega, start, stop, every, out, batch_last, resume, final, status
):
    """Iterate from state `start` to state `stop`.

    out      the saved states: (B, n_saved, 2), or (2, n_saved, B) if batch_last; n_saved may be 0.
             States whose number is a multiple of `every` are saved.
    resume   (2, B), what the next call goes on from, or (2, 0) if this is the only one.
    final    (B, 2), state `stop`, NaN if it does not exist; or (0, 2) if it is not wanted.
    status   (B,): OK, SUPERCRITICAL, or NONFINITE if state `stop` does not exist for any reason.
    """
    batch, n_saved = omega.shape[0], out.shape[1]
    # Blocks begin where cache lines of the saved states do, if they do so in all rows alike.
    flat, flat_final = out.reshape(out.size), final.reshape(final.size)
    line = to_cache_line(flat, 0)
    pad = -line % VECTOR if batch_last else 0
    height = TILE_ACROSS if batch_last else TILE
    n_blocks = (batch + pad + LANES - 1) // LANES
    # Each task has its own arrays and goes through several blocks.
    n_tasks = min(n_blocks, TASKS)
    for task in prange(n_tasks):
        given = rows_of_lanes(7)
        state = rows_of_lanes(2)
        shift, bound = rows_of_lanes(1)[0], rows_of_lanes(1)[0]
        wild, beyond = np.empty(LANES, np.bool_), np.empty(LANES, np.bool_)
        frame = rows_of_lanes(6)
        coefficients = rows_of_lanes(4)
        flat_tile = aligned(TILE * 2 * LANES)
        tile = flat_tile.reshape((TILE, 2, LANES))
        kept = aligned(LANES * (2 * TILE + VECTOR))
        tile_vectors = tile.reshape((TILE * 2, LANES // VECTOR, VECTOR))
        state_vectors = state.reshape((2, LANES // VECTOR, VECTOR))
        frame_vectors = frame.reshape((6, LANES // VECTOR, VECTOR))
        for block in range(task * n_blocks // n_tasks, (task + 1) * n_blocks // n_tasks):
            first = max(block * LANES - pad, 0)
            width = min((block + 1) * LANES - pad, batch) - first
            lanes = in_whole_vectors(width)

            gather_bodies(I1, I2, I13, I23, eps, first, width, lanes, given)
            gather_states(omega, first, width, lanes, given)
            enter_canonical(given, state, frame, shift, bound, wild, beyond, lanes)
            any_wild = wild[:lanes].any()
            straight = method == CANONICAL and width == LANES and every == 1 and not any_wild
            past_caches = batch % VECTOR == 0 and flat.size >= BEYOND_CACHES
            if method == PRINTED:
                enter_printed(given, state, frame, coefficients, lanes)
            if start > 0:
                for l in range(width):
                    state[0, l], state[1, l] = resume[0, first + l], resume[1, first + l]

            row = start // every + 1 if start > 0 else 0
            filled = 0
            if start == 0:
                for l in range(lanes):
                    tile[0, 0, l], tile[0, 1, l] = given[5, l], given[6, l]
                filled = min(1, n_saved)
            last = 0
            # Steps to go; divisions in each turn would cost as much as a step.
            to_stop, to_save = stop - start, every - start % every
            to_flush = FLUSH_EVERY - start % FLUSH_EVERY
            while True:
                if filled == height or to_stop == 0:
                    if batch_last:
                        write_across(
                            flat_tile, filled, flat, line, n_saved, batch, row, first, width
                        )
                    else:
                        write_along(flat_tile, filled, flat, n_saved, row, first, width)
                    row += filled
                    filled = 0
                if to_stop == 0:
                    break
                # The last state goes by itself, for `final`.
                ahead = min(to_stop - 1, to_flush) if straight and filled == 0 else 0
                if not batch_last:
                    ahead -= ahead % TILE
                elif not past_caches:
                    ahead = 0
                steps = max(ahead, min(to_stop, to_save, to_flush))
                # No function around these calls: it would count references at each step.
                if ahead > 0:
                    if batch_last:
                        index = row * batch + first
                        advance_across(
                            state_vectors, frame_vectors, flat, index, n_saved, batch, ahead
                        )
                    else:
                        advance_along(
                            state_vectors,
                            frame_vectors,
                            tile_vectors,
                            flat_tile,
                            kept,
                            flat,
                            line,
                            n_saved,
                            row,
                            first,
                            ahead // TILE,
                        )
                    row, to_save = row + ahead, to_save + ahead
                elif method == PRINTED:
                    advance_printed(state, coefficients, steps, lanes)
                elif any_wild:
                    # A guard changes nothing in a tame lane: who shares a block does not matter.
                    advance_guarded(state, shift, bound, steps, lanes)
                else:
                    advance_tame(state, steps, lanes)
                to_stop, to_save, to_flush = to_stop - steps, to_save - steps, to_flush - steps
                if to_flush == 0:
                    to_flush = FLUSH_EVERY
                    if method != PRINTED:
                        flush_negligible(state, shift, lanes)
                if to_save == 0 or to_stop == 0:
                    show(frame, state, tile, filled, lanes)
                    last = filled
                if to_save == 0:
                    to_save = every
                    if width == LANES and not batch_last:
                        expect_write_along(flat, n_saved, row, first, filled)
                    filled += 1

            if final.size > 0:
                scatter_pairs(tile[last, 0], tile[last, 1], first, width, flat_final)
            for l in range(width):
                code = SUPERCRITICAL if beyond[l] else OK
                status[first + l] = NONFINITE if np.isnan(tile[last, 0, l]) else code
            if resume.shape[1] > 0:
                for l in range(width):
                    resume[0, first + l], resume[1, first + l] = state[0, l], state[1, l]
        publish()


def _locate_failure(method, I1, I2, I13, I23, eps, omega, stop, failed, status, failed_at):
    """Find what went wrong in each `failed` trajectory, and its first missing state."""
    for k in prange(failed.size):
        i = failed[k]
        given = rows_of_lanes(7)
        state = rows_of_lanes(2)
        shift, bound = rows_of_lanes(1)[0], rows_of_lanes(1)[0]
        wild, beyond = np.empty(LANES, np.bool_), np.empty(LANES, np.bool_)
        frame = rows_of_lanes(6)
        coefficients = rows_of_lanes(4)
        tile = np.empty((1, 2, LANES))
        d, regular = 1.0, True
        gather_bodies(I1, I2, I13, I23, eps, i, 1, 1, given)
        gather_states(omega, i, 1, 1, given)
        enter_canonical(given, state, frame, shift, bound, wild, beyond, 1)
        if method == PRINTED:
            enter_printed(given, state, frame, coefficients, 1)
        c = coefficients[:, 0]
        n = 0
        tile[0, 0, 0] = omega[i, 0]
        while n < stop and np.isfinite(tile[0, 0, 0]):
            if method == PRINTED:
                d, regular = printed_denominator(c[0], c[1], c[2], c[3], state[0, 0], state[1, 0])
                advance_printed(state, coefficients, 1, 1)
            else:
                d, regular = denominator(state[0, 0], state[1, 0], shift[0])
                advance_guarded(state, shift, bound, 1, 1)
            n += 1
            show(frame, state, tile, 0, 1)
        status[i] = SINGULAR if np.isfinite(d) and not regular else NONFINITE
        failed_at[i] = n


iterate = Loop(_iterate)
locate_failure = Loop(_locate_failure)
