"""The search for crossings of surfaces along motions: inside each step, and by shorter steps.

Inside a step `Stepping.inside` is accurate enough for signs of a surface. If they change once, a
crossing lies between the ends. If they change more often, the states at these points are computed
by shorter steps. Each crossing is then a root of the surface along shorter steps of the method from
the state before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray
from ..core.motion.choosing import AT_ONCE
from ..core.motion.engine import Settings
from ..core.motion.refine import crossing_fractions
from ..core.motion.rows import State
from ..core.motion.rules import MOST_STEPS
from ..core.motion.stepping import Stepping
from ..engine.arguments import ALL
from ..engine.motions import right_hand_sides, status_of, threads_for
from ..engine.status import Status
from ..engine.stretches import Report
from .functions import returned_at, values_at
from .search import Surface

PARTS = 8  # of a step, between which signs of surfaces are compared
_NUDGE = 2.0**-50  # part of a step by which the end of a bracket moves on, to lie beyond
_NUDGES = 26  # how often it does, four times as far each time
# Steps of the first stretch between two looks; each has twice as many, up to a limit.
_STEPS, _MOST, _NUMBERS = 4, 4096, 2**20

Indices = NDArray[np.int64]


class Group(NamedTuple):
    """Trajectories with one right-hand side."""

    where: Indices  # of the batch
    engine: Stepping


class Steps(NamedTuple):
    """Steps that trajectories of a group have taken."""

    group: Group
    own: Indices  # the trajectory in the group
    number: Indices  # of the step of a trajectory in this stretch
    rows: FloatArray  # (1 + attempts, trajectories, rows), before and after each attempt
    attempt: Indices
    place: Indices  # the trajectory in `rows`

    def before(self, which: Any = ALL) -> FloatArray:
        """Return the rows (K, rows) before some of these steps."""
        found: FloatArray = self.rows[self.attempt[which], self.place[which]]
        return found

    def after(self, which: Any = ALL) -> FloatArray:
        """Return the rows (K, rows) after some of these steps."""
        found: FloatArray = self.rows[self.attempt[which] + 1, self.place[which]]
        return found


class MotionSearch:
    """A search for crossings along the motions from states x (B, D) to a time `last`, a modulus.

    Attributes
    ----------
    pieces : list
        Of each round: trajectories, surfaces, moduli of times and states of crossings.
    counts, steps, status, t, final
        Of each trajectory (B,), (B, D) for `final`.
    """

    def __init__(
        self,
        field: Any,
        x: FloatArray,
        batch: tuple[int, ...],
        last: float,
        sign: int,
        settings: Settings,
        surfaces: Sequence[Surface],
        direction: int,
        most: int | None,
        transient: float,
        threads: int | None,
    ) -> None:
        self.batch, self.last, self.sign, self.surfaces = batch, last, sign, surfaces
        self.direction, self.limit, self.transient = direction, most or math.inf, transient
        (B, self.D), count, self.groups = x.shape, threads_for(len(x), threads), []
        for where, f, table in right_hand_sides(field.right_hand_sides, field.shape, batch):
            own = np.arange(B) if where is ALL else where
            states = np.empty((1, len(own), self.D))
            arguments = f, table, x[own], [last], sign, settings, states, count
            self.groups.append(Group(own, Stepping(*arguments)))
        self.counts, self.steps, self.tries = np.zeros((3, B), np.int64)
        self.status = np.full(B, Status.OK, np.int8)
        self.t, self.final, self.is_stopped = np.zeros(B), x.copy(), False
        self.active = np.full(B, last > 0.0)
        for group in self.groups:
            self._end(group, np.arange(len(group.where)))
        self.values = self._values_of(x[np.newaxis])[:, 0]
        # Where f has choices, of each surface and trajectory: the time of its last crossing.
        self.has_choices = any(group.engine.choices is not None for group in self.groups)
        self.latest = np.full(self.values.shape if self.has_choices else (0, 0), -np.inf)
        self.pieces: list[tuple[Indices, Indices, FloatArray, FloatArray]] = []

    def _values_of(self, states: FloatArray) -> FloatArray:
        """Return the values (S, rows, B) of all surfaces at states (rows, B, D)."""
        states = states.reshape(len(states), *self.batch, self.D)
        found = []
        for k, surface in enumerate(self.surfaces):
            name = f"surface[{k}]" if len(self.surfaces) > 1 else "surface"
            values = values_at(name, states, returned_at(name, surface, states))
            found.append(values.reshape(len(states), -1))
        return np.array(found)

    def run(self, report: Report | None) -> None:
        """Take all steps; `report` takes the number of trajectories that are done."""
        told, longest = -1, _STEPS
        most = min(max(_NUMBERS // max(PARTS * self.final.size, 1), 1), _MOST)
        while self.active.any() and not self.is_stopped:
            longest = min(longest, most)
            groups = [group for group in self.groups if self.active[group.where].any()]
            self._look([each for group in groups for each in self._stretch(group, longest)])
            for group in self.groups:
                self._end(group, np.flatnonzero(self.active[group.where]))
            done, longest = len(self.active) - int(self.active.sum()), 2 * longest
            if report is not None and done > told:
                told, self.is_stopped = done, not report(done)
        left = self.active
        self.status[left], self.final[left] = Status.TOO_MANY_STEPS, np.nan

    def _stretch(self, group: Group, attempts: int) -> list[Steps]:
        """Let the active trajectories of a group try some steps; return the steps taken."""
        engine, found = group.engine, []
        own = np.flatnonzero(self.active[group.where])
        for k, rows in engine.attempts(engine.flat[own], own, self.last, attempts):
            engine.flat[own[k]] = rows[-1]
            self.tries[group.where[own[k]]] += len(rows) - 1
            counts = rows[:, :, engine.rows.steps]
            is_taken = counts[1:] > counts[:-1]
            attempt, place = np.nonzero(is_taken)
            number = (counts[:-1] - counts[0])[is_taken].astype(np.int64)
            found.append(Steps(group, own[k[place]], number, rows, attempt, place))
        return found

    def _end(self, group: Group, own: Indices) -> None:
        """Note what has become of trajectories of a group, and end those that are done."""
        group.engine.go_on(own)
        rows, flat, where = group.engine.rows, group.engine.flat[own], group.where[own]
        self.t[where], self.steps[where] = flat[:, rows.t], flat[:, rows.steps]
        state = flat[:, rows.state]
        state[(self.tries[where] >= MOST_STEPS) & (state <= State.IMPLICIT)] = State.TOO_MANY
        ended = state > State.IMPLICIT
        flat, state, where = flat[ended], state[ended].astype(int), where[ended]
        self.status[where], self.active[where] = status_of(state), False
        self.final[where] = np.where((state == State.DONE)[:, None], flat[:, : self.D], np.nan)

    # ------------------------------------------------------------------------------- inside a step
    def _look(self, steps: list[Steps]) -> None:
        """Find the crossings in some steps."""
        lane = np.concatenate([each.group.where[each.own] for each in steps])
        if not lane.size:
            return
        number = np.concatenate([each.number for each in steps])
        rows, B, D = int(number.max()) + 1, len(self.active), self.D
        inside = np.full((rows, PARTS, B, D), np.nan)
        inside[number, :, lane] = np.concatenate(
            [each.group.engine.inside(each.before(), each.after(), PARTS) for each in steps]
        )
        values = self._values_of(inside.reshape(-1, B, D)).reshape(-1, rows, PARTS, B)
        # Those of a step, at its start and at the ends of its parts.
        own = np.empty((len(values), PARTS + 1, len(lane)))
        own[:, 1:] = values[:, number, :, lane].transpose(1, 2, 0)
        before = values[:, number - 1, -1, lane]
        own[:, 0] = np.where(number == 0, self.values[:, lane], before)
        is_on = (self.steps[lane] + number == 0) & (own[:, 0] == 0.0)
        own[:, 0] = np.where(is_on, own[:, 1], own[:, 0])  # the side to which a motion goes
        order = np.argsort(number, kind="stable")  # the last step of a trajectory is the last here
        self.values[:, lane[order]] = own[:, -1, order]
        changes = _changes(own)
        which = np.flatnonzero((np.count_nonzero(changes, axis=1) > 1).any(axis=0))
        if which.size:  # the cubic says where to look closer
            m, part = np.repeat(which, PARTS - 1), np.tile(np.arange(PARTS - 1), len(which))
            inside[:] = np.nan
            inside[number[m], part, lane[m]] = self._states(steps, m, (part + 1) / PARTS)[0]
            values = self._values_of(inside.reshape(-1, B, D)).reshape(values.shape)
            own[:, part + 1, m] = values[:, number[m], part, lane[m]]
            changes = _changes(own)
        wanted = changes
        if self.direction and not self.has_choices:
            wanted = changes & ((own[:, 1:] >= 0.0) == (self.direction > 0))
        surface, part, m = np.nonzero(wanted)
        if m.size:
            order = np.lexsort((part, number[m], lane[m]))
            surface, part, m = surface[order], part[order], m[order]
            once = np.count_nonzero(changes, axis=1)[surface, m] == 1
            self._refine(steps, own, lane[m], m, surface, part, once)

    def _states(
        self, steps: list[Steps], m: Indices, fractions: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return states (K, D) and moduli of times (K,) inside steps m of all these steps."""
        states, times, first = np.empty((len(m), self.D)), np.empty(len(m)), 0
        for each in steps:
            k = np.flatnonzero((m >= first) & (m < first + len(each.own)))
            own, rows = m[k] - first, each.group.engine.rows
            before, after = each.before(own), each.after(own)
            lengths = fractions[k] * (after[:, rows.t] - before[:, rows.t])
            found = each.group.engine.after(before, each.own[own], lengths)
            found = np.where((fractions[k] == 1.0)[:, np.newaxis], after, found)
            states[k], times[k] = found[:, : self.D], found[:, rows.t]
            first += len(each.own)
        return states, times

    def _refine(
        self,
        steps: list[Steps],
        values: FloatArray,
        lane: Indices,
        m: Indices,
        surface: Indices,
        part: Indices,
        once: NDArray[np.bool_],
    ) -> None:
        """Find crossings in steps m: in a part of the step, or anywhere inside it if `once`.

        They are in the order of trajectories, and of their steps.
        """
        B, row = len(self.active), np.arange(len(lane)) - np.searchsorted(lane, lane)
        inner, low = part / PARTS, np.where(once, 0.0, part / PARTS)
        size = np.where(once, 1.0, 1.0 / PARTS)
        a, b = values[surface, part, m], values[surface, part + 1, m]
        with np.errstate(all="ignore"):
            guess = (inner + a / (a - b) / PARTS - low) / size
        guess = np.where(np.isfinite(guess), np.clip(guess, 0.0, 1.0), 0.5)
        a = values[surface, np.where(once, 0, part), m]
        b = values[surface, np.where(once, PARTS, part + 1), m]

        def look(k: Indices, fractions: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
            """Return values of the surfaces, states and times at fractions of the brackets."""
            found, times = self._states(steps, m[k], low[k] + size[k] * fractions)
            states = np.full((int(row[k].max()) + 1, B, self.D), np.nan)
            states[row[k], lane[k]] = found
            return self._values_of(states)[surface[k], row[k], lane[k]], found, times

        fractions, over_pole = crossing_fractions(lambda *where: look(*where)[0], guess, a, b)
        # The point that is kept lies beyond the surface, so that a motion from it does not cross.
        states, times = np.empty((len(lane), self.D)), np.empty(len(lane))
        k, step = np.arange(len(lane)), _NUDGE
        fractions = np.minimum(fractions + step, 1.0)
        for left in reversed(range(_NUDGES)):
            found, states[k], times[k] = look(k, fractions[k])
            k = k[(found >= 0.0) != (b[k] >= 0.0)]
            if not k.size:
                break
            fractions[k] = np.minimum(fractions[k] + step, 1.0) if left > 1 else 1.0
            step *= 4.0
        is_wanted = ~over_pole & (times > self.transient)
        if self.has_choices:
            is_wanted &= ~self._at_once(lane, surface, times)
            is_wanted &= (self.direction == 0) | ((b >= 0.0) == (self.direction > 0))
        keep = np.flatnonzero(is_wanted)
        keep = keep[np.lexsort((times[keep], lane[keep]))]
        number = np.arange(len(keep)) - np.searchsorted(lane[keep], lane[keep])
        number += self.counts[lane[keep]]
        keep, number = keep[number < self.limit], number[number < self.limit]
        np.add.at(self.counts, lane[keep], 1)
        self.tries[lane[keep]] = 0
        self.pieces.append((lane[keep], surface[keep], times[keep], states[keep]))
        ends = keep[number + 1 == self.limit]
        self.final[lane[ends]], self.t[lane[ends]] = states[ends], times[ends]
        taken = np.concatenate(
            [
                each.rows[each.attempt + 1, each.place, each.group.engine.rows.steps]
                for each in steps
            ]
        )
        self.steps[lane[ends]] = taken[m[ends]]
        self.active[lane[ends]] = False

    def _at_once(self, lane: Indices, surface: Indices, times: FloatArray) -> NDArray[np.bool_]:
        """Whether crossings follow one of the same surface at once, as where a solution slides.

        Where f drives it back on both sides of a surface, rounding decides on which it lies.
        """
        order = np.lexsort((times, surface, lane))
        k, s, t = lane[order], surface[order], times[order]
        before = self.latest[s, k]
        is_next = (k[1:] == k[:-1]) & (s[1:] == s[:-1])
        before[1:] = np.where(is_next, t[:-1], before[1:])
        np.maximum.at(self.latest, (s, k), t)
        found = np.empty(len(t), np.bool_)
        found[order] = t - before <= AT_ONCE * t
        return found

    def found(self) -> dict[str, Any]:
        """Return the attributes of all crossings, in order, and of trajectories."""
        pieces = [*zip(*self.pieces, strict=True)] or [()] * 4
        empty = np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0), np.empty((0, self.D))
        joined = [np.concatenate([e, *p]) for e, p in zip(empty, pieces, strict=True)]
        trajectory, surface, times, states = joined
        order = np.lexsort((times, trajectory))
        return {
            "trajectory": trajectory[order],
            "surface": surface[order],
            "time": self.sign * times[order],
            "states": states[order],
            "count": self.counts.reshape(self.batch),
            "status": self.status.reshape(self.batch),
            "end": np.where(self.status < 0, self.sign * self.t, np.nan).reshape(self.batch),
            "final": self.final.reshape(*self.batch, self.D),
            "steps": self.steps.reshape(self.batch),
        }


def _changes(values: FloatArray) -> NDArray[np.bool_]:
    """Return where values (S, PARTS + 1, M) change their sign; 0 counts as positive.

    Values that are not finite at an end of the step make no change; inside it they are left out.
    """
    positive, finite = values >= 0.0, np.isfinite(values)
    for k in range(1, values.shape[1] - 1):
        positive[:, k] = np.where(finite[:, k], positive[:, k], positive[:, k - 1])
    changes = positive[:, 1:] != positive[:, :-1]
    found: NDArray[np.bool_] = changes & (finite[:, :1] & finite[:, -1:])
    return found
