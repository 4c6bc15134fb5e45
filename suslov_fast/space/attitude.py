"""Orientation of the body in space."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..bodies.nd import SuslovND
from ..bodies.rigid import Suslov3D, SuslovGyrostat
from ..checks import MOMENTS, FloatArray, common_shape, first_index, instance, spell, wrong
from ..core import orientations
from ..engine import threads as _threads
from ..engine.arguments import AnyBody, flat_arrays, flat_parameter, thread_count

# States follow each other if what the equations leave is below this part of the step between them,
# which is above rounding and below what any other method or step size leaves,
_OF_THE_STEP = 1e-6
# plus this part of the terms, and in three dimensions this part over the distance to a pole.
_OF_THE_TERMS, _NEXT_TO_POLES = 1e-10, 2.0**-47
# Numbers of the states that are tested at a time.
_SLAB = 2**16


def attitude(
    body: Suslov3D | SuslovND | SuslovGyrostat,
    omega: ArrayLike,
    eps: ArrayLike,
    R0: ArrayLike | None = None,
    *,
    threads: int | None = None,
) -> FloatArray:
    """Orientation of the body along stored trajectories, eps being their step size.

    Parameters
    ----------
    body : Suslov3D, SuslovND or SuslovGyrostat
        A single one, or a batch.
    omega : array_like(float, shape=(N + 1, ..., D))
        Consecutive states of trajectories, as :func:`iterate` returns them, including NaN after a
        failure.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.
    R0 : array_like(float, shape=(..., n, n)), optional
        Rotation matrix, the orientation at the first state; by default the identity.
    threads : int, optional
        Number of threads, by default Numba's. Results do not depend on it.

    Returns
    -------
    ndarray(float, shape=(N + 1, ..., n, n))
        Matrices R that take components in the body frame to components in space, orthogonal to
        rounding; NaN from the first NaN state on. In three dimensions
        ``scipy.spatial.transform.Rotation.from_matrix(R.reshape(-1, 3, 3))`` converts them.

    Raises
    ------
    ValueError
        If states do not follow each other, as every k-th state of a run.

    Notes
    -----
    R_next = R cay(eps (Omega + Omega_next) / 2) with the Cayley map, a discretization of order 2 of
    R' = R Omega.

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
    n, D = body.dimension + 1, body.dimension
    states = checks.states("omega", omega, body._labels)
    if states.ndim < 2 or len(states) == 0:
        raise wrong("omega", f"shape (N + 1, ..., {D})", states.shape)
    step_size = checks.within("eps", checks.real_array("eps", eps), MOMENTS)
    start = np.eye(n) if R0 is None else checks.rotations("R0", R0, n)
    threads = thread_count(threads)
    shapes = {"omega": states.shape[1:-1], "eps": step_size.shape, "R0": start.shape[:-2]}
    batch = common_shape({"body": body.shape, **shapes})
    states = np.expand_dims(states, tuple(range(1, len(batch) + 3 - states.ndim)))
    states = np.broadcast_to(states, (len(states), *batch, D))
    _check_that_states_follow(body, states, step_size)
    flat = flat_arrays(states.reshape(len(states), -1, D), states.shape[:1], 2)
    turns = np.empty((*flat.shape[:2], n, n))
    turns[0] = flat_arrays(start, batch, 2)
    turns[0, np.isnan(flat[0]).any(axis=-1)] = np.nan
    axial = not isinstance(body, SuslovND)
    arguments = flat, flat_parameter(step_size, batch), axial, turns[0].copy(), 0, 1, 1, turns
    _threads.call_kernel(orientations.turn, turns.size, threads, *arguments)
    return turns.reshape((len(states), *batch, n, n))


def _check_that_states_follow(body: Any, states: FloatArray, eps: FloatArray) -> None:
    """Raise ValueError if states (N + 1, ..., D) are not consecutive states of the map."""
    rows = max(_SLAB // max(math.prod(states.shape[1:]), 1), 1)
    for first in range(0, len(states) - 1, rows):
        part = states[first : first + rows + 1]
        with np.errstate(all="ignore"):
            strays = _strays(body, part[:-1], part[1:], eps)
        if strays.any():
            row, *place = first_index(strays)
            where = f" of trajectory {spell(tuple(place))}" if place else ""
            number = first + row
            received = f"states {number} and {number + 1}{where} that are not"
            hint = "if the run was saved with save_every > 1, save every state"
            expected = "consecutive states of the map with this eps"
            raise wrong("omega", expected, f"{received}; {hint}")


def _strays(body: Any, w: FloatArray, v: FloatArray, eps: FloatArray) -> Any:
    """Return where v is not the next state of w, by the implicit equations; nowhere for NaN.

    In all dimensions v_i - w_i = (eps / J_i) ((p v_i + p_next w_i) / 2 - I_i v.w), where p = I.w
    and p_next = I.v; in three dimensions a rotor adds a term.
    """
    distance: Any = 1.0
    k = np.asarray(getattr(body, "k", 0.0))[..., np.newaxis]
    if isinstance(body, SuslovND):
        J, I = body.J, body.I
    else:
        J = np.stack(np.broadcast_arrays(body.I1, body.I2), axis=-1)
        I = np.stack(np.broadcast_arrays(body.I23, np.negative(body.I13)), axis=-1)
        distance = _distance_to_pole(J, I, k, eps, w)
    size = np.maximum(abs(v).max(axis=-1), abs(w).max(axis=-1))[..., np.newaxis]
    w, v = w / size, v / size  # products are in range
    h, weights = eps[..., np.newaxis] * size / J, np.sqrt(J)
    turn = 0.5 * k / size * (v + w)[..., ::-1] * [1.0, -1.0] if k.any() else 0.0 * w

    def total(each: FloatArray) -> FloatArray:
        return np.asarray(each.sum(axis=-1, keepdims=True))

    left = v - w - h * (0.5 * (total(I * w) * v + total(I * v) * w) - I * total(v * w) - turn)
    terms = abs(w) + abs(v) + abs(turn) * abs(h)
    terms += abs(h) * 0.5 * (total(abs(I * w)) * abs(v) + total(abs(I * v)) * abs(w))
    terms += abs(h) * abs(I) * total(abs(v * w))
    residual, step, size = ((weights * abs(each)).sum(axis=-1) for each in (left, v - w, terms))
    allowed = distance * _OF_THE_STEP * step + (_OF_THE_TERMS * distance + _NEXT_TO_POLES) * size
    return distance * residual > allowed


def _distance_to_pole(J: Any, I: Any, k: Any, eps: FloatArray, w: FloatArray) -> FloatArray:
    """Return |det A| over the sum of the moduli of its terms; 1 if that is not a number."""
    h1, h2 = np.moveaxis(0.5 * eps[..., np.newaxis] / J, -1, 0)
    (I_1, I_2), (w1, w2) = np.moveaxis(I, -1, 0), np.moveaxis(w, -1, 0)
    l = I_1 * w2 - I_2 * w1 + k[..., 0]
    first, second = h1 * I_2 * w2, h2 * I_1 * w1
    product = h1 * (l + I_1 * w2) * (h2 * (l - I_2 * w1))
    size = (1.0 + abs(first)) * (1.0 + abs(second)) + abs(product)
    distance = abs((1.0 - first) * (1.0 - second) + product) / size
    return np.where(distance < 1.0, distance, 1.0)
