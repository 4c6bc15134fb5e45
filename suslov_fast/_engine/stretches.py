"""The division of a run into stretches, between which Python handles Ctrl-C and reports progress.

A stretch takes 10 ms to 100 ms, and longer only where steps need elimination.
"""

from __future__ import annotations

from collections.abc import Iterator

import numba

from .execution import Problem, Span

# Work of a thread in a stretch, in steps of one trajectory of the 3D map.
_STRETCH = 2**26
# Least numbers of trajectories and of steps of a stretch, if there are as many, each divided by the
# work of a step: entering a trajectory costs tens of steps of the 3D map.
_ABREAST, _LENGTH = 2**13, 2**8
# Cost of saving a state, in steps of the 3D map.
_SAVING = 8

# Trajectories begin to end, from state start to state stop; the steps between saved states, and the
# number of those before.
Stretch = tuple[int, int, int, int, int, int]


def alike(size: int, most: int, lanes: int) -> int:
    """Return the length of parts of about equal length, at most `most`, in multiples of lanes.

    A short part at the end would leave threads idle.
    """
    parts = -(-size // most)
    return -(-size // (parts * lanes)) * lanes


def stretches_of(
    problem: Problem, span: Span, step: float, lanes: int
) -> Iterator[tuple[Stretch, int]]:
    """Yield the stretches to compute one after another, and the work of each for several threads.

    `step` is the cost of a step of one trajectory, in steps of the 3D map. A thread takes `lanes`
    trajectories at a time, in the time of all lanes; such a block is not worth a second thread. The
    batch is divided first, so that the data of a stretch stay in the caches; time is divided only
    if few trajectories take long.
    """
    size, count = len(problem.omega0), span.steps - span.start
    cost = step + (_SAVING / span.every if span.rows else 0.0)
    blocks = -(-size // lanes)
    width, length = blocks * lanes or 1, max(count, 1)
    if width * length * cost > _STRETCH:
        most = problem.threads or numba.config.NUMBA_NUM_THREADS
        of_stretch = min(blocks, most) * _STRETCH / cost
        abreast = max(lanes * most, int(_ABREAST / step), int(of_stretch / length))
        width = alike(width, abreast, lanes)
        length = max(int(_LENGTH / step), int(of_stretch / width), 1)
    for begin in range(0, size, width):
        end = min(begin + width, size)
        for start in range(span.start, max(span.steps, span.start + 1), length):
            stop = min(start + length, span.steps)
            work = (end - begin) * (stop - start) * step if end - begin > lanes else 0
            yield (begin, end, start, stop, span.every, span.rows_before), int(work)
            if problem.progress is not None:
                done = begin * count + (end - begin) * (stop - span.start)
                problem.progress(done // size)
