"""`flow`: the motion of a system at given times, exact or to a tolerance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.exact import states_at
from ..bodies.systems import System
from ..checks import FloatArray, Reals, StatesLike, short, wrong
from ..core.expressions.event_formulas import EventAction
from ..core.flow.batch_solver import SolverRequest
from ..fields.field import Field, system_of
from ..fields.right_hand_sides import with_events
from ..keywords import public
from ..maps import map_of
from ..maps.batch import Progress, reporter
from ..maps.problem import Problem
from ..status import Status
from .event import Event, field_of
from .events import (
    actions_of,
    batch_of,
    checked_events,
    event_times_of,
    starts_at_rest,
    warn_of_times_that_never_come,
)
from .integration import SolverResult, empty_result, to_tolerance, without_ends
from .modes import Sliding, are_stuck
from .motion import Motion
from .motion_arguments import (
    checked_settings,
    checked_starts,
    request_of,
    warn_of_ends,
    warn_of_lost_components,
    warn_of_tables,
    warn_of_times,
)
from .sensitivities import WithColumns, with_derivatives


@public
def flow(
    system: System,
    x0: StatesLike,
    /,
    *,
    time: Reals,
    rtol: float = 1e-9,
    atol: ArrayLike | None = None,
    max_step: float | None = None,
    stiff: bool | None = None,
    events: Event | Sequence[Event] | None = (),
    derivatives: str | Sequence[str] = (),
    threads: int | None = None,
    progress: Progress = None,
) -> Motion:
    """Return the motion: the solution of the equations at given times, from x0 at time 0.

    `time` lists the times at which states are wanted: ``(0, 10)`` is two times, no interval. Times
    before x0 are negative. NaN in x0 gives NaN. Each trajectory takes steps of its own, by
    extrapolation of order 10, or of order 7 where the equations are stiff. The step size follows
    from the estimated error of the trajectory; the times do not shorten steps. If the closed form
    of a body is known, its motion is exact.

    Parameters
    ----------
    system : Field, Suslov3D, SuslovND or callable
        A single field or body, or a batch. A function of the state in place of a field has the
        variables x1, x2, ..., as many as x0 has components, and no parameters.
    x0 : array_like(float, shape=(..., D))
        Initial states: states x of a field, or angular velocities; or a dictionary of components
        by name.
    time : array_like(float, shape=() or (n,))
        Times counted from x0, in any order, all 0 or later, or all 0 or earlier: ``time=[5, 6]``
        is 5 and 6 after x0, not from 5 on. A number is one time, n = 1. If equations depend on
        time, time is a variable t with the rate 1, and x0 contains its initial value:
        ``Field(lambda s: (-s[0] + np.cos(s[1]), 1.0), "x t")``.
    rtol : float
        Relative tolerance, from 1e-13 to 1e-2. The estimated error of a step stays below `rtol`
        times the largest absolute value that the component has had on the trajectory, or 2**-60 of
        the largest component's if that is more. If a component becomes small, loses its digits and
        grows again by itself, the trajectory is computed again, with relative digits for it.
    atol : float or array_like(float, shape=(D,)), optional
        Absolute tolerance, 0 or more. If it is given, the estimated error of component i stays
        below ``atol[i] + rtol * abs(x[i])``, or the rounding error of the step if that is more, so
        that small components have digits of their own.
    max_step : float, optional
        The longest step in time, for pulses that are shorter than the steps.
    stiff : bool, optional
        True or False takes all steps by the method for stiff equations, or by the other one. By
        default each trajectory chooses, from step to step.
    events : Event or sequence of Event
        Events at times or on surfaces, see :class:`Event`; ``motion.events`` holds
        what they did.
    derivatives : str or sequence of str
        "x0", and names of parameters of the field, as "x0 k c": ``motion.derivatives[name]`` then
        is the derivative with respect to it. The variational equations are solved to the same
        tolerance, relative to the size of x0 or of the parameter, and so is the motion of a body,
        which is exact without them.
    threads, progress
        As in :func:`iterate`; `progress` counts states, and those that are not computed yet when
        it returns False are NaN. A solution has the same bits on any threads, in any batch.

    Returns
    -------
    Motion
        The states (n, ..., D), with the status of each trajectory. A solution that ends, because it
        escapes to infinity or reaches a pole, is NaN from there on; so is one that takes more than
        250,000 steps, or as many events, from one time to the next, and a solution of equations
        without a value at x0. One :class:`IntegrationWarning` counts them, and says when the first
        one ends, and of what. NaN for a state that contains NaN, without a warning.

    See Also
    --------
    crossings : The states at which a motion meets a surface.
    iterate : Orbits of Kahan's map, for laws that hold exactly.
    ensemble : More trajectories than memory holds.

    References
    ----------
    P. Deuflhard, SIAM Review 27 (1985), 505-535, on extrapolation methods of variable order and
    step length.

    Examples
    --------
    Predators and prey (Lotka-Volterra) for three rates, at two times:

    >>> import numpy as np
    >>> from suslov_fast import Field, Suslov3D, flow
    >>> family = Field(
    ...     lambda x, a: (x[0] - x[0] * x[1], a * (x[0] * x[1] - x[1])), "u v", a=[0.5, 1, 2]
    ... )
    >>> motion = flow(family, [1.0, 0.5], time=[5.0, 10.0])
    >>> motion.states.shape, bool(motion.ok.all())
    ((2, 3, 2), True)

    A function of the state in place of a field:

    >>> flow(lambda x: (x[1], -x[0]), [1.0, 0.0], time=np.pi).states.round(6) + 0.0
    array([[-1.,  0.]])

    The motion of a body, which is exact:

    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> flow(body, [1.0, 0.5], time=5.0).states.round(6)
    array([[ 0.873751, -1.093725]])
    """
    body: Any = system_of(system, x0)
    request = request_of(time, checked_settings(body, rtol, atol, max_step, stiff), threads)
    times, sign = request.times, request.sign
    names, field = checked_derivatives(body, derivatives)
    acting = checked_events(events)
    if acting:
        field = field or field_of(body)
    x, batch = checked_starts(body, x0, batch_of(acting))
    if isinstance(body, Field):
        warn_of_times(body, x, times)
        if sign > 0 and body._tables_of_time:
            warn_of_tables(body, x, times.max(initial=0.0))
    at_rest = None, None
    if acting:
        warn_of_times_that_never_come(acting, sign, times)
        if sign > 0:
            starts = x.reshape(*batch, x.shape[1]) if batch else x[0]
            at_rest = starts_at_rest(field, acting, starts)
    return solved(body, x, batch, request, progress, names, field, acting, at_rest)


def solved(
    body: Any,
    x: FloatArray,
    batch: tuple[int, ...],
    request: SolverRequest,
    progress: Progress,
    names: tuple[str, ...],
    field: Any,
    events: tuple[Event, ...],
    at_rest: Any = (None, None),
) -> Motion:
    """Return the motion from states x (B, D), with one warning for all solutions that end.

    `field` has the equations of the body if there are events, or derivatives by `names`.
    """
    times, settings = request.times, request.settings
    actions: tuple[EventAction, ...] = ()
    of_columns = event_times = None
    new: Any = None  # arrays of the result that are not read-only yet, by default all
    if events:
        actions = actions_of(field, events)
        event_times = event_times_of(events, request.sign, batch)
    total = len(times) * math.prod(batch)
    with reporter(progress, total) as report:
        if report is not None or events:
            others = request.threads, report, event_times, request.most, request.since
            request = SolverRequest(times, request.sign, settings, *others)
        if names:
            found, of_columns = with_derivatives(field, x, batch, names, request, actions)
        elif events:
            own = WithColumns(field.shape, with_events(field, actions))
            found = to_tolerance(own, x, batch, request)
        else:
            found = motion_of(body, x, batch, request)
        phases: dict[str, Any] = {}
        where = () if found.is_good and at_rest[0] is None else are_stuck(found.status, at_rest[0])
        if len(where):
            part = Sliding(field or body, x, batch, where, request, events)
            found, of_columns, phases = part.continued(found, of_columns, names, at_rest)
        if report is not None and total and not found.is_stopped:
            report(total)  # the engine counts neither a time twice nor states after an end
    if not found.is_good:
        warn_of_ends(found, x, batch, settings.atol)
        warn_of_lost_components(found, batch)
    if batch:
        states = found.states.reshape((len(times), *batch, body.dimension))
    else:
        states = found.states[:, 0]  # sooner than by `reshape`
    steps = found.steps.reshape(batch)
    if len(times) == 1:
        last = times.reshape(())
    else:
        last = np.array(request.sign * abs(times).max(initial=0.0))
    if found.is_good:
        status, end = without_ends(batch)[1], np.full(batch, last) if batch else last
        again, new = status, (states, times, steps, of_columns, end)
    else:
        status = found.status.reshape(batch)
        end = np.where(status == Status.OK, last, found.t.reshape(batch))
        again = without_ends(batch)[1] if found.repeated is None else found.repeated.reshape(batch)
    motion = Motion._of(
        {
            "states": states,
            "time": times,
            "body": body,
            "status": status,
            "end": end,
            "steps": steps,
            "rtol": settings.rtol,
            "atol": settings.atol,
            "max_step": settings.max_step,
            "stiff": settings.stiff,
            "_again": again,
            "_by": names,
            "_derivatives": of_columns,
        },
        new,
    )
    if phases:
        vars(motion).update(phases)
    if events:
        vars(motion)["_records"] = found.records, events, request.most
    else:
        vars(motion)["events"] = None
    return motion


def checked_derivatives(system: Any, derivatives: Any) -> tuple[tuple[str, ...], Any]:
    """Return the checked names of derivatives, and the field that has them; None without names."""
    if type(derivatives) is tuple and not derivatives:  # as in most calls
        return (), None
    names = derivatives.split() if isinstance(derivatives, str) else derivatives
    if not isinstance(names, (tuple, list)) or not all(isinstance(name, str) for name in names):
        such = "x0", *system._coordinates
        received = short(derivatives)
        raise wrong("derivatives", f"names, such as {such}", received, TypeError)
    field: Any = system._field
    if unknown := [name for name in names if name not in ("x0", *field._coordinates)]:
        known = ", ".join(map(repr, ("x0", *field._coordinates)))
        raise wrong("derivatives", f"names of {known}", f"{unknown[0]!r}")
    if "x0" in names and "x0" in field._coordinates:
        how = "the initial state and a parameter: give the parameter another name"
        raise wrong("derivatives", "names of one thing each", f"'x0', {how}")
    if len({*names}) < len(names):
        raise wrong("derivatives", "different names", short(names))
    return tuple(names), field


# ------------------------------------------------------------------------------------------ motions
def motion_of(
    system: Any, x: FloatArray, batch: tuple[int, ...], request: SolverRequest
) -> SolverResult:
    """Return the motion from states x (B, D): exact, to a tolerance, or member by member."""
    if isinstance(system, Field):
        return to_tolerance(system, x, batch, request)
    is_exact = system._is_solved  # True, or for each member
    if np.all(is_exact):
        return _exact(system, x, batch, request)
    if not np.any(is_exact):
        return to_tolerance(system._field, x, batch, request)
    is_exact = np.broadcast_to(is_exact, batch).ravel()
    found = empty_result(x, len(request.times))
    for exact in (True, False):
        where = np.flatnonzero(is_exact == exact)
        members, count = _members(system, batch, where), (len(where),)
        found = found.with_part(where, motion_of(members, x[where], count, request))
    return found


def _members(body: Any, batch: tuple[int, ...], where: NDArray[np.int64]) -> Any:
    """Return the members (K,) of a body, one for each of the trajectories `where` of the batch."""
    parts = {}
    for name, value in body._parts.items():
        array = np.asarray(value)
        inner = array.shape[array.ndim - body._axes.get(name, 0) :]
        parts[name] = np.broadcast_to(array, (*batch, *inner)).reshape(-1, *inner)[where]
    return body._with_parts(parts)


def _exact(
    body: Any, x: FloatArray, batch: tuple[int, ...], request: SolverRequest
) -> SolverResult:
    """Return the exact motion of a body; NaN where the closed form is out of range."""
    omega = x.reshape(*batch, x.shape[1])
    problem = Problem(map_of(body), body, omega, 0.0, batch, request.threads, "x0")
    found = empty_result(x, len(request.times))
    states = states_at(problem, request.times, is_number=False).reshape(found.states.shape)
    status = np.where(np.isnan(states).any(axis=(0, 2)), Status.NONFINITE, Status.OK)
    status[np.isnan(x[:, 0])] = Status.NONFINITE
    return found._replace(states=states, status=status.astype(np.int8), t=np.full(len(x), np.nan))
