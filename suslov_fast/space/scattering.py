"""The angle between the angular velocities in space at time -infinity and +infinity."""

from __future__ import annotations

import numpy as np

from ..bodies.rigid import Suslov3D
from ..checks import FloatArray, instance
from ..engine.arguments import refuse_rotor


def scattering_angle(body: Suslov3D) -> FloatArray:
    """Angle between the angular velocities in space at time -infinity and at +infinity.

    In the continuous problem every motion leaves one steady rotation and tends to another. The
    angle between them in space depends on the body, not on the energy.

    Parameters
    ----------
    body : Suslov3D
        A single one, or a batch.

    Returns
    -------
    ndarray(float, shape=(...))
        Angle in radians, from 0, if the body turns over, to pi, if its final orientation is
        the initial one; NaN if I13 = I23 = 0, because then every state is steady.

    Notes
    -----
    With D = I13**2 I2 + I23**2 I1, k**2 = I13**2 + I23**2, alpha = I1 I2 k / D,
    beta**2 = I1 I2 / k**2, gamma = beta I13 I23 (I2 - I1) / D and
    kappa**2 = (alpha - i gamma)**2 - beta**2,

    sin(angle / 2)**2 = (Re cosh(pi kappa / 2) / cosh(pi alpha / 2))**2
    + (Im cosh(pi kappa / 2) / sinh(pi alpha / 2))**2.

    The error is about 1e-15 (alpha + beta + abs(gamma)), below 1e-10 if I1 and I2 are within a
    factor of 1e8. The angle of the discrete problem converges to this one with order 2.

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
    refuse_rotor(body, "scattering_angle", "iterate or flow")
    instance("body", body, Suslov3D)
    with np.errstate(all="ignore"):  # I13 = I23 = 0 gives NaN; what underflows is 0
        angle = _angle(*np.broadcast_arrays(body.I1, body.I2, body.I13, body.I23))
    return angle[()]


def _angle(I1: FloatArray, I2: FloatArray, I13: FloatArray, I23: FloatArray) -> FloatArray:
    """Angle 2 arcsin |S|, by sums of positive terms.

    With A, P, Q = pi / 2 times alpha, p, q, where kappa = p + i q,

    |S|**2 = (cosh(P) cos(Q) / cosh(A))**2 + (sinh(P) sin(Q) / sinh(A))**2,
    1 - |S|**2 = sinh(A - P) sinh(A + P) ((cos(Q) / cosh(A))**2 + (sin(Q) / sinh(A))**2).
    """
    a, k = I1 * I2, np.hypot(I13, I23)
    D = I13 * (I13 * I2) + I23 * (I23 * I1)
    alpha, beta = a * (k / D), np.sqrt(a) / k
    gamma = abs(beta * (I13 * (I2 - I1) / D * I23))
    unit = np.maximum(np.maximum(alpha, beta), gamma)  # so that no square is out of range
    alpha, beta, gamma, unit = alpha / unit, beta / unit, gamma / unit, 0.5 * np.pi * unit
    size = np.hypot(alpha - beta, gamma) * np.hypot(alpha + beta, gamma)  # abs(kappa)**2
    square = (alpha - beta) * (alpha + beta) - gamma * gamma  # its real part
    larger = np.sqrt(0.5 * (size + abs(square)))
    smaller = np.where(larger > 0.0, alpha * gamma / larger, 0.0)
    p, q = np.where(square >= 0.0, (larger, smaller), (smaller, larger))
    # alpha**2 - p**2 is the smaller root of d**2 - total d + (alpha beta)**2, from which alpha - p
    # is accurate near p = alpha.
    total, root = alpha * alpha + beta * beta + gamma * gamma, alpha * beta
    gap = unit * (2.0 * root / (total + size) * root / (alpha + p))
    # All terms divided by exp(A).
    Q = np.fmod(unit * q, 2.0 * np.pi)
    cosine = np.cos(Q) / (1.0 + np.exp(-2.0 * unit * alpha))
    sine = np.sin(Q) / -np.expm1(-2.0 * unit * alpha)
    twice = -2.0 * unit * p
    S = np.exp(-gap) * np.hypot((1.0 + np.exp(twice)) * cosine, -np.expm1(twice) * sine)
    one = np.expm1(-2.0 * gap) * np.expm1(-2.0 * unit * (alpha + p))
    angle: FloatArray = 2.0 * np.arctan2(S, np.sqrt(one) * np.hypot(cosine, sine))
    return angle
