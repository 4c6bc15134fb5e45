"""The body in space: angular velocity and momentum, orientation, and scattering angle."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import checks
from .bodies.classes import AnyBody, BodyIn3D
from .bodies.rigid import Suslov3D
from .checks import FloatArray, Reals, common_shape, first_index, spell, wrong
from .core.suslov import orientations
from .engine.arguments import flat_arrays, flat_parameter
from .engine.problem import Problem
from .engine.stretches import states_after
from .engine.threads import call_kernel
from .keywords import public
from .maps import map_of, problem

# Tolerances for consecutive states, relative to the step and to the states: above rounding errors,
# and below the difference that another method or step size makes.
_OF_THE_STEP, _OF_THE_STATE = 1e-6, 1e-10


@public
def to_matrix(
    body: AnyBody,
    omega: ArrayLike,
    /,
    *,
    rotation: ArrayLike | None = None,
    attitude: ArrayLike | None = None,
) -> FloatArray:
    """Angular velocity as an antisymmetric matrix Omega, with ``R' = R Omega``.

    Parameters
    ----------
    body : Suslov3D, SuslovGyrostat or SuslovND
        A single body, or a batch.
    omega : array_like(float, shape=(..., D))
        Angular velocities of the body.
    rotation : array_like(float, shape=(..., n, n)), optional
        The rotation that `from_inertia` or `from_mass_tensor` returned. With it, the result is in
        the basis of the tensor given there, not in the adapted basis.
    attitude : array_like(float, shape=(..., n, n)), optional
        Orientations of the body from :func:`attitude`. With them, the result is in space.

    Returns
    -------
    ndarray(float, shape=(..., n, n))
        In three dimensions, its product with a vector v is the cross product of (Omega1, Omega2, 0)
        and v. In n dimensions, its last column holds Omega_in.

    Raises
    ------
    TypeError, ValueError
        For a field, or if both `rotation` and `attitude` are passed.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, to_matrix
    >>> to_matrix(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [2.0, 5.0])
    array([[ 0.,  0.,  5.],
           [ 0.,  0., -2.],
           [-5.,  2.,  0.]])
    """
    return _shown("to_matrix", body, omega, rotation, attitude)


@public
def to_vector(
    body: BodyIn3D,
    omega: ArrayLike,
    /,
    *,
    rotation: ArrayLike | None = None,
    attitude: ArrayLike | None = None,
) -> FloatArray:
    """Angular velocity as a vector, (Omega1, Omega2, 0), of a body in three dimensions.

    Parameters
    ----------
    body, omega, rotation, attitude
        As in :func:`to_matrix`; omega is (Omega1, Omega2), shape (..., 2).

    Returns
    -------
    ndarray(float, shape=(..., 3))
        (Omega1, Omega2, 0), or the components in the other basis.

    Raises
    ------
    TypeError, ValueError
        As in :func:`to_matrix`, and for a body in n dimensions.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, to_vector
    >>> I = [[4, 0, -0.5], [0, 2, -0.3], [-0.5, -0.3, 3]]
    >>> body, rotation = Suslov3D.from_inertia(I, a=[1, 0, 0])
    >>> to_vector(body, [2.0, 5.0], rotation=rotation).round(4)  # in the basis of I
    array([ 0.    ,  5.3524, -0.5928])
    """
    return _shown("to_vector", body, omega, rotation, attitude)


@public
def momentum(
    body: AnyBody,
    omega: ArrayLike,
    /,
    *,
    rotation: ArrayLike | None = None,
    attitude: ArrayLike | None = None,
) -> FloatArray:
    """Angular momentum M of the body, in the body or in space.

    M = I Omega in three dimensions (without I3, because Omega3 = 0), plus k e3 with a rotor;
    M = I Omega + Omega I in n dimensions. It is not conserved in space: in three dimensions its
    derivative is the :func:`reaction` times the constrained axis.

    Parameters
    ----------
    body, omega, rotation, attitude
        As in :func:`to_matrix`.

    Returns
    -------
    ndarray(float, shape=(..., 3) or (..., n, n))
        A vector in three dimensions, an antisymmetric matrix in n. Unit: inertia * omega.

    Raises
    ------
    TypeError, ValueError
        As in :func:`to_matrix`.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, iterate, momentum
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> run = iterate(body, [1.0, 0.5], eps=0.2, steps=100, attitude=True)
    >>> momentum(body, run.omega, attitude=run.attitude)[[0, -1]].round(3)  # in space
    array([[ 4.   ,  0.5  , -0.65 ],
           [ 2.276, -1.408, -2.146]])
    """
    return _shown("momentum", body, omega, rotation, attitude)


def _shown(
    function: str, body: Any, omega: Any, rotation: ArrayLike | None, attitude: ArrayLike | None
) -> FloatArray:
    """Return vectors (..., n) or matrices (..., n, n) of a function, in the requested basis."""
    checked = problem(function, body, omega)
    with np.errstate(all="ignore"):
        values = checked.map.formulas[function].compute(checked)
    value_axes, n = values.ndim - len(checked.batch), body.dimension + 1
    if rotation is not None and attitude is not None:
        raise ValueError("pass rotation or attitude, not both")
    if rotation is not None:
        R = checks.square_matrices("rotation", rotation, n).swapaxes(-2, -1)
    elif attitude is not None:
        R = checks.square_matrices("attitude", attitude, n, allow_nan=True)
    else:
        return np.asarray(values)
    common_shape({"omega": checked.batch, "matrices": R.shape[:-2]})
    if value_axes == 1:
        return np.asarray((R @ values[..., np.newaxis])[..., 0])
    return np.asarray(R @ values @ R.swapaxes(-2, -1))


@public
def attitude(
    body: AnyBody,
    omega: ArrayLike,
    /,
    eps: Reals,
    R0: ArrayLike | None = None,
    *,
    threads: int | None = None,
) -> FloatArray:
    """Orientation of the body along saved trajectories, as rotation matrices R.

    R_next = R cay(eps (Omega + Omega_next) / 2), with the Cayley map: a discretization of
    R' = R Omega of order 2, which keeps R orthogonal. ``iterate(..., attitude=True)`` computes the
    same during a run, also if it saves only every k-th state.

    Parameters
    ----------
    body, omega, eps
        As in :func:`iterate`, without fields; omega is all consecutive states of a run,
        (N + 1, ..., D).
    R0 : array_like(float, shape=(..., n, n)), optional
        Rotation matrix: the orientation at the first state; by default the identity.
    threads
        As in :func:`iterate`.

    Returns
    -------
    ndarray(float, shape=(N + 1, ..., n, n))
        R takes components in the body to components in space. Dimensionless, orthogonal to
        rounding; NaN from the first NaN state on.

    Raises
    ------
    ValueError
        If the states are not consecutive states of a run with this eps or -eps (tolerance 1e-6 of
        the step and 1e-10 of the states), for example if only every k-th state was saved.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, attitude, iterate
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> R = attitude(body, iterate(body, [1.0, 0.5], eps=0.2, steps=100).omega, eps=0.2)
    >>> R[-1].round(3)
    array([[ 0.441, -0.668, -0.6  ],
           [-0.72 , -0.662,  0.207],
           [-0.536,  0.341, -0.773]])
    """
    map_of(body).require("attitude", body)
    path, D = checks.states("omega", omega, body.labels), body.dimension
    if path.ndim < 2 or len(path) == 0:
        raise wrong("omega", f"have the shape (N + 1, ..., {D})", path.shape)
    first = problem("attitude", body, path[0], eps, threads)
    R0 = np.eye(D + 1) if R0 is None else checks.rotations("R0", R0, D + 1)
    batch = common_shape({"omega and eps": first.batch, "R0": R0.shape[:-2]})
    path = np.expand_dims(path, tuple(range(1, len(batch) + 3 - path.ndim)))
    path = np.broadcast_to(path, (len(path), *batch, D))
    _check_that_states_follow(first, path)
    flat = flat_arrays(path.reshape(len(path), math.prod(batch), D), (len(path),), 2)
    turns = np.empty((*flat.shape[:2], D + 1, D + 1))
    turns[0] = flat_arrays(R0, batch, 2)
    turns[0, np.isnan(flat[0]).any(axis=-1)] = np.nan
    arrays = flat, flat_parameter(first.eps, batch), first.map.attitude == "axial", turns[0].copy()
    start, every, row = 0, 1, 1
    threads = first.threads
    call_kernel(orientations.turn_along, turns.size, threads, *arrays, start, every, row, turns)
    return turns.reshape((len(path), *batch, D + 1, D + 1))


def _check_that_states_follow(first: Problem, states: FloatArray) -> None:
    """Raise ValueError if states (N + 1, ..., D) are not consecutive states of the map."""
    before, after, eps = states[:-1], states[1:], first.eps
    with np.errstate(all="ignore"):
        step, size = abs(after - before).max(axis=-1), (abs(after) + abs(before)).max(axis=-1)
        strays = ~np.isnan(step)
        for start, last, h in ((before, after, eps), (after, before, -eps)):
            batch = start.shape[:-1]
            image = states_after(first._replace(omega=start, eps=h, batch=batch, threads=None))
            error = abs(image - last).max(axis=-1)
            strays &= ~(error <= _OF_THE_STEP * step + _OF_THE_STATE * size)
    if strays.any():
        row, *place = first_index(strays)
        where = f" of trajectory {spell(tuple(place))}" if place else ""
        text = (
            f"omega: a step of the map with this eps does not take state {row}{where} to the next"
        )
        how = "pass all states of iterate, or call it with attitude=True; flow has no attitude"
        raise ValueError(f"{text}: {how}")


@public
def scattering_angle(body: Suslov3D, /) -> FloatArray:
    """Angle between the limits of the angular velocity in space at times -infinity and +infinity.

    This is the angle of the continuous motion, which depends only on the body; the angle of the map
    converges to it with order 2 in eps. With D = I13**2 I2 + I23**2 I1, m**2 = I13**2 + I23**2,
    alpha = I1 I2 m / D, beta**2 = I1 I2 / m**2, gamma = beta I13 I23 (I2 - I1) / D and
    kappa**2 = (alpha - i gamma)**2 - beta**2,

    sin(angle / 2)**2 = (Re cosh(pi kappa / 2) / cosh(pi alpha / 2))**2
    + (Im cosh(pi kappa / 2) / sinh(pi alpha / 2))**2,

    for gamma = 0 a result of Fedorov, Maciejewski and Przybylska, Nonlinearity 22 (2009),
    arXiv:0902.0079.

    Parameters
    ----------
    body : Suslov3D
        A single one, or a batch.

    Returns
    -------
    ndarray(float, shape=(...))
        Angle in radians between 0 (the body turns over) and pi (it returns to its initial
        orientation); NaN if I13 = I23 = 0. Its error is about 1e-15 (alpha + beta + abs(gamma)).

    Raises
    ------
    TypeError
        If the body is not a `Suslov3D`.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, scattering_angle
    >>> float(scattering_angle(Suslov3D(I1=4, I2=1, I13=-1.5, I23=-0.3)).round(12))
    1.221073798141
    """
    map_of(body).require("scattering_angle", body)
    I1, I2, I13, I23 = np.broadcast_arrays(*body.constants[:4])
    # Written with sums of positive terms, which lose no digits. Let A, B, C and P + i Q be pi / 2
    # times alpha, beta, abs(gamma) and the conjugate of kappa, and S = sin(angle / 2). Then A - P
    # is the real part of B**2 / (A + i C + P + i Q), and
    # |S|**2 = (cosh(P) cos(Q) / cosh(A))**2 + (sinh(P) sin(Q) / sinh(A))**2,
    # 1 - |S|**2 = sinh(A - P) sinh(A + P) ((cos(Q) / cosh(A))**2 + (sin(Q) / sinh(A))**2).
    with np.errstate(all="ignore"):  # I13 = I23 = 0 gives NaN; what underflows is 0
        m, D = np.hypot(I13, I23), I13 * I13 * I2 + I23 * I23 * I1
        A, B = 0.5 * np.pi * (I1 * I2 * (m / D)), 0.5 * np.pi * np.sqrt(I1 * I2) / m
        C = abs(B * (I13 * (I2 - I1) / D * I23))
        kappa = np.sqrt((A - B) * (A + B) - C * C + 2j * (A * C))
        P, Q = kappa.real, kappa.imag
        gap = B * (B / np.hypot(A + P, C + Q)) * ((A + P) / np.hypot(A + P, C + Q))  # A - P
        # Numerators and denominators are divided by exp(A), so that they do not overflow.
        cosine, sine = np.cos(Q) / (1.0 + np.exp(-2.0 * A)), np.sin(Q) / -np.expm1(-2.0 * A)
        S = np.exp(-gap) * np.hypot((1.0 + np.exp(-2.0 * P)) * cosine, -np.expm1(-2.0 * P) * sine)
        product = np.expm1(-2.0 * gap) * np.expm1(-2.0 * (A + P))
        return np.asarray(2.0 * np.arctan2(S, np.sqrt(product) * np.hypot(cosine, sine)))[()]
