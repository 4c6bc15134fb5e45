"""The engine of one process: all threads compute a piece while the one before is written."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor

from .job import Job
from .layout import Arrays
from .meter import Report
from .pieces import Piece, Tile, pieces, write
from .signals import Stop


def run(
    job: Job, group: Arrays, tiles: Iterable[tuple[int, ...]], report: Report, stop: Stop
) -> None:
    """Compute and write what the tiles lack; ends early, with all in hand written, if asked to."""
    with ThreadPoolExecutor(1, "suslov_fast writer") as writer:
        writing: Future[None] | None = None
        for index in tiles:
            for piece in pieces(Tile.of(job, index), group, None):
                # One is being written at most, so that memory holds two.
                if writing is not None:
                    writing.result()
                writing = writer.submit(_write, piece, group, report)
                del piece
                if stop.asked:
                    break
            if stop.asked:
                break
        if writing is not None:
            writing.result()


def _write(piece: Piece, group: Arrays, report: Report) -> None:
    write(piece, group)
    count = 1
    for length in piece.tile.shape:
        count *= length
    report(count * (piece.segment.stop - piece.segment.start), piece.nbytes)
