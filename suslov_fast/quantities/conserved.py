"""Conserved quantities and the invariant measure."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from ..bodies.field import QuadraticField
from ..bodies.nd import SuslovND, check_measure, check_solved
from ..checks import FloatArray, wrong
from ..core import quantities as formulas
from ..core import quantities_field as fields
from ..engine.arguments import AnyBody, BodyIn3D, BodyOrField, States
from ..maps import states_after
from .evaluation import by_terms, evaluate


def energy(body: BodyOrField, omega: ArrayLike) -> FloatArray:
    """Energy, half the sum of J_i Omega_i**2, conserved by the continuous motion; H of a field.

    Parameters
    ----------
    body : Suslov3D, SuslovND, SuslovGyrostat or QuadraticField
        A single one, or a batch; a field has to be made by `QuadraticField.from_hamiltonian`.
    omega : array_like(float, shape=(..., D))
        States.

    Returns
    -------
    ndarray(float, shape=(...))
        In the unit of inertia times that of omega squared; of a field, in the unit of H.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, energy
    >>> float(energy(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [1.0, 0.5]))
    2.125
    """
    given = {"omega": omega}
    return evaluate(body, given, formulas.energy, formulas.energy_nd, _hamiltonian)


def _hamiltonian(states: States) -> FloatArray:
    return by_terms(fields.hamiltonian, states, terms=_terms_of(states.body))


def _terms_of(field: QuadraticField) -> Any:
    if field.H is None:
        expected = "a field with a Hamiltonian, made by QuadraticField.from_hamiltonian"
        raise wrong("body", expected, "one without", TypeError)
    return field.H.terms


def first_integral(body: AnyBody, omega: ArrayLike, eps: ArrayLike) -> FloatArray:
    """First integral F of the map.

    In three dimensions F = (I1 Omega1**2 + I2 Omega2**2) / (4 I1 I2 + eps**2 x**2) with
    x = I13 Omega1 + I23 Omega2 (+ k for a gyrostat). In n dimensions F is known if J I = b I and
    J = a on the vectors orthogonal to I: F = 2 E / (4 a b + eps**2 x**2), where x is ``|I|`` times
    the length of the component of omega orthogonal to I.

    Parameters
    ----------
    body : Suslov3D, SuslovND or SuslovGyrostat
        A single one, or a batch.
    omega : array_like(float, shape=(..., D))
        States.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.

    Returns
    -------
    ndarray(float, shape=(...))
        In the unit of omega squared over that of inertia.

    Raises
    ------
    NotIntegrableError
        If no first integral is known for the body; :func:`modified_energy` is nearly conserved.

    Notes
    -----
    Lemma 1 of the paper, equation (6).

    Examples
    --------
    >>> from suslov_fast import Suslov3D, first_integral, step
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> first_integral(body, [[1.0, 0.5], step(body, [1.0, 0.5], eps=0.2)], eps=0.2).round(9)
    array([0.26534473, 0.26534473])
    """
    if isinstance(body, SuslovND):
        check_solved(body, "first_integral")
    given, in_nd = {"omega": omega, "eps": eps}, formulas.first_integral_nd
    return evaluate(body, given, formulas.first_integral, in_nd)


def modified_energy(body: BodyOrField, omega: ArrayLike, eps: ArrayLike) -> FloatArray:
    """Modified energy E**2 / (E + eps**2 f.Jf / 8), where f is the vector field.

    The map conserves it wherever :func:`first_integral` is known (in three dimensions it is
    2 I1 I2 F), and for every other body up to an error of order eps**4; the error of E is of order
    eps**2. For a field with a Hamiltonian H it is H + (eps / 3) grad H . A**-1 f, with the
    :func:`matrix` A, which the map conserves exactly.

    Parameters
    ----------
    body : Suslov3D, SuslovND, SuslovGyrostat or QuadraticField
        A single one, or a batch; a field has to be made by `QuadraticField.from_hamiltonian`.
    omega : array_like(float, shape=(..., D))
        States.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.

    Returns
    -------
    ndarray(float, shape=(...))
        In the unit of the :func:`energy`. NaN, with one :class:`SingularStepWarning`, where a state
        of a field has no next state.

    Notes
    -----
    That of a field is due to Celledoni, McLachlan, Owren and Quispel (2013), arXiv:1209.1164. With
    the Hamiltonian as a symmetric trilinear form in (x, 1) it is H(x, x, x_next).

    Examples
    --------
    >>> from suslov_fast import Suslov3D, modified_energy, step
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> modified_energy(body, [[1.0, 0.5], step(body, [1.0, 0.5], eps=0.2)], eps=0.2).round(6)
    array([2.122758, 2.122758])
    """
    given, in_nd = {"omega": omega, "eps": eps}, formulas.modified_energy_nd
    return evaluate(body, given, formulas.modified_energy, in_nd, _modified_hamiltonian)


def _modified_hamiltonian(states: States) -> FloatArray:
    terms = _terms_of(states.body)
    return by_terms(fields.polarised_hamiltonian, states, states_after(states), terms=terms)


def criticality(body: AnyBody, omega: ArrayLike, eps: ArrayLike) -> FloatArray:
    """Criticality t = eps sqrt(h / (I1 I2)), which determines the regime of an orbit of the map.

    It is constant along an orbit, and has the sign of eps. If -1 < t < 1, the orbit follows the
    continuous motion; otherwise it jumps across the line of steady states, and can meet a pole.

    Parameters
    ----------
    body : Suslov3D, SuslovND or SuslovGyrostat
        A single one, or a batch.
    omega : array_like(float, shape=(..., D))
        States.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.

    Returns
    -------
    ndarray(float, shape=(...))
        t, dimensionless.

    Raises
    ------
    NotIntegrableError
        If no first integral is known for the body.

    Notes
    -----
    h is the integral of equation (9) of the paper, I13**2 I2 + I23**2 I1 times the
    :func:`first_integral` F. With a rotor t = e A, with e = eps / (2 sqrt(I1 I2)) and
    A**2 = 4 I1 I2 F (I13**2 / I1 + I23**2 / I2); without one that is the same.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, criticality
    >>> body = Suslov3D(I1=3, I2=3, I13=-0.2, I23=-0.2)
    >>> criticality(body, [[1, 2], [-40, -250]], eps=1).round(4)
    array([0.1049, 1.2281])
    """
    if isinstance(body, SuslovND):
        check_solved(body, "criticality")
    given, in_nd = {"omega": omega, "eps": eps}, formulas.criticality_nd
    return evaluate(body, given, formulas.criticality, in_nd)


def rotation_number(body: BodyIn3D, omega: ArrayLike, eps: ArrayLike) -> FloatArray:
    """Rotation number of an orbit of the map of a gyrostat: turns of its phase per step.

    It is constant along an orbit, and 0 where orbits go from one steady state to another.

    Parameters
    ----------
    body : Suslov3D or SuslovGyrostat
        A single one, or a batch.
    omega : array_like(float, shape=(..., 2))
        States.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.

    Returns
    -------
    ndarray(float, shape=(...))
        Turns, dimensionless, between -1/2 and 1/2, with the sign of k eps.

    Notes
    -----
    With z = sqrt(I1) Omega1 + i sqrt(I2) Omega2, l = I13 Omega1 + I23 Omega2 + k and the e and A of
    :func:`criticality` it is sign(k) arctan(e sqrt(k**2 - A**2)) / pi turns of the argument of
    z / (1 - i e l). If abs(e) A < 1, Omega turns as often. It is not in the paper.

    Examples
    --------
    >>> from suslov_fast import SuslovGyrostat, rotation_number
    >>> body = SuslovGyrostat(I1=2.3, I2=1.4, I13=0.5, I23=-0.7, k=[0.0, 0.9, 1.8])
    >>> rotation_number(body, [1.1, -0.4], eps=0.35).round(6)
    array([0.      , 0.      , 0.043038])
    """
    return evaluate(body, {"omega": omega, "eps": eps}, formulas.rotation_number)


def invariant_density(body: BodyOrField, omega: ArrayLike, eps: ArrayLike) -> FloatArray:
    """Density of an invariant measure of the map.

    rho = 1 / (x (4 I1 I2 + eps**2 x**2)) with x = I13 Omega1 + I23 Omega2 (+ k for a gyrostat); for
    a field with a Hamiltonian 1 / det A, with the :func:`matrix` A. In n dimensions one is known
    for n = 3, and for n = 4 with I along one axis. With the :func:`jacobian` J at omega,
    rho(next omega) det J = rho(omega), signs included; eps = 0 is the continuous motion.

    Parameters
    ----------
    body : Suslov3D, SuslovND, SuslovGyrostat or QuadraticField
        A single one, or a batch; a field has to be made by `QuadraticField.from_hamiltonian`.
    omega : array_like(float, shape=(..., D))
        States.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.

    Returns
    -------
    ndarray(float, shape=(...))
        In three dimensions in the unit of 1 / omega over that of inertia to the third power, with
        the sign of x, and infinite where x = 0. For n = 4 in the unit of 1 / omega squared.
        Dimensionless for a field, and infinite at poles.

    Raises
    ------
    NotIntegrableError
        If no invariant measure is known for the body.

    Notes
    -----
    The measures are not in the paper. For n = 4 and I = (I1, 0, 0) rho is
    1 / (w2 w3 (1 - (eps I1)**2 (J1 w1**2 - (J3 - J2) (w2**2 - w3**2)) / (4 J1 J2 J3))); for another
    axis the indices are permuted.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, invariant_density
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> float(invariant_density(body, [1.0, 0.5], eps=0.2).round(9))
    -0.096052391
    """
    if isinstance(body, SuslovND):
        check_measure(body, "invariant_density")
    given, in_nd = {"omega": omega, "eps": eps}, formulas.invariant_density_nd
    in_3d = formulas.invariant_density
    return evaluate(body, given, in_3d, in_nd, _density_of_field, poles=True)


def _density_of_field(states: States) -> FloatArray:
    _terms_of(states.body)  # there has to be one
    return by_terms(fields.density, states)
