"""A trial of kernels that are not of the package, before their first run.

A kernel writes to memory that it is given, and no error shows if it writes nothing, too much, or
other numbers after a cut. The trial takes a few trajectories some steps, in several ways that must
give the same bits, between numbers that no kernel may touch. It takes no longer than 1000 steps.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from ..checks import FloatArray, short, wrong
from ..core import codes
from .arguments import Problem, flat_arrays
from .status import Status

_STEPS, _SIZE, _GUARD = 6, 19, -99
_UNTOUCHED = 1.2345678901234e-99
_TRIED: set[tuple[Any, int]] = set()


def _guarded(shape: tuple[int, ...], fill: float, dtype: Any = np.float64) -> Any:
    """Return an array that lies between numbers that stay as they are, and these."""
    count = int(np.prod(shape))
    beside = 8 + 2 * count // max(shape[0], 1)  # as much as two rows
    memory = np.full(count + 2 * beside, fill, dtype)
    memory[:beside] = memory[count + beside :] = _GUARD
    array = memory[beside : count + beside].reshape(shape)
    return array, (memory[:beside], memory[count + beside :])


class _Trial:
    """The arrays that a kernel writes, from state 0 on."""

    def __init__(self, steps: Any, omega0: FloatArray, every: int = 1) -> None:
        (B, D), self.every, self.steps = omega0.shape, every, steps
        rows = _STEPS // every + 1
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
        self, arguments: Any, start: int, stop: int, lanes: Any = None, part: Any = (0, 1)
    ) -> "_Trial":
        """Continue from state `start` to `stop`, as one part of a call."""
        row = start // self.every + 1 if start else 0
        span = *(lanes or (0, len(self.omega0))), start, stop, self.every, row
        kernel, given = self.steps.kernel, self.omega0.copy()
        after = self.saved, self.final, self.status, self.failed_at
        kernel(*part, arguments, given, self.carry, span, *after)
        _expect(_same(given, self.omega0), "omega0 to stay as it is", "another one", 3)
        outside = [number for guard in self.guards for number in guard if number != _GUARD]
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


@lru_cache(maxsize=64)  # for small calls
def is_of_package(kernel: Any, arguments: Any) -> bool:
    """Return True for a kernel of the package, with arguments that the package makes."""
    maker = getattr(arguments, "__module__", None)  # callables may lack one
    where: str = kernel.py_func.__module__
    return maker == Problem.__module__ and where.startswith(codes.__package__)


def try_once(problem: Problem, steps: Any) -> None:
    """Try the kernel of a run; ValueError if it breaks the contract of `maps.Map`."""
    key = steps, problem.body.dimension
    if key in _TRIED or 0 in problem.body.shape:
        return
    try_steps(problem, steps)
    _TRIED.add(key)


def try_steps(problem: Problem, steps: Any, size: int = _SIZE) -> None:
    """Try a kernel with a body of a problem, and states and step sizes near one of its own."""
    body, D = problem.body, problem.body.dimension
    body = body[(0,) * len(body.shape)] if body.shape else body
    states = flat_arrays(problem.omega, problem.omega.shape[:-1])
    states = states[np.isfinite(states).all(axis=1)]
    given = states[0] if len(states) else np.ones(D)
    omega0 = given * np.linspace(1.0, 0.5, size)[:, None]
    omega0[1], omega0[3] = np.nan, np.clip(1e200 * given, -1e300, 1e300)
    eps = float(np.ravel(problem.eps)[0]) if np.size(problem.eps) else 1.0
    several = eps * np.linspace(1.0, 0.5, size)
    arguments = steps.arguments(body, several, (size,))
    check_arguments(arguments, size)

    whole = _Trial(steps, omega0).take(arguments, 0, _STEPS)
    missing = np.argwhere(~whole.written())
    _expect(len(missing) == 0, "all states to be written", f"some that are not: {missing[:1]}", 5)
    _expect(_same(whole.saved[0], omega0), "state 0 to be saved", short(whole.saved[0, 0]), 3)
    _expect(_same(whole.saved[-1], whole.final), "final to be the last state", "another", 6)
    _check_failures(whole)

    cut = _Trial(steps, omega0).take(arguments, 0, 0)
    cut.take(arguments, 0, 2).take(arguments, 2, 3).take(arguments, 3, _STEPS)
    _expect(cut.equals(whole), "the same bits after cuts in time", "others", 4)
    seldom = _Trial(steps, omega0, 4).take(arguments, 0, 3).take(arguments, 3, _STEPS)
    as_before = _same(seldom.saved, whole.saved[::4]) and _same(seldom.final, whole.final)
    _expect(as_before, "the same states if every fourth is saved", "others", 5)

    some = _Trial(steps, omega0).take(arguments, 0, _STEPS, (5, 9))
    others = np.delete(some.touched(), range(5, 9))
    _expect(not others.any(), "trajectories begin to end - 1 alone", "others, too", 2)
    parts = [_Trial(steps, omega0).take(arguments, 0, _STEPS, part=(p, 3)) for p in range(3)]
    times = sum(part.touched().astype(int) for part in parts)
    _expect(bool((times == 1).all()), "each trajectory in one part", f"{short(times)} times", 2)
    for k in (0, 2, size - 1):
        of_one = steps.arguments(body, float(several[k]), (1,))
        alone = _Trial(steps, omega0[k : k + 1]).take(of_one, 0, _STEPS)
        _expect(alone.equals(whole, [k]), "the same bits in any batch", f"others of {k}", 7)


def check_arguments(arguments: Any, size: int) -> None:
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


def _check_failures(run: _Trial) -> None:
    """Compare statuses with the states that are NaN."""
    for i, status in enumerate(run.status):
        states, failed_at = run.saved[:, i], int(run.failed_at[i])
        known = int(status) in {int(each) for each in Status}
        _expect(known, f"a status of {[int(each) for each in Status]}", f"{status}", 7)
        exist = np.isfinite(states).all(axis=-1)
        if status >= 0:
            received = f"status {status} of {short(states[-1])}, failed_at = {failed_at}"
            _expect(bool(exist.all()) and failed_at == -1, "failures as a status", received, 7)
            continue
        first = int(np.argmin(exist))
        received = f"failed_at = {failed_at}, first state that is not finite {first}"
        _expect(not exist.all() and failed_at == first, "the step of a failure", received, 7)
        after = np.isnan(states[first:]).all()
        _expect(bool(after), "NaN from a failure on", short(states[first]), 7)
    of_nan = run.status[1] == codes.NONFINITE and run.failed_at[1] == 0
    _expect(bool(of_nan), "NONFINITE at step 0 for a state that is NaN", f"{run.status[1]}", 3)
