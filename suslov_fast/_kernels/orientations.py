"""Orientations along given states.

omega   (N + 1, B, m), the states
eps     (B,), the step size
"""

from .._formulas.rotation import mean
from .._jit import kernel, share
from .lanes import LANES
from .turning_3d import enter_turns, turn_on, turns_block, write_turns
from .turning_nd import CLEAN_EVERY, clean_up, turn


@kernel
def reconstruct(part, parts, omega, eps, R0, quaternions, turns):
    """Fill the orientations after the first, with the arrays of `turning_3d`."""
    batch, states, r = omega.shape[1], omega.reshape(omega.size), turns_block()
    turning = eps, R0, quaternions, turns
    first_block, last_block = share((batch + LANES - 1) // LANES, part, parts)
    for block in range(first_block, last_block):
        first = block * LANES
        width = min(LANES, batch - first)
        enter_turns(turning, omega[0], first, width, width, r)
        for n in range(len(turns)):
            begin = (n + 1) * batch + first
            turn_on(states[2 * begin : 2 * (begin + width)], r, width)
            write_turns(turning, r, n, first, width)


@kernel
def reconstruct_nd(part, parts, omega, eps, turns, scratch):
    """Fill orientations (N + 1, B, n, n) after the first; scratch (tasks, 3 n + 2, n)."""
    batch, m, tasks = omega.shape[1], omega.shape[2], len(scratch)
    n = m + 1
    first_task, last_task = share(tasks, part, parts)
    for task in range(first_task, last_task):
        memory = scratch[task]
        columns, gram, cleaned = memory[:n], memory[n : 2 * n], memory[2 * n : 3 * n]
        image, b = memory[3 * n], memory[3 * n + 1, :m]
        for i in range(task * batch // tasks, (task + 1) * batch // tasks):
            for r in range(n):
                for c in range(n):
                    columns[c, r] = turns[0, i, r, c]
            for k in range(1, len(turns)):
                for j in range(m):
                    b[j] = mean(omega[k - 1, i, j], omega[k, i, j])
                turn(columns, b, eps[i], image)
                if k % CLEAN_EVERY == 0:
                    clean_up(columns, gram, cleaned)
                for r in range(n):
                    for c in range(n):
                        turns[k, i, r, c] = columns[c, r]
