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
    """Some trajectories of :func:`iterate` failed, and ``on_singular="raise"`` was passed.

    Attributes
    ----------
    trajectories : Trajectories
        The whole run, with the trajectories that did not fail, too.

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


def report_failures(run: Any, batch_run: Any, on_singular: OnSingular) -> None:
    """Warn of passed poles; warn of failed trajectories, or raise an error that contains the run.

    `batch_run` is the `BatchRun` that has computed the run.
    """
    status, failed_at = run.status, run.failed_at
    if on_singular == "ignore" or not np.count_nonzero(status):
        return
    report_poles(batch_run.problem, status, failed_at, batch_run.by_sign)
    texts = []
    for code, cause in ((Status.SINGULAR, "singular step"), (Status.NONFINITE, "non-finite step")):
        failed = status == code
        if failed.any():
            index = first_index(failed)
            texts.append(
                f"{np.count_nonzero(failed)} of {failed.size} trajectories: {cause}, "
                f"first: {spell(index)} at step {failed_at[index]}"
            )
    passed = (status < 0) & (run.first_pole >= 0)
    if passed.any():
        why = "eps is too long"
        why += ", or the motion escapes" if batch_run.problem.body._may_escape else ""
        texts.append(f"{np.count_nonzero(passed)} of them had passed a pole before: {why}")
    if texts and on_singular == "raise":
        raise SingularStepError("; ".join(texts), run)
    if texts:
        warn("; ".join(texts), IntegrationWarning)
