"""A run as kernels see it: flat arrays, computed part by part."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .._kernels import codes
from .progress import Progress, reporter

# Work of the first part, in steps of one trajectory of the 3D map: some 10 ms to 300 ms. Python
# looks for Ctrl-C between parts.
_PART = 2**27
# Parts that take less or more seconds than these are followed by longer or shorter ones.
_SHORT, _LONG = 0.05, 0.2
# Work of saving a state, in steps.
_SAVING = 8
# Least numbers of trajectories and of steps of a part, if there are as many, each divided by the
# work of a step: entering a trajectory costs some 30 steps of the 3D map.
_ABREAST, _LENGTH = 2**13, 2**8
# A copy of an array takes less time than a new one that is filled.
_ONE_NOT_COMPUTED = np.full(1, codes.NOT_COMPUTED, np.int8)


@dataclass(slots=True)  # not frozen: that would take longer than a short run
class Problem:
    """A run over a batch of B trajectories, from state `start` to state `stop`.

    Attributes
    ----------
    omega
        (B, D), the states at step 0.
    parameters
        Parameters of the body and its eps, units taken out: each for all trajectories, or one for
        each.
    eps
        The step size in the unit of time of omega, (B,) or (1,); used with an orientation.
    every, keeps
        States whose number is a multiple of `every` are saved, if `keeps`; a run that keeps states
        has the same last one wherever it is cut.
    saved, turns
        (rows, B, D) and (rows, B, n, n), filled by the run: states and orientations from `start`
        on, state 0 included, state `start` > 0 not; no rows if only the last ones are wanted.
    orientation
        (B, n, n), the orientation at step 0, or None if it is not wanted.
    resume
        `Outcome.resume` of the run up to `start`.
    single
        True for a single step that nobody goes on from.
    """

    method: str
    omega: FloatArray
    parameters: list[FloatArray]
    eps: FloatArray
    start: int
    stop: int
    every: int
    keeps: bool
    saved: FloatArray
    turns: FloatArray
    orientation: FloatArray | None = None
    resume: dict[str, NDArray[Any]] = field(default_factory=dict)
    threads: int | None = None
    progress: Progress = None
    single: bool = False

    @property
    def size(self) -> int:
        """The number of trajectories."""
        return len(self.omega)

    @property
    def first_row(self) -> int:
        """The number of the first row of `saved`, in multiples of `every`."""
        return self.start // self.every + 1 if self.start else 0

    @property
    def saves_last(self) -> bool:
        """True if the last row of `saved` holds the last states."""
        return len(self.saved) > 0 and self.stop % self.every == 0

    def some(self, chosen: NDArray[np.intp], stop: int, saved: FloatArray) -> Problem:
        """Return the run of some of the trajectories from step 0 to `stop`."""

        def of(parameter: FloatArray) -> FloatArray:
            return parameter if len(parameter) == 1 else parameter[chosen]

        return replace(
            self,
            omega=self.omega[chosen],
            parameters=[of(each) for each in self.parameters],
            eps=of(self.eps),
            start=0,
            stop=stop,
            saved=saved,
            progress=None,
        )

    def parts(self, work: float, lanes: int) -> Iterable[Part]:
        """Return the parts to compute one after another: some trajectories and some of their steps.

        `work` is that of a step of one trajectory, in steps of the 3D map; a thread takes `lanes`
        trajectories at a time. The batch is cut first, so that what a part works on stays in the
        caches; time is only where few trajectories take long.
        """
        size, steps = len(self.omega), self.stop - self.start
        if len(self.saved):
            work += _SAVING / self.every
        room = _PART / work
        if (not self.progress and size * steps <= room) or not size * steps:
            return (Part(0, size, self.start, self.stop),)
        abreast = max(lanes * numba.config.NUMBA_NUM_THREADS, int(_ABREAST / work))
        return self._parts_of(room, lanes, abreast, max(1, int(_LENGTH / work)))

    def _parts_of(self, room: float, lanes: int, abreast: int, length: int) -> Iterator[Part]:
        """Yield parts of about `room` steps; where steps turn out cheap or dear, `room` adapts."""
        steps = self.stop - self.start
        with reporter(self.progress, steps) as report:
            end = 0
            while end < self.size:
                begin, left = end, self.size - end
                end += min(alike(left, max(abreast, int(room / steps)), lanes), left)
                stop = self.start
                while stop < self.stop:
                    start, stop = (
                        stop,
                        min(stop + max(length, int(room / (end - begin))), self.stop),
                    )
                    clock = time.perf_counter()
                    yield Part(begin, end, start, stop)
                    seconds = time.perf_counter() - clock
                    room *= 2.0 if seconds < _SHORT else 0.5 if seconds > _LONG else 1.0
                    report((begin * steps + (end - begin) * (stop - self.start)) // self.size)


def alike(size: int, most: int, lanes: int) -> int:
    """Return the length of parts of about the same length, at most `most`, in whole lanes.

    A short part at the end would leave threads idle.
    """
    parts = -(-size // most)
    return -(-size // (parts * lanes)) * lanes


class Part(NamedTuple):
    """Trajectories `begin` to `end`, from state `start` to state `stop`."""

    begin: int
    end: int
    start: int
    stop: int

    def work(self, lanes: int, step: float) -> int:
        """Return the lane-steps that threads can share: none within one block of lanes."""
        count = self.end - self.begin
        return int(count * (self.stop - self.start) * step) if count > lanes else 0


class Outcome(NamedTuple):
    """Results of a run, beside the saved states.

    Attributes
    ----------
    final
        (B, D), state `stop`; NaN if it does not exist.
    status, failed_at
        (B,), a code, and the number of the first state that does not exist, or -1.
    resume
        Arrays from which the run can be continued, by name.
    """

    final: FloatArray
    status: NDArray[np.int8]
    failed_at: NDArray[np.int64]
    resume: dict[str, NDArray[Any]]


def not_computed(size: int) -> NDArray[np.int8]:
    """Return statuses that a kernel is to fill."""
    return _ONE_NOT_COMPUTED.copy() if size == 1 else np.full(size, codes.NOT_COMPUTED, np.int8)


@lru_cache
def never(size: int) -> NDArray[np.int64]:
    """Return `failed_at` where nothing failed: -1, read-only and in no memory."""
    return np.ndarray((size,), np.int64, b"\xff" * 8, 0, (0,))


def worst(status: NDArray[np.int8]) -> int:
    """Return the least of statuses, negative if a trajectory failed; at most 0."""
    return min(status.item(), 0) if status.size == 1 else int(status.min(initial=0))


def check_computed(status: NDArray[np.int8]) -> bool:
    """Make sure that kernels filled all statuses; return True if a trajectory failed."""
    least = worst(status)
    if least == codes.NOT_COMPUTED:
        raise RuntimeError("a loop ended before its last trajectory; please report this")
    return least < 0
