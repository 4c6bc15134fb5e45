"""Lyapunov exponents: steps of orbits and of their tangent vectors.

Growth is a product of factors, stored as (product, exponent) like in `multiplied`.
"""

import numpy as np

from .._formulas.canonical_map import SMALLEST_SQUARED, guarded_step, shifted
from .._formulas.coordinates import at_rest, from_canonical, to_canonical
from .._formulas.elementary import exponent, two_to_the
from .._formulas.tangent import (
    canonical_derivative,
    complement,
    mean_logarithm,
    multiplied,
    times_matrix,
)
from .._formulas.units import moderate, normal_body, normal_state
from .._jit import carray, formula, inner, kernel, select, share, stack
from .elimination import ZERO_TO_ROUNDING
from .lanes import LANES, whole

# Rows of a block in three dimensions: the state (X, Z), c and 1 - t**2; a displacement in (X, Y);
# the matrix that takes it to omega, up to a factor; the growth of its length and that of the area.
X_, Z_, C_, G_, V1, V2, M11, M12, M21, M22, LENGTH, OF_LENGTH, AREA, OF_AREA, ROWS = range(15)
_ROOM = ROWS * LANES


@inner
def enter_orbit(i, parameters, omega, carried):
    """Fill the rows of an orbit; its displacement is along Omega1, or along Omega2 if the first
    step annihilates the former.
    """
    I1, I2, I13, I23, eps, M, P, E = normal_body(
        parameters[0][i], parameters[1][i], parameters[2][i], parameters[3][i], parameters[4][i]
    )
    omega1, omega2, W = normal_state(omega[i, 0], omega[i, 1])
    eps = moderate(eps, E + W + P - M)
    X, Y, lost = to_canonical(I1, I2, I13, I23, eps, omega1, omega2)
    m11, m12, m21, m22 = from_canonical(I1, I2, I13, I23, eps)
    largest = max(max(abs(m11), abs(m12)), max(abs(m21), abs(m22)))
    m11, m12, m21, m22 = m11 / largest, m12 / largest, m21 / largest, m22 / largest
    if at_rest(I13, I23, eps, X, Y):
        X, Y, lost = 0.0, 0.0, 0.0
        m11, m12, m21, m22 = 1.0, 0.0, 0.0, 1.0
    c, Z = shifted(Y, lost)
    G = complement(X, Y, lost)
    det = m11 * m22 - m12 * m21
    d11, d12, d21, d22, _, _ = canonical_derivative(X, Z, c, G)
    v1, v2 = m22 / det, -m21 / det
    if d11 * v1 + d12 * v2 == 0.0 and d21 * v1 + d22 * v2 == 0.0:
        v1, v2 = -m12 / det, m11 / det
    carried[X_, i], carried[Z_, i], carried[C_, i], carried[G_, i] = X, Z, c, G
    carried[V1, i], carried[V2, i] = v1, v2
    carried[M11, i], carried[M12, i], carried[M21, i], carried[M22, i] = m11, m12, m21, m22
    carried[LENGTH, i], carried[AREA, i] = 1.0, 1.0
    carried[OF_LENGTH, i], carried[OF_AREA, i] = 0.0, 0.0


@kernel
def enter(part, parts, parameters, omega, carried):
    """Fill the rows (ROWS, B) of orbits from five parameters (B,) and states (B, 2)."""
    first, last = share(len(omega), part, parts)
    for i in range(first, last):
        enter_orbit(i, parameters, omega, carried)


@formula
def advance(s, l):
    """Make one step of an orbit of a block."""
    X, Z, c, v1, v2 = s[X_, l], s[Z_, l], s[C_, l], s[V1, l], s[V2, l]
    d11, d12, d21, d22, det, X_next = canonical_derivative(X, Z, c, s[G_, l])
    v1, v2 = d11 * v1 + d12 * v2, d21 * v1 + d22 * v2
    u1, u2 = s[M11, l] * v1 + s[M12, l] * v2, s[M21, l] * v1 + s[M22, l] * v2
    length = np.sqrt(u1 * u1 + u2 * u2)
    s[V1, l], s[V2, l] = v1 / length, v2 / length
    # The derivative exists if the next state does.
    exists, Z_next = guarded_step(X, Z, c, np.inf)
    poison = 0.0 * exists
    s[LENGTH, l], s[OF_LENGTH, l] = multiplied(s[LENGTH, l], s[OF_LENGTH, l], length + poison)
    s[AREA, l], s[OF_AREA, l] = multiplied(s[AREA, l], s[OF_AREA, l], det + poison)
    # Subnormal squares are slow, and negligible relative to 1.
    rests = (abs(X_next) < SMALLEST_SQUARED) & (Z_next > c)
    s[X_, l], s[Z_, l] = select(rests, 0.0, X_next) + poison, Z_next


@inner
def advance_block(block, steps, carried):
    """Make steps of a block."""
    s = carray(stack(_ROOM), (ROWS, LANES))
    first = block * LANES
    width = min(LANES, carried.shape[1] - first)
    lanes = whole(width)
    for r in range(ROWS):
        for l in range(lanes):
            s[r, l] = carried[r, first + min(l, width - 1)]
    for _ in range(steps):
        for l in range(lanes):
            advance(s, l)
    for r in range(ROWS):
        for l in range(width):
            carried[r, first + l] = s[r, l]


@kernel
def iterate(part, parts, steps, carried):
    """Make steps of all orbits, whose rows `carried` (ROWS, B) are read and written."""
    first, last = share((carried.shape[1] + LANES - 1) // LANES, part, parts)
    for block in range(first, last):
        advance_block(block, steps, carried)


@inner
def factorise(matrix, order):
    """Factorise a matrix in place with partial pivoting; return False if it is singular."""
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


@inner
def solve(matrix, order, v):
    """Replace v by the solution for the right side v of the factorised system."""
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


@inner
def multiply(h, I, omega, sign, rows, k, result):
    """Fill A(omega) v with `sign` times the step size, for the vector v in row k."""
    p, I_v, omega_v = 0.0, 0.0, 0.0
    for j in range(omega.size):
        p += I[j] * omega[j]
        I_v += I[j] * rows[k, j]
        omega_v += omega[j] * rows[k, j]
    for j in range(omega.size):
        result[j] = times_matrix(sign * h[j], I[j], omega[j], rows[k, j], p, I_v, omega_v)


@inner
def orthonormalise(frame, products, exponents):
    """Apply the Gram-Schmidt method to the rows of a frame; their lengths multiply the products."""
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


@inner
def step(h, I, omega, frame, matrix, v, order):
    """Make one step of a state, NaN if there is no next one, and of a frame."""
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


@inner
def advance_orbits(task, steps, h, I, omega, frames, products, exponents, scratch):
    """Make the steps of the orbits of one task."""
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


def scratch_size(m):
    """Return the length of the scratch of a task of `iterate_nd`."""
    return m * m + 2 * m


@kernel
def iterate_nd(part, parts, steps, h, I, omega, frames, products, exponents, scratch):
    """Make steps of orbits in n dimensions.

    h, I        (B, m): eps / (2 J), and I.
    omega       (B, m), the states; this and what follows is read and written.
    frames      (B, m, m), orthonormal displacements as rows.
    products, exponents   (B, m), their growth.
    scratch     (tasks, scratch_size(m)), one for each task.
    """
    first, last = share(len(scratch), part, parts)
    for task in range(first, last):
        advance_orbits(task, steps, h, I, omega, frames, products, exponents, scratch)


@inner
def take_logarithm(i, products, exponents, steps, out):
    """Fill the mean logarithms of an orbit."""
    for k in range(out.shape[1]):
        product = products[i, k]
        twos = exponent(product) + 1.0
        mean = mean_logarithm(product * two_to_the(-twos), exponents[i, k], twos, steps)
        out[i, k] = mean if product > 0.0 else (-np.inf if product == 0.0 else np.nan)


@kernel
def take_logarithms(part, parts, products, exponents, steps, out):
    """Fill the mean logarithms (B, m) of products (B, m)."""
    first, last = share(len(out), part, parts)
    for i in range(first, last):
        take_logarithm(i, products, exponents, steps, out)
