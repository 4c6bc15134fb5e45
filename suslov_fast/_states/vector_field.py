"""Vector field and reaction of the continuous problem."""

from __future__ import annotations

from numpy.typing import ArrayLike

from .._checks import FloatArray
from .._docs import filled
from .._engine.arguments import AnyBody, BodyOrField
from .table import evaluate


@filled
def vector_field(body: BodyOrField, omega: ArrayLike, *, threads: int | None = None) -> FloatArray:
    """Time derivative of omega in the continuous motion.

    Returns
    -------
    ndarray(float, shape=(..., D))
        In the unit of omega squared.

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


@filled
def reaction(
    body: AnyBody, omega: ArrayLike, eps: ArrayLike | None = None, *, threads: int | None = None
) -> FloatArray:
    """Lagrange multiplier of the constraint: the torque that keeps Omega3 at 0.

    Parameters
    ----------
    eps : array_like(float, shape=(...)), optional
        Step size, in the unit of time of omega. With it the multiplier is that of the discrete
        equations between each state and its next one, without it that of the continuous equations.

    Returns
    -------
    ndarray(float, shape=(...) or (..., n - 1, n - 1))
        In the unit of inertia times that of omega squared. In n dimensions, the antisymmetric
        matrix lambda_ij of equation (13). NaN, with one :class:`SingularStepWarning`, where eps is
        given and a state has no next state.

    Notes
    -----
    In three dimensions lambda follows from the third equation of (2). Its discretization, made as
    in equation (4), is
    (x_next - x) / eps = lambda + (I1 - I2) (Omega1 Omega2_next + Omega1_next Omega2) / 2.
    A rotor of constant momentum does not change it.

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
