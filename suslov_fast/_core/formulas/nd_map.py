"""The n-dimensional map, equation (dsn), one component at a time.

p = I.omega; J_i = I_ii + I_nn; I_i = I_in.
"""

from ..jit import formula


@formula
def slope(J_i, I_i, omega_i, p, square):
    """The vector field f_i of equation (nsus1); square = |omega|**2."""
    return (p * omega_i - I_i * square) / J_i


# The matrix A below (dsn), which is Id - (eps/2) f'(omega), is diagonal plus rank two:
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


@formula
def increment(I_i, omega_i, of_omega, of_I, r_i):
    """delta_i, with of_omega = eps I.(omega + omega_next) / 2, of_I = eps omega.omega_next."""
    return (of_omega * omega_i - of_I * I_i) * r_i


@formula
def solve2(eps, p, square, alpha, beta, gamma):
    """What `increment` needs of omega_next; |det| of its equations, and what that would lose from.

    A is diagonal plus rank two. With d_i = J_i - (eps/2) p:
    alpha = sum I omega / d, beta = sum I**2 / d, gamma = sum omega**2 / d.
    """
    h = 0.5 * eps
    # Unknowns: I.delta and omega.delta of the increment delta.
    a11, a12, b1 = 1.0 - h * alpha, eps * beta, eps * (p * alpha - square * beta)
    a21, a22, b2 = -h * gamma, 1.0 + eps * alpha, eps * (p * gamma - square * alpha)
    det = a11 * a22 - a12 * a21
    size = (1.0 + abs(h * alpha)) * (1.0 + abs(eps * alpha)) + abs(a12 * a21)
    r = 1.0 / det
    return (
        h * (2.0 * p + (a22 * b1 - a12 * b2) * r),
        eps * (square + (a11 * b2 - a21 * b1) * r),
        abs(det),
        size,
    )
