"""Loops over trajectories and steps of the 3D map.

A block of up to LANES trajectories advances together, step by step, so that the compiler puts the
lanes side by side in vector registers; blocks are independent. A trajectory's arithmetic never
depends on its block, nor on how its steps are cut into calls.

Common arguments, flat over the batch of B trajectories:

method       PRINTED or CANONICAL.
I1 ... eps   five arrays of B numbers, or of one that serves all.
omega        (B, 2), the states at step 0.

Arrays of a block, lanes last, beside `given` of `blocks`:

state          (2, LANES), the rows FIRST and SECOND: (omega1, omega2) where the method is PRINTED,
               else (X, Z).
limits         (4, LANES), the rows SHIFT: c, where Z = c - Y; BOUND: for |X| + |Z|, beyond which
               omega would overflow; WILD: whether the trajectory is not tame; BEYOND: whether
               t >= 1.
frame          (7, LANES), the rows M11 to SCALE, where omega = (m state + rest) scale.
coefficients   (4, LANES): those of (ds2).
shown          (2, LANES): angular velocities, those of the last step.
turn           (4, LANES): the orientation, a unit quaternion.
"""

import numpy as np
from numba import prange

from ..codes import NONFINITE, OK, SINGULAR, SUPERCRITICAL
from ..formulas.canonical_map import canonical_step, denominator, guarded_step, shifted, tame
from ..formulas.coordinates import angular_velocity, at_rest, from_canonical, to_canonical
from ..formulas.printed_map import printed_coefficients, printed_denominator, printed_step
from ..formulas.rotation import row_times_matrix, turn_between, turned
from ..jit import Loop
from ..staged import staged
from . import intrinsics  # noqa: F401  (compiles what is imported from vector)
from .blocks import (
    EPS,
    GIVEN,
    I1_,
    I2_,
    I13_,
    I23_,
    LANES,
    OMEGA1,
    OMEGA2,
    STATE1,
    STATE2,
    UNIT,
    gather_bodies,
    gather_states,
    in_whole_vectors,
    scatter_pairs,
    spread,
    take_units_out,
    tasks_for,
)
from .tiles import BEYOND_CACHES, write_numbers
from .vector import (
    VECTOR,
    expect_store,
    fence,
    load,
    on_stack,
    store,
    store_pairs,
    stream_pairs,
    to_cache_line,
)

PRINTED, CANONICAL = range(2)

FIRST, SECOND = range(2)
SHIFT, BOUND, WILD, BEYOND = range(4)
M11, M12, M21, M22, REST1, REST2, SCALE = range(7)

# How rows are written: past the caches, where all of them begin with cache lines; from a tile; or,
# if they stay in the caches, straight to their place.
PAST_CACHES, TILED, IN_CACHES = range(3)

# omega is finite where |X| + |Z| is below this over the largest number of the frame: float64 ends
# at 1.8e308, and omega is a sum of three products.
LARGEST = 1e307

# A state X this small on its way to a fixed point becomes 0: subnormals are four times slower.
NEGLIGIBLE = 2.0**-960
FLUSH_EVERY = 256


# Short passes with few results each: one loop over all of this would not be vectorised.


@staged
def enter_canonical(given, state, frame, limits, lanes):
    for l in range(lanes):
        state[FIRST, l], state[SECOND, l], limits[SHIFT, l] = to_canonical(
            given[I1_, l],
            given[I2_, l],
            given[I13_, l],
            given[I23_, l],
            given[EPS, l],
            given[STATE1, l],
            given[STATE2, l],
        )
    for l in range(lanes):
        frame[M11, l], frame[M12, l], frame[M21, l], frame[M22, l] = from_canonical(
            given[I1_, l], given[I2_, l], given[I13_, l], given[I23_, l], given[EPS, l]
        )
    # The identity map (I13 = I23 = 0, or eps = 0) has no frame: the state rests where it is.
    for l in range(lanes):
        rests = at_rest(
            given[I13_, l], given[I23_, l], given[EPS, l], state[FIRST, l], state[SECOND, l]
        )
        for k in range(2):
            state[k, l] = 0.0 if rests else state[k, l]
        limits[SHIFT, l] = 0.0 if rests else limits[SHIFT, l]
        for k in range(4):
            frame[k, l] = 0.0 if rests else frame[k, l]
        for k in range(2):
            frame[REST1 + k, l] = given[OMEGA1 + k, l] if rests else 0.0
        frame[SCALE, l] = 1.0 if rests else given[UNIT, l]
    for l in range(lanes):
        limits[BEYOND, l] = abs(state[SECOND, l]) >= 1.0
        limits[SHIFT, l], state[SECOND, l] = shifted(state[SECOND, l], limits[SHIFT, l])
    for l in range(lanes):
        limits[BOUND, l] = (LARGEST / max(given[UNIT, l], 1.0)) / max(
            max(abs(frame[M11, l]), abs(frame[M12, l])), max(abs(frame[M21, l]), abs(frame[M22, l]))
        )
        limits[WILD, l] = not tame(
            state[FIRST, l], state[SECOND, l], limits[SHIFT, l], limits[BOUND, l]
        )
        frame[REST1, l] += frame[M12, l] * limits[SHIFT, l]
        frame[REST2, l] += frame[M22, l] * limits[SHIFT, l]
        frame[M12, l], frame[M22, l] = -frame[M12, l], -frame[M22, l]


@staged
def enter_printed(given, state, frame, limits, coefficients, lanes):
    for l in range(lanes):
        still = given[EPS, l] == 0.0 or (given[I13_, l] == 0.0 and given[I23_, l] == 0.0)
        state[FIRST, l] = given[OMEGA1, l] if still else given[STATE1, l]
        state[SECOND, l] = given[OMEGA2, l] if still else given[STATE2, l]
        frame[M11, l], frame[M12, l], frame[M21, l], frame[M22, l] = 1.0, 0.0, 0.0, 1.0
        frame[REST1, l], frame[REST2, l] = 0.0, 0.0
        frame[SCALE, l] = 1.0 if still else given[UNIT, l]
        limits[BOUND, l] = np.inf if still else LARGEST / max(given[UNIT, l], 1.0)
    for l in range(lanes):
        coefficients[0, l], coefficients[1, l], coefficients[2, l], coefficients[3, l] = (
            printed_coefficients(
                given[I1_, l], given[I2_, l], given[I13_, l], given[I23_, l], given[EPS, l]
            )
        )


@staged
def any_wild(limits, lanes):
    wild = False
    for l in range(lanes):
        wild |= limits[WILD, l] != 0.0
    return wild


@staged
def advance_printed(state, coefficients, bound, steps, lanes):
    for _ in range(steps):
        for l in range(lanes):
            state[FIRST, l], state[SECOND, l] = printed_step(
                coefficients[0, l],
                coefficients[1, l],
                coefficients[2, l],
                coefficients[3, l],
                state[FIRST, l],
                state[SECOND, l],
                bound[l],
            )


@staged
def advance_guarded(state, shift, bound, steps, lanes):
    for _ in range(steps):
        for l in range(lanes):
            state[FIRST, l], state[SECOND, l] = guarded_step(
                state[FIRST, l], state[SECOND, l], shift[l], bound[l]
            )


@staged
def advance_tame(state, steps, lanes):
    for _ in range(steps):
        for l in range(lanes):
            state[FIRST, l], state[SECOND, l] = canonical_step(
                state[FIRST, l], state[SECOND, l], 0.0
            )


@staged
def flush_negligible(state, shift, lanes):
    for l in range(lanes):
        X = state[FIRST, l]
        state[FIRST, l] = 0.0 if abs(X) < NEGLIGIBLE and state[SECOND, l] > shift[l] else X


@staged
def show(frame, state, shown, lanes):
    """The angular velocities of a block."""
    for l in range(lanes):
        shown[0, l], shown[1, l] = angular_velocity(
            frame[M11, l],
            frame[M12, l],
            frame[M21, l],
            frame[M22, l],
            frame[REST1, l],
            frame[REST2, l],
            frame[SCALE, l],
            state[FIRST, l],
            state[SECOND, l],
        )


@staged
def vector_of_velocities(frame, g, X, Z):
    """The angular velocities of a vector of states."""
    return angular_velocity(
        load(frame, M11, g),
        load(frame, M12, g),
        load(frame, M21, g),
        load(frame, M22, g),
        load(frame, REST1, g),
        load(frame, REST2, g),
        load(frame, SCALE, g),
        X,
        Z,
    )


@staged
def put(into, index, g, omega1, omega2):
    """Write a vector of a row that starts at `index`: straight to its place, or to a tile."""
    flat, tile, way, _ = into
    if way == PAST_CACHES:
        stream_pairs(flat, index + 2 * VECTOR * g, omega1, omega2)
    elif way == TILED:
        store_pairs(tile, 2 * VECTOR * g, omega1, omega2)
    else:
        store_pairs(flat, index + 2 * VECTOR * g, omega1, omega2)


@staged
def end_row(into, index, stride, width):
    """Write what lies in the tile to its row, whole cache lines past the caches.

    The lines at its ends have others' numbers too: a store waits for them, so those of the next
    row are fetched.
    """
    flat, tile, way, line = into
    if way == TILED:
        expect_store(flat, min(index + stride, flat.size - 1))
        expect_store(flat, min(index + stride + 2 * width, flat.size) - 1)
        write_numbers(tile, 0, flat, index, 2 * width, line, True)


@staged
def write(frame, state, shown, into, index, stride, width):
    """Write the angular velocities of a block side by side, pair by pair, from `index` on.

    frame, state, shown   with an axis of vectors of lanes.
    into                  the numbers of the result, a tile, how rows are written, and how many of
                          the numbers lie before the first cache line.
    """
    flat, _, way, _ = into
    whole = width // VECTOR
    for g in range((width + VECTOR - 1) // VECTOR if way == TILED else whole):
        omega1, omega2 = vector_of_velocities(
            frame, g, load(state, FIRST, g), load(state, SECOND, g)
        )
        put(into, index, g, omega1, omega2)
    if whole * VECTOR < width and way != TILED:
        omega1, omega2 = vector_of_velocities(
            frame, whole, load(state, FIRST, whole), load(state, SECOND, whole)
        )
        store(shown, 0, whole, omega1)
        store(shown, 1, whole, omega2)
        for l in range(width - whole * VECTOR):
            flat[index + 2 * (whole * VECTOR + l)] = shown[0, whole, l]
            flat[index + 2 * (whole * VECTOR + l) + 1] = shown[1, whole, l]
    end_row(into, index, stride, width)


@staged
def advance_and_write(frame, state, into, index, stride, steps):
    """Steps of a block of LANES tame trajectories, each state saved, a row `stride` after the last.

    All in one place, so that the memory and the arithmetic work at once.
    """
    for n in range(steps):
        place = index + n * stride
        for g in range(LANES // VECTOR):
            X, Z = canonical_step(load(state, FIRST, g), load(state, SECOND, g), 0.0)
            store(state, FIRST, g, X)
            store(state, SECOND, g, Z)
            omega1, omega2 = vector_of_velocities(frame, g, X, Z)
            put(into, place, g, omega1, omega2)
        end_row(into, place, stride, LANES)


@staged
def turn_on(time_step, frame, state, shown, turn, lanes):
    """Turn the body from the angular velocities `shown` to those of the state, which are shown."""
    for l in range(lanes):
        next1, next2 = angular_velocity(
            frame[M11, l],
            frame[M12, l],
            frame[M21, l],
            frame[M22, l],
            frame[REST1, l],
            frame[REST2, l],
            frame[SCALE, l],
            state[FIRST, l],
            state[SECOND, l],
        )
        unit, b1, b2 = turn_between(time_step[l], shown[0, l], shown[1, l], next1, next2)
        turn[0, l], turn[1, l], turn[2, l], turn[3, l] = turned(
            turn[0, l], turn[1, l], turn[2, l], turn[3, l], unit, b1, b2
        )
        shown[0, l], shown[1, l] = next1, next2


@staged
def write_turns(R0, turn, turns, row, first, width):
    for l in range(width):
        i, w, x, y, z = first + l, turn[0, l], turn[1, l], turn[2, l], turn[3, l]
        for r in range(3):
            turns[row, i, r, 0], turns[row, i, r, 1], turns[row, i, r, 2] = row_times_matrix(
                R0[r, 0, i], R0[r, 1, i], R0[r, 2, i], w, x, y, z
            )


@staged
def blocks_between(begin, end, out):
    """How many blocks some trajectories make, and whether they begin where cache lines do.

    They do, by what the first block lacks, if all rows of the saved states lie alike.
    """
    to_line, stride = to_cache_line(out, 2 * begin), 2 * out.shape[1]
    lined_up = out.size >= BEYOND_CACHES and stride % VECTOR == 0 and to_line % 2 == 0
    pad = -(to_line // 2) % (VECTOR // 2) if lined_up else 0
    return (end - begin + pad + LANES - 1) // LANES, lined_up, pad


@staged
def iterate_blocks(
    task,
    n_tasks,
    method,
    I1,
    I2,
    I13,
    I23,
    eps,
    omega,
    begin,
    end,
    start,
    stop,
    every,
    first_row,
    out,
    resume,
    turning,
    final,
    status,
):
    """What one task of `iterate` does."""
    saves, goes_on, turns_too = out.shape[0] > 0, resume.shape[1] > 0, turning is not None
    if turns_too:
        time_step, R0, quaternions, turns = turning
    flat, flat_final = out.reshape(out.size), final.reshape(final.size)
    states = omega.reshape(omega.size)
    stride = 2 * out.shape[1]
    n_blocks, lined_up, pad = blocks_between(begin, end, out)
    given, limits = on_stack(GIVEN, LANES), on_stack(4, LANES)
    state, shown, frame = on_stack(2, LANES), on_stack(2, LANES), on_stack(7, LANES)
    coefficients, turn = on_stack(4, LANES), on_stack(4, LANES)
    step_row, tile = on_stack(LANES), on_stack(2 * LANES)
    state_vectors = state.reshape((2, LANES // VECTOR, VECTOR))
    shown_vectors = shown.reshape((2, LANES // VECTOR, VECTOR))
    frame_vectors = frame.reshape((7, LANES // VECTOR, VECTOR))
    for block in range(task * n_blocks // n_tasks, (task + 1) * n_blocks // n_tasks):
        first = begin + max(block * LANES - pad, 0)
        width = min(begin + (block + 1) * LANES - pad, end) - first
        lanes = in_whole_vectors(width)
        way = TILED if out.size >= BEYOND_CACHES and width >= VECTOR else IN_CACHES
        way = PAST_CACHES if lined_up and (block > 0 or pad == 0) else way
        into = flat, tile, way, to_cache_line(out, 0)

        gather_bodies((I1, I2, I13, I23, eps), first, width, lanes, given)
        gather_states(states, first, width, lanes, given)
        if start == 0 and saves:
            scatter_pairs(given[OMEGA1], given[OMEGA2], first, width, flat)
        take_units_out(given, lanes)
        enter_canonical(given, state, frame, limits, lanes)
        wild = any_wild(limits, lanes)
        if method == PRINTED:
            enter_printed(given, state, frame, limits, coefficients, lanes)
        if start > 0:
            for l in range(width):
                state[FIRST, l], state[SECOND, l] = resume[0, first + l], resume[1, first + l]
        if turns_too:
            spread(time_step, first, width, lanes, step_row)
            for l in range(width):
                for k in range(4):
                    turn[k, l] = quaternions[k, first + l]
            if start > 0:
                show(frame, state, shown, lanes)
            else:
                for l in range(lanes):
                    shown[0, l], shown[1, l] = given[OMEGA1, l], given[OMEGA2, l]
                if saves:
                    write_turns(R0, turn, turns, 0, first, width)

        straight = method == CANONICAL and width == LANES and every == 1 and saves
        straight = straight and not (wild or turns_too)
        row = start // every + 1 - first_row
        # Steps to go; divisions in each turn would cost as much as a step.
        to_stop, to_save = stop - start, every - start % every
        to_flush = FLUSH_EVERY - start % FLUSH_EVERY
        while to_stop > 0:
            steps = min(to_stop, to_flush)
            # The state of a step after which X is flushed is shown as it is then.
            if straight and to_flush > 1:
                steps = min(to_stop, to_flush - 1)
                index = row * stride + 2 * first
                advance_and_write(frame_vectors, state_vectors, into, index, stride, steps)
                row, to_save = row + steps, to_save + steps
            else:
                steps = min(steps, 1 if turns_too else to_save)
                if method == PRINTED:
                    advance_printed(state, coefficients, limits[BOUND], steps, lanes)
                elif wild:
                    # A guard changes nothing in a tame lane: neighbours do not matter.
                    advance_guarded(state, limits[SHIFT], limits[BOUND], steps, lanes)
                else:
                    advance_tame(state, steps, lanes)
                if turns_too:
                    turn_on(step_row, frame, state, shown, turn, lanes)
            to_stop, to_save, to_flush = to_stop - steps, to_save - steps, to_flush - steps
            if to_flush == 0:
                to_flush = FLUSH_EVERY
                if method != PRINTED:
                    flush_negligible(state, limits[SHIFT], lanes)
            if to_save == 0:
                to_save = every
                if saves:
                    index = row * stride + 2 * first
                    write(frame_vectors, state_vectors, shown_vectors, into, index, stride, width)
                    if turns_too:
                        write_turns(R0, turn, turns, row, first, width)
                    row += 1

        if stop > 0:
            show(frame, state, shown, lanes)
        else:
            for l in range(lanes):
                shown[0, l], shown[1, l] = given[OMEGA1, l], given[OMEGA2, l]
        scatter_pairs(shown[0], shown[1], first, width, flat_final)
        for l in range(width):
            code = SUPERCRITICAL if limits[BEYOND, l] != 0.0 else OK
            status[first + l] = NONFINITE if np.isnan(shown[0, l]) else code
        if goes_on:
            for l in range(width):
                resume[0, first + l], resume[1, first + l] = state[FIRST, l], state[SECOND, l]
        if turns_too:
            for l in range(width):
                for k in range(4):
                    quaternions[k, first + l] = turn[k, l]
            if not saves and turns.shape[0] > 0:
                write_turns(R0, turn, turns, 0, first, width)
    fence()


def _iterate(
    method,
    I1,
    I2,
    I13,
    I23,
    eps,
    omega,
    begin,
    end,
    start,
    stop,
    every,
    first_row,
    out,
    resume,
    turning,
    final,
    status,
):
    """Iterate trajectories `begin` to `end` from state `start` to state `stop`.

    out           (rows, B, 2), the saved states, those whose number is a multiple of `every`, from
                  the one numbered first_row * every on; rows may be 0.
    resume        (2, B), the states as they are held: read where start > 0, and written; (2, 0) if
                  nobody goes on from them.
    turning       None where no orientations are wanted, which are not compiled then; or
                  time_step    (B,) or (1,), the step size in the unit of time of omega,
                  R0           (3, 3, B), the orientations at step 0,
                  quaternions  (4, B), those since then: read and written, and
                  turns        (rows, B, 3, 3), the orientations that are saved with the states, or
                               alone the last.
    final         (B, 2), state `stop`, NaN if it does not exist.
    status        (B,): OK, SUPERCRITICAL, or NONFINITE if state `stop` does not exist.
    """
    n_blocks, _, _ = blocks_between(begin, end, out)
    # Each task goes through several blocks.
    n_tasks = tasks_for(n_blocks)
    for task in prange(n_tasks):
        iterate_blocks(
            task,
            n_tasks,
            method,
            I1,
            I2,
            I13,
            I23,
            eps,
            omega,
            begin,
            end,
            start,
            stop,
            every,
            first_row,
            out,
            resume,
            turning,
            final,
            status,
        )


@staged
def locate(method, I1, I2, I13, I23, eps, omega, failed, start, stop, resume, status, failed_at, k):
    """What `locate_failure` does for one trajectory."""
    i, states = failed[k], omega.reshape(omega.size)
    given, limits = on_stack(GIVEN, LANES), on_stack(4, LANES)
    state, shown, frame = on_stack(2, LANES), on_stack(2, LANES), on_stack(7, LANES)
    coefficients = on_stack(4, LANES)
    d, regular = 1.0, True
    gather_bodies((I1, I2, I13, I23, eps), i, 1, 1, given)
    gather_states(states, i, 1, 1, given)
    take_units_out(given, 1)
    enter_canonical(given, state, frame, limits, 1)
    if method == PRINTED:
        enter_printed(given, state, frame, limits, coefficients, 1)
    if start > 0:
        state[FIRST, 0], state[SECOND, 0] = resume[0, k], resume[1, k]
    n = start
    shown[0, 0] = omega[i, 0] + 0.0 * omega[i, 1] if start == 0 else 0.0
    while n < stop and np.isfinite(shown[0, 0]):
        first, second = state[FIRST, 0], state[SECOND, 0]
        if method == PRINTED:
            c = coefficients
            d, regular = printed_denominator(c[0, 0], c[1, 0], c[2, 0], c[3, 0], first, second)
            advance_printed(state, coefficients, limits[BOUND], 1, 1)
        else:
            d, regular = denominator(first, second, limits[SHIFT, 0])
            advance_guarded(state, limits[SHIFT], limits[BOUND], 1, 1)
        n += 1
        show(frame, state, shown, 1)
    resume[0, k], resume[1, k] = state[FIRST, 0], state[SECOND, 0]
    if failed_at[i] < 0 and not np.isfinite(shown[0, 0]):
        status[i] = SINGULAR if np.isfinite(d) and not regular else NONFINITE
        failed_at[i] = n


def _locate_failure(
    method, I1, I2, I13, I23, eps, omega, failed, start, stop, resume, status, failed_at
):
    """Find what went wrong in the `failed` trajectories, and their first missing states.

    failed      (F,), the numbers of the trajectories.
    resume      (2, F), the states as they are held: read where start > 0, and written.
    failed_at   (B,), -1 where it is not known yet; those between `start` and `stop` are found.
    """
    for k in prange(failed.size):
        locate(
            method, I1, I2, I13, I23, eps, omega, failed, start, stop, resume, status, failed_at, k
        )


iterate = Loop(_iterate)
locate_failure = Loop(_locate_failure)
