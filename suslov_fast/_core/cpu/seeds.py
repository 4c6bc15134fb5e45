"""What is known of a run of the closed form before its rows are: powers of r, and seeds.

A run is that of `equal_steps`. Arrays are flat, with rows of WIDTH numbers as in `orbits`:

tables   what the rows named below hold of each orbit.
seeds    those of one group of rows, or of few trajectories of several, in a part of the tables.
along    the tables of few trajectories, numbers side by side.
"""

import numpy as np

from ..formulas.closed_form import logarithm_of_power, power_of_logarithm, sign_of_power
from ..formulas.elementary import scaled, two_to_the
from ..lanewise import larger, select, smaller
from ..staged import apart, staged
from .blocks import spread as spread_numbers
from .orbits import (
    A1,
    A2,
    ABREAST,
    B1,
    B2,
    BODY,
    GIVEN,
    KAPPA,
    KNOWN,
    LOG,
    LOG_LOST,
    ORBIT,
    UNIT1,
    UNIT2,
    WIDTH,
    N,
    R,
    after,
    body_of_all,
    enter_block,
    enter_orbit,
    in_whole,
    lanes_at,
    store_lanes,
)
from .vector import VECTOR, splat, store_at

# Rows from one exact power of r on.
GROUP = 64

# Where the rows of `tables` lie: r**(8 a every) for a = 0 ... 7, r**(b every) likewise; the number
# of the given state; whether all rows must be taken one by one; what `rows_across` and
# `rows_along` keep of a group; and the seeds of two groups, as those of the next one may be made
# meanwhile.
TABLE_A, TABLE_B = 0, 8 * WIDTH
START, APART, HALF_U, KAPPA_U, SEEDS = range(16 * WIDTH, 21 * WIDTH, WIDTH)
# Those of `seeds`: the w, and whether the rows after it must be taken one by one.
SEED, SLOW = range(0, 2 * WIDTH, WIDTH)
TABLES = SEEDS + 4 * WIDTH

# Where the arrays of a block lie.
BODY_AT = GIVEN
ORBIT_AT = BODY_AT + BODY
TABLES_AT = ORBIT_AT + ORBIT
BLOCK = TABLES_AT + TABLES

# Where `along` has the numbers of lanes, of a single trajectory.
NUMBERS = 2 * VECTOR

# Seeds w so large are taken one by one, as are those so near a pole: |k| w**2 above 1/4.
LARGE_SEED, NEAR_POLE = 400.0, 0.25
# omega is the difference of two numbers up to twice as large; float64 ends at 1.8e308.
LARGEST = 1e307
# A w this small becomes 0: subnormals are slow.
NEGLIGIBLE = 2.0**-960


def not_negligible(v):
    """v, or 0 in the place of what would soon be subnormal."""
    return select(abs(v) > NEGLIGIBLE, v, 0.0 * v)


def enter_run(every, whole, orbit, tables, l):
    """The powers of r between seeds, and which orbits have no state between others."""
    r, log_r, lost = (lanes_at(orbit, row + l) for row in (R, LOG, LOG_LOST))
    steps = every * lanes_at(orbit, UNIT1 + l) * lanes_at(orbit, UNIT2 + l)
    log_r, lost = logarithm_of_power(steps, log_r, lost)
    for table, eights in ((TABLE_A, 8.0), (TABLE_B, 1.0)):
        powers = [1.0]
        for a in (1.0, 2.0, 4.0):
            p, k = power_of_logarithm(a * eights * log_r, a * eights * lost)
            sign = select(r > 0.0, 1.0, sign_of_power(a * eights * every, -1.0))
            power = not_negligible(sign * (1.0 + p) * two_to_the(larger(k, -1000.0)))
            powers += [power, *(not_negligible(power * other) for other in powers[1:])]
        for row, power in enumerate(powers):
            store_lanes(tables, table + row * WIDTH + l, power)
    a1, b1, a2, b2 = (abs(lanes_at(orbit, row + l)) for row in (A1, B1, A2, B2))
    usual = ((r > 0.0) | whole) & (a1 + a2 + b1 + b2 < LARGEST)
    usual = usual | (lanes_at(orbit, KNOWN + l) == 0.0)
    store_lanes(tables, APART + l, select(usual, 0.0, 1.0))


def enter_seed(orbit, work, tables, seeds, l):
    """The w at the numbers in row N; and which must be taken row by row."""
    n, start = lanes_at(work, N + l), lanes_at(tables, START + l)
    f, k = after(larger(n - start, 0.0), orbit, l)
    w = not_negligible(scaled(f, larger(smaller(k, LARGE_SEED), -1000.0)))
    pole = abs(lanes_at(orbit, KAPPA + l) * w * w) > NEAR_POLE
    slow = (k >= LARGE_SEED) | (lanes_at(orbit, R + l) < 0.0) & pole
    slow = slow | (lanes_at(tables, APART + l) != 0.0) | (n < start)
    store_lanes(seeds, SEED + l, w)
    store_lanes(seeds, SLOW + l, select(slow, 1.0, 0.0))


@apart
def enter_seeds(orbit, work, tables, seeds, l):
    """The same, compiled once for all that need it."""
    enter_seed(orbit, work, tables, seeds, l)


@staged
def seeds_of(tables, group, abreast):
    """Where the seeds of a group of rows lie, of which `abreast` groups are made at once."""
    return tables[SEEDS + group // abreast % 2 * (2 * WIDTH) :]


@staged
def enter_seeds_across(number, orbit, work, tables, seeds, l):
    """The seeds of trajectories at the same number."""
    work[N + l : N + l + ABREAST] = number
    enter_seeds(orbit, work, tables, seeds, l)


@staged
def enter_seeds_along(first, every, group, orbit, work, tables, seeds, width, abreast):
    """The seeds of few trajectories, of `abreast` groups."""
    for j in range(abreast):
        number = first + every * ((group - group % abreast + j) * GROUP)
        for l in range(width):
            work[N + abreast * l + j] = number
    for l in range(0, abreast * width, ABREAST):
        enter_seeds(orbit, work, tables, seeds, l)


@staged
def repeat(rows, k, l, abreast):
    """Put what lane l of a row has into the lanes from `abreast` times l on."""
    number = splat(rows[k + l])
    for lane in range(abreast * l, abreast * (l + 1), VECTOR):
        store_at(rows, k + lane, number)


@staged
def make_lanes_of_seeds(orbit, tables, along, width, abreast):
    """Spread few trajectories over the lanes of the seeds of groups of rows.

    abreast   how many groups have their seeds made at once: trajectory l has so many lanes, from
              that number times l on.
    along     receives the tables of each trajectory, numbers side by side: B, then A; of a
              single one B twice, and the numbers of lanes.
    """
    for l in range(width - 1, -1, -1):
        for j in range(VECTOR):
            along[VECTOR * l + j] = tables[TABLE_B + j * WIDTH + l]
            along[VECTOR * (VECTOR + l) + j] = tables[TABLE_A + j * WIDTH + l]
        for k in range(0, ORBIT, WIDTH):
            repeat(orbit, k, l, abreast)
        for k in (START, APART):
            repeat(tables, k, l, abreast)
    if width == 1:
        for j in range(VECTOR):
            along[VECTOR + j], along[NUMBERS + j] = along[j], j


@staged
def known_of(block):
    """The arrays of a block: given, body, orbit and tables."""
    given, body = block[:BODY_AT], block[BODY_AT:ORBIT_AT]
    return given, body, block[ORBIT_AT:TABLES_AT], block[TABLES_AT:BLOCK]


@staged
def pieces_of(width):
    """In how many pieces a block is entered."""
    return 1 + (3 if width >= VECTOR else 2) * (in_whole(width) // ABREAST)


@apart
def enter_piece(piece, k, common, lane, width, row, block, work):
    """Enter a block, piece after piece, so that rows of another may be written in between.

    k        how many blocks the task has entered before.
    common   what blocks have in common.
    row      the first of the run that is wanted; few trajectories get no seeds here.
    block    where the arrays lie, those of blocks taking turns.
    """
    flow, back, bodies, states, start, (first, every) = common
    given, body, orbit, tables = known_of(block)
    vectors = in_whole(width) // ABREAST
    l = (piece - 1) % vectors * ABREAST
    if piece == 0:
        lanes, _ = enter_block(bodies, states, lane, width, k < 2, given, body)
        spread_numbers(start, lane, width, lanes, tables[START:])
    elif piece <= vectors:
        step = 0 if body_of_all(bodies) else 1
        enter_orbit(flow, back, given, body, orbit, l, step * l)
    elif piece <= 2 * vectors:
        whole = (np.floor(first) == first) & (np.floor(every) == every)
        enter_run(every, whole, orbit, tables, l)
    else:
        group = row // GROUP
        number = first + every * (group * GROUP)
        enter_seeds_across(number, orbit, work, tables, seeds_of(tables, group, 1), l)
