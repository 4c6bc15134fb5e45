"""The constants of the closed form, as Section 4 of the paper names them."""

from __future__ import annotations

from typing import NamedTuple

from numpy.typing import ArrayLike

from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .table import find


class ClosedForm(NamedTuple):
    """Constants h, k1, k2 and t of :func:`closed_form`, each of shape (...)."""

    h: FloatArray
    k1: FloatArray
    k2: FloatArray
    t: FloatArray


def closed_form(
    body: Suslov3D, omega0: ArrayLike, eps: ArrayLike, threads: int | None = None
) -> ClosedForm:
    """Constants h, k1 and k2 of the solution of Section 4, and t.

    With them and theta = k1 n eps + k2, state n of the orbit is
    x = sign(x_0) 2 sqrt(h I1 I2 / (I1 I2 - h eps**2)) / cosh(theta) and
    y = 2 sqrt(h I1 I2) tanh(theta), in the coordinates of :func:`to_xy`.

    Parameters
    ----------
    body : Suslov3D
        The body, or a batch of them.
    omega0 : array_like(float, shape=(..., 2))
        State 0; NaN for none.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega0; 0 gives the constants of the continuous motion.
    threads : int, optional
        Number of threads; by default Numba's.

    Returns
    -------
    ClosedForm
        A named tuple of arrays (...): h, in the unit of (I13 omega)**2, k1, in the unit of 1 / eps,
        k2, and t, the :func:`criticality`. k1 and k2 are NaN where t is not between -1 and 1, for
        there the solution is another; k2 is infinite on the line x = 0, and 0 at rest.

    Raises
    ------
    TypeError, ValueError
        If an argument is of another type or shape, or infinite.

    Notes
    -----
    h is the F of equation (i2), D = I13**2 I2 + I23**2 I1 times that of Lemma 1. k1 solves equation
    (k1), k1 = -(2 / eps) artanh t, and k2 belongs to t_0 = 0. In the theorem of the paper the
    prefactor must read 2 sqrt(h I1 I2), the denominator I23**2 I1 + I13**2 I2, and x be positive.

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import Suslov3D, closed_form, iterate, to_xy
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> h, k1, k2, t = closed_form(body, [1.0, 0.5], eps=0.2)
    >>> states = iterate(body, [1.0, 0.5], eps=0.2, steps=3).omega
    >>> to_xy(body, states)[:, 1].round(6)
    array([-0.95    , -1.030413, -1.102959, -1.167933])
    >>> (2 * np.sqrt(4 * h) * np.tanh(k1 * 0.2 * np.arange(4) + k2)).round(6)
    array([-0.95    , -1.030413, -1.102959, -1.167933])
    """
    constants = find("closed_form", body, omega0, eps, threads, "omega0")
    return ClosedForm(*(constants[..., k][()] for k in range(4)))
