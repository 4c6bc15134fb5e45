"""Runs from checked arguments: the arrays of a run, how it goes on, and the report of failures."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray, first_index, spell, warn
from ..engine.arguments import States, checked_out
from ..engine.memory import require
from ..engine.progress import Progress, reporter
from ..engine.status import SingularStepWarning, Status
from ..engine.stretches import NO_TURNS, March
from ..maps import Map

OnSingular = Literal["warn", "raise", "ignore"]
ON_SINGULAR = "warn", "raise", "ignore"


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


def attributes_of_run(
    map: Map,
    states: States,
    march: March,
    method: str,
    steps: int,
    save_every: int | None,
    progress: Progress = None,
    out: FloatArray | None = None,
    earlier: Any = None,
) -> dict[str, Any]:
    """Go on to state `steps`; return the attributes of `Trajectories`, with states of `earlier`."""
    batch, (size, D) = states.batch, march.omega0.shape
    rows, every = (steps // save_every + 1, save_every) if save_every else (1, 0)
    shape, n = (rows, *batch, D), 0 if march.turned is None else D + 1
    numbers = rows * size * (D * (out is None) + n * n) + 4 * size * D
    require(8 * numbers, f"the saved states are {shape}: raise save_every or divide the batch")
    saved = np.empty(shape) if out is None else checked_out(out, shape)
    if out is not None:  # it may overlap state 0
        march.omega0 = march.omega0.copy()
    turns = np.empty((rows, *batch, n, n)) if n else None
    row = 0
    if every and earlier is not None:
        row = len(earlier.states)
        saved[:row] = earlier.states
        if turns is not None:
            turns[:row] = earlier.attitude
    flat = saved.reshape(rows, size, D)
    flat_turns = NO_TURNS if turns is None else turns.reshape(rows, size, n, n)
    if progress:
        start = march.n
        with reporter(progress, steps - start) as report:
            march.to(steps, flat, every, row, flat_turns, lambda n: report(n - start))
    else:  # a context would take a tenth of a small call
        march.to(steps, flat, every, row, flat_turns)
    if not every:
        flat[0] = march.final
        if turns is not None:
            flat_turns[0] = march.turned
    return {
        "states": saved,
        "eps": states.eps,
        "body": states.body,
        "status": march.status.reshape(batch),
        "failed_at": march.failed_at.reshape(batch),
        "final": march.final.reshape(shape[1:]),
        "method": method,
        "steps": steps,
        "save_every": save_every,
        "attitude": turns,
        "_map": map,
        "_carry": march.carry,
        "_turned": march.turned,
    }


def report_failures(run: Any, on_singular: OnSingular, since: int = 0) -> None:
    """Warn of trajectories that failed at step `since` or later, or raise an error, once."""
    if on_singular == "ignore" or not (message := failures(run.status, run.failed_at, since)):
        return
    if on_singular == "raise":
        raise SingularStepError(message, run)
    warn(message, SingularStepWarning)


def failures(status: NDArray[np.int8], failed_at: NDArray[np.int64], since: int) -> str:
    """Return a count of the trajectories that failed at step `since` or later, "" if none did."""
    if (status.item() if status.size == 1 else status.min(initial=0)) >= 0:
        return ""
    failed, parts = failed_at >= since, []
    for code, what in ((Status.SINGULAR, "singular step"), (Status.NONFINITE, "non-finite step")):
        of_code = failed & (status == code)
        if of_code.any():
            index = first_index(of_code)
            parts.append(
                f"{np.count_nonzero(of_code)} of {failed.size} trajectories: {what}, "
                f"first: {spell(index)} at step {failed_at[index]}"
            )
    return "; ".join(parts)
