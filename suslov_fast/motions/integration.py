"""Motions of systems at times: the right-hand side of each trajectory, and calls of the engine."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..checks import FloatArray
from ..core.flow.batch_solver import BatchSolver, SolverRequest, closer
from ..core.flow.growing_components import LATER, RELATIVE
from ..core.flow.held import STATUS as STATUS
from ..core.flow.integrator import Integrator
from ..core.flow.memory import LaneState
from ..core.flow.small_batches import solve_small_batch
from ..maps.kernel_arguments import ALL
from ..maps.kernel_calls import available
from ..status import Status

# Trajectories from which on threads are started, unless the user gives their number.
_IN_THREADS = 64
_LONG = 30_000  # operations of f whose compiling takes long
_LARGE = 50  # equations with a dense f', from which on LSODA is faster: measured on rate networks
_ENDS = Status.ENDED, Status.TOO_MANY_STEPS, Status.NONFINITE
# Why digits are in doubt: a component fell below 1e-300, or with relative digits there is no end.
FELL, NO_DIGITS = np.int8(1), np.int8(2)
# Numbers in states of several trajectories up to which `solve_small_batch` keeps their memory.
_FEW = 256


@lru_cache(64)
def warn_of_size(f: Any, is_implicit: bool) -> None:
    """Warn once if f takes long to compile, or if other solvers take its implicit steps sooner."""
    if not f.is_written:
        return
    if is_implicit and f.entries > max(_LARGE * f.D, f.D**2 / 2):
        checks.warn(
            f"f' is a dense matrix of {f.D} x {f.D}, and steps for stiff equations take long: "
            "SciPy's solve_ivp is faster, with method='LSODA' or 'BDF' and jac=field.jacobian"
        )
        return
    count = len(f.f.operations)
    # Fewer than D**2 operations are no sums over all variables.
    if not (is_implicit or f.is_dense) and count > max(_LONG, f.D**2):
        checks.warn(
            f"f has {count} operations, which take about {count / 10_000:.0f} s to compile: write "
            "sums over all variables as products W @ v with matrices"
        )


Integrator.on_new = warn_of_size


class Records(NamedTuple):
    """Records of events, ordered by trajectory and time."""

    trajectory: NDArray[np.int64]  # (K,)
    which: NDArray[np.int64]  # (K,), numbers of events in the order of code
    time: FloatArray  # (K,)
    before: FloatArray  # (K, D)
    states: FloatArray  # (K, D), after the change; `before` where none acts
    of_columns: Any = None  # (K, C + 2 D), tau of C columns, f before and after, if there are any
    derivatives: Any = None  # of times (K, C), of `before` and `states` (K, D, C)

    def in_order(self) -> Records:
        """Return these records."""
        return self

    def first(self, most: float) -> Records:
        """Return the first `most` records of each trajectory."""
        if most == math.inf:
            return self
        ranks = np.arange(len(self.time)) - np.searchsorted(self.trajectory, self.trajectory)
        return self.selected(ranks < most)

    def selected(self, own: NDArray[np.bool_]) -> Records:
        """Return the records that are marked (K,), without `of_columns`."""
        derivatives = self.derivatives and tuple(a[own] for a in self.derivatives)
        arrays: dict[str, Any] = {name: getattr(self, name)[own] for name in self._fields[:5]}
        return self._replace(of_columns=None, derivatives=derivatives, **arrays)

    def part(self, where: NDArray[np.int64]) -> Records:
        """Return the records of trajectories `where` (K,), ascending, as of 0 to K - 1."""
        own = np.isin(self.trajectory, where)

        def of(a: Any) -> Any:
            return a and tuple(map(of, a)) if a is None or isinstance(a, tuple) else a[own]

        return Records(np.searchsorted(where, self.trajectory[own]), *map(of, self[1:]))

    def with_part(self, where: NDArray[np.int64], part: Records) -> Records:
        """Return records with those of trajectories `where` (K,) as in `part`, of 0 to K - 1."""
        stays, numbers = ~np.isin(self.trajectory, where), where[part.trajectory]
        both = np.concatenate([self.trajectory[stays], numbers])
        order = np.argsort(both, kind="stable")

        def joined(a: Any, b: Any) -> Any:
            if a is None or isinstance(a, tuple):
                return a and tuple(map(joined, a, b))
            return np.concatenate([own for own in (a[stays], b) if len(own)] or [b])[order]

        return Records(both[order], *map(joined, self[1:], part[1:]))


class Rows(NamedTuple):
    """Records of events of one or more trajectories, as the engine writes them."""

    arrays: list[FloatArray]  # of rows, see `event_records`
    sign: int  # of time
    starts: FloatArray  # (B, D)

    def in_order(self) -> Records:
        """Return the records in order of trajectory, then time."""
        first, last = 3 + self.starts.shape[1], 3 + 2 * self.starts.shape[1]
        rows = np.concatenate([np.empty((0, last)), *self.arrays][len(self.arrays) > 0 :])
        B = len(self.starts)
        if B > 1:
            small = np.min_scalar_type(B)  # NumPy sorts 16 bits by digits, seven times faster
            order = np.argsort(rows[:, 0].view(np.int64).astype(small), kind="stable")
            rows = np.take(rows, order, axis=0)
        trajectory, time = rows[:, 0].view(np.int64), rows[:, 2]
        if ((trajectory[1:] == trajectory[:-1]) & (time[1:] < time[:-1])).any():
            # Several in a step may be in another order. It takes many times as long.
            rows = np.take(rows, np.lexsort((time, trajectory)), axis=0)
        trajectory, which = rows[:, :2].view(np.int64).T.copy()
        before, states, others = (a.copy() for a in np.split(rows[:, 3:], (first - 3, last - 3), 1))
        return Records(trajectory, which, self.sign * rows[:, 2], before, states, others)


class SolverResult(NamedTuple):
    """The result of the engine for B trajectories."""

    states: FloatArray  # (n, B, D), NaN where a solution has ended
    t: FloatArray  # (B,), the time at which a trajectory ended, NaN if it reached the last one
    steps: NDArray[np.int64]  # (B,)
    status: NDArray[np.int8]  # (B,)
    is_stopped: bool = False  # whether `report` ended the run
    records: Any = None  # `Records` or `Rows`, if there are events
    doubtful: NDArray[np.int8] | None = None  # (B,), `FELL` or `NO_DIGITS`, else 0
    repeated: NDArray[np.int8] | None = None  # (B,), 1 if small components made it compute again
    is_good: bool = False  # True if it is known that there is nothing to warn of

    def part(self, where: NDArray[np.int64]) -> SolverResult:
        """Return the result of trajectories `where` (K,), ascending; arrays are copies."""
        rows: dict[str, Any] = {n: a[where] for n, a in self._of_trajectories() if a is not None}
        records = None if self.records is None else self.records.in_order().part(where)
        states = self.states[:, where]
        return self._replace(states=states, records=records, is_good=False, **rows)

    def with_part(self, where: NDArray[np.int64], part: SolverResult) -> SolverResult:
        """Return the result with trajectories `where` (K,) as in `part`; arrays may change."""
        found: dict[str, Any] = {"states": _writeable(self.states)}
        found["states"][:, where] = part.states
        for (name, own), (_, new) in zip(
            self._of_trajectories(), part._of_trajectories(), strict=True
        ):
            if own is not None or new is not None:
                found[name] = np.zeros(len(self.t), np.int8) if own is None else _writeable(own)
                found[name][where] = 0 if new is None else new
        if part.records is not None:
            found["records"] = self.records.in_order().with_part(where, part.records.in_order())
        is_stopped = self.is_stopped or part.is_stopped
        return self._replace(is_stopped=is_stopped, is_good=False, **found)

    def _of_trajectories(self) -> list[tuple[str, Any]]:
        """Return the names and arrays (B,) that have a number of each trajectory, or None."""
        names = "t", "steps", "status", "doubtful", "repeated"
        return [(name, getattr(self, name)) for name in names]

    def again(self, where: NDArray[np.int64], part: SolverResult) -> SolverResult:
        """Return the result with a second run of trajectories `where`; its steps are added."""
        return self.with_part(where, part._replace(steps=self.steps[where] + part.steps))


def _writeable(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array, or a copy of one that results share."""
    return array if array.flags.writeable else array.copy()


@lru_cache(64)
def without_ends(batch: tuple[int, ...]) -> tuple[FloatArray, NDArray[np.int8]]:
    """Return ends, NaN, and statuses, OK, that nobody can write to, so that results share them."""
    ends = np.full(batch, np.nan)
    return np.ndarray(batch, np.float64, ends.tobytes()), np.ndarray(
        batch, np.int8, bytes(ends.size)
    )


def empty_result(starts: FloatArray, count: int) -> SolverResult:
    """Return the result before any step: states at `count` times are NaN."""
    B = len(starts)
    states = np.full((count, *starts.shape), np.nan)
    status = np.full(B, Status.TOO_MANY_STEPS, np.int8)
    steps = np.zeros(B, np.int64)
    return SolverResult(states, np.zeros(B), steps, status, records=Rows([], 1, starts))


def right_hand_sides(
    groups: Any, shape: tuple[int, ...], batch: tuple[int, ...]
) -> list[tuple[Any, Any, FloatArray]]:
    """Return groups of trajectories that share a right-hand side f: (indices or ALL, f, table).

    `groups` are the right-hand sides of the members of a field of this shape.
    """
    if math.prod(shape) == 1:
        return [(ALL, groups[0].f, groups[0].table[0])]
    if shape == batch and len(groups) == 1:
        return [(ALL, groups[0].f, groups[0].table)]
    found, count = [], math.prod(shape)
    numbers = np.broadcast_to(np.arange(count).reshape(shape), batch).ravel()
    for members, f, table in groups:
        place = np.full(count, -1)
        place[members] = np.arange(len(members))
        places = place[numbers]
        where = np.flatnonzero(places >= 0)
        if len(where):
            found.append((where, f, table[places[where]]))
    return found


def solve(
    field: Any, starts: FloatArray, batch: tuple[int, ...], request: SolverRequest
) -> SolverResult:
    """Return the `SolverResult` of the motion from `starts` (B, D) to ascending `request.times`.

    If `request.report` returns False, states that are not yet computed stay NaN.
    """
    groups = field._right_hand_sides
    if not len(starts):
        return empty_result(starts, len(request.times))
    if not field.shape:
        [(_, f, table)] = groups
        return _of_group(f, table[0], starts, request)
    groups = right_hand_sides(groups, field.shape, batch)
    where, f, table = groups[0]
    if where is ALL:
        return _of_group(f, table, starts, request)
    return _of_groups(groups, starts, request)


def to_tolerance(
    field: Any, x: FloatArray, batch: tuple[int, ...], request: SolverRequest
) -> SolverResult:
    """Return the motion of a field, to a tolerance, at times in any order."""
    if request.sign < 0:
        request = request._replace(times=abs(request.times))
    moduli, is_changed = request.times, request.event_times is not None
    count = len(moduli)
    ascend = count == 1 or (count > 1 and not np.count_nonzero(moduli[1:] <= moduli[:-1]))
    if ascend and (is_changed or moduli[-1] > 0.0):
        found = solve(field, x, batch, request)
        if moduli[0] == 0.0:  # after events the engine saves it, unless a solution has no value
            kept = found.status == Status.NONFINITE if is_changed else slice(None)
            found.states[0, kept] = x[kept]
        return found
    later = moduli >= 0.0 if is_changed else moduli > 0.0  # an event at time 0 acts
    ascending, places = np.unique(moduli[later], return_inverse=True)
    if not len(ascending):
        found = empty_result(x, len(moduli))
        found.status[:] = np.where(np.isnan(x[:, 0]), Status.NONFINITE, Status.OK)
        found.t[:] = np.nan
    else:
        found = solve(field, x, batch, request._replace(times=ascending))
    states = np.empty((len(moduli), *x.shape))
    states[later] = found.states[places]
    states[~later] = x
    if is_changed:
        has_none = found.status == Status.NONFINITE
        states[:, has_none] = np.where(moduli[:, np.newaxis, np.newaxis] > 0.0, np.nan, x[has_none])
    return found._replace(states=states)


def _of_group(
    f: Any, table: FloatArray, starts: FloatArray, request: SolverRequest
) -> SolverResult:
    """Return the `SolverResult` of trajectories that share f, with `table`, numbers of f."""
    B, begun = len(starts), None
    threads = 1 if B == 1 else threads_for(B, request.threads)
    has_records = request.event_times is not None
    if request.report is None and threads == 1 and (B == 1 or starts.size <= _FEW):
        states, steps, rows, begun = solve_small_batch(f, table, starts, request)
        if begun is None:
            ends, status = without_ends((B,))
            records = Rows(rows, request.sign, starts) if has_records else None
            return SolverResult(states, ends, steps, status, records=records, is_good=True)
    else:
        states = np.full((len(request.times), *starts.shape), np.nan)
    engine = BatchSolver(f, table, starts, request, states)
    engine.run(threads, begun)
    found = _result_of(engine, starts)
    (where,) = np.nonzero(engine.state == LaneState.AGAIN)
    if not len(where) or engine.is_stopped:
        return found
    own = table if table.ndim == 1 else table[where]
    request = _part_of(request, where, engine.report_of_part(where))
    part = _again(f, own, starts[where], request, engine.lost[where])
    return found.again(where, part._replace(repeated=np.ones(len(where), np.int8)))


def _result_of(engine: BatchSolver, starts: FloatArray) -> SolverResult:
    """Return the `SolverResult` of a run from `starts` (B, D)."""
    sign, records = engine.request.sign, None
    ends = np.where(engine.state == LaneState.DONE, np.nan, sign * engine.t)
    if engine.request.event_times is not None:
        records = Rows(engine.records, sign, starts)
    return SolverResult(
        states=engine.states,
        t=ends,
        steps=engine.steps,
        status=STATUS[engine.state],
        is_stopped=engine.is_stopped,
        records=records,
        doubtful=FELL * engine.doubtful,
    )


def _again(
    f: Any, table: FloatArray, starts: FloatArray, request: SolverRequest, lost: FloatArray
) -> SolverResult:
    """Return trajectories that had an alarm, with relative digits of the components that lost them.

    These have RELATIVE in `lost` (B, D). Another alarm adds some, the third one all. If a solution
    ends sooner than without relative digits, it has none, and is doubtful.
    """

    def run(which: NDArray[np.int64], lost: FloatArray, acts: bool) -> BatchSolver:
        part = _part_of(request, which, request.report)
        part = part._replace(settings=closer(request.settings))
        states = np.full((len(request.times), len(which), starts.shape[1]), np.nan)
        own = table if table.ndim == 1 else table[which]
        engine = BatchSolver(f, own, starts[which], part, states, lost, acts)
        engine.run(threads_for(len(which), request.threads))
        return engine

    relative = np.where(lost < 0.0, RELATIVE, 0.0)
    engine = run(np.arange(len(starts)), relative, True)
    found = _result_of(engine, starts)
    where = np.flatnonzero(engine.state == LaneState.AGAIN)
    for acts in (True, False):
        if not len(where) or found.is_stopped:
            break
        lost = engine.lost[engine.state == LaneState.AGAIN]
        engine = run(where, np.where((lost < 0.0) | (not acts), RELATIVE, 0.0), acts)
        found = found.again(where, _result_of(engine, starts[where]))
        where = where[engine.state == LaneState.AGAIN]
    (where,) = np.nonzero(np.isin(found.status, _ENDS))
    if len(where) and not found.is_stopped:
        first = _result_of(run(where, np.zeros((len(where), lost.shape[1])), False), starts[where])
        (lasts,) = np.nonzero(np.isnan(first.t) | (abs(first.t) > LATER * abs(found.t[where])))
        part = first.part(lasts)._replace(doubtful=np.full(len(lasts), NO_DIGITS))
        found = found.again(where[lasts], part)
    return found


def _part_of(request: SolverRequest, where: NDArray[np.int64], report: Any) -> SolverRequest:
    """Return the request of trajectories `where`."""
    event_times = request.event_times and request.event_times.of(where)
    return request._replace(report=report, event_times=event_times)


def _of_groups(groups: Any, starts: FloatArray, request: SolverRequest) -> SolverResult:
    """Return the joint `SolverResult` of groups of trajectories, (indices, f, table of f) each."""
    found, report, done = empty_result(starts, len(request.times)), request.report, 0
    for where, f, table in groups:
        own = None if report is None else lambda now, before=done: report(before + now)
        part = _of_group(f, table, starts[where], _part_of(request, where, own))
        found = found.with_part(where, part)
        done += len(request.times) * len(where)
        if found.is_stopped:
            break
    return found


def threads_for(B: int, threads: int | None) -> int:
    """Return how many threads to use for B trajectories."""
    return threads or (available() if B > _IN_THREADS else 1)
