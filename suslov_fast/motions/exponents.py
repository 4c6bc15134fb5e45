"""Lyapunov exponents of maps and of motions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .. import checks
from ..bodies.systems import System
from ..calls import Progress, reporter, thread_count
from ..checks import FloatArray, Reals, StatesLike, integer, short, wrong
from ..core.flow.batch_solver import SolverRequest
from ..fields.map import Map
from ..keywords import public
from ..maps.derivatives import growth
from ..maps.evaluation import mask_and_warn
from ..maps.map_records import Method, eps_and_steps, map_of
from ..maps.problem import Problem, check
from ..status import Status, report_poles
from . import motion_arguments
from .event import EventLike
from .events import actions_of, batch_of, checked_events, clocked, event_times_of
from .integration import threads_for
from .kept_integrals import warn_of_unkept
from .tangents import exponents_of
from .warnings_of_motions import causes_of, warn_of_ends

_SLIDING = {
    Status.SLIDING: (
        "slide along a surface at which f jumps, where exponents are not computed (smooth f there: "
        "np.tanh(y/width) for np.sign(y))"
    )
}


@public
def lyapunov_exponents(
    system: System,
    x0: StatesLike,
    /,
    eps: Reals | None = None,
    steps: int | None = None,
    transient: float = 0,
    *,
    time: float | None = None,
    rtol: float = motion_arguments.RTOL,
    t0: Reals | None = None,
    events: EventLike | Sequence[EventLike] | None = (),
    method: Method = "auto",
    threads: int | None = None,
    progress: Progress = None,
) -> FloatArray:
    """Return Lyapunov exponents over a finite time, per unit of time; a positive one shows chaos.

    With `eps` and `steps` the exponents belong to orbits of Kahan's map; with `time` they belong to
    the motion, as :func:`flow` computes it. For a :class:`Map` they are per step.

    Tangent vectors follow the derivative of the map, or the variational equations of the motion.
    Before they lose digits, they are decomposed as Q R, and the columns of Q replace them
    (Benettin's method). The exponents are the sums of the logarithms of the diagonals of R, divided
    by the time. Their sum equals the mean of ``log |det DPhi| / |eps|``, or the mean of the trace
    of f'; for maps the relative error of the sum is 1e-10. Where f jumps, the saltation matrix S
    multiplies tangent vectors, and adds ``log |det S|`` to the sum of logarithms. The exponents of
    an orbit have the same bits in any batch.

    Parameters
    ----------
    system, x0
        As in :func:`iterate` and :func:`flow`.
    eps, steps : optional
        As in :func:`iterate`; eps is not 0, and is left out for a `Map`. The mean is over `steps`
        steps after the transient, 1 or more.
    transient : int or float
        Number of steps, or time, before averaging begins. It aligns the tangent vectors; without
        it the mean has an error of order 1 / steps, or 1 / time.
    time : float, optional
        The time to average over, positive, in place of eps and steps.
    rtol : float
        With `time`, the relative tolerance of :func:`flow`, for states and tangent vectors.
    t0
        With `time`, as in :func:`flow`.
    events : Event, callable or str, or a sequence of these
        With `time`, events without `terminal` and `most`, see :class:`Event`. Tangent vectors
        change with the state, and with the time at which the state meets a surface.
    method, threads, progress
        As in :func:`iterate`; `method` is for maps only. `progress` counts steps, including the
        transient, or thousandths of the time. If it returns False, the exponents are means up to
        there, or NaN within the transient.

    Returns
    -------
    ndarray(float, shape=(..., D))
        Exponents, the largest first. They are ``-inf`` if a step or an event is not invertible,
        such as an event that sets a component to a number. They are NaN, with one
        :class:`IntegrationWarning`, if an orbit of the map fails, or if a motion ends or slides
        along a surface where f jumps. If an orbit passed a pole, a warning says so: its exponents
        belong to the map, and not to the motion. A motion has no exponents for variables with a
        constant rate other than 0, such as time, unless an event sets them. With constraints the
        exponents are those of motions that satisfy them: as many as their manifold has dimensions.

    See Also
    --------
    periodic_orbit : The multipliers of one periodic orbit.

    References
    ----------
    G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn, Meccanica 15 (1980), 9-20.

    Examples
    --------
    The largest exponent of the Lorenz system is about 0.906 per unit of time:

    >>> from suslov_fast import Field, lyapunov_exponents
    >>> lorenz = Field(
    ...     lambda x: (10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]),
    ...     "x y z",
    ... )
    >>> exponents = lyapunov_exponents(lorenz, [1, 1, 20], time=400, transient=20, rtol=1e-6)
    >>> exponents.round(1) + 0.0
    array([  0.9,   0. , -14.6])
    >>> exponents = lyapunov_exponents(lorenz, [1, 1, 20], 1 / 128, 50_000, transient=2000)
    >>> exponents.round(1) + 0.0
    array([  0.9,   0. , -14.6])
    """
    body: Any = motion_arguments.system_of(system, x0)
    if isinstance(body, Map):
        eps, steps = eps_and_steps("lyapunov_exponents", body, eps, steps)
    others = {"method": method, "rtol": rtol, "events": events}
    if not motion_arguments.either_map_or_motion("lyapunov_exponents", eps, steps, time, **others):
        body = body._autonomous
        checked = check(map_of(body, method), body, x0, eps, threads, method=method, name="x0")
        return _of_map(checked, integer("steps", steps, 1), transient, progress)
    time, before = checks.positive("time", time), checks.real_number("transient", transient)
    if not isinstance(before, float) or before < 0.0:
        raise wrong("transient", "a time, 0 or more", short(transient))
    acting = checked_events(events)
    if any(each.terminal or each.most is not None for each in acting):
        received = "terminal or most, with which a trajectory ends"
        raise wrong("events", "those with which trajectories go on", received)
    acting = tuple(each for each in acting if each.to is not None)
    body = clocked(body, acting)
    settings = motion_arguments.checked_settings(body, rtol)
    x, batch, _ = motion_arguments.checked_starts(body, x0, batch_of(acting), t0)
    actions = actions_of(body._field, acting)
    event_times = event_times_of(acting, 1, batch) if actions else None
    count = threads_for(len(x), thread_count(threads))
    with reporter(progress, 1000) as report:
        request = SolverRequest(np.array([time]), 1, settings, count, report, event_times)
        exponents, ends = exponents_of(body._field, x, batch, request, before, actions)
    warn_of_unkept(ends.all_ends, batch, since=body._layout.times(x))
    causes = {**causes_of(body), **_SLIDING}
    warn_of_ends(ends, x, batch, causes=causes)
    return exponents.reshape(*batch, exponents.shape[1])


def _of_map(problem: Problem, steps: int, transient: Any, progress: Progress) -> FloatArray:
    """Return the exponents (..., D) of orbits of a map, per unit of time, after a transient."""
    transient = integer("transient", transient, 0)
    length = abs(np.broadcast_to(problem.eps, problem.batch))[..., np.newaxis]
    if not length.all():
        raise wrong("eps", "other than 0, because exponents are per unit of time")
    with reporter(progress, transient + steps) as report, np.errstate(all="ignore"):
        found = growth(problem, steps, transient, report)
        sums = found.sums
    sums[np.isnan(sums).any(axis=1)] = np.nan
    means = -np.sort(-sums / max(found.steps, 1), axis=1)
    exponents = means.reshape(*problem.batch, problem.body._layout.D) / length
    report_poles(
        problem,
        found.status.reshape(problem.batch),
        found.failed_at.reshape(problem.batch),
        by_sign=found.by_sign.reshape(problem.batch),
    )
    if found.steps == 0:  # `progress` ended the run in its transient
        return exponents
    return mask_and_warn(problem, exponents, poles=True)
