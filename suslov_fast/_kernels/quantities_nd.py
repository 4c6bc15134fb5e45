"""Quantities of states in n dimensions: one loop over states for all formulas.

A state has m = n - 1 components. Arguments of a kernel:

parameters         J, I (period, m) or (1, m), eps (period,) or (1,), of states in turn
omega, following   (count, m), the states; the next ones, or omega itself
out                (count, 1), (count, m) or (count, m * m), the results
scratch            (tasks, ROWS, m), a problem
infinite           (tasks,), 1 if a task has found an infinite number, else 0
"""

from typing import NamedTuple

import numpy as np

from .._formulas.coordinates import sum_of_products
from .._formulas.elementary import scaled, two_to_the
from .._formulas.nd_map import matrix_row, slope_of_itself
from .._formulas.units import Units, leave
from .._jit import Kernel, formula, inner, namespace, select, share
from .units_nd import unit_of, unit_of_moments

# Number of rows of `BodyAndState`.
ROWS = 10
# A change in a step that differs from that of the states by more than this part of them is wrong.
DIFFERENT = 2.0**-40
# A difference below this part of its terms has lost digits.
CANCELLED_RATE = 2.0**-8

# What a quantity provides: at_state(s, eps, unit, out), which fills `out` from a problem.
quantity = namespace("quantity")


class BodyAndState(NamedTuple):
    """A body, a state and the next one in one system of units, and the vector field."""

    J: object  # all (m,)
    I: object
    omega: object
    following: object
    off: object
    off_following: object
    slope: object
    after: object  # sums over the components after i
    after_following: object
    after_off: object


@inner
def find_slope(s):
    """Fill `slope` with the right side of (15) over J_i and eps.

    With d_i = I_k Omega_i - I_i Omega_k for the largest I_k, which are accurate near the line
    Omega = c I, where all of them vanish, p Omega_i - I_i |Omega|**2 = (p d_i - I_i Omega.d) / I_k,
    where the terms of component i in p and in Omega.d cancel and are left out. Products of a state
    and the next are polarised.
    """
    k, m = 0, s.I.size
    for i in range(m):
        k = i if abs(s.I[i]) > abs(s.I[k]) else k
    p, p_next, of_off = 0.0, 0.0, 0.0
    for i in range(m - 1, -1, -1):
        I, w, v = s.I[i], s.omega[i], s.following[i]
        s.off[i] = sum_of_products(s.I[k], w, -I, s.omega[k])
        s.off_following[i] = sum_of_products(s.I[k], v, -I, s.following[k])
        s.after[i], s.after_following[i], s.after_off[i] = p, p_next, of_off
        p, p_next = p + I * w, p_next + I * v
        of_off += v * s.off[i] + w * s.off_following[i]
    p, p_next, of_off, half = 0.0, 0.0, 0.0, 0.5 / s.I[k] if s.I[k] != 0.0 else 0.0
    for i in range(m):
        I, w, v, d, d_next = s.I[i], s.omega[i], s.following[i], s.off[i], s.off_following[i]
        along = (p + s.after[i]) * d_next + (p_next + s.after_following[i]) * d
        s.slope[i] = half * (along - I * (of_off + s.after_off[i])) / s.J[i]
        p, p_next, of_off = p + I * w, p_next + I * v, of_off + (v * d + w * d_next)


@inner
def fill_energy(s, eps, out):
    total = 0.0
    for i in range(s.J.size):
        total += s.J[i] * s.omega[i] * s.omega[i]
    out[0] = 0.5 * total


@inner
def fill_modified_energy(s, eps, out):
    """E**2 / (E + eps**2 f.Jf / 8); NaN out of range."""
    find_slope(s)
    # Plain sums: a function of arrays would count references, which takes four times as long.
    of_omega, of_slope = 0.0, 0.0
    for i in range(s.J.size):
        of_omega += s.J[i] * s.omega[i] * s.omega[i]
        of_slope += s.J[i] * s.slope[i] * s.slope[i]
    out[0] = 0.5 * of_omega
    if of_omega > 0.0:
        ratio = 0.25 * eps * eps * of_slope / of_omega
        out[0] = 0.5 * of_omega / (1.0 + ratio) if ratio < np.inf else np.nan


@inner
def fill_vector_field(s, eps, out):
    find_slope(s)
    for i in range(s.slope.size):
        out[i] = s.slope[i]


@inner
def fill_slopes(s, eps, out):
    """Fill (eps/2) f'(omega), the identity minus the matrix A of equation (16)."""
    m, after, before = s.omega.size, 0.0, 0.0  # sums of terms of p, of other components
    for i in range(m - 1, -1, -1):
        s.off[i] = after
        after += s.I[i] * s.omega[i]
    poison = 0.0 * after  # a NaN in the state makes all entries NaN
    for i in range(m):
        c, g = matrix_row(s.J[i], s.I[i], s.omega[i], eps)
        for j in range(m):
            out[i * m + j] = c * s.omega[j] + g * s.I[j] + poison
        out[i * m + i] = slope_of_itself(s.J[i], before + s.off[i] + poison, eps)
        before += s.I[i] * s.omega[i]


@inner
def fill_matrix(s, eps, out):
    fill_slopes(s, eps, out)
    for i in range(out.size):
        out[i] = 0.0 - out[i]
    for i in range(s.J.size):
        out[i * (s.J.size + 1)] += 1.0


@inner
def fill_invariant_density(s, eps, out):
    """Fill the density for n = 4 and I along axis a.

    With the other axes b and c and h = eps I_a / 2 its inverse is
    w_b w_c (1 - h**2 (J_a w_a**2 - (J_c - J_b) (w_b**2 - w_c**2)) / (J_a J_b J_c)).
    """
    a = 0
    for i in range(3):
        a = i if abs(s.I[i]) > abs(s.I[a]) else a
    b, c, h = (a + 1) % 3, (a + 2) % 3, 0.5 * eps * s.I[a]
    w_b, w_c = s.omega[b], s.omega[c]
    along, across = h * s.omega[a] / s.J[b], h * (s.J[c] - s.J[b]) / s.J[b]
    ratio = 1.0 - along * (h * s.omega[a] / s.J[c])
    ratio += across / s.J[a] * (h / s.J[c]) * ((w_b - w_c) * (w_b + w_c))
    below = w_b * w_c * ratio
    out[0] = select(below == 0.0, np.inf, 1.0 / below)


@formula
def driven_by(s, i, j, p, p_next):
    """I_j slope_i - I_i slope_j without the terms with |omega|**2, which cancel if J_i = J_j."""
    a, b, sign = (i, j, 1.0) if s.J[i] <= s.J[j] else (j, i, -1.0)
    off = sum_of_products(s.I[b], s.omega[a], -s.I[a], s.omega[b])
    off_next = sum_of_products(s.I[b], s.following[a], -s.I[a], s.following[b])
    along = 0.5 * (p * off_next + p_next * off)
    return sign * (along + s.I[b] * (s.J[b] - s.J[a]) * s.slope[a]) / s.J[b]


@formula
def fill_reaction(s, eps, unit, out):
    """Fill the antisymmetric matrix lambda_ij of equation (13), of terms of two dimensions.

    The slope is more accurate than the difference of the states, unless a long step cancels it.
    """
    find_slope(s)
    m, p, p_next, any_differs = s.slope.size, 0.0, 0.0, False
    for i in range(m):
        w, v = s.omega[i], s.following[i]
        p, p_next = p + s.I[i] * w, p_next + s.I[i] * v
        differs = abs(eps * s.slope[i] - (v - w)) > DIFFERENT * (abs(w) + abs(v))
        s.slope[i] = select(differs, (v - w) / eps, s.slope[i])
        any_differs |= differs
    for i in range(m):
        out[i * m + i] = 0.0 * s.slope[i]
        for j in range(i):
            driven = s.I[j] * s.slope[i] - s.I[i] * s.slope[j]
            if abs(driven) < CANCELLED_RATE * abs(s.I[j] * s.slope[i]) and not any_differs:
                driven = driven_by(s, i, j, p, p_next)
            gyration = s.omega[i] * s.following[j] + s.following[i] * s.omega[j]
            gyration = 0.5 * (s.J[j] - s.J[i]) * gyration
            value = leave(driven, unit, -1, 2, 2) - leave(gyration, unit, 1, 0, 2)
            out[i * m + j], out[j * m + i] = value, -value


@formula
def scale_body(J, I, s):
    """Fill the body of a problem, and return its units."""
    M = unit_of_moments(J)
    P = unit_of(I, M)
    of_moments, of_products = two_to_the(-M), two_to_the(-P)
    for i in range(J.size):
        s.J[i], s.I[i] = J[i] * of_moments, I[i] * of_products
    return M, P


@formula
def scale_state(omega, following, s):
    """Fill the states of a problem; return their unit, and True if a component is infinite."""
    W, infinite = unit_of(omega, 0.0), False
    factor = two_to_the(-W)
    for i in range(omega.size):
        s.omega[i], s.following[i] = omega[i] * factor, following[i] * factor
        infinite |= abs(omega[i]) == np.inf
    return W, infinite


def evaluate_nd(part, parts, parameters, omega, following, out, scratch, infinite):
    """Evaluate a quantity in a part of the tasks."""
    J, I, eps = parameters
    count, period, tasks = len(omega), max(len(J), len(I), len(eps)), len(scratch)
    first_task, last_task = share(tasks, part, parts)
    for task in range(first_task, last_task):
        memory, body, M, P, infinite[task] = scratch[task], -1, 0.0, 0.0, 0
        s = BodyAndState(
            memory[0], memory[1], memory[2], memory[3], memory[4],
            memory[5], memory[6], memory[7], memory[8], memory[9],
        )  # fmt: skip
        for state in range(task * count // tasks, (task + 1) * count // tasks):
            b = state % period
            if b != body:
                M, P = scale_body(J[b % len(J)], I[b % len(I)], s)
                body = b
            W, is_infinite = scale_state(omega[state], following[state], s)
            infinite[task] |= is_infinite
            step = scaled(eps[b % len(eps)], P + W - M)
            quantity.at_state(s, step, Units(M, P, W), out[state])


def of_body_nd(name, fill, *dimension):
    """Build the kernel of a quantity from a function that fills it in the units of a problem.

    Its dimension are its exponents of moments, of products of inertia and of omega.
    """
    moment, product, omega = dimension

    def at_state(s, eps, unit, out):
        fill(s, eps, out)
        for i in range(out.size):
            out[i] = leave(out[i], unit, moment, product, omega)

    at_state.__qualname__ = f"{name}_at_state"  # see `quantities_3d.of_formulas`
    return Kernel(evaluate_nd, name, quantity=namespace(name, at_state=formula(at_state)))


energy = of_body_nd("energy_nd", fill_energy, 1, 0, 2)
modified_energy = of_body_nd("modified_energy_nd", fill_modified_energy, 1, 0, 2)
invariant_density = of_body_nd("invariant_density_nd", fill_invariant_density, 0, 0, -2)
vector_field = of_body_nd("vector_field_nd", fill_vector_field, -1, 1, 2)
matrix = of_body_nd("matrix_nd", fill_matrix, 0, 0, 0)
slopes = of_body_nd("slopes_nd", fill_slopes, 0, 0, 0)
reaction = Kernel(
    evaluate_nd, "reaction_nd", quantity=namespace("reaction", at_state=fill_reaction)
)
