"""The continuous problem beside the discrete one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from . import _nd
from ._bodies.nd import SuslovND
from ._checks import FloatArray
from ._core.formulas import continuous
from ._engine.arguments import Body, check, components
from ._engine.elementwise import evaluate
from ._map import next_states


def vector_field(body: Body, omega: ArrayLike) -> FloatArray:
    """The derivative of omega by time.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega : array_like(float, shape=(..., D))
        Angular velocities.

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
    (state,), batch = check(body, {"omega": omega})
    if isinstance(body, SuslovND):
        return _nd.slope(body, state, state)
    return evaluate(continuous.vector_field, batch, *body.parameters, *components(state))


def reaction(
    body: Body,
    omega: ArrayLike,
    eps: ArrayLike | None = None,
    omega_next: ArrayLike | None = None,
) -> FloatArray:
    """The Lagrange multiplier of the constraint: the torque that keeps Omega3 at 0.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega : array_like(float, shape=(..., D))
        Angular velocities.
    eps : array_like(float, shape=(...)), optional
        Step size, in the unit of time of omega. With it the multiplier is that of the discrete
        equations between omega and the next state, without it that of the continuous ones.
    omega_next : array_like(float, shape=(..., D)), optional
        The next state, if it is known already; only together with eps.

    Returns
    -------
    ndarray(float, shape=(...) or (..., n - 1, n - 1))
        In the unit of inertia times that of omega squared; in n dimensions the antisymmetric
        lambda_ij of (nsus).

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
    if omega_next is None:
        (state,), batch = check(body, {"omega": omega})
        following = state if eps is None else next_states(body, state, eps, stacklevel=3)
        batch = following.shape[:-1] if eps is not None else batch
    elif eps is None:
        raise ValueError("eps: expected a step size together with omega_next, got None")
    else:
        (state, following, _), batch = check(
            body, {"omega": omega, "omega_next": omega_next}, {"eps": eps}
        )
    if isinstance(body, SuslovND):
        m = body.dimension
        return np.broadcast_to(_nd.reaction(body, state, following), (*batch, m, m)).copy()
    return evaluate(
        continuous.reaction, batch, *body.parameters, *components(state), *components(following)
    )
