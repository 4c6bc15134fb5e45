"""Loops over trajectories, steps and components of the n-dimensional map.

A block of a few groups of VECTOR trajectories advances together: while one group waits for a
division another works. With m = n - 1 components:

method   GAUSS or RANK2.
J, I     (B, m), or (1, m) where one body serves all: J_i = I_ii + I_nn and the couplings I_in.
eps      (B,) or (1,).
omega    (B, m), the states to start from.

GAUSS solves A(omega) omega_next = omega, equation (dsn). RANK2 solves for the increment in O(n):
then little is rounded while steps are small. Where they are not, where a d_i nearly vanishes or
omega shrinks by orders of magnitude, it goes over to other ways, a lane at a time.

Arrays of vectors of lanes:

cells    (groups, m, 4, VECTOR): J, I, omega, and work: 1/d, then the next omega. All in units of
         powers of two in which they are of the order of 1; new ones where omega has left that.
sums     (groups, 14, VECTOR): logarithms of these units, then what EPS and so on name.
matrix   (rows, columns, VECTOR), of one group at a time: A and its right side.
"""

import math

import numpy as np
from numba import prange

from ..codes import NONFINITE, OK, SINGULAR
from ..formulas.nd_map import column_of_coupling, column_of_omega, entry, increment, slope, solve2
from ..jit import Loop, inlined_part, part
from . import intrinsics  # noqa: F401  (compiles what `vector` defines)
from .vector import VECTOR, aligned, choose, in_all, larger, load, same, smaller, store

GAUSS, RANK2 = range(2)

LANES = 32
# Components that the groups of a block have together, unless it is one group: cells that fit in L1.
ROOM = 160

J_, I_, OMEGA, WORK = range(4)
# eps; the unit of omega; bounds of |omega|**2 for steps to be small and for units to serve; p,
# |omega|**2, eps p / 2; what `increment` needs; 1 where the O(n) step is accurate, else 0.
EPS, UNIT, SMALL_STEPS, LOW, HIGH, P, SQUARE, HALF, OF_OMEGA, OF_I, ACCURATE = range(3, 14)

# A pivot this much smaller than those before it, times m, is zero to rounding.
ZERO_TO_ROUNDING = 2.0**-50
# Where all |d_i| / J_i are above this, and the determinant of the two sums is above its square, the
# O(n) step loses less than two digits.
FAR = 0.25
# With the component of the smallest |d_i| / J_i as a third unknown, the next may be this small.
FAR_ENOUGH = 0.1
# Steps are small where eps |I| |omega| / min J is below this: increments cancel at most so much.
SMALL = 64.0
# Units serve while |omega|**2 is between the inverse of this and this, or 0 from the start.
SPREAD = 2.0**200
# States whose |omega| is below this in the unit of the user are finite there.
LARGEST = 2.0**1000
# Rows or columns of A that are reduced at once.
ABREAST = 4


@part
def block_size(m):
    """The trajectories that share a block, in whole groups."""
    return max(VECTOR, min(LANES, ROOM // m * VECTOR))


@part
def add_up(cells, sums, g):
    """p and |omega|**2 of each lane."""
    p, square = same(0.0), same(0.0)
    for i in range(cells.shape[1]):
        I, omega = load(cells, g, i, I_), load(cells, g, i, OMEGA)
        p = p + I * omega
        square = square + omega * omega
    store(sums, g, P, p)
    store(sums, g, SQUARE, square)


@part
def new_matrix(m):
    """Room for A and its right side, and for ABREAST rows or columns from any on.

    The number of columns is odd, so that the rows of a column are spread over the cache.
    """
    rows, columns = m + ABREAST, (m + ABREAST) // 2 * 2 + 1
    matrix = aligned(rows * columns * VECTOR).reshape((rows, columns, VECTOR))
    matrix[:] = 0.0
    return matrix


@part
def assemble(cells, sums, g, matrix):
    m = cells.shape[1]
    eps = load(sums, g, EPS)
    half = 0.5 * eps * load(sums, g, P)
    store(sums, g, HALF, half)
    for i in range(m):
        J_i, I_i, omega_i = load(cells, g, i, J_), load(cells, g, i, I_), load(cells, g, i, OMEGA)
        of_omega, of_I = column_of_omega(J_i, I_i, eps), column_of_coupling(J_i, omega_i, eps)
        for j in range(m):
            I_j, omega_j = load(cells, g, j, I_), load(cells, g, j, OMEGA)
            store(matrix, i, j, entry(0.0, of_omega, of_I, I_j, omega_j))
        store(matrix, i, i, entry(1.0 - half / J_i, of_omega, of_I, I_i, omega_i))
        store(matrix, i, m, omega_i)


@inlined_part
def reduce_column(matrix, first, k):
    """Eliminate in column k what the columns before it stand for, ABREAST rows from `first` on."""
    i0, i1, i2, i3 = first, first + 1, first + 2, first + 3
    a0, a1 = load(matrix, i0, k), load(matrix, i1, k)
    a2, a3 = load(matrix, i2, k), load(matrix, i3, k)
    for t in range(k):
        above = load(matrix, t, k)
        a0 = a0 - load(matrix, i0, t) * above
        a1 = a1 - load(matrix, i1, t) * above
        a2 = a2 - load(matrix, i2, t) * above
        a3 = a3 - load(matrix, i3, t) * above
    store(matrix, i0, k, a0)
    store(matrix, i1, k, a1)
    store(matrix, i2, k, a2)
    store(matrix, i3, k, a3)


@inlined_part
def reduce_row(matrix, k, first):
    """The same in row k, ABREAST columns from `first` on."""
    j0, j1, j2, j3 = first, first + 1, first + 2, first + 3
    a0, a1 = load(matrix, k, j0), load(matrix, k, j1)
    a2, a3 = load(matrix, k, j2), load(matrix, k, j3)
    for t in range(k):
        factor = load(matrix, k, t)
        a0 = a0 - factor * load(matrix, t, j0)
        a1 = a1 - factor * load(matrix, t, j1)
        a2 = a2 - factor * load(matrix, t, j2)
        a3 = a3 - factor * load(matrix, t, j3)
    store(matrix, k, j0, a0)
    store(matrix, k, j1, a1)
    store(matrix, k, j2, a2)
    store(matrix, k, j3, a3)


@inlined_part
def exchange_rows(matrix, m, k):
    """Bring the largest number of column k, from row k on, into row k, a lane at a time."""
    for l in range(VECTOR):
        pivot = k
        for i in range(k + 1, m):
            larger_yet = abs(matrix[i, k, l]) > abs(matrix[pivot, k, l])
            pivot = i if larger_yet else pivot
        for j in range(m + 1):
            other = matrix[pivot, j, l]
            matrix[pivot, j, l] = matrix[k, j, l]
            matrix[k, j, l] = other


@part
def eliminate(matrix, m):
    """Gaussian elimination with partial pivoting, in place, in Crout's order.

    A number is loaded when its row or column is due and takes all its products at once. The right
    side becomes the solution, NaN where the matrix is singular.
    """
    size = same(0.0)
    for k in range(m):
        for i in range(k, m, ABREAST):
            reduce_column(matrix, i, k)
        diagonal = abs(load(matrix, k, k))
        largest = diagonal
        for i in range(k + 1, m):
            largest = larger(abs(load(matrix, i, k)), largest)
        # Most often no lane exchanges rows: A is near the identity.
        if not in_all(diagonal >= largest):
            exchange_rows(matrix, m, k)
        size = larger(largest, size)
        regular = largest > ZERO_TO_ROUNDING * m * size
        inverse = choose(regular, 1.0 / load(matrix, k, k), same(np.nan))
        store(matrix, k, k, inverse)
        for i in range(k + 1, m):
            store(matrix, i, k, load(matrix, i, k) * inverse)
        for j in range(k + 1, m + 1, ABREAST):
            reduce_row(matrix, k, j)
    for i in range(m - 1, -1, -1):
        solution = load(matrix, i, m)
        for j in range(m - 1, i, -1):
            solution = solution - load(matrix, i, j) * load(matrix, j, m)
        store(matrix, i, m, solution * load(matrix, i, i))


@inlined_part
def sum_up(cells, sums, g):
    """The sums of the O(n) step, with 1/d as work, and the two unknowns that follow."""
    eps, p, square = load(sums, g, EPS), load(sums, g, P), load(sums, g, SQUARE)
    half = 0.5 * eps * p
    alpha, beta, gamma, margin = same(0.0), same(0.0), same(0.0), same(np.inf)
    for i in range(cells.shape[1]):
        J, I, omega = load(cells, g, i, J_), load(cells, g, i, I_), load(cells, g, i, OMEGA)
        d = J - half
        r = 1.0 / d
        margin = smaller(abs(d) - FAR * J, margin)
        I_r = I * r
        alpha = alpha + I_r * omega
        beta = beta + I_r * I
        gamma = gamma + omega * r * omega
        store(cells, g, i, WORK, r)
    of_omega, of_I, det, size = solve2(eps, p, square, alpha, beta, gamma)
    accurate = (margin > 0.0) & (det > FAR * FAR * size) & (square < load(sums, g, SMALL_STEPS))
    store(sums, g, HALF, half)
    store(sums, g, OF_OMEGA, of_omega)
    store(sums, g, OF_I, of_I)
    store(sums, g, ACCURATE, choose(accurate, same(1.0), same(0.0)))


@part
def next_component(cells, g, i, of_omega, of_I):
    I, omega, r = load(cells, g, i, I_), load(cells, g, i, OMEGA), load(cells, g, i, WORK)
    return omega + increment(I, omega, of_omega, of_I, r)


@part
def next_states(cells, sums, g):
    of_omega, of_I = load(sums, g, OF_OMEGA), load(sums, g, OF_I)
    for i in range(cells.shape[1]):
        store(cells, g, i, WORK, next_component(cells, g, i, of_omega, of_I))


@part
def take_next_states(cells, sums, g):
    for i in range(cells.shape[1]):
        store(cells, g, i, OMEGA, load(cells, g, i, WORK))
    add_up(cells, sums, g)


@inlined_part
def step_all(cells, sums, g):
    """`next_states` and `take_next_states` at once, where no lane needs care."""
    of_omega, of_I = load(sums, g, OF_OMEGA), load(sums, g, OF_I)
    p, square = same(0.0), same(0.0)
    for i in range(cells.shape[1]):
        omega = next_component(cells, g, i, of_omega, of_I)
        store(cells, g, i, OMEGA, omega)
        p = p + load(cells, g, i, I_) * omega
        square = square + omega * omega
    store(sums, g, P, p)
    store(sums, g, SQUARE, square)


@part
def solve3(system):
    """Solve a 3 x 3 system, pivoting; the solution is the last column. False if it is singular."""
    size, regular = 0.0, True
    for k in range(3):
        row = k
        for i in range(k + 1, 3):
            row = i if abs(system[i, k]) > abs(system[row, k]) else row
        for j in range(4):
            other = system[row, j]
            system[row, j] = system[k, j]
            system[k, j] = other
        size = max(size, abs(system[k, k]))
        regular = regular and abs(system[k, k]) > 1e-3 * size
        for i in range(3):
            if i != k:
                factor = system[i, k] / system[k, k]
                for j in range(k, 4):
                    system[i, j] -= factor * system[k, j]
    for k in range(3):
        system[k, 3] /= system[k, k]
    return regular


@part
def step_bordered(cells, g, eps, p, square, k, l):
    """The O(n) step of lane l with the increment of component k, whose d is small, as an unknown.

    Returns whether it is accurate.
    """
    alpha, beta, gamma = 0.0, 0.0, 0.0
    for i in range(cells.shape[1]):
        if i != k:
            r = 1.0 / (cells[g, i, J_, l] - 0.5 * eps * p)
            alpha += cells[g, i, I_, l] * cells[g, i, OMEGA, l] * r
            beta += cells[g, i, I_, l] * cells[g, i, I_, l] * r
            gamma += cells[g, i, OMEGA, l] * cells[g, i, OMEGA, l] * r
            cells[g, i, WORK, l] = r
    J_k, I_k, omega_k = cells[g, k, J_, l], cells[g, k, I_, l], cells[g, k, OMEGA, l]
    # Unknowns: I.delta, omega.delta as in `solve2`, and delta_k, which is not in their sums. The
    # second one over |omega|, to a power of two: then pivots do not depend on the unit of omega.
    unit = math.ldexp(1.0, math.frexp(square)[1] // 2)
    system = np.array(
        [
            [1.0 - 0.5 * eps * alpha, eps * beta * unit, -I_k, eps * (p * alpha - square * beta)],
            [
                -0.5 * eps * gamma / unit,
                1.0 + eps * alpha,
                -omega_k / unit,
                eps * (p * gamma - square * alpha) / unit,
            ],
            [
                -0.5 * eps * omega_k / J_k,
                eps * I_k / J_k * unit,
                1.0 - 0.5 * eps * p / J_k,
                eps * slope(J_k, I_k, omega_k, p, square),
            ],
        ]
    )
    accurate = solve3(system)
    of_omega, of_I = 0.5 * eps * (2.0 * p + system[0, 3]), eps * (square + system[1, 3] * unit)
    for i in range(cells.shape[1]):
        cells[g, i, WORK, l] = cells[g, i, OMEGA, l] + increment(
            cells[g, i, I_, l], cells[g, i, OMEGA, l], of_omega, of_I, cells[g, i, WORK, l]
        )
    cells[g, k, WORK, l] = omega_k + system[2, 3]
    return accurate


@part
def step_with_care(cells, sums, g, l):
    """The step of a lane where one d may be small; whether it is accurate."""
    if not sums[g, SQUARE, l] < sums[g, SMALL_STEPS, l]:
        return False
    half = sums[g, HALF, l]
    k, smallest, second = 0, np.inf, np.inf
    for i in range(cells.shape[1]):
        ratio = abs(1.0 - half / cells[g, i, J_, l])
        if ratio < smallest:
            k, smallest, second = i, ratio, smallest
        elif ratio < second:
            second = ratio
    return second > FAR_ENOUGH and step_bordered(
        cells, g, sums[g, EPS, l], sums[g, P, l], sums[g, SQUARE, l], k, l
    )


@part
def step_each(cells, sums, g):
    """The step of a group where some lane needs care, by elimination where that is not enough."""
    next_states(cells, sums, g)
    m, left = cells.shape[1], np.zeros(VECTOR, np.bool_)
    for l in range(VECTOR):
        left[l] = sums[g, ACCURATE, l] == 0.0 and not step_with_care(cells, sums, g, l)
    if left.any():
        matrix = new_matrix(m)
        assemble(cells, sums, g, matrix)
        eliminate(matrix, m)
        for l in range(VECTOR):
            if left[l]:
                for i in range(m):
                    cells[g, i, WORK, l] = matrix[i, m, l]
    take_next_states(cells, sums, g)


@part
def end(cells, sums, g, first, status, failed_at, n):
    """End the trajectories whose state n is not finite in the unit of the user."""
    for l in range(min(VECTOR, status.size - first)):
        finite, undefined = True, False
        for i in range(cells.shape[1]):
            finite &= np.isfinite(cells[g, i, OMEGA, l] * sums[g, UNIT, l])
            undefined |= np.isnan(cells[g, i, OMEGA, l])
        if not finite and status[first + l] == OK:
            in_range = np.isfinite(sums[g, HALF, l])
            status[first + l] = SINGULAR if undefined and in_range else NONFINITE
            failed_at[first + l] = n


@part
def fill(cells, sums, g, which, values, first):
    """Rows of values, or one row for all lanes, in units that go to UNIT, with their logarithms."""
    m, last = values.shape[1], values.shape[0] - 1
    if last == 0:
        for i in range(m):
            store(cells, g, i, which, same(values[0, i]))
    else:
        for l in range(VECTOR):
            row = min(first + l, last)
            for i in range(m):
                cells[g, i, which, l] = values[row, i]
    largest = same(0.0)
    for i in range(m):
        largest = larger(abs(load(cells, g, i, which)), largest)
    store(sums, g, which, largest)
    exponent, unit = 0, 1.0
    for l in range(VECTOR):
        if l == 0 or last > 0:
            # The unit and its inverse are in range.
            exponent = min(max(math.frexp(sums[g, which, l])[1], -1022), 1023)
            unit = math.ldexp(1.0, exponent)
        sums[g, which, l], sums[g, UNIT, l] = exponent, unit
    inverse = 1.0 / load(sums, g, UNIT)
    for i in range(m):
        store(cells, g, i, which, load(cells, g, i, which) * inverse)


@part
def start_group(J, I, eps, omega, first, status, cells, sums, g):
    """Fill the arrays of a group.

    Lanes beyond the batch, and those that have ended, rest at 0, in a unit that makes it NaN.
    """
    fill(cells, sums, g, J_, J, first)
    fill(cells, sums, g, I_, I, first)
    fill(cells, sums, g, OMEGA, omega, first)
    for l in range(VECTOR):
        # (dsn) keeps its form: only eps I omega / J counts.
        exponent = sums[g, OMEGA, l] + sums[g, I_, l] - sums[g, J_, l]
        sums[g, EPS, l] = math.ldexp(eps[min(first + l, eps.size - 1)], int(exponent))
        if first + l >= status.size or status[first + l] != OK:
            sums[g, EPS, l], sums[g, UNIT, l] = 0.0, np.nan
            for i in range(cells.shape[1]):
                cells[g, i, OMEGA, l] = 0.0
    smallest, square = same(np.inf), same(0.0)
    for i in range(cells.shape[1]):
        smallest = smaller(load(cells, g, i, J_), smallest)
        square = square + load(cells, g, i, I_) * load(cells, g, i, I_)
    longest, largest = SMALL * smallest / load(sums, g, EPS), LARGEST / load(sums, g, UNIT)
    store(sums, g, SMALL_STEPS, longest * longest / square)
    add_up(cells, sums, g)
    moves = load(sums, g, SQUARE) > 0.0
    store(sums, g, LOW, choose(moves, same(1.0 / SPREAD), same(-1.0)))
    store(sums, g, HIGH, smaller(largest * largest, same(SPREAD)))


@part
def write(cells, sums, g, out, row, batch_last, first):
    if batch_last:
        for i in range(cells.shape[1]):
            for l in range(min(VECTOR, out.shape[2] - first)):
                out[i, row, first + l] = cells[g, i, OMEGA, l] * sums[g, UNIT, l]
    else:
        for l in range(min(VECTOR, out.shape[0] - first)):
            for i in range(cells.shape[1]):
                out[first + l, row, i] = cells[g, i, OMEGA, l] * sums[g, UNIT, l]


@part
def write_last(cells, sums, g, final, first):
    write(cells, sums, g, final.reshape((final.shape[0], 1, final.shape[1])), 0, False, first)


@part
def renew(J, I, eps, final, first, status, cells, sums, g):
    """Find new units for a group, as a call that went on from here would."""
    write_last(cells, sums, g, final, first)
    start_group(J, I, eps, final, first, status, cells, sums, g)


def _iterate(
    method, J, I, eps, omega, start, stop, every, out, batch_last, final, status, failed_at
):
    """Iterate from state `start`, given as omega, to state `stop`.

    out         the saved states: (B, n_saved, m), or (m, n_saved, B) if batch_last; n_saved may be
                0. States whose number is a multiple of `every` are saved.
    final       (B, m), state `stop`; may be omega itself.
    status      (B,), SINGULAR or NONFINITE where a trajectory has ended; read and written.
    failed_at   (B,), the first state that does not exist, where one does not; read and written.
    """
    m = omega.shape[1]
    size = block_size(m)
    for block in prange((omega.shape[0] + size - 1) // size):
        first = block * size
        groups = (min(size, omega.shape[0] - first) + VECTOR - 1) // VECTOR
        cells = aligned(groups * m * 4 * VECTOR).reshape((groups, m, 4, VECTOR))
        sums = aligned(groups * 14 * VECTOR).reshape((groups, 14, VECTOR))
        matrix = new_matrix(m) if method == GAUSS else np.empty((0, 0, VECTOR))
        for g in range(groups):
            start_group(J, I, eps, omega, first + g * VECTOR, status, cells, sums, g)
            if start == 0 and out.shape[1] > 0:
                write(cells, sums, g, out, 0, batch_last, first + g * VECTOR)
        for n in range(start + 1, stop + 1):
            saved = n % every == 0
            if method == RANK2:
                # Of all groups first: one need not wait for the unknowns of the one before.
                for g in range(groups):
                    sum_up(cells, sums, g)
            for g in range(groups):
                if method == GAUSS:
                    assemble(cells, sums, g, matrix)
                    eliminate(matrix, m)
                    for i in range(m):
                        store(cells, g, i, WORK, load(matrix, i, m))
                    take_next_states(cells, sums, g)
                elif in_all(load(sums, g, ACCURATE) > 0.0):
                    step_all(cells, sums, g)
                else:
                    step_each(cells, sums, g)
                square = load(sums, g, SQUARE)
                if not in_all((square > load(sums, g, LOW)) & (square < load(sums, g, HIGH))):
                    end(cells, sums, g, first + g * VECTOR, status, failed_at, n)
                    renew(J, I, eps, final, first + g * VECTOR, status, cells, sums, g)
                if saved:
                    write(cells, sums, g, out, n // every, batch_last, first + g * VECTOR)
        for g in range(groups):
            write_last(cells, sums, g, final, first + g * VECTOR)


iterate = Loop(_iterate)
