"""Orientation of the body in space."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.body_nd import SuslovND
from .._bodies.rigid import in_units
from .._checks import (
    FloatArray,
    aligned,
    common_shape,
    first_index,
    instance,
    real_array,
    rotations,
    spell,
    vectors,
    wrong,
)
from .._docs import filled
from .._engine import threads as _threads
from .._engine.arguments import AnyBody, thread_count
from .._engine.evaluation import TASKS
from .._engine.layout import flat_parameter, for_kernel
from .._kernels import orientations as kernels
from .._kernels.consecutive import follow
from .._kernels.lanes import LANES

# Costs of an element of the result, and of checking an element of the states, in steps of the map.
_TURNING, _CHECKING = 10, 10


@filled
def attitude(
    body: AnyBody,
    omega: ArrayLike,
    eps: ArrayLike,
    R0: ArrayLike | None = None,
    *,
    threads: int | None = None,
) -> FloatArray:
    """Orientation of the body along stored trajectories, eps being their step size.

    Parameters
    ----------
    %(rigid_body)s
    omega : array_like(float, shape=(N + 1, ..., D))
        Consecutive states of trajectories, as :func:`iterate` returns them, including NaN after a
        failure. States that do not follow each other, as every k-th state, are an error.
    %(eps)s
    R0 : array_like(float, shape=(..., n, n)), optional
        Rotation matrix, the orientation at the first state; by default the identity.
    %(threads)s

    Returns
    -------
    ndarray(float, shape=(N + 1, ..., n, n))
        Matrices R that take components in the body frame to components in space, orthogonal to
        rounding; NaN from the first NaN state on. In three dimensions
        ``scipy.spatial.transform.Rotation.from_matrix(R.reshape(-1, 3, 3))`` converts them.

    %(Raises: invalid)s

    Notes
    -----
    R_next = R cay(eps (Omega + Omega_next) / 2) with the Cayley map, a discretization of order 2 of
    R' = R Omega. In three dimensions it is computed with unit quaternions.

    Two states are consecutive if they satisfy the implicit equations (4), in n dimensions (15), to
    one part in 1e6 of the step between them. All are accepted where that cannot be tested: if the
    step is below one part in 1e10 of the state, and in three dimensions next to a pole.

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
    instance("body", body, AnyBody)
    m = body.dimension
    labels = body._labels
    omega, eps, R0 = aligned({"omega": omega, "eps": eps, "R0": R0}, labels).values()
    states = vectors("omega", omega, m, allow_nan=True, labels=labels)
    if states.ndim < 2 or len(states) == 0:
        raise wrong("omega", f"shape (N + 1, ..., {m})", states.shape)
    step_size = real_array("eps", eps)
    start = np.eye(m + 1) if R0 is None else rotations("R0", R0, m + 1)
    threads = thread_count(threads)
    shapes = {"omega": states.shape[1:-1], "eps": step_size.shape, "R0": start.shape[:-2]}
    batch = common_shape({"body": body.shape, **shapes})
    rows, size, n = len(states), math.prod(batch), m + 1
    states = np.expand_dims(states, tuple(range(1, len(batch) + 3 - states.ndim)))
    flat = for_kernel(np.broadcast_to(states, (rows, *batch, m)).reshape(rows, size, m))
    _check_that_states_follow(body, flat, step_size, batch, threads)
    turns = np.empty((rows, size, n, n))
    turns[0] = np.broadcast_to(start, (*batch, n, n)).reshape(turns.shape[1:])
    turns[0, np.isnan(flat[0]).any(axis=-1)] = np.nan
    flat_eps = for_kernel(np.broadcast_to(step_size, batch).ravel())
    arrays: tuple[FloatArray, ...]
    if isinstance(body, SuslovND):
        kernel, lanes = kernels.reconstruct_nd, 1
        arrays = turns, np.empty((min(size, TASKS), 3 * n + 2, n))
    else:
        kernel, lanes = kernels.reconstruct, LANES
        arrays = turns[0], np.tile([1.0, 0.0, 0.0, 0.0], (size, 1)), turns[1:]
    work = turns.size * _TURNING if size > lanes else 0
    _threads.call_kernel(kernel, work, threads, flat, flat_eps, *arrays)
    return turns.reshape((rows, *batch, n, n))


def _check_that_states_follow(
    body: Any, omega: FloatArray, eps: FloatArray, batch: tuple[int, ...], threads: int | None
) -> None:
    """Raise ValueError if states (N + 1, B, D) are not consecutive states of the map."""
    J, I, rotor, moments, products = in_units(body)
    with np.errstate(all="ignore"):
        h = np.ldexp(eps[..., np.newaxis], products - moments) / J
    shape = np.broadcast_shapes(h.shape, I.shape, rotor.shape)
    *rows, k = (np.broadcast_to(each, shape) for each in (np.sqrt(J), h, I, rotor))
    parameters = *(flat_parameter(r, batch, 1) for r in rows), flat_parameter(k[..., 0], batch)
    stray = np.empty(omega.shape[1], np.int64)
    work = omega.size * _CHECKING if stray.size > LANES else 0
    _threads.call_kernel(follow, work, threads, *parameters, omega, stray)
    if stray.max(initial=-1) < 0:
        return
    where = f" of trajectory {spell(first_index((stray >= 0).reshape(batch)))}" if batch else ""
    number = stray[np.argmax(stray >= 0)]
    received = f"states {number - 1} and {number}{where} that are not"
    raise wrong(
        "omega",
        "consecutive states of the map with this eps",
        f"{received}; if the run was saved with save_every > 1, save every state",
    )
