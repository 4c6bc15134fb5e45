"""The choices of right-hand sides with conditions, which are fixed along steps and made anew after.

A step ends just beyond a surface on which a condition changes (`rules.CUT`). A solution that comes
back to surfaces at once, again and again, slides along them, and ends.
"""

import numpy as np

from ..lists.variational import Variational
from .arguments import NUMBER
from .rows import OF_CHANGES, State
from .rules import GROWN

# A solution slides that changes its choices so often within so small a part of the time.
_BACK_AND_FORTH, AT_ONCE = 12, 2.0**-36
# Parts of the time: within which a surface lies before which a solution ends, at first within
# `_NEAR`; and within which one that ends so again slides.
_NEAR, _AHEAD, _AGAIN = 2.0**-44, 2.0**-38, 2.0**-28


class Choices:
    """The choices of all trajectories of a `Motion`; they stand in its table, one row for each."""

    def __init__(self, motion):
        self.motion, self.f, B = motion, motion.f, len(motion.x0)
        self.conditions = self.f.conditions
        P = self.conditions.P
        table = np.broadcast_to(motion.table, (B, motion.table.shape[-1]))
        self.inputs = table[:, : P + self.conditions.jumps + self.conditions.kinks].T.copy()
        self.inputs[P:] = self.conditions.choices_at(self._watched(motion.x0), self.inputs[:P])
        motion.table = np.ascontiguousarray(self.f.table_with(self.inputs, table.T).T)
        self.at, self.often = np.zeros(B), np.zeros(B, int)  # of the last change

    def _watched(self, states):
        """Return the components (-, K) on which choices depend, of states (K, D)."""
        return states[:, : self.conditions.D].T

    def look(self, flat, which, table):
        """Write the choices of kinks at the states in rows of trajectories `which` to a table.

        A trajectory may have several rows: its states at different times.
        """
        P, first = self.conditions.P, self.conditions.P + self.conditions.jumps
        if self.conditions.kinks:
            kinks = self.conditions.kinks_at(self._watched(flat), self.inputs[:P, which])
            table[:, first : first + len(kinks)] = kinks.T

    def renew(self, flat, which):
        """Make the choices of trajectories `which`, with these rows, anew where f jumps."""
        rows, state = self.motion.rows, flat[:, self.motion.rows.state]
        (k,) = np.nonzero(state >= State.CHANGED)
        if k.size:
            own, t = which[k], flat[k, rows.t]
            is_at_once = t - self.at[own] <= AT_ONCE * np.maximum(t, flat[k, rows.wanted])
            is_at_once &= ~self._are_changed(flat, k)  # whose changes are counted elsewhere
            self.often[own] = np.where(is_at_once, self.often[own] + 1, 0)
            self.at[own] = t
            before = flat[k, rows.f : rows.f + self.f.D]
            self._choose(flat, k, own, np.zeros(len(k)))
            self._forget_low(flat, k, before)
            ahead = _AHEAD * np.where(t > 0.0, t, self.motion.last)
            back = self._jumps_ahead(flat, k, own, ahead)
            if back.any():
                self._seek(flat, k[back], ahead[back])
            slides = self.often[own] >= _BACK_AND_FORTH
            state[k] = np.where(slides, State.SLIDING, state[k] - State.CHANGED)
        t = flat[:, rows.t]
        (k,) = np.nonzero((state == State.ENDED) & ((t > self.at[which]) | (t == 0.0)))
        if k.size:
            self._go_on(flat, k, which[k])

    def _seek(self, flat, k, ahead):
        """Let the next steps of rows k end on a surface that they cross within a time."""
        rows, watched = self.motion.rows, self.conditions.D
        flat[k, rows.far : rows.far + watched] = self._ahead(flat, k, ahead)[:, :watched]
        flat[k, rows.whole], flat[k, rows.wanted] = flat[k, rows.wanted], ahead
        flat[k, rows.inner], flat[k, rows.outer] = 0.0, ahead
        flat[k, rows.weight], flat[k, rows.rounds] = 0.0, 0.0

    def _forget_low(self, flat, k, before):
        """Forget that components were small to which the jump of f is an inflow of their own."""
        rows = self.motion.rows
        low, count = flat[:, rows.low : rows.far], rows.far - rows.low
        if count and low[k].any():
            after = flat[k, rows.f : rows.f + count]
            is_inflow = abs(after - before[:, :count]) > GROWN * abs(before[:, :count])
            low[k] = np.where(is_inflow & (low[k] < 3.0), 0.0, low[k])

    def _go_on(self, flat, k, which):
        """Let solutions go on that end just before a surface, because f has no value beyond it."""
        rows, jumps = self.motion.rows, self.conditions.jumps
        now = self._choices_ahead(flat, k, which, np.zeros(len(k)))[jumps:]
        whole = np.where(flat[k, rows.t] > 0.0, flat[k, rows.t], self.motion.last)
        differ, ahead = np.zeros(len(k), bool), _NEAR * whole
        while True:
            choices = self._choices_ahead(flat, k, which, ahead)
            differ = self._jumps_ahead(flat, k, which, ahead) | (choices[jumps:] != now).any(axis=0)
            is_near = ahead < _AHEAD * whole
            if not (is_near & ~differ).any():
                break
            ahead = np.where(differ, ahead, np.minimum(8.0 * ahead, _AHEAD * whole))
        k, which, ahead = k[differ], which[differ], ahead[differ]
        if k.size:
            t = flat[k, rows.t]
            again = t - self.at[which] <= _AGAIN * t
            self.often[which] = np.where(again, self.often[which] + 1, 0)
            self.at[which] = t
            first_state = self.motion.numbers[NUMBER.first_state]
            slides = self.often[which] >= _BACK_AND_FORTH
            flat[k, rows.state] = np.where(slides, State.SLIDING, first_state)
            flat[k, rows.wanted], flat[k, rows.outer] = 16.0 * ahead, np.inf
            self._move(flat, k, ahead)
            self._choose(flat, k, which, np.zeros(len(k)))

    def _move(self, flat, k, ahead):
        """Let the states of rows k move on beyond a surface, and those at times passed be saved."""
        rows, motion, D = self.motion.rows, self.motion, self.f.D
        places, numbers = (flat[:, i].view(np.int64) for i in (rows.place, rows.trajectory))
        after = flat[k, rows.t] + ahead
        while (passed := (flat[k, rows.next] <= after) & (flat[k, rows.state] < State.DONE)).any():
            i = k[passed]
            states = self._ahead(flat, i, flat[i, rows.next] - flat[i, rows.t])
            motion.states[places[i], numbers[i]] = states
            places[i] += 1
            flat[i, rows.next], flat[i, rows.second] = motion.times[places[i] + [[0], [1]]]
            flat[i, rows.tries] = 0.0
        flat[k, :D], flat[k, rows.t] = self._ahead(flat, k, ahead), after
        is_last = (after >= motion.last) & (flat[k, rows.state] < State.DONE)
        flat[k[is_last], rows.state], flat[k[is_last], rows.t] = State.DONE, motion.last

    def _are_changed(self, flat, k):
        """Return whether changes of the state have acted just now, which take care of columns."""
        if not self.f.changes:
            return np.zeros(len(k), bool)
        rows = self.motion.rows
        return flat[k, rows.of_changes + OF_CHANGES.at] == flat[k, rows.t]

    def _jumps_ahead(self, flat, k, which, ahead):
        """Return whether choices of jumps are others a time later than those that rows k have."""
        choices, P = self._choices_ahead(flat, k, which, ahead), self.conditions.P
        return (choices != self.inputs[P:, which])[: self.conditions.jumps].any(axis=0)

    def _choices_ahead(self, flat, k, which, ahead):
        """Return the choices (-, K) at the states of rows k, or a time later."""
        parameters = self.inputs[: self.conditions.P, which]
        return self.conditions.choices_at(self._watched(self._ahead(flat, k, ahead)), parameters)

    def _ahead(self, flat, k, ahead):
        """Return the states (K, D) of rows k a time later, along their rates."""
        D, first = self.f.D, self.motion.rows.f
        of_time = (self.motion.numbers[NUMBER.sign] * ahead)[:, np.newaxis]
        return flat[k, :D] + of_time * flat[k, first : first + D]

    def _choose(self, flat, k, which, ahead):
        """Make the choices of trajectories `which` anew, at the states of rows k or later."""
        f, rows, motion, P = self.f, self.motion.rows, self.motion, self.conditions.P
        old, tables = self.inputs[P:, which], motion.table[which]
        self.look(flat[k], which, tables)
        tables = tables.T
        self.inputs[P:, which] = choices = self._choices_ahead(flat, k, which, ahead)
        motion.table[which] = f.table_with(self.inputs[:, which], tables).T
        x, table = flat[k, : f.D].T, motion.table[which].T
        rates = f.value_and_denominators(x, table)
        if isinstance(f, Variational) and self.conditions.jumps:
            differ = (choices != old)[: self.conditions.jumps] & ~self._are_changed(flat, k)
            surfaces = np.array(self.conditions.surfaces, int)
            first = np.where(differ.any(axis=0), surfaces[differ.argmax(axis=0)], -1)
            x = f.after_jump(x, flat[k, rows.f : rows.f + f.D].T, rates, tables, first)
            flat[k, : f.D] = x.T
            largest = flat[k, rows.largest : rows.largest + f.D]
            flat[k, rows.largest : rows.largest + f.D] = np.maximum(largest, abs(x.T))
            rates = f.value_and_denominators(x, table)
        flat[k, rows.f : rows.f + len(rates)] = rates.T
