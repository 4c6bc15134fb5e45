"""Computing and writing tiles, piece by piece, in this process or on the workers of Dask.

A piece is a range of steps of a tile. It is written in this order: states; results, with the last
piece; the record, from which the next piece starts. Each chunk is one object, which a store
replaces as a whole, so that all data before a record are in the store, even if the process is
killed.
"""

from __future__ import annotations

import math
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from itertools import count, islice
from logging import getLogger
from threading import Event
from types import FrameType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray, instance, wrong
from .._engine.arguments import States
from .._engine.execution import execute
from .._engine.problem import Output, Span, problem_of
from .._engine.progress import Progress, reporter
from .._engine.random_starts import RandomStarts
from .job import Job, step_work
from .reductions import monitored, reductions_of
from .store import MARKS, RECORDS, Arrays, advice, open_arrays, withdraw

# Called with a tile and the number of its stored steps.
Stored = Callable[[int, int], object]
ByName = dict[str, NDArray[Any]]
Piece = tuple[Span, Output, ByName]

# Duration of a piece in seconds, which limits the wait after Ctrl-C, and the work of the
# first one, in trajectory-steps of the 3D map.
_DURATION, _FIRST = 0.5, 2**26
# Number of times that Dask recomputes a tile after an error, and tiles queued per thread of a
# worker: no thread is idle, and few initial states are in memory.
_RETRIES, _WAITING = 2, 2
# Seconds for an attempt to reach a scheduler, and until the next one.
_ATTEMPT, _PAUSE = 2.0, 0.05


def compute_tiles(job: Job, client: Any, verify: bool, progress: Progress) -> None:
    """Compute the unfinished tiles of a store; with `verify`, all that are damaged or missing."""
    arrays, tiles = open_arrays(job), range(math.prod(job.grid))
    marks = arrays[MARKS]
    if verify:
        done = np.full(len(tiles), -1)
        marks[...] = done
    else:
        done = np.asarray(marks[...])
    for tile in tiles:
        if verify:
            done[tile] = _steps_stored(job.part(tile), tile, arrays)
            if done[tile] == job.steps:
                marks[tile] = job.steps
        if done[tile] != job.steps and (verify or done[tile] >= 0):  # damaged, or of a shorter run
            withdraw(job, arrays, tile, done[tile] < 0)
    unfinished = np.flatnonzero(done != job.steps).tolist()
    if not unfinished:
        return
    done = np.maximum(done, 0)
    made = sum(math.prod(job.shape(tile)) * int(done[tile]) for tile in tiles)
    with _stopping() as stop, reporter(progress, math.prod(job.batch) * job.steps) as show:

        def stored(tile: int, steps: int) -> None:
            nonlocal made
            made += math.prod(job.shape(tile)) * (steps - int(done[tile]))
            done[tile] = steps
            if steps == job.steps:
                marks[tile] = steps
            show(made)

        show(made)
        if client is None:
            _run_here(job, arrays, unfinished, stored, stop)
        else:
            _run_on_workers(job, client, unfinished, stored, stop)
    if left := np.count_nonzero(done != job.steps):
        raise KeyboardInterrupt(
            f"stopped with {len(tiles) - left} of {len(tiles)} tiles in {job.store} finished; "
            "repeat the call to resume"
        )


def _pieces(
    job: Job, tile: int, starts: FloatArray, arrays: Arrays, threads: int | None
) -> Iterator[Piece]:
    """Compute the missing pieces of a tile; `job` is the part of the run in it."""
    shape, D, every = job.shape(tile), job.body.dimension, job.every
    start, resume, reduced = _resume_point(job, tile, arrays)
    omega0 = np.where(np.isnan(starts).any(axis=-1, keepdims=True), np.nan, starts)
    states = States(job.body, omega0, job.eps, shape, threads, orientation=job.orientation)
    problem = problem_of(job.map, states, job.method)
    omega0 = problem.omega0.reshape(*shape, D)
    known = reductions_of(job.map)
    most = int(_FIRST / (math.prod(shape) * step_work(D)))
    stop = -1
    while stop < job.steps:
        stop = min(job.steps, start + max(most, 1))
        if every is not None:  # the states of a piece fill one chunk at most
            row = start // every + 1 if start else 0
            stop = min(stop, max((row // job.rows + 1) * job.rows * every - every, start + 1))
        span = Span(stop, every, start, resume)
        begin = time.perf_counter()
        output = execute(problem, span)
        # With the closed form steps are free, and one piece soon contains them all.
        speed = (stop - start) / max(time.perf_counter() - begin, 1e-3)
        most, resume = int(speed * _DURATION), output.resume
        if len(output.saved):
            reduced = {
                name: known[name].extreme(
                    reduced.get(name, np.array(np.nan)),
                    known[name].reduce(job.body, job.eps, output.saved, omega0),
                )
                for name in job.reductions
            }
        yield span, output, reduced
        del output  # the next piece takes the same memory
        start = stop


def _write_piece(job: Job, tile: int, piece: Piece, arrays: Arrays) -> None:
    span, output, reduced = piece
    where, last = job.where(tile), span.steps == job.steps
    rows = slice(span.rows_before, span.rows_before + len(output.saved))
    if len(output.saved) and (job.save_every is not None or last):
        states = {job.map.variable: output.saved, "attitude": output.turns}
        for name, function in job.monitors.items():
            states[name] = monitored(name, function, output.saved)
        for name in job.states:
            arrays[name][(rows, *where)] = states[name]
    if last:
        for name in job.results:
            arrays[name][where] = reduced[name] if name in reduced else getattr(output, name)
    records = np.zeros(output.status.shape, job.record)
    records["steps"] = span.steps
    for name, values in {**output.resume, **reduced}.items():
        if name in records.dtype.names:
            records[name] = values.reshape(records[name].shape)
    arrays[RECORDS][where] = records[..., np.newaxis].view(np.uint8)


def _records(job: Job, tile: int, arrays: Arrays) -> Any:
    return np.ascontiguousarray(arrays[RECORDS][job.where(tile)]).view(job.record)[..., 0]


def _resume_point(job: Job, tile: int, arrays: Arrays) -> tuple[int, ByName, ByName]:
    """Return the step from which to resume a tile, and the data of earlier steps."""
    with advice(job.store):
        records = _records(job, tile, arrays)
    flat = records.reshape(-1)
    # A complete tile whose mark is missing is computed anew: a piece without saved states would
    # evaluate the last state in another way, with other last digits.
    if not 0 <= (steps := int(flat["steps"][0])) < job.steps:
        return 0, {}, {}
    names = [name for name in flat.dtype.names if name not in ("steps", *job.reductions)]
    reduced = {name: records[name].copy() for name in job.reductions}
    return steps, {name: flat[name].copy() for name in names}, reduced


def _steps_stored(job: Job, tile: int, arrays: Arrays) -> int:
    """Return the number of steps of a tile stored undamaged: the end of a piece, or -1.

    `job` is the part of the run in the tile. States are NaN only from `failed_at` on; other NaN
    are those of absent chunks.
    """
    where = job.where(tile)
    try:
        records = _records(job, tile, arrays)
        steps, failed_at = int(records["steps"].flat[0]), records["failed_at"]
        failed = failed_at >= 0
        whole = bool((records["steps"] == steps).all())
        if steps == job.steps:
            whole &= np.array_equal(np.isnan(arrays["final"][where]).any(axis=-1), failed)
            for name in job.results[1:]:
                whole &= np.asarray(arrays[name][where]).tobytes() == records[name].tobytes()
        numbers = job.numbers[job.numbers <= steps] if job.states else ()
        for first in range(0, len(numbers), job.rows):
            n = np.reshape(numbers[first : first + job.rows], (-1, *(1,) * failed.ndim))
            rows = slice(first, first + len(n))
            for name in job.states:
                values = arrays[name][(rows, *where)]
                if name in job.monitors:  # whose values may be NaN at states that are not
                    states = np.asarray(arrays[job.map.variable][(rows, *where)])
                    known = np.isnan(monitored(name, job.monitors[name], states))
                    whole &= np.array_equal(np.isnan(values), known)
                    continue
                absent = np.isnan(values).reshape(len(n), *failed.shape, -1).any(axis=-1)
                whole &= np.array_equal(absent, failed & (n >= failed_at))
    except (ValueError, RuntimeError, OSError):  # of checksums and codecs
        return -1
    return steps if whole else -1


@contextmanager
def _stopping() -> Iterator[Event]:
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


def _run_here(job: Job, arrays: Arrays, tiles: Sequence[int], stored: Stored, stop: Event) -> None:
    """Compute tiles with all threads, each piece while the previous one is written."""

    def keep(tile: int, piece: Piece) -> None:
        _write_piece(job, tile, piece, arrays)
        stored(tile, piece[0].steps)

    work = (
        (tile, piece)
        for tile in tiles
        for piece in _pieces(job.part(tile), tile, job.starts(tile), arrays, None)
    )
    with ThreadPoolExecutor(1, "suslov_fast writer") as writer:
        writing: Future[Any] = writer.submit(int)  # nothing to wait for
        for tile, piece in work:
            writing.result()
            writing = writer.submit(keep, tile, piece)
            del piece
            if stop.is_set():
                break
        writing.result()


def client_of(scheduler: Any) -> AbstractContextManager[Any]:
    """Return the context of a client or of None; a client made here, by an address, is closed."""
    if scheduler is None:
        return nullcontext()
    from distributed import Client

    instance("scheduler", scheduler, (Client, str))
    if not isinstance(scheduler, str):
        return nullcontext(scheduler)
    _wait_for(scheduler)
    made: AbstractContextManager[Any] = Client(scheduler, set_as_default=False)
    return made


def _wait_for(address: str) -> None:
    """Return when something answers at an address; OSError after the time that Dask allows.

    `Client` would wait in a thread that Ctrl-C does not end.
    """
    import dask
    from dask.utils import parse_timedelta
    from distributed.comm.addressing import parse_address, parse_host_port

    protocol, location = parse_address(address)
    if protocol not in ("tcp", "tls"):
        return
    try:
        place = parse_host_port(location)
    except ValueError as error:
        expected = "an address such as tcp://127.0.0.1:8786"
        raise wrong("scheduler", expected, repr(address)) from error
    seconds = parse_timedelta(dask.config.get("distributed.comm.timeouts.connect", "30s"))
    begin = time.monotonic()
    for attempt in count():
        try:
            socket.create_connection(place, _ATTEMPT).close()
            return
        except OSError as error:
            if time.monotonic() > begin + seconds:
                received = f"none within {seconds:g} s"
                raise wrong(
                    "scheduler", f"a Dask scheduler at {address}", received, OSError
                ) from error
            if attempt == 0:
                getLogger("suslov_fast").warning("waiting for the scheduler %s", address)
            time.sleep(_PAUSE)


def _run_on_workers(
    job: Job, client: Any, tiles: Sequence[int], stored: Stored, stop: Event
) -> None:
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
    for piece in _pieces(part, tile, starts, arrays, 1):
        _write_piece(part, tile, piece, arrays)
    return tile
