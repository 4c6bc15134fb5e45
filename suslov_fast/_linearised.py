"""The derivative of the map, and how fast orbits leave or reach steady states."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from . import _nd
from ._bodies.nd import SuslovND
from ._checks import FloatArray
from ._core.formulas import linearised
from ._engine.arguments import Body, check, components
from ._engine.elementwise import evaluate, without_poles
from ._map import next_states


def jacobian(body: Body, omega: ArrayLike, eps: ArrayLike) -> FloatArray:
    """The derivative of the map.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega : array_like(float, shape=(..., D))
        Angular velocities.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.

    Returns
    -------
    ndarray(float, shape=(..., D, D))
        Dimensionless; row i, column j holds the derivative of the next Omega_i by Omega_j. NaN,
        with one :class:`SingularStepWarning`, where the map has a pole.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.

    Notes
    -----
    DPhi = A(omega; eps)**-1 A(omega_next; -eps), with the matrix A that the paper inverts to
    get (ds2).

    Examples
    --------
    >>> from suslov_fast import Suslov3D, jacobian
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> jacobian(body, [1.0, 0.5], eps=0.2).round(6)
    array([[ 1.006511,  0.037232],
           [-0.221645,  0.937189]])
    """
    (state, step_size), batch = check(body, {"omega": omega}, {"eps": eps})
    if isinstance(body, SuslovND):
        following = next_states(body, state, step_size, stacklevel=3)
        return _nd.jacobian(body, state, following, step_size)
    parameters = (*body.normalised, body.normalised_eps(step_size))
    entries = evaluate(linearised.jacobian, batch, *parameters, *components(state))
    return without_poles(entries).reshape((*batch, 2, 2))


def multipliers(body: Body, c: ArrayLike, eps: ArrayLike) -> FloatArray:
    """The eigenvalues of the derivative of the map at the steady state c (I23, -I13), or c I.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    c : array_like(float, shape=(...))
        Where on the line of steady states; the unit is that of omega over that of inertia.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.

    Returns
    -------
    ndarray(float, shape=(..., D))
        Dimensionless: 1, for the direction of the line, and the multipliers of the distance from
        it: above 1 in size where the line repels, below where it attracts, infinite at a pole.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.

    Notes
    -----
    (1 + Y) / (1 - Y), Y = eps c D / (2 I1 I2), by equation (xy1) at x = 0, y = c D. In n
    dimensions Y = eps c s / 2 for the eigenvalues s, ascending, of J**-1 (|I|**2 Id - I I^T).

    Examples
    --------
    >>> from suslov_fast import Suslov3D, multipliers
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> multipliers(body, c=[-2.0, 2.0], eps=0.2).round(6)
    array([[1.      , 0.940805],
           [1.      , 1.062919]])
    """
    (where, step_size), batch = check(body, {}, {"c": c, "eps": eps})
    if isinstance(body, SuslovND):
        return _nd.multipliers(body, where, step_size)
    I1, I2, I13, I23 = body.parameters
    return np.asarray(evaluate(linearised.multipliers, batch, I1, I2, I13, I23, step_size, where))
