"""Growth of tangent vectors along motions: variational equations, decomposed from time to time.

Columns of V grow, or turn to the direction that grows fastest. A segment of time ends before they
lose their digits; then V = Q R, logarithms of the diagonal of R are added up, and Q goes on. Each
trajectory has lengths of its own, T / 2**m, so that its bits do not depend on others.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray
from ..core.lists.variational import variational
from ..core.motion.engine import Settings
from .motions import Found, call_engine, nothing_found, right_hand_sides
from .status import Status

_MOST = 40  # m of the shortest segment
_UNITS = 2**_MOST  # of a phase, the lengths of this segment
_ROOM = 8.0  # of the first segment: its length times the size of f'
# The diagonal of R in a segment: the least part of its largest entry, and of 1, because errors are
# `rtol` times the largest columns so far; and the largest entry.
_LEAST, _LARGEST = 2.0**-10, 2.0**300
_OF_PROGRESS = 1000  # parts of the time


def exponents_of(
    field: Any,
    starts: FloatArray,
    batch: tuple[int, ...],
    time: float,
    transient: float,
    settings: Settings,
    threads: int,
    report: Callable[[int], bool] | None,
) -> tuple[FloatArray, Found]:
    """Return exponents (B, n), the largest first, of n components that are no clocks, and ends."""
    found, exponents = nothing_found(starts, 0), None
    groups = list(right_hand_sides(field.listed_right_hand_sides, field.shape, batch))
    total, before = transient + time, 0.0
    for where, f, table in groups:
        x, count = starts[where], len(starts[where])
        run = _Run(f, table, x, settings, threads)

        share = count / len(starts) / total

        def told(done: float, share: float = share, before: float = before) -> bool:
            return report is None or report(int(_OF_PROGRESS * (before + share * done)))

        goes_on = transient == 0.0 or run.over(transient, told)
        run.begin()
        goes_on = goes_on and run.over(time, partial(_later, told, transient))
        own = run.exponents()
        if exponents is None:
            exponents = np.full((len(starts), own.shape[1]), np.nan)
        exponents[where] = own
        found.t[where], found.status[where] = run.t, run.status
        before += share * total
        if not goes_on:
            break
    if exponents is None:
        exponents = np.empty((0, field.dimension))
    return exponents, found


def _later(told: Callable[[float], bool], before: float, done: float) -> bool:
    return told(before + done)


def _slowest_first(slopes: FloatArray) -> FloatArray:
    """Return orthonormal columns (B, n, n) along eigenvectors of f', the slowest to decay first.

    A column in a fast direction that no other mode reaches would stay there, and every segment
    would be a few of its e-folds.
    """
    rates, modes = np.linalg.eig(slopes)
    order = np.lexsort((-rates.imag, -rates.real))[:, np.newaxis]
    columns = np.where(rates.imag[:, np.newaxis] < 0.0, modes.imag, modes.real)
    columns = np.take_along_axis(columns, order, axis=-1)
    return np.linalg.qr(columns + 2.0**-40 * np.eye(slopes.shape[-1]))[0]


class _Run:
    """Trajectories with tangent vectors; `over` goes on by a phase of time."""

    def __init__(self, f: Any, table: FloatArray, x: FloatArray, settings: Settings, threads: int):
        self.f, self.table, self.x = f, table, x.copy()
        self.settings, self.threads = settings, threads
        self.moving = np.setdiff1d(np.arange(f.D), [*f.clocks])
        self.n = len(self.moving)
        self.tangent = variational(f, self.n, True)
        slopes = np.moveaxis(f.jacobian(x.T, table.T), (0, 1), (-2, -1))[..., self.moving, :]
        slopes = np.broadcast_to(slopes[..., self.moving], (len(x), self.n, self.n))
        slopes = np.where(np.isfinite(slopes).all(axis=(1, 2), keepdims=True), slopes, 0.0)
        self.Q = _slowest_first(slopes)
        self.status = np.where(np.isnan(x[:, 0]), Status.NONFINITE, Status.OK).astype(np.int8)
        self.t = np.zeros(len(x))
        self.begin()

    def begin(self) -> None:
        """Forget the sums."""
        B = len(self.x)
        self.logs, self.trace, self.duration = np.zeros((B, self.n)), np.zeros(B), np.zeros(B)

    def over(self, time: float, told: Callable[[float], bool]) -> bool:
        """Take a phase; return False if `told`, which takes the time that is done, ended it."""
        at, level = np.zeros(len(self.x), np.int64), self._first_levels(time)
        while (active := (self.status == Status.OK) & (at < _UNITS)).any():
            for m in np.unique(level[active]):
                which = np.flatnonzero(active & (level == m))
                is_good, is_easy = self._segment(which, time * 2.0**-m, m == _MOST)
                at[which[is_good]] += _UNITS >> m
                level[which[~is_good]] += 1
                fits = at[which] % (_UNITS >> m << 1) == 0
                level[which[is_easy & fits & (m > 0)]] -= 1
            if not told(time * float(at.mean()) / _UNITS):
                return False
        return True

    def _first_levels(self, time: float) -> NDArray[np.int64]:
        """Return m for the first segments."""
        slopes = self.f.jacobian(self.x.T, self.table.T)
        size = abs(slopes).sum(axis=1).max(axis=0) * np.ones(len(self.x))
        size = np.where(np.isfinite(size), np.maximum(time * size / _ROOM, 1.0), 1.0)
        return np.minimum(np.ceil(np.log2(size)), _MOST).astype(np.int64)

    def _segment(self, which: NDArray[np.int64], length: float, is_last: bool) -> tuple[Any, Any]:
        """Take a segment; return where it was not too long, and where it may be longer.

        With `is_last` there is no shorter one.
        """
        D, n, K = self.f.D, self.n, len(which)
        sizes = np.exp2(np.round(np.log2(abs(self.x[which]).max(axis=1) + 2.0**-500)))
        start = np.zeros((K, self.tangent.D))
        start[:, :D] = self.x[which]
        columns = start[:, D:-2].reshape(K, n, D)
        columns[:, :, self.moving] = self.Q[which].transpose(0, 2, 1) * sizes[:, None, None]
        start[:, -2] = sizes
        states = np.full((1, K, self.tangent.D), np.nan)
        table = self.table if self.table.ndim == 1 else self.table[which]
        arguments = self.tangent, table, start, np.array([length]), 1, self.settings, states
        _, t, _, status = call_engine(*arguments, self.threads)
        (end,) = states
        ended = status != Status.OK
        columns = end[:, D:-2].reshape(K, n, D)[:, :, self.moving]
        V = columns.transpose(0, 2, 1) / sizes[:, None, None]
        V[~np.isfinite(V).all(axis=(1, 2))] = np.eye(n)
        Q, R = np.linalg.qr(V)
        diagonal = abs(np.diagonal(R, axis1=1, axis2=2))
        largest = diagonal.max(axis=1)
        part = diagonal[:, :-1].min(axis=1, initial=np.inf) / np.maximum(largest, 1.0)
        self.status[which[ended]] = status[ended]
        self.t[which[ended]] += t[ended]
        is_good = ~ended & (is_last | (part > _LEAST) & (largest < _LARGEST))
        go = which[is_good]
        with np.errstate(divide="ignore"):
            self.logs[go] += np.log(diagonal[is_good])
        self.trace[go] += end[is_good, -1] / sizes[is_good]
        self.x[go], self.Q[go] = end[is_good, :D], Q[is_good]
        self.duration[go] += length
        self.t[go] += length
        return is_good, is_good & (part * part > _LEAST)

    def exponents(self) -> FloatArray:
        """Return the mean rates; the last one follows from the trace of f'."""
        logs = self.logs.copy()
        logs[:, -1] = self.trace - logs[:, :-1].sum(axis=1)
        with np.errstate(all="ignore"):
            rates = logs / self.duration[:, np.newaxis]
        rates[self.status != Status.OK] = np.nan
        return -np.sort(-rates, axis=1)
