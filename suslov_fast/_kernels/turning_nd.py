"""Orientations in n dimensions, one trajectory at a time.

`turning` is a tuple of arrays: the time step (B,) or (1,); columns (B, n, n), the transposes of the
orientations R, so that a column of R is contiguous; results R (rows, B, n, n) at saved states; the
previous states (tasks, n - 1, lanes); and scratch (tasks, 2 n + 2, n).
"""

import numpy as np

from .._formulas.rotation import is_large, mean, turned_component, turned_last, unit_of_large
from .._jit import inner
from .codes import OK
from .lanes import entry

# Rounding errors are removed at each state whose index is a multiple of this.
CLEAN_EVERY = 16


@inner
def turn(columns, b, eps, image):
    """Multiply R by cay(eps (Omega + Omega_next) / 2), in place.

    b (m,) is the mean of the two states and is overwritten; image (n,) is scratch.
    """
    m = b.size
    half, total, largest = 0.5 * eps, 0.0, 0.0
    for j in range(m):
        total += abs(half * b[j])
        largest = max(largest, abs(b[j]))
    large = is_large(total)
    unit = 0.0 if large else 1.0
    factor = np.copysign(unit_of_large(largest), eps) if large else half
    square = 0.0
    for j in range(m):
        b[j] *= factor
        square += b[j] * b[j]
    scale = 2.0 / (unit + square)
    for r in range(m + 1):
        image[r] = 0.0
    for j in range(m):
        for r in range(m + 1):
            image[r] += columns[j, r] * b[j]
    for j in range(m):
        scaled = scale * b[j]
        for r in range(m + 1):
            columns[j, r] = turned_component(columns[j, r], columns[m, r], image[r], unit, scaled)
    for r in range(m + 1):
        columns[m, r] = turned_last(columns[m, r], image[r], scale, unit, square)


@inner
def clean_up(columns, gram, cleaned):
    """Take one step of Newton's method to the nearest orthogonal matrix, in place."""
    n = columns.shape[0]
    for r in range(n):
        for c in range(n):
            gram[r, c] = 1.5 if r == c else 0.0
            cleaned[r, c] = 0.0
    for k in range(n):
        for r in range(n):
            for c in range(n):
                gram[r, c] -= 0.5 * columns[k, r] * columns[k, c]
    for r in range(n):
        for k in range(n):
            for c in range(n):
                cleaned[r, c] += columns[r, k] * gram[k, c]
    for r in range(n):
        for c in range(n):
            columns[r, c] = cleaned[r, c]


@inner
def turn_lanes(c, b, turning, task, begin, end, n, start):
    """Rotate the orientations of a block to state n."""
    time_step, columns, _, before, scratch = turning
    size = columns.shape[1]
    gram, cleaned = scratch[task, :size], scratch[task, size : 2 * size]
    image, middle = scratch[task, 2 * size], scratch[task, 2 * size + 1, : size - 1]
    for l in range(end - begin):
        k = begin + l
        for i in range(size - 1):
            w = c.omega[i, l] * b.unit[l]
            middle[i], before[task, i, l] = mean(before[task, i, l], w), w
        if n > start:
            turn(columns[k], middle, entry(time_step, k), image)
            if n % CLEAN_EVERY == 0:
                clean_up(columns[k], gram, cleaned)
        elif b.status[l] != OK:
            for i in range(size):
                for j in range(size):
                    columns[k, i, j] = np.nan


@inner
def write_turns(turning, begin, end, row):
    """Write the orientations of a block to a row."""
    _, columns, turns, _, _ = turning
    for k in range(begin, end):
        for r in range(columns.shape[1]):
            for c in range(columns.shape[1]):
                turns[row, k, r, c] = columns[k, c, r]
