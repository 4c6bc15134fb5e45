"""Trajectories step by step, and states by the closed form: one call of a kernel for each stretch.

Between stretches, which take up to 0.1 s, Python handles Ctrl-C and progress is reported.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from ..bodies.nd import SuslovND
from ..checks import FloatArray, wrong
from ..core import closed_form, orientations, steps_field
from .arguments import States, flat_arrays, parameters_of, require
from .threads import Kernel, call_kernel

# Work of a thread in a stretch, in steps of the three-dimensional map.
_STRETCH = 2**26
# Least numbers of trajectories and of steps of a stretch, if there are as many, each divided by the
# cost of a step: entering a trajectory costs tens of steps of the three-dimensional map.
_ABREAST, _LENGTH = 2**13, 2**8
# Cost of saving a state, in steps of the three-dimensional map.
_SAVING = 8.0
# Work of a stretch with orientations: the number of states times n**2.
_TURNING = 2**24

# States of a slice: 30 ms, or 130 ms of orbits that turn.
_SLICE = 2**21
# Costs of entering an orbit, and of a state, in steps of the three-dimensional map.
_ENTERING, _STATE = 64, 8

Progress = bool | None | Callable[[int, int], object]  # the argument of long computations
Report = Callable[[int], object]  # takes the number of steps done so far


def check_progress(progress: Progress) -> None:
    """Check the argument, and that tqdm is installed if a bar is requested."""
    if progress is True:
        _tqdm()
    elif not (progress is None or progress is False or callable(progress)):
        expected = "True, False, None or a callable (done, total)"
        raise wrong("progress", expected, type(progress).__name__, TypeError)


@contextmanager
def reporter(progress: Progress, total: int) -> Iterator[Report]:
    """Yield a function that takes the number of steps done so far, and shows any progress."""
    shown = -1

    def report(done: int) -> None:
        nonlocal shown
        if callable(progress) and done > shown:
            progress(done, total)
        elif bar is not None:
            bar.update(done - bar.n)
        shown = done

    bar = _tqdm()(total=total, unit="step", unit_scale=True) if progress is True else None
    with bar or nullcontext():
        yield report
        report(total)


def _tqdm() -> Any:
    try:
        from tqdm.auto import tqdm  # a notebook bar in a notebook
    except ImportError as error:
        install = "pip install '.[progress]' in a copy of the repository"
        raise ImportError(f"progress: expected tqdm, got none: {install}") from error
    return tqdm


class Steps(NamedTuple):
    """The steps of a method, for states of D components."""

    kernel: Kernel
    carried: Callable[[int], int]  # the numbers of a trajectory from which steps go on
    # Of a step, in those of the 3D map; T is the number of terms of a field.
    cost: Callable[[int, int], float] = lambda D, T: 1.0
    lanes: int = 128  # trajectories that a thread takes at a time


class March:
    """A batch of B trajectories on its way: at state `n`, with all that is needed to go on."""

    def __init__(self, steps: Steps, states: States) -> None:
        body, omega, eps, batch, self.threads, _, orientation = states
        self.steps, self.n, self.batch = steps, -1, batch  # before state 0
        source = body.field() if steps.kernel is steps_field.steps else body
        self.parameters = parameters_of(source, eps, batch)
        self.axial = not isinstance(body, SuslovND)
        self.omega0 = flat_arrays(omega, batch)
        size, D = self.omega0.shape
        self.carry = np.empty((size, steps.carried(D)))
        self.turned = None if orientation is None else flat_arrays(orientation, batch, 2).copy()
        if self.turned is not None:
            self.turned[np.isnan(self.omega0).any(axis=1)] = np.nan
        # Those of the run at state n, in the shape of the batch.
        self.final = np.empty((*batch, D))
        self.status = np.zeros(batch, np.int8)
        self.failed_at = np.empty(batch, np.int64)
        self.failed_at.fill(-1)

    def to(
        self,
        stop: int,
        every: int = 0,
        out: FloatArray | None = None,
        report: Report | None = None,
    ) -> tuple[FloatArray, FloatArray | None]:
        """Go on to state `stop`; return states (rows, ..., D) and orientations, None without them.

        They are those after state n that are multiples of `every`, in `out` if it is given; or the
        last one if `every` is 0. `report` takes the number of the state that all trajectories have
        come to.
        """
        (size, D), turned, batch, again = self.omega0.shape, self.turned, self.batch, self.n == 0
        if again:  # kernels begin with state 0, which is saved once more
            self.n = -1
        rows = stop // every - self.n // every if every else 0
        n, turns = 0 if turned is None else D + 1, None
        numbers = rows * size * (D * (out is None) + n * n)
        require(8 * numbers, "raise save_every or divide the batch")
        saved = np.empty((rows, *batch, D)) if out is None else out
        flat = saved.reshape(len(saved), size, D)
        if turned is not None:
            turns = np.empty((rows, *batch, n, n))
            self._turn_to(stop, every, flat, turns.reshape(rows, size, n, n), report)
        elif stop > self.n:
            self._step_to(stop, every, flat, report)
        if again:
            saved, turns = saved[1:], None if turns is None else turns[1:]
        if every:
            return saved, turns
        if out is not None:
            out[0] = self.final
        turns = None if turned is None else turned.reshape(1, *batch, n, n)
        return self.final[np.newaxis] if out is None else out, turns

    def _step_to(self, stop: int, every: int, saved: FloatArray, report: Report | None) -> None:
        """Go on without orientations."""
        n, size = self.n, len(self.omega0)
        before = self.parameters, self.omega0, self.carry
        final = self.final.reshape(self.omega0.shape)
        after = saved, final, self.status.reshape(size), self.failed_at.reshape(size)
        for (begin, end, start, until), work in self._stretches(stop, every):
            row = start // every - n // every if every and start > 0 else 0
            span = begin, end, start, until, every, row
            call_kernel(self.steps.kernel, work, self.threads, *before, span, *after)
            if report is not None:
                steps = begin * (stop - n) + (end - begin) * (until - n)
                report(n + steps // max(size, 1))
        self.n = stop

    def _turn_to(
        self, stop: int, every: int, saved: FloatArray, turns: FloatArray, report: Report | None
    ) -> None:
        """Go on with orientations: all states into memory of our own, then what they turn."""
        (size, D), eps, turned, row = self.omega0.shape, self.parameters[-1], self.turned, 0
        at_once = max(_TURNING // (max(size, 1) * (D + 1) ** 2), 1)
        path = np.empty((min(at_once, max(stop - self.n, 1)) + 1, size, D))
        path[0] = self.final.reshape(size, D)
        while stop > self.n:
            is_new, start = self.n < 0, max(self.n, 0)
            until = min(start + len(path) - 1, stop)
            self._step_to(until, 1, path if is_new else path[1:], None)
            states, first = path[: until - start + 1], row
            if every:
                multiples = states[0 if is_new else every - start % every :: every]
                row += len(multiples)
                saved[first:row] = multiples
                if is_new:
                    turns[first] = turned
                    first += 1
            work, given = size * (until - start) * (D + 1) ** 2, (states, eps, self.axial, turned)
            call_kernel(orientations.turn, work, self.threads, *given, start, every, first, turns)
            path[0] = states[-1]
            if report is not None:
                report(until)

    def _stretches(self, stop: int, every: int) -> Iterable[tuple[tuple[int, ...], int]]:
        """Return trajectories begin to end, states start to stop, and work, of each stretch.

        The batch is divided first, so that the data of a stretch stay in the caches; time is
        divided only if few trajectories take long. A block of lanes takes the time of all lanes,
        and is not worth a second thread.
        """
        (size, D), n, (_, _, cost_of, lanes) = self.omega0.shape, max(self.n, 0), self.steps
        step, length = cost_of(D, self.parameters[0].shape[-1]), max(stop - n, 1)
        cost = step + (_SAVING / every if every else 0.0)
        blocks = -(-size // lanes)
        if blocks * lanes * length * cost <= _STRETCH:
            return [((0, size, n, stop), int(size * length * step) if blocks > 1 else 0)]
        most = self.threads or numba.config.NUMBA_NUM_THREADS
        at_once = min(blocks, most) * _STRETCH / cost  # steps of all trajectories
        abreast = max(lanes * most, int(_ABREAST / step), int(at_once / length))
        width = -(-size // (-(-size // abreast) * lanes)) * lanes
        length = max(int(_LENGTH / step), int(at_once / width), 1)
        work = int(length * step) if width > lanes else 0
        return (
            ((begin, end, start, min(start + length, stop)), (end - begin) * work)
            for begin in range(0, size, width)
            for end in (min(begin + width, size),)
            for start in range(n, max(stop, n + 1), length)
        )


def states_at(
    parameters: tuple[FloatArray, ...],
    omega: FloatArray,
    discrete: bool,
    times: FloatArray,
    threads: int | None,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return states (N, B, 2) at times (N,), and why orbits lack some, the flags (3, B) of kernels.

    The orbits are those of states omega (B, 2), of the map, or else of the flow.
    """
    shape = times.size, *omega.shape
    require(8 * math.prod(shape), "compute fewer states at a time")
    out, reasons = np.empty(shape), np.zeros((3, len(omega)), bool)
    if shape[0] * shape[1] <= _SLICE:
        _fill(threads, parameters, omega, float(discrete), times, out, reasons)
        return out, reasons
    for rows, orbits in _slices(*shape[:2]):
        part = tuple(each if len(each) == 1 else each[orbits] for each in parameters)
        found = np.zeros(reasons[:, orbits].shape, bool)
        states = out[rows, orbits]
        _fill(threads, part, omega[orbits], float(discrete), times[rows], states, found)
        reasons[:, orbits] |= found
    return out, reasons


def _fill(threads: int | None, *arguments: Any) -> None:
    _, omega, _, times, *_ = arguments
    work = len(omega) * (_ENTERING + _STATE * len(times))
    call_kernel(closed_form.states, work, threads, *arguments)


def _slices(times: int, orbits: int) -> Iterator[tuple[slice, slice]]:
    """Yield the times and orbits of each call of the kernel, whose results are contiguous."""
    rows = max(_SLICE // max(orbits, 1), 1)
    width = orbits if rows > 1 else min(_SLICE, orbits)
    for row in range(0, times, rows):
        for first in range(0, orbits, width or 1):
            yield slice(row, row + rows), slice(first, first + width)
