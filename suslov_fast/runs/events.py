"""`Events`: where changes of the state acted, or surfaces were crossed, along motions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray
from ..engine.status import ended_in_words
from ..keywords import public
from .change import Change, field_of
from .columns import CHANGES
from .results import Result

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, eq=False, repr=False)
class Events(Result):
    """Events along motions: the result of :func:`crossings`, and :attr:`Motion.changes`.

    There are K of them, ordered by trajectory, then along the motion; at one instant in the order
    in which they acted.

    Attributes
    ----------
    trajectory : ndarray(int, shape=(K,))
        Index of the trajectory, in the batch flattened in C order:
        ``events.time[events.trajectory == i]`` are the times of trajectory i.
    which : ndarray(int, shape=(K,))
        The number of the surface, or of the change, in the list that was passed; 0 if there is one.
    time : ndarray(float, shape=(K,))
        Times, with the digits of the tolerance.
    before, states : ndarray(float, shape=(K, D))
        The states before and after; equal where nothing changes. At a surface they lie on it to
        rounding, on the side to which the motion goes.
    count : ndarray(int, shape=(..., C))
        How often each of the C surfaces or changes was met by each trajectory.
    given : tuple of Change
        The changes, with equations as text.
    body
        The system.
    status, end, final
        As in :class:`Motion`; of :func:`crossings`, `final` is the state at the last time, or at
        the crossing number `most`.

    Notes
    -----
    Files of a motion have its events.

    Examples
    --------
    >>> from suslov_fast import Change, Field, flow
    >>> cell = Field(lambda x: (0.1 * x[0],), "mass")
    >>> division = Change(lambda x: x[0] - 2, to=lambda x: (x[0] / 2,))
    >>> events = flow(cell, [1.0], time=20.0, changes=division).changes
    >>> events
    Events(states: (2, 1), time: 6.93147 to 13.8629, count: 2)
    >>> events.given
    (Change('mass - 2', to=('mass/2',)),)
    """

    called = "events"
    coordinates: ClassVar[Any] = "trajectory", "which", "time"

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
    _given: tuple[Change, ...] = field(default=(), compare=False)

    @property
    def given(self) -> tuple[Change, ...]:
        """The changes, with equations as text."""
        own = field_of(self.body)
        return tuple(change.of(own) for change in self._given)

    @classmethod
    def _restored(cls, attributes: dict[str, Any], about: dict[str, Any]) -> Events:
        given = tuple(Change.from_dict(each) for each in about["changes"])
        events = cls._of(attributes | {"_given": given})
        size, numbers = events.count.size, events.trajectory * len(given) + events.which
        if not np.array_equal(np.bincount(numbers, minlength=size), events.count.ravel()):
            raise ValueError("count is not that of the events")
        return events

    def __eq__(self, other: Any) -> bool:
        are_equal = super().__eq__(other)
        return are_equal and self.given == other.given if are_equal is True else are_equal

    def __getstate__(self) -> dict[str, Any]:
        return super().__getstate__() | {"_given": self.given}

    @property
    def _batch(self) -> tuple[int, ...]:
        return self.count.shape[:-1]

    @property
    def _heading(self) -> str:
        return str(self._titles["title"])

    def _members(self, index: tuple[int, ...]) -> dict[str, Any]:
        attributes = super()._members(index)
        own = self.trajectory == np.ravel_multi_index(index, self._batch)
        for column in CHANGES:
            attributes[column.name] = attributes[column.name][own]
        return attributes | {"trajectory": np.zeros_like(attributes["trajectory"])}

    def _at_events(self, values: Any, axes: int = 0) -> Any:
        """Return for each event the value (...) of its trajectory, an array of `axes` axes."""
        inner = values.shape[values.ndim - axes :]
        by_trajectory = np.broadcast_to(values, (*self._batch, *inner)).reshape(-1, *inner)
        return by_trajectory[self.trajectory]

    def __repr__(self) -> str:
        count = ", ".join(map(str, self.count.reshape(-1, len(self._given)).sum(axis=0).tolist()))
        states, times = f"states: {self.states.shape}", self.time
        time = f"{times.min():g} to {times.max():g}" if times.size else "none"
        ended = ended_in_words(self.status)
        return f"Events({states}, time: {time}, count: {count}{ended})"

    @public
    def to_xarray(self) -> xarray.Dataset:
        """Return a labelled dataset.

        Dimensions: "event" and "component". The points are "omega", or "x" for a field.
        Coordinates along "event": `trajectory`, `which`, `time`, and parameters of the body that
        vary: ``data.where(data.rho > 24.74, drop=True)``.

        Returns
        -------
        xarray.Dataset
            The events of all trajectories, along "event".

        Examples
        --------
        >>> from suslov_fast import Field, crossings
        >>> pendulum = Field(lambda x: (x[1], -np.sin(x[0])), "angle rate")
        >>> dict(crossings(pendulum, [0.1, 0.0], "angle", time=10.0).to_xarray().sizes)
        {'event': 3, 'component': 2}
        """
        from .datasets import events_to_xarray

        return events_to_xarray(self)

    @public
    def plot(
        self,
        *names: int | str,
        color: Any = None,
        title: str | bool | None = None,
        ax: Any = None,
        label: str | None = None,
    ) -> Any:
        """Draw the points, as :meth:`Trajectories.plot` does states: ``events.plot("y", "py")``.

        By default the components are the first two that vary; of a canonical Hamiltonian field a
        coordinate and its momentum. `color` may also be "trajectory", "which" or "time", or a
        number for each point (K,). Of more than 1,000,000 points it draws as many, chosen at
        random.
        """
        from . import drawing  # which imports Matplotlib

        return drawing.plot_events(self, names, color, title, ax, label)
