"""Bodies in three dimensions, with and without a rotor: the Suslov problem, equations (1), (2).

Also the four examples of the paper, and the rotation of inertia tensors to adapted bases.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from numbers import Real
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..checks import FloatArray, wrong
from ..keywords import public, public_class
from .base import Body
from .fields.field import Field
from .fields.terms import collected

# Tolerance of the triangle inequality of moments, relative to the largest one: flat bodies have
# equality, and the parallel axis theorem loses a few digits.
_ROUNDING = 1e-12


def _exact(a: Any) -> Any:
    """Return a number as a fraction, and a rational function as it is."""
    return Fraction(a) if isinstance(a, Real) else a


@dataclass(frozen=True, eq=False, repr=False)
class _In3D(Body):
    """The parameters and equations that both bodies in three dimensions share."""

    I1: Any  # array_like when given, then a float or an array
    I2: Any
    I13: Any
    I23: Any

    positive: ClassVar[dict[str, int]] = dict.fromkeys(("I1", "I2", "I3"), checks.MOMENTS)

    @property
    def constants(self) -> tuple[Any, ...]:
        """I1 in the shape of the batch, which I3 alone may have; I2, I13, I23; k or 0."""
        I1 = np.broadcast_to(self.I1, self.shape) if self.shape else self.I1
        return I1, self.I2, self.I13, self.I23, vars(self).get("k", 0.0)

    @property
    def steady_line(self) -> FloatArray | None:
        *_, I13, I23, k = self.constants
        return None if np.any(k) else np.stack(np.broadcast_arrays(I23, -I13), axis=-1)

    def _inertia(self, I3: Any) -> FloatArray:
        """Return the inertia tensors (..., 3, 3) with this I3."""
        I1, I2, I13, I23, I3, zero = np.broadcast_arrays(*self.constants[:4], I3, 0.0)
        rows = [I1, zero, I13], [zero, I2, I23], [I13, I23, I3]
        return np.moveaxis(np.array(rows), (0, 1), (-2, -1))

    @cached_property
    def _field(self) -> Field:
        I1, I2, *form = self.constants if self.shape else map(_exact, self.constants)
        # With l = I13 Omega1 + I23 Omega2 + k: Omega1' = -l Omega2 / I1, Omega2' = l Omega1 / I2.
        l = np.stack(np.broadcast_arrays(*form), axis=-1)
        rows = -l / np.asarray(I1)[..., None], l / np.asarray(I2)[..., None]
        places = [[0] * 3 + [1] * 3, [0, 1, 2] * 2, [1] * 3 + [0] * 3]
        values = [np.broadcast_to(row, (*self.shape, 3)) for row in rows]
        terms = collected(places, np.concatenate(values, axis=-1), 2, 2)
        return Field.of_terms(terms, self.labels)


@public_class
@dataclass(frozen=True, eq=False, repr=False)
class Suslov3D(_In3D):
    """A rigid body, or a batch of them, in the adapted basis of the Suslov problem.

    In that basis the constraint is Omega3 = 0 and the inertia tensor is
    ``[[I1, 0, I13], [0, I2, I23], [I13, I23, I3]]``. With x = I13 Omega1 + I23 Omega2 the equations
    of motion are ``I1 Omega1' = -x Omega2`` and ``I2 Omega2' = x Omega1``: equation (2) of
    Dragovic and Gajic, arXiv:0807.2966.

    Parameters
    ----------
    I1, I2 : array_like(float, shape=(...))
        Moments of inertia, between 1e-50 and 1e50, in any unit that all parameters share.
    I13, I23 : array_like(float, shape=(...))
        Products of inertia, 0 or between 1e-60 and 1e60 in modulus. Where both are 0 every angular
        velocity is constant.
    I3 : array_like(float, shape=(...)), optional
        The third moment of inertia, which only :func:`step_full` uses: it drops out of the map.
        :meth:`admissible_I3` tells which of them rigid bodies have.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> bodies = Suslov3D(I1=[2, 3, 4], I2=1, I13=-0.5, I23=-0.3)
    >>> bodies.shape, bodies[-1]
    ((3,), Suslov3D(I1=4.0, I2=1.0, I13=-0.5, I23=-0.3))
    """

    I3: Any = None

    steady: ClassVar[str] = "c (I23, -I13) for all numbers c"

    @public
    def admissible_I3(self) -> tuple[FloatArray, FloatArray]:
        """Return the interval of I3 for which a rigid body with these parameters exists.

        Returns
        -------
        low, high : ndarray(float, shape=(...))
            The ends of the open interval, unit: that of I1; NaN if no body has these parameters.

        Notes
        -----
        The inertia tensor has to be positive definite, and its principal moments have to obey the
        triangle inequality.

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
        # Between them the two smaller moments exceed the largest one, if a body has these numbers.
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
        cls, I: ArrayLike, a: ArrayLike = (0.0, 0.0, 1.0)
    ) -> tuple[Suslov3D, FloatArray]:
        """Return the body with this inertia tensor and this constrained axis.

        Parameters
        ----------
        I : array_like(float, shape=(..., 3, 3))
            Inertia tensor about the fixed point, in any basis fixed in the body and any unit (which
            the parameters of the body then have): the matrix of M = I Omega. Its entries off the
            diagonal are integrals of -x y dm; some CAD programs print +x y dm. From the tensor
            about the centre of mass, at the vector d from the fixed point, it is
            ``I_centre + m * (d @ d * np.eye(3) - np.outer(d, d))``; 1 g mm^2 is 1e-9 kg m^2.
        a : array_like(float, shape=(..., 3)), optional
            The axis, in that basis, about which the body must not rotate, of any length but 0; by
            default the third.

        Returns
        -------
        body : Suslov3D
            The body in its adapted basis. Products of inertia below 2**-50 of the largest moment
            count as rounding errors, and become 0.
        rotation : ndarray(float, shape=(..., 3, 3))
            The rotation matrix that takes components to the adapted basis:
            ``I_adapted = rotation @ I @ rotation.T``. The state of the body with angular velocity
            omega is ``(rotation @ omega)[:2]``. The identity if the basis is adapted already.

        Raises
        ------
        ValueError
            If I is not symmetric to 1e-12 of its size or not positive definite, or a principal
            moment exceeds the sum of the others. For a batch, the message names the member.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> I = [[4, 0, -0.5], [0, 2, -0.3], [-0.5, -0.3, 3]]
        >>> body, rotation = Suslov3D.from_inertia(I, a=[0, 0, 2])
        >>> body
        Suslov3D(I1=4.0, I2=2.0, I13=-0.5, I23=-0.3, I3=3.0)
        """
        I1, I2, I13, I23, I3, rotation = _in_adapted_basis(I, a)
        return cls(I1, I2, I13, I23, I3), rotation


@public_class
@dataclass(frozen=True, eq=False, repr=False)
class SuslovGyrostat(_In3D):
    """A rigid body, or a batch of them, with a rotor along the constrained axis.

    With l = I13 Omega1 + I23 Omega2 + k the equations of motion are ``I1 Omega1' = -l Omega2`` and
    ``I2 Omega2' = l Omega1``: equation (2) of Dragovic and Gajic, arXiv:0807.2966, with the
    momentum k of the rotor. Omega rotates even if I13 = I23 = 0.

    Parameters
    ----------
    I1, I2, I13, I23, I3
        As in :class:`Suslov3D`; I3 is optional.
    k : array_like(float, shape=(...))
        Momentum of the rotor, of either sign, 0 or between 1e-60 and 1e60 in modulus. Unit:
        inertia * omega.

    Examples
    --------
    >>> from suslov_fast import SuslovGyrostat
    >>> SuslovGyrostat(I1=2.3, I2=1.4, I13=0.5, I23=-0.7, k=0.9)
    SuslovGyrostat(I1=2.3, I2=1.4, I13=0.5, I23=-0.7, k=0.9)
    """

    k: Any
    I3: Any = None

    steady: ClassVar[str] = "0, and the states with I13 Omega1 + I23 Omega2 = -k"

    @classmethod
    @public
    def from_inertia(
        cls, I: ArrayLike, a: ArrayLike, k: ArrayLike
    ) -> tuple[SuslovGyrostat, FloatArray]:
        """Return the body and the rotation, as :meth:`Suslov3D.from_inertia` does.

        I is that of the whole body, the rotor included; k (...) is the momentum of the rotor along
        a, positive in the direction of a, in the unit of I * omega.
        """
        I1, I2, I13, I23, I3, rotation = _in_adapted_basis(I, a)
        return cls(I1, I2, I13, I23, k, I3), rotation


class Figure(NamedTuple):
    """A body, a step size, and the extent of the axes, which the paper does not state."""

    body: Suslov3D
    eps: float
    extent: float


FIGURES = {  # the four examples at the end of Section 4
    1: Figure(Suslov3D(4, 1, -0.5, -0.3), 0.2, 4.0),
    2: Figure(Suslov3D(4, 3, -0.4, -0.2), 0.2, 10.0),
    3: Figure(Suslov3D(4, 2, 0, -0.2), 0.02, 100.0),
    4: Figure(Suslov3D(3, 3, -0.2, -0.2), 1.0, 3.0),
}


def _in_adapted_basis(I: ArrayLike, a: ArrayLike) -> tuple[Any, ...]:
    """Return I1, I2, I13, I23, I3 and the rotation; ValueError if no rigid body has the tensor."""
    tensors, rotation = adapted(I, a, 3)
    principal = np.linalg.eigvalsh(checks.real_array("I", I))
    largest, others = principal[..., -1], principal[..., 0] + principal[..., 1]
    bad = others - largest < -_ROUNDING * largest
    _refuse("I", bad, f"is of no rigid body (triangle inequality): {_CONVENTIONS}")
    I1, I2, I3 = np.moveaxis(np.diagonal(tensors, axis1=-2, axis2=-1), -1, 0)
    return I1, I2, tensors[..., 0, 2], tensors[..., 1, 2], I3, rotation


# How programs print another tensor.
_CONVENTIONS = "it is about the fixed point, with minus the integrals of x y dm off the diagonal"


def _refuse(name: str, bad: Any, what: str) -> None:
    """Raise ValueError, which names the first member of a batch of which something is true."""
    if bad.any():
        member = f": member {checks.spell(checks.first_index(bad))}" if np.ndim(bad) else ""
        raise ValueError(f"{name}{member} {what}")


def adapted(I: ArrayLike, a: ArrayLike, n: int) -> tuple[FloatArray, FloatArray]:
    """Return inertia matrices (..., n, n) in adapted bases, and rotations to these bases.

    The axis a becomes e_n; the other axes diagonalize their block and rotate as little as possible.
    """
    if isinstance(a, str):
        example = [*[0] * (n - 1), 1]
        raise wrong("a", f"{n} numbers, such as {example}", repr(a), TypeError)
    matrix, axis = checks.square_matrices("I", I, n), checks.real_array("a", a)
    size = abs(matrix).max(axis=(-2, -1), initial=0.0)
    asymmetry = abs(matrix - matrix.swapaxes(-2, -1)).max(axis=(-2, -1), initial=0.0)
    how = "for printed digits pass (I + I.T) / 2, and I + np.triu(I, 1).T for an upper half"
    _refuse("I", ~(asymmetry <= 1e-12 * size), f"is not symmetric: {how}")
    least = np.linalg.eigvalsh(matrix).min(axis=-1, initial=np.inf)
    _refuse("I", ~(least > 1e-15 * size), f"is not positive definite: {_CONVENTIONS}")
    if axis.shape[-1:] != (n,):
        expected = f"{n} numbers, the components of an axis, or axes (..., {n})"
        raise wrong("a", expected, f"of the shape {axis.shape}")
    length = np.linalg.norm(axis, axis=-1, keepdims=True)
    _refuse("a", ~((length > 0) & (length < np.inf))[..., 0], "is not an axis of finite length")
    checks.common_shape({"I": matrix.shape[:-2], "a": axis.shape[:-1]})
    # Rotate the axis to e_n by the smallest angle. If it points down, rotate its opposite in this
    # way, and then make half a turn.
    sign = np.where(axis[..., -1:] < 0.0, -1.0, 1.0)
    up = sign * axis / length
    between = up + np.eye(n)[-1]
    to_last = np.eye(n) - between[..., :, None] * between[..., None, :] / between[..., -1:, None]
    to_last[..., -1, :] = up
    to_last[..., [0, -1], :] *= sign[..., None]
    rotated = to_last @ matrix @ to_last.swapaxes(-2, -1)
    vectors = np.linalg.eigh(rotated[..., :-1, :-1])[1]
    order = abs(vectors).argmax(axis=-2).argsort(axis=-1)
    vectors = np.take_along_axis(vectors, order[..., None, :], axis=-1)
    vectors *= np.where(np.diagonal(vectors, axis1=-2, axis2=-1) < 0.0, -1.0, 1.0)[..., None, :]
    turn = np.broadcast_to(np.eye(n), rotated.shape).copy()
    turn[..., :-1, :-1] = vectors.swapaxes(-2, -1)
    turn[..., 0, :] *= np.sign(np.linalg.det(turn))[..., None]
    tensors = turn @ rotated @ turn.swapaxes(-2, -1)
    # Products of inertia that should be 0 have rounding errors of the moments.
    largest = np.diagonal(tensors, axis1=-2, axis2=-1).max(axis=-1)[..., None]
    tensors[..., :-1, -1][abs(tensors[..., :-1, -1]) < 2.0**-50 * largest] = 0.0
    return tensors, turn @ to_last + 0.0  # no -0.0
