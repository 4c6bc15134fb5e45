"""Trial of another author's step before its first run, against the contract of `maps.Map`.

Python carries out the step, because it checks indices and compiled code does not: there memory of
others would change. A step that Python cannot carry out is only compiled.
"""

import re
from typing import Any

import numba
import numpy as np

from ..checks import FloatArray, integer, short, wrong
from ..core.compiling.numba import rows_of
from ..core.users.own_map import KernelOfStep
from .arguments import Arguments
from .problem import Problem
from .status import Status

_GUARD, _BESIDE = -99.0, 64  # numbers beside the arrays of a step, and how many
_TRIED: set[tuple[Any, int]] = set()  # kernels and dimensions that passed the trial


def arguments_for(problem: Problem, steps: Any, size: int) -> Arguments:
    """Return the arguments of a run of `size` trajectories, after a trial of a new step."""
    arguments: Arguments = steps.arguments(problem.body, problem.eps, problem.batch)
    if isinstance(steps.kernel, KernelOfStep):
        check_rows(arguments, size)
        key = steps.kernel, problem.body.dimension
        if size and key not in _TRIED:
            _try(steps.kernel, arguments, problem.omega)
            _TRIED.add(key)
    return arguments


def check_rows(arguments: Any, size: int) -> None:
    """Raise an error unless arrays of floats have one row, or one for each trajectory."""
    if not isinstance(arguments, tuple):
        raise wrong("Steps.arguments", "a tuple of arrays", type(arguments).__name__, TypeError)
    for k, array in enumerate(arguments):
        kind = getattr(array, "dtype", None)
        if kind is not None and kind.kind == "f" and kind != np.float64:
            raise wrong(f"arguments[{k}]", "an array of float64", str(kind), TypeError)
        if kind == np.float64 and len(array) not in (1, size):
            expected = f"have 1 or {size} rows, those of the batch"
            raise wrong(f"arguments[{k}]", expected, len(array))


def _try(kernel: Any, arguments: Arguments, omega: FloatArray) -> None:
    """Raise an error if a step from a state of the problem breaks the contract."""
    if getattr(arguments[-1], "dtype", None) != np.float64:
        received = short(arguments[-1])
        raise wrong("eps, the last of Steps.arguments,", "an array of float64", received, TypeError)
    states, D = omega.reshape(-1, omega.shape[-1]), omega.shape[-1]
    state = next((x for x in states if np.isfinite(x).all() and x.any()), np.ones(D))
    size = integer("work", kernel.size.py_func(D), 0)
    eps = next((float(each) for each in arguments[-1] if each), 1.0)
    given = kernel.step.py_func, size, arguments[:-1], state, eps
    is_same = np.array_equal(_after(*given, 0.0), _after(*given, 0.5), equal_nan=True)
    _expect(is_same, "remember no other step: what it reads of work, it writes")
    nothing, none = np.empty((0, D)), np.zeros(0, np.int64)
    results = np.empty((0, *nothing.shape)), nothing, none.astype(np.int8), none
    try:  # for no trajectories
        kernel(0, 1, arguments, nothing, np.empty((2, 0)), (0,) * 6, *results)
    except numba.TypingError as error:
        reason = " ".join(re.sub(r"\x1b\[[\d;]*m", "", str(error)).split())
        expected = "be a function of (x, out, eps, work, *row) that Numba compiles"
        raise wrong("step", f"{expected}, and return a Status", reason, TypeError) from error


def _expect(holds: Any, what: str) -> None:
    """Raise ValueError, with what a step must do, unless it holds."""
    if not holds:
        raise ValueError(f"step must {what} (see maps.Map)")


def _after(
    step: Any, size: int, arrays: Arguments, state: FloatArray, eps: float, fill: float
) -> FloatArray:
    """Return the state after a step, in memory between guards, with `fill` in `work`.

    It is NaN if Python cannot carry out the step.
    """
    D, given = len(state), [a[:1] if a.dtype == np.float64 else a for a in arrays]
    memory = [np.full(n + 2 * _BESIDE, _GUARD) for n in (D, D, size)]
    x, out, work = (array[_BESIDE:-_BESIDE] for array in memory)
    x[:], out[:], work[:] = state, np.nan, fill
    copies, outside = tuple(map(np.copy, given)), ""
    try:
        with np.errstate(all="ignore"):
            code = step(x, out, eps, work, *rows_of(copies, 0))
    except IndexError as error:
        code, outside = 0, str(error)
    except Exception:
        return np.full(D, np.nan)
    if any((a[:_BESIDE] != _GUARD).any() or (a[-_BESIDE:] != _GUARD).any() for a in memory):
        outside = "numbers beside them were written"
    within = f"stay within its arrays, x and out of {D} numbers, work of {size}, and the row"
    _expect(not outside, f"{within}; pass work=n to steps_of for work of n numbers: {outside}")
    pairs = zip((x, *copies), (state, *given), strict=True)
    is_kept = all(np.array_equal(after, before, equal_nan=True) for after, before in pairs)
    _expect(is_kept, "write to out and work alone, not to x nor to its row")
    statuses = [int(each) for each in Status]
    _expect(code is None or code in statuses, f"return a Status, one of {statuses}")
    return out
