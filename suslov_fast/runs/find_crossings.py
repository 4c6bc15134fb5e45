"""The function `crossings`, which checks its arguments and starts the search."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.classes import BodyOrField
from ..bodies.fields.general import with_changes
from ..checks import FloatArray, Reals, integer, one_number, one_of, short, wrong
from ..core.motion.engine import Settings
from ..engine.motions import Asked, solve
from ..engine.problem import check, warn_of_times
from ..engine.random_starts import RandomStarts
from ..engine.sensitivity import WithColumns
from ..engine.starts import (
    RTOL,
    checked_settings,
    checked_starts,
    either_map_or_motion,
    ends_in_words,
)
from ..engine.status import PoleWarning, Status
from ..engine.stretches import March, Progress, reporter
from ..engine.threads import thread_count
from ..keywords import public
from ..maps import map_of
from .change import Change, checked_direction, field_of
from .changes import acts_of, stops_of
from .crossings import Crossings
from .failures import ON_SINGULAR, OnSingular, report_failures, told
from .search import Surface, checked_surface, found_along

_LAST = ": pass its last number, or for (100, 200) time=100 after transient=100"


@public
def crossings(
    system: BodyOrField,
    x0: ArrayLike | RandomStarts,
    /,
    eps: Reals | None = None,
    steps: int | None = None,
    surface: Surface | str | Sequence[Surface | str] | None = None,
    *,
    time: float | None = None,
    rtol: float = RTOL,
    atol: ArrayLike | None = None,
    max_step: float | None = None,
    stiff: bool | None = None,
    direction: int | str = 1,
    transient: float = 0,
    most: int | None = None,
    method: str = "auto",
    threads: int | None = None,
    on_singular: OnSingular = "warn",
    progress: Progress = None,
) -> Crossings:
    """Find where orbits cross a surface s(x) = 0: Poincaré sections, maxima, escapes, basins.

    With `time` the orbits are motions: a point where s becomes positive, or stops being so, has the
    digits of the tolerance. With `eps` and `steps` they are orbits of the map: the states are those
    of :func:`iterate`, bit for bit, and only the crossings are kept. With a = s(x_n) and
    b = s(x_{n+1}), an orbit crosses upwards between states n and n + 1 if a < 0 <= b, and downwards
    if b < 0 <= a: 0 counts as positive. A start on the surface is never a crossing.

    Parameters
    ----------
    system : QuadraticField, Field, Suslov3D, SuslovGyrostat or SuslovND
        A single field or body, or a batch.
    x0 : array_like(float, shape=(..., D))
        Initial states, as in :func:`iterate`.
    eps, steps
        Along a map: the step size, as in :func:`iterate`, and the number of steps after the
        transient, 0 or more.
    surface : callable or str, or sequence of them along a motion
        The name of a component, a formula of them, ``"z - 27"``, or the function s. A section:
        ``lambda x: x[..., 2] - 27``; an escape: ``lambda x: (x**2).sum(-1) - 4``. Along a motion it
        is traced once, as that of a `Field`, and may take parameters of the system by name. Along a
        map it takes states (..., D) and returns real values (...), each from its own state alone,
        by NumPy or compiled by Numba. It is called with read-only pieces (rows, ..., D) of the
        orbits, NaN where there is no state, which later pieces overwrite: copy states that you
        keep. A value of s that is NaN or infinite makes no crossing.
    time : float
        Along a motion: the time after the transient; negative backwards in time.
    rtol, atol, max_step, stiff
        As in :func:`flow`.
    direction : {1, -1, 0} or {"up", "down", "both"}
        Upwards (the default), downwards, or both. SciPy's events have the default 0.
    transient : int or float
        Number of steps, or the time, at first in which crossings are ignored.
    most : int, optional
        The number of crossings, 1 or more, at which a trajectory ends; the run ends when all
        trajectories have ended or failed.
    method, threads
        As in :func:`iterate`.
    on_singular : {"warn", "raise", "ignore"}
        As in :func:`iterate`; the error holds the result as `crossings`.
    progress : bool or callable, optional
        As in :func:`iterate`, called with the steps of the transient included.
        Along motions it is called with the number of trajectories that have ended.

    Returns
    -------
    Crossings
        Along a motion. Each trajectory takes the steps of :func:`flow`, and a crossing is a state
        after a shorter step of the method. Signs of s are compared at the ends of a step and at
        seven points inside it, and where s comes near 0 and goes back, at its least value. Two
        crossings within a step of the implicit method, and points where a motion touches the
        surface, may be missed. A smaller `max_step` looks closer.
    Crossings
        Along a map. Its points lie on the straight lines between consecutive states, whose error is
        O(eps**2) for every method: of order 2 they are as accurate as the states, while along a map
        of higher order `time` finds the crossings of the motion to more digits. If eps is too large
        for the map to follow the motion, use `before` or `after` instead.

    Raises
    ------
    TypeError, ValueError
        As :func:`iterate` and :func:`flow`; also if `surface` does not return a real value for each
        state, or with both `time` and `steps`.

    Examples
    --------
    The section of the Lorenz attractor at x3 = 27, and the successive maxima of x3:

    >>> from suslov_fast import QuadraticField, crossings
    >>> def lorenz(x, rho):
    ...     return 10 * (x[1] - x[0]), x[0] * (rho - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]
    >>> field = QuadraticField.from_function(lorenz, 3, rho=28)
    >>> starts = [[1.0, 1.0, 20.0], [-2.0, 1.0, 20.0]]
    >>> section = crossings(
    ...     field, starts, surface=lambda x: x[..., 2] - 27, time=30.0, transient=8.0
    ... )
    >>> bool(abs(section.states[:, 2] - 27).max() < 1e-12)
    True
    >>> peaks = crossings(field, starts, surface=lambda x: -field(x)[..., 2], time=3.0)
    >>> peaks.states[peaks.trajectory == 0, 2][:3].round(3)
    array([40.413, 38.669, 44.072])

    The same section along the map, with steps of 1/64:

    >>> section = crossings(field, starts, 1 / 64, 2000, lambda x: x[..., 2] - 27, transient=500)
    >>> section.n[:3]
    array([502, 548, 599])
    """
    direction = checked_direction(direction)
    if most is not None:
        most = integer("most", most, 1, "None or an integer of at least 1")
    one_of("on_singular", on_singular, ON_SINGULAR)
    if surface is None:
        how = "time=T along a motion, or eps and steps, and surface=lambda x: x[..., 0]"
        raise TypeError(f"surface is missing: pass {how}, for component 0")
    tolerances = {"rtol": rtol, "atol": atol, "max_step": max_step, "stiff": stiff}
    if either_map_or_motion("crossings", eps, steps, time, method=method, **tolerances):
        settings = checked_settings(system, **tolerances)
        return _along_motion(
            system, x0, surface, time, settings, direction, transient, most, threads, on_singular,
            progress,
        )  # fmt: skip
    map = map_of(system, method)
    problem = check(map, system, x0, eps, threads, name="x0")
    steps, transient = integer("steps", steps, 0), integer("transient", transient, 0)
    reports = reporter(progress, transient + steps)
    along_map = checked_surface(surface, system.labels)
    warn_of_times(problem)
    if type(problem.eps) is not float:  # copied, because the result keeps it
        problem = problem._replace(eps=np.array(problem.eps))
    march = March(problem, method)
    asked = direction, most, transient, transient + steps
    with reports as report:
        found, is_stopped = found_along(march, along_map, *asked, report)
    if is_stopped:
        steps = max(march.n - transient, 0)
    points = Crossings._of(
        found
        | {
            "body": system,
            "eps": problem.eps,
            "map": map,
            "method": method,
            "steps": steps,
            "transient": transient,
            "direction": direction,
            "most": most,
        }
    )
    report_failures(points, march, on_singular, name="crossings")
    return points


def _along_motion(
    system: Any,
    x0: Any,
    surface: Any,
    time: Any,
    settings: Settings,
    direction: int,
    transient: Any,
    most: int | None,
    threads: int | None,
    on_singular: OnSingular,
    progress: Progress,
) -> Crossings:
    """Return the crossings along motions, after checks of the arguments that maps do not have."""
    field = field_of(system)
    duration, before = one_number("time", time, _LAST), one_number("transient", transient)
    if before < 0.0:
        raise wrong("transient", "0 or more", short(transient))
    is_many = isinstance(surface, Sequence) and not isinstance(surface, str)
    given = surface if is_many else [surface]
    if not given:
        raise wrong("surface", "a function, or one or more", "none")
    if len(given) == 2 and isinstance(given[1], (int, float)):  # a component and its value
        k, value = given
        how = f"'{k} - {value}'" if isinstance(k, str) else f"lambda x: x[{k}] - {value}"
        received = f"{short(surface)}: pass {how}"
        raise wrong("surface", "a function, or one or more", received, TypeError)
    is_text = all(isinstance(each, str) for each in given)  # what a function returns may change
    changes = (_of_texts if is_text else _of_surfaces)(tuple(given), direction)
    x, batch = checked_starts(system, x0, 2)
    sign, last = -1 if duration < 0.0 else 1, abs(duration) + before
    acts = acts_of(field, changes)
    changed = WithColumns(field.shape, with_changes(field, acts))
    stops = stops_of(changes, sign, batch)
    limit = math.inf if most is None else most
    with reporter(progress, len(x)) as report:
        asked = Asked(np.array([last]), sign, settings, thread_count(threads), report, stops,
                      limit, before)  # fmt: skip
        found = solve(changed, x, batch, asked)
        if report is not None and not found.is_stopped:
            report(len(x))
    points = Crossings._of(
        _attributes(found, x, batch, limit)
        | {
            "body": system,
            "last": sign * last,
            "transient": before,
            "direction": direction,
            "most": most,
            **settings._asdict(),
        }
    )
    ends = points.end.ravel()
    message = ends_in_words(points.status.ravel(), ends, found.is_stopped, x, batch)
    told(message, points, "crossings", on_singular, PoleWarning)
    return points


def _of_surfaces(surfaces: tuple[Any, ...], direction: int) -> tuple[Change, ...]:
    """Return the changes that record crossings of surfaces."""
    return tuple(Change(each, direction=direction) for each in surfaces)


_of_texts = lru_cache(64)(_of_surfaces)  # which keep what they are for a field


def _attributes(found: Any, x: FloatArray, batch: tuple[int, ...], limit: float) -> dict[str, Any]:
    """Return the first `limit` crossings of each trajectory, and what became of trajectories."""
    trajectory, which, time, _, states = found.records
    count = np.bincount(trajectory, minlength=len(x))
    first = np.cumsum(count) - count
    own: Any = slice(None)
    if limit < math.inf:
        own = np.arange(len(trajectory)) - first[trajectory] < limit
    final, status = found.states[0], np.where(found.status == Status.STOPPED, 0, found.status)
    ends = np.flatnonzero(count >= limit)
    if len(ends):
        count[ends], final[ends] = limit, states[first[ends] + int(limit) - 1]
        status[ends] = Status.OK
    return {
        "trajectory": trajectory[own],
        "surface": which[own],
        "time": time[own],
        "states": states[own],
        "count": count.reshape(batch),
        "status": status.astype(np.int8).reshape(batch),
        "end": np.where(status < 0, found.t, np.nan).reshape(batch),
        "final": final.reshape(*batch, x.shape[1]),
        "steps": found.steps.reshape(batch),
    }
