"""Derivatives with respect to time, with the reaction, and those of the map by its state."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.field import QuadraticField
from ..bodies.nd import SuslovND
from ..bodies.rigid import SuslovGyrostat
from ..checks import FloatArray, first_index, spell
from ..core import quantities as formulas
from ..core import quantities_field as fields
from ..engine.arguments import AnyBody, BodyOrField, States, check
from ..maps import states_after
from .evaluation import by_terms, evaluate

# A state is fixed if no component of the field is above this part of the sum of its terms.
_FIXED = 1e-8


def vector_field(body: BodyOrField, omega: ArrayLike) -> FloatArray:
    """Time derivative of omega in the continuous motion, or of the state x of a field.

    Parameters
    ----------
    body : Suslov3D, SuslovND, SuslovGyrostat or QuadraticField
        A single one, or a batch.
    omega : array_like(float, shape=(..., D))
        States.

    Returns
    -------
    ndarray(float, shape=(..., D))
        In the unit of omega squared; of a field, in that of x over time.

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
    in_3d, in_nd = formulas.vector_field, formulas.vector_field_nd
    of_field = partial(by_terms, fields.vector_field)
    return evaluate(body, {"omega": omega}, in_3d, in_nd, of_field, axes=1)


def reaction(body: AnyBody, omega: ArrayLike, eps: ArrayLike | None = None) -> FloatArray:
    """Lagrange multiplier of the constraint: the torque that keeps Omega3 at 0.

    Parameters
    ----------
    body : Suslov3D, SuslovND or SuslovGyrostat
        A single one, or a batch.
    omega : array_like(float, shape=(..., D))
        States.
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
    In three dimensions lambda follows from the third equation of (2), which is discretized as
    (x_next - x) / eps = lambda + (I1 - I2) (Omega1 Omega2_next + Omega1_next Omega2) / 2.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, reaction
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> float(reaction(body, [1.0, 0.5]).round(6))
    -1.345625
    >>> float(reaction(body, [1.0, 0.5], eps=0.01).round(6))
    -1.336328
    """
    arguments = {"omega": omega} if eps is None else {"omega": omega, "eps": eps}
    axes = 2 * isinstance(body, SuslovND)
    return evaluate(body, arguments, formulas.reaction, _reaction_nd, axes=axes)


def _reaction_nd(states: States) -> FloatArray:
    body, omega, eps, *_ = states
    after = states_after(states) if np.any(eps) else omega
    found: FloatArray = formulas.reaction_nd(body.J, body.I, omega, after)
    return found


def matrix(body: BodyOrField, omega: ArrayLike, eps: ArrayLike) -> FloatArray:
    """Matrix A that the paper inverts: A(omega; eps) next_omega = omega.

    It is 1 - (eps / 2) f'(omega), where f is the vector field. For every body and field,
    A(omega; eps) (next_omega - omega) = eps f(omega).

    Parameters
    ----------
    body : Suslov3D, SuslovND, SuslovGyrostat or QuadraticField
        A single one, or a batch.
    omega : array_like(float, shape=(..., D))
        States.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.

    Returns
    -------
    ndarray(float, shape=(..., D, D))
        A, dimensionless.

    Notes
    -----
    The paper inverts it before equation (5), and in (16).

    Examples
    --------
    >>> from suslov_fast import Suslov3D, matrix, step
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> (matrix(body, [1.0, 0.5], eps=0.2) @ step(body, [1.0, 0.5], eps=0.2)).round(6)
    array([1. , 0.5])
    """
    given, in_terms = {"omega": omega, "eps": eps}, partial(by_terms, fields.matrix)
    return evaluate(body, given, formulas.matrix, in_terms, in_terms, axes=2)


def jacobian(body: BodyOrField, omega: ArrayLike, eps: ArrayLike) -> FloatArray:
    """Derivative of the map: the Jacobian matrix of the next state with respect to the state.

    Parameters
    ----------
    body : Suslov3D, SuslovND, SuslovGyrostat or QuadraticField
        A single one, or a batch.
    omega : array_like(float, shape=(..., D))
        States.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.

    Returns
    -------
    ndarray(float, shape=(..., D, D))
        Dimensionless; row i, column j holds the derivative of the next Omega_i by Omega_j. NaN,
        with one :class:`SingularStepWarning`, where a state has no next state.

    Notes
    -----
    With the A of :func:`matrix` it is A(omega; eps)**-1 A(omega_next; -eps).

    Examples
    --------
    >>> from suslov_fast import Suslov3D, jacobian
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> jacobian(body, [1.0, 0.5], eps=0.2).round(6)
    array([[ 1.006511,  0.037232],
           [-0.221645,  0.937189]])
    """
    given, in_terms = {"omega": omega, "eps": eps}, partial(by_terms, fields.jacobian)
    return evaluate(body, given, formulas.jacobian, in_terms, in_terms, axes=2)


def multipliers(body: BodyOrField, x: ArrayLike, eps: ArrayLike) -> NDArray[Any]:
    """Eigenvalues of the derivative of the map at a fixed point.

    Parameters
    ----------
    body : Suslov3D, SuslovND, SuslovGyrostat or QuadraticField
        A single one, or a batch.
    x : array_like(float, shape=(..., D))
        Fixed points of the map: steady states of a body, zeros of a field.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of x.

    Returns
    -------
    ndarray(float or complex, shape=(..., D))
        Dimensionless, in descending order of their moduli, of a conjugate pair the one with the
        positive imaginary part first; floats for a Suslov body, complex for a gyrostat or a field.
        That along a line of steady states of a body is 1. Infinite at a pole; NaN for states that
        are NaN.

    Raises
    ------
    ValueError
        If a component of the vector field at a state is above 1e-8 of the sum of the moduli of its
        terms. :func:`jacobian` is the derivative at any state.

    Notes
    -----
    An eigenvalue mu of f' gives the multiplier (1 + eps mu / 2) / (1 - eps mu / 2). In n dimensions
    mu = c s at omega = c I, for s in the spectrum of ``J**-1 (|I|**2 Id - I I^T)``.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, multipliers
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> multipliers(body, [[0.6, -1.0], [-0.6, 1.0]], eps=0.2).round(6)
    array([[1.      , 0.940805],
           [1.062919, 1.      ]])
    """
    states = check(body, BodyOrField, {"x": x, "eps": eps})
    half_step = 0.5 * np.asarray(states.eps)[..., np.newaxis]
    with np.errstate(all="ignore"):
        slopes = _slopes_at_fixed_points(states)
        is_field = isinstance(body, QuadraticField)
        Y = half_step * (_eigenvalues(slopes) if is_field else _rates_of_body(states, slopes))
        found = np.where(Y == 1.0, np.inf, (1.0 + Y) / (1.0 - Y))
        found = np.broadcast_to(found, (*states.batch, body.dimension))
        order = np.lexsort((-found.imag, -abs(found)), axis=-1)
    unknown = np.isnan(states.omega).any(axis=-1, keepdims=True)
    return np.where(unknown, np.nan, np.take_along_axis(found, order, axis=-1))


def _slopes_at_fixed_points(states: States) -> FloatArray:
    """Return f' (..., D, D), or raise ValueError if f is not 0 to rounding.

    With y = (x, 1) and the symmetric table of coefficients, f_i = table_ijk y_j y_k.
    """
    table, x = states.body.field().table.astype(np.float64), states.omega
    y = np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)[..., np.newaxis, :, np.newaxis]
    half_slopes = (table @ y)[..., 0]
    f, terms = half_slopes @ y[..., 0, :, :], (abs(table) @ abs(y))[..., 0] @ abs(y[..., 0, :, :])
    unknown = np.isnan(x).any(axis=-1)
    moves = (~(abs(f) <= _FIXED * terms)).any(axis=(-2, -1)) & ~unknown
    moves = np.broadcast_to(moves, states.batch)
    if moves.any():
        where = f", first: {spell(first_index(moves))}" if states.batch else ""
        raise ValueError(
            f"{states.name}: expected fixed points of the map, got {np.count_nonzero(moves)} other "
            f"states{where}: use jacobian for the derivative at these"
        )
    return np.asarray(2.0 * half_slopes[..., :-1])


def _eigenvalues(matrices: FloatArray) -> NDArray[Any]:
    """Return eigenvalues, complex; NaN for matrices that are not finite."""
    known = np.asarray(np.isfinite(matrices).all(axis=(-2, -1)))[..., np.newaxis]
    found = np.linalg.eigvals(np.where(known[..., np.newaxis], matrices, 0.0))
    return np.where(known, found.astype(complex), np.nan)


def _rates_of_body(states: States, slopes: FloatArray) -> NDArray[Any]:
    """Return the eigenvalues of f' at steady states of a body, (..., m), of which one is 0."""
    body, x = states.body, states.omega
    if isinstance(body, SuslovND) and body.dimension != 2:
        along = (body.I * body.I).sum(axis=-1, keepdims=True)
        c = (body.I * x).sum(axis=-1, keepdims=True) / along
        across = np.where(along > 0.0, c * _spectrum(body.J, body.I), 0.0)
        return np.concatenate([across, np.zeros((*across.shape[:-1], 1))], axis=-1)
    trace = np.trace(slopes, axis1=-2, axis2=-1)
    rates = np.stack([trace, 0.0 * trace], axis=-1)
    if not isinstance(body, SuslovGyrostat):
        return rates
    speed = np.asarray(body.k / np.sqrt(body.I1 * body.I2))[..., np.newaxis]
    pair = 1j * speed * np.array([1.0, -1.0])  # at rest, where f' turns
    return np.where((x == 0.0).all(axis=-1, keepdims=True) & (speed != 0.0), pair, rates)


def _spectrum(J: FloatArray, I: FloatArray) -> FloatArray:
    """Return the spectrum of J**-1 (|I|**2 Id - I I^T) without the 0 of I, each to rounding.

    The sum of I_i**2 / (pole_i - s), with pole_i = |I|**2 / J_i, is 0 for one s between two poles.
    """
    square = I * I
    poles = square.sum(axis=-1, keepdims=True) / J
    bounds = np.sort(poles, axis=-1)
    low, high = bounds[..., :-1], bounds[..., 1:]
    square, poles = square[..., np.newaxis, :], poles[..., np.newaxis, :]
    for _ in range(80):
        middle = np.where(high > 4.0 * low, np.sqrt(low) * np.sqrt(high), 0.5 * (low + high))
        above = (square / (poles - middle[..., np.newaxis])).sum(axis=-1) < 0.0
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return high
