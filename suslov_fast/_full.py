"""The scheme before Omega3 is set to 0."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _map
from ._bodies.three import Suslov3D
from ._checks import FloatArray, integer, one_of
from ._core.cpu import full_map as loops
from ._core.formulas.full_map import full_coefficients, full_step
from ._engine import threads as _threads
from ._engine.arguments import check, components
from ._engine.elementwise import evaluate, without_poles
from ._engine.layout import saved_states
from ._engine.progress import Progress, check_progress, reporter
from ._status import Status
from ._trajectories import Trajectories

# Python looks for Ctrl-C between slices of so many steps of a trajectory: some 0.1 s.
_SLICE = 2**25
# What a step and a saved state cost, in steps of the map.
_STEP, _SAVING = 4, 8


def step_full(body: Suslov3D, omega: ArrayLike, eps: ArrayLike, I3: ArrayLike) -> FloatArray:
    """One step of the three-component scheme, equation (ds).

    The constraint asks for Omega3 = 0; the scheme itself only changes the sign of Omega3.

    Parameters
    ----------
    body : Suslov3D
        The body, or a batch of them.
    omega : array_like(float, shape=(..., 3))
        Angular velocities (Omega1, Omega2, Omega3); NaN where there is none.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.
    I3 : array_like(float, shape=(...))
        The third moment of inertia, positive.

    Returns
    -------
    ndarray(float, shape=(..., 3))
        The next states; NaN where omega is, and, with one :class:`SingularStepWarning`, where there
        is none.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, step_full
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> step_full(body, [1.0, 0.5, 0.1], eps=0.2, I3=3).round(6)
    array([ 0.988568,  0.315951, -0.1     ])
    """
    state, coefficients, batch = _checked(body, "omega", omega, eps, I3)
    following = evaluate(full_step, batch, *coefficients, *components(state))
    missing = np.broadcast_to(np.isnan(state).any(axis=-1), batch)
    following[missing] = 0.0  # not a failure of this step
    following = without_poles(following)
    following[missing] = np.nan
    return following


def iterate_full(
    body: Suslov3D,
    omega0: ArrayLike,
    eps: ArrayLike,
    steps: int,
    I3: ArrayLike,
    *,
    save_every: int | None = 1,
    out: FloatArray | None = None,
    threads: int | None = None,
    on_singular: _map.OnSingular = "warn",
    progress: Progress = None,
) -> Trajectories:
    """Iterate the three-component scheme, equation (ds), in which Omega3 need not vanish.

    The shapes of the body, of `eps`, of `I3` and of `omega0` without its last axis broadcast to the
    batch shape ``...``.

    Parameters
    ----------
    body : Suslov3D
        The body, or a batch of them.
    omega0 : array_like(float, shape=(..., 3))
        Initial angular velocities (Omega1, Omega2, Omega3).
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega0; a negative one gives the inverse map.
    steps : int
        Number of steps, 0 or more.
    I3 : array_like(float, shape=(...))
        The third moment of inertia, positive.
    save_every : int or None
        Keep the states 0, k, 2k, ... up to `steps`; None keeps only the last.
    out : ndarray(float64, shape=(n_saved, ..., 3)), optional
        C-contiguous array that receives the saved states, instead of a new one.
    threads : int, optional
        Number of threads; by default what Numba is set to.
    on_singular : {"warn", "raise", "ignore"}
        What to do if trajectories came to an end, as in :func:`iterate`.
    progress : bool or callable, optional
        True shows a bar (needs tqdm); a callable is called as ``progress(done, steps)``.

    Returns
    -------
    Trajectories
        With states of three components. What holds for the problem itself, such as
        :func:`first_integral`, does not for them.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above; nothing is computed or written then.
    ImportError
        If `progress` is True and tqdm is not installed.
    SingularStepError
        If `on_singular` is "raise" and a trajectory came to an end.

    Notes
    -----
    Omega3 changes sign at each step. As eps -> 0 the scheme then has no limit: for the body below,
    omega0 = (1, 0.5, 0.1) and I3 = 3 the quotient (Omega1_next - Omega1) / eps is

    ======  ==========  ============
    eps     Omega3 = 0  Omega3 = 0.1
    ======  ==========  ============
    0.1     0.0750      -0.178
    0.01    0.0806      -2.42
    0.001   0.0812      -24.9
    ======  ==========  ============

    This is why the paper sets Omega3 = 0.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, iterate_full
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> orbit = iterate_full(body, [1.0, 0.5, 0.1], eps=0.2, steps=100, I3=3)
    >>> orbit.omega.shape
    (101, 3)
    >>> orbit.omega[:4, 2]
    array([ 0.1, -0.1,  0.1, -0.1])
    """
    one_of("on_singular", on_singular, ("warn", "raise", "ignore"))
    state, coefficients, batch = _checked(body, "omega0", omega0, eps, I3)
    steps = integer("steps", steps, 0, "an integer of at least 0")
    if save_every is not None:
        save_every = integer("save_every", save_every, 1, "None or an integer of at least 1")
    threads = _threads.thread_count(threads)
    check_progress(progress)
    first, every = (steps, steps + 1) if save_every is None else (0, save_every)
    n = np.arange(first, steps + 1, every)
    size = math.prod(batch)
    start = np.broadcast_to(state, (*batch, 3)).reshape(size, 3).copy()
    saved = saved_states((len(n), *batch, 3), "C", out)
    if not saved.flags.c_contiguous:
        raise ValueError("out: expected a C-contiguous array, got one that is not")
    flat = saved.reshape(len(n), size, 3)
    if save_every is not None:
        flat[0] = start
    final, status, failed_at = _run(
        start,
        np.stack([np.broadcast_to(each, batch).ravel() for each in coefficients]),
        steps,
        every,
        flat if save_every is not None else flat[:0],
        threads,
        progress,
    )
    if save_every is None:
        flat[0] = final
    trajectories = Trajectories(
        omega=saved,
        n=n,
        eps=float(eps) if np.ndim(eps) == 0 else np.array(eps, np.float64),  # type: ignore[arg-type]
        body=body,
        status=status.reshape(batch),
        final=final.reshape((*batch, 3)),
        failed_at=failed_at.reshape(batch),
    )
    _map._report(trajectories, on_singular, stacklevel=2)
    return trajectories


def _checked(
    body: Suslov3D, name: str, omega: ArrayLike, eps: ArrayLike, I3: ArrayLike
) -> tuple[FloatArray, tuple[FloatArray, ...], tuple[int, ...]]:
    """States, coefficients of the scheme, and the batch shape."""
    (state, step_size, third), batch = check(
        body, {name: omega}, {"eps": eps, "I3": I3}, dimension=3
    )
    if not (third > 0).all():
        raise ValueError(f"I3: expected a positive moment of inertia, got {third.min()}")
    with np.errstate(all="ignore"):
        coefficients = full_coefficients(*body.parameters, step_size, third)
    return state, coefficients, batch


def _run(
    start: FloatArray,
    coefficients: FloatArray,
    steps: int,
    every: int,
    saved: FloatArray,
    threads: int | None,
    progress: Progress,
) -> tuple[FloatArray, NDArray[np.int8], NDArray[np.int64]]:
    """Final states (B, 3), statuses and first missing states; saved states are filled."""
    size = len(start)
    state = np.ascontiguousarray(start.T)
    known = np.isfinite(start).all(axis=-1)
    state[:, ~known] = np.nan
    status = np.where(known, Status.OK, Status.NONFINITE).astype(np.int8)
    failed_at = np.where(known, -1, 0)
    n_blocks = (size + loops.LANES - 1) // loops.LANES
    scratch = np.empty((min(n_blocks, loops.TASKS), loops.ROWS * loops.LANES))
    work = _STEP + _SAVING // every
    length = max(_SLICE // (work * max(size, 1)), 1)
    with reporter(progress, steps) as report:
        for begin in range(0, steps, length):
            end = min(begin + length, steps)
            _threads.run(
                loops.iterate,
                (end - begin) * size * work if n_blocks > 1 else 0,
                threads,
                coefficients,
                begin,
                end,
                every,
                state,
                saved,
                status,
                failed_at,
                scratch,
            )
            report(end)
    return np.ascontiguousarray(state.T), status, failed_at
