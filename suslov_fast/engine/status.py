"""Statuses of trajectories, and one warning or error for all trajectories that failed."""

from enum import IntEnum
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..checks import first_index, spell, warn
from ..core import codes

OnSingular = Literal["warn", "raise", "ignore"]
ON_SINGULAR = "warn", "raise", "ignore"


class Status(IntEnum):
    """Final status of a trajectory: negative if it failed, positive if it finished with a caveat.

    `OK` (0) is a finished trajectory. `SINGULAR` and `NONFINITE` are negative: the last state has
    no next state, or none in the range of float64. `SUPERCRITICAL` and `PASSED_POLE` are positive:
    eps is too large for the orbit to follow the continuous motion. The first is for bodies in three
    dimensions, where the :func:`criticality` is 1 or more; the second for all others, see
    :class:`PoleWarning`. `message` says it in words.

    Examples
    --------
    >>> from suslov_fast import QuadraticField, Status, iterate
    >>> blow_up = QuadraticField([[[1]]])  # x' = x**2, whose map has a pole at x = 1 / eps
    >>> run = iterate(blow_up, [[-0.5], [1.0]], eps=1.0, steps=3, on_singular="ignore")
    >>> [Status(status).name for status in run.status]
    ['OK', 'SINGULAR']
    >>> Status(run.status[1]).message
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
        "finished, but t >= 1: eps is too large for the orbit to follow the continuous motion; "
        "choose a smaller eps if it should"
    ),
    Status.PASSED_POLE: (
        "finished, but took a step from det A < 0: the motion escapes to infinity, and later "
        "states are those of the map alone; or eps is too large"
    ),
    Status.SINGULAR: "singular step: the state lies on a pole of the map and has no next state",
    Status.NONFINITE: "non-finite step: the next state is beyond the range of float64",
}


class SingularStepWarning(RuntimeWarning):
    """Some trajectories of a batch failed before their last step.

    Their `status` is negative and tells why (:class:`Status`), `failed_at` is the number of the
    first missing state, and states are NaN from there on. Other trajectories are not affected. The
    argument ``on_singular`` of runs turns this warning into a :class:`SingularStepError`, or off.

    Examples
    --------
    >>> import warnings
    >>> from suslov_fast import QuadraticField, SingularStepWarning, iterate
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore", SingularStepWarning)
    ...     run = iterate(QuadraticField([[[1]]]), [[-0.5], [1.0]], eps=1.0, steps=3)
    >>> run.status.tolist(), run.failed_at.tolist()
    ([0, -1], [-1, 1])
    """


class PoleWarning(RuntimeWarning):
    """Some trajectories of a batch may have jumped over infinity, or eps is too large for them.

    They took a step from a state where A(x) = 1 - (eps / 2) f'(x) has a negative determinant. Along
    a motion that the steps resolve, it is positive. Where it is negative, an odd number of real
    eigenvalues mu of f' have eps mu / 2 > 1: the motion escapes to infinity and the map returns
    from the other side, or eps is too large. The test misses an even number of such eigenvalues, so
    that the absence of a warning proves nothing.

    These trajectories have the status `PASSED_POLE`. `failed_at` is the number of the first state
    after the step, which gives the time of escape to a few steps. Later states belong to the map
    and say nothing about the motion.

    Examples
    --------
    The solution x = 1 / (1 - t) of x' = x**2 escapes to infinity at t = 1:

    >>> import warnings
    >>> from suslov_fast import PoleWarning, QuadraticField, Status, iterate
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore", PoleWarning)
    ...     run = iterate(QuadraticField([[[1]]]), [1.0], 0.03, 50)
    >>> run.ok, Status(run.status).name, int(run.failed_at)
    (True, 'PASSED_POLE', 34)
    """


class SingularStepError(ArithmeticError):
    """Some trajectories of a batch failed before their last step, and ``on_singular="raise"``.

    Attributes
    ----------
    trajectories : Trajectories
        The whole batch of :func:`iterate`, with the trajectories that did not fail.
    crossings : Crossings
        The result of :func:`crossings`, in place of `trajectories`.

    Examples
    --------
    >>> from suslov_fast import QuadraticField, SingularStepError, iterate
    >>> try:
    ...     run = iterate(QuadraticField([[[1]]]), [[-0.5], [1.0]], 1.0, 3, on_singular="raise")
    ... except SingularStepError as error:
    ...     print(error)
    ...     run = error.trajectories
    1 of 2 trajectories: singular step, first: 1 at step 1
    >>> run.status.tolist()
    [0, -1]
    """

    trajectories: Any = None
    crossings: Any = None

    def __init__(self, message: str, result: Any, name: str = "trajectories") -> None:
        super().__init__(message)
        self.result, self.name = result, name
        setattr(self, name, result)

    def __reduce__(self) -> tuple[type, tuple[str, Any, str]]:
        return type(self), (str(self), self.result, self.name)


def first_beyond(failed_at: NDArray[np.int64], first_pole: NDArray[np.int64]) -> Any:
    """Return the first state that does not belong to the motion, a number beyond all if none.

    A failure never comes before a pole that was passed.
    """
    first = np.where(first_pole < 0, failed_at, first_pole)
    return np.where(first < 0, np.iinfo(np.int64).max, first)


def count_in_words(status: NDArray[np.int8]) -> str:
    """Return in words how many trajectories failed, and how many passed a pole, if any."""
    passed = np.count_nonzero(status == Status.PASSED_POLE)
    text = f"failed: {np.count_nonzero(status < 0)} of {status.size}"
    return f"{text}, passed a pole: {passed}" if passed else text


def report_failures(
    run: Any, on_singular: OnSingular, since: int = 0, name: str = "trajectories"
) -> None:
    """Warn that trajectories of a run failed at step `since` or later, or raise an error.

    The error has the run as its attribute `name`. Passed poles are never more than a warning.
    """
    status, failed_at = run.status, run.failed_at
    if not (status.item() if status.size == 1 else status.any()):
        return
    if on_singular != "ignore":
        body = run.body if hasattr(run, "body") else run.problem.body
        report_poles(body, status, failed_at, since)
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
    message = "; ".join(texts)
    if message and on_singular == "raise":
        raise SingularStepError(message, run, name)
    if message and on_singular == "warn":
        warn(message, SingularStepWarning)


def report_poles(
    body: Any, status: NDArray[np.int8], failed_at: NDArray[np.int64], since: int = 0
) -> None:
    """Warn if trajectories of a body passed a pole at step `since` or later."""
    passed = (status == Status.PASSED_POLE) & (failed_at >= since)
    if passed.any():
        index = first_index(passed)
        warn_of_poles(body, int(passed.sum()), passed.size, index, failed_at[index])


def warn_of_poles(body: Any, passed: int, size: int, index: tuple[int, ...], step: int) -> None:
    """Warn that some trajectories of a body passed a pole: the one at `index` did at `step`."""
    why = "the motion escapes to infinity, or eps" if body._may_escape else "eps"
    warn(
        f"{passed} of {size} trajectories: a step from det A < 0: {why} is too long "
        f"(an eigenvalue of f' above 2/eps); first: {spell(index)} at step {step}",
        PoleWarning,
    )
