"""Cutting a run: the batch into tiles, the time of a tile into pieces."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from .._checks import integer

Slices = tuple[slice, ...]

# Bytes of the states in one chunk. Files of this size are read and written at full speed.
_BYTES = 2**24
# Work of a tile of the default plan, in trajectory-steps of the 3D map: some 20 s of a core.
_WORK = 2**34
# A cluster needs several tiles for each worker, and a tile that takes longer than its task's
# overhead.
_MANY, _LEAST = 32, 2**28
# Fewer trajectories leave threads and vector lanes idle.
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

    def where(self, index: tuple[int, ...]) -> Slices:
        """Return the part of the batch that a tile covers."""
        return tuple(
            slice(k * part, min((k + 1) * part, length))
            for k, part, length in zip(index, self.tile, self.batch, strict=True)
        )

    def size(self, index: tuple[int, ...]) -> int:
        """Return the number of trajectories of a tile."""
        return math.prod(part.stop - part.start for part in self.where(index))


def plan_of(
    batch: tuple[int, ...],
    dims: tuple[str, ...],
    chunk: int | Mapping[str, int] | None,
    state_bytes: int,
    rows: int,
    work: float,
) -> Plan:
    """Return the plan that the argument `chunk` asks for, or chunks of at most 16 MiB.

    Parameters
    ----------
    state_bytes
        Size of one saved state.
    rows
        Number of saved states of each trajectory.
    work
        Work of a trajectory, in steps of the 3D map.
    """
    sizes, chunk_rows = _asked(chunk, dims)
    if isinstance(chunk, Mapping):
        tile = tuple(
            max(1, min(sizes.get(name, length), length))
            for name, length in zip(dims, batch, strict=True)
        )
    else:
        count = sizes.get("", _trajectories(batch, state_bytes, rows, max(work, 1.0)))
        tile = _along_last_axes(batch, count)
    if chunk_rows is None:
        chunk_rows = max(1, min(rows, _BYTES // (state_bytes * math.prod(tile))))
    return Plan(batch, tile, chunk_rows)


def step_work(dimension: int) -> float:
    """Return the work of a step, in steps of the 3D map."""
    return 1.0 if dimension == 2 else 8.0 * dimension


def _asked(
    chunk: int | Mapping[str, int] | None, dims: tuple[str, ...]
) -> tuple[dict[str, int], int | None]:
    expected = "a number of trajectories, or sizes along some of " + ", ".join(("n", *dims))
    if chunk is None:
        return {}, None
    if not isinstance(chunk, Mapping):
        return {"": integer("chunk", chunk, 1, expected)}, None
    sizes = {name: integer("chunk", size, 1, expected) for name, size in chunk.items()}
    unknown = [str(name) for name in sizes if name not in ("n", *dims)]
    if unknown:
        raise ValueError(f"chunk: expected {expected}, got {', '.join(unknown)}")
    return sizes, sizes.pop("n", None)


def _trajectories(batch: tuple[int, ...], state_bytes: int, rows: int, work: float) -> int:
    fit = min(max(_BYTES // (state_bytes * rows), _ENOUGH), _BYTES // state_bytes)
    shared = max(-(-math.prod(batch) // _MANY), int(_LEAST / work))
    return max(_FEWEST, min(fit, shared, int(_WORK / work)))


def _along_last_axes(batch: tuple[int, ...], count: int) -> tuple[int, ...]:
    tile: list[int] = []
    for length in reversed(batch):
        tile.insert(0, max(1, min(count, length)))
        count //= tile[0]
    return tuple(tile)


def piece_end(start: int, steps: int, every: int | None, rows: int, most: int) -> int:
    """Return the step at which a piece that begins at `start` ends.

    A piece has at most `most` steps, and its saved states lie in one chunk of `rows` states.
    """
    stop = min(steps, start + max(most, 1))
    if every is not None:
        next_row = start // every + 1 if start else 0
        last_row = (next_row // rows + 1) * rows - 1
        stop = min(stop, max(last_row * every, start + 1))
    return stop
