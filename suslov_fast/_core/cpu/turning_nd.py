"""The turning of the body in n dimensions, one trajectory at a time.

R         (n, n), the orientation.
angle     (n - 1,), that by which the body turns: eps (omega + omega_next) / 2.
scratch   (n + 1, n).
"""

import math

from ..jit import part

# Rounding is undone after so many turns.
CLEAN_EVERY = 16
# Angles below this have a square in range.
LARGE = 2.0**500


@part
def in_range(angle):
    """Take out a factor 1 / c, if the square needs it; returns c, which may be 0."""
    largest = 0.0
    for j in range(angle.size):
        largest = max(largest, abs(angle[j]))
    if not LARGE <= largest < math.inf:
        return 1.0
    c = math.ldexp(1.0, -math.frexp(largest)[1])
    for j in range(angle.size):
        angle[j] *= c
    return c


@part
def turn(R, angle):
    """R cay(S), in place, with S = angle e_n^T - e_n angle^T.

    cay(S) = Id + (S + S**2 / 2) / (1 + |angle|**2 / 4).
    """
    m = angle.size
    c = in_range(angle)
    square = 0.0
    for j in range(m):
        square += angle[j] * angle[j]
    scale = 1.0 / (c * c + 0.25 * square)
    for r in range(m + 1):
        image, last = 0.0, R[r, m]
        for j in range(m):
            image += R[r, j] * angle[j]
        for j in range(m):
            R[r, j] -= scale * (c * last + 0.5 * image) * angle[j]
        R[r, m] = last + scale * (c * image - 0.5 * square * last)


@part
def clean(R, scratch):
    """One step of Newton's method for the nearest orthogonal matrix, in place."""
    n = R.shape[0]
    for r in range(n):
        for c in range(n):
            gram = 1.5 if r == c else 0.0
            for j in range(n):
                gram -= 0.5 * R[r, j] * R[c, j]
            scratch[r, c] = gram
    for c in range(n):
        for r in range(n):
            scratch[n, r] = 0.0
            for j in range(n):
                scratch[n, r] += scratch[r, j] * R[j, c]
        for r in range(n):
            R[r, c] = scratch[n, r]
