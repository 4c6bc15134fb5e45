"""Functions for your own compiled loops: ``njit`` functions, which also work from Python.

In three dimensions :func:`frame` makes the constants of a body, or of a gyrostat, and a step size.
A loop carries two numbers: :func:`enter` makes them of omega, :func:`advance` takes them one step
further, and :func:`leave` turns them back. In n dimensions and for fields :func:`system` makes the
constants, :func:`work` the memory of a thread, and :func:`step_system` takes a step.

They serve ordinary range: dimensionless numbers of moduli below 1e100. What does not exist is NaN.

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

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._bodies.base import Body
from ._bodies.body_3d import Suslov3D, SuslovGyrostat
from ._bodies.body_nd import SuslovND
from ._bodies.field import QuadraticField
from ._checks import FloatArray, instance, real_number, wrong
from ._formulas import coordinates, equations, integrals
from ._jit import borrowed, for_users
from ._kernels import one_state


class Frame(NamedTuple):
    """A body without a rotor and a step size: (u, v) = (X, Y) of the theory pages."""

    I1: float
    I2: float
    I13: float
    I23: float
    k: float  # 0
    eps: float
    # (u, v) = (u1 omega1 + u2 omega2, v1 omega1 + v2 omega2)
    u1: float
    u2: float
    v1: float
    v2: float
    inverse: float  # of the determinant u1 v2 - u2 v1

    labels = ("Omega1", "Omega2")  # of the components of a state


class GyrostatFrame(NamedTuple):
    """A gyrostat and a step size: u + i v = eps / 2 (omega1 + i sqrt(I2 / I1) omega2)."""

    I1: float
    I2: float
    I13: float
    I23: float
    k: float
    eps: float
    u1: float
    u2: float
    v1: float
    v2: float
    inverse: float  # of the determinant u1 v2 - u2 v1
    # X = K + a u + b v, Y = b u - a v.
    K: float
    a: float
    b: float

    labels = Frame.labels


class NDSystem(NamedTuple):
    """A body in n dimensions and a step size."""

    J: FloatArray
    I: FloatArray
    eps: float
    # Below these eps p / 2 and the square of the modulus of omega, a step in O(n) is accurate.
    near: float
    longest: float

    labels = property(lambda self: tuple(f"Omega{i + 1}n" for i in range(len(self.J))))


class FieldSystem(NamedTuple):
    """A quadratic field and a step size, for f = q(x, x) + l x + c."""

    slopes: FloatArray  # eps l / 2, and eps c / 2 in the last column, (D, D + 1)
    indices: NDArray[np.int64]  # i, j and k of the terms v x_j x_k of q_i, (3, T)
    values: FloatArray  # v
    half: float  # eps / 2

    labels = property(lambda self: tuple(f"x{i + 1}" for i in range(len(self.slopes))))


# Numba resolves the length of a tuple as it compiles, and drops the branch for the other kind.
_GYROSTAT, _FIELD = len(GyrostatFrame._fields), len(FieldSystem._fields)


def frame(body: Suslov3D | SuslovGyrostat, eps: ArrayLike) -> Frame | GyrostatFrame:
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
        An argument of any compiled function. Its `labels` are those of the components.

    Raises
    ------
    TypeError
        If the body is of another class, or the step size is no real number.
    ValueError
        If there are several bodies or step sizes, or if the map is the identity.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> from suslov_fast.compiled import frame, step
    >>> constants = frame(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), eps=0.2)
    >>> omega1, omega2 = step(constants, 1.0, 0.5)
    >>> round(omega1, 6), round(omega2, 6)
    (1.013781, 0.372248)
    """
    if isinstance(body, (SuslovND, QuadraticField)):
        expected = "Suslov3D or SuslovGyrostat, or system(body, eps) in place of frame"
        raise wrong("body", expected, type(body).__name__, TypeError)
    instance("body", body, (Suslov3D, SuslovGyrostat))
    name = type(body).__name__
    eps = _single(
        body,
        eps,
        f"[frame({name}(*each), eps) for *each, eps in np.broadcast(*body.parameters, eps)]",
    )
    I1, I2, I13, I23, k = (*body.parameters, 0.0)[:5]
    if eps == 0.0 or I13 == I23 == k == 0.0:
        expected = "eps != 0, and I13, I23 or k != 0"
        raise wrong("body, eps", expected, f"{body!r}, eps = {eps!r}: the map is the identity")
    given = I1, I2, I13, I23, k, eps
    if isinstance(body, SuslovGyrostat):
        half, ratio, mean = 0.5 * eps, math.sqrt(I2 / I1), math.sqrt(I1) * math.sqrt(I2)
        inverse = 1.0 / half / half / ratio
        rotor = half * k / mean, I13 / mean, I23 / I2
        made: Frame | GyrostatFrame = GyrostatFrame(
            *given, half, 0.0, 0.0, half * ratio, inverse, *rotor
        )
    else:
        made = Frame(*given, *map(float, _coordinates(I1, I2, I13, I23, eps)))
    if not all(map(math.isfinite, made)):
        raise wrong("body, eps", "numbers of ordinary range", f"{body!r}, eps = {eps!r}")
    return made


@for_users
def _coordinates(I1, I2, I13, I23, eps):
    u1, v1, _, _ = coordinates.dimensionless(I1, I2, I13, I23, 0.0, eps, 1.0, 0.0)
    u2, v2, _, _ = coordinates.dimensionless(I1, I2, I13, I23, 0.0, eps, 0.0, 1.0)
    return u1, u2, v1, v2, 1.0 / (u1 * v2 - u2 * v1)


def _single(body: Any, eps: ArrayLike, loop: str) -> float:
    """Return the step size; ValueError for several bodies or step sizes."""
    number = real_number("eps", eps)
    shape = np.broadcast_shapes(body.shape, np.shape(number))
    if shape or not isinstance(number, float):
        raise wrong("body, eps", "one body and one step size", f"the shape {shape}: loop, {loop}")
    return number


@for_users
def enter(frame: Frame | GyrostatFrame, omega1: float, omega2: float) -> tuple[float, float]:
    """Return the numbers u and v of a state, dimensionless and linear in omega."""
    return frame.u1 * omega1 + frame.u2 * omega2, frame.v1 * omega1 + frame.v2 * omega2


@for_users
def advance(frame: Frame | GyrostatFrame, u: float, v: float) -> tuple[float, float]:
    """Return u and v one step further, with one division; NaN where there is no next state."""
    if len(frame) == _GYROSTAT:
        return one_state.step_of_gyrostat(frame.K, frame.a, frame.b, u, v)
    return one_state.step_of_body(u, v)


@for_users
def leave(frame: Frame | GyrostatFrame, u: float, v: float) -> tuple[float, float]:
    """Return (omega1, omega2), the inverse of :func:`enter`."""
    f = frame
    return (f.v2 * u - f.u2 * v) * f.inverse, (f.u1 * v - f.v1 * u) * f.inverse


@for_users
def step(frame: Frame | GyrostatFrame, omega1: float, omega2: float) -> tuple[float, float]:
    """Return the next state; NaN where there is none."""
    u, v = enter(frame, omega1, omega2)
    u, v = advance(frame, u, v)
    return leave(frame, u, v)


@for_users
def vector_field(frame: Frame | GyrostatFrame, omega1: float, omega2: float) -> tuple[float, float]:
    """Return the derivatives of omega1 and omega2, as :func:`suslov_fast.vector_field`."""
    f = frame
    return equations.vector_field(f.I1, f.I2, f.I13, f.I23, f.k, f.eps, omega1, omega2)


@for_users
def energy(frame: Frame | GyrostatFrame, omega1: float, omega2: float) -> float:
    """Return the energy, as :func:`suslov_fast.energy`."""
    return integrals.energy(frame.I1, frame.I2, omega1, omega2)


@for_users
def first_integral(frame: Frame | GyrostatFrame, omega1: float, omega2: float) -> float:
    """Return F of Lemma 1, as :func:`suslov_fast.first_integral`."""
    f = frame
    return integrals.first_integral(f.I1, f.I2, f.I13, f.I23, f.k, f.eps, omega1, omega2)


def system(body: Body, eps: ArrayLike) -> NDSystem | FieldSystem:
    """Return the constants of one body or field and one step size, for loops in n dimensions.

    Parameters
    ----------
    body : SuslovND, QuadraticField, or a body in three dimensions
        A single body, or a field. For bodies in three dimensions a :func:`frame` is faster.
    eps : float
        Step size, in the unit of time of the body.

    Returns
    -------
    NamedTuple of arrays and float
        An argument of any compiled function. Its `labels` are those of the components.

    Raises
    ------
    TypeError
        If `body` is neither a body nor a field, or the step size is no real number.
    ValueError
        If there are several bodies or step sizes.

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
    if isinstance(body, SuslovND):
        loop = "[system(SuslovND(J, I), eps) for J, I in zip(body.J, body.I)]"
        eps = _single(body, eps, loop)
        J, I = body.J, body.I
        with np.errstate(divide="ignore"):
            longest = 4.0 * J.min() / np.sqrt(I @ I) / abs(eps)
        return NDSystem(J, I, eps, 0.5 * float(J.min()), float(longest * longest))
    loop = "[system(QuadraticField(*each), eps) for each in zip(field.quadratic, field.linear)]"
    eps, field = _single(body, eps, loop), body.field()
    (indices, values), D = field.terms, field.dimension
    slopes, linear = np.zeros((D, D + 1)), indices[2] == D
    slopes[indices[0, linear], indices[1, linear]] = 0.5 * eps * values[linear]
    return FieldSystem(slopes, indices[:, ~linear].copy(), values[~linear], 0.5 * eps)


@for_users
def work(system: NDSystem | FieldSystem) -> tuple[FloatArray, ...]:
    """Return memory for :func:`step_system`: one for each thread. Nothing else allocates."""
    m = len(system[0])
    return np.empty((2, m, m + 1)), np.empty((2, m))


@for_users
def step_system(
    system: NDSystem | FieldSystem, x: FloatArray, out: FloatArray, work: tuple[FloatArray, ...]
) -> int:
    """Write the state that follows x (D,) to `out` (D,), which may be x; return its Status.

    Where there is no next state, the status is negative and `out` is NaN. Arrays of another length
    are a ValueError.
    """
    x, out, memory, scales = borrowed(x), borrowed(out), borrowed(work[0]), borrowed(work[1])
    first, second = borrowed(system[0]), borrowed(system[1])
    if (len(x) != len(first)) | (len(out) != len(first)) | (memory.shape[1] != len(first)):
        raise ValueError("step_system: expected x, out and work of the dimension of the system")
    if len(system) == _FIELD:
        values = borrowed(system.values)
        return one_state.step_of_field(second, values, system.half, first, x, out, memory, scales)
    eps, near, longest = system.eps, system.near, system.longest
    return one_state.step_nd(first, second, eps, near, longest, x, out, memory, scales)
