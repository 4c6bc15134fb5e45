"""Derivative of the map, and multipliers of its steady states."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.nd import SuslovND
from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .._docs import filled
from .._engine.arguments import Body, check
from .table import find


@filled
def jacobian(body: Any, omega: ArrayLike, eps: ArrayLike, threads: int | None = None) -> FloatArray:
    """Derivative of the map: the Jacobian matrix of the next state with respect to the state.

    Parameters
    ----------
    %(any_body)s
    %(omega)s
    %(eps)s
    %(threads)s

    Returns
    -------
    ndarray(float, shape=(..., D, D))
        Dimensionless; row i, column j holds the derivative of the next Omega_i by Omega_j. NaN,
        with one :class:`SingularStepWarning`, where a state has no next state.

    Raises
    ------
    %(invalid)s

    Notes
    -----
    In three dimensions equation (8) of the paper is solved for the next state and differentiated;
    the result is as accurate as that of :func:`step`, next to poles too. In n dimensions LAPACK
    computes A(omega; eps)**-1 A(omega_next; -eps), with the A of :func:`matrix`.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, jacobian
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> jacobian(body, [1.0, 0.5], eps=0.2).round(6)
    array([[ 1.006511,  0.037232],
           [-0.221645,  0.937189]])
    """
    return find("jacobian", body, omega, eps, threads)


@filled
def matrix(body: Any, omega: ArrayLike, eps: ArrayLike, threads: int | None = None) -> FloatArray:
    """Matrix A that the paper inverts: A(omega; eps) next_omega = omega.

    Parameters
    ----------
    %(body)s
    %(omega)s
    %(eps)s
    %(threads)s

    Returns
    -------
    ndarray(float, shape=(..., D, D))
        A, dimensionless.

    Raises
    ------
    %(invalid)s

    Notes
    -----
    The matrix that the paper inverts before equation (5), and in equation (16): the identity minus
    eps / 2 times the derivative of the vector field. :func:`iterate` uses it only with the method
    "gauss".

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
    return find("matrix", body, omega, eps, threads)


@filled
def multipliers(body: Body, c: ArrayLike, eps: ArrayLike) -> FloatArray:
    """Eigenvalues of the derivative of the map at the steady state c (I23, -I13), or c I.

    Parameters
    ----------
    %(body)s
    c : array_like(float, shape=(...))
        Position on the line of steady states, in the unit of omega over that of inertia.
    %(eps)s

    Returns
    -------
    ndarray(float, shape=(..., D))
        Dimensionless. The first is 1, for the direction along the line; the others multiply the
        distance from it. Their magnitude is above 1 where the line repels, below 1 where it
        attracts, and infinite at a pole.

    Raises
    ------
    %(invalid)s

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
    (where, step_size), batch = check(body, {}, {"c": c, "eps": eps})
    spectrum, exponent = _spectrum_nd(body) if isinstance(body, SuslovND) else _spectrum_3d(body)
    fraction, power = np.frexp(np.multiply(*map(_mantissa, (where, step_size))))
    power = power + _exponent(where) + _exponent(step_size) + exponent
    with np.errstate(all="ignore"):
        Y = np.ldexp(0.5 * fraction[..., np.newaxis] * spectrum, power[..., np.newaxis])
        result: FloatArray = np.where(
            abs(Y) < 1.0, (1.0 + Y) / (1.0 - Y), (1.0 / Y + 1.0) / (1.0 / Y - 1.0)
        )
    full = np.ones((*batch, body.dimension))
    full[..., 1:] = result
    return full


def _mantissa(values: FloatArray) -> FloatArray:
    return np.frexp(values)[0]


def _exponent(values: FloatArray) -> FloatArray:
    return np.frexp(values)[1]


def _spectrum_3d(body: Suslov3D) -> tuple[FloatArray, FloatArray]:
    """I13**2 / I1 + I23**2 / I2, as numbers (..., 1) and powers of two."""
    I1, I2, I13, I23 = map(np.asarray, body.parameters)
    first, k = _mantissa(I13) ** 2 / _mantissa(I1), 2 * _exponent(I13) - _exponent(I1)
    second, l = _mantissa(I23) ** 2 / _mantissa(I2), 2 * _exponent(I23) - _exponent(I2)
    # The larger of the two powers; that of a 0 does not count.
    power = np.maximum(np.where(first > 0, k, l), np.where(second > 0, l, k))
    total = np.ldexp(first, k - power) + np.ldexp(second, l - power)
    return np.asarray(total)[..., np.newaxis], power


def _spectrum_nd(body: SuslovND) -> tuple[FloatArray, FloatArray]:
    """The spectrum of J**-1 (|I|**2 Id - I I^T) without the 0 of I, likewise, ascending."""
    moments = _exponent(body.J.max(axis=-1))
    products = _exponent(abs(body.I).max(axis=-1))
    # A moment this much smaller than others leaves the range of float64 in what follows.
    J = np.maximum(np.ldexp(body.J, -moments[..., np.newaxis]), 2.0**-900)
    I = np.ldexp(body.I, -products[..., np.newaxis])
    square = (I * I).sum(axis=-1, keepdims=True)
    # J**-1/2 (|I|**2 Id - I I^T) J**-1/2 is symmetric and takes sqrt(J) I to 0. A reflection of an
    # axis into that direction takes the other axes to a basis of the rest.
    root = np.sqrt(J)
    null, across = np.broadcast_arrays(root * I, I / root)
    basis = _complement(null)
    inverse = np.broadcast_to(square / J, null.shape)[..., np.newaxis]
    projected = across[..., np.newaxis, :] @ basis
    symmetric = basis.swapaxes(-2, -1) @ (inverse * basis) - projected.swapaxes(-2, -1) * projected
    spectrum = np.linalg.eigvalsh(symmetric)
    # Each lies between two of the |I|**2 / J_i.
    bounds = np.sort(inverse[..., 0], axis=-1)
    return np.clip(spectrum, bounds[..., :-1], bounds[..., 1:]), 2 * products - moments


def _complement(vectors: FloatArray) -> FloatArray:
    """Orthonormal bases (..., m, m - 1) of what is orthogonal to vectors (..., m), 0 included."""
    m = vectors.shape[-1]
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    unit = np.where(size > 0, vectors / np.where(size > 0, size, 1.0), np.eye(m)[0])
    # Householder's reflection, of the first axis into plus or minus the unit vector.
    normal = unit.copy()
    normal[..., 0] += np.copysign(1.0, unit[..., 0])
    square = (normal * normal).sum(axis=-1)[..., np.newaxis, np.newaxis]
    reflection: FloatArray = (
        np.eye(m) - 2.0 / square * normal[..., :, np.newaxis] * normal[..., np.newaxis, :]
    )
    return reflection[..., 1:]
