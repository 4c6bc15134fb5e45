"""A run of a map: a problem, a span of steps, and the output that drivers fill."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._checks import EXACT, FloatArray, wrong
from .._kernels import codes
from .arguments import BodyOrField, States
from .layout import flat_arrays
from .memory import require
from .progress import Progress, reporter

if TYPE_CHECKING:
    from .._maps import Map

Indices = NDArray[np.intp]
Resume = Mapping[str, NDArray[Any]]
# Numbers of states that `in_turn` copies at a time.
_COPIED = 2**20
NONE: Indices = np.empty(0, np.intp)


class Problem(NamedTuple):
    """A batch of B trajectories of a map, and how to compute them."""

    map: Map
    body: BodyOrField
    batch: tuple[int, ...]  # its shape
    omega0: FloatArray  # (B, D), the states at step 0
    eps: float | FloatArray  # of a shape that broadcasts to the batch
    parameters: tuple[Any, ...]  # of `Map.parameters`: arrays (B, ...) or (1, ...)
    method: str
    orientation: FloatArray | None  # (B, n, n), at step 0
    threads: int | None
    continued: bool  # False for a single step that no other follows
    # Takes the number of steps done so far. The closed form does not call it, nor do drivers of
    # trajectories that another one left.
    progress: Callable[[int], object] | None = None

    @property
    def size(self) -> int:
        return len(self.omega0)

    def take(self, chosen: Indices) -> Problem:
        def of(array: FloatArray) -> FloatArray:
            return array if len(array) == 1 else array[chosen]

        return self._replace(
            batch=chosen.shape,
            omega0=self.omega0[chosen],
            parameters=tuple(map(of, self.parameters)),
            orientation=None if self.orientation is None else self.orientation[chosen],
            progress=None,
        )


def problem_of(map: Map, states: States, method: str = "auto", continued: bool = True) -> Problem:
    """Return the problem of states at step 0; if it may be continued, with copies of all."""
    body, omega0, eps, batch, threads, _, orientation = states
    omega0, parameters = flat_arrays(omega0, batch), map.parameters(body, eps, batch)
    if orientation is not None:
        orientation = flat_arrays(orientation, batch, 2).copy()
    if continued:
        omega0, eps = omega0.copy(), eps if type(eps) is float else np.array(eps)
    return Problem(
        map, body, batch, omega0, eps, parameters, method, orientation, threads, continued
    )


class Span(NamedTuple):
    """Steps after state `start`, up to state `steps`; every so many states are saved, or none."""

    start: int
    steps: int
    save_every: int | None
    every: int  # steps between saved states, more than `steps` if none are saved
    rows_before: int  # states saved before this span
    rows: int  # states saved in it, with state 0 if it starts there
    resume: Resume  # `Output.resume` of the span up to state `start`, if that is not 0

    @property
    def saves_last(self) -> bool:
        """True if the last state is one of the saved ones."""
        return self.rows > 0 and self.steps % self.every == 0


def span_of(
    steps: int, save_every: int | None, start: int = 0, resume: Resume | None = None
) -> Span:
    if save_every is None:
        return Span(start, steps, None, steps + 1, 0, 0, resume or {})
    before = start // save_every + 1 if start else 0
    rows = steps // save_every + 1 - before
    return Span(start, steps, save_every, save_every, before, rows, resume or {})


ONE_STEP = span_of(1, None)


class Output(NamedTuple):
    """The results of a span, flat for drivers, and in the shape of the batch for users."""

    saved: FloatArray  # (rows, B, D)
    turns: FloatArray | None  # (rows, B, n, n); without saved states a row for the last orientation
    final: FloatArray  # (B, D), the last state; NaN if it does not exist
    status: NDArray[np.int8]  # (B,)
    failed_at: NDArray[np.int64]  # the first state that does not exist, or -1
    resume: dict[str, NDArray[Any]]  # arrays from which the run can be continued

    @classmethod
    def empty(
        cls, problem: Problem, span: Span, states: FloatArray, turns: FloatArray | None
    ) -> Output:
        """Return an output that is not filled; without saved states, `states` is the last."""
        is_last = span.save_every is None or span.saves_last
        final, size = states[-1] if is_last else np.empty(problem.omega0.shape), problem.size
        status, failed_at = np.empty(size, np.int8), np.empty(size, np.int64)
        status.fill(codes.NOT_COMPUTED)
        failed_at.fill(-1)
        return cls(states[: span.rows], turns, final, status, failed_at, {})

    @property
    def worst(self) -> int:
        """The least status, negative if a trajectory failed; at most 0."""
        status = self.status
        return min(status.item(), 0) if status.size == 1 else int(status.min(initial=0))

    def with_status(self, code: int) -> Indices:
        """Return the trajectories with this status, the least of all that occur."""
        return np.flatnonzero(self.status == code) if self.worst == code else NONE

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
Driver = Callable[[Problem, Span, Output], Indices]


def numbers_of_saved(steps: int, save_every: int | None) -> NDArray[np.int64]:
    """Return the indices of all saved states."""
    return np.array([steps]) if save_every is None else np.arange(0, steps + 1, save_every)


def in_turn(
    drivers: Sequence[Driver], problem: Problem, span: Span, output: Output, from_0: bool = False
) -> None:
    """Let each driver compute the trajectories that those before it left.

    With `from_0`, the first driver leaves trajectories that the others compute from step 0 on; they
    are not continued.
    """
    first, *others = drivers
    left = first(problem, span, output)
    if not left.size:
        return
    if from_0:
        span = span_of(span.steps, span.save_every)
    together = max(_COPIED // (problem.omega0.shape[1] * (span.rows + 1)), 1)
    for driver in others:
        computing, left = left, NONE
        for begin in range(0, computing.size, together):
            some = computing[begin : begin + together]
            chosen, rows = problem.take(some), span.rows or 1
            turned = chosen.orientation
            turns = None if turned is None else np.empty((rows, *turned.shape))
            part = Output.empty(chosen, span, np.empty((rows, *chosen.omega0.shape)), turns)
            resume = {name: array[some] for name, array in span.resume.items()}
            rest = driver(chosen, span._replace(resume=resume), part)
            if from_0:
                part.resume.clear()
            output.put(some, part)
            left = np.append(left, some[rest]) if rest.size else left


def execute(
    problem: Problem,
    span: Span,
    progress: Progress = None,
    out: FloatArray | None = None,
    before: tuple[FloatArray, FloatArray | None] | None = None,
) -> Output:
    """Compute a span; return results in the batch shape.

    Saved states are written to `out` if given; those saved earlier are copied from `before`.
    """
    (size, D), batch, orientation = problem.omega0.shape, problem.batch, problem.orientation
    earlier = 0 if before is None else span.rows_before
    rows = earlier + span.rows if span.save_every else 1
    shape = rows, *batch, D
    # Besides the saved states: omega0, the last state, and up to 2 D numbers to go on from.
    numbers = (4 + rows * (out is None and span.save_every is not None)) * size * D
    if orientation is not None:
        numbers += rows * orientation.size
    require(8 * numbers, "the saved states are {}: raise save_every or divide the batch", shape)
    if span.steps > EXACT:  # numbers of steps are floats in the closed form
        raise wrong("steps", "at most 2**53", span.steps)
    states = np.empty(shape) if out is None else out
    flat, turns, flat_turns = states.reshape(rows, size, D), None, None
    if orientation is not None:
        turns = np.empty((rows, *batch, D + 1, D + 1))
        flat_turns = turns.reshape(rows, size, D + 1, D + 1)[earlier:]
    if before is not None:
        states[:earlier], flat = before[0][:earlier], flat[earlier:]
        if turns is not None and before[1] is not None:
            turns[:earlier] = before[1][:earlier]
    output = Output.empty(problem, span, flat, flat_turns)
    if progress:
        with reporter(progress, span.steps - span.start) as report:
            problem.map.run(problem._replace(progress=report), span, output)
    else:  # a context and a second problem would take a tenth of a single step
        problem.map.run(problem, span, output)

    _, _, final, status, failed_at, resume = output
    if output.worst == codes.NOT_COMPUTED:
        raise RuntimeError("internal error: a kernel skipped trajectories; please report this")
    if resume:
        resume |= {"status": status, "failed_at": failed_at}
    resume["omega0"] = problem.omega0
    if orientation is not None:
        resume["R0"] = orientation
    # The last state is that saved, also if a span of no steps follows.
    last_is_saved = rows > 0 and span.steps % span.every == 0
    final = states[-1] if last_is_saved else final.reshape(shape[1:])
    status, failed_at = status.reshape(batch), failed_at.reshape(batch)
    return Output(states, turns, final, status, failed_at, resume)
