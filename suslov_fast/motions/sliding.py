"""Solutions that slide along a surface at which f jumps: they are computed again, with modes."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from ..checks import warn
from ..core.expressions.event_formulas import EventAction
from ..core.expressions.sliding import SlidingEquations
from ..core.flow.batch_solver import NO_EVENT_TIMES, EventTimes
from ..fields.equations import Equations
from ..fields.field import Field
from ..fields.right_hand_sides import with_events
from ..fields.traced import EQUATIONS, NAMES
from ..status import Status
from .event import traced
from .integration import to_tolerance
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

    `actions` are those of events, in the order of code.
    """

    def __init__(
        self, field: Any, x: Any, batch: Any, where: Any, request: Any, actions: Any
    ) -> None:
        self.found, self.x, self.where, self.system, self.held = None, x, where, field, ()
        self.has_records = request.event_times is not None
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
        """Return `found` and derivatives `of_columns` with these trajectories computed again."""
        where, D = self.where, self.x.shape[1]
        which, event = at_rest
        if which is not None and traced(event, self.system).action not in self.held:
            warn(
                f"events: x0 rests on the surface of {event} in {which.sum()} of {which.size} "
                "trajectories, and leaves it without an event, because a start is none: begin on "
                "the side from which it is crossed, or hold x0 there by a variable for the mode"
            )
        if self.found is None:
            return found, of_columns
        K = (len(where),)
        if names:
            part, columns = with_derivatives(
                self.field, self.starts, K, names, self.request, self.actions
            )
            count = columns.shape[-1]
            kept = [
                c for c in range(count) if "x0" not in names or not D <= c < self.starts.shape[1]
            ]
            own = of_columns.reshape(len(of_columns), -1, *of_columns.shape[-2:])
            own[:, where] = columns[..., :D, kept]
            of_columns = own.reshape(of_columns.shape)
        else:
            groups = WithColumns(self.field.shape, with_events(self.field, self.actions))
            part, kept = to_tolerance(groups, self.starts, K, self.request), None
        part = part._replace(t=part.t.copy(), status=part.status.copy())  # others may share them
        # Modes change without end, as on two surfaces that are crossed, or there is none.
        ends = [Status.ENDED] if self.surfaces else [Status.ENDED, Status.ACCUMULATES]
        part.status[np.isin(part.status, ends)] = Status.SLIDING
        part = part._replace(states=part.states[..., :D])
        if not self.has_records:
            return found.again(where, part._replace(records=None)), of_columns
        whole = found.records.in_order()
        before, states = whole.before, whole.states
        whole = whole._replace(before=before[:, :D], states=states[:, :D], of_columns=None)
        part = part._replace(records=self.records(part.records.in_order(), kept))
        return found._replace(records=whole).again(where, part), of_columns

    def records(self, records: Any, columns: Any = None) -> Any:
        """Return records without those of modes, with the numbers of the whole batch."""
        which = records.which
        is_own = (which >= self.surfaces) & (which <= self.surfaces + self.count)
        kept = ~is_own
        for k, place in self.contacts.items():  # a body that leaves its contact
            is_same = (records.before[:, : self.D] == records.states[:, : self.D]).all(axis=1)
            kept &= (which != k) | ((records.before[:, place] > 0.5) & ~is_same)
        numbers = np.where(which > self.surfaces, which - self.count - 1, which)
        return records._replace(
            trajectory=records.trajectory[kept],
            which=numbers[kept],
            time=records.time[kept],
            before=records.before[kept][:, : self.D],
            states=records.states[kept][:, : self.D],
            of_columns=None,
            derivatives=columns
            and tuple(
                (a[kept][:, : self.D] if a.ndim > 2 else a[kept])[..., columns]
                for a in records.derivatives
            ),
        )


def are_stuck(status: Any, at_rest: Any) -> Any:
    """Return which solutions slide or rest; they take too many steps if they begin on a surface."""
    ends = Status.SLIDING, Status.TOO_MANY_STEPS, Status.ACCUMULATES
    return np.flatnonzero(np.isin(status, ends) | (False if at_rest is None else at_rest))
