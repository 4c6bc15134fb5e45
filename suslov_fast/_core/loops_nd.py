"""Loops over trajectories, steps and components of the n-dimensional map.

A block of up to LANES trajectories advances together, as in `loops_map`. With m = n - 1 components:

method   GAUSS or RANK2.
J, I     (B, m), or (1, m) where one body serves all: J_i = I_ii + I_nn and the couplings I_in.
eps      (B,) or (1,).
omega    (B, m), the states to start from.

GAUSS solves A(omega) omega_next = omega, equation (dsn). RANK2 solves for the increment in O(n):
then little is rounded while steps are small. Where they are not, where a d_i nearly vanishes or
omega shrinks by orders of magnitude, it goes over to other ways, a lane at a time.

Arrays of a block, lanes last. Rows that a loop goes through lie at fixed distances in one array, so
that the compiler sees that they do not overlap:

cells    (m, 4, LANES): J, I, omega, and work: 1/d, then the next omega. All in units of powers of
         two in which they are of the order of 1.
sums     (10, LANES): eps, the unit of omega, the bound of |omega|**2 for small steps; p = I.omega,
         |omega|**2, eps p / 2, and what the method makes of them.
matrix   A and its right side, VECTOR lanes at a time, as a flat (m, m + 1, VECTOR) array, and
         workspace: one vector of factors, omega, I.
"""

import math

import numpy as np
from numba import prange

from . import intrinsics  # noqa: F401  (compiles subtract_product)
from .codes import NONFINITE, OK, SINGULAR
from .jit import Loop, inlined_part, part
from .nd_map import column_of_coupling, column_of_omega, increment, slope, solve2
from .vector import VECTOR, aligned, subtract_product

GAUSS, RANK2 = range(2)

LANES = 32
# With more components than this a block takes fewer lanes, for its cells to stay in L1 and L2.
LARGE = 56

J_, I_, OMEGA, WORK = range(4)
EPS, UNIT, BOUND, P, SQUARE, HALF, ALPHA, BETA, GAMMA, MARGIN = range(10)

# A pivot this much smaller than those before it, times m, is zero to rounding.
ZERO_TO_ROUNDING = 2.0**-50
# Where all |d_i| / J_i are above this, and the determinant of the two sums is above its square, the
# O(n) step loses less than two digits.
FAR = 0.25
# With the component of the smallest |d_i| / J_i as a third unknown, the next may be this small.
FAR_ENOUGH = 0.1
# Steps are small where eps |I| |omega| / min J is below this: increments cancel at most so much.
SMALL = 64.0


@inlined_part
def add_up(cells, sums, lanes):
    """p and |omega|**2 of each lane."""
    for l in range(lanes):
        sums[P, l], sums[SQUARE, l] = 0.0, 0.0
    for i in range(cells.shape[0]):
        for l in range(lanes):
            sums[P, l] += cells[i, I_, l] * cells[i, OMEGA, l]
            sums[SQUARE, l] += cells[i, OMEGA, l] * cells[i, OMEGA, l]


@part
def new_matrix(m):
    """Workspace for VECTOR lanes: A with its right side, one vector, and two of m vectors."""
    return aligned((m * (m + 1) + 1 + 2 * m) * VECTOR)


@part
def assemble(cells, sums, first, matrix):
    """A and omega of VECTOR lanes from `first` on."""
    m = cells.shape[0]
    row = (m + 1) * VECTOR
    factor = m * row
    omega, coupling = factor + VECTOR, factor + (m + 1) * VECTOR
    for j in range(m):
        for l in range(VECTOR):
            matrix[omega + j * VECTOR + l] = cells[j, OMEGA, first + l]
            matrix[coupling + j * VECTOR + l] = cells[j, I_, first + l]
    for i in range(m):
        for q in range(i * row, (i + 1) * row):
            matrix[q] = 0.0
        for l in range(VECTOR):
            eps, p, J_i = sums[EPS, first + l], sums[P, first + l], cells[i, J_, first + l]
            matrix[i * row + i * VECTOR + l] = 1.0 - 0.5 * eps * p / J_i
            matrix[i * row + m * VECTOR + l] = cells[i, OMEGA, first + l]
            matrix[factor + l] = column_of_omega(J_i, cells[i, I_, first + l], eps)
        for j in range(m):
            subtract_product(matrix, i * row + j * VECTOR, factor, omega + j * VECTOR)
        for l in range(VECTOR):
            matrix[factor + l] = column_of_coupling(
                cells[i, J_, first + l], cells[i, OMEGA, first + l], sums[EPS, first + l]
            )
        for j in range(m):
            subtract_product(matrix, i * row + j * VECTOR, factor, coupling + j * VECTOR)


@part
def eliminate(m, matrix):
    """Gaussian elimination with partial pivoting, in place.

    The last column becomes the solution, NaN where the matrix is singular.
    """
    row = (m + 1) * VECTOR
    factor = m * row
    best, size = np.empty(VECTOR), np.zeros(VECTOR)
    pivot_row = np.empty(VECTOR, np.int64)
    for k in range(m):
        diagonal = k * row + k * VECTOR
        for l in range(VECTOR):
            best[l], pivot_row[l] = abs(matrix[diagonal + l]), k
        for i in range(k + 1, m):
            for l in range(VECTOR):
                candidate = abs(matrix[i * row + k * VECTOR + l])
                pivot_row[l] = i if candidate > best[l] else pivot_row[l]
                best[l] = candidate if candidate > best[l] else best[l]
        for l in range(VECTOR):
            # Most often no lane exchanges rows: A is near the identity.
            if pivot_row[l] != k:
                for j in range(k, m + 1):
                    here, there = k * row + j * VECTOR + l, pivot_row[l] * row + j * VECTOR + l
                    other = matrix[there]
                    matrix[there] = matrix[here]
                    matrix[here] = other
            size[l] = best[l] if best[l] > size[l] else size[l]
            regular = best[l] > ZERO_TO_ROUNDING * m * size[l]
            matrix[diagonal + l] = 1.0 / matrix[diagonal + l] if regular else np.nan
        for i in range(k + 1, m):
            for l in range(VECTOR):
                matrix[factor + l] = matrix[i * row + k * VECTOR + l] * matrix[diagonal + l]
            for j in range(k + 1, m + 1):
                subtract_product(matrix, i * row + j * VECTOR, factor, k * row + j * VECTOR)
    for i in range(m - 1, -1, -1):
        solution = i * row + m * VECTOR
        for j in range(i + 1, m):
            subtract_product(matrix, solution, i * row + j * VECTOR, j * row + m * VECTOR)
        for l in range(VECTOR):
            matrix[solution + l] *= matrix[i * row + i * VECTOR + l]


@part
def step_gauss(cells, sums, lanes, matrix):
    m = cells.shape[0]
    add_up(cells, sums, lanes)
    for first in range(0, lanes, VECTOR):
        assemble(cells, sums, first, matrix)
        eliminate(m, matrix)
        for i in range(m):
            for l in range(VECTOR):
                cells[i, WORK, first + l] = matrix[(i * (m + 1) + m) * VECTOR + l]


@inlined_part
def sum_up(cells, sums, lanes):
    """The sums of the O(n) step, with 1/d as work, and the two unknowns that follow."""
    add_up(cells, sums, lanes)
    for l in range(lanes):
        sums[ALPHA, l], sums[BETA, l], sums[GAMMA, l], sums[MARGIN, l] = 0.0, 0.0, 0.0, np.inf
        sums[HALF, l] = 0.5 * sums[EPS, l] * sums[P, l]
    for i in range(cells.shape[0]):
        for l in range(lanes):
            d = cells[i, J_, l] - sums[HALF, l]
            r = 1.0 / d
            I_r, omega_r = cells[i, I_, l] * r, cells[i, OMEGA, l] * r
            far = abs(d) - FAR * cells[i, J_, l]
            margin = sums[MARGIN, l]
            cells[i, WORK, l] = r
            sums[MARGIN, l] = far if far < margin else margin
            sums[ALPHA, l] += I_r * cells[i, OMEGA, l]
            sums[BETA, l] += I_r * cells[i, I_, l]
            sums[GAMMA, l] += omega_r * cells[i, OMEGA, l]
    # From here on alpha and beta hold what `increment` needs, gamma how regular the two sums are.
    for l in range(lanes):
        sums[ALPHA, l], sums[BETA, l], sums[GAMMA, l] = solve2(
            sums[EPS, l],
            sums[P, l],
            sums[SQUARE, l],
            sums[ALPHA, l],
            sums[BETA, l],
            sums[GAMMA, l],
        )


@part
def is_accurate(sums, l):
    far = sums[MARGIN, l] > 0.0 and sums[GAMMA, l] > FAR * FAR
    return far and sums[SQUARE, l] < sums[BOUND, l]


@inlined_part
def next_states(cells, sums, lanes):
    for i in range(cells.shape[0]):
        for l in range(lanes):
            cells[i, WORK, l] = cells[i, OMEGA, l] + increment(
                cells[i, I_, l],
                cells[i, OMEGA, l],
                sums[ALPHA, l],
                sums[BETA, l],
                cells[i, WORK, l],
            )


@inlined_part
def take_next_states(cells, sums, lanes):
    """Their sum times 0 tells, by NaN, which are not finite in the unit of the user."""
    for l in range(lanes):
        sums[MARGIN, l] = 0.0
    for i in range(cells.shape[0]):
        for l in range(lanes):
            cells[i, OMEGA, l] = cells[i, WORK, l]
            sums[MARGIN, l] += 0.0 * (cells[i, WORK, l] * sums[UNIT, l])


@inlined_part
def step_all(cells, sums, lanes):
    """`next_states` and `take_next_states` at once, where no lane needs care."""
    for l in range(lanes):
        sums[MARGIN, l] = 0.0
    for i in range(cells.shape[0]):
        for l in range(lanes):
            following = cells[i, OMEGA, l] + increment(
                cells[i, I_, l],
                cells[i, OMEGA, l],
                sums[ALPHA, l],
                sums[BETA, l],
                cells[i, WORK, l],
            )
            cells[i, OMEGA, l] = following
            sums[MARGIN, l] += 0.0 * (following * sums[UNIT, l])


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
def step_bordered(cells, eps, p, square, k, l):
    """The O(n) step of lane l with the increment of component k, whose d is small, as an unknown.

    Returns whether it is accurate.
    """
    alpha, beta, gamma = 0.0, 0.0, 0.0
    for i in range(cells.shape[0]):
        if i != k:
            r = 1.0 / (cells[i, J_, l] - 0.5 * eps * p)
            alpha += cells[i, I_, l] * cells[i, OMEGA, l] * r
            beta += cells[i, I_, l] * cells[i, I_, l] * r
            gamma += cells[i, OMEGA, l] * cells[i, OMEGA, l] * r
            cells[i, WORK, l] = r
    J_k, I_k, omega_k = cells[k, J_, l], cells[k, I_, l], cells[k, OMEGA, l]
    # Unknowns: I.delta and omega.delta as in `solve2`, with delta_k outside their sums.
    system = np.array(
        [
            [1.0 - 0.5 * eps * alpha, eps * beta, -I_k, eps * (p * alpha - square * beta)],
            [-0.5 * eps * gamma, 1.0 + eps * alpha, -omega_k, eps * (p * gamma - square * alpha)],
            [
                -0.5 * eps * omega_k / J_k,
                eps * I_k / J_k,
                1.0 - 0.5 * eps * p / J_k,
                eps * slope(J_k, I_k, omega_k, p, square),
            ],
        ]
    )
    accurate = solve3(system)
    of_omega, of_I = 0.5 * eps * (2.0 * p + system[0, 3]), eps * (square + system[1, 3])
    for i in range(cells.shape[0]):
        cells[i, WORK, l] = cells[i, OMEGA, l] + increment(
            cells[i, I_, l], cells[i, OMEGA, l], of_omega, of_I, cells[i, WORK, l]
        )
    cells[k, WORK, l] = omega_k + system[2, 3]
    return accurate


@part
def step_with_care(cells, sums, l):
    """The step of a lane where one d may be small; whether it is accurate."""
    if not sums[SQUARE, l] < sums[BOUND, l]:
        return False
    eps, p = sums[EPS, l], sums[P, l]
    k, smallest, second = 0, np.inf, np.inf
    for i in range(cells.shape[0]):
        ratio = abs(1.0 - 0.5 * eps * p / cells[i, J_, l])
        if ratio < smallest:
            k, smallest, second = i, ratio, smallest
        elif ratio < second:
            second = ratio
    return second > FAR_ENOUGH and step_bordered(cells, eps, p, sums[SQUARE, l], k, l)


@part
def largest_exponent(values):
    """The power of two just above the largest of some numbers; 0 if all vanish."""
    largest = 0.0
    for value in values:
        largest = max(largest, abs(value))
    return math.frexp(largest)[1]


@part
def load(J, I, eps, omega, first, width, lanes, cells, sums):
    """Fill the arrays of a block; lanes beyond its width rest at 0."""
    of_J, of_I = 0, 0
    for l in range(lanes):
        inside = l < width
        body = first + l if inside and J.shape[0] > 1 else 0
        coupling = first + l if inside and I.shape[0] > 1 else 0
        state = first + l if inside else 0
        # (dsn) keeps its form: only eps I omega / J counts.
        if l == 0 or J.shape[0] > 1:
            of_J = largest_exponent(J[body])
        if l == 0 or I.shape[0] > 1:
            of_I = largest_exponent(I[coupling])
        of_omega = largest_exponent(omega[state]) if inside else 0
        J_unit, I_unit = math.ldexp(1.0, -of_J), math.ldexp(1.0, -of_I)
        omega_unit = math.ldexp(1.0, -of_omega) if inside else 0.0
        smallest, square = np.inf, 0.0
        for i in range(cells.shape[0]):
            cells[i, J_, l] = J[body, i] * J_unit
            cells[i, I_, l] = I[coupling, i] * I_unit
            cells[i, OMEGA, l] = omega[state, i] * omega_unit
            smallest = min(smallest, cells[i, J_, l])
            square += cells[i, I_, l] * cells[i, I_, l]
        step_size = eps[first + l if inside and eps.size > 1 else 0]
        sums[EPS, l] = math.ldexp(step_size, of_omega + of_I - of_J)
        sums[UNIT, l] = math.ldexp(1.0, of_omega)
        speed = abs(sums[EPS, l]) * np.sqrt(square)
        sums[BOUND, l] = (SMALL * smallest / speed) ** 2 if speed > 0.0 else np.inf


@part
def write(cells, sums, out, row, batch_last, first, width):
    if batch_last:
        for i in range(cells.shape[0]):
            for l in range(width):
                out[i, row, first + l] = cells[i, OMEGA, l] * sums[UNIT, l]
    else:
        for l in range(width):
            for i in range(cells.shape[0]):
                out[first + l, row, i] = cells[i, OMEGA, l] * sums[UNIT, l]


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
    size = LANES if m <= LARGE else 2 * VECTOR
    for block in prange((omega.shape[0] + size - 1) // size):
        first = block * size
        width = min(size, omega.shape[0] - first)
        lanes = (width + VECTOR - 1) // VECTOR * VECTOR
        cells, sums = np.empty((m, 4, LANES)), np.empty((10, LANES))
        matrix = new_matrix(m) if method == GAUSS else np.empty(0)
        left = np.empty(LANES, np.bool_)
        load(J, I, eps, omega, first, width, lanes, cells, sums)
        row = start // every + 1 if start > 0 else 0
        if start == 0 and out.shape[1] > 0:
            write(cells, sums, out, 0, batch_last, first, width)
            row = 1
        for n in range(start + 1, stop + 1):
            if method == GAUSS:
                step_gauss(cells, sums, lanes, matrix)
                take_next_states(cells, sums, lanes)
            else:
                sum_up(cells, sums, lanes)
                accurate = True
                for l in range(width):
                    accurate &= is_accurate(sums, l) or status[first + l] != OK
                if accurate:
                    step_all(cells, sums, lanes)
                else:
                    next_states(cells, sums, lanes)
                    for l in range(lanes):
                        left[l] = (
                            l < width
                            and status[first + l] == OK
                            and not is_accurate(sums, l)
                            and not step_with_care(cells, sums, l)
                        )
                    for group in range(0, lanes, VECTOR):
                        if left[group : group + VECTOR].any():
                            if matrix.size == 0:
                                matrix = new_matrix(m)
                            assemble(cells, sums, group, matrix)
                            eliminate(m, matrix)
                            for l in range(VECTOR):
                                if left[group + l]:
                                    for i in range(m):
                                        cells[i, WORK, group + l] = matrix[
                                            (i * (m + 1) + m) * VECTOR + l
                                        ]
                    take_next_states(cells, sums, lanes)
            for l in range(width):
                if sums[MARGIN, l] != 0.0:  # NaN: the next state is not finite
                    undefined = False
                    for i in range(m):
                        undefined |= np.isnan(cells[i, OMEGA, l])
                        cells[i, OMEGA, l] = np.nan
                    if status[first + l] == OK:
                        in_range = np.isfinite(sums[EPS, l] * sums[P, l])
                        status[first + l] = SINGULAR if undefined and in_range else NONFINITE
                        failed_at[first + l] = n
            if n % every == 0:
                write(cells, sums, out, row, batch_last, first, width)
                row += 1
        for l in range(width):
            for i in range(m):
                final[first + l, i] = cells[i, OMEGA, l] * sums[UNIT, l]


iterate = Loop(_iterate)
