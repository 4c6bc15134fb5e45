"""Growth of tangent vectors along motions: variational equations with repeated decomposition.

Tangent vectors, the columns of V, grow, and turn to the direction that grows fastest. A segment of
time ends before they lose their digits. Then V = Q R, the logarithms of the diagonal of R are added
up, and the next segment starts with Q. The segments of each trajectory have lengths T / 2**m, and m
depends on this trajectory alone, so that its bits do not depend on the batch.

If rates of decay are far apart, as in stiff equations, segments would be very short: a few e-folds
of the second fastest rate. Then an orthonormal frame replaces the columns (`orthonormal_frame`),
and a segment ends before the columns of the frame lose their right angles, or the tangent space of
constraints has turned too far from the axes of the frame.

An event may remove a direction, as an event does that sets a component to a number. Then a column
has no digits left even after the shortest segment with this event. The column is called dead, and
its exponent is -inf.

Constraints of mechanics hold on a manifold. There the columns of Q span its tangent space, so they
are as many as it has dimensions: off the manifold equations of motion have no meaning.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls import ALL
from ..checks import FloatArray
from ..core.expressions.orthonormal_frame import SHIFT, with_frame
from ..core.expressions.variational import variational
from ..core.flow import batch_solver
from ..core.flow.batch_solver import BatchSolver, EventTimes, SolverRequest
from ..core.flow.growing_components import TRIES
from ..core.flow.memory import UNKEPT, LaneState
from ..core.hybrid.event_formulas import EventAction, components_of
from ..fields.constraints import constraints_of
from ..fields.right_hand_sides import with_events
from ..maps.ordered_algebra import dual_product, orthonormal
from ..status import Status
from .extension import divided, extended
from .integration import STATUS, SolverResult, empty_result, right_hand_sides
from .tangent_spaces import TangentSpaces
from .tolerances import (
    DEAD_DIAGONAL,
    DIAGONAL_WITHOUT_DIGITS,
    FEW_SEGMENTS,
    HALVINGS_OF_SEGMENTS,
    LARGEST_DIAGONAL,
    LARGEST_FRAME,
    LEAST_DIAGONAL,
    LEAST_GROWTH,
    LONGEST_FIRST_SEGMENT,
    PART_OF_ALL_DIRECTIONS,
    PART_OF_FEW_SEGMENTS,
    PARTS_OF_PROGRESS,
    POWERS_OF_SLOPES,
    SKEWNESS_OF_FRAME,
    TURN_OF_TANGENT_SPACE,
)

_UNITS = 2**HALVINGS_OF_SEGMENTS  # number of shortest segments in the whole time
# With events, _LESS shortens the transient, and the time is cut at its part _FIRST before it is cut
# into segments. A segment should not end just after an event, because the next one begins without
# memory of surfaces that were met; and events often act at simple parts of the time.
_LESS, _FIRST = 1.0 - 2.0**-20 / np.pi, 1.0 / np.e


def exponents_of(
    field: Any,
    starts: FloatArray,
    batch: tuple[int, ...],
    request: SolverRequest,
    transient: float,
    actions: tuple[EventAction, ...],
) -> tuple[FloatArray, SolverResult]:
    """Return Lyapunov exponents (B, n), the largest first, and a `SolverResult` with the ends.

    Left out are components that have a constant rate in all members, and that no event sets, and
    directions off constraints.
    """
    (time,), report, event_times = request.times.tolist(), request.report, request.event_times
    result = empty_result(starts, 0)
    groups = right_hand_sides(with_events(field, actions, ()), field.shape, batch)
    changed = {i for action in actions for i in components_of(action)}
    drifting = [{*f.steady} - changed for _, f, _ in groups]
    left_out = [*set.intersection(*drifting)] if groups else []
    moving = np.setdiff1d(np.arange(field._layout.D), left_out)
    constraints = constraints_of(field)
    spaces = TangentSpaces(field, constraints, batch, moving) if constraints else None
    count = spaces.size if spaces else len(moving)
    exponents = np.full((len(starts), count), np.nan)
    if not count:
        return exponents, result.without_steps(np.isnan(starts[:, 0]))
    transient *= _LESS if actions else 1.0
    total, before, goes_on = transient + time, 0.0, True
    for where, f, table in groups:
        x = starts[where]
        times = event_times if event_times is None or where is ALL else event_times.of(where)
        of_group = spaces and spaces.of(where)
        run = _Run(f, table, x, moving, request._replace(event_times=times), of_group)
        share = len(x) / max(len(starts), 1) / total

        def told(done: float, share: float = share, before: float = before) -> bool:
            return report is None or report(int(PARTS_OF_PROGRESS * (before + share * done)))

        goes_on = run.through(transient, time, told)
        exponents[where] = run.exponents()
        ends = result.all_ends
        ends.t[where], ends.status[where], ends.unkept[where] = run.t, run.status, run.unkept
        before += share * total
        if not goes_on:
            break
    return exponents, result._replace(is_stopped=not goes_on)


def _slowest_first(slopes: FloatArray) -> FloatArray:
    """Return orthonormal columns (B, n, n): first the directions that grow, or decay slowly.

    With a shift s above the rates of growth, powers of the transpose of f' - s turn columns to the
    directions in which it is large; the complements of these are the slow ones. Each column also
    has a small part of all directions, so that it turns to the slowest of them. A column that
    stayed along a fast eigenvector would make all segments short.
    """
    B, n, _ = slopes.shape
    # Processors differ in the last digits of eigenvalues, cosines, and perhaps f'. No bit of the
    # result depends on them, because s is a power of 2, and other numbers are rounded.
    rates = np.linalg.eigvals(slopes).real.max(axis=1)
    grows = rates > LEAST_GROWTH * abs(slopes).max(axis=(1, 2))
    shift = np.where(grows, np.ldexp(1.0, np.frexp(1.37 * rates)[1]), 0.0)
    shifted = slopes - shift[:, np.newaxis, np.newaxis] * np.eye(n)
    generic = np.cos(1.0 + np.arange(n * n)).reshape(n, n).round(6)
    columns = np.tile(generic, (B, 1, 1))
    for _ in range(POWERS_OF_SLOPES):
        columns, _ = orthonormal(dual_product(shifted, columns))
    return orthonormal(columns[..., ::-1].round(6) + PART_OF_ALL_DIRECTIONS * generic)[0]


def _slowest_first_in(basis: FloatArray, left: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return `_slowest_first` columns (B, n, d) in spaces with `TangentSpaces.coordinates`."""
    known = np.isfinite(basis).all(axis=(1, 2), keepdims=True)
    basis = np.where(known, basis, np.eye(*basis.shape[1:]))
    left = np.where(known, left, np.eye(*left.shape[1:]))
    return dual_product(np.swapaxes(basis, 1, 2), _slowest_first(left @ slopes @ basis))


def _decomposed(V: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Q and the moduli of the diagonal of R, where Q R = V (K, n, n); Q = 1 if V is NaN."""
    V[~np.isfinite(V).all(axis=(1, 2))] = np.eye(V.shape[-1])
    return orthonormal(V)


class _Run:
    """Trajectories with tangent vectors and sums of the logarithms of their growth.

    spaces   the `TangentSpaces` of the n tangent vectors, or None if these span all directions
    """

    def __init__(
        self,
        f: Any,
        table: FloatArray,
        x: FloatArray,
        moving: NDArray[np.int64],
        request: SolverRequest,
        spaces: TangentSpaces | None = None,
    ) -> None:
        self.f, self.table, self.x, self.moving = f, table, x.copy(), moving
        self.spaces = spaces
        self.settings, self.threads = request.settings, request.threads
        self.event_times = request.event_times
        self.n = spaces.size if spaces else len(self.moving)
        self.tangent = variational(f, self.n, True)
        is_plain = not (f.is_dense or f.products or f.hybrid.chooses or f.hybrid.acts)
        self.has_frames = np.full(len(x), is_plain and self.n <= LARGEST_FRAME)
        self.count = np.zeros(len(x), np.int64)  # number of segments so far
        self.passed = np.zeros(len(x), np.int64)  # number of given times of events so far
        slopes = np.moveaxis(f.jacobian(x.T, table.T), (0, 1), (-2, -1))[..., self.moving, :]
        square = len(x), len(self.moving), len(self.moving)
        slopes = np.broadcast_to(slopes[..., self.moving], square)
        slopes = np.where(np.isfinite(slopes).all(axis=(1, 2), keepdims=True), slopes, 0.0)
        self.Q = (
            _slowest_first_in(*spaces.coordinates(x), slopes) if spaces else _slowest_first(slopes)
        )
        self.status = np.where(np.isnan(x[:, 0]), Status.NONFINITE, Status.OK).astype(np.int8)
        self.t, self.unkept = np.zeros(len(x)), np.zeros((len(x), UNKEPT))
        self.lost, self.again = np.zeros(x.shape), np.zeros(len(x), bool)
        self.tried, self.acts = 0, True  # how many of `TRIES` this run follows, see `_repeat`
        self.begin()

    def begin(self) -> None:
        """Set the sums of logarithms to 0, at the start and after the transient."""
        B = len(self.x)
        self.logs, self.duration = np.zeros((B, self.n)), np.zeros(B)
        self.dead = np.zeros((B, self.n), bool)

    def through(self, transient: float, time: float, report: Callable[[float], bool]) -> bool:
        """Advance by the transient and by `time`, and again after alarms; return as `over` does."""
        x = self.x.copy()
        goes_on = transient == 0.0 or self.over(transient, report)
        self.begin()
        goes_on = goes_on and self.over(time, lambda done: report(transient + done))
        if not (goes_on and self.again.any()):
            return goes_on
        return self._repeat(x, transient, time, lambda done: report(transient + time))

    def _repeat(
        self, x: FloatArray, transient: float, time: float, report: Callable[[float], bool]
    ) -> bool:
        """Compute trajectories again from x after an alarm, with relative digits where lost."""
        (which,) = np.nonzero(self.again)
        times = self.event_times and self.event_times.of(which)
        settings = self.settings if self.tried else batch_solver.closer(self.settings)
        request = SolverRequest(np.array([time]), 1, settings, self.threads, event_times=times)
        spaces = self.spaces and self.spaces.of(which)
        run = _Run(self.f, self._table(which), x[which], self.moving, request, spaces)
        own = TRIES[self.tried]
        run.tried, run.acts = self.tried + 1, own.acts
        run.lost[:] = own.marks(self.lost[which])
        goes_on = run.through(transient, time, report)
        for name in ("logs", "duration", "dead", "t", "status", "unkept"):
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
        at = np.zeros(len(self.x), np.int64)
        level = self._first_levels(time)
        by_frame = np.zeros(len(self.x), bool)
        self.count[:] = 0
        while (active := (self.status == Status.OK) & (at < _UNITS)).any():
            is_slow = (self.count >= FEW_SEGMENTS) & (at < PART_OF_FEW_SEGMENTS * _UNITS)
            by_frame = self.has_frames & (by_frame | is_slow)
            for take, chosen in ((self._segment, ~by_frame), (self._segment_of_frame, by_frame)):
                for m in np.unique(level[active & chosen]):
                    is_next = active & chosen & (level == m) & (self.status == Status.OK)
                    which = np.flatnonzero(is_next)
                    is_good, is_easy = take(which, time * 2.0**-m, m == HALVINGS_OF_SEGMENTS)
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
        size = np.where(
            np.isfinite(size), np.maximum(time * size / LONGEST_FIRST_SEGMENT, 1.0), 1.0
        )
        part, power = np.frexp(size)  # the least power of 2 that is not below `size`
        return np.minimum(power - (part == 0.5), HALVINGS_OF_SEGMENTS).astype(np.int64)

    def _segment(self, which: NDArray[np.int64], length: float, is_last: bool) -> tuple[Any, Any]:
        """Take a segment; return masks: it was short enough, and the next one may be longer.

        If `is_last` is True, the segment counts as short enough, because it is the shortest one.
        """
        D, n, K = self.f.D, self.n, len(which)
        sizes = np.exp2(np.round(np.log2(abs(self.x[which]).max(axis=1) + 2.0**-500)))
        columns, u_and_s = np.zeros((K, n, D)), np.stack([sizes, np.zeros(K)], axis=1)
        columns[:, :, self.moving] = self.Q[which].transpose(0, 2, 1) * sizes[:, None, None]
        start = extended(self.x[which], columns, u_and_s)
        event_times = self._event_times_of(which)
        engine = self._solved(which, length, self.tangent, self._table(which), start, event_times)
        (x, others), ended = divided(engine.states[0], D), engine.state != LaneState.DONE
        columns = others[:, :-2].reshape(K, n, D)[:, :, self.moving]
        V = columns.transpose(0, 2, 1) / sizes[:, None, None]
        Q, diagonal = self._decomposed(x, V, which)
        is_changed, passed = self._changes_of(engine, K)
        lives = ~self.dead[which]
        largest = diagonal.max(axis=1, where=lives, initial=0.0)
        # The growth of the last column follows from the trace of f', so its entry does not matter,
        # unless an event acts, a column is dead, f has products, which have no trace here, or
        # columns do not span all directions.
        matters = lives.copy()
        has_no_trace = bool(self.f.products or self.spaces)
        matters[:, -1] &= is_changed | ~lives.all(axis=1) | has_no_trace
        least = diagonal.min(axis=1, where=matters, initial=np.inf)
        part = least / np.maximum(largest, 1.0)
        # With events, infinite columns may end a long segment. Then a shorter segment follows.
        is_end = ended & (is_last | (self.event_times is None))
        self.status[which[is_end]] = STATUS[engine.state][is_end]
        self.t[which[is_end]] += engine.t[is_end]
        is_good = ~ended & (is_last | (part > LEAST_DIAGONAL) & (largest < LARGEST_DIAGONAL))
        with np.errstate(all="ignore"):
            logs = np.log(diagonal)
            of_trace = others[:, -1] / sizes - logs[:, :-1].sum(axis=1)
        logs[:, -1] = np.where(matters[:, -1], logs[:, -1], of_trace)
        self.passed[which[is_good]] += passed[is_good]
        self.count[which[is_good]] += 1
        self._accept(which, is_good, length, x, engine.lost, Q, np.where(lives, logs, 0.0))
        if is_last and self.event_times is not None:
            least = np.maximum(DEAD_DIAGONAL * largest, DIAGONAL_WITHOUT_DIGITS)[:, np.newaxis]
            dies = is_good[:, np.newaxis] & matters & (diagonal <= least)
            for k in np.flatnonzero(dies.any(axis=1)):
                self._bury(which[k], dies[k], x[k], V[k])
        return is_good, is_good & (part * part > LEAST_DIAGONAL)

    def _segment_of_frame(
        self, which: NDArray[np.int64], length: float, is_last: bool
    ) -> tuple[Any, Any]:
        """Take a segment with orthonormal frames as columns, as `_segment` does with tangents.

        Trajectories that do not reach the end of the segment have no frames in later segments.
        """
        D, n, K, x, spaces = self.f.D, self.n, len(which), self.x[which], self.spaces
        frame = with_frame(self.f, tuple(self.moving.tolist()))
        W, U = self.Q[which], spaces.axes(x, which) if spaces else np.empty(0)
        table, x, starts = batch_solver.counted_from_start(self.f, self._table(which), x)
        if spaces:
            W = dual_product(U[..., :n], W)
            table = np.broadcast_to(table, (K, table.shape[-1]))
            table = np.concatenate([table, U.reshape(K, -1)], axis=1)
        start = extended(x, W + SHIFT, np.zeros((K, n)))
        table = np.ascontiguousarray(frame.table_of(table.T).T)
        engine = self._solved(which, length, frame, table, start)
        (x, others), ended = divided(engine.states[0], D), engine.state != LaneState.DONE
        if starts is not None:
            x[:, [*self.f.hybrid.offsets]] += starts
        W = V = others[:, :-n].reshape(K, n, n) - SHIFT
        off, turned = abs(dual_product(W, W) - np.eye(n)).max(axis=(1, 2)), np.zeros(K)
        if spaces:
            V, turned = spaces.tangents(x, U, W, which)
        Q, diagonal = self._decomposed(x, V, which)
        ended |= ~np.isfinite(turned)
        self.has_frames[which[ended]] = False
        off = off / (SKEWNESS_OF_FRAME * self.settings.rtol)
        is_good = ~ended & (is_last | (off <= 1.0) & (turned <= TURN_OF_TANGENT_SPACE))
        logs = others[:, -n:] + np.log(diagonal)
        self._accept(which, is_good, length, x, engine.lost, Q, logs)
        return is_good, is_good & (4.0 * off <= 1.0) & (2.0 * turned <= TURN_OF_TANGENT_SPACE)

    def _accept(
        self, which: Any, is_good: Any, length: float, x: Any, lost: Any, Q: Any, logs: Any
    ) -> None:
        """Go on from the end of a segment in those trajectories in which it was short enough."""
        go = which[is_good]
        self.x[go], self.lost[go] = x[is_good], lost[is_good]
        self.Q[go] = Q[is_good]
        self.logs[go] += logs[is_good]
        self.duration[go] += length
        self.t[go] += length

    def _table(self, which: NDArray[np.int64]) -> FloatArray:
        return self.table if self.table.ndim == 1 else self.table[which]

    def _solved(
        self, which: Any, length: float, f: Any, table: Any, start: Any, event_times: Any = None
    ) -> BatchSolver:
        """Solve f from `start` over a segment, and note which trajectories had an alarm."""
        request = SolverRequest(np.array([length]), 1, self.settings, event_times=event_times)
        states = np.full((1, *start.shape), np.nan)
        # Without digits are, near rest, only those components that constraints determine.
        acts = self.acts and (f is self.tangent or not self.spaces)
        engine = BatchSolver(f, table, start, request, states, self.lost[which], acts)
        engine.run(self.threads)
        ends = engine.state == LaneState.AGAIN
        self.again[which[ends]], self.status[which[ends]] = True, Status.TOO_MANY_STEPS
        self.lost[which[ends]] = engine.lost[ends]
        if self.f.left_out:
            shift = np.array([0.0, 1.0, 1.0]) * self.t[which, np.newaxis]
            found = np.where(engine.unkept > 0.0, engine.unkept + shift, 0.0)
            self.unkept[which] = np.where(self.unkept[which] > 0.0, self.unkept[which], found)
        return engine

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

    def _changes_of(
        self, engine: BatchSolver, K: int
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Return where events acted on K trajectories of `engine`, and how many at given times."""
        if self.event_times is None:
            return np.zeros(K, bool), np.zeros(K, np.int64)
        rows = np.concatenate([np.empty((0, 2)), *(each[:, :2] for each in engine.records)])
        trajectory, number = rows.copy().view(np.int64).T
        at_times = trajectory[number >= self.f.hybrid.events.surface_count]
        return np.bincount(trajectory, minlength=K) > 0, np.bincount(at_times, minlength=K)

    def _decomposed(
        self, x: FloatArray, V: FloatArray, which: Any
    ) -> tuple[FloatArray, FloatArray]:
        """Return Q and the moduli of the diagonal of R, where Q R = V (K, n, ...) at states x."""
        return self.spaces.decomposed(x, V, which) if self.spaces else _decomposed(V)

    def _bury(self, k: int, are_lost: NDArray[np.bool_], x: FloatArray, V: FloatArray) -> None:
        """Move columns of V that have lost their digits to the end; their exponents are -inf."""
        self.dead[k] |= are_lost
        order = np.argsort(self.dead[k], kind="stable")
        self.dead[k], self.logs[k] = self.dead[k, order], self.logs[k, order]
        self.Q[k] = self._decomposed(x[np.newaxis], V[np.newaxis, :, order], [k])[0][0]

    def exponents(self) -> FloatArray:
        """Return the exponents (B, n), the largest first; NaN for motions that ended."""
        logs = np.where(self.dead, -np.inf, self.logs)
        with np.errstate(all="ignore"):
            rates = logs / self.duration[:, np.newaxis]
        rates[self.status != Status.OK] = np.nan
        return -np.sort(-rates, axis=1)
