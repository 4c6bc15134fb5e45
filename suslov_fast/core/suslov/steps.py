"""Steps of a body or gyrostat in three dimensions, in blocks of lanes: the kernel.

The equations, and the plain and the general form of a state, are those of `suslov.map_3d`.
"""

import numpy as np

from ..numba.arrays import array_at, block_of, uncounted
from ..numba.decorators import are_common, as_python, formula, kernel, pick, share
from ..numba.intrinsics import lesser, select
from ..numba.status_codes import NONFINITE, SINGULAR, SUPERCRITICAL
from .blocks import alignment, store_rows, write_pairs
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

# Typed, because Numba compiles a function for each literal, and types one twice if a sum begins so.
FIRST, ONE, LANES, NO = np.int64(0), np.int64(1), np.int64(128), np.bool_(False)
FEW = 6  # trajectories, which take less time one by one than all lanes of a block
# Plain steps, of which only the last one sets a decayed X to 0. A test at each step would take a
# fifth longer and give the same bits: Y < 0 is constant where X is negligible, and X decays on.
DECAYING = np.int64(16)
PROJECTED = 512  # steps, after which R is restored
GENERAL, PLAIN, FIXED = 0.0, 1.0, 2.0
TO_FIND = -2  # stands for the step, still unknown, at which a trajectory failed

# Rows of a block: the form; X and Y of the plain form; X, u, v and initial R of the general form.
# A run continues from these: from the first three if the whole block is plain, from U and V as the
# state if that is fixed. TAKEN and AT_POLE count the general steps of a lane alone, and those from
# a pole. The rest are the state, the frame, and the factors of X.
KIND, X_, Y_, XG, U, V, R, TAKEN, AT_POLE, W1, W2, FRAME = range(12)
E_, I13_, I23_, K_ = range(FRAME + 6, FRAME + 10)
CARRIED, CARRIED_BY_PLAIN, ROWS = TAKEN, XG, K_ + 1
# Rows that first hold something else: parameters until the frames are made, a flag until the steps.
I1_, I2_, EPS_, TOO_LONG = KIND, X_, E_, TAKEN
STATE = np.int64(W1)  # typed, as FIRST
new_block = block_of(ROWS, int(LANES))


@formula
def frame_at(b, l):
    """Return the `Frame` (constants of body and eps) of lane l of a block `b` (ROWS, lanes)."""
    K, a1, a2 = b[FRAME, l], b[FRAME + 1, l], b[FRAME + 2, l]
    return Frame(K, a1, a2, b[FRAME + 3, l], b[FRAME + 4, l], b[FRAME + 5, l])


@formula
def state_at(b, l):
    """Return the state (w1, w2) of lane l of a block `b` (ROWS, lanes); NaN if there is none."""
    plain1, plain2 = leave_plain(frame_at(b, l), b[X_, l], b[Y_, l])
    plain, fixed = b[KIND, l] == PLAIN, b[KIND, l] == FIXED
    w1 = select(plain, plain1, select(fixed, b[W1, l], b[U, l]))
    w2 = select(plain, plain2, select(fixed, b[W2, l], b[V, l] * b[FRAME + 3, l]))
    exists = abs(w1) + abs(w2) < np.inf
    return select(exists, w1, np.nan), select(exists, w2, np.nan)


@formula
def fill_frames(b, lanes, first, width, parameters):
    """Fill `lanes` lanes of a block `b` with the `Frame`, e, I13, I23 and k of trajectories.

    They are `width` trajectories from number `first` on; later lanes repeat the first one.
    `parameters` are (I1, I2, I13, I23, k, eps).
    """
    I1, I2, I13, I23, k, eps = parameters
    full = LANES if lanes > 1 else ONE  # constants, for SIMD
    for l in range(lanes):
        i = first + (l if l < width else 0)
        b[I1_, l], b[I2_, l] = pick(I1, i), pick(I2, i)
        b[I13_, l], b[I23_, l] = pick(I13, i), pick(I23, i)
        b[K_, l], b[EPS_, l] = pick(k, i), pick(eps, i)
    for l in range(full):
        frame, e = frame_of(b[I1_, l], b[I2_, l], b[I13_, l], b[I23_, l], b[K_, l], b[EPS_, l])
        b[FRAME, l], b[FRAME + 1, l], b[FRAME + 2, l] = frame.K, frame.a1, frame.a2
        b[FRAME + 3, l], b[FRAME + 4, l], b[FRAME + 5, l] = frame.back, frame.m1, frame.m2
        b[E_, l] = e


@formula
def start_lanes(b, lanes, first, width, omega0, status, failed_at):
    """Fill lanes with trajectories from number `first` on, at state 0; return how many are plain.

    Plain states take steps in X and Y alone. If `lanes` is 1, a plain trajectory counts as LANES.
    Lanes beyond `width` repeat the first one. `b` is the block (ROWS, LANES), and `omega0` (B, 2).
    `status` and `failed_at` (B,) change for states that are supercritical or not finite.
    """
    full, plains, flagged = LANES if lanes > 1 else ONE, FIRST, FIRST
    for l in range(lanes):
        i = first + (l if l < width else 0)
        b[W1, l], b[W2, l] = omega0[i, 0], omega0[i, 1]
    for l in range(full):
        frame, w1, w2 = frame_at(b, l), b[W1, l], b[W2, l]
        X, Y = XY_in_frame(frame, b[E_, l], b[I13_, l], b[I23_, l], b[K_, l], w1, w2)
        plain, v = is_plain(frame, X, Y), w2 / frame.back
        fixed = ~plain & is_fixed(X, Y)
        form = select(plain, PLAIN, select(fixed, FIXED, GENERAL))
        b[KIND, l], b[U, l], b[V, l] = form, select(fixed, 0.0, w1), select(fixed, 0.0, v)
        b[X_, l], b[Y_, l] = X, Y
        b[XG, l] = select(loses_digits(frame, X, Y), np.nan, X)  # NaN, for no next state
        b[TOO_LONG, l] = select(is_supercritical(frame, X, Y), 1.0, 0.0)
        flagged += (b[TOO_LONG, l] > 0.0) | ~(abs(w1) + abs(v) < np.inf)
        plains += plain
    if plains < full:
        for l in range(full):
            X = b[XG, l]
            b[R, l] = length(b[U, l], b[V, l]) / np.sqrt(1.0 + X * X)
    for l in range(width if flagged > 0 else 0):
        if b[TOO_LONG, l] > 0.0:
            status[first + l] = SUPERCRITICAL
        if not abs(b[U, l]) + abs(b[V, l]) < np.inf:
            status[first + l], failed_at[first + l] = NONFINITE, 0
    return plains * (LANES // lanes)


@formula
def continue_lanes(b, lanes, first, width, carry):
    """Fill lanes with `width` trajectories from number `first` on, as `carry` has them after a run.

    Return how many take steps in X and Y alone, LANES if the only lane does; `b` is the block.
    """
    plains = FIRST
    for l in range(lanes):
        for j in range(CARRIED):
            b[j, l] = carry[j, first + (l if l < width else 0)]
        b[W1, l], b[W2, l] = b[U, l], b[V, l]
        if b[KIND, l] == FIXED:
            b[U, l], b[V, l] = 0.0, 0.0
        plains += b[KIND, l] == PLAIN
    return plains * (LANES // lanes)


@formula
def take_steps(b, lanes, plains, n, pause):
    """Take the lanes of a block `b` from state n to state `pause`; `lanes` is a constant, for SIMD.

    `plains` is how many take steps in X and Y alone, LANES if all do. A single lane stops if there
    is no next state; to test all lanes takes 1.4 times as long.
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
    """Write all of `output` except saved states; return how many trajectories may have failed.

    The lanes of the block `b` are trajectories `first` to last - 1; `plains` of them take steps in
    X and Y alone, LANES if all do. If `alone`, there is one lane, with a failure that is known.
    Otherwise failed_at becomes TO_FIND where a trajectory may have failed.
    """
    _, final, carry, status, failed_at = output
    to_find = FIRST
    if plains == LANES:
        target = array_at(final.ctypes.data, (final.size,), np.float64)
        store_rows(b, STATE, target, 2 * first, last - first)
        for j in range(CARRIED_BY_PLAIN):
            for l in range(last - first):
                carry[j, first + l] = b[j, l]
    for l in range(last - first if plains < LANES else 0):
        i = first + l
        may_fail = b[KIND, l] != PLAIN and status[i] >= 0
        if not alone and may_fail and not abs(b[U, l]) + abs(b[V, l]) < LARGEST:
            failed_at[i], to_find = TO_FIND, to_find + 1
            continue
        final[i, 0], final[i, 1] = b[W1, l], b[W2, l]
        if b[KIND, l] == FIXED:
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

    Trajectories that may have failed in a block of lanes are taken again, one by one, to find the
    step. None has failed if the last state is far inside the range, because R is conserved.

    parameters   (I1, I2, I13, I23, k, eps), each (1,) or (B,)
    omega0       (B, 2), state 0, read if start = 0
    output       an `Output`; `carry` has CARRIED rows
    """
    parameters, omega0, output = uncounted(parameters), uncounted(omega0), uncounted(output)
    begin, end, start, stop, every, first_row = span
    saved, _, carry, status, failed_at = output
    B, out, b = len(omega0), array_at(saved.ctypes.data, (saved.size,), np.float64), new_block()
    first_saved = stop + 1 if every == 0 else (start // every + 1) * every if start > 0 else 0
    alone, common = end - begin <= FEW, are_common(parameters)
    lanes = ONE if alone else LANES
    lead, shift, shared = alignment(out, begin, B, lanes)
    stride, origin = lanes - shared, begin - shift
    first_block, last_block = share((end - origin + stride - 1) // stride, part, parts)
    begin = begin if first_block == 0 else origin + first_block * stride
    end = lesser(origin + last_block * stride, end)
    first, again, to_find = begin, NO, FIRST
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
        b[TAKEN, FIRST], b[AT_POLE, FIRST] = 0.0, 0.0
        fuses = plains == LANES and not alone and common and every == 1
        n, next_saved, row, frame = start, first_saved, first_row, frame_at(b, FIRST)
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
                next_saved, row = next_saved + every, row + 1
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
    """Take the steps of all trajectories by NumPy, with the bits of `steps`; always return True.

    `Kernel.by_numpy` calls it before `steps` is compiled; True says that the work is done.
    `steps` explains the arguments.
    """
    # NumPy rounds sums, products, quotients and roots as the kernel does.
    begin, end, start, stop, every, row = span
    saved, final, carry, status, failed_at = output
    own, b = slice(begin, end), np.zeros((STATE + 2, end - begin))
    I1, I2, I13, I23, k, eps = (a[own] if len(a) > 1 else a for a in parameters)
    frame, e = frame_of(I1, I2, I13, I23, k, eps)
    if start == 0:
        w1, w2 = b[W1], b[W2] = omega0[own].T
        b[X_], b[Y_] = X, Y = XY_in_frame(frame, e, I13, I23, k, w1, w2)
        fixed = is_fixed(X, Y)
        form = select(is_plain(frame, X, Y), PLAIN, select(fixed, FIXED, GENERAL))
        b[KIND], b[U], b[V] = form, w1, w2 / frame.back
        b[XG] = X = select(loses_digits(frame, X, Y), np.nan, X)
        b[R] = length(b[U], b[V]) / np.sqrt(1.0 + X * X)
        status[own][is_supercritical(frame, b[X_], Y)] = SUPERCRITICAL
        undefined = ~fixed & ~(abs(b[U]) + abs(b[V]) < np.inf)
        status[own][undefined], failed_at[own][undefined] = NONFINITE, 0
    else:
        b[:CARRIED] = carry[:, own]
        b[W1], b[W2] = b[U], b[V]
    p, g = np.flatnonzero(b[KIND] == PLAIN), np.flatnonzero(b[KIND] == GENERAL)
    of_plain = Frame(*(a[p] if len(a) > 1 else a for a in frame))
    of_general = Frame(*(a[g] if len(a) > 1 else a for a in frame))
    X, Y, XZ, u, v, first = b[X_, p], b[Y_, p], b[XG, g], b[U, g], b[V, g], b[R, g]
    exists, w = status[own][g] >= 0, b[STATE:]
    for n in range(start, stop + 1):
        if n > start and len(p):
            X, Y = plain_step(X, Y)
        if n > start and len(g):
            XZ, u, v, pole = general_step(of_general, XZ, u, v)
            lost = exists & ~(abs(u) + abs(v) < np.inf)
            if np.count_nonzero(lost):
                which, exists = begin + g[lost], exists & ~lost
                status[which] = select(pole[lost] > 0.0, SINGULAR, NONFINITE)
                failed_at[which], u[lost], v[lost] = n, np.nan, np.nan
            if n % PROJECTED == 0:
                XZ, u, v = project_on_level(of_general, first, XZ, u, v)
        is_saved = every > 0 and n % every == 0 and (n > start or n == 0)
        if n > 0 and (is_saved or n == stop):
            w[:, p], w[:, g] = leave_plain(of_plain, X, Y), (u, v * of_general.back)
            w[:, ~(abs(w[0]) + abs(w[1]) < np.inf)] = np.nan
        if is_saved:
            saved[row, own], row = w.T, row + 1
    b[X_, p], b[Y_, p], b[XG, g], b[U, g], b[V, g] = X, Y, XZ, u, v
    b[U:R, b[KIND] == FIXED] = w[:, b[KIND] == FIXED]
    final[own], carry[:, own] = w.T, b[:CARRIED]
    return True


steps.in_numpy = as_python(steps_side_by_side, of_arrays=True)
