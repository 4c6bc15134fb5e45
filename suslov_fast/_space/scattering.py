"""Angle in space between the two steady rotations of a motion."""

from __future__ import annotations

import math

import numpy as np

from .._bodies.three import Suslov3D
from .._checks import FloatArray, instance
from .._docs import filled
from .._engine import threads as _threads
from .._engine.layout import for_kernel
from .._kernels import scattering as kernels

# Cost of an angle, in steps of the map.
_WORK = 100


@filled
def scattering_angle(body: Suslov3D, *, threads: int | None = None) -> FloatArray:
    """Angle in space between the angular velocities at time -infinity and at +infinity.

    In the continuous problem every motion leaves one steady rotation and tends to another. The
    angle between them in space depends on the body, not on the energy.

    Parameters
    ----------
    %(body_3d)s
    %(threads)s

    Returns
    -------
    ndarray(float, shape=(...))
        Angle in radians, from 0, if the body turns over, to pi, if its final orientation is
        the initial one; NaN if I13 = I23 = 0, because then every state is steady.

    Raises
    ------
    %(invalid)s

    Notes
    -----
    With D = I13**2 I2 + I23**2 I1, k**2 = I13**2 + I23**2, alpha = I1 I2 k / D,
    beta**2 = I1 I2 / k**2, gamma = beta I13 I23 (I2 - I1) / D and
    kappa**2 = (alpha - i gamma)**2 - beta**2,

    sin(angle / 2)**2 = (Re cosh(pi kappa / 2) / cosh(pi alpha / 2))**2
    + (Im cosh(pi kappa / 2) / sinh(pi alpha / 2))**2.

    The error is about 1e-15 (alpha + beta + abs(gamma)), times the angle if that is
    exponentially small: the formula amplifies the rounding of the body's parameters. It is below
    1e-10 if I1 and I2 are within a factor of 1e8 of each other, for any I13 and I23. The angle
    of the discrete problem converges to this one with order 2.

    References
    ----------
    .. [1] Yu. N. Fedorov, A. J. Maciejewski, M. Przybylska, "The Poisson equations in the
       nonholonomic Suslov problem: integrability, meromorphic and hypergeometric solutions",
       Nonlinearity 22 (2009), arXiv:0902.0079: the angle where gamma = 0.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, scattering_angle
    >>> float(scattering_angle(Suslov3D(I1=4, I2=1, I13=-1.5, I23=-0.3)).round(12))
    1.221073798141
    """
    instance("body", body, Suslov3D)
    threads = _threads.thread_count(threads)
    parameters = tuple(
        for_kernel(np.broadcast_to(each, body.shape).reshape(-1)) for each in body.parameters
    )
    angles = np.empty(math.prod(body.shape))
    _threads.run(kernels.scatter, angles.size * _WORK, threads, parameters, angles)
    return angles.reshape(body.shape)[()]
