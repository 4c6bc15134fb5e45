"""The engine of Dask: tiles are tasks, each of which writes its own part of the store."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from itertools import islice
from threading import Event
from typing import Any

from .._checks import FloatArray, instance
from .compute import Stored, pieces, write
from .job import Job
from .starts import RandomStarts
from .store import open_arrays

# Number of times that Dask recomputes a tile after an error.
_RETRIES = 2
# Tiles queued per thread of a worker: no thread is idle, and few initial states are in memory.
_WAITING = 2


def client_of(scheduler: Any) -> AbstractContextManager[Any]:
    """Return the context of a client, passed as such or by the address of its scheduler, or None.

    It closes only clients made here.
    """
    if scheduler is None:
        return nullcontext()
    from distributed import Client

    instance("scheduler", scheduler, (Client, str))
    if isinstance(scheduler, Client):
        return nullcontext(scheduler)
    made: AbstractContextManager[Any] = Client(scheduler, set_as_default=False)
    return made


def run(job: Job, client: Any, tiles: Sequence[int], stored: Stored, stop: Event) -> None:
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
            stored(future.result(), job.steps)
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
