"""Computing and writing a tile, piece by piece; the engine of this process.

A piece is a stretch of time of a tile. It is written in this order: states; results, with the last
piece; the record, from which the next piece starts; the mark. Each chunk is one object, which a
store replaces as a whole, so that all that a mark stands for is in the store, wherever a process is
killed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .._engine.layout import flat_matrices, flat_vectors
from .._engine.run import Results, Run, go_on
from .control import Report, Stop
from .job import Job
from .plan import piece_end, step_work
from .reductions import REDUCTIONS
from .store import RECORD, STEPS_DONE, Arrays, place_of

Index = tuple[int, ...]
Values = dict[str, NDArray[Any]]

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
        return (self.stop - self.start) * self.job.plan.size(self.index)

    @property
    def nbytes(self) -> int:
        """Size of its states."""
        arrays = (self.results.omega, self.results.attitude)
        return sum(array.nbytes for array in arrays if array is not None)


def pieces(
    job: Job, index: Index, starts: FloatArray, arrays: Arrays, threads: int | None
) -> Iterator[Piece]:
    """Compute what the store lacks of a tile.

    `job` is the part of the run that the tile covers, and `starts` are its initial states.
    """
    shape = tuple(part.stop - part.start for part in job.plan.where(index))
    mark = int(arrays[STEPS_DONE][index])
    start, resume, reduced = _left(job, index, arrays, mark)
    if mark == start == job.steps:
        return
    flat = np.array(flat_vectors(starts, shape))
    flat[np.isnan(flat).any(axis=-1)] = np.nan
    turned = None if job.orientation is None else flat_matrices(job.orientation, shape)
    most = int(_FIRST / max(math.prod(shape) * step_work(job.body.dimension), 1.0))
    while True:
        stop = piece_end(start, job.steps, job.every, job.plan.rows, most)
        begin = time.perf_counter()
        run = Run(
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
        resume = {name: results.resume[name] for name in _kept(job) if name in results.resume}
        reduced = _accumulated(job, starts, shape, results, reduced)
        rows = slice(run.rows_before, run.rows_before + len(results.omega))
        # Where the closed form is evaluated steps cost nothing, and soon one piece has them all.
        speed = (stop - start) / max(time.perf_counter() - begin, 1e-3)
        yield Piece(job, index, start, stop, rows, results, reduced)
        if stop == job.steps:
            return
        del results, run  # the next piece takes the same memory
        start, most = stop, int(speed * _DURATION)


def _accumulated(
    job: Job, starts: FloatArray, shape: tuple[int, ...], results: Results, before: Values
) -> Values:
    if not (job.reductions and len(results.omega)):
        return before
    first = np.broadcast_to(starts, (*shape, job.body.dimension))
    values = {}
    for name in job.reductions:
        reduction = REDUCTIONS[name]
        values[name] = reduction.reduce(job.body, results.omega, job.eps, first)
        if before:
            values[name] = reduction.combine(before[name], values[name])
    return values


def write(piece: Piece, arrays: Arrays) -> None:
    """Write a piece."""
    job, results, stop = piece.job, piece.results, piece.stop
    where, last = job.plan.where(piece.index), piece.stop == piece.job.steps
    if job.keeps_states and len(results.omega) and (job.save_every is not None or last):
        arrays["omega"][(piece.rows, *where)] = results.omega
        if results.attitude is not None:
            arrays["attitude"][(piece.rows, *where)] = results.attitude
    if last:
        for name, values in _ends(piece).items():
            arrays[name][where] = values
    arrays[RECORD][where] = _record(piece)
    arrays[STEPS_DONE][place_of(piece.index)] = np.full((1,) * len(piece.index), stop)


def _ends(piece: Piece) -> Values:
    results = piece.results
    ends = {"final": results.final, "status": results.status, "failed_at": results.failed_at}
    return {**ends, **piece.reduced}


# The record: for each trajectory, 64-bit words of the number of steps, `failed_at`, the arrays that
# the map needs to go on, and the reductions so far.


def _kept(job: Job) -> dict[str, tuple[tuple[str | int, ...], str]]:
    """Axes and type of the arrays that a map needs to go on; "B" are the trajectories."""
    from .._bodies.three import Suslov3D

    turned, n = job.orientation is not None, job.body.dimension + 1
    if isinstance(job.body, Suslov3D):
        return {"state": ((2, "B"), "f8"), "turn": ((4, "B" if turned else 0), "f8")}
    return {
        "state": (("B", n - 1), "f8"),
        "exponent": (("B",), "f8"),
        "status": (("B",), "i1"),
        "failed_at": (("B",), "i8"),
        **({"columns": (("B", n, n), "f8")} if turned else {}),
    }


def _words(job: Job) -> Iterator[tuple[str, slice, tuple[str | int, ...], str]]:
    """Name, place in the record, axes and type of each array."""
    at = 2
    for name, (dims, dtype) in _kept(job).items():
        count = math.prod(length for length in dims if isinstance(length, int))
        yield name, slice(at, at := at + count), dims, dtype
    for name in job.reductions:
        own: tuple[int, ...] = (job.body.dimension,) if REDUCTIONS[name].of_components else ()
        yield f"reduced {name}", slice(at, at := at + math.prod(own)), ("B", *own), "f8"


def record_size(job: Job) -> int:
    """Return the number of words for each trajectory."""
    return max((place.stop for _, place, _, _ in _words(job)), default=2)


def _record(piece: Piece) -> NDArray[np.int64]:
    job, failed_at = piece.job, piece.results.failed_at
    values = {**piece.results.resume, **{f"reduced {k}": v for k, v in piece.reduced.items()}}
    record = np.zeros((failed_at.size, record_size(job)), np.int64)
    record[:, 0], record[:, 1] = piece.stop, failed_at.reshape(-1)
    for name, place, dims, dtype in _words(job):
        if name in values and "B" in dims:
            array = np.asarray(values[name], dtype)
            if name.startswith("reduced "):
                array = array.reshape(failed_at.size, *dims[1:])
            words = np.moveaxis(array, dims.index("B"), 0).reshape(failed_at.size, -1)
            wide = np.ascontiguousarray(words, "f8" if dtype == "f8" else "i8")
            record[:, place] = wide.view(np.int64)
    return record.reshape(*failed_at.shape, -1)


def read_record(job: Job, index: Index, arrays: Arrays) -> tuple[int, FloatArray, Values, Values]:
    """Return steps, `failed_at`, the arrays to go on from, and the reductions of a tile."""
    record = np.asarray(arrays[RECORD][job.plan.where(index)])
    batch, words = record.shape[:-1], record.reshape(-1, record.shape[-1])
    resume, reduced = {}, {}
    for name, place, dims, dtype in _words(job):
        own = [length for length in dims if isinstance(length, int)]
        if "B" not in dims:  # an array that this run does not need
            resume[name] = np.empty(own)
            continue
        values = np.ascontiguousarray(words[:, place]).reshape(len(words), *own)
        values = values.view("f8") if dtype == "f8" else values.astype(dtype)
        if name.startswith("reduced "):
            reduced[name.removeprefix("reduced ")] = values.reshape(*batch, *own)
        else:
            resume[name] = np.ascontiguousarray(np.moveaxis(values, 0, dims.index("B")))
    steps = int(words[0, 0]) if len(words) else job.steps
    return steps, record[..., 1], resume, reduced


def _left(job: Job, index: Index, arrays: Arrays, mark: int) -> tuple[int, Values, Values]:
    """Return the step from which to go on with a tile, and the record of it."""
    if mark < 0:
        return 0, {}, {}
    steps, _, resume, reduced = read_record(job, index, arrays)
    # The mark may be older: it is written last.
    return (steps, resume, reduced) if mark <= steps <= job.steps else (0, {}, {})


def is_whole(job: Job, index: Index, arrays: Arrays) -> bool:
    """Return True if a tile holds all that its mark stands for.

    A missing chunk reads as NaN. States are NaN from `failed_at` on, and there only.
    """
    where = job.plan.where(index)
    try:
        mark = int(arrays[STEPS_DONE][index])
        if mark < 0:
            return True
        steps, failed_at, _, reduced = read_record(job, index, arrays)
        if steps != mark:
            return False
        if mark == job.steps:
            ends = {"failed_at": failed_at, **reduced}
            if any(not _equal(arrays[name][where], ends[name]) for name in ends):
                return False
            status, final = arrays["status"][where], arrays["final"][where]
            if not _equal(status < 0, failed_at >= 0) or not _nan_where(final, failed_at >= 0):
                return False
        if not job.keeps_states or (job.save_every is None and mark < job.steps):
            return True
        numbers = job.numbers[job.numbers <= mark]
        for first in range(0, len(numbers), job.plan.rows):
            n = numbers[first : first + job.plan.rows].reshape(-1, *(1,) * len(where))
            gone = (failed_at >= 0) & (n >= failed_at)
            rows = slice(first, first + len(n))
            for name in ("omega", "attitude"):
                if name in arrays and not _nan_where(arrays[name][(rows, *where)], gone):
                    return False
    except (ValueError, RuntimeError, OSError, IndexError):  # checksums, codecs, cut files
        return False
    return True


def _nan_where(values: Any, expected: NDArray[np.bool_]) -> bool:
    found = np.isnan(values).reshape(*expected.shape, -1)
    return bool((found == expected[..., np.newaxis]).all())


def _equal(one: Any, other: Any) -> bool:
    return np.asarray(one).tobytes() == np.asarray(other).tobytes()


def run(job: Job, arrays: Arrays, tiles: Sequence[Index], report: Report, stop: Stop) -> None:
    """Compute tiles with all threads, each piece while the one before is written."""

    def keep(piece: Piece) -> None:
        write(piece, arrays)
        report(piece.steps, piece.nbytes)

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
