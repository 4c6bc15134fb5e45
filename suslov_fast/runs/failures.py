"""The report of failed trajectories: one warning, or one error, for all."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from ..checks import first_index, spell, warn
from ..engine.status import SingularStepWarning, Status

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


def report_failures(run: Any, on_singular: OnSingular, since: int = 0) -> None:
    """Warn of trajectories of a run, or a march, that failed at step `since` or later, or raise."""
    status, failed_at = run.status, run.failed_at
    if (status.item() if status.size == 1 else status.min(initial=0)) >= 0:
        return
    failed, parts = failed_at >= since, []
    for code, what in ((Status.SINGULAR, "singular step"), (Status.NONFINITE, "non-finite step")):
        of_code = failed & (status == code)
        if of_code.any():
            index = first_index(of_code)
            parts.append(
                f"{np.count_nonzero(of_code)} of {failed.size} trajectories: {what}, "
                f"first: {spell(index)} at step {failed_at[index]}"
            )
    message = "; ".join(parts)
    if message and on_singular == "raise":
        raise SingularStepError(message, run)
    if message and on_singular == "warn":
        warn(message, SingularStepWarning)
