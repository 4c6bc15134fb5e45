"""Motions of systems at times: the right-hand side of each trajectory, and calls of the engine."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray
from ..core.motion.engine import Motion as Engine, Settings, prepare
from ..core.motion.one import motion_of_one
from ..core.motion.rows import State
from .arguments import ALL
from .status import Status
from .threads import available

# Trajectories from which on threads are started, unless the user gives their number.
_MANY = 64
_LARGE = 2**20  # numbers of states from which on both halves are compiled before there are any
DONE = int(State.DONE)
_STATUS = np.full(len(State), Status.TOO_MANY_STEPS, np.int8)  # also of a run that was ended
_STATUS[State.DONE], _STATUS[State.ENDED] = Status.OK, Status.ENDED
_STATUS[State.NO_VALUE], _STATUS[State.SLIDING] = Status.NONFINITE, Status.SLIDING


class Asked(NamedTuple):
    """What is asked of a motion."""

    times: FloatArray  # (n,), in any order
    sign: int  # -1 backwards in time
    settings: Settings
    threads: int | None = None
    report: Callable[[int], bool] | None = None  # takes the number of states that are done


class Found(NamedTuple):
    """What the engine found of B trajectories."""

    states: FloatArray  # (n, B, D), NaN where a solution has ended
    t: FloatArray  # (B,), the time at which a trajectory ended, NaN if it reached the last one
    steps: NDArray[np.int64]  # (B,)
    status: NDArray[np.int8]  # (B,)
    is_stopped: bool = False  # whether `report` ended the run


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
    times, sign, settings, threads, report = asked
    B = len(starts)
    if B == 1 and report is None:
        alone = _of_one(field, starts, times, sign, settings)
        if alone is not None:
            return alone
    if not B:
        return nothing_found(starts, len(times))
    groups = [*right_hand_sides(field.right_hand_sides, field.shape, batch)]
    for where, f, table in groups:  # LLVM ends the process where it finds no memory
        count = B if where is ALL else len(where)
        prepare(f, settings, count, table.ndim > 1, starts.size * len(times) > _LARGE)
    found = nothing_found(starts, len(times))
    count = threads_for(B, threads)
    done = 0
    for where, f, table in groups:
        x0, states = starts, found.states
        if where is not ALL:
            x0 = starts[where]
            states = np.full((len(times), *x0.shape), np.nan)
        before = done
        own = None if report is None else lambda now, before=before: report(before + now)
        arguments = f, table, x0, times, sign, settings, states
        is_stopped, t, steps, status = call_engine(*arguments, count, own)
        if where is not ALL:
            found.states[:, where] = states
        found.t[where] = np.where(status == Status.OK, np.nan, t)
        found.steps[where], found.status[where] = steps, status
        done += len(times) * len(x0)
        if is_stopped:
            return found._replace(is_stopped=True)
    return found


def call_engine(
    f: Any,
    table: FloatArray,
    x0: FloatArray,
    times: FloatArray,
    sign: int,
    settings: Settings,
    states: FloatArray,
    threads: int,
    report: Callable[[int], bool] | None = None,
) -> tuple[bool, FloatArray, NDArray[np.int64], NDArray[np.int8]]:
    """Write states (n, B, D); return whether `report` ended the run, ends, steps and statuses."""
    engine = Engine(f, table, x0, times, sign, settings, states)
    engine.run(threads, report)
    return engine.is_stopped, sign * engine.t, engine.steps, status_of(engine.state)


def status_of(state: Any) -> NDArray[np.int8]:
    """Return the `Status` of trajectories with these states of the engine."""
    found: NDArray[np.int8] = _STATUS[np.maximum(state, 0)]
    return found


def threads_for(B: int, threads: int | None) -> int:
    """Return how many threads take B trajectories."""
    return threads or (available() if B > _MANY else 1)


def _of_one(
    field: Any, starts: FloatArray, times: FloatArray, sign: int, settings: Settings
) -> Found | None:
    """Return the motion of one trajectory, in few microseconds, or None if that is impossible."""
    _, f, table = field.right_hand_sides[0]
    if f.conditions is not None:
        return None
    result = motion_of_one(f, table.tobytes(), starts.tobytes(), times.tobytes(), sign, settings)
    if result is None:
        return None
    states, t, steps, state = result
    states = np.frombuffer(states).reshape(len(times), *starts.shape)
    if state != DONE:
        states[~(times <= t)] = np.nan
    end = np.nan if state == DONE else sign * t
    return Found(states, np.array([end]), np.array([steps]), _STATUS[state : state + 1].copy())
