"""Solutions that slide along a surface at which f jumps: they are computed again, with modes."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from ..checks import warn
from ..core.expressions.event_formulas import EventAction, in_order_of_code
from ..core.expressions.sliding import SlidingEquations
from ..core.flow.batch_solver import NO_EVENT_TIMES, EventTimes
from ..fields.equations import Equations
from ..fields.field import Field
from ..fields.right_hand_sides import with_events
from ..fields.traced import EQUATIONS, NAMES
from ..results.result import read_only
from ..status import Status
from .event import traced
from .events import actions_of
from .integration import to_tolerance
from .phases import rows_of
from .sensitivities import WithColumns, with_derivatives


@lru_cache(32)
def _with_modes(equations: Equations, actions: tuple[EventAction, ...], sign: int) -> Any:
    """Return equations with modes, and the actions of events: or None if nothing slides."""
    D, P = len(equations.names), len(equations.parameters)
    found = SlidingEquations(equations.values, equations.results, D, P, actions, sign)
    if not found.size:
        return None
    names = [*equations.names, *(f"mode {g}" for g in range(found.size))]
    own = Equations(names, equations.parameters, found.values, found.results)
    return own, found


class Sliding:
    """Trajectories `where` of a field, with modes: their field, starts and request.

    `events` are `Event`s.
    """

    def __init__(
        self, field: Any, x: Any, batch: Any, where: Any, request: Any, events: Any
    ) -> None:
        self.found, self.x, self.where, self.system, self.held = None, x, where, field, ()
        self.has_records = request.event_times is not None
        actions = self.given = actions_of(field, events)
        self.events = [events[k] for k in in_order_of_code(events)]
        if not isinstance(field, Field) or field._equations is None:
            return
        self.found = _with_modes(field._equations, actions, request.sign)
        if self.found is None:
            return
        equations, self.modes = self.found
        self.actions, self.surfaces = self.modes.actions, self.modes.surfaces_of_events
        self.count, size, self.contacts = self.modes.count, self.modes.size, self.modes.contacts
        self.held = tuple(actions[k] for k in self.contacts)
        parts = dict(field.parameters)
        if field.shape:
            parts = {n: np.broadcast_to(a, batch).ravel()[where] for n, a in field._arrays.items()}
        self.field = Field._of({**parts, NAMES: equations.names, EQUATIONS: equations})
        self.D = x.shape[1]
        self.starts = np.concatenate([x[where], np.ones((len(where), size))], axis=1)
        if self.contacts:
            last = abs(request.times).max(initial=0.0)
            self.starts[:, -2:] = last / (1.0 + last), 0.0
        times = (request.event_times or NO_EVENT_TIMES).of(where)
        rows = len(times.times)
        which = times.which + self.count + 1
        first = np.full((rows, 1), float(self.surfaces + self.count))
        times = EventTimes(
            np.concatenate([np.zeros((rows, 1)), times.times], axis=1),
            np.concatenate([first, np.broadcast_to(which, times.times.shape)], axis=1),
        )
        settings = request.settings
        if isinstance(settings.atol, tuple):
            settings = settings._replace(atol=settings.atol + (0.0,) * size)
        self.request = request._replace(event_times=times, settings=settings, report=None)

    def continued(self, found: Any, of_columns: Any, names: Any, at_rest: Any) -> Any:
        """Return `found` and derivatives `of_columns` with these trajectories computed again.

        Also return attributes of the motion: rows of phases and the texts of surfaces.
        """
        where, D = self.where, self.x.shape[1]
        which, event = at_rest
        if which is not None and traced(event, self.system).action not in self.held:
            warn(
                f"events: x0 rests on the surface of {event} in {which.sum()} of {which.size} "
                "trajectories, and leaves it without an event, because a start is none: begin on "
                "the side from which it is crossed, or hold x0 there by a variable for the mode"
            )
        if self.found is None:
            return found, of_columns, {}
        K = (len(where),)
        if names:
            part, columns = with_derivatives(
                self.field, self.starts, K, names, self.request, self.actions
            )
            count = columns.shape[-1]
            kept = [
                c for c in range(count) if "x0" not in names or not D <= c < self.starts.shape[1]
            ]
            columns = columns[..., :D, kept]
        else:
            groups = WithColumns(self.field.shape, with_events(self.field, self.actions))
            part, kept, columns = to_tolerance(groups, self.starts, K, self.request), None, None
        of_part, status = part.records.in_order(), part.status.copy()
        # There are no modes, or they change without end, as on two surfaces that are crossed.
        status[of_part.trajectory[np.isinf(of_part.states[:, D:]).any(axis=1)]] = Status.SLIDING
        if not self.surfaces:
            status[status == Status.ACCUMULATES] = Status.SLIDING
        part = part._replace(states=part.states[..., :D], status=status)
        rows = rows_of(of_part, D, self.count, len(self.contacts))
        part = self.stopped(part._replace(records=self.records(of_part, kept)), columns)
        numbers = rows[:, 0].astype(np.int64)
        rows[:, 0] = where[numbers]
        rows = rows[~(abs(rows[:, 2]) > abs(part.t[numbers]))]
        if columns is not None:
            own = of_columns.reshape(len(of_columns), -1, *of_columns.shape[-2:])
            own[:, where] = columns
            of_columns = own.reshape(of_columns.shape)
        if self.has_records:
            whole = found.records.in_order()
            before, states = whole.before[:, :D], whole.states[:, :D]
            whole = whole._replace(before=before, states=states, of_columns=None)
            found = found._replace(records=whole)
        else:
            part = part._replace(records=None)
        phases = {"_phases": read_only(rows), "_surfaces": self.texts()}
        return found.again(where, part), of_columns, phases

    def stopped(self, part: Any, columns: Any) -> Any:
        """Return the result where contacts end solutions at hit number `most`; columns change."""
        records, times = part.records, abs(self.request.times)
        for k in self.contacts:
            most = self.given[k].most
            hits = np.flatnonzero(records.which == k)
            trajectory = records.trajectory[hits]
            rank = np.arange(len(hits)) - np.searchsorted(trajectory, trajectory)
            last = hits[rank == most - 1]
            stops, ends = records.trajectory[last], part.t.copy()
            ends[stops], part.status[stops] = records.time[last], Status.STOPPED
            later = times[:, np.newaxis] > abs(ends[stops])
            for a in (part.states,) if columns is None else (part.states, columns):
                a[:, stops] = np.where(
                    later[..., *(np.newaxis,) * (a.ndim - 2)], np.nan, a[:, stops]
                )
            bound = np.full(len(ends), len(records.time))
            bound[stops] = last
            kept = np.arange(len(records.time)) <= bound[records.trajectory]
            records = records.selected(kept)
            part = part._replace(records=records, t=ends)
        return part

    def texts(self) -> tuple[str, ...]:
        """Return the texts of the surfaces of modes: of f, then of contacts."""
        equations = self.system._equations
        pairs = [tuple(map(equations.shown, pair)) for pair in self.modes.pairs]
        of_f = (a if b == "0" else f"{a} - ({b})" if " " in b else f"{a} - {b}" for a, b in pairs)
        touching = [traced(self.events[k], self.system) for k in self.contacts]
        return *of_f, *(each.tracer.text(each.surface) for each in touching)

    def records(self, records: Any, columns: Any = None) -> Any:
        """Return records without records of modes, with the numbers of the whole batch."""
        which = records.which
        is_own = (which >= self.surfaces) & (which <= self.surfaces + self.count)
        kept = ~is_own
        for k, place in self.contacts.items():  # a body that leaves its contact
            is_same = (records.before[:, : self.D] == records.states[:, : self.D]).all(axis=1)
            kept &= (which != k) | ((records.before[:, place] > 0.5) & ~is_same)
        found = records.selected(kept)
        numbers = np.where(found.which > self.surfaces, found.which - self.count - 1, found.which)
        derivatives = columns and tuple(
            (a[:, : self.D] if a.ndim > 2 else a)[..., columns] for a in found.derivatives
        )
        before, states = found.before[:, : self.D], found.states[:, : self.D]
        return found._replace(which=numbers, before=before, states=states, derivatives=derivatives)


def are_stuck(status: Any, at_rest: Any) -> Any:
    """Return which solutions slide or rest; some that come to slide end, or take too many steps."""
    ends = Status.SLIDING, Status.TOO_MANY_STEPS, Status.ACCUMULATES, Status.ENDED
    return np.flatnonzero(np.isin(status, ends) | (False if at_rest is None else at_rest))
