"""Computing and writing a tile, piece by piece; the engine of this process.

A piece is a stretch of time of a tile. It is written in this order: states; results, with the last
piece; the record, from which the next piece starts; the mark. Each chunk is one object, which a
store replaces as a whole, so that all that a mark stands for is in the store, wherever a process is
killed.
"""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from threading import Event
from types import FrameType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .._engine.layout import flat_matrices, flat_vectors
from .._engine.run import Results, Run, go_on
from .job import Index, Job, step_work
from .reductions import REDUCTIONS
from .store import MARKS, RECORDS, Arrays

# Called with the number of trajectory-steps made since the last call.
Report = Callable[[int], object]
Values = dict[str, NDArray[Any]]

# Duration of a piece in seconds, which bounds what a killed process loses, and the work of the
# first one, in trajectory-steps of the 3D map.
_DURATION, _FIRST = 20.0, 2**30


class Piece(NamedTuple):
    """A stretch of time of a tile, which ends at step `stop`.

    `steps` is the number of its trajectory-steps, and `rows` are those of its saved states.
    """

    stop: int
    steps: int
    rows: slice
    results: Results
    reduced: Values


def pieces(
    job: Job, index: Index, starts: FloatArray, arrays: Arrays, threads: int | None
) -> Iterator[Piece]:
    """Compute what the store lacks of a tile.

    `job` is the part of the run that the tile covers, and `starts` are its initial states.
    """
    shape, D, every = job.shape(index), job.body.dimension, job.every
    start, resume, reduced = _left(job, index, arrays)
    flat = np.array(flat_vectors(starts, shape))
    flat[np.isnan(flat).any(axis=-1)] = np.nan
    turned = None if job.orientation is None else flat_matrices(job.orientation, shape)
    most = int(_FIRST / (math.prod(shape) * step_work(D)))
    stop = -1
    while stop < job.steps:
        stop = min(job.steps, start + max(most, 1))
        if every is not None:  # the states of a piece fill one chunk at most
            row = start // every + 1 if start else 0
            stop = min(stop, max((row // job.rows + 1) * job.rows * every - every, start + 1))
        begin = time.perf_counter()
        run = Run(
            map=job.map,
            body=job.body,
            batch=shape,
            omega0=flat,
            eps=job.eps,
            steps=stop,
            save_every=every,
            method=job.method,
            orientation=turned,
            start=start,
            resume=resume,
            threads=threads,
        )
        results = go_on(run)
        resume = results.resume
        for name in job.reductions if len(results.omega) else ():
            first = np.broadcast_to(starts, (*shape, D))
            values = REDUCTIONS[name].reduce(job.body, job.eps, results.omega, first)
            if name in reduced:
                values = REDUCTIONS[name].combine(reduced[name], values)
            reduced = {**reduced, name: values}
        # Where the closed form is evaluated steps cost nothing, and soon one piece has them all.
        speed = (stop - start) / max(time.perf_counter() - begin, 1e-3)
        rows = slice(run.rows_before, run.rows_before + len(results.omega))
        yield Piece(stop, (stop - start) * math.prod(shape), rows, results, reduced)
        del results, run  # the next piece takes the same memory
        start, most = stop, int(speed * _DURATION)


def write(job: Job, index: Index, piece: Piece, arrays: Arrays) -> None:
    """Write a piece of a tile."""
    where, results, last = job.where(index), piece.results, piece.stop == job.steps
    if job.keeps_states and len(results.omega) and (job.save_every is not None or last):
        arrays["omega"][(piece.rows, *where)] = results.omega
        if results.attitude is not None:
            arrays["attitude"][(piece.rows, *where)] = results.attitude
    if last:
        ends = {name: getattr(results, name) for name in ("final", "status", "failed_at")}
        for name, values in {**ends, **piece.reduced}.items():
            arrays[name][where] = values
    records = np.zeros(results.status.shape, job.record)
    records["steps"], records["failed_at"] = piece.stop, results.failed_at
    for part, values in (("resume", results.resume), ("reduced", piece.reduced)):
        for name in records[part].dtype.names or ():
            if name in values:
                records[part][name] = values[name].reshape(records[part][name].shape)
    arrays[RECORDS][where] = records[..., np.newaxis].view(np.uint8)
    arrays[MARKS][index] = piece.stop


def _records(job: Job, index: Index, arrays: Arrays) -> Any:
    return np.ascontiguousarray(arrays[RECORDS][job.where(index)]).view(job.record)[..., 0]


def _left(job: Job, index: Index, arrays: Arrays) -> tuple[int, Values, Values]:
    """Return the step from which to go on with a tile, and what the steps before left."""
    mark = int(arrays[MARKS][index])
    if mark < 0:
        return 0, {}, {}
    records = _records(job, index, arrays)
    steps = int(records["steps"].flat[0])
    if not mark <= steps <= job.steps:  # the mark may be older, as it is written last
        return 0, {}, {}
    flat = records.reshape(-1)["resume"]
    resume = {name: flat[name].copy() for name in flat.dtype.names or ()}
    return steps, resume, {name: records["reduced"][name].copy() for name in job.reductions}


def is_whole(job: Job, index: Index, arrays: Arrays) -> bool:
    """Return True if a tile holds all that its mark stands for; `job` is the part it covers.

    States are NaN from `failed_at` on, and only there, so that other NaN are those of a chunk that
    is absent.
    """
    where = job.where(index)
    try:
        mark = int(arrays[MARKS][index])
        if mark < 0:
            return True
        records = _records(job, index, arrays)
        failed_at = records["failed_at"]
        failed = failed_at >= 0
        same = bool((records["steps"] == mark).all())
        if mark == job.steps:
            expected = {name: records["reduced"][name] for name in job.reductions}
            for name, values in {"failed_at": failed_at, **expected}.items():
                same &= np.asarray(arrays[name][where]).tobytes() == values.tobytes()
            same &= np.array_equal(np.asarray(arrays["status"][where]) < 0, failed)
            same &= _is_nan_where(arrays["final"][where], failed)
        numbers = job.numbers[job.numbers <= mark] if job.keeps_states else ()
        for first in range(0, len(numbers), job.rows):
            n = np.reshape(numbers[first : first + job.rows], (-1, *(1,) * failed.ndim))
            rows = slice(first, first + len(n))
            gone = failed & (n >= failed_at)
            for name in ("omega", "attitude")[: 1 + (job.orientation is not None)]:
                same &= _is_nan_where(arrays[name][(rows, *where)], gone)
    except (ValueError, RuntimeError, OSError):  # of checksums and codecs
        return False
    return same


def _is_nan_where(values: Any, expected: NDArray[np.bool_]) -> bool:
    found = np.isnan(values).reshape(*expected.shape, -1)
    return bool((found == expected[..., np.newaxis]).all())


@contextmanager
def stopping() -> Iterator[Event]:
    """Turn the first SIGINT or SIGTERM into a request to stop, if this is the main thread."""
    stop, before = Event(), {}

    def ask(number: int, frame: FrameType | None) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            before[number] = signal.signal(number, ask)
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def run(job: Job, arrays: Arrays, tiles: Sequence[Index], report: Report, stop: Event) -> None:
    """Compute tiles with all threads, each piece while the one before is written."""

    def keep(index: Index, piece: Piece) -> None:
        write(job, index, piece, arrays)
        report(piece.steps)

    work = (
        (index, piece)
        for index in tiles
        for piece in pieces(job.part(index), index, job.starts(index), arrays, None)
    )
    with ThreadPoolExecutor(1, "suslov_fast writer") as writer:
        writing: Future[None] | None = None
        for index, piece in work:
            if writing is not None:
                writing.result()
            writing = writer.submit(keep, index, piece)
            del piece
            if stop.is_set():
                break
        if writing is not None:
            writing.result()
