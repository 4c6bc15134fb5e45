"""A kernel that iterates trajectories, made from a function that takes one step of one state.

`tests/contract.py` says what a kernel must do; its arguments are those of `steps_3d.steps`, but for

arguments    arrays, the step sizes last; arrays of float64 have a row for each trajectory, or one
             for all
carry        (2, B), the first state with a positive status, 0 if there is none, and this status
"""

import numpy as np

from .codes import NONFINITE, OK
from .numba import Kernel, function, rows_of, share

CARRIED = 2


class KernelOfStep(Kernel):
    """A kernel that `steps_of` made from `step`; `size(D)` is the length of its memory."""


def steps_of(step, work):
    """Return the kernel of step(x, out, eps, work, *row), with memory for `work` numbers.

    A step sees only its own memory, so that it cannot break the contract of kernels.
    """
    size = _compiled(work if callable(work) else lambda D: work)
    step = _compiled(step)

    @KernelOfStep
    def steps(part, parts, arguments, omega0, carry, span, saved, final, status, failed_at):
        begin, end, start, stop, every, next_row = span
        eps, D = arguments[-1], omega0.shape[1]
        x, out = np.empty(D), np.empty(D)
        memory = np.zeros(size(D))  # so that steps which remember do so alike, and trials see it
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
                        out[d] = np.nan  # in case `step` does not set a component
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

    steps.step, steps.size = step, size
    return steps


def _compiled(py_func):
    return py_func if hasattr(py_func, "py_func") else function(py_func)
