"""`step` and `iterate`: one step, and many steps, of the map of a body or field."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.systems import MapOrField
from ..calls import Progress, reporter
from ..checks import FloatArray, Reals, StatesLike, integer, one_of, start_of
from ..keywords import public
from ..maps.batch import BatchRun
from ..maps.map_records import Method, eps_and_steps, eps_of, map_of
from ..maps.problem import check
from ..results.failures import ON_SINGULAR, OnSingular, report_failures
from ..results.result import times_of
from .trajectories import Trajectories


@public
def step(
    system: MapOrField,
    x: StatesLike,
    /,
    eps: Reals | None = None,
    *,
    t0: Reals | None = None,
    method: Method = "auto",
    threads: int | None = None,
) -> FloatArray:
    """Return the next state: one step of Kahan's map of a field or body, or of a `Map`.

    In Kahan's method (next - x) / eps is equal to f, made linear in the next state: squares x_i**2
    become x_i next_i, products x_i x_j become (x_i next_j + next_i x_j) / 2, and x_i becomes
    (x_i + next_i) / 2. The method is symmetric: a step with -eps undoes a step with eps.

    Parameters
    ----------
    system
        As in :func:`iterate`.
    x : array_like(float, shape=(..., D))
        States x of a field, or angular velocities of a body.
    eps, t0, method, threads
        As in :func:`iterate`.

    Returns
    -------
    ndarray(float, shape=(..., D))
        The next states: NaN for a state that contains NaN, and for a state on a pole of the map,
        which also causes an :class:`IntegrationWarning`.

    See Also
    --------
    iterate : Many steps, with statuses.

    Notes
    -----
    For bodies these are equations (4) and (15) of Dragovic and Gajic, arXiv:0807.2966.

    Examples
    --------
    >>> from suslov_fast import Field, step
    >>> field = Field(lambda x: (x[0] - x[0] * x[1], x[0] * x[1] - x[1]), 2)
    >>> later = step(field, [1.0, 0.5], eps=0.2)
    >>> later.round(6)
    array([1.104712, 0.505236])
    >>> step(field, later, eps=-0.2).round(6)
    array([1. , 0.5])
    """
    map = map_of(system, method)
    problem = check(map, system, x, eps_of("step", system, eps), threads, method=method, t0=t0)
    batch_run = BatchRun(problem)
    if (after := batch_run.of_one()) is not None:
        return system._layout.leave(after)
    batch_run.to(1)
    if np.count_nonzero(batch_run.status):
        # `step` reports neither passed poles nor given states with NaN, which fail at step 0.
        batch_run.status[(batch_run.status > 0) | (batch_run.failed_at == 0)] = 0
        report_failures(batch_run, batch_run, "warn")
    return system._layout.leave(batch_run.final)


@public
def iterate(
    system: MapOrField,
    x0: StatesLike,
    /,
    eps: Reals | None = None,
    steps: int | None = None,
    *,
    t0: Reals | None = None,
    save_every: int | None = 1,
    method: Method = "auto",
    attitude: bool | ArrayLike = False,
    threads: int | None = None,
    on_singular: OnSingular = "warn",
    progress: Progress = None,
) -> Trajectories:
    """Iterate a map from a batch of initial states: a `Map`, or Kahan's map of an ODE x' = f(x).

    A :class:`Map` x -> f(x) has no step size: ``iterate(map, x0, steps=1000)``. For a
    :class:`Field` or a body, each step is a step of Kahan's method, of size `eps`.

    The shapes of the system, of `eps` and of the initial states without their last axis broadcast
    to the batch shape ``...``. A trajectory has the same bits whatever else is in the batch, and
    for any `threads` and `save_every`.

    Parameters
    ----------
    system : Map, Field, Suslov3D or SuslovND
        A single map, field or body, or a batch.
    x0 : array_like(float, shape=(..., D))
        Initial states: states x of a map or field, angular velocities (Omega1, Omega2) of a body in
        three dimensions, or the n - 1 components Omega_in of a body in n dimensions. A state that
        contains NaN fails at step 0. From a run or a motion its orbits go on at their ends.
    eps : array_like(float, shape=(...))
        Step size in time, 0 or from 1e-50 to 1e50 in modulus; not for a `Map`. A negative step
        size runs backwards in time, with the inverse map.
    steps : int
        Number of steps, 0 or more. For a `Map` it may be the third argument.
    t0 : array_like(float, shape=(...)), optional
        As in :func:`flow`.
    save_every : int or None
        k, to save the states 0, k, 2k, ... up to `steps`; or None, to save only the last state.
    method : str
        "auto" is Kahan's method, of order 2. For fields "order4", "order6" and "order8" compose 7,
        13 and 21 of its steps: they have more digits for the same work, but do not conserve what
        Kahan's map conserves. For bodies in n dimensions "gauss" eliminates the matrix A at every
        step; "auto" uses that A is diagonal plus rank two, and eliminates only where digits would
        be lost.
    attitude : bool or array_like(float, shape=(..., n, n))
        To compute also the rotation matrix R from the body to space: R at state 0, or True for the
        identity there. R_next = R cay(eps (Omega + Omega_next) / 2), where cay is the Cayley map.
    threads : int, optional
        Number of threads; by default all threads of Numba.
    on_singular : {"warn", "raise", "ignore"}
        Failed trajectories cause an :class:`IntegrationWarning`, or a :class:`SingularStepError`
        with the run as its attribute `trajectories`, or neither. Passed poles cause an
        :class:`IntegrationWarning`, except with "ignore".
    progress : bool or callable, optional
        True shows a progress bar, which needs tqdm. A function is called as
        ``progress(done, steps)``; if it returns False, the run ends at state `done`.

    Returns
    -------
    Trajectories
        The saved states and the status of each trajectory. A state on a pole has no next state:
        later states are NaN. For bodies :meth:`Suslov3D.exact` continues after a pole.

    Raises
    ------
    SingularStepError
        If a trajectory failed and `on_singular` is "raise".

    See Also
    --------
    flow : Solutions of equations to a tolerance.
    Suslov3D.exact : Any state of the orbit of a body, from a closed form.

    Examples
    --------
    Where are 1000 populations of predators and prey after 400 steps?

    >>> import numpy as np
    >>> from suslov_fast import Field, iterate
    >>> field = Field(
    ...     lambda x: (x[0] - x[0] * x[1], x[0] * x[1] - x[1]), "prey predator"
    ... )
    >>> starts = np.random.default_rng(0).uniform(0.5, 1.5, (1000, 2))
    >>> run = iterate(field, starts, eps=1 / 32, steps=400, save_every=100)
    >>> run.states.shape, bool(run.ok.all()), run.final.mean(axis=0).round(2)
    ((5, 1000, 2), True, array([1.  , 1.01]))
    """
    map = map_of(system, method)
    x0, time = start_of(x0, t0)
    t0 = time if system._has_eps else t0
    eps, steps = eps_and_steps("iterate", system, eps, steps)
    if save_every is not None:
        save_every = integer("save_every", save_every, 1, "None or an integer of at least 1")
    steps = integer("steps", steps, 0, "the number of steps, an integer of 0 or more")
    others: Any = {"attitude": attitude, "method": method, "t0": t0}
    problem = check(map, system, x0, eps, threads, name=f"{system._variable}0", **others)
    if type(problem.eps) is not float:  # copied, because the run keeps it
        problem = problem._replace(eps=np.array(problem.eps))
    batch_run = BatchRun(problem)
    one_of("on_singular", on_singular, ON_SINGULAR)
    with reporter(progress, steps) as report:
        saved, turns = batch_run.to(steps, save_every or 0, report=report)
    layout = problem.body._layout
    run = Trajectories._of(
        {
            "states": layout.leave(saved),
            "eps": problem.eps,
            "body": problem.body,
            "map": problem.map,
            "status": batch_run.status,
            "failed_at": batch_run.failed_at,
            "first_pole": batch_run.first_pole,
            "final": layout.leave(batch_run.final),
            "method": method,
            "steps": batch_run.n,  # fewer, if `progress` ended the run
            "save_every": save_every,
            "attitude": turns,
            "_t0": times_of(t0, problem.batch),
        }
    )
    report_failures(run, batch_run, on_singular)
    return run
