"""Trial of another author's step before its first run, against the contract of `maps.Map`.

The kernel that `steps_of` makes cuts runs, saves states and marks failures for every step alike.
The step itself may still read or write beyond its arrays, change x or its row, remember an earlier
step in `work`, or expect other arrays.
"""

import inspect
import re
import warnings
from dataclasses import fields
from itertools import pairwise
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from ..bodies.fields.field_of_terms import SHARED
from ..checks import FloatArray, integer, short, wrong
from ..core.compiling.numba import rows_of
from ..core.users.own_map import KernelOfStep
from .arguments import Arguments, flat_arrays
from .problem import Problem
from .status import Status

_SIZE, _STEPS = 19, 6  # trajectories, and steps
_GUARD, _BESIDE = -99.0, 64  # numbers beside the arrays of a step, and how many
_GUARDED = slice(_BESIDE), slice(-_BESIDE, None)
_TRIED: set[tuple[Any, int]] = set()  # steps and dimensions that passed the trial


def arguments_for(problem: Problem, steps: Any, size: int) -> Arguments:
    """Return the arguments of a run of `size` trajectories, after a trial of a new step."""
    is_foreign = isinstance(steps.kernel, KernelOfStep)
    if is_foreign:
        _try_once(problem, steps)
    arguments: Arguments = steps.arguments(problem.body, problem.eps, problem.batch)
    if is_foreign:
        check_arguments(arguments, size)
    return arguments


def _try_once(problem: Problem, steps: Any) -> None:
    """Try a step before its first run with a body of this dimension."""
    key = steps, problem.body.dimension
    if key in _TRIED or 0 in problem.body.shape:
        return
    try:
        _try_step(problem, steps)
    except numba.TypingError as error:
        reason = " ".join(re.sub(r"\x1b\[[\d;]*m", "", str(error)).split())
        expected = "have code that Numba compiles, and return a Status as an int"
        raise wrong("step", expected, reason, TypeError) from error
    _TRIED.add(key)


def check_arguments(arguments: Any, size: int) -> None:
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


def _try_step(problem: Problem, steps: Any) -> None:
    """Try a step with one body of the problem, states near one of its own, and its step size."""
    body = problem.body[(0,) * len(problem.body.shape)] if problem.body.shape else problem.body
    eps = next((float(h) for h in np.ravel(problem.eps) if h), 1.0)
    omega0 = _states_of_trial(problem)
    arguments = steps.arguments(body, eps, (_SIZE,))
    try:
        of_family = steps.arguments(family_like(body, _SIZE), np.full(_SIZE, eps), (_SIZE,))
    except Exception:  # the class has no families
        of_family = steps.arguments(body, np.full(_SIZE, eps), (_SIZE,))
    check_arguments(of_family, _SIZE)
    _check_signature(steps.kernel.step.py_func, arguments)
    _try_in_python(steps.kernel, arguments, omega0)

    given = [np.copy(each) for each in of_family]
    final, status = _run(steps, of_family, omega0)
    _expect(all(map(_same, given, of_family)), "write to out and work alone, not to its row")
    known = [int(each) for each in Status]
    _expect(np.isin(status, known).all(), f"return a Status, one of {known}")
    # In another order, and in several calls, each with memory of its own.
    other, _ = _run(steps, of_family, omega0[::-1].copy(), (0, 2, 3, _STEPS))
    _expect(_same(other[::-1], final), "remember no other step: what it reads of work, it writes")
    there, still, back, half = (
        _run(steps, steps.arguments(body, h * eps, (_SIZE,)), omega0)[0] for h in (1, 0.0, -1, 0.5)
    )
    goes_back = not _same(back, there) and not _same(back, still)
    uses_eps = not _same(half, there)
    _expect(goes_back or not uses_eps, "step back for -eps, not as for abs(eps) or 0")


def _expect(holds: Any, what: str) -> None:
    """Raise ValueError, with what a step must do, unless it holds."""
    if not holds:
        raise ValueError(f"step must {what} (see maps.Map)")


def _same(a: Any, b: Any) -> bool:
    """Return whether two arrays are equal, with NaN equal to NaN."""
    return bool(np.array_equal(a, b, equal_nan=np.asarray(a).dtype.kind == "f"))


def _run(
    steps: Any, arguments: Any, omega0: FloatArray, cuts: tuple[int, ...] = (0, _STEPS)
) -> tuple[FloatArray, NDArray[np.int8]]:
    """Return the last states and statuses of a run, with one call from each cut to the next."""
    size, nothing = len(omega0), np.empty((0, *omega0.shape))
    final, carry = np.empty_like(omega0), np.zeros((steps.carried, size))
    status, failed_at = np.zeros(size, np.int8), np.full(size, -1, np.int64)
    for start, stop in pairwise(cuts):
        span = 0, size, start, stop, 0, 0
        steps.kernel(0, 1, arguments, omega0, carry, span, nothing, final, status, failed_at)
    return final, status


def _states_of_trial(problem: Problem) -> FloatArray:
    """Return states near one of the problem; some are NaN or so large that they fail."""
    states = flat_arrays(problem.omega, problem.omega.shape[:-1])
    states = states[np.isfinite(states).all(axis=1) & states.any(axis=1)]
    state = states[0] if len(states) else np.ones(problem.body.dimension)
    scales = np.linspace(1.0, 0.5, _SIZE)
    scales[3:7] = 1e200, 1e1, 1e2, 1e3  # these fail at once or later
    with np.errstate(over="ignore"):
        omega0 = np.clip(state * scales[:, None], -1e300, 1e300)
    omega0[1] = np.nan
    return np.asarray(omega0)


def family_like(body: Any, size: int) -> Any:
    """Return a batch of `size` copies of a single body."""
    parts = dict(body._parts)
    for name, value in parts.items():
        if np.asarray(value).dtype.kind in "iufO" and name not in SHARED:
            parts[name] = np.broadcast_to(value, (size, *np.shape(value)))
    return body._with(parts)


def _check_signature(step: Any, arguments: Any) -> None:
    """Raise TypeError unless a step takes as many arrays as `Steps.arguments` makes without eps."""
    signature, count = inspect.signature(step), len(arguments) - 1
    try:
        signature.bind(*range(4 + count))
    except TypeError:
        text = "step must take (x, out, eps, work, *row), with a row as long as Steps.arguments"
        received = f"{step.__name__}{signature}"
        raise TypeError(f"{text}, {count}, not {received}") from None
    if getattr(arguments[-1], "dtype", None) != np.float64:
        received = short(arguments[-1])
        raise wrong("eps, the last of Steps.arguments,", "an array of float64", received, TypeError)


def _try_in_python(kernel: Any, arguments: Any, omega0: FloatArray) -> None:
    """Raise ValueError if a step changes x or its row, or reads or writes beyond its arrays.

    Python checks indices, and compiled code does not: memory of others would change. Guards show
    what compiled functions that the step calls write.
    """
    D, outside = omega0.shape[1], ""
    size = integer("work", kernel.size.py_func(D), 0)
    for state in omega0:
        memory = [np.full(n + 2 * _BESIDE, _GUARD) for n in (D, D, size)]
        x, out, work = (array[_BESIDE:-_BESIDE] for array in memory)
        x[:], row = state, rows_of(tuple(map(np.copy, arguments[:-1])), 0)
        try:
            with np.errstate(all="ignore"):
                kernel.step.py_func(x, out, arguments[-1][0], work, *row)
        except (IndexError, ValueError) as error:  # an index, or a slice shorter than its name says
            is_of_arrays = "out of" in str(error) or "shape" in str(error)
            outside = str(error) if is_of_arrays else ""
        except Exception:  # not every compiled function runs as Python
            return
        if any((array[k] != _GUARD).any() for array in memory for k in _GUARDED):
            outside = "numbers beside them were written"
        if outside:
            text = f"step must stay within its arrays, x and out of {D} numbers, work of {size}"
            how = "and the row; pass work=n to steps_of for work of n numbers"
            raise ValueError(f"{text}, {how}: {outside}")
        _expect(_same(x, state), "write to out and work alone, not to x")


# -------------------------------------------------------------------------------- bodies of others
def check_parameters(kind: Any, random: Any) -> None:
    """Raise an error if a parameter of a class is a vector and `_axes` does not say so.

    Otherwise its components would count as members of a batch. The test makes random bodies of the
    record, and a body whose parameters are numbers.
    """
    name = kind.__name__
    if kind.__module__.partition(".")[0] == __package__.partition(".")[0]:
        return
    how = f"{name}._axes, as _axes = {{'I': 1}} for a vector I"
    for k, make in enumerate(random):
        body = make(np.random.default_rng(0), ())
        if shape := getattr(body, "shape", ()):
            vectors = [n for n, a in body._parts.items() if np.ndim(a) > body._axes.get(n, 0)]
            text = f"random[{k}] made a batch {shape} for the shape (): return a single body"
            raise ValueError(f"{text}, or give the axes of {', '.join(vectors)} in {how}")
    if kind._axes:
        return
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            body = kind(**{each.name: 1.0 for each in fields(kind)})
        except Exception:  # no body may have these numbers
            return
        try:
            body.field()
        except (TypeError, IndexError) as error:
            expected = f"field() of parameters that are numbers, or the axes of vectors in {how}"
            raise wrong("body", expected, f"{type(error).__name__}: {error}") from error
        except Exception:  # a field may divide by 0
            return
