"""What is computed between two marks of a tile, and how it gets into the store."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._checks import FloatArray
from .._engine.layout import flat_matrices, flat_vectors
from .._engine.run import Results, Run, go_on
from .chunks import Settled, put
from .job import Job
from .layout import RESUME, STEPS_DONE, Arrays, packed, unpacked
from .plan import Segment, segments
from .reductions import REDUCTIONS, reduced
from .starts import Slices

_BEGUN_WITH = ("omega0", "R0")
# Bytes of a .npz beside those of its arrays, for each and at all.
_ENTRY, _ARCHIVE = 512, 1024


@dataclass(frozen=True)
class Tile:
    """A part of the batch.

    Attributes
    ----------
    job
        The run, with the parameters of this part alone.
    starts
        (..., D), its initial states.
    """

    job: Job
    index: tuple[int, ...]
    where: Slices
    starts: FloatArray

    @classmethod
    def of(cls, job: Job, index: tuple[int, ...]) -> Tile:
        """A tile of a run."""
        where = job.plan.where(index)
        return cls(job.of(where), index, where, job.starts(where))

    @property
    def shape(self) -> tuple[int, ...]:
        """That of its batch."""
        return tuple(each.stop - each.start for each in self.where)


@dataclass(frozen=True)
class Piece:
    """A segment that is computed, with the states that it kept in `rows`."""

    tile: Tile
    segment: Segment
    rows: slice
    results: Results
    reduced: dict[str, FloatArray]

    @property
    def nbytes(self) -> int:
        """What it writes, but for what goes on from it."""
        arrays = [self.results.omega, self.results.attitude, *self.reduced.values()]
        return sum(array.nbytes for array in arrays if array is not None)


def pieces(tile: Tile, group: Arrays, threads: int | None) -> Iterator[Piece]:
    """What a tile lacks, computed piece by piece from where the store left it."""
    job = tile.job
    start, resume = _left(tile, group)
    if start == job.steps and _mark(tile, group) == start:
        return
    whole = job.jumps
    if whole:
        start, resume = 0, {}
    flat = np.array(flat_vectors(tile.starts, tile.shape))
    flat[np.isnan(flat).any(axis=-1)] = np.nan
    orientation = None
    if job.orientation is not None:
        orientation = flat_matrices(job.orientation, tile.shape)
    work = job.work(tile.where)
    for segment in segments(start, job.steps, job.save_every, job.plan.rows, work, whole):
        run = Run(
            map=job.map,
            body=job.body,
            batch=tile.shape,
            omega0=flat,
            eps=job.eps,
            steps=segment.stop,
            save_every=job.save_every,
            method=job.method,
            orientation=orientation,
            start=segment.start,
            resume=resume,
            threads=threads,
        )
        results = go_on(run)
        resume = {k: v for k, v in results.resume.items() if k not in _BEGUN_WITH}
        yield _piece(tile, segment, run, results, resume)
        del results  # the next piece takes the same memory, which is in the caches


def _piece(
    tile: Tile, segment: Segment, run: Run, results: Results, resume: dict[str, Any]
) -> Piece:
    job = tile.job
    rows = slice(run.rows_before, run.rows_before + len(results.omega))
    values: dict[str, FloatArray] = {}
    if job.reductions and len(results.omega):
        first = np.broadcast_to(tile.starts, (*tile.shape, job.body.dimension))
        values = reduced(job.reductions, job.body, job.eps, results.omega, first)
    return Piece(tile, segment, rows, replace(results, resume=resume), values)


def write(piece: Piece, group: Arrays, settled: Settled = "replacing") -> None:
    """Write a piece: its data, then what goes on from it, then the mark."""
    tile, job, results = piece.tile, piece.tile.job, piece.results
    every_component = slice(0, job.body.dimension)
    last = piece.segment.stop == job.steps
    if job.keeps_states and len(results.omega) and (job.save_every is not None or last):
        where = (piece.rows, *tile.where)
        put(group["omega"], (*where, every_component), results.omega, settled)
        if results.attitude is not None:
            square = (slice(0, job.body.dimension + 1),) * 2
            put(group["attitude"], (*where, *square), results.attitude, settled)
    for name, values in piece.reduced.items():
        where = (*tile.where, every_component) if REDUCTIONS[name].of_components else tile.where
        if piece.segment.start:
            values = REDUCTIONS[name].combine(group[name][where], values)
        put(group[name], where, values, settled)
    if last:
        put(group["final"], (*tile.where, every_component), results.final, settled)
        put(group["status"], tile.where, results.status, settled)
        put(group["failed_at"], tile.where, results.failed_at, settled)
    if RESUME in group:
        _go_on_from(tile, group, piece.segment.stop, results.resume)
    mark = np.array(piece.segment.stop).reshape(tuple(1 for _ in tile.index))
    put(group[STEPS_DONE], _place(tile), mark, "none")


def _go_on_from(tile: Tile, group: Arrays, steps: int, resume: dict[str, Any]) -> None:
    array = group[RESUME]
    data = packed(steps, resume if steps else {})  # nothing but the starts before step 1
    record = np.zeros((*(1 for _ in tile.index), array.shape[-1]), np.uint8)
    flat = record.reshape(-1)
    flat[:8] = np.array([data.size]).view(np.uint8)
    flat[8 : 8 + data.size] = data
    put(array, (*_place(tile), slice(0, array.shape[-1])), record, "none")


def _place(tile: Tile) -> Slices:
    """Of a tile among all."""
    return tuple(slice(k, k + 1) for k in tile.index)


def _mark(tile: Tile, group: Arrays) -> int:
    return int(group[STEPS_DONE][tile.index])


def _left(tile: Tile, group: Arrays) -> tuple[int, dict[str, Any]]:
    """Where a tile is to be gone on with, and from what."""
    mark = _mark(tile, group)
    if mark < 0 or RESUME not in group:
        return max(mark, 0), {}
    return unpacked(group[RESUME][tile.index])


def resume_size(job: Job) -> int:
    """The bytes that what is left to go on from takes at most; none if there is nothing."""
    if 0 in job.plan.batch:
        return 0
    where = tuple(slice(0, 1) for _ in job.plan.batch)
    one, n = job.of(where), job.body.dimension + 1
    run = Run(
        map=one.map,
        body=one.body,
        batch=tuple(1 for _ in where),
        omega0=np.array(job.starts(where).reshape(1, -1)),
        eps=one.eps,
        steps=1,
        save_every=one.save_every,
        method=one.method,
        orientation=None if one.orientation is None else one.orientation.reshape(1, n, n).copy(),
        threads=1,
    )
    entries = [v for k, v in go_on(run).resume.items() if k not in _BEGUN_WITH]
    if not any(array.size for array in entries):
        return 0
    each = sum(array.nbytes for array in entries)
    count = int(np.prod(job.plan.tile))
    return _ARCHIVE + _ENTRY * (len(entries) + 1) + each * count
