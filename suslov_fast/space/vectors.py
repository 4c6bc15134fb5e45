"""Angular velocity and momentum as vectors and matrices: in the adapted basis, in that of the
inertia tensor, and in space.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.nd import SuslovND
from ..checks import FloatArray, common_shape, square_matrices, wrong
from ..engine.arguments import AnyBody, BodyIn3D, check


def to_matrix(
    body: AnyBody,
    omega: ArrayLike,
    *,
    rotation: ArrayLike | None = None,
    attitude: ArrayLike | None = None,
) -> FloatArray:
    """Antisymmetric matrix Omega of an angular velocity: R' = R Omega.

    Parameters
    ----------
    body : Suslov3D, SuslovND or SuslovGyrostat
        A single one, or a batch.
    omega : array_like(float, shape=(..., D))
        States.
    rotation : array_like(float, shape=(..., n, n)), optional
        What `from_inertia` or `from_mass_tensor` returned: the result is in the basis of their
        tensor, not in the adapted basis.
    attitude : array_like(float, shape=(..., n, n)), optional
        Orientations of the body: the result is in space.

    Returns
    -------
    ndarray(float, shape=(..., n, n))
        In three dimensions, the matrix whose product with a vector v is the vector product of
        (Omega1, Omega2, 0) and v. In n dimensions, its last column holds Omega_in.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, to_matrix
    >>> to_matrix(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [2.0, 5.0])
    array([[ 0.,  0.,  5.],
           [ 0.,  0., -2.],
           [-5.,  2.,  0.]])
    """
    column = _states(body, AnyBody, omega)
    if isinstance(body, BodyIn3D):
        column = column[..., ::-1] * [1.0, -1.0]
    block = 0.0 * column[..., np.newaxis, :1]
    return _shown(body, _antisymmetric(column, block), 2, rotation, attitude)


def to_vector(
    body: BodyIn3D,
    omega: ArrayLike,
    *,
    rotation: ArrayLike | None = None,
    attitude: ArrayLike | None = None,
) -> FloatArray:
    """Angular velocity as a vector, in three dimensions.

    Parameters
    ----------
    body : Suslov3D or SuslovGyrostat
        A single one, or a batch.
    omega : array_like(float, shape=(..., 2))
        States.
    rotation : array_like(float, shape=(..., 3, 3)), optional
        What `from_inertia` returned: the result is in the basis of its tensor.
    attitude : array_like(float, shape=(..., 3, 3)), optional
        Orientations of the body: the result is in space.

    Returns
    -------
    ndarray(float, shape=(..., 3))
        (Omega1, Omega2, 0), or its components in the other basis.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, to_vector
    >>> to_vector(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [2.0, 5.0])
    array([2., 5., 0.])
    """
    if isinstance(body, SuslovND):
        raise wrong("body", "one in three dimensions", "SuslovND: use to_matrix", TypeError)
    state = _states(body, BodyIn3D, omega)
    vector = np.concatenate([state, abs(0.0 * state[..., :1])], axis=-1)
    return _shown(body, vector, 1, rotation, attitude)


def momentum(
    body: AnyBody,
    omega: ArrayLike,
    *,
    rotation: ArrayLike | None = None,
    attitude: ArrayLike | None = None,
) -> FloatArray:
    """Angular momentum M = I Omega, or M = I Omega + Omega I in n dimensions.

    With a rotor it is I Omega + k e3.

    Parameters
    ----------
    body : Suslov3D, SuslovND or SuslovGyrostat
        A single one, or a batch.
    omega : array_like(float, shape=(..., D))
        States.
    rotation : array_like(float, shape=(..., n, n)), optional
        What `from_inertia` or `from_mass_tensor` returned: the result is in the basis of their
        tensor, not in the adapted basis.
    attitude : array_like(float, shape=(..., n, n)), optional
        Orientations of the body: the result is in space.

    Returns
    -------
    ndarray(float, shape=(..., 3) or (..., n, n))
        A vector in three dimensions, an antisymmetric matrix in n; in the unit of inertia times
        that of omega.

    Notes
    -----
    I3 does not enter because Omega3 = 0. In space M is not conserved: in three dimensions its
    derivative is the :func:`reaction` times the constrained axis.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, momentum
    >>> momentum(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [2.0, 5.0])
    array([ 8. ,  5. , -2.5])
    """
    state = _states(body, AnyBody, omega)
    with np.errstate(all="ignore"):
        if isinstance(body, BodyIn3D):
            I1, I2, I13, I23, k = body.parameters
            w1, w2 = state[..., 0], state[..., 1]
            vector = np.stack(np.broadcast_arrays(I1 * w1, I2 * w2, I13 * w1 + I23 * w2 + k), -1)
            return _shown(body, vector, 1, rotation, attitude)
        product = state[..., :, np.newaxis] * body.I[..., np.newaxis, :]
        matrix = _antisymmetric(body.J * state, product - product.swapaxes(-2, -1))
        return _shown(body, matrix, 2, rotation, attitude)


def _states(body: Any, kinds: Any, omega: ArrayLike) -> FloatArray:
    """Return states (..., D) of the whole batch."""
    states = check(body, kinds, {"omega": omega})
    return np.broadcast_to(states.omega, (*states.batch, body.dimension))


def _antisymmetric(column: FloatArray, block: FloatArray) -> FloatArray:
    """Return antisymmetric matrices from their last column and the remaining block."""
    n = column.shape[-1] + 1
    matrix = np.empty((*column.shape[:-1], n, n))
    matrix[..., :-1, :-1], matrix[..., -1, -1] = block, 0.0 * column[..., 0]
    matrix[..., :-1, -1], matrix[..., -1, :-1] = column, -column
    return matrix + 0.0  # no -0.0


def _shown(
    body: Any, found: FloatArray, axes: int, rotation: ArrayLike | None, attitude: ArrayLike | None
) -> FloatArray:
    """Return vectors, or matrices for two axes, of the adapted basis in the requested one."""
    n = body.dimension + 1
    if rotation is not None and attitude is not None:
        raise wrong("rotation, attitude", "at most one of them", "both")
    if rotation is not None:
        turn = square_matrices("rotation", rotation, n).swapaxes(-2, -1)
    elif attitude is not None:
        turn = square_matrices("attitude", attitude, n, allow_nan=True)
    else:
        return found
    common_shape({"omega": found.shape[:-axes], "matrices": turn.shape[:-2]})
    if axes == 1:
        return np.asarray((turn @ found[..., np.newaxis])[..., 0])
    return np.asarray(turn @ found @ turn.swapaxes(-2, -1))
