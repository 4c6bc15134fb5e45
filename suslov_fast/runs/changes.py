"""Changes of the state along motions: what the engine takes of them, and the events of each."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..checks import common_shape, kind_of, short, warn, wrong
from ..core.lists.changes import Act, in_order_of_code
from ..core.motion.engine import NO_STOPS, Stops
from ..engine.status import Status
from .change import Change, traced
from .events import Events


def checked_changes(changes: Any) -> tuple[Change, ...]:
    """Return changes as a tuple."""
    if type(changes) is tuple and not changes:  # as in most calls
        return ()
    changes = (changes,) if isinstance(changes, Change) else changes
    if not isinstance(changes, (tuple, list)):
        how = f"{kind_of(changes)}: pass Change(surface, to=...)" if callable(changes) else ""
        raise wrong("changes", "a Change, or a list of them", how or short(changes), TypeError)
    for each in changes:
        if not isinstance(each, Change):
            received = (
                f"{kind_of(each)}: pass Change(surface, to=...), or Change(times=..., to=...)"
            )
            raise wrong("changes", "a Change, or a list of them", received, TypeError)
    return tuple(changes)


def acts_of(field: Any, changes: tuple[Change, ...]) -> tuple[Act, ...]:
    """Return the acts of changes, in the order of code."""
    acts = [traced(change, field).act for change in changes]
    return tuple(acts[k] for k in in_order_of_code(acts))


def batch_of(changes: tuple[Change, ...]) -> tuple[int, ...]:
    """Return the shape of the batch of the times of changes."""
    if not changes:
        return ()
    shapes = [change.times.shape[:-1] for change in changes if change.times is not None]
    return common_shape({f"times {k}": shape for k, shape in enumerate(shapes)})


# The last arguments, identities of changes; the changes, which keep them theirs; and `Stops`.
_latest: list[tuple[Any, Any, Stops]] = [(None, None, NO_STOPS)]


def stops_of(changes: tuple[Change, ...], sign: int, batch: tuple[int, ...]) -> Stops:
    """Return the times of changes; calls one after the other for the same objects share them."""
    asked, known = ([*map(id, changes)], sign, batch), _latest[0]
    if known[0] != asked:
        known = _latest[0] = asked, changes, _new_stops(changes, sign, batch)
    return known[2]


def _new_stops(changes: tuple[Change, ...], sign: int, batch: tuple[int, ...]) -> Stops:
    later = [change for change in changes if change.times is not None]
    if not later:
        return NO_STOPS
    # The number of the first one of these.
    first = sum(each.times is None for each in changes)
    shapes = [change.times.shape[:-1] for change in later]
    is_shared = all(math.prod(shape) == 1 for shape in shapes)
    times, which = [np.empty((1 if is_shared else math.prod(batch), 0))], []
    for k, change in enumerate(later, first):
        array = change.times
        if not is_shared:
            array = np.broadcast_to(array, (*batch, array.shape[-1]))
        moduli = sign * array.reshape(len(times[0]), array.shape[-1])
        times.append(np.where(moduli >= 0.0, moduli, np.inf))
        which += [float(k)] * moduli.shape[1]
    both = np.concatenate(times, axis=1)
    order = np.argsort(both, axis=1, kind="stable")
    return Stops(np.take_along_axis(both, order, 1), np.array(which)[order])


def warn_of_times_that_never_come(
    changes: tuple[Change, ...], sign: int, last: float, count: int
) -> None:
    """Warn of each change whose times are all before x0 or after the last time asked, `last`."""
    for k, change in enumerate(changes if count else ()):
        times = None if change.times is None else change.times[np.isfinite(change.times)]
        if times is None or not times.size or ((times * sign >= 0.0) & (abs(times) <= last)).any():
            continue
        warn(
            f"changes: number {k} never acts: its times, {times.min():g} to {times.max():g}, count "
            f"from x0 as those of the motion do, which ends at {sign * last:g}"
        )


def changes_of_records(records: Any, changes: tuple[Change, ...], motion: Any) -> Events:
    """Return the events in `Records`, with the numbers of changes in the list of the user."""
    D, K = motion.body.dimension, 0 if records is None else len(records.time)
    columns: dict[str, Any] = {name: np.empty(0, np.int64) for name in ("trajectory", "which")}
    columns |= {"time": np.empty(0), **dict.fromkeys(("before", "states"), np.empty((0, D)))}
    if K:
        numbers = np.array(in_order_of_code(changes), np.int64)
        columns = {
            "trajectory": records.trajectory,
            "which": numbers[records.which],
            "time": records.time,
            "before": records.before[:, :D],
            "states": records.states[:, :D],
        }
    return changes_of(columns, changes, motion)


def changes_of(columns: dict[str, Any], changes: tuple[Change, ...], motion: Any) -> Events:
    """Return the events of a motion with these columns.

    ValueError if a number of a trajectory or of a change is none of the motion's.
    """
    body, status, C = motion.body, motion.status, len(changes)
    numbers = columns["trajectory"] * C + columns["which"]
    count = np.bincount(numbers, minlength=status.size * C).reshape(*status.shape, C)
    final = np.full((status.size, body.dimension), np.nan)
    if len(motion.time):
        final[:] = motion.states[-1].reshape(final.shape)
    stopped = np.flatnonzero(status.ravel() == Status.STOPPED)
    final[stopped] = columns["states"][np.searchsorted(columns["trajectory"], stopped, "right") - 1]
    about = {
        "status": status,
        "end": motion.end,
        "final": final.reshape(*status.shape, body.dimension),
    }
    return Events._of(columns | about | {"count": count, "body": body, "_given": changes})
