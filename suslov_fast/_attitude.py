"""The orientation of the body in space."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ._bodies.nd import SuslovND
from ._bodies.three import Suslov3D
from ._checks import FloatArray, common_shape, instance, real_array, vectors
from ._core.cpu import attitude as loops
from ._engine import threads
from ._engine.arguments import Body
from ._engine.layout import flat_parameter

# Work of one turn, in steps of the map.
_WORK = 100


def attitude(
    body: Body, omega: ArrayLike, eps: ArrayLike, R0: ArrayLike | None = None
) -> FloatArray:
    """The orientation of the body along stored trajectories.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega : array_like(float, shape=(..., N + 1, D))
        Trajectories, as `iterate` stores them; NaN after a failure.
    eps : array_like(float, shape=(...))
        Time between two states: the step size, times `save_every`.
    R0 : array_like(float, shape=(..., n, n)), optional
        Orientation at the first state, a rotation matrix; by default the identity.

    Returns
    -------
    ndarray(float, shape=(..., N + 1, n, n))
        Matrices R that take components in the body to components in space, orthogonal to
        rounding however long the trajectory; NaN where omega is. In three dimensions
        ``scipy.spatial.transform.Rotation.from_matrix(R.reshape(-1, 3, 3))`` turns them into
        SciPy's rotations.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.

    Notes
    -----
    R_next = R cay(eps (Omega + Omega_next) / 2), the Cayley map: the discrete counterpart of
    R' = R Omega, of order 2. In three dimensions it is computed with unit quaternions.

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import Suslov3D, attitude, iterate
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> R = attitude(body, iterate(body, [1.0, 0.5], eps=0.2, steps=100).omega, eps=0.2)
    >>> R.shape
    (101, 3, 3)
    >>> bool(abs(R @ R.swapaxes(-2, -1) - np.eye(3)).max() < 2e-15)
    True
    """
    instance("body", body, (Suslov3D, SuslovND))
    m = body.dimension
    states = vectors("omega", omega, m, allow_nan=True)
    if states.ndim < 2 or states.shape[-2] == 0:
        raise ValueError(f"omega: expected shape (..., N + 1, {m}), got {states.shape}")
    interval = real_array("eps", eps)
    start = None if R0 is None else _rotations("R0", R0, m + 1)
    batch = common_shape(
        body=body.shape,
        omega=states.shape[:-2],
        eps=interval.shape,
        R0=() if start is None else start.shape[:-2],
    )
    length = states.shape[-2]
    size = math.prod(batch)
    flat = np.broadcast_to(states, (*batch, length, m)).reshape(size, length, m)
    flat = np.require(flat, np.float64, ["C", "A", "W"])
    turns = np.empty((size, length, m + 1, m + 1))
    threads.run(
        loops.reconstruct if isinstance(body, Suslov3D) else loops.reconstruct_nd,
        size * length * _WORK * m if size > 1 else 0,
        None,
        flat,
        flat_parameter(interval, batch),
        turns,
    )
    turns = turns.reshape((*batch, length, m + 1, m + 1))
    return turns if start is None else start[..., np.newaxis, :, :] @ turns


def _rotations(name: str, value: ArrayLike, n: int) -> FloatArray:
    matrices = vectors(name, value, n)
    if matrices.ndim < 2 or matrices.shape[-2] != n:
        raise ValueError(f"{name}: expected shape (..., {n}, {n}), got {matrices.shape}")
    error = abs(matrices @ matrices.swapaxes(-2, -1) - np.eye(n)).max(initial=0.0)
    if error > 1e-10 or not (np.linalg.det(matrices) > 0).all():
        raise ValueError(
            f"{name}: expected rotation matrices, got |R R.T - 1| = {error:.2g} and determinant "
            f"{np.linalg.det(matrices).min(initial=np.inf):.2g}"
        )
    return matrices
