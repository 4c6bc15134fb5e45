"""Growth of tangent vectors along motions: variational equations with repeated decomposition.

Columns of V grow, or turn to the direction that grows fastest. A segment of time ends before they
lose their digits; then V = Q R, the logarithms of the diagonal of R are added up, and the next
segment starts with Q. Each trajectory has segment lengths T / 2**m of its own, so that its bits do
not depend on others.

If rates of decay are far apart, as in stiff equations, segments would be a few e-folds of the
second fastest rate. Then an orthonormal frame replaces the columns (`orthonormal_frame`): its
segments end before it loses its angles.

An event may take a direction away, such as one that sets a component to a number. Then a column has
no digits left even after the shortest segment with it. It is dead, with the exponent -inf.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray
from ..core.expressions.event_formulas import EventAction, components_of
from ..core.expressions.orthonormal_frame import SHIFT, with_frame
from ..core.expressions.variational import variational
from ..core.flow.batch_solver import (
    BatchSolver,
    EventTimes,
    SolverRequest,
    closer,
    counted_from_start,
)
from ..core.flow.growing_components import RELATIVE
from ..core.flow.memory import LaneState
from ..fields.right_hand_sides import with_events
from ..maps.kernel_arguments import ALL
from ..status import Status
from .integration import STATUS, SolverResult, empty_result, right_hand_sides

_MOST = 40  # m of the shortest segment
_UNITS = 2**_MOST  # of a phase, the lengths of this segment
_ROOM = 8.0  # of the first segment: its length times the size of f'
# The diagonal of R in a segment: the least part of its largest entry, and of 1, because errors are
# `rtol` times the largest columns so far; and the largest entry.
_LEAST, _LARGEST = 2.0**-10, 2.0**300
_OF_ALL = 2.0**-6  # part of all directions in each of the first columns
_DEAD = 2.0**-40  # part of the largest entry, below which the shortest segment has no digits
_NO_DIGITS = 2.0**-48  # of a column of length 1, which the rounding of a change leaves alone
_OF_PROGRESS = 1000  # parts of the time
# Segments after which a trajectory has a frame, if they are less than a part of the time; most
# components of one; and by how many times `rtol` its columns may differ from orthonormal ones.
_FEW, _PART, _LARGEST_FRAME, _OFF = 64, 2.0**-5, 12, 32.0
# With events: part of the transient and of a phase, which segments end at first. They should not
# end where a state comes from a surface, because they begin without memory, and events often act
# at simple parts of the time.
_LESS, _FIRST = 1.0 - 2.0**-20 / np.pi, 1.0 / np.e


def exponents_of(
    field: Any,
    starts: FloatArray,
    batch: tuple[int, ...],
    request: SolverRequest,
    transient: float,
    actions: tuple[EventAction, ...],
) -> tuple[FloatArray, SolverResult]:
    """Return Lyapunov exponents (B, n), the largest first, and a `SolverResult`: status and ends.

    n counts the components that an action sets, or that have no constant rate in some member.
    `actions` are actions of events, surfaces first.
    """
    (time,), report, event_times = request.times.tolist(), request.report, request.event_times
    found = empty_result(starts, 0)
    members = with_events(field, actions, (), True) if actions else field._listed_right_hand_sides
    groups = right_hand_sides(members, field.shape, batch)
    changed = {i for action in actions for i in components_of(action)}
    drifting = [{*f.steady} - changed for _, f, _ in groups]
    left_out = [*set.intersection(*drifting)] if groups else []
    moving = np.setdiff1d(np.arange(field.dimension), left_out)
    exponents = np.full((len(starts), len(moving)), np.nan)
    if not len(moving):
        found.status[:] = np.where(np.isnan(starts[:, 0]), Status.NONFINITE, Status.OK)
        return exponents, found
    transient *= _LESS if actions else 1.0
    total, before, goes_on = transient + time, 0.0, True
    for where, f, table in groups:
        x, count = starts[where], len(starts[where])
        own = event_times if event_times is None or where is ALL else event_times.of(where)
        run = _Run(f, table, x, moving, request._replace(event_times=own))
        share = count / max(len(starts), 1) / total

        def told(done: float, share: float = share, before: float = before) -> bool:
            return report is None or report(int(_OF_PROGRESS * (before + share * done)))

        goes_on = transient == 0.0 or run.over(transient, told)
        run.begin()
        goes_on = goes_on and run.over(time, lambda done: told(transient + done))
        if goes_on and run.again.any():
            goes_on = run.repeat(x, transient, time, lambda done: told(total))
        exponents[where] = run.exponents()
        found.t[where], found.status[where] = run.t, run.status
        before += share * total
        if not goes_on:
            break
    return exponents, found._replace(is_stopped=not goes_on)


def _slowest_first(slopes: FloatArray) -> FloatArray:
    """Return orthonormal columns (B, n, n) along eigenvectors of f', the slowest to decay first.

    Each column gets a small part of all directions, so that it turns to the slowest ones. Without
    it, a column along a fast eigenvector may stay there, and all segments would be short. Also a
    direction that is slowest only at the start would hold a column for a long time.
    """
    rates, modes = np.linalg.eig(slopes)
    order = np.lexsort((-rates.imag, -rates.real))[:, np.newaxis]
    columns = np.where(rates.imag[:, np.newaxis] < 0.0, modes.imag, modes.real)
    columns = np.take_along_axis(columns, order, axis=-1)
    n = slopes.shape[-1]
    return np.linalg.qr(columns + _OF_ALL * np.cos(1.0 + np.arange(n * n)).reshape(n, n))[0]


class _Run:
    """Trajectories with tangent vectors and sums of the logarithms of their growth."""

    def __init__(
        self,
        f: Any,
        table: FloatArray,
        x: FloatArray,
        moving: NDArray[np.int64],
        request: SolverRequest,
    ) -> None:
        self.f, self.table, self.x, self.moving = f, table, x.copy(), moving
        self.settings, self.threads = request.settings, request.threads
        self.event_times = request.event_times
        self.n = len(self.moving)
        self.tangent = variational(f, self.n, True)
        has_frames = self.n <= _LARGEST_FRAME and not (
            f.is_dense or f.products or f.branches or f.events
        )
        self.has_frames = np.full(len(x), has_frames)
        self.count = np.zeros(len(x), np.int64)  # of segments
        self.passed = np.zeros(len(x), np.int64)  # times of events
        slopes = np.moveaxis(f.jacobian(x.T, table.T), (0, 1), (-2, -1))[..., self.moving, :]
        slopes = np.broadcast_to(slopes[..., self.moving], (len(x), self.n, self.n))
        slopes = np.where(np.isfinite(slopes).all(axis=(1, 2), keepdims=True), slopes, 0.0)
        self.Q = _slowest_first(slopes)
        self.status = np.where(np.isnan(x[:, 0]), Status.NONFINITE, Status.OK).astype(np.int8)
        self.t = np.zeros(len(x))
        self.lost, self.again = np.zeros(x.shape), np.zeros(len(x), bool)
        self.is_first = self.acts = True  # see `repeat`
        self.begin()

    def begin(self) -> None:
        """Set the sums of logarithms to 0, also after the transient."""
        B = len(self.x)
        self.logs, self.duration = np.zeros((B, self.n)), np.zeros(B)
        self.dead = np.zeros((B, self.n), bool)

    def repeat(
        self, x: FloatArray, transient: float, time: float, report: Callable[[float], bool]
    ) -> bool:
        """Compute trajectories with an alarm again, from their starts in x, with relative digits.

        Components that lost theirs have them, and all components after another alarm.
        """
        (which,) = np.nonzero(self.again)
        table = self.table if self.table.ndim == 1 else self.table[which]
        times = self.event_times and self.event_times.of(which)
        request = SolverRequest(
            np.array([time]), 1, closer(self.settings), self.threads, None, times
        )
        run = _Run(self.f, table, x[which], self.moving, request)
        run.is_first, run.acts = False, self.is_first
        run.lost[:] = np.where((self.lost[which] < 0.0) | (not run.acts), RELATIVE, 0.0)
        goes_on = transient == 0.0 or run.over(transient, report)
        run.begin()
        goes_on = goes_on and run.over(time, report)
        if goes_on and run.again.any():
            goes_on = run.repeat(x[which], transient, time, report)
        for name in ("logs", "duration", "dead", "t", "status"):
            getattr(self, name)[which] = getattr(run, name)
        return goes_on

    def over(self, time: float, report: Callable[[float], bool]) -> bool:
        """Advance by `time`; return False if report(time done) is False, which ends the run."""
        if self.event_times is None:
            return self._over(time, report)
        first = _FIRST * time
        return self._over(first, report) and self._over(time - first, lambda t: report(first + t))

    def _over(self, time: float, report: Callable[[float], bool]) -> bool:
        """Advance by `time` in segments of time / 2**m; return False if `report` ends the run."""
        at, level = np.zeros(len(self.x), np.int64), self._first_levels(time)
        self.count[:], by_frame = 0, np.zeros(len(self.x), bool)
        while (active := (self.status == Status.OK) & (at < _UNITS)).any():
            is_slow = (self.count >= _FEW) & (at < _PART * _UNITS)
            by_frame = self.has_frames & (by_frame | is_slow)
            for take, own in ((self._segment, ~by_frame), (self._segment_of_frame, by_frame)):
                for m in np.unique(level[active & own]):
                    which = np.flatnonzero(active & own & (level == m) & (self.status == Status.OK))
                    is_good, is_easy = take(which, time * 2.0**-m, m == _MOST)
                    at[which[is_good]] += _UNITS >> m
                    level[which[~is_good]] += 1
                    fits = at[which] % (_UNITS >> m << 1) == 0
                    level[which[is_easy & fits & (m > 0)]] -= 1
            if not report(time * float(at.mean()) / _UNITS):
                return False
        return True

    def _first_levels(self, time: float) -> NDArray[np.int64]:
        """Return m of the first segment, of length time / 2**m, for each trajectory."""
        slopes = self.f.jacobian(self.x.T, self.table.T)
        size = abs(slopes).sum(axis=1).max(axis=0) * np.ones(len(self.x))
        size = np.where(np.isfinite(size), np.maximum(time * size / _ROOM, 1.0), 1.0)
        return np.minimum(np.ceil(np.log2(size)), _MOST).astype(np.int64)

    def _segment(self, which: NDArray[np.int64], length: float, is_last: bool) -> tuple[Any, Any]:
        """Take a segment; return where it was short enough, and where the next may be longer.

        `which` are numbers of trajectories. If `is_last`, there are no shorter segments.
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
        request = self._request(length, self._event_times_of(which))
        engine = BatchSolver(
            self.tangent, table, start, request, states, self.lost[which], self.acts
        )
        engine.run(self.threads)
        self._note_alarms(engine, which)
        (end,), status = states, STATUS[engine.state]
        ended = status != Status.OK
        columns = end[:, D:-2].reshape(K, n, D)[:, :, self.moving]
        V = columns.transpose(0, 2, 1) / sizes[:, None, None]
        V[~np.isfinite(V).all(axis=(1, 2))] = np.eye(n)
        Q, R = np.linalg.qr(V)
        diagonal = abs(np.diagonal(R, axis1=1, axis2=2))
        is_changed, passed = self._changes_of(engine, K)
        lives = ~self.dead[which]
        largest = diagonal.max(axis=1, where=lives, initial=0.0)
        matters = lives.copy()  # the trace of f' tells of the last column, without a change
        matters[:, -1] &= is_changed | ~lives.all(axis=1) | bool(self.f.products)
        least = diagonal.min(axis=1, where=matters, initial=np.inf)
        part = least / np.maximum(largest, 1.0)
        # With events, columns may have become infinite in place of the state.
        is_end = ended & (is_last | (self.event_times is None))
        self.status[which[is_end]] = status[is_end]
        self.t[which[is_end]] += engine.t[is_end]
        is_good = ~ended & (is_last | (part > _LEAST) & (largest < _LARGEST))
        go = which[is_good]
        with np.errstate(all="ignore"):
            logs = np.log(diagonal[is_good])
            of_trace = end[is_good, -1] / sizes[is_good] - logs[:, :-1].sum(axis=1)
        logs[:, -1] = np.where(matters[is_good, -1], logs[:, -1], of_trace)
        self.logs[go] += np.where(lives[is_good], logs, 0.0)
        self.x[go], self.Q[go], self.lost[go] = end[is_good, :D], Q[is_good], engine.lost[is_good]
        self.passed[go] += passed[is_good]
        self.count[go] += 1
        self.duration[go] += length
        self.t[go] += length
        if is_last and self.event_times is not None:
            least = np.maximum(_DEAD * largest, _NO_DIGITS)[:, np.newaxis]
            dies = is_good[:, np.newaxis] & matters & (diagonal <= least)
            for k in np.flatnonzero(dies.any(axis=1)):
                self._bury(which[k], dies[k], V[k])
        return is_good, is_good & (part * part > _LEAST)

    def _segment_of_frame(
        self, which: NDArray[np.int64], length: float, is_last: bool
    ) -> tuple[Any, Any]:
        """Take a segment with frames; return masks: it was short enough, the next may be longer.

        Trajectories, of numbers `which`, that do not reach its end have no frames from then on.
        """
        D, n, K = self.f.D, self.n, len(which)
        frame = with_frame(self.f, tuple(self.moving.tolist()))
        table = self.table if self.table.ndim == 1 else self.table[which]
        table, x, starts = counted_from_start(self.f, table, self.x[which])
        start, states = np.zeros((K, frame.D)), np.full((1, K, frame.D), np.nan)
        start[:, :D], start[:, D:-n] = x, self.Q[which].reshape(K, n * n) + SHIFT
        table = np.ascontiguousarray(frame.table_of(table.T).T)
        request = self._request(length)
        lost = self.lost[which], self.acts
        engine = BatchSolver(frame, table, start, request, states, *lost)
        engine.run(self.threads)
        self._note_alarms(engine, which)
        (end,), ended = states, STATUS[engine.state] != Status.OK
        if starts is not None:
            end[:, [*self.f.offsets]] += starts
        V = end[:, D:-n].reshape(K, n, n) - SHIFT
        V[~np.isfinite(V).all(axis=(1, 2))] = np.eye(n)
        off = abs(V.transpose(0, 2, 1) @ V - np.eye(n)).max(axis=(1, 2))
        Q, R = np.linalg.qr(V)
        self.has_frames[which[ended]] = False
        most = _OFF * self.settings.rtol
        is_good = ~ended & (is_last | (off <= most))
        go = which[is_good]
        diagonal = abs(np.diagonal(R, axis1=1, axis2=2))
        self.logs[go] += end[is_good, -n:] + np.log(diagonal[is_good])
        self.x[go], self.Q[go], self.lost[go] = end[is_good, :D], Q[is_good], engine.lost[is_good]
        self.duration[go] += length
        self.t[go] += length
        return is_good, is_good & (4.0 * off <= most)

    def _note_alarms(self, engine: BatchSolver, which: NDArray[np.int64]) -> None:
        """End the trajectories `which` that `engine` would compute again."""
        ends = engine.state == LaneState.AGAIN
        self.again[which[ends]], self.status[which[ends]] = True, Status.TOO_MANY_STEPS
        self.lost[which[ends]] = engine.lost[ends]

    def _event_times_of(self, which: NDArray[np.int64]) -> EventTimes | None:
        """Return the times of events left for trajectories `which`, counted from their present."""
        if self.event_times is None or not self.event_times.times.size:
            return self.event_times
        both = self.event_times.times, self.event_times.which
        times, numbers = (np.broadcast_to(a, (len(self.x), a.shape[1])) for a in both)
        times, numbers, passed = times[which], numbers[which], self.passed[which, np.newaxis]
        is_left = np.arange(times.shape[1]) >= passed
        times = np.where(is_left, np.maximum(times - self.t[which, np.newaxis], 0.0), np.inf)
        order = np.argsort(times, axis=1, kind="stable")
        return EventTimes(
            np.take_along_axis(times, order, 1), np.take_along_axis(numbers, order, 1)
        )

    def _request(self, length: float, event_times: EventTimes | None = None) -> SolverRequest:
        return SolverRequest(np.array([length]), 1, self.settings, event_times=event_times)

    def _changes_of(
        self, engine: BatchSolver, K: int
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Return where events acted on K trajectories of `engine`, and how many at given times."""
        if self.event_times is None:
            return np.zeros(K, bool), np.zeros(K, np.int64)
        rows = np.concatenate([np.empty((0, 2)), *(each[:, :2] for each in engine.records)])
        trajectory, number = rows.copy().view(np.int64).T
        at_times = trajectory[number >= self.f.events.surfaces]
        return np.bincount(trajectory, minlength=K) > 0, np.bincount(at_times, minlength=K)

    def _bury(self, k: int, are_lost: NDArray[np.bool_], V: FloatArray) -> None:
        """Move columns that have lost their digits to the end; their exponents are -inf.

        `V` has the columns of trajectory k; `are_lost` is True for columns without digits.
        """
        self.dead[k] |= are_lost
        order = np.argsort(self.dead[k], kind="stable")
        self.dead[k], self.logs[k] = self.dead[k, order], self.logs[k, order]
        self.Q[k] = np.linalg.qr(V[:, order])[0]

    def exponents(self) -> FloatArray:
        """Return the exponents (B, n), the largest first; NaN for motions that ended."""
        logs = np.where(self.dead, -np.inf, self.logs)
        with np.errstate(all="ignore"):
            rates = logs / self.duration[:, np.newaxis]
        rates[self.status != Status.OK] = np.nan
        return -np.sort(-rates, axis=1)
