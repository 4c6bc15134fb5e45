"""States by the closed form, in rows of equal steps or at arbitrary times.

A lane of a block is a trajectory at a row or a time: few trajectories fill a block with several
rows, neighbours in the output. In rows of equal steps powers are computed directly every GROUP
rows, and multiplied twice in between: a state depends only on its orbit and its index.

Arguments of kernels, over a batch of B trajectories:

motion       1, or -1 for the inverse map and the flow backward in time, since all times are >= 0;
             and True for the flow
parameters   I1, I2, I13, I23, k and eps: (B,) each, or (1,) if common to all; for the flow eps is
             the unit of times
omega        (B, 2), the states at time 0
lanes        the first trajectory to compute, and the one after the last
out          (N, B, 2), the states; NaN if a state does not exist
ends         status, failed_at and the last step of a run whose trajectories end at a pole; for
             empty arrays the closed form continues past it
missing      (parts, 3), incremented by the numbers of NaN states of orbits whose state 0 is not
             NaN: at a step, between two steps, and out of the range of float64
"""

from typing import NamedTuple

import numpy as np

from .._formulas import closed_form as formulas
from .._formulas.closed_form import (
    EXACT,
    OUT_OF_RANGE,
    PASSES,
    REGULAR,
    RESTS,
    SUPERCRITICAL,
    TURNS,
    UNKNOWN,
    Forms,
    Levels,
    Passage,
    Start,
    Steps,
)
from .._formulas.elementary import scaled, smaller
from .._jit import formula, inner, kernel, lane, put, rows_of, select, share, stack
from . import codes
from .lanes import entry, whole
from .tiles import lead_of, missing_of_first_block, write_row

EIGHT, GROUP = 8, 64
# A block of 64 orbits takes 65 KB.
LANES = 64
_LINE = 2 * LANES
# States of one task.
TASK = 2**16
# A ratio w above 2**this at a multiple of GROUP rows is computed one by one.
LARGE_SEED = 200.0
# A w below this becomes 0, and its square earlier, since subnormal numbers are slow.
NEGLIGIBLE, NO_SQUARE = 2.0**-960, 2.0**-300
# The logarithm of the largest state that certainly is finite.
LARGEST_EXPONENT = 1022.0
# Beyond this number of steps phases are not known.
LONGEST_PHASE = 2.0**50
# The status of a trajectory that must be iterated.
NOT_FOUND = -3


class Problem(NamedTuple):
    """Bodies, step sizes and first states of the lanes."""

    I1: object
    I2: object
    I13: object
    I23: object
    k: object
    eps: object
    omega1: object
    omega2: object


class Rows(NamedTuple):
    """Lanes at some rows or times.

    place, offset    of the row in the output and in time, relative to the first
    eights, number   the multiple of eight in the offset; the time
    fails, slow      the first step without a state; 1 if states are computed one by one
    far              what states next to a pole exceed, and few others
    turns, odd       1 if an orbit does not pass; in which rows its r**n is negative
    w, r             the ratio of a `Passage`, and r, or 0 where its square is negligible
    c, s             the c and s of `Forms`
    seed_...         the same at multiples of GROUP rows, `table_...` of several groups
    eighths, ones    by how much they grow in multiples of eight rows, and in some rows
    """

    place: object
    offset: object
    eights: object
    number: object
    fails: object
    slow: object
    far: object
    turns: object
    w: object
    r: object
    c: object
    s: object
    seed_w: object
    seed_c: object
    seed_s: object
    seed_slow: object
    table_w: object
    table_c: object
    table_s: object
    table_slow: object
    eighths_c: object
    eighths_s: object
    ones_c: object
    ones_s: object
    odd: object


class Block(NamedTuple):
    problem: Problem
    start: Start
    levels: Levels
    steps: Steps
    passage: Passage
    forms: Forms
    odd: Forms


@formula
def row():
    """Return a number for each lane, on the stack."""
    return stack(LANES)


@formula
def table():
    """Return a number for each lane and each of eight rows, on the stack."""
    return stack(EIGHT, LANES)


@formula
def block():
    return Block(
        rows_of(Problem, LANES),
        rows_of(Start, LANES),
        rows_of(Levels, LANES),
        rows_of(Steps, LANES),
        rows_of(Passage, LANES),
        rows_of(Forms, LANES),
        rows_of(Forms, LANES),
    )


@formula
def rows_of_block():
    return Rows(
        row(), row(), row(), row(), row(), row(), row(), row(), row(), row(), row(),
        row(), row(), row(), row(), row(), row(), row(), row(), row(),
        table(), table(), table(), table(), table(),
    )  # fmt: skip


@formula
def not_negligible(v):
    """Return v, or 0 if it would soon be subnormal."""
    return select(abs(v) < NEGLIGIBLE, 0.0, v)


@formula
def plan_of(lanes, out, count, length, most):
    """Return the numbers of tasks, of tasks per block, of rows or times (of `count`) per task, of
    those side by side in a block, at most `most`, and by how much the first block is shorter.

    length   number of rows or times that take one entry of a block's tables.
    """
    batch, shift, abreast = lanes[1] - lanes[0], 0, 1
    while 2 * abreast * batch <= LANES and abreast < most:
        abreast *= 2
    if abreast == 1:
        shift = missing_of_first_block(lead_of(out), out.shape[1], 2)
    blocks = (batch + shift + LANES - 1) // LANES
    at_once = abreast * length
    some = max(TASK // (at_once * max(min(batch, LANES), 1)), 1) * at_once
    parts = (count + some - 1) // some
    return blocks * parts, parts, some, abreast, shift


@formula
def task_of(task, plan, lanes):
    """Return the first trajectory of a task, their number, and how many rows precede its own."""
    _, parts, some, _, shift = plan
    block = task // parts
    first = lanes[0] + max(block * LANES - shift, 0)
    width = min(lanes[0] + (block + 1) * LANES - shift, lanes[1]) - first
    return first, width, task % parts * some


@formula
def fill_lanes(problem, r, parameters, omega, first, width, abreast, direction):
    """Give each lane a trajectory and a row, in the order of the output; return the whole lanes.

    Lanes beyond the last repeat it.
    """
    I1, I2, I13, I23, k, eps = parameters
    lanes, place, i = whole(width * abreast), 0, 0
    for l in range(lanes):
        problem.I1[l], problem.I2[l] = entry(I1, first + i), entry(I2, first + i)
        problem.I13[l], problem.I23[l] = entry(I13, first + i), entry(I23, first + i)
        problem.k[l], problem.eps[l] = entry(k, first + i), entry(eps, first + i)
        problem.omega1[l], problem.omega2[l] = omega[first + i, 0], omega[first + i, 1]
        offset = place if direction > 0 else abreast - 1 - place
        r.place[l], r.offset[l], r.eights[l] = float(place), float(offset), float(offset // EIGHT)
        if i < width - 1:
            i += 1
        elif place < abreast - 1:
            i, place = 0, place + 1
    return lanes


@formula
def enter(b, r, motion, lanes):
    """Fill the orbits of a block; return the numbers of those that pass or rest, of those that do
    not, and of these those whose r**n has two signs, and those that may meet poles.
    """
    back, flows = motion
    for l in range(lanes):
        put(b.start, l, formulas.start(back, flows, lane(b.problem, l)))
    turning, alternating, meeting = 0, 0, 0
    for l in range(lanes):
        o = lane(b.start, l)
        e = formulas.levels(o)
        s = formulas.steps(o, e)
        put(b.levels, l, e)
        put(b.steps, l, s)
        put(b.passage, l, formulas.passage(o, e, s.kind, lane(b.problem, l)))
        turns = s.kind > PASSES
        r.turns[l], r.far[l] = select(turns, 1.0, 0.0), np.inf
        turning += select(turns, 1, 0)
        alternating += select(turns & (s.r < 0.0), 1, 0)
        meeting += select(turns & (o.fate == SUPERCRITICAL), 1, 0)
    if turning > 0:
        for l in range(lanes):
            o, e, s = lane(b.start, l), lane(b.levels, l), lane(b.steps, l)
            s = formulas.turning(o, e, s, lane(b.problem, l))
            put(b.steps, l, s)
            put(b.forms, l, formulas.forms(o, e, s, False))
            may_meet = r.turns[l] * o.fate == SUPERCRITICAL
            r.far[l] = select(may_meet, formulas.far_from_poles(o, e), np.inf)
    if alternating > 0:
        for l in range(lanes):
            o, e, s = lane(b.start, l), lane(b.levels, l), lane(b.steps, l)
            put(b.odd, l, formulas.forms(o, e, s, True))
    return lanes - turning, turning, alternating, meeting


@inner
def state_of(n, steps, passage, forms, unit):
    """Return state n of an orbit: infinite or NaN if it does not exist."""
    if steps.kind > PASSES:
        c, s = formulas.multiples(n, steps)
        omega1, omega2 = formulas.quotient(c, s, forms)
        if formulas.is_pole(c, s, forms):
            omega1, omega2 = np.nan, np.nan
    else:
        f, k = formulas.growth(n, steps, passage)
        omega1, omega2 = formulas.passing(f, k, steps.r, passage)
    rest = formulas.rest_of(unit)
    return scaled(omega1, rest), scaled(omega2, rest)


@formula
def state_at(b, l, n):
    """Return state n of the orbit in a lane."""
    steps = lane(b.steps, l)
    forms = lane(b.odd if formulas.is_odd(n, steps.r) else b.forms, l)
    return state_of(n, steps, lane(b.passage, l), forms, b.start.power[l])


@formula
def first_missing(b, l, stop):
    """Return the index of the first state of an orbit with T >= 1 that does not exist, and True if
    it is infinite.
    """
    fails, infinite, s = np.inf, False, lane(b.steps, l)
    for case in range(4):  # both zeros, for even and odd n
        h = lane(b.odd if case > 1 and s.r < 0.0 else b.forms, l)
        places = formulas.indices_of_poles(h.d11, h.d12, h.d22, s.root, s.log_r)
        nearest = np.floor((places[1] if case % 2 else places[0]) + 0.5)
        for n in (nearest - 1.0, nearest, nearest + 1.0):
            if 1.0 <= n <= min(stop, fails - 1.0):
                omega1, omega2 = state_at(b, l, n)
                size = abs(omega1) + abs(omega2)
                if not size < np.inf:
                    fails, infinite = n, size == np.inf
    return fails, infinite


@formula
def end_of(b, l, stop):
    """Return the status of an orbit at a step, and the index of its first missing state."""
    fate, kind, T = b.start.fate[l], b.steps.kind[l], b.levels.T[l]
    if fate < 0.0:
        if fate == OUT_OF_RANGE:
            return NOT_FOUND, np.inf
        return (codes.NONFINITE, 0.0) if fate == UNKNOWN else (codes.SINGULAR, 1.0)
    if fate == SUPERCRITICAL:
        if kind == RESTS:
            return codes.SUPERCRITICAL, np.inf
        if kind == TURNS:  # which of its steps comes next to a pole is not known
            return NOT_FOUND, np.inf
        fails, infinite = first_missing(b, l, stop)
        missing = codes.NONFINITE if infinite else codes.SINGULAR
        return missing if fails < np.inf else codes.SUPERCRITICAL, fails
    if b.start.power[l] > 0.0 and kind != RESTS:
        # |z| = R sqrt(1 + X**2), and X is largest where Y = 0.
        T, order = T * b.start.order[l], b.start.order[l]
        X = order * (b.start.K[l] + T) / ((1.0 - T) * (1.0 + T))
        least = min(b.problem.I1[l], b.problem.I2[l]) / max(b.problem.I1[l], b.problem.I2[l])
        largest = b.levels.R[l] * (1.0 + X) / np.sqrt(least)
        if np.log2(largest) + 2.0 + b.start.power[l] > LARGEST_EXPONENT:
            return NOT_FOUND, np.inf
    return codes.OK, np.inf


@formula
def write_ends(b, fails, first, width, lanes, ends):
    """Write statuses of trajectories; return True if any ends before the last step."""
    status, failed_at, stop = ends
    any_fails = False
    for l in range(width):
        code, fails_at = codes.OK, np.inf
        if b.start.fate[l] != REGULAR or b.start.power[l] > 0.0:
            code, fails_at = end_of(b, l, stop)
        fails[l], status[first + l] = fails_at, code
        if fails_at < np.inf:
            failed_at[first + l], any_fails = int(fails_at), True
    for l in range(width, lanes):
        fails[l] = fails[l - width]
    return any_fails


@formula
def mend(b, slow, l, n, line, missing):
    """Correct state n of lane l if it is slow, out of range, the first, or missing."""
    omega1, omega2 = line[2 * l], line[2 * l + 1]
    if slow:
        omega1, omega2 = state_at(b, l, n)
    elif b.steps.kind[l] != RESTS:
        rest = formulas.rest_of(b.start.power[l])
        omega1, omega2 = scaled(omega1, rest), scaled(omega2, rest)
    size, fate = abs(omega1) + abs(omega2), b.start.fate[l]
    if n == 0.0:
        omega1, omega2 = b.problem.omega1[l], b.problem.omega2[l]
    elif not size < np.inf:
        omega1, omega2 = np.nan, np.nan
        unknown_phase = b.steps.kind[l] == TURNS and LONGEST_PHASE < n < np.inf
        if fate == OUT_OF_RANGE or size == np.inf or unknown_phase:
            missing[2] += 1.0
        elif fate != UNKNOWN:
            missing[0 if np.floor(n) == n and n <= EXACT else 1] += 1.0
    line[2 * l], line[2 * l + 1] = omega1, omega2


@formula
def needs_mending(b, lanes):
    """Test that states may be out of range or missing, or are scaled last."""
    count = 0
    for l in range(lanes):
        fate, unit = b.start.fate[l], b.start.power[l]
        scales = (abs(unit) > formulas.PART_OF_COEFFICIENTS) & (b.steps.kind[l] != RESTS)
        count += select((fate < 0.0) | scales, 1, 0)
    return count > 0


@formula
def enter_ratios(b, r, lanes, first_number, every, turning):
    """Fill the growth between rows, and in which rows r**n is negative."""
    for a in range(EIGHT):
        for l in range(lanes):
            steps, s = 8.0 * (a + r.eights[l]) * every, lane(b.steps, l)
            p, k, sign = formulas.power_of_ratio(steps, s)
            r.eighths_c[a, l] = not_negligible(abs(sign) * scaled(1.0 + p, k))
        for l in range(lanes):
            steps, s = (a + (r.offset[l] - 8.0 * r.eights[l])) * every, lane(b.steps, l)
            p, k, sign = formulas.power_of_ratio(steps, s)
            r.ones_c[a, l] = not_negligible(abs(sign) * scaled(1.0 + p, k))
            r.odd[a, l] = select(formulas.is_odd(first_number + steps, s.r), r.turns[l], 0.0)
        for l in range(lanes if turning else 0):
            steps, s = 8.0 * (a + r.eights[l]) * every, lane(b.steps, l)
            c, r.eighths_s[a, l] = formulas.multiples(steps, s)
            r.eighths_c[a, l] = select(s.turns != 0.0, c, r.eighths_c[a, l])
        for l in range(lanes if turning else 0):
            steps, s = (a + (r.offset[l] - 8.0 * r.eights[l])) * every, lane(b.steps, l)
            c, r.ones_s[a, l] = formulas.multiples(steps, s)
            r.ones_c[a, l] = select(s.turns != 0.0, c, r.ones_c[a, l])


@formula
def enter_table(b, r, lanes, first_number, every, top, turning):
    """Fill the ratios or coefficients at the rows top + GROUP i; those of row i have the place of
    lanes of row i.
    """
    for l in range(lanes):
        n = first_number + every * (top + GROUP * r.place[l])
        f, k = formulas.growth(n, lane(b.steps, l), lane(b.passage, l))
        r.table_w[l] = not_negligible(scaled(f, smaller(k, LARGE_SEED)))
        r.table_slow[l] = select(k >= LARGE_SEED, 1.0, 0.0)
    if turning:
        for l in range(lanes):
            n = first_number + every * (top + GROUP * r.place[l])
            c, s = formulas.multiples(n, lane(b.steps, l))
            r.table_c[l], r.table_s[l] = not_negligible(c), s


@formula
def take_seeds(r, group, width, abreast, lanes, turning):
    """Take the seeds of one group of rows from the tables."""
    for i in range(width):
        w, slow = r.table_w[group * width + i], r.table_slow[group * width + i]
        for place in range(abreast):
            r.seed_w[place * width + i], r.seed_slow[place * width + i] = w, slow
    for i in range(width if turning else 0):
        c, s = r.table_c[group * width + i], r.table_s[group * width + i]
        for place in range(abreast):
            r.seed_c[place * width + i], r.seed_s[place * width + i] = c, s
    for l in range(width * abreast, lanes):
        r.seed_w[l], r.seed_slow[l], r.seed_c[l], r.seed_s[l] = 0.0, 0.0, 0.0, 0.0


@formula
def enter_eighth(b, r, lanes, a, turning):
    """Fill ratios and coefficients at one of eight rows; return how many lanes are slow there."""
    slow = 0
    for l in range(lanes):
        w = r.seed_w[l] * r.eighths_c[a, l]
        r.w[l], r.slow[l] = not_negligible(w), r.seed_slow[l]
        r.r[l] = select(abs(w) > NO_SQUARE, b.steps.r[l], 0.0)
        slow += select(r.slow[l] != 0.0, 1, 0)
    for l in range(lanes if turning else 0):
        c, s, square = r.seed_c[l], r.seed_s[l], b.steps.square[l]
        r.c[l], r.s[l] = product(c, s, r.eighths_c[a, l], r.eighths_s[a, l], square)
    return slow


@formula
def product(c, s, next_c, next_s, square):
    """c and s of `Forms` after the steps of both pairs."""
    return c * next_c - square * (s * next_s), s * select(square > 0.0, next_c, 1.0) + c * next_s


@formula
def fill_passing(b, r, lanes, row, line):
    """Compute the states of a row, and of those beside it, of orbits that pass."""
    o = b.passage
    for l in range(lanes):
        w = r.w[l] * r.ones_c[row, l]
        inverse = 1.0 / (1.0 + w * (r.r[l] * w - o.c[l]))
        line[2 * l] = o.rest1[l] + (o.a1[l] * w - o.b1[l]) * inverse
        line[2 * l + 1] = o.rest2[l] + (o.a2[l] * w - o.b2[l]) * inverse


@formula
def fill_turning(b, r, forms, chosen, lanes, row, line):
    """Compute the states of chosen orbits that do not pass."""
    for l in range(lanes):
        next_c, next_s, square = r.ones_c[row, l], r.ones_s[row, l], b.steps.square[l]
        c, s = product(r.c[l], r.s[l], next_c, next_s, square)
        omega1, omega2 = formulas.quotient(c, s, lane(forms, l))
        line[2 * l] = select(chosen[l] != 0.0, omega1, line[2 * l])
        line[2 * l + 1] = select(chosen[l] != 0.0, omega2, line[2 * l + 1])


@formula
def fill_line(b, r, kinds, lanes, row, line):
    passing, turning, alternating, _ = kinds
    if passing > 0:
        fill_passing(b, r, lanes, row, line)
    if turning > 0:
        fill_turning(b, r, b.forms, r.turns, lanes, row, line)
    if alternating > 0:
        fill_turning(b, r, b.odd, r.odd[row], lanes, row, line)


@formula
def count_slow(r, width, line):
    """Mark states that may be at a pole as slow; return how many are slow."""
    slow = 0
    for l in range(width):
        near = ~(abs(line[2 * l]) + abs(line[2 * l + 1]) < r.far[l])
        r.slow[l] = select(near, 1.0, r.seed_slow[l])
        slow += select(r.slow[l] != 0.0, 1, 0)
    return slow


@kernel
def fill_rows(part, parts, motion, parameters, omega, steps, rows, lanes, out, ends, missing):
    """Fill rows begin <= i < end: state first + every i goes to row origin + direction i.

    steps   first, every
    rows    begin, end, origin, direction
    """
    first_number, every = steps
    begin, end, origin, direction = rows
    low = begin // GROUP * GROUP
    plan = plan_of(lanes, out, end - low, GROUP, GROUP)
    tasks, _, some, abreast, _ = plan
    b, r, line = block(), rows_of_block(), stack(_LINE)
    flat, lead, batch = out.reshape(out.size), lead_of(out), out.shape[1]
    found, (first_task, last_task) = missing[part], share(tasks, part, parts)
    for task in range(first_task, last_task):
        first, width, skipped = task_of(task, plan, lanes)
        used = fill_lanes(b.problem, r, parameters, omega, first, width, abreast, direction)
        kinds = enter(b, r, motion, used)
        turning = kinds[1] > 0
        fails = write_ends(b, r.fails, first, width, used, ends) if ends[0].size else False
        mends = needs_mending(b, used)
        enter_ratios(b, r, used, first_number, every, turning)
        start = low + skipped
        for top in range(start, min(start + some, end), GROUP * abreast):
            enter_table(b, r, used, first_number, every, top, turning)
            for group in range(top, min(top + GROUP * abreast, end), GROUP):
                if group + GROUP <= begin:
                    continue
                take_seeds(r, (group - top) // GROUP, width, abreast, used, turning)
                for a in range(0, EIGHT, max(abreast // EIGHT, 1)):
                    slow = enter_eighth(b, r, used, a, turning) > 0
                    for one in range(0, EIGHT, abreast):
                        at = group + EIGHT * a + one
                        if at >= end or at + abreast <= begin:
                            continue
                        fill_line(b, r, kinds, used, one, line)
                        if kinds[3] > 0:
                            slow = count_slow(r, used, line) > 0
                        first_row = at == 0 and first_number == 0.0
                        for l in range(width * abreast if mends or slow or first_row else 0):
                            place = at + r.offset[l]
                            if begin <= place < end:
                                n = first_number + every * place
                                mend(b, r.slow[l] != 0.0, l, n, line, found)
                        for l in range(width * abreast if fails else 0):
                            if first_number + every * (at + r.offset[l]) >= r.fails[l]:
                                line[2 * l], line[2 * l + 1] = np.nan, np.nan
                        # Places in the output of the rows of this line.
                        low_place, high_place = max(begin - at, 0), min(end - at, abreast)
                        if direction < 0:
                            low_place, high_place = abreast - high_place, abreast - low_place
                        place = origin + direction * at - (abreast - 1 if direction < 0 else 0)
                        joined = high_place - low_place if width == batch else 1
                        for i in range(low_place, high_place, joined):
                            write_row(
                                line[2 * width * i :],
                                flat,
                                2 * ((place + i) * batch + first),
                                2 * width * joined,
                                2 * direction * batch * abreast,
                                lead,
                            )


@kernel
def fill_states(part, parts, motion, parameters, omega, times, to, lanes, out, ends, missing):
    """Fill row to[j] with the states at times[j], which are numbers of steps of the map."""
    plan = plan_of(lanes, out, times.size, 1, min(times.size, LANES))
    tasks, _, some, abreast, _ = plan
    b, r, line = block(), rows_of_block(), stack(_LINE)
    flat, lead, batch = out.reshape(out.size), lead_of(out), out.shape[1]
    found, (first_task, last_task) = missing[part], share(tasks, part, parts)
    for task in range(first_task, last_task):
        first, width, skipped = task_of(task, plan, lanes)
        used = fill_lanes(b.problem, r, parameters, omega, first, width, abreast, 1)
        kinds = enter(b, r, motion, used)
        turning = kinds[1] > 0
        fails = write_ends(b, r.fails, first, width, used, ends) if ends[0].size else False
        mends = needs_mending(b, used) or fails
        for j in range(skipped, min(skipped + some, times.size), abreast):
            for l in range(used):
                r.number[l] = times[min(j + int(r.offset[l]), times.size - 1)]
                r.seed_slow[l] = select(r.number[l] == 0.0, 1.0, 0.0)
            for l in range(used):
                o, s = lane(b.passage, l), lane(b.steps, l)
                f, k = formulas.growth(r.number[l], s, o)
                line[2 * l], line[2 * l + 1] = formulas.passing(f, k, s.r, o)
            if turning:
                for l in range(used):
                    s = lane(b.steps, l)
                    r.c[l], r.s[l] = formulas.multiples(r.number[l], s)
                    r.ones_c[0, l], r.ones_s[0, l] = 1.0, 0.0
                    r.odd[0, l] = select(formulas.is_odd(r.number[l], s.r), r.turns[l], 0.0)
                fill_line(b, r, (0, *kinds[1:]), used, 0, line)
            slow, count = count_slow(r, used, line), width * min(abreast, times.size - j)
            for l in range(count if slow > 0 or mends else 0):
                mend(b, r.slow[l] != 0.0, l, r.number[l], line, found)
                if fails and r.number[l] >= r.fails[l]:
                    line[2 * l], line[2 * l + 1] = np.nan, np.nan
            for i in range(count // width):
                target = 2 * (to[j + i] * batch + first)
                write_row(line[2 * width * i :], flat, target, 2 * width, 0, lead)
