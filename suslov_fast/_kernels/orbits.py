"""Blocks of orbits that rest or pass, for `closed_form_rows`, which explains the arguments.

The kernel of these orbits leaves a block with another one to that of `other_orbits`, a kernel of
its own, which is compiled when a batch first has such an orbit, and computes the same bits for
orbits that rest or pass.
"""

from collections import namedtuple

from .._formulas import closed_form as formulas
from .._formulas import closed_form_states
from .._formulas.units import ScaledState
from .._jit import formula, inlined, lane, put, rows_of, select
from . import codes
from .lanes import spread

# A block of 64 orbits takes 60 KB.
ROW_LANES = 64

# What is known of the orbit of each lane: tuples of arrays. A `lane` of it is called an orbit.
Block = namedtuple("Block", "problem body start levels steps forms")
# Numbers of each lane.
#
# place, offset    number of rows of the block before that of the lane: in the output, and in time
# number           the number of steps, or the time
# recompute_from   size from which on a state is computed again
# power_left       exponent of the factor that multiplies states last, see `closed_form`
# fails            the first step without a state
# c, s             the pair at the last multiple of BASE rows
# seed_...         that at the last multiple of GROUP rows; `table_...` those of several groups
RowLanes = namedtuple(
    "RowLanes",
    "place offset number recompute_from power_left fails c s seed_c seed_s table_c table_s",
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
def enter_orbits(b, motion, used):
    """Fill a block, as if its orbits rest or pass; return how many do not."""
    back, flows = motion
    others = 0
    for l in range(used):
        body, omega1, omega2 = lane(b.body, l), b.problem.omega1[l], b.problem.omega2[l]
        put(b.start, l, formulas.start(back, flows, body, omega1, omega2))
    for l in range(used):
        start = lane(b.start, l)
        levels = formulas.levels(start)
        steps = formulas.steps(start, levels)
        put(b.levels, l, levels)
        put(b.steps, l, steps)
        others += select(formulas.is_other(start, levels, steps), 1, 0)
    return others


@formula
def enter_logarithms(b, motion, used):
    """Fill the logarithms of the ratios of a map."""
    _, flows = motion
    for l in range(0 if flows else used):
        b.steps.log_r[l], b.steps.log_lost[l] = formulas.with_logarithm(
            lane(b.start, l), lane(b.levels, l), b.steps.log_r[l], b.steps.log_lost[l]
        )


@formula
def enter_forms(b, used):
    """Fill the forms, as if all orbits rest or pass."""
    for l in range(used):
        given = lane(b.problem, l)
        put(b.forms, l, formulas.forms(lane(b.start, l), lane(b.levels, l), given))


# What `closed_form_rows` takes from this module or from `other_orbits`.

pairs = closed_form_states  # functions of pairs (c, s)


@formula
def takes(left, first, width):
    """Return True if a block is to be computed."""
    return True


@formula
def fill_block(b, lanes, motion, left, first, width, used):
    """Fill a block of orbits; return False if it is left."""
    if enter_orbits(b, motion, used) > 0:
        for l in range(width):
            left[first + l] = 1
        return False
    enter_logarithms(b, motion, used)
    enter_forms(b, used)
    return True


@formula
def write_ends(b, lanes, first, width, used, ends):
    """Write statuses of trajectories, and where they end."""
    status, failed_at, _ = ends
    for l in range(width if len(status) else 0):
        unknown = b.start.fate[l] == formulas.UNKNOWN
        status[first + l] = codes.NONFINITE if unknown else codes.OK
        if unknown:
            failed_at[first + l] = 0


@formula
def corrects(b, lanes, used):
    """Return True if states of a block may have to be corrected."""
    return False


@formula
def correct(b, lanes, asked, count, tile, missing):
    """Compute unusual states of the first `count` lanes of a tile again, and count those that are
    missing; `asked` are the first offset that is asked for, and the end.
    """
