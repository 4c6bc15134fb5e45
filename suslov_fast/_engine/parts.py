"""The division of a run into parts of about a tenth of a second, between which Python handles
Ctrl-C and reports progress.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numba

# Work of the first part, in steps of one trajectory of the 3D map: some 10 ms to 300 ms.
_PART = 2**27
# The next part is longer if a part took less than the first time (in seconds), and shorter if it
# took more than the second.
_SHORT, _LONG = 0.05, 0.2
# Least numbers of trajectories and of steps of a part, if there are as many, each divided by the
# work of a step: entering a trajectory costs some 30 steps of the 3D map.
_ABREAST, _LENGTH = 2**13, 2**8

Report = Callable[[int], object]


class Part(NamedTuple):
    """Trajectories `begin` to `end`, from state `start` to state `stop`."""

    begin: int
    end: int
    start: int
    stop: int

    def work(self, lanes: int, step: float) -> int:
        """Return the lane-steps that can run in parallel: none within one block of lanes."""
        count = self.end - self.begin
        return int(count * (self.stop - self.start) * step) if count > lanes else 0


def alike(size: int, most: int, lanes: int) -> int:
    """Return the length of parts of about equal length, at most `most`, in multiples of lanes.

    A short part at the end would leave threads idle.
    """
    parts = -(-size // most)
    return -(-size // (parts * lanes)) * lanes


def parts_of(
    size: int, start: int, steps: int, work: float, lanes: int, report: Report | None
) -> Iterable[Part]:
    """Return the parts to compute one after another: some trajectories and some of their steps.

    `work` is the cost of a step of one trajectory, in steps of the 3D map; a thread takes `lanes`
    trajectories at a time. The batch is divided first, so that the data of a part stay in the
    caches; time is divided only if few trajectories take long. `report` takes a number of steps.
    """
    room, count = _PART / work, steps - start
    if (report is None and size * count <= room) or not size * count:
        return (Part(0, size, start, steps),)
    abreast = max(lanes * numba.config.NUMBA_NUM_THREADS, int(_ABREAST / work))
    length = max(1, int(_LENGTH / work))
    return _parts(size, start, steps, room, lanes, abreast, length, report)


def _parts(
    size: int,
    first: int,
    steps: int,
    room: float,
    lanes: int,
    abreast: int,
    length: int,
    report: Report | None,
) -> Iterator[Part]:
    """Yield parts of about `room` steps; `room` adapts to the measured time of a part."""
    end, count = 0, steps - first
    while end < size:
        begin = end
        end += min(alike(size - end, max(abreast, int(room / count)), lanes), size - end)
        stop = first
        while stop < steps:
            start = stop
            stop = min(stop + max(length, int(room / (end - begin))), steps)
            clock = time.perf_counter()
            yield Part(begin, end, start, stop)
            seconds = time.perf_counter() - clock
            room *= 2.0 if seconds < _SHORT else 0.5 if seconds > _LONG else 1.0
            if report is not None:
                report((begin * count + (end - begin) * (stop - first)) // size)
