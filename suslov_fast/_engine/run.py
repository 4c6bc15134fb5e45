"""From a checked run to its results: memory, the flat problem, and what a run is continued from."""

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
    """The arguments of a run, checked; `Problem` is what becomes of them.

    Attributes
    ----------
    omega0
        (B, D), the states at step 0; of a run that may be continued, in memory that nobody else
        writes to.
    eps
        The step size, a number or of a shape that broadcasts to the batch.
    orientation
        (B, n, n), the orientations at step 0, or None.
    start, resume
        The number of steps made before, and `Results.resume` of them.
    single
        True for a single step that nobody goes on from.
    """

    map: Map
    body: Body
    batch: tuple[int, ...]
    omega0: FloatArray
    eps: float | FloatArray
    steps: int
    save_every: int | None
    method: str = "auto"
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
        """The number of states that were kept before `start`."""
        return self.start // self.save_every + 1 if self.save_every and self.start else 0


@dataclass(slots=True)
class Results:
    """Arrays over the batch, see `Trajectories`; `resume` also has omega0, and R0 if it turns."""

    omega: FloatArray
    attitude: FloatArray | None
    final: FloatArray
    status: NDArray[np.int8]
    failed_at: NDArray[np.int64]
    resume: dict[str, NDArray[Any]]


def numbers_of_saved(steps: int, save_every: int | None) -> NDArray[np.int64]:
    """Return the numbers of all states that a run keeps."""
    return np.array([steps]) if save_every is None else np.arange(0, steps + 1, save_every)


def execute(
    run: Run,
    out: FloatArray | None = None,
    before: tuple[FloatArray, FloatArray | None] | None = None,
) -> Results:
    """Make the steps of a run; the states that are kept go to `out`, if there is one.

    Those kept before, and the orientations, are copied from `before`.
    """
    saved, turns = _room(run, run.rows, out)
    begin = run.rows_before
    if before is not None:
        for kept, array in zip(before, (saved, turns), strict=True):
            if array is not None and kept is not None:
                array[:begin] = kept[:begin]
    return _results(run, saved, turns, begin)


def go_on(run: Run) -> Results:
    """Make the steps of a run since its start; of the states that are kept, only those since."""
    return _results(run, *_room(run, run.rows - run.rows_before), 0)


def _room(
    run: Run, rows: int, out: FloatArray | None = None
) -> tuple[FloatArray | None, FloatArray | None]:
    """Return arrays for states and orientations that are kept, where they fit in memory."""
    size, D = run.omega0.shape
    shape, turned = (rows, *run.batch, D), run.orientation
    saves = out is None and run.save_every is not None
    numbers = (4 + rows * saves) * size * D  # arrays of the size of a state beside them
    if turned is not None:
        numbers += rows * turned.size
    require(8 * numbers, "the states kept are {}: raise save_every or cut the batch", shape)
    turns = None if turned is None else np.empty((*shape[:-1], *turned.shape[1:]))
    return np.empty(shape) if saves else out, turns


def _results(run: Run, saved: FloatArray | None, turns: FloatArray | None, begin: int) -> Results:
    """Make the steps, and fill what is kept from row `begin` on."""
    batch, every, (size, D) = run.batch, run.save_every, run.omega0.shape
    parameters = run.map.parameters(run.body, run.eps, batch)
    eps, rows, turned = parameters[-1], _no_rows(D), _no_rows(D + 1, D + 1)
    if saved is not None and every is not None:
        rows = saved.reshape((len(saved), size, D))[begin:]
    if turns is not None:
        eps = flat_parameter(run.eps, batch)
        turned = turns.reshape((len(turns), size, D + 1, D + 1))[begin:]
    final, status, failed_at, resume = run.map.run(
        Problem(
            run.method,
            run.omega0,
            parameters,
            eps,
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
    )
    if saved is not None and every is not None and len(saved) and run.steps % every == 0:
        final = saved[-1]
    else:
        final = final.reshape((*batch, D))
    if saved is None:
        saved = final[np.newaxis]
    elif every is None:
        saved[0] = final
    resume["omega0"] = run.omega0
    if run.orientation is not None:
        resume["R0"] = run.orientation
    return Results(saved, turns, final, status.reshape(batch), failed_at.reshape(batch), resume)


@lru_cache
def _no_rows(*shape: int) -> FloatArray:
    return np.empty((0, 0, *shape))
