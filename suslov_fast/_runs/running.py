"""Checks of the last arguments of a run, its computation, and the report of failures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeVar

import numpy as np

from .._checks import FloatArray, first_index, integer, one_of, spell, warn
from .._engine.execution import ONE_STEP, execute
from .._engine.layout import checked_out
from .._engine.problem import Output, Problem, Span
from .._engine.progress import Progress, check_progress
from .._engine.status import SingularStepWarning, Status

OnSingular = Literal["warn", "raise", "ignore"]
Run = TypeVar("Run")


class SingularStepError(ArithmeticError):
    """Some trajectories of a batch failed before their last step.

    Attributes
    ----------
    trajectories : Trajectories
        The finished batch, including failed trajectories.
    """

    def __init__(self, message: str, trajectories: Any) -> None:
        super().__init__(message)
        self.trajectories = trajectories

    def __reduce__(self) -> tuple[type, tuple[str, Any]]:
        return type(self), (str(self), self.trajectories)


def compute_run(
    result: Callable[..., Run],
    problem: Problem,
    steps: int,
    save_every: int | None,
    on_singular: OnSingular,
    progress: Progress,
    out: FloatArray | None = None,
    earlier: Any = None,
) -> Run:
    """Check the other arguments of `iterate`, compute the run, from `earlier` on, and warn.

    `result` makes the run of its attributes.
    """
    one_of("on_singular", on_singular, ("warn", "raise", "ignore"))
    steps = integer("steps", steps, 0)
    if save_every is not None:
        save_every = integer("save_every", save_every, 1, "None or an integer of at least 1")
    check_progress(progress)
    span, before, since = Span(steps, save_every), None, 0
    if earlier is not None:
        start, before = earlier.steps, (earlier.states, earlier.attitude)
        span, since = Span(start + steps, save_every, start, earlier._resume), start + 1
    if out is not None:
        out = checked_out(out, (span.rows or 1, *problem.batch, problem.omega0.shape[1]))
    output = execute(problem, span, progress, out, before)
    run = result(
        states=output.saved,
        eps=problem.eps,
        body=problem.body,
        status=output.status,
        failed_at=output.failed_at,
        final=output.final,
        method=problem.method,
        steps=span.steps,
        save_every=span.save_every,
        attitude=output.turns,
        _map=problem.map,
        _resume=output.resume,
    )
    if on_singular != "ignore" and (message := failures(output, since)):
        if on_singular == "raise":
            raise SingularStepError(message, run)
        warn(message, SingularStepWarning)
    return run


def one_step(problem: Problem) -> FloatArray:
    """Return the next states, and warn of those that do not exist."""
    output = execute(problem, ONE_STEP)
    # Failures at step 0 are NaN in the input, which are not reported.
    if message := failures(output, 1):
        warn(message, SingularStepWarning)
    return output.final


def failures(output: Output, since: int) -> str:
    """Return a count of the trajectories that failed at step `since` or later, "" if none did."""
    if output.worst >= 0:
        return ""
    failed, parts = output.failed_at >= since, []
    for code, what in ((Status.SINGULAR, "singular step"), (Status.NONFINITE, "non-finite step")):
        of_code = failed & (output.status == code)
        if of_code.any():
            index = first_index(of_code)
            parts.append(
                f"{np.count_nonzero(of_code)} of {failed.size} trajectories: {what}, "
                f"first: {spell(index)} at step {output.failed_at[index]}"
            )
    return "; ".join(parts)
