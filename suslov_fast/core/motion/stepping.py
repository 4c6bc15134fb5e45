"""Trajectories that take one step at a time, so that their caller can look inside each step."""

import numpy as np

from ..threads import in_parts
from .engine import BLOCK, WIDTH, Motion, half_of
from .in_numpy import StepsInNumPy
from .rows import BEGINS, State
from .text import NUMBER


class Stepping(Motion):
    """Trajectories that take the steps of `Motion`; their `Rows` stand in `flat` (B, rows).

    `flat` may be copied, changed and put back: all that a step needs is there.
    """

    def __init__(self, f, table, x0, times, sign, settings, states, threads):
        super().__init__(f, table, x0, times, sign, settings, states)
        self.numbers[NUMBER.most], self.threads, self.report = 0.0, threads, None
        self.last, self.W = float(self.times[-1]), 1 if len(x0) == 1 else WIDTH
        self.rows = half_of(f, False, self.has_atol).rows
        self.flat = np.zeros((len(x0), self.rows.size))
        self.flat[:, : f.D] = x0
        self.flat[:, self.rows.trajectory].view(np.int64)[:] = np.arange(len(x0))
        self.begin(self.flat, np.arange(len(x0)))

    def begin(self, flat, which):
        """Begin trajectories `which` at the states in their rows: f there, and the first length."""
        half = half_of(self.f, False, self.has_atol)
        flat[:, self.rows.state] = BEGINS
        lines = np.ascontiguousarray(flat.T)[np.newaxis]
        StepsInNumPy(half, self, lines, self._table(half, slice(None), which, len(which))).begin()
        flat[:] = lines[0].T

    def attempt(self, flat, which, last=np.inf):
        """Let trajectories try one step each, not beyond the time `last`; change their rows."""
        self.numbers[NUMBER.last] = last
        modes, parts, abandoned = flat[:, self.rows.state].copy(), [], []
        for mode in (State.EXPLICIT, State.IMPLICIT):
            k = np.flatnonzero(modes == mode)
            parts += [(k[i : i + BLOCK], mode) for i in range(0, len(k), BLOCK)]

        def take(number):
            k, mode = parts[number]
            lines = self._lines(flat, k, self.W)
            half = half_of(self.f, mode == State.IMPLICIT, self.has_atol)
            table = self._table(half, slice(None), which[k], self.W)
            self._steps(half, lines, table, np.zeros(len(which), np.int64), k, abandoned)
            back = lines.transpose(0, 2, 1).reshape(-1, self.rows.size)[: len(k)]
            state = back[:, self.rows.state]
            state[state == State.TOO_MANY] = mode  # it has made its one attempt
            flat[k] = back

        if self.threads == 1 or len(parts) == 1:
            for number in range(len(parts)):
                take(number)
        else:
            in_parts(len(parts), take, abandoned)

    def after(self, flat, which, lengths):
        """Return the rows of trajectories `which` a time later: after a step of this length.

        Where such a step is refused, there are shorter ones; without any they are NaN.
        """
        rows, flat = self.rows, flat.copy()
        goal = flat[:, rows.t] + lengths
        flat[:, rows.wanted], k = lengths, np.flatnonzero(lengths > 0.0)
        while k.size:
            now = flat[k]
            wanted, taken = now[:, rows.wanted].copy(), now[:, rows.steps].copy()
            rest = goal[k] - now[:, rows.t]
            self.attempt(now, which[k])
            is_taken = now[:, rows.steps] > taken
            arrives = is_taken & (wanted >= rest)
            fails = ~is_taken & (now[:, rows.state] > State.IMPLICIT)
            now[fails, : self.f.D] = np.nan
            flat[k] = now
            rest = goal[k] - now[:, rows.t]
            flat[k, rows.wanted] = np.minimum(now[:, rows.wanted], rest)
            k = k[~(arrives | fails | (rest <= 0.0))]
        return flat
