"""Blocks with orbits that neither rest nor pass: what differs from `orbits`, and the states that
are computed again because they may be poles.
"""

import numpy as np

from .._formulas import closed_form as formulas
from .._formulas import other_orbits as others
from .._formulas.elementary import LONGEST_PHASE, exponent, scaled
from .._jit import formula, inner, lane, put, select
from . import codes
from .lanes import whole

# Exponent of the largest state that certainly is finite.
LARGEST_EXPONENT = 1022.0


@formula
def refine(b, used):
    """Replace the steps, and levels that lose digits, of orbits that neither rest nor pass."""
    cancels = 0
    for l in range(used):
        cancels += select(formulas.cancels(lane(b.levels, l)), 1, 0)
    for l in range(used if cancels > 0 else 0):
        start, levels = lane(b.start, l), lane(b.levels, l)
        if formulas.cancels(levels):
            levels = others.accurate_levels(start, levels)
            put(b.levels, l, levels)
            put(b.steps, l, formulas.steps(start, levels))
    for l in range(used):
        put(b.steps, l, others.steps(lane(b.start, l), lane(b.levels, l), lane(b.steps, l)))


@formula
def enter_angles(b, lanes, used):
    """Fill the angles of orbits that turn."""
    turning = 0
    for l in range(used):
        turning += select(b.steps.kind[l] == others.TURNS, 1, 0)
    turning = used if turning > 0 else 0
    # In two loops: a processor overlaps the lanes of a short one.
    for l in range(turning):  # `c` and `s` hold the tangent until there are rows
        lanes.c[l], lanes.s[l] = others.turning_tangent(lane(b.levels, l))
    for l in range(turning):
        tangent = lanes.c[l], lanes.s[l]
        turns, lost = others.turning(lane(b.start, l), lane(b.levels, l), tangent)
        turns_here = b.steps.kind[l] == others.TURNS
        b.steps.turns[l] = select(turns_here, turns, 0.0)
        b.steps.turns_lost[l] = select(turns_here, lost, 0.0)


@formula
def replace_forms(b, lanes, used):
    """Replace the forms of orbits that neither rest nor pass, and fill what `correct` needs."""
    for l in range(used):
        start, levels, steps = lane(b.start, l), lane(b.levels, l), lane(b.steps, l)
        if steps.kind == others.NEAR:
            put(b.forms, l, others.near_forms(start, levels))
        elif steps.kind == others.TURNS:
            put(b.forms, l, others.turning_forms(start, levels))
        rests = steps.kind == formulas.RESTS
        lanes.recompute_from[l] = others.recompute_from(start, levels, steps)
        loses = others.loses_state_1(start) & ~formulas.is_missing(start)
        lanes.inexact[l] = select(loses, 1.0, -1.0)
        lanes.power_left[l] = select(rests, 0.0, formulas.power_left(start.power))
        lanes.fails[l] = np.inf


@inner
def state_at(orbit, power_left, n):
    """Return state n of an orbit: infinite or NaN if it does not exist."""
    c, s = others.pair(n, orbit.steps)
    omega1, omega2 = formulas.omega_of(c, s, orbit.forms)
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
def corrects(b, lanes, used):
    """Return True if states of a block may have to be corrected."""
    found = 0
    for l in range(used):
        usual = (lanes.recompute_from[l] == np.inf) & (lanes.power_left[l] == 0.0)
        usual = usual & (lanes.inexact[l] < 0.0) & ~formulas.is_missing(lane(b.start, l))
        found += select(usual, 0, 1)
    return found > 0


@formula
def correct(b, lanes, asked, count, tile, missing):
    """Compute unusual states of the first `count` lanes of a tile again, and count those that are
    missing; `asked` are the first offset that is asked for, and the end.
    """
    begin, end = asked
    unusual = 0
    for l in range(whole(count)):
        usual = abs(tile[2 * l]) + abs(tile[2 * l + 1]) < lanes.recompute_from[l]
        usual = usual & (lanes.power_left[l] == 0.0) & (lanes.number[l] < lanes.fails[l])
        unusual += select(usual & (lanes.number[l] != lanes.inexact[l]), 0, 1)
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
    if n == at.inexact:
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
            column = 0 if np.floor(n) == n and n <= formulas.LARGEST_COUNT else 1
    return omega1, omega2, column
