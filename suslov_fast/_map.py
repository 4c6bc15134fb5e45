"""The 3D map: one step, and many steps of a batch."""

from __future__ import annotations

import warnings
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from . import _parallel
from ._bodies import Suslov3D
from ._core import loops_map as loops
from ._layout import (
    first_index,
    flat_parameter,
    flat_saved_states,
    flat_vectors,
    saved_states,
    spell,
    unflatten,
)
from ._progress import Progress, check_progress, reporter
from ._status import SingularStepError, SingularStepWarning, Status
from ._trajectories import Trajectories
from ._validation import (
    FloatArray,
    common_shape,
    instance,
    integer,
    one_of,
    real_array,
    vectors,
)

Method = Literal["auto", "ds2", "canonical"]
Order = Literal["C", "F"]
OnSingular = Literal["warn", "raise", "ignore"]

# Between two slices of this many lane-steps (some 10 ms to 300 ms) Python looks for Ctrl-C.
_SLICE = 2**27
# What a saved state costs, in steps.
_SAVING = 8


def step(body: Suslov3D, omega: ArrayLike, eps: ArrayLike) -> FloatArray:
    """One step of the discrete Suslov problem, equation (ds2).

    Parameters
    ----------
    body : Suslov3D
        The body, or a batch of them.
    omega : array_like(float, shape=(..., 2))
        Angular velocities (Omega1, Omega2).
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega; a negative one gives the inverse map.

    Returns
    -------
    ndarray(float, shape=(..., 2))
        The next states; NaN, with one :class:`SingularStepWarning`, where there is none.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above; nothing is computed then.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, step
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> step(body, [1.0, 0.5], eps=0.2).round(6)
    array([1.013781, 0.372248])
    """
    trajectories = _iterate(body, "omega", omega, eps, 1, None, "canonical", "C", None, None, None)
    _report(trajectories, "warn", stacklevel=2)
    return trajectories.final


def iterate(
    body: Suslov3D,
    omega0: ArrayLike,
    eps: ArrayLike,
    steps: int,
    *,
    save_every: int | None = 1,
    method: Method = "auto",
    order: Order = "C",
    out: FloatArray | None = None,
    threads: int | None = None,
    on_singular: OnSingular = "warn",
    progress: Progress = None,
) -> Trajectories:
    """Iterate a batch of trajectories of the discrete Suslov problem, equation (ds2).

    The shapes of the body, of `eps` and of `omega0` without its last axis broadcast to the batch
    shape ``...``. The result for one trajectory is the same bit for bit alone, in any batch, in
    any order and on any number of threads.

    Parameters
    ----------
    body : Suslov3D
        The body, or a batch of them.
    omega0 : array_like(float, shape=(..., 2))
        Initial angular velocities (Omega1, Omega2).
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega0; a negative one gives the inverse map.
    steps : int
        Number of steps, 0 or more.
    save_every : int or None
        Keep the states 0, k, 2k, ... up to `steps`; None keeps only the last, which `omega` and
        `final` of the result then share.
    method : {"auto", "canonical", "ds2"}
        "canonical" iterates the parameter-free form of the map, "ds2" the formula as the paper
        prints it, which is slower and less accurate. "auto" is "canonical" where states are saved;
        for the last state alone it takes two canonical steps per division, a third faster, and
        agrees to rounding.
    order : {"C", "F"}
        Memory order of the array that is allocated; "F" makes the batch the fastest axis.
    out : ndarray(float64, shape=(..., n_saved, 2)), optional
        C- or F-contiguous array that receives the saved states, instead of a new one.
    threads : int, optional
        Number of threads; by default what Numba is set to. The setting is restored afterwards.
    on_singular : {"warn", "raise", "ignore"}
        What to do if trajectories came to an end: one :class:`SingularStepWarning` for all, a
        :class:`SingularStepError` that carries the result, or nothing.
    progress : bool or callable, optional
        True shows a bar (needs tqdm); a callable is called as ``progress(done, steps)``.

    Returns
    -------
    Trajectories

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above; nothing is computed or written then.
    ImportError
        If `progress` is True and tqdm is not installed.
    SingularStepError
        If `on_singular` is "raise" and a trajectory came to an end.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, iterate
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> orbit = iterate(body, [1.0, 0.5], eps=0.2, steps=25)
    >>> orbit.omega.shape
    (26, 2)
    >>> orbit.final.round(6)
    array([ 0.873325, -1.093093])
    """
    one_of("on_singular", on_singular, ("warn", "raise", "ignore"))
    trajectories = _iterate(
        body, "omega0", omega0, eps, steps, save_every, method, order, out, threads, progress
    )
    _report(trajectories, on_singular, stacklevel=2)
    return trajectories


def _iterate(
    body: Suslov3D,
    name: str,
    omega0: ArrayLike,
    eps: ArrayLike,
    steps: int,
    save_every: int | None,
    method: str,
    order: str,
    out: FloatArray | None,
    threads: int | None,
    progress: Progress,
) -> Trajectories:
    """Check everything, then iterate; failures are recorded but not yet reported."""
    instance("body", body, Suslov3D)
    omega = vectors(name, omega0, 2)
    step_size = real_array("eps", eps)
    steps = integer("steps", steps, 0, "an integer of at least 0")
    if save_every is not None:
        expected = "None or an integer of at least 1"
        save_every = integer("save_every", save_every, 1, expected)
    one_of("method", method, ("auto", "canonical", "ds2"))
    one_of("order", order, ("C", "F"))
    threads = _parallel.thread_count(threads)
    check_progress(progress)
    batch = common_shape(**{"body": body.shape, "eps": step_size.shape, name: omega.shape[:-1]})
    n_saved = 1 if save_every is None else steps // save_every + 1
    shape = (*batch, n_saved, 2)
    try:
        if np.prod(shape, dtype=float) > 2**60:  # more than NumPy could even ask for
            raise MemoryError
        n = np.arange(n_saved) * (save_every or 1) + (steps if save_every is None else 0)
        saved = None
        if save_every is not None or order == "F" or out is not None:
            saved = saved_states(shape, order, out)
            order = "C" if saved.flags.c_contiguous else "F"
    except MemoryError as error:
        raise MemoryError(
            f"expected saved states that fit in memory, got shape {shape}; raise save_every"
        ) from error

    parameters = (*body.normalised, body.normalised_eps(step_size))
    arguments = [flat_parameter(parameter, batch, order) for parameter in parameters]
    states = flat_vectors(omega, batch, order)
    if out is not None:
        arguments = [_apart(argument, out) for argument in arguments]
        states = _apart(states, out)
    size = len(states)
    final, status = np.empty((size, 2)), np.empty(size, np.int8)
    code = _evaluation(method, save_every)
    if saved is None or save_every is None:
        flat_saved, every, weight = np.empty((0, 0, 0)), steps + 1, 1.0
    else:
        flat_saved, every = flat_saved_states(saved, order), save_every
        weight = 1.0 + _SAVING / save_every

    # Few trajectories take as long as half a block.
    slice_steps = steps
    if steps * max(size, loops.LANES // 2) * weight > _SLICE:
        slice_steps = max(2, int(_SLICE / (max(size, loops.LANES // 2) * weight)) // 2 * 2)
    resume = np.empty((2, size if slice_steps < steps else 0))
    eps = float(step_size) if step_size.ndim == 0 else step_size.copy()
    with reporter(progress, steps) as report:
        for start in range(0, max(steps, 1), max(slice_steps, 1)):
            stop = min(start + slice_steps, steps)
            _parallel.run(
                loops.iterate,
                _work(size, (stop - start) * weight),
                threads,
                code,
                *arguments,
                states,
                start,
                stop,
                every,
                flat_saved,
                order == "F",
                resume,
                final,
                status,
            )
            report(stop)

    failed_at = np.broadcast_to(np.int64(-1), size)
    failed = np.flatnonzero(status < 0)
    if failed.size:
        failed_at = failed_at.copy()
        _parallel.run(
            loops.locate_failure,
            _work(failed.size, steps),
            threads,
            code,
            *arguments,
            states,
            steps,
            failed,
            status,
            failed_at,
        )
    final = unflatten(final, batch, order)
    if saved is None:
        saved = final[..., np.newaxis, :]
    elif save_every is None:
        saved[..., 0, :] = final
    return Trajectories(
        omega=saved,
        n=n,
        eps=eps,
        body=body,
        status=unflatten(status, batch, order),
        final=final,
        failed_at=unflatten(failed_at, batch, order),
    )


def _evaluation(method: str, save_every: int | None) -> int:
    if method == "ds2":
        return loops.PRINTED
    return loops.PROJECTIVE if method == "auto" and save_every is None else loops.CANONICAL


def _work(trajectories: int, steps_each: float) -> int:
    """Lane-steps that threads can share: none within one block."""
    return int(trajectories * steps_each) if trajectories > loops.LANES else 0


def _apart(argument: FloatArray, out: FloatArray) -> FloatArray:
    return argument.copy() if np.may_share_memory(argument, out) else argument


def _report(trajectories: Trajectories, on_singular: str, stacklevel: int) -> None:
    """Say once for the whole batch which trajectories came to an end."""
    if trajectories.ok or on_singular == "ignore":
        return
    status = trajectories.status
    parts = []
    for code, what in ((Status.SINGULAR, "singular step"), (Status.NONFINITE, "non-finite step")):
        failed = status == code
        if failed.any():
            index = first_index(failed)
            parts.append(
                f"{np.count_nonzero(failed)} of {status.size} trajectories: {what}, "
                f"first: {spell(index)} at step {trajectories.failed_at[index]}"
            )
    message = "; ".join(parts)
    if on_singular == "raise":
        raise SingularStepError(message, trajectories)
    warnings.warn(message, SingularStepWarning, stacklevel=stacklevel + 1)
