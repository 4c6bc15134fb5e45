"""The solution of a system at given times, exact or to a tolerance, with events; its warnings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..bodies.exact import states_at
from ..calls import Progress, flat_arrays, reporter
from ..checks import FloatArray
from ..core.flow.batch_solver import SolverRequest
from ..core.hybrid.event_formulas import EventAction
from ..fields.field import Field
from ..fields.right_hand_sides import with_events
from ..maps.map_records import map_of
from ..maps.problem import Problem
from . import warnings_of_motions
from .event import Event
from .events import actions_of, event_times_of, starts_at_rest
from .integration import SolverResult, empty_result, to_tolerance
from .kept_integrals import warn_of_unkept
from .modes import Sliding, are_stuck
from .sensitivities import with_derivatives


def solution(
    system: Any,
    x0: FloatArray,
    batch: tuple[int, ...],
    request: SolverRequest,
    progress: Progress,
    names: tuple[str, ...],
    events: tuple[Event, ...],
) -> tuple[SolverResult, dict[str, Any]]:
    """Return the motion from x0 (B, D), and its phases; warn if it ends."""
    if progress is None:
        result, phases = _computed(system, x0, batch, request, names, events)
    else:
        total = len(request.times) * math.prod(batch)
        with reporter(progress, total) as report:
            request = request._replace(report=report)
            result, phases = _computed(system, x0, batch, request, names, events)
            if report is not None and total and not result.is_stopped:
                # The engine may report less: it counts equal times once, no states after an end.
                report(total)
    if result.ends is not None:
        causes = warnings_of_motions.causes_of(system)
        warnings_of_motions.warn_of_ends(result, x0, batch, request.settings.atol, causes)
        warnings_of_motions.warn_of_lost_components(system, result, batch)
        warn_of_unkept(result.ends, batch, request.sign, system._layout.times(x0))
    return result, phases


def _computed(
    system: Any,
    x0: FloatArray,
    batch: tuple[int, ...],
    request: SolverRequest,
    names: tuple[str, ...],
    events: tuple[Event, ...],
) -> tuple[SolverResult, dict[str, Any]]:
    """Return the motion from x0 (B, D), and its phases, as attributes of a `Motion`."""
    actions: tuple[EventAction, ...] = ()
    resting, at_rest = None, None
    if events:
        actions = actions_of(system._field, events)
        request = request._replace(event_times=event_times_of(events, request.sign, batch))
        if request.sign > 0:
            resting, at_rest = starts_at_rest(
                system._field, events, x0.reshape(*batch, x0.shape[1])
            )
    if names:
        result = with_derivatives(system._field, x0, batch, names, request, actions)
    elif events:
        groups = with_events(system._field, actions)
        result = to_tolerance(groups, system._field.shape, x0, batch, request)
    elif isinstance(system, Field):
        result = to_tolerance(system._right_hand_sides, system.shape, x0, batch, request)
    else:
        result = _of_body(system, x0, batch, request)
    if result.ends is None and resting is None:  # as in most calls
        return result, {}
    where = are_stuck(result, resting)
    if not len(where):
        return result, {}
    sliding = Sliding(system._field, x0, batch, where, request, events)
    return sliding.continued(result, names, (resting, at_rest))


def _of_body(
    body: Any, x0: FloatArray, batch: tuple[int, ...], request: SolverRequest
) -> SolverResult:
    """Return the motion of a body from states x0 (B, D): exact, to a tolerance, or both."""
    is_exact = body._is_solved  # a truth value, or an array for members
    if np.all(is_exact):
        return _exact(body, x0, batch, request)
    if not np.any(is_exact):
        field = body._field
        return to_tolerance(field._right_hand_sides, field.shape, x0, batch, request)
    is_exact = np.broadcast_to(is_exact, batch).ravel()
    result = empty_result(x0, len(request.times))
    for exact in (True, False):
        where = np.flatnonzero(is_exact == exact)
        parts = {
            name: flat_arrays(a, batch, body._axes.get(name, 0))[where]
            for name, a in body._arrays.items()
        }
        part = _of_body(body._with_parts(parts), x0[where], (len(where),), request)
        result = result.with_part(where, part)
    return result


def _exact(
    body: Any, x0: FloatArray, batch: tuple[int, ...], request: SolverRequest
) -> SolverResult:
    """Return the exact motion of a body; NaN where the closed form is out of range."""
    omega = x0.reshape(*batch, x0.shape[1])
    problem = Problem(map_of(body), body, omega, 0.0, batch, request.threads, "x0")
    result = empty_result(x0, len(request.times))
    states = states_at(problem, request.times, is_number=False).reshape(result.states.shape)
    has_none = np.isnan(states).any(axis=(0, 2)) | np.isnan(x0[:, 0])
    return result._replace(states=states).without_steps(has_none)
