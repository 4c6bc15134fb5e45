"""Derivatives with respect to time, with the reaction, and those of the map by its state."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.base import Body
from .._bodies.rigid import in_units
from .._checks import FloatArray
from .._docs import filled
from .._engine.arguments import WithoutRotor, check, refuse_rotor
from .._kernels.elimination import ACCURATE
from .table import described, evaluate


@described
def vector_field(body: Body, omega: ArrayLike, *, threads: int | None = None) -> FloatArray:
    """Time derivative of omega in the continuous motion.

    %(Parameters: body, omega, threads)s

    Returns
    -------
    ndarray(float, shape=(..., D))
        In the unit of omega squared.

    %(Raises: invalid)s

    Notes
    -----
    Equation (2) of the paper; in n dimensions equation (14).

    Examples
    --------
    >>> from suslov_fast import Suslov3D, vector_field
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> vector_field(body, [1.0, 0.5]).round(6)
    array([ 0.08125, -0.65   ])
    """
    return evaluate("vector_field", body, {"omega": omega}, threads)


@described
def reaction(
    body: Body, omega: ArrayLike, eps: ArrayLike | None = None, *, threads: int | None = None
) -> FloatArray:
    """Lagrange multiplier of the constraint: the torque that keeps Omega3 at 0.

    Parameters
    ----------
    %(body, omega)s
    eps : array_like(float, shape=(...)), optional
        Step size, in the unit of time of omega. With it the multiplier is that of the discrete
        equations between each state and its next one, without it that of the continuous equations.
    %(threads)s

    Returns
    -------
    ndarray(float, shape=(...) or (..., n - 1, n - 1))
        In the unit of inertia times that of omega squared. In n dimensions, the antisymmetric
        matrix lambda_ij of equation (13). NaN, with one :class:`SingularStepWarning`, where eps is
        given and a state has no next state.

    %(Raises: invalid)s

    Notes
    -----
    In three dimensions lambda follows from the third equation of (2), which is discretized as
    (x_next - x) / eps = lambda + (I1 - I2) (Omega1 Omega2_next + Omega1_next Omega2) / 2. A rotor
    does not change it.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, reaction
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> float(reaction(body, [1.0, 0.5]).round(6))
    -1.345625
    >>> float(reaction(body, [1.0, 0.5], eps=0.01).round(6))
    -1.336328
    """
    if eps is None:
        return evaluate("reaction", body, {"omega": omega}, threads)
    return evaluate("discrete_reaction", body, {"omega": omega, "eps": eps}, threads)


@described
def jacobian(
    body: Body, omega: ArrayLike, eps: ArrayLike, *, threads: int | None = None
) -> FloatArray:
    """Derivative of the map: the Jacobian matrix of the next state with respect to the state.

    %(Parameters: body, omega, eps, threads)s

    Returns
    -------
    ndarray(float, shape=(..., D, D))
        Dimensionless; row i, column j holds the derivative of the next Omega_i by Omega_j. NaN,
        with one :class:`SingularStepWarning`, where a state has no next state.

    %(Raises: invalid)s

    Notes
    -----
    In three dimensions equation (8) of the paper is solved for the next state and differentiated.
    In n dimensions, and for fields, elimination gives A(omega; eps)**-1 A(omega_next; -eps), with
    the A of :func:`matrix`. The result is as accurate as that of :func:`step`.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, jacobian
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> jacobian(body, [1.0, 0.5], eps=0.2).round(6)
    array([[ 1.006511,  0.037232],
           [-0.221645,  0.937189]])
    """
    return evaluate("jacobian", body, {"omega": omega, "eps": eps}, threads)


@described
def matrix(
    body: Body, omega: ArrayLike, eps: ArrayLike, *, threads: int | None = None
) -> FloatArray:
    """Matrix A that the paper inverts: A(omega; eps) next_omega = omega.

    For a gyrostat A(omega; eps) next_omega = A(0; -eps) omega.

    %(Parameters: body, omega, eps, threads)s

    Returns
    -------
    ndarray(float, shape=(..., D, D))
        A, dimensionless.

    %(Raises: invalid)s

    Notes
    -----
    The paper inverts it before equation (5), and in (16). It is the identity minus eps / 2 times
    the derivative of the vector field.

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import Suslov3D, matrix, step
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> A = matrix(body, [1.0, 0.5], eps=0.2)
    >>> A.round(6)
    array([[ 0.99375, -0.02   ],
           [ 0.115  ,  1.03   ]])
    >>> (A @ step(body, [1.0, 0.5], eps=0.2)).round(6)
    array([1. , 0.5])
    """
    return evaluate("matrix", body, {"omega": omega, "eps": eps}, threads)


@filled
def multipliers(body: WithoutRotor, c: ArrayLike, eps: ArrayLike) -> FloatArray:
    """Eigenvalues of the derivative of the map at the steady state c (I23, -I13), or c I.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        A single one, or a batch.
    c : array_like(float, shape=(...))
        Position on the line of steady states, in the unit of omega over that of inertia.
    %(eps)s

    Returns
    -------
    ndarray(float, shape=(..., D))
        Dimensionless. The first is 1, for the direction along the line; the others multiply the
        distance from it, and are infinite at a pole.

    %(Raises: invalid)s

    Notes
    -----
    By equation (8) of the paper at x = 0, y = c D, the multiplier is (1 + Y) / (1 - Y) with
    Y = eps c D / (2 I1 I2), D = I13**2 I2 + I23**2 I1. In n dimensions Y = eps c s / 2 for the
    eigenvalues s, in ascending order, of ``J**-1 (|I|**2 Id - I I^T)``.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, multipliers
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> multipliers(body, c=[-2.0, 2.0], eps=0.2).round(6)
    array([[1.      , 0.940805],
           [1.      , 1.062919]])
    """
    refuse_rotor(body, "multipliers", "jacobian at the steady state")
    _, where, step_size, batch, *_ = check(body, WithoutRotor, {"c": c, "eps": eps})
    J, I, _, moments, products = in_units(body)
    spectrum = _spectrum(J, I)
    with np.errstate(all="ignore"):
        where, step_size = (np.asarray(each)[..., np.newaxis] for each in (where, step_size))
        speed = np.ldexp(where, products) * np.ldexp(step_size, products - moments)
        Y = 0.5 * speed * spectrum
        result = np.where(abs(Y) < 1.0, (1.0 + Y) / (1.0 - Y), (1.0 / Y + 1.0) / (1.0 / Y - 1.0))
    full = np.ones((*batch, body.dimension))
    full[..., 1:] = result
    return full


def _spectrum(J: FloatArray, I: FloatArray) -> FloatArray:
    """Return the spectrum of J**-1 (|I|**2 Id - I I^T), ascending, without the 0 of I."""
    if J.shape[-1] == 2:
        trace: FloatArray = (I * (I / J[..., ::-1])).sum(axis=-1, keepdims=True)
        return trace
    # J**-1/2 (|I|**2 Id - I I^T) J**-1/2 is symmetric, maps sqrt(J) I to 0, and has no negative
    # eigenvalues.
    square, across = I * I, I / np.sqrt(J)
    diagonal = np.eye(I.shape[-1], dtype=bool)
    others = np.where(diagonal, 0.0, square[..., np.newaxis, :]).sum(axis=-1)
    symmetric = np.where(
        diagonal,
        (others / J)[..., np.newaxis],
        -across[..., :, np.newaxis] * across[..., np.newaxis, :],
    )
    # Each eigenvalue lies between two of the |I|**2 / J_i.
    poles = square.sum(axis=-1, keepdims=True) / J
    bounds = np.sort(poles, axis=-1)
    found = np.clip(np.linalg.eigvalsh(symmetric)[..., 1:], bounds[..., :-1], bounds[..., 1:])
    uneven = bounds[..., 0] < ACCURATE**2 * bounds[..., -1]
    if uneven.any():
        found[uneven] = _zeros(np.broadcast_to(square, poles.shape)[uneven], poles[uneven])
    return found


def _zeros(square: FloatArray, poles: FloatArray) -> FloatArray:
    """Return the s between poles for which the sum of I_i**2 / (pole_i - s) is 0, by bisection.

    The errors of `eigvalsh` are relative to the largest s, those of this to each.
    """
    bounds, square, poles = np.sort(poles, axis=-1), square[:, np.newaxis], poles[:, np.newaxis]
    low, high = bounds[:, :-1], bounds[:, 1:]
    with np.errstate(all="ignore"):
        for _ in range(80):
            middle = np.where(high > 4.0 * low, np.sqrt(low) * np.sqrt(high), 0.5 * (low + high))
            above = (square / (poles - middle[..., np.newaxis])).sum(axis=-1) < 0.0
            low, high = np.where(above, middle, low), np.where(above, high, middle)
    return high
