"""States as elements of so(n): in the adapted basis, that of the inertia tensor, and in space."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.body_3d import SuslovGyrostat
from .._bodies.body_nd import SuslovND
from .._checks import FloatArray, aligned, common_shape, instance, square_matrices, vectors, wrong
from .._docs import filled
from .._engine.arguments import AnyBody, BodyIn3D, check

# Relative tolerance of antisymmetry and of the constraint.
_ROUNDING = 1e-12


@filled
def to_matrix(
    body: AnyBody,
    omega: ArrayLike,
    *,
    rotation: ArrayLike | None = None,
    attitude: ArrayLike | None = None,
) -> FloatArray:
    """Antisymmetric matrix Omega of an angular velocity: R' = R Omega.

    %(Parameters: rigid_body, omega, rotation, attitude)s

    Returns
    -------
    ndarray(float, shape=(..., n, n))
        In three dimensions, the matrix whose product with a vector v is the vector product of
        (Omega1, Omega2, 0) and v. In n dimensions, its last column holds Omega_in.

    %(Raises: invalid)s

    Examples
    --------
    >>> from suslov_fast import Suslov3D, SuslovND, to_matrix
    >>> to_matrix(SuslovND(J=[1.3, 2.1], I=[0.4, -0.7]), [2.0, 5.0])
    array([[ 0.,  0.,  2.],
           [ 0.,  0.,  5.],
           [-2., -5.,  0.]])
    >>> to_matrix(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [2.0, 5.0])
    array([[ 0.,  0.,  5.],
           [ 0.,  0., -2.],
           [-5.,  2.,  0.]])
    """
    column, turn = _states_and_turn(body, AnyBody, omega, rotation, attitude)
    if isinstance(body, BodyIn3D):
        column = np.stack([column[..., 1], -column[..., 0]], axis=-1)
    return _turned(_antisymmetric(column, _zero(column)[..., np.newaxis]), turn)


@filled
def from_matrix(
    body: AnyBody, matrix: ArrayLike, *, rotation: ArrayLike | None = None
) -> FloatArray:
    """Angular velocities from antisymmetric matrices, the inverse of :func:`to_matrix`.

    Parameters
    ----------
    %(rigid_body)s
    matrix : array_like(float, shape=(..., n, n))
        Antisymmetric matrices that obey the constraint, Omega_ij = 0 for i, j < n in the adapted
        basis, to 1e-12 of the largest component. Where one is NaN, so is the result.
    %(rotation)s

    Returns
    -------
    ndarray(float, shape=(..., D))
        Components in the adapted basis, as all functions take them.

    %(Raises: invalid)s

    Examples
    --------
    >>> from suslov_fast import Suslov3D, from_matrix, to_matrix
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> from_matrix(body, to_matrix(body, [2.0, 5.0]))
    array([2., 5.])
    """
    instance("body", body, AnyBody)
    n = body.dimension + 1
    matrix, rotation = aligned({"matrix": matrix, "rotation": rotation}).values()
    matrices = square_matrices("matrix", matrix, n, allow_nan=True)
    turn = None if rotation is None else square_matrices("rotation", rotation, n)
    size = abs(matrices).max(axis=(-2, -1), initial=0.0, keepdims=True)
    excess = abs(0.5 * matrices + 0.5 * matrices.swapaxes(-2, -1))
    if (excess > _ROUNDING * size).any():
        received = f"|A + A.T| / 2 = {np.nanmax(excess):.2g}"
        raise wrong("matrix", "antisymmetric matrices", received)
    adapted = _turned(matrices, turn)
    forbidden = abs(adapted[..., :-1, :-1])
    if (forbidden > _ROUNDING * n * size).any():
        expected = "matrices that obey the constraint Omega_ij = 0 for i, j < n"
        raise wrong("matrix", expected, f"{np.nanmax(forbidden):.2g}")
    column = adapted[..., :-1, -1]
    if isinstance(body, BodyIn3D):
        column = np.stack([-column[..., 1], column[..., 0]], axis=-1)
    batch = common_shape({"body": body.shape, "matrix": column.shape[:-1]})
    return np.broadcast_to(column + 0.0, (*batch, n - 1)).copy()


@filled
def to_vector(
    body: BodyIn3D,
    omega: ArrayLike,
    *,
    rotation: ArrayLike | None = None,
    attitude: ArrayLike | None = None,
) -> FloatArray:
    """Angular velocity as a vector, in three dimensions.

    %(Parameters: body_in_3d, omega, rotation, attitude)s

    Returns
    -------
    ndarray(float, shape=(..., 3))
        (Omega1, Omega2, 0), or its components in the other basis.

    %(Raises: invalid)s

    Examples
    --------
    >>> from suslov_fast import Suslov3D, to_vector
    >>> to_vector(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [2.0, 5.0])
    array([2., 5., 0.])
    """
    _require_3d(body, "to_matrix")
    state, turn = _states_and_turn(body, BodyIn3D, omega, rotation, attitude)
    return _turned_vector(np.concatenate([state, _zero(state)], axis=-1), turn)


@filled
def from_vector(
    body: BodyIn3D, vector: ArrayLike, *, rotation: ArrayLike | None = None
) -> FloatArray:
    """Angular velocities from vectors, the inverse of :func:`to_vector`.

    Parameters
    ----------
    %(body_in_3d)s
    vector : array_like(float, shape=(..., 3))
        Angular velocities normal to the constrained axis, to 1e-12 of the largest component. Where
        one is NaN, so is the result.
    %(rotation)s

    Returns
    -------
    ndarray(float, shape=(..., 2))
        (Omega1, Omega2) in the adapted basis, as all functions take them.

    %(Raises: invalid)s

    Examples
    --------
    >>> from suslov_fast import Suslov3D, from_vector
    >>> I = [[4, 0, -0.5], [0, 3, -0.3], [-0.5, -0.3, 3]]
    >>> body, rotation = Suslov3D.from_inertia(I, a=[0, 1, 0])
    >>> from_vector(body, [1.0, 0.0, 0.5], rotation=rotation).shape
    (2,)
    """
    _require_3d(body, "from_matrix")
    instance("body", body, BodyIn3D)
    vector, rotation = aligned({"vector": vector, "rotation": rotation}).values()
    array = vectors("vector", vector, 3, allow_nan=True)
    turn = None if rotation is None else square_matrices("rotation", rotation, 3)
    adapted = _turned_vector(array, turn)
    size = abs(array).max(axis=-1, initial=0.0)
    if (abs(adapted[..., 2]) > _ROUNDING * size).any():
        received = f"the component {np.nanmax(abs(adapted[..., 2])):.2g} along it"
        raise wrong("vector", "angular velocities normal to the axis of the body", received)
    batch = common_shape({"body": body.shape, "vector": adapted.shape[:-1]})
    unknown = np.isnan(adapted).any(axis=-1, keepdims=True)
    return np.broadcast_to(np.where(unknown, np.nan, adapted[..., :2]), (*batch, 2)).copy()


@filled
def momentum(
    body: AnyBody,
    omega: ArrayLike,
    *,
    rotation: ArrayLike | None = None,
    attitude: ArrayLike | None = None,
) -> FloatArray:
    """Angular momentum M = I Omega, or M = I Omega + Omega I in n dimensions.

    With a rotor it is I Omega + k e3.

    %(Parameters: rigid_body, omega, rotation, attitude)s

    Returns
    -------
    ndarray(float, shape=(..., 3) or (..., n, n))
        A vector in three dimensions, an antisymmetric matrix in n; in the unit of inertia times
        that of omega.

    %(Raises: invalid)s

    Notes
    -----
    I3 does not enter because Omega3 = 0. The :func:`energy` is half the scalar product of M and
    Omega, or -trace(M Omega) / 4 for matrices. In space M is not conserved: in three dimensions
    its derivative is the :func:`reaction` times the constrained axis.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, momentum
    >>> momentum(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [2.0, 5.0])
    array([ 8. ,  5. , -2.5])
    """
    state, turn = _states_and_turn(body, AnyBody, omega, rotation, attitude)
    with np.errstate(all="ignore"):
        if isinstance(body, BodyIn3D):
            w1, w2 = state[..., 0], state[..., 1]
            third = body.I13 * w1 + body.I23 * w2
            if isinstance(body, SuslovGyrostat):
                third = third + body.k
            components = body.I1 * w1, body.I2 * w2, third
            return _turned_vector(np.stack(np.broadcast_arrays(*components), axis=-1), turn)
        product = state[..., :, np.newaxis] * body.I[..., np.newaxis, :]
        matrix = _antisymmetric(body.J * state, product - product.swapaxes(-2, -1))
    return _turned(matrix, turn)


def _require_3d(body: object, instead: str) -> None:
    if isinstance(body, SuslovND):
        raise wrong("body", "one in three dimensions", f"SuslovND: use {instead}", TypeError)


def _states_and_turn(
    body: AnyBody, kinds: Any, omega: Any, rotation: Any, attitude: Any
) -> tuple[FloatArray, FloatArray | None]:
    """Return states (..., D) of the whole batch, and the matrices that convert components from the
    adapted basis to the requested one.
    """
    instance("body", body, kinds)
    if rotation is not None and attitude is not None:
        raise wrong("rotation, attitude", "at most one of them", "both")
    given = {"omega": omega, "rotation": rotation, "attitude": attitude}
    omega, rotation, attitude = aligned(given, body._labels).values()
    states, n, turn = check(body, kinds, {"omega": omega}), body.dimension + 1, None
    if rotation is not None:
        turn = square_matrices("rotation", rotation, n).swapaxes(-2, -1)
    elif attitude is not None:
        turn = square_matrices("attitude", attitude, n, allow_nan=True)
    omega = states.omega
    if omega.shape[:-1] != states.batch:
        omega = np.broadcast_to(omega, (*states.batch, n - 1))
    return omega, turn


def _antisymmetric(column: FloatArray, block: FloatArray) -> FloatArray:
    """Return antisymmetric matrices from their last column and the remaining block."""
    batch = np.broadcast_shapes(column.shape[:-1], block.shape[:-2])
    n = column.shape[-1] + 1
    matrix = np.empty((*batch, n, n))
    matrix[..., :-1, :-1], matrix[..., -1, -1] = block, _zero(block[..., 0])[..., 0]
    matrix[..., :-1, -1], matrix[..., -1, :-1] = column, -column
    return matrix


def _zero(state: FloatArray) -> FloatArray:
    """Return zeros (..., 1) for states (..., D), and NaN where these are NaN."""
    return 0.0 * state[..., :1] + 0.0  # not -0.0


def _product(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return a matrix product that is bit-identical on all machines, unlike that of a library."""
    common_shape({"matrices": left.shape[:-2], "omega": right.shape[:-2]})
    total: FloatArray = left[..., :, :1] * right[..., :1, :]
    for k in range(1, left.shape[-1]):
        total = total + left[..., :, k : k + 1] * right[..., k : k + 1, :]
    return total


def _turned(matrix: FloatArray, turn: FloatArray | None) -> FloatArray:
    return matrix if turn is None else _product(_product(turn, matrix), turn.swapaxes(-2, -1))


def _turned_vector(vector: FloatArray, turn: FloatArray | None) -> FloatArray:
    return vector if turn is None else _product(turn, vector[..., np.newaxis])[..., 0]
