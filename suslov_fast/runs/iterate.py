"""One step and many steps of the map of a body or a field."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.classes import BodyOrField
from ..bodies.rigid import Suslov3D
from ..checks import FloatArray, integer, warn, wrong
from ..engine.problem import check
from ..engine.random_starts import RandomStarts
from ..engine.status import OnSingular, report_failures
from ..engine.stretches import March, Progress
from ..maps import Method, map_of
from ..quantities.evaluation import mask_and_warn
from .trajectories import Trajectories, run_to_end


def step(
    body: BodyOrField,
    omega: ArrayLike,
    /,
    eps: ArrayLike,
    *,
    method: Method = "auto",
    threads: int | None = None,
) -> FloatArray:
    """One step of the discrete Suslov problem, equation (4) of the paper, or (15) in n dimensions.

    For a :class:`QuadraticField` it is a step of Kahan's map from the state x.

    Parameters
    ----------
    body, eps, method, threads
        As in :func:`iterate`; a step in three dimensions always runs on one thread.
    omega : array_like(float, shape=(..., D))
        Angular velocities, or states x of a field.

    Returns
    -------
    ndarray(float, shape=(..., D))
        The next states; NaN for states that are NaN, and, with one :class:`SingularStepWarning`,
        where there is no next state.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, step
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> step(body, [1.0, 0.5], eps=0.2).round(6)
    array([1.013781, 0.372248])
    """
    map = map_of(body, method)
    problem = check(map, body, omega, eps, threads)
    if "step" in map.formulas:
        return mask_and_warn(problem, map.formulas["step"].compute(problem))
    march = March(problem, method)
    march.to(1)
    march.status[march.status > 0] = 0  # poles are a matter of runs
    report_failures(march, "warn", since=1)  # those at step 0 are NaN as given
    return march.final


def iterate(
    body: BodyOrField,
    omega0: ArrayLike | RandomStarts,
    /,
    eps: ArrayLike,
    steps: int,
    *,
    save_every: int | None = 1,
    method: Method = "auto",
    attitude: bool | ArrayLike = False,
    out: FloatArray | None = None,
    threads: int | None = None,
    on_singular: OnSingular = "warn",
    progress: Progress = None,
) -> Trajectories:
    """Iterate a batch of trajectories of the discrete Suslov problem, or of Kahan's map of a field.

    The shapes of the body, of `eps` and of `omega0` without its last axis broadcast to the batch
    shape ``...``. A trajectory has the same bits in any batch, order and number of threads, for any
    `save_every`, and in however many calls it is computed.

    Parameters
    ----------
    body : Suslov3D, SuslovND, SuslovGyrostat or QuadraticField
        A single one, or a batch.
    omega0 : array_like(float, shape=(..., D)) or RandomStarts
        State 0: angular velocities (Omega1, Omega2), or the n - 1 components Omega_in; or states x
        of a field. A trajectory from NaN has the status NONFINITE and failed at step 0.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of the states, 0 or between 1e-50 and 1e50 in modulus; a
        negative one is that of the inverse map.
    steps : int
        Number of steps, 0 or more.
    save_every : int or None
        Save the states 0, k, 2k, ... up to `steps`; None saves only the last.
    method : {"auto"}, {"auto", "gauss", "rank2"} in n dimensions, or of a field \
            {"auto", "order4", "order6", "order8"}
        A step of order 4, 6 or 8 is made of 5, 9 or 17 steps of the map, by fractions of eps. It is
        far more accurate for the same work, but no longer conserves what the map conserves.
        "gauss" eliminates the matrix A with pivoting, in n**3 / 3 operations; "rank2" uses
        that A is diagonal plus rank two, in about 20 n, and eliminates where digits would be lost,
        as "auto" does.
    attitude : bool or array_like(float, shape=(..., n, n))
        True, or the initial rotation matrix (by default the identity), to carry the orientation of
        the body along at every step; see :func:`attitude`.
    out : ndarray(float64, shape=(n_saved, ..., D)), optional
        C-contiguous array that receives the saved states, instead of a new one.
    threads : int, optional
        Number of threads, by default Numba's. Results do not depend on it.
    on_singular : {"warn", "raise", "ignore"}
        What to do if trajectories fail: one :class:`SingularStepWarning` for all, a
        :class:`SingularStepError` that holds the result, or nothing. Of poles that
        are passed one :class:`PoleWarning` tells, unless this is "ignore".
    progress : bool or callable, optional
        True shows a bar (needs tqdm); a callable is called as ``progress(done, steps)``, while all
        trajectories stand at the state `done`. If it returns False, the run ends there;
        :meth:`Trajectories.extend` continues it. All other answers go on: with a
        `threading.Event` write ``lambda done, steps: not event.is_set()``.

    Returns
    -------
    Trajectories

    Notes
    -----
    At a pole there is no next state: :func:`iterate` and :func:`step` stop there, with NaN and the
    status SINGULAR. The closed form goes on beyond the pole, as the birational map does:
    :func:`exact` and :func:`limits` have the states after it, and only the state directly after
    the pole is NaN.

    A step of a field, or of a body in n dimensions, from a state with det A < 0 has the status
    PASSED_POLE, and `failed_at` is the state after it: the motion escapes to infinity, or eps is
    too long. The states beyond are there, and are those of the map alone. See
    :class:`PoleWarning`, also for what it does not see.

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
    map = map_of(body, method)
    problem = check(map, body, omega0, eps, threads, name="omega0", attitude=attitude)
    counts = checked_counts(steps, save_every)
    if type(problem.eps) is not float:  # a copy, for the run
        given = np.array(problem.eps)
        problem = problem._replace(eps=given)
        if given.shape in ((counts[0],), (counts[0] + 1,)) and counts[0] > 9:
            _advise_on_times(given, counts[0])
    march = March(problem, method)
    return run_to_end(march, method, *counts, on_singular, progress, out)


def _advise_on_times(eps: FloatArray, steps: int) -> None:
    """Warn of what `odeint` takes, times from 0 to the end: here they are a step size each."""
    step = float(eps[1] - eps[0])
    if eps[0] == 0.0 and step > 0.0 and np.allclose(np.diff(eps), step, rtol=1e-6, atol=0.0):
        text = (
            f"eps: {eps.size} step sizes from 0 to {eps[-1]:g}, one for each trajectory of a batch"
        )
        warn(f"{text}; for a run with these times pass eps={step:g}, steps={eps.size - 1}")


def checked_counts(steps: int, save_every: int | None) -> tuple[int, int | None]:
    """Return the checked numbers of steps, of the run and from one saved state to the next."""
    if save_every is not None:
        save_every = integer("save_every", save_every, 1, "None or an integer of at least 1")
    return integer("steps", steps, 0, "the number of steps, an integer of 0 or more"), save_every


def step_full(
    body: Suslov3D, omega: ArrayLike, /, eps: ArrayLike, I3: ArrayLike | None = None
) -> FloatArray:
    """One step of the scheme in three components, equation (3) of the paper.

    The constraint requires Omega3 = 0; the scheme itself only changes the sign of Omega3, and
    unless Omega3 is 0 it has no limit for eps -> 0.

    Parameters
    ----------
    body, eps
        As in :func:`iterate`.
    omega : array_like(float, shape=(..., 3))
        Angular velocities (Omega1, Omega2, Omega3).
    I3 : array_like(float, shape=(...)), optional
        The third moment of inertia, positive; by default that of the body.

    Returns
    -------
    ndarray(float, shape=(..., 3))
        The next states; NaN for states that are NaN, and, with one :class:`SingularStepWarning`,
        where there is no next state.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, step_full
    >>> body = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3)
    >>> step_full(body, [1.0, 0.5, 0.1], eps=0.2, I3=3).round(6)
    array([ 0.9897  ,  0.406546, -0.1     ])
    """
    map = map_of(body)
    map.require("step_full", body)
    if I3 is not None:
        body = replace(body, I3=I3)
    elif body.I3 is None:
        raise wrong("I3", "a number, or a body whose I3 is set", "neither", TypeError)
    labels = "Omega1", "Omega2", "Omega3"
    problem = check(map, body, omega, eps, components=labels)
    return mask_and_warn(problem, map.formulas["step_full"].compute(problem))
