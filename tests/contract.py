"""The contract of kernels of steps, tested item by item.

    steps(part, parts, arguments, omega0, carry, span, saved, final, status, failed_at)

A kernel is decorated with `core.compiling.numba.kernel`; `core/users/own_map.py` has a short one.
It neither validates nor raises, and allocates nothing inside loops over steps.

1. `arguments` is the tuple of arrays that `Steps.arguments(body, eps, batch)` returned, once for a
   run; a kernel only reads it. An array has one row if all B trajectories share it, else B rows:
   ``array[i % len(array)]`` belongs to trajectory i. A negative eps steps back.
2. `span` is (begin, end, start, stop, every, row). The call takes the trajectories
   begin <= i < end from state `start` to state `stop`. A thread computes part number `part` of
   `parts`; `core.compiling.numba.share` returns its trajectories.
3. State 0 is `omega0` (B, D), read only if start = 0. It counts as a saved state and, if it is NaN,
   as a failure at step 0: status NONFINITE. Calls with start = stop = 0 do nothing else.
4. A run can be cut into calls anywhere, in time and in the batch, and all cuts give the same bits:
   a step must not depend on n. Steps continue from `final` (B, D) and from `carry` (carried, B),
   whose contents the kernel chooses. Both are read if start > 0, and written at `stop`.
5. If every > 0, states n with start < n <= stop, and n = 0 if start = 0, are saved if n is a
   multiple of `every`: the first to saved[row], the next to saved[row + 1], and so on; `saved` is
   (rows, B, D).
6. `final` receives the states at `stop`, saved or not.
7. A trajectory that fails at state n gets status[i] < 0 (SINGULAR, or NONFINITE beyond float64),
   failed_at[i] = n, and NaN from there on, in `saved` and `final`, also in later calls. The bits of
   a trajectory depend neither on others, nor on the batch, its order, or `parts`. With
   `Steps.notes_poles`, the first step from det A < 0 sets PASSED_POLE, and both failed_at[i] and
   carry[0, i], which is 0 before, to the number of the state after it; a failure later leaves
   carry[0, i] as it is.

A kernel writes to arrays that it is given, and no error shows if it writes too little, too much, or
other numbers where a run is cut. The trial runs a few trajectories in several ways that must give
the same bits, with guard values around all arrays: about 6,000 steps in all.
"""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from suslov_fast import Status
from suslov_fast.bodies.fields.field_of_terms import H_INDICES, INDICES, MATRIX
from suslov_fast.checks import FloatArray, short
from suslov_fast.core.compiling import codes
from suslov_fast.engine.arguments import flat_arrays
from suslov_fast.engine.problem import Problem
from suslov_fast.engine.trial import check_arguments

SHARED = INDICES, H_INDICES, MATRIX  # parts that all members of a family of fields share
_SIZE, _WIDE, _STEPS = 19, 301, 6  # trajectories, those of a wide batch, and steps
# Runs from these states must have the bits of a run from state 0; they pass state 64, and a round
# number beyond 32 bits, where kernels that do something every so many steps might differ. No state
# on the way is a multiple of 512, at which the kernel of `core/suslov/steps.py` restores R.
_LATE = 61, 43 * 10**8 - 3
_CUTS = 0, 2, 3, 3, _STEPS  # ends of calls; the third call takes no step
_GUARD, _UNTOUCHED = -99, 1.2345678901234e-99  # values around arrays, and in them before a run


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
    """Raise AssertionError, with the item of the contract that a kernel breaks, unless it holds."""
    if not holds:
        raise AssertionError(f"item {item} asks for {expected}, not {received}")


def _expect_same(run: _Run, expected: _Run, where: str, item: int) -> None:
    """Raise AssertionError unless two runs agree in all but `carry`, which is a kernel's own."""
    pairs = zip(run[:4], expected[:4], strict=True)
    _expect(all(_same(*pair) for pair in pairs), f"the same bits {where}", "others", item)


def _check_failures(run: _Run, notes_poles: bool) -> None:
    """Raise AssertionError unless statuses and failed_at tell which states are not finite."""
    n, (status, failed_at) = np.arange(len(run.saved))[:, None], (run.status, run.failed_at)
    is_known, known = np.isin(status, [*Status]), [int(each) for each in Status]
    _expect(is_known.all(), f"a status of {known}", short({*status[~is_known].tolist()}), 7)
    exist: Any = np.isfinite(run.saved).all(axis=-1)
    gone = (status < 0) & (n >= failed_at)
    # With a positive status, failed_at is -1 or the first state for which it holds.
    is_right = (failed_at == -1) | (status > 0) & (failed_at > 0) & (failed_at < len(n))
    is_right = (failed_at >= 0) & (status < 0) | is_right & (status >= 0)
    if notes_poles:
        is_right &= (status != codes.PASSED_POLE) | (failed_at == abs(run.carry[0]))
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


def _rows(arguments: Any, has_rows: Any, which: Any, scale: Any = 1.0) -> Any:
    """Return arguments with these rows, times `scale`, of arrays with one row for each member."""
    return tuple(
        np.ascontiguousarray((array[which].T * scale).T) if is_row else array
        for array, is_row in zip(arguments, has_rows, strict=True)
    )


# --------------------------------------------------------------------------------------- the trial
def family_like(body: Any, size: int) -> Any:
    """Return a batch of `size` copies of a single body."""
    parts = dict(body._parts)
    for name, value in parts.items():
        if np.asarray(value).dtype.kind in "iufO" and name not in SHARED:
            parts[name] = np.broadcast_to(value, (size, *np.shape(value)))
    return body._with(parts)


def try_steps(problem: Problem, steps: Any, size: int = _SIZE) -> None:
    """Try a kernel with one body of the problem, states near one of its own, and its step size."""
    body = problem.body[(0,) * len(problem.body.shape)] if problem.body.shape else problem.body
    omega0 = _states_of_trial(problem, size)
    eps = next((float(h) for h in np.ravel(problem.eps) if h), 1.0)

    # Make the arguments of a family whose members differ, by scaling the rows of equal members.
    of_one, many = steps.arguments(body, eps, (size,)), np.full(size, eps)
    try:
        of_equals = steps.arguments(family_like(body, size), many, (size,))
    except Exception:  # the class has no families
        of_equals = steps.arguments(body, many, (size,))
    check_arguments(of_one, size)
    check_arguments(of_equals, size)
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
    """Raise AssertionError unless a run from state 0 saved all states and noted all failures."""
    missing = np.argwhere((whole.saved == _UNTOUCHED).any(axis=-1))
    _expect(len(missing) == 0, "all states to be saved", f"none at (n, i) = {missing[:1]}", 5)
    _expect(_same(whole.saved[0], omega0), "state 0 to be saved", short(whole.saved[0, 0]), 3)
    _expect(_same(whole.saved[-1], whole.final), "final to be the last state", "another", 6)
    _check_failures(whole, notes_poles)
    of_nan = whole.status[1] == codes.NONFINITE and whole.failed_at[1] == 0
    _expect(of_nan, "NONFINITE at step 0 for a state that is NaN", f"{whole.status[1]}", 3)


def _check_divisions(steps: Any, arguments: Any, omega0: FloatArray, whole: _Run) -> None:
    """Raise AssertionError unless divided runs have the bits of the whole one."""
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
