"""Cutting a run: the batch into tiles, the time of a tile into pieces."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from .._checks import integer

Slices = tuple[slice, ...]
Index = tuple[int, ...]

# Bytes of the states in one chunk. Files of this size are read and written at full speed.
_BYTES = 2**24
# Workers share a run of so many tiles evenly; one of less work, in steps of the 3D map, takes less
# time than its task costs.
_MANY, _LEAST = 32, 2**28
# Fewer trajectories leave threads and vector lanes idle; for these states along time are cut.
_FEWEST, _ENOUGH = 64, 2**14


@dataclass(frozen=True)
class Plan:
    """The chunks of a store.

    Attributes
    ----------
    tile
        Number of trajectories of a tile along each axis of the batch.
    rows
        Number of saved states in a chunk.
    """

    batch: tuple[int, ...]
    tile: tuple[int, ...]
    rows: int

    @property
    def grid(self) -> tuple[int, ...]:
        """Number of tiles along each axis of the batch."""
        return tuple(-(-length // part) for length, part in zip(self.batch, self.tile, strict=True))

    def where(self, index: Index) -> Slices:
        """Return the part of the batch that a tile covers."""
        return tuple(
            slice(k * part, min((k + 1) * part, length))
            for k, part, length in zip(index, self.tile, self.batch, strict=True)
        )

    def shape(self, index: Index) -> tuple[int, ...]:
        """Return the shape of that part."""
        return tuple(part.stop - part.start for part in self.where(index))


def plan_of(
    batch: tuple[int, ...],
    dims: tuple[str, ...],
    chunk: int | Mapping[str, int] | None,
    state_bytes: int,
    rows: int,
    work: float,
) -> Plan:
    """Return the plan that the argument `chunk` asks for, else chunks of 16 MiB at most.

    A trajectory has `rows` saved states of `state_bytes` each, and is `work` steps of the 3D map.
    """
    expected = "a number of trajectories, or sizes along some of " + ", ".join(("n", *dims))
    chunk_rows = None
    if isinstance(chunk, Mapping):
        sizes = {name: integer("chunk", size, 1, expected) for name, size in chunk.items()}
        unknown = [str(name) for name in sizes if name not in ("n", *dims)]
        if unknown:
            raise ValueError(f"chunk: expected {expected}, got {', '.join(unknown)}")
        tile = [
            max(1, min(sizes.get(name, length), length))
            for name, length in zip(dims, batch, strict=True)
        ]
        chunk_rows = sizes.get("n")
    else:
        if chunk is None:
            fit = min(max(_BYTES // (state_bytes * rows), _ENOUGH), _BYTES // state_bytes)
            shared = max(-(-math.prod(batch) // _MANY), int(_LEAST / max(work, 1.0)))
            count = max(_FEWEST, min(fit, shared))
        else:
            count = integer("chunk", chunk, 1, expected)
        tile = []
        for length in reversed(batch):  # from the last axis on
            tile.insert(0, max(1, min(count, length)))
            count //= tile[0]
    fit = _BYTES // (state_bytes * math.prod(tile))
    return Plan(batch, tuple(tile), chunk_rows or max(1, min(rows, fit)))


def step_work(dimension: int) -> float:
    """Return the work of a step, in steps of the 3D map."""
    return 1.0 if dimension == 2 else 8.0 * dimension


def piece_end(start: int, steps: int, every: int | None, rows: int, most: int) -> int:
    """Return the step at which a piece that begins at `start` ends.

    A piece has at most `most` steps, or one, and its states fill at most one chunk of `rows`.
    """
    stop = min(steps, start + max(most, 1))
    if every is not None:
        next_row = start // every + 1 if start else 0
        last_row = (next_row // rows + 1) * rows - 1
        stop = min(stop, max(last_row * every, start + 1))
    return stop
