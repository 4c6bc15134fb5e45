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
w + delta cancels; there lanes take the step by elimination. det A is the determinant of the two
equations times prod (d_i / J_i). Where it is negative, a step passes a pole, or is too long.

parameters   J, I (1 or B, m); eps (1 or B,)
final        (B, m), the states that a run continues from
carry        (1, B), the first state beyond a step from det A < 0, 0 if there is none

A block of lanes is two arrays: c[J_, I_, W or INVERSE, component, lane], and b[row, lane] with
numbers of lanes. The number of components in c is even; if m is odd, the last has J = inf and
I = w = 0. After a failure the state and eps of a lane are NaN, so that it needs no elimination.
"""

from typing import Any, NamedTuple

import numpy as np

from ..numba.arrays import keep, uncounted
from ..numba.decorators import as_python, formula, function, inlined, kernel, share
from ..numba.gauss import NONE, TO_SOLVE, accept, eliminate, memory_of_one, solve
from ..numba.intrinsics import lesser, select
from ..numba.status_codes import NONFINITE, OK, PASSED_POLE
from .blocks import write_states

J_, I_, W, INVERSE = range(4)  # INVERSE: 1 / d
# Rows after those of `elimination`: p, |w|**2 and h p; alpha, beta and gamma; the factors of w / d
# and I / d in delta; eps; a bound of h p below which no d is small; for a row of A, 2 h I_i / J_i,
# h w_i / J_i and p - I_i w_i; and a number with the sign of det A.
(P, SQUARE, HALF, ALPHA, BETA, GAMMA, OF_W, OF_I) = range(TO_SOLVE + 1, TO_SOLVE + 9)
EPS, NEAR, ROW_W, ROW_I, OTHERS, DET, ROWS = range(OF_I + 1, OF_I + 8)
LANES = 64  # enough that a sum over components does not wait for the store of the one before
# A step in O(n) keeps its digits if |d_i| / J_i > FAR_FROM_0, the determinant of the two equations
# is above LEAST_DET times the sum of the moduli of its terms, and w.w_next > LEAST_COSINE |w|**2.
FAR_FROM_0, LEAST_DET, LEAST_COSINE = 0.25, 0.0625, 0.125


@formula
def sum_terms(J, I, w, half):
    """Return 1 / d, I w / d, I**2 / d and w**2 / d, where d = J - half and half = (eps / 2) I.w."""
    inverse = 1.0 / (J - half)
    along = I * inverse
    return inverse, along * w, along * I, w * inverse * w


@formula
def solve_two(eps, p, square, alpha, beta, gamma):
    """Solve the two equations for I.delta and w.delta (see the top) by Cramer's rule.

    The increment of a step is delta_i = (u w_i + v I_i) / d_i. Return u and v, True if they are
    accurate, and the determinant. p is I.w, `square` |w|**2, and alpha, beta and gamma are sums of
    I w / d, I**2 / d and w**2 / d.
    """
    h = 0.5 * eps
    a11, a12, b1 = 1.0 - h * alpha, eps * beta, eps * (p * alpha - square * beta)
    a21, a22, b2 = -h * gamma, 1.0 + eps * alpha, eps * (p * gamma - square * alpha)
    det = a11 * a22 - a12 * a21
    size = (1.0 + abs(h * alpha)) * (1.0 + abs(eps * alpha)) + abs(a12 * a21)
    inverse = 1.0 / det
    I_delta, w_delta = (a22 * b1 - a12 * b2) * inverse, (a11 * b2 - a21 * b1) * inverse
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
        for l in range(begin, begin + lanes):  # without w_i, which cancels in p - I_i w_i
            a[i, i, l - begin] = 1.0 - 0.5 * b[EPS, l] * b[OTHERS, l] / c[J_, i, l]


@formula
def compute_factors(c, b, lanes):
    """Prepare the increments of states of a block (c, b); return how many lanes need elimination.

    The increment of w_i is (b[OF_W] w_i + b[OF_I] I_i) / d_i, and c[INVERSE] is 1 / d. Terms i and
    M/2 + i are added in pairs, which halves the number of stores.
    """
    M = c.shape[1]
    pairs = M // 2
    for l in range(lanes):
        b[HALF, l] = 0.5 * b[EPS, l] * b[P, l]
        b[ALPHA, l], b[BETA, l], b[GAMMA, l] = 0.0, 0.0, 0.0
    for i in range(pairs):
        j = pairs + i
        for l in range(lanes):
            inverse_i, alpha_i, beta_i, gamma_i = sum_terms(
                c[J_, i, l], c[I_, i, l], c[W, i, l], b[HALF, l]
            )
            inverse_j, alpha_j, beta_j, gamma_j = sum_terms(
                c[J_, j, l], c[I_, j, l], c[W, j, l], b[HALF, l]
            )
            c[INVERSE, i, l], c[INVERSE, j, l] = inverse_i, inverse_j
            b[ALPHA, l] = b[ALPHA, l] + alpha_i + alpha_j
            b[BETA, l] = b[BETA, l] + beta_i + beta_j
            b[GAMMA, l] = b[GAMMA, l] + gamma_i + gamma_j
    near, to_solve = NONE, NONE
    for l in range(lanes):
        b[OF_W, l], b[OF_I, l], accurate, b[DET, l] = solve_two(
            b[EPS, l], b[P, l], b[SQUARE, l], b[ALPHA, l], b[BETA, l], b[GAMMA, l]
        )
        b[TO_SOLVE, l] = select(accurate, 0.0, 1.0)
        near += b[HALF, l] >= b[NEAR, l]
        to_solve += ~accurate
    if near > 0:
        for l in range(lanes):
            for i in range(M):
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
            w_i, w_j = c[W, i, l], c[W, j, l]
            b[P, l] = b[P, l] + c[I_, i, l] * w_i + c[I_, j, l] * w_j
            b[SQUARE, l] = b[SQUARE, l] + w_i * w_i + w_j * w_j


@inlined
def eliminate_one(c, b, l, memory):
    """Take the step of lane l of a block (c, b) with pivoting in `memory`; return its status."""
    a, units = memory
    m = len(units[0])
    fill_systems(c, b, a, l, 1)
    system = a.reshape(m, m + 1)
    status = solve(system, units)  # equation (16)
    b[OF_W, l], b[OF_I, l], b[DET, l] = 0.0, 0.0, 1.0
    for i in range(m):
        c[W, i, l], c[INVERSE, i, l] = system[i, m], 0.0
        b[DET, l] *= -1.0 if system[i, i] < 0.0 else 1.0
    if status != OK:
        end_lane(c, b, l)
    return status


@inlined
def eliminate_all(c, b, a, lanes):
    """Take the step of a block (c, b) by elimination in `a`; return how many lanes need `solve`."""
    m = len(a)
    fill_systems(c, b, a, 0, lanes)
    eliminate(a, b, lanes)
    for l in range(lanes):
        b[TO_SOLVE, l], b[DET, l] = 0.0, 1.0
    for i in range(m):
        for l in range(lanes):
            b[TO_SOLVE, l] += 0.0 * a[i, m, l]  # NaN if the solution is not finite
            b[DET, l] *= select(a[i, i, l] < 0.0, -1.0, 1.0)
    return accept(a, c[W], b, lanes)


@inlined
def start_one(system, state, c, b):
    """Fill a block (c, b) of one lane with the body and step size of an `NDSystem`, and a state."""
    J, I, b[EPS, 0], b[NEAR, 0], _ = system
    for i in range(c.shape[1]):
        c[J_, i, 0], c[I_, i, 0], c[W, i, 0] = np.inf, 0.0, 0.0
        if i < len(J):
            c[J_, i, 0], c[I_, i, 0], c[W, i, 0] = J[i], I[i], state[i]


@inlined
def end_one(c, b, out, status):
    """Write the state of a block (c, b) to `out`; return `status`, PASSED_POLE if OK, det A < 0."""
    for i in range(len(out)):
        out[i] = c[W, i, 0]
    return PASSED_POLE if status == OK and b[DET, 0] < 0.0 else status


@function
def nd_step_of_one(system, state, out, memory):
    """Write the state after `state` to `out`; return its status. `memory` is from `nd_memory`."""
    (c, b, for_solve), status = memory, OK
    start_one(system, state, c, b)
    compute_sums(c, b, 1)
    if compute_factors(c, b, 1) > 0:
        status = eliminate_one(c, b, 0, for_solve)
    add_increments(c, b, 1)
    return end_one(c, b, out, status)


@function
def gauss_step_of_one(system, state, out, memory):
    """Write the state after `state`, by elimination in `memory`, to `out`; return its status."""
    ((c, b, for_solve), a), status = memory, OK
    start_one(system, state, c, b)
    if eliminate_all(c, b, a, 1) > 0 or np.isnan(c[W, 0, 0]):  # `accept` leaves out NaN
        status = eliminate_one(c, b, 0, for_solve)
    return end_one(c, b, out, status)


@function
def nd_memory(system):
    """Return arrays in which `nd_step_of_one` works, for all its calls."""
    m = system.dimension
    return np.empty((4, m + m % 2, 1)), np.empty((ROWS, 1)), memory_of_one(m)


@function
def gauss_memory(system):
    """Return arrays in which `gauss_step_of_one` works, for all its calls."""
    m = system.dimension
    return nd_memory(system), np.empty((m, m + 1, 1))


class NDSystem(NamedTuple):
    """A body in n dimensions and a step size, for compiled loops of users (`compiled`)."""

    J: Any  # (m,)
    I: Any  # (m,)
    eps: float
    near: float  # see row NEAR
    dimension: int


class GaussSystem(NDSystem):
    """A body and a step size, for steps by elimination."""

    __slots__ = ()


# What `compiled` calls for a system of these kinds.
NDSystem.memory, NDSystem.one_step = nd_memory, nd_step_of_one
GaussSystem.memory, GaussSystem.one_step = gauss_memory, gauss_step_of_one


@kernel
def nd_steps(part, parts, parameters, omega0, span, output):
    """Iterate part `part` of `parts` of the trajectories, in O(n) a step.

    `parameters` are J, I (1 or B, m) and eps; `omega0` (B, m) is state 0. `carry` (1, B) of the
    `output` has n of first states past poles, or 0.
    """
    parameters, omega0, output = uncounted((parameters, omega0, output))
    iterate_nd(part, parts, parameters, omega0, span, output, None)


@kernel
def gauss_steps(part, parts, parameters, omega0, span, output):
    """Iterate part `part` of `parts` of the trajectories, by elimination with m unknowns a step.

    `nd_steps` explains the arguments.
    """
    parameters, omega0, output = uncounted((parameters, omega0, output))
    iterate_nd(part, parts, parameters, omega0, span, output, True)


@inlined
def iterate_nd(part, parts, parameters, omega0, span, output, by_elimination):
    """Iterate part `part` of `parts` of the trajectories, by elimination or in O(n) a step.

    `by_elimination` is True, or None for O(n): Numba removes branches by None. The others are the
    arguments of `nd_steps`.
    """
    saved, final, carry, _, _ = output
    first, last, start, stop, every, next_row = span
    m = omega0.shape[1]
    lanes = lesser(LANES if m <= 24 else LANES // 2, ((last - first or 1) + 7) // 8 * 8)
    memory = np.empty((4, m + m % 2, lanes)), np.empty((ROWS, lanes)), memory_of_one(m)
    systems = None if by_elimination is None else np.empty((m, m + 1, lanes))
    (c, b, for_solve), a = uncounted(memory), uncounted(systems)
    first_block, last_block = share((last - first + lanes - 1) // lanes, part, parts)
    for block in range(first_block, last_block):
        begin, row = first + block * lanes, next_row
        end = lesser(begin + lanes, last)
        states = omega0 if start == 0 else final
        start_block(c, b, parameters, states, begin, end, start, output)
        for k in range(begin, end if start == 0 else begin):
            carry[0, k] = 0.0
        for n in range(start, stop + 1):
            if n > start:
                step_block(c, b, a, for_solve, begin, end, n, output, by_elimination)
            if every > 0 and n % every == 0 and (n > start or start == 0):
                write_states(c[W], begin, end, saved[row])
                row += 1
        write_states(c[W], begin, end, final)
    keep(memory)
    keep(systems)


@inlined
def step_block(c, b, a, for_solve, begin, end, n, output, by_elimination):
    """Take step n of a block (c, b) of trajectories `begin` to end - 1.

    `a` (m, m + 1, lanes) and `for_solve` are memory for elimination, without and with pivoting.
    The `output` receives failures and poles. `by_elimination` is None for a step in O(n), else
    True.
    """
    _, _, carry, status, failed_at = output
    lanes = c.shape[2]
    if by_elimination is None:
        to_solve = compute_factors(c, b, lanes)
    else:
        to_solve = eliminate_all(c, b, a, lanes)
    for l in range(lanes if to_solve > 0 else 0):
        if b[TO_SOLVE, l] > 0.0:
            code = eliminate_one(c, b, l, for_solve)
            if code != OK and begin + l < end:
                status[begin + l], failed_at[begin + l] = code, n
    for l in range(end - begin):
        if b[DET, l] < 0.0 and status[begin + l] == OK:
            status[begin + l], failed_at[begin + l] = PASSED_POLE, n
            carry[0, begin + l] = n
    if by_elimination is None:
        add_increments(c, b, lanes)
        compute_sums(c, b, lanes)


@function
def start_block(c, b, parameters, states, begin, end, start, output):
    """Fill a block (c, b) with trajectories begin to end - 1; spare lanes repeat the last one.

    `parameters` are J, I and eps. `states` (B, m) have the number `start`. If it is 0, states that
    are not finite have failed at state 0, with the status NONFINITE.
    """
    _, _, _, status, failed_at = output
    (J, I, eps), m = parameters, states.shape[1]
    for l in range(c.shape[2]):
        k, undefined, smallest = lesser(begin + l, end - 1), 0.0, np.inf
        b[EPS, l] = eps[k % len(eps)]
        for i in range(c.shape[1]):
            c[J_, i, l], c[I_, i, l], c[W, i, l] = np.inf, 0.0, 0.0
            if i < m:
                c[J_, i, l], c[I_, i, l] = J[k % len(J), i], I[k % len(I), i]
                c[W, i, l] = states[k, i]
            undefined += 0.0 * c[W, i, l]
            smallest = lesser(c[J_, i, l], smallest)
        b[NEAR, l] = (1.0 - FAR_FROM_0) * smallest
        if start == 0 and np.isnan(undefined):
            status[k], failed_at[k] = NONFINITE, 0
        if status[k] < 0:
            end_lane(c, b, l)
    compute_sums(c, b, c.shape[2])


@inlined
def end_lane(c, b, l):
    """Set the state and eps of failed lane l of a block (c, b) to NaN: it needs no elimination."""
    b[EPS, l] = np.nan
    for i in range(c.shape[1]):
        c[W, i, l] = np.nan


def _sums_of_all(I, w):
    """Return p = I.w and |w|**2 of states w (M, B), added in the order of `compute_sums`."""
    p = square = 0.0
    pairs = len(w) // 2
    for i, j in zip(range(pairs), range(pairs, 2 * pairs), strict=True):
        p = p + I[i] * w[i] + I[j] * w[j]
        square = square + w[i] * w[i] + w[j] * w[j]
    return p, square


def nd_steps_side_by_side(parameters, omega0, span, output):
    """Take the steps by NumPy and return True; return False if one loses digits or passes a pole.

    `nd_steps` explains the arguments. `carry` becomes 0 if start is 0.
    """
    begin, end, start, stop, every, row = span
    saved, final, carry, status, failed_at = output
    if begin == end:
        return True
    own, m = slice(begin, end), omega0.shape[1]
    J, I, eps = (a[own].T if len(a) > 1 else a.T for a in parameters)
    to_even = (0, m % 2), (0, 0)
    J, I = np.pad(J, to_even, constant_values=np.inf), np.pad(I, to_even)
    w = np.pad((omega0 if start == 0 else final)[own].T, to_even)
    if start == 0:
        undefined = np.isnan(w).any(axis=0)
        status[own][undefined], failed_at[own][undefined], carry[0, own] = NONFINITE, 0, 0.0
    ended = status[own] < 0
    w[:, ended], eps = np.nan, select(ended, np.nan, eps)
    near, pairs, inverse = (1.0 - FAR_FROM_0) * J.min(axis=0), len(w) // 2, np.empty_like(w)
    p, square = _sums_of_all(I, w)
    for n in range(start, stop + 1):
        if n > start:
            half, alpha, beta, gamma = 0.5 * eps * p, 0.0, 0.0, 0.0
            for i in range(pairs):
                j = pairs + i
                inverse[i], alpha_i, beta_i, gamma_i = sum_terms(J[i], I[i], w[i], half)
                inverse[j], alpha_j, beta_j, gamma_j = sum_terms(J[j], I[j], w[j], half)
                alpha = alpha + alpha_i + alpha_j
                beta = beta + beta_i + beta_j
                gamma = gamma + gamma_i + gamma_j
            of_w, of_I, accurate, det = solve_two(eps, p, square, alpha, beta, gamma)
            if ((half >= near) | ~accurate | (det < 0.0)).any():
                return False
            w = w + (of_w * w + of_I * I) * inverse
            p, square = _sums_of_all(I, w)
        if every > 0 and n % every == 0 and (n > start or start == 0):
            saved[row, own], row = w[:m].T, row + 1
    final[own] = w[:m].T
    return True


nd_steps.in_numpy = as_python(nd_steps_side_by_side, of_arrays=True)
