"""One warning or error for all trajectories of a batch that failed."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from ..checks import first_index, spell, warn
from ..errors import SuslovError
from ..status import IntegrationWarning, Status, report_poles
from .result import States

OnSingular = Literal["warn", "raise", "ignore"]
ON_SINGULAR = "warn", "raise", "ignore"


class SingularStepError(SuslovError, ArithmeticError):
    """An error of :func:`iterate` with ``on_singular="raise"``: some trajectories failed.

    Attributes
    ----------
    trajectories : Trajectories
        The whole batch, also the trajectories that did not fail.

    Examples
    --------
    >>> from suslov_fast import Field, SingularStepError, iterate
    >>> try:
    ...     run = iterate(Field.from_terms([[[1]]]), [[-0.5], [1.0]], 1.0, 3, on_singular="raise")
    ... except SingularStepError as error:
    ...     print(error)
    ...     run = error.trajectories
    1 of 2 trajectories: singular step, first: 1 at step 1
    >>> run.status.tolist()
    [0, -1]
    """

    trajectories: States

    def __init__(self, message: str, trajectories: States) -> None:
        super().__init__(message)
        self.trajectories = trajectories

    def __reduce__(self) -> tuple[type, tuple[str, States]]:
        return type(self), (str(self), self.trajectories)


def report_failures(run: Any, batch_run: Any, on_singular: OnSingular, since: int = 0) -> None:
    """Warn that trajectories of a run failed at step `since` or later, or raise an error.

    `batch_run` has computed the run. Passed poles are a warning, even if failures are errors.
    """
    status, failed_at = run.status, run.failed_at
    if not (status.item() if status.size == 1 else status.any()):
        return
    if on_singular != "ignore":
        report_poles(batch_run.problem, status, failed_at, batch_run.by_sign)
    if status.min() >= 0:
        return
    texts = []
    for code, cause in ((Status.SINGULAR, "singular step"), (Status.NONFINITE, "non-finite step")):
        failed = (failed_at >= since) & (status == code)
        if failed.any():
            index = first_index(failed)
            texts.append(
                f"{np.count_nonzero(failed)} of {failed.size} trajectories: {cause}, "
                f"first: {spell(index)} at step {failed_at[index]}"
            )
    passed = (status < 0) & (failed_at >= since) & (run.first_pole >= 0)
    if texts and passed.any():
        why = "eps is too long"
        why += ", or the motion escapes" if batch_run.problem.body._may_escape else ""
        texts.append(f"{np.count_nonzero(passed)} of them had passed a pole before: {why}")
    message = "; ".join(texts)
    if message and on_singular == "raise":
        raise SingularStepError(message, run)
    if message and on_singular == "warn":
        warn(message, IntegrationWarning)
