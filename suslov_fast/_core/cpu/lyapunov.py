"""Loops over the steps of an orbit and of small displacements from it.

Growth is a product of factors, held as (product, exponent) in the sense of `multiplied`.
"""

import numpy as np
from numba import prange

from ..formulas import units
from ..formulas.canonical_map import guarded_step, shifted
from ..formulas.coordinates import at_rest, from_canonical, to_canonical
from ..formulas.tangent import canonical_derivative, mean_logarithm, multiplied, times_matrix
from ..jit import Loop
from ..staged import staged
from . import intrinsics  # noqa: F401  (compiles what is imported from vector)
from .blocks import LANES, in_whole_vectors, tasks_for
from .vector import on_stack

# A state X this small on its way to a fixed point becomes 0: subnormals are slow.
NEGLIGIBLE = 2.0**-960
# A pivot this much smaller than those before it, times m, is zero to rounding.
ZERO_TO_ROUNDING = 2.0**-50

# Rows of a block in three dimensions: the state (X, Z) and c; a displacement in (X, Y); the matrix
# that takes it to omega, up to a factor; the growth of its length and that of the area.
X_, Z_, C_, V1, V2, M11, M12, M21, M22, LENGTH, OF_LENGTH, AREA, OF_AREA, ROWS = range(14)


@staged
def enter_orbit(i, I1, I2, I13, I23, eps, omega, carried):
    """What `enter` does for one orbit."""
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


def _enter(I1, I2, I13, I23, eps, omega, carried):
    """Fill the rows (ROWS, B) of orbits from their states (B, 2); displacements are along e1."""
    for i in prange(omega.shape[0]):
        enter_orbit(i, I1, I2, I13, I23, eps, omega, carried)


@staged
def advance(rows, lanes):
    """One step of a block."""
    for l in range(lanes):
        X, Z, c = rows[X_, l], rows[Z_, l], rows[C_, l]
        v1, v2 = rows[V1, l], rows[V2, l]
        d11, d12, d21, d22, det = canonical_derivative(X, Z, c)
        v1, v2 = d11 * v1 + d12 * v2, d21 * v1 + d22 * v2
        u1 = rows[M11, l] * v1 + rows[M12, l] * v2
        u2 = rows[M21, l] * v1 + rows[M22, l] * v2
        length = np.sqrt(u1 * u1 + u2 * u2)
        rows[V1, l], rows[V2, l] = v1 / length, v2 / length
        X_next, Z_next = guarded_step(X, Z, c, np.inf)
        # A derivative exists where a next state does.
        poison = 0.0 * X_next
        rows[LENGTH, l], rows[OF_LENGTH, l] = multiplied(
            rows[LENGTH, l], rows[OF_LENGTH, l], length + poison
        )
        rows[AREA, l], rows[OF_AREA, l] = multiplied(rows[AREA, l], rows[OF_AREA, l], det + poison)
        rests = abs(X_next) < NEGLIGIBLE and Z_next > c
        rows[X_, l], rows[Z_, l] = 0.0 if rests else X_next, Z_next


@staged
def advance_blocks(task, n_tasks, steps, carried):
    """What one task of `iterate` does."""
    batch, rows = carried.shape[1], on_stack(ROWS, LANES)
    n_blocks = (batch + LANES - 1) // LANES
    for block in range(task * n_blocks // n_tasks, (task + 1) * n_blocks // n_tasks):
        first = block * LANES
        width = min(LANES, batch - first)
        lanes = in_whole_vectors(width)
        for r in range(ROWS):
            for l in range(width):
                rows[r, l] = carried[r, first + l]
            for l in range(width, lanes):
                rows[r, l] = 0.0
        for _ in range(steps):
            advance(rows, lanes)
        for r in range(ROWS):
            for l in range(width):
                carried[r, first + l] = rows[r, l]


def _iterate(steps, carried):
    """So many steps of all orbits, whose rows `carried` (ROWS, B) are read and written."""
    n_tasks = tasks_for((carried.shape[1] + LANES - 1) // LANES)
    for task in prange(n_tasks):
        advance_blocks(task, n_tasks, steps, carried)


@staged
def factorise(matrix, order):
    """L U of a matrix, in place, with partial pivoting; whether it is regular."""
    m = matrix.shape[0]
    size, regular = 0.0, True
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
        regular &= abs(matrix[k, k]) > ZERO_TO_ROUNDING * m * size
        for i in range(k + 1, m):
            factor = matrix[i, k] / matrix[k, k]
            matrix[i, k] = factor
            for j in range(k + 1, m):
                matrix[i, j] -= factor * matrix[k, j]
    return regular


@staged
def solve(matrix, order, v):
    """Replace v by the solution for it, given what `factorise` left."""
    m = matrix.shape[0]
    for k in range(m):
        other = v[order[k]]
        v[order[k]] = v[k]
        v[k] = other
    for i in range(1, m):
        for j in range(i):
            v[i] -= matrix[i, j] * v[j]
    for i in range(m - 1, -1, -1):
        for j in range(i + 1, m):
            v[i] -= matrix[i, j] * v[j]
        v[i] /= matrix[i, i]


@staged
def multiply(h, I, omega, sign, rows, k, result):
    """A(omega) v with `sign` times the step size, for the vector v in row k."""
    p, I_v, omega_v = 0.0, 0.0, 0.0
    for j in range(omega.size):
        p += I[j] * omega[j]
        I_v += I[j] * rows[k, j]
        omega_v += omega[j] * rows[k, j]
    for j in range(omega.size):
        result[j] = times_matrix(sign * h[j], I[j], omega[j], rows[k, j], p, I_v, omega_v)


@staged
def orthonormalise(frame, products, exponents):
    """Gram and Schmidt's method on the rows of a frame; their lengths multiply the products."""
    m = frame.shape[0]
    for k in range(m):
        square = 0.0
        for j in range(m):
            square += frame[k, j] * frame[k, j]
        length = np.sqrt(square)
        products[k], exponents[k] = multiplied(products[k], exponents[k], length)
        for j in range(m):
            frame[k, j] *= 1.0 / length if length > 0.0 else 0.0
        for i in range(k + 1, m):
            along = 0.0
            for j in range(m):
                along += frame[k, j] * frame[i, j]
            for j in range(m):
                frame[i, j] -= along * frame[k, j]


@staged
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
    if factorise(matrix, order):
        solve(matrix, order, omega)
        for k in range(m):
            multiply(h, I, omega, -1.0, frame, k, v)
            solve(matrix, order, v)
            for j in range(m):
                frame[k, j] = v[j]
    else:
        for j in range(m):
            omega[j] = np.nan


@staged
def advance_orbits(task, steps, h, I, omega, frames, products, exponents, scratch):
    """What one task of `iterate_nd` does."""
    batch, m, n_tasks = omega.shape[0], omega.shape[1], scratch.shape[0]
    matrix = scratch[task][: m * m].reshape((m, m))
    v, order = scratch[task][m * m : m * m + m], scratch[task][m * m + m : m * m + 2 * m]
    for i in range(task * batch // n_tasks, (task + 1) * batch // n_tasks):
        n, exists = 0, True
        while exists and n < steps:
            step(h[i], I[i], omega[i], frames[i], matrix, v, order.view(np.int64))
            orthonormalise(frames[i], products[i], exponents[i])
            n, exists = n + 1, np.isfinite(omega[i, 0])
        if not exists:
            for k in range(m):
                products[i, k] = np.nan


def scratch_size(m: int) -> int:
    """The numbers that a task of `iterate_nd` works in."""
    return m * m + 2 * m


def _iterate_nd(steps, h, I, omega, frames, products, exponents, scratch):
    """The same in n dimensions.

    h, I        (B, m): eps / (2 J), and I.
    omega       (B, m), the states; this and what follows is read and written.
    frames      (B, m, m), orthonormal displacements as rows.
    products, exponents   (B, m), their growth.
    scratch     (tasks, scratch_size(m)), one for each task.
    """
    for task in prange(scratch.shape[0]):
        advance_orbits(task, steps, h, I, omega, frames, products, exponents, scratch)


@staged
def take_logarithm(i, products, exponents, steps, out):
    """What `take_logarithms` does for one orbit."""
    for k in range(out.shape[1]):
        product = products[i, k]
        twos = units.exponent(product) + 1
        mean = mean_logarithm(product * units.power(-twos), exponents[i, k], twos, steps)
        out[i, k] = mean if product > 0.0 else (-np.inf if product == 0.0 else np.nan)


def _take_logarithms(products, exponents, steps, out):
    """The mean logarithms (B, m) of products (B, m)."""
    for i in prange(out.shape[0]):
        take_logarithm(i, products, exponents, steps, out)


enter = Loop(_enter)
iterate = Loop(_iterate)
iterate_nd = Loop(_iterate_nd)
take_logarithms = Loop(_take_logarithms)
