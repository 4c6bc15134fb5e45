"""Computing and writing a tile, piece by piece; the engine of this process.

A piece is a stretch of time of a tile. It is written in this order: states; results, with the last
piece; the record, from which the next piece starts; the mark. Each chunk is one object, which a
store replaces as a whole, so that all that a mark stands for is in the store, wherever a process is
killed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .._engine.layout import flat_matrices, flat_vectors
from .._engine.run import Results, Run, go_on
from .control import Stop
from .job import Job
from .plan import Index, piece_end, step_work
from .record import Values, packed, unpacked
from .reductions import REDUCTIONS
from .store import RECORD, STEPS_DONE, Arrays, place_of

# Called with the number of trajectory-steps made since the last call.
Report = Callable[[int], object]

# Duration of a piece in seconds, which bounds what a killed process loses, and the work of the
# first one, in trajectory-steps of the 3D map.
_DURATION, _FIRST = 20.0, 2**30


@dataclass(frozen=True)
class Piece:
    """A computed piece of a tile: steps `start` to `stop`, saved states in `rows`."""

    job: Job
    index: Index
    start: int
    stop: int
    rows: slice
    results: Results
    reduced: Values

    @property
    def steps(self) -> int:
        """Number of trajectory-steps."""
        return (self.stop - self.start) * int(self.results.status.size)


def pieces(
    job: Job, index: Index, starts: FloatArray, arrays: Arrays, threads: int | None
) -> Iterator[Piece]:
    """Compute what the store lacks of a tile.

    `job` is the part of the run that the tile covers, and `starts` are its initial states.
    """
    shape, D = job.plan.shape(index), job.body.dimension
    start, resume, reduced = _left(job, index, arrays)
    flat = np.array(flat_vectors(starts, shape))
    flat[np.isnan(flat).any(axis=-1)] = np.nan
    turned = None if job.orientation is None else flat_matrices(job.orientation, shape)
    most = int(_FIRST / max(math.prod(shape) * step_work(D), 1.0))
    stop = -1
    while stop < job.steps:
        stop = piece_end(start, job.steps, job.every, job.plan.rows, most)
        begin = time.perf_counter()
        run = Run(
            map=job.map,
            body=job.body,
            batch=shape,
            omega0=flat,
            eps=job.eps,
            steps=stop,
            save_every=job.every,
            method=job.method,
            orientation=turned,
            start=start,
            resume=resume,
            threads=threads,
        )
        results = go_on(run)
        names = {each.name for each in job.map.resume}
        resume = {name: array for name, array in results.resume.items() if name in names}
        for name in job.reductions if len(results.omega) else ():
            first = np.broadcast_to(starts, (*shape, D))
            values = REDUCTIONS[name].reduce(job.body, job.eps, results.omega, first)
            if name in reduced:
                values = REDUCTIONS[name].combine(reduced[name], values)
            reduced = {**reduced, name: values}
        # Where the closed form is evaluated steps cost nothing, and soon one piece has them all.
        speed = (stop - start) / max(time.perf_counter() - begin, 1e-3)
        rows = slice(run.rows_before, run.rows_before + len(results.omega))
        yield Piece(job, index, start, stop, rows, results, reduced)
        del results, run  # the next piece takes the same memory
        start, most = stop, int(speed * _DURATION)


def write(piece: Piece, arrays: Arrays) -> None:
    """Write a piece."""
    job, results, last = piece.job, piece.results, piece.stop == piece.job.steps
    where = job.plan.where(piece.index)
    if job.keeps_states and len(results.omega) and (job.save_every is not None or last):
        arrays["omega"][(piece.rows, *where)] = results.omega
        if results.attitude is not None:
            arrays["attitude"][(piece.rows, *where)] = results.attitude
    if last:
        ends = {name: getattr(results, name) for name in ("final", "status", "failed_at")}
        for name, values in {**ends, **piece.reduced}.items():
            arrays[name][where] = values
    arrays[RECORD][where] = packed(
        job, piece.stop, results.failed_at, results.resume, piece.reduced
    )
    arrays[STEPS_DONE][place_of(piece.index)] = piece.stop


def _left(job: Job, index: Index, arrays: Arrays) -> tuple[int, Values, Values]:
    """Return the step from which to go on with a tile, and what the steps before left."""
    mark = int(arrays[STEPS_DONE][index])
    if mark < 0:
        return 0, {}, {}
    steps, _, resume, reduced = unpacked(job, arrays[RECORD][job.plan.where(index)])
    # The mark may be older, as it is written last.
    return (steps, resume, reduced) if mark <= steps <= job.steps else (0, {}, {})


def is_whole(job: Job, index: Index, arrays: Arrays) -> bool:
    """Return True if a tile holds all that its mark stands for; `job` is the part it covers.

    States are NaN from `failed_at` on, and only there, so that other NaN are those of a chunk that
    is absent.
    """
    where = job.plan.where(index)
    try:
        mark = int(arrays[STEPS_DONE][index])
        if mark < 0:
            return True
        steps, failed_at, _, reduced = unpacked(job, arrays[RECORD][where])
        failed = failed_at >= 0
        same = steps == mark
        if mark == job.steps:
            for name, values in {"failed_at": failed_at, **reduced}.items():
                same &= np.asarray(arrays[name][where]).tobytes() == values.tobytes()
            same &= np.array_equal(arrays["status"][where] < 0, failed)
            same &= _is_nan_where(arrays["final"][where], failed)
        numbers = job.numbers[job.numbers <= mark] if job.keeps_states else ()
        for first in range(0, len(numbers), job.plan.rows):
            n = np.reshape(numbers[first : first + job.plan.rows], (-1, *(1,) * failed.ndim))
            rows = slice(first, first + len(n))
            same &= _is_nan_where(arrays["omega"][(rows, *where)], failed & (n >= failed_at))
            if job.orientation is not None:  # the first one is given
                gone = failed & (n >= np.maximum(failed_at, 1))
                same &= _is_nan_where(arrays["attitude"][(rows, *where)], gone)
    except (ValueError, RuntimeError, OSError):  # of checksums and codecs
        return False
    return bool(same)


def _is_nan_where(values: Any, expected: NDArray[np.bool_]) -> bool:
    found = np.isnan(values).reshape(*expected.shape, -1)
    return bool((found == expected[..., np.newaxis]).all())


def run(job: Job, arrays: Arrays, tiles: Sequence[Index], report: Report, stop: Stop) -> None:
    """Compute tiles with all threads, each piece while the one before is written."""

    def keep(piece: Piece) -> None:
        write(piece, arrays)
        report(piece.steps)

    with ThreadPoolExecutor(1, "suslov_fast writer") as writer:
        writing: Future[None] | None = None
        for index in tiles:
            where = job.plan.where(index)
            for piece in pieces(job.part(where), index, job.starts(where), arrays, None):
                if writing is not None:
                    writing.result()
                writing = writer.submit(keep, piece)
                del piece
                if stop.asked:
                    break
            if stop.asked:
                break
        if writing is not None:
            writing.result()
