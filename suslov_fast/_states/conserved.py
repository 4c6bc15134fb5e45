"""Conserved quantities and the invariant measure.

States have any shape (..., D): one, a batch, or a whole run, time first.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from .._checks import FloatArray
from .table import find


def energy(body: Any, omega: ArrayLike, threads: int | None = None) -> FloatArray:
    """Energy, half the sum of J_i Omega_i**2, conserved by the continuous motion.

    In three dimensions it is (I1 Omega1**2 + I2 Omega2**2) / 2. The map conserves
    :func:`first_integral` instead.

    Parameters
    ----------
    body : Suslov3D, SuslovND or SuslovGyrostat
        The body, or a batch of them.
    omega : array_like(float, shape=(..., D))
        Angular velocities; NaN for states that do not exist, and so is the result.
    threads : int, optional
        Number of threads; by default Numba's.

    Returns
    -------
    ndarray(float, shape=(...))
        In the unit of inertia times that of omega squared.

    Raises
    ------
    TypeError, ValueError
        If an argument is of another type or shape, or infinite.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, energy
    >>> float(energy(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [1.0, 0.5]))
    2.125
    """
    return find("energy", body, omega, None, threads)


def first_integral(
    body: Any, omega: ArrayLike, eps: ArrayLike, threads: int | None = None
) -> FloatArray:
    """First integral F of the map.

    F = (I1 Omega1**2 + I2 Omega2**2) / (4 I1 I2 + eps**2 x**2), x = I13 Omega1 + I23 Omega2, to
    which a gyrostat adds k. In more dimensions F is known where J I = b I and J = a on the vectors
    orthogonal to I: F = 2 E / (4 a b + eps**2 x**2), x = ``|I|`` times the part of omega orthogonal
    to I.

    Parameters
    ----------
    body : Suslov3D, SuslovND or SuslovGyrostat
        The body, or a batch of them.
    omega : array_like(float, shape=(..., D))
        Angular velocities; NaN for states that do not exist, and so is the result.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.
    threads : int, optional
        Number of threads; by default Numba's.

    Returns
    -------
    ndarray(float, shape=(...))
        In the unit of omega squared over that of inertia.

    Raises
    ------
    TypeError, ValueError
        If an argument is of another type or shape, or infinite.
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
    return find("first_integral", body, omega, eps, threads)


def modified_energy(
    body: Any, omega: ArrayLike, eps: ArrayLike, threads: int | None = None
) -> FloatArray:
    """Modified energy E**2 / (E + eps**2 f.Jf / 8), f the vector field.

    In three dimensions it is 2 I1 I2 F. The map conserves it wherever :func:`first_integral` is
    known, and for all other bodies up to an error of order eps**4; that of E is of order eps**2.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega : array_like(float, shape=(..., D))
        Angular velocities; NaN for states that do not exist, and so is the result.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.
    threads : int, optional
        Number of threads; by default Numba's.

    Returns
    -------
    ndarray(float, shape=(...))
        In the unit of inertia times that of omega squared.

    Raises
    ------
    TypeError, ValueError
        If an argument is of another type or shape, or infinite.

    Notes
    -----
    In three dimensions Lemma 1 in another unit. For n > 3 and general J no first integral is known.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, modified_energy, step
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> float(modified_energy(body, [1.0, 0.5], eps=0.2).round(12))
    2.122757837035
    >>> float(modified_energy(body, step(body, [1.0, 0.5], eps=0.2), eps=0.2).round(12))
    2.122757837035
    """
    return find("modified_energy", body, omega, eps, threads)


def criticality(
    body: Any, omega: ArrayLike, eps: ArrayLike, threads: int | None = None
) -> FloatArray:
    """Number t = eps sqrt(h / (I1 I2)), which decides the regime of an orbit of the map.

    With -1 < t < 1 the orbit follows the continuous motion; otherwise the step is too long
    for that, and the orbit jumps across the line of steady states. t is constant along an orbit.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega : array_like(float, shape=(..., D))
        Angular velocities; NaN for states that do not exist, and so is the result.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega; t has its sign.
    threads : int, optional
        Number of threads; by default Numba's.

    Returns
    -------
    ndarray(float, shape=(...))
        t, dimensionless.

    Raises
    ------
    TypeError, ValueError
        If an argument is of another type or shape, or infinite.
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
    return find("criticality", body, omega, eps, threads)


def invariant_density(
    body: Any, omega: ArrayLike, eps: ArrayLike, threads: int | None = None
) -> FloatArray:
    """Density of the invariant measure of the map, in (Omega1, Omega2).

    rho = 1 / (x (4 I1 I2 + eps**2 x**2)), x = I13 Omega1 + I23 Omega2, to which a gyrostat adds k.
    Where J is the :func:`jacobian` at omega, rho(next omega) det J = rho(omega), signs included.

    Parameters
    ----------
    body : Suslov3D or SuslovGyrostat
        The body, or a batch of them.
    omega : array_like(float, shape=(..., 2))
        Angular velocities; NaN for states that do not exist, and so is the result.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega; 0 gives a density of the continuous motion.
    threads : int, optional
        Number of threads; by default Numba's.

    Returns
    -------
    ndarray(float, shape=(...))
        In the unit of 1 / omega over that of inertia to the third power; it has the sign of x, and
        is infinite on the line x = 0 of steady states. A constant factor is free: here it is the
        one that makes this the density in (x, y) too.

    Raises
    ------
    TypeError, ValueError
        If an argument is of another type or shape, or infinite.

    Notes
    -----
    The paper names no measure; that of equation (xy1) is dx dy / (x (4 I1 I2 + eps**2 x**2)).

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import Suslov3D, invariant_density, jacobian, step
    >>> body, omega = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [1.0, 0.5]
    >>> float(invariant_density(body, omega, eps=0.2).round(9))
    -0.096052391
    >>> after = invariant_density(body, step(body, omega, eps=0.2), eps=0.2)
    >>> float((after * np.linalg.det(jacobian(body, omega, eps=0.2))).round(9))
    -0.096052391
    """
    return find("invariant_density", body, omega, eps, threads)
