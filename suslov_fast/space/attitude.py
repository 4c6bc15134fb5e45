"""Orientation of the body in space."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..bodies.nd import SuslovND
from ..checks import MOMENTS, FloatArray, common_shape, first_index, instance, spell, wrong
from ..core import orientations
from ..engine import threads as _threads
from ..engine.arguments import AnyBody, States, flat_arrays, flat_parameter, thread_count
from ..maps import states_after

# A state follows another if it differs from the image of that by less than this part of the step,
# which is above rounding and below what any other method or step size gives, and of the state.
_OF_THE_STEP, _OF_THE_STATE = 1e-6, 1e-10


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
        rounding; NaN from the first NaN state on.

    Raises
    ------
    ValueError
        If states do not follow each other, as every k-th state of a run.

    Notes
    -----
    R_next = R cay(eps (Omega + Omega_next) / 2) with the Cayley map, a discretization of order 2 of
    R' = R Omega.
    States follow each other if the map takes the first to the second, or its inverse the second to
    the first, to 1e-6 of the step between them and 1e-10 of the states.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, attitude, iterate
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> attitude(body, iterate(body, [1.0, 0.5], eps=0.2, steps=100).omega, eps=0.2).shape
    (101, 3, 3)
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
    flat = flat_arrays(states.reshape(len(states), math.prod(batch), D), states.shape[:1], 2)
    turns = np.empty((*flat.shape[:2], n, n))
    turns[0] = flat_arrays(start, batch, 2)
    turns[0, np.isnan(flat[0]).any(axis=-1)] = np.nan
    axial = not isinstance(body, SuslovND)
    arguments = flat, flat_parameter(step_size, batch), axial, turns[0].copy(), 0, 1, 1, turns
    _threads.call_kernel(orientations.turn, turns.size, threads, *arguments)
    return turns.reshape((len(states), *batch, n, n))


def _check_that_states_follow(body: Any, states: FloatArray, eps: FloatArray) -> None:
    """Raise ValueError if states (N + 1, ..., D) are not consecutive states of the map."""
    before, after = states[:-1], states[1:]
    with np.errstate(all="ignore"):
        strays = ~(_follows(body, before, after, eps) | _follows(body, after, before, -eps))
    strays &= ~np.isnan(before + after).any(axis=-1)
    if strays.any():
        row, *place = first_index(strays)
        where = f" of trajectory {spell(tuple(place))}" if place else ""
        received = f"states {row} and {row + 1}{where} that are not"
        hint = "if the run was saved with save_every > 1, save every state"
        raise wrong("omega", "consecutive states of the map with this eps", f"{received}; {hint}")


def _follows(body: Any, before: FloatArray, after: FloatArray, eps: FloatArray) -> Any:
    """Return where the map takes states to the others."""
    found = states_after(States(body, before, eps, before.shape[:-1]))
    error = abs(found - after).max(axis=-1)
    step, size = (abs(each).max(axis=-1) for each in (after - before, abs(after) + abs(before)))
    return error <= _OF_THE_STEP * step + _OF_THE_STATE * size
