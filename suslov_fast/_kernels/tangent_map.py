"""The tangent map: derivatives of steps, and the growth of lengths under their products."""

import numpy as np

from .._formulas.elementary import exponent, larger, logarithm, smaller, two_to_the
from .._formulas.twofold import product
from .._jit import LINE, inner, kernel, select, share, stack, subtract_product
from .elimination import WIDTH, eliminate, eliminate_twofold, subtract, twofold

# Where terms cancel to this part of them, twice the digits may not suffice.
UNKNOWN = 2.0**-50
# The logarithm of a pivot above this part of its terms is known.
NEGLIGIBLE = 2.0**-60


@inner
def add_log_det(matrix, beyond_1, sign, totals):
    """Add sign times log |det| of eliminated systems, -inf if one is singular."""
    for i in range(matrix.shape[0]):
        for l in range(WIDTH):
            pivot, beyond = abs(1.0 / matrix[i, i, l]), beyond_1[i, l]
            distance = select(beyond > -1.0, -beyond, 1.0 - pivot)
            log = select(pivot > 0.0, logarithm(pivot, distance), -np.inf)
            totals[l] += sign * log


@kernel
def differentiate(part, parts, slopes, following, derivatives, logarithms, ratios, scratch):
    """Find derivatives of steps, (1 - S)**-1 (1 + S_next), and logarithms of |det|.

    slopes        (count, D, D): S = (eps/2) f' at states
    following     (count, D, D): S_next, the same at the next states
    derivatives   (count, D, D)
    logarithms    (count,)
    ratios        (count,), of the pivots, see `eliminate`
    scratch       for matrices (parts, D, 2 D, WIDTH) and (parts, D, D, WIDTH), and for their
                  diagonals less 1 (parts, 2, D, WIDTH)
    """
    count, D, _ = slopes.shape
    of_ahead, of_back, totals = scratch[2][part, 0], scratch[2][part, 1], stack(WIDTH)
    of_steps, ratio = stack(WIDTH), stack(WIDTH)
    ahead, back = scratch[0][part], scratch[1][part]
    blocks = (count + WIDTH - 1) // WIDTH
    first, last = share(blocks, part, parts)
    for block in range(first, last):
        begin = block * WIDTH
        for l in range(WIDTH):
            k, undefined = min(begin + l, count - 1), 0.0
            for i in range(D):
                for j in range(D):
                    before, after = slopes[k, i, j], following[k, i, j]
                    unit = 1.0 if i == j else 0.0
                    ahead[i, j, l] = unit - before
                    ahead[i, D + j, l] = back[i, j, l] = unit + after
                    undefined += 0.0 * before + 0.0 * after
                of_ahead[i, l], of_back[i, l] = -slopes[k, i, i], following[k, i, i]
            totals[l] = undefined
        eliminate(ahead, of_steps, of_ahead)
        eliminate(back, ratio, of_back)
        add_log_det(back, of_back, 1.0, totals)
        add_log_det(ahead, of_ahead, -1.0, totals)
        for l in range(min(WIDTH, count - begin)):
            logarithms[begin + l] = totals[l]
            ratios[begin + l] = smaller(of_steps[l], ratio[l])
            for i in range(D):
                for j in range(D):
                    derivatives[begin + l, i, j] = ahead[i, D + j, l]


@inner
def fill(matrix, first, terms, mass, values, half, state, lost):
    """Fill columns from `first` on with the mass times 1 - half f' at a state and its rounding."""
    D = len(mass)
    for i in range(D):
        for j in range(first, first + D):
            matrix[i, j, 0], matrix[i, j, 1], matrix[i, j, 2] = 0.0, 0.0, 0.0
        subtract(matrix, i, first + i, (-mass[i], 0.0))
    for t in range(len(values)):
        i, j, k, factor = terms[0, t], terms[1, t], terms[2, t], (half * values[t], 0.0)
        if k < D:
            subtract(matrix, i, first + j, product(factor, (state[k], lost[k])))
            subtract(matrix, i, first + k, product(factor, (state[j], lost[j])))
        elif j < D:
            subtract(matrix, i, first + j, factor)


@kernel
def differentiate_twofold(
    part, parts, terms, half, mass, unit, values, states, derivatives, logarithms, scratch
):
    """Find what `differentiate` does with twice the digits, from the terms of a field.

    terms         (3, T): i, j, k of the terms v x_j x_k of the mass times f_i, as in `map_field`
    half          (count,), half the step size
    mass, unit    (count, D), that of each equation, and the unit of each unknown
    values        (count, T), of v
    states        (count, D)
    derivatives   (count, D, D)
    logarithms    (count,)
    scratch       (parts, D, 2 D + 1, 3) and (parts, 3, D)
    """
    count, D = states.shape
    matrix, (zero, following, lost) = scratch[0][part], scratch[1][part]
    tangent, system = matrix[:, : 2 * D], matrix[:, : D + 1]
    begin, end = share(count, part, parts)
    for n in range(begin, end):
        step = terms, mass[n], values[n], half[n]
        back = terms, mass[n], values[n], -half[n]
        # A(x) x_next = A(0; -eps) x + eps c
        zero[:] = 0.0
        fill(matrix, D + 1, *back, zero, zero)
        matrix[:, D] = 0.0
        for i in range(D):
            for j in range(D):
                subtract(matrix, i, D, product(twofold(matrix, i, D + 1 + j), (-states[n, j], 0.0)))
        for t in range(terms.shape[1]):
            if terms[1, t] == D:
                subtract(matrix, terms[0, t], D, (-2.0 * half[n] * values[n, t], 0.0))
        fill(matrix, 0, *step, states[n], zero)
        scale(matrix, unit[n])
        eliminate_twofold(system, UNKNOWN)
        for i in range(D):
            following[i], lost[i] = matrix[i, D, 0] * unit[n, i], matrix[i, D, 1] * unit[n, i]
        fill(matrix, 0, *back, following, lost)
        scale(matrix, unit[n])
        log = log_det(system)
        fill(matrix, 0, *step, states[n], zero)
        fill(matrix, D, *back, following, lost)
        scale(matrix, unit[n])
        known = is_known(tangent)
        logarithms[n] = log - log_det(tangent)
        for i in range(D):
            for j in range(D):
                value = matrix[i, D + j, 0] * unit[n, i]
                derivatives[n, i, j] = value if known else np.nan


@inner
def scale(matrix, unit):
    """Multiply the first columns by the units of the unknowns, powers of two."""
    for j in range(len(unit)):
        for i in range(len(unit)):
            for part in range(3):
                matrix[i, j, part] *= unit[j]


@inner
def is_known(tangent):
    """Test that the right sides are not small differences of their terms."""
    D, largest, terms = len(tangent), 0.0, 0.0
    for i in range(D):
        for j in range(D, 2 * D):
            largest = larger(abs(tangent[i, j, 0]), largest)
            terms = larger(tangent[i, j, 2], terms)
    return largest > UNKNOWN * terms


@inner
def log_det(matrix):
    """Eliminate, and return log |det|, -inf if the matrix is singular, NaN if it may be."""
    log = eliminate_twofold(matrix, NEGLIGIBLE) * np.log(2.0)
    for i in range(len(matrix)):
        pivot = abs(matrix[i, i, 0])
        if pivot == 0.0:
            return -np.inf
        log += logarithm(pivot, 1.0 - pivot)
    return log


@kernel
def orthonormalise(part, parts, columns, derivatives, logarithms, carried, of_det, scratch):
    """Multiply frames by derivatives in turn, and replace each product Q R by Q.

    columns       number of columns of Q that are computed
    derivatives   (N, B, D, D)
    logarithms    (N, B), of their |det|
    carried       (B, D + 2, D), read and written: the columns of Q, as rows; and the products of
                  the diagonals of all R, as numbers and exponents of 2 (if 0, so is the column)
    of_det        (B,), to which `logarithms` are added
    scratch       (parts, 2 D + 3, D, LINE)
    """
    steps, batch, D, _ = derivatives.shape
    derivative, frame = scratch[part, :D], scratch[part, D : 2 * D + 2]
    column, along = scratch[part, 2 * D + 2], stack(LINE)
    first, last = share((batch + LINE - 1) // LINE, part, parts)
    for block in range(first, last):
        begin = block * LINE
        width = min(LINE, batch - begin)
        for l in range(LINE):
            for i in range(D + 2):
                for j in range(D):
                    frame[i, j, l] = carried[begin + l, i, j] if l < width else 0.0
                    if i < D:
                        derivative[i, j, l] = 0.0  # of lanes beyond the last trajectory
        for n in range(steps):
            for l in range(width):
                for i in range(D):
                    for j in range(D):
                        derivative[i, j, l] = derivatives[n, begin + l, i, j]
            for k in range(columns):
                for i in range(D):  # minus the derivative times row k of the frame
                    for l in range(LINE):
                        column[i, l] = 0.0
                    for j in range(D):
                        subtract_product(column, (i, 0), derivative, (i, j, 0), frame, (k, j, 0))
                for c in range(k):  # the modified Gram-Schmidt method
                    for l in range(LINE):
                        along[l] = 0.0
                    for i in range(D):
                        for l in range(LINE):
                            along[l] += frame[c, i, l] * column[i, l]
                    for i in range(D):
                        subtract_product(column, (i, 0), along, (0,), frame, (c, i, 0))
                for l in range(LINE):
                    along[l] = 0.0
                for i in range(D):
                    for l in range(LINE):
                        along[l] += column[i, l] * column[i, l]
                for l in range(LINE):
                    length = np.sqrt(along[l])
                    product = frame[D, k, l] * length
                    power = exponent(product)
                    frame[D, k, l] = product * two_to_the(-power)
                    frame[D + 1, k, l] += power
                    along[l] = select(length == 0.0, 0.0, 1.0 / length)
                for i in range(D):
                    for l in range(LINE):
                        frame[k, i, l] = 0.0
                    subtract_product(frame, (k, i, 0), column, (i, 0), along, (0,))
            for l in range(width):
                of_det[begin + l] += logarithms[n, begin + l]
        for l in range(width):
            for i in range(D + 2):
                for j in range(D):
                    carried[begin + l, i, j] = frame[i, j, l]
