"""One step and many steps: of the map of a body, and of the scheme in three components."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

from numpy.typing import ArrayLike

from .._bodies.body_3d import Suslov3D
from .._checks import FloatArray, instance, one_of
from .._docs import filled
from .._engine.arguments import BodyOrField, check, orientations_of, refuse_rotor
from .._engine.problem import Problem, problem_of
from .._engine.progress import Progress
from .._engine.random_starts import RandomStarts
from .._maps import map_named, map_of
from .running import OnSingular, compute_run, one_step
from .trajectories import Trajectories

Method = Literal["auto", "canonical", "ds2", "gauss", "rank2"]


@filled
def step(
    body: BodyOrField, omega: ArrayLike, eps: ArrayLike, *, threads: int | None = None
) -> FloatArray:
    """One step of the discrete Suslov problem, equation (4) of the paper, or (15) in n dimensions.

    For a :class:`QuadraticField` it is a step of Kahan's map, and omega is the state x.

    %(Parameters: body, omega, eps, threads)s

    Returns
    -------
    ndarray(float, shape=(..., D))
        %(next_states)s

    %(Raises: invalid)s

    Notes
    -----
    %(poles)s

    Examples
    --------
    >>> from suslov_fast import Suslov3D, step
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> step(body, [1.0, 0.5], eps=0.2).round(6)
    array([1.013781, 0.372248])
    """
    map = map_of(body)
    states = check(body, (), {"omega": omega, "eps": eps}, threads)
    return one_step(problem_of(map, states, continued=False))


@filled
def iterate(
    body: BodyOrField,
    omega0: ArrayLike | RandomStarts,
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
    shape ``...``. A trajectory is bit-identical in any batch, order and number of threads.

    Parameters
    ----------
    %(body)s
    omega0 : array_like(float, shape=(..., D)) or RandomStarts
        State 0: (Omega1, Omega2), or the n - 1 components Omega_in. If it is NaN, the trajectory
        fails at step 0.
    %(eps, steps)s
    save_every : int or None
        Save the states 0, k, 2k, ... up to `steps`; None saves only the last, in memory that
        `omega` and `final` of the result share.
    method : {"auto", "canonical", "ds2"}, or {"auto", "gauss", "rank2"} in n dimensions
        In three dimensions "canonical" iterates the map in canonical coordinates, in which it has
        no parameters; "ds2" iterates equation (5) as printed, which is slower and less accurate.
        "auto" evaluates the closed form, at a cost that depends on the number of saved states and
        not on `steps`. It iterates runs with `attitude`, runs of fewer than 32 steps that save only
        the last state, and orbits of a gyrostat that are periodic and may meet a pole (t >= 1). A
        gyrostat has "auto" and "canonical".

        In n dimensions "gauss" eliminates the matrix A, with partial pivoting, in some n**3 / 3
        operations; "rank2" uses that A is diagonal plus rank two and needs some 20 n, but
        eliminates, too, where several J_i - eps p / 2 nearly vanish. "auto" evaluates the closed
        form for n = 3, if all J_i are exactly equal, and if I has one nonzero component and all
        other J_i are equal; otherwise it is "rank2".
    attitude : bool or array_like(float, shape=(..., n, n))
        True, or the initial rotation matrix (by default the identity), to compute the orientation
        of the body at every step, for any `save_every`; see :func:`attitude`.
    %(out, threads, on_singular, progress)s

    Returns
    -------
    Trajectories

    %(Raises: invalid, errors_of_runs)s

    Notes
    -----
    %(poles)s

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
    map = map_of(body)
    arguments: dict[str, Any] = {"omega0": omega0, "eps": eps}
    if attitude is not False:
        arguments |= orientations_of(body, map.carries_attitude, attitude)
    states = check(body, (), arguments, threads)
    one_of("method", method, map.methods)
    problem = problem_of(map, states, method)
    return compute_run(Trajectories._of, problem, steps, save_every, on_singular, progress, out)


@filled
def step_full(
    body: Suslov3D, omega: ArrayLike, eps: ArrayLike, I3: ArrayLike | None = None
) -> FloatArray:
    """One step of the scheme in three components, equation (3) of the paper.

    The constraint requires Omega3 = 0; the scheme itself only changes the sign of Omega3.

    Parameters
    ----------
    %(body_3d)s
    omega : array_like(float, shape=(..., 3))
        Angular velocities (Omega1, Omega2, Omega3); NaN where there is none.
    %(eps, I3)s

    Returns
    -------
    ndarray(float, shape=(..., 3))
        %(next_states)s

    %(Raises: invalid)s

    Examples
    --------
    >>> from suslov_fast import Suslov3D, step_full
    >>> body = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3)
    >>> step_full(body, [1.0, 0.5, 0.1], eps=0.2, I3=3).round(6)
    array([ 0.9897  ,  0.406546, -0.1     ])
    """
    return one_step(_problem(body, {"omega": omega, "eps": eps}, I3, None))


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

    All shapes broadcast as in :func:`iterate`, with that of `I3`.

    Parameters
    ----------
    %(body_3d)s
    omega0 : array_like(float, shape=(..., 3))
        Initial angular velocities (Omega1, Omega2, Omega3).
    %(eps, steps, I3, save_every, out, threads, on_singular, progress)s

    Returns
    -------
    Trajectories
        Quantities of the two-component problem, such as :func:`first_integral`, do not apply.

    %(Raises: invalid, errors_of_runs)s

    Notes
    -----
    Omega3 changes sign at each step. Unless it is 0, as in the paper, the scheme has no limit for
    eps -> 0: in the example (Omega1_next - Omega1) / eps is -0.174, -2.42, -24.9 for eps = 0.1,
    0.01, 0.001; with Omega3 = 0 it is 0.0782, 0.081, 0.0812.

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
    problem = _problem(body, {"omega0": omega0, "eps": eps}, I3, threads)
    return compute_run(Trajectories._of, problem, steps, save_every, on_singular, progress, out)


def _problem(
    body: Suslov3D, arguments: dict[str, ArrayLike], I3: ArrayLike | None, threads: int | None
) -> Problem:
    refuse_rotor(body, "the three-component scheme", "iterate or flow")
    instance("body", body, Suslov3D)
    if I3 is not None:
        body = replace(body, I3=I3)  # type: ignore[arg-type]
    elif body.I3 is None:
        raise TypeError("I3: expected a number, or a body whose I3 is set, got neither")
    map = map_named("suslov3d_full")
    return problem_of(map, check(body, (), arguments, threads, map.components(body)))
