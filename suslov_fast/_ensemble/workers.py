"""The engine of Dask: tiles are tasks, each of which writes its own part of the store."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from typing import Any

from .._checks import FloatArray
from .compute import Report, pieces, write
from .control import Stop
from .job import Job
from .plan import Index
from .starts import Kept
from .store import Arrays

# Times that Dask computes a tile anew after an error.
_RETRIES = 2
# Tiles that wait at each thread of a worker: none is idle, and few initial states are in memory.
_WAITING = 2


@contextmanager
def client_of(scheduler: Any) -> Iterator[Any]:
    """Return a Dask client, from itself or from the address of its scheduler."""
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


def run(job: Job, client: Any, tiles: Sequence[Index], report: Report, stop: Stop) -> None:
    """Compute tiles on the workers; a request to stop lets those in hand finish."""
    from distributed import as_completed

    def submit(index: Index) -> Any:
        return client.submit(_compute, *_sent(job, index), pure=False, retries=_RETRIES)

    left = iter(tiles)
    abreast = _WAITING * max(1, sum(client.nthreads().values()))
    futures = as_completed([submit(each) for each in islice(left, abreast)], loop=client.loop)
    try:
        for future in futures:
            report(future.result())
            if not stop.asked:
                for index in islice(left, 1):
                    futures.add(submit(index))
    except BaseException:
        client.cancel(list(futures.futures))
        raise


def _sent(job: Job, index: Index) -> tuple[Job, Index, FloatArray | None]:
    """Return the arguments of a task: starts that are in this process go along."""
    where = job.plan.where(index)
    part = job.part(where)
    if isinstance(job.source, Kept):
        return replace(part, source=None), index, job.starts(where)
    return part, index, None


def _compute(part: Job, index: Index, starts: FloatArray | None) -> int:
    """Compute what a tile lacks, on one thread; return the number of trajectory-steps."""
    arrays, steps = Arrays(part.store), 0
    if starts is None:
        starts = part.starts(part.plan.where(index))
    for piece in pieces(part, index, starts, arrays, 1):
        write(piece, arrays)
        steps += piece.steps
    return steps
