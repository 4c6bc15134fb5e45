"""The engine of Dask: tiles are tasks, each of which writes its own part of the store."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from threading import Event
from typing import Any

from .._checks import FloatArray, instance
from .compute import Report, pieces, write
from .job import Job
from .starts import RandomStarts
from .store import open_arrays

# Number of times that Dask recomputes a tile after an error.
_RETRIES = 2
# Tiles queued per thread of a worker: no thread is idle, and few initial states are in memory.
_WAITING = 2


@contextmanager
def client_of(scheduler: Any) -> Iterator[Any]:
    """Yield a Dask client, passed as such or by the address of its scheduler; None for None."""
    if scheduler is None:
        yield None
        return
    from distributed import Client

    instance("scheduler", scheduler, (Client, str))
    if isinstance(scheduler, Client):
        yield scheduler
    else:
        with Client(scheduler, set_as_default=False) as client:
            yield client


def run(job: Job, client: Any, tiles: Sequence[int], report: Report, stop: Event) -> None:
    """Compute tiles on the workers; a stop request lets current tiles finish."""
    from distributed import as_completed

    def submit(tile: int) -> Any:
        part, starts = job.part(tile), None
        if not isinstance(job.source, RandomStarts):  # sent with the task
            part, starts = replace(part, source=None), job.starts(tile)
        return client.submit(_compute, part, tile, starts, pure=False, retries=_RETRIES)

    left = iter(tiles)
    abreast = _WAITING * max(1, sum(client.nthreads().values()))
    futures = as_completed([submit(each) for each in islice(left, abreast)], loop=client.loop)
    try:
        for future in futures:
            report(future.result(), job.steps)
            if not stop.is_set():
                for tile in islice(left, 1):
                    futures.add(submit(tile))
    except BaseException:
        client.cancel(list(futures.futures))
        raise


def _compute(part: Job, tile: int, starts: FloatArray | None) -> int:
    """Compute the missing pieces of a tile on one thread; return its index."""
    arrays = open_arrays(part)
    starts = part.starts(tile) if starts is None else starts
    for piece in pieces(part, tile, starts, arrays, 1):
        write(part, tile, piece, arrays)
    return tile
