"""The n-dimensional map, equation (dsn), one component at a time.

p = I.omega; square = |omega|**2; J_i = I_ii + I_nn; I_i = I_in; d_i = J_i - (eps/2) p; delta =
omega_next - omega.
"""

from .._jit import formula, select


@formula
def slope(J_i, I_i, omega_i, p, square):
    """The vector field f_i of equation (nsus1)."""
    return (p * omega_i - I_i * square) / J_i


# The matrix A of equation (dsn), which is Id - (eps/2) f'(omega), is diagonal plus rank two:
# A_ij = delta_ij (1 - eps p / (2 J_i)) - column_of_omega_i omega_j - column_of_coupling_i I_j.


@formula
def column_of_omega(J_i, I_i, eps):
    return -eps * I_i / J_i


@formula
def column_of_coupling(J_i, omega_i, eps):
    return 0.5 * eps * omega_i / J_i


@formula
def entry(diagonal, of_omega, of_I, I_j, omega_j):
    """A_ij; diagonal is 0 where i is not j."""
    return diagonal - of_omega * omega_j - of_I * I_j


# The rank-two form needs three sums over components:
# alpha = sum I omega / d, beta = sum I**2 / d, gamma = sum omega**2 / d.


@formula
def summands(I_i, omega_i, r_i):
    """The terms of alpha, beta and gamma; r_i = 1 / d_i."""
    I_r = I_i * r_i
    return I_r * omega_i, I_r * I_i, omega_i * r_i * omega_i


@formula
def increment(I_i, omega_i, of_omega, of_I, r_i):
    """delta_i, with of_omega = eps I.(omega + omega_next) / 2, of_I = eps omega.omega_next."""
    return (of_omega * omega_i - of_I * I_i) * r_i


@formula
def weights(eps, p, square, I_delta, omega_delta):
    """What `increment` needs, from I.delta and omega.delta."""
    return 0.5 * eps * (2.0 * p + I_delta), eps * (square + omega_delta)


@formula
def solve2(eps, p, square, alpha, beta, gamma):
    """`weights`; |det| of the two equations, and the size of the terms that it is the sum of."""
    h = 0.5 * eps
    # Unknowns: I.delta and omega.delta.
    a11, a12, b1 = 1.0 - h * alpha, eps * beta, eps * (p * alpha - square * beta)
    a21, a22, b2 = -h * gamma, 1.0 + eps * alpha, eps * (p * gamma - square * alpha)
    det = a11 * a22 - a12 * a21
    size = (1.0 + abs(h * alpha)) * (1.0 + abs(eps * alpha)) + abs(a12 * a21)
    r = 1.0 / det
    of_omega, of_I = weights(eps, p, square, (a22 * b1 - a12 * b2) * r, (a11 * b2 - a21 * b1) * r)
    return of_omega, of_I, abs(det), size


@formula
def bordered(J_k, I_k, omega_k, eps, p, square, alpha, beta, gamma):
    """Equations for I.delta, omega.delta and delta_k: rows of coefficients and right side.

    Component k is not in the sums: its d may be 0.
    """
    h = 0.5 * eps
    return (
        (1.0 - h * alpha, eps * beta, -I_k, eps * (p * alpha - square * beta)),
        (-h * gamma, 1.0 + eps * alpha, -omega_k, eps * (p * gamma - square * alpha)),
        (
            -h * omega_k / J_k,
            eps * I_k / J_k,
            1.0 - h * p / J_k,
            eps * slope(J_k, I_k, omega_k, p, square),
        ),
    )


@formula
def leading(row, other, k):
    """Two rows, that with the larger number in column k first."""
    swapped = abs(other[k]) > abs(row[k])
    pairs = list(zip(row, other, strict=True))
    first = [select(swapped, theirs, own) for own, theirs in pairs]
    return first, [select(swapped, own, theirs) for own, theirs in pairs]


@formula
def reduced(row, pivot, k):
    """A row less that multiple of another which leaves 0 in column k."""
    factor = row[k] / pivot[k]
    return [own - factor * other for own, other in zip(row, pivot, strict=True)]


@formula
def solve3(a, b, c):
    """The solution of three equations, with partial pivoting; the pivots' sizes."""
    a, b = leading(a, b, 0)
    a, c = leading(a, c, 0)
    b, c = leading(reduced(b, a, 0), reduced(c, a, 0), 1)
    c = reduced(c, b, 1)
    z = c[3] / c[2]
    y = (b[3] - b[2] * z) / b[1]
    x = (a[3] - a[2] * z - a[1] * y) / a[0]
    return x, y, z, abs(a[0]), abs(b[1]), abs(c[2])
