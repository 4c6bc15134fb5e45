"""Checks of arguments of functions that compute motions."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np

from .. import checks
from ..calls import flat_arrays, thread_count
from ..checks import FloatArray, arguments_of, common_shape, short, wrong
from ..core.flow.batch_solver import Settings, SolverRequest
from ..core.flow.tolerances import LEAST_RTOL
from ..fields.base import Body
from ..fields.constraints import check_constraints
from ..fields.field import Field
from ..fields.layout import parts_of_name
from ..fields.names import TIME
from ..fields.symbols import NotReal
from ..results.result import read_only
from .tolerances import FEW_TIMES, LARGEST_RTOL

# The default of rtol, a float object of its own. So `is` tells whether a user passed rtol where it
# means nothing, also if the user passed 1e-9.
RTOL = float("1e-9")
# The defaults of arguments that only maps have, and of arguments that only motions have.
_OF_MAPS = {"method": "auto"}
_OF_MOTIONS = Settings(RTOL)._asdict() | {"events": (), "derivatives": ()}
_ONE_TIME = {float, int}  # types of a time that is one number


def either_map_or_motion(name: str, eps: Any, steps: Any, time: Any, **others: Any) -> bool:
    """Return True for a call along a motion, with `time`; False for a map, with `eps` and `steps`.

    `others` are arguments that only one of them accepts; TypeError if the call mixes both.
    """
    is_motion = time is not None
    if not is_motion and (eps is None or steps is None):
        raise TypeError(
            f"{name} takes time=T along a motion, or eps and steps along Kahan's map of it"
        )
    given = {"eps": eps is not None, "steps": steps is not None} if is_motion else {}
    for argument, default in (_OF_MAPS if is_motion else _OF_MOTIONS).items():
        value = others.get(argument, default)
        given[argument] = value is not default and not (isinstance(value, str) and value == default)
    checks.left_out("time" if is_motion else "eps and steps", **given)
    return is_motion


def checked_times(value: Any) -> tuple[FloatArray, int]:
    """Return the times (n,), and 1 if they are forward or -1 if they are backward."""
    time = checks.real_number("time", value)
    if isinstance(time, float):
        return read_only(np.array([time])), -1 if time < 0.0 else 1
    if time.ndim > 1:
        raise wrong("time", "a number or a 1-D array", f"an array of shape {time.shape}")
    numbers = time.tolist() if time.size <= FEW_TIMES else (time.min(), time.max())
    low, high = min(numbers, default=0.0), max(numbers, default=0.0)
    if low < 0.0 < high:
        how = "flow(system, x0, time=T)(t) takes times t on both sides of 0"
        raise wrong("time", "all 0 or later, or all 0 or earlier", f"{low:g} and {high:g}: {how}")
    # A copy, which the motion keeps.
    return read_only(np.array(time)), -1 if low < 0.0 else 1


def checked_settings(
    system: Any, rtol: Any, atol: Any = None, max_step: Any = None, stiff: Any = None
) -> Settings:
    """Return the checked `Settings` of motions of a system; TypeError for a `Map`."""
    _ = system._has_eps or system._field  # `_field` raises for a `Map`
    settings = _of_rtol(rtol) if type(rtol) is float else _of_rtol.__wrapped__(rtol)
    if atol is max_step is stiff is None:  # for speed in small calls
        return settings
    if atol is not None:
        atol, layout = checks.real_number("atol", atol), system._layout
        if not isinstance(atol, float) and atol.shape != (layout.n,):
            n = layout.n
            raise wrong("atol", f"a number, or {n}, one for each component", f"{atol.shape}")
        if np.min(atol) < 0.0:
            raise wrong("atol", "0 or more", short(float(np.min(atol))))
        if not isinstance(atol, float):
            atol = layout.atol(tuple(atol.tolist()))
    if max_step is not None:
        max_step = checks.positive("max_step", max_step)
    if stiff is not None and not isinstance(stiff, (bool, np.bool_)):
        raise wrong("stiff", "True, False or None", short(stiff), TypeError)
    return Settings(settings.rtol, atol, max_step, None if stiff is None else bool(stiff))


@functools.lru_cache(64)
def _of_rtol(given: Any) -> Settings:
    rtol = checks.real_number("rtol", given)
    if not isinstance(rtol, float) or not LEAST_RTOL <= rtol <= LARGEST_RTOL:
        raise wrong("rtol", f"a number from {LEAST_RTOL:g} to {LARGEST_RTOL:g}", short(given))
    return Settings(rtol)


def checked_derivatives(system: Any, derivatives: Any) -> tuple[str, ...]:
    """Return the names of derivatives as a tuple, after checks; TypeError for a `Map`."""
    if type(derivatives) is tuple and not derivatives:  # as in most calls
        return ()
    names = derivatives.split() if isinstance(derivatives, str) else derivatives
    known = "x0", *system._field._coordinates
    if not isinstance(names, (tuple, list)) or not all(isinstance(name, str) for name in names):
        raise wrong("derivatives", f"names, such as {known}", short(derivatives), TypeError)
    pairs = [(name, parts_of_name(name)) for name in names]
    names = [each for name, pair in pairs for each in (pair if pair[0] in known else [name])]
    if unknown := [name for name in names if name not in known]:
        raise wrong("derivatives", f"names of {known}", repr(unknown[0]))
    if "x0" in names and "x0" in known[1:]:
        how = "the initial state and a parameter: give the parameter another name"
        raise wrong("derivatives", "names of one thing each", f"'x0', {how}")
    if len({*names}) < len(names):
        raise wrong("derivatives", "different names", short(names))
    return tuple(names)


def request_of(
    system: Any,
    time: Any,
    threads: int | None,
    rtol: Any,
    atol: Any = None,
    max_step: Any = None,
    stiff: Any = None,
) -> SolverRequest:
    """Return the request of a call of `flow` after checks; TypeError for a `Map`."""
    is_plain = threads is atol is max_step is stiff is None and type(rtol) is float
    if is_plain and type(time) in _ONE_TIME and time and system._has_eps:
        return _at_one_time(time, rtol)  # for speed in small calls
    settings = checked_settings(system, rtol, atol, max_step, stiff)
    times, sign = checked_times(time)
    return SolverRequest(times, sign, settings, thread_count(threads))


@functools.lru_cache(64)
def _at_one_time(time: float, rtol: float) -> SolverRequest:
    settings = _of_rtol(rtol)
    times, sign = checked_times(time)
    return SolverRequest(times, sign, settings)


def checked_starts(
    system: Any, x0: Any, others: tuple[int, ...] = (), t0: Any = None
) -> tuple[FloatArray, tuple[int, ...], Any]:
    """Return initial states (B, D) of the engine, the batch shape, and the time at them or None.

    `others` is the batch of event times. ValueError if states violate constraints of the system.
    """
    x0, t0 = checks.start_of(x0, t0)
    x = system._layout.enter("x0", x0, t0)
    if system._quantities:
        check_constraints(system, x)
    if x.ndim == 1 and x.flags.carray and not (system.shape or others):  # for speed in small calls
        return x[np.newaxis], (), t0
    batch = common_shape({"system": system.shape, "x0": x.shape[:-1], "times of events": others})
    return flat_arrays(x, batch), batch, t0


def system_of(system: Any, x0: Any) -> Any:
    """Return the system; for a function of the state, a field with the variables of x0."""
    if isinstance(system, Body):
        return system
    if isinstance(system, type) or not callable(system):
        checks.instance("system", system, Body)  # this raises an error
    if isinstance(x0, Mapping):
        return Field(system, [*x0], complex=[k for k in x0 if np.iscomplexobj(x0[k])] or False)
    is_complex = np.iscomplexobj(x0)
    D = (1, *checks.real_array("x0", np.real(x0) if is_complex else x0, True).shape)[-1]
    others = arguments_of(system)[1:]
    if others and not TIME & {*arguments_of(system)}:
        values = ", ".join(f"{name}=..." for name in others)
        how = f"Field(f, {D}, {values})"
        raise TypeError(f"system: a function of the state alone, or {how}, not one of parameters")
    try:
        return Field(system, D, complex=is_complex)
    except TypeError as error:
        if not isinstance(error.__cause__, NotReal):
            raise
        return Field(system, D, complex=True)
    except ValueError as error:
        raise ValueError(f"{error}, and x0 has {D} components") from None
