"""The report of failed trajectories: one warning, or one error, for all."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

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
