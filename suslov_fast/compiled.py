"""Steps and quantities as ``njit`` functions, for your own compiled loops and for Python.

In three dimensions :func:`frame` returns the constants of a body or gyrostat and a step size. A
loop iterates two numbers: :func:`enter` computes them from omega, :func:`advance` takes a step, and
:func:`leave` computes omega from them. In n dimensions and for fields :func:`system` returns the
constants, :func:`work` the memory of a thread, and :func:`step_system` takes a step.

States that do not exist are NaN. Arrays of types other than float64 do not compile (TypeError).

Examples
--------
>>> from numba import njit
>>> from suslov_fast import Suslov3D
>>> from suslov_fast.compiled import advance, enter, frame
>>> @njit
... def steps_to_the_line(frame, omega1, omega2):
...     u, v = enter(frame, omega1, omega2)
...     n = 0
...     while abs(u) > 1e-9:
...         u, v = advance(frame, u, v)
...         n += 1
...     return n
>>> steps_to_the_line(frame(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), eps=0.2), 1.0, 0.5)
218
"""

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload, typeof_impl

from .bodies.base import Body
from .bodies.rigid import Suslov3D, SuslovGyrostat
from .checks import MOMENTS, FloatArray, Reals, instance, real_number, within, wrong
from .core.compiling.arrays import uncounted
from .core.compiling.llvm import select
from .core.compiling.numba import for_users, formula, of_kind
from .core.suslov import map as map_3d, quantities
from .core.suslov.n_dimensions import GaussSystem, NDSystem
from .core.users.system import FieldSystem
from .keywords import public
from .maps import map_of

__all__ = [
    "FieldSystem",
    "Frame",
    "GaussSystem",
    "GyrostatFrame",
    "NDSystem",
    "advance",
    "energy",
    "enter",
    "first_integral",
    "frame",
    "leave",
    "step",
    "step_system",
    "system",
    "vector_field",
    "work",
]


def __dir__() -> list[str]:
    return __all__


# Without a rotor u and v are X and Y of `core.suslov.map`, and steps with T < 1 have the bits of
# its plain form. With a rotor, X = K + ... would lose digits of ell where K is large. There u and v
# are (omega1, omega2 / back) in the unit of time eps / 2, and the frame is that of the body in this
# unit.


@formula
def enter_body(frame, omega1, omega2):
    """X and Y of a state."""
    f = frame
    _, X, Y = map_3d.frame_and_XY(f.I1, f.I2, f.I13, f.I23, f.k, f.eps, omega1, omega2)
    return X, Y


@formula
def advance_body(frame, X, Y):
    """X and Y of the next state, for any T."""
    square, above, beyond = X * (2.0 * X), 1.0 + Y, Y - 1.0
    # For Y < 0, where D > 1 + X**2, `least` is not that of `map_3d.turn`, but smaller than D, too.
    D, least = square - beyond, map_3d.ZERO_TO_ROUNDING * (above + square)
    ratio = above / select(abs(D) > least, D, np.nan)
    X_next = X * ratio
    decayed = abs(X_next) < -map_3d.NEGLIGIBLE * Y
    # Y - 2 X X_next cancels only where T >= 1; then (1 + Y_next) / (1 - Y) = X_next / X.
    usual = (abs(Y) < 1.0) | (square < 1.0)
    Y_next = select(usual, Y, -1.0) - select(usual, square, beyond) * ratio
    return select(decayed, 0.0, X_next), Y_next


@formula
def enter_gyrostat(frame, omega1, omega2):
    """The state in the unit of time eps / 2."""
    half = 0.5 * frame.eps
    return half * omega1, half * (omega2 / frame.back)


@formula
def advance_gyrostat(frame, u, v):
    """The next state, without a test of the range of X, Y and K."""
    X, Y = frame.K + (frame.a1 * u + frame.a2 * v), frame.a2 * u - frame.a1 * v
    along, across, _, _ = map_3d.turn(X, Y, frame.K)
    return along * u - across * v, along * v + across * u


@formula
def leave_gyrostat(frame, u, v):
    """(omega1, omega2)."""
    half = 0.5 * frame.eps
    return u / half, v / half * frame.back


class Frame(NamedTuple):
    """The constants of a body without a rotor, a step size, and the numbers of `map_3d.Frame`.

    Compares as a tuple.
    """

    I1: float
    I2: float
    I13: float
    I23: float
    k: float
    eps: float
    K: float
    a1: float
    a2: float
    back: float
    m1: float
    m2: float

    enter_state = enter_body
    advance_state = advance_body
    leave_state = map_3d.leave_plain


class GyrostatFrame(Frame):
    """The constants of a gyrostat, a step size, and numbers of `map_3d.Frame`.

    These are in the unit of time eps / 2; m1 and m2, which could be infinite, are 0.
    """

    enter_state = enter_gyrostat
    advance_state = advance_gyrostat
    leave_state = leave_gyrostat


_enter, _advance, _leave = map(of_kind, ("enter_state", "advance_state", "leave_state"))
_memory, _one_step = of_kind("memory"), of_kind("one_step")


@public
def frame(body: Suslov3D | SuslovGyrostat, /, eps: Reals) -> Frame:
    """Return the constants of one body and one step size, for loops in three dimensions.

    Parameters
    ----------
    body : Suslov3D or SuslovGyrostat
        A single body. For other bodies, and for fields, see :func:`system`.
    eps : float
        Step size in time, positive or negative.

    Returns
    -------
    NamedTuple of float
        An argument of any compiled function.

    Raises
    ------
    TypeError
        If the body is of another class.
    ValueError
        If the map is the identity, for I13 = I23 = k = 0 or eps = 0.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> from suslov_fast.compiled import frame, step
    >>> constants = frame(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), eps=0.2)
    >>> omega1, omega2 = step(constants, 1.0, 0.5)
    >>> print(round(omega1, 6), round(omega2, 6))
    1.013781 0.372248
    """
    map_of(body).require("frame", body)
    step_size = _single(body, eps)
    constants = tuple(map(float, body.constants))
    *inertia, k = constants
    if step_size == 0.0 or not any((*inertia[2:], k)):
        text = f"body, eps: the map of {body!r} with eps = {step_size!r} is the identity"
        raise ValueError(f"{text}, which has no frame: use eps != 0, and I13, I23 or k != 0")
    frame_of: Any = map_3d.frame_of.py_func
    with np.errstate(all="ignore"):
        if "k" in body.parameters:
            # In the unit of time eps / 2, in which k is eps k / 2.
            numbers, _ = frame_of(*inertia, 0.5 * step_size * k, 2.0)
            return GyrostatFrame(*constants, step_size, *map(float, numbers[:4]), 0.0, 0.0)
        numbers, _ = frame_of(*constants, step_size)
    return Frame(*constants, step_size, *map(float, numbers))


def _single(body: Any, eps: Reals) -> float:
    """Return the step size; ValueError for several bodies or step sizes."""
    number = within("eps", real_number("eps", eps), MOMENTS)
    shape = np.broadcast_shapes(body.shape, np.shape(number))
    if shape or not isinstance(number, float):
        received = f"a batch of shape {shape}: loop over both"
        raise wrong("body, eps", "a single body and a single step size", received)
    return number


@for_users
def enter(frame: Frame, omega1: float, omega2: float) -> tuple[float, float]:
    """Return the numbers u and v of a state, dimensionless and linear in omega."""
    return _enter(frame, omega1, omega2)


@for_users
def advance(frame: Frame, u: float, v: float) -> tuple[float, float]:
    """Return u and v of the next state, with one division; NaN where there is no next state.

    With a rotor, :func:`step` returns NaN for a state whose X, Y or K exceeds 1e8 in modulus.
    :func:`advance` does not test this, and its result for such a state may have no digits.
    """
    return _advance(frame, u, v)


@for_users
def leave(frame: Frame, u: float, v: float) -> tuple[float, float]:
    """Return (omega1, omega2), the inverse of :func:`enter`."""
    return _leave(frame, u, v)


@for_users
def step(frame: Frame, omega1: float, omega2: float) -> tuple[float, float]:
    """Return the next state; NaN where there is none."""
    f = frame
    return map_3d.one_step(f.I1, f.I2, f.I13, f.I23, f.k, f.eps, omega1, omega2)


@for_users
def vector_field(frame: Frame, omega1: float, omega2: float) -> tuple[float, float]:
    """Return the derivatives of omega1 and omega2, as :func:`suslov_fast.vector_field`."""
    f = frame
    return quantities.vector_field_at(f.I1, f.I2, f.I13, f.I23, f.k, omega1, omega2)


@for_users
def energy(frame: Frame, omega1: float, omega2: float) -> float:
    """Return the energy, as :func:`suslov_fast.energy`."""
    return quantities.energy_at(frame.I1, frame.I2, omega1, omega2)


@for_users
def first_integral(frame: Frame, omega1: float, omega2: float) -> float:
    """Return F of Lemma 1, as :func:`suslov_fast.first_integral`."""
    f = frame
    return quantities.first_integral_at(f.I1, f.I2, f.I13, f.I23, f.k, f.eps, omega1, omega2)


@public
def system(body: Body, /, eps: Reals, *, method: str = "auto") -> NDSystem | FieldSystem:
    """Return the constants of one body or field and one step size, for loops in n dimensions.

    Parameters
    ----------
    body : SuslovND, QuadraticField, or a body in three dimensions
        A single body, or a field. For bodies in three dimensions a :func:`frame` is faster.
    eps
        As in :func:`frame`.
    method : str
        As in :func:`suslov_fast.iterate`. A step of order 4, 6 or 8 counts as one step.

    Returns
    -------
    NamedTuple of arrays and numbers
        Pass it to compiled functions as an argument. Numba does not cache a function in which the
        system of a field is a global, because it contains an address of this process.

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
    step_size = _single(body, eps)
    map = map_of(body, method)
    make = map.methods[method].system
    if make is None:
        received = f"{type(body).__name__}: {map.title} has none by {method!r}"
        raise wrong("body", "one whose map has compiled steps", received, TypeError)
    return make(body, step_size)


@for_users
def work(system: NDSystem | FieldSystem) -> tuple[Any, ...]:
    """Return the memory that :func:`step_system` needs in one thread; steps allocate no more."""
    return system.dimension, _memory(system)


@for_users
def step_system(
    system: NDSystem | FieldSystem,
    x: FloatArray,
    out: FloatArray,
    work: tuple[Any, ...],
) -> int:
    """Write the state that follows x (D,) to `out` (D,), which may be x; return its Status.

    Where there is no next state, the status is negative and `out` is NaN. After a step from
    det A < 0 the status is positive, PASSED_POLE: test ``status < 0``, not its truth. Arrays of
    another length raise a ValueError; arrays of other types than float64 raise a TypeError when the
    loop is compiled.
    """
    _check(x, out)
    D, (dimension, memory) = system.dimension, uncounted(work)
    if (len(x) != D) | (len(out) != D) | (dimension != D):
        raise ValueError("step_system: x, out and work must have the dimension of the system")
    return _one_step(uncounted(system), uncounted(x), uncounted(out), memory)


def _check(x, out):
    """Refuse arrays of types other than float64, when a loop is compiled."""


@overload(_check)
def _check_types(x, out):
    for name, kind in (("x", x), ("out", out)):
        if not isinstance(kind, types.Array) or (kind.dtype, kind.ndim) != (types.float64, 1):
            raise wrong(name, "an array (D,) of float64", f"{kind!s:.60}", TypeError)
    return lambda x, out: None


@typeof_impl.register(Body)
def _refuse_bodies(body, context):
    how = "pass frame(body, eps) or system(body, eps)"
    raise TypeError(f"compiled code cannot take a {type(body).__name__}: {how}")
