"""Steps of one state in ordinary range, for loops of users: no units, no scaling, no lanes.

Functions of arrays return True, or False where they lose digits and `solve` has to follow.
"""

import numpy as np

from .._formulas.coordinates import ZERO_TO_ROUNDING
from .._formulas.elementary import larger, smaller
from .._formulas.equations import denominator
from .._formulas.nd_map import matrix_row, slope_of_itself, solve2
from .._jit import formula, select
from .codes import NONFINITE, OK, SINGULAR
from .map_canonical import LARGE, SMALLEST_SQUARED
from .one_system import solve_system

# One state can be solved again at little cost, so bounds are closer than those of many lanes: of
# |det| in units of its terms, of pivots, and of the sum of a state and its increment.
LEAST_DET, LEAST_PIVOT, LEAST_SUM = 0.25, 2.0**-3, 2.0**-3


@formula
def advance(X, Y):
    """Equation (8) with one division, see `map_canonical`; NaN at poles.

    Nothing waits for the division that can be done beside it. X becomes 0 before its square is
    subnormal, if it decreases. The test for a pole is that of `equations.denominator`: there
    1 + Y is 2 (1 + X**2).
    """
    double, below, above = 2.0 * X, 1.0 - Y, 1.0 + Y
    square = double * X
    D = below + square
    exists = abs(D) > ZERO_TO_ROUNDING * smaller(abs(above), 2.0**20 * square)
    inverse = select(exists, 1.0 / D, np.nan)
    of_X = select((abs(X) < SMALLEST_SQUARED) & (Y < 0.0), 0.0, X * above)
    small_change = Y - (double * of_X) * inverse
    return of_X * inverse, select(abs(X) > LARGE, (Y * below - square) * inverse, small_change)


@formula
def advance_gyrostat(K, a, b, u, v):
    """Multiply u + i v by (1 + i X_next) / (1 - i X) = (1 - Y - K X + 2 i X) / D, see
    `map_gyrostat`; NaN at poles. X = K + a u + b v, Y = b u - a v.
    """
    X, Y = K + (a * u + b * v), b * u - a * v
    inverse = 1.0 / denominator(X, 0.0, -Y, K)
    along, across = (1.0 - Y - K * X) * inverse, 2.0 * X * inverse
    return along * u - across * v, along * v + across * u


@formula
def step_nd(J, I, eps, near, longest, omega, out, inverse):
    """Take a step in O(n), see `map_nd`."""
    m, p, square = len(omega), 0.0, 0.0
    for i in range(m):
        p += I[i] * omega[i]
        square += omega[i] * omega[i]
    half, alpha, beta, gamma = 0.5 * eps * p, 0.0, 0.0, 0.0
    for i in range(m):
        r = 1.0 / (J[i] - half)
        inverse[i] = r
        alpha += I[i] * r * omega[i]
        beta += I[i] * r * I[i]
        gamma += omega[i] * r * omega[i]
    of_omega, of_I, det, size = solve2(eps, p, square, alpha, beta, gamma)
    accurate = (det > LEAST_DET * size) & (square < longest) & (half < near)
    if accurate:
        for i in range(m):
            out[i] = omega[i] + (of_omega * omega[i] - of_I * I[i]) * inverse[i]
    return accurate


@formula
def fill_nd(J, I, eps, omega, matrix):
    """Fill A(omega), and omega as the right side."""
    m = len(omega)
    for i in range(m):
        of_omega, of_I = matrix_row(J[i], I[i], omega[i], eps)
        others = 0.0
        for j in range(m):
            matrix[i, j] = -of_omega * omega[j] - of_I * I[j]
            others += 0.0 if j == i else I[j] * omega[j]
        matrix[i, i] = 1.0 - slope_of_itself(J[i], others, eps)
        matrix[i, m] = omega[i]


@formula
def step_of_field(D, quadratic, slopes, x, out, matrix):
    """Take a step of Kahan's map by elimination with the diagonal as pivots, see `elimination`."""
    fill_field(D, quadratic, slopes, x, matrix)
    largest, least = 1.0, np.inf
    for k in range(D):
        largest = larger(abs(matrix[k, k]), largest)
    for k in range(D):
        least = smaller(abs(matrix[k, k]), least)
        inverse = 1.0 / matrix[k, k]
        for j in range(k + 1, D + 1):
            matrix[k, j] *= inverse
        for i in range(k + 1, D):
            factor = matrix[i, k]
            for j in range(k + 1, D + 1):
                matrix[i, j] -= factor * matrix[k, j]
            largest = larger(abs(matrix[i, i]), largest)
    size, way = 0.0, 0.0
    for i in range(D - 1, -1, -1):
        for j in range(i + 1, D):
            matrix[i, D] -= matrix[i, j] * matrix[j, D]
        size += abs(x[i] - 2.0 * matrix[i, D])
        way += abs(matrix[i, D])
    accurate = (least > LEAST_PIVOT * largest) & (size > LEAST_SUM * way) & (size < np.inf)
    if accurate:
        for i in range(D):
            out[i] = next_component(x[i], matrix[i, D])
    return accurate


@formula
def next_component(x, half):
    """The sum of a component and its increment, minus twice `half`; -0.0 remains."""
    return select(half == 0.0, x, x - 2.0 * half)


@formula
def solve_field(quadratic, slopes, x, out, system, scales):
    """Take a step by `solve`; a component that its increment cancels is the solution of
    A x_next = x + (eps/2) l x + eps c.
    """
    D, matrix = len(x), system[0]
    fill_field(D, quadratic, slopes, x, matrix)
    for i in range(D):
        matrix[i, D + 1] = x[i] + 2.0 * slopes[i, D]
        for j in range(D):
            matrix[i, D + 1] += slopes[i, j] * x[j]
    status = solve(system, scales)
    for i in range(D):
        after = next_component(x[i], matrix[i, D])
        cancelled = abs(after) < LEAST_SUM * abs(matrix[i, D])
        out[i] = select(cancelled, matrix[i, D + 1], after)
    return status


@formula
def fill_field(D, quadratic, slopes, x, matrix):
    """Fill A(x), and minus half the step size times f(x) as the right side."""
    for i in range(D):
        for j in range(D):
            matrix[i, j] = 0.0
        for k in range(D):
            for j in range(D):
                matrix[i, j] += quadratic[i, k, j] * x[k]
        right = -slopes[i, D]
        for j in range(D):
            right -= (0.5 * matrix[i, j] + slopes[i, j]) * x[j]
            matrix[i, j] = -matrix[i, j] - slopes[i, j]
        matrix[i, i] += 1.0
        matrix[i, D] = right


@formula
def solve(system, scales):
    """Solve a system, see `solve_system`; return the status of the solutions, NaN unless OK.

    NaN from finite equations is a pole, otherwise an overflow.
    """
    m, finite, size = scales.shape[1], 0.0, 0.0
    for i in range(m):
        for j in range(system.shape[2]):
            finite += 0.0 * system[0, i, j]
    solve_system(system, scales)
    for i in range(m):
        size += abs(system[0, i, m])
    if size < np.inf:
        return OK
    for i in range(m):
        system[0, i, m] = np.nan
    return SINGULAR if finite == 0.0 and np.isnan(size) else NONFINITE
