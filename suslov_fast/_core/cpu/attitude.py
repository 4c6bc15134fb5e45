"""Loops over the steps of the orientation of the body.

Common arguments, flat over the batch of B trajectories:

omega   (N + 1, B, m), the states, the first of which was dealt with before.
eps     (B,), the step size.
out     (N, B, n, n), the orientations at the others; NaN from the first state on that is NaN.
"""

from numba import prange

from ..formulas.implicit import mismatch, strays, unit_of
from ..formulas.rotation import (
    mean,
    row_times_matrix,
    turn_between,
    turned,
)
from ..jit import Loop
from ..staged import staged
from .blocks import LANES
from .turning_nd import CLEAN_EVERY, clean_up, turn


@staged
def turn_block(block, omega, eps, R0, carried, out):
    """What `reconstruct` does for one block."""
    first = block * LANES
    last = min(first + LANES, omega.shape[1])
    for k in range(out.shape[0]):
        for l in range(first, last):
            unit, b1, b2 = turn_between(
                eps[l], omega[k, l, 0], omega[k, l, 1], omega[k + 1, l, 0], omega[k + 1, l, 1]
            )
            carried[0, l], carried[1, l], carried[2, l], carried[3, l] = turned(
                carried[0, l], carried[1, l], carried[2, l], carried[3, l], unit, b1, b2
            )
        for l in range(first, last):
            w, x, y, z = carried[0, l], carried[1, l], carried[2, l], carried[3, l]
            for r in (0, 1, 2):
                out[k, l, r, 0], out[k, l, r, 1], out[k, l, r, 2] = row_times_matrix(
                    R0[r, 0, l], R0[r, 1, l], R0[r, 2, l], w, x, y, z
                )


def _reconstruct(omega, eps, R0, carried, out):
    """Orientations R0 R, where R began as the identity.

    R0        (3, 3, B).
    carried   (4, B), the quaternions of R; read and written.
    """
    for block in prange((omega.shape[1] + LANES - 1) // LANES):
        turn_block(block, omega, eps, R0, carried, out)


@staged
def turn_some(task, omega, eps, number, before, out, scratch):
    """What one task of `reconstruct_nd` does."""
    batch, m, n_tasks = omega.shape[1], omega.shape[2], scratch.shape[0]
    n, room = m + 1, scratch[task]
    columns, gram, cleaned = room[:n], room[n : 2 * n], room[2 * n : 3 * n]
    image, b = room[3 * n], room[3 * n + 1][:m]
    for i in range(task * batch // n_tasks, (task + 1) * batch // n_tasks):
        for r in range(n):
            for c in range(n):
                columns[c, r] = before[i, r, c]
        for k in range(out.shape[0]):
            for j in range(m):
                b[j] = mean(omega[k, i, j], omega[k + 1, i, j])
            turn(columns, b, eps[i], image)
            if (number + k + 1) % CLEAN_EVERY == 0:
                clean_up(columns, gram, cleaned)
            for r in range(n):
                for c in range(n):
                    out[k, i, r, c] = columns[c, r]


def _reconstruct_nd(omega, eps, number, before, out, scratch):
    """The same in n dimensions.

    number    of the first state in `omega`.
    before    (B, n, n), the orientations there.
    scratch   (tasks, 3 n + 2, n), one for each task.
    """
    for task in prange(scratch.shape[0]):
        turn_some(task, omega, eps, number, before, out, scratch)


@staged
def total_mismatch(root, h, I, omega, following):
    """The sums over components that `strays` takes."""
    largest = 0.0
    for j in range(omega.size):
        largest = max(largest, max(abs(omega[j]), abs(following[j])))
    unit = unit_of(largest)
    p, p_next, product = 0.0, 0.0, 0.0
    for j in range(omega.size):
        p += I[j] * (omega[j] * unit)
        p_next += I[j] * (following[j] * unit)
        product += (omega[j] * unit) * (following[j] * unit)
    left, step, size = 0.0, 0.0, 0.0
    for j in range(omega.size):
        left_j, step_j, size_j = mismatch(
            h[j] / unit, I[j], omega[j] * unit, following[j] * unit, p, p_next, product
        )
        left += root[j] * left_j
        step += root[j] * step_j
        size += root[j] * size_j
    return left, step, size


@staged
def follow_block(block, root, h, I, number, omega, stray):
    """What `follow` does for one block."""
    for k in range(omega.shape[0] - 1):
        for i in range(block * LANES, min((block + 1) * LANES, omega.shape[1])):
            row = i if h.shape[0] > 1 else 0
            left, step, size = total_mismatch(
                root[row], h[row], I[row], omega[k, i], omega[k + 1, i]
            )
            if strays(left, step, size) and stray[i] < 0:
                stray[i] = number + k + 1


def _follow(root, h, I, number, omega, stray):
    """Find states that do not follow the one before by the map.

    root     (B, m) or (1, m), the weights of the components: the roots of J.
    h, I     (B, m) or (1, m): eps / J, and I, which is of the order of 1.
    number   of the first state in `omega`.
    stray    (B,), the number of the first state that does not, or -1; read and written.
    """
    for block in prange((omega.shape[1] + LANES - 1) // LANES):
        follow_block(block, root, h, I, number, omega, stray)


reconstruct = Loop(_reconstruct)
reconstruct_nd = Loop(_reconstruct_nd)
follow = Loop(_follow)
