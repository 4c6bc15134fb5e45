"""`Motion`, the result of `flow`: states at the requested times, and how motions end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.systems import BodyOrField
from ..checks import FloatArray, Reals, real_number, wrong
from ..core.flow.batch_solver import Settings
from ..fields.html import html_table
from ..keywords import public
from ..results.result import States, read_only
from ..results.schema import OF_EVENTS
from ..status import Status, ended_in_words
from .event import Event
from .events import Derivatives, Events, clocked, events_of, events_of_records
from .motion_arguments import request_of
from .phases import Phases, phases_of
from .solution import solution


@dataclass(frozen=True, eq=False, repr=False)
class Motion(States):
    """Solutions of the equations of motion at given times: the result of :func:`flow`.

    Attributes
    ----------
    states : ndarray(float, shape=(n, ..., D))
        The states at the n times, in the order of `time`; NaN after the end of a solution.
        ``np.asarray(motion)`` is the same array, and ``motion["x1"]`` is one component.
    time : ndarray(float, shape=(n,))
        The times.
    final : ndarray(float, shape=(..., D))
        The state of each trajectory at the last time, or after the terminal event that ended it.
    names : tuple of str
        Names of the components.
    status : ndarray(int8, shape=(...))
        The :class:`Status` of each trajectory: OK; STOPPED, which is positive, if an event ended
        it; NOT_KEPT, positive too, if it does not keep a function of :meth:`Field.conserving`; or
        negative if it has no state at the last time.
    end : ndarray(float, shape=(...))
        The last time of each trajectory: the last one in `time`, or the time at which the solution
        or its computation ended.
    steps : ndarray(int, shape=(...))
        The number of steps, including the steps of a first computation that was repeated; 0 where
        the solution is exact.
    events : Events or None
        The events that happened; None if the call had none.
    phases : Phases
        When trajectories begin and end to slide along a surface where f jumps, or to rest on the
        surface of an event.
    derivatives : dict of str to ndarray
        The derivatives that were asked for. ``motion.derivatives["x0"]`` has the shape
        (n, ..., D, D); its entry [..., i, j] is the derivative of component i with respect to
        component j of x0. The derivative with respect to a parameter has the shape (n, ..., D).
    x0 : ndarray(float, shape=(..., D))
        The initial state of each trajectory.
    t0 : ndarray(float, shape=(...)) or None
        If f takes the time, as f(t, y): the time t at each x0.
    body, rtol, atol, max_step, stiff
        The arguments of :func:`flow`.

    Notes
    -----
    ``motion.ok`` (...) is True where a solution reaches the last time or its terminal event.
    ``motion.member(k)`` is the motion of trajectory k alone. Two motions are equal if all
    attributes are equal, where NaN equals NaN. Arrays are read-only; change a copy.

    Examples
    --------
    An orbit in a cubic potential, along which the energy is constant:

    >>> import numpy as np
    >>> from suslov_fast import Field, flow
    >>> well = Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 - x[0] + x[0] ** 3, "q p")
    >>> motion = flow(well, [0.9, 0.0], time=np.linspace(0, 20, 101))
    >>> motion
    Motion(states: (101, 2), time: 0 to 20, rtol: 1e-09)
    >>> motion.states[-1].round(6), bool(np.ptp(motion.energy()) < 1e-8)
    (array([0.325746, 0.490267]), True)

    The solution as a function of time:

    >>> motion(20.0).round(6), motion([0.0, 0.5]).shape
    (array([0.325746, 0.490267]), (2, 2))
    """

    states: FloatArray
    time: FloatArray
    body: BodyOrField
    status: NDArray[np.int8]
    end: FloatArray
    steps: NDArray[np.int64]
    _start: FloatArray  # (..., D), x0 and a hidden time
    events: Events | None  # without a default, so that `__getattr__` makes it when it is read
    _again: NDArray[np.int8] | Any = None  # 1 if computed again after an alarm (lost digits)
    _t0: FloatArray | Any = 0.0  # the time (...) at x0
    _by: tuple[str, ...] = ()  # the argument `derivatives`
    _derivatives: FloatArray | Any = None  # (n, ..., D, C), by C variables: x0, parameters
    _phases: FloatArray | Any = None  # rows of `phases.rows_of`, if anything slides or rests
    _surfaces: tuple[str, ...] = ()  # texts of the surfaces in `phases`
    # The fields of `Settings`.
    rtol: float | Any = None
    atol: float | tuple[float, ...] | None = None
    max_step: float | None = None
    stiff: bool | None = None

    @classmethod
    def _restored(cls, attributes: dict[str, Any], about: dict[str, Any]) -> Motion:
        parts = {each.name: attributes.pop(f"events.{each.name}") for each in OF_EVENTS}
        attributes["events"] = attributes.pop("events.count")  # replaced below; None without events
        motion = cls._of(attributes)
        if motion.events is not None:
            given = tuple(map(Event.from_dict, about["events"]))
            vars(motion)["events"] = events_of(parts, given, motion)
        return motion

    @public
    def __call__(self, t: Reals, /) -> FloatArray:
        """Return the states of the solution at any times, also after the last time.

        The motion is computed again from its initial states, with the arguments of its call. So
        these states are as accurate as those in the motion, and have the bits of ``flow(...,
        time=t)``. Pass all times at once, because each call takes the time of a call of `flow`.

        Parameters
        ----------
        t : array_like(float, shape=() or (n,))
            Times counted from x0, as `time` in :func:`flow`; here they may lie on both sides of 0.

        Returns
        -------
        ndarray(float, shape=(..., D) or (n, ..., D))
            The states; NaN where a solution has ended before.

        Examples
        --------
        >>> import numpy as np
        >>> from suslov_fast import Field, flow
        >>> motion = flow(Field(lambda x: (x[1], -x[0]), "q p"), [1.0, 0.0], time=10.0)
        >>> motion(np.pi).round(6) + 0.0
        array([-1.,  0.])
        """
        batch, times = self.status.shape, real_number("t", t)
        if np.ndim(times) > 1:
            raise wrong("t", "a number or a 1-D array", f"an array of shape {np.shape(times)}")
        settings = [getattr(self, name) for name in Settings._fields]
        events = () if self.events is None else self.events._given
        system = clocked(self.body, events)
        layout = system._layout
        asked, start = np.ravel(times), self._start.reshape(-1, layout.D)
        states = np.empty((len(asked), *self.states.shape[1:]), self.states.dtype)
        for part in (asked >= 0.0, asked < 0.0):
            if part.any():
                request = request_of(system, asked[part], None, *settings)
                result, _ = solution(system, start, batch, request, None, self._by, events)
                shape = len(result.states), *batch, result.states.shape[-1]
                states[part] = layout.leave(result.states.reshape(shape))
        return read_only(states if np.ndim(times) else states[0])

    def _members(self, index: tuple[int, ...]) -> dict[str, Any]:
        attributes = super()._members(index)
        if self.events is not None:
            attributes["events"] = Events._of(self.events._members(index))
        if self._phases is not None:
            kept = self._phases[:, 0] == np.ravel_multi_index(index, self.status.shape)
            attributes["_phases"] = self._phases[kept] * [0.0, 1.0, 1.0, 1.0]
        return attributes

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name == "events" and "_records" in vars(self):
                records, given, most, layout = vars(self)["_records"]
                records = records.in_order().first(most)
                vars(self)["events"] = events_of_records(records, given, self, layout)
                return self.events
            return super().__getattr__(name)

    @property
    def x0(self) -> FloatArray:
        """The initial states, shape (..., D)."""
        layout = self.body._layout
        return read_only(np.asarray(layout.untimed.leave(self._start[..., : layout.size])))

    @property
    def t0(self) -> FloatArray:
        """The times t at x0, shape (...)."""
        return self._t0

    @property
    def derivatives(self) -> dict[str, FloatArray]:
        """The derivatives of the states by name, "x0" or a parameter."""
        of_columns, D = self._derivatives, self.body._layout.size
        return Derivatives.of(self._by, D, lambda at: np.ascontiguousarray(of_columns[..., at]))

    @property
    def phases(self) -> Phases:
        """Times at which trajectories begin and end to slide or rest."""
        return phases_of(self._phases, self._surfaces)

    @property
    def final(self) -> FloatArray:
        """The states at the last time, or after terminal events, shape (..., D)."""
        if self.events is not None:
            return self.events.final
        if not len(self.time):
            raise IndexError("a motion at no times has no final state: pass time=T to flow")
        return self.states[-1]

    @property
    def _last(self) -> tuple[Any, Any]:
        """The states and the times (...) from which another motion goes on."""
        if self.body._layout.time_variable:
            return self.final, None
        stopped = self.status == Status.STOPPED
        return self.final, self._t0 + np.where(stopped, self.end, self.time[-1])

    def _to_draw(self) -> Motion:
        """The motion or, for one trajectory at one or two times, the same one at 201 times."""
        if self.status.size > 1 or len(self.time) not in (1, 2):
            return self
        first = self.time[0] if len(self.time) == 2 else 0.0
        times = np.linspace(first, self.time[-1], 201)
        return self._of(vars(self) | {"time": times, "states": self(times), "_derivatives": None})

    def _repr_html_(self) -> str:
        last = self.final.reshape(-1, len(self.names)).tolist() if len(self.time) else []
        about = zip(self.status.ravel().tolist(), self.end.ravel().tolist(), last, strict=False)
        rows = ((k, Status(status).name, t, *x) for k, (status, t, x) in enumerate(about))
        return html_table(self, ["trajectory", "status", "end", *self.names], rows)

    def __repr__(self) -> str:
        first_and_last = self.time[:: max(len(self.time) - 1, 1)]
        times = " to ".join(f"{t:g}" for t in first_and_last)
        states = f"states: {self.states.shape}"
        ended = ended_in_words(self.status)
        if count := np.count_nonzero(self._again):
            ended += f", computed again: {count} of {self.status.size}"
        return f"Motion({states}, time: {times or 'none'}, rtol: {self.rtol:g}{ended})"
