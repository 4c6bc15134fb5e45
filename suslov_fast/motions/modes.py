"""Solutions that slide along surfaces at which f jumps, or rest: computed again, with modes.

A mode is a further component of the state, see `core/hybrid/sliding.py`: 0 while the solution
slides along its surface.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from ..checks import warn
from ..core.expressions.programs import Program, emitted, in_order
from ..core.flow.batch_solver import NO_EVENT_TIMES, EventTimes
from ..core.flow.tolerances import AT_ONCE
from ..core.hybrid.event_formulas import EventAction, in_order_of_code
from ..core.hybrid.sliding import SlidingEquations
from ..fields.equations import Equations
from ..fields.field import Field
from ..fields.layout import Layout
from ..fields.right_hand_sides import with_events
from ..fields.traced import EQUATIONS, LAYOUT
from ..results.result import read_only
from ..status import Status
from .actions_on_constraints import action_of
from .event import traced
from .events import actions_of
from .extension import Extension, divided, extended, with_atol
from .integration import SolverResult
from .phases import rows_of
from .sensitivities import with_derivatives


@lru_cache(32)
def _with_modes(equations: Equations, actions: tuple[EventAction, ...], sign: int) -> Any:
    """Return equations with modes, as `Equations` and `SlidingEquations`; None without any mode."""
    D, P = len(equations.names), len(equations.parameters)
    rows, count, positions, _ = invariants = equations.invariants
    modes = SlidingEquations(equations.values, equations.results, D, P, actions, sign, invariants)
    if not modes.size:
        return None
    names = [*equations.names, *(f"mode {g}" for g in range(modes.size))]
    program = in_order(equations.values, [*rows])
    program = Program(program[0].operations, program[1])
    known = {i: i for i in range(D)} | {D + p: D + modes.size + p for p in range(P)}
    rows = emitted(modes.values, program, known) if rows else []
    kept = {"residuals": rows[:count], "conserved": rows[count:]} if rows else {}
    about: Any = {"quantities": kept, "positions": positions}
    return Equations(names, equations.parameters, modes.values, modes.results, **about), modes


class Sliding:
    """Trajectories `where` (K,) of a batch of solutions, to be computed again with modes.

    field, starts, request   equations, states x0 and request with modes
    contacts                 {number of an event at which a body may rest: component of the mode};
                             numbers count events on surfaces first
    modes                    `SlidingEquations`, or None if no solution can slide or rest; then the
                             first three are not set
    """

    def __init__(
        self, field: Any, x: Any, batch: Any, where: Any, request: Any, events: Any
    ) -> None:
        self.x, self.where, self.system = x, where, field
        self.modes: Any = None
        self.contacts: dict[int, int] = {}
        actions = self.given = actions_of(field, events)
        self.events = [events[k] for k in in_order_of_code(events)]
        with_modes = field._equations and _with_modes(field._equations, actions, request.sign)
        if not with_modes:
            return
        equations, self.modes = with_modes
        self.actions, self.surfaces = self.modes.actions, self.modes.surfaces_of_events
        self.count, size, self.contacts = self.modes.count, self.modes.size, self.modes.contacts
        parts = dict(field.parameters)
        if field.shape:
            parts = {n: np.broadcast_to(a, batch).ravel()[where] for n, a in field._arrays.items()}
        self.field = Field._of({**parts, LAYOUT: Layout(equations.names), EQUATIONS: equations})
        self.D = x.shape[1]
        self.starts, self.atol = extended(x[where], np.ones((len(where), size))), (0.0,) * size
        if self.modes.has_clock:
            last = abs(request.times).max(initial=0.0)
            self.starts[:, -2:] = last / (1.0 + last), 0.0
        times = (request.event_times or NO_EVENT_TIMES).of(where)
        rows = len(times.times)
        which = np.broadcast_to(times.which + self.count + 1, times.times.shape)
        times = EventTimes(  # before the given times, time 0 for the event that sets all modes
            np.concatenate([np.zeros((rows, 1)), times.times], axis=1),
            np.concatenate([np.full((rows, 1), float(self.surfaces + self.count)), which], axis=1),
        )
        self.request = request._replace(event_times=times, report=None)
        if self.modes.recorders:  # `records` finds crossings that the engine does not count
            self.request = self.request._replace(most=np.inf)

    def continued(self, result: Any, names: Any, at_rest: Any) -> Any:
        """Return the result with trajectories `where` computed again, and attributes of `Motion`.

        The attributes say when solutions slide or rest. Solutions are differentiated with respect
        to `names`. `at_rest` is from `starts_at_rest`.
        """
        where, D = self.where, self.x.shape[1]
        which, event = at_rest
        held = [self.given[k] for k in self.contacts]
        if which is not None and action_of(event, self.system) not in held:
            warn(
                f"events: x0 rests on the surface of {event} in {which.sum()} of {which.size} "
                "trajectories, and leaves it without an event, because a start is none: begin on "
                "the side from which it is crossed, or hold x0 there by a variable for the mode"
            )
        if self.modes is None:
            return result, {}
        K, field = (len(where),), self.field
        kept = None
        if names:
            settings = with_atol(self.request.settings, self.atol)
            request = self.request._replace(settings=settings)
            part = with_derivatives(field, self.starts, K, names, request, self.actions)
            size = self.system._layout.size
            others = slice(size, self.starts.shape[1]) if "x0" in names else ()  # time, modes
            kept = np.delete(np.arange(part.derivatives.shape[-1]), others)
            states, derivatives = divided(part.states, D)[0], part.derivatives[..., :D, kept]
            part = part._replace(states=states, derivatives=derivatives)
        else:
            groups = with_events(field, self.actions)
            extension = Extension(groups, field.shape, self.starts, D, self.atol)
            part, _ = extension.run(K, self.request)
        of_part, ends = part.records.in_order(), part.all_ends
        status = ends.status
        # An infinite mode marks a failure, as if no values of modes are consistent: status SLIDING,
        # unless the next action finds some. If the user has no events on surfaces, changes of modes
        # accumulate: SLIDING, too.
        failed = of_part.trajectory[np.isinf(of_part.states[:, D:]).any(axis=1)]
        status[failed[status[failed] < 0]] = Status.SLIDING
        if not self.surfaces:
            status[status == Status.ACCUMULATES] = Status.SLIDING
        part = part._replace(ends=ends)
        rows = rows_of(of_part, D, self.count, len(self.contacts))
        part = self.stopped(part._replace(records=self.records(of_part, kept)))
        numbers = rows[:, 0].astype(np.int64)
        rows[:, 0] = where[numbers]
        rows = rows[~(abs(rows[:, 2]) > abs(ends.t[numbers]))]
        phases = {"_phases": read_only(rows), "_surfaces": self.texts()}
        # Without events of the user, the result has no records.
        return result.again(where, part._replace(records=result.records and part.records)), phases

    def stopped(self, part: Any) -> Any:
        """Return a result that ends where a contact was hit `most` times; later states are NaN."""
        records, times = part.records, abs(self.request.times)
        for k in self.contacts:
            most = self.given[k].most
            hits = np.flatnonzero(records.which == k)
            trajectory = records.trajectory[hits]
            rank = np.arange(len(hits)) - np.searchsorted(trajectory, trajectory)
            last = hits[rank == most - 1]
            stops = records.trajectory[last]
            part.ends.t[stops], part.ends.status[stops] = records.time[last], Status.STOPPED
            n, later = np.nonzero(times[:, np.newaxis] > abs(records.time[last]))
            part.states[n, stops[later]] = np.nan
            if part.derivatives is not None:
                part.derivatives[n, stops[later]] = np.nan
            bound = np.full(len(part.ends.t), len(records.time))
            bound[stops] = last
            records = records.selected(np.arange(len(records.time)) <= bound[records.trajectory])
        return part._replace(records=records)

    def texts(self) -> tuple[str, ...]:
        """Return the surfaces of modes as texts: surfaces of f, then of contacts."""
        equations = self.system._equations
        pairs = [tuple(map(equations.shown, pair)) for pair in self.modes.pairs.values()]
        of_f = (a if b == "0" else f"{a} - ({b})" if " " in b else f"{a} - {b}" for a, b in pairs)
        touching = [traced(self.events[k], self.system) for k in self.contacts]
        return *of_f, *(each.tracer.text(each.surface) for each in touching)

    def records(self, records: Any, columns: Any = None) -> Any:
        """Return the records of events that a user gave, without those of modes.

        States have no modes. The numbers of events count those on surfaces first, then others.
        Derivatives keep only the directions with the numbers in `columns`.
        """
        records = self._with_crossings(records)
        which = records.which
        kept = (which < self.surfaces) | (which > self.surfaces + self.count)
        for k, place in self.contacts.items():  # a body that leaves its contact is not an event
            is_same = (records.before[:, : self.D] == records.states[:, : self.D]).all(axis=1)
            kept &= (which != k) | ((records.before[:, place] > 0.5) & ~is_same)
        found, D = records.selected(kept), self.D
        number = np.where(found.which > self.surfaces, found.which - self.count - 1, found.which)
        found = found._replace(which=number, before=found.before[:, :D], states=found.states[:, :D])
        if columns is None:
            return found
        return found._replace(
            time_by=found.time_by[:, columns],
            before_by=found.before_by[:, :D, columns],
            states_by=found.states_by[:, :D, columns],
        )

    def _with_crossings(self, records: Any) -> Any:
        """Return records in which changes of modes are the crossings of their surfaces.

        They replace the records of events that only record: where a solution comes to a surface,
        slides, and leaves it, the sign of s is rounding. Changes that follow at once count as one.
        """
        recorders, begins = self.modes.recorders, self.surfaces + self.count
        others = ~np.isin(records.which, [*recorders])
        rows = [np.flatnonzero(others)]
        numbers = [records.which[rows[0]]]
        for k, g in recorders.items():
            before, after = records.before[:, self.D + g], records.states[:, self.D + g]
            (changes,) = np.nonzero((before != after) & others & (records.which != begins))
            trajectory, time = records.trajectory[changes], records.time[changes]
            is_new = np.ones(len(changes), bool)
            is_new[1:] = trajectory[1:] != trajectory[:-1]
            is_new[1:] |= abs(np.diff(time)) > AT_ONCE * abs(time[1:])
            is_last = np.append(is_new[1:], True)[: len(changes)]
            change = after[changes[is_last]] - before[changes[is_new]]
            counts = np.isfinite(change) & (abs(time[is_last]) > self.request.since)
            counts &= (change != 0.0) & (change * self.given[k].direction >= 0.0)
            rows.append(changes[is_last][counts])
            numbers.append(np.full(len(rows[-1]), k))
        order = np.argsort(places := np.concatenate(rows), kind="stable")
        which, found = np.concatenate(numbers)[order], records.selected(places[order])
        found, is_new = found._replace(which=which), np.isin(which, [*recorders])
        for name in ("before", "before_by"):
            if (own := getattr(found, name)) is not None:
                later = getattr(found, name.replace("before", "states"))
                own[is_new] = later[is_new]
        return found


def are_stuck(result: SolverResult, at_rest: Any) -> Any:
    """Return the numbers of solutions that may slide, by their status, or rest at the start."""
    status = result.all_ends.status
    may_slide = (status < 0) & (status != Status.NONFINITE)
    return np.flatnonzero(may_slide | (False if at_rest is None else at_rest))
