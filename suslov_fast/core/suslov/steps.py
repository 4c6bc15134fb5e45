"""Steps of a body or gyrostat in three dimensions, in blocks of lanes: the kernel.

`suslov.map_3d` has the equations, and the plain and the general form of a state. A block b[row, l]
has a trajectory in each lane l: LANES of them, or a single one.
"""

import numpy as np

from ..numba.arrays import array_at, block_of, uncounted
from ..numba.decorators import ZERO, as_python, formula, kernel, lesser, share
from ..numba.intrinsics import select
from ..numba.status_codes import NONFINITE, SINGULAR, SUPERCRITICAL
from .blocks import alignment, are_common, fill_parameters, store_rows, write_pairs
from .map_3d import (
    LARGEST,
    Frame,
    XY_in_frame,
    decaying_step,
    frame_of,
    general_step,
    is_fixed,
    is_plain,
    is_supercritical,
    leave_plain,
    length,
    loses_digits,
    plain_step,
    project_on_level,
)

ONE, LANES, NO = np.int64(1), np.int64(128), np.bool_(False)  # typed, see `decorators.ZERO`
FEW = 6  # up to so many trajectories take less time one by one than all lanes of a block
# Plain steps between two tests that set a decayed X to 0. A test at each step would take a fifth
# longer and give the same bits: Y < 0 is constant where X is negligible, and X decays on.
DECAYING = np.int64(16)
PROJECTED = 512  # steps after which a general state is projected on the level of the constant R
GENERAL, PLAIN, FIXED = 0.0, 1.0, 2.0  # forms of a state, see `map_3d`; no step changes a FIXED one
TO_FIND = -2  # stands for the step, still unknown, at which a trajectory failed

# Rows of a block. If all its lanes have the form PLAIN, a run continues from its first three rows,
# else from its first CARRIED rows, in which U and V are the state of lanes of the form FIXED.
FORM, X_, Y_ = range(3)  # X and Y of the plain form
XG, U, V, R = range(3, 7)  # X, u and v of the general form, and R at the start
CARRIED_BY_PLAIN, CARRIED = XG, R + 1
TAKEN, AT_POLE = 7, 8  # of a single lane: the numbers of general steps and of steps from a pole
W1, W2 = 9, 10  # the state; if it were in other rows, storing it would delay loads of X and Y
FRAME = 11  # the first of the seven rows of the `Frame`
I1_, I2_, I13_, I23_, K_, EPS_ = range(18, 24)
TOO_LONG = 24  # 1.0 if the step is too long for state 0, see `is_supercritical`
ROWS = 25
STATE, BODY = np.int64(W1), np.int64(I1_)  # typed, see `decorators.ZERO`
new_block = block_of(ROWS, int(LANES))


@formula
def frame_at(b, l):
    """Return the `Frame` of lane l of a block."""
    e, K, a1 = b[FRAME, l], b[FRAME + 1, l], b[FRAME + 2, l]
    a2, back, m1 = b[FRAME + 3, l], b[FRAME + 4, l], b[FRAME + 5, l]
    return Frame(e, K, a1, a2, back, m1, b[FRAME + 6, l])


@formula
def fill_frame(b, l):
    """Compute the `Frame` of lane l of a block from the rows of its body and eps."""
    frame = frame_of(b[I1_, l], b[I2_, l], b[I13_, l], b[I23_, l], b[K_, l], b[EPS_, l])
    b[FRAME, l] = frame.e
    b[FRAME + 1, l] = frame.K
    b[FRAME + 2, l] = frame.a1
    b[FRAME + 3, l] = frame.a2
    b[FRAME + 4, l] = frame.back
    b[FRAME + 5, l] = frame.m1
    b[FRAME + 6, l] = frame.m2


@formula
def state_at(b, l):
    """Return the state (w1, w2) of lane l of a block; NaN if there is none."""
    plain1, plain2 = leave_plain(frame_at(b, l), b[X_, l], b[Y_, l])
    plain = b[FORM, l] == PLAIN
    fixed = b[FORM, l] == FIXED
    w1 = select(plain, plain1, select(fixed, b[W1, l], b[U, l]))
    w2 = select(plain, plain2, select(fixed, b[W2, l], b[V, l] * b[FRAME + 4, l]))
    exists = abs(w1) + abs(w2) < np.inf
    return select(exists, w1, np.nan), select(exists, w2, np.nan)


@formula
def start_lane(b, l):
    """Fill the rows from FORM to V, and TOO_LONG, of lane l of a block from its state 0."""
    frame, w1, w2 = frame_at(b, l), b[W1, l], b[W2, l]
    X, Y = XY_in_frame(frame, b[I13_, l], b[I23_, l], b[K_, l], w1, w2)
    plain = is_plain(frame, X, Y)
    fixed = ~plain & is_fixed(X, Y)
    b[FORM, l] = select(plain, PLAIN, select(fixed, FIXED, GENERAL))
    b[X_, l] = X
    b[Y_, l] = Y
    b[XG, l] = select(loses_digits(frame, X, Y), np.nan, X)  # NaN: there is no next state
    b[U, l] = select(fixed, 0.0, w1)
    b[V, l] = select(fixed, 0.0, w2 / frame.back)
    b[TOO_LONG, l] = select(is_supercritical(frame, X, Y), 1.0, 0.0)


@formula
def fill_frames(b, lanes, first, width, parameters):
    """Fill lanes with the bodies of `width` trajectories from `first` on; others repeat `first`."""
    for l in range(lanes):
        fill_parameters(b, l, BODY, parameters, first + (l if l < width else 0))
    for l in range(LANES if lanes > 1 else ONE):  # constant lengths, for SIMD
        fill_frame(b, l)


@formula
def start_lanes(b, lanes, first, width, omega0, status, failed_at):
    """Fill lanes with initial states; return how many of them are in the plain form of `map_3d`.

    If a block has a single lane, return LANES in place of 1. States that are supercritical
    (`is_supercritical`) or not finite set their `status`.
    """
    for l in range(lanes):
        i = first + (l if l < width else 0)
        b[W1, l], b[W2, l] = omega0[i, 0], omega0[i, 1]
    full = LANES if lanes > 1 else ONE  # constant lengths, for SIMD
    plains, flagged = ZERO, ZERO
    for l in range(full):
        start_lane(b, l)
        plains += b[FORM, l] == PLAIN
        flagged += (b[TOO_LONG, l] > 0.0) | ~(abs(b[U, l]) + abs(b[V, l]) < np.inf)
    if plains < full:
        for l in range(full):
            b[R, l] = length(b[U, l], b[V, l]) / np.sqrt(1.0 + b[XG, l] * b[XG, l])
    for l in range(width if flagged > 0 else 0):
        if b[TOO_LONG, l] > 0.0:
            status[first + l] = SUPERCRITICAL
        if not abs(b[U, l]) + abs(b[V, l]) < np.inf:
            status[first + l], failed_at[first + l] = NONFINITE, 0
    return plains * (LANES // lanes)


@formula
def continue_lanes(b, lanes, first, width, carry):
    """Fill lanes as `start_lanes` does, but from `carry`, in which the last run left them."""
    plains = ZERO
    for l in range(lanes):
        for j in range(CARRIED):
            b[j, l] = carry[j, first + (l if l < width else 0)]
        b[W1, l], b[W2, l] = b[U, l], b[V, l]
        if b[FORM, l] == FIXED:
            b[U, l], b[V, l] = 0.0, 0.0
        plains += b[FORM, l] == PLAIN
    return plains * (LANES // lanes)


@formula
def take_steps(b, lanes, plains, n, pause):
    """Take a block from state n to `pause`; `plains` of its `lanes` take `plain_step`s.

    A single lane stops if there is no next state. Many lanes are not tested, and go on with NaN,
    because tests would take 1.4 times as long.
    """
    if plains > 0:
        for begin in range(n, pause, DECAYING):
            for _ in range(begin + 1, lesser(begin + DECAYING, pause)):
                for l in range(lanes):
                    b[X_, l], b[Y_, l] = decaying_step(b[X_, l], b[Y_, l])
            for l in range(lanes):
                b[X_, l], b[Y_, l] = plain_step(b[X_, l], b[Y_, l])
    if plains == LANES:
        return
    for _ in range(n, pause):
        for l in range(lanes):
            frame = frame_at(b, l)
            b[XG, l], b[U, l], b[V, l], pole = general_step(frame, b[XG, l], b[U, l], b[V, l])
            if lanes == 1:
                b[AT_POLE, l] += pole
                if not abs(b[U, l]) + abs(b[V, l]) < np.inf:
                    b[U, l], b[V, l] = np.nan, np.nan
                    return
                b[TAKEN, l] += 1.0
    if pause % PROJECTED == 0:
        for l in range(lanes):
            X, u, v = b[XG, l], b[U, l], b[V, l]
            b[XG, l], b[U, l], b[V, l] = project_on_level(frame_at(b, l), b[R, l], X, u, v)


@formula
def finish_lanes(b, alone, plains, first, last, span, output):
    """Write the last states, `carry` and failures of trajectories `first` to last - 1.

    A later run continues from `carry`. A lane that is `alone` knows the step at which it failed.
    Among many lanes, failed_at becomes TO_FIND where a trajectory may have failed. Return how many.
    """
    _, final, carry, status, failed_at = output
    to_find = ZERO
    if plains == LANES:
        target = array_at(final.ctypes.data, (final.size,), np.float64)
        store_rows(b, STATE, target, 2 * first, last - first)
        for j in range(CARRIED_BY_PLAIN):
            for l in range(last - first):
                carry[j, first + l] = b[j, l]
    for l in range(last - first if plains < LANES else 0):
        i = first + l
        may_fail = b[FORM, l] != PLAIN and status[i] >= 0
        if not alone and may_fail and not abs(b[U, l]) + abs(b[V, l]) < LARGEST:
            failed_at[i] = TO_FIND
            to_find += 1
            continue
        final[i, 0], final[i, 1] = b[W1, l], b[W2, l]
        if b[FORM, l] == FIXED:
            b[U, l], b[V, l] = b[W1, l], b[W2, l]
        for j in range(CARRIED):
            carry[j, i] = b[j, l]
        if alone and may_fail:
            failed_at[i] = -1  # in place of TO_FIND
            if b[TAKEN, l] < span.stop - span.start:
                status[i] = SINGULAR if b[AT_POLE, l] > 0.0 else NONFINITE
                failed_at[i] = span.start + b[TAKEN, l] + 1
    return to_find


@kernel
def steps(part, parts, parameters, omega0, span, output):
    """Take part `part` of `parts` of the steps of a `Span`.

    If the last state of a trajectory is far inside the range, no step has failed, because R is
    conserved. Other trajectories are computed again, one by one, to find the step that failed.

    parameters   (I1, I2, I13, I23, k, eps), each (1,) or (B,)
    output       an `Output`; `carry` has CARRIED rows
    """
    parameters, omega0, output = uncounted(parameters), uncounted(omega0), uncounted(output)
    begin, end, start, stop, every, first_row = span
    saved, _, carry, status, failed_at = output
    out = array_at(saved.ctypes.data, (saved.size,), np.float64)
    B, b = len(omega0), new_block()
    first_saved = stop + 1 if every == 0 else (start // every + 1) * every if start > 0 else 0
    common = are_common(parameters)
    alone = end - begin <= FEW
    lanes = ONE if alone else LANES
    lead, shift, shared = alignment(out, begin, B, lanes)
    stride, origin = lanes - shared, begin - shift
    first_block, last_block = share((end - origin + stride - 1) // stride, part, parts)
    begin = begin if first_block == 0 else origin + first_block * stride
    end = lesser(origin + last_block * stride, end)
    first, again, to_find = begin, NO, ZERO
    while first < end:
        last = lesser(first + stride - (first - origin) % stride, end)
        if again and failed_at[first] != TO_FIND:
            first = last
            continue
        width = lesser(last + shared, end) - first
        after, before = shared > 0 and first > begin, shared > 0 and last < end
        if not common or first == begin:
            fill_frames(b, lanes, first, width, parameters)
        if start == 0:
            plains = start_lanes(b, lanes, first, width, omega0, status, failed_at)
        else:
            plains = continue_lanes(b, lanes, first, width, carry)
        b[TAKEN, ZERO], b[AT_POLE, ZERO] = 0.0, 0.0
        fuses = plains == LANES and not alone and common and every == 1
        frame = frame_at(b, ZERO)
        n, next_saved, row = start, first_saved, first_row
        while True:
            fused = fuses and 0 < n < stop
            if fused:  # states and steps in one loop
                for l in range(LANES):
                    b[W1, l], b[W2, l] = leave_plain(frame, b[X_, l], b[Y_, l])
                    b[X_, l], b[Y_, l] = plain_step(b[X_, l], b[Y_, l])
            elif n > 0:  # at first W1 and W2 are state 0
                for l in range(lanes):
                    b[W1, l], b[W2, l] = state_at(b, l)
            if n == next_saved:
                place = 2 * (row * B + first)
                if alone:
                    out[place], out[place + 1] = b[W1, 0], b[W2, 0]
                else:
                    write_pairs(b, STATE, out, place, width, lead, after, before)
                next_saved += every
                row += 1
            if n == stop:
                break
            pause = lesser(lesser(stop, next_saved), (n // PROJECTED + 1) * PROJECTED)
            if alone:
                take_steps(b, ONE, plains, n, pause)
            elif not fused:
                take_steps(b, LANES, plains, n, pause)
            n = pause
        to_find += finish_lanes(b, alone, plains, first, last, span, output)
        first = last
        if first == end and to_find > 0:
            first, again, to_find, first_saved = begin, True, 0, stop + 1
            alone, lanes, stride, shared = True, ONE, ONE, 0


def steps_side_by_side(parameters, omega0, span, output):
    """Take the steps of all trajectories by NumPy, with the bits of `steps`; return True."""
    # NumPy rounds sums, products, quotients and roots as the kernel does.
    begin, end, start, stop, every, row = span
    some, l = slice(begin, end), slice(None)  # trajectories, and all lanes of a block of them
    saved, final, carry, status, failed_at = output.of(some)
    b = np.zeros((ROWS, end - begin))
    for place, parameter in enumerate(parameters, BODY):
        b[place] = parameter[some] if len(parameter) > 1 else parameter
    fill_frame(b, l)
    if start == 0:
        b[W1], b[W2] = omega0[some].T
        start_lane(b, l)
        b[R] = length(b[U], b[V]) / np.sqrt(1.0 + b[XG] * b[XG])
        status[b[TOO_LONG] > 0.0] = SUPERCRITICAL
        undefined = ~(abs(b[U]) + abs(b[V]) < np.inf)
        status[undefined], failed_at[undefined] = NONFINITE, 0
    else:
        b[:CARRIED] = carry
        b[W1], b[W2] = b[U], b[V]
        b[U:R, b[FORM] == FIXED] = 0.0
    frame, plain, general = frame_at(b, l), b[FORM] == PLAIN, b[FORM] == GENERAL
    for n in range(start, stop + 1):
        if n > start and plain.any():
            b[X_], b[Y_] = plain_step(b[X_], b[Y_])
        if n > start and general.any():
            b[XG], b[U], b[V], pole = general_step(frame, b[XG], b[U], b[V])
            lost = general & (status >= 0) & ~(abs(b[U]) + abs(b[V]) < np.inf)
            status[lost] = select(pole[lost] > 0.0, SINGULAR, NONFINITE)
            failed_at[lost] = n
            b[U:R, lost] = np.nan
            if n % PROJECTED == 0:
                b[XG], b[U], b[V] = project_on_level(frame, b[R], b[XG], b[U], b[V])
        is_saved = every > 0 and n % every == 0 and (n > start or n == 0)
        if n > 0 and (is_saved or n == stop):
            b[W1], b[W2] = state_at(b, l)
        if is_saved:
            saved[row] = b[W1:FRAME].T
            row += 1
    b[U:R, b[FORM] == FIXED] = b[W1:FRAME, b[FORM] == FIXED]
    final[:] = b[W1:FRAME].T
    carry[:] = b[:CARRIED]
    return True


steps.in_numpy = as_python(steps_side_by_side, of_arrays=True)
