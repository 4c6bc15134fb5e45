"""A trial of kernels that are not of the package, before their first run.

A kernel writes to memory that it is given, and no error shows if it writes nothing, too much, or
other numbers after a cut. The trial takes a few trajectories some steps, in several ways that must
give the same bits, between numbers that no kernel may touch: about 5,000 steps in all.
"""

import inspect
import warnings
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import fields
from functools import lru_cache
from typing import Any

import numba
import numpy as np

from ..bodies.field import MATRIX
from ..checks import FloatArray, short, wrong
from ..core import codes
from ..core.one_step import KernelOfStep
from .arguments import Arguments, Problem, flat_arrays
from .status import Status

_SIZE, _WIDE, _FEW, _STEPS, _LONG, _GUARD = 19, 301, 8, 6, 140, -99  # trajectories, and steps
_LATE = 61, 997  # states from which steps are those from state 0; some multiples of 64 follow
_UNTOUCHED = 1.2345678901234e-99
_TRIED: set[tuple[Any, int]] = set()


def _guarded(shape: tuple[int, ...], fill: Any, dtype: Any = np.float64) -> Any:
    """Return an array that lies between numbers that stay as they are, and these."""
    count, beside = int(np.prod(shape)), 64 + 8 * int(np.prod(shape[1:]))  # at least eight rows
    memory = np.full(count + 2 * beside, _GUARD, dtype)
    array = memory[beside : count + beside].reshape(shape)
    array[...] = fill
    return array, (memory[:beside], memory[count + beside :])


class _Trial:
    """The arrays that a kernel writes, from state 0 on."""

    def __init__(
        self, steps: Any, omega0: FloatArray, every: int = 1, length: int = _STEPS
    ) -> None:
        (B, D), self.every, self.steps = omega0.shape, every, steps
        rows = length // every + 1 if every else 0
        self.omega0, guards = omega0, []
        self.saved, guard = _guarded((rows, B, D), _UNTOUCHED)
        guards += guard
        self.final, guard = _guarded((B, D), _UNTOUCHED)
        guards += guard
        self.carry, guard = _guarded((steps.carried, B), _UNTOUCHED)
        guards += guard
        self.status, guard = _guarded((B,), 0, np.int8)
        guards += guard
        self.failed_at, guard = _guarded((B,), -1, np.int64)
        self.guards = [*guards, *guard]

    def take(
        self,
        arguments: Any,
        start: int,
        stop: int,
        lanes: Any = None,
        part: Any = (0, 1),
        row: int | None = None,
    ) -> "_Trial":
        """Continue from state `start` to `stop`, as one part of a call."""
        if row is None:
            row = start // self.every + 1 if start and self.every else 0
        span = *(lanes or (0, len(self.omega0))), start, stop, self.every, row
        # What a kernel reads beside an array of one row is no step size, and no coefficient.
        given = tuple(_between_guards(each) for each in arguments)
        states, after = self.omega0.copy(), (self.saved, self.final, self.status, self.failed_at)
        self.steps.kernel(*part, given, states, self.carry, span, *after)
        pairs = zip(_arrays(given), _arrays(arguments), strict=True)
        kept = all(_same(one, other) for one, other in pairs)
        _expect(kept, "arguments to stay as they are", "others", 1)
        _expect(_same(states, self.omega0), "omega0 to stay as it is", "another one", 3)
        outside: list[float] = []
        for guard in self.guards:
            outside += guard[guard != _GUARD].tolist()
        _expect(not outside, "nothing to be written beside the arrays", short(outside), 5)
        return self

    def written(self) -> Any:
        """Return where each trajectory was written to: its last state and its saved states."""
        final = (self.final != _UNTOUCHED).all(axis=-1)
        return np.concatenate([final[None], (self.saved != _UNTOUCHED).all(axis=-1)])

    def touched(self) -> Any:
        """Return which trajectories were written to at all."""
        marks = (self.final != _UNTOUCHED).any(axis=-1) | (self.status != 0)
        carried = (self.carry != _UNTOUCHED).any(axis=0)
        return marks | carried | (self.saved != _UNTOUCHED).any(axis=(0, 2))

    def equals(self, other: "_Trial", which: Any = slice(None)) -> bool:
        pairs = [(self.status, other.status[which]), (self.failed_at, other.failed_at[which])]
        pairs += [(self.final, other.final[which]), (self.saved, other.saved[:, which])]
        return all(_same(one, two) for one, two in pairs)


def _same(one: Any, two: Any) -> bool:
    return bool(np.array_equal(one, two, equal_nan=one.dtype.kind == "f"))


def _expect(holds: bool, expected: str, received: str, item: int) -> None:
    if not holds:
        raise wrong("kernel", f"{expected} (item {item} of maps.Map)", received)


# ---------------------------------------------------------------------------- arguments of kernels
@lru_cache(maxsize=64)  # for small calls
def _is_of_package(kernel: Any, arguments: Any) -> bool:
    """Return True for a kernel of the package, with arguments that the package makes."""
    maker = getattr(arguments, "__module__", None)  # callables may lack one
    where: str = kernel.py_func.__module__
    is_ours = where.startswith(codes.__package__) and not isinstance(kernel, KernelOfStep)
    return maker == Problem.__module__ and is_ours


def arguments_for(problem: Problem, steps: Any, size: int) -> Arguments:
    """Return the arguments of a run of `size` trajectories; try a kernel of others before.

    ValueError if the kernel breaks the contract of `maps.Map`.
    """
    is_foreign = not _is_of_package(steps.kernel, steps.arguments)
    key = steps, problem.body.dimension
    if is_foreign and key not in _TRIED and 0 not in problem.body.shape:
        try:
            try_steps(problem, steps)
        except numba.TypingError as error:
            if not isinstance(steps.kernel, KernelOfStep):
                raise
            expected = "a function that Numba compiles, and that returns a Status as an int"
            raise wrong("step", expected, "the error above", TypeError) from error
        _TRIED.add(key)
    arguments: Arguments = steps.arguments(problem.body, problem.eps, problem.batch)
    if is_foreign:
        _check_arguments(arguments, size)
    return arguments


def _check_arguments(arguments: Any, size: int) -> None:
    """Raise an error unless arrays of numbers have a row for all, or one for each trajectory."""
    if not isinstance(arguments, tuple):
        raise wrong("Steps.arguments", "a tuple of arrays", type(arguments).__name__, TypeError)
    for k, array in enumerate(arguments):
        kind = getattr(array, "dtype", None)
        if kind is not None and kind.kind == "f" and kind != np.float64:
            raise wrong(f"arguments[{k}]", "an array of float64", str(kind), TypeError)
        if kind == np.float64 and len(array) not in (1, size):
            expected = f"1 or {size} rows, those of the batch (item 1 of maps.Map)"
            raise wrong(f"arguments[{k}]", expected, len(array))


def _check_step(kernel: Any, count: int) -> None:
    """Raise an error unless a step takes as many arrays as `Steps.arguments` makes beside eps."""
    step = kernel.step.py_func
    signature = inspect.signature(step)
    try:
        signature.bind(*range(4 + count))
    except TypeError:
        expected = f"step(x, out, eps, work, *row) with a row of {count}, those of Steps.arguments"
        raise wrong("step", expected, f"{step.__name__}{signature}", TypeError) from None


def _arrays(arguments: Any) -> Iterator[Any]:
    """Yield the arrays in tuples of arguments."""
    for each in arguments:
        if isinstance(each, tuple):
            yield from _arrays(each)
        elif isinstance(each, np.ndarray):
            yield each


def _between_guards(argument: Any) -> Any:
    """Return a copy of an array of numbers of trajectories, and of what is no array itself."""
    if isinstance(argument, tuple):
        make = getattr(argument, "_make", tuple)  # of a named tuple
        return make(map(_between_guards, argument))
    if not isinstance(argument, np.ndarray) or argument.dtype != np.float64:
        return np.copy(argument) if isinstance(argument, np.ndarray) else argument
    array, _ = _guarded(argument.shape, argument)
    array.flags.writeable = argument.flags.writeable  # part of its type
    return array


def _rows(arguments: Any, has_rows: Any, which: Any, scale: Any = 1.0) -> Any:
    """Return arguments with these rows of what a family has rows of, each times a number."""
    return tuple(
        np.ascontiguousarray((each[which].T * scale).T) if own else each
        for each, own in zip(arguments, has_rows, strict=True)
    )


def _family_like(body: Any, size: int) -> Any:
    """Return a batch of `size` bodies that all equal this one."""
    parts = {}
    for name, each in body._parts.items():
        array = np.asarray(each)
        own = array.shape[array.ndim - body._axes.get(name, 0) :]
        is_of_member = array.dtype.kind in "iufO" and name != MATRIX  # which a family shares
        parts[name] = np.broadcast_to(array, (size, *own)) if is_of_member else each
    return body._of(parts)


# -------------------------------------------------------------------------------- bodies of others
def check_parameters(kind: Any, random: Any) -> None:
    """Raise an error if a parameter of a class is a vector and `_axes` does not say so.

    Its components would be taken as members of a batch. Tried are random bodies of the record, and
    a body whose parameters are numbers.
    """
    name = kind.__name__
    if kind.__module__.partition(".")[0] == __package__.partition(".")[0]:
        return
    how = f"{name}._axes, as _axes = {{'I': 1}} for a vector I"
    for k, make in enumerate(random):
        body = make(np.random.default_rng(0), ())
        if shape := getattr(body, "shape", ()):
            given = [n for n, each in body._parts.items() if np.ndim(each) > body._axes.get(n, 0)]
            expected = f"a single body for the shape (), or the axes of {', '.join(given)} in {how}"
            raise wrong(f"random[{k}]", expected, f"a batch {shape}")
    if kind._axes:
        return
    failure: Exception | None = None
    # A constructor may refuse these numbers, and a field may divide by 0.
    with suppress(Exception), np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        body = kind(**{each.name: 1.0 for each in fields(kind)})
        try:
            body.field()
        except (TypeError, IndexError) as error:
            failure = error
    if failure is not None:
        expected = f"field() of parameters that are numbers, or the axes of vectors in {how}"
        raise wrong("body", expected, f"{type(failure).__name__}: {failure}") from failure


# --------------------------------------------------------------------------------------- the trial
def try_steps(problem: Problem, steps: Any, size: int = _SIZE) -> None:
    """Try a kernel with a body of a problem, and states and step sizes near one of its own."""
    body, D = problem.body, problem.body.dimension
    body = body[(0,) * len(body.shape)] if body.shape else body
    states = flat_arrays(problem.omega, problem.omega.shape[:-1])
    states = states[np.isfinite(states).all(axis=1) & states.any(axis=1)]
    given = states[0] if len(states) else np.ones(D)
    omega0 = given * np.linspace(1.0, 0.5, size)[:, None]
    omega0[1], omega0[3] = np.nan, np.clip(1e200 * given, -1e300, 1e300)
    eps = next((float(each) for each in np.ravel(problem.eps) if each), 1.0)

    # A family: what has a row for each member gets rows that differ.
    of_one, many = steps.arguments(body, eps, (size,)), np.full(size, eps)
    try:
        of_equals = steps.arguments(_family_like(body, size), many, (size,))
    except Exception:  # a class without families, whose single bodies are exact
        of_equals = steps.arguments(body, many, (size,))
    for each in (of_one, of_equals):
        _check_arguments(each, size)
    if isinstance(steps.kernel, KernelOfStep):
        _check_step(steps.kernel, len(of_one) - 1)
    has_rows = [
        getattr(each, "dtype", None) == np.float64 and len(each) == size for each in of_equals
    ]
    first = np.zeros(size, int)
    arguments = _rows(of_one, has_rows, first, np.linspace(1.0, 0.5, size))

    whole = _Trial(steps, omega0).take(arguments, 0, _STEPS)
    missing = np.argwhere(~whole.written())
    _expect(len(missing) == 0, "all states to be written", f"some that are not: {missing[:1]}", 5)
    _expect(_same(whole.saved[0], omega0), "state 0 to be saved", short(whole.saved[0, 0]), 3)
    _expect(_same(whole.saved[-1], whole.final), "final to be the last state", "another", 6)
    _check_failures(whole)
    of_nan = whole.status[1] == codes.NONFINITE and whole.failed_at[1] == 0
    _expect(bool(of_nan), "NONFINITE at step 0 for a state that is NaN", f"{whole.status[1]}", 3)

    cut = _Trial(steps, omega0).take(arguments, 0, 0)
    cut.take(arguments, 0, 2).take(arguments, 2, 3).take(arguments, 3, _STEPS)
    _expect(cut.equals(whole), "the same bits after cuts in time", "others", 4)
    for every in (4, 0):
        seldom = _Trial(steps, omega0, every).take(arguments, 0, 3).take(arguments, 3, _STEPS)
        as_before = not every or _same(seldom.saved, whole.saved[::every])
        as_before = as_before and _same(seldom.final, whole.final)
        which = "every fourth" if every else "none"
        _expect(as_before, f"the same states if {which} is saved", "others", 5)

    some = _Trial(steps, omega0).take(arguments, 0, _STEPS, (5, 9))
    others = np.delete(some.touched(), range(5, 9))
    _expect(not others.any(), "trajectories begin to end - 1 alone", "others, too", 2)
    parts = [_Trial(steps, omega0).take(arguments, 0, _STEPS, part=(p, 3)) for p in range(3)]
    times = sum(part.touched().astype(int) for part in parts)
    _expect(bool((times == 1).all()), "each trajectory in one part", f"{short(times)} times", 2)

    _try_rows(steps, of_one, has_rows, omega0, size)
    for k in (0, 2, size - 1):
        of_row = _rows(arguments, has_rows, slice(k, k + 1))
        alone = _Trial(steps, omega0[k : k + 1]).take(of_row, 0, _STEPS)
        _expect(alone.equals(whole, [k]), "the same bits in any batch", f"others of {k}", 7)
    again = np.arange(max(_WIDE, 2 * size)) % size
    wide = _Trial(steps, omega0[again], length=1).take(_rows(arguments, has_rows, again), 0, 1)
    as_before = _same(wide.saved, whole.saved[:2, again])
    _expect(as_before, "the same bits in a large batch", "others", 7)
    _try_signs(steps, body, eps, omega0)
    _try_late(steps, arguments, has_rows, whole, given)


def _try_rows(steps: Any, of_one: Any, has_rows: Any, omega0: FloatArray, size: int) -> None:
    """Compare arrays of one row, for all trajectories, with as many equal rows."""
    each = _rows(of_one, has_rows, np.zeros(size, int))
    common, equal = (_Trial(steps, omega0).take(a, 0, _STEPS) for a in (of_one, each))
    _expect(common.equals(equal), "the same bits for arrays of one row and of B", "others", 1)


def _try_signs(steps: Any, body: Any, eps: float, omega0: FloatArray) -> None:
    """Compare runs there and back, if the step size enters at all."""
    lengths = eps, 0.5 * eps, -eps
    whole, half, back = (
        _Trial(steps, omega0).take(steps.arguments(body, h, (len(omega0),)), 0, _STEPS).final
        for h in lengths
    )
    is_deaf = _same(back, whole) and not _same(half, whole)
    _expect(not is_deaf, "other states for -eps, which goes back", "those of eps", 1)
    stands = _same(back[4:], omega0[4:]) and not _same(whole[4:], omega0[4:])
    _expect(not stands, "steps for a negative eps", "none", 1)


def _try_late(steps: Any, arguments: Any, has_rows: Any, whole: _Trial, given: FloatArray) -> None:
    """Look at later steps, in a long run, and from states of which some fail at once."""
    size, D = whole.omega0.shape
    spread = np.clip(given * np.geomspace(1.0, 1e3, _FEW)[:, None], -1e300, 1e300)
    few = _rows(arguments, has_rows, slice(_FEW))
    long = _Trial(steps, spread, length=_LONG).take(few, 0, _LONG)
    _check_failures(long)
    cut = _Trial(steps, spread, length=_LONG)
    cut.final[:] = 0.5  # which is read from the second call on
    for start, stop in ((0, 64), (64, 64), (64, 71), (71, _LONG)):
        for lanes in ((0, 3), (3, _FEW)):
            for p in range(2):
                cut.take(few, start, stop, lanes, (p, 2))
    _expect(cut.equals(long), "the same bits after cuts in time and in the batch", "others", 4)
    if steps.carried:
        return  # the last states are not all that steps continue from
    largest = np.full((size, D), 1.7e308)
    largest[1::2, 1::2] *= -1.0  # one of two signs is beyond the range after a step
    for omega0 in (whole.omega0[4:], largest[4:]):
        rows = _rows(arguments, has_rows, slice(4, None))
        early = _Trial(steps, omega0).take(rows, 0, _STEPS)
        _check_failures(early)
        for start in _LATE:
            late = _Trial(steps, omega0)
            late.final[:] = omega0
            late.take(rows, start, start + _STEPS, row=1)
            late.saved[0] = omega0
            late.failed_at[late.failed_at >= 0] -= start
            _check_failures(late)
            _expect(late.equals(early), f"steps from state {start} as from 0", "others", 4)


def _check_failures(run: _Trial) -> None:
    """Compare statuses with the states that are NaN."""
    for i, status in enumerate(run.status):
        states, failed_at = run.saved[:, i], int(run.failed_at[i])
        known = int(status) in {int(each) for each in Status}
        _expect(known, f"a status of {[int(each) for each in Status]}", f"{status}", 7)
        exist = np.isfinite(states).all(axis=-1)
        if status >= 0:
            received = f"status {status} of {short(states[-1])}, failed_at = {failed_at}"
            # A positive status may say since when it holds.
            told = failed_at == -1 or (status > 0 and 0 < failed_at < len(states))
            if status == codes.PASSED_POLE:
                noted = run.steps.notes_poles and run.carry[0, i] == failed_at
                expected = "PASSED_POLE with Steps.notes_poles, and failed_at in carry[0]"
                _expect(noted, expected, received, 7)
            _expect(bool(exist.all()) and told, "failures as a status", received, 7)
            continue
        first = int(np.argmin(exist))
        received = f"failed_at = {failed_at}, first state that is not finite {first}"
        _expect(not exist.all() and failed_at == first, "the step of a failure", received, 7)
        after = np.isnan(states[first:]).all()
        _expect(bool(after), "NaN from a failure on", short(states[first]), 7)
