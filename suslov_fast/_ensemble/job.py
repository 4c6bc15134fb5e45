"""A run to be stored: checked arguments, tiles of the batch, identity."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray, integer, wrong
from .._engine.layout import alike
from .._engine.problem import Map, numbers_of_saved
from .._engine.random_starts import Slices
from .._maps import map_of
from .reductions import Monitors, identity_of_function, reductions_of
from .starts import Source, part_of, values_or_digest

# Bytes of the states in one chunk. Files of this size are read and written at full speed.
_BYTES = 2**24
# Number of tiles that balances the load of workers, and the least work of a tile, in steps of the
# 3D map, below which the overhead of a task dominates.
_MOST_TILES, _LEAST_WORK = 32, 2**28
# Fewer trajectories leave threads and vector lanes idle; a chunk then has fewer times instead.
_FEWEST, _ENOUGH_LANES = 64, 2**14


@dataclass(frozen=True, eq=False)
class Job:
    """A run and its store; arguments as in `ensemble`, checked."""

    body: Any
    eps: FloatArray
    source: Source | None  # of initial states; None if a worker receives those of its tile
    orientation: FloatArray | None  # at step 0; it broadcasts to the batch
    batch: tuple[int, ...]
    steps: int
    save_every: int | None
    method: str
    reductions: tuple[str, ...]
    monitors: Monitors
    dims: tuple[str, ...]
    store: Any
    compression: str | None
    tile: tuple[int, ...] = ()  # number of trajectories of a tile along each axis of the batch
    rows: int = 1  # number of saved states in a chunk

    @property
    def map(self) -> Map:
        return map_of(self.body)

    @property
    def keeps_states(self) -> bool:
        """True if states are stored, and not only reductions of them."""
        return self.save_every is not None or not self.reductions

    @property
    def every(self) -> int | None:
        """Stride of the computed states; reductions use all states if none are stored."""
        return self.save_every if self.keeps_states else 1

    @property
    def states(self) -> tuple[str, ...]:
        """Stored arrays with an axis of time."""
        turns = ("attitude",) * (self.orientation is not None)
        return (self.map.variable, *turns, *self.monitors) * self.keeps_states

    @property
    def results(self) -> tuple[str, ...]:
        """Stored arrays written with the last step."""
        return ("final", "status", "failed_at", *self.reductions)

    @property
    def saved(self) -> int:
        """Number of stored states."""
        return 1 if self.save_every is None else self.steps // self.save_every + 1

    @property
    def numbers(self) -> NDArray[np.int64]:
        """Step numbers of the stored states."""
        return numbers_of_saved(self.steps, self.save_every)

    @property
    def grid(self) -> tuple[int, ...]:
        """Number of tiles along each axis of the batch."""
        return tuple(-(-length // part) for length, part in zip(self.batch, self.tile, strict=True))

    @property
    def record(self) -> np.dtype[Any]:
        """Record of a trajectory in the store, from which the next piece can start."""
        D = self.body.dimension
        lengths = {"component": D, "space": D + 1}
        resume: list[Any] = [
            (kept.name, kept.dtype, tuple(lengths.get(str(dim), dim) for dim in kept.dims[1:]))
            for kept in self.map.resume
            if self.orientation is not None or not kept.attitude
        ]
        known = reductions_of(self.map)
        reduced: list[Any] = [
            (name, "float64", (D,) * known[name].of_components) for name in self.reductions
        ]
        return np.dtype([("steps", "int64"), *resume, *reduced])

    def where(self, tile: int) -> Slices:
        """Return the part of the batch in a tile."""
        starts = np.multiply(np.unravel_index(tile, self.grid), self.tile).tolist()
        axes = zip(starts, self.tile, self.batch, strict=True)
        return tuple(slice(k, min(k + part, length)) for k, part, length in axes)

    def shape(self, tile: int) -> tuple[int, ...]:
        """Return the shape of that part."""
        return tuple(part.stop - part.start for part in self.where(tile))

    def starts(self, tile: int) -> FloatArray:
        """Return the initial states of a tile, which broadcast to it."""
        assert self.source is not None
        where = part_of(self.source.shape, self.where(tile))
        return self.source._part(where, self.body.dimension)

    def part(self, tile: int) -> Job:
        """Return the job with the parameters of one tile."""
        where = self.where(tile)

        def cut(array: FloatArray, own: int = 0) -> FloatArray:
            return array[part_of(array.shape[: array.ndim - own], where)]

        kind, body = type(self.body), self.body
        if body.shape:
            parameters = body._arrays.items()
            body = kind._of({name: cut(each, kind._axes(name)) for name, each in parameters})
        orientation = None if self.orientation is None else cut(self.orientation, 2)
        return replace(self, body=body, eps=cut(self.eps), orientation=orientation)

    def identity(self) -> dict[str, Any]:
        """Return plain values that identify the results, for any number of steps."""
        from .. import __version__

        assert self.source is not None
        parameters = {name: values_or_digest(value) for name, value in self.body._arrays.items()}
        return {
            "body": {"map": self.map.name, **parameters, **self.body._besides},
            "eps": values_or_digest(self.eps),
            "omega0": self.source._identity(),
            "batch": list(self.batch),
            "dims": list(self.dims),
            "method": self.method,
            "save_every": self.save_every,
            "attitude": None if self.orientation is None else values_or_digest(self.orientation),
            "reductions": list(self.reductions)
            or {
                name: identity_of_function(name, function, self.body.dimension)
                for name, function in self.monitors.items()
            },
            "version": __version__,
        }


def cut(job: Job, chunk: int | Mapping[str, int] | None) -> Job:
    """Return a job with the chunk sizes of `chunk`, by default chunks of 16 MiB."""
    expected = "a number of trajectories, or sizes along some of " + ", ".join(("n", *job.dims))
    D, size = job.body.dimension, math.prod(job.batch)
    saved = 1 if job.every is None else job.steps // job.every + 1
    state_bytes = 8 * (D + (0 if job.orientation is None else (D + 1) ** 2))
    sizes: dict[str, int] = {}
    if isinstance(chunk, Mapping):
        sizes = {name: integer("chunk", each, 1, expected) for name, each in chunk.items()}
        if unknown := [str(name) for name in sizes if name not in ("n", *job.dims)]:
            raise wrong("chunk", expected, ", ".join(unknown))
        count = size
    elif chunk is None:
        fit = min(max(_BYTES // (state_bytes * saved), _ENOUGH_LANES), _BYTES // state_bytes)
        shared = max(-(-size // _MOST_TILES), int(_LEAST_WORK / max(job.steps * step_work(D), 1.0)))
        count = max(_FEWEST, min(fit, shared))
    else:
        count = integer("chunk", chunk, 1, expected)
    tile: tuple[int, ...] = ()
    for name, length in zip(reversed(job.dims), reversed(job.batch), strict=True):
        part = max(1, min(sizes.get(name, count), length))
        # Parts of about equal size: a small part takes as much space as others.
        tile = (alike(length, part, 1) if chunk is None and length else part, *tile)
        count = count if sizes else count // part
    fit = max(1, _BYTES // (state_bytes * math.prod(tile)))
    rows = min(sizes["n"], max(saved, fit)) if "n" in sizes else alike(saved, min(saved, fit), 1)
    return replace(job, tile=tile, rows=rows)


def step_work(dimension: int) -> float:
    """Return the work of a step, in steps of the 3D map."""
    return 1.0 if dimension == 2 else 8.0 * dimension


def require_same(asked: dict[str, Any], stored: dict[str, Any], store: object) -> None:
    """Raise a ValueError that names the difference if the store holds another run."""
    asked, stored = (
        {f"body {name}": value for name, value in each["body"].items()}
        | {name: value for name, value in each.items() if name != "body"}
        for each in (asked, stored)
    )
    differing = [
        f"{name} {stored.get(name)!s:.99} instead of {asked.get(name)!s:.99}"
        for name in dict.fromkeys([*asked, *stored])
        if stored.get(name) != asked.get(name)
    ]
    if differing:
        received = f"{store} of another run, with {'; '.join(differing)}"
        raise wrong("store", "a new store or that of this run", received)
