"""Reduction of solved bodies from n to three dimensions.

A solved body has J I = b I, and J = a on the vectors orthogonal to I. Its states stay in the plane
of I and of `across`, the part of omega orthogonal to I: there it is the 3D body with I1 = b,
I2 = a and I13 = 0 in the state I23 Omega1 = I.omega, I23 Omega2 = |I| |across|, whose coordinates
are x = |I| |across| and y = b I.omega.
"""

import numpy as np

from .._formulas.coordinates import sum_of_products, two_sum
from .._formulas.elementary import TO_INTEGER, exponent, larger, scaled, two_to_the
from .._jit import formula, inner, kernel, put, select, share, two_product
from .units_nd import unit_of, unit_of_moments

# The largest exponents of states, step sizes and ratios of J for which all numbers are far from the
# limits of float64, also at poles.
LARGEST_POWER, LONGEST_POWER, FARTHEST = 900.0, 200.0, 300.0
# The unit in the last place of numbers from 2 to 4.
_LAST_PLACE = 2.0**-51


@formula
def as_product(p, lost):
    """Return A and B, 1 <= B < 2 or nearly, whose product is p + lost to 76 bits; p is finite.

    Near Y = 1, and for orbits that start near X = 0, y must be more precise than float64. The 3D
    map takes y as a product: (S + i u)(S + j u) = S**2 + (i + j) S u + i j u**2 with the rounded
    root S and u one unit in its last place. i + j determines the leading digits, i j the rest.
    """
    half = 2.0 * np.floor(0.5 * exponent(p))
    whole = scaled(abs(p), -half)
    more = scaled(select(p > 0.0, lost, -lost), -half)
    S = (np.sqrt(whole) + 2.0) - 2.0
    square, square_lost = two_product(S, S)
    unit = S * _LAST_PLACE
    rest = whole - square
    k = np.ceil((rest + (more - square_lost)) / unit)
    rest = (rest - k * unit) + (more - square_lost)
    root = np.sqrt(larger(k * k - 4.0 * (rest / _LAST_PLACE) / _LAST_PLACE, 0.0))
    i = (0.5 * (k + root) + TO_INTEGER) - TO_INTEGER
    A = scaled(S + i * _LAST_PLACE, half)
    B = S + (k - i) * _LAST_PLACE
    A = select(p > 0.0, A, -A)
    return select(lost == 0.0, p, A), select(lost == 0.0, 1.0, B)


@inner
def split(I, omega, k, own, across):
    """Split a state in units of 2**own into parts along I and orthogonal to it; I_k is the largest.

    The part along I replaces I. Returns I23 and the state of the 3D body, True if the other part is
    0, and I.omega.
    """
    p, lost, square, total = 0.0, 0.0, 0.0, 0.0
    w_k = scaled(omega[k], -own)
    for i in range(I.size):
        w = scaled(omega[i], -own)
        product, of_product = two_product(I[i], w)
        p, of_sum = two_sum(p, product)
        lost += of_product + of_sum
        # Accurate near the steady states, where all of these differences vanish.
        across[i] = sum_of_products(I[k], w, -I[i], w_k)
        square += I[i] * I[i]
        total += I[i] * across[i]
    largest, undefined = 0.0, 0.0
    for i in range(I.size):
        across[i] = (across[i] - I[i] * (total / square)) / I[k]
        largest = larger(abs(across[i]), largest)
        undefined += 0.0 * across[i]
    power, length = exponent(largest + undefined), 0.0
    for i in range(I.size):
        across[i] = scaled(across[i], -power)
        length += across[i] * across[i]
    length, norm, rounded = np.sqrt(length), np.sqrt(square), p + lost
    omega1, I23 = as_product(rounded, lost - (rounded - p))
    for i in range(I.size):
        I[i] = scaled(I23 * I[i] / square, own)
        across[i] = scaled(across[i] / length * (I23 / norm), own)
    return I23, omega1, scaled(norm * length / I23, power), length == 0.0, p


@kernel
def reduce(part, parts, parameters, omega, three, state, along, across, unit, fits):
    """Find the 3D problems of trajectories of solved bodies.

    parameters : J, I (B, m) or (1, m); eps (B,) or (1,)
    omega : (B, m), the states at step 0
    three : (B, 5), I1, I2, I13, I23 of the 3D bodies, and the step sizes, in units in which
        moments, products of inertia and states are of the order of 1
    state : (B, 2), the states of these bodies
    along, across : (B, m); omega is along times the first component of a state of the 3D body, plus
        across times the second
    unit : (B,), the logarithms of the units of the moments
    fits : (B,), 1 if a trajectory is in the range of this reduction, else 0
    """
    m, (first, last) = omega.shape[1], share(len(omega), part, parts)
    for b in range(first, last):
        J, I = parameters[0][b % len(parameters[0])], parameters[1][b % len(parameters[1])]
        eps = parameters[2][b % len(parameters[2])]
        k, undefined = 0, 0.0
        M, own = unit_of_moments(J), unit_of(omega[b], 0.0)
        P = unit_of(I, M)
        for i in range(m):
            if abs(I[i]) > abs(I[k]):
                k = i
            undefined += 0.0 * omega[b, i]
        for i in range(m):
            along[b, i] = I[i] * two_to_the(-P)
        of_k, of_others = J[k] * two_to_the(-M), J[0 if k > 0 else m - 1] * two_to_the(-M)
        step = scaled(eps, own + P - M)
        I23, omega1, omega2, on_line, p = split(along[b], omega[b], k, own, across[b])
        if I[k] == 0.0 or on_line or step == 0.0:  # a fixed state is `along` itself
            I23, omega1, omega2 = 0.0 if I[k] == 0.0 else p, 1.0, 0.0
            for i in range(m):
                along[b, i], across[b, i] = omega[b, i], 0.0
        if undefined != 0.0:
            I23, omega1, omega2 = 0.0, np.nan, np.nan
        put(three[b], 0, (of_k, of_others, 0.0, I23, step))
        put(state[b], 0, (omega1, omega2))
        apart = abs(exponent(of_k) - exponent(of_others))
        in_range = apart <= FARTHEST and abs(own) + apart <= LARGEST_POWER and undefined == 0.0
        unit[b], fits[b] = M, in_range and exponent(step) <= LONGEST_POWER


@kernel
def expand(part, parts, states, along, across, out, begin):
    """Fill states out (rows, B, m), from `begin` on, from 3D states (rows, lanes, 2)."""
    lanes, m = states.shape[1], along.shape[1]
    left, right = along[begin : begin + lanes], across[begin : begin + lanes]
    first, last = share(len(states), part, parts)
    for r in range(first, last):
        row = out[r, begin : begin + lanes]
        for b in range(lanes):
            omega1, omega2 = states[r, b, 0], states[r, b, 1]
            for i in range(m):
                row[b, i] = left[b, i] * omega1 + right[b, i] * omega2
