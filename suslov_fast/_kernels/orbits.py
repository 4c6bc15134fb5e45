"""Blocks of orbits for `closed_form_rows`, which explains the arguments."""

from collections import namedtuple

import numpy as np

from .._formulas import closed_form as formulas
from .._formulas.elementary import smaller
from .._formulas.units import ScaledState
from .._jit import inlined, lane, put, rows_of, select
from . import codes, other_orbits
from .lanes import all_share, spread, whole

# A block of 64 orbits takes 60 KB.
ROW_LANES = 64

# What is known of the orbit of each lane: tuples of arrays. A `lane` of it is called an orbit.
Block = namedtuple("Block", "problem body start levels steps forms")
# Numbers of each lane.
#
# place, offset    number of rows of the block before that of the lane: in the output, and in time
# number           the number of steps, or the time
# recompute_from   size from which on a state is computed again
# inexact          1 if the forms lose digits of state 1, else -1
# power_left       exponent of the factor that multiplies states last, see `closed_form`
# fails            the first step without a state
# c, s             the pair at the last multiple of BASE rows
# seed_...         that at the last multiple of GROUP rows; `table_...` those of several groups
RowLanes = namedtuple(
    "RowLanes",
    "place offset number recompute_from inexact power_left fails c s seed_c seed_s table_c table_s",
)


@inlined
def block():
    return Block(
        rows_of(ScaledState, ROW_LANES),
        rows_of(formulas.OrbitBody, ROW_LANES),
        rows_of(formulas.Start, ROW_LANES),
        rows_of(formulas.Levels, ROW_LANES),
        rows_of(formulas.Steps, ROW_LANES),
        rows_of(formulas.Forms, ROW_LANES),
    )


@inlined
def fill_lanes(b, lanes, omega, first, width, abreast, direction):
    """Give each lane a trajectory and a row, in the order of the output; return how many are used.

    Lanes beyond the last repeat trajectories.
    """
    used, states = whole(width * abreast), omega[first : first + width]
    omega1, omega2 = b.problem.omega1, b.problem.omega2
    for l in range(width):
        omega1[l], omega2[l] = states[l, 0], states[l, 1]
    for l in range(width, used):
        omega1[l], omega2[l] = omega1[l - width], omega2[l - width]
    for l in range(used):
        place = smaller(np.floor(l / width), abreast - 1.0)
        lanes.place[l], lanes.offset[l] = place, select(direction > 0, place, abreast - 1.0 - place)
    return used


@inlined
def enter_bodies(b, parameters, first, width, used):
    """Give each lane the body and the step size of its trajectory."""
    for k in range(len(parameters)):
        row = b.problem[k]
        spread(parameters[k], first, width, row)
        for l in range(width, used):
            row[l] = row[l - width]
    for l in range(used):
        put(b.body, l, formulas.body(lane(b.problem, l)))


@inlined
def enter_orbits(b, lanes, motion, used, others):
    """Fill the orbits of a block; return False if it is left."""
    back, flows = motion
    found = 0
    for l in range(used):
        body, omega1, omega2 = lane(b.body, l), b.problem.omega1[l], b.problem.omega2[l]
        put(b.start, l, formulas.start(back, flows, body, omega1, omega2))
    for l in range(used):
        start = lane(b.start, l)
        levels = formulas.levels(start)
        steps = formulas.steps(start, levels)
        put(b.levels, l, levels)
        put(b.steps, l, steps)
        found += select(formulas.is_other(start, levels, steps), 1, 0)
    if others is None and found > 0:
        return False
    if others is not None:
        other_orbits.refine(b, used)
    for l in range(0 if flows else used):
        b.steps.log_r[l], b.steps.log_lost[l] = formulas.with_logarithm(
            lane(b.start, l), lane(b.levels, l), b.steps.log_r[l], b.steps.log_lost[l]
        )
    for l in range(used):
        given = lane(b.problem, l)
        put(b.forms, l, formulas.forms(lane(b.start, l), lane(b.levels, l), given))
    if others is not None:
        other_orbits.enter_angles(b, lanes, used)
        other_orbits.replace_forms(b, lanes, used)
    return True


@inlined
def write_ends(b, lanes, ends, first, width, used, others):
    """Write statuses of trajectories, and where they end."""
    status, failed_at, stop = ends
    for l in range(width if len(status) else 0):
        code, fails, fate = codes.OK, np.inf, b.start.fate[l]
        if fate == formulas.UNKNOWN:
            code, fails = codes.NONFINITE, 0.0
        elif others is not None:
            if fate != formulas.REGULAR or b.start.power[l] > 0.0:
                code, fails = other_orbits.end_of(lane(b, l), lanes.power_left[l], stop)
            lanes.fails[l] = fails
        status[first + l] = code
        if fails < np.inf:
            failed_at[first + l] = int(fails)
    if others is not None:
        for l in range(width, used):  # the other rows of these trajectories
            lanes.fails[l] = lanes.fails[l - width]


@inlined
def enter(b, lanes, batch, place, entered, others):
    """Fill a block and write the statuses of its trajectories; return the number of its lanes.

    It is 0 if the block is left, or with `others`, if it is not. Lanes up to `entered` have a body,
    which they keep if all trajectories share one.
    """
    motion, parameters, omega, ends, left = batch
    first, width, abreast, direction = place
    found = 0
    for l in range(width):
        found += left[first + l]
    if (found > 0) == (others is None):
        return 0
    used = fill_lanes(b, lanes, omega, first, width, abreast, direction)
    if used > entered or not all_share(parameters):
        enter_bodies(b, parameters, first, width, used)
    if not enter_orbits(b, lanes, motion, used, others):
        for l in range(width):
            left[first + l] = 1
        return 0
    write_ends(b, lanes, ends, first, width, used, others)
    return used
