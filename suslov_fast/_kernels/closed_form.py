"""States by the closed form: rows of equal steps, and states at any times.

The lanes of a block are trajectories or, where these are few, trajectories at several rows or
times, row by row. In rows of equal steps the geometric sequence begins anew from an exact power
every GROUP rows, and is multiplied twice in between: a state depends on its orbit and its number
alone.

Arguments of kernels, over a batch of B trajectories:

sign         1, or -1 for the inverse map and the flow back in time; all times are >= 0
parameters   I1, I2, I13, I23 and eps: (B,) each, or (1,) if all share it; for the flow eps is the
             unit of times
omega        (B, 2), the states at time 0
lanes        the first trajectory wanted, and the one after the last
out          (N, B, 2), the states; NaN where there is none
ends         status, failed_at and the last step of a run whose trajectories end at a pole; for
             empty arrays the closed form goes on beyond it
missing      (3,), to which is added how many states are NaN though state 0 is not: at a step,
             between two steps, and out of the range of float64
"""

import numpy as np
from numba import prange

from .._formulas.closed_form import (
    FAR_OUT,
    OUT_OF_RANGE,
    Orbit,
    enter_body,
    enter_flow,
    enter_map,
    far_point,
    growth,
    near_point,
    near_state,
    power_of_ratio,
    state_at,
)
from .._formulas.elementary import larger, scaled, smaller
from .._jit import carray, formula, inner, kernel, select, stack
from . import codes
from .tiles import lead_of, missing_of_first_block, write_row

LANES, EIGHT, GROUP = 128, 8, 64
# Rows of a block: the fields of an orbit, those named here, r**(8 a every), and r**(a every).
OMEGA1, OMEGA2, NUMBER, SEED, LARGE, HALF, KAPPA, SLOW = range(len(Orbit._fields), len(Orbit._fields) + 8)
EIGHTHS, ROWS = SLOW + 1, SLOW + 9
FIELDS = SLOW + 17
A1, B1, A2, B2, POWER, ORBIT_KAPPA, _, _, _, R, LOG_R, LOG_LOST, _, H, UNIT, CODE, FAILS = range(
    len(Orbit._fields)
)
ROOM, WIDE = FIELDS * LANES, 2 * LANES
TILE = EIGHT * WIDE
# States of one task.
TASK = 2**16
# Seeds w so large are taken one by one, as are those so near a pole: |k| w**2 above 1/4.
LARGE_SEED, NEAR_POLE = 200.0, 0.25
# A w so small becomes 0, as subnormal numbers are slow, and its square does earlier.
NEGLIGIBLE, NO_SQUARE = 2.0**-960, 2.0**-300
# The logarithm of the largest state that certainly is finite.
LARGEST_EXPONENT = 1022.0


@formula
def orbit_of(r, l):
    """Return the orbit in lane l of a block."""
    return Orbit(
        *(r[0, l], r[1, l], r[2, l], r[3, l], r[4, l], r[5, l], r[6, l], r[7, l], r[8, l]),
        *(r[9, l], r[10, l], r[11, l], r[12, l], r[13, l], r[14, l], r[15, l], r[16, l]),
    )


@formula
def not_negligible(v):
    """Return v, or 0 in the place of what would soon be subnormal."""
    return select(abs(v) > NEGLIGIBLE, v, 0.0)


@formula
def plan_of(lanes, out, count, length):
    """Return how blocks and times are shared: the number of tasks, how many a block has, how many
    of `count` rows or times a task has and a block holds side by side, and by how much the first
    block is shorter.

    length   of what is side by side.
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


def entrance(enter):
    """Make the loop that enters orbits."""

    @inner
    def enter_block(sign, parameters, omega, first, width, groups, room):
        """Enter trajectories, and repeat them for each group; return the lanes in use."""
        I1, I2, I13, I23, eps = parameters
        lanes = (width + EIGHT - 1) // EIGHT * EIGHT
        for l in range(lanes):  # lanes beyond the last trajectory repeat it
            b = first + min(l, width - 1)
            room[OMEGA1, l], room[OMEGA2, l] = omega[b, 0], omega[b, 1]
        shared = I1.size * I2.size * I13.size * I23.size * eps.size == 1
        body = enter_body(I1[0], I2[0], I13[0], I23[0], eps[0])
        for l in range(lanes):
            b = first + min(l, width - 1)
            if not shared:
                body = enter_body(
                    I1[min(b, I1.size - 1)],
                    I2[min(b, I2.size - 1)],
                    I13[min(b, I13.size - 1)],
                    I23[min(b, I23.size - 1)],
                    eps[min(b, eps.size - 1)],
                )
            put(room, l, enter(body, sign, room[OMEGA1, l], room[OMEGA2, l]))
        if groups > 1:
            lanes = (width * groups + EIGHT - 1) // EIGHT * EIGHT
            repeat(room, width, lanes, 0, NUMBER)
        return lanes

    return enter_block


@formula
def put(room, l, orbit):
    """Put an orbit into lane l."""
    row = 0
    for number in orbit:
        room[row, l] = number
        row += 1


@inner
def repeat(room, width, lanes, row, stop):
    """Repeat what the first lanes of some rows hold."""
    for k in range(row, stop):
        for l in range(width, lanes):
            room[k, l] = room[k, l - width]


@inner
def end_of(orbit):
    """Return the status of an orbit, and the number of the first state that does not exist."""
    if orbit.code < 0.0:
        return orbit.code, orbit.fails
    if orbit.power > 0.0:
        largest = (abs(orbit.a1) + abs(orbit.a2)) / np.sqrt(abs(orbit.kappa) + 1e-300)
        largest += abs(orbit.b1) + abs(orbit.b2)
        if np.log2(largest) + orbit.power > LARGEST_EXPONENT:
            return OUT_OF_RANGE, np.inf
    if orbit.fails < np.inf:
        nearest = np.floor(orbit.fails + 0.5)
        for n in (nearest - 1.0, nearest, nearest + 1.0):
            omega1, omega2 = state_at(n, orbit)
            size = abs(omega1) + abs(omega2)
            if n >= 1.0 and not size < np.inf:
                return select(size == np.inf, float(codes.NONFINITE), float(codes.SINGULAR)), n
    return orbit.code, np.inf


@inner
def write_ends(room, first, width, lanes, ends):
    """Find how trajectories end; return True if any does before the last step."""
    status, failed_at, stop = ends
    any_fails = False
    for l in range(width):
        code, fails = end_of(orbit_of(room, l))
        if fails > stop:
            code, fails = abs(code), np.inf
        room[FAILS, l] = fails
        status[first + l] = int(code)
        if fails < np.inf:
            failed_at[first + l], any_fails = int(fails), True
    repeat(room, width, lanes, FAILS, FAILS + 1)
    return any_fails


@inner
def mend(room, l, n, tile, i, missing):
    """Mend state n of lane l at tile[i:]: where it is slow, out of range, the first, or missing."""
    omega1, omega2 = tile[i], tile[i + 1]
    if room[SLOW, l] != 0.0:
        omega1, omega2 = state_at(n, orbit_of(room, l))
    elif room[POWER, l] != 0.0:
        omega1, omega2 = scaled(omega1, room[POWER, l]), scaled(omega2, room[POWER, l])
    size = abs(omega1) + abs(omega2)
    if n == 0.0:
        omega1, omega2 = room[OMEGA1, l], room[OMEGA2, l]
    elif not size < np.inf:
        omega1, omega2 = np.nan, np.nan
        if room[CODE, l] == OUT_OF_RANGE or size == np.inf:
            missing[2] += 1.0
        elif room[CODE, l] != codes.NONFINITE:
            missing[0 if np.floor(n) == n else 1] += 1.0
    tile[i], tile[i + 1] = omega1, omega2


@inner
def end_rows(room, l, n, tile, i):
    """Let no state follow a pole."""
    if n >= room[FAILS, l]:
        tile[i], tile[i + 1] = np.nan, np.nan


@inner
def enter_ratios(room, every, lanes):
    """Fill the powers of r from one seed to the next."""
    for table, eights in ((EIGHTHS, 8.0), (ROWS, 1.0)):
        for a in range(EIGHT):
            for l in range(lanes):
                steps = a * eights * every * room[UNIT, l]
                p, k, sign = power_of_ratio(steps, room[R, l], room[LOG_R, l], room[LOG_LOST, l])
                power = sign * scaled(1.0 + p, larger(k, -1000.0))
                room[table + a, l] = not_negligible(power)


@inner
def enter_seeds(room, first, every, top, lanes):
    """Fill the w of each lane at its row, and whether all rows after it are slow."""
    for l in range(lanes):
        n = first + every * (top + room[NUMBER, l])
        f, k = growth(n, orbit_of(room, l))
        w = scaled(f, larger(smaller(k, LARGE_SEED), -1000.0))
        room[SEED, l] = not_negligible(w)
        between = (room[R, l] <= 0.0) & (room[EIGHTHS + 1, l] != room[EIGHTHS + 1, l])
        slow = (k >= LARGE_SEED) | (room[CODE, l] < 0.0) | between | (w != w)
        room[LARGE, l] = select(slow, 1.0, 0.0)


@inner
def enter_eighth(room, a, lanes):
    """Fill what eight rows share; return how many lanes must be taken one by one."""
    slow = 0.0
    for l in range(lanes):
        u = room[SEED, l] * room[EIGHTHS + a, l]
        kappa = room[ORBIT_KAPPA, l]
        near_pole = (room[R, l] < 0.0) & (abs(kappa * u * u) > NEAR_POLE)
        room[SLOW, l] = select(near_pole, 1.0, room[LARGE, l])
        room[HALF, l] = 0.5 * not_negligible(u)
        room[KAPPA, l] = select(abs(u) > NO_SQUARE, 4.0 * kappa, 0.0)
        slow += room[SLOW, l]
    return slow


@formula
def fill_row(room, b, lanes, tile, i):
    """Fill a row of the tile from i on."""
    for l in range(lanes):
        tile[i + 2 * l], tile[i + 2 * l + 1] = near_state(
            room[HALF, l] * room[ROWS + b, l],
            room[KAPPA, l],
            room[A1, l],
            room[B1, l],
            room[A2, l],
            room[B2, l],
        )


@inner
def any_power(room, lanes):
    """Return True if the states of a lane are multiplied by a power of two."""
    found = 0.0
    for l in range(lanes):
        found += abs(room[POWER, l])
    return found > 0.0


def loop_over_rows(enter_block):
    """Make the loop over the rows or times of a task."""

    @inner
    def fill_rows(task, arguments):
        """Fill the rows of one task; return how many states are missing."""
        sign, parameters, omega, steps, rows, lanes_asked, out, ends = arguments
        (first_number, every), (begin, end, origin, direction) = steps, rows
        low = begin // GROUP * GROUP
        _, parts, some, groups, shift = plan_of(lanes_asked, out, end - low, GROUP)
        block, part = task // parts, task % parts
        first = lanes_asked[0] + max(block * LANES - shift, 0)
        width = min(lanes_asked[0] + (block + 1) * LANES - shift, lanes_asked[1]) - first
        room, tile = carray(stack(ROOM), (FIELDS, LANES)), carray(stack(TILE), (TILE,))
        missing = carray(stack(3), (3,))
        missing[0], missing[1], missing[2] = 0.0, 0.0, 0.0
        flat, lead, batch = out.reshape(out.size), lead_of(out), out.shape[1]
        lanes = enter_block(sign, parameters, omega, first, width, groups, room)
        for l in range(lanes):
            room[NUMBER, l] = float(l // width * GROUP)
        fails = write_ends(room, first, width, lanes, ends) if ends[0].size else False
        scales = any_power(room, lanes)
        enter_ratios(room, every, lanes)
        begin_of_task = low + part * some
        for top in range(begin_of_task, min(begin_of_task + some, end), GROUP * groups):
            enter_seeds(room, first_number, every, top, lanes)
            starts = top == 0 and first_number == 0.0
            for a in range(EIGHT):
                row = top + EIGHT * a
                if groups == 1 and (row >= end or row + EIGHT <= begin):
                    continue
                mends = enter_eighth(room, a, lanes) > 0.0 or scales or (starts and a == 0)
                for b in range(EIGHT):
                    i = 0 if groups == 1 else b * WIDE
                    fill_row(room, b, lanes, tile, i)
                    if groups == 1 and not begin <= row + b < end:
                        continue
                    for l in range(width * groups if mends or fails else 0):
                        place = row + b + room[NUMBER, l]
                        n = first_number + every * place
                        if mends and begin <= place < end:
                            mend(room, l, n, tile, i + 2 * l, missing)
                        if fails:
                            end_rows(room, l, n, tile, i + 2 * l)
                    if groups == 1:
                        target = 2 * ((origin + direction * (row + b)) * batch + first)
                        write_row(tile, flat, target, 2 * width, 2 * direction * batch, lead)
                if groups > 1:
                    scatter_rows(tile, flat, row, (begin, end, origin, direction), width, groups)
        return missing[0], missing[1], missing[2]

    return fill_rows


@inner
def scatter_rows(tile, flat, row, rows, width, groups):
    """Write eight rows of each group of lanes, where all trajectories are in a block."""
    begin, end, origin, direction = rows
    for g in range(groups):
        for b in range(EIGHT):
            place = row + g * GROUP + b
            if begin <= place < end:
                target = 2 * (origin + direction * place) * width
                for i in range(2 * width):
                    flat[target + i] = tile[b * WIDE + 2 * g * width + i]


def loop_over_times(enter_block):
    """Make the loop over the rows or times of a task."""

    @inner
    def fill_states(task, arguments):
        """Fill the states of one task; return how many are missing."""
        sign, parameters, omega, times, to, lanes_asked, out, ends = arguments
        _, parts, some, groups, shift = plan_of(lanes_asked, out, times.size, 1)
        block, part = task // parts, task % parts
        first = lanes_asked[0] + max(block * LANES - shift, 0)
        width = min(lanes_asked[0] + (block + 1) * LANES - shift, lanes_asked[1]) - first
        room, tile = carray(stack(ROOM), (FIELDS, LANES)), carray(stack(TILE), (TILE,))
        missing = carray(stack(3), (3,))
        missing[0], missing[1], missing[2] = 0.0, 0.0, 0.0
        flat, lead, batch = out.reshape(out.size), lead_of(out), out.shape[1]
        lanes = enter_block(sign, parameters, omega, first, width, groups, room)
        fails = write_ends(room, first, width, lanes, ends) if ends[0].size else False
        scales, far = any_power(room, lanes), 0.0
        for l in range(lanes):
            far += abs(room[H, l])
            room[SLOW, l] = 0.0
        for j in range(part * some, min((part + 1) * some, times.size), groups):
            for l in range(lanes):
                room[NUMBER, l] = times[min(j + l // width, times.size - 1)]
            used = width * min(groups, times.size - j)
            odd = fill_near(room, lanes, tile)
            if far > 0.0:
                odd = fill_far(room, lanes, tile)
            if odd > 0.0 or scales or fails:
                for l in range(used):
                    mend(room, l, room[NUMBER, l], tile, 2 * l, missing)
                    if fails:
                        end_rows(room, l, room[NUMBER, l], tile, 2 * l)
            for g in range(min(groups, times.size - j)):
                target = 2 * (to[j + g] * batch + first)
                if groups == 1:
                    write_row(tile, flat, target, 2 * width, 0, lead)
                else:
                    for i in range(2 * width):
                        flat[target + i] = tile[2 * g * width + i]
        return missing[0], missing[1], missing[2]

    return fill_states


@inner
def fill_near(room, lanes, tile):
    """Fill the tile with a state for each lane; return how many must be mended."""
    odd = 0.0
    for l in range(lanes):
        orbit = orbit_of(room, l)
        f, k = growth(room[NUMBER, l], orbit)
        room[HALF, l], room[KAPPA, l] = f, k
    for l in range(lanes):
        orbit = orbit_of(room, l)
        A, B = near_point(room[HALF, l], room[KAPPA, l], orbit.kappa)
        omega1, omega2 = orbit.a1 * A + orbit.b1 * B, orbit.a2 * A + orbit.b2 * B
        tile[2 * l], tile[2 * l + 1] = omega1, omega2
        finite = abs(omega1) + abs(omega2) < np.inf
        odd += select(finite & (room[NUMBER, l] != 0.0), 0.0, 1.0)
    return odd


@inner
def fill_far(room, lanes, tile):
    """Replace the states of lanes that are far out; return how many must be mended."""
    odd = 0.0
    for l in range(lanes):
        orbit = orbit_of(room, l)
        A, B = far_point(room[NUMBER, l], orbit)
        far = orbit.h != 0.0
        omega1 = select(far, orbit.a1 * A + orbit.b1 * B, tile[2 * l])
        omega2 = select(far, orbit.a2 * A + orbit.b2 * B, tile[2 * l + 1])
        tile[2 * l], tile[2 * l + 1] = omega1, omega2
        finite = abs(omega1) + abs(omega2) < np.inf
        odd += select(finite & (room[NUMBER, l] != 0.0), 0.0, 1.0)
    return odd


enter_block_of_map, enter_block_of_flow = entrance(enter_map), entrance(enter_flow)
fill_rows_of_map = loop_over_rows(enter_block_of_map)
fill_rows_of_flow = loop_over_rows(enter_block_of_flow)
fill_states_of_map = loop_over_times(enter_block_of_map)
fill_states_of_flow = loop_over_times(enter_block_of_flow)


@kernel
def rows_of_map(sign, parameters, omega, steps, rows, lanes, out, ends, missing):
    """Fill rows begin <= i < end: state first + every i goes to row origin + direction i.

    steps   first, every
    rows    begin, end, origin, direction
    """
    arguments = sign, parameters, omega, steps, rows, lanes, out, ends
    steps_missing, between, beyond = 0.0, 0.0, 0.0
    for task in prange(plan_of(lanes, out, rows[1] - rows[0] // GROUP * GROUP, GROUP)[0]):
        some = fill_rows_of_map(task, arguments)
        steps_missing += some[0]
        between += some[1]
        beyond += some[2]
    missing[0], missing[1], missing[2] = steps_missing, between, beyond


@kernel
def rows_of_flow(sign, parameters, omega, steps, rows, lanes, out, ends, missing):
    """Fill rows as `rows_of_map` does, of states at times."""
    arguments = sign, parameters, omega, steps, rows, lanes, out, ends
    beyond = 0.0
    for task in prange(plan_of(lanes, out, rows[1] - rows[0] // GROUP * GROUP, GROUP)[0]):
        beyond += fill_rows_of_flow(task, arguments)[2]
    missing[2] = beyond


@kernel
def states_of_map(sign, parameters, omega, times, to, lanes, out, ends, missing):
    """Fill row to[j] with the states of number times[j]."""
    arguments = sign, parameters, omega, times, to, lanes, out, ends
    steps_missing, between, beyond = 0.0, 0.0, 0.0
    for task in prange(plan_of(lanes, out, times.size, 1)[0]):
        some = fill_states_of_map(task, arguments)
        steps_missing += some[0]
        between += some[1]
        beyond += some[2]
    missing[0], missing[1], missing[2] = steps_missing, between, beyond


@kernel
def states_of_flow(sign, parameters, omega, times, to, lanes, out, ends, missing):
    """Fill row to[j] with the states at times[j]."""
    arguments = sign, parameters, omega, times, to, lanes, out, ends
    beyond = 0.0
    for task in prange(plan_of(lanes, out, times.size, 1)[0]):
        beyond += fill_states_of_flow(task, arguments)[2]
    missing[2] = beyond
