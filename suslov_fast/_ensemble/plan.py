"""How a run is cut: the batch into tiles, the time of a tile into segments."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from .._bodies.three import Suslov3D
from .._checks import integer
from .._engine.arguments import Body
from .starts import Slices

# The states of one chunk of a store, in bytes. Files of this size are read and written at full
# speed, and a few of them fit everywhere.
_BYTES = 2**24
# Steps of the 3D map between two marks, some 20 s of one core: what a killed process loses.
_WORK = 2**34
# Workers share a run whose tiles are so many, and end together; a tile of less work than this would
# take longer to hand out than to compute.
_MANY, _LEAST = 32, 2**28
# Fewer trajectories leave threads without work.
_FEWEST = 64


@dataclass(frozen=True)
class Plan:
    """The shape of the chunks of a store.

    Attributes
    ----------
    tile
        How many trajectories along each axis of the batch.
    rows
        How many of the states that are kept.
    """

    batch: tuple[int, ...]
    tile: tuple[int, ...]
    rows: int

    @property
    def grid(self) -> tuple[int, ...]:
        """How many tiles lie along each axis of the batch."""
        return tuple(-(-length // part) for length, part in zip(self.batch, self.tile, strict=True))

    def where(self, index: tuple[int, ...]) -> Slices:
        """The part of the batch that a tile is."""
        return tuple(
            slice(k * part, min((k + 1) * part, length))
            for k, part, length in zip(index, self.tile, self.batch, strict=True)
        )


def plan_of(
    body: Body,
    batch: tuple[int, ...],
    steps: int,
    save_every: int | None,
    attitude: bool,
    dims: tuple[str, ...],
    chunk: int | Mapping[str, int] | None,
) -> Plan:
    """Chunks as they are asked for, or such that a few fit in any memory."""
    each = 8 * (body.dimension + ((body.dimension + 1) ** 2 if attitude else 0))
    kept = 1 if save_every is None else steps // save_every + 1
    asked, rows = _asked(chunk, dims)
    if isinstance(chunk, Mapping):
        tile = tuple(
            min(asked.get(name, length), length) or 1
            for name, length in zip(dims, batch, strict=True)
        )
    else:
        count = asked.get("", _trajectories(body, batch, steps, kept, each))
        tile = _from_the_last_axis(batch, count)
    if rows is None:
        rows = max(1, min(kept, _BYTES // (each * math.prod(tile))))
    return Plan(batch, tile, rows)


def _asked(
    chunk: int | Mapping[str, int] | None, dims: tuple[str, ...]
) -> tuple[dict[str, int], int | None]:
    expected = "a number of trajectories, or sizes along some of " + ", ".join(("n", *dims))
    if chunk is None:
        return {}, None
    if not isinstance(chunk, Mapping):
        return {"": integer("chunk", chunk, 1, expected)}, None
    sizes = {name: integer("chunk", size, 1, expected) for name, size in chunk.items()}
    strangers = [str(name) for name in sizes if name not in ("n", *dims)]
    if strangers:
        raise ValueError(f"chunk: expected {expected}, got {', '.join(strangers)}")
    return sizes, sizes.pop("n", None)


def _trajectories(body: Body, batch: tuple[int, ...], steps: int, kept: int, each: int) -> int:
    """Those whose states fit in a chunk, and whose steps are made between two marks."""
    # So many that vectors and threads are busy, even where time is cut for it.
    fit = max(_BYTES // (each * kept), 2**14)
    fit = min(fit, _BYTES // each)
    work = max(steps, 1) * work_of(body)
    shared = max(-(-math.prod(batch) // _MANY), int(_LEAST / work))
    return max(_FEWEST, min(fit, shared, int(_WORK / work)))


def work_of(body: Body) -> float:
    """That of a step, in steps of the 3D map."""
    return 1.0 if isinstance(body, Suslov3D) else 8.0 * body.dimension


def _from_the_last_axis(batch: tuple[int, ...], count: int) -> tuple[int, ...]:
    tile: list[int] = []
    for length in reversed(batch):
        tile.insert(0, max(1, min(count, length)))
        count //= tile[0]
    return tuple(tile)


@dataclass(frozen=True)
class Segment:
    """Steps `start` to `stop` of a tile; state `start` is known."""

    start: int
    stop: int


def segments(
    start: int, steps: int, save_every: int | None, rows: int, work: float, whole: bool
) -> Iterator[Segment]:
    """The segments from a state on: each fills at most one chunk of states.

    `work` is that of one step of the tile. With `whole` there is one segment, whatever it takes.
    """
    stop = start
    while True:
        start, stop = stop, steps
        if not whole:
            stop = min(stop, start + max(1, int(_WORK / max(work, 1.0))))
            if save_every is not None:
                next_row = start // save_every + 1 if start else 0
                last_row = (next_row // rows + 1) * rows - 1
                stop = min(stop, max(last_row * save_every, start + 1))
        yield Segment(start, stop)
        if stop == steps:
            return
