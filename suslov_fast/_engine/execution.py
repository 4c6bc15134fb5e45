"""A run of a map: a problem, a span of steps, and the output that drivers fill."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._checks import EXACT, FloatArray, wrong
from .._kernels import codes
from .arguments import BodyOrField
from .layout import flat_parameter
from .memory import require
from .parts import Report
from .progress import Progress, reporter

if TYPE_CHECKING:
    from .._maps.record import Map

Indices = NDArray[np.intp]
Resume = Mapping[str, NDArray[Any]]
# Numbers of states that `in_turn` copies at a time.
_TOGETHER = 2**20
# Copying an array is faster than filling a new one.
_ONE_NOT_COMPUTED = np.full(1, codes.NOT_COMPUTED, np.int8)
NONE: Indices = np.empty(0, np.intp)


class Problem(NamedTuple):
    """A batch of B trajectories of a map.

    Attributes
    ----------
    batch
        The shape of the batch.
    omega0
        (B, D), the states at step 0; of a run that may be continued, in memory not shared
        with the caller.
    eps
        The step size, a number or of a shape that broadcasts to the batch.
    orientation
        (B, n, n), the orientations at step 0, or None.
    parameters
        What `Map.parameters` returns: parameters of the body and eps, (B, ...) or (1, ...).
    time_step
        eps in the unit of time of omega, (B,) or (1,); None without an orientation.
    """

    map: Map
    body: BodyOrField
    batch: tuple[int, ...]
    omega0: FloatArray
    eps: float | FloatArray
    method: str
    orientation: FloatArray | None
    parameters: tuple[Any, ...]
    time_step: FloatArray | None

    @property
    def size(self) -> int:
        """The number of trajectories."""
        return len(self.omega0)

    def take(self, chosen: Indices) -> Problem:
        """Return the problem of some of the trajectories."""

        def of(array: FloatArray | None) -> FloatArray | None:
            return array if array is None or len(array) == 1 else array[chosen]

        return self._replace(
            batch=chosen.shape,
            omega0=self.omega0[chosen],
            orientation=None if self.orientation is None else self.orientation[chosen],
            parameters=tuple(map(of, self.parameters)),
            time_step=of(self.time_step),
        )


def problem_of(
    map: Map,
    body: BodyOrField,
    batch: tuple[int, ...],
    omega0: FloatArray,
    eps: float | FloatArray,
    method: str = "auto",
    orientation: FloatArray | None = None,
) -> Problem:
    """Return a problem, with the parameters for kernels."""
    time_step = None if orientation is None else flat_parameter(eps, batch)
    parameters = map.parameters(body, eps, batch)
    return Problem(map, body, batch, omega0, eps, method, orientation, parameters, time_step)


class Span(NamedTuple):
    """Steps after state `start`, up to state `steps`; every so many states are saved, or none."""

    start: int
    steps: int
    save_every: int | None

    @property
    def every(self) -> int:
        """The number of steps between saved states, more than `steps` if none are saved."""
        return self.save_every or self.steps + 1

    @property
    def rows(self) -> int:
        """The number of saved states of a trajectory since state 0; if none are saved, the last."""
        return 1 if self.save_every is None else self.steps // self.save_every + 1

    @property
    def rows_before(self) -> int:
        """The number of states saved before this span."""
        return self.start // self.save_every + 1 if self.save_every and self.start else 0

    @property
    def rows_saved(self) -> int:
        """The number of states saved in this span, with state 0 if it starts there."""
        return 0 if self.save_every is None else self.rows - self.rows_before

    @property
    def saves_last(self) -> bool:
        """True if the last state is one of the saved ones."""
        return self.rows_saved > 0 and self.steps % self.every == 0


class Options(NamedTuple):
    """Options of a computation; `report` takes the number of steps done so far.

    Attributes
    ----------
    continued
        False for a single step that no other follows.
    """

    threads: int | None = None
    report: Report | None = None
    continued: bool = True


class Output(NamedTuple):
    """The results of a span, flat for drivers, and in the shape of the batch for users.

    Attributes
    ----------
    saved, turns
        (rows, B, D) and (rows, B, n, n), the saved states and orientations. Without saved states,
        `turns` has a row for the last orientation.
    final
        (B, D), the last state; NaN if it does not exist.
    status, failed_at
        (B,), a code, and if that is negative, the index of the first state that does not exist.
    resume
        Arrays from which the run can be continued, by name.
    """

    saved: FloatArray
    turns: FloatArray | None
    final: FloatArray
    status: NDArray[np.int8]
    failed_at: NDArray[np.int64]
    resume: dict[str, NDArray[Any]]

    def put(self, chosen: Indices, part: Output) -> None:
        """Take over the results of some trajectories, of their last rows if they have more."""
        for whole, rows in ((self.saved, part.saved), (self.turns, part.turns)):
            if whole is not None and rows is not None and len(whole):
                whole[:, chosen] = rows[len(rows) - len(whole) :]
        self.final[chosen] = part.final
        self.status[chosen], self.failed_at[chosen] = part.status, part.failed_at
        for name, array in part.resume.items():
            if name not in self.resume:
                size = len(self.status)
                self.resume[name] = np.zeros((size, *array.shape[1:]), array.dtype)
            self.resume[name][chosen] = array


# Fills the output of a problem; returns the indices of the trajectories that it cannot compute.
Driver = Callable[[Problem, Span, Resume, Output, Options], Indices]


def not_computed(size: int) -> NDArray[np.int8]:
    """Return the initial statuses for a kernel."""
    return _ONE_NOT_COMPUTED.copy() if size == 1 else np.full(size, codes.NOT_COMPUTED, np.int8)


@lru_cache
def _no_failures(size: int) -> NDArray[np.int64]:
    """Return `failed_at` for no failures: -1, read-only, without memory per trajectory."""
    return np.ndarray((size,), np.int64, b"\xff" * 8, 0, (0,))


def worst(status: NDArray[np.int8]) -> int:
    """Return the least status, negative if a trajectory failed; at most 0."""
    return min(status.item(), 0) if status.size == 1 else int(status.min(initial=0))


def with_status(status: NDArray[np.int8], code: int) -> Indices:
    """Return the trajectories whose status is this code, the least of all codes that occur."""
    return np.flatnonzero(status == code) if worst(status) == code else NONE


def numbers_of_saved(steps: int, save_every: int | None) -> NDArray[np.int64]:
    """Return the indices of all saved states."""
    return np.array([steps]) if save_every is None else np.arange(0, steps + 1, save_every)


def _output(
    problem: Problem,
    span: Span,
    saved: FloatArray,
    turns: FloatArray | None,
    final: FloatArray | None = None,
) -> Output:
    """Return an output that no driver has filled."""
    size = problem.size
    if final is None:
        final = saved[-1] if span.saves_last else np.empty(problem.omega0.shape)
    return Output(saved, turns, final, not_computed(size), np.empty(size, np.int64), {})


def in_turn(
    drivers: Sequence[Driver],
    problem: Problem,
    span: Span,
    resume: Resume,
    output: Output,
    options: Options,
    from_0: bool = False,
) -> None:
    """Let each driver compute the trajectories that those before it left.

    With `from_0`, the first driver leaves trajectories that the others compute from step 0 on; they
    are not continued.
    """
    first, *others = drivers
    left = first(problem, span, resume, output, options)
    if not left.size:
        return
    if from_0:
        span, resume = span._replace(start=0), {}
    options, rows = options._replace(report=None), span.rows_saved
    together = max(_TOGETHER // (problem.omega0.shape[1] * (rows + 1)), 1)
    for driver in others:
        computing, left = left, NONE
        for begin in range(0, computing.size, together):
            some = computing[begin : begin + together]
            chosen = problem.take(some)
            saved, turned = np.empty((rows, *chosen.omega0.shape)), chosen.orientation
            turns = None if turned is None else np.empty((rows or 1, *turned.shape))
            part = _output(chosen, span, saved, turns)
            known = {name: array[some] for name, array in resume.items()}
            missing = driver(chosen, span, known, part, options)
            if from_0:
                part.resume.clear()
            output.put(some, part)
            left = np.append(left, some[missing]) if missing.size else left


def execute(
    problem: Problem,
    span: Span,
    options: Options = Options(),  # noqa: B008  (it is not mutable)
    progress: Progress = None,
    resume: Resume | None = None,
    out: FloatArray | None = None,
    before: tuple[FloatArray, FloatArray | None] | None = None,
) -> Output:
    """Compute a span from state 0 on, or go on from `resume`; return results in the batch shape.

    Saved states are written to `out` if given. Those saved earlier are copied from `before`;
    without it, only those of the span are returned.
    """
    whole = before is not None or not span.start
    begin = span.rows_before if whole else 0
    states, turns = _room(problem, span, begin, out)
    if span.steps > EXACT:  # numbers of steps are floats in the closed form
        raise wrong("steps", "at most 2**53", span.steps)
    if before is not None:
        for earlier, array in zip(before, (states, turns), strict=True):
            if earlier is not None and array is not None:
                array[:begin] = earlier[:begin]
    (size, D), total = problem.omega0.shape, span.steps - span.start
    flat, last = states.reshape(len(states), size, D), None
    if span.save_every is None:
        flat, last = flat[:0], flat[0]
    flat_turns = None if turns is None else turns.reshape(len(turns), size, D + 1, D + 1)[begin:]
    output = _output(problem, span, flat[begin:], flat_turns, last)
    if progress:
        with reporter(progress, total) as report:
            options = options._replace(report=report)
            problem.map.run(problem, span, resume or {}, output, options)
            report(total)
    else:
        problem.map.run(problem, span, resume or {}, output, options)
    return _shaped(problem, span, output, states, turns)


def _room(
    problem: Problem, span: Span, begin: int, out: FloatArray | None
) -> tuple[FloatArray, FloatArray | None]:
    """Return arrays for saved states and orientations; MemoryError if they do not fit."""
    size, D = problem.omega0.shape
    rows = begin + span.rows_saved if span.save_every else 1
    shape, turned = (rows, *problem.batch, D), problem.orientation
    numbers = (4 + rows * (out is None and span.save_every is not None)) * size * D
    if turned is not None:
        numbers += rows * turned.size
    require(8 * numbers, "the saved states are {}: raise save_every or divide the batch", shape)
    turns = None if turned is None else np.empty((*shape[:-1], *turned.shape[1:]))
    return np.empty(shape) if out is None else out, turns


def _shaped(
    problem: Problem, span: Span, output: Output, states: FloatArray, turns: FloatArray | None
) -> Output:
    """Return the results in the shape of the batch, with what is needed to go on."""
    _, _, final, status, failed_at, resume = output
    least, batch = worst(status), problem.batch
    if least == codes.NOT_COMPUTED:
        raise RuntimeError("internal error: a kernel skipped trajectories; please report this")
    if least < 0:
        failed_at[status >= 0] = -1
    else:
        failed_at = _no_failures(problem.size)
    if resume:
        resume["status"], resume["failed_at"] = status, failed_at
    resume["omega0"] = problem.omega0
    if problem.orientation is not None:
        resume["R0"] = problem.orientation
    final = final.reshape((*batch, problem.omega0.shape[1]))
    if len(states) and span.steps % span.every == 0:
        final = states[-1]
    return Output(states, turns, final, status.reshape(batch), failed_at.reshape(batch), resume)
