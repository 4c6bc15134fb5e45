"""The engine of many processes: tiles are Dask tasks, each of which writes its own part."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from typing import Any

from .._checks import FloatArray
from .job import Job
from .layout import Arrays
from .meter import Report
from .pieces import Tile, pieces, write
from .signals import Stop
from .starts import Kept

# A tile whose workers die more often than this, beside what Dask forgives, ends the run.
_DEATHS = 10
# Tiles that wait at each thread of a worker: none is idle, and starts of few are in memory.
_WAITING = 2


@contextmanager
def client_of(scheduler: Any) -> Iterator[Any]:
    """A Dask client, from itself or from an address."""
    from distributed import Client

    if isinstance(scheduler, Client):
        yield scheduler
    elif isinstance(scheduler, str):
        with Client(scheduler, set_as_default=False) as client:
            yield client
    else:
        raise TypeError(
            "scheduler: expected a distributed.Client or an address, "
            f"got {type(scheduler).__name__}"
        )


def run(
    job: Job,
    client: Any,
    tiles: Iterator[tuple[int, ...]],
    report: Report,
    stop: Stop,
) -> None:
    """Compute and write what the tiles lack; ends early, with all in hand written, if asked to."""
    from distributed import KilledWorker, as_completed

    deaths: dict[tuple[int, ...], int] = {}

    def submit(index: tuple[int, ...]) -> Any:
        future = client.submit(_compute, *_sent(job, index), pure=False)
        future.index = index
        return future

    abreast = _WAITING * max(1, sum(client.nthreads().values()))
    first = [submit(index) for index in islice(tiles, abreast)]
    futures = as_completed(first, loop=client.loop)
    try:
        for future in futures:
            try:
                report(*future.result())
            except KilledWorker:
                deaths[future.index] = deaths.get(future.index, 0) + 1
                if deaths[future.index] > _DEATHS:
                    raise
                futures.add(submit(future.index))
                continue
            if not stop.asked:
                for index in islice(tiles, 1):
                    futures.add(submit(index))
    except BaseException:
        client.cancel(list(futures.futures))
        raise


def _sent(job: Job, index: tuple[int, ...]) -> tuple[Job, tuple[int, ...], FloatArray | None]:
    """What a task is given: starts that are in this process go along, and others stay."""
    where = job.plan.where(index)
    part = job.of(where)
    if isinstance(job.source, Kept):
        return replace(part, source=None), index, job.starts(where)
    return part, index, None


def _compute(part: Job, index: tuple[int, ...], starts: FloatArray | None) -> tuple[int, int]:
    """The task: what a tile lacks, on one thread, whatever other tasks this worker has."""
    group = Arrays(part.store)
    where = part.plan.where(index)
    tile = Tile(part, index, where, part.starts(where) if starts is None else starts)
    steps, nbytes = 0, 0
    for piece in pieces(tile, group, 1):
        write(piece, group, "all")
        steps += math.prod(tile.shape) * (piece.segment.stop - piece.segment.start)
        nbytes += piece.nbytes
    return steps, nbytes
