"""Blocks of trajectories of the 3D problem, which loops take side by side.

A block has up to LANES trajectories. Their numbers stand in rows of lanes, of which whole vectors
are in use, so that the compiler puts lanes side by side in vector registers. Rows live on the
stack: nothing is allocated while a loop runs, and the compiler knows that no two of them overlap.
"""

from ..formulas.units import own_unit
from ..staged import staged
from . import intrinsics  # noqa: F401  (compiles what is imported from vector)
from .vector import VECTOR, pairs_at, store_at, store_pairs, vector_at

# Measured: 64 lanes lose a quarter to the loop around them, 256 gain nothing.
LANES = 128
# More than the threads of any machine that this is likely to meet.
TASKS = 64

# The rows of `given`: what a block is given, and the state in a unit of its own, with that unit.
I1_, I2_, I13_, I23_, EPS, OMEGA1, OMEGA2, STATE1, STATE2, UNIT = range(10)
GIVEN = 10


@staged
def tasks_for(blocks):
    """How many tasks some blocks are."""
    return min(blocks, TASKS)


@staged
def in_whole_vectors(width):
    """The lanes in use for so many trajectories."""
    return (width + VECTOR - 1) // VECTOR * VECTOR


@staged
def spread(parameter, first, width, lanes, row):
    """A parameter of the trajectories of a block; 1 in the lanes beyond its width."""
    one_for_all = parameter.size == 1
    value = parameter[0] if one_for_all else 1.0
    for l in range(lanes):
        row[l] = value
    if not one_for_all:
        # An index from 0 on is known not to count from the end, which would take a branch.
        numbers = parameter[first : first + width]
        for l in range(width):
            row[l] = numbers[l]


@staged
def gather_pairs(pairs, first, width, row1, row2):
    """Pairs of numbers, one after the other, into two rows."""
    whole = width // VECTOR * VECTOR
    for l in range(0, whole, VECTOR):
        firsts, seconds = pairs_at(pairs, 2 * (first + l))
        store_at(row1, l, firsts)
        store_at(row2, l, seconds)
    for l in range(whole, width):
        row1[l], row2[l] = pairs[2 * (first + l)], pairs[2 * (first + l) + 1]


@staged
def scatter_pairs(row1, row2, first, width, pairs):
    """The reverse of `gather_pairs`."""
    whole = width // VECTOR * VECTOR
    for l in range(0, whole, VECTOR):
        store_pairs(pairs, 2 * (first + l), vector_at(row1, l), vector_at(row2, l))
    for l in range(whole, width):
        pairs[2 * (first + l)], pairs[2 * (first + l) + 1] = row1[l], row2[l]


@staged
def gather_bodies(bodies, first, width, lanes, given):
    """The bodies and step sizes of a block."""
    for row, parameter in zip((I1_, I2_, I13_, I23_, EPS), bodies, strict=True):
        spread(parameter, first, width, lanes, given[row])


@staged
def gather_states(states, first, width, lanes, given):
    """The states of a block; `states` is flat."""
    gather_pairs(states, first, width, given[OMEGA1], given[OMEGA2])
    for l in range(width, lanes):
        given[OMEGA1, l], given[OMEGA2, l] = 1.0, 1.0


@staged
def take_units_out(given, lanes):
    """Find units, powers of two, in which the states of a block are of the order of 1.

    The step sizes change with them; the bodies define no unit of time.
    """
    for l in range(lanes):
        given[EPS, l], given[STATE1, l], given[STATE2, l], given[UNIT, l] = own_unit(
            given[EPS, l], given[OMEGA1, l], given[OMEGA2, l]
        )
