"""The n-dimensional body, equations (13) and (14), and which formulas are known for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..checks import OTHERS, FloatArray, first_index, real_array, spell, within, wrong
from ..keywords import public, public_class
from .base import Body
from .field import QuadraticField
from .field_of_terms import parts_of
from .names import labels
from .polynomials import numbers
from .rigid import adapted
from .terms import collected

# Relative rounding error of J and I after the rotation by from_mass_tensor.
_ROUNDING = 1e-14
# What to use, in place of these functions, for bodies without a known formula.
_INSTEAD = {
    "exact": "iterate",
    "flow": "flow, which computes it to a tolerance",
    "limits": "iterate",
    "first_integral": "modified_energy",
    "criticality": "iterate, and compare with half the step size",
    "invariant_density": "the determinant of jacobian",
}


@public_class
@dataclass(frozen=True, eq=False, repr=False)
class SuslovND(Body):
    """A body in n dimensions, or a batch of them, in the adapted basis of the Suslov problem.

    In that basis Omega_ij = 0 for i, j < n, and the inertia matrix is diagonal except for its last
    row and column: section 5 of Dragovic and Gajic, equation (13). The state is
    omega = (Omega_1n, ..., Omega_(n-1)n). For n = 3 this is :class:`Suslov3D` with
    (Omega_13, Omega_23) = (Omega2, -Omega1), J = (I2, I1) and I = (-I13, -I23).

    Parameters
    ----------
    J : array_like(float, shape=(..., n - 1))
        J_i = I_ii + I_nn, between 1e-60 and 1e60, in any unit that I shares.
    I : array_like(float, shape=(..., n - 1))
        The products I_in, 0 or between 1e-60 and 1e60 in modulus. Where all are 0 every angular
        velocity is constant.

    Raises
    ------
    TypeError, ValueError
        If a parameter is not finite and in its range, or J and I differ in length.

    Examples
    --------
    >>> from suslov_fast import SuslovND
    >>> body = SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5])
    >>> body.n, body.dimension, body.shape
    (4, 3, ())
    """

    J: Any  # array_like when given, then an array
    I: Any

    _axes: ClassVar[dict[str, int]] = {"J": 1, "I": 1}
    _positive: ClassVar[dict[str, int]] = {"J": OTHERS}
    _steady: ClassVar[str] = "c I for all numbers c, or all states if I = 0"

    def __post_init__(self) -> None:
        super().__post_init__()
        J, I = np.shape(self.J), np.shape(self.I)
        if J[-1:] != I[-1:] or J[-1:] in ((), (0,)):
            how = ": pass n - 1 numbers for each, such as 1.3, 2.1, 3.7 and 0.4, -0.7, 0.5"
            raise wrong("J and I", "have the shape (..., n - 1), both", f"{J} and {I}{how}")

    @cached_property
    def dimension(self) -> int:
        """The number of components of a state, n - 1."""
        return int(self.J.shape[-1])

    @property
    def n(self) -> int:
        """The dimension of space."""
        return self.dimension + 1

    @cached_property
    def _labels(self) -> tuple[str, ...]:
        return tuple(f"Omega{i + 1}n" for i in range(self.dimension))

    @cached_property
    def _field(self) -> QuadraticField:
        parts = (numbers(name, each, bool(self.shape)) for name, each in self._parts.items())
        places, values = self._terms_of(*parts)
        terms = collected(places, within("J and I", values, OTHERS), self.dimension, 2)
        return QuadraticField._of(parts_of(terms, labels(self.dimension)))

    @property
    def _terms(self) -> Any:
        """The terms of the field, computed in floats because exact numbers are slow."""
        return self._terms_of(self.J, self.I)

    def _terms_of(self, J: Any, I: Any) -> tuple[Any, Any]:
        """Return indices and values of J_i x_i' = x_i sum_j I_j x_j - I_i sum_j x_j x_j."""
        i, j = np.nonzero(~np.eye(self.dimension, dtype=bool))
        places = np.array([[*i, *i], [*np.minimum(i, j), *j], [*np.maximum(i, j), *j]], np.int64)
        return places, np.concatenate([I[..., j] / J[..., i], -I[..., i] / J[..., i]], axis=-1)

    @classmethod
    @public
    def from_mass_tensor(
        cls, I: ArrayLike, a: ArrayLike | None = None
    ) -> tuple[SuslovND, FloatArray]:
        """Return the body with these second moments of mass and this constrained axis.

        Parameters
        ----------
        I : array_like(float, shape=(..., n, n))
            Second moments of mass about the fixed point, the integrals of x_i x_j dm (positive off
            the diagonal, too), in any basis fixed in the body and any unit: the matrix of
            M = I Omega + Omega I. It is positive definite, and symmetric to 1e-12 of its largest
            entry. For n = 3 it is trace(T) / 2 - T, with the inertia tensor T of
            :meth:`Suslov3D.from_inertia`.
        a : array_like(float, shape=(..., n)), optional
            The constrained axis, which becomes e_n, of any length but 0; by default e_n itself.

        Returns
        -------
        body : SuslovND
            The body in its adapted basis. Products of inertia below 2**-50 of the largest moment
            count as rounding errors, and become 0.
        rotation : ndarray(float, shape=(..., n, n))
            The rotation matrix that takes components to the adapted basis:
            ``I_adapted = rotation @ I @ rotation.T``. The identity if the basis is adapted already.

        Raises
        ------
        ValueError
            If I is not symmetric or not positive definite, or a is 0. The message names the member.

        Examples
        --------
        >>> from suslov_fast import SuslovND
        >>> body, rotation = SuslovND.from_mass_tensor([[1, 0, 0.4], [0, 2, -0.7], [0.4, -0.7, 3]])
        >>> body
        SuslovND(J=[4.0, 5.0], I=[0.4, -0.7])
        """
        given = real_array("I", I)
        n = (0, *given.shape)[-1]
        if n < 2:
            raise wrong("I", "have the shape (..., n, n) with n > 1", given.shape)
        tensors, rotation = adapted(given, np.eye(n)[-1] if a is None else a, n)
        moments = np.diagonal(tensors, axis1=-2, axis2=-1)
        return cls(moments[..., :-1] + moments[..., -1:], tensors[..., :-1, -1]), rotation


class NotIntegrableError(ValueError):
    """No formula is known for this body: no closed form, first integral or invariant measure.

    Functions that need one raise it; the message says for which bodies a formula is known, and what
    to use for this one.

    Examples
    --------
    >>> from suslov_fast import NotIntegrableError, SuslovND, first_integral
    >>> body = SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5])
    >>> try:
    ...     first_integral(body, [1.0, 0.5, 0.2], eps=0.1)
    ... except NotIntegrableError as error:
    ...     print(str(error).rpartition(": ")[2])
    use modified_energy
    """

    known: Any = False  # for which members of a batch a formula is known


def are_solved(body: SuslovND) -> Any:
    """Return True where n = 3, or, to rounding, J I = b I and J = a on vectors orthogonal to I."""
    J, coupled = np.broadcast_arrays(body.J, _coupled(body))
    count = coupled.sum(axis=-1, keepdims=True)
    left_out = coupled & (count == 1)
    low = np.where(left_out, np.inf, J).min(axis=-1)
    high = np.where(left_out, 0.0, J).max(axis=-1)
    return (high * (1.0 - _ROUNDING) <= low) | (count[..., 0] == 0) | (J.shape[-1] == 2)


def _coupled(body: SuslovND) -> Any:
    """Return True for those I_i that are not 0, to rounding."""
    size = abs(body.I)
    return size > _ROUNDING * size.max(axis=-1, keepdims=True)


def check_known(body: SuslovND, function: str) -> None:
    """Raise NotIntegrableError unless the formula of a function is known for all bodies."""
    if function not in _INSTEAD:
        return
    known = are_solved(body)
    expected = "all J equal, or with I along one axis and all other J equal"
    if function == "invariant_density":
        few = _coupled(body).sum(axis=-1) <= 1
        known = (few & (body.dimension == 3)) | (body.dimension == 2)
        expected = "n = 3, or with n = 4 and I along one axis"
    if not known.all():
        which = f"body {spell(first_index(~known))}" if known.ndim else "this body"
        known_for = f"only for bodies with {expected}"
        how = f"use {_INSTEAD[function]}"
        text = f"{function} has no known formula for {which}, {known_for}: {how}"
        error = NotIntegrableError(text)
        error.known = known
        raise error
