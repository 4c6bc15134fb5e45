"""Motions of systems at times: the right-hand side of each trajectory, and calls of the engine."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..calls import ALL, available
from ..checks import FloatArray
from ..core.flow.batch_solver import COLUMNS, BatchSolver, SolverRequest, closer
from ..core.flow.growing_components import TRIES
from ..core.flow.held import STATUS as STATUS
from ..core.flow.integrator import Integrator
from ..core.flow.memory import UNKEPT, LaneState
from ..core.flow.small_batches import solve_small_batch
from ..core.flow.tolerances import SAME_END
from ..fields.right_hand_sides import OfMembers
from ..status import Status
from .tolerances import (
    EQUATIONS_OF_LARGE_F,
    NUMBERS_OF_SMALL_BATCH,
    OPERATIONS_OF_LONG_F,
    TRAJECTORIES_OF_ONE_THREAD,
)

_ENDS = Status.ENDED, Status.TOO_MANY_STEPS, Status.NONFINITE
# Why digits are in doubt. FELL: a component fell below 1e-300. NO_DIGITS: the solution ends sooner
# if the allowed errors of small components are relative to their values.
FELL, NO_DIGITS = np.int8(1), np.int8(2)


@lru_cache(64)
def warn_of_size(f: Any, is_implicit: bool) -> None:
    """Warn once if f takes long to compile, or if other solvers take its implicit steps sooner."""
    if not f.is_written:
        return
    if is_implicit and f.entries > max(EQUATIONS_OF_LARGE_F * f.D, f.D**2 / 2):
        checks.warn(
            f"f' is a dense matrix of {f.D} x {f.D}, and steps for stiff equations take long: "
            "SciPy's solve_ivp is faster, with method='LSODA' or 'BDF' and jac=field.jacobian"
        )
        return
    count = 0 if is_implicit or f.is_dense else len(f.rates.operations)
    if count > max(OPERATIONS_OF_LONG_F, f.D**2):  # sums over all variables need D**2 operations
        checks.warn(
            f"f has {count} operations, which take about {count / 10_000:.0f} s to compile: write "
            "sums over all variables as products W @ v with matrices"
        )


Integrator.on_new = warn_of_size


class Records(NamedTuple):
    """Records of K events, ordered by trajectory and time."""

    trajectory: NDArray[np.int64]  # (K,)
    which: NDArray[np.int64]  # (K,), numbers of events, events on surfaces first
    time: FloatArray  # (K,)
    before: FloatArray  # (K, D)
    states: FloatArray  # (K, D), after the event
    of_columns: Any = None  # (K, C + 2 D), for C columns of derivatives, see `_of_records`
    # Derivatives of `time` (K, C), and of `before` and `states` (K, D, C), if they are computed.
    time_by: Any = None
    before_by: Any = None
    states_by: Any = None

    def in_order(self) -> Records:
        """Return these records, which are in order; `Rows` have this method, too."""
        return self

    def first(self, most: float) -> Records:
        """Return the first `most` records of each trajectory."""
        if most == math.inf:
            return self
        ranks = np.arange(len(self.time)) - np.searchsorted(self.trajectory, self.trajectory)
        return self.selected(ranks < most)

    def selected(self, marked: NDArray[np.bool_]) -> Records:
        """Return the records that are marked (K,)."""
        return Records._make(None if a is None else a[marked] for a in self)

    def with_part(self, where: NDArray[np.int64], part: Records, chosen: Any) -> Records:
        """Return records in which those of trajectories where[chosen] come from `part`.

        `part` has the records of all trajectories `where`, numbered from 0.
        """
        others = self.selected(~np.isin(self.trajectory, where[chosen]))
        part = part._replace(trajectory=where[part.trajectory])
        part = part.selected(np.isin(part.trajectory, where[chosen]))
        if not (len(others.time) and len(part.time)):
            return part if len(part.time) else others
        trajectory = np.concatenate([others.trajectory, part.trajectory])
        order, both = np.argsort(trajectory, kind="stable"), zip(others, part, strict=True)
        return Records._make(a if a is None else np.concatenate([a, b])[order] for a, b in both)


class Rows(NamedTuple):
    """Records of events of one or more trajectories, as the engine writes them."""

    arrays: list[FloatArray]  # arrays of rows, see `events.records`
    sign: int  # sign of time
    starts: FloatArray  # initial states (B, D)

    def in_order(self) -> Records:
        """Return the records in order of trajectory, then time."""
        first, last = 3 + self.starts.shape[1], 3 + 2 * self.starts.shape[1]
        rows = np.concatenate(self.arrays or [np.empty((0, last))])
        B = len(self.starts)
        if B > 1:
            small = np.min_scalar_type(B)  # seven times faster in 16 bits: NumPy's radix sort
            order = np.argsort(rows[:, 0].view(np.int64).astype(small), kind="stable")
            rows = np.take(rows, order, axis=0)
        trajectory, time = rows[:, 0].view(np.int64), rows[:, 2]
        if ((trajectory[1:] == trajectory[:-1]) & (time[1:] < time[:-1])).any():
            # Events in one step may be out of order in time. The slower `lexsort` sorts only then.
            rows = np.take(rows, np.lexsort((time, trajectory)), axis=0)
        trajectory, which = rows[:, :2].view(np.int64).T.copy()
        before, states, others = (a.copy() for a in np.split(rows[:, 3:], (first - 3, last - 3), 1))
        return Records(trajectory, which, self.sign * rows[:, 2], before, states, others)


class Ends(NamedTuple):
    """The ends of B trajectories."""

    t: FloatArray  # (B,), the time of a trajectory's end, NaN if it reached the last time asked for
    status: NDArray[np.int8]  # (B,)
    doubtful: NDArray[np.int8]  # (B,), `FELL` or `NO_DIGITS`, else 0
    repeated: NDArray[np.int8]  # (B,), 1 if computed again after an alarm (lost digits), else 0
    unkept: FloatArray  # (B, UNKEPT), results of tests of first integrals, with moduli of times


class SolverResult(NamedTuple):
    """The result of the engine for B trajectories."""

    states: FloatArray  # (n, B, D), NaN where a solution has ended
    columns: dict[str, NDArray[Any]]  # {name in `COLUMNS`: array (B,)}
    # None only if no trajectory ended early, was repeated, is doubtful or has changed an integral.
    ends: Ends | None = None
    records: Any = None  # `Records` or `Rows`, if there are events
    derivatives: Any = None  # (n, B, D, C), by C variables, if they are asked for
    is_stopped: bool = False  # whether `report` ended the run

    @property
    def all_ends(self) -> Ends:
        """The `Ends`, also if all trajectories have reached the last time."""
        B = self.states.shape[1]
        return self.ends or _ends(np.full(B, np.nan), np.zeros(B, np.int8))

    def without_steps(self, has_no_value: NDArray[np.bool_]) -> SolverResult:
        """Return a copy in which trajectories `has_no_value` (B,) end at x0, and no others."""
        result = self._replace(ends=None)
        ends = result.all_ends
        ends.status[has_no_value] = Status.NONFINITE
        return result._replace(ends=ends) if has_no_value.any() else result

    def with_part(
        self, where: NDArray[np.int64], part: SolverResult, chosen: Any = slice(None)
    ) -> SolverResult:
        """Return the result with trajectories where[chosen] from `part`; overwrite own arrays.

        `part` is the result of all trajectories `where`.
        """
        ends, records, places = self.all_ends, self.records, where[chosen]
        wholes: list[Any] = [*ends, *self.columns.values()]
        parts: list[Any] = [*part.all_ends, *part.columns.values()]
        for whole, new in zip(wholes, parts, strict=True):
            whole[places] = new[chosen]
        self.states[:, places] = part.states[:, chosen]
        if part.derivatives is not None:
            self.derivatives[:, places] = part.derivatives[:, chosen]
        if part.records is not None:
            records = records.in_order().with_part(where, part.records.in_order(), chosen)
        is_stopped = self.is_stopped or part.is_stopped
        return self._replace(ends=ends, records=records, is_stopped=is_stopped)

    def again(
        self, where: NDArray[np.int64], part: SolverResult, chosen: Any = slice(None)
    ) -> SolverResult:
        """Return `with_part` for a second run of trajectories; its steps are added."""
        steps = self.columns["steps"][where] + part.columns["steps"]
        part = part._replace(columns=part.columns | {"steps": steps})
        return self.with_part(where, part, chosen)


def _ends(t: FloatArray, status: NDArray[np.int8]) -> Ends:
    """Return `Ends` without a doubt."""
    doubtful, repeated = np.zeros((2, len(t)), np.int8)
    return Ends(t, status, doubtful, repeated, np.zeros((len(t), UNKEPT)))


def empty_result(x0: FloatArray, count: int) -> SolverResult:
    """Return the result before any step: states at `count` times are NaN."""
    B = len(x0)
    status = np.full(B, Status.TOO_MANY_STEPS, np.int8)
    return SolverResult(
        states=np.full((count, *x0.shape), np.nan),
        columns={name: np.zeros(B, kind) for name, (_, kind) in COLUMNS.items()},
        ends=_ends(np.zeros(B), status),
        records=Rows([], 1, x0),
    )


def right_hand_sides(
    groups: list[OfMembers], shape: tuple[int, ...], batch: tuple[int, ...]
) -> list[tuple[Any, Any, FloatArray]]:
    """Return groups of trajectories that share a right-hand side f: (indices or ALL, f, table).

    `groups` are the right-hand sides of the members of a field of this shape.
    """
    if math.prod(shape) == 1:
        return [(ALL, groups[0].f, groups[0].table[0])]
    if shape == batch and len(groups) == 1:
        return [(ALL, groups[0].f, groups[0].table)]
    groups_of, count = [], math.prod(shape)
    numbers = np.broadcast_to(np.arange(count).reshape(shape), batch).ravel()
    for members, f, table in groups:
        place = np.full(count, -1)
        place[members] = np.arange(len(members))
        places = place[numbers]
        where = np.flatnonzero(places >= 0)
        if len(where):
            groups_of.append((where, f, table[places[where]]))
    return groups_of


def to_tolerance(
    groups: list[OfMembers],
    shape: tuple[int, ...],
    x0: FloatArray,
    batch: tuple[int, ...],
    request: SolverRequest,
) -> SolverResult:
    """Return motions from states x0 (B, D), to a tolerance, at `request.times` in any order.

    `groups` are the right-hand sides of the members of a field of this shape. If `request.report`
    returns False, states that are not yet computed stay NaN.
    """
    count, places = len(request.times), None
    if not (count and len(x0)):
        return empty_result(x0, count).without_steps(np.isnan(x0[:, 0]))
    if request.sign < 0:
        request = request._replace(times=abs(request.times))
    if count > 1 and np.count_nonzero(request.times[1:] <= request.times[:-1]):
        times, places = np.unique(request.times, return_inverse=True)
        request = request._replace(times=times)
    first = last = request.times.item(0)
    if count > 1:
        last = request.times.item(-1)
    has_events = request.event_times is not None
    if last > 0.0 or has_events:  # events at time 0 act, too
        if math.prod(shape) == 1:  # for speed in small calls
            result = _of_group(groups[0].f, groups[0].table[0], x0, request)
        else:
            result = _of_groups(right_hand_sides(groups, shape, batch), x0, request)
    else:
        result = empty_result(x0, 1).without_steps(np.isnan(x0[:, 0]))
    if first == 0.0:
        # With events the engine saves the states at time 0, except where f has no value at x0.
        kept = result.all_ends.status == Status.NONFINITE if has_events else slice(None)
        result.states[0, kept] = x0[kept]
    return result if places is None else result._replace(states=result.states[places])


def _of_group(f: Any, table: FloatArray, x0: FloatArray, request: SolverRequest) -> SolverResult:
    """Return the `SolverResult` of trajectories that share f; `table` has its numbers."""
    B, begun = len(x0), None
    threads = 1 if B == 1 else threads_for(B, request.threads)
    if request.report is None and threads == 1 and (B == 1 or x0.size <= NUMBERS_OF_SMALL_BATCH):
        states, columns, rows, begun = solve_small_batch(f, table, x0, request)
        if begun is None:
            records = None if request.event_times is None else _rows_of(rows, x0, request)
            return SolverResult(states, columns, None, records)
    else:
        states = np.full((len(request.times), *x0.shape), np.nan)
    engine = BatchSolver(f, table, x0, request, states)
    engine.run(threads, begun)
    result = _result_of(engine, x0)
    if engine.is_stopped or not np.count_nonzero(engine.state == LaneState.AGAIN):
        return result
    return _again(engine, result, table, x0)


def _result_of(engine: BatchSolver, x0: FloatArray) -> SolverResult:
    """Return the `SolverResult` of a run from `x0` (B, D)."""
    records = _rows_of(engine.records, x0, engine.request)
    ends_early = np.count_nonzero(engine.state != LaneState.DONE) or engine.is_stopped
    keeps = not (engine.f.of_x.left_out and np.count_nonzero(engine.unkept))
    if keeps and not (ends_early or np.count_nonzero(engine.doubtful)):
        return SolverResult(engine.states, engine.columns, records=records)
    status = STATUS[engine.state]
    status[(status == Status.OK) & engine.unkept.any(axis=1)] = Status.NOT_KEPT
    ends = Ends(
        t=np.where(engine.state == LaneState.DONE, np.nan, engine.request.sign * engine.t),
        status=status,
        doubtful=FELL * engine.doubtful,
        repeated=np.zeros(len(x0), np.int8),
        unkept=engine.unkept,
    )
    return SolverResult(engine.states, engine.columns, ends, records, is_stopped=engine.is_stopped)


def _rows_of(records: Any, x0: FloatArray, request: SolverRequest) -> Rows | None:
    return None if request.event_times is None else Rows(records, request.sign, x0)


def _again(
    engine: BatchSolver, result: SolverResult, table: FloatArray, x0: FloatArray
) -> SolverResult:
    """Return a result in which trajectories with an alarm (`growing_components`) are recomputed.

    They take the next of `TRIES` after each alarm. If a solution ends sooner with allowed errors
    relative to components than without them, the solution without them is returned, marked as
    doubtful.
    """
    f, request = engine.f, engine.request

    def run(which: NDArray[np.int64], lost: FloatArray, acts: bool) -> BatchSolver:
        part = _part_of(request, which, report)._replace(settings=closer(request.settings))
        states = np.full((len(request.times), len(which), x0.shape[1]), np.nan)
        own = table if table.ndim == 1 else table[which]
        engine = BatchSolver(f, own, x0[which], part, states, lost, acts)
        engine.run(threads_for(len(which), request.threads))
        return engine

    first = where = np.flatnonzero(engine.state == LaneState.AGAIN)
    lost, report = engine.lost[where], engine.report_of_part(where)
    for each in TRIES:
        engine = run(where, each.marks(lost), each.acts)
        result = result.again(where, _result_of(engine, x0[where]))
        alarms = engine.state == LaneState.AGAIN
        where, lost = where[alarms], engine.lost[alarms]
        if not len(where) or result.is_stopped:
            break
    where = first[np.isin(result.all_ends.status[first], _ENDS)]
    if len(where) and not result.is_stopped:
        plain = _result_of(run(where, np.zeros((len(where), f.of_x.D)), False), x0[where])
        ends, last = plain.all_ends, result.all_ends.t[where]
        ends.doubtful[:] = NO_DIGITS
        (lasts,) = np.nonzero(np.isnan(ends.t) | (abs(ends.t) > SAME_END * abs(last)))
        result = result.again(where, plain._replace(ends=ends), lasts)
    result.all_ends.repeated[first] = 1
    return result


def _part_of(request: SolverRequest, where: NDArray[np.int64], report: Any) -> SolverRequest:
    """Return the request for some trajectories, with another function `report`."""
    event_times = request.event_times and request.event_times.of(where)
    return request._replace(report=report, event_times=event_times)


def _of_groups(groups: Any, x0: FloatArray, request: SolverRequest) -> SolverResult:
    """Return the joint `SolverResult` of groups of trajectories, (indices, f, table of f) each."""
    where, f, table = groups[0]
    if where is ALL:
        return _of_group(f, table, x0, request)
    result, report, done = empty_result(x0, len(request.times)), request.report, 0
    for where, f, table in groups:
        of_part = None if report is None else lambda now, before=done: report(before + now)
        part = _of_group(f, table, x0[where], _part_of(request, where, of_part))
        result = result.with_part(where, part)
        done += len(request.times) * len(where)
        if result.is_stopped:
            break
    return result


def threads_for(B: int, threads: int | None) -> int:
    """Return how many threads to use for B trajectories."""
    return threads or (available() if B > TRAJECTORIES_OF_ONE_THREAD else 1)
