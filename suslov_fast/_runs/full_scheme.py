"""The three-component scheme, equation (3) of the paper."""

from __future__ import annotations

from dataclasses import replace

from numpy.typing import ArrayLike

from .._bodies.body_3d import Suslov3D
from .._checks import FloatArray, instance
from .._docs import filled
from .._engine.arguments import check, refuse_rotor
from .._engine.execution import Problem, problem_of
from .._engine.progress import Progress
from .._maps.registry import map_named
from .trajectories import OnSingular, Trajectories, finish, one_step


@filled
def step_full(
    body: Suslov3D, omega: ArrayLike, eps: ArrayLike, I3: ArrayLike | None = None
) -> FloatArray:
    """One step of the scheme in three components, equation (3) of the paper.

    The constraint requires Omega3 = 0; the scheme itself only changes the sign of Omega3.

    Parameters
    ----------
    omega : array_like(float, shape=(..., 3))
        Angular velocities (Omega1, Omega2, Omega3); NaN where there is none.
    I3 : array_like(float, shape=(...)), optional
        The third moment of inertia, positive; by default that of the body.

    Returns
    -------
    ndarray(float, shape=(..., 3))
        %(next_states)s

    Examples
    --------
    >>> from suslov_fast import Suslov3D, step_full
    >>> body = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3)
    >>> step_full(body, [1.0, 0.5, 0.1], eps=0.2, I3=3).round(6)
    array([ 0.9897  ,  0.406546, -0.1     ])
    """
    return one_step(_problem(body, "omega", omega, eps, I3))


@filled
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
    """Iterate the scheme in three components, equation (3), in which Omega3 may be nonzero.

    The shapes of the body, of `eps`, of `I3` and of `omega0` without its last axis broadcast to the
    batch shape ``...``.

    Parameters
    ----------
    omega0 : array_like(float, shape=(..., 3))
        Initial angular velocities (Omega1, Omega2, Omega3).
    I3 : array_like(float, shape=(...)), optional
        The third moment of inertia, positive; by default that of the body.

    Returns
    -------
    Trajectories
        With states of three components. Quantities of the two-component problem, such as
        :func:`first_integral`, do not apply to them.

    Raises
    ------
    %(errors_of_runs)s

    Notes
    -----
    Omega3 changes sign at each step. As eps -> 0 the scheme then has no limit: for the body below,
    omega0 = (1, 0.5, 0.1) and I3 = 3 the quotient (Omega1_next - Omega1) / eps is

    ======  ==========  ============
    eps     Omega3 = 0  Omega3 = 0.1
    ======  ==========  ============
    0.1     0.0782      -0.174
    0.01    0.081       -2.42
    0.001   0.0812      -24.9
    ======  ==========  ============

    This is why the paper sets Omega3 = 0.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, iterate_full
    >>> body = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3)
    >>> orbit = iterate_full(body, [1.0, 0.5, 0.1], eps=0.2, steps=100, I3=3)
    >>> orbit.omega.shape
    (101, 3)
    >>> orbit.omega[:4, 2]
    array([ 0.1, -0.1,  0.1, -0.1])
    """
    problem = _problem(body, "omega0", omega0, eps, I3, threads)
    return finish(problem, 0, steps, save_every, on_singular, progress, out)


def _problem(
    body: Suslov3D,
    name: str,
    omega: ArrayLike,
    eps: ArrayLike,
    I3: ArrayLike | None,
    threads: int | None = None,
) -> Problem:
    refuse_rotor(body, "the three-component scheme", "iterate or flow")
    instance("body", body, Suslov3D)
    if I3 is not None:
        body = replace(body, I3=I3)  # type: ignore[arg-type]
    elif body.I3 is None:
        raise TypeError("I3: expected a number, or a body whose I3 is set, got neither")
    map = map_named("suslov3d_full")
    components = map.components(body)
    (state, step_size), batch = check(body, (), {name: omega, "eps": eps}, components)
    return problem_of(map, body, batch, state, step_size, threads=threads)
