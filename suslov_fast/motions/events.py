"""`Events`, the record of events along motions; checks of lists of events; their given times."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calls import flat_arrays
from ..checks import FloatArray, common_shape, integer, short, wrong
from ..core.expressions.numpy_evaluation import evaluate
from ..core.flow.batch_solver import NO_EVENT_TIMES, EventTimes
from ..core.hybrid.event_formulas import EventAction, in_order_of_code
from ..fields.html import html_table
from ..fields.layout import parts_of_name
from ..keywords import public
from ..results.result import Result
from ..results.schema import OF_EVENTS
from ..status import Status, ended_in_words
from .actions_on_constraints import action_of
from .event import Event, traced
from .tolerances import CHANGE_AT_REST, DISTANCE_FROM_START


class Derivatives(dict[str, Any]):
    """Derivatives by name, "x0" or a parameter; the error for another name tells how to ask."""

    def __missing__(self, name: str) -> Any:
        real, imag = parts_of_name(name)
        if real in self:
            return _side_by_side(self[real], self[imag])
        raise KeyError(f"{name!r} was not asked for: pass derivatives=({name!r},)")

    @classmethod
    def of(cls, names: Sequence[str], D: int, part: Callable[[Any], Any]) -> Derivatives:
        """Return part(i) by name, where i selects columns: slice(D) for "x0", else one number."""
        others = itertools.count(D if "x0" in names else 0)
        return cls((name, part(slice(D) if name == "x0" else next(others))) for name in names)


def _side_by_side(real: Any, imag: Any) -> Any:
    """Return derivatives with respect to both parts of a complex parameter, on a last axis."""
    if isinstance(real, tuple):
        return type(real)(*map(_side_by_side, real, imag))
    return np.stack([real, imag], axis=-1)


class EventDerivatives(NamedTuple):
    """Derivatives of the times of K events (K,), and of the states before and after them (K, D).

    Derivatives with respect to x0 have one more axis, which has the length D.
    """

    time: FloatArray
    before: FloatArray
    states: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Events(Result):
    """Events along motions: the result of :func:`crossings`, and ``Motion.events``.

    The K events are ordered by trajectory, then along the motion. Events at one instant are in the
    order in which they acted.

    Attributes
    ----------
    trajectory : ndarray(int, shape=(K,))
        Index of the trajectory, in the batch flattened in C order. ``events.of(i)`` are the events
        of trajectory i.
    which : ndarray(int, shape=(K,))
        The number of the surface or of the event in the list that was passed; 0 for a single one.
    time : ndarray(float, shape=(K,))
        The times of the events, as accurate as the tolerance.
    before, states : ndarray(float, shape=(K, D))
        The states before and after each event, which are equal if the event changes nothing.
        `before` lies on the surface up to rounding, on the side to which the motion goes.
    count : ndarray(int, shape=(..., C))
        How often each of the C surfaces or events occurred on each trajectory.
    given : tuple of Event
        The events that were passed, with equations as text.
    body
        The system.
    status, end, final
        As in :class:`Motion`. For :func:`crossings`, `final` is the state at the last time, or at
        the crossing with the number `most`.
    derivatives : dict of EventDerivatives
        For each name in the argument `derivatives`, the derivatives of `time`, `before` and
        `states` with respect to it. They contain the change of the time of the event (saltation
        matrix), and are as accurate as the tolerance.

    Examples
    --------
    >>> from suslov_fast import Event, Field, flow
    >>> cell = Field(lambda x: (0.1 * x[0],), "mass")
    >>> division = Event(lambda x: x[0] - 2, to=lambda x: (x[0] / 2,))
    >>> events = flow(cell, [1.0], time=20.0, events=division).events
    >>> events
    Events(states: (2, 1), time: 6.93147 to 13.8629, count: 2)
    >>> events.given
    (Event('mass - 2', to=('mass/2',)),)
    >>> growth = Field(lambda x, r: (r * x[0],), "mass", r=0.1)
    >>> events = flow(growth, [1.0], time=20.0, events=division, derivatives="r").events
    >>> events.derivatives["r"].time.round(4)  # -log(2) / r**2, twice that
    array([ -69.3147, -138.6294])
    """

    _called = "events"
    _by_number = "events.states[k], or events.time[events.which == k] for one event of a list"
    _in_parts = ", or events.split(), a list of them by trajectory"
    _coordinates: ClassVar[Any] = "trajectory", "which", "time"

    trajectory: NDArray[np.int64]
    which: NDArray[np.int64]
    time: FloatArray
    before: FloatArray
    states: FloatArray
    count: NDArray[np.int64]
    body: Any
    status: NDArray[np.int8]
    end: FloatArray
    final: FloatArray
    _given: tuple[Event, ...] = field(default=(), compare=False)
    _by: tuple[str, ...] = ()
    _time_by: FloatArray | Any = None  # derivatives (K, C) of `time` by C variables: x0, parameters
    _before_by: FloatArray | Any = None  # derivatives of `before` (K, D, C)
    _states_by: FloatArray | Any = None  # derivatives of `states` (K, D, C)

    @property
    def given(self) -> tuple[Event, ...]:
        """The events, with equations as text."""
        return tuple(event.of(self.body) for event in self._given)

    @property
    def derivatives(self) -> dict[str, EventDerivatives]:
        """The derivatives of times and states by name, "x0" or a parameter."""
        columns = self._time_by, self._before_by, self._states_by
        D = self.body._layout.size
        return Derivatives.of(
            self._by, D, lambda at: EventDerivatives(*(a[..., at].copy() for a in columns))
        )

    @classmethod
    def _restored(cls, attributes: dict[str, Any], about: dict[str, Any]) -> Events:
        given = tuple(Event.from_dict(each) for each in about["events"])
        return cls._of(attributes | {"_given": given})

    def __eq__(self, other: Any) -> bool:
        are_equal = super().__eq__(other)
        return are_equal and self.given == other.given if are_equal is True else are_equal

    def __getstate__(self) -> dict[str, Any]:
        return super().__getstate__() | {"_given": self.given}

    @property
    def _batch(self) -> tuple[int, ...]:
        return self.count.shape[:-1]

    def _members(self, index: tuple[int, ...]) -> dict[str, Any]:
        attributes = super()._members(index)
        k = np.ravel_multi_index(index, self._batch)
        kept = slice(*np.searchsorted(self.trajectory, [k, k + 1]))
        for column in OF_EVENTS:
            if (values := attributes[column.name]) is not None:
                attributes[column.name] = values[kept]
        given = tuple(event._member(index) for event in self._given)
        return attributes | {
            "_given": given,
            "trajectory": np.zeros_like(attributes["trajectory"]),
        }

    @public
    def plot(self, *names: int | str, color: Any = None, ax: Any = None, **style: Any) -> Any:
        """Draw the states after the events as dots, such as a Poincare section (extra `plots`).

        Parameters
        ----------
        *names : int or str
            Two or three components, by index or name, also "time"; by default the first two.
        color : str or array_like(float, shape=(...)), optional
            As in :meth:`Motion.plot`; by default colours show the parameter of a family.
        ax : matplotlib.axes.Axes, optional
            Axes to draw on; by default axes of a new figure.
        **style
            Arguments of Matplotlib's `scatter`, such as ``s=2``.

        Returns
        -------
        matplotlib.axes.Axes

        Examples
        --------
        >>> from suslov_fast import Field, crossings
        >>> hill = lambda x: (x[0]**2 + x[1]**2 + x[2]**2 + x[3]**2) / 2 + x[0]**2 * x[1]
        >>> field = Field.from_hamiltonian(hill, "x y px py")
        >>> section = crossings(field, [0.0, 0.1, 0.3, 0.0], "x", time=100.0, direction="up")
        >>> section.plot("y", "py").figure.savefig("section.png")  # doctest: +SKIP
        """
        from ..results.figures import plot_events

        chosen = self.body._layout.drawn(names or (0, 1))
        return plot_events(self, chosen, color, ax, style)

    def split(self) -> list[Events]:
        """Return the events of each trajectory, a list in the order of the batch, flattened.

        Examples
        --------
        The times between the maxima of three oscillators:

        >>> import numpy as np
        >>> from suslov_fast import Field, crossings
        >>> family = Field(lambda x, k: (x[1], -k * x[0]), "x v", k=[1.0, 4.0, 9.0])
        >>> maxima = crossings(family, [1.0, 0.0], "v", direction="down", time=20.0)
        >>> [np.diff(each.time).mean().round(6).item() for each in maxima.split()]
        [6.283185, 3.141593, 2.094395]
        """
        return [self.of(k) for k in range(math.prod(self._batch))]

    def of(self, trajectory: int) -> Events:
        """Return the events of one trajectory, by its number in the batch, flattened in C order."""
        most = math.prod(self._batch) - 1
        k = integer("trajectory", trajectory, 0, f"an integer from 0 to {most}", most)
        index = tuple(map(int, np.unravel_index(k, self._batch))) if self._batch else ()
        return self._of(self._members(index)) if index else self

    def _at_events(self, values: Any) -> Any:
        """Return for each event the value of its trajectory; `values` broadcast with the batch."""
        return np.broadcast_to(values, self._batch).ravel()[self.trajectory]

    def _repr_html_(self) -> str:
        numbers = (a[:8].astype(object) for a in (self.trajectory, self.which, self.time))
        rows = np.c_[(*numbers, self.states[:8])]
        return html_table(self, ["trajectory", "which", "time", *self.names], rows)

    def __repr__(self) -> str:
        count = ", ".join(map(str, self.count.reshape(-1, len(self._given)).sum(axis=0).tolist()))
        states, times = f"states: {self.states.shape}", self.time
        time = f"{times.min():g} to {times.max():g}" if times.size else "none"
        ended = ended_in_words(self.status)
        return f"Events({states}, time: {time}, count: {count}{ended})"


# ---------------------------------------------------------------------- lists of events for motions
def checked_events(events: Any) -> tuple[Event, ...]:
    """Return events and surfaces, one or a list, as a tuple; TypeError for anything else."""
    if events is None or (type(events) is tuple and not events):  # most calls have no events
        return ()
    given = events if isinstance(events, (tuple, list)) else (events,)
    for each in given:
        if not (isinstance(each, (Event, str)) or callable(each)):
            expected = "an Event, a surface as a function or as text, or a list of them"
            raise wrong("events", expected, short(each), TypeError)
    return tuple(each if isinstance(each, Event) else Event(each) for each in given)


def clocked(system: Any, events: tuple[Event, ...]) -> Any:
    """Return a system for the engine: with a hidden time if an event reads it, and f does not."""
    if not events or system._layout.clock is not None:
        return system
    field = system._field
    reads = any(traced(event, field).layout.clock is not None for event in events)
    return field._timed if reads else system


def actions_of(field: Any, events: tuple[Event, ...]) -> tuple[EventAction, ...]:
    """Return the actions of events, traced for a field: surfaces first, then given times."""
    actions = [action_of(event, field) for event in events]
    return tuple(actions[k] for k in in_order_of_code(actions))


def batch_of(events: tuple[Event, ...]) -> tuple[int, ...]:
    """Return the batch shape to which the given times of events broadcast; () without events."""
    if not events:
        return ()
    shapes = [event.times.shape[:-1] for event in events if event.times is not None]
    return common_shape({f"times {k}": shape for k, shape in enumerate(shapes)})


def event_times_of(events: tuple[Event, ...], sign: int, batch: tuple[int, ...]) -> EventTimes:
    """Return the given times of events for a batch of motions with times of this sign, 1 or -1."""
    arrays = [event.times for event in events if event.times is not None]
    if not arrays:
        return NO_EVENT_TIMES
    first = len(events) - len(arrays)  # the compiled code numbers events on surfaces first
    if all(times.size == times.shape[-1] for times in arrays):
        return _shared_times(first, sign, *(times.tobytes() for times in arrays))
    return _event_times(first, sign, [flat_arrays(times, batch) for times in arrays])


@functools.lru_cache(64)
def _shared_times(first: int, sign: int, *each: bytes) -> EventTimes:
    """Return `_event_times` for times that all trajectories share; cached for speed."""
    return _event_times(first, sign, [np.frombuffer(times)[np.newaxis] for times in each])


def _event_times(first: int, sign: int, each: list[FloatArray]) -> EventTimes:
    """Return `EventTimes` of the events first, first + 1, ..., from their times (rows, k).

    NaN, and times in the direction other than `sign`, become infinity: such events never act.
    """
    moduli = sign * np.concatenate(each, axis=1)
    moduli = np.where(moduli >= 0.0, moduli, np.inf)
    which = np.repeat(np.arange(first, first + len(each)), [a.shape[1] for a in each])
    order = np.argsort(moduli, axis=1, kind="stable")
    return EventTimes(np.take_along_axis(moduli, order, 1), which.astype(np.float64)[order])


def starts_at_rest(field: Any, events: tuple[Event, ...], x: FloatArray) -> Any:
    """Return which states x0 (..., D) rest on the surface of an event, and the event; or two None.

    A state rests on a surface if the rate of the surface function s is 0 in the state, and the
    motion then leaves the surface in a direction in which the event acts. Differences of s before
    and after x0 along f show the rate, a midpoint step shows the direction. If an event at time 0
    may change x0, no state rests.
    """
    if any(event.times is not None and (event.times == 0.0).any() for event in events):
        return None, None
    found, of = None, None
    for event in events:
        action = traced(event, field).action
        if action.surface is None or (action.to is None and math.isinf(action.most)):
            continue
        is_on = _surface_at(field, action.surface, x) == 0.0
        if not np.count_nonzero(is_on):
            continue
        with np.errstate(all="ignore"):
            rates, sizes = field._value(x), abs(x).max(axis=-1, keepdims=True)
            h = (
                DISTANCE_FROM_START
                * np.where(sizes > 0, sizes, 1.0)
                / abs(rates).max(axis=-1, keepdims=True)
            )
            middle = x + h * rates
            nearby = x - h * rates, middle, x + 2.0 * h * field._value(middle)
            before, after, later = (_surface_at(field, action.surface, y) for y in nearby)
        sizes = abs(after + before) + abs(later)
        is_at_rest = is_on & (abs(after - before) <= CHANGE_AT_REST * sizes)
        leaves = later * action.direction > 0.0 if action.direction else later != 0.0
        if (which := np.ravel(is_at_rest & leaves)).any():
            found, of = (which if found is None else found | which), event
    return found, of


def _surface_at(field: Any, surface: Any, x: FloatArray) -> FloatArray:
    """Return the values of a surface function at states (..., D) of a field, or of a family."""
    components = x.tolist() if x.ndim == 1 else np.moveaxis(x, -1, 0)  # for speed in small calls
    values = dict(enumerate([*components, *field._inputs]))
    if surface.operations:
        with np.errstate(all="ignore"):
            evaluate(surface.operations, values)
    found = values[surface.results[0]]
    return found if x.ndim == 1 else np.broadcast_to(found, x.shape[:-1])


def events_of_records(records: Any, events: tuple[Event, ...], motion: Any, layout: Any) -> Events:
    """Return `Records` of the engine as `Events`, with the numbers of events in the user's list."""
    columns = {each.name: getattr(records, each.name.lstrip("_")) for each in OF_EVENTS}
    columns["which"] = np.array(in_order_of_code(events), np.int64)[records.which]
    columns |= {k: layout.leave(columns[k]) for k in ("before", "states")}
    if motion._by:
        columns |= {k: layout.leave_rows(columns[k]) for k in ("_before_by", "_states_by")}
    return events_of(columns, events, motion)


def events_of(columns: dict[str, Any], events: tuple[Event, ...], motion: Any) -> Events:
    """Return the `Events` of a motion from the arrays that `OF_EVENTS` lists, by name."""
    status, C = motion.status, len(events)
    numbers = columns["trajectory"] * C + columns["which"]
    # If numbers in a file are out of range, `bincount` or `reshape` raises a ValueError.
    count = np.bincount(numbers, minlength=status.size * C).reshape(*status.shape, C)
    final = np.full(motion.states.shape[1:], np.nan, motion.states.dtype)
    if len(motion.time):
        final[...] = motion.states[-1]
    is_stopped = status == Status.STOPPED
    if is_stopped.any():
        last = np.searchsorted(columns["trajectory"], np.flatnonzero(is_stopped), "right") - 1
        final[is_stopped] = columns["states"][last]
    about = {"status": status, "end": motion.end, "final": final}
    about |= {"count": count, "body": motion.body, "_given": events, "_by": motion._by}
    return Events._of(columns | about)
