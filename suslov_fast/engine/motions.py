"""Motions of systems at times: the right-hand side of each trajectory, and calls of the engine."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray
from ..core.motion.arguments import NUMBER
from ..core.motion.engine import (
    Motion as Engine,
    Settings,
    Stops,
    add_starts,
    counted_from_start,
    prepare,
)
from ..core.motion.one import motion_of_one
from ..core.motion.rows import Cause, State
from .arguments import ALL
from .problem import MANY
from .status import Status
from .threads import available

# Trajectories from which on threads are started, unless the user gives their number.
_IN_THREADS = 64
# By `State`; also of a run that was ended, perhaps before its first step, -1.
_STATUS = np.full(State.ACCUMULATES + 2, Status.TOO_MANY_STEPS, np.int8)
_STATUS[State.DONE], _STATUS[State.ENDED] = Status.OK, Status.ENDED
_STATUS[State.NO_VALUE], _STATUS[State.SLIDING] = Status.NONFINITE, Status.SLIDING
_STATUS[State.STOPPED], _STATUS[State.ACCUMULATES] = Status.STOPPED, Status.ACCUMULATES


class Asked(NamedTuple):
    """The request for a motion."""

    times: FloatArray  # (n,), in any order
    sign: int  # -1 backwards in time
    settings: Settings
    threads: int | None = None
    report: Callable[[int], bool] | None = None  # takes the number of states that are done
    stops: Stops | None = None  # times of changes, if the right-hand side has changes
    most: float = math.inf  # crossings that are recorded, before a trajectory stops
    since: float = -1.0  # modulus of the time after which they count


class Records(NamedTuple):
    """Records of changes of the state, ordered by trajectory and time."""

    trajectory: NDArray[np.int64]  # (K,)
    which: NDArray[np.int64]  # (K,), numbers of changes in the order of code
    time: FloatArray  # (K,)
    before: FloatArray  # (K, D)
    states: FloatArray  # (K, D), after the change; `before` where none acts


class Found(NamedTuple):
    """The result of the engine for B trajectories."""

    states: FloatArray  # (n, B, D), NaN where a solution has ended
    t: FloatArray  # (B,), the time at which a trajectory ended, NaN if it reached the last one
    steps: NDArray[np.int64]  # (B,)
    status: NDArray[np.int8]  # (B,)
    is_stopped: bool = False  # whether `report` ended the run
    records: Records | None = None  # of changes, if there are any
    causes: NDArray[np.int64] | None = None  # (B,), why solutions ended, `Cause`, or all unknown
    grown: NDArray[np.int64] | None = None  # (B,), see `core.motion.engine.Motion`; None if all -1


def nothing_found(starts: FloatArray, count: int) -> Found:
    """Return what is found of trajectories at `count` times before the first step."""
    B = len(starts)
    states = np.full((count, *starts.shape), np.nan)
    status = np.full(B, Status.TOO_MANY_STEPS, np.int8)
    return Found(states, np.zeros(B), np.zeros(B, np.int64), status)


def right_hand_sides(
    groups: Any, shape: tuple[int, ...], batch: tuple[int, ...]
) -> Iterator[tuple[Any, Any, FloatArray]]:
    """Yield groups of trajectories of a batch: indices, or ALL, the right-hand side, its table.

    `groups` are those of the members of a field of this shape.
    """
    if not shape:
        yield ALL, groups[0].f, groups[0].table[0]
        return
    if shape == batch and len(groups) == 1:
        yield ALL, groups[0].f, groups[0].table
        return
    count = math.prod(shape)
    numbers = np.broadcast_to(np.arange(count).reshape(shape), batch).ravel()
    for members, f, table in groups:
        place = np.full(count, -1)
        place[members] = np.arange(len(members))
        places = place[numbers]
        where = np.flatnonzero(places >= 0)
        if len(where):
            yield where, f, table[places[where]]


def solve(field: Any, starts: FloatArray, batch: tuple[int, ...], asked: Asked) -> Found:
    """Return what is found of the motion from `starts` (B, D) at ascending moduli of times.

    If `report` returns False, states that are not done stay NaN.
    """
    times, sign, settings, threads, report, stops, most, since = asked
    B = len(starts)
    if B == 1 and report is None:
        alone = _of_one(field, starts, asked)
        if alone is not None:
            return alone
    if not B:
        records = None if stops is None else _in_order([], sign, starts)
        return nothing_found(starts, len(times))._replace(records=records)
    groups = [*right_hand_sides(field.right_hand_sides, field.shape, batch)]
    if starts.size * len(times) > MANY:  # LLVM ends the process where it finds no memory
        for where, f, table in groups:
            prepare(f, settings, B if where is ALL else len(where), table.ndim > 1)
    whole: Any = None if groups[0][0] is ALL else nothing_found(starts, len(times))[:4]
    count = threads_for(B, threads)
    done, records, causes, grown = 0, [], None, None
    for where, f, table in groups:
        x0, before = starts if where is ALL else starts[where], done
        states = np.full((len(times), *x0.shape), np.nan)
        own = None if report is None else lambda now, before=before: report(before + now)
        arguments = f, table, x0, times, sign, settings, states
        own_stops = stops if stops is None or where is ALL else stops.of(where)
        engine = Engine(*arguments, own_stops)
        engine.numbers[NUMBER.enough], engine.numbers[NUMBER.since] = most, since
        engine.run(count, own)
        records += [(where, each) for each in engine.records]
        ends = np.where(engine.state == State.DONE, np.nan, sign * engine.t)
        part = states, ends, engine.steps, status_of(engine.state)
        if where is ALL:
            whole = part
        else:
            whole[0][:, where] = states
            for array, values in zip(whole[1:], part[1:], strict=True):
                array[where] = values
        causes = _noted(causes, Cause.UNKNOWN, B, where, engine.causes)
        grown = _noted(grown, -1, B, where, engine.grown)
        done += len(times) * len(x0)
        if engine.is_stopped:
            break
    of_changes = None if stops is None else _in_order(records, sign, starts)
    states, ends, steps, status = whole
    return Found(states, ends, steps, status, engine.is_stopped, of_changes, causes, grown)


def _noted(
    before: NDArray[np.int64] | None, none: int, B: int, where: Any, notes: Any
) -> NDArray[np.int64] | None:
    """Return notes of B trajectories, None without any, with those of trajectories `where`."""
    if not notes:
        return before
    found: NDArray[np.int64] = np.full(B, none) if before is None else before
    for which, values in notes:
        found[which if where is ALL else where[which]] = values
    return found


def _in_order(records: list[tuple[Any, FloatArray]], sign: int, starts: FloatArray) -> Records:
    """Return records in order, from those of the engine and the trajectories they belong to."""
    D = starts.shape[1]
    rows = np.concatenate([rows for _, rows in records] or [np.empty((0, 3 + D))])
    trajectory, which = rows[:, :2].view(np.int64).T
    first = 0
    for where, part in records:
        own = slice(first, first := first + len(part))
        if where is not ALL:
            trajectory[own] = where[trajectory[own]]
    small = np.min_scalar_type(len(starts))  # NumPy sorts 16 bits by digits, seven times as fast
    rows = np.take(rows, np.argsort(trajectory.astype(small), kind="stable"), axis=0)
    trajectory, which = rows[:, :2].view(np.int64).T
    if ((trajectory[1:] == trajectory[:-1]) & (rows[1:, 2] < rows[:-1, 2])).any():
        # Several in a step may be in another order. It takes many times as long.
        rows = np.take(rows, np.lexsort((rows[:, 2], trajectory)), axis=0)
        trajectory, which = rows[:, :2].view(np.int64).T
    trajectory, which = trajectory.copy(), which.copy()
    before = states = rows[:, 3 : 3 + D].copy()
    if rows.shape[1] > 3 + D:
        states = rows[:, 3 + D :].copy()
    return Records(trajectory, which, sign * rows[:, 2], before, states)


def status_of(state: Any) -> NDArray[np.int8]:
    """Return the `Status` of trajectories with these states of the engine."""
    found: NDArray[np.int8] = _STATUS[state]
    return found


def threads_for(B: int, threads: int | None) -> int:
    """Return how many threads take B trajectories."""
    return threads or (available() if B > _IN_THREADS else 1)


def _of_one(field: Any, starts: FloatArray, asked: Asked) -> Found | None:
    """Return the motion of one trajectory, in few microseconds, or None if that is impossible."""
    times, sign, settings, _, _, stops, most, since = asked
    _, f, table = field.right_hand_sides[0]
    clocks, of_clocks = [*f.offsets], None
    if clocks and any(starts.item(0, i) != 0.0 for i in clocks):  # in less time than NumPy
        table, starts, of_clocks = counted_from_start(f, table, starts)
    given = f, table.tobytes(), starts.tobytes(), times.tobytes(), sign, settings
    result = motion_of_one(*given) if stops is None else motion_of_one(*given, stops, most, since)
    if result is None:
        return None
    states, t, steps, state, grown, *records = result
    states = np.frombuffer(states).reshape(len(times), *starts.shape)
    if of_clocks is not None:
        states[..., clocks] += of_clocks
    if state != State.DONE and stops is None:
        states[~(times <= t)] = np.nan
    end = np.nan if state == State.DONE else sign * t
    found = Found(states, np.array([end]), np.array([steps]), _STATUS[state : state + 1].copy())
    found = found if grown < 0 else found._replace(grown=np.array([grown]))
    if stops is None:
        return found
    if of_clocks is not None:
        for rows in records[0]:
            add_starts(f, rows, of_clocks)
    return found._replace(records=_in_order([(ALL, each) for each in records[0]], sign, starts))
