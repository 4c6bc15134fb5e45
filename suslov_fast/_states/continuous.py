"""The continuous problem beside the discrete one."""

from __future__ import annotations

from numpy.typing import ArrayLike

from .._bodies.nd import SuslovND
from .._checks import FloatArray
from .._core.cpu import observables, observables_nd
from .._engine.arguments import Body, check
from .._engine.layout import flat_vectors
from .._engine.observables import by_slabs, of_state, of_state_nd
from .._engine.run import Run, execute
from .._engine.threads import thread_count
from .._maps.registry import map_of


def vector_field(body: Body, omega: ArrayLike, threads: int | None = None) -> FloatArray:
    """The derivative of omega by time.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega : array_like(float, shape=(..., D))
        Angular velocities; NaN for states that do not exist, and so is the result.
    threads : int, optional
        Number of threads; by default what Numba is set to.

    Returns
    -------
    ndarray(float, shape=(..., D))
        In the unit of omega squared.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.

    Notes
    -----
    Equations (s1) and (nsus1).

    Examples
    --------
    >>> from suslov_fast import Suslov3D, vector_field
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> vector_field(body, [1.0, 0.5]).round(6)
    array([ 0.08125, -0.65   ])
    """
    (state,), batch = check(body, {"omega": omega}, later=True)
    count = thread_count(threads)
    if isinstance(body, SuslovND):
        result = (body.dimension,)
        return of_state_nd(observables_nd.vector_field, body, state, None, batch, count, result)
    return of_state(observables.vector_field, body, state, None, batch, count, 2)


def reaction(
    body: Body, omega: ArrayLike, eps: ArrayLike | None = None, threads: int | None = None
) -> FloatArray:
    """The Lagrange multiplier of the constraint: the torque that keeps Omega3 at 0.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega : array_like(float, shape=(..., D))
        Angular velocities; NaN for states that do not exist, and so is the result.
    eps : array_like(float, shape=(...)), optional
        Step size, in the unit of time of omega. With it the multiplier is that of the discrete
        equations between each state and its own next one, without it that of the continuous ones.
    threads : int, optional
        Number of threads; by default what Numba is set to.

    Returns
    -------
    ndarray(float, shape=(...) or (..., n - 1, n - 1))
        In the unit of inertia times that of omega squared; in n dimensions the antisymmetric
        lambda_ij of (nsus). NaN, with one :class:`SingularStepWarning`, where eps is given and a
        state has no next one.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.

    Notes
    -----
    The third equation of (s1); made discrete as the others are in (ds1), it reads
    (x_next - x) / eps = lambda + (I1 - I2) (Omega1 Omega2_next + Omega1_next Omega2) / 2.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, reaction
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> float(reaction(body, [1.0, 0.5]).round(6))
    -1.345625
    >>> float(reaction(body, [1.0, 0.5], eps=0.01).round(6))
    -1.336328
    """
    (state, *step_size), batch = check(
        body, {"omega": omega}, {} if eps is None else {"eps": eps}, later=True
    )
    count = thread_count(threads)
    if isinstance(body, SuslovND):
        result = (body.dimension, body.dimension)
        if step_size:
            return by_slabs(
                _discrete_reaction_nd, body, state, step_size[0], batch, result, warn=True
            )
        return of_state_nd(observables_nd.reaction, body, state, None, batch, count, result)
    if step_size:
        loop = observables.discrete_reaction
        return of_state(loop, body, state, step_size[0], batch, count)
    return of_state(observables.reaction, body, state, None, batch, count)


def _discrete_reaction_nd(body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    batch = omega.shape[:-1]
    run = Run(
        map=map_of(body),
        body=body,
        batch=batch,
        omega0=flat_vectors(omega, batch),
        eps=eps,
        steps=1,
        save_every=None,
        method="auto",
        single=True,
    )
    following = execute(run).final
    loop, result = observables_nd.reaction, (body.dimension, body.dimension)
    return of_state_nd(loop, body, omega, None, batch, None, result, following)
