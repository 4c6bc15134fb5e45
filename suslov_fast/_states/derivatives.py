"""Derivatives with respect to time, with the reaction, and those of the map by its state."""

from __future__ import annotations

from numpy.typing import ArrayLike

from .._bodies.base import Body
from .._checks import FloatArray
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


@described
def multipliers(body: Body, x: ArrayLike, eps: ArrayLike) -> FloatArray:
    """Eigenvalues of the derivative of the map at a fixed point.

    Parameters
    ----------
    %(body)s
    x : array_like(float, shape=(..., D))
        Fixed points of the map: steady states of a body, zeros of a field.
    %(eps)s

    Returns
    -------
    ndarray(float or complex, shape=(..., D))
        Dimensionless, in descending order of their moduli, of a conjugate pair the one with the
        positive imaginary part first; floats for a Suslov body, complex for a gyrostat or a field.
        On a line of steady states of a body, that along the line is 1 exactly. Infinite at a pole;
        NaN for states that are NaN.

    Raises
    ------
    %(invalid)s
    ValueError
        If a component of the vector field at a state is above 1e-8 of the sum of the moduli of its
        terms. :func:`jacobian` is the derivative at any state.

    Notes
    -----
    At a fixed point the derivative of the map is (1 - eps f' / 2)**-1 (1 + eps f' / 2), so that an
    eigenvalue mu of f' gives the multiplier (1 + eps mu / 2) / (1 - eps mu / 2). On the line
    x = 0 of equation (8) of the paper this is (1 + Y) / (1 - Y) with Y = eps y / (2 I1 I2). In n
    dimensions mu = c s at omega = c I, for s in the spectrum of ``J**-1 (|I|**2 Id - I I^T)``.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, multipliers
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> multipliers(body, [[0.6, -1.0], [-0.6, 1.0]], eps=0.2).round(6)
    array([[1.      , 0.940805],
           [1.062919, 1.      ]])
    """
    return evaluate("multipliers", body, {"x": x, "eps": eps}, None)
