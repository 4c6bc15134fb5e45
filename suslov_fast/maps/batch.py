"""Runs in chunks: one call of a kernel each, for some trajectories and some steps.

Between chunks, which take up to 0.1 s, Python handles Ctrl-C. With `progress`, time is divided
first: at each call all trajectories have taken the same number of steps, so the run can end there.
"""

from collections.abc import Callable, Iterator
from itertools import chain
from time import perf_counter
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from ..calls import ALL, Report, flat_arrays, flat_parameter
from ..checks import FloatArray
from ..core.maps.kernel import field_steps
from ..core.maps.step_system import FieldSystem, steps_of_one
from ..core.numba.decorators import Kernel
from ..core.numba.span import AXES, Output, Span
from ..core.suslov import orientations
from ..core.suslov.map_3d import BodySystem
from ..core.suslov.map_nd import NDSystem
from .kernel_arguments import Arguments
from .kernel_calls import call_kernel
from .problem import Problem
from .tolerances import (
    COST_OF_SAVING,
    FEW_TRAJECTORIES,
    STEPS_BETWEEN_REPORTS,
    TIME_OF_LONG_CHUNK,
    TIME_OF_SHORT_CHUNK,
    TIME_OF_STEP_IN_PYTHON,
    WORK_OF_CHUNK,
    WORK_OF_CHUNK_WITH_TURNS,
)


class StepMethod(NamedTuple):
    """The steps of one method of a map: a kernel, and functions for its arguments and its cost."""

    kernel: Kernel
    # Returns the arguments of the kernel for (body, eps, batch).
    arguments: Callable[[Any, Any, tuple[int, ...]], Arguments]
    # Returns the constants of `compiled.step_system` for (body, eps).
    system: Callable[[Any, float], BodySystem | NDSystem | FieldSystem]
    carried: int = 0  # how many numbers, besides the last state, a trajectory continues from
    # Returns the time of a step, relative to the 3D map, for (D, arguments).
    cost: Callable[[int, Arguments], float] = lambda D, arguments: 1.0
    lanes: int = 128  # trajectories that a thread takes at a time
    # Yields groups of trajectories whose steps have the same operations: indices and arguments.
    divide: Callable[[Arguments], Iterator[tuple[Any, Arguments]]] | None = None
    # True if carry[0] has the number of each trajectory's first state beyond a pole, else 0. It is
    # negative if a wrong sign of a component showed the pole, and positive if det A < 0 did.
    notes_poles: bool = False
    # True if a substep goes backwards: fast decay may make det A < 0 there, as a pole does.
    goes_back: bool = False


class BatchRun:
    """A run of B trajectories from the states of a problem; they have taken `n` steps."""

    def __init__(self, problem: Problem) -> None:
        self.steps = problem.map.methods[problem.method]
        self.problem, batch = problem, problem.batch
        self.starts = flat_arrays(problem.x, batch)
        size, D = self.starts.shape
        self.arguments = self.steps.arguments(problem.body, problem.eps, problem.batch)
        self.groups: list[Any] = [(ALL, self.arguments)]
        if self.steps.divide is not None and problem.body.shape:
            self.groups = [*self.steps.divide(self.arguments)]
        self.turned: FloatArray | None = None
        self.n = 0
        self.carry = np.zeros((self.steps.carried, size))
        if problem.orientation is not None:
            self.turned = flat_arrays(problem.orientation, batch, 2).copy()
            self.turned[np.isnan(self.starts).any(axis=1)] = np.nan
        # States after n steps, statuses, and numbers of the first missing states.
        self.final, self.status = np.empty((*batch, D)), np.zeros(batch, np.int8)
        self.failed_at = np.full(batch, -1)

    @property
    def first_pole(self) -> NDArray[np.int64]:
        """The number of the first state beyond a pole, for each trajectory; -1 if there is none."""
        if not (self.steps.notes_poles and np.count_nonzero(self.carry[0])):  # as in most runs
            return np.full(self.problem.batch, -1)
        first = abs(self.carry[0]).astype(np.int64)
        return np.where(first > 0, first, -1).reshape(self.problem.batch)

    @property
    def by_sign(self) -> Any:
        """True where a component that keeps its sign changed it: a pole with det A > 0."""
        return self.steps.notes_poles and self.carry[0].reshape(self.problem.batch) < 0

    def to(
        self, stop: int, every: int = 0, report: Report | None = None
    ) -> tuple[FloatArray, FloatArray | None]:
        """Continue to state `stop`; return states (rows, ..., D), and orientations or None.

        They are the states 0, `every`, 2 `every`, ..., or the last state alone if `every` is 0. The
        run ends earlier if `report`, which is called with a number of steps, returns False.
        """
        (size, D), batch, turned = self.starts.shape, self.problem.batch, self.turned
        rows = _rows(0, stop, every)
        n, turns = 0 if turned is None else D + 1, None
        saved = np.empty((rows, *batch, D))
        flat = saved.reshape(len(saved), size, D)
        if turned is None:
            self._step_to(stop, every, flat, report)
        else:
            turns = np.empty((rows, *batch, n, n))
            self._turn_to(stop, every, flat, turns.reshape(rows, size, n, n), report)
        if every and self.n == stop:
            return saved, turns
        if every:  # `report` ended the run: give the memory for the other states back
            rows = _rows(0, self.n, every)
            return saved[:rows].copy(), None if turns is None else turns[:rows].copy()
        turns = None if turned is None else turned.reshape(1, *batch, n, n)
        return self.final[np.newaxis], turns

    def of_one(self, count: int = 1, every: int = 0, saved: Any = None) -> FloatArray | None:
        """Return the state after `count` steps, for a single state of a field or map; else None."""
        if self.steps.kernel is not field_steps or self.problem.batch:
            return None
        return steps_of_one(self.arguments, self.starts[0], count, every, saved)

    def _step_to(self, stop: int, every: int, saved: FloatArray, report: Report | None) -> None:
        """Continue to state `stop`, or until `report` ends the run; save states n * `every`."""
        if report is None:
            if self.n or (after := self.of_one(stop, every, saved)) is None:
                self._all_to(stop, every, saved)
            else:
                self.final[:], self.n = after, stop
            return
        row, length = 0, self._length(every)
        for until in chain(range(length, stop, length), [stop]):
            rows = row + _rows(self.n, until, every)
            self._all_to(until, every, saved[row:rows])
            row = rows
            if not report(until):
                break

    def _length(self, every: int) -> int:
        """Return how many steps to take between two reports of progress."""
        (_, D), threads = self.starts.shape, self.problem.threads or numba.config.NUMBA_NUM_THREADS
        lanes, fewest = self.steps.lanes, 1
        work = 0.0  # time of one step of the whole batch on all threads
        for where, arguments in self.groups:
            cost = max(self.steps.cost(D, arguments), 0.1) + (
                COST_OF_SAVING / every if every else 0.0
            )
            blocks = max(-(-len(self.starts if where is ALL else where) // lanes), 1)
            work += cost * blocks * lanes / min(blocks, threads)
            fewest = max(int(STEPS_BETWEEN_REPORTS / min(cost, 4.0)), fewest)
        return max(int(WORK_OF_CHUNK / work), fewest)

    def _all_to(self, stop: int, every: int, saved: FloatArray) -> None:
        """Continue all groups of trajectories to state `stop`; save states n * `every`."""
        size, D = self.starts.shape
        final, status = self.final.reshape(size, D), self.status.reshape(size)
        failed_at = self.failed_at.reshape(size)
        output = Output(saved, final, self.carry, status, failed_at)
        for where, arguments in self.groups:
            if where is ALL:
                self._take(arguments, self.starts, output, stop, every)
                continue
            copies = (np.take(a, where, axis) for a, axis in zip(output, AXES, strict=True))
            part = Output(*copies)
            self._take(arguments, self.starts[where], part, stop, every)
            for array, axis, copy in zip(output, AXES, part, strict=True):
                array[(ALL, where) if axis else where] = copy
        self.n = stop

    def _take(
        self, arguments: Arguments, starts: FloatArray, output: Output, stop: int, every: int
    ) -> None:
        """Continue a group of trajectories to state `stop`, in chunks.

        Chunks divide the batch before they divide time, so that their data stay in the caches. If a
        chunk takes little or much time, the next one is longer or shorter, because `cost` is rough.
        A block of lanes takes the same time however few of them are used, so a batch of one block
        is serial.
        """
        kernel, lanes = self.steps.kernel, self.steps.lanes
        (size, D), n, threads = starts.shape, self.n, self.problem.threads
        step = self.steps.cost(D, arguments)
        cost = step + (COST_OF_SAVING / every if every else 0.0)
        width, length = -(-size // lanes) * lanes or lanes, stop - n or 1
        if width * length * cost > WORK_OF_CHUNK:
            most = threads or numba.config.NUMBA_NUM_THREADS
            budget = (
                min(width // lanes, most) * WORK_OF_CHUNK / cost
            )  # steps of single trajectories
            unit = lanes * most  # multiples of it give each thread the same number of blocks
            width = min(max(int(budget / length) // unit, 1) * unit, width)
            length = max(int(budget / width), 1)
        for begin in range(0, size or 1, width):
            end = min(begin + width, size)
            start = n
            while True:  # once even if stop = n
                until = min(start + length, stop)
                row = _rows(n, start, every) if start else 0
                span = Span(begin, end, start, until, every, row)
                work = int((end - begin) * (until - start) * step) if end - begin > lanes else 0
                called_at = perf_counter()
                taken = size if size <= FEW_TRAJECTORIES else width
                seconds = TIME_OF_STEP_IN_PYTHON * (1.0 + step) * taken * (until - start + 2)
                data = arguments, starts, span, output
                call_kernel(kernel, work, threads, *data, seconds=seconds)
                if until == stop:
                    break
                seconds, start = perf_counter() - called_at, until
                if seconds < TIME_OF_SHORT_CHUNK:
                    length *= 2
                elif seconds > TIME_OF_LONG_CHUNK:
                    length = max(length // 2, 1)

    def _turn_to(
        self, stop: int, every: int, saved: FloatArray, turns: FloatArray, report: Report | None
    ) -> None:
        """Continue to state `stop`; save states n * `every`, and the orientations to `turns`."""
        (size, D), turned, row = self.starts.shape, self.turned, 0
        length = min(
            max(WORK_OF_CHUNK_WITH_TURNS // (max(size, 1) * (D + 1) ** 2), 1), max(stop, 1)
        )
        path = np.empty((length + 1, size, D))
        eps = flat_parameter(self.problem.eps, self.problem.batch)
        axial = self.problem.map.attitude == "axial"
        for start in range(0, max(stop, 1), length):  # once even if stop = 0
            path[0], until = self.final.reshape(size, D), min(start + length, stop)
            # The first part of the path includes state 0.
            self._step_to(until, 1, path[1:] if start else path, None)
            states, first = path[: until - start + 1], row
            if every:
                multiples = states[every - start % every if start else 0 :: every]
                row += len(multiples)
                saved[first:row] = multiples
                if start == 0:  # the orientation at state 0 is given
                    turns[0], first = turned, 1
            arrays, rows = (states, eps, axial, turned), (start, every, first, turns)
            work, threads = states.size * (D + 1), self.problem.threads
            seconds = 0.2 * TIME_OF_STEP_IN_PYTHON * (size + 8) * (until - start + 1) * (D + 1) ** 2
            call_kernel(orientations.turn_along, work, threads, *arrays, *rows, seconds=seconds)
            if report is not None and not report(until):
                break


def _rows(begin: int, end: int, every: int) -> int:
    """Return how many multiples of `every` are in (begin, end], or in [0, end] if `begin` is 0."""
    return end // every - (begin or -1) // every if every else 0


def states_after(problem: Problem) -> FloatArray:
    """Return the states (..., D) after one step; NaN where there is none."""
    batch_run = BatchRun(problem)
    batch_run.to(1)
    return batch_run.final
