"""The orientation of the body in space."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.nd import SuslovND
from .._bodies.three import Suslov3D
from .._checks import FloatArray, aligned, common_shape, instance, real_array, rotations, vectors
from .._core.cpu import attitude as loops
from .._core.cpu.blocks import LANES, TASKS
from .._engine import threads as _threads
from .._engine.arguments import Body
from .._engine.layout import first_index, spell

# Python looks for Ctrl-C between slices of so many numbers of the result: some 0.1 s.
_SLICE = 2**25
# What a number of the result costs, and what a number of the states does to check, in steps of the
# map.
_TURNING, _CHECKING = 10, 10


def attitude(
    body: Body,
    omega: ArrayLike,
    eps: ArrayLike,
    R0: ArrayLike | None = None,
    threads: int | None = None,
) -> FloatArray:
    """The orientation of the body along stored trajectories.

    The shapes of the body, of `eps`, of `omega` without its first and last axis and of `R0` without
    its last two broadcast to the batch shape ``...``.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega : array_like(float, shape=(N + 1, ..., D))
        Trajectories with all their states, as `iterate` stores them; NaN after a failure.
    eps : array_like(float, shape=(...))
        The step size that the states were iterated with.
    R0 : array_like(float, shape=(..., n, n)), optional
        Orientation at the first state, a rotation matrix; by default the identity.
    threads : int, optional
        Number of threads; by default what Numba is set to.

    Returns
    -------
    ndarray(float, shape=(N + 1, ..., n, n))
        Matrices R that take components in the body to components in space, orthogonal to
        rounding however long the trajectory; NaN from the first state on that is NaN. In three
        dimensions ``scipy.spatial.transform.Rotation.from_matrix(R.reshape(-1, 3, 3))`` turns them
        into SciPy's rotations.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above; in particular if states do not follow each other
        by the map with this eps, as every k-th state of a run does not.

    Notes
    -----
    R_next = R cay(eps (Omega + Omega_next) / 2), the Cayley map: the discrete counterpart of
    R' = R Omega, of order 2. In three dimensions it is computed with unit quaternions.

    A state follows another if the implicit equations (dsn) hold to one part in 1e6 of the step
    between the two. Near a steady state, where steps are less than one part in 1e10 of the state,
    that cannot be told.

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
    omega, eps, R0 = aligned({"omega": omega, "eps": eps, "R0": R0}).values()
    states = vectors("omega", omega, m, allow_nan=True)
    if states.ndim < 2 or len(states) == 0:
        raise ValueError(f"omega: expected shape (N + 1, ..., {m}), got {states.shape}")
    step_size = real_array("eps", eps)
    start = np.eye(m + 1) if R0 is None else rotations("R0", R0, m + 1)
    threads = _threads.thread_count(threads)
    batch = common_shape(
        {
            "body": body.shape,
            "omega": states.shape[1:-1],
            "eps": step_size.shape,
            "R0": start.shape[:-2],
        }
    )
    flat = _flat_states(states, batch)
    flat_eps = np.broadcast_to(step_size, batch).ravel()
    _check_that_states_follow(body, flat, step_size, batch, threads)
    turns = np.empty((len(flat), math.prod(batch), m + 1, m + 1))
    turns[0] = np.broadcast_to(start, (*batch, m + 1, m + 1)).reshape(turns.shape[1:])
    turns[0, np.isnan(flat[0]).any(axis=-1)] = np.nan
    if isinstance(body, Suslov3D):
        _reconstruct(flat, flat_eps, turns, threads)
    else:
        _reconstruct_nd(flat, flat_eps, turns, threads)
    return turns.reshape((len(flat), *batch, m + 1, m + 1))


def _flat_states(states: FloatArray, batch: tuple[int, ...]) -> FloatArray:
    """States (N + 1, ..., D) as the array (N + 1, B, D) that loops take."""
    length, *own, m = states.shape
    aligned = states.reshape(length, *(1,) * (len(batch) - len(own)), *own, m)
    full = np.broadcast_to(aligned, (length, *batch, m)).reshape(length, math.prod(batch), m)
    return np.require(full, np.float64, ["C", "A", "W"])


def _slices(rows: int, numbers: int) -> Iterator[tuple[int, int]]:
    """Parts (start, stop) of the states after the first, so many numbers each."""
    length = max(_SLICE // max(numbers, 1), 1)
    for start in range(1, rows, length):
        yield start, min(start + length, rows)


def _reconstruct(
    omega: FloatArray, eps: FloatArray, turns: FloatArray, threads: int | None
) -> None:
    """Fill the orientations after the first, in three dimensions."""
    rows, size, _ = omega.shape
    R0 = np.ascontiguousarray(turns[0].transpose(1, 2, 0))
    carried = np.zeros((4, size))
    carried[0] = 1.0
    for start, stop in _slices(rows, size * 9):
        _threads.run(
            loops.reconstruct,
            (stop - start) * size * 9 * _TURNING if size > LANES else 0,
            threads,
            omega[start - 1 : stop],
            eps,
            R0,
            carried,
            turns[start:stop],
        )


def _reconstruct_nd(
    omega: FloatArray, eps: FloatArray, turns: FloatArray, threads: int | None
) -> None:
    """The same in n dimensions."""
    rows, size, m = omega.shape
    n = m + 1
    scratch = np.empty((min(size, TASKS), 3 * n + 2, n))
    for start, stop in _slices(rows, size * n * n):
        _threads.run(
            loops.reconstruct_nd,
            (stop - start) * size * n * n * _TURNING if size > 1 else 0,
            threads,
            omega[start - 1 : stop],
            eps,
            start - 1,
            turns[start - 1],
            turns[start:stop],
            scratch,
        )


def _check_that_states_follow(
    body: Body,
    omega: FloatArray,
    eps: FloatArray,
    batch: tuple[int, ...],
    threads: int | None,
) -> None:
    """Raise if states (N + 1, B, D) are not those of the map, one after the other."""
    rows, size, m = omega.shape
    parameters = _implicit_parameters(body, eps, batch)
    stray = np.full(size, -1)
    for start, stop in _slices(rows, size * m):
        _threads.run(
            loops.follow,
            (stop - start) * size * m * _CHECKING if size > LANES else 0,
            threads,
            *parameters,
            start - 1,
            omega[start - 1 : stop],
            stray,
        )
    if stray.max(initial=-1) < 0:
        return
    strays = (stray >= 0).reshape(batch)
    where = f" of trajectory {spell(first_index(strays))}" if batch else ""
    number = stray[np.argmax(stray >= 0)]
    raise ValueError(
        "omega: expected states that follow each other by one step of the map with this eps, got "
        f"states {number - 1} and {number}{where} that do not; if they are every k-th state of a "
        "run, save each one"
    )


def _implicit_parameters(
    body: Body, eps: FloatArray, batch: tuple[int, ...]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The roots of J, eps / J and I of (dsn), J and I of the order of 1: (B, m) or (1, m)."""
    if isinstance(body, Suslov3D):
        I1, I2, I13, I23 = np.broadcast_arrays(*body.parameters)
        J, I = np.stack([I1, I2], axis=-1), np.stack([I23, -I13], axis=-1)
    else:
        J, I = np.broadcast_arrays(body.J, body.I)
    _, of_J = np.frexp(J.max(axis=-1, keepdims=True))
    _, of_I = np.frexp(abs(I).max(axis=-1, keepdims=True))
    J, I = np.ldexp(J, -of_J), np.ldexp(I, -of_I)
    with np.errstate(all="ignore"):
        h = np.ldexp(eps[..., np.newaxis], of_I - of_J) / J
    if h.ndim > 1:
        flat = (*batch, body.dimension)
        J, I, h = (np.broadcast_to(each, flat) for each in (J, I, h))
    root, h, I = (
        np.require(each.reshape(-1, body.dimension), np.float64, ["C", "A", "W"])
        for each in (np.sqrt(J), h, I)
    )
    return root, h, I
