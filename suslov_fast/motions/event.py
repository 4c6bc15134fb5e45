"""`Event`, which acts on states along motions: its arguments, its traced functions, its text."""

from __future__ import annotations

import builtins
import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, field, fields, replace
from numbers import Integral, Real
from types import CellType, CodeType, FunctionType
from typing import Any

import numpy as np

from .. import checks
from ..checks import either, short, wrong
from ..core.cached import cached_property
from ..core.hybrid.event_formulas import EventAction, KeyedProgram, read_by
from ..fields.base import Body
from ..fields.equation_text import values_of, written
from ..fields.layout import CLOCK, Layout
from ..fields.state_functions import operands_of
from ..fields.tracer import Tracer, called_by_name, components
from ..fields.user_function import UserFunction
from ..keywords import public, public_class
from ..results.result import place_in, read_only

_ON_SURFACE = "a function of the state, such as lambda x: x[0] - 1, or the name of a component"
_NEW_STATE = "a function of the state that returns the new one, or a list of its components"
_DIRECTIONS = {"up": 1, "down": -1, "both": 0}


@public_class
@dataclass(frozen=True, eq=False, repr=False)
class Event:
    """An event along motions, on a surface or at given times: an argument of :func:`flow`.

    An event is a dose, a reset, a bounce, a spike, a switch, or the end of a trajectory.
    ``flow(system, x0, time=t, events=[...])`` accepts one or more of them, and ``Motion.events``
    records when they happened. The functions of an event are traced, as the function of a
    :class:`Field` is, and run as machine code. After the state they may have arguments with the
    names of parameters of the system.

    If a function uses other names from outside, the event keeps the values that they have when the
    event is made. So a loop variable is a constant of the event.

    Parameters
    ----------
    surface : str or callable, optional
        The name of a component, a formula, or a function s of the state, ``lambda x: x[0] - 30``.
        The event happens where s becomes positive, or stops being positive, along the motion or
        through another event. Where s is NaN no event happens. A start on the surface is no event.
        Attributes `terminal` and `direction` of the function, as SciPy reads them, stand for
        arguments that are left out.
    to : callable or sequence of str or float, or one of these, optional
        The state after the event: a function of the state, ``lambda x: (x[0], -x[1])``, or a list
        of components. A component is a number, or a formula of the state before: ``("h", "-v")``,
        ``(1, 0)``. For a single variable a number is enough. Without `to` and `terminal` the event
        is recorded and changes nothing.
    terminal : bool
        If True, the event ends the trajectory, which then has the status STOPPED.
    direction : {"both", "up", "down"} or {0, 1, -1}
        With "up" the event happens only where s increases, with "down" only where s decreases, in
        the direction of the computation. If the times of :func:`flow` are negative, this direction
        is backwards in time.
    times : array_like(float, shape=(k,) or (..., k)), optional
        In place of a surface, the times of the event: k times for all trajectories, or k times for
        each one, where ``...`` broadcasts with the batch. NaN fills places without a time.
    most : int, optional
        The trajectory ends at the event with this number, 1 or more, with the status STOPPED. It
        does not go on without the event: with ``most=3`` a ball ends at its third bounce.
        Moments at which a resting body leaves the surface do not count.

    Notes
    -----
    At one instant, events at given times act first, then events on surfaces; within both groups
    the order of the list holds. Each event acts on the state after the event before it, and all
    are tried again until none acts. If the motion is wanted at the time of an event, it has the
    state after the event.
    A body that bounces in shorter and shorter hops comes to rest on the surface until a force lifts
    it, see ``Motion.phases``. If other events follow one another without end, the trajectory ends
    with the status ACCUMULATES.
    On a field with constraints (:meth:`Field.from_lagrangian`) new velocities are followed by the
    reactions to them: they become the nearest ones on the constraints, in the metric of the masses;
    of a bounce, an action that turns or stops ds/dt, the new ds/dt is kept. New coordinates must be
    on the constraints, as x0 must be; else the trajectory ends.
    With events, also the motion of a body is solved to the tolerance of :func:`flow`. Two events
    are equal if all attributes are equal. A function is equal to itself alone; ``Event.of`` makes
    an event of texts.

    Examples
    --------
    A ball that keeps 9/10 of its speed at each bounce:

    >>> from suslov_fast import Event, Field, flow
    >>> ball = Field(lambda x, g, e: (x[1], -g), "h v", g=9.81, e=0.9)
    >>> bounce = Event("h", direction=-1, to=lambda x, e: (x[0], -e * x[1]))
    >>> motion = flow(ball, [1.0, 0.0], time=[1.0, 2.0], events=bounce)
    >>> motion.events.time.round(6), motion.states[:, 0].round(6)
    (array([0.451524, 1.264266, 1.995734]), array([0.710949, 0.013684]))

    A dose of 100 at times 0, 24 and 48:

    >>> body = Field(lambda x, k: (-k * x[0],), "c", k=0.1)
    >>> dose = Event(times=[0, 24, 48], to=lambda x: (x[0] + 100,))
    >>> flow(body, [0.0], time=[0, 47, 48], events=dose).states[:, 0].round(3)
    array([100.   ,  10.935, 109.895])
    """

    surface: str | Callable[..., Any] | None = None
    to: Callable[..., Any] | Sequence[str | float] | str | float | None = None
    _: KW_ONLY
    terminal: bool = False
    direction: int | str = "both"
    times: Any = None  # `Any`, so that type checkers ask for no test of None
    most: int | None = None
    _definitions: Mapping[str, str] = field(init=False, default_factory=dict)
    _traced: dict[Any, TracedEvent] = field(init=False, default_factory=dict)
    _kept: dict[str, Any] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        if (self.surface is None) == (self.times is None):
            received = "neither" if self.times is None else "both"
            how = "Event('h', to=...) acts where h is 0, Event(times=[1, 2], to=...) at times"
            raise wrong("surface or times", "given, one of them", f"{received}: {how}")
        if self.surface is not None:
            _check_surface(self.surface)
        terminal, given_direction, most = _as_in_scipy(self)
        to = self.to
        if to in ("up", "down", "both"):
            raise wrong("to", _NEW_STATE, f"{to!r}: pass direction={to!r}")
        to = to.tolist() if isinstance(to, np.ndarray) else to
        to = [to] if isinstance(to, (str, int, float)) else to  # for a field of one variable
        if isinstance(to, (tuple, list)) and all(isinstance(a, (str, int, float)) for a in to):
            to = tuple(a if isinstance(a, str) else repr(float(a)) for a in to)
        elif to is not None and not callable(to):
            how = ": a parameter that changes is a variable of the rate 0" * isinstance(to, dict)
            raise wrong("to", _NEW_STATE, f"{short(to)}{how}", TypeError)
        word: Any = given_direction
        number = _DIRECTIONS.get(word, word) if isinstance(word, str) else word
        known = "1 or 'up', -1 or 'down', 0 or 'both'"
        direction = checks.integer("direction", number, -1, known, 1)
        if direction and self.surface is None:
            raise wrong("direction", "left out beside times")
        if not isinstance(terminal, (bool, np.bool_)):
            raise wrong("terminal", "True or False", short(terminal), TypeError)
        if most is not None:
            most = checks.integer("most", most, 1, "None or an integer of at least 1")
        if terminal and most is not None:
            how = "left out beside terminal=True, at the first: most=3 alone ends at the third"
            raise wrong("most", how)
        vars(self).update(to=to, direction=direction, most=most, terminal=bool(terminal))
        self._kept.update(surface=_with_values(self.surface, {}), to=_with_values(to, {}))
        if self.times is not None:
            times = np.array(checks.float_array("times", self.times), ndmin=1)
            vars(self)["times"] = read_only(times)

    @public
    def of(self, system: Any) -> Event:
        """Return this event with equations as text in the names of a system, so that it pickles."""
        checks.instance("system", system, Body)
        of_system = traced(self, system._field)
        return self if self._is_text else of_system.text

    @public
    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and texts for JSON; an event with functions needs ``of`` first."""
        if not self._is_text:
            raise TypeError("to_dict: functions have no text before they are traced: of(system)")
        entries = self._arguments | {"definitions": dict(self._definitions)}
        if (times := self.times) is not None:  # None replaces NaN, which JSON lacks
            entries["times"] = np.where(np.isfinite(times), times, np.array(None)).tolist()
        return {name: value for name, value in entries.items() if value not in (None, False, 0, {})}

    @classmethod
    @public
    def from_dict(cls, description: Mapping[str, Any]) -> Event:
        """Return the event that :meth:`to_dict` described, also after its way through JSON."""
        checks.instance("description", description, Mapping)
        entries = dict(description)
        definitions = entries.pop("definitions", {})
        if (times := entries.get("times")) is not None:
            entries["times"] = np.array(times, np.float64)  # None becomes NaN
        event = cls(**entries)
        vars(event)["_definitions"] = dict(definitions)
        return event

    @property
    def _arguments(self) -> dict[str, Any]:
        """The checked arguments by name, with which copies, texts and comparisons are made."""
        return {each.name: getattr(self, each.name) for each in fields(self) if each.init}

    @property
    def _takes_time(self) -> bool:
        """True if a function has an argument t, or a text the name t."""
        to = self.to if isinstance(self.to, tuple) else (self.to,)
        given = self.surface, *to, *self._definitions.values()
        return any(
            UserFunction("to", each).has_time
            if callable(each)
            else isinstance(each, str) and re.search(rf"\b{CLOCK}\b", each)
            for each in given
        )

    @property
    def _is_text(self) -> bool:
        return not (callable(self.surface) or callable(self.to))

    def _member(self, index: tuple[int, ...]) -> Event:
        """Return the event of one trajectory, from its index in the batch."""
        if self.times is None or self.times.ndim == 1:
            return self
        event = object.__new__(Event)
        times = self.times[place_in(self.times.shape[:-1], index)]
        vars(event).update(vars(self), times=times, _traced={})
        return event

    def __eq__(self, other: object) -> bool:
        return self._key == other._key if isinstance(other, Event) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[Any, ...]:
        """The values that == and hash compare; times as bytes, because NaN equals NaN there."""
        values = self._arguments
        if self.times is not None:
            values["times"] = self.times.shape, (self.times + 0.0).tobytes()
        return *values.values(), *self._definitions.items()

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_traced": {}, "_kept": {}}

    def __repr__(self) -> str:
        values = self._arguments
        parts = [] if values.pop("surface") is None else [_shown(self.surface)]
        if (times := values.pop("times")) is not None:
            is_short = times.ndim == 1 and times.size <= 4
            numbers = ", ".join(f"{t:g}" for t in times) if is_short else ""
            parts.append(f"times=[{numbers}]" if is_short else f"times: {times.shape}")
        parts += (f"{name}={_shown(value)}" for name, value in values.items() if value)
        return f"Event({', '.join(parts)})"


def traced(event: Event, system: Any) -> TracedEvent:
    """Return the `TracedEvent` of an event for the component and parameter names of a field.

    If the event reads the time, and f of the field does not, it is for the field with a hidden
    time, which its layout tells.
    """
    key = system._layout, system._coordinates
    if key not in event._traced:
        event._traced[key] = _traced(event, *key)
    return event._traced[key]


def _traced(event: Event, layout: Layout, parameters: tuple[str, ...]) -> TracedEvent:
    if layout.clock is None and not layout.time_variable and event._takes_time:
        timed = TracedEvent(event, layout.timed, parameters)
        if layout.timed.clock in timed.action.read():
            return timed
    return TracedEvent(event, layout, parameters)


def _with_values(f: Any, known: dict[int, Any]) -> Any:
    """Return a copy of a function that keeps the present values of names from outside.

    Functions of the same file that the function calls become such copies, too; `known` has the
    copies by id. Anything but a Python function is returned as it is.
    """
    f = getattr(f, "py_func", f)  # of a function of Numba, the Python function
    if not isinstance(f, FunctionType):
        return f
    if id(f) in known:
        return known[id(f)]
    cells = tuple(CellType() for _ in f.__closure__ or ())
    values: dict[str, Any] = {"__builtins__": builtins}
    copy = FunctionType(f.__code__, values, f.__name__, f.__defaults__, cells)
    copy.__kwdefaults__ = f.__kwdefaults__ and dict(f.__kwdefaults__)
    known[id(f)] = copy

    def kept(value: Any) -> Any:
        is_near = isinstance(value, FunctionType) and value.__globals__ is f.__globals__
        return _with_values(value, known) if is_near else value

    names = _names_in(f.__code__)
    values.update((name, kept(f.__globals__[name])) for name in names if name in f.__globals__)
    for cell, given in zip(cells, f.__closure__ or (), strict=True):
        with suppress(ValueError):  # if the name has no value yet
            cell.cell_contents = kept(given.cell_contents)
    return copy


def _names_in(code: CodeType) -> set[str]:
    """Return the outside names that a function, and functions inside it, may use."""
    inner = (each for each in code.co_consts if isinstance(each, CodeType))
    return {*code.co_names}.union(*map(_names_in, inner))


# A surface may stand for an event that only records, or that has the attributes of SciPy's.
EventLike = Event | str | Callable[..., Any]


def _shown(function: Any) -> str:
    """Return a function or texts in short, for messages."""
    if callable(function):
        return getattr(function, "__name__", type(function).__name__)
    return short(function)


def _check_surface(surface: Any) -> None:
    """Raise TypeError unless a surface is a text or a function."""
    if not isinstance(surface, str) and not callable(surface):
        is_number = isinstance(surface, (int, float))
        what = f": pass lambda x: x[k] - {surface}, for component k" * is_number
        what += ": times are times=[1, 2]" * isinstance(surface, (list, tuple, np.ndarray))
        raise wrong("surface", _ON_SURFACE, f"{checks.kind_of(surface)}{what}", TypeError)


def _as_in_scipy(event: Event) -> tuple[Any, Any, Any]:
    """Return `terminal`, `direction` and `most`, from attributes of the surface where left out."""
    terminal, direction, most = event.terminal, event.direction, event.most
    if direction == "both":
        sign = getattr(event.surface, "direction", 0)
        direction = int(np.sign(float(sign))) if isinstance(sign, Real) else sign
    if terminal is False and most is None:  # a number is that of the event that ends the motion
        terminal = getattr(event.surface, "terminal", False)
        if isinstance(terminal, Integral) and not isinstance(terminal, bool):
            terminal, most = False, terminal or None
    return terminal, direction, most


class TracedEvent:
    """An event with its functions as expressions, in these names of variables and parameters."""

    def __init__(self, event: Event, layout: Layout, parameters: tuple[str, ...]) -> None:
        self.event, self.layout, self.tracer = event, layout, Tracer(layout, parameters)
        kept = {"surface": event.surface, "to": event.to} | event._kept
        self.surface = None if event.surface is None else self._surface(kept["surface"])
        self.to = None if event.to is None else self._results("to", kept["to"])
        most = math.inf if event.most is None else float(event.most)
        values = self.tracer.values
        at = None if self.surface is None else KeyedProgram.of(values, [self.surface])
        to = None if self.to is None else KeyedProgram.of(values, self.to)
        self.action = EventAction(at, to, int(event.direction), 1.0 if event.terminal else most)

    def _surface(self, surface: Any) -> Any:
        """Return a surface, a function or text, as an operand; ValueError if it reads no state."""
        known = *self.layout.names, *self.layout.components
        if isinstance(surface, str) and surface.isidentifier() and surface not in known:
            names = either(self.layout.components)
            expected = f"a function of the state, or the name of a component, {names}"
            raise wrong("surface", expected, short(surface))
        (operand,) = self._results("surface", surface)
        name, of = self.tracer.values.of.get(operand, ("", ()))
        if name == "select" and of[1:] == (1.0, 0.0):
            received = f"{self.tracer.text(operand)}: pass the difference that changes its sign"
            raise wrong("surface", _ON_SURFACE, received, TypeError)
        read = read_by(KeyedProgram.of(self.tracer.values, [operand]), [operand])
        if not any(a < self.layout.D for a in read):
            how = f"it is {self.tracer.text(operand)}: Event(times=[...]) acts at given times"
            raise ValueError(f"surface: it must depend on the state, {how}")
        return operand

    def _results(self, argument: str, f: Any) -> list[Any]:
        """Return the results of f, a function or texts, as operands; messages name `argument`."""
        if not callable(f):
            return self._read(argument, [f] if isinstance(f, str) else f)
        return operands_of(argument, f, self.tracer)

    def _read(self, argument: str, texts: Sequence[str]) -> list[Any]:
        """Return formulas, given as texts, as operands; messages name `argument`."""
        tracer, known, layout = self.tracer, self.tracer.known, self.layout
        if argument == "to" and len(texts) not in (layout.n, layout.size):
            names = layout.parts
            how = f"to={(*names[:-1], f'-{names[-1]}/2')} changes {names[-1]} alone"
            expected = f"{len(names)} texts, one for each component"
            raise wrong("to", expected, f"{len(texts)}: {how}")
        each = [*self.event._definitions.items(), *enumerate(texts)]
        try:
            values = values_of(each, known, called_by_name)
            found = [values[k] for k in range(len(texts))]
            if argument == "to" and len(found) == layout.n:
                return components(tracer, layout, found, tracer.time)
            if argument == "to":  # texts of parts
                found = layout.completed(found, tracer.time)
            return [*map(tracer.result, found)]
        except (TypeError, ValueError) as error:
            of = either(tracer.names)
            raise ValueError(f"{argument}: {error}; names of this system are {of}") from None

    @cached_property
    def text(self) -> Event:
        """The event with texts in place of functions."""
        event, surfaces = self.event, [] if self.surface is None else [self.surface]
        results = [*surfaces, *(self.to or ())]
        definitions, texts = written(self.tracer.values, results, self.tracer.names)
        surface = texts[0] if surfaces else None
        to = None if self.to is None else texts[len(surfaces) :][: self.layout.size]
        text = replace(event, surface=surface, to=to)
        vars(text)["_definitions"] = definitions
        return text
