"""Tiles of the batch of an ensemble: each is computed and written to its part of the store."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..checks import FloatArray, wrong
from ..engine.problem import Problem, Where, along, part_of
from ..engine.random_starts import RandomStarts
from ..engine.stretches import March
from . import stores
from .columns import of_runs
from .functions import returned_at, values_at
from .metadata import Tile

# Tiles that are queued per thread of a Dask worker.
_QUEUED = 4
# Dask warns of tasks with more bytes; a tile needs a few chunks at most.
_LARGE_TASK = 2**28
# Cost of writing a state, in steps of the three-dimensional map. If the steps between two saved
# states cost less, one thread computes them, because others would spin while it writes.
_WRITING_COST = 8.0

Functions = Mapping[str, Callable[[FloatArray], ArrayLike]]
Options = tuple[str, int, int | None, Functions]  # method, steps, save_every, functions


def finish(
    tiles: dict[Tile, Where],
    whole: Problem,
    options: Options,
    arrays: Any,
    client: Any,
    store: Any,
) -> Generator[tuple[Where, bool], None, None]:
    """Compute tiles of a batch, here or by a Dask client.

    Yield the place of each when done, and whether a change of sign told a pole.
    """
    if client is None:
        for where in tiles.values():
            yield where, _compute(_problem_of(whole, where), options, where, arrays)
        return
    from dask import config
    from distributed import as_completed

    settings = {"distributed.admin.large-graph-warning-threshold": _LARGE_TASK}
    waiting = iter(tiles.items())
    under_way: dict[Any, tuple[Tile, Where]] = {}
    jobs, known_workers = as_completed(loop=client.loop), set()

    def submit() -> None:
        """Queue tiles for all workers, of which there may be more by now."""
        most = _QUEUED * max(1, sum(client.nthreads().values()))
        for tile, where in islice(waiting, max(0, most - len(under_way))):
            arguments = _problem_of(whole, where), options, where, arrays
            with config.set(settings):
                job = client.submit(_compute_on_worker, *arguments, pure=False)
            under_way[job] = tile, where
            jobs.add(job)

    try:
        submit()
        for job in jobs:
            tile, where = under_way.pop(job)
            worker, by_sign = job.result()
            if worker not in known_workers and not stores.has_tile(store, tile):
                received = f"{worker}, whose tile is not at {store}"
                raise wrong("client", "have workers that write to the store", received)
            known_workers.add(worker)
            yield where, by_sign
            submit()
    finally:
        client.cancel([*under_way])


def _compute_on_worker(*arguments: Any) -> tuple[str, bool]:
    """Compute a tile; return the address of the worker, and the value of `_compute`."""
    from distributed import get_worker

    by_sign = _compute(*arguments)
    return str(get_worker().address), by_sign


def _compute(tile: Problem, options: Options, where: Where, arrays: Any) -> bool:
    """Compute a tile in pieces that fill a chunk, and write them; `status`, last, marks it done.

    Return whether a change of sign told that one of its trajectories passed a pole.
    """
    (method, steps, every, functions), map, row = options, tile.map, 0
    if isinstance(tile.omega, RandomStarts):  # drawn here, so that no process holds all states
        part = tile.omega._part(along(tile.omega.shape, where), tile.body.dimension)
        tile = tile._replace(omega=part)
    march, rows = March(tile, method), arrays[map.variable].chunks[0]
    cost = march.steps.cost(tile.body.dimension, march.arguments)
    if every and every * cost < _WRITING_COST:
        march.problem = tile._replace(threads=1)
    for states, turns in march.pieces(steps, every or 0, rows):
        piece = {map.variable: states}
        piece |= {} if turns is None else {"attitude": turns}
        piece |= {name: checked_values(name, f, states) for name, f in functions.items()}
        for name, values in piece.items():
            arrays[name][(slice(row, row + len(states)), *where)] = values
        row += len(states)
    for column in sorted(of_runs(march.steps, False), key=lambda column: column.is_last):
        if not column.is_saved:
            arrays[column.name][where] = getattr(march, column.name)
    return bool(np.any(march.told_by_signs))


def checked_values(name: str, function: Any, states: FloatArray) -> Any:
    """Return the values of a user's function for states (..., D), real numbers (...)."""
    name = f"functions[{name!r}]"
    return values_at(name, states, returned_at(name, function, states), truths=True)


def _problem_of(whole: Problem, where: Where) -> Problem:
    """Return the problem of a tile; initial states in an array are read and checked only now."""
    tile = part_of(whole, where)
    if isinstance(tile.omega, RandomStarts):
        return tile
    return tile._replace(omega=checks.states("omega0", np.asarray(tile.omega), tile.body._labels))


def place_of(tile: Tile, shape: tuple[int, ...], chunks: tuple[int, ...]) -> Where:
    """Return the slices of the batch that a tile covers."""
    axes = zip(tile, shape, chunks, strict=True)
    return tuple(slice(k * m, min(k * m + m, n)) for k, n, m in axes)


def count_in(where: Where) -> int:
    """Return the number of trajectories in a part of the batch."""
    return math.prod(part.stop - part.start for part in where)
