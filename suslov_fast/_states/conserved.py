"""What is conserved, and which regime an orbit is in.

Every function takes states of any shape (..., D): one, a batch, or a whole run, time first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.nd import SuslovND
from .._bodies.reduction import first_integral as first_integral_nd
from .._bodies.reduction import reduce
from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .._core.cpu import observables, observables_nd
from .._engine.arguments import Body, check
from .._engine.observables import by_slabs, of_state, of_state_nd
from .._engine.threads import thread_count


def energy(body: Body, omega: ArrayLike, threads: int | None = None) -> FloatArray:
    """The energy, half the sum of J_i Omega_i**2, conserved by the continuous motion.

    In three dimensions it is (I1 Omega1**2 + I2 Omega2**2) / 2.

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
    (state,), batch = check(body, {"omega": omega}, later=True)
    count = thread_count(threads)
    if isinstance(body, SuslovND):
        return of_state_nd(observables_nd.energy, body, state, None, batch, count)
    return of_state(observables.energy, body, state, None, batch, count)


def first_integral(
    body: Body, omega: ArrayLike, eps: ArrayLike, threads: int | None = None
) -> FloatArray:
    """The first integral F of the map.

    F = (I1 Omega1**2 + I2 Omega2**2) / (4 I1 I2 + eps**2 (I13 Omega1 + I23 Omega2)**2). In more
    dimensions one is known where J I = b I and J = a on the vectors orthogonal to I:
    F = 2 E / (4 a b + eps**2 x**2), x = ``|I|`` times the part of omega orthogonal to I.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega : array_like(float, shape=(..., D))
        Angular velocities; NaN for states that do not exist, and so is the result.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.
    threads : int, optional
        Number of threads; by default what Numba is set to.

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
    (state, step_size), batch = check(body, {"omega": omega}, {"eps": eps}, later=True)
    count = thread_count(threads)
    if isinstance(body, SuslovND):
        reduce(body, "first_integral")
        return by_slabs(_first_integral_nd, body, state, step_size, batch)
    return of_state(observables.first_integral, body, state, step_size, batch, count)


def modified_energy(
    body: Body, omega: ArrayLike, eps: ArrayLike, threads: int | None = None
) -> FloatArray:
    """E**2 / (E + eps**2 f.Jf / 8), the energy that the map conserves, or nearly.

    E is the energy and f the vector field. In three dimensions this is 2 I1 I2 F, and it is
    conserved wherever :func:`first_integral` is known; for all other bodies up to an error of
    order eps**4, while that of E itself is of order eps**2.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega : array_like(float, shape=(..., D))
        Angular velocities; NaN for states that do not exist, and so is the result.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.
    threads : int, optional
        Number of threads; by default what Numba is set to.

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
    (state, step_size), batch = check(body, {"omega": omega}, {"eps": eps}, later=True)
    count = thread_count(threads)
    if isinstance(body, SuslovND):
        return of_state_nd(observables_nd.modified_energy, body, state, step_size, batch, count)
    return of_state(observables.modified_energy, body, state, step_size, batch, count)


def criticality(
    body: Body, omega: ArrayLike, eps: ArrayLike, threads: int | None = None
) -> FloatArray:
    """The number t = eps sqrt(h / (I1 I2)) that decides how an orbit of the map behaves.

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
        Number of threads; by default what Numba is set to.

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
    (state, step_size), batch = check(body, {"omega": omega}, {"eps": eps}, later=True)
    count = thread_count(threads)
    if isinstance(body, SuslovND):
        reduce(body, "criticality")
        return by_slabs(_criticality_nd, body, state, step_size, batch)
    return of_state(observables.criticality, body, state, step_size, batch, count)


def invariant_density(
    body: Suslov3D, omega: ArrayLike, eps: ArrayLike, threads: int | None = None
) -> FloatArray:
    """The density of the measure that the map preserves, in (Omega1, Omega2).

    rho = 1 / (x (4 I1 I2 + eps**2 x**2)), x = I13 Omega1 + I23 Omega2. Where J is the
    :func:`jacobian` at omega, rho(next omega) det J = rho(omega), signs included.

    Parameters
    ----------
    body : Suslov3D
        The body, or a batch of them.
    omega : array_like(float, shape=(..., 2))
        Angular velocities; NaN for states that do not exist, and so is the result.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega; 0 gives a density of the continuous motion.
    threads : int, optional
        Number of threads; by default what Numba is set to.

    Returns
    -------
    ndarray(float, shape=(...))
        In the unit of 1 / omega over that of inertia to the third power; it has the sign of x, and
        is infinite on the line x = 0 of steady states. A constant factor is free: here it is the
        one that makes this the density in (x, y) too.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.

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
    (state, step_size), batch = check(body, {"omega": omega}, {"eps": eps}, dimension=2, later=True)
    count = thread_count(threads)
    return of_state(observables.invariant_density, body, state, step_size, batch, count)


def _first_integral_nd(body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    if body.dimension == 2:
        reduction = reduce(body, "first_integral")
        return first_integral(reduction.three, reduction.state(omega), eps, threads=1)
    body, omega, eps, unit = _normal(body, omega, eps)
    reduction = reduce(body, "first_integral")
    value = first_integral_nd(reduction, omega, eps, energy(body, omega, threads=1))
    return _ldexp(value, unit)


def _criticality_nd(body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    if body.dimension > 2:
        body, omega, eps, _ = _normal(body, omega, eps)
    reduction = reduce(body, "criticality")
    return criticality(reduction.three, reduction.state(omega), eps, threads=1)


def _normal(
    body: SuslovND, omega: FloatArray, eps: FloatArray
) -> tuple[SuslovND, FloatArray, FloatArray, FloatArray]:
    """All in units of powers of two in which it is of the order of 1; the power that F has."""
    _, moments = np.frexp(body.J.max(axis=-1, keepdims=True))
    _, products = np.frexp(abs(body.I).max(axis=-1, keepdims=True))
    _, speeds = np.frexp(abs(omega).max(axis=-1, keepdims=True))
    # Positive, as a body's must be, however far apart they are.
    normal = SuslovND(np.maximum(_ldexp(body.J, -moments), 2.0**-900), _ldexp(body.I, -products))
    power = (speeds + products - moments)[..., 0]
    # Steps that long are all alike, and finite.
    step_size = np.clip(_ldexp(eps, power), -1e300, 1e300)
    return normal, _ldexp(omega, -speeds), step_size, (2 * speeds - moments)[..., 0]


def _ldexp(values: FloatArray, power: FloatArray) -> FloatArray:
    with np.errstate(all="ignore"):
        result: FloatArray = np.ldexp(values, power)
    return result
