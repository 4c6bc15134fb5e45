"""Loops over the steps of an orbit and of small displacements from it.

Growth is a product of factors, held as (product, exponent) in the sense of `multiplied`.
"""

import math

import numpy as np
from numba import prange

from ..formulas.canonical_map import guarded_step, shifted
from ..formulas.coordinates import at_rest, from_canonical, to_canonical
from ..formulas.tangent import canonical_derivative, mean_logarithm, multiplied, times_matrix
from ..jit import Loop, part

# Trajectories that a task takes side by side; what they need fits in the first cache.
LANES = 128
# More tasks than the threads of any machine that this is likely to meet.
TASKS = 64
# A state X this small on its way to a fixed point becomes 0: subnormals are slow.
NEGLIGIBLE = 2.0**-960
# A pivot this much smaller than those before it, times m, is zero to rounding.
ZERO_TO_ROUNDING = 2.0**-50

# Rows of a block in three dimensions: the state (X, Z) and c; a displacement in (X, Y); the matrix
# that takes it to omega, up to a factor; the growth of its length and that of the area. They stand
# in one flat array at offsets that the compiler knows, so that it sees that none overlap.
X_, Z_, C_, V1, V2, M11, M12, M21, M22, LENGTH, OF_LENGTH, AREA, OF_AREA, ROWS = range(14)


def _enter(I1, I2, I13, I23, eps, omega, carried):
    """Fill the rows (ROWS, B) of orbits from their states (B, 2); displacements are along e1."""
    for i in prange(omega.shape[0]):
        X, Y, lost = to_canonical(I1[i], I2[i], I13[i], I23[i], eps[i], omega[i, 0], omega[i, 1])
        m11, m12, m21, m22 = from_canonical(I1[i], I2[i], I13[i], I23[i], eps[i])
        largest = max(max(abs(m11), abs(m12)), max(abs(m21), abs(m22)))
        m11, m12, m21, m22 = m11 / largest, m12 / largest, m21 / largest, m22 / largest
        if at_rest(I13[i], I23[i], eps[i], X, Y):
            X, Y, lost = 0.0, 0.0, 0.0
            m11, m12, m21, m22 = 1.0, 0.0, 0.0, 1.0
        c, Z = shifted(Y, lost)
        carried[X_, i], carried[Z_, i], carried[C_, i] = X, Z, c
        det = m11 * m22 - m12 * m21
        d11, d12, d21, d22, _ = canonical_derivative(X, Z, c)
        v1, v2 = m22 / det, -m21 / det
        if d11 * v1 + d12 * v2 == 0.0 and d21 * v1 + d22 * v2 == 0.0:  # lost in the first step
            v1, v2 = -m12 / det, m11 / det
        carried[V1, i], carried[V2, i] = v1, v2
        carried[M11, i], carried[M12, i], carried[M21, i], carried[M22, i] = m11, m12, m21, m22
        carried[LENGTH, i], carried[AREA, i] = 1.0, 1.0
        carried[OF_LENGTH, i], carried[OF_AREA, i] = 0.0, 0.0


@part
def advance(rows):
    """One step of a block."""
    for l in range(LANES):
        X, Z, c = rows[X_ * LANES + l], rows[Z_ * LANES + l], rows[C_ * LANES + l]
        v1, v2 = rows[V1 * LANES + l], rows[V2 * LANES + l]
        d11, d12, d21, d22, det = canonical_derivative(X, Z, c)
        v1, v2 = d11 * v1 + d12 * v2, d21 * v1 + d22 * v2
        u1 = rows[M11 * LANES + l] * v1 + rows[M12 * LANES + l] * v2
        u2 = rows[M21 * LANES + l] * v1 + rows[M22 * LANES + l] * v2
        length = np.sqrt(u1 * u1 + u2 * u2)
        rows[V1 * LANES + l], rows[V2 * LANES + l] = v1 / length, v2 / length
        X_next, Z_next = guarded_step(X, Z, c, np.inf)
        # A derivative exists where a next state does.
        poison = 0.0 * X_next
        rows[LENGTH * LANES + l], rows[OF_LENGTH * LANES + l] = multiplied(
            rows[LENGTH * LANES + l], rows[OF_LENGTH * LANES + l], length + poison
        )
        rows[AREA * LANES + l], rows[OF_AREA * LANES + l] = multiplied(
            rows[AREA * LANES + l], rows[OF_AREA * LANES + l], det + poison
        )
        rests = abs(X_next) < NEGLIGIBLE and Z_next > c
        rows[X_ * LANES + l], rows[Z_ * LANES + l] = 0.0 if rests else X_next, Z_next


def _iterate(steps, carried, scratch):
    """So many steps of all orbits.

    carried   (ROWS, B), read and written.
    scratch   (tasks, ROWS LANES), one for each task.
    """
    batch, n_tasks = carried.shape[1], scratch.shape[0]
    n_blocks = (batch + LANES - 1) // LANES
    for task in prange(n_tasks):
        rows = scratch[task]
        for block in range(task * n_blocks // n_tasks, (task + 1) * n_blocks // n_tasks):
            first = block * LANES
            width = min(LANES, batch - first)
            for r in range(ROWS * LANES):
                rows[r] = 0.0
            for r in range(ROWS):
                for l in range(width):
                    rows[r * LANES + l] = carried[r, first + l]
            for _ in range(steps):
                advance(rows)
            for r in range(ROWS):
                for l in range(width):
                    carried[r, first + l] = rows[r * LANES + l]


@part
def factorise(matrix, order):
    """L U of a matrix, in place, with partial pivoting; whether it is regular."""
    m = matrix.shape[0]
    size = 0.0
    for k in range(m):
        pivot = k
        for i in range(k + 1, m):
            pivot = i if abs(matrix[i, k]) > abs(matrix[pivot, k]) else pivot
        order[k] = pivot
        for j in range(m):
            other = matrix[pivot, j]
            matrix[pivot, j] = matrix[k, j]
            matrix[k, j] = other
        size = max(size, abs(matrix[k, k]))
        if not abs(matrix[k, k]) > ZERO_TO_ROUNDING * m * size:
            return False
        for i in range(k + 1, m):
            factor = matrix[i, k] / matrix[k, k]
            matrix[i, k] = factor
            for j in range(k + 1, m):
                matrix[i, j] -= factor * matrix[k, j]
    return True


@part
def solve(matrix, order, v):
    """Replace v by the solution for it, given what `factorise` left."""
    m = matrix.shape[0]
    for k in range(m):
        other = v[int(order[k])]
        v[int(order[k])] = v[k]
        v[k] = other
    for i in range(1, m):
        for j in range(i):
            v[i] -= matrix[i, j] * v[j]
    for i in range(m - 1, -1, -1):
        for j in range(i + 1, m):
            v[i] -= matrix[i, j] * v[j]
        v[i] /= matrix[i, i]


@part
def multiply(h, I, omega, sign, rows, k, result):
    """A(omega) v with `sign` times the step size, for the vector v in row k."""
    p, I_v, omega_v = 0.0, 0.0, 0.0
    for j in range(omega.size):
        p += I[j] * omega[j]
        I_v += I[j] * rows[k, j]
        omega_v += omega[j] * rows[k, j]
    for j in range(omega.size):
        result[j] = times_matrix(sign * h[j], I[j], omega[j], rows[k, j], p, I_v, omega_v)


@part
def orthonormalise(frame, products, exponents):
    """Gram and Schmidt's method on the rows of a frame; their lengths multiply the products."""
    m = frame.shape[0]
    for k in range(m):
        square = 0.0
        for j in range(m):
            square += frame[k, j] * frame[k, j]
        length = math.sqrt(square)
        products[k], exponents[k] = multiplied(products[k], exponents[k], length)
        for j in range(m):
            frame[k, j] *= 1.0 / length if length > 0.0 else 0.0
        for i in range(k + 1, m):
            along = 0.0
            for j in range(m):
                along += frame[k, j] * frame[i, j]
            for j in range(m):
                frame[i, j] -= along * frame[k, j]


@part
def step(h, I, omega, frame, matrix, v, order):
    """One step of a state and of a frame of displacements; NaN where there is no next state."""
    m = omega.size
    p = 0.0
    for j in range(m):
        p += I[j] * omega[j]
    for i in range(m):
        for j in range(m):
            matrix[i, j] = times_matrix(
                h[i], I[i], omega[i], 1.0 if i == j else 0.0, p, I[j], omega[j]
            )
    if not factorise(matrix, order):
        omega[:] = np.nan
        return
    solve(matrix, order, omega)
    for k in range(m):
        multiply(h, I, omega, -1.0, frame, k, v)
        solve(matrix, order, v)
        for j in range(m):
            frame[k, j] = v[j]


def _iterate_nd(steps, h, I, omega, frames, products, exponents, scratch):
    """The same in n dimensions.

    h, I        (B, m): eps / (2 J), and I.
    omega       (B, m), the states; this and what follows is read and written.
    frames      (B, m, m), orthonormal displacements as rows.
    products, exponents   (B, m), their growth.
    scratch     (tasks, m + 2, m), one for each task.
    """
    (batch, m), n_tasks = omega.shape, scratch.shape[0]
    for task in prange(n_tasks):
        matrix, v, order = scratch[task, :m], scratch[task, m], scratch[task, m + 1]
        for i in range(task * batch // n_tasks, (task + 1) * batch // n_tasks):
            h_i, I_i, omega_i, frame = h[i], I[i], omega[i], frames[i]
            products_i, exponents_i = products[i], exponents[i]
            for _ in range(steps):
                step(h_i, I_i, omega_i, frame, matrix, v, order)
                orthonormalise(frame, products_i, exponents_i)
                if not np.isfinite(omega_i[0]):
                    products_i[:] = np.nan
                    break


def _take_logarithms(products, exponents, steps, out):
    """The mean logarithms (B, m) of products (B, m)."""
    for i in prange(out.shape[0]):
        for k in range(out.shape[1]):
            if products[i, k] > 0.0:
                product, power = math.frexp(products[i, k])
                out[i, k] = mean_logarithm(product, exponents[i, k], float(power), steps)
            else:
                out[i, k] = -np.inf if products[i, k] == 0.0 else np.nan


enter = Loop(_enter)
iterate = Loop(_iterate)
iterate_nd = Loop(_iterate_nd)
take_logarithms = Loop(_take_logarithms)
