"""Runs from checked arguments: the arrays of a run, how it goes on, and the report of failures."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray, first_index, spell, warn
from ..engine.arguments import States, checked_out
from ..engine.progress import Progress, reporter
from ..engine.status import SingularStepWarning, Status
from ..engine.stretches import March
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
    start, every = march.n, save_every or 0
    if out is not None:  # which may overlap state 0
        rows = steps // every + 1 if every else 1
        out = checked_out(out, (rows, *march.final.shape))
        march.omega0 = march.omega0.copy()
    if progress:
        with reporter(progress, steps - start) as report:
            saved, turns = march.to(steps, every, out, lambda n: report(n - start))
    else:  # a context would take a tenth of a small call
        saved, turns = march.to(steps, every, out)
    if every and earlier is not None:
        saved = np.concatenate([earlier.states, saved])
        turns = None if turns is None else np.concatenate([earlier.attitude, turns])
    return {
        "states": saved,
        "eps": states.eps,
        "body": states.body,
        "status": march.status,
        "failed_at": march.failed_at,
        "final": march.final,
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
