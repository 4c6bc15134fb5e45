"""Quantities of states in n dimensions: one loop over states, m = n - 1 components to a state."""

import numpy as np

from .._formulas.coordinates import sum_of_products
from .._formulas.elementary import exponent, larger, scaled, two_to_the
from .._formulas.nd_map import matrix_diagonal, matrix_row
from .._formulas.units import above_one, fraction, moderate
from .._jit import inner, kernel, share

ENERGY, MODIFIED_ENERGY, VECTOR_FIELD, REACTION, MATRIX = range(5)
# Rows of scratch, (ROWS, m): the body and the states in units of powers of two, and intermediate
# results of `find_slope`.
J_, I_, OMEGA, NEXT, OFF, OFF_NEXT, SLOPE, ROWS = range(8)


@inner
def take_unit(values, row, default):
    """Fill a row with scaled numbers; return the exponent of the unit, the default for zeros."""
    largest = 0.0
    for i in range(values.size):
        largest = larger(abs(values[i]), largest)
    power = exponent(largest) if largest > 0.0 else default
    unit = two_to_the(-power)
    for i in range(values.size):
        row[i] = values[i] * unit
    return power


@inner
def find_slope(s, k):
    """Fill the row SLOPE with the right side of (15) over J_i and eps; I_k is the largest.

    With d_i = I_k Omega_i - I_i Omega_k, which are accurate near the line Omega = c I, where all
    of them vanish, p Omega_i - I_i |Omega|**2 = (p d_i - I_i Omega.d) / I_k; products of a state
    and the next are polarised.
    """
    p, p_next, of_off, of_off_next = 0.0, 0.0, 0.0, 0.0
    for i in range(s.shape[1]):
        I, w, v = s[I_, i], s[OMEGA, i], s[NEXT, i]
        s[OFF, i] = sum_of_products(s[I_, k], w, -I, s[OMEGA, k])
        s[OFF_NEXT, i] = sum_of_products(s[I_, k], v, -I, s[NEXT, k])
        p += I * w
        p_next += I * v
        of_off += v * s[OFF, i]
        of_off_next += w * s[OFF_NEXT, i]
    of_I, half = of_off + of_off_next, 0.5 / s[I_, k] if s[I_, k] != 0.0 else 0.0
    for i in range(s.shape[1]):
        off = p * s[OFF_NEXT, i] + p_next * s[OFF, i]
        s[SLOPE, i] = half * (off - s[I_, i] * of_I) / s[J_, i]


@inner
def energy_of(J, omega):
    total = 0.0
    for i in range(J.size):
        total += 0.5 * J[i] * omega[i] * omega[i]
    return total


@inner
def find_reaction(s, M, P, W, out):
    """Fill the antisymmetric matrix lambda_ij of equation (13)."""
    m, unit = s.shape[1], larger(2.0 * P - M, M)
    of_slope, of_gyration = fraction(2.0 * P - M - unit), fraction(M - unit)
    for i in range(m):
        out[i * m + i] = 0.0 * s[SLOPE, i]
        for j in range(i):
            driven = s[I_, j] * s[SLOPE, i] - s[I_, i] * s[SLOPE, j]
            gyration = s[OMEGA, i] * s[NEXT, j] + s[NEXT, i] * s[OMEGA, j]
            gyration = 0.5 * (s[J_, j] - s[J_, i]) * gyration
            value = scaled(of_slope * driven - of_gyration * gyration, unit + 2.0 * W)
            out[i * m + j], out[j * m + i] = value, -value


@inner
def find_matrix(s, eps, out):
    """Fill the matrix A(omega; eps) of equation (16)."""
    m, poison = s.shape[1], 0.0  # a NaN in the state makes all entries NaN
    for i in range(m):
        poison += 0.0 * s[OMEGA, i]
    for i in range(m):
        c, g = matrix_row(s[J_, i], s[I_, i], s[OMEGA, i], eps)
        others = poison
        for j in range(m):
            out[i * m + j] = poison - c * s[OMEGA, j] - g * s[I_, j]
            others += s[I_, j] * s[OMEGA, j] if j != i else 0.0
        out[i * m + i] = matrix_diagonal(s[J_, i], others, eps)


@inner
def find(quantity, s, k, eps, units, out):
    """Find the quantity of a state."""
    M, P, E, W = units
    if quantity == MATRIX:
        find_matrix(s, moderate(eps, E + W + P - M), out)
        return
    if quantity != ENERGY:
        find_slope(s, k)
    if quantity == VECTOR_FIELD:
        for i in range(s.shape[1]):
            out[i] = scaled(s[SLOPE, i], 2.0 * W + P - M)
    elif quantity == REACTION:
        find_reaction(s, M, P, W, out)
    else:
        energy, power = energy_of(s[J_], s[OMEGA]), M + 2.0 * W
        if quantity == MODIFIED_ENERGY:
            # E**2 / (E + eps**2 f.Jf / 8), or 0 at rest, in units in which 1 is `one`.
            eps, one, far = above_one(eps, E + W + P - M)
            excess = 0.25 * eps * eps * energy_of(s[J_], s[SLOPE])
            power -= 2.0 * far
            energy = energy / (one * one + excess / energy) if energy > 0.0 else energy + excess
        out[0] = scaled(energy, power)


@inner
def find_some(quantity, parameters, omega, following, out, task, scratch, infinite):
    """Find the quantity of the states of a task."""
    (J, I, eps), (tasks, _, m) = parameters, scratch.shape
    s, count, body, largest = scratch[task], len(omega), -1, 0.0
    M, P, E, k, size = 0.0, 0.0, 0.0, 0, 1.0
    period = max(len(J), len(I), len(eps))
    for state in range(task * count // tasks, (task + 1) * count // tasks):
        b = state % period
        if b != body:
            M = take_unit(J[b % len(J)], s[J_], 0.0)
            P = take_unit(I[b % len(I)], s[I_], M)
            E = exponent(eps[b % len(eps)])
            size, k = eps[b % len(eps)] * two_to_the(-E), 0
            for i in range(m):
                k = i if abs(s[I_, i]) > abs(s[I_, k]) else k
            body = b
        W = take_unit(omega[state], s[OMEGA], 0.0)
        unit = two_to_the(-W)
        for i in range(m):
            s[NEXT, i] = following[state, i] * unit
            largest = larger(abs(omega[state, i]), largest)
        find(quantity, s, k, size, (M, P, E, W), out[state])
    infinite[task] = largest == np.inf


@kernel
def evaluate(part, parts, quantity, parameters, omega, following, out, scratch, infinite):
    """Find a quantity of all states.

    parameters : J, I (period, m) or (1, m), eps (period,) or (1,), of states in turn
    omega, following : (count, m), the states; the next ones, or omega itself
    out : (count, 1), (count, m) or (count, m * m)
    scratch : (tasks, ROWS, m)
    infinite : (tasks,), 1 if a task has found an infinite number, else 0
    """
    first, last = share(len(scratch), part, parts)
    for task in range(first, last):
        find_some(quantity, parameters, omega, following, out, task, scratch, infinite)
