"""A run of the map, checked and flat, and the parts that it is computed in."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .arguments import Body
from .progress import Progress, reporter

# What a part costs at first, in steps of one trajectory of the 3D map: some 10 ms to 300 ms. Python
# looks for Ctrl-C between parts.
_PART = 2**27
# Parts that take less or more seconds than these are followed by longer or shorter ones.
_SHORT, _LONG = 0.05, 0.2
# What a saved state costs, in steps.
_SAVING = 8
# A part holds at least so many trajectories, if there are as many: enough for all threads ...
_ABREAST = 2**13
# ... and so many steps: entering a trajectory costs some 30.
_LENGTH = 2**8


@dataclass(frozen=True)
class Problem:
    """A run over a batch of B trajectories, from state `start` to state `stop`.

    Attributes
    ----------
    omega
        (B, D), the states at step 0.
    eps
        The step size, (B,) or (1,), as the body's `normalised_eps` gives it.
    every
        States whose number is a multiple of this are saved.
    saved
        (rows, B, D), filled by the run: the saved states from `start` on, state 0 included, state
        `start` > 0 not; no rows if only the last state is wanted.
    turns
        (rows, B, n, n), the orientations that go with them.
    orientation
        (B, n, n), the orientation at step 0, or None if it is not wanted.
    resume
        What the run up to `start` left to go on from, as `Outcome.resume`.
    keep
        Whether this run may be gone on with; else it leaves nothing in `Outcome.resume`.
    """

    body: Body
    method: str
    batch: tuple[int, ...]
    omega: FloatArray
    eps: FloatArray
    start: int
    stop: int
    every: int
    saved: FloatArray
    turns: FloatArray
    orientation: FloatArray | None = None
    resume: dict[str, NDArray[Any]] = field(default_factory=dict)
    keep: bool = True
    threads: int | None = None
    progress: Progress = None

    @property
    def size(self) -> int:
        """The number of trajectories."""
        return len(self.omega)

    @property
    def first_row(self) -> int:
        """The number of the saved state that the first row holds, in multiples of `every`."""
        return self.start // self.every + 1 if self.start else 0

    def parts(self, work: float, again: bool = True) -> Iterator[Part]:
        """What is computed at a time: some trajectories, and some of their steps.

        `work` is that of a step of one trajectory, in steps of the 3D map; where steps turn out to
        be cheaper or dearer, parts grow or shrink. The batch is cut first, so that what a part
        works on stays in the caches; time only where few trajectories take long. Where a run can
        not be taken up `again`, time is not cut.
        """
        if len(self.saved):
            work += _SAVING / self.every
        steps = max(self.stop - self.start, 1)
        room = _PART / work
        if self.size * steps <= room and not self.progress:
            yield Part(0, self.size, self.start, self.stop)
            return
        with reporter(self.progress, self.stop - self.start) as report:
            begin = 0
            while begin < self.size or begin == 0:
                end = min(begin + max(_ABREAST, int(room / steps)), self.size)
                start = stop = self.start
                while stop < self.stop or start == stop == self.start:
                    length = max(_LENGTH, int(room / max(end - begin, 1))) if again else steps
                    start, stop = stop, min(stop + length, self.stop)
                    clock = time.perf_counter()
                    yield Part(begin, end, start, stop)
                    seconds = time.perf_counter() - clock
                    if seconds < _SHORT:
                        room *= 2.0
                    elif seconds > _LONG:
                        room *= 0.5
                    done = begin * steps + (end - begin) * (stop - self.start)
                    report(done // max(self.size, 1) if stop > self.start else 0)
                    if stop == self.stop:
                        break
                begin = end
                if begin >= self.size:
                    break


class Part(NamedTuple):
    """Trajectories `begin` to `end`, from state `start` to state `stop`."""

    begin: int
    end: int
    start: int
    stop: int

    def work(self, lanes: int, step: float) -> int:
        """Lane-steps that threads can share: none within one block of lanes."""
        count = self.end - self.begin
        return int(count * (self.stop - self.start) * step) if count > lanes else 0


class Outcome(NamedTuple):
    """What a run leaves, beside the saved states.

    final         (B, D), state `stop`; NaN if it does not exist.
    status        (B,): see `codes`.
    failed_at     (B,), the number of the first state that does not exist, or -1.
    orientation   (B, n, n) at state `stop`, or None.
    resume        Arrays from which the run can be gone on with, by name; the batch is an axis.
    """

    final: FloatArray
    status: NDArray[np.int8]
    failed_at: NDArray[np.int64]
    orientation: FloatArray | None
    resume: dict[str, NDArray[Any]]
