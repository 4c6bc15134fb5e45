"""The body in space: angular velocity and momentum, orientation, and scattering angle."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import checks
from .bodies.classes import AnyBody, BodyIn3D
from .bodies.rigid import Suslov3D
from .checks import FloatArray, common_shape
from .keywords import public
from .maps import map_of, problem


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
        Orientations of the body, such as ``run.attitude``. With them, the result is in space.

    Returns
    -------
    ndarray(float, shape=(..., n, n))
        In three dimensions, its product with a vector v is the cross product of (Omega1, Omega2, 0)
        and v. In n dimensions, its last column holds Omega_in.

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

    Examples
    --------
    >>> from suslov_fast import Suslov3D, iterate, momentum
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> run = iterate(body, [1.0, 0.5], eps=0.2, steps=100, attitude=True)
    >>> momentum(body, run.states, attitude=run.attitude)[[0, -1]].round(3)  # in space
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
