"""Steps of the map of a body in n dimensions (theory, section 3), with m = n - 1 components.

The field, equation (14) of the paper, is f_i = (p w_i - |w|**2 I_i) / J_i with p = I.w. A step of
the map (15) solves A(w) w_next = w, equation (16). The matrix A = 1 - h f'(w), h = eps / 2, is
diagonal plus rank two,

A_ij = (2 h I_i w_j - h w_i I_j) / J_i  for j != i,   A_ii = 1 - h (p - I_i w_i) / J_i.

So a step takes O(n) operations. With d_i = J_i - h p, w_next = w + delta,

delta_i = (h (2 p + I.delta) w_i - 2 h (|w|**2 + w.delta) I_i) / d_i.

The products with I and w are two equations for I.delta and w.delta. With alpha = sum I w / d,
beta = sum I**2 / d and gamma = sum w**2 / d they are

(1 - h alpha) I.delta + 2 h beta w.delta = 2 h (p alpha - |w|**2 beta),
-h gamma I.delta + (1 + 2 h alpha) w.delta = 2 h (p gamma - |w|**2 alpha).

Digits are lost where a d_i is small, where the determinant of the two equations cancels, and where
w + delta cancels; such lanes solve A(w) w_next = w by elimination. det A is prod (d_i / J_i) times
the determinant of the two equations. If det A is negative, a step passes a pole, or is too long.

parameters   J, I (1 or B, m); eps (1 or B,)
final        (B, m), the states that a run continues from
carry        (1, B), the number of the first state after a step with det A < 0, 0 if there is none

A block of lanes is two arrays: c[row, component, lane], with the rows J_, I_, W and INVERSE, and
b[row, lane], with one number for each lane. The number of components in c is even; if m is odd, the
last has J = inf and I = w = 0. After a failure the state and eps of a lane are NaN, so that the
lane needs no elimination. In NumPy a block has a single lane of arrays over all trajectories.
"""

from typing import Any, NamedTuple

import numpy as np

from ..numba.arrays import keep, uncounted
from ..numba.decorators import ZERO, as_python, formula, function, inlined, kernel, lesser, share
from ..numba.gauss import TO_SOLVE, eliminate, keeps_digits, memory_of_one, solve
from ..numba.intrinsics import select
from ..numba.status_codes import NONFINITE, OK, PASSED_POLE
from .blocks import empty_at_line, write_states

J_, I_, W, INVERSE = range(4)  # rows of c; INVERSE: 1 / d_i
# Rows of b after the rows of `gauss.eliminate`:
P, SQUARE, HALF = range(TO_SOLVE + 1, TO_SOLVE + 4)  # p, |w|**2 and h p
ALPHA, BETA, GAMMA = range(HALF + 1, HALF + 4)
OF_W, OF_I = range(GAMMA + 1, GAMMA + 3)  # the factors of w / d and I / d in delta
EPS, NEAR = range(OF_I + 1, OF_I + 3)  # eps, and a bound of h p below which no d is small
ROW_W, ROW_I, OTHERS = range(NEAR + 1, NEAR + 4)  # 2 h I_i / J_i, h w_i / J_i and p - I_i w_i
DET = OTHERS + 1  # a number with the sign of det A
ROWS = DET + 1
LANES = 64  # with fewer, each addition to a lane's sum would wait until the last sum is stored
# A step in O(n) keeps its digits if |d_i| / J_i > FAR_FROM_0, the determinant of the two equations
# is above LEAST_DET times the sum of the moduli of its terms, and w.w_next > LEAST_COSINE |w|**2.
FAR_FROM_0, LEAST_DET, LEAST_COSINE = 0.25, 0.0625, 0.125


@formula
def terms_at(c, b, i, l):
    """Return 1 / d, I w / d, I**2 / d and w**2 / d of component i in lane l."""
    I, w = c[I_, i, l], c[W, i, l]
    inverse = 1.0 / (c[J_, i, l] - b[HALF, l])
    along = I * inverse
    return inverse, along * w, along * I, w * inverse * w


@formula
def solve_two(eps, p, square, alpha, beta, gamma):
    """Return u and v of the increment delta_i = (u w_i + v I_i) / d_i.

    They follow from the two equations for I.delta and w.delta in the head of this file. Return also
    True if u and v keep their digits, and the determinant. `square` is |w|**2.
    """
    h = 0.5 * eps
    a11 = 1.0 - h * alpha
    a12 = eps * beta
    a21 = -h * gamma
    a22 = 1.0 + eps * alpha
    b1 = eps * (p * alpha - square * beta)
    b2 = eps * (p * gamma - square * alpha)
    det = a11 * a22 - a12 * a21
    size = (1.0 + abs(h * alpha)) * (1.0 + abs(eps * alpha)) + abs(a12 * a21)
    inverse = 1.0 / det
    I_delta = (a22 * b1 - a12 * b2) * inverse
    w_delta = (a11 * b2 - a21 * b1) * inverse
    accurate = (abs(det) > LEAST_DET * size) & (square + w_delta >= LEAST_COSINE * square)
    return h * (2.0 * p + I_delta), -eps * (square + w_delta), accurate | np.isnan(eps), det


@formula
def fill_systems(c, b, a, begin, lanes):
    """Fill `a` with systems A(w) w_next = w of a block (c, b), `lanes` lanes from `begin` on."""
    m = len(a)
    for i in range(m):
        for l in range(begin, begin + lanes):
            b[ROW_W, l] = b[EPS, l] * c[I_, i, l] / c[J_, i, l]
            b[ROW_I, l] = 0.5 * b[EPS, l] * c[W, i, l] / c[J_, i, l]
            b[OTHERS, l], a[i, m, l - begin] = 0.0, c[W, i, l]
        for j in range(m):
            if j != i:
                for l in range(begin, begin + lanes):
                    a[i, j, l - begin] = b[ROW_W, l] * c[W, j, l] - b[ROW_I, l] * c[I_, j, l]
                for l in range(begin, begin + lanes):
                    b[OTHERS, l] += c[I_, j, l] * c[W, j, l]
        for l in range(begin, begin + lanes):  # w_i is absent, because it cancels in p - I_i w_i
            a[i, i, l - begin] = 1.0 - 0.5 * b[EPS, l] * b[OTHERS, l] / c[J_, i, l]


@formula
def compute_factors(c, b, lanes):
    """Compute 1 / d and the factors of the increments, b[OF_W] and b[OF_I].

    Return how many lanes may have a small d, and how many need elimination whatever their d are.
    """
    pairs = c.shape[1] // 2  # sums of pairs of terms halve the number of stores
    for l in range(lanes):
        b[HALF, l] = 0.5 * b[EPS, l] * b[P, l]
        b[ALPHA, l], b[BETA, l], b[GAMMA, l] = 0.0, 0.0, 0.0
    for i in range(pairs):
        j = pairs + i
        for l in range(lanes):
            inverse_i, alpha_i, beta_i, gamma_i = terms_at(c, b, i, l)
            inverse_j, alpha_j, beta_j, gamma_j = terms_at(c, b, j, l)
            c[INVERSE, i, l], c[INVERSE, j, l] = inverse_i, inverse_j
            b[ALPHA, l] = b[ALPHA, l] + alpha_i + alpha_j
            b[BETA, l] = b[BETA, l] + beta_i + beta_j
            b[GAMMA, l] = b[GAMMA, l] + gamma_i + gamma_j
    near, to_solve = ZERO, ZERO
    for l in range(lanes):
        b[OF_W, l], b[OF_I, l], accurate, b[DET, l] = solve_two(
            b[EPS, l], b[P, l], b[SQUARE, l], b[ALPHA, l], b[BETA, l], b[GAMMA, l]
        )
        b[TO_SOLVE, l] = select(accurate, 0.0, 1.0)
        near += b[HALF, l] >= b[NEAR, l]
        to_solve += ~accurate
    return near, to_solve


@formula
def find_small_divisors(c, b, lanes):
    """Multiply b[DET] by the signs of the d; return how many more lanes need elimination."""
    to_solve = ZERO
    for l in range(lanes):
        for i in range(c.shape[1]):
            b[DET, l] *= -1.0 if b[HALF, l] > c[J_, i, l] else 1.0
            if abs(1.0 - b[HALF, l] / c[J_, i, l]) <= FAR_FROM_0 and b[TO_SOLVE, l] == 0.0:
                b[TO_SOLVE, l] = 1.0
                to_solve += 1
    return to_solve


@formula
def add_increments(c, b, lanes):
    """Add the increments (b[OF_W] w_i + b[OF_I] I_i) / d_i to the states c[W], in `lanes` lanes."""
    for i in range(c.shape[1]):
        for l in range(lanes):
            along = b[OF_W, l] * c[W, i, l] + b[OF_I, l] * c[I_, i, l]
            c[W, i, l] = c[W, i, l] + along * c[INVERSE, i, l]


@formula
def compute_sums(c, b, lanes):
    """Compute b[P] = I.w and b[SQUARE] = |w|**2 of lanes, from I = c[I_] and states w = c[W]."""
    pairs = c.shape[1] // 2
    for l in range(lanes):
        b[P, l], b[SQUARE, l] = 0.0, 0.0
    for i in range(pairs):
        j = pairs + i
        for l in range(lanes):
            w_i = c[W, i, l]
            w_j = c[W, j, l]
            b[P, l] = b[P, l] + c[I_, i, l] * w_i + c[I_, j, l] * w_j
            b[SQUARE, l] = b[SQUARE, l] + w_i * w_i + w_j * w_j


@inlined
def eliminate_one(c, b, l, memory):
    """Take the step of lane l of a block (c, b) with pivoting in `memory`; return its status."""
    a, units = memory
    m = len(units[0])
    fill_systems(c, b, a, l, 1)
    system = a.reshape(m, m + 1)
    status = solve(system, units)  # A(w) w_next = w
    b[OF_W, l], b[OF_I, l] = 0.0, 0.0  # so that `add_increments` adds 0
    b[DET, l] = 1.0
    for i in range(m):
        c[W, i, l] = system[i, m]
        c[INVERSE, i, l] = 0.0
        b[DET, l] *= -1.0 if system[i, i] < 0.0 else 1.0
    if status != OK:
        end_lane(c, b, l)
    return status


@inlined
def eliminate_all(c, b, a, lanes):
    """Take the step of a block (c, b) by elimination in `a`, in the lanes that keep their digits.

    Return how many lanes lose digits; b[TO_SOLVE] is 1 in these lanes, else 0.
    """
    m, to_solve = len(a), ZERO
    fill_systems(c, b, a, 0, lanes)
    eliminate(a, b, lanes)
    for l in range(lanes):
        b[TO_SOLVE, l] = 0.0
        b[DET, l] = 1.0
    for i in range(m):
        for l in range(lanes):
            b[TO_SOLVE, l] += 0.0 * a[i, m, l]  # NaN if the solution is not finite
            b[DET, l] *= select(a[i, i, l] < 0.0, -1.0, 1.0)
    for l in range(lanes):
        is_solved = (b[TO_SOLVE, l] == 0.0) & keeps_digits(b, l) | np.isnan(b[EPS, l])
        b[TO_SOLVE, l] = select(is_solved, 0.0, 1.0)
        to_solve += ~is_solved
    for i in range(m):
        for l in range(lanes):
            c[W, i, l] = select(b[TO_SOLVE, l] == 0.0, a[i, m, l], c[W, i, l])
    return to_solve


@formula
def fill_lane(c, l, J, I, w):
    """Fill lane l of a block with J, I and the state w of a trajectory."""
    for i in range(c.shape[1]):
        c[J_, i, l], c[I_, i, l], c[W, i, l] = np.inf, 0.0, 0.0
        if i < len(w):
            c[J_, i, l], c[I_, i, l], c[W, i, l] = J[i], I[i], w[i]


@function
def nd_step_of_one(system, state, out, memory):
    """Write the state after `state` to `out`; return its status. `memory` is from `nd_memory`."""
    return step_one(system, state, out, memory, None)


@function
def gauss_step_of_one(system, state, out, memory):
    """Write the state after `state`, by elimination, to `out`; return its status."""
    return step_one(system, state, out, memory, True)


@inlined
def step_one(system, state, out, memory, by_elimination):
    """Do what `nd_step_of_one` does, by elimination unless `by_elimination` is None."""
    # None in place of False, because Numba removes branches that None decides.
    c, b, a, for_solve, notes = memory
    _, status, _ = notes
    status[0] = OK
    J, I, b[EPS, 0], b[NEAR, 0], _ = system
    fill_lane(c, 0, J, I, state)
    step_block(c, b, a, for_solve, 0, 1, 1, notes, 1, by_elimination)
    for i in range(len(out)):
        out[i] = c[W, i, 0]
    return np.int64(status[0])


@function
def nd_memory(system):
    """Return arrays in which `nd_step_of_one` works, for all its calls."""
    m = system.dimension
    notes = np.zeros((1, 1)), np.zeros(1, np.int8), np.zeros(1, np.int64)
    return np.empty((4, m + m % 2, 1)), np.empty((ROWS, 1)), None, memory_of_one(m), notes


@function
def gauss_memory(system):
    """Return what `nd_memory` returns, with a matrix for steps by elimination."""
    m = system.dimension
    c, b, _, for_solve, notes = nd_memory(system)
    return c, b, np.empty((m, m + 1, 1)), for_solve, notes


class NDSystem(NamedTuple):
    """A body in n dimensions and a step size, for compiled loops of users (`compiled`)."""

    J: Any  # (m,)
    I: Any  # (m,)
    eps: float
    near: float  # bound of h p, see the row NEAR
    dimension: int


class GaussSystem(NDSystem):
    """A body and a step size, for steps by elimination."""

    __slots__ = ()


# Functions that `compiled` calls for an `NDSystem`.
NDSystem.memory, NDSystem.one_step = nd_memory, nd_step_of_one
GaussSystem.memory, GaussSystem.one_step = gauss_memory, gauss_step_of_one


@kernel
def nd_steps(part, parts, parameters, omega0, span, output):
    """Take part `part` of `parts` of the steps of a `Span`, in O(n) operations a step."""
    parameters, omega0, output = uncounted((parameters, omega0, output))
    iterate_nd(part, parts, parameters, omega0, span, output, None)


@kernel
def gauss_steps(part, parts, parameters, omega0, span, output):
    """Take steps as `nd_steps` does, but by elimination."""
    parameters, omega0, output = uncounted((parameters, omega0, output))
    iterate_nd(part, parts, parameters, omega0, span, output, True)


@inlined
def iterate_nd(part, parts, parameters, omega0, span, output, by_elimination):
    """Take steps as `nd_steps` does, by elimination unless `by_elimination` is None."""
    saved, final, carry, status, failed_at = output
    first, last, start, stop, every, next_row = span
    m = omega0.shape[1]
    lanes = lesser(LANES if m <= 24 else LANES // 2, ((last - first or 1) + 7) // 8 * 8)
    block, rows = empty_at_line((4, m + m % 2, lanes)), empty_at_line((1, ROWS, lanes))[0]
    memory = block, rows, memory_of_one(m)
    systems = None if by_elimination is None else empty_at_line((m, m + 1, lanes))
    (c, b, for_solve), a = uncounted(memory), uncounted(systems)
    notes = carry, status, failed_at
    first_block, last_block = share((last - first + lanes - 1) // lanes, part, parts)
    for block in range(first_block, last_block):
        begin = first + block * lanes
        end = lesser(begin + lanes, last)
        row = next_row
        states = omega0 if start == 0 else final
        start_block(c, b, parameters, states, begin, end, start, notes)
        for n in range(start, stop + 1):
            if n > start:
                step_block(c, b, a, for_solve, begin, end, n, notes, lanes, by_elimination)
            if every > 0 and n % every == 0 and (n > start or start == 0):
                write_states(c[W], begin, end, saved[row])
                row += 1
        write_states(c[W], begin, end, final)
    keep(memory)
    keep(systems)


@inlined
def step_block(c, b, a, for_solve, begin, end, n, notes, lanes, by_elimination):
    """Take step n of a block (c, b) of trajectories `begin` to end - 1; note failures and poles."""
    carry, status, failed_at = notes
    if by_elimination is None:
        compute_sums(c, b, lanes)
        near, to_solve = compute_factors(c, b, lanes)
        if near > 0:
            to_solve += find_small_divisors(c, b, lanes)
    else:
        to_solve = eliminate_all(c, b, a, lanes)
    for l in range(lanes if to_solve > 0 else 0):
        if b[TO_SOLVE, l] > 0.0:
            code = eliminate_one(c, b, l, for_solve)
            if code != OK and begin + l < end:
                status[begin + l] = code
                failed_at[begin + l] = n
    for l in range(end - begin):
        if b[DET, l] < 0.0 and status[begin + l] == OK:
            status[begin + l] = PASSED_POLE
            failed_at[begin + l] = n
            carry[0, begin + l] = n
    if by_elimination is None:
        add_increments(c, b, lanes)


@function
def start_block(c, b, parameters, states, begin, end, start, notes):
    """Fill a block (c, b) with trajectories `begin` to end - 1; spare lanes repeat the last one.

    `states` (B, m) have the number `start`. State 0 fails if it is not finite.
    """
    carry, status, failed_at = notes
    J, I, eps = parameters
    for l in range(c.shape[2]):
        k = lesser(begin + l, end - 1)
        undefined, smallest = 0.0, np.inf
        b[EPS, l] = eps[k % len(eps)]
        fill_lane(c, l, J[k % len(J)], I[k % len(I)], states[k])
        for i in range(c.shape[1]):
            undefined += 0.0 * c[W, i, l]
            smallest = lesser(c[J_, i, l], smallest)
        b[NEAR, l] = (1.0 - FAR_FROM_0) * smallest
        if start == 0:
            carry[0, k] = 0.0
            if np.isnan(undefined):
                status[k], failed_at[k] = NONFINITE, 0
        if status[k] < 0:
            end_lane(c, b, l)


@inlined
def end_lane(c, b, l):
    """Set the state and eps of failed lane l of a block (c, b) to NaN: it needs no elimination."""
    b[EPS, l] = np.nan
    for i in range(c.shape[1]):
        c[W, i, l] = np.nan


def nd_steps_side_by_side(parameters, omega0, span, output):
    """Take the steps by NumPy; return False if one loses digits or passes a pole, else True."""
    begin, end, start, stop, every, row = span
    if begin == end:
        return True
    some, m = slice(begin, end), omega0.shape[1]
    saved, final, carry, status, failed_at = output.of(some)
    c, b = np.zeros((4, m + m % 2, 1, end - begin)), np.empty((ROWS, 1, end - begin))
    J, I, eps = (a[some] if len(a) > 1 else a for a in parameters)
    c[J_] = np.inf
    c[J_, :m, 0] = J.T
    c[I_, :m, 0] = I.T
    c[W, :m, 0] = (omega0[some] if start == 0 else final).T
    if start == 0:
        undefined = np.isnan(c[W, :, 0]).any(axis=0)
        status[undefined], failed_at[undefined] = NONFINITE, 0
        carry[:] = 0.0
    c[W, :, 0] = select(status < 0, np.nan, c[W, :, 0])
    b[EPS] = select(status < 0, np.nan, eps)
    b[NEAR] = (1.0 - FAR_FROM_0) * c[J_].min(axis=0)
    for n in range(start, stop + 1):
        if n > start:
            compute_sums(c, b, 1)
            near, to_solve = compute_factors(c, b, 1)
            if ((near > 0) | (to_solve > 0) | (b[DET, 0] < 0.0)).any():
                return False
            add_increments(c, b, 1)
        if every > 0 and n % every == 0 and (n > start or start == 0):
            saved[row] = c[W, :m, 0].T
            row += 1
    final[:] = c[W, :m, 0].T
    return True


nd_steps.in_numpy = as_python(nd_steps_side_by_side, of_arrays=True)
