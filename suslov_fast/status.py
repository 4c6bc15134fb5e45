"""Statuses of trajectories, and the warning of trajectories that passed a pole."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .checks import first_index, spell, warn
from .core.numba import status_codes


class Status(IntEnum):
    """Final status of a trajectory: negative if it failed, positive if it finished with a caveat.

    - `OK` (0): the trajectory is finished.
    - `SINGULAR` (negative): the last state of an orbit lies on a pole of the map.
    - `NONFINITE` (negative): the next state of an orbit is beyond the range of float64, or the
      right-hand side of a :class:`Motion` has no value at x0.
    - `SUPERCRITICAL`, `PASSED_POLE` (positive): the orbit need not follow the continuous motion.
      `SUPERCRITICAL` is for bodies in three dimensions with a :meth:`Suslov3D.criticality` t with
      ``|t| >= 1``, `PASSED_POLE` for other systems, see :class:`IntegrationWarning`.
    - `ENDED`, `SLIDING`, `ACCUMULATES`, `TOO_MANY_STEPS` (negative): a :class:`Motion` stops before
      the last time.
    - `STOPPED` (positive): an event ended a :class:`Motion`.
    - `NOT_KEPT` (positive): a function that :meth:`Field.conserving` should keep changes along a
      :class:`Motion`, or its gradient left no way to keep it.
    - `DEGENERATE` (positive), `NOT_FOUND` (negative): only of :func:`equilibria`.

    `message` explains the status in a sentence.

    Examples
    --------
    >>> from suslov_fast import Field, Status, iterate
    >>> blow_up = Field.from_terms([[[1]]])  # x' = x**2, whose map has a pole at x = 1 / eps
    >>> run = iterate(blow_up, [[-0.5], [1.0]], eps=1.0, steps=3, on_singular="ignore")
    >>> [Status(status).name for status in run.status], run.failed_at.tolist()
    (['OK', 'SINGULAR'], [-1, 1])
    >>> Status(run.status[1]).message
    'singular step: the state lies on a pole of the map and has no next state'
    """

    OK = status_codes.OK
    SUPERCRITICAL = status_codes.SUPERCRITICAL
    PASSED_POLE = status_codes.PASSED_POLE
    SINGULAR = status_codes.SINGULAR
    NONFINITE = status_codes.NONFINITE
    ENDED = status_codes.ENDED
    SLIDING = status_codes.SLIDING
    TOO_MANY_STEPS = status_codes.TOO_MANY_STEPS
    ACCUMULATES = status_codes.ACCUMULATES
    STOPPED = status_codes.STOPPED
    NOT_KEPT = status_codes.NOT_KEPT
    DEGENERATE = status_codes.DEGENERATE
    NOT_FOUND = status_codes.NOT_FOUND

    @property
    def message(self) -> str:
        """The meaning of the status, as a sentence."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.OK: "finished",
    Status.SUPERCRITICAL: (
        "finished, but |t| >= 1: the orbit does not follow the continuous motion; "
        "to follow it choose a smaller eps"
    ),
    Status.PASSED_POLE: (
        "finished, but passed a pole: the motion escapes to infinity, or eps is too large "
        "(det A < 0, or a component changed its sign, which is impossible along the motion)"
    ),
    Status.SINGULAR: "singular step: the state lies on a pole of the map and has no next state",
    Status.NONFINITE: "non-finite step: the next state is beyond the range of float64",
    Status.ENDED: "the solution ends: it escapes to infinity, or reaches a pole of the equations",
    Status.SLIDING: (
        "the solution slides along conditions, or crosses them ever faster, and they do not tell "
        "how it goes on"
    ),
    Status.TOO_MANY_STEPS: (
        "stopped before the last time: steps and events follow one another, and the solution does "
        "not move on; or progress returned False"
    ),
    Status.ACCUMULATES: "events follow one another without end, and no body comes to rest",
    Status.STOPPED: "finished: an event ended it",
    Status.NOT_KEPT: (
        "finished, but a function that field.conserving(...) should keep changes along f, or its "
        "gradient left no way to keep it"
    ),
    Status.DEGENERATE: (
        "an equilibrium at which f' is singular: a multiple root, as at a fold, or one of a family"
    ),
    Status.NOT_FOUND: "no equilibrium is found from this state: pass a nearer one",
}


class IntegrationWarning(RuntimeWarning):
    """Some trajectories ended early, lost digits, or passed a pole and left the motion.

    - **They failed**: `status` is negative, and states of a run are NaN from number `failed_at` on.
      :class:`Status` lists the causes. Other trajectories are not affected. With
      ``on_singular="raise"`` :func:`iterate` raises a :class:`SingularStepError` instead.
    - **They passed a pole of the map**: the motion escapes to infinity, from where the map returns
      on the other side, or eps is too large. A pole is detected in two ways. In a step from a state
      x where det A(x) < 0, with A(x) = 1 - (eps / 2) f'(x), an odd number of real eigenvalues mu of
      f' have eps mu / 2 > 1. Or a component that is a factor of its own equation, such as a
      population, changes its sign, which is impossible along the motion. An even number of these
      eigenvalues is not detected, so a run without a warning may have passed poles, too.

      These trajectories have the status `PASSED_POLE`, unless they failed later. `first_pole` of a
      run is the number of the first state after such a step, and `valid` is True before it. Later
      states belong to the map. They approximate the motion only if the orbit does not move along
      the eigenvector of mu. Methods of order 4 to 8 have sub-steps backwards in time, in which a
      mode that decays fast looks like a pole.
    - **Solutions of** :func:`flow` **end** before the last time, lose the digits of a component, or
      do not keep a function of :meth:`Field.conserving`, which has the status `NOT_KEPT`. One
      warning counts these solutions, and names the first trajectory.
    """


def ended_in_words(status: NDArray[np.int8]) -> str:
    """Return in words how many motions ended, and how many events stopped, if any."""
    counts = {"ended": status < 0, "stopped": status == Status.STOPPED}
    counts["integrals not kept"] = status == Status.NOT_KEPT
    texts = (f", {k}: {np.count_nonzero(v)} of {v.size}" for k, v in counts.items() if v.any())
    return "".join(texts)


def report_poles(problem: Any, status: Any, failed_at: Any, by_sign: Any) -> None:
    """Warn if trajectories of a problem passed a pole; `by_sign` is True if a sign showed it."""
    passed = status == Status.PASSED_POLE
    if not passed.any():
        return
    index, why = first_index(passed), "eps is too long"
    step = int(failed_at[index])
    if problem.body._may_escape:
        time = step * float(np.broadcast_to(problem.eps, problem.batch)[index])
        why = f"the motion escapes to infinity before t = {time:g}, or {why}"
    if (passed & by_sign).any():
        why += " (a component that cannot change its sign did)"
    if problem.map.methods[problem.method].goes_back:
        why += ", or a mode decays so fast that a substep backwards in time looks "
        why += "like a pole, and the states may be right"
    warn(
        f"{passed.sum()} of {passed.size} trajectories passed a pole "
        f"(first: trajectory {spell(index)} at step {step}): {why}",
        IntegrationWarning,
    )
