"""States by the closed form, in rows of equal steps or at arbitrary times.

The lanes of a block are trajectories or, if these are few, trajectories at several rows or
times, row by row. In rows of equal steps the geometric sequence restarts every GROUP rows from a
power computed directly, and is multiplied twice in between: a state depends only on its orbit and
its index.

Arguments of kernels, over a batch of B trajectories:

sign         1, or -1 for the inverse map and the flow backward in time; all times are >= 0
parameters   I1, I2, I13, I23 and eps: (B,) each, or (1,) if common to all; for the flow eps is the
             unit of times
omega        (B, 2), the states at time 0
lanes        the first trajectory to compute, and the one after the last
out          (N, B, 2), the states; NaN if a state does not exist
ends         status, failed_at and the last step of a run whose trajectories end at a pole; for
             empty arrays the closed form continues past it
missing      (parts, 3), incremented by the numbers of NaN states of orbits whose state 0 is not
             NaN: at a step, between two steps, and out of the range of float64
"""

import numpy as np

from .._formulas.closed_form import (
    OUT_OF_RANGE,
    REGULAR,
    SUPERCRITICAL,
    UNDEFINED,
    UNKNOWN,
    Orbit,
    coefficients,
    coordinates_of_flow,
    coordinates_of_map,
    far_point,
    growth,
    near_point,
    near_state,
    power_of_ratio,
    sequence_of_flow,
    sequence_of_map,
    state_at,
)
from .._formulas.elementary import scaled, smaller
from .._jit import Kernel, carray, formula, inner, select, share, stack
from . import codes
from .lanes import LANES, body_at, whole
from .tiles import lead_of, missing_of_first_block, write_row

EIGHT, GROUP = 8, 64
# Rows of a block: the fields of an orbit, and time-independent data of the lanes for some rows.
A1, B1, A2, B2, POWER, V, K, LAG, R, LOG_R, LOG_LOST, G, H, FATE = range(len(Orbit._fields))
OMEGA1, OMEGA2, FAILS, NUMBER, SEED, LARGE, HALF, KAPPA, SLOW = range(FATE + 1, FATE + 10)
# r**(8 a every), and r**(a every), a = 0 ... 7.
EIGHTHS, ROWS = SLOW + 1, SLOW + 9
FIELDS = ROWS + 8
# Rows from SEED on, used while orbits are entered. Loops over lanes become SIMD for up to 16 rows.
I1_, I2_, I13_, I23_, EPS_, X_, Y_, LOST, UNIT, TIME, KIND, T_ = range(SEED, SEED + 12)
ROOM, WIDE = FIELDS * LANES, 2 * LANES
TILE = EIGHT * WIDE
# States of one task.
TASK = 2**16
# Seeds w above this, and those near a pole, |k| w**2 above 1/4, are computed one by one.
LARGE_SEED, NEAR_POLE = 200.0, 0.25
# A w below this becomes 0, and its square earlier, since subnormal numbers are slow.
NEGLIGIBLE, NO_SQUARE = 2.0**-960, 2.0**-300
# The logarithm of the largest state that certainly is finite.
LARGEST_EXPONENT = 1022.0
# The status of a trajectory that must be iterated.
NOT_FOUND = -3


@formula
def orbit_of(r, l):
    """Return the orbit in lane l of a block."""
    return Orbit(
        *(r[0, l], r[1, l], r[2, l], r[3, l], r[4, l], r[5, l], r[6, l]),
        *(r[7, l], r[8, l], r[9, l], r[10, l], r[11, l], r[12, l], r[13, l]),
    )


@formula
def body_and_state_of(r, l):
    """Return I1, I2, I13, I23, eps and omega in lane l of a block."""
    return r[I1_, l], r[I2_, l], r[I13_, l], r[I23_, l], r[EPS_, l], r[OMEGA1, l], r[OMEGA2, l]


@formula
def not_negligible(v):
    """Return v, or 0 if it would soon be subnormal."""
    return select(abs(v) < NEGLIGIBLE, 0.0, v)


@formula
def plan_of(lanes, out, count, length):
    """Return the numbers of tasks, of tasks per block, of rows or times (of `count`) per task, of
    groups of lanes in a block, and by how much the first block is shorter.

    length   number of rows or times of a group.
    """
    batch, shift = lanes[1] - lanes[0], 0
    groups = max(min(LANES // max(batch, 1), (count + length - 1) // length), 1)
    if groups == 1:
        shift = missing_of_first_block(lead_of(out), out.shape[1], 2)
    blocks = (batch + shift + LANES - 1) // LANES
    at_once = groups * length
    some = max(TASK // (at_once * max(min(batch, LANES), 1)), 1) * at_once
    parts = (count + some - 1) // some
    return blocks * parts, parts, some, groups, shift


@formula
def task_of(task, plan, lanes):
    """Return the first trajectory of a task, their number, and how many rows precede its own."""
    _, parts, some, _, shift = plan
    block = task // parts
    first = lanes[0] + max(block * LANES - shift, 0)
    width = min(lanes[0] + (block + 1) * LANES - shift, lanes[1]) - first
    return first, width, task % parts * some


@inner
def state_of_lane(room, l, n):
    """Return state n of the orbit in a lane, by either form."""
    return state_at(n, orbit_of(room, l))


@inner
def end_of(room, l, stop):
    """Return the status of an orbit at a step, and the index of its first missing state."""
    orbit = orbit_of(room, l)
    if orbit.fate <= OUT_OF_RANGE:
        return NOT_FOUND, np.inf
    if orbit.fate < 0.0:
        unknown = orbit.fate == UNKNOWN
        return (codes.NONFINITE, 0.0) if unknown else (codes.SINGULAR, 1.0)
    if orbit.power > 0.0:
        largest = (abs(orbit.a1) + abs(orbit.a2)) / np.sqrt(abs(2.0 * orbit.r) + 1e-300)
        largest += abs(orbit.b1) + abs(orbit.b2)
        if np.log2(largest) + orbit.power > LARGEST_EXPONENT:
            return NOT_FOUND, np.inf
    if orbit.fate >= 1.0:
        nearest = np.floor(orbit.fate - 0.5)
        for n in (nearest - 1.0, nearest, nearest + 1.0):
            omega1, omega2 = state_of_lane(room, l, n)
            size = abs(omega1) + abs(omega2)
            if 1.0 <= n <= stop and not size < np.inf:
                return codes.NONFINITE if size == np.inf else codes.SINGULAR, n
    return codes.SUPERCRITICAL if orbit.fate >= SUPERCRITICAL else codes.OK, np.inf


@inner
def write_ends(room, first, width, ends):
    """Write statuses of trajectories; return True if any ends before the last step."""
    status, failed_at, stop = ends
    any_fails = False
    for l in range(width):
        code, fails = codes.OK, np.inf
        if room[FATE, l] != REGULAR or room[POWER, l] > 0.0:
            code, fails = end_of(room, l, stop)
        room[FAILS, l], status[first + l] = fails, code
        if fails < np.inf:
            failed_at[first + l], any_fails = int(fails), True
    return any_fails


@inner
def mend(room, l, n, tile, i, missing):
    """Correct state n of lane l at tile[i:] if it is slow, out of range, the first, or missing."""
    omega1, omega2 = tile[i], tile[i + 1]
    if room[SLOW, l] != 0.0:
        omega1, omega2 = state_of_lane(room, l, n)
    elif room[POWER, l] != 0.0:
        omega1, omega2 = scaled(omega1, room[POWER, l]), scaled(omega2, room[POWER, l])
    size = abs(omega1) + abs(omega2)
    if n == 0.0:
        omega1, omega2 = room[OMEGA1, l], room[OMEGA2, l]
    elif not size < np.inf:
        omega1, omega2 = np.nan, np.nan
        if room[FATE, l] == OUT_OF_RANGE or size == np.inf:
            missing[2] += 1.0
        elif room[FATE, l] != UNKNOWN:
            missing[0 if np.floor(n) == n else 1] += 1.0
    tile[i], tile[i + 1] = omega1, omega2


@inner
def end_rows(room, l, n, tile, i):
    """Set the states after a pole to NaN."""
    if n >= room[FAILS, l]:
        tile[i], tile[i + 1] = np.nan, np.nan


def entering(of_map):
    """Build the function that enters the orbits of a block, for the map or the flow."""
    coordinates, sequence = coordinates_of_flow, sequence_of_flow
    if of_map:
        coordinates, sequence = coordinates_of_map, sequence_of_map

    @inner
    def enter(sign, parameters, omega, first, width, room):
        """Fill the fields of the orbits of a block; lanes beyond the last repeat it."""
        lanes = whole(width)
        for l in range(lanes):
            b = first + min(l, width - 1)
            room[OMEGA1, l], room[OMEGA2, l] = omega[b, 0], omega[b, 1]
            o = body_at(parameters, b)
            room[I1_, l], room[I2_, l], room[I13_, l], room[I23_, l], room[EPS_, l] = o
        for l in range(lanes):
            o = coordinates(sign, *body_and_state_of(room, l))
            room[X_, l], room[Y_, l], room[LOST, l] = o[0], o[1], o[2]
            room[UNIT, l], room[TIME, l], room[KIND, l] = o[3], o[4], o[5]
        for l in range(lanes):
            o = sequence(room[X_, l], room[Y_, l], room[LOST, l], room[TIME, l], room[KIND, l])
            room[T_, l], room[V, l], room[K, l], room[LAG, l], room[R, l] = o[:5]
            room[LOG_R, l], room[LOG_LOST, l], room[G, l], room[H, l], room[FATE, l] = o[5:]
        for l in range(lanes):
            T = room[T_, l]
            of_x = 4.0 * (T / (1.0 + T) if of_map else T)
            body_and_state = body_and_state_of(room, l)
            o = coefficients(of_x, T, room[UNIT, l], room[KIND, l], sign, *body_and_state)
            room[A1, l], room[B1, l], room[A2, l], room[B2, l], room[POWER, l] = o
            fate, exists = room[FATE, l], room[B1, l] == room[B1, l]
            room[FATE, l] = select(exists, fate, smaller(fate, UNDEFINED))

    return enter


@inner
def finish_block(room, first, width, groups, ends):
    """Repeat the orbits for each group of lanes; return the lanes, and True if any state is scaled
    afterwards, True if any is missing before the last step.
    """
    lanes = whole(width * groups)
    fails = write_ends(room, first, width, ends) if ends[0].size else False
    if groups > 1:
        for k in range(NUMBER):
            for l in range(width, lanes):
                room[k, l] = room[k, l - width]
    scales = 0
    for l in range(lanes):
        room[SLOW, l] = 0.0
        scales += select(room[POWER, l] != 0.0, 1, 0)
    return lanes, scales > 0, fails


@inner
def enter_ratios(room, lanes, every):
    """Fill the powers of r between rows, and the row indices of groups of lanes."""
    for a in range(2 * EIGHT):
        steps = (8.0 * a if a < EIGHT else a - 8.0) * every
        for l in range(lanes):
            p, k, s = power_of_ratio(steps, room[R, l], room[LOG_R, l], room[LOG_LOST, l])
            room[EIGHTHS + a, l] = not_negligible(s * scaled(1.0 + p, k))


@inner
def enter_seeds(room, lanes, first_number, every, top):
    """Fill the numbers w of the rows from which the geometric sequence restarts."""
    for l in range(lanes):
        f, k = growth(first_number + every * (top + room[NUMBER, l]), orbit_of(room, l))
        w = scaled(f, smaller(k, LARGE_SEED))
        room[SEED, l] = not_negligible(w)
        between = (room[R, l] <= 0.0) & (room[ROWS + 1, l] != room[ROWS + 1, l])
        slow = (k >= LARGE_SEED) | (room[FATE, l] < 0.0) | between | (w != w)
        room[LARGE, l] = select(slow, 1.0, 0.0)


@inner
def enter_eighth(room, lanes, a):
    """Fill w / 2 and 4 k at the first of eight rows; return how many lanes are slow there."""
    slow = 0
    for l in range(lanes):
        u = room[SEED, l] * room[EIGHTHS + a, l]
        kappa = 2.0 * room[R, l]
        near_pole = (room[R, l] < 0.0) & (abs(kappa * u * u) > NEAR_POLE)
        room[SLOW, l] = select(near_pole, 1.0, room[LARGE, l])
        room[HALF, l] = 0.5 * not_negligible(u)
        room[KAPPA, l] = select(abs(u) > NO_SQUARE, 4.0 * kappa, 0.0)
        slow += select(room[SLOW, l] != 0.0, 1, 0)
    return slow


@inner
def scatter_rows(tile, flat, row, rows, width, groups):
    """Write eight rows of each group of lanes."""
    begin, end, origin, direction, batch, first = rows
    stride = 2 * direction * batch
    for g in range(groups):
        place = row + g * GROUP
        target = 2 * ((origin + direction * place) * batch + first)
        if begin <= place and place + EIGHT <= end:
            for l in range(width):
                for b in range(EIGHT):
                    i = target + stride * b + 2 * l
                    flat[i], flat[i + 1] = (
                        tile[b, 2 * (g * width + l)],
                        tile[b, 2 * (g * width + l) + 1],
                    )
        else:
            for b in range(max(begin - place, 0), min(end - place, EIGHT)):
                for i in range(2 * width):
                    flat[target + stride * b + i] = tile[b, 2 * g * width + i]


def fill_rows(part, parts, sign, parameters, omega, steps, rows, lanes, out, ends, missing):
    """Fill rows begin <= i < end: state first + every i goes to row origin + direction i.

    steps   first, every
    rows    begin, end, origin, direction
    """
    first_number, every = steps
    begin, end, origin, direction = rows
    low = begin // GROUP * GROUP
    plan = plan_of(lanes, out, end - low, GROUP)
    tasks, _, some, groups, _ = plan
    room, tile = carray(stack(ROOM), (FIELDS, LANES)), carray(stack(TILE), (EIGHT, WIDE))
    flat, lead, batch = out.reshape(out.size), lead_of(out), out.shape[1]
    found, (first_task, last_task) = missing[part], share(tasks, part, parts)
    for task in range(first_task, last_task):
        first, width, skipped = task_of(task, plan, lanes)
        enter(sign, parameters, omega, first, width, room)
        used, scales, fails = finish_block(room, first, width, groups, ends)
        enter_ratios(room, used, every)
        for l in range(used):
            room[NUMBER, l] = float(l // width * GROUP)
        top_of_task = low + skipped
        for top in range(top_of_task, min(top_of_task + some, end), GROUP * groups):
            enter_seeds(room, used, first_number, every, top)
            starts = top == 0 and first_number == 0.0
            for a in range(EIGHT):
                row = top + EIGHT * a
                if groups == 1 and (row >= end or row + EIGHT <= begin):
                    continue
                slow = enter_eighth(room, used, a)
                repairs_all = slow > 0 or scales
                for b in range(EIGHT):
                    line = tile[b if groups > 1 else 0]
                    for l in range(used):
                        line[2 * l], line[2 * l + 1] = near_state(
                            room[HALF, l] * room[ROWS + b, l],
                            room[KAPPA, l],
                            room[A1, l],
                            room[B1, l],
                            room[A2, l],
                            room[B2, l],
                        )
                    if groups == 1 and not begin <= row + b < end:
                        continue
                    repairs = repairs_all or (starts and a == 0 and b == 0)
                    for l in range(width * groups if repairs or fails else 0):
                        place = row + b + room[NUMBER, l]
                        n = first_number + every * place
                        if repairs and begin <= place < end:
                            mend(room, l, n, line, 2 * l, found)
                        if fails:
                            end_rows(room, l, n, line, 2 * l)
                    if groups == 1:
                        target = 2 * ((origin + direction * (row + b)) * batch + first)
                        write_row(line, flat, target, 2 * width, 2 * direction * batch, lead)
                if groups > 1:
                    place = begin, end, origin, direction, batch, first
                    scatter_rows(tile, flat, row, place, width, groups)


def fill_states(part, parts, sign, parameters, omega, times, to, lanes, out, ends, missing):
    """Fill row to[j] with the states at times[j], which are numbers of steps of the map."""
    plan = plan_of(lanes, out, times.size, 1)
    tasks, _, some, groups, _ = plan
    room, line = carray(stack(ROOM), (FIELDS, LANES)), carray(stack(WIDE), (WIDE,))
    flat, lead, batch = out.reshape(out.size), lead_of(out), out.shape[1]
    found, (first_task, last_task) = missing[part], share(tasks, part, parts)
    for task in range(first_task, last_task):
        first, width, skipped = task_of(task, plan, lanes)
        enter(sign, parameters, omega, first, width, room)
        used, scales, fails = finish_block(room, first, width, groups, ends)
        far = 0
        for l in range(used):
            far += select(room[H, l] != 0.0, 1, 0)
        for j in range(skipped, min(skipped + some, times.size), groups):
            for l in range(used):
                room[NUMBER, l] = times[min(j + l // width, times.size - 1)]
            odd = 0
            for l in range(used):
                room[HALF, l], room[KAPPA, l] = growth(room[NUMBER, l], orbit_of(room, l))
            for l in range(used):
                o = orbit_of(room, l)
                A, B = near_point(room[HALF, l], room[KAPPA, l], 2.0 * o.r)
                omega1, omega2 = o.a1 * A + o.b1 * B, o.a2 * A + o.b2 * B
                line[2 * l], line[2 * l + 1] = omega1, omega2
                finite = abs(omega1) + abs(omega2) < np.inf
                odd += select(finite & (room[NUMBER, l] != 0.0), 0, 1)
            if far > 0:
                for l in range(used):
                    o = orbit_of(room, l)
                    A, B = far_point(room[NUMBER, l], o)
                    is_far = o.h != 0.0
                    omega1 = select(is_far, o.a1 * A + o.b1 * B, line[2 * l])
                    omega2 = select(is_far, o.a2 * A + o.b2 * B, line[2 * l + 1])
                    line[2 * l], line[2 * l + 1] = omega1, omega2
                    odd += select(abs(omega1) + abs(omega2) < np.inf, 0, 1)
            groups_left = min(groups, times.size - j)
            for l in range(width * groups_left if odd > 0 or scales or fails else 0):
                mend(room, l, room[NUMBER, l], line, 2 * l, found)
                if fails:
                    end_rows(room, l, room[NUMBER, l], line, 2 * l)
            for g in range(groups_left):
                target = 2 * (to[j + g] * batch + first)
                if groups == 1:
                    write_row(line, flat, target, 2 * width, 0, lead)
                else:
                    for i in range(2 * width):
                        flat[target + i] = line[2 * g * width + i]


rows_of_map = Kernel(fill_rows, "rows_of_map", enter=entering(True))
rows_of_flow = Kernel(fill_rows, "rows_of_flow", enter=entering(False))
states_of_map = Kernel(fill_states, "states_of_map", enter=entering(True))
states_of_flow = Kernel(fill_states, "states_of_flow", enter=entering(False))
