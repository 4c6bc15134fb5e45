"""Statuses of trajectories, and the warning for failed ones."""

from __future__ import annotations

from enum import IntEnum

from ..core import codes


class Status(IntEnum):
    """Final status of a trajectory: negative if it failed.

    Examples
    --------
    >>> from suslov_fast import Status
    >>> Status.SINGULAR.message
    'singular step: the state lies on a pole of the map and has no next state'
    """

    OK = codes.OK
    SUPERCRITICAL = codes.SUPERCRITICAL
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
    Status.SINGULAR: "singular step: the state lies on a pole of the map and has no next state",
    Status.NONFINITE: "non-finite step: the next state is beyond the range of float64",
}


class SingularStepWarning(RuntimeWarning):
    """Some trajectories of a batch failed before their last step."""
