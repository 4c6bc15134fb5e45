"""The search for crossings of surfaces along motions: inside each step, and by shorter steps.

Between its ends a step is a cubic with the values and rates there, whose accuracy is enough for
signs of a surface at points inside; a step of the implicit half is a straight line. If signs change
once, a crossing lies between the ends. If they change more often, the states at these points are
computed by shorter steps. Each crossing is then a root of the surface along shorter steps of the
method from the state before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray
from ..core.motion.engine import Settings
from ..core.motion.rows import State
from ..core.motion.rules import MOST_STEPS
from ..core.motion.stepping import Stepping
from ..engine.motions import right_hand_sides, status_of, threads_for
from ..engine.arguments import ALL
from ..engine.status import Status
from ..engine.stretches import Report
from .functions import returned_at, values_at
from .refine import crossing_fractions
from .search import Surface

PARTS = 8  # of a step, between which signs of surfaces are compared
_NUDGES = 12  # how often the end of a bracket moves on, to lie beyond the surface

Indices = NDArray[np.int64]


class Group(NamedTuple):
    """Trajectories with one right-hand side."""

    where: Indices  # of the batch
    steps: Stepping


class Taken(NamedTuple):
    """Steps that trajectories of a group have taken."""

    group: Group
    own: Indices  # in the group
    before: FloatArray  # rows
    after: FloatArray
    length: FloatArray


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
        for where, f, table in right_hand_sides(field._right_hand_sides, field.shape, batch):
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
        told = -1
        while self.active.any() and not self.is_stopped:
            steps = [taken for group in self.groups if len((taken := self._step(group)).own)]
            if steps:
                self._look(steps)
            for group in self.groups:
                self._end(group, np.flatnonzero(self.active[group.where]))
            done = len(self.active) - int(self.active.sum())
            if report is not None and done > told:
                told, self.is_stopped = done, not report(done)
        left = self.active
        self.status[left], self.final[left] = Status.TOO_MANY_STEPS, np.nan

    def _step(self, group: Group) -> Taken:
        """Let the active trajectories of a group try a step each; return the steps taken."""
        own, rows = np.flatnonzero(self.active[group.where]), group.steps.rows
        before = group.steps.flat[own]
        after = before.copy()
        group.steps.attempt(after, own, self.last)
        group.steps.flat[own] = after
        taken = after[:, rows.steps] > before[:, rows.steps]
        length = after[:, rows.t] - before[:, rows.t]
        self.tries[group.where[own]] += 1
        return Taken(group, own[taken], before[taken], after[taken], length[taken])

    def _end(self, group: Group, own: Indices) -> None:
        """Note what has become of trajectories of a group, and end those that are done."""
        rows, flat, where = group.steps.rows, group.steps.flat[own], group.where[own]
        self.t[where], self.steps[where] = flat[:, rows.t], flat[:, rows.steps]
        state = flat[:, rows.state]
        state[(self.tries[where] >= MOST_STEPS) & (state <= State.IMPLICIT)] = State.TOO_MANY
        ended = state > State.IMPLICIT
        flat, state, where = flat[ended], state[ended].astype(int), where[ended]
        self.status[where], self.active[where] = status_of(state), False
        self.final[where] = np.where((state == State.DONE)[:, None], flat[:, : self.D], np.nan)

    # ------------------------------------------------------------------------------- inside a step
    def _look(self, steps: list[Taken]) -> None:
        """Find the crossings in steps of different trajectories."""
        B, inside = len(self.active), np.full((PARTS, len(self.active), self.D), np.nan)
        for taken in steps:
            inside[:, taken.group.where[taken.own]] = self._between(taken)
        values = np.concatenate([self.values[:, np.newaxis], self._values_of(inside)], axis=1)
        moved = np.concatenate([taken.group.where[taken.own] for taken in steps])
        self.values[:, moved] = values[:, -1, moved]
        changes = _changes(values)
        which = np.flatnonzero((np.count_nonzero(changes, axis=1) > 1).any(axis=0))
        if which.size:  # the cubic says where to look closer
            fractions = np.arange(1, PARTS) / PARTS
            lanes, parts = np.repeat(which, PARTS - 1), np.tile(fractions, len(which))
            states = np.full((PARTS - 1, B, self.D), np.nan)
            of_lanes, _ = self._states(steps, lanes, parts)
            states[np.tile(np.arange(PARTS - 1), len(which)), lanes] = of_lanes
            values[:, 1:PARTS, which] = self._values_of(states)[:, :, which]
            changes = _changes(values)
        if not changes.any():
            return
        positive = values[:, 1:] >= 0.0
        wanted = changes & (positive if self.direction > 0 else ~positive)
        lane, surface, part = np.nonzero((wanted if self.direction else changes).transpose(2, 0, 1))
        if lane.size:
            once = np.count_nonzero(changes, axis=1)[surface, lane] == 1
            self._refine(steps, values, lane, surface, part, once)

    def _between(self, taken: Taken) -> FloatArray:
        """Return the states (PARTS, K, D) at the ends of the parts of steps."""
        D, rows = self.D, taken.group.steps.rows
        x, f = taken.before[:, :D], taken.before[:, D : 2 * D]
        new, f_new = taken.after[:, :D], taken.after[:, D : 2 * D]
        u = (np.arange(1, PARTS + 1) / PARTS)[:, np.newaxis, np.newaxis]
        with np.errstate(over="ignore", invalid="ignore"):
            change, h = new - x, (self.sign * taken.length)[:, np.newaxis]
            bend = (1.0 - 2.0 * u) * change + (u - 1.0) * (h * f) + u * (h * f_new)
            bend *= u * (u - 1.0)
            bend[:, taken.before[:, rows.state] == State.IMPLICIT] = 0.0
            states = x + u * change + bend
        states[-1] = new
        return states

    def _states(
        self, steps: list[Taken], lanes: Indices, fractions: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return states (K, D) and moduli of times (K,) inside the steps of some trajectories."""
        states, times = np.empty((len(lanes), self.D)), np.empty(len(lanes))
        for taken in steps:
            place = np.full(len(self.active), -1)
            place[taken.group.where[taken.own]] = np.arange(len(taken.own))
            k = np.flatnonzero(place[lanes] >= 0)
            own, rows = place[lanes[k]], taken.group.steps.rows
            lengths = fractions[k] * taken.length[own]
            found = taken.group.steps.after(taken.before[own], taken.own[own], lengths)
            at_end = (fractions[k] == 1.0)[:, np.newaxis]
            found = np.where(at_end, taken.after[own], found)
            states[k], times[k] = found[:, : self.D], found[:, rows.t]
        return states, times

    def _refine(
        self,
        steps: list[Taken],
        values: FloatArray,
        lane: Indices,
        surface: Indices,
        part: Indices,
        once: NDArray[np.bool_],
    ) -> None:
        """Find crossings of surfaces by trajectories: in a part of a step, or anywhere if `once`.

        They are ordered by trajectory.
        """
        B, row = len(self.active), np.arange(len(lane)) - np.searchsorted(lane, lane)
        inner, size = part / PARTS, np.where(once, 1.0, 1.0 / PARTS)
        low = np.where(once, 0.0, inner)
        a, b = values[surface, part, lane], values[surface, part + 1, lane]
        with np.errstate(all="ignore"):
            guess = (inner + a / (a - b) / PARTS - low) / size
        guess = np.where(np.isfinite(guess), np.clip(guess, 0.0, 1.0), 0.5)
        a = values[surface, np.where(once, 0, part), lane]
        b = values[surface, np.where(once, PARTS, part + 1), lane]

        def look(which: Indices, fractions: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
            """Return values of the surfaces, states and times at fractions of the brackets."""
            found, times = self._states(steps, lane[which], low[which] + size[which] * fractions)
            states = np.full((int(row[which].max()) + 1, B, self.D), np.nan)
            states[row[which], lane[which]] = found
            return self._values_of(states)[surface[which], row[which], lane[which]], found, times

        fractions, over_pole = crossing_fractions(lambda *where: look(*where)[0], guess, a, b)
        # The point that is kept lies beyond the surface, so that a motion from it does not cross.
        states, times = np.empty((len(lane), self.D)), np.empty(len(lane))
        k, step = np.arange(len(lane)), 2.0**-52
        for left in reversed(range(_NUDGES)):
            found, states[k], times[k] = look(k, fractions[k])
            k = k[(found >= 0.0) != (b[k] >= 0.0)]
            if not k.size:
                break
            fractions[k] = np.minimum(fractions[k] + step, 1.0) if left > 1 else 1.0
            step *= 4.0
        keep = np.flatnonzero(~over_pole & (times > self.transient))
        keep = keep[np.lexsort((times[keep], lane[keep]))]
        number = np.arange(len(keep)) - np.searchsorted(lane[keep], lane[keep])
        number += self.counts[lane[keep]]
        keep, number = keep[number < self.limit], number[number < self.limit]
        np.add.at(self.counts, lane[keep], 1)
        self.tries[lane[keep]] = 0
        self.pieces.append((lane[keep], surface[keep], times[keep], states[keep]))
        ends = keep[number + 1 == self.limit]
        self.final[lane[ends]], self.t[lane[ends]] = states[ends], times[ends]
        self.active[lane[ends]] = False

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
    """Return where values (S, PARTS + 1, B) change their sign; 0 counts as positive.

    Values that are not finite at an end of the step make no change; inside it they are left out.
    """
    positive, finite = values >= 0.0, np.isfinite(values)
    for k in range(1, values.shape[1] - 1):
        positive[:, k] = np.where(finite[:, k], positive[:, k], positive[:, k - 1])
    changes = positive[:, 1:] != positive[:, :-1]
    return changes & (finite[:, :1] & finite[:, -1:])
