"""Trial of a kernel of another author before its first run, against the contract of `maps.Map`.

A kernel writes to arrays that it is given, and no error shows if it writes too little, too much, or
other numbers where a run is cut. The trial runs a few trajectories in several ways that must give
the same bits, with guard values around all arrays: about 6,000 steps in all.
"""

import inspect
import warnings
from dataclasses import fields
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from ..bodies.field import MATRIX
from ..checks import FloatArray, integer, short, wrong
from ..core import codes
from ..core.numba import rows_of
from ..core.one_step import KernelOfStep
from .arguments import Arguments, by_constants, flat_arrays
from .problem import Problem
from .status import Status

_SIZE, _WIDE, _STEPS = 19, 301, 6  # trajectories, those of a wide batch, and steps
# Runs from these states must have the bits of a run from state 0; they pass state 64, and a round
# number beyond 32 bits, where kernels that do something every so many steps might differ. No state
# on the way is a multiple of 512, at which the kernel of `core/steps_3d.py` restores R.
_LATE = 61, 43 * 10**8 - 3
_CUTS = 0, 2, 3, 3, _STEPS  # ends of calls; the third call takes no step
_GUARD, _UNTOUCHED = -99, 1.2345678901234e-99  # values around arrays, and in them before a run
_TRIED: set[tuple[Any, int]] = set()  # steps and dimensions that passed the trial


# ------------------------------------------------------------------------- runs in guarded memory
def _guarded(shape: tuple[int, ...], fill: Any, dtype: Any = np.float64) -> Any:
    """Return an array with guard values before and after it in memory, and these two guards."""
    count, beside = int(np.prod(shape)), 64 + 8 * int(np.prod(shape[1:]))  # eight rows or more
    memory = np.full(count + 2 * beside, _GUARD, dtype)
    array = memory[beside : count + beside].reshape(shape)
    array[...] = fill
    return array, (memory[:beside], memory[count + beside :])


class _Run(NamedTuple):
    """The arrays that a kernel wrote."""

    saved: FloatArray
    final: FloatArray
    status: NDArray[np.int8]
    failed_at: NDArray[np.int64]
    carry: FloatArray

    def of(self, which: Any) -> "_Run":
        """Return the run of some trajectories."""
        of_rows = self.saved[:, which], self.final[which], self.status[which]
        return _Run(*of_rows, self.failed_at[which], self.carry[:, which])


def _run(
    steps: Any,
    arguments: Any,
    omega0: FloatArray,
    cuts: tuple[int, ...] = (0, _STEPS),
    every: int = 1,
    in_pieces: bool = False,
    shift: int = 0,
    first: int = 0,
) -> _Run:
    """Run a kernel, with one call from each cut to the next, or several for pieces of the batch.

    Numbers of states begin with `shift`, and rows of saved states with `first`, in place of 0.
    """
    B, D = omega0.shape
    rows = first + (_STEPS // every + 1 if every else 0)
    (saved, *a), (final, *b), (carry, *c), (status, *d), (failed_at, *e) = (
        _guarded((rows, B, D), _UNTOUCHED),
        _guarded((B, D), _UNTOUCHED),
        _guarded((steps.carried, B), _UNTOUCHED),
        _guarded((B,), 0, np.int8),
        _guarded((B,), -1, np.int64),
    )
    guards, states = [each for [pair] in (a, b, c, d, e) for each in pair], omega0.copy()
    # A kernel that reads beyond an array of one row must not find a step size or a coefficient.
    guarded = tuple(map(_between_guards, arguments))
    pieces = [(0, B, 0, 1)]
    if in_pieces:
        pieces = [(*lanes, part, 2) for lanes in ((0, 3), (3, B)) for part in (0, 1)]
    calls = [(start + shift, stop + shift) for start, stop in pairwise(cuts)]
    for start, stop in [(0, 0)] * (shift > 0) + calls:
        of_shift = shift if start else 0
        row = first + ((start - of_shift) // every + 1 if start and every else 0)
        end_row = first + ((stop - of_shift) // every + 1 if every else 0)
        for begin, end, *part in pieces:
            span = begin, end, start, stop, every, row
            steps.kernel(*part, guarded, states, carry, span, saved, final, status, failed_at)
            pairs = zip(guarded, arguments, strict=True)
            kept = all(_same(*pair) for pair in pairs if isinstance(pair[0], np.ndarray))
            _expect(kept, "arguments to stay as they are", "others", 1)
            _expect(_same(states, omega0), "omega0 to stay as it is", "another one", 3)
            outside = [x for guard in guards for x in guard[guard != _GUARD].tolist()]
            _expect(not outside, "nothing to be written beside the arrays", short(outside), 5)
        is_later = saved[end_row:] != _UNTOUCHED
        _expect(not is_later.any(), "no state beyond `stop` to be saved", "one", 5)
    for numbers in (failed_at, *carry[: steps.notes_poles]):
        numbers[numbers > 0] -= shift
    return _Run(saved[first:], final, status, failed_at, carry)


def _between_guards(argument: Any) -> Any:
    """Return a copy of an argument; an array of floats lies between guards."""
    if not isinstance(argument, np.ndarray) or argument.dtype != np.float64:
        return np.copy(argument) if isinstance(argument, np.ndarray) else argument
    array, _ = _guarded(argument.shape, argument)
    array.flags.writeable = argument.flags.writeable  # it is part of the type for Numba
    return array


def _same(a: Any, b: Any) -> bool:
    """Return whether two arrays are equal, with NaN equal to NaN."""
    return bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f"))


def _expect(holds: Any, expected: str, received: str, item: int) -> None:
    """Raise ValueError, with the item of the contract that a kernel breaks, unless it holds."""
    if not holds:
        raise ValueError(f"kernel: item {item} of maps.Map asks for {expected}, not {received}")


def _expect_same(run: _Run, expected: _Run, where: str, item: int) -> None:
    """Raise ValueError unless two runs agree in all but `carry`, which is private to a kernel."""
    pairs = zip(run[:4], expected[:4], strict=True)
    _expect(all(_same(*pair) for pair in pairs), f"the same bits {where}", "others", item)


def _check_failures(run: _Run, notes_poles: bool) -> None:
    """Raise ValueError unless statuses and failed_at tell which states are not finite."""
    n, (status, failed_at) = np.arange(len(run.saved))[:, None], (run.status, run.failed_at)
    is_known, known = np.isin(status, [*Status]), [int(each) for each in Status]
    _expect(is_known.all(), f"a status of {known}", short({*status[~is_known].tolist()}), 7)
    exist: Any = np.isfinite(run.saved).all(axis=-1)
    gone = (status < 0) & (n >= failed_at)
    # With a positive status, failed_at is -1 or the first state for which it holds.
    is_right = (failed_at == -1) | (status > 0) & (failed_at > 0) & (failed_at < len(n))
    is_right = (failed_at >= 0) & (status < 0) | is_right & (status >= 0)
    if notes_poles:
        is_right &= (status != codes.PASSED_POLE) | (failed_at == run.carry[0])
    else:
        is_right &= status != codes.PASSED_POLE
    is_right &= (exist != gone).all(axis=0)
    is_right &= (np.isnan(run.saved).all(axis=-1) | ~gone).all(axis=0)
    if not is_right.all():
        i = int(np.argmin(is_right))
        expected = (
            "a negative Status and failed_at = n where state n is the first that is not finite, "
            "NaN from there on, and PASSED_POLE only with Steps.notes_poles and n in carry[0]"
        )
        states = f"finite: {exist[:, i].tolist()}, the last {short(run.saved[-1, i])}"
        _expect(False, expected, f"status {status[i]}, failed_at {failed_at[i]}, {states}", 7)


# ---------------------------------------------------------------------------- arguments of kernels
@lru_cache(maxsize=64)  # for speed in small calls
def _is_of_package(kernel: Any, arguments: Any) -> bool:
    """Return True if a kernel and the maker of its arguments belong to the package."""
    maker = getattr(arguments, "__module__", None)  # callables may lack one
    where: str = kernel.py_func.__module__
    is_ours = where.startswith(codes.__package__) and not isinstance(kernel, KernelOfStep)
    return maker == by_constants.__module__ and is_ours


def arguments_for(problem: Problem, steps: Any, size: int) -> Arguments:
    """Return the arguments of a run of `size` trajectories, after a trial of a new kernel.

    Raises ValueError if the kernel breaks the contract of `maps.Map`.
    """
    is_foreign = not _is_of_package(steps.kernel, steps.arguments)
    key = steps, problem.body.dimension
    if is_foreign and key not in _TRIED and 0 not in problem.body.shape:
        try:
            try_steps(problem, steps)
        except numba.TypingError as error:
            if not isinstance(steps.kernel, KernelOfStep):
                raise
            expected = "have code that Numba compiles, and return a Status as an int: see above"
            raise wrong("step", expected, error=TypeError) from error
        _TRIED.add(key)
    arguments: Arguments = steps.arguments(problem.body, problem.eps, problem.batch)
    if is_foreign:
        _check_arguments(arguments, size)
    return arguments


def _check_arguments(arguments: Any, size: int) -> None:
    """Raise an error unless arrays of floats have one row, or one for each trajectory."""
    if not isinstance(arguments, tuple):
        raise wrong("Steps.arguments", "a tuple of arrays", type(arguments).__name__, TypeError)
    for k, array in enumerate(arguments):
        kind = getattr(array, "dtype", None)
        if kind is not None and kind.kind == "f" and kind != np.float64:
            raise wrong(f"arguments[{k}]", "an array of float64", str(kind), TypeError)
        if kind == np.float64 and len(array) not in (1, size):
            expected = f"have 1 or {size} rows, those of the batch (item 1 of maps.Map)"
            raise wrong(f"arguments[{k}]", expected, len(array))


def _check_step(kernel: Any, arguments: Any) -> None:
    """Raise TypeError unless a step takes as many arrays as `Steps.arguments` makes without eps."""
    step, count = kernel.step.py_func, len(arguments) - 1
    signature = inspect.signature(step)
    try:
        signature.bind(*range(4 + count))
    except TypeError:
        text = "step must take (x, out, eps, work, *row), with a row as long as Steps.arguments"
        received = f"{step.__name__}{signature}"
        raise TypeError(f"{text}, {count}, not {received}") from None
    if getattr(arguments[-1], "dtype", None) != np.float64:
        received = short(arguments[-1])
        raise wrong("eps, the last of Steps.arguments,", "an array of float64", received, TypeError)


def _check_indices(kernel: Any, arguments: Any, omega0: FloatArray) -> None:
    """Raise ValueError if a step reads or writes beyond its arrays, for one of the states.

    Python checks indices, and compiled code does not: memory of others would change. Guards show
    what compiled functions that the step calls write.
    """
    D, outside = omega0.shape[1], ""
    size = integer("work", kernel.size.py_func(D), 0)
    for state in omega0:
        (x, *a), (out, *b), (work, *c) = (_guarded((n,), 0.0) for n in (D, D, size))
        x[:], row = state, rows_of(tuple(map(_between_guards, arguments[:-1])), 0)
        try:
            with np.errstate(all="ignore"):
                kernel.step.py_func(x, out, arguments[-1][0], work, *row)
        except IndexError as error:
            outside = str(error) if "out of" in str(error) else ""
        except Exception:  # not every compiled function runs as Python
            return
        if any((guard != _GUARD).any() for [pair] in (a, b, c) for guard in pair):
            outside = "numbers beside them were written"
        if outside:
            text = f"step must stay within its arrays, x and out of {D} numbers, work of {size}"
            how = "and the row; pass work=n to steps_of for work of n numbers"
            raise ValueError(f"{text}, {how}: {outside}")


def _rows(arguments: Any, has_rows: Any, which: Any, scale: Any = 1.0) -> Any:
    """Return arguments with these rows, times `scale`, of arrays with one row for each member."""
    return tuple(
        np.ascontiguousarray((array[which].T * scale).T) if is_row else array
        for array, is_row in zip(arguments, has_rows, strict=True)
    )


def _family_like(body: Any, size: int) -> Any:
    """Return a batch of `size` copies of a single body."""
    parts = dict(body._parts)
    for name, value in parts.items():
        if np.asarray(value).dtype.kind in "iufO" and name != MATRIX:  # families share K
            parts[name] = np.broadcast_to(value, (size, *np.shape(value)))
    return body._of(parts)


# --------------------------------------------------------------------------------------- the trial
def try_steps(problem: Problem, steps: Any, size: int = _SIZE) -> None:
    """Try a kernel with one body of the problem, states near one of its own, and its step size."""
    body = problem.body[(0,) * len(problem.body.shape)] if problem.body.shape else problem.body
    omega0 = _states_of_trial(problem, size)
    eps = next((float(h) for h in np.ravel(problem.eps) if h), 1.0)

    # Make the arguments of a family whose members differ, by scaling the rows of equal members.
    of_one, many = steps.arguments(body, eps, (size,)), np.full(size, eps)
    try:
        of_equals = steps.arguments(_family_like(body, size), many, (size,))
    except Exception:  # the class has no families
        of_equals = steps.arguments(body, many, (size,))
    _check_arguments(of_one, size)
    _check_arguments(of_equals, size)
    if isinstance(steps.kernel, KernelOfStep):
        _check_step(steps.kernel, of_one)
        _check_indices(steps.kernel, of_one, omega0)
    has_rows = [getattr(a, "dtype", None) == np.float64 and len(a) == size for a in of_equals]
    equal = _rows(of_one, has_rows, np.zeros(size, int))
    arguments = _rows(equal, has_rows, slice(None), np.linspace(0.99, 0.49, size))

    whole = _run(steps, arguments, omega0)
    _check_states(whole, omega0, steps.notes_poles)
    _check_divisions(steps, arguments, omega0, whole)
    one_row, many_rows = (_run(steps, a, omega0) for a in (of_one, equal))
    _expect_same(one_row, many_rows, "for arrays of one row and of B", 1)
    for members in ([size - 1], np.arange(_WIDE) % size):
        other = _run(steps, _rows(arguments, has_rows, members), omega0[members])
        _expect_same(other, whole.of(members), "in any batch", 7)

    of_eps = (steps.arguments(body, h * eps, (size,)) for h in (1.0, 0.0, -1.0, 0.5))
    there, still, back, half = (_run(steps, a, omega0).final for a in of_eps)
    goes_back = not _same(back, there) and not _same(back, still)
    uses_eps = not _same(half, there)
    _expect(goes_back or not uses_eps, "steps back for -eps", "those of abs(eps) or 0", 1)


def _states_of_trial(problem: Problem, size: int) -> FloatArray:
    """Return states near one of the problem; some are NaN or so large that they fail."""
    states = flat_arrays(problem.omega, problem.omega.shape[:-1])
    states = states[np.isfinite(states).all(axis=1) & states.any(axis=1)]
    state = states[0] if len(states) else np.ones(problem.body.dimension)
    scales = np.linspace(1.0, 0.5, size)
    scales[3:7] = 1e200, 1e1, 1e2, 1e3  # these fail at once or later
    with np.errstate(over="ignore"):
        omega0 = np.clip(state * scales[:, None], -1e300, 1e300)
    omega0[1], omega0[7:9] = np.nan, 1e300
    omega0[8, 1::2] *= -1.0
    omega0[np.arange(9, 12), np.arange(3) % omega0.shape[1]] = 1e200  # an overflow without NaN
    return np.asarray(omega0)


def _check_states(whole: _Run, omega0: FloatArray, notes_poles: bool) -> None:
    """Raise ValueError unless a run from state 0 has saved all states and noted all failures."""
    missing = np.argwhere((whole.saved == _UNTOUCHED).any(axis=-1))
    _expect(len(missing) == 0, "all states to be saved", f"none at (n, i) = {missing[:1]}", 5)
    _expect(_same(whole.saved[0], omega0), "state 0 to be saved", short(whole.saved[0, 0]), 3)
    _expect(_same(whole.saved[-1], whole.final), "final to be the last state", "another", 6)
    _check_failures(whole, notes_poles)
    of_nan = whole.status[1] == codes.NONFINITE and whole.failed_at[1] == 0
    _expect(of_nan, "NONFINITE at step 0 for a state that is NaN", f"{whole.status[1]}", 3)


def _check_divisions(steps: Any, arguments: Any, omega0: FloatArray, whole: _Run) -> None:
    """Raise ValueError unless divided runs have the bits of the whole one."""
    cut = _run(steps, arguments, omega0, _CUTS)
    _expect_same(cut, whole, "after cuts in time", 4)
    for every, saved in ((4, whole.saved[::4]), (0, whole.saved[:0])):
        seldom = _run(steps, arguments, omega0, _CUTS, every)
        _expect_same(seldom, whole._replace(saved=saved), f"if every = {every}", 5)
    lower = _run(steps, arguments, omega0, first=3)
    _expect_same(lower, whole, "from any row of `saved` on", 5)
    for shift in _LATE:
        late = _run(steps, arguments, omega0, shift=shift)
        _check_failures(late, steps.notes_poles)
        _expect_same(late, whole, f"from state {shift} as from 0", 4)
    pieces = _run(steps, arguments, omega0, _CUTS, in_pieces=True)
    _expect_same(pieces, whole, "for begin <= i < end and parts of the work", 2)


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
