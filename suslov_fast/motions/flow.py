"""`flow`: the motion of a system at given times, exact or to a tolerance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.systems import System
from ..calls import Progress
from ..checks import FloatArray, Reals, StatesLike
from ..core.flow.batch_solver import Settings, SolverRequest
from ..keywords import public
from ..results.result import read_only, times_of, zeros_of
from ..status import Status
from .event import Event, EventLike
from .events import batch_of, checked_events, clocked
from .motion import Motion
from .motion_arguments import (
    checked_derivatives,
    checked_starts,
    request_of,
    system_of,
)
from .solution import solution
from .tolerances import FEW_MOTIONS
from .warnings_of_motions import warn_of_event_times, warn_of_times


@public
def flow(
    system: System,
    x0: StatesLike,
    /,
    *,
    time: Reals,
    t0: Reals | None = None,
    rtol: float = 1e-9,
    atol: ArrayLike | None = None,
    max_step: float | None = None,
    stiff: bool | None = None,
    events: EventLike | Sequence[EventLike] | None = (),
    derivatives: str | Sequence[str] = (),
    threads: int | None = None,
    progress: Progress = None,
) -> Motion:
    """Return the motion from x0: the states of the solution at given times.

    The state at time 0 is x0. `time` lists the times of the wanted states: ``(0, 10)`` are two
    times, not an interval. Negative times lie before x0. If x0 contains NaN, so do all states.

    Each trajectory has its own steps, by extrapolation methods of order 10, or of order 7 where the
    equations are stiff. The estimated error of the trajectory controls the step size; steps do not
    have to end at the wanted times. If the closed form of a body is known, its motion is exact.

    Parameters
    ----------
    system : Field, Suslov3D, SuslovND or callable
        A single field or body, or a batch. A function of the state may replace the field: its
        variables are x1, x2, ..., as many as x0 has components, and it has no parameters.
    x0 : array_like(float, shape=(..., D))
        Initial states: states x of a field, or angular velocities of a body. A dictionary gives the
        components by name. From a run or a motion its solutions go on at their ends.
    time : array_like(float, shape=() or (n,))
        Times counted from x0, in any order; all 0 or later, or all 0 or earlier. ``time=[5, 6]``
        is 5 and 6 after x0, not an interval. A number is one time, n = 1.
    t0 : array_like(float, shape=(...)), optional
        The time t at x0, if f or an event takes it, as f(t, y): by default 0, or the time at the
        end of the :class:`Motion` x0.
    rtol : float
        Relative tolerance, from 1e-13 to 1e-2. In each step the estimated error of a component
        stays below `rtol` times its size. The size is the largest absolute value that it has had on
        the trajectory, and at least 2**-60 times the largest size of all components. With `rtol`
        above 3e-5 (1e-8 in implicit steps; 1e-6 for a component that is a factor of its rate),
        errors are smaller while a component is far below its size. If a component becomes so small
        that it loses its digits, and then grows again by itself, the trajectory is computed again
        with a relative tolerance for this component.
    atol : float or array_like(float, shape=(D,)), optional
        Absolute tolerance, 0 or more. If it is given, the estimated error of component i stays
        below ``atol[i] + rtol * abs(x[i])``, or below the rounding error of the step if that is
        larger. Pass it if components need relative accuracy also while they are small.
    max_step : float, optional
        The longest step in time. Pass it if f has pulses that are shorter than the steps.
    stiff : bool, optional
        True takes all steps with the method for stiff equations, False with the other method. By
        default each trajectory chooses the method from step to step.
    events : Event, callable or str, or a sequence of these
        Events at times or on surfaces, see :class:`Event`; ``motion.events`` records them. A
        surface alone, a function or text, is an event that only records, or that has the attributes
        `terminal` and `direction` of the function.
    derivatives : str or sequence of str
        The motion is differentiated with respect to these: "x0", and parameters of the field, as
        in "x0 k c". Then ``motion.derivatives[name]`` is the derivative. The variational equations
        are solved to the same tolerance, relative to the size of x0 or of the parameter. With
        derivatives also the motion of a body is solved to the tolerance.
    threads, progress
        As in :func:`iterate`. `progress` counts states; if it returns False, states that are not
        computed yet are NaN. A solution has the same bits with any number of threads, and in any
        batch.

    Returns
    -------
    Motion
        The states (n, ..., D), and the status of each trajectory. If a solution ends, because it
        escapes to infinity or reaches a pole, its states are NaN from there on. The same holds for
        a solution that 250,000 steps, actions and records of events take less than a thousandth of
        the last time further, and for equations without a value at x0. One
        :class:`IntegrationWarning` counts all of these; it tells the cause and the time of the
        first. Initial states with NaN cause no warning.

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
    names, acting = checked_derivatives(body, derivatives), checked_events(events)
    timed = clocked(body, acting) if acting else body
    request = request_of(timed, time, threads, rtol, atol, max_step, stiff)
    x0, batch, t0 = checked_starts(timed, x0, batch_of(acting) if acting else (), t0)
    if timed._clocks:
        warn_of_times(timed, x0, request, t0)
    if acting:
        warn_of_event_times(acting, request)
    return solved(timed, x0, batch, request, progress, names, acting, body, t0)


def solved(
    system: Any,
    x0: FloatArray,
    batch: tuple[int, ...],
    request: SolverRequest,
    progress: Progress,
    names: tuple[str, ...],
    events: tuple[Event, ...],
    body: Any,
    t0: Any,
) -> Motion:
    """Return the motion from x0 (B, D), differentiated with respect to `names`; warn if it ends.

    `system` may have a hidden time that the `body` of the user lacks; `t0` is the time at x0.
    """
    result, phases = solution(system, x0, batch, request, progress, names, events)
    layout, ends = system._layout, result.ends
    if batch:
        states = result.states.reshape(len(result.states), *batch, x0.shape[1])
        start = x0.copy().reshape(*batch, x0.shape[1])
    else:
        states, start = result.states[:, 0], x0[0].copy()
    motion = _of_request(request, batch) | {
        "body": body,
        "states": read_only(layout.leave(states)),
        "_start": read_only(start),
        "_by": names,
        **phases,
    }
    for name, column in result.columns.items():
        motion[name] = read_only(column.reshape(batch))
    if t0 is not None:
        motion["_t0"] = times_of(t0, batch)
    if ends is not None:
        status, end, again = (a.reshape(batch) for a in (ends.status, ends.t, ends.repeated))
        motion["status"], motion["_again"] = read_only(status), read_only(again)
        finished = (status == Status.OK) | (status == Status.NOT_KEPT)
        motion["end"] = read_only(np.where(finished, motion["end"], end))
    if type(request.settings.atol) is tuple:
        motion["atol"] = layout.leave_atol(request.settings.atol)
    if names:
        derivatives = result.derivatives
        derivatives = derivatives.reshape(len(derivatives), *batch, *derivatives.shape[2:])
        motion["_derivatives"] = read_only(layout.leave_rows(derivatives))
    if events:
        del motion["events"]  # `Motion` makes it from the records when it is read
        motion["_records"] = result.records, events, request.most, layout
    return Motion._with(motion)


def _of_request(request: SolverRequest, batch: tuple[int, ...]) -> dict[str, Any]:
    """Return the attributes of motions that reach the last time, but for those of solutions."""
    times, settings = request.times, request.settings
    if len(times) == 1 and (time := times.item()) and math.prod(batch) <= FEW_MOTIONS:
        return _at_one_time(time, batch, settings)  # for speed in small calls; not 0, or -0
    last = request.sign * abs(times).max(initial=0.0)
    return _at_times(times, np.full(batch, last) if batch else np.array(last), settings)


@lru_cache(64)
def _at_one_time(time: float, batch: tuple[int, ...], settings: Settings) -> dict[str, Any]:
    return _at_times(read_only(np.array([time])), np.full(batch, time), settings)


def _at_times(times: FloatArray, end: FloatArray, settings: Settings) -> dict[str, Any]:
    zeros, t0 = zeros_of(end.shape), times_of(None, end.shape)
    without = {"status": zeros, "_again": zeros, "_t0": t0, "events": None}
    return {"time": times, "end": read_only(end), **without, **settings._asdict()}
