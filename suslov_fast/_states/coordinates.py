"""The paper's coordinates (x, y)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .._docs import filled
from .table import find


@filled
def to_xy(body: Suslov3D, omega: ArrayLike, threads: int | None = None) -> FloatArray:
    """Coordinates x = I13 Omega1 + I23 Omega2 and y = I23 I1 Omega1 - I13 I2 Omega2.

    The steady states are the line x = 0. x is accurate to rounding next to that line too.

    Parameters
    ----------
    %(body_3d)s
    %(omega_3d)s
    %(threads)s

    Returns
    -------
    ndarray(float, shape=(..., 2))
        x, in the unit of inertia times that of omega, and y, in that of inertia squared times that
        of omega.

    Raises
    ------
    %(invalid)s

    Notes
    -----
    Section 4 of the paper, equation (7).

    Examples
    --------
    >>> from suslov_fast import Suslov3D, to_xy
    >>> to_xy(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25), [1.0, 0.5])
    array([-0.625, -0.75 ])
    """
    return find("to_xy", body, omega, None, threads)


@filled
def from_xy(body: Suslov3D, xy: ArrayLike, threads: int | None = None) -> FloatArray:
    """Angular velocities from coordinates (x, y), the inverse of :func:`to_xy`.

    Parameters
    ----------
    %(body_3d)s
        I13 and I23 must not both be 0.
    xy : array_like(float, shape=(..., 2))
        Coordinates (x, y). Where one is NaN, so is the result.
    %(threads)s

    Returns
    -------
    ndarray(float, shape=(..., 2))
        (Omega1, Omega2).

    Raises
    ------
    %(invalid)s

    Examples
    --------
    >>> from suslov_fast import Suslov3D, from_xy
    >>> from_xy(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25), [-0.625, -0.75])
    array([1. , 0.5])
    """
    if isinstance(body, Suslov3D) and np.any((np.asarray(body.I13) == 0) & (body.I23 == 0)):
        raise ValueError(
            "body: expected I13 or I23 other than 0, got both 0, where (x, y) is 0 for every omega"
        )
    return find("from_xy", body, xy, None, threads, "xy")
