"""A kernel of steps from one step of one state, for maps of others: see `maps.Map`.

part, parts  the number of this part of the work, and how many parts there are
arguments    arrays, of which those of numbers have a row for all trajectories or one for each; the
             step sizes come last
omega0       (B, D), state 0
carry        (2, B), the first state with a positive status, 0 if there is none, and this status
span         begin, end, start, stop, every, row: see `maps.Map`
saved        (rows, B, D), final (B, D), status (B,), failed_at (B,): written
"""

import numpy as np

from .codes import NONFINITE, OK
from .numba import Kernel, function, rows_of, share

CARRIED = 2


class KernelOfStep(Kernel):
    """A kernel that `steps_of` made, of `step`."""


def steps_of(step, work):
    """Return the kernel of step(x, out, eps, work, *row), with `work` numbers of own memory.

    All arrays but these are touched here alone, which is why the items of `maps.Map` hold.
    """
    size = _compiled(work if callable(work) else lambda D: work)
    step = _compiled(step)

    @KernelOfStep
    def steps(part, parts, arguments, omega0, carry, span, saved, final, status, failed_at):
        begin, end, start, stop, every, next_row = span
        eps, D = arguments[-1], omega0.shape[1]
        x, out, memory = np.empty(D), np.empty(D), np.empty(size(D))
        first, last = share(end - begin, part, parts)
        for i in range(begin + first, begin + last):
            h, own, row, undefined = eps[i % len(eps)], rows_of(arguments[:-1], i), next_row, 0.0
            for d in range(D):
                x[d] = omega0[i, d] if start == 0 else final[i, d]
                undefined += 0.0 * x[d]
            if start == 0:
                carry[0, i], carry[1, i] = 0.0, OK
                if np.isnan(undefined):
                    status[i], failed_at[i] = NONFINITE, 0
            for n in range(start, stop + 1):
                if n > start and status[i] >= 0:
                    for d in range(D):
                        out[d] = np.nan  # which a component that `step` forgets stays
                    code, undefined = step(x, out, h, memory, *own), 0.0
                    for d in range(D):
                        x[d] = out[d]
                        undefined += 0.0 * x[d]
                    if code >= 0 and np.isnan(undefined):
                        code = NONFINITE
                    if code < 0 or (code > 0 and status[i] == OK):
                        status[i], failed_at[i] = code, n
                        if code > 0:
                            carry[0, i], carry[1, i] = n, code
                if status[i] < 0:
                    for d in range(D):
                        x[d] = np.nan
                if every > 0 and n % every == 0 and (n > start or start == 0):
                    for d in range(D):
                        saved[row, i, d] = x[d]
                    row += 1
            for d in range(D):
                final[i, d] = x[d]

    steps.step = step
    return steps


def _compiled(py_func):
    return py_func if hasattr(py_func, "py_func") else function(py_func)
