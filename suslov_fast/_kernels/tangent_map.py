"""The tangent map: derivatives of steps, and the growth of lengths under their products."""

import numpy as np

from .._formulas.elementary import exponent, logarithm, smaller, two_to_the
from .._jit import LINE, inner, kernel, select, share, stack, subtract_product
from .elimination import ACCURATE, WIDTH, eliminate
from .one_system import solve_system


@inner
def add_log_det(matrix, beyond_1, sign, totals):
    """Add sign times log |det| of eliminated systems, -inf if one is singular."""
    for i in range(matrix.shape[0]):
        for l in range(WIDTH):
            pivot = abs(1.0 / matrix[i, i, l])
            distance = select(beyond_1[i, l] > -1.0, -beyond_1[i, l], 1.0 - pivot)
            log = select(pivot > 0.0, logarithm(pivot, distance), -np.inf)
            totals[l] += sign * log


@kernel
def differentiate(part, parts, slopes, following, derivatives, logarithms, ratios, scratch):
    """Find derivatives of steps, (1 - S)**-1 (1 + S_next), and logarithms of |det|.

    slopes        (count, D, D): S = (eps/2) f' at states
    following     (count, D, D): S_next, the same at the next states
    derivatives   (count, D, D)
    logarithms    (count,); NaN if all digits of a determinant cancel
    ratios        (count,), of the pivots, see `eliminate`
    scratch       for matrices (parts, D, 2 D, WIDTH) and (parts, D, D, WIDTH), for their
                  diagonals less 1 (parts, 2, D, WIDTH), and for `solve_system` (parts, 2, D, 2 D),
                  (parts, 2, D, D) and (parts, 2, D)
    """
    count, D, _ = slopes.shape
    of_ahead, of_back, totals = scratch[2][part, 0], scratch[2][part, 1], stack(WIDTH)
    of_steps, ratio = stack(WIDTH), stack(WIDTH)
    ahead, back = scratch[0][part], scratch[1][part]
    step, inverse, scales = scratch[3][part], scratch[4][part], scratch[5][part]
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
            k = begin + l
            logarithms[k], ratios[k] = totals[l], smaller(of_steps[l], ratio[l])
            for i in range(D):
                for j in range(D):
                    derivatives[k, i, j] = ahead[i, D + j, l]
            if not ratios[k] > ACCURATE:
                logarithms[k] = differentiate_one(
                    slopes[k], following[k], derivatives[k], step, inverse, scales
                )


@inner
def differentiate_one(slopes, following, derivative, step, inverse, scales):
    """Find the derivative of one step by `solve_system`, and return the logarithm of |det|."""
    D = len(slopes)
    for i in range(D):
        for j in range(D):
            unit = 1.0 if i == j else 0.0
            step[0, i, j] = unit - slopes[i, j]
            step[0, i, D + j] = inverse[0, i, j] = unit + following[i, j]
    solve_system(step, scales)
    solve_system(inverse, scales)
    for i in range(D):
        for j in range(D):
            derivative[i, j] = step[0, i, D + j]
    return log_det(inverse[0]) - log_det(step[0])


@inner
def log_det(matrix):
    """Return log |det| of a matrix with these pivots, NaN if one is 0 to rounding."""
    log = 0.0
    for i in range(len(matrix)):
        pivot = abs(matrix[i, i])
        log += logarithm(pivot, 1.0 - pivot) if pivot != 0.0 else -np.inf
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
