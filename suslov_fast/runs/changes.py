"""Changes of the state along motions: what the engine takes of them, and what `Changes` did."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray, common_shape, kind_of, short, wrong
from ..core.lists.changes import Act, in_order_of_code, is_section
from ..core.motion.engine import NO_STOPS, Stops
from .change import Change, field_of, traced
from .points import Points, span


@dataclass(frozen=True, eq=False, repr=False)
class Changes(Points):
    """Records of the changes of the state along motions: ``Motion.changes``.

    There are K of them, ordered by trajectory, then along the motion; at one instant in the order
    in which they acted.

    Attributes
    ----------
    trajectory : ndarray(int, shape=(K,))
        Index of the trajectory, in the batch flattened in C order.
    which : ndarray(int, shape=(K,))
        The number of the change in the list that :func:`flow` was given; 0 if there is one.
    time : ndarray(float, shape=(K,))
        Times at which they acted.
    before, states : ndarray(float, shape=(K, D))
        The states before and after; equal for a record, a change without `to`.
    count : ndarray(int, shape=(..., C))
        How often each of the C changes acted on each trajectory.
    given : tuple of Change
        The changes, with equations as text.
    body
        The system.

    Notes
    -----
    ``len(changes)`` is K; iteration and indexing are those of `states`, so that a table of all
    columns is ``changes.to_dataframe()``. Files and stores of the motion have them.

    Examples
    --------
    >>> from suslov_fast import Change, Field, flow
    >>> cell = Field.from_function(lambda x: (0.1 * x[0],), "mass")
    >>> division = Change(lambda x: x[0] - 2, to=lambda x: (x[0] / 2,))
    >>> changes = flow(cell, [1.0], time=20.0, changes=division).changes
    >>> changes
    Changes(x: (2, 1), time: 6.93147 to 13.8629, count: 2)
    >>> changes.given
    (Change('mass - 2', to=('mass/2',)),)
    """

    called = "changes of a motion"
    coordinates = "trajectory", "which", "time"
    what = "changes"

    trajectory: NDArray[np.int64]
    which: NDArray[np.int64]
    time: FloatArray
    before: FloatArray
    states: FloatArray
    count: NDArray[np.int64]
    body: Any
    _given: tuple[Change, ...] = field(default=(), compare=False)

    @property
    def given(self) -> tuple[Change, ...]:
        """The changes, with equations as text."""
        own = field_of(self.body)
        return tuple(change.of(own) for change in self._given)

    def __eq__(self, other: Any) -> bool:
        are_equal = super().__eq__(other)
        return are_equal and self.given == other.given if are_equal is True else are_equal

    def __getstate__(self) -> dict[str, Any]:
        return super().__getstate__() | {"_given": self.given}

    def save(self, *_: Any, **__: Any) -> None:
        raise TypeError("save: a file of the motion holds its changes: motion.save(path)")

    def __dir__(self) -> list[str]:
        return [name for name in super().__dir__() if name not in ("ok", "save", "what")]

    @property
    def _batch(self) -> tuple[int, ...]:
        return self.count.shape[:-1]

    def __repr__(self) -> str:
        count = ", ".join(map(str, self.count.reshape(-1, len(self._given)).sum(axis=0).tolist()))
        states = f"{self._variable}: {self.states.shape}"
        return f"Changes({states}, time: {span(self.time)}, count: {count})"


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
    first = sum(each.times is None and not is_section(each) for each in changes)
    shapes = [change.times.shape[:-1] for change in later]
    is_shared = all(math.prod(shape) == 1 for shape in shapes)
    times, which = [np.empty((1 if is_shared else math.prod(batch), 0))], []
    for k, change in enumerate(later, first):
        array = change.times
        if not is_shared:
            array = np.broadcast_to(array, (*batch, array.shape[-1]))
        moduli = sign * array.reshape(len(times[0]), -1)
        times.append(np.where(moduli >= 0.0, moduli, np.inf))
        which += [float(k)] * moduli.shape[1]
    both = np.concatenate(times, axis=1)
    order = np.argsort(both, axis=1, kind="stable")
    return Stops(np.take_along_axis(both, order, 1), np.array(which)[order])


def changes_of_records(
    records: Any, system: Any, changes: tuple[Change, ...], batch: tuple[int, ...]
) -> Changes:
    """Return what `Records` of changes say, with their numbers in the list of the user."""
    if records is None:  # of no trajectories, or no times
        return nothing_changed(system, changes, batch, 0)
    numbers, D = np.array(in_order_of_code(changes), np.int64), system.dimension
    columns = {
        "trajectory": records.trajectory,
        "which": numbers[records.which],
        "time": records.time,
        "before": records.before[:, :D],
        "states": records.states[:, :D],
    }
    return changes_of(columns, system, changes, batch)


def changes_of(
    columns: dict[str, Any], system: Any, changes: tuple[Change, ...], batch: tuple[int, ...]
) -> Changes:
    """Return a result with these columns; ValueError if their numbers are none of the batch."""
    B, C = math.prod(batch), len(changes)
    numbers = columns["trajectory"] * C + columns["which"]
    count = np.bincount(numbers, minlength=B * C).reshape(*batch, C)
    return Changes._of(columns | {"count": count, "body": system, "_given": changes})


def nothing_changed(
    system: Any, changes: tuple[Change, ...], batch: tuple[int, ...], count: int
) -> Changes:
    """Return a result without any, whose counts are this number."""
    columns: dict[str, Any] = {name: np.empty(0, np.int64) for name in ("trajectory", "which")}
    columns |= {
        "time": np.empty(0),
        **dict.fromkeys(("before", "states"), np.empty((0, system.dimension))),
    }
    found = changes_of(columns, system, changes, batch)
    return Changes._of(vars(found) | {"count": np.full_like(found.count, count)})
