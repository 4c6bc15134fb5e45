"""Blocks with orbits that neither rest nor pass, as `orbits`; states that may be poles."""

import numpy as np

from .._formulas import closed_form as formulas
from .._formulas import closed_form_states as states
from .._formulas import other_orbits as others
from .._formulas.elementary import LONGEST_PHASE, exponent, scaled
from .._jit import formula, inner, lane, put, select
from . import codes
from .lanes import whole
from .orbits import enter_forms, enter_logarithms, enter_orbits

# Exponent of the largest state that certainly is finite.
LARGEST_EXPONENT = 1022.0

pairs = others


@formula
def takes(left, first, width):
    found = 0
    for l in range(width):
        found += left[first + l]
    return found > 0


@formula
def fill_block(b, lanes, motion, left, first, width, used):
    enter_orbits(b, motion, used)
    cancels, turning = 0, 0
    for l in range(used):
        cancels += select(formulas.cancels(lane(b.levels, l)), 1, 0)
    for l in range(used if cancels > 0 else 0):
        start, levels = lane(b.start, l), lane(b.levels, l)
        if formulas.cancels(levels):
            levels = others.accurate_levels(start, levels)
            put(b.levels, l, levels)
            put(b.steps, l, formulas.steps(start, levels))
    for l in range(used):
        steps = others.steps(lane(b.start, l), lane(b.levels, l), lane(b.steps, l))
        put(b.steps, l, steps)
        turning += select(steps.kind == others.TURNS, 1, 0)
    enter_logarithms(b, motion, used)
    if turning > 0:  # in two loops: a processor overlaps the lanes of a short one
        for l in range(used):  # `c` and `s` hold the tangent until there are rows
            lanes.c[l], lanes.s[l] = others.turning_tangent(lane(b.levels, l))
        for l in range(used):
            tangent = lanes.c[l], lanes.s[l]
            turns, lost = others.turning(lane(b.start, l), lane(b.levels, l), tangent)
            turns_here = b.steps.kind[l] == others.TURNS
            b.steps.turns[l] = select(turns_here, turns, 0.0)
            b.steps.turns_lost[l] = select(turns_here, lost, 0.0)
    enter_forms(b, used)
    for l in range(used):
        start, levels, steps = lane(b.start, l), lane(b.levels, l), lane(b.steps, l)
        if steps.kind == others.NEAR:
            put(b.forms, l, others.near_forms(start, levels))
        elif steps.kind == others.TURNS:
            put(b.forms, l, others.turning_forms(start, levels))
        rests = steps.kind == formulas.RESTS
        lanes.recompute_from[l] = others.recompute_from(start, levels, steps)
        lanes.power_left[l] = select(rests, 0.0, formulas.power_left(start.power))
        lanes.fails[l] = np.inf
    return True


@inner
def state_at(orbit, power_left, n):
    """Return state n of an orbit: infinite or NaN if it does not exist."""
    c, s = others.pair(n, orbit.steps)
    omega1, omega2 = states.omega_of(c, s, orbit.forms)
    if others.is_pole(c, s, orbit.forms):
        omega1, omega2 = np.nan, np.nan
    return scaled(omega1, power_left), scaled(omega2, power_left)


@formula
def first_missing(orbit, power_left, stop):
    """Return the index of the first state of an orbit with T >= 1 that does not exist, and True if
    it is infinite.
    """
    fails, infinite = np.inf, False
    for second in range(2):
        nearest = np.floor(others.step_to_pole(orbit.forms, orbit.steps, second) + 0.5)
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
    fate, rests = start.fate, steps.kind == formulas.RESTS
    if fate == formulas.BEYOND_RANGE:
        return codes.NEEDS_STEPS, np.inf
    if fate == formulas.UNKNOWN:
        return codes.NONFINITE, 0.0
    if fate == formulas.UNDEFINED:
        return codes.SINGULAR, 1.0
    if fate == formulas.JUMPING:
        if rests:
            return codes.SUPERCRITICAL, np.inf
        if steps.kind == others.TURNS:  # which of its steps comes next to a pole is not known
            return codes.NEEDS_STEPS, np.inf
        fails, infinite = first_missing(orbit, power_left, stop)
        code = codes.NONFINITE if infinite else codes.SINGULAR
        return code if fails < np.inf else codes.SUPERCRITICAL, fails
    if start.power > 0.0 and not rests:
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


@formula
def corrects(b, lanes, used):
    found = 0
    for l in range(used):
        start = lane(b.start, l)
        usual = (lanes.recompute_from[l] == np.inf) & (lanes.power_left[l] == 0.0)
        usual = usual & ~(formulas.is_missing(start) | others.loses_state_1(start))
        found += select(usual, 0, 1)
    return found > 0


@formula
def correct(b, lanes, asked, count, tile, missing):
    begin, end = asked
    unusual = 0
    for l in range(whole(count)):
        usual = abs(tile[2 * l]) + abs(tile[2 * l + 1]) < lanes.recompute_from[l]
        usual = usual & (lanes.power_left[l] == 0.0) & (lanes.number[l] < lanes.fails[l])
        loses = (lanes.number[l] == 1.0) & others.loses_state_1(lane(b.start, l))
        unusual += select(usual & ~loses, 0, 1)
    for l in range(count if unusual > 0 else 0):
        if begin <= lanes.offset[l] < end and lanes.number[l] != 0.0:
            omega1, omega2, column = corrected(
                lane(b, l), lane(lanes, l), tile[2 * l], tile[2 * l + 1]
            )
            tile[2 * l], tile[2 * l + 1] = omega1, omega2
            if column >= 0:
                missing[column] += 1.0


@inner
def corrected(orbit, at, omega1, omega2):
    """Return the state of a lane, computed again if it is unusual, and the column of `missing` that
    counts it if it is missing, else -1.
    """
    start, steps, n, column = orbit.start, orbit.steps, at.number, -1
    if n == 1.0 and others.loses_state_1(start) and not formulas.is_missing(start):
        omega1, omega2 = others.state_1(start)
        omega1, omega2 = scaled(omega1, at.power_left), scaled(omega2, at.power_left)
    elif abs(omega1) + abs(omega2) < at.recompute_from:
        omega1, omega2 = scaled(omega1, at.power_left), scaled(omega2, at.power_left)
    elif steps.kind != formulas.RESTS:
        omega1, omega2 = state_at(orbit, at.power_left, n)
    size = abs(omega1) + abs(omega2)
    if at.fails <= n < np.inf:
        omega1, omega2 = np.nan, np.nan
    elif not size < np.inf:
        omega1, omega2 = np.nan, np.nan
        unknown_phase = steps.kind == others.TURNS and LONGEST_PHASE <= n * steps.turns < np.inf
        if start.fate == formulas.BEYOND_RANGE or size == np.inf or unknown_phase:
            column = 2
        elif start.fate != formulas.UNKNOWN:
            column = 0 if np.floor(n) == n and n <= states.LARGEST_COUNT else 1
    return omega1, omega2, column
