"""The coordinates (x, y) of the paper, and the constants of its solution (Section 4)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.rigid import Suslov3D
from ..checks import FloatArray, wrong
from ..core import quantities as formulas
from ..engine.arguments import check, refuse_rotor
from .evaluation import reported


def to_xy(body: Suslov3D, omega: ArrayLike) -> FloatArray:
    """Coordinates x = I13 Omega1 + I23 Omega2 and y = I23 I1 Omega1 - I13 I2 Omega2.

    The steady states are the line x = 0.

    Parameters
    ----------
    body : Suslov3D
        A single one, or a batch.
    omega : array_like(float, shape=(..., 2))
        States.

    Returns
    -------
    ndarray(float, shape=(..., 2))
        x, in the unit of inertia times that of omega, and y, in that of inertia squared times that
        of omega.

    Notes
    -----
    Section 4 of the paper, equation (7).

    Examples
    --------
    >>> from suslov_fast import Suslov3D, to_xy
    >>> to_xy(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25), [1.0, 0.5])
    array([-0.625, -0.75 ])
    """
    refuse_rotor(body, "to_xy", "iterate or flow")
    states = check(body, Suslov3D, {"omega": omega}, later=True)
    found = formulas.to_xy(*body.parameters, 0.0, states.omega)
    return reported(states, found, axes=1)


def from_xy(body: Suslov3D, xy: ArrayLike) -> FloatArray:
    """Angular velocities from coordinates (x, y), the inverse of :func:`to_xy`.

    Parameters
    ----------
    body : Suslov3D
        A single one, or a batch; I13 and I23 are not both 0.
    xy : array_like(float, shape=(..., 2))
        Coordinates (x, y). Where one is NaN, so is the result.

    Returns
    -------
    ndarray(float, shape=(..., 2))
        (Omega1, Omega2).

    Raises
    ------
    ValueError
        If I13 and I23 are both 0, where (x, y) is 0 for every omega.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, from_xy
    >>> from_xy(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25), [-0.625, -0.75])
    array([1. , 0.5])
    """
    refuse_rotor(body, "from_xy", "iterate or flow")
    states = check(body, Suslov3D, {"xy": xy}, components=("x", "y"), later=True)
    if np.any((np.asarray(body.I13) == 0) & (np.asarray(body.I23) == 0)):
        received = "both 0, where (x, y) is 0 for every omega"
        raise wrong("body", "I13 or I23 other than 0", received)
    found = formulas.from_xy(*body.parameters, 0.0, states.omega)
    return reported(states, found, axes=1)


class ClosedForm(NamedTuple):
    """Constants h, k1, k2 and t of :func:`closed_form`, each of shape (...)."""

    h: FloatArray
    k1: FloatArray
    k2: FloatArray
    t: FloatArray


def closed_form(body: Suslov3D, omega0: ArrayLike, eps: ArrayLike) -> ClosedForm:
    """Constants h, k1 and k2 of the solution of Section 4, and the criticality t.

    In the coordinates of :func:`to_xy` state n of the orbit is
    x = sign(x_0) 2 sqrt(h I1 I2 / (I1 I2 - h eps**2)) / cosh(theta) and
    y = 2 sqrt(h I1 I2) tanh(theta), with theta = k1 n eps + k2. eps = 0 gives the constants of the
    continuous motion.

    Parameters
    ----------
    body : Suslov3D
        A single one, or a batch.
    omega0 : array_like(float, shape=(..., 2))
        States, each any one of its orbit.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.

    Returns
    -------
    ClosedForm
        Named tuple of arrays (...): h, in the unit of (I13 omega)**2; k1, in the unit of 1 / eps;
        k2, dimensionless; and t, the :func:`criticality`. k1 and k2 are NaN where t is not between
        -1 and 1, because the solution has another form there. k2 is infinite on the line x = 0, and
        0 at rest.

    Notes
    -----
    h is the integral of equation (9), k1 = -(2 / eps) artanh t solves equation (12), and k2 is that
    of Theorem 1, which holds for positive x, with the prefactor 2 sqrt(h I1 I2) and the denominator
    I23**2 I1 + I13**2 I2.

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import Suslov3D, closed_form, exact, to_xy
    >>> body, eps = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), 0.2
    >>> h, k1, k2, t = closed_form(body, [1.0, 0.5], eps)
    >>> y = 2 * np.sqrt(h * body.I1 * body.I2) * np.tanh(k1 * 3 * eps + k2)
    >>> print(y.round(6), to_xy(body, exact(body, [1.0, 0.5], eps, n=3))[1].round(6))
    -1.167933 -1.167933
    """
    refuse_rotor(body, "closed_form", "exact")
    states = check(body, Suslov3D, {"omega0": omega0, "eps": eps})
    return ClosedForm(*formulas.closed_form(*body.parameters, states.eps, states.omega))
