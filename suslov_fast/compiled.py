"""Functions for your own compiled loops: ``njit`` functions, which also work from Python.

In three dimensions :func:`frame` returns the constants of a body or gyrostat and a step size. A
loop carries two numbers: :func:`enter` computes them from omega, :func:`advance` takes a step, and
:func:`leave` returns omega. In n dimensions and for fields :func:`system` returns the constants,
:func:`work` the memory of a thread, and :func:`step_system` takes a step.

States that do not exist are NaN. Arrays of other types than float64 do not compile (TypeError).

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

import math
from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload, typeof_impl
from numpy.typing import ArrayLike, NDArray

from .bodies.base import Body
from .bodies.rigid import Suslov3D, SuslovGyrostat
from .checks import MOMENTS, FloatArray, instance, real_number, within, wrong
from .core import quantities, steps_3d, steps_field, steps_nd
from .core.elimination import memory_of_one
from .core.numba import borrowed, for_users, select
from .core.operations import plan_step
from .maps import map_of

__all__ = [
    "FieldSystem",
    "Frame",
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


# Constants of a body and a step size: u = u1 omega1 + u2 omega2, v = v1 omega1 + v2 omega2; m is
# the inverse of this matrix. Without a rotor, u and v are X and Y of the theory pages; with one
# u + i v = eps / 2 (omega1 + i sqrt(I2 / I1) omega2), X = K + a u + b v and Y = b u - a v.
Frame = namedtuple("Frame", "I1 I2 I13 I23 k eps u1 u2 v1 v2 m11 m12 m21 m22")
GyrostatFrame = namedtuple("GyrostatFrame", (*Frame._fields, "K", "a", "b"))


class NDSystem(NamedTuple):
    """A body in n dimensions and a step size."""

    J: FloatArray
    I: FloatArray
    eps: float
    near: float  # a bound, see `steps_nd`


class FieldSystem(NamedTuple):
    """A quadratic field and a step size: half of it times the values of the terms, their indices,
    and the operations of a step.
    """

    half: FloatArray
    indices: NDArray[np.int64]
    operations: NDArray[np.uint32]
    rows: int
    dimension: int


# Numba resolves the length of a tuple as it compiles, and drops the branch for the other kind.
_BODY, _FIELD = len(Frame._fields), len(FieldSystem._fields)


def frame(body: Suslov3D | SuslovGyrostat, /, eps: ArrayLike) -> Frame | GyrostatFrame:
    """Return the constants of one body and one step size, for loops in three dimensions.

    Parameters
    ----------
    body : Suslov3D or SuslovGyrostat
        A single body. For other bodies, and for fields, see :func:`system`.
    eps : float
        Step size, positive or negative, in the unit of time of the body.

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
    map_of(body).formula("frame", body)
    number = _single(body, eps)
    given = I1, I2, I13, I23, k = tuple(map(float, body.constants))
    if number == 0.0 or not any((I13, I23, k)):
        expected = "eps != 0, and I13, I23 or k != 0"
        raise wrong("body, eps", expected, f"{body!r}, eps = {number!r}: the map is the identity")
    half, s = 0.5 * number, math.sqrt(I1 * I2)
    e, ratio = half / s, s / I2
    if "k" in body.parameters:
        scales = half, 0.0, 0.0, half / ratio, 1.0 / half, 0.0, 0.0, ratio / half
        return GyrostatFrame(*given, number, *scales, e * k, I13 / s, I23 * ratio / s)
    scales = e * I13, e * I23, e * I23 * ratio, -e * I13 / ratio
    per_g = 1.0 / (e * (I13 * (I13 / I1) + I23 * (I23 / I2)))
    inverse = I13 / I1 * per_g, I23 / s * per_g, I23 / I2 * per_g, -I13 / s * per_g
    return Frame(*given, number, *scales, *inverse)


def _single(body: Any, eps: ArrayLike) -> float:
    """Return the step size; ValueError for several bodies or step sizes."""
    number = within("eps", real_number("eps", eps), MOMENTS)
    shape = np.broadcast_shapes(body.shape, np.shape(number))
    if shape or not isinstance(number, float):
        raise wrong("body, eps", "one body and one step size", f"the shape {shape}: loop over both")
    return number


@for_users
def enter(frame: Frame | GyrostatFrame, omega1: float, omega2: float) -> tuple[float, float]:
    """Return the numbers u and v of a state, dimensionless and linear in omega."""
    return frame.u1 * omega1 + frame.u2 * omega2, frame.v1 * omega1 + frame.v2 * omega2


@for_users
def advance(frame: Frame | GyrostatFrame, u: float, v: float) -> tuple[float, float]:
    """Return u and v one step further, with one division; NaN where there is no next state."""
    if len(frame) == _BODY:
        _, _, ratio, _ = steps_3d.turn(u, v, 0.0)
        following = u * ratio
        decayed = abs(following) < -steps_3d.NEGLIGIBLE * v
        # (1 + Y_next) / (1 - Y) = X_next / X: the difference would cancel for large v.
        turned = select(abs(v) < 1.0, v - 2.0 * u * following, (1.0 - v) * ratio - 1.0)
        return select(decayed, 0.0, following), turned
    X, Y = frame.K + (frame.a * u + frame.b * v), frame.b * u - frame.a * v
    along, across, _, _ = steps_3d.turn(X, Y, frame.K)
    return along * u - across * v, along * v + across * u


@for_users
def leave(frame: Frame | GyrostatFrame, u: float, v: float) -> tuple[float, float]:
    """Return (omega1, omega2), the inverse of :func:`enter`."""
    return frame.m11 * u + frame.m12 * v, frame.m21 * u + frame.m22 * v


@for_users
def step(frame: Frame | GyrostatFrame, omega1: float, omega2: float) -> tuple[float, float]:
    """Return the next state; NaN where there is none."""
    f = frame
    return steps_3d.one_step(f.I1, f.I2, f.I13, f.I23, f.k, f.eps, omega1, omega2)


@for_users
def vector_field(frame: Frame | GyrostatFrame, omega1: float, omega2: float) -> tuple[float, float]:
    """Return the derivatives of omega1 and omega2, as :func:`suslov_fast.vector_field`."""
    f = frame
    return quantities.vector_field_at(f.I1, f.I2, f.I13, f.I23, f.k, omega1, omega2)


@for_users
def energy(frame: Frame | GyrostatFrame, omega1: float, omega2: float) -> float:
    """Return the energy, as :func:`suslov_fast.energy`."""
    return quantities.energy_at(frame.I1, frame.I2, omega1, omega2)


@for_users
def first_integral(frame: Frame | GyrostatFrame, omega1: float, omega2: float) -> float:
    """Return F of Lemma 1, as :func:`suslov_fast.first_integral`."""
    f = frame
    return quantities.first_integral_at(f.I1, f.I2, f.I13, f.I23, f.k, f.eps, omega1, omega2)


def system(body: Body, /, eps: ArrayLike) -> NDSystem | FieldSystem:
    """Return the constants of one body or field and one step size, for loops in n dimensions.

    Parameters
    ----------
    body : SuslovND, QuadraticField, or a body in three dimensions
        A single body, or a field. For bodies in three dimensions a :func:`frame` is faster.
    eps
        As in :func:`frame`.

    Returns
    -------
    NamedTuple of arrays and float
        An argument of any compiled function.

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
    number = _single(body, eps)
    kernel = map_of(body).methods["auto"].kernel
    if kernel not in (steps_nd.nd_steps, steps_3d.steps, steps_field.field_steps):
        expected = "a body with the steps of the package"
        raise wrong("body", expected, type(body).__name__, TypeError)
    if kernel is steps_nd.nd_steps:
        near = (1.0 - steps_nd.FAR_FROM_0) * float(np.min(body.J))
        return NDSystem(np.array(body.J), np.array(body.I), number, near)
    indices, values = map(np.array, body.terms)
    plan = plan_step(indices, body.dimension)
    return FieldSystem(0.5 * number * values, indices, *plan, body.dimension)


@for_users
def work(system: NDSystem | FieldSystem) -> tuple[Any, ...]:
    """Return the memory that :func:`step_system` needs in one thread; nothing else allocates."""
    if len(system) == _FIELD:
        return np.empty((system.rows, 1)), steps_field.memory_of_lane(system.dimension, 1)
    m = len(system[0])
    block, numbers = np.empty((4, m + m % 2, 1)), np.empty((steps_nd.ROWS, 1))
    return block, numbers, memory_of_one(m)


@for_users
def step_system(
    system: NDSystem | FieldSystem, x: FloatArray, out: FloatArray, work: tuple[Any, ...]
) -> int:
    """Write the state that follows x (D,) to `out` (D,), which may be x; return its Status.

    Where there is no next state, the status is negative and `out` is NaN. Arrays of another length
    raise a ValueError; of another type than float64, a TypeError when the loop is compiled.
    """
    _check(x, out)
    constants, memory = borrowed(system), borrowed(work)
    m = system.dimension if len(system) == _FIELD else len(system[0])
    if (len(x) != m) | (len(out) != m) | (len(memory[-1][0]) != m):
        raise ValueError("step_system: expected x, out and work of the dimension of the system")
    if len(system) == _FIELD:
        return steps_field.field_step_of_one(constants, borrowed(x), borrowed(out), memory)
    return steps_nd.nd_step_of_one(constants, borrowed(x), borrowed(out), memory)


def _check(x, out):
    """Refuse arrays of other types than float64, when a loop is compiled."""


@overload(_check)
def _check_types(x, out):
    for name, each in (("x", x), ("out", out)):
        if not isinstance(each, types.Array) or (each.dtype, each.ndim) != (types.float64, 1):
            raise wrong(name, "an array (D,) of float64", f"{each!s:.60}", TypeError)
    return lambda x, out: None


@typeof_impl.register(Body)
def _refuse_bodies(body, context):
    expected = "frame(body, eps) or system(body, eps)"
    raise wrong("compiled code", expected, type(body).__name__, TypeError)
