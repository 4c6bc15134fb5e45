"""Steps of right-hand sides with conditions, each of which ends where a condition changes.

Along a step the choices of f are fixed (`lists.conditions`). Where they differ from those of the
state at a point inside a step, or at its end, the step is taken again, to the first point at which
a surface is crossed, and choices are made anew there. A solution that comes back to a surface at
once, again and again, slides along it, and ends.
"""

import numpy as np

from .refine import crossing_fractions
from .rows import State
from .stepping import Stepping
from .text import NUMBER

PARTS = 4  # of a step, between which choices are compared
_NUDGES = 28  # how often the end of a bracket moves on, to lie beyond the surface
# A solution slides that changes its choices so often within so small a part of the time.
_BACK_AND_FORTH, _AT_ONCE = 12, 2.0**-36
_AHEAD = 2.0**-38  # part of the time, within which a surface lies before which a solution ends


class Choosing(Stepping):
    """Trajectories whose steps end where a condition of f changes."""

    def __init__(self, f, table, x0, times, sign, settings, states, threads):
        conditions, self.count = f.conditions, len(x0)
        rows = np.array(np.broadcast_to(table, (len(x0), table.shape[-1])))
        kept = conditions.P + conditions.count
        self.parameters = rows[:, :kept].T.copy()
        own = self.parameters[: conditions.P]
        self.parameters[conditions.P :] = conditions.choices_at(x0.T, own)
        rows = np.ascontiguousarray(f.table_of(self.parameters).T)
        self.at, self.often = np.zeros(len(x0)), np.zeros(len(x0), int)  # of the last change
        self.changed = np.zeros(len(x0), bool)  # choices are to be made anew
        self.ahead = np.zeros(len(x0))  # the time after which they are made
        self.changes = 0  # of all trajectories so far
        super().__init__(f, rows, x0, times, sign, settings, states, threads)

    def attempts(self, flat, which, last, count):
        """See `Stepping.attempts`; a trajectory waits after a change of its choices."""
        k = np.flatnonzero(self.changed[which] & (flat[:, self.rows.state] <= State.IMPLICIT))
        if k.size:
            self._choose(flat, k, which[k])
        found = super().attempts(flat, which, last, count)
        for k, rows in found:
            self._cut(rows, which[k])
            self._go_on(rows, which[k])
        return found

    def _choose(self, flat, k, which):
        """Make the choices of trajectories `which` anew, at the states in rows k."""
        P, D, rows = self.f.conditions.P, self.f.D, self.rows
        x = flat[k, :D].T
        ahead = self.numbers[NUMBER.sign] * self.ahead[which] * flat[k, rows.f : rows.f + D].T
        choices = self.f.conditions.choices_at(x + ahead, self.parameters[:P, which])
        self.parameters[P:, which] = choices
        self.table[which] = self.f.table_of(self.parameters[:, which]).T
        f = self.f.value_and_denominators(x, self.table[which].T)
        flat[k, rows.f : rows.f + len(f)] = f.T
        self.changed[which], self.ahead[which] = False, 0.0

    def _surfaces(self, states, which):
        """Return the values of all surfaces (count, K) at states (K, D)."""
        return self.f.surface_values(states.T, self.table[which].T)

    def _differ(self, states, which):
        """Return which choices (count, K) are others at states (K, D)."""
        values = self._surfaces(states, which)
        return self.f.conditions.choices_of(values) != self.parameters[self.f.conditions.P :, which]

    def _cut(self, rows, which):
        """End the steps between rows (1 + attempts, K, rows) where a condition changes.

        The rows after it are those at its end.
        """
        is_taken = np.diff(rows[:, :, self.rows.steps], axis=0) > 0.0
        step, lane = np.nonzero(is_taken)
        if not step.size:
            return
        before, after, own = rows[step, lane], rows[step + 1, lane], which[lane]
        states = self.inside(before, after, PARTS)
        differ = self._differ_inside(states, own)
        open_ = differ.any(axis=(0, 2))
        while open_.any():
            # The first such step of each trajectory.
            m = np.flatnonzero(open_)
            m = m[np.unique(lane[m], return_index=True)[1]]
            open_[m] = False
            changes = self._look_closer(before[m], after[m], own[m], differ[:, m])
            real = changes.any(axis=(0, 2))
            m, changes = m[real], changes[:, real]
            if m.size:
                ends = self._ends(before[m], after[m], own[m], changes)
                self._note(ends, before[m], after[m], own[m])
                for i, k, end in zip(step[m], lane[m], ends, strict=True):
                    rows[i + 1 :, k] = end
                open_[np.isin(lane, lane[m])] = False

    def _go_on(self, rows, which):
        """Let solutions go on that end just before a surface, because f has no value beyond it."""
        k = np.flatnonzero(rows[-1, :, self.rows.state] == State.ENDED)
        k = k[rows[-1, k, self.rows.t] > 0.0]
        if k.size:
            D, now, own = self.f.D, rows[-1, k], which[k]
            t, first = now[:, self.rows.t], self.rows.f
            ahead = _AHEAD * t
            of_time = (self.numbers[NUMBER.sign] * ahead)[:, np.newaxis]
            differ = self._differ(now[:, :D] + of_time * now[:, first : first + D], own).any(axis=0)
            differ &= t > self.at[own]
            k, own = k[differ], own[differ]
            rows[-1, k, self.rows.state] = rows[0, k, self.rows.state]
            rows[-1, k, self.rows.wanted] = 16.0 * ahead[differ]
            self.ahead[own], self.at[own], self.changed[own] = ahead[differ], t[differ], True
            self.changes += len(own)

    def _differ_inside(self, states, which):
        """Return which choices (count, K, parts) are others at states (K, parts, D)."""
        K, parts, D = states.shape
        differ = self._differ(states.reshape(-1, D), np.repeat(which, parts))
        return differ.reshape(-1, K, parts)

    def _look_closer(self, before, after, which, differ):
        """Return `differ` (count, K, PARTS) for steps, right where they do not change once."""
        once = (differ[:, :, :-1] <= differ[:, :, 1:]).all(axis=(0, 2))
        k = np.flatnonzero(~once)
        if k.size:
            own, part = np.repeat(k, PARTS - 1), np.tile(np.arange(1, PARTS), len(k))
            states = self._states(before[own], after[own], which[own], part / PARTS)
            of_parts = self._differ(states[:, : self.f.D], which[own])
            differ[:, k, : PARTS - 1] = of_parts.reshape(-1, len(k), PARTS - 1)
        return differ

    def _states(self, before, after, which, fractions, saves=False):
        """Return the rows at fractions of steps."""
        is_known = (fractions == 1.0) & (not saves)
        length = after[:, self.rows.t] - before[:, self.rows.t]
        found = self.after(before, which, np.where(is_known, 0.0, fractions * length), saves)
        return np.where(is_known[:, np.newaxis], after, found)

    def _ends(self, before, after, which, differ):
        """Return the rows where the first condition changes in steps, just beyond its surface."""
        parts = np.where(differ.any(axis=2), differ.argmax(axis=2), PARTS)
        c, k = np.nonzero(parts <= np.minimum(parts.min(axis=0) + 1, PARTS - 1))
        once = differ[c, k, -1] & (differ[c, k, :-1] <= differ[c, k, 1:]).all(axis=1)
        low = np.where(once, 0.0, parts[c, k] / PARTS)
        high = np.where(once, 1.0, (parts[c, k] + 1) / PARTS)
        fractions = self._fractions(before, after, which, c, k, low, high)
        earliest = np.full(len(which), np.inf)
        np.minimum.at(earliest, k, fractions)
        return self._states(before, after, which, earliest, saves=True)

    def _fractions(self, before, after, which, c, k, low, high):
        """Return the fractions of steps k at which conditions c have just changed."""
        size, choice = high - low, self.parameters[self.f.conditions.P + c, which[k]]
        is_floor = self.f.conditions.is_floor[c]

        def look(m, fractions):
            """Return values that are 0 on the surface, and which choices are others."""
            own = k[m]
            states = self._states(before[own], after[own], which[own], low[m] + size[m] * fractions)
            values = self._surfaces(states[:, : self.f.D], which[own])
            differ = self.f.conditions.choices_of(values)[c[m], np.arange(len(m))] != choice[m]
            values = values[c[m], np.arange(len(m))]
            level = choice[m] + up[m]
            return np.where(is_floor[m], values - level, values), differ

        every, up = np.arange(len(c)), np.zeros(len(c))
        end = look(every, np.ones(len(c)))[0]
        up = np.where(is_floor & (end >= 1.0), 1.0, 0.0)
        end, start = end - up, look(every, np.zeros(len(c)))[0]
        with np.errstate(all="ignore"):
            guess = np.clip(start / (start - end), 0.0, 1.0)
        guess = np.where(np.isfinite(guess), guess, 0.5)
        fractions, _ = crossing_fractions(lambda *at: look(*at)[0], guess, start, end)
        m, step = every, 2.0**-52
        for left in reversed(range(_NUDGES)):
            m = m[~look(m, fractions[m])[1]]
            if not m.size:
                break
            fractions[m] = np.minimum(fractions[m] + step, 1.0) if left > 1 else 1.0
            step *= 4.0
        return low + size * fractions

    def _note(self, ends, before, after, which):
        """Note the changes of choices at the ends of steps; a solution that slides ends."""
        rows, t = self.rows, ends[:, self.rows.t]
        length = after[:, rows.t] - before[:, rows.t]
        is_at_once = t - self.at[which] <= _AT_ONCE * np.maximum(t, length)
        self.often[which] = np.where(is_at_once, self.often[which] + 1, 0)
        slides = self.often[which] >= _BACK_AND_FORTH
        ends[:, rows.wanted], ends[:, rows.state] = length, before[:, rows.state]
        ends[slides, rows.state] = State.SLIDING
        self.at[which], self.changed[which] = t, True
        self.changes += len(which)


def stepping_of(f, *others):
    """Return the `Stepping` of a right-hand side, with conditions or without."""
    return (Stepping if f.conditions is None else Choosing)(f, *others)
