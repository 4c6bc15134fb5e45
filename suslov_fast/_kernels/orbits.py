"""Blocks of orbits of the closed form: how they are entered, how those of a run end, and states
that are computed one by one. `closed_form_rows` computes all others, and explains the arguments.
"""

from collections import namedtuple

import numpy as np

from .._formulas import closed_form as formulas
from .._formulas import closed_form_states as states
from .._formulas.elementary import exponent, scaled
from .._formulas.units import Problem
from .._jit import allocation, formula, inner, lane, put, rows_of, select
from . import codes
from .lanes import spread

# A block of 64 orbits takes 60 KB.
LANES = 64
# Exponent of the largest state that certainly is finite.
LARGEST_EXPONENT = 1022.0

# What is known of the orbit of each lane: tuples of arrays. A `lane` of it is called an orbit.
Block = namedtuple("Block", "problem body start levels steps forms")
# Numbers of each lane.
#
# place, offset    number of rows of the block before that of the lane: in the output, and in time
# number           the number of steps, or the time
# recompute_from   size from which on a state is computed again
# usual_after      state 0 is given, and state 1 computed from it if this is 1
# power_left       exponent of the factor that multiplies states last, see `closed_form`
# fails            the first step without a state
# c, s             the pair at the last multiple of BASE rows; `c_or_0` is 0 for negligible c**2
# seed_...         that at the last multiple of GROUP rows; `table_...` those of several groups
RowLanes = namedtuple(
    "RowLanes",
    "place offset number recompute_from usual_after power_left fails "
    "c c_or_0 s seed_c seed_s table_c table_s",
)


@allocation
def block():
    return Block(
        rows_of(Problem, LANES),
        rows_of(formulas.Body, LANES),
        rows_of(formulas.Start, LANES),
        rows_of(formulas.Levels, LANES),
        rows_of(formulas.Steps, LANES),
        rows_of(formulas.Forms, LANES),
    )


@formula
def enter_bodies(b, parameters, first, width, used):
    """Give each lane the body and the step size of its trajectory."""
    for k in range(len(parameters)):
        row = b.problem[k]
        spread(parameters[k], first, width, row)
        for l in range(width, used):
            row[l] = row[l - width]
    for l in range(used):
        put(b.body, l, formulas.body(lane(b.problem, l)))


@formula
def enter(b, lanes, motion, used):
    """Fill the orbits of a block; return `any_kind`, and True if some states may have to be
    corrected.
    """
    back, flows = motion
    for l in range(used):
        body, omega1, omega2 = lane(b.body, l), b.problem.omega1[l], b.problem.omega2[l]
        put(b.start, l, formulas.start(back, flows, body, omega1, omega2))
    others, turning, recomputed, cancels = 0, 0, 0, 0
    for l in range(used):
        levels = formulas.levels(lane(b.start, l))
        put(b.levels, l, levels)
        cancels += select(formulas.cancels(levels), 1, 0)
    for l in range(used if cancels > 0 else 0):
        start, levels = lane(b.start, l), lane(b.levels, l)
        if formulas.cancels(levels):
            put(b.levels, l, formulas.accurate_levels(start, levels))
    for l in range(used):
        put(b.steps, l, formulas.steps(lane(b.start, l), lane(b.levels, l)))
    for l in range(0 if flows else used):
        root, lost, r = b.levels.root[l], b.levels.root_lost[l], b.levels.r[l]
        high, low = formulas.logarithm_of_ratio(root, lost, r)
        of_map = (b.start.discrete[l] > 0.0) & (b.steps.log_r[l] < 0.0) & (r != 0.0)
        b.steps.log_r[l] = select(of_map, high, b.steps.log_r[l])
        b.steps.log_lost[l] = select(of_map, low, b.steps.log_lost[l])
    for l in range(used):
        start, levels, steps = lane(b.start, l), lane(b.levels, l), lane(b.steps, l)
        if steps.kind == formulas.RESTS:
            put(b.forms, l, formulas.resting_forms(start, lane(b.problem, l)))
        else:
            put(b.forms, l, formulas.passing_forms(start, levels))
        size = formulas.recompute_from(start, levels, steps)
        power_left = select(steps.kind == formulas.RESTS, 0.0, formulas.power_left(start.power))
        lanes.recompute_from[l], lanes.power_left[l], lanes.fails[l] = size, power_left, np.inf
        lanes.usual_after[l] = usual_after = formulas.usual_after(start, steps)
        others += select(steps.kind > formulas.PASSES, 1, 0)
        turning += select(steps.kind == formulas.TURNS, 1, 0)
        recomputed += select((size < np.inf) | (power_left + usual_after != 0.0), 1, 0)
    if turning > 0:  # in two loops: a processor overlaps the lanes of a short one
        for l in range(used):  # `c` and `s` hold the tangent until there are rows
            lanes.c[l], lanes.s[l] = formulas.turning_tangent(lane(b.levels, l))
        for l in range(used):
            if b.steps.kind[l] == formulas.TURNS:
                start, levels = lane(b.start, l), lane(b.levels, l)
                tangent = lanes.c[l], lanes.s[l]
                b.steps.turns[l], b.steps.turns_lost[l] = formulas.turning(start, levels, tangent)
                b.steps.m_square[l] = -levels.square
    if others > 0:
        for l in range(used):
            start, levels, steps = lane(b.start, l), lane(b.levels, l), lane(b.steps, l)
            if steps.kind == formulas.TURNS:
                put(b.forms, l, formulas.turning_forms(start, levels, steps))
            elif steps.kind > formulas.PASSES:
                put(b.forms, l, formulas.near_forms(start, levels, 1.0))
    return others > 0, recomputed > 0


@inner
def state_at(orbit, power_left, n):
    """Return state n of an orbit: infinite or NaN if it does not exist."""
    forms = forms_of(orbit, select(n % 2.0 == 1.0, -1.0, 1.0))
    c, s = states.pair(n, orbit.steps, True)
    omega1, omega2 = states.omega_of(c, states.squarable(c), s, forms)
    if states.is_pole(c, s, forms):
        omega1, omega2 = np.nan, np.nan
    return scaled(omega1, power_left), scaled(omega2, power_left)


@formula
def forms_of(orbit, sign):
    """Return the forms of an even or odd number of steps, see `near_forms`."""
    if formulas.has_two_forms(orbit.steps):
        return formulas.near_forms(orbit.start, orbit.levels, sign)
    return orbit.forms


@formula
def first_missing(orbit, power_left, stop):
    """Return the index of the first state of an orbit with T >= 1 that does not exist, and True if
    it is infinite.
    """
    fails, infinite = np.inf, False
    for case in range(4):  # both zeros, for even and odd n
        forms = forms_of(orbit, 1.0 if case < 2 else -1.0)
        nearest = np.floor(states.step_to_pole(forms, orbit.steps, case % 2) + 0.5)
        for n in (nearest - 1.0, nearest, nearest + 1.0):
            if 1.0 <= n <= min(stop, fails - 1.0):
                omega1, omega2 = state_at(orbit, power_left, n)
                size = abs(omega1) + abs(omega2)
                if not size < np.inf:
                    fails, infinite = n, size == np.inf
    return fails, infinite


@inner
def end_of(orbit, power_left, stop):
    """Return the status of an orbit at step `stop`, and the index of its first missing state."""
    problem, _, start, levels, steps, _ = orbit
    if start.fate < 0.0:
        if start.fate == formulas.OUT_OF_RANGE:
            return codes.NEEDS_STEPS, np.inf
        return (codes.NONFINITE, 0.0) if start.fate == formulas.UNKNOWN else (codes.SINGULAR, 1.0)
    if start.fate == formulas.SUPERCRITICAL:
        if steps.kind == formulas.RESTS:
            return codes.SUPERCRITICAL, np.inf
        if steps.kind == formulas.TURNS:  # which of its steps comes next to a pole is not known
            return codes.NEEDS_STEPS, np.inf
        fails, infinite = first_missing(orbit, power_left, stop)
        code = codes.NONFINITE if infinite else codes.SINGULAR
        return code if fails < np.inf else codes.SUPERCRITICAL, fails
    if start.power > 0.0 and steps.kind != formulas.RESTS:
        # |z| = R sqrt(1 + X**2), and X is largest where Y = 0.
        T = start.discrete * levels.T
        X = start.discrete * (start.K + T) / ((1.0 - T) * (1.0 + T))
        least = min(problem.I1, problem.I2) / max(problem.I1, problem.I2)
        largest = levels.R * (1.0 + X) / np.sqrt(least)
        if exponent(largest) + 3.0 + start.power > LARGEST_EXPONENT:
            return codes.NEEDS_STEPS, np.inf
    return codes.OK, np.inf


@formula
def write_ends(b, lanes, first, width, used, ends):
    """Write statuses of trajectories; return True if any ends before the last step."""
    status, failed_at, stop = ends
    any_fails = False
    for l in range(width if len(status) else 0):
        code = codes.OK
        if b.start.fate[l] != formulas.REGULAR or b.start.power[l] > 0.0:
            code, lanes.fails[l] = end_of(lane(b, l), lanes.power_left[l], stop)
        status[first + l] = code
        if lanes.fails[l] < np.inf:
            failed_at[first + l] = int(lanes.fails[l])
            any_fails = True
    # The other rows of these trajectories.
    for l in range(width, used if any_fails else 0):
        lanes.fails[l] = lanes.fails[l - width]
    return any_fails


@formula
def count_unusual(lanes, used, tile):
    """Return how many states are missing, computed from state 0, or again, or to be scaled."""
    count = 0
    for l in range(used):
        usual = abs(tile[2 * l]) + abs(tile[2 * l + 1]) < lanes.recompute_from[l]
        usual = usual & (lanes.power_left[l] == 0.0)
        usual = (
            usual & (lanes.usual_after[l] < lanes.number[l]) & (lanes.number[l] < lanes.fails[l])
        )
        count += select(usual, 0, 1)
    return count


@inner
def corrected(orbit, at, omega1, omega2):
    """Return the state of a lane, computed again if it is unusual, and the column of `missing` that
    counts it if it is missing, else -1.
    """
    start, steps, n, column = orbit.start, orbit.steps, at.number, -1
    if n == 0.0:
        omega1, omega2 = orbit.problem.omega1, orbit.problem.omega2
    elif n == at.usual_after:
        omega1, omega2 = states.state_1(start)
        omega1, omega2 = scaled(omega1, at.power_left), scaled(omega2, at.power_left)
    elif abs(omega1) + abs(omega2) < at.recompute_from:
        omega1, omega2 = scaled(omega1, at.power_left), scaled(omega2, at.power_left)
    elif start.fate >= 0.0 and steps.kind != formulas.RESTS:
        omega1, omega2 = state_at(orbit, at.power_left, n)
    size = abs(omega1) + abs(omega2)
    if at.fails <= n < np.inf:
        omega1, omega2 = np.nan, np.nan
    elif not size < np.inf:
        omega1, omega2 = np.nan, np.nan
        unknown_phase = (
            steps.kind == formulas.TURNS and states.LONGEST_PHASE <= n * steps.turns < np.inf
        )
        if start.fate == formulas.OUT_OF_RANGE or size == np.inf or unknown_phase:
            column = 2
        elif start.fate != formulas.UNKNOWN:
            column = 0 if np.floor(n) == n and n <= states.EXACT else 1
    return omega1, omega2, column


@formula
def correct(b, lanes, l, tile, missing):
    """Compute the state of a lane if it is unusual; count it if it is missing."""
    omega1, omega2, column = corrected(lane(b, l), lane(lanes, l), tile[2 * l], tile[2 * l + 1])
    tile[2 * l], tile[2 * l + 1] = omega1, omega2
    if column >= 0:
        missing[column] += 1.0
