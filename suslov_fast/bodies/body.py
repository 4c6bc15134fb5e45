"""Base classes of bodies, and of bodies of the Suslov problem: values at states, closed form."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..checks import FloatArray, Reals, real_number, wrong
from ..fields.base import Body, Parameters
from ..fields.field import Field
from ..keywords import public
from ..maps.evaluation import evaluate
from ..maps.map_records import map_of
from ..maps.problem import Problem, check
from .exact import states_at
from .formulas_3d import limits


class BodyOfEquations(Body):
    """A body with equations of motion, which its class names once, as the field `_field`."""

    @public
    def __call__(self, omega: ArrayLike, /) -> FloatArray:
        """Return the rates Omega' (..., D) of angular velocities (..., D), unit omega**2.

        These are the equations of motion: (2) and (14) of Dragovic and Gajic, arXiv:0807.2966.

        >>> from suslov_fast import Suslov3D
        >>> Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25)([1.0, 0.5])
        array([ 0.078125, -0.625   ])
        """
        return self._field(omega)

    @public
    def field(self) -> Field:
        """Return the equations of motion as a field in the components of the states.

        Returns
        -------
        Field
            Coefficients of a single body are exact functions of its parameters, which are doubles.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> Suslov3D(I1=4, I2=1, I13=-0.5, I23=0).field()
        Field(Omega1' = 1/8*Omega1*Omega2, Omega2' = -1/2*Omega1**2)
        """
        return self._field

    @public
    def jacobian(self, omega: ArrayLike, /) -> FloatArray:
        """Return the derivative of the equations of motion, as :meth:`Field.jacobian` does."""
        return self._field.jacobian(omega)


class Suslov(BodyOfEquations):
    """A rigid body with a nonholonomic constraint, in three or in n dimensions."""

    _axes: ClassVar[dict[str, int]] = {"rotation": 2}
    rotation: Any

    @property
    def parameters(self) -> dict[str, Any]:
        """The parameters by name."""
        return Parameters({n: each for n, each in self._parts.items() if n != "rotation"})

    def _rotated(self, rotation: Any) -> Self:
        """Return the body with the rotation from the basis of its tensor."""
        return self._with_parts({**self._parts, "rotation": rotation})

    @classmethod
    def _from_dict(cls, given: dict[str, Any]) -> Self:
        rotation = given.pop("rotation", None)
        body = super()._from_dict(given)
        if rotation is None:
            return body
        return body._rotated(checks.rotations("rotation", rotation, body.dimension + 1))

    _is_solved: ClassVar[Any] = True  # for each member, True if its closed form is known

    def _in_plane(self, problem: Problem) -> tuple[Problem, Callable[[FloatArray], FloatArray]]:
        """Return an equivalent problem in three dimensions, and the way back of its states."""
        return problem, lambda states: states

    def _check_solved(self, function: str) -> None:
        """Raise NotIntegrableError unless each member has a closed form."""

    def _value(self, name: str, omega: Any, eps: Any = 0.0) -> FloatArray:
        """Return the value of a formula of the map."""
        map = map_of(self)
        return evaluate(map.formulas[name], map, self, omega, eps)

    def _problem(self, omega: Any, eps: Any = 0.0, threads: int | None = None) -> Problem:
        """Return the checked problem of initial states and step sizes."""
        return check(map_of(self), self, omega, eps, threads, name="omega0")

    @public
    def energy(self, omega: ArrayLike, /) -> FloatArray:
        """Return the energy, half the sum of J_i Omega_i**2; in three dimensions J = (I1, I2).

        The motion conserves it. Along orbits of the map it varies by O(eps**2), because the map
        conserves :func:`kahan.modified_energy`, in n dimensions at least nearly.

        Parameters
        ----------
        omega : array_like(float, shape=(..., D))
            Angular velocities. NaN gives NaN.

        Returns
        -------
        ndarray(float, shape=(...))
            Unit: inertia * omega**2.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> body.energy([[1.0, 0.5], [0.0, 2.0]])
        array([2.125, 2.   ])
        """
        return self._value("energy", omega)

    @public
    def first_integral(self, omega: ArrayLike, /, eps: Reals) -> FloatArray:
        """Return the first integral F of the map, which is constant along its orbits.

        In three dimensions F = (I1 Omega1**2 + I2 Omega2**2) / (4 I1 I2 + eps**2 l**2), with
        l = I13 Omega1 + I23 Omega2 + k (Lemma 1 of Dragovic and Gajic, arXiv:0807.2966). In n
        dimensions it is F of the reduced body (:meth:`SuslovND.reduced`). If all products of
        inertia I are 0, F is the energy divided by 2 a b, where a and b are the first two different
        J_i.

        Parameters
        ----------
        omega : array_like(float, shape=(..., D))
            Angular velocities. NaN gives NaN.
        eps : array_like(float, shape=(...))
            Step size in time; 0 stands for the continuous motion.

        Returns
        -------
        ndarray(float, shape=(...))
            Unit: omega**2 / inertia.

        Raises
        ------
        NotIntegrableError
            If no F is known for a body in n dimensions. Its :func:`kahan.modified_energy` is
            nearly conserved.

        Examples
        --------
        >>> from suslov_fast import Suslov3D, iterate
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> orbit = iterate(body, [1.0, 0.5], eps=0.2, steps=10_000).states
        >>> F = body.first_integral(orbit, eps=0.2)
        >>> float(F[0].round(9)), bool(abs(F / F[0] - 1).max() < 1e-12)
        (0.26534473, True)
        """
        return self._value("first_integral", omega, eps)

    @public
    def criticality(self, omega: ArrayLike, /, eps: Reals) -> FloatArray:
        """Return the criticality t, which decides whether an orbit of the map follows the motion.

        Choose eps so that ``|t| < 1``: otherwise the orbit can jump across the line of steady
        states and meet a pole. t = eps sqrt(h / (I1 I2)) is constant along an orbit; h is
        I13**2 I2 + I23**2 I1 times the :meth:`first_integral`.

        Parameters
        ----------
        omega, eps
            As in :meth:`first_integral`.

        Returns
        -------
        ndarray(float, shape=(...))
            t, dimensionless, with the sign of eps.

        Raises
        ------
        NotIntegrableError
            If the body has no :meth:`first_integral`.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> body = Suslov3D(I1=3, I2=3, I13=-0.2, I23=-0.2)
        >>> body.criticality([[1, 2], [-40, -250]], eps=1).round(4)
        array([0.1049, 1.2281])
        """
        return self._value("criticality", omega, eps)

    @public
    def reaction(self, omega: ArrayLike, /, eps: Reals | None = None) -> FloatArray:
        """Return the torque of the constraint, the multiplier lambda that keeps Omega3 at 0.

        With x = I13 Omega1 + I23 Omega2, the third equation of motion is
        ``x' = lambda + (I1 - I2) Omega1 Omega2``, and the third equation of the map is
        (x_next - x) / eps = lambda + (I1 - I2) (Omega1 Omega2_next + Omega1_next Omega2) / 2.
        See equations (2) and (13) of Dragovic and Gajic, arXiv:0807.2966.

        Parameters
        ----------
        omega : array_like(float, shape=(..., D))
            Angular velocities. NaN gives NaN.
        eps : array_like(float, shape=(...)), optional
            With a step size, lambda of the step from each state; without, lambda of the motion.

        Returns
        -------
        ndarray(float, shape=(...) or (..., n - 1, n - 1))
            Unit: inertia * omega**2. In n dimensions, the antisymmetric matrix lambda_ij. With
            eps, NaN and one :class:`IntegrationWarning` for a state on a pole of the map.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> float(body.reaction([1.0, 0.5], eps=0.01).round(6))
        -1.336328
        """
        return self._value("reaction", omega, 0.0 if eps is None else eps)

    @public
    def momentum(self, omega: ArrayLike, /, *, attitude: ArrayLike | None = None) -> FloatArray:
        """Return the angular momentum M, in the body or in space.

        M = I Omega in three dimensions (without I3, because Omega3 = 0), plus k e3 with a rotor;
        M = I Omega + Omega I in n dimensions. It is not conserved in space: in three dimensions its
        derivative is the :meth:`reaction` times the constrained axis.

        Parameters
        ----------
        omega : array_like(float, shape=(..., D))
            Angular velocities.
        attitude : array_like(float, shape=(..., n, n)), optional
            Orientations of the body, such as ``run.attitude``. With them, the result is in space.

        Returns
        -------
        ndarray(float, shape=(..., 3) or (..., n, n))
            A vector in three dimensions, an antisymmetric matrix in n. Unit: inertia * omega.

        Examples
        --------
        >>> from suslov_fast import Suslov3D, iterate
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> run = iterate(body, [1.0, 0.5], eps=0.2, steps=100, attitude=True)
        >>> body.momentum(run.states, attitude=run.attitude)[[0, -1]].round(3)  # in space
        array([[ 4.   ,  0.5  , -0.65 ],
               [ 2.276, -1.408, -2.146]])
        """
        values = self._value("momentum", omega)
        if attitude is None:
            return values
        R = checks.square_matrices("attitude", attitude, self.dimension + 1, allow_nan=True)
        if map_of(self).attitude == "axial":
            return np.asarray((R @ values[..., np.newaxis])[..., 0])
        return np.asarray(R @ values @ R.swapaxes(-2, -1))

    @public
    def exact(
        self, omega0: ArrayLike, /, eps: Reals, n: ArrayLike, *, threads: int | None = None
    ) -> FloatArray:
        """Return states of an orbit of the map by its closed form, at the same cost for every n.

        Parameters
        ----------
        omega0, eps
            As in :func:`iterate`.
        n : array_like(float, shape=() or (N,))
            Numbers of the states, positive or negative. They may be any real numbers, which give a
            curve through the orbit, if the :meth:`criticality` t has ``|t| < 1``; with a rotor, if
            ``t**2 - (e k)**2 < 1`` for ``e = eps / (2 sqrt(I1 I2))``.
        threads
            As in :func:`iterate`.

        Returns
        -------
        ndarray(float, shape=(..., D) or (N, ..., D))
            The states. They are NaN, with a `RuntimeWarning`, if eps times the angular velocity or
            k is too large for the formula, about 1e8 (then use :func:`iterate`). If the condition
            on t fails, they are also NaN for n above 2**53 and for n that is not an integer. The
            formula continues beyond a pole of the map, where :func:`iterate` stops; the state
            directly after the pole is NaN, with a :class:`IntegrationWarning`.

        Raises
        ------
        NotIntegrableError
            If no closed form is known for this body in n dimensions.

        Notes
        -----
        The formula is Theorem 1 of Dragovic and Gajic, arXiv:0807.2966, with two corrections
        (:meth:`Suslov3D.closed_form`), extended to t >= 1 and to bodies with a rotor.

        Examples
        --------
        Where is the body after 25 steps, and after 10**12 steps forwards and backwards?

        >>> from suslov_fast import Suslov3D
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> body.exact([1.0, 0.5], eps=0.2, n=25).round(6)
        array([ 0.873325, -1.093093])
        >>> body.exact([1.0, 0.5], eps=0.2, n=[-(10**12), 10**12]).round(6)
        array([[-0.791446,  1.319077],
               [ 0.791446, -1.319077]])
        """
        if isinstance(n, float) and math.isinf(n):
            raise wrong("n", "finite", f"{n!r}: limits returns the limits of an orbit")
        numbers = np.asarray(real_number("n", n))
        if numbers.ndim > 1:
            raise wrong("n", "a number or a 1-D array", f"an array of shape {numbers.shape}")
        self._check_solved("exact")
        return states_at(self._problem(omega0, eps, threads), numbers, is_number=True)

    @public
    def limits(self, omega0: ArrayLike, /, eps: Reals) -> tuple[FloatArray, FloatArray]:
        """Return the limits of an orbit of the map as n goes to minus and to plus infinity.

        An orbit goes from one steady rotation to another. Without a rotor the second rotation is
        opposite to the first one (Proposition 2 of Dragovic and Gajic, arXiv:0807.2966).

        Parameters
        ----------
        omega0, eps
            As in :func:`iterate`, but eps = 0 stands for the continuous motion.

        Returns
        -------
        omega_minus, omega_plus : ndarray(float, shape=(..., D))
            Angular velocities on the line I13 Omega1 + I23 Omega2 = -k. Orbits continue beyond
            poles, and a fixed point is its own limit. NaN for an orbit on a closed curve, which a
            rotor makes possible, and for the state at which the map, or its inverse, is 0 / 0.

        Raises
        ------
        NotIntegrableError
            If no closed form is known for this body in n dimensions.

        Examples
        --------
        Which steady rotation does the body come from, and which does it approach?

        >>> from suslov_fast import Suslov3D
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> before, after = body.limits([1.0, 0.5], eps=0.2)
        >>> before.round(6), after.round(6)
        (array([-0.791446,  1.319077]), array([ 0.791446, -1.319077]))
        """
        self._check_solved("limits")
        plane, from_plane = self._in_plane(self._problem(omega0, eps))
        minus, plus = limits(plane)
        return from_plane(minus), from_plane(plus)
