"""Iteration in stretches of steps, each one call of a kernel.

Between stretches, which take up to 0.1 s, Python handles Ctrl-C. With `progress` time is divided
first, so that all trajectories stand at the same step when it is called, and the run can end there.
"""

import inspect
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from itertools import chain
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray, extra, instance, integer, kind_of, require, short, wrong
from ..core import orientations
from ..core.numba import Kernel
from ..core.steps_field import FieldSystem
from ..core.steps_nd import NDSystem
from .arguments import ALL, Arguments, flat_arrays, flat_parameter
from .problem import Problem
from .threads import call_kernel
from .trial import arguments_for

# Work of a thread in a stretch, and cost of saving a state, in steps of the three-dimensional map.
_STRETCH, _SAVING = 2**26, 8.0
# Work of a stretch with orientations: the number of states times n**2.
_TURNING = 2**24

# The least number of steps of the three-dimensional map from one report of progress to the next, a
# fourth of it for others: the states of a large batch come from memory each time.
_BETWEEN = 256

Progress = bool | None | Callable[[int, int], object]  # the argument of long computations
Report = Callable[[int], bool]  # takes the number of steps done so far; False ends the run


def reporter(progress: Progress, total: int) -> AbstractContextManager[Report | None]:
    """Check `progress`; return a context manager of the function that shows the steps done.

    The context opens and closes a bar.
    """
    if progress is None or progress is False:
        return nullcontext()
    if progress is True:
        return _bar(extra("tqdm.auto", "progress").tqdm, total)  # a notebook bar in a notebook
    if not callable(progress) or isinstance(progress, type) or not _takes_two(progress):
        name = kind_of(progress) if isinstance(progress, type) else short(progress)
        expected = "True, for a bar, or a function that is called as progress(done, total)"
        raise wrong("progress", expected, name, TypeError)

    def report(done: int) -> bool:
        answer = progress(done, total)
        return not (isinstance(answer, (bool, np.bool_)) and not answer)

    return nullcontext(report)


def _takes_two(function: Callable[..., object]) -> bool:
    """Return False if a function cannot be called with two numbers."""
    try:
        inspect.signature(function).bind(0, 0)
    except TypeError:
        return False
    except ValueError:  # some functions written in C do not say
        pass
    return True


@contextmanager
def _bar(tqdm: Any, total: int) -> Iterator[Report]:
    with tqdm(total=total, unit="step", unit_scale=True) as bar:

        def report(done: int) -> bool:
            bar.update(done - bar.n)
            return True

        yield report


class Steps(NamedTuple):
    """The steps of a method: a kernel, see `maps.Map`, and what a run needs to call it."""

    kernel: Kernel
    arguments: Callable[[Any, Any, tuple[int, ...]], Arguments]  # of (body, eps, batch)
    carried: int = 0  # numbers of a trajectory that steps continue from, beside the last state
    # Of a step of D components, relative to the 3D map, from the arguments of the kernel.
    cost: Callable[[int, Arguments], float] = lambda D, arguments: 1.0
    lanes: int = 128  # trajectories that a thread takes at a time
    # Makes the constants of `compiled.step_system`, of (body, eps); without it that has no steps.
    system: Callable[[Any, float], NDSystem | FieldSystem] | None = None
    # Divides the trajectories of (D, arguments) into some that have arguments of their own.
    divide: Callable[[int, Arguments], Iterator[tuple[Any, Arguments]]] | None = None
    # True if carry[0] is the first state beyond a step from det A < 0, 0 while there is none.
    notes_poles: bool = False


def check_steps(name: str, steps: Any) -> None:
    """Raise an error unless these are steps that a run can take."""
    instance(name, steps, Steps)
    instance(f"{name}.kernel", steps.kernel, Kernel)
    for each in ("arguments", "cost"):
        if not callable(getattr(steps, each)):
            raise wrong(f"{name}.{each}", "a function", repr(getattr(steps, each)), TypeError)
    integer(f"{name}.carried", steps.carried, 1 if steps.notes_poles else 0)
    if integer(f"{name}.lanes", steps.lanes, 1) % 8:
        raise wrong(f"{name}.lanes", "a multiple of 8", steps.lanes)


class Progressed(NamedTuple):
    """The data that continue a run, beside its problem."""

    n: int  # the steps that it has taken
    final: FloatArray  # (..., D), the states there
    status: NDArray[np.int8]  # (...)
    failed_at: NDArray[np.int64]  # (...)
    carry: FloatArray  # (carried, B)
    turned: FloatArray | None  # (B, n, n), the orientations there


class March:
    """A run of B trajectories at state `n`, with all that is needed to continue it.

    It begins with the states of a problem, or goes on where another one stood.
    """

    def __init__(
        self, problem: Problem, method: str | None = None, earlier: Progressed | None = None
    ) -> None:
        methods = problem.map.methods
        method = method or problem.method
        self.problem, self.steps = problem, methods.get(method, next(iter(methods.values())))
        self.omega0 = flat_arrays(problem.omega, problem.batch)
        self.arguments = arguments_for(problem, self.steps, len(self.omega0))
        size, D = self.omega0.shape
        divide, own = self.steps.divide, self.arguments
        self.groups: list[Any] = [(ALL, own)] if divide is None else [*divide(D, own)]
        self.turned: FloatArray | None = None
        if earlier is not None:
            self.n = earlier.n
            self.final, self.status = earlier.final.copy(), earlier.status.copy()
            self.failed_at, self.carry = earlier.failed_at.copy(), earlier.carry.copy()
            self.turned = None if earlier.turned is None else earlier.turned.copy()
            return
        self.n = 0
        self.carry = np.zeros((self.steps.carried, size))
        if problem.orientation is not None:
            self.turned = flat_arrays(problem.orientation, problem.batch, 2).copy()
            self.turned[np.isnan(self.omega0).any(axis=1)] = np.nan
        # Those of the run at state n, in the shape of the batch.
        self.final = np.empty((*problem.batch, D))
        self.status = np.zeros(problem.batch, np.int8)
        self.failed_at = np.empty(problem.batch, np.int64)
        self.failed_at.fill(-1)  # `np.full` takes longer, in small calls

    def to(
        self,
        stop: int,
        every: int = 0,
        out: FloatArray | None = None,
        report: Report | None = None,
    ) -> tuple[FloatArray, FloatArray | None]:
        """Continue to state `stop`; return states (rows, ..., D) and orientations, or None.

        They are the multiples of `every` after state n, and state 0 if n is 0, in `out` if it is
        given; or the last state if `every` is 0. `report` takes the number of steps of this call
        that all trajectories have taken; where it returns False the march ends, at state `n`.
        """
        (size, D), batch, turned = self.omega0.shape, self.problem.batch, self.turned
        rows, begin = _rows(self.n, stop, every), self.n
        n, turns = 0 if turned is None else D + 1, None
        numbers = rows * size * (D * (out is None) + n * n)
        require(8 * numbers, "raise save_every or divide the batch")
        saved = np.empty((rows, *batch, D)) if out is None else out
        flat = saved.reshape(len(saved), size, D)
        if turned is None:
            self._step_to(stop, every, flat, report)
        else:
            turns = np.empty((rows, *batch, n, n))
            self._turn_to(stop, every, flat, turns.reshape(rows, size, n, n), report)
        if every and self.n == stop:
            return saved, turns
        if every:  # `report` ended the march: memory for the rest is given back
            rows = _rows(begin, self.n, every)
            saved = saved[:rows].copy() if out is None else out[:rows]
            return saved, None if turns is None else turns[:rows].copy()
        if out is not None:
            out[0] = self.final
        turns = None if turned is None else turned.reshape(1, *batch, n, n)
        return self.final[np.newaxis] if out is None else out, turns

    def pieces(
        self, steps: int, every: int, rows: int
    ) -> Iterator[tuple[FloatArray, FloatArray | None]]:
        """Iterate from state 0 to `steps`; yield what `to` returns, `rows` states at a time."""
        last = steps // every if every else 0
        for end in range(rows, last + rows + 1, rows):
            saved, turns = self.to(steps if end > last else (end - 1) * every, every)
            # After a piece that is state 0 alone, the next one begins with state 0 again.
            yield saved[-rows:], None if turns is None else turns[-rows:]

    def _step_to(self, stop: int, every: int, saved: FloatArray, report: Report | None) -> None:
        """Continue without orientations."""
        if report is None:
            self._all_to(stop, every, saved)
            return
        begin, row, length = self.n, 0, self._length(every)
        for until in chain(range(begin + length, stop, length), [stop]):
            rows = row + _rows(self.n, until, every)
            self._all_to(until, every, saved[row:rows])
            row = rows
            if not report(until - begin):
                break

    def _length(self, every: int) -> int:
        """Return the number of steps of all trajectories from one report to the next."""
        (_, D), most = self.omega0.shape, self.problem.threads or numba.config.NUMBA_NUM_THREADS
        lanes, least = self.steps.lanes, 1
        work = 0.0  # the time of a step, on all threads
        for where, arguments in self.groups:
            cost = max(self.steps.cost(D, arguments), 0.1) + (_SAVING / every if every else 0.0)
            blocks = max(-(-len(self.omega0 if where is ALL else where) // lanes), 1)
            work += cost * blocks * lanes / min(blocks, most)
            least = max(int(_BETWEEN / min(cost, 4.0)), least)
        return max(int(_STRETCH / work), least)

    def _all_to(self, stop: int, every: int, saved: FloatArray) -> None:
        """Continue all trajectories to state `stop`."""
        size, D = self.omega0.shape
        final, status = self.final.reshape(size, D), self.status.reshape(size)
        failed_at, axes = self.failed_at.reshape(size), (0, 1, 1, 0, 0, 0)  # of trajectories
        arrays: Any = self.omega0, self.carry, saved, final, status, failed_at
        for where, arguments in self.groups:
            if where is ALL:
                self._take(arguments, arrays, stop, every)
                continue
            own = [np.take(each, where, axis) for each, axis in zip(arrays, axes, strict=True)]
            self._take(arguments, own, stop, every)
            for each, axis, found in zip(arrays[1:], axes[1:], own[1:], strict=True):
                each[(ALL, where) if axis else where] = found
        self.n = stop

    def _take(self, arguments: Arguments, arrays: Sequence[Any], stop: int, every: int) -> None:
        """Continue trajectories with these arguments and arrays.

        The batch is divided first, so that the data of a stretch stay in the caches; time is
        divided only if few trajectories take long. A block of lanes takes the time of all lanes,
        and is not worth a second thread.
        """
        kernel, lanes = self.steps.kernel, self.steps.lanes
        (size, D), n, threads = arrays[0].shape, self.n, self.problem.threads
        step = self.steps.cost(D, arguments)
        cost = step + (_SAVING / every if every else 0.0)
        width, length = max(-(-size // lanes), 1) * lanes, max(stop - n, 1)
        if width * length * cost > _STRETCH:
            most = threads or numba.config.NUMBA_NUM_THREADS
            at_once = min(width // lanes, most) * _STRETCH / cost  # steps of all trajectories
            whole = lanes * most  # so that all threads have as many blocks
            width = min(max(int(at_once / length) // whole, 1) * whole, width)
            length = max(int(at_once / width), 1)
        for begin in range(0, max(size, 1), width):
            end = min(begin + width, size)
            for start in range(n, max(stop, n + 1), length):
                until = min(start + length, stop)
                row = _rows(n, start, every) if start else 0
                span = begin, end, start, until, every, row
                work = int((end - begin) * (until - start) * step) if end - begin > lanes else 0
                call_kernel(kernel, work, threads, arguments, *arrays[:2], span, *arrays[2:])

    def _turn_to(
        self, stop: int, every: int, saved: FloatArray, turns: FloatArray, report: Report | None
    ) -> None:
        """Continue with orientations: all states into own memory, then the rotations along them."""
        (size, D), n, turned, row = self.omega0.shape, self.n, self.turned, 0
        length = min(max(_TURNING // (max(size, 1) * (D + 1) ** 2), 1), max(stop - n, 1))
        path = np.empty((length + 1, size, D))
        eps = flat_parameter(self.problem.eps, self.problem.batch)
        axial = self.problem.map.attitude == "axial"
        for start in range(n, max(stop, n + 1), length):
            path[0], until = self.final.reshape(size, D), min(start + length, stop)
            self._step_to(until, 1, path[1:] if start else path, None)
            states, first = path[: until - start + 1], row
            if every:
                multiples = states[every - start % every if start else 0 :: every]
                row += len(multiples)
                saved[first:row] = multiples
                if start == 0:
                    turns[0], first = turned, 1
            work, given = states.size * (D + 1), (states, eps, axial, turned)
            threads = self.problem.threads
            call_kernel(orientations.turn_along, work, threads, *given, start, every, first, turns)
            if report is not None and not report(until - n):
                break


def _rows(begin: int, end: int, every: int) -> int:
    """Return how many states after state `begin` up to state `end` are saved; with state 0."""
    return end // every - (begin or -1) // every if every else 0


def states_after(problem: Problem, steps: int = 1) -> FloatArray:
    """Return the states (..., D) after a number of steps, NaN where there are none."""
    march = March(problem)
    march.to(steps)
    return march.final
