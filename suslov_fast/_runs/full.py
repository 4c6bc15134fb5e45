"""The scheme before Omega3 is set to 0."""

from __future__ import annotations

from dataclasses import replace

from numpy.typing import ArrayLike

from .._bodies.three import Suslov3D
from .._checks import FloatArray, instance
from .._engine.arguments import check
from .._engine.layout import own_parameter, own_states
from .._engine.progress import Progress
from .._engine.run import Run, execute
from .._maps.registry import map_of
from .iterate import finish
from .trajectories import OnSingular, Trajectories, report


def step_full(
    body: Suslov3D, omega: ArrayLike, eps: ArrayLike, I3: ArrayLike | None = None
) -> FloatArray:
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
    I3 : array_like(float, shape=(...)), optional
        The third moment of inertia, positive; by default that of the body.

    Returns
    -------
    ndarray(float, shape=(..., 3))
        The next states; NaN where omega is, and, with one :class:`SingularStepWarning`, where there
        is none.

    Raises
    ------
    TypeError, ValueError
        For invalid arguments.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, step_full
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> step_full(body, [1.0, 0.5, 0.1], eps=0.2, I3=3).round(6)
    array([ 0.988568,  0.315951, -0.1     ])
    """
    run = _checked(body, "omega", omega, eps, I3)
    results = execute(run)
    # Failures at step 0 are states that did not exist before, and no news.
    report(run, results, "warn", 1, stacklevel=2)
    return results.final


def iterate_full(
    body: Suslov3D,
    omega0: ArrayLike,
    eps: ArrayLike,
    steps: int,
    I3: ArrayLike | None = None,
    *,
    save_every: int | None = 1,
    out: FloatArray | None = None,
    threads: int | None = None,
    on_singular: OnSingular = "warn",
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
    I3 : array_like(float, shape=(...)), optional
        The third moment of inertia, positive; by default that of the body.
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
        For invalid arguments, before any work.
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
    run = _checked(body, "omega0", omega0, eps, I3)
    run.steps, run.save_every, run.threads, run.progress = steps, save_every, threads, progress
    return finish(run, out, on_singular)


def _checked(
    body: Suslov3D, name: str, omega: ArrayLike, eps: ArrayLike, I3: ArrayLike | None
) -> Run:
    """Return a run of one step."""
    instance("body", body, Suslov3D)
    if I3 is not None:
        body = replace(body, I3=I3)  # type: ignore[arg-type]
    elif body.I3 is None:
        raise TypeError("I3: expected a number, or a body whose I3 is set, got neither")
    arrays, batch = check(body, {name: omega}, {"eps": eps}, 3, kinds=Suslov3D)
    states, own_eps = own_states(arrays[0], batch), own_parameter(arrays[1])
    return Run(map_of(body, full=True), body, batch, states, own_eps, steps=1, save_every=None)
