"""Tiles of the batch of an ensemble: each is computed and written to its part of the store."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from dataclasses import asdict, dataclass, replace
from itertools import islice
from typing import Any, ClassVar

import numpy as np

from ... import checks
from ...checks import FloatArray, require
from ...core.motion.engine import Settings
from ...engine.arguments import flat_arrays
from ...engine.motions import Asked
from ...engine.problem import Problem, Where, along, part_of
from ...engine.random_starts import RandomStarts
from ...engine.stretches import March
from ..change import Change, field_of
from ..changes import acts_of, changes_of_records, stops_of
from ..columns import RUN
from ..flow import motion_of, motion_with_changes
from .stores import group_of

# Tiles that are queued per thread of a Dask worker.
_QUEUED = 4
# Dask warns of tasks with more bytes; a tile needs a few chunks at most.
_LARGE_TASK = 2**28
# Cost of writing a state, in steps of the three-dimensional map. If the steps between two saved
# states cost less, one thread computes them, because others would spin while it writes.
_WRITING_COST = 8.0

Piece = dict[str, Any]  # values of columns


@dataclass(frozen=True)
class Steps:
    """The task of a tile of a map: steps of a method."""

    method: str
    steps: int
    save_every: int | None

    axis: ClassVar[str] = "n"  # along which states are saved
    fewest: ClassVar[int] = 2**12  # trajectories that keep a processor busy

    @property
    def rows(self) -> int:
        """The number of saved states of a trajectory."""
        return 1 if self.save_every is None else self.steps // self.save_every + 1

    @property
    def work(self) -> int:
        """The work for a trajectory, in the unit of progress."""
        return self.steps

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments of :func:`iterate`, as a run has them."""
        return asdict(self)

    @property
    def most(self) -> int:
        """The number of trajectories that take a few seconds."""
        return 2**31 // (self.steps + 1)

    def of(self, where: Where) -> Steps:
        """Return the task of a part of the batch."""
        return self

    def pieces(self, part: Problem, rows: int) -> Iterator[Piece]:
        """Yield the saved states, `rows` at a time, and at last the other columns."""
        march, every = March(part, self.method), self.save_every or 0
        cost = march.steps.cost(part.body.dimension, march.arguments)
        if every and every * cost < _WRITING_COST:
            march.problem = part._replace(threads=1)
        for states, turns in march.pieces(self.steps, every, rows):
            yield {"states": states} | ({} if turns is None else {"attitude": turns})
        last = [column.name for column in RUN if column.is_public and not column.is_saved]
        yield {name: getattr(march, name) for name in last}


@dataclass(frozen=True)
class Times:
    """The task of a tile of a motion: states at times."""

    times: FloatArray
    sign: int
    settings: Settings
    changes: tuple[Change, ...] = ()  # as text, which workers can be sent

    axis: ClassVar[str] = "time"
    fewest: ClassVar[int] = 2**6
    most: ClassVar[int] = 2**16

    @property
    def rows(self) -> int:
        """The number of states of a trajectory."""
        return len(self.times)

    @property
    def work(self) -> int:
        """The work for a trajectory, in the unit of progress."""
        return self.rows

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments of :func:`flow`, as a motion has them."""
        return self.settings._asdict() | {"by": ()}

    def pieces(self, part: Problem, rows: int) -> Iterator[Piece]:
        """Yield the states, `rows` at a time, and at last the other columns."""
        (body, x, batch), n = (part.body, part.omega, part.batch), len(self.times)
        require(8 * (n + 2) * math.prod(batch) * body.dimension, "pass a smaller chunk")
        asked = Asked(self.times, self.sign, self.settings, part.threads)
        starts, counts = flat_arrays(x, batch), None
        if self.changes:
            field = field_of(body)
            asked = asked._replace(stops=stops_of(self.changes, self.sign, batch))
            acts = acts_of(field, self.changes)
            found = motion_with_changes(field, starts, batch, acts, asked)
            counts = changes_of_records(found.records, body, self.changes, batch).count
        else:
            found = motion_of(body, starts, batch, asked)
        states = found.states.reshape(n, *batch, body.dimension)
        for k in range(0, n, rows):
            yield {"states": states[k : k + rows]}
        last: Piece = {"end": found.t, "steps": found.steps, "status": found.status}
        last = {name: values.reshape(batch) for name, values in last.items()}
        yield last if counts is None else last | {"count": counts}

    def of(self, where: Where) -> Times:
        """Return the task of a part of the batch, with its times of changes."""
        own = tuple(
            each
            if each.times is None
            else replace(each, times=each.times[along(each.times.shape[:-1], where)])
            for each in self.changes
        )
        return replace(self, changes=own)


Task = Steps | Times


def finish(
    tiles: list[Where], whole: Problem, task: Task, client: Any, store: Any
) -> Generator[Where, None, None]:
    """Compute tiles of a batch, here or by a Dask client, and write them; yield each when done."""
    if client is None:
        for where in tiles:
            _compute(_problem_of(whole, where), task.of(where), where, store)
            yield where
        return
    from dask import config
    from distributed import as_completed

    settings = {"distributed.admin.large-graph-warning-threshold": _LARGE_TASK}
    waiting, jobs = iter(tiles), as_completed(loop=client.loop)
    under_way: dict[Any, Where] = {}

    def submit() -> None:
        """Queue tiles for all workers, of which there may be more by now."""
        most = _QUEUED * max(1, sum(client.nthreads().values()))
        for where in islice(waiting, max(0, most - len(under_way))):
            part = _problem_of(whole, where)
            with config.set(settings):
                job = client.submit(_compute, part, task.of(where), where, store, pure=False)
            under_way[job] = where
            jobs.add(job)

    try:
        submit()
        for job in jobs:
            job.result()
            yield under_way.pop(job)
            submit()
    finally:
        client.cancel([*under_way])


def _compute(part: Problem, task: Task, where: Where, store: Any) -> None:
    """Compute a tile in pieces that fill a chunk, and write them; `status`, last, marks it done."""
    if isinstance(part.omega, RandomStarts):  # drawn here, so that no process holds all states
        drawn = part.omega._part(along(part.omega.shape, where), part.body.dimension)
        part = part._replace(omega=drawn)
    variable = part.body.variable
    # A chunk that is not there was lost.
    kept = {"write_empty_chunks": True}
    arrays = {name: array.with_config(kept) for name, array in group_of(store, "r+").arrays()}
    batch, rows = arrays["status"].metadata.dimension_names or (), arrays[variable].chunks[0]
    place: dict[str, Any] = dict(zip(batch, where, strict=True))
    for k, piece in enumerate(task.pieces(part, rows)):
        place[task.axis] = slice(k * rows, k * rows + len(piece.get("states", ())))
        for name in sorted(piece, key=lambda name: name == "status"):
            array = arrays[variable if name == "states" else name]
            index = tuple(place.get(d, slice(None)) for d in array.metadata.dimension_names or ())
            array[index] = piece[name]


def _problem_of(whole: Problem, where: Where) -> Problem:
    """Return the problem of a tile; initial states in an array are read and checked only now."""
    tile = part_of(whole, where)
    if isinstance(tile.omega, RandomStarts):
        return tile
    return tile._replace(omega=checks.states("x0", np.asarray(tile.omega), tile.body.labels))


def count_in(where: Where) -> int:
    """Return the number of trajectories in a part of the batch."""
    return math.prod(part.stop - part.start for part in where)
