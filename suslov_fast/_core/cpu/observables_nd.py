"""The same loops in n dimensions, m = n - 1 components to a state: see `observables`.

J, I        flat arrays of `period` bodies of m numbers, or of one body that serves all.
following   the next states, flat, or omega itself where a quantity needs none.

Components of the states of a block stand in rows of lanes, m rows to each of the `cells`.
"""

import numpy as np
from numba import prange

from ..formulas import continuous, integrals, nd_map, units
from ..jit import Loop
from ..staged import staged
from . import intrinsics  # noqa: F401  (compiles what is imported from vector)
from .vector import VECTOR, to_cache_line

# Fewer than in `blocks`: m rows of them shall fit in the caches.
LANES = 32

# Cells: parameters and states in units of powers of two.
J_, I_, OMEGA, NEXT, SLOPE = range(5)
CELLS = 5
# Rows of sums; the step size; room for the sizes of vectors; the largest number in a state so far.
P_SUM, P_NEXT, PRODUCT, ENERGY, EXCESS, EPS, SIZE, LARGEST = range(8)
SUMS = 8
# Rows of the logarithms of units.
M, P, E, W = range(4)
LOGARITHMS = 4


def scratch_size(m: int) -> int:
    """The numbers that a task works in: one cache line more than its rows."""
    return (CELLS * m + SUMS) * LANES + VECTOR


@staged
def fill(values, m, first, width, cells, which):
    """Rows of values, those of each state or those of one body for all."""
    step = 0 if values.size == m else m
    begin = 0 if values.size == m else first * m
    for l in range(width):
        numbers = values[begin + l * step : begin + l * step + m]
        for i in range(m):
            cells[which, i, l] = numbers[i]


@staged
def find_sizes(cells, which, width, row):
    """The largest component of each vector of a cell."""
    for l in range(width):
        row[l] = 0.0
    for i in range(cells.shape[1]):
        for l in range(width):
            row[l] = units.larger(abs(cells[which, i, l]), row[l])


@staged
def take_units(cells, which, width, row, logarithms, default):
    """Divide the vectors of a cell by powers of two, whose logarithms go to a row."""
    find_sizes(cells, which, width, row)
    for l in range(width):
        logarithms[l] = units.exponent(row[l]) if row[l] > 0.0 else default[l]
        row[l] = units.power(-logarithms[l])
    for i in range(cells.shape[1]):
        for l in range(width):
            cells[which, i, l] *= row[l]


@staged
def enter_bodies(J, I, eps, m, first, width, cells, sums, logarithms):
    fill(J, m, first, width, cells, J_)
    fill(I, m, first, width, cells, I_)
    take_units(cells, J_, width, sums[SIZE], logarithms[M], logarithms[M])
    take_units(cells, I_, width, sums[SIZE], logarithms[P], logarithms[M])
    for l in range(width):
        step_size = eps[0 if eps.size == 1 else first + l]
        logarithms[E, l] = units.exponent(step_size)
        sums[EPS, l] = step_size * units.power(-logarithms[E, l])


@staged
def enter_states(omega, following, m, first, width, cells, sums, logarithms):
    for l in range(width):
        numbers = omega[(first + l) * m : (first + l + 1) * m]
        after = following[(first + l) * m : (first + l + 1) * m]
        for i in range(m):
            cells[OMEGA, i, l], cells[NEXT, i, l] = numbers[i], after[i]
    find_sizes(cells, OMEGA, width, sums[SIZE])
    for l in range(width):
        sums[LARGEST, l] = units.larger(sums[SIZE, l], sums[LARGEST, l])
        logarithms[W, l] = 0
    take_units(cells, OMEGA, width, sums[SIZE], logarithms[W], logarithms[W])
    for i in range(m):
        for l in range(width):
            cells[NEXT, i, l] *= sums[SIZE, l]


@staged
def add_up(cells, sums, width):
    """I.omega, I.omega_next and omega.omega_next."""
    for l in range(width):
        sums[P_SUM, l], sums[P_NEXT, l], sums[PRODUCT, l] = 0.0, 0.0, 0.0
    for i in range(cells.shape[1]):
        for l in range(width):
            I, omega, after = cells[I_, i, l], cells[OMEGA, i, l], cells[NEXT, i, l]
            sums[P_SUM, l] += I * omega
            sums[P_NEXT, l] += I * after
            sums[PRODUCT, l] += omega * after


@staged
def find_slopes(cells, sums, width):
    add_up(cells, sums, width)
    for i in range(cells.shape[1]):
        for l in range(width):
            cells[SLOPE, i, l] = continuous.polarised_slope(
                cells[J_, i, l],
                cells[I_, i, l],
                cells[OMEGA, i, l],
                cells[NEXT, i, l],
                sums[P_SUM, l],
                sums[P_NEXT, l],
                sums[PRODUCT, l],
            )


@staged
def add_up_energy(cells, sums, width):
    for l in range(width):
        sums[ENERGY, l] = 0.0
    for i in range(cells.shape[1]):
        for l in range(width):
            sums[ENERGY, l] += integrals.energy_term(cells[J_, i, l], cells[OMEGA, i, l])


@staged
def find_energy(cells, sums, logarithms, first, width, out):
    add_up_energy(cells, sums, width)
    for l in range(width):
        out[first + l] = units.scaled(sums[ENERGY, l], logarithms[M, l] + 2 * logarithms[W, l])


@staged
def find_modified_energy(cells, sums, logarithms, first, width, out):
    add_up_energy(cells, sums, width)
    find_slopes(cells, sums, width)
    for l in range(width):
        sums[EXCESS, l] = 0.0
    for i in range(cells.shape[1]):
        for l in range(width):
            sums[EXCESS, l] += integrals.energy_term(cells[J_, i, l], cells[SLOPE, i, l])
    for l in range(width):
        K = logarithms[E, l] + logarithms[W, l] + logarithms[P, l] - logarithms[M, l]
        eps, one, far = units.above_one(sums[EPS, l], K)
        excess = 0.25 * eps * eps * sums[EXCESS, l]
        out[first + l] = units.scaled(
            integrals.modified_energy_nd(sums[ENERGY, l], excess, one),
            logarithms[M, l] + 2 * (logarithms[W, l] - far),
        )


@staged
def find_vector_field(cells, sums, logarithms, first, width, out):
    m = cells.shape[1]
    find_slopes(cells, sums, width)
    for l in range(width):
        unit = 2 * logarithms[W, l] + logarithms[P, l] - logarithms[M, l]
        for i in range(m):
            out[(first + l) * m + i] = units.scaled(cells[SLOPE, i, l], unit)


@staged
def find_reaction(cells, sums, logarithms, first, width, out):
    m = cells.shape[1]
    find_slopes(cells, sums, width)
    for l in range(width):
        of_I, of_J = 2 * logarithms[P, l] - logarithms[M, l], logarithms[M, l]
        unit = max(of_I, of_J)
        of_slope, of_gyration = units.fraction(of_I - unit), units.fraction(of_J - unit)
        place = (first + l) * m * m
        for i in range(m):
            out[place + i * m + i] = 0.0 * sums[PRODUCT, l]
            for j in range(i):
                driven = continuous.reaction_entry(
                    cells[I_, i, l], cells[I_, j, l], cells[SLOPE, i, l], cells[SLOPE, j, l]
                )
                gyration = continuous.gyration_entry(
                    cells[J_, i, l],
                    cells[J_, j, l],
                    cells[OMEGA, i, l],
                    cells[OMEGA, j, l],
                    cells[NEXT, i, l],
                    cells[NEXT, j, l],
                )
                value = units.scaled(
                    of_slope * driven - of_gyration * gyration, unit + 2 * logarithms[W, l]
                )
                out[place + i * m + j], out[place + j * m + i] = value, -value


@staged
def find_matrix(cells, sums, logarithms, first, width, out):
    m = cells.shape[1]
    add_up(cells, sums, width)
    for l in range(width):
        K = logarithms[E, l] + logarithms[W, l] + logarithms[P, l] - logarithms[M, l]
        eps = units.moderate(sums[EPS, l], K)
        half = 0.5 * eps * sums[P_SUM, l]
        for i in range(m):
            of_omega = nd_map.column_of_omega(cells[J_, i, l], cells[I_, i, l], eps)
            of_I = nd_map.column_of_coupling(cells[J_, i, l], cells[OMEGA, i, l], eps)
            for j in range(m):
                # A NaN in the state is one in all entries.
                diagonal = 1.0 - half / cells[J_, i, l] if i == j else 0.0 * half
                out[((first + l) * m + i) * m + j] = nd_map.entry(
                    diagonal, of_omega, of_I, cells[I_, j, l], cells[OMEGA, j, l]
                )


@staged
def any_infinite(sums):
    infinite = False
    for l in range(LANES):
        infinite |= sums[LARGEST, l] == np.inf
    return infinite


def _observable(name, find):
    """A loop over all states of a part that finds a quantity for a block of them."""

    @staged
    def evaluate(task, J, I, eps, omega, following, out, m, period, infinite, scratch, logarithms):
        """What one task does."""
        shared = J.size == m and I.size == m and eps.size == 1
        states, tasks = omega.size // m, scratch.shape[0]
        repetitions = (states + period - 1) // period
        parts = (period + LANES - 1) // LANES * repetitions
        line = to_cache_line(scratch[task], 0)
        stop = line + CELLS * m * LANES
        cells = scratch[task][line:stop].reshape((CELLS, m, LANES))
        sums = scratch[task][stop : stop + SUMS * LANES].reshape((SUMS, LANES))
        units_of = logarithms[task]
        for l in range(LANES):
            sums[LARGEST, l] = 0.0
        begin = task * parts // tasks
        for k in range(begin, (task + 1) * parts // tasks):
            body, time = k // repetitions * LANES, k % repetitions
            lanes = min(LANES, period - body)
            if k == begin or (time == 0 and not shared):
                enter_bodies(J, I, eps, m, body, lanes, cells, sums, units_of)
            first = time * period + body
            width = min(lanes, states - first)
            enter_states(omega, following, m, first, width, cells, sums, units_of)
            find(cells, sums, units_of, first, width, out)
        infinite[task] = any_infinite(sums)

    def loop(J, I, eps, omega, following, out, m, period, infinite, scratch, logarithms):
        for task in prange(scratch.shape[0]):
            evaluate(
                task, J, I, eps, omega, following, out, m, period, infinite, scratch, logarithms
            )

    loop.__name__ = name
    return Loop(loop)


energy = _observable("energy", find_energy)
modified_energy = _observable("modified_energy", find_modified_energy)
vector_field = _observable("vector_field", find_vector_field)
reaction = _observable("reaction", find_reaction)
matrix = _observable("matrix", find_matrix)
