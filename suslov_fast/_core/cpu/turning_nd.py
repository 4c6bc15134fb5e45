"""The turning of the body in n dimensions, one trajectory at a time.

columns   (n, n), the transpose of the orientation R: its rows, side by side, are vectors for the
          inner loops.
"""

import numpy as np

from ..formulas.rotation import is_large, turned_component, turned_last, unit_of_large
from ..staged import apart

# Rounding is undone at each state whose number is a multiple of this.
CLEAN_EVERY = 16


@apart
def turn(columns, b, eps, image):
    """Turn an orientation in place, as it goes from one state to the next.

    b         (m,), the mean of the two states; overwritten.
    image     (n,), scratch.
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
    # Rows side by side: the inner loops are vectors of them.
    last = columns[m]
    for r in range(m + 1):
        image[r] = 0.0
    for j in range(m):
        column, component = columns[j], b[j]
        for r in range(m + 1):
            image[r] += column[r] * component
    for j in range(m):
        turning, scaled = columns[j], scale * b[j]
        for r in range(m + 1):
            turning[r] = turned_component(turning[r], last[r], image[r], unit, scaled)
    for r in range(m + 1):
        last[r] = turned_last(last[r], image[r], scale, unit, square)


@apart
def clean_up(columns, gram, cleaned):
    """One step of Newton's method to the nearest orthogonal matrix, in place; two scratches."""
    n = columns.shape[0]
    for r in range(n):
        for c in range(n):
            gram[r, c] = 1.5 if r == c else 0.0
    for k in range(n):
        for r in range(n):
            factor = 0.5 * columns[k, r]
            for c in range(n):
                gram[r, c] -= factor * columns[k, c]
    for r in range(n):
        for c in range(n):
            cleaned[r, c] = 0.0
        for k in range(n):
            factor = columns[r, k]
            for c in range(n):
                cleaned[r, c] += factor * gram[k, c]
    for r in range(n):
        for c in range(n):
            columns[r, c] = cleaned[r, c]
