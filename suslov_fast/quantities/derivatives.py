"""The vector field, the reaction, and derivatives of the map: Jacobians, multipliers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.classes import AnyBody, BodyOrField
from ..bodies.fields.terms import Terms, slopes_at, sums_at
from ..checks import FloatArray, Reals, first_index, spell
from ..engine.problem import Problem
from ..keywords import public
from ..maps import Method, map_of, problem
from .evaluation import evaluate

# Tolerance of fixed points: the modulus of a component of f over the sum of those of its terms.
_FIXED = 1e-8


@public
def vector_field(system: BodyOrField, x: ArrayLike, /) -> FloatArray:
    """Right-hand side f(x) of the equations of motion ``x' = f(x)``.

    For a body, the time derivative of its angular velocity.

    Parameters
    ----------
    system, x
        As in :func:`jacobian`.

    Returns
    -------
    ndarray(float, shape=(..., D))
        f(x), unit x / time; for a body, omega**2.

    Notes
    -----
    For bodies these are equations (2) and (14) of Dragovic and Gajic, arXiv:0807.2966.

    Examples
    --------
    >>> from suslov_fast import Field, vector_field
    >>> field = Field(lambda x: (x[0] - x[0] * x[1], x[0] * x[1] - x[1]), 2)
    >>> vector_field(field, [[1.0, 0.5], [2.0, 1.0]])
    array([[0.5, 0. ],
           [0. , 1. ]])
    """
    return evaluate("vector_field", system, x)


@public
def reaction(body: AnyBody, omega: ArrayLike, /, eps: Reals | None = None) -> FloatArray:
    """Torque of the constraint of a body: the Lagrange multiplier lambda that keeps Omega3 at 0.

    With x = I13 Omega1 + I23 Omega2, the third equation of motion is
    ``x' = lambda + (I1 - I2) Omega1 Omega2``, and its discretization is
    (x_next - x) / eps = lambda + (I1 - I2) (Omega1 Omega2_next + Omega1_next Omega2) / 2.

    Parameters
    ----------
    body, omega
        As in :func:`jacobian`, without fields.
    eps : array_like(float, shape=(...)), optional
        With a step size, lambda between each state and the next one; without, that of the
        continuous motion.

    Returns
    -------
    ndarray(float, shape=(...) or (..., n - 1, n - 1))
        Unit: inertia * omega**2. In n dimensions, the antisymmetric matrix lambda_ij. With eps, NaN
        and one :class:`IntegrationWarning` for a state on a pole of the map.

    Notes
    -----
    Equations (2) and (13) of Dragovic and Gajic, arXiv:0807.2966.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, reaction
    >>> float(reaction(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [1.0, 0.5], eps=0.01).round(6))
    -1.336328
    """
    return evaluate("reaction", body, omega, 0.0 if eps is None else eps)


@public
def matrix(system: BodyOrField, x: ArrayLike, /, eps: Reals) -> FloatArray:
    """Matrix A of the linear system that a step of Kahan's map solves.

    A = 1 - (eps / 2) f'(x), and A (x_next - x) = eps f(x), where f is the :func:`vector_field`. The
    map has a pole where det A = 0. For a body without a rotor A x_next = x: the matrices before
    equation (5) and of equation (16) of Dragovic and Gajic, arXiv:0807.2966.

    Parameters
    ----------
    system, x, eps
        As in :func:`jacobian`.

    Returns
    -------
    ndarray(float, shape=(..., D, D))
        A, dimensionless.

    Examples
    --------
    >>> from suslov_fast import Field, matrix
    >>> field = Field(lambda x: (x[0] - x[0] * x[1], x[0] * x[1] - x[1]), 2)
    >>> matrix(field, [1.0, 0.5], eps=0.2)
    array([[ 0.95,  0.1 ],
           [-0.05,  1.  ]])
    """
    return evaluate("matrix", system, x, eps)


@public
def jacobian(
    system: BodyOrField, x: ArrayLike, /, eps: Reals, *, method: Method = "auto"
) -> FloatArray:
    """Derivative of the map: row i, column j holds d(x_next)_i / dx_j.

    For Kahan's map it is A(x; eps)**-1 A(x_next; -eps), with the A of :func:`matrix`; for the
    methods of order 4, 6 and 8 the product over all sub-steps.

    Parameters
    ----------
    system : Field, Suslov3D, SuslovGyrostat or SuslovND
        A single field or body, or a batch.
    x : array_like(float, shape=(..., D))
        States x of a field, or angular velocities of a body. NaN gives NaN.
    eps : array_like(float, shape=(...))
        Step size in time; a negative one steps back.
    method : str
        As in :func:`iterate`.

    Returns
    -------
    ndarray(float, shape=(..., D, D))
        NaN, with one :class:`IntegrationWarning`, for a state on a pole of the map.

    Examples
    --------
    >>> from suslov_fast import Field, jacobian
    >>> field = Field(lambda x: (x[0] - x[0] * x[1], x[0] * x[1] - x[1]), 2)
    >>> jacobian(field, [1.0, 0.5], eps=0.2).round(6)
    array([[ 1.093638, -0.221485],
           [ 0.105205,  0.999397]])
    """
    return evaluate("jacobian", system, x, eps, map=map_of(system, method))


@public
def multipliers(
    system: BodyOrField, x: ArrayLike, /, eps: Reals, *, method: Method = "auto"
) -> FloatArray:
    """Multipliers of fixed points (equilibria): the eigenvalues of the derivative of the map.

    A fixed point is stable if all moduli are below 1. Multipliers of Kahan's map are
    (1 + eps mu / 2) / (1 - eps mu / 2) for the eigenvalues mu of f', those of order 4, 6 and 8 the
    products of these over all sub-steps. For a body in n dimensions mu = c s at omega = c I, for s
    in the spectrum of ``J**-1 (|I|**2 Id - I I^T)``.

    Parameters
    ----------
    system
        As in :func:`jacobian`.
    x : array_like(float, shape=(..., D))
        Fixed points of the map: zeros of a field, steady states of a body.
    eps, method
        As in :func:`jacobian`.

    Returns
    -------
    ndarray(float or complex, shape=(..., D))
        Sorted by decreasing modulus; in conjugate pairs Im > 0 comes first. Complex for a field or
        a gyrostat; floats for other bodies, where 1 belongs to the line of steady states. Infinite
        at a pole.

    Raises
    ------
    ValueError
        If x is not a fixed point: a component of f(x) exceeds 1e-8 of the sum of the moduli of its
        terms, and a step of Newton's method moves x by more than 1e-8 of ``max abs(x)``. At other
        states use :func:`jacobian`.

    Examples
    --------
    A damped oscillator, whose equilibrium is stable:

    >>> from suslov_fast import Field, multipliers
    >>> field = Field(lambda x: (x[1], -x[0] - 0.1 * x[1]), "x v")
    >>> abs(multipliers(field, [0.0, 0.0], eps=0.2)).round(6)
    array([0.990148, 0.990148])
    """
    checked = problem("multipliers", system, x, eps, method=method, name="x")
    with np.errstate(all="ignore"):
        slopes = _slopes_at_fixed_points(checked)
        known = np.asarray(np.isfinite(slopes).all(axis=(-2, -1)))[..., np.newaxis]
        slopes = np.where(known[..., np.newaxis], slopes, 0.0)
        Y = np.asarray(checked.eps)[..., np.newaxis] * checked.map.eigenvalues(checked, slopes)
        values = checked.map.stages.multiply(0.5 * Y)
        values = np.where(np.broadcast_to(known, (*checked.batch, 1)), values, np.nan)
        order = np.lexsort((-values.imag, -abs(values)), axis=-1)
    return np.take_along_axis(values, order, axis=-1)


def _slopes_at_fixed_points(checked: Problem) -> FloatArray:
    """Return f' (..., D, D); raise ValueError where f is not 0 to rounding."""
    x, terms = checked.omega, Terms(*checked.body._terms)
    (i, j, k), values = terms
    y = np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)
    products = values * y[..., j] * y[..., k]
    # f, and the sum of the moduli of its terms.
    f, sizes = (sums_at(i, each, x.shape[-1]) for each in (products, abs(products)))
    derivative = slopes_at(terms, x)
    moves = ~((abs(f) <= _FIXED * sizes) & (sizes < np.inf)) & ~np.isnan(x)
    if moves.any():
        moves &= ~_is_near_fixed_point(f, sizes, derivative, x)[..., np.newaxis]
    if moves.any():
        moves = np.broadcast_to(moves.any(axis=-1), checked.batch)
        text = f"{checked.name} is not a fixed point"
        if checked.batch:
            where = spell(first_index(moves))
            text = f"{checked.name}: states that are not fixed points, first: {where}"
        raise ValueError(
            f"{text}: use jacobian for the derivative there; "
            "for a periodic orbit see periodic_orbit"
        )
    return derivative


def _is_near_fixed_point(f: Any, sizes: Any, slopes: Any, x: Any) -> Any:
    """Return (...) whether f' d = f has a small solution d: what a solver of f = 0 returns."""
    known = np.isfinite(slopes).all(axis=(-2, -1)) & np.isfinite(f).all(axis=-1)
    slopes, f = np.where(known[..., np.newaxis, np.newaxis], slopes, 0.0), f[..., np.newaxis]
    f = np.where(known[..., np.newaxis, np.newaxis], f, 0.0)
    d = np.linalg.pinv(slopes, rcond=1e-13) @ f
    residual, x = abs(slopes @ d - f)[..., 0], np.broadcast_to(x, sizes.shape)
    is_small = abs(d[..., 0]).max(axis=-1) <= _FIXED * abs(x).max(axis=-1)
    return known & is_small & (residual <= _FIXED * sizes).all(axis=-1)
