"""Steps of one state in ordinary range, for loops of users: no units, no scaling, no lanes."""

import numpy as np

from .._formulas.elementary import larger, smaller
from .._formulas.equations import next_coordinates, turn_of_gyrostat
from .._formulas.nd_map import matrix_row, next_component, slope_of_itself, solve2, sum_terms
from .._jit import formula, select
from . import map_field
from .codes import OK
from .map_canonical import SMALLEST_SQUARED
from .one_system import solve_system

# One state can be solved again at little cost, so bounds are closer than those of many lanes: of
# |det| in units of its terms, of pivots, and of the sum of a state and its increment.
LEAST_DET, LEAST_PIVOT, LEAST_SUM = 0.25, 2.0**-3, 2.0**-3
# c of `coordinates.shifted`; in interpreted runs, no division by a float of NumPy raises.
NOT_SHIFTED = np.float64(0.0)


@formula
def step_of_body(X, Y):
    """X and Y of the next state; X becomes 0 before its square is subnormal, if it decreases."""
    moving = select((abs(X) < SMALLEST_SQUARED) & (Y < 0.0), 0.0, X)
    next_X, Z = next_coordinates(moving, X, NOT_SHIFTED, -Y)
    return next_X, -Z


@formula
def step_of_gyrostat(K, a, b, u, v):
    """Turn u + i v, for X = K + a u + b v and Y = b u - a v."""
    X, Y = K + (a * u + b * v), b * u - a * v
    _, along, across = turn_of_gyrostat(X, NOT_SHIFTED, -Y, K)
    return along * u - across * v, along * v + across * u


@formula
def step_nd(J, I, eps, near, longest, omega, out, system, scales):
    """Take a step in O(n) where that is accurate, see `map_nd`, else by elimination."""
    m, matrix, inverse, p, square = len(omega), system[0], scales[0], 0.0, 0.0
    for i in range(m):
        p += I[i] * omega[i]
        square += omega[i] * omega[i]
    half, alpha, beta, gamma = 0.5 * eps * p, 0.0, 0.0, 0.0
    for i in range(m):
        inverse[i], of_alpha, of_beta, of_gamma = sum_terms(J[i], I[i], omega[i], half)
        alpha, beta, gamma = alpha + of_alpha, beta + of_beta, gamma + of_gamma
    of_omega, of_I, det, size = solve2(eps, p, square, alpha, beta, gamma)
    if (det > LEAST_DET * size) & (square < longest) & (half < near):
        for i in range(m):
            out[i] = next_component(I[i], omega[i], inverse[i], of_omega, of_I)
        return OK
    for i in range(m):
        of_omega, of_I = matrix_row(J[i], I[i], omega[i], eps)
        others = 0.0
        for j in range(m):
            matrix[i, j] = -of_omega * omega[j] - of_I * I[j]
            others += 0.0 if j == i else I[j] * omega[j]
        matrix[i, i] = 1.0 - slope_of_itself(J[i], others, eps)
        matrix[i, m] = omega[i]
    return solved(system, scales, out)


@formula
def step_of_field(indices, values, half, slopes, x, out, system, scales):
    """Take a step by elimination with the diagonal as pivots, see `elimination`, where that is
    accurate, else by `solve_system`.
    """
    D, matrix, largest, least = len(x), system[0], 1.0, np.inf
    map_field.fill_equations(indices, values, 0, half, slopes, x, matrix)
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
    if (least > LEAST_PIVOT * largest) & (size > LEAST_SUM * way) & (size < np.inf):
        for i in range(D):
            out[i] = map_field.after_increment(x[i], matrix[i, D])
        return OK
    map_field.fill_equations(indices, values, 0, half, slopes, x, matrix)
    map_field.fill_next(slopes, x, matrix)
    return solved(system, scales, out)


@formula
def solved(system, scales, out):
    """Solve a system for the next state, which is NaN unless the status is OK."""
    status = solve_system(system, scales)
    for i in range(len(out)):
        out[i] = system[0, i, len(out)] if status == OK else np.nan
    return status
