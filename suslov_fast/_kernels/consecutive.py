"""The test that states are consecutive, by the implicit equations.

These are equation (15) of the paper. Equation (4) is the case J = (I1, I2) and I = (I23, -I13) in
the components (Omega1, Omega2). A rotor adds a term.
"""

from .._jit import formula, kernel, select, share

# A state is the image of another if the residual is below this part of the step between them,
# which is above rounding and below the residual of any other method or step size,
OF_THE_STEP = 1e-6
# plus this part of the terms,
OF_THE_TERMS = 1e-10
# and, in three dimensions, this part divided by the distance to a pole: next to poles equation (5)
# and closed forms lose these digits.
NEXT_TO_POLES = 2.0**-47
# States larger than this or smaller than its inverse are first scaled to the order of 1.
OUT_OF_RANGE = 2.0**300


@formula
def distance_to_pole(h1, h2, I_1, I_2, half_k, omega1, omega2):
    """|det A| over the sum of the magnitudes of its terms, for m = 2; 1 if it is not a number.

    A omega_next = omega + ... are the implicit equations.
    """
    minus11, minus22 = 0.5 * h1 * I_2 * omega2, 0.5 * h2 * I_1 * omega1
    a12 = h1 * (I_1 * omega2 - 0.5 * I_2 * omega1 + half_k)
    a21 = h2 * (I_2 * omega1 - 0.5 * I_1 * omega2 - half_k)
    product = a12 * a21
    size = (1.0 + abs(minus11)) * (1.0 + abs(minus22)) + abs(product)
    distance = abs((1.0 - minus11) * (1.0 - minus22) - product) / size
    return select(distance < 1.0, distance, 1.0)


@formula
def strays(equations, row, omega, n, i):
    """Test that state n of trajectory i is not the image of the state before; False for NaN."""
    root, h, I, rotor = equations
    m, largest = omega.shape[2], 0.0
    for j in range(m):
        largest = max(largest, max(abs(omega[n - 1, i, j]), abs(omega[n, i, j])))
    in_range = 1.0 / OUT_OF_RANGE < largest < OUT_OF_RANGE
    unit = select(in_range, 1.0, 1.0 / (largest + 1e-307))
    p, p_next, product = 0.0, 0.0, 0.0
    size_p, size_next, size_product = 0.0, 0.0, 0.0
    for j in range(m):
        w, v = omega[n - 1, i, j] * unit, omega[n, i, j] * unit
        p += I[row, j] * w
        p_next += I[row, j] * v
        product += w * v
        size_p += abs(I[row, j] * w)
        size_next += abs(I[row, j] * v)
        size_product += abs(w * v)
    residual, step, size, k = 0.0, 0.0, 0.0, 0.5 * rotor[row] * unit
    for j in range(m):
        w, v, other, after = omega[n - 1, i, j] * unit, omega[n, i, j] * unit, 0.0, 0.0
        if k != 0.0:
            other, after = omega[n - 1, i, 1 - j] * unit, omega[n, i, 1 - j] * unit
        h_j, driven = h[row, j] / unit, (k if j == 1 else -k) * (other + after)
        to_next, to_omega = 0.5 * h_j * v, 0.5 * h_j * w
        # Component j over J_j, the left side minus the right, and the size of its terms.
        left = v - w - (to_next * p + to_omega * p_next) + h_j * (I[row, j] * product - driven)
        terms = abs(w) + abs(v) + abs(to_next) * size_p + abs(to_omega) * size_next
        terms += abs(h_j) * (abs(I[row, j]) * size_product + abs(k) * (abs(other) + abs(after)))
        residual += root[row, j] * abs(left)
        size += root[row, j] * terms
        step += root[row, j] * abs(v - w)
    distance = 1.0
    if m == 2:
        h1, h2, w1, w2 = h[row, 0] / unit, h[row, 1] / unit, omega[n - 1, i, 0], omega[n - 1, i, 1]
        distance = distance_to_pole(h1, h2, I[row, 0], I[row, 1], k, w1 * unit, w2 * unit)
    rounding = OF_THE_TERMS * distance + NEXT_TO_POLES
    return distance * residual > distance * OF_THE_STEP * step + rounding * size


@kernel
def follow(part, parts, root, h, I, rotor, omega, stray):
    """Find states that are not the image of the previous state.

    root     (B, m) or (1, m), the weights of the components: the roots of J
    h, I     (B, m) or (1, m): eps / J, and I, which is of the order of 1
    rotor    (B,) or (1,), the momentum of a rotor in the unit of I; 0 unless m = 2
    omega    (N + 1, B, m), the states
    stray    (B,), the index of the first such state, or -1
    """
    equations, (first, last) = (root, h, I, rotor), share(omega.shape[1], part, parts)
    for i in range(first, last):
        row, n = min(i, len(h) - 1), 1
        while n < len(omega) and not strays(equations, row, omega, n, i):
            n += 1
        stray[i] = n if n < len(omega) else -1
