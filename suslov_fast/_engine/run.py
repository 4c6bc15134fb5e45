"""From a checked run to its results: memory, the loops, and how a run is gone on with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .arguments import Body
from .layout import flat_parameter
from .memory import require
from .problem import Outcome, Problem
from .progress import Progress


class Map(Protocol):
    """The fields of a map that a run needs; `_maps.record.Map` has them."""

    @property
    def parameters(
        self,
    ) -> Callable[[Any, float | FloatArray, tuple[int, ...]], list[FloatArray]]: ...
    @property
    def run(self) -> Callable[[Problem], Outcome]: ...


@dataclass(slots=True)  # not frozen: that would take longer than a short run
class Run:
    """A run of the map that is asked for, checked.

    Attributes
    ----------
    map
        The map that is iterated, a record.
    omega0
        (B, D), the states at step 0; of a run that may be gone on with, in memory that nobody else
        writes to.
    eps
        The step size, a number or of a shape that broadcasts to the batch.
    orientation
        (B, n, n), the orientations at step 0, or None.
    start
        The number of steps that were made before.
    resume
        What they left.
    single
        Whether it is a single step that nobody goes on from.
    """

    map: Map
    body: Body
    batch: tuple[int, ...]
    omega0: FloatArray
    eps: float | FloatArray
    steps: int
    save_every: int | None
    method: str
    orientation: FloatArray | None = None
    threads: int | None = None
    progress: Progress = None
    start: int = 0
    resume: dict[str, NDArray[Any]] = field(default_factory=dict)
    single: bool = False

    @property
    def rows(self) -> int:
        """The number of states of each trajectory that are kept."""
        return 1 if self.save_every is None else self.steps // self.save_every + 1

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the states that are kept."""
        return (self.rows, *self.batch, self.omega0.shape[1])

    @property
    def rows_before(self) -> int:
        """The number of those that were kept before."""
        if self.save_every is None or self.start == 0:
            return 0
        return self.start // self.save_every + 1


def numbers_of_saved(steps: int, save_every: int | None) -> NDArray[np.int64]:
    """The numbers of all states that a run keeps."""
    if save_every is None:
        return np.array([steps])
    return np.arange(0, steps + 1, save_every)


@dataclass(slots=True)
class Results:
    """Arrays over the batch; see `Trajectories`."""

    omega: FloatArray
    attitude: FloatArray | None
    final: FloatArray
    status: NDArray[np.int8]
    failed_at: NDArray[np.int64]
    resume: dict[str, NDArray[Any]]


def execute(
    run: Run,
    out: FloatArray | None = None,
    before: tuple[FloatArray, FloatArray | None] | None = None,
) -> Results:
    """Make the steps of a run.

    `out` receives the states that are kept, if it is given. Those that were kept before, and the
    orientations, are copied from `before`.
    """
    saved, turns = _room(run, run.rows, out)
    begin = 0
    if before is not None and (begin := run.rows_before):
        for kept, array in zip(before, (saved, turns), strict=True):
            if array is not None:
                array[:begin] = kept
    return _results(run, saved, turns, begin)


def go_on(run: Run) -> Results:
    """Make the steps of a run since its start; of the states that are kept, only those since."""
    saved, turns = _room(run, run.rows - run.rows_before)
    return _results(run, saved, turns, 0)


def _room(
    run: Run, rows: int, out: FloatArray | None = None
) -> tuple[FloatArray | None, FloatArray | None]:
    """Arrays for states that are kept, and for the orientations, where they fit in memory."""
    size, D = run.omega0.shape
    shape, turns = (rows, *run.batch, D), None
    saves = out is None and run.save_every is not None
    numbers = 4 * size * D  # in arrays beside them
    if saves:
        numbers += rows * size * D
    if run.orientation is not None:
        numbers += rows * run.orientation.size
    require(8 * numbers, "the states kept are {}: raise save_every or cut the batch", shape)
    if run.orientation is not None:
        turns = np.empty((*shape[:-1], *run.orientation.shape[1:]))
    return np.empty(shape) if saves else out, turns


def _results(run: Run, saved: FloatArray | None, turns: FloatArray | None, begin: int) -> Results:
    """Make the steps, and fill what is kept from row `begin` on."""
    problem = _problem(run, saved, turns, begin)
    final, status, failed_at, resume = run.map.run(problem)
    batch, every = run.batch, run.save_every
    if saved is None or every is None or run.steps % every or not len(saved):
        final = final.reshape((*batch, final.shape[1]))
    else:
        final = saved[-1]
    if saved is None:
        saved = final[np.newaxis]
    elif every is None:
        saved[0] = final
    # What the loops left to go on from, with what the run began with.
    resume["omega0"] = run.omega0
    if run.orientation is not None:
        resume["R0"] = run.orientation
    return Results(saved, turns, final, status.reshape(batch), failed_at.reshape(batch), resume)


def _problem(run: Run, saved: FloatArray | None, turns: FloatArray | None, begin: int) -> Problem:
    """The flat problem."""
    batch, every, (size, D) = run.batch, run.save_every, run.omega0.shape
    parameters = run.map.parameters(run.body, run.eps, batch)
    time_step, rows, turned = parameters[-1], _no_rows(D), _no_rows(D + 1, D + 1)
    if saved is not None and every is not None:
        rows = saved.reshape((len(saved), size, D))
        if begin:
            rows = rows[begin:]
    if run.orientation is not None:
        time_step = flat_parameter(run.eps, batch)
    if turns is not None:
        turned = turns.reshape((len(turns), size, D + 1, D + 1))[begin:]
    return Problem(
        run.method,
        run.omega0,
        parameters,
        time_step,
        run.start,
        run.steps,
        every or run.steps + 1,
        every is not None,
        rows,
        turned,
        run.orientation,
        run.resume,
        run.threads,
        run.progress,
        run.single,
    )


@lru_cache
def _no_rows(*shape: int) -> FloatArray:
    return np.empty((0, 0, *shape))
