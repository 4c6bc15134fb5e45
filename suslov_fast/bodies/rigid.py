"""Bodies in three dimensions, equations (1) and (2), also with a rotor; the paper's examples."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from fractions import Fraction
from numbers import Rational
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..checks import FloatArray, Reals, wrong
from ..core.cached import cached_property
from ..fields.field import Field
from ..fields.terms import collected
from ..keywords import public, public_class
from ..maps.evaluation import mask_and_warn
from ..maps.map_records import MAPS, Discretization, map_of
from ..maps.orders import STEPS_3D
from ..maps.problem import check
from .adapted_basis import in_adapted_basis
from .body import Suslov
from .formulas_3d import IN_3D, closed_form, eigenvalues_in_3d, scattering_angle, step_full


class ClosedForm(NamedTuple):
    """The constants (...) of orbits that :meth:`Suslov3D.closed_form` returns."""

    h: FloatArray  # equation (9) of arXiv:0807.2966
    k1: FloatArray  # equation (12) of arXiv:0807.2966
    k2: FloatArray  # the phase in Theorem 1 of arXiv:0807.2966
    t: FloatArray

    def __repr__(self) -> str:
        """Return the constants as text; of one orbit as numbers, not as np.float64(...)."""
        parts = (f"{name}={a if np.ndim(a) else float(a)}" for name, a in self._asdict().items())
        return f"ClosedForm({', '.join(parts)})"


@public_class
@dataclass(frozen=True, eq=False, repr=False)
class Suslov3D(Suslov):
    """A rigid body, or a batch of them, in the adapted basis of the Suslov problem.

    In that basis the constraint is Omega3 = 0 and the inertia tensor is
    ``[[I1, 0, I13], [0, I2, I23], [I13, I23, I3]]``. With l = I13 Omega1 + I23 Omega2 + k the
    equations of motion are ``I1 Omega1' = -l Omega2`` and ``I2 Omega2' = l Omega1``: equation (2)
    of Dragovic and Gajic, arXiv:0807.2966, with the momentum k of a rotor, by default 0.

    Parameters
    ----------
    I1, I2 : array_like(float, shape=(...))
        Moments of inertia, between 1e-50 and 1e50, in any unit that all parameters share.
    I13, I23 : array_like(float, shape=(...))
        Products of inertia, 0 or between 1e-60 and 1e60 in modulus. Where both are 0 and there is
        no rotor every angular velocity is constant.
    k : array_like(float, shape=(...))
        Momentum of a rotor along the constrained axis, of either sign, 0 or between 1e-60 and 1e60
        in modulus. Unit: inertia * omega.
    I3 : array_like(float, shape=(...)), optional
        The third moment of inertia, which only :meth:`step_full` uses: it drops out of the map.
        :meth:`admissible_I3` tells which of them rigid bodies have.

    Attributes
    ----------
    rotation : ndarray(float, shape=(..., 3, 3)) or None
        Of a body that :meth:`from_inertia` made: the rotation to the adapted basis.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> bodies = Suslov3D(I1=[2, 3, 4], I2=1, I13=-0.5, I23=-0.3)
    >>> bodies.shape, bodies[-1]
    ((3,), Suslov3D(I1=4.0, I2=1.0, I13=-0.5, I23=-0.3))
    >>> Suslov3D(I1=2.3, I2=1.4, I13=0.5, I23=-0.7, k=0.9)
    Suslov3D(I1=2.3, I2=1.4, I13=0.5, I23=-0.7, k=0.9)
    """

    I1: Any  # array_like when given, then a float or an array
    I2: Any
    I13: Any
    I23: Any
    k: Any = 0.0
    I3: Any = None
    rotation: Any = field(default=None, init=False)

    _positive: ClassVar[dict[str, int]] = dict.fromkeys(("I1", "I2", "I3"), checks.MOMENTS)

    @property
    def _constants(self) -> tuple[Any, ...]:
        """The constants I1 (broadcast to the shape of the batch), I2, I13, I23 and k."""
        I1 = np.broadcast_to(self.I1, self.shape) if self.shape else self.I1
        return I1, self.I2, self.I13, self.I23, self.k

    @property
    def _steady_line(self) -> FloatArray | None:
        *_, I13, I23, k = self._constants
        if np.all(k):
            return None
        line = np.stack(np.broadcast_arrays(I23, -I13, k)[:2], axis=-1)
        return np.where(np.asarray(k)[..., np.newaxis] == 0.0, line, np.nan)

    def _inertia(self, I3: Any) -> FloatArray:
        """Return the inertia tensors (..., 3, 3) with this I3."""
        I1, I2, I13, I23, I3, zero = np.broadcast_arrays(*self._constants[:4], I3, 0.0)
        rows = [I1, zero, I13], [zero, I2, I23], [I13, I23, I3]
        return np.moveaxis(np.array(rows), (0, 1), (-2, -1))

    @cached_property
    def _field(self) -> Field:
        constants = self._constants
        if not self.shape:  # a single body has exact coefficients; symbols stay as they are
            exact = (Fraction(a) if isinstance(a, (float, Rational)) else a for a in constants)
            constants = tuple(exact)
        I1, I2, *form = constants
        # With l = I13 Omega1 + I23 Omega2 + k: Omega1' = -l Omega2 / I1, Omega2' = l Omega1 / I2.
        l = np.stack(np.broadcast_arrays(*form), axis=-1)
        rows = -l / np.asarray(I1)[..., None], l / np.asarray(I2)[..., None]
        places = [[0] * 3 + [1] * 3, [0, 1, 2] * 2, [1] * 3 + [0] * 3]
        values = [np.broadcast_to(row, (*self.shape, 3)) for row in rows]
        terms = collected(places, np.concatenate(values, axis=-1), 2, 2)
        return Field._of_terms(terms, self._labels)

    def _without_rotor(self, function: str) -> None:
        """Raise ValueError if a body has a rotor."""
        if np.any(self.k):
            raise ValueError(f"{function} is for bodies without a rotor, whose k is 0")

    @public
    def admissible_I3(self) -> tuple[FloatArray, FloatArray]:
        """Return the interval of I3 for which a rigid body with these parameters exists.

        Its inertia tensor is positive definite, and its principal moments obey the triangle
        inequality.

        Returns
        -------
        low, high : ndarray(float, shape=(...))
            The ends of the open interval, in the unit of I1; NaN if no body has these parameters.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> low, high = Suslov3D(I1=3, I2=3, I13=-0.2, I23=-0.2).admissible_I3()
        >>> round(float(low), 6), round(float(high), 6)
        (0.053816, 5.946184)
        """
        # At both ends the second moments of mass, tr(T) / 2 - T = (B + I3 diag(1, 1, -1)) / 2, are
        # singular. So the ends are the two larger eigenvalues of -diag(1, 1, -1) B.
        T, signs = self._inertia(0.0), np.diag([-1.0, -1.0, 1.0])
        B = np.trace(T, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - 2 * T
        ends = np.sort(np.linalg.eigvals(signs @ B).real, axis=-1)[..., 1:]
        # Bodies exist if, for I3 half-way between both ends, the sum of the smaller moments exceeds
        # the largest one.
        moments = np.linalg.eigvalsh(self._inertia(ends.mean(axis=-1)))
        exists = moments.sum(axis=-1) > 2.0 * moments[..., -1]
        low, high = np.moveaxis(np.where(exists[..., None], ends, np.nan), -1, 0)
        return low[()], high[()]

    @staticmethod
    @public
    def figure(k: int, /) -> tuple[Suslov3D, float]:
        """Return the body and the step size of figure k, 1 to 4, of arXiv:0807.2966."""
        number = checks.integer("k", k, 1)
        if number not in FIGURES:
            raise wrong("k", "the number of a figure of the paper, 1 to 4", number)
        body, eps, _ = FIGURES[number]
        return body, eps

    @classmethod
    @public
    def from_inertia(
        cls, I: ArrayLike, a: ArrayLike = (0.0, 0.0, 1.0), k: ArrayLike = 0.0
    ) -> Suslov3D:
        """Return the body with this inertia tensor and this constrained axis.

        Parameters
        ----------
        I : array_like(float, shape=(..., 3, 3))
            Inertia tensor about the fixed point, in any basis fixed in the body and any unit (which
            the parameters of the body then have): the matrix of M = I Omega, of the whole body,
            also of a rotor. Its entries off the diagonal are integrals of -x y dm; some CAD
            programs print +x y dm. From the tensor about the centre of mass, at the vector d from
            the fixed point, it is ``I_centre + m * (d @ d * np.eye(3) - np.outer(d, d))``; 1 g mm^2
            is 1e-9 kg m^2.
        a : array_like(float, shape=(..., 3)), optional
            The axis, in that basis, about which the body must not rotate, of any length but 0; by
            default the third.
        k : array_like(float, shape=(...))
            Momentum of a rotor along a, positive in the direction of a.

        Returns
        -------
        Suslov3D
            The body in its adapted basis. Products of inertia below 2**-50 of the largest moment
            are rounding errors, and become 0. The attribute `rotation` (..., 3, 3) is the matrix
            that rotates components to the adapted basis: ``I_adapted = rotation @ I @ rotation.T``.
            The state for the angular velocity omega is ``(rotation @ omega)[:2]``.

        Raises
        ------
        ValueError
            If I is not symmetric to 1e-12 of its size or not positive definite, or a principal
            moment exceeds the sum of the others. For a batch, the message names the member.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> body = Suslov3D.from_inertia([[4, 0, -0.5], [0, 2, -0.3], [-0.5, -0.3, 3]], a=[0, 0, 2])
        >>> body
        Suslov3D(I1=4.0, I2=2.0, I13=-0.5, I23=-0.3, I3=3.0)
        >>> body.rotation
        array([[1., 0., 0.],
               [0., 1., 0.],
               [0., 0., 1.]])
        """
        I1, I2, I13, I23, I3, rotation = in_adapted_basis(I, a)
        return cls(I1, I2, I13, I23, k, I3)._rotated(rotation)

    @public
    def rotation_number(self, omega: ArrayLike, /, eps: Reals) -> FloatArray:
        """Return the rotation number of an orbit: the mean number of turns per step of the map.

        It is 0 for orbits from one steady state to another, else
        sign(k eps) arctan(sqrt((e k)**2 - t**2)) / pi, with e = eps / (2 sqrt(I1 I2)) and the
        :meth:`criticality` t. The angle is the argument of z / (1 - i e l), with
        z = sqrt(I1) Omega1 + i sqrt(I2) Omega2 and l = I13 Omega1 + I23 Omega2 + k; if
        ``|t| < 1``, Omega makes as many turns.

        Parameters
        ----------
        omega, eps
            As in :meth:`first_integral`.

        Returns
        -------
        ndarray(float, shape=(...))
            Turns, dimensionless, between -1/2 and 1/2, with the sign of k eps.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> body = Suslov3D(I1=2.3, I2=1.4, I13=0.5, I23=-0.7, k=[0.0, 0.9, 1.8])
        >>> body.rotation_number([1.1, -0.4], eps=0.35).round(6)
        array([0.      , 0.      , 0.043038])
        """
        return self._value("rotation_number", omega, eps)

    @public
    def to_xy(self, omega: ArrayLike, /) -> FloatArray:
        """Return x = I13 Omega1 + I23 Omega2 and y = I23 I1 Omega1 - I13 I2 Omega2 of a state.

        Equation (7) of Dragovic and Gajic, arXiv:0807.2966. In these coordinates the equations of
        motion are ``x' = x y / (I1 I2)`` and ``y' = -x**2`` (Remark 2). The steady states are the
        line x = 0.

        Parameters
        ----------
        omega : array_like(float, shape=(..., 2))
            Angular velocities. NaN gives NaN.

        Returns
        -------
        ndarray(float, shape=(..., 2))
            x, unit inertia * omega, and y, unit inertia**2 * omega.

        Raises
        ------
        ValueError
            If the body has a rotor.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25).to_xy([1.0, 0.5])
        array([-0.625, -0.75 ])
        """
        self._without_rotor("to_xy")
        return self._value("to_xy", omega)

    @public
    def closed_form(self, omega0: ArrayLike, /, eps: Reals) -> ClosedForm:
        """Return the constants h, k1 and k2 of the closed form of an orbit, and its criticality t.

        In the coordinates of :meth:`to_xy`, with theta = k1 n eps + k2, state n of the orbit is
        x = sign(x_0) 2 sqrt(h I1 I2 / (I1 I2 - h eps**2)) / cosh(theta) and
        y = 2 sqrt(h I1 I2) tanh(theta), where k1 = -(2 / eps) artanh t. :meth:`exact` evaluates it.

        Parameters
        ----------
        omega0 : array_like(float, shape=(..., 2))
            Initial angular velocities. NaN gives NaN.
        eps : array_like(float, shape=(...))
            Step size in time; 0 is the continuous motion.

        Returns
        -------
        ClosedForm
            A named tuple of arrays (...): h, unit (inertia * omega)**2; k1, unit 1 / eps; k2,
            dimensionless; and t, the :meth:`criticality`. k1 and k2 are NaN unless ``|t| < 1``. k2
            is infinite on the line x = 0, and 0 at rest.

        Raises
        ------
        ValueError
            If the body has a rotor.

        Notes
        -----
        h is the integral of equation (9) of Dragovic and Gajic, arXiv:0807.2966; k1 solves equation
        (12), and k2 is the phase of Theorem 1 for positive x, with two corrections: the prefactor
        2 sqrt(h I1 I2) and the denominator I23**2 I1 + I13**2 I2.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> constants = body.closed_form([1.0, 0.5], eps=0.2)
        >>> float(constants.k1.round(6)), float(constants.t.round(6))
        (-0.402536, 0.040232)
        """
        self._without_rotor("closed_form")
        return ClosedForm(*closed_form(self._problem(omega0, eps)))

    @public
    def step_full(self, omega: ArrayLike, /, eps: Reals, I3: ArrayLike | None = None) -> FloatArray:
        """Return the next state of the scheme in three components.

        Equation (3) of Dragovic and Gajic, arXiv:0807.2966, where the constraint is Omega3 = 0. A
        step of the scheme changes the sign of Omega3. So unless Omega3 is 0, steps do not converge
        to a motion as eps -> 0.

        Parameters
        ----------
        omega : array_like(float, shape=(..., 3))
            Angular velocities (Omega1, Omega2, Omega3).
        eps : array_like(float, shape=(...))
            Step size in time.
        I3 : array_like(float, shape=(...)), optional
            Third moment of inertia, positive; by default I3 of the body.

        Returns
        -------
        ndarray(float, shape=(..., 3))
            The next states. NaN for a state that contains NaN; NaN, with one
            :class:`IntegrationWarning`, for a state on a pole of the map.

        Raises
        ------
        TypeError
            If neither `I3` nor ``body.I3`` is given.
        ValueError
            If the body has a rotor.

        Examples
        --------
        Does a violation of the constraint decay?

        >>> from suslov_fast import Suslov3D
        >>> body = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3)
        >>> body.step_full([1.0, 0.5, 0.1], eps=0.2, I3=3).round(6)
        array([ 0.9897  ,  0.406546, -0.1     ])
        """
        self._without_rotor("step_full")
        body = self if I3 is None else replace(self, I3=I3)
        if body.I3 is None:
            raise TypeError("I3 is missing: pass I3, or a body that has one")
        labels = "Omega1", "Omega2", "Omega3"
        problem = check(map_of(self), body, omega, eps, components=labels)
        return mask_and_warn(problem, step_full(problem))

    @public
    def scattering_angle(self) -> FloatArray:
        """Return the angle between the limits of the angular velocity in space.

        These are the limits at times -infinity and +infinity of the continuous motion. The angle
        depends only on the body; the angle of the map converges to it with order 2. With
        D = I13**2 I2 + I23**2 I1, m**2 = I13**2 + I23**2,
        alpha = I1 I2 m / D, beta**2 = I1 I2 / m**2, gamma = beta I13 I23 (I2 - I1) / D and
        kappa**2 = (alpha - i gamma)**2 - beta**2,

        sin(angle / 2)**2 = (Re cosh(pi kappa / 2) / cosh(pi alpha / 2))**2
        + (Im cosh(pi kappa / 2) / sinh(pi alpha / 2))**2,

        for gamma = 0 a result of Fedorov, Maciejewski and Przybylska, Nonlinearity 22 (2009),
        arXiv:0902.0079.

        Returns
        -------
        ndarray(float, shape=(...))
            Angle in radians between 0 (the body turns over) and pi (it returns to its initial
            orientation); NaN if I13 = I23 = 0. Its error is about
            1e-15 (alpha + beta + abs(gamma)).

        Raises
        ------
        ValueError
            If the body has a rotor.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> float(Suslov3D(I1=4, I2=1, I13=-1.5, I23=-0.3).scattering_angle().round(12))
        1.221073798141
        """
        self._without_rotor("scattering_angle")
        return scattering_angle(*np.broadcast_arrays(*self._constants[:4]))


# The four figures at the end of Section 4 of arXiv:0807.2966: bodies, step sizes, and extents of
# the axes, which the paper does not state.
FIGURES = {
    1: (Suslov3D(4, 1, -0.5, -0.3), 0.2, 4.0),
    2: (Suslov3D(4, 3, -0.4, -0.2), 0.2, 10.0),
    3: (Suslov3D(4, 2, 0, -0.2), 0.02, 100.0),
    4: (Suslov3D(3, 3, -0.2, -0.2), 1.0, 3.0),
}


MAPS["Suslov3D"] = Discretization(  # equation (4) of arXiv:0807.2966
    name="Suslov3D",
    title="Discrete Suslov problem",
    body=Suslov3D,
    methods={"auto": STEPS_3D},
    formulas=IN_3D,
    attitude="axial",
    eigenvalues=eigenvalues_in_3d,
)
