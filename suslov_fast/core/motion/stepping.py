"""Trajectories that take one step at a time, so that their caller can look inside each step."""

import numpy as np

from ..compiling.threads import in_parts
from .arguments import NUMBER
from .engine import BLOCK, WIDTH, Motion, half_of
from .rows import BEGINS, State


class Stepping(Motion):
    """Trajectories that take the steps of `Motion`; their `Rows` stand in `flat` (B, rows).

    `flat` may be copied, changed and put back: all that a step needs is there. Clocks do not count
    from the start.
    """

    counts_from_start = False

    def __init__(self, f, table, x0, times, sign, settings, states, threads):
        super().__init__(f, table, x0, times, sign, settings, states)
        self.numbers[NUMBER.most], self.threads, self.report = 0.0, threads, None
        self.W = 1 if len(x0) == 1 else WIDTH
        self.flat = np.zeros((len(x0), self.rows.size))
        self.flat[:, : f.D] = x0
        self.flat[:, self.rows.trajectory].view(np.int64)[:] = np.arange(len(x0))
        self.begin(self.flat, np.arange(len(x0)))

    def begin(self, flat, which):
        """Begin trajectories `which` at the states in their rows: f there, and the first length."""
        half = half_of(self.f, False, self.has_atol)
        flat[:, self.rows.state] = BEGINS
        for first in range(0, len(flat), self.W):  # without a budget lanes begin, and take no step
            part = slice(first, first + self.W)
            rows = np.ascontiguousarray(flat[part])
            table = self._table(half, which[part])
            self._taker(half, rows, table, self.W, budget=0)()
            flat[part] = rows
            self.keep_choices(which[part], table)

    def attempts(self, flat, which, last, count):
        """Let trajectories `which` with these rows try some steps each, not beyond a time.

        Return pairs: numbers of trajectories in `flat`, and their rows (1 + attempts, K, rows), of
        which the first are those of `flat`. A trajectory waits that turns to the other half.
        """
        self.numbers[NUMBER.last] = last
        state, parts, abandoned = flat[:, self.rows.state], [], []
        for mode in (State.EXPLICIT, State.IMPLICIT):
            k = np.flatnonzero(state == mode)
            parts += [(k[i : i + BLOCK], mode) for i in range(0, len(k), BLOCK)]
        found = [None] * len(parts)

        def take(number):
            k, mode = parts[number]
            half = half_of(self.f, mode == State.IMPLICIT, self.has_atol)
            rows = flat[k]
            table = self._table(half, which[k])
            step = self._taker(half, rows, table, self.W)
            states, copies, taken = rows[:, self.rows.state], np.empty((count + 1, *rows.shape)), 0
            copies[0] = rows
            while taken < count and np.count_nonzero(states == mode) and not abandoned:
                while not step() and not abandoned:
                    pass
                states[states == State.TOO_MANY] = mode  # it has made its one attempt
                taken += 1
                copies[taken] = rows
            found[number] = k, copies[: taken + 1]
            self.keep_choices(which[k], table)

        if self.threads == 1 or len(parts) == 1:
            for number in range(len(parts)):
                take(number)
        else:
            in_parts(len(parts), take, abandoned, self.threads)
        return found
