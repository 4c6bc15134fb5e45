"""Orientations of bodies: R_next = R cay(S), S = eps (Omega + Omega_next) / 2 (theory, section 4).

S/2 = b e_n^T - e_n b^T, because only the last row and column of Omega are not 0. So

cay(S) = (1 - S/2)**-1 (1 + S/2) = 1 + 2 (S/2 + (S/2)**2) / (1 + |b|**2),

and a row (r, r_n) of R becomes, with c = 2 / (1 + |b|**2),

(r - c (r.b + r_n) b,   r_n + c (r.b - |b|**2 r_n)).

Rounding errors of R^T R = 1 are removed at states with indices that are multiples of CLEAN_EVERY.
"""

from ..numba.decorators import function, kernel, share
from ..numba.gauss import simd_max
from .blocks import empty_at_line

SQUARE, ALONG, QUARTER = range(3)  # rows of `c`, one number a lane: |b|**2, r.b and eps / 4
CLEAN_EVERY = 16
# If a |b_i| is above this, b is scaled down to it: |b|**2 is in range, cay(S) stays a half turn.
HALF_TURN = 2.0**500


@kernel
def turn_along(part, parts, omega, eps, axial, R, start, every, next_row, turns):
    """Compute orientations along consecutive states, for part `part` of `parts` of trajectories.

    omega   (rows + 1, B, D), the states from `start` on: Omega1 and Omega2 in three dimensions
            (`axial`), else Omega_in
    eps     (1 or B,)
    R       (B, n, n), at the first state; replaced by R at the last state
    turns   (..., B, n, n); rows from `next_row` on receive R at later states with indices that
            are multiples of `every`; none if `every` is 0
    """
    count, B, D = omega.shape
    lanes = min(64 if D < 8 else 8, (max(B, 1) + 7) // 8 * 8)
    r = empty_at_line((D + 1, D + 1, lanes))
    b, c = empty_at_line((1, D, lanes))[0], empty_at_line((1, 3, lanes))[0]
    gram, cleaned = empty_at_line(r.shape), empty_at_line(r.shape)
    first_block, last_block = share((B + lanes - 1) // lanes, part, parts)
    for block in range(first_block, last_block):
        begin, row = block * lanes, next_row
        width = min(lanes, B - begin)
        for l in range(lanes):  # lanes beyond the last trajectory repeat this trajectory
            k = min(begin + l, B - 1)
            c[QUARTER, l] = 0.25 * eps[k % len(eps)]
            for i in range(D + 1):
                for j in range(D + 1):
                    r[i, j, l] = R[k, i, j]
        for n in range(1, count):
            for l in range(lanes):
                k = begin + min(l, width - 1)
                if axial:
                    b[0, l] = c[QUARTER, l] * (omega[n - 1, k, 1] + omega[n, k, 1])
                    b[1, l] = -c[QUARTER, l] * (omega[n - 1, k, 0] + omega[n, k, 0])
                else:
                    for i in range(D):
                        b[i, l] = c[QUARTER, l] * (omega[n - 1, k, i] + omega[n, k, i])
            turn_lanes(r, b, c)
            if (start + n) % CLEAN_EVERY == 0:
                clean(r, gram, cleaned)
            if every > 0 and (start + n) % every == 0:
                write(r, begin, width, turns[row])
                row += 1
        write(r, begin, width, R)


@function
def turn_lanes(r, b, c):
    """Replace r (n, n, lanes) by r cay(S), S/2 = b e_n^T - e_n b^T, b (D, lanes); c is memory."""
    D, lanes = b.shape
    for l in range(lanes):
        c[ALONG, l], c[SQUARE, l] = HALF_TURN, 0.0
    for i in range(D):
        for l in range(lanes):
            c[ALONG, l] = simd_max(abs(b[i, l]), c[ALONG, l])
    for l in range(lanes):
        c[ALONG, l] = HALF_TURN / c[ALONG, l]
    for i in range(D):
        for l in range(lanes):
            b[i, l] *= c[ALONG, l]
            c[SQUARE, l] += b[i, l] * b[i, l]
    for i in range(D + 1):
        for l in range(lanes):
            c[ALONG, l] = 0.0
        for j in range(D):
            for l in range(lanes):
                c[ALONG, l] += r[i, j, l] * b[j, l]
        for l in range(lanes):
            scale = 2.0 / (1.0 + c[SQUARE, l])
            last = r[i, D, l]
            r[i, D, l] = last + scale * (c[ALONG, l] - c[SQUARE, l] * last)
            c[ALONG, l] = scale * (c[ALONG, l] + last)
        for j in range(D):
            for l in range(lanes):
                r[i, j, l] -= c[ALONG, l] * b[j, l]


@function
def clean(r, gram, cleaned):
    """Replace r by r (3 - r^T r) / 2, nearer to orthogonality; `gram`, `cleaned` are memory."""
    n, _, lanes = r.shape
    for i in range(n):
        for j in range(n):
            gram[i, j] = 1.5 if i == j else 0.0
            for k in range(n):
                for l in range(lanes):
                    gram[i, j, l] -= 0.5 * r[k, i, l] * r[k, j, l]
    for i in range(n):
        for j in range(n):
            cleaned[i, j] = 0.0
            for k in range(n):
                for l in range(lanes):
                    cleaned[i, j, l] += r[i, k, l] * gram[k, j, l]
    for i in range(n):  # `r[:] = cleaned` takes seconds to compile
        for j in range(n):
            for l in range(lanes):
                r[i, j, l] = cleaned[i, j, l]


@function
def write(r, begin, width, target):
    """Write the orientations r of the first `width` lanes to target[begin : begin + width]."""
    for l in range(width):
        for i in range(r.shape[0]):
            for j in range(r.shape[0]):
                target[begin + l, i, j] = r[i, j, l]
