"""`crossings`: where motions cross surfaces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.systems import System
from ..calls import Progress, thread_count
from ..checks import Reals, StatesLike, integer, one_number, short, wrong
from ..core.flow.batch_solver import Settings, SolverRequest
from ..keywords import public
from .event import Event
from .events import Events, clocked
from .flow import solved
from .motion_arguments import RTOL, checked_derivatives, checked_settings, checked_starts, system_of

_LAST = ": pass its last number, or for (100, 200) time=100 after transient=100"


@public
def crossings(
    system: System,
    x0: StatesLike,
    /,
    surface: Any,
    *,
    time: float,
    t0: Reals | None = None,
    rtol: float = RTOL,
    atol: ArrayLike | None = None,
    max_step: float | None = None,
    stiff: bool | None = None,
    direction: int | str = "both",
    transient: float = 0,
    most: int | None = None,
    derivatives: str | Sequence[str] = (),
    threads: int | None = None,
    progress: Progress = None,
) -> Events:
    """Find where motions cross a surface s(x) = 0: Poincare sections, maxima, escapes, basins.

    A crossing is a point where s becomes positive, or stops being positive. A step of the solver
    ends at each crossing, so that its time and state are as accurate as the tolerance. Two
    crossings within one step are found from the values and rates of s at five points of the step.
    The search may miss points where a motion touches the surface, and humps of s that are narrower
    than a thirtieth of a step; then pass a smaller `max_step`. Where s is NaN there is no crossing.
    A start on the surface does not count.

    Parameters
    ----------
    system, x0
        As in :func:`flow`.
    surface : str or callable, or sequence of them
        One or more surfaces, each as in :class:`Event`: ``"z - 27"``, or ``lambda x: x[2] - 27``.
    time : float
        The time after the transient; negative backwards in time.
    t0, rtol, atol, max_step, stiff
        As in :func:`flow`.
    direction : {"both", "up", "down"} or {0, 1, -1}
        As in :class:`Event`.
    transient : float
        The time at the beginning in which crossings are ignored.
    most : int, optional
        The number of crossings, 1 or more, after which a trajectory ends.
    derivatives : str or sequence of str
        As in :func:`flow`. ``crossings(...).derivatives["a"].time`` are the derivatives of the
        times with respect to the parameter a.
    threads, progress
        As in :func:`iterate`; `progress` counts trajectories that have ended.

    Returns
    -------
    Events

    See Also
    --------
    Event : A surface at which the state changes, or the motion ends.

    Examples
    --------
    The section of the Lorenz attractor at x3 = 27, and the successive maxima of x3:

    >>> from suslov_fast import Field, crossings
    >>> def lorenz(x, rho):
    ...     return 10 * (x[1] - x[0]), x[0] * (rho - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]
    >>> field = Field(lorenz, 3, rho=28)
    >>> starts = [[1.0, 1.0, 20.0], [-2.0, 1.0, 20.0]]
    >>> section = crossings(field, starts, "x3 - 27", time=30.0, transient=8.0, direction="up")
    >>> bool(abs(section.states[:, 2] - 27).max() < 1e-11)
    True
    >>> peaks = crossings(field, starts, lambda x: -field(x)[..., 2], time=3.0, direction="up")
    >>> peaks.states[peaks.trajectory == 0, 2][:3].round(3)
    array([40.413, 38.669, 44.072])
    """
    if most is not None:
        most = integer("most", most, 1, "None or an integer of at least 1")
    body: Any = system_of(system, x0)
    settings = Settings(rtol=rtol, atol=atol, max_step=max_step, stiff=stiff)
    names = checked_derivatives(body, derivatives)
    duration, before = one_number("time", time, _LAST), one_number("transient", transient)
    if before < 0.0:
        raise wrong("transient", "0 or more", short(transient))
    is_many = isinstance(surface, Sequence) and not isinstance(surface, str)
    given = surface if is_many else [surface]
    if not given:
        raise wrong("surface", "a function, or one or more", "none")
    events = tuple(_event(each, direction) for each in given)
    system = clocked(body, events)
    settings = checked_settings(system, *settings)
    x, batch, t0 = checked_starts(system, x0, t0=t0)
    request = SolverRequest(
        np.array([abs(duration) + before]),
        -1 if duration < 0.0 else 1,
        settings,
        thread_count(threads),
        most=math.inf if most is None else most,
        since=before,
    )
    motion = solved(system, x, batch, request, progress, names, events, body, t0)
    assert motion.events is not None  # a motion with a surface has events
    return motion.events


def _event(surface: Any, direction: Any) -> Event:
    if type(surface) is type(direction) is str:
        return _event_of_text(surface, direction)
    return Event(surface, direction=direction)


@lru_cache(64)
def _event_of_text(surface: str, direction: Any) -> Event:
    """Return an event, kept for later calls, because it keeps its formula."""
    return Event(surface, direction=direction)
