"""The engine of one process: a tile on each thread, and what is left over on all of them."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed

import numba

from .._engine.memory import available
from .chunks import Settled
from .job import Job
from .layout import Arrays
from .meter import Report
from .pieces import Piece, Tile, pieces, write
from .signals import Stop

Index = tuple[int, ...]
Keep = Callable[[Piece], None]

# Chunks that a thread holds: what it computes or writes, and what is made on the way.
_HELD = 4


def run(
    job: Job,
    group: Arrays,
    tiles: Sequence[Index],
    settled: Settled,
    report: Report,
    stop: Stop,
) -> None:
    """Compute and write what the tiles lack; ends early, with all in hand written, if asked to."""
    abreast = _abreast(job)
    shared = len(tiles) % abreast if abreast > 1 else len(tiles)
    each = len(tiles) - shared
    door = threading.Lock()

    def keep(piece: Piece) -> None:
        write(piece, group, settled)
        steps = math.prod(piece.tile.shape) * (piece.segment.stop - piece.segment.start)
        with door:
            report(steps, piece.nbytes)

    if each:
        _side_by_side(job, group, tiles[:each], abreast, keep, stop)
    if shared and not stop.asked:
        _one_by_one(job, group, tiles[each:], keep, stop)


def _abreast(job: Job) -> int:
    """How many tiles are in hand at a time: one on each thread, if they fit in memory."""
    count = int(numba.config.NUMBA_NUM_THREADS)
    room = available()
    if room is not None:
        count = min(count, room // (_HELD * job.chunk_bytes))
    return max(count, 1)


def _side_by_side(
    job: Job, group: Arrays, tiles: Sequence[Index], abreast: int, keep: Keep, stop: Stop
) -> None:
    """Threads that each compute a tile and write it: none waits for another."""
    left = iter(tiles)
    door, failed = threading.Lock(), threading.Event()

    def work() -> None:
        while not (stop.asked or failed.is_set()):
            with door:
                index = next(left, None)
            if index is None:
                return
            for piece in pieces(Tile.of(job, index), group, 1):
                keep(piece)
                del piece
                if stop.asked or failed.is_set():
                    return

    with ThreadPoolExecutor(abreast, "suslov_fast tile") as pool:
        workers = [pool.submit(work) for _ in range(abreast)]
        try:
            for worker in as_completed(workers):
                worker.result()
        except BaseException:
            failed.set()
            raise


def _one_by_one(job: Job, group: Arrays, tiles: Sequence[Index], keep: Keep, stop: Stop) -> None:
    """All threads compute a piece while the one before is written."""
    with ThreadPoolExecutor(1, "suslov_fast writer") as writer:
        writing: Future[None] | None = None
        for index in tiles:
            for piece in pieces(Tile.of(job, index), group, None):
                # One is being written at most, so that memory holds two.
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
