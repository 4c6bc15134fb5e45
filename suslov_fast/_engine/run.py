"""From a checked run to its results: memory, the loops, and how a run is gone on with."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .._core.formulas.full_map import full_coefficients
from . import iterate_3d, iterate_full, jump_nd
from .arguments import Body
from .layout import flat_parameter
from .memory import require
from .problem import Problem
from .progress import Progress


@dataclass(slots=True)  # not frozen: that would take longer than a short run
class Run:
    """A run of the map that is asked for, checked.

    Attributes
    ----------
    omega0
        (B, D), the states at step 0, in memory that nobody else writes to.
    eps
        The step size, () or of a shape that broadcasts to the batch.
    orientation
        (B, n, n), the orientations at step 0, or None.
    start
        The number of steps that were made before.
    resume
        What they left.
    dimension
        The number of components of a state.
    shape
        The shape of the states that are kept.
    """

    body: Body
    batch: tuple[int, ...]
    omega0: FloatArray
    eps: FloatArray
    steps: int
    save_every: int | None
    method: str
    orientation: FloatArray | None = None
    start: int = 0
    resume: dict[str, NDArray[Any]] = field(default_factory=dict)
    threads: int | None = None
    progress: Progress = None
    dimension: int = field(init=False)
    shape: tuple[int, ...] = field(init=False)

    def __post_init__(self) -> None:
        rows = 1 if self.save_every is None else self.steps // self.save_every + 1
        self.dimension = int(self.omega0.shape[-1])
        self.shape = (rows, *self.batch, self.dimension)

    @property
    def rows_before(self) -> int:
        """How many of them were kept before."""
        if self.save_every is None or self.start == 0:
            return 0
        return self.start // self.save_every + 1


def numbers_of_saved(steps: int, save_every: int | None) -> NDArray[np.int64]:
    """The numbers of all states that a run keeps."""
    if save_every is None:
        return np.array([steps])
    return np.arange(0, steps + 1, save_every)


class Results(NamedTuple):
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
    saved, turns = _room(run, run.shape[0], out)
    begin = run.rows_before
    if before is not None and begin:
        for kept, array in zip(before, (saved, turns), strict=True):
            if array is not None:
                array[:begin] = kept
    new = [None if array is None else array[begin:] for array in (saved, turns)]
    return _results(run, _problem(run, *new), saved, turns)


def go_on(run: Run) -> Results:
    """Make the steps of a run since its start; of the states that are kept, only those since."""
    saved, turns = _room(run, run.shape[0] - run.rows_before)
    return _results(run, _problem(run, saved, turns), saved, turns)


def _room(
    run: Run, rows: int, out: FloatArray | None = None
) -> tuple[FloatArray | None, FloatArray | None]:
    """Arrays for so many states that are kept, and for the orientations."""
    _require_memory(run, rows, out is None)
    saved, turns = out, None
    if saved is None and run.save_every is not None:
        saved = np.empty((rows, *run.shape[1:]))
    if run.orientation is not None:
        n = run.dimension + 1
        turns = np.empty((rows, *run.batch, n, n))
    return saved, turns


def _results(
    run: Run, problem: Problem, saved: FloatArray | None, turns: FloatArray | None
) -> Results:
    if run.method == "full":
        final, status, failed_at, resume = iterate_full.run(problem)
    elif isinstance(run.body, Suslov3D):
        final, status, failed_at, resume = iterate_3d.run(problem)
    else:
        final, status, failed_at, resume = jump_nd.run(problem, run.body, run.batch)
    final = final.reshape((*run.batch, run.dimension))
    if saved is None:
        saved = final[np.newaxis]
    elif run.save_every is None:
        saved[0] = final
    elif run.steps % run.save_every == 0 and len(saved):
        final = saved[-1]
    return Results(
        omega=saved,
        attitude=turns,
        final=final,
        status=status.reshape(run.batch),
        failed_at=failed_at.reshape(run.batch),
        resume=_beside(run, resume),
    )


def _beside(run: Run, resume: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """What the loops left to go on from, with what the run began with."""
    begin = {"omega0": run.omega0}
    if run.orientation is not None:
        begin["R0"] = run.orientation
    if run.method == "full":
        begin["I3"] = run.resume["I3"]
    return resume | begin


def _require_memory(run: Run, rows: int, saves: bool) -> None:
    """Refuse a run that does not fit, with what it takes beside the states that are kept."""
    D = run.dimension
    kept = rows * math.prod(run.batch)
    numbers = 4 * D * math.prod(run.batch)
    if saves and run.save_every is not None:
        numbers += D * kept
    if run.orientation is not None:
        numbers += (D + 1) ** 2 * kept
    require(8 * numbers, f"the states kept are {run.shape}: raise save_every or cut the batch")


def _parameters(run: Run) -> list[FloatArray]:
    if run.method != "full":
        return run.body.flat_normalised(run.batch)
    given = [
        flat_parameter(np.asarray(each), run.batch) for each in (*run.body.parameters, run.eps)
    ]
    with np.errstate(all="ignore"):
        coefficients = full_coefficients(*given, run.resume["I3"])
    size = len(run.omega0)
    return [np.stack([np.broadcast_to(each, (size,)) for each in coefficients])]


def _problem(run: Run, saved: FloatArray | None, turns: FloatArray | None) -> Problem:
    """The flat problem; `saved` and `turns` receive what is kept from its start on."""
    body, size, D = run.body, math.prod(run.batch), run.dimension
    keeps = saved is not None and run.save_every is not None
    rows = run.shape[0] - run.rows_before
    return Problem(
        method=run.method,
        omega=run.omega0,
        parameters=_parameters(run),
        eps=flat_parameter(body.normalised_eps(run.eps), run.batch),
        time_step=flat_parameter(run.eps, run.batch),
        start=run.start,
        stop=run.steps,
        every=run.save_every or run.steps + 1,
        keeps=run.save_every is not None,
        saved=(
            saved.reshape(rows, size, D)  # type: ignore[union-attr]
            if keeps
            else np.empty((0, 0, D))
        ),
        turns=(
            np.empty((0, 0, D + 1, D + 1))
            if turns is None
            else turns.reshape(rows, size, D + 1, D + 1)
        ),
        orientation=run.orientation,
        resume=run.resume,
        threads=run.threads,
        progress=run.progress,
    )
