"""Conserved quantities, the invariant measure, and the coordinates and constants of Section 4."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.classes import AnyBody, BodyIn3D, BodyOrField
from ..bodies.rigid import Suslov3D
from ..checks import FloatArray, Reals
from ..engine.problem import check
from ..keywords import public
from ..maps import map_of, problem
from .evaluation import evaluate, mask_and_warn


@public
def energy(system: BodyOrField, x: ArrayLike, /) -> FloatArray:
    """Hamiltonian H of a field, or energy of a body: half the sum of J_i Omega_i**2.

    The motion conserves it; along orbits of the map it varies by O(eps**2), because the map
    conserves the :func:`modified_energy`. In three dimensions J_1 and J_2 are I1 and I2.

    Parameters
    ----------
    system, x
        As in :func:`jacobian`; a field must come from `from_hamiltonian` of its class.

    Returns
    -------
    ndarray(float, shape=(...))
        H; for a body, unit inertia * omega**2.

    Examples
    --------
    >>> from suslov_fast import Field, energy
    >>> well = Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 - x[0] + x[0] ** 3, 2)
    >>> energy(well, [[0.5, 0.0], [0.0, 0.5]])
    array([-0.375,  0.125])
    """
    return evaluate("energy", system, x)


@public
def first_integral(body: AnyBody, omega: ArrayLike, /, eps: Reals) -> FloatArray:
    """First integral F of the map of a body, which is constant along its orbits.

    In three dimensions F = (I1 Omega1**2 + I2 Omega2**2) / (4 I1 I2 + eps**2 x**2), with
    x = I13 Omega1 + I23 Omega2 (+ k for a gyrostat). In n dimensions F is that of the two
    coordinates to which :meth:`SuslovND.reduced` takes the body, or the energy over 2 a b where
    I = 0, with the first two different J.

    Parameters
    ----------
    body, omega, eps
        As in :func:`jacobian`, without fields.

    Returns
    -------
    ndarray(float, shape=(...))
        Unit: omega**2 / inertia.

    Raises
    ------
    NotIntegrableError
        If no F is known for the body. Its :func:`modified_energy` is nearly conserved.
    TypeError
        For a field: `suslov_fast.integrability.report` looks for its integrals.

    Notes
    -----
    Lemma 1 of Dragovic and Gajic, arXiv:0807.2966.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, first_integral, iterate
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> orbit = iterate(body, [1.0, 0.5], eps=0.2, steps=10_000).states
    >>> F = first_integral(body, orbit, eps=0.2)
    >>> float(F[0].round(9)), bool(abs(F / F[0] - 1).max() < 1e-12)
    (0.26534473, True)
    """
    return evaluate("first_integral", body, omega, eps)


@public
def modified_energy(system: BodyOrField, x: ArrayLike, /, eps: Reals) -> FloatArray:
    """Modified energy, which the map conserves and which tends to the energy as eps -> 0.

    For a field with a Hamiltonian H it is H + (eps / 3) grad H . A**-1 f, with the vector field f
    and the :func:`matrix` A, and the map conserves it exactly. For a body it is
    E**2 / (E + eps**2 f.Jf / 8), with the :func:`energy` E: exactly conserved where
    :func:`first_integral` is known (in three dimensions it is 2 I1 I2 F), for other bodies up to
    an error of order eps**4. Methods of higher order do not conserve it, because they combine steps
    of several sizes.

    Parameters
    ----------
    system, x, eps
        As in :func:`jacobian`; a field must come from :meth:`Field.from_hamiltonian`.

    Returns
    -------
    ndarray(float, shape=(...))
        Unit: that of the :func:`energy`. NaN, with one :class:`IntegrationWarning`, for a state of
        a field on a pole of the map.

    Notes
    -----
    For fields: Celledoni, McLachlan, Owren and Quispel, arXiv:1209.1164.

    Examples
    --------
    >>> from suslov_fast import Field, iterate, modified_energy
    >>> well = Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 - x[0] + x[0] ** 3, 2)
    >>> orbit = iterate(well, [0.5, 0.0], eps=0.1, steps=100_000).states
    >>> H = modified_energy(well, orbit, eps=0.1)
    >>> bool(abs(H - H[0]).max() < 1e-12)
    True
    """
    return evaluate("modified_energy", system, x, eps)


@public
def criticality(body: AnyBody, omega: ArrayLike, /, eps: Reals) -> FloatArray:
    """Criticality t of a body, which decides whether an orbit of the map follows the motion.

    Keep ``|t| < 1``: otherwise the orbit can jump across the line of steady states and meet a
    pole. t = eps sqrt(h / (I1 I2)) is constant along an orbit, where h is I13**2 I2 + I23**2 I1
    times the :func:`first_integral`.

    Parameters
    ----------
    body, omega, eps
        As in :func:`jacobian`; the body has a :func:`first_integral`.

    Returns
    -------
    ndarray(float, shape=(...))
        t, dimensionless, with the sign of eps.

    Raises
    ------
    NotIntegrableError, TypeError
        If the body has no :func:`first_integral`, or is a field.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, criticality
    >>> body = Suslov3D(I1=3, I2=3, I13=-0.2, I23=-0.2)
    >>> criticality(body, [[1, 2], [-40, -250]], eps=1).round(4)
    array([0.1049, 1.2281])
    """
    return evaluate("criticality", body, omega, eps)


@public
def rotation_number(body: BodyIn3D, omega: ArrayLike, /, eps: Reals) -> FloatArray:
    """Rotation number of an orbit of a gyrostat: mean number of turns per step of the map.

    With e = eps / (2 sqrt(I1 I2)) and the :func:`criticality` e A, it is
    sign(k) arctan(e sqrt(k**2 - A**2)) / pi, and 0 where orbits go from one steady state to
    another. The angle counted is the argument of z / (1 - i e l), with
    z = sqrt(I1) Omega1 + i sqrt(I2) Omega2 and l = I13 Omega1 + I23 Omega2 + k; if abs(e) A < 1,
    Omega makes as many turns.

    Parameters
    ----------
    body, omega, eps
        As in :func:`jacobian`; the body is a `SuslovGyrostat`, or a `Suslov3D` as one with k = 0.

    Returns
    -------
    ndarray(float, shape=(...))
        Turns, dimensionless, between -1/2 and 1/2, with the sign of k eps.

    Examples
    --------
    >>> from suslov_fast import SuslovGyrostat, rotation_number
    >>> body = SuslovGyrostat(I1=2.3, I2=1.4, I13=0.5, I23=-0.7, k=[0.0, 0.9, 1.8])
    >>> rotation_number(body, [1.1, -0.4], eps=0.35).round(6)
    array([0.      , 0.      , 0.043038])
    """
    return evaluate("rotation_number", body, omega, eps)


@public
def invariant_density(system: BodyOrField, x: ArrayLike, /, eps: Reals) -> FloatArray:
    """Density rho of an invariant measure: rho(x_next) det(jacobian at x) = rho(x).

    For a field with a Hamiltonian rho = 1 / det A, with the :func:`matrix` A. For a body in three
    dimensions rho = 1 / (l (4 I1 I2 + eps**2 l**2)) with l = I13 Omega1 + I23 Omega2 (+ k for a
    gyrostat). In n dimensions rho is known if :meth:`SuslovND.reduced` leaves two coordinates,
    or three of which one has a coupling. For n = 4 and I = (I1, 0, 0) it is
    1 / (w2 w3 (1 - (eps I1)**2 (J1 w1**2 - (J3 - J2) (w2**2 - w3**2)) / (4 J1 J2 J3))). A remainder
    w_E0 of k dimensions adds the factor ``1 / |w_E0|**(k - 1)``: for odd k > 1 the identity above
    holds up to a sign. Where I = 0, rho = 1. Methods of higher order do not have these measures.

    Parameters
    ----------
    system, x, eps
        As in :func:`jacobian`; eps = 0 is the continuous motion.

    Returns
    -------
    ndarray(float, shape=(...))
        For a field dimensionless, and infinite at poles. For a body in three dimensions the unit is
        1 / (omega * inertia**3); the sign is that of l, and the density is infinite where l = 0.
        For n = 4 with three coordinates the unit is 1 / omega**2.

    Raises
    ------
    NotIntegrableError
        If no invariant measure is known for the body.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, invariant_density
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> float(invariant_density(body, [1.0, 0.5], eps=0.2).round(9))
    -0.096052391
    """
    return evaluate("invariant_density", system, x, eps)


@public
def to_xy(body: Suslov3D, omega: ArrayLike, /) -> FloatArray:
    """Coordinates x = I13 Omega1 + I23 Omega2 and y = I23 I1 Omega1 - I13 I2 Omega2 of a state.

    Equation (7) of Dragovic and Gajic, arXiv:0807.2966. In them the equations of motion are
    ``x' = x y / (I1 I2)`` and ``y' = -x**2`` (Remark 2). The steady states are the line x = 0.

    Parameters
    ----------
    body, omega
        As in :func:`jacobian`; the body is a `Suslov3D`.

    Returns
    -------
    ndarray(float, shape=(..., 2))
        x, unit inertia * omega, and y, unit inertia**2 * omega.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, to_xy
    >>> to_xy(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25), [1.0, 0.5])
    array([-0.625, -0.75 ])
    """
    return evaluate("to_xy", body, omega)


@public
def from_xy(body: Suslov3D, xy: ArrayLike, /) -> FloatArray:
    """Angular velocity (Omega1, Omega2) with given coordinates (x, y): inverse of :func:`to_xy`.

    Parameters
    ----------
    body : Suslov3D
        A single body, or a batch.
    xy : array_like(float, shape=(..., 2))
        Coordinates x and y of :func:`to_xy`, in its units. NaN gives NaN.

    Returns
    -------
    ndarray(float, shape=(..., 2))
        Omega1 and Omega2.

    Raises
    ------
    ValueError
        If I13 = I23 = 0, because then x = y = 0 for every omega.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, from_xy
    >>> from_xy(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25), [-0.625, -0.75])
    array([1. , 0.5])
    """
    map = map_of(body)
    map.require("from_xy", body)
    if np.any((body.I13 == 0) & (body.I23 == 0)):
        raise ValueError("body: x and y are defined only where I13 or I23 is other than 0")
    checked = check(map, body, xy, name="xy", components=("x", "y"), later=True)
    return mask_and_warn(checked, map.formulas["from_xy"].compute(checked))


class ClosedForm(NamedTuple):
    """Constants of a solution, as :func:`closed_form` returns them; each has the shape (...).

    The integral h has the unit (inertia * omega)**2 and the rate k1 the unit 1 / eps; the phase k2
    and the criticality t are dimensionless.
    """

    h: FloatArray  # equation (9)
    k1: FloatArray  # equation (12)
    k2: FloatArray  # Theorem 1
    t: FloatArray

    def __repr__(self) -> str:
        """Return the constants as text; those of one orbit as numbers, not as np.float64(...)."""
        parts = [value if np.ndim(value) else float(value) for value in self]
        return f"ClosedForm(h={parts[0]}, k1={parts[1]}, k2={parts[2]}, t={parts[3]})"


@public
def closed_form(body: Suslov3D, omega0: ArrayLike, /, eps: Reals) -> ClosedForm:
    """Constants h, k1 and k2 of the closed form of an orbit of a body, and its criticality t.

    In the coordinates of :func:`to_xy`, with theta = k1 n eps + k2, state n of the orbit is
    x = sign(x_0) 2 sqrt(h I1 I2 / (I1 I2 - h eps**2)) / cosh(theta) and
    y = 2 sqrt(h I1 I2) tanh(theta), where k1 = -(2 / eps) artanh t. :func:`exact` evaluates it.

    Parameters
    ----------
    body, omega0, eps
        As in :func:`jacobian`; the body is a `Suslov3D`, and eps = 0 is the continuous motion.

    Returns
    -------
    ClosedForm
        Named tuple of arrays (...): h, unit (inertia * omega)**2; k1, unit 1 / eps;
        k2, dimensionless; and t, the :func:`criticality`. k1 and k2 are NaN where t is not between
        -1 and 1. k2 is infinite on the line x = 0, and 0 at rest.

    Notes
    -----
    h is the integral of equation (9) of Dragovic and Gajic, arXiv:0807.2966; k1 solves equation
    (12), and k2 is that of Theorem 1 for positive x, with two corrections: the prefactor
    2 sqrt(h I1 I2) and the denominator I23**2 I1 + I13**2 I2.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, closed_form
    >>> constants = closed_form(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [1.0, 0.5], eps=0.2)
    >>> float(constants.k1.round(6)), float(constants.t.round(6))
    (-0.402536, 0.040232)
    """
    checked = problem("closed_form", body, omega0, eps, name="omega0")
    return ClosedForm(*checked.map.formulas["closed_form"].compute(checked))
