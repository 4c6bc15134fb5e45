"""Steps as ``njit`` functions, for your own compiled loops and for Python.

:func:`system` returns the constants of a step: a step of a map, or the motion of a field over a
time. :func:`step_system` computes the next state, an array, in memory that :func:`work` allocates;
each thread of a loop needs memory of its own. For bodies in three dimensions :func:`step` takes and
returns a state as two numbers. States that do not exist are NaN.
"""

from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import ArrayLike

from .checks import MOMENTS, FloatArray, Reals, instance, one_number, real_number, within, wrong
from .core.expressions.variational import variational
from .core.flow.batch_solver import Settings
from .core.flow.held import OF_ANOTHER, PARAMETERS, TIME, MotionSystem, motion_system_of
from .core.maps.step_system import FieldSystem
from .core.numba.arrays import uncounted
from .core.numba.decorators import for_users, of_kind
from .core.numba.intrinsics import with_item
from .core.suslov.map_3d import BodySystem, one_step
from .core.suslov.map_nd import NDSystem
from .fields.base import Body
from .fields.field import Field
from .fields.right_hand_sides import of_one
from .keywords import public
from .maps.map_records import eps_of, map_of
from .motions import motion_arguments
from .motions.event import EventLike
from .motions.events import actions_of, batch_of, checked_events, clocked, event_times_of
from .motions.extension import atol_of_columns, with_atol

__all__ = ["end", "step", "step_system", "system", "with_parameters", "with_time", "work"]


def __dir__() -> list[str]:
    return __all__


System = BodySystem | NDSystem | FieldSystem | MotionSystem
_memory, _one_step, _end = of_kind("memory"), of_kind("one_step"), of_kind("end")


@for_users
def step(system: BodySystem, omega1: float, omega2: float) -> tuple[float, float]:
    """Return the next state of a body in three dimensions, two numbers; NaN if there is none."""
    s = system
    return one_step(s.I1, s.I2, s.I13, s.I23, s.k, s.eps, omega1, omega2)


@public
def system(
    body: Body,
    /,
    eps: Reals | None = None,
    *,
    method: str = "auto",
    time: float | None = None,
    rtol: float = motion_arguments.RTOL,
    atol: ArrayLike | None = None,
    max_step: float | None = None,
    stiff: bool | None = None,
    events: EventLike | Sequence[EventLike] = (),
    derivatives: str | Sequence[str] = (),
) -> System:
    """Return the constants of a step, for compiled loops with a single body, field or map.

    With `eps` a step is a step of Kahan's map. With `time` a step is the motion of a field over
    this time, with the same bits as in :func:`suslov_fast.flow`; if a terminal event ends the
    motion earlier, the next state is the state at the event.

    Parameters
    ----------
    body : Suslov3D, SuslovND, Field or Map
        A single body, field or map, not a batch.
    eps : float
        Step size in time, positive or negative; left out for a `Map`, and with `time`.
    method : str
        As in :func:`suslov_fast.iterate`. A step of order 4, 6 or 8 counts as one step.
    time : float
        Time of the motion, positive or negative, in place of `eps`. If f or an event reads the
        time, the last entry of states is t, because each step begins at another one; a complex
        variable has two entries.
    rtol, atol, max_step, stiff, events
        As in :func:`suslov_fast.flow`, only with `time`. With ``stiff=False`` half as much code is
        compiled.
    derivatives : str or sequence of str
        Names as in :func:`suslov_fast.flow`; "x0" is the state at the start of each step. With C
        columns of derivatives the arrays `x` and `out` of `step_system` have D + D C entries: the D
        components, then the derivatives (D, C) in C order, with the columns for "x0" first.
        `step_system` does not read the derivatives in `x`.

    Returns
    -------
    NamedTuple of arrays and numbers
        Pass it to compiled functions as an argument. For a field it contains memory addresses of
        this process, so Numba does not cache functions that use it as a global variable.

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import SuslovND
    >>> from suslov_fast.compiled import step_system, system, work
    >>> constants = system(SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5]), eps=0.4)
    >>> omega, memory = np.array([0.3, 0.9, -0.6]), work(constants)
    >>> step_system(constants, omega, omega, memory)  # Status.OK; out may be the state itself
    0
    >>> omega.round(6)
    array([ 0.09633 ,  0.914132, -0.609721])
    """
    instance("body", body, Body)
    given = Settings(rtol=rtol, atol=atol, max_step=max_step, stiff=stiff)
    both = (0.0, 0) if time is None else (eps, None)
    others = {"method": method, **given._asdict(), "events": events, "derivatives": derivatives}
    if motion_arguments.either_map_or_motion("system", *both, time, **others):
        return _motion(body, one_number("time", time), given, events, derivatives)
    step_size: Any = within("eps", real_number("eps", eps_of("system", body, eps)), MOMENTS)
    if shape := np.broadcast_shapes(body.shape, np.shape(step_size)):
        received = f"a batch of shape {shape}: loop over both"
        raise wrong("body, eps", "a single body and a single step size", received)
    return map_of(body, method).methods[method].system(body, step_size)


def _not_pickled(_: MotionSystem) -> NoReturn:
    raise TypeError("a motion for loops has addresses of code: make it again in each process")


MotionSystem.__reduce__ = _not_pickled  # type: ignore[method-assign]


def _motion(field: Any, time: float, given: Any, events: Any, derivatives: Any) -> MotionSystem:
    """Return the motion of a single field over a time, with the `given` settings."""
    instance("system", field, Field)
    acting, sign = checked_events(events), -1 if time < 0.0 else 1
    field = clocked(field, acting)
    if shape := field.shape + batch_of(acting):
        received = f"a batch of shape {shape}: make a system for each"
        raise wrong("system", "a single field, with events of the same times for all", received)
    settings = motion_arguments.checked_settings(field, *given)
    names = motion_arguments.checked_derivatives(field, derivatives)
    by = tuple(name for name in names if name != "x0")
    f, inputs = of_one(field, by if names else None, actions_of(field, acting))
    if names:
        f = variational(f, field._layout.D * ("x0" in names) + len(by))
        settings = with_atol(settings, atol_of_columns(settings, f.columns))
    event_times = event_times_of(acting, sign, ()) if acting else None
    parameters = inputs if f.is_dense else inputs[: len(field._inputs)]
    places = [field._coordinates.index(name) for name in by]
    return motion_system_of(f, settings, event_times, inputs, parameters, time, places)


@for_users
def with_parameters(system: MotionSystem, parameters: FloatArray) -> MotionSystem:
    """Return the motion with other parameters (n,), in the order of ``system.parameters``.

    Nothing is compiled. Each step reads the array, so a loop may write new values to it.
    """
    if len(parameters) != len(system.parameters):
        raise ValueError("with_parameters: pass as many as system.parameters has")
    return with_item(system, PARAMETERS, parameters)


@for_users
def with_time(system: MotionSystem, time: float) -> MotionSystem:
    """Return the motion over another time, of the same sign; nothing is compiled."""
    if system.time * time < 0.0:
        raise ValueError("with_time: make another system for the other direction of time")
    return with_item(system, TIME, float(time))


@for_users
def end(system: MotionSystem, work: tuple[Any, ...]) -> float:
    """Return the time at which the last motion ended, which a terminal event may shorten."""
    return _end(uncounted(system), uncounted(work)[1])


@for_users
def work(system: System) -> tuple[Any, ...]:
    """Return the memory in which :func:`step_system` works: one for each thread of a loop."""
    return system.dimension, _memory(system)


@for_users
def step_system(
    system: System,
    x: FloatArray,
    out: FloatArray,
    work: tuple[Any, ...],
) -> int:
    """Write the next state of x (D,) to `out` (D,), which may be x; return its Status.

    If there is no next state, the status is negative and `out` is NaN, so test ``status < 0``; for
    a state that violates constraints of a field it is NONFINITE. The positive status PASSED_POLE is
    for steps that pass a pole, except in three dimensions. NOT_KEPT, positive too, is for motions
    that do not keep a function of :meth:`Field.conserving`. Arrays of another length raise a
    ValueError. Arrays of types other than float64 raise a TypeError when the loop is compiled.
    """
    _check(x, out)
    D, (dimension, memory) = system.dimension, uncounted(work)
    if (len(x) != D) | (len(out) != D) | (dimension != D):
        raise ValueError("step_system: x, out and work must have the dimension of the system")
    status = _one_step(uncounted(system), uncounted(x), uncounted(out), memory)
    if status == OF_ANOTHER:
        raise ValueError("step_system: work must be that of the system")
    return status


def _check(x, out):
    """Refuse arrays of types other than float64, when a loop is compiled."""


@overload(_check)
def _check_types(x, out):
    for name, kind in (("x", x), ("out", out)):
        if not isinstance(kind, types.Array) or (kind.dtype, kind.ndim) != (types.float64, 1):
            raise wrong(name, "an array (D,) of float64", f"{kind!s:.60}", TypeError)
    return lambda x, out: None
