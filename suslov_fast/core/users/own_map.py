"""Steps of users: a kernel that takes them along trajectories, made from a step of one state.

`tests/package/test_kernels.py` says what a kernel must do; its arguments are those of
`steps_3d.steps`, but for

arguments    arrays, the step sizes last; arrays of float64 have a row for each trajectory, or one
             for all
carry        (2, B), the first state with a positive status, 0 if there is none, and this status

Steps of implicit methods call `slope_at` and `solve`. With x_D = 1, f_i is the sum of the terms
v x_j x_k whose i, j and k are `indices` (3, T), and whose v are `values` (T,).
"""

import numpy as np

from ..compiling.codes import NONFINITE, OK, SINGULAR
from ..compiling.elimination import eliminate_below, exchange
from ..compiling.numba import Kernel, for_users, function, rows_of, share
from ..fields.quantities import term

CARRIED = 2
ZERO_TO_ROUNDING = 2.0**-50  # a pivot of a scaled row counts as 0 if it is below D times this


class KernelOfStep(Kernel):
    """A kernel that `steps_of` made from `step`; `size(D)` is the length of its memory."""


def steps_of(step, work):
    """Return the kernel of step(x, out, eps, work, *row), with memory for `work` numbers.

    A step sees only its own memory, so that it cannot break the contract of kernels.
    """
    size = _compiled(work if callable(work) else lambda D: work)
    step = _compiled(step)

    @KernelOfStep
    def steps(part, parts, arguments, omega0, carry, span, saved, final, status, failed_at):
        begin, end, start, stop, every, next_row = span
        eps, D = arguments[-1], omega0.shape[1]
        x, out = np.empty(D), np.empty(D)
        memory = np.zeros(size(D))  # so that steps which remember do so alike, and trials see it
        first, last = share(end - begin, part, parts)
        for i in range(begin + first, begin + last):
            h, own, row, undefined = eps[i % len(eps)], rows_of(arguments[:-1], i), next_row, 0.0
            for d in range(D):
                x[d] = omega0[i, d] if start == 0 else final[i, d]
                undefined += 0.0 * x[d]
            if start == 0:
                carry[0, i], carry[1, i] = 0.0, OK
                if np.isnan(undefined):
                    status[i], failed_at[i] = NONFINITE, 0
            for n in range(start, stop + 1):
                if n > start and status[i] >= 0:
                    for d in range(D):
                        out[d] = np.nan  # in case `step` does not set a component
                    code, undefined = step(x, out, h, memory, *own), 0.0
                    for d in range(D):
                        x[d] = out[d]
                        undefined += 0.0 * x[d]
                    if code >= 0 and np.isnan(undefined):
                        code = NONFINITE
                    if code < 0 or (code > 0 and status[i] == OK):
                        status[i], failed_at[i] = code, n
                        if code > 0:
                            carry[0, i], carry[1, i] = n, code
                if status[i] < 0:
                    for d in range(D):
                        x[d] = np.nan
                if every > 0 and n % every == 0 and (n > start or start == 0):
                    for d in range(D):
                        saved[row, i, d] = x[d]
                    row += 1
            for d in range(D):
                final[i, d] = x[d]

    steps.step, steps.size = step, size
    return steps


def _compiled(py_func):
    return py_func if hasattr(py_func, "py_func") else function(py_func)


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
        pivot = exchange(A, k, 1.0)
        if abs(A[k, k]) <= D * ZERO_TO_ROUNDING:
            return SINGULAR
        b[k], b[pivot] = b[pivot], b[k]
        eliminate_below(A, k)
        for i in range(k + 1, D):
            b[i] -= A[i, k] * b[k]
    for i in range(D - 1, -1, -1):
        for j in range(i + 1, D):
            b[i] -= A[i, j] * b[j]
        b[i] /= A[i, i]
        undefined += 0.0 * b[i]
    return OK if undefined == 0.0 else NONFINITE
