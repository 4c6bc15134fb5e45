"""Slopes of a field, and solutions of linear systems, for steps of implicit methods.

f_i is the sum of the terms v x_j x_k with x_D = 1, whose i, j and k are `indices` (3, T) and whose
v are `values` (T,).
"""

from .codes import NONFINITE, OK, SINGULAR
from .numba import for_users
from .quantities_field import term

ZERO_TO_ROUNDING = 2.0**-50  # a pivot of a scaled row counts as 0 if it is below D times this


@for_users
def slope_at(x, indices, values, f, derivative):
    """Write f(x) to f (D,), and f'(x) to derivative (D, D), for a step of a map of one's own.

    Parameters
    ----------
    x : ndarray(float64, shape=(D,))
        The state.
    indices, values : ndarray(shape=(3, T)), ndarray(float64, shape=(T,))
        The terms of the field, as `maps.by_field` gives them to a step.
    f, derivative : ndarray(float64, shape=(D,)), ndarray(float64, shape=(D, D))
        Arrays for the slope x' = f(x) and the matrix of its derivatives, df_i / dx_j.

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import QuadraticField, maps
    >>> indices, values = QuadraticField.from_function(lambda x: (x[0] * x[1], 3 - x[1]), 2).terms
    >>> f, derivative = np.empty(2), np.empty((2, 2))
    >>> maps.slope_at(np.array([2.0, 5.0]), indices, values, f, derivative)
    >>> f, derivative
    (array([10., -2.]), array([[ 5.,  2.],
           [ 0., -1.]]))
    """
    D = len(x)
    for i in range(D):
        f[i] = 0.0
        for j in range(D):
            derivative[i, j] = 0.0
    for t in range(len(values)):
        i, j, k = term(indices, t)
        of_j = x[j] if j < D else 1.0
        of_k = x[k] if k < D else 1.0
        f[i] += values[t] * of_j * of_k
        if j < D:
            derivative[i, j] += values[t] * of_k
        if k < D:
            derivative[i, k] += values[t] * of_j


@for_users
def solve(A, b):
    """Solve A y = b by Gaussian elimination, for a step of a map of one's own.

    Rows are divided by their largest modulus, and pivots chosen in columns.

    Parameters
    ----------
    A : ndarray(float64, shape=(D, D))
        The matrix, which is overwritten.
    b : ndarray(float64, shape=(D,))
        The right side, in whose place y is written.

    Returns
    -------
    int
        A `Status`: OK; SINGULAR if a pivot is 0 to rounding; NONFINITE if y is not finite, as for A
        or b with NaN.

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import maps
    >>> b = np.array([5.0, 6.0])
    >>> maps.solve(np.array([[0.0, 1.0], [2.0, 4.0]]), b), b
    (0, array([-7.,  5.]))
    >>> maps.solve(np.ones((2, 2)), b)  # SINGULAR
    -1
    """
    D, undefined = len(b), 0.0
    for i in range(D):
        largest = 0.0
        for j in range(D):
            undefined += 0.0 * A[i, j]
            largest = max(largest, abs(A[i, j]))
        scale = largest if largest > 0.0 else 1.0
        b[i] /= scale
        for j in range(D):
            A[i, j] /= scale
    if undefined != 0.0:
        return NONFINITE
    for k in range(D):
        pivot = k
        for i in range(k + 1, D):
            if abs(A[i, k]) > abs(A[pivot, k]):
                pivot = i
        if abs(A[pivot, k]) <= D * ZERO_TO_ROUNDING:
            return SINGULAR
        if pivot != k:
            b[k], b[pivot] = b[pivot], b[k]
            for j in range(k, D):
                A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
        for i in range(k + 1, D):
            factor = A[i, k] / A[k, k]
            b[i] -= factor * b[k]
            for j in range(k + 1, D):
                A[i, j] -= factor * A[k, j]
    for i in range(D - 1, -1, -1):
        for j in range(i + 1, D):
            b[i] -= A[i, j] * b[j]
        b[i] /= A[i, i]
        undefined += 0.0 * b[i]
    return OK if undefined == 0.0 else NONFINITE
