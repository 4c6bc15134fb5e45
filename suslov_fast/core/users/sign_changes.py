"""Crossings of a surface s(x) = 0: changes of the sign of s from one state to the next.

A value of 0 counts as positive. With a = s(x_n) and b = s(x_{n+1}), an orbit crosses upwards if
a < 0 <= b, and downwards if b < 0 <= a. The straight line from x_n to x_{n+1} meets the surface, to
first order, at the fraction a / (a - b) of its length.
"""

import numpy as np

from ..compiling.numba import for_users


@for_users
def write_crossings(places, n, last, values, states, most, counts, integers, numbers):
    """Write the crossings of B orbits over a stretch of states; return how many there are.

    A value that is not finite makes no crossing, and an orbit has at most `most` of them.

    places     k B + i in ascending order, where the sign of s changes after row k of orbit i
    n          the number of row 0
    last       (B,), the values of s at row 0
    values     (rows, B), those at the rows after it
    states     (rows + 1, B, D)
    counts     (B,), how many crossings each orbit has had; increased
    integers   (len(places), 4): the orbit, how many crossings it had before, and n; 0 is left
    numbers    (len(places), 2 D + 1): the states n and n + 1, and the fraction
    """
    (_, B, D), count = states.shape, 0
    for place in places:
        k = place // B
        i = place - k * B
        a, b = last[i] if k == 0 else values[k - 1, i], values[k, i]
        if counts[i] >= most or not (abs(a) < np.inf and abs(b) < np.inf):
            continue
        integers[count, 0], integers[count, 1], integers[count, 2] = i, counts[i], n + k
        for j in range(D):
            numbers[count, j] = states[k, i, j]
            numbers[count, D + j] = states[k + 1, i, j]
        # Halve both where a - b could overflow.
        scale = 1.0 if max(abs(a), abs(b)) < 2.0**1023 else 0.5
        numbers[count, 2 * D] = scale * a / (scale * a - scale * b)
        counts[i] += 1
        count += 1
    return count


@for_users
def sort_by_orbit(integers, numbers, starts, n, before, after, fraction, over_pole):
    """Copy what `write_crossings` wrote to arrays where those of orbit i are from starts[i] on.

    The last of `integers` is 1 for a crossing over a pole.
    """
    D = before.shape[1]
    for row in range(len(integers)):
        place = starts[integers[row, 0]] + integers[row, 1]
        n[place] = integers[row, 2]
        for j in range(D):
            before[place, j] = numbers[row, j]
            after[place, j] = numbers[row, D + j]
        fraction[place] = numbers[row, 2 * D]
        over_pole[place] = integers[row, 3] != 0
