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
    Start,
    Steps,
)
from .._formulas.elementary import scaled
from .._formulas.units import Problem
from .._jit import formula, inner, kernel, lane, put, rows_of, select, share, stack
from . import codes
from .lanes import entry, whole
from .tiles import lead_of, missing_of_first_block, write_row

EIGHT, GROUP = 8, 64
# A block of 64 orbits takes 60 KB.
LANES = 64
_LINE = 2 * LANES
# States of one task.
TASK = 2**16
# A ratio below this becomes 0, since subnormal numbers are slow.
NEGLIGIBLE = 2.0**-960
# The logarithm of the largest state that certainly is finite.
LARGEST_EXPONENT = 1022.0
# Beyond this number of steps phases are not known.
LONGEST_PHASE = 2.0**50
# The status of a trajectory that must be iterated.
NOT_FOUND = -3


class Block(NamedTuple):
    problem: Problem
    start: Start
    levels: Levels
    steps: Steps
    forms: Forms


class Rows(NamedTuple):
    """Lanes at some rows or times.

    place, offset    of the row in the output and in time, relative to the first
    number           the number of steps, or the time
    exact            the size from which on states are computed one by one
    rest             the part of the unit of states that multiplies them last
    fails            the first step without a state
    c, s             the coordinates of states
    seed_...         the same at multiples of GROUP rows, `table_...` of several groups
    """

    place: object
    offset: object
    number: object
    exact: object
    rest: object
    fails: object
    c: object
    s: object
    seed_c: object
    seed_s: object
    table_c: object
    table_s: object


class Growth(NamedTuple):
    """By how much c and s grow in multiples of eight rows, and in some rows."""

    eights_c: object
    eights_s: object
    ones_c: object
    ones_s: object


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
        rows_of(Forms, LANES),
    )


@formula
def plan_of(lanes, out, count, length, most):
    """Return the numbers of tasks, of tasks per block, of rows or times (of `count`) per task, of
    those side by side in a block, at most `most`, and by how much the first block is shorter.

    length   number of rows or times that take one entry of a block's tables.
    """
    batch, shift, abreast = lanes[1] - lanes[0], 0, 1
    while 2 * abreast * batch <= LANES and abreast < most and batch == out.shape[1]:
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
        r.place[l], r.offset[l] = place, place if direction > 0 else abreast - 1 - place
        if i < width - 1:
            i += 1
        elif place < abreast - 1:
            i, place = 0, place + 1
    return lanes


@formula
def enter(b, r, motion, lanes):
    """Fill the orbits of a block; return True if some neither pass nor rest, and True if some
    states may have to be computed one by one.

    The first is the argument `others` of the loops below: as a constant, so that a loop over orbits
    that pass computes no sines.
    """
    back, flows = motion
    for l in range(lanes):
        put(b.start, l, formulas.start(back, flows, lane(b.problem, l)))
    others, turning, special = 0, 0, 0
    for l in range(lanes):
        o = lane(b.start, l)
        e = formulas.levels(o)
        s = formulas.steps(o, e)
        put(b.levels, l, e)
        put(b.steps, l, s)
        put(b.forms, l, formulas.forms(o, e, s, lane(b.problem, l)))
        r.exact[l], r.fails[l] = formulas.exact_size(o, e, s), np.inf
        r.rest[l] = select(s.kind == RESTS, 0.0, formulas.rest_of(o.power))
        others += select(s.kind > PASSES, 1, 0)
        turning += select(s.kind == TURNS, 1, 0)
        special += select((r.exact[l] < np.inf) | (r.rest[l] != 0.0), 1, 0)
    if turning > 0:
        for l in range(lanes):
            s = formulas.turning(lane(b.start, l), lane(b.levels, l), lane(b.steps, l))
            put(b.steps, l, s)
    if others > 0:
        for l in range(lanes):
            o, e, s = lane(b.start, l), lane(b.levels, l), lane(b.steps, l)
            put(b.forms, l, formulas.other_forms(o, e, s, lane(b.forms, l), False))
    return others > 0, special > 0


@inner
def state_of(n, steps, forms, rest):
    """Return state n of an orbit: infinite or NaN if it does not exist."""
    c, s = formulas.pair(n, steps, True)
    omega1, omega2 = formulas.quotient(c, s, forms)
    if formulas.is_pole(c, s, forms):
        omega1, omega2 = np.nan, np.nan
    return scaled(omega1, rest), scaled(omega2, rest)


@formula
def forms_of(b, l, odd):
    """Return the forms of an even or odd number of steps."""
    o, e, s, forms = lane(b.start, l), lane(b.levels, l), lane(b.steps, l), lane(b.forms, l)
    return formulas.other_forms(o, e, s, forms, odd) if formulas.has_two_forms(s) else forms


@formula
def state_at(b, r, l, n):
    """Return state n of the orbit in a lane."""
    return state_of(n, lane(b.steps, l), forms_of(b, l, n % 2.0 == 1.0), r.rest[l])


@formula
def first_missing(b, r, l, stop):
    """Return the index of the first state of an orbit with T >= 1 that does not exist, and True if
    it is infinite.
    """
    fails, infinite = np.inf, False
    for case in range(4):  # both zeros, for even and odd n
        forms = forms_of(b, l, case > 1)
        nearest = np.floor(formulas.step_to_pole(forms, lane(b.steps, l), case % 2) + 0.5)
        for n in (nearest - 1.0, nearest, nearest + 1.0):
            if 1.0 <= n <= min(stop, fails - 1.0):
                omega1, omega2 = state_at(b, r, l, n)
                size = abs(omega1) + abs(omega2)
                if not size < np.inf:
                    fails, infinite = n, size == np.inf
    return fails, infinite


@formula
def end_of(b, r, l, stop):
    """Return the status of an orbit at a step, and the index of its first missing state."""
    fate, kind, e = b.start.fate[l], b.steps.kind[l], lane(b.levels, l)
    if fate < 0.0:
        if fate == OUT_OF_RANGE:
            return NOT_FOUND, np.inf
        return (codes.NONFINITE, 0.0) if fate == UNKNOWN else (codes.SINGULAR, 1.0)
    if fate == SUPERCRITICAL:
        if kind == RESTS:
            return codes.SUPERCRITICAL, np.inf
        if kind == TURNS:  # which of its steps comes next to a pole is not known
            return NOT_FOUND, np.inf
        fails, infinite = first_missing(b, r, l, stop)
        missing = codes.NONFINITE if infinite else codes.SINGULAR
        return missing if fails < np.inf else codes.SUPERCRITICAL, fails
    if b.start.power[l] > 0.0 and kind != RESTS:
        # |z| = R sqrt(1 + X**2), and X is largest where Y = 0.
        T, order = e.T * b.start.order[l], b.start.order[l]
        X = order * (b.start.K[l] + T) / ((1.0 - T) * (1.0 + T))
        least = min(b.problem.I1[l], b.problem.I2[l]) / max(b.problem.I1[l], b.problem.I2[l])
        largest = e.R * (1.0 + X) / np.sqrt(least)
        if np.log2(largest) + 2.0 + b.start.power[l] > LARGEST_EXPONENT:
            return NOT_FOUND, np.inf
    return codes.OK, np.inf


@formula
def write_ends(b, r, first, width, lanes, ends):
    """Write statuses of trajectories; return True if any ends before the last step."""
    status, failed_at, stop = ends
    any_fails = False
    for l in range(width if len(status) else 0):
        code = codes.OK
        if b.start.fate[l] != REGULAR or b.start.power[l] > 0.0:
            code, r.fails[l] = end_of(b, r, l, stop)
        status[first + l] = code
        if r.fails[l] < np.inf:
            failed_at[first + l], r.exact[l], any_fails = int(r.fails[l]), 0.0, True
    for l in range(width, lanes if any_fails else 0):
        r.fails[l], r.exact[l] = r.fails[l - width], r.exact[l - width]
    return any_fails


@formula
def count_unusual(r, width, line):
    """Return how many states are computed one by one: see `exact_size`, and state 0."""
    count = 0
    for l in range(width):
        usual = (abs(line[2 * l]) + abs(line[2 * l + 1]) < r.exact[l]) & (r.rest[l] == 0.0)
        count += select(usual & (r.number[l] > 0.0), 0, 1)
    return count


@formula
def correct(b, r, l, line, missing):
    """Compute the state of a lane if it is unusual; count it if it is missing."""
    n, omega1, omega2 = r.number[l], line[2 * l], line[2 * l + 1]
    fate, kind = b.start.fate[l], b.steps.kind[l]
    if n == 0.0:
        omega1, omega2 = b.problem.omega1[l], b.problem.omega2[l]
    elif abs(omega1) + abs(omega2) < r.exact[l]:
        omega1, omega2 = scaled(omega1, r.rest[l]), scaled(omega2, r.rest[l])
    elif fate >= 0.0 and kind != RESTS:
        omega1, omega2 = state_at(b, r, l, n)
    size = abs(omega1) + abs(omega2)
    if r.fails[l] <= n < np.inf:
        omega1, omega2 = np.nan, np.nan
    elif not size < np.inf:
        omega1, omega2 = np.nan, np.nan
        unknown_phase = kind == TURNS and LONGEST_PHASE < n < np.inf
        if fate == OUT_OF_RANGE or size == np.inf or unknown_phase:
            missing[2] += 1.0
        elif fate != UNKNOWN:
            missing[0 if np.floor(n) == n and n <= EXACT else 1] += 1.0
    line[2 * l], line[2 * l + 1] = omega1, omega2


@formula
def not_negligible(v):
    """Return v, or 0 if it would soon be subnormal."""
    return select(abs(v) < NEGLIGIBLE, 0.0, v)


@formula
def enter_growth(b, r, g, lanes, every, others):
    """Fill the growth between rows."""
    for a in range(EIGHT):
        for l in range(lanes):
            steps, eights = lane(b.steps, l), np.floor(0.125 * r.offset[l])
            c, s = formulas.growth(8.0 * (a + eights) * every, steps, others)
            g.eights_c[a, l], g.eights_s[a, l] = not_negligible(c), s
            c, s = formulas.growth((a + r.offset[l] - 8.0 * eights) * every, steps, others)
            g.ones_c[a, l], g.ones_s[a, l] = not_negligible(c), s


@formula
def enter_table(b, r, lanes, first_number, every, top, others):
    """Fill the coordinates at the rows top + GROUP i, row i in the place of lanes of row i; return
    True if some are not known, or are pairs of a large ratio.
    """
    unusual = 0
    for l in range(lanes):
        steps = lane(b.steps, l)
        c, s = formulas.pair(first_number + every * (top + GROUP * r.place[l]), steps, others)
        c = select((steps.kind == PASSES) & (s < 1.0), np.inf, c)
        r.table_c[l], r.table_s[l] = not_negligible(c), s
        unusual += select(abs(c) < np.inf, 0, 1)
    return unusual > 0


@formula
def take_seeds(r, group, width, abreast, lanes, others):
    """Take the seeds of one group of rows from the tables."""
    for i in range(width):
        c = r.table_c[group * width + i]
        for place in range(abreast):
            r.seed_c[place * width + i] = c
    for i in range(width if others else 0):
        s = r.table_s[group * width + i]
        for place in range(abreast):
            r.seed_s[place * width + i] = s
    for l in range(width * abreast, lanes):
        r.seed_c[l], r.seed_s[l] = 0.0, 0.0


@formula
def fill_line(b, r, g, lanes, row, others, line):
    """Compute the states of a row of a group, and of those beside it."""
    if row % EIGHT == 0:
        for l in range(lanes):
            next_c = g.eights_c[row // EIGHT, l]
            c = r.seed_c[l] * next_c
            if others:
                next_s, square = g.eights_s[row // EIGHT, l], b.steps.square[l]
                c, r.s[l] = formulas.product(r.seed_c[l], r.seed_s[l], next_c, next_s, square)
            r.c[l] = not_negligible(c)
    for l in range(lanes):
        next_c, s = g.ones_c[row % EIGHT, l], 1.0
        c = r.c[l] * next_c
        if others:
            next_s, square = g.ones_s[row % EIGHT, l], b.steps.square[l]
            c, s = formulas.product(r.c[l], r.s[l], next_c, next_s, square)
        line[2 * l], line[2 * l + 1] = formulas.quotient(c, s, lane(b.forms, l))


@formula
def fill_line_at_times(b, r, lanes, others, line):
    """Compute the states at the times of the lanes."""
    for l in range(lanes):
        c, s = formulas.pair(r.number[l], lane(b.steps, l), others)
        line[2 * l], line[2 * l + 1] = formulas.quotient(c, s, lane(b.forms, l))


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
    b, r, g = block(), rows_of(Rows, LANES), Growth(table(), table(), table(), table())
    flat, lead, line = out.reshape(out.size), lead_of(out), stack(_LINE)
    found, (first_task, last_task) = missing[part], share(tasks, part, parts)
    for task in range(first_task, last_task):
        first, width, skipped = task_of(task, plan, lanes)
        used = fill_lanes(b.problem, r, parameters, omega, first, width, abreast, direction)
        others, special = enter(b, r, motion, used)
        special |= write_ends(b, r, first, width, used, ends)
        if others:
            enter_growth(b, r, g, used, every, True)
        else:
            enter_growth(b, r, g, used, every, False)
        start = low + skipped
        for top in range(start, min(start + some, end), GROUP * abreast):
            if others:
                unusual = enter_table(b, r, used, first_number, every, top, True)
            else:
                unusual = enter_table(b, r, used, first_number, every, top, False)
            for at in range(top, min(top + GROUP * abreast, end), abreast):
                row = (at - top) % GROUP
                if row == 0:
                    take_seeds(r, (at - top) // GROUP, width, abreast, used, others)
                if others:
                    fill_line(b, r, g, used, row, True, line)
                else:
                    fill_line(b, r, g, used, row, False, line)
                if at + abreast <= begin:
                    continue
                if special or unusual or (at == 0 and first_number == 0.0):
                    for l in range(used):
                        r.number[l] = first_number + every * (at + r.offset[l])
                    for l in range(width * abreast if count_unusual(r, used, line) else 0):
                        if begin <= at + r.offset[l] < end:
                            correct(b, r, l, line, found)
                # Places in the line of the rows asked for.
                low_place, high_place = max(begin - at, 0), min(end - at, abreast)
                if direction < 0:
                    low_place, high_place = abreast - high_place, abreast - low_place
                place = origin + direction * at - (abreast - 1 if direction < 0 else 0)
                write_row(
                    line[2 * width * low_place :],
                    flat,
                    2 * ((place + low_place) * out.shape[1] + first),
                    2 * width * (high_place - low_place),
                    2 * direction * out.shape[1] * abreast,
                    lead,
                )


@kernel
def fill_states(part, parts, motion, parameters, omega, times, to, lanes, out, ends, missing):
    """Fill row to[j] with the states at times[j], which are numbers of steps of the map."""
    plan = plan_of(lanes, out, times.size, 1, min(times.size, LANES))
    tasks, _, some, abreast, _ = plan
    b, r, line = block(), rows_of(Rows, LANES), stack(_LINE)
    flat, lead = out.reshape(out.size), lead_of(out)
    found, (first_task, last_task) = missing[part], share(tasks, part, parts)
    for task in range(first_task, last_task):
        first, width, skipped = task_of(task, plan, lanes)
        used = fill_lanes(b.problem, r, parameters, omega, first, width, abreast, 1)
        others, _ = enter(b, r, motion, used)
        write_ends(b, r, first, width, used, ends)
        for j in range(skipped, min(skipped + some, times.size), abreast):
            for l in range(used):
                r.number[l] = times[min(j + int(r.offset[l]), times.size - 1)]
            if others:
                fill_line_at_times(b, r, used, True, line)
            else:
                fill_line_at_times(b, r, used, False, line)
            count = width * min(abreast, times.size - j)
            for l in range(count if count_unusual(r, used, line) else 0):
                correct(b, r, l, line, found)
            for i in range(count // width):
                target = 2 * (to[j + i] * out.shape[1] + first)
                write_row(line[2 * width * i :], flat, target, 2 * width, 0, lead)
