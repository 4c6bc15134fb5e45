"""Statuses of trajectories, and the one warning, or error, for all that failed."""

from enum import IntEnum
from typing import Any, Literal

import numpy as np

from ..checks import first_index, spell, warn
from ..core import codes

OnSingular = Literal["warn", "raise", "ignore"]
ON_SINGULAR = "warn", "raise", "ignore"


class Status(IntEnum):
    """Final status of a trajectory: negative if it failed, positive if it finished with a caveat.

    Examples
    --------
    >>> from suslov_fast import Status
    >>> Status.SINGULAR.message
    'singular step: the state lies on a pole of the map and has no next state'
    """

    OK = codes.OK
    SUPERCRITICAL = codes.SUPERCRITICAL
    PASSED_POLE = codes.PASSED_POLE
    SINGULAR = codes.SINGULAR
    NONFINITE = codes.NONFINITE

    @property
    def message(self) -> str:
        """The meaning of the status, as a sentence."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.OK: "finished",
    Status.SUPERCRITICAL: (
        "finished, but t >= 1: the step is too long for the orbit to follow the continuous motion; "
        "choose a smaller eps if it should"
    ),
    Status.PASSED_POLE: (
        "finished, but a step was from det A < 0: the motion escapes to infinity before, and the "
        "states beyond are those of the map alone; or eps is too long"
    ),
    Status.SINGULAR: "singular step: the state lies on a pole of the map and has no next state",
    Status.NONFINITE: "non-finite step: the next state is beyond the range of float64",
}


class SingularStepWarning(RuntimeWarning):
    """Some trajectories of a batch failed before their last step."""


class PoleWarning(RuntimeWarning):
    """Some trajectories of a batch took a step from a state with det A < 0.

    A(x) = 1 - (eps / 2) f'(x) has a positive determinant along a motion that the steps resolve.
    Where it is negative an odd number of real eigenvalues of f' are above 2 / eps: the motion
    escapes to infinity, and the map comes back from the other side; or eps is too long. An even
    number is not seen.
    """


class SingularStepError(ArithmeticError):
    """Some trajectories of a batch failed before their last step.

    Attributes
    ----------
    trajectories : Trajectories
        The finished batch of :func:`iterate`, including failed trajectories.
    crossings : Crossings
        The result of :func:`crossings`, in place of `trajectories`.
    """

    trajectories: Any = None
    crossings: Any = None

    def __init__(self, message: str, result: Any, name: str = "trajectories") -> None:
        super().__init__(message)
        self.result, self.name = result, name
        setattr(self, name, result)

    def __reduce__(self) -> tuple[type, tuple[str, Any, str]]:
        return type(self), (str(self), self.result, self.name)


def report_failures(
    run: Any, on_singular: OnSingular, since: int = 0, name: str = "trajectories"
) -> None:
    """Warn of trajectories of a run, or a march, that failed at step `since` or later, or raise.

    The error holds the run as its attribute `name`. Poles that were passed are a warning at most.
    """
    status, failed_at = run.status, run.failed_at
    if on_singular != "ignore":
        report_poles(run, run.body if hasattr(run, "body") else run.problem.body, since)
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
        raise SingularStepError(message, run, name)
    if message and on_singular == "warn":
        warn(message, SingularStepWarning)


def report_poles(run: Any, body: Any, since: int = 0) -> None:
    """Warn of trajectories of a body that passed a pole at step `since` or later."""
    passed = (run.status == Status.PASSED_POLE) & (run.failed_at >= since)
    if passed.any():
        index = first_index(passed)
        why = "the motion escapes to infinity, or eps" if body._may_escape else "eps"
        warn(
            f"{np.count_nonzero(passed)} of {passed.size} trajectories: a step from det A < 0: "
            f"{why} is too long (an eigenvalue of f' above 2/eps); "
            f"first: {spell(index)} at step {run.failed_at[index]}",
            PoleWarning,
        )
