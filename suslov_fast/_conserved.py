"""What is conserved, and which regime an orbit is in."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from . import _nd
from ._bodies.nd import SuslovND
from ._bodies.reduction import first_integral as first_integral_nd
from ._bodies.reduction import reduce
from ._bodies.three import Suslov3D
from ._checks import FloatArray
from ._core.formulas import coordinates, integrals
from ._engine.arguments import Body, check, components
from ._engine.elementwise import evaluate


def energy(body: Body, omega: ArrayLike) -> FloatArray:
    """The energy, half the sum of J_i Omega_i**2, conserved by the continuous motion.

    In three dimensions it is (I1 Omega1**2 + I2 Omega2**2) / 2.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega : array_like(float, shape=(..., D))
        Angular velocities.

    Returns
    -------
    ndarray(float, shape=(...))
        In the unit of inertia times that of omega squared.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.

    Notes
    -----
    The energy integral of equation (s1). The map conserves :func:`first_integral` instead.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, energy
    >>> float(energy(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [1.0, 0.5]))
    2.125
    """
    (state,), batch = check(body, {"omega": omega})
    return energy_of(body, state, batch)


def energy_of(body: Body, state: FloatArray, batch: tuple[int, ...]) -> FloatArray:
    """The energy of states that are checked already, or that may hold NaN."""
    if isinstance(body, SuslovND):
        return np.broadcast_to(_nd.energy(body, state), batch).copy()[()]
    return evaluate(integrals.energy, batch, body.I1, body.I2, *components(state))


def first_integral(body: Body, omega: ArrayLike, eps: ArrayLike) -> FloatArray:
    """The first integral F of the map.

    F = (I1 Omega1**2 + I2 Omega2**2) / (4 I1 I2 + eps**2 (I13 Omega1 + I23 Omega2)**2). In more
    dimensions one is known where J I = b I and J = a on the vectors orthogonal to I:
    F = 2 E / (4 a b + eps**2 x**2), x = |I| times the part of omega orthogonal to I.

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
    ndarray(float, shape=(...))
        In the unit of omega squared over that of inertia.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.
    NotIntegrableError
        If no first integral is known for the body.

    Notes
    -----
    Lemma 1, equation (i1). The paper's second expression (i2) is this one times
    D = I13**2 I2 + I23**2 I1.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, first_integral, step
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> float(first_integral(body, [1.0, 0.5], eps=0.2).round(12))
    0.265344729629
    >>> float(first_integral(body, step(body, [1.0, 0.5], eps=0.2), eps=0.2).round(12))
    0.265344729629
    """
    (state, step_size), batch = check(body, {"omega": omega}, {"eps": eps})
    return first_integral_of(body, state, step_size, batch)


def first_integral_of(
    body: Body, state: FloatArray, step_size: FloatArray, batch: tuple[int, ...]
) -> FloatArray:
    """F of states that are checked already, or that may hold NaN."""
    if isinstance(body, SuslovND):
        E = energy_of(body, state, batch)
        return first_integral_nd(reduce(body, "first_integral"), state, step_size, E)
    X = _canonical(body, state, step_size, batch)[..., 0]
    return evaluate(integrals.first_integral, batch, body.I1, body.I2, X, *components(state))


def modified_energy(body: Body, omega: ArrayLike, eps: ArrayLike) -> FloatArray:
    """E**2 / (E + eps**2 f.Jf / 8), the energy that the map conserves, or nearly.

    E is the energy and f the vector field. In three dimensions this is 2 I1 I2 F, and it is
    conserved wherever :func:`first_integral` is known; for all other bodies up to an error of
    order eps**4, while that of E itself is of order eps**2.

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
    ndarray(float, shape=(...))
        In the unit of inertia times that of omega squared.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.

    Notes
    -----
    In three dimensions Lemma 1 in another unit. For n > 3 and general J no rational first integral
    was found, of degree up to 10 for n = 4.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, modified_energy, step
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> float(modified_energy(body, [1.0, 0.5], eps=0.2).round(12))
    2.122757837035
    >>> float(modified_energy(body, step(body, [1.0, 0.5], eps=0.2), eps=0.2).round(12))
    2.122757837035
    """
    (state, step_size), batch = check(body, {"omega": omega}, {"eps": eps})
    return modified_energy_of(body, state, step_size, batch)


def modified_energy_of(
    body: Body, state: FloatArray, step_size: FloatArray, batch: tuple[int, ...]
) -> FloatArray:
    """The modified energy of states that are checked already, or that may hold NaN."""
    if isinstance(body, SuslovND):
        return _nd.modified_energy(body, state, step_size)
    X = _canonical(body, state, step_size, batch)[..., 0]
    return evaluate(integrals.modified_energy, batch, energy_of(body, state, batch), X)


def criticality(body: Body, omega: ArrayLike, eps: ArrayLike) -> FloatArray:
    """The number t = eps sqrt(h / (I1 I2)) that decides how an orbit of the map behaves.

    With -1 < t < 1 the orbit follows the continuous motion; otherwise the step is too long
    for that, and the orbit jumps across the line of steady states. t is constant along an orbit.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega : array_like(float, shape=(..., D))
        Angular velocities.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega; t has its sign.

    Returns
    -------
    ndarray(float, shape=(...))
        t, dimensionless.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.
    NotIntegrableError
        If no first integral is known for the body.

    Notes
    -----
    h is the integral of equation (i2), the one that Section 4 of the paper uses.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, criticality
    >>> body = Suslov3D(I1=3, I2=3, I13=-0.2, I23=-0.2)
    >>> criticality(body, [[1, 2], [-40, -250]], eps=1).round(4)
    array([0.1049, 1.2281])
    """
    (state, step_size), batch = check(body, {"omega": omega}, {"eps": eps})
    if isinstance(body, SuslovND):
        reduction = reduce(body, "criticality")
        return criticality(reduction.three, reduction.state(state), step_size)
    XY = _canonical(body, state, step_size, batch)
    level = evaluate(integrals.level, batch, *components(XY))
    # Rounding must not carry an orbit across the border: |t| < 1 exactly where |Y| < 1.
    below = np.nextafter(1.0, 0.0)
    level = np.where(abs(XY[..., 1]) < 1.0, np.minimum(level, below), np.maximum(level, 1.0))
    return np.copysign(level, step_size)


def _canonical(
    body: Suslov3D, state: FloatArray, step_size: FloatArray, batch: tuple[int, ...]
) -> FloatArray:
    """The dimensionless coordinates (X, Y)."""
    parameters = (*body.normalised, body.normalised_eps(step_size))
    return evaluate(coordinates.to_canonical, batch, *parameters, *components(state))[..., :2]
