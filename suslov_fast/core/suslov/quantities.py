"""Quantities of a state of a body: NumPy universal functions, each with its formula.

All take the same arguments, even those that they ignore: in three dimensions I1, I2, I13, I23, k (0
without a rotor), eps and the state w; in n dimensions J, I, eps and w.

X, Y, K, e, ell, g and z are those of `suslov.map`, nu that of `closed_form`, x and y those of
equation (7), and `half` is eps / 2. Numbers of equations are those of the paper.
"""

import math

import numpy as np

from ..numba.decorators import formula, universal
from ..numba.intrinsics import select
from .closed_form import constants_of, coordinates, difference_of_squares, unit_of
from .map import ZERO_TO_ROUNDING, frame_and_XY, frame_of, is_supercritical, length, step_in_frame

LAYOUT_3D, LAYOUT_ND = "(),(),(),(),(),(),(d)->", "(d),(d),(),(d)->"
STATES_LAYOUT_3D = "(),(),(),(),(),(),(b,d)->"  # B states of one body


# ------------------------------------------------------------------------------- three dimensions
@formula
def in_range(number):
    """Return the number, or NaN if it is beyond the range of float64."""
    return select(abs(number) < np.inf, number, np.nan)


@formula
def energy_at(I1, I2, w1, w2):
    """Return (I1 w1**2 + I2 w2**2) / 2."""
    return 0.5 * (I1 * w1 * w1 + I2 * w2 * w2)


@formula
def first_integral_at(I1, I2, I13, I23, k, eps, w1, w2):
    """Return F of Lemma 1, (6): (I1 w1**2 + I2 w2**2) / (4 I1 I2 + eps**2 ell**2)."""
    step = eps * (I13 * w1 + I23 * w2 + k)
    return 2.0 * energy_at(I1, I2, w1, w2) / in_range(4.0 * I1 * I2 + step * step)


@universal(LAYOUT_3D + "()")
def energy(I1, I2, I13, I23, k, eps, w, out):
    out[0] = energy_at(I1, I2, w[0], w[1])


@universal(LAYOUT_3D + "()")
def first_integral(I1, I2, I13, I23, k, eps, w, out):
    out[0] = first_integral_at(I1, I2, I13, I23, k, eps, w[0], w[1])


@universal(LAYOUT_3D + "()")
def modified_energy(I1, I2, I13, I23, k, eps, w, out):
    """Compute 2 I1 I2 F."""
    out[0] = 2.0 * I1 * I2 * first_integral_at(I1, I2, I13, I23, k, eps, w[0], w[1])


@universal(LAYOUT_3D + "()")
def invariant_density(I1, I2, I13, I23, k, eps, w, out):
    """Compute 1 / (ell (4 I1 I2 + eps**2 ell**2))."""
    ell = I13 * w[0] + I23 * w[1] + k
    step = eps * ell
    out[0] = 1.0 / in_range(ell * (4.0 * I1 * I2 + step * step))


@formula
def criticality_at(I1, I2, I13, I23, k, eps, w1, w2):
    """Return T = e |g| |z| / sqrt(1 + X**2), on the side of 1 on which the steps test it."""
    step, twice = eps * (I13 * w1 + I23 * w2 + k), 2.0 * energy_at(I1, I2, w1, w2)
    numerator = (eps * eps * (I13 * I13 * I2 + I23 * I23 * I1)) * twice
    denominator = (I1 * I2) * (4.0 * (I1 * I2) + step * step)
    square, is_in_range = numerator / denominator, twice > 1e-280 and denominator < 1e280
    if is_in_range and 1e-280 < numerator < 1e280 and 1e-280 < square < 1e280:
        T = np.sqrt(square)
    else:
        of_g = I13 * (I13 / I1) + I23 * (I23 / I2)
        unit = unit_of(w1, w2, 0.0)
        size = np.sqrt(2.0 * energy_at(I1, I2, w1 / unit, w2 / unit) * of_g)
        T = in_range(abs(eps) * (size * unit)) / length(2.0 * np.sqrt(I1 * I2), step)
    if k != 0.0 or abs(T - 1.0) < 1e-6:
        frame, X, Y = frame_and_XY(I1, I2, I13, I23, k, eps, w1, w2)  # with the bits of steps
        beyond = is_supercritical(frame, X, Y)
        T = select(beyond & (T < 1.0), 1.0, select((T >= 1.0) & ~beyond, 1.0 - 2.0**-53, T))
    return select(eps < 0.0, -T, T)


@universal(STATES_LAYOUT_3D + "(b)")
def criticality(I1, I2, I13, I23, k, eps, w, out):
    for i in range(len(w)):
        out[i] = criticality_at(I1, I2, I13, I23, k, eps, w[i, 0], w[i, 1])


@universal(LAYOUT_3D + "()")
def rotation_number(I1, I2, I13, I23, k, eps, w, out):
    """Compute sign(k) arctan(e mu) / pi with mu**2 = k**2 - A**2; 0 if mu**2 is negative."""
    root_a, g1, g2, _, _, _ = constants_of(I1, I2, I13, I23)
    ell, x, nu = coordinates(I13, I23, k, root_a, g1, g2, w[0], w[1])
    e = 0.5 * eps / root_a
    square = -difference_of_squares(ell, x, nu, k, e * ell, e * k)
    turns = math.atan(abs(e) * np.sqrt(select(square < 0.0, 0.0, square))) / math.pi
    out[0] = select(e * k < 0.0, -turns, turns)


@universal(LAYOUT_3D + "(d)")
def to_xy(I1, I2, I13, I23, k, eps, w, out):
    """Compute x = I13 w1 + I23 w2 and y = I23 I1 w1 - I13 I2 w2, equation (7)."""
    out[0], out[1] = I13 * w[0] + I23 * w[1], I23 * I1 * w[0] - I13 * I2 * w[1]


@universal(LAYOUT_3D + "(),(),(),()")
def closed_form(I1, I2, I13, I23, k, eps, w, h, k1, k2, t):
    """Compute h, k1, k2 and t of Section 4; k1 and k2 are NaN unless -1 < t < 1.

    Equation (9): h = D F = (I1 I2 x**2 + y**2) / (4 I1 I2 + eps**2 x**2). Equation (12), with its
    sign: k1 = -(2 / eps) artanh t. sinh k2 = y / (|x| sqrt(I1 I2 (1 - t**2))).
    """
    unit = unit_of(w[0], w[1], 0.0)
    w1, w2, eps = w[0] / unit, w[1] / unit, eps * unit
    _, X, Y = frame_and_XY(I1, I2, I13, I23, 0.0, eps, w1, w2)
    root_a, g1, g2, _, _, _ = constants_of(I1, I2, I13, I23)
    x, _, nu = coordinates(I13, I23, 0.0, root_a, g1, g2, w1, w2)
    t[0] = criticality_at(I1, I2, I13, I23, 0.0, eps, w1, w2)
    h[0], k1[0], k2[0] = 0.25 * (x * x + nu * nu) / (1.0 + X * X), np.nan, np.nan
    if abs(Y) < 1.0:
        T, complement = abs(t[0]), (1.0 - Y) * (1.0 + Y) / (1.0 + X * X)  # 1 - T**2
        angle = math.atanh(T) if T < 0.5 else -0.5 * math.log(complement / (1.0 + T) ** 2)
        k1[0] = -2.0 * unit * np.sqrt(h[0] / (I1 * I2)) * (angle / T if T > 0.0 else 1.0)
        k2[0] = 0.0 if h[0] == 0.0 else math.asinh(nu / (abs(x) * np.sqrt(complement)))
    h[0] *= unit * unit


@universal(LAYOUT_3D + "(d)")
def vector_field(I1, I2, I13, I23, k, eps, w, out):
    """Compute equation (2) without Omega3 and lambda: -ell w2 / I1 and ell w1 / I2."""
    ell = I13 * w[0] + I23 * w[1] + k
    out[0], out[1] = -(ell * w[1]) / I1, (ell * w[0]) / I2


@formula
def matrix_at(I1, I2, I13, I23, k, half, w1, w2):
    """Return the entries (11, 12, 21, 22) of 1 - half f', the matrix before equation (5)."""
    ell = I13 * w1 + I23 * w2 + k
    return (
        1.0 + half * (I13 * w2) / I1,
        half * (ell + I23 * w2) / I1,
        -half * (ell + I13 * w1) / I2,
        1.0 - half * (I23 * w1) / I2,
    )


@universal(LAYOUT_3D + "(d,d)")
def matrix(I1, I2, I13, I23, k, eps, w, out):
    a11, a12, a21, a22 = matrix_at(I1, I2, I13, I23, k, 0.5 * eps, w[0], w[1])
    out[0, 0], out[0, 1], out[1, 0], out[1, 1] = a11, a12, a21, a22


@formula
def inverse_determinant(I1, I2, I13, I23, k, half, w1, w2):
    """Return 1 / Delta of equation (5): Delta = det A = 1 - Y + 2 X**2 - K X; NaN at poles."""
    Y, ell = half * (I23 / I2 * w1 - I13 / I1 * w2), I13 * w1 + I23 * w2 + k
    part = half * ell / (I1 * I2)
    square, KX = 2.0 * half * ell * part, half * k * part
    D = ((1.0 - Y) - KX) + square
    pole = abs(D) <= ZERO_TO_ROUNDING * ((1.0 + abs(Y)) + square)
    return 1.0 / select(pole, np.nan, in_range(D))


@universal(LAYOUT_3D + "(d,d)")
def jacobian(I1, I2, I13, I23, k, eps, w, out):
    """Compute A(w; eps)**-1 A(w_next; -eps) by the adjugate; w_next is the next state."""
    half = 0.5 * eps
    first, second = w[0] - half * k * w[1] / I1, w[1] + half * k * w[0] / I2
    inverse = inverse_determinant(I1, I2, I13, I23, k, half, w[0], w[1])
    a11, a12, a21, a22 = matrix_at(I1, I2, I13, I23, k, half, w[0], w[1])
    next1, next2 = (a22 * first - a12 * second) * inverse, (a11 * second - a21 * first) * inverse
    b11, b12, b21, b22 = matrix_at(I1, I2, I13, I23, k, -half, next1, next2)
    out[0, 0], out[0, 1] = (a22 * b11 - a12 * b21) * inverse, (a22 * b12 - a12 * b22) * inverse
    out[1, 0], out[1, 1] = (a11 * b21 - a21 * b11) * inverse, (a11 * b22 - a21 * b12) * inverse


@universal(STATES_LAYOUT_3D + "(b,d)")
def step(I1, I2, I13, I23, k, eps, w, out):
    """Compute the next states of B states; their common frame takes most of the divisions."""
    frame, e = frame_of(I1, I2, I13, I23, k, eps)
    for i in range(len(w)):
        out[i, 0], out[i, 1] = step_in_frame(frame, e, I13, I23, k, w[i, 0], w[i, 1])


@universal("(),(),(),(),(),(),(d)->(d)")
def step_full(I1, I2, I13, I23, I3, eps, w, out):
    """Compute the next state of equations (3): w3_next = -w3; the first two give the increments."""
    half, x = 0.5 * eps, I13 * w[0] + I23 * w[1]
    a11, a12 = I1 + half * (I13 * w[1]), half * (x + I23 * w[1] + (I3 - I2) * w[2])
    a21, a22 = half * ((I1 - I3) * w[2] - x - I13 * w[0]), I2 - half * (I23 * w[0])
    b1 = 2.0 * (I13 * w[2] - half * (I23 * w[2] * w[2] + w[1] * x))
    b2 = 2.0 * (I23 * w[2] + half * (I13 * w[2] * w[2] + w[0] * x))
    det, size = a11 * a22 - a12 * a21, abs(a11 * a22) + abs(a12 * a21)
    inverse = 1.0 / select(abs(det) > ZERO_TO_ROUNDING * size, det, np.nan)
    out[0] = w[0] + (a22 * b1 - a12 * b2) * inverse
    out[1] = w[1] + (a11 * b2 - a21 * b1) * inverse
    out[2] = -w[2]


@universal(LAYOUT_3D + "()")
def reaction(I1, I2, I13, I23, k, eps, w, out):
    """Compute (ell_next - ell) / eps - (I1 - I2) (w1 w2_next + w1_next w2) / 2.

    It is lambda of equation (2), with the differences and products of equation (4); for eps = 0
    derivatives replace the differences. Both terms have the denominator det A. Terms of the
    numerators cancel only if they cancel in the result, too.
    """
    a, half, x = I1 * I2, 0.5 * eps, I13 * w[0] + I23 * w[1]
    ell, y = x + k, I23 * I1 * w[0] - I13 * I2 * w[1]
    if eps == 0.0:
        out[0] = ell * y / a - (I1 - I2) * (w[0] * w[1])
        return
    inverse = inverse_determinant(I1, I2, I13, I23, k, half, w[0], w[1])
    of_1 = I1 * w[0] * w[0] * (I13 * w[0] + k)
    of_2 = I2 * w[1] * w[1] * (I23 * w[1] + k)
    mean = w[0] * w[1] * (1.0 - half * half * k * ell / a) + half * (of_1 - of_2) / a
    out[0] = (ell * (y - half * ell * x) / a - (I1 - I2) * mean) * inverse


# ---------------------------------------------------------------------------------- n dimensions
@formula
def sums_of_others(I, w):
    """Return the index of the largest |w_j|, and the sums of I_j w_j and w_j**2 over the others.

    In f_i = (p w_i - I_i |w|**2) / J_i, equation (14), the terms I_i w_i**2 cancel. `force` leaves
    the largest component out of the sums, because its terms would outweigh the others.
    """
    largest, p, square = 0, 0.0, 0.0
    for j in range(len(w)):
        largest = j if abs(w[j]) > abs(w[largest]) else largest
    for j in range(len(w)):
        if j != largest:
            p, square = p + I[j] * w[j], square + w[j] * w[j]
    return largest, p, square


@formula
def force(I, w, i, largest, p, square):
    """Return J_i f_i."""
    if i == largest:
        return p * w[i] - I[i] * square
    W = w[largest]
    return (p + I[largest] * W) * w[i] - I[i] * (square + W * W)


@formula
def twice_energy(J, w):
    """Return the sum of J_i w_i**2."""
    total = 0.0
    for j in range(len(w)):
        total += J[j] * w[j] * w[j]
    return total


@universal(LAYOUT_ND + "()")
def energy_nd(J, I, eps, w, out):
    out[0] = 0.5 * twice_energy(J, w)


@universal(LAYOUT_ND + "()")
def modified_energy_nd(J, I, eps, w, out):
    """Compute E**2 / (E + eps**2 f.Jf / 8)."""
    largest, p, square = sums_of_others(I, w)
    of_slope, of_state = 0.0, twice_energy(J, w)
    for i in range(len(w)):
        Jf = force(I, w, i, largest, p, square)
        of_slope += Jf * (Jf / J[i])
    ratio = 0.25 * eps * eps * in_range(of_slope) / of_state
    out[0] = 0.5 * of_state / in_range(1.0 + ratio) if of_state != 0.0 else 0.0


@universal(LAYOUT_ND + "()")
def invariant_density_nd(J, I, eps, w, out):
    """Compute the density for two coordinates, or for three with I along axis a.

    With the other axes b and c and rate = eps I_a / 2, the inverse of the density for three is w_b
    w_c (1 - rate**2 (J_a w_a**2 - (J_c - J_b) (w_b**2 - w_c**2)) / (J_a J_b J_c)).
    """
    if len(w) == 2:
        ell = I[0] * w[1] - I[1] * w[0]
        step = eps * ell
        out[0] = 1.0 / in_range(ell * (4.0 * J[0] * J[1] + step * step))
    else:
        a = 0
        for i in range(3):
            a = i if abs(I[i]) > abs(I[a]) else a
        b, c, rate = (a + 1) % 3, (a + 2) % 3, 0.5 * eps * I[a]
        along = (rate * w[a] / J[b]) * (rate * w[a] / J[c])
        across = (
            (w[b] - w[c]) * (w[b] + w[c]) * (rate / J[a]) * (rate / J[b]) * ((J[c] - J[b]) / J[c])
        )
        below = in_range(w[b] * w[c] * (1.0 - along + across))
        out[0] = np.inf if below == 0.0 else 1.0 / below


@universal(LAYOUT_ND + "(d)")
def vector_field_nd(J, I, eps, w, out):
    """Compute equation (14): (p w_i - I_i |w|**2) / J_i."""
    largest, p, square = sums_of_others(I, w)
    for i in range(len(w)):
        out[i] = force(I, w, i, largest, p, square) / J[i]


@universal("(d),(d),(d),(d)->(d,d)")
def reaction_between(J, I, w, after, out):
    """Compute lambda_ij = I_j s_i - I_i s_j - (J_j - J_i) (w_i after_j + after_i w_j) / 2, (13).

    s is the field with polarised products: (after - w) / eps in a step, f(w) if after = w.
    """
    for i in range(len(w)):
        out[i, i] = 0.0
        for j in range(len(w)):
            p = I[j] * (w[j] * after[i] + after[j] * w[i])
            out[i, i] += (0.5 * p - I[i] * w[j] * after[j]) / J[i] if j != i else 0.0
    for i in range(len(w)):
        for j in range(i):
            mean = 0.5 * (w[i] * after[j] + after[i] * w[j])
            out[i, j] = I[j] * out[i, i] - I[i] * out[j, j] - (J[j] - J[i]) * mean
            out[j, i] = -out[i, j]
    for i in range(len(w)):
        out[i, i] *= 0.0
