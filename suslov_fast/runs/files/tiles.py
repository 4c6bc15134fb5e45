"""Tiles of the batch of an ensemble: each is computed and written to its part of the store."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ... import checks
from ...checks import FloatArray, wrong
from ...engine.problem import Problem, Where, along, part_of
from ...engine.random_starts import RandomStarts
from ...engine.stretches import March
from ..columns import of_runs
from ..functions import returned_at, values_at
from . import access, stores
from .metadata import Stored, Tile

# Tiles that are queued per thread of a Dask worker.
_QUEUED = 4
# Dask warns of tasks with more bytes; a tile needs a few chunks at most.
_LARGE_TASK = 2**28
# Cost of writing a state, in steps of the three-dimensional map. If the steps between two saved
# states cost less, one thread computes them, because others would spin while it writes.
_WRITING_COST = 8.0

Functions = Mapping[str, Callable[[FloatArray], ArrayLike]]
Options = tuple[str, int, int | None, Functions]  # method, steps, save_every, functions
Arrays = Mapping[str, Stored]  # of a store, by their names


def finish(
    tiles: dict[Tile, Where],
    whole: Problem,
    options: Options,
    arrays: Arrays,
    client: Any,
    store: Any,
) -> Generator[tuple[Where, bool], None, None]:
    """Compute tiles of a batch, here or by a Dask client, and write them to the arrays of a store.

    Yield the place of each when done, and whether a change of sign told a pole.
    """
    target = access.reader(store, read_only=False)
    if client is None:
        for tile, where in tiles.items():
            part = _problem_of(whole, where)
            yield where, _compute(part, options, tile, where, arrays, target)
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
            arguments = _problem_of(whole, where), options, tile, where, arrays, target
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


def _compute(
    part: Problem, options: Options, tile: Tile, where: Where, arrays: Arrays, target: Any
) -> bool:
    """Compute a tile in pieces that fill a chunk, and write them; `status`, last, marks it done.

    Return whether a change of sign told that one of its trajectories passed a pole.
    """
    from .chunks import encoded

    (method, steps, every, functions), map = options, part.map
    if isinstance(part.omega, RandomStarts):  # drawn here, so that no process holds all states
        drawn = part.omega._part(along(part.omega.shape, where), part.body.dimension)
        part = part._replace(omega=drawn)
    march, rows = March(part, method), arrays[map.variable].chunks[0]
    cost = march.steps.cost(part.body.dimension, march.arguments)
    if every and every * cost < _WRITING_COST:
        march.problem = part._replace(threads=1)
    position = dict(zip(arrays["status"].dims, tile, strict=True))

    def write(columns: Mapping[str, Any]) -> None:
        """Write the values of columns to their chunks at `position`."""
        made = {}
        for name, values in columns.items():
            array = arrays[name]
            made[array.key(name, position)] = encoded(values, array.chunks, array.dtype)
        access.run(access.put(target, made))

    for position["n"], (states, turns) in enumerate(march.pieces(steps, every or 0, rows)):
        piece = {map.variable: states}
        piece |= {} if turns is None else {"attitude": turns}
        write(piece | {name: checked_values(name, f, states) for name, f in functions.items()})
    kept = [column for column in of_runs(False) if not column.is_saved]
    for is_last in (False, True):
        names = [column.name for column in kept if column.is_last == is_last]
        write({name: getattr(march, name) for name in names})
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
