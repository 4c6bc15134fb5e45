"""The n-dimensional body, equations (13) and (14)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..checks import FloatArray, wrong
from ..core.cached import cached_property
from ..fields.field import Field
from ..fields.terms import collected
from ..keywords import public, public_class
from ..maps.map_records import MAPS, Discretization
from ..maps.orders import GAUSS, STEPS_ND
from .adapted_basis import adapted
from .body import Suslov
from .formulas_nd import IN_ND, check_known, eigenvalues_nd, in_plane
from .reduction import Reduction, first_of_equal

# Relative rounding error of J and I after the rotation by from_mass_tensor.
_ROUNDING = 1e-14


@public_class
@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SuslovND(Suslov):
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
        velocity is constant. No body has I_i above J_i / 2 in modulus: such numbers are computed,
        with one warning.

    Attributes
    ----------
    rotation : ndarray(float, shape=(..., n, n)) or None
        Of a body that :meth:`from_mass_tensor` made: the rotation to the adapted basis.

    Examples
    --------
    >>> from suslov_fast import SuslovND
    >>> body = SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5])
    >>> body.n, body.dimension, body.shape
    (4, 3, ())
    """

    J: Any  # array_like when given, then an array
    I: Any
    rotation: Any = field(default=None, init=False)

    _axes: ClassVar[dict[str, int]] = {"J": 1, "I": 1, "rotation": 2}
    _positive: ClassVar[dict[str, int]] = {"J": checks.OTHERS}
    _meaning: ClassVar[str] = (
        ", of n - 1 numbers J_i = I_ii + I_nn and n - 1 couplings I_in of a mass tensor, as 1.3, "
        "2.1, 3.7 and 0.4, -0.7, 0.5; from_mass_tensor(I) takes the tensor, and "
        "Suslov3D(I1, I2, I13, I23) is the body in three dimensions"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        J, I = np.shape(self.J), np.shape(self.I)
        if J[-1:] != I[-1:] or J[-1:] in ((), (0,)):
            received = f"{J} and {I}{self._meaning}"
            raise wrong("J and I", "have the shape (..., n - 1), both", received)
        # The mass tensor is positive: I_in**2 < I_ii I_nn <= J_i**2 / 4, for J_i = I_ii + I_nn.
        beyond = abs(self.I) > 0.5 * self.J
        if beyond.any():
            i = checks.first_index(beyond)[-1] + 1
            how = "no body has these numbers; were J and I exchanged?"
            checks.warn(f"I: I_{i} exceeds J_{i} / 2, half of I_ii + I_nn: {how}")

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

    @property
    def _steady_line(self) -> FloatArray:
        return self.I

    @cached_property
    def _field(self) -> Field:
        parts = [*self.parameters.values()]
        if not self.shape:  # a single body has exact coefficients
            parts = [np.vectorize(Fraction, "O")(each) for each in parts]
        places, values = self._terms_of(*parts)
        values = checks.within("J and I", values, checks.OTHERS)
        terms = collected(places, values, self.dimension, 2)
        return Field._of_terms(terms, self._labels)

    @property
    def _terms(self) -> Any:
        """The terms of the field, computed in floats because exact numbers are slow."""
        return self._terms_of(self.J, self.I)

    def _terms_of(self, J: Any, I: Any) -> tuple[Any, Any]:
        """Return indices and values of J_i x_i' = x_i sum_j I_j x_j - I_i sum_j x_j x_j."""
        i, j = np.nonzero(~np.eye(self.dimension, dtype=bool))
        places = np.array([[*i, *i], [*np.minimum(i, j), *j], [*np.maximum(i, j), *j]], np.int64)
        return places, np.concatenate([I[..., j] / J[..., i], -I[..., i] / J[..., i]], axis=-1)

    @cached_property
    def _reduction(self) -> Reduction:
        return Reduction(self.J, self.I)

    @property
    def _is_solved(self) -> Any:
        """True for members with a closed form."""
        return self._reduction.steady | (self._reduction.count == 2)

    _check_solved = check_known
    _in_plane = staticmethod(in_plane)

    @public
    def reduced(
        self,
    ) -> tuple[
        SuslovND,
        Callable[[ArrayLike], FloatArray],
        Callable[[ArrayLike, ArrayLike], FloatArray],
    ]:
        """Return an equivalent body of fewer dimensions, if some of the J_i are equal.

        At most two coordinates replace all components with J_i = a. Let w and I_a be the parts of
        omega and I in these components. One coordinate is u, the component of w along I_a; its I is
        the length of I_a, and u is absent if I_a = 0. The other one is r, the length of the
        remainder of w, with I = 0; r is absent if u is the only component. Both have J = a. The
        reduced body has the same map, motion, energies and steady states.

        Returns
        -------
        body : SuslovND
            The body of these coordinates, in the order in which the J_i appear, u before r. J_i
            that differ in the last bit are not equal.
        to_reduced : callable
            ``to_reduced(omega)`` returns the coordinates (..., k) of states (..., n - 1). r has a
            sign if the remainders form a line; else it is not negative.
        from_reduced : callable
            ``from_reduced(x, omega)`` returns the states (..., n - 1) with the coordinates x
            (..., k). Their remainders have the directions of the remainders of omega, for example
            of the first state of an orbit. A remainder of two or more components that is 0 in
            omega has no direction: there the state is NaN, unless r is 0.

        Notes
        -----
        Each member of a batch is reduced by its own J and I. A member that needs fewer coordinates
        than another has further ones, with I = 0, which are 0 and stay 0.

        Some poles of the map, at states with J_i = eps (I . omega) / 2 for equal J_i, are no poles
        of the reduced body, which continues the map there.

        Examples
        --------
        >>> from suslov_fast import SuslovND, iterate
        >>> body = SuslovND(J=[2, 2, 2, 3], I=[0.25, 0.5, -0.5, 0.75])
        >>> reduced, to_reduced, from_reduced = body.reduced()
        >>> reduced
        SuslovND(J=[2.0, 2.0, 3.0], I=[0.75, 0.0, 0.75])
        >>> omega = [0.5, 0.1, 0.3, -0.2]
        >>> orbit = iterate(reduced, to_reduced(omega), eps=0.1, steps=50).states
        >>> run = iterate(body, omega, eps=0.1, steps=50)
        >>> bool(abs(from_reduced(orbit, omega) - run.states).max() < 1e-14)
        True
        """
        parts, labels_of = self._reduction, self._labels
        size = int(parts.count.max(initial=1))
        J, I = parts.parameters(size)
        body = SuslovND._of({"J": J, "I": I})

        def to_reduced(omega: ArrayLike) -> FloatArray:
            given = checks.states("omega", omega, labels_of)
            checks.common_shape({"body": self.shape, "omega": given.shape[:-1]})
            return parts.states(given, size)

        def from_reduced(x: ArrayLike, omega: ArrayLike) -> FloatArray:
            coordinates = checks.states("x", x, body._labels)
            given = checks.states("omega", omega, labels_of)
            shapes = {"x": coordinates.shape[:-1], "omega": given.shape[:-1]}
            checks.common_shape({"body": self.shape, **shapes})
            return parts.back(coordinates, given)

        return body, to_reduced, from_reduced

    @classmethod
    @public
    def from_mass_tensor(cls, I: ArrayLike, a: ArrayLike | None = None) -> SuslovND:
        """Return the body with these second moments of mass and this constrained axis.

        Parameters
        ----------
        I : array_like(float, shape=(..., n, n))
            Second moments of mass about the fixed point, the integrals of x_i x_j dm, in any basis
            fixed in the body and any unit: the matrix of M = I Omega + Omega I. It is positive
            definite, and symmetric to 1e-12 of its largest entry. For n = 3 it is
            trace(T) / 2 - T, with the inertia tensor T of :meth:`Suslov3D.from_inertia`.
        a : array_like(float, shape=(..., n)), optional
            The constrained axis, which becomes e_n, of any length but 0; by default e_n itself.

        Returns
        -------
        SuslovND
            The body in its adapted basis, with the attribute `rotation` (..., n, n) of
            :meth:`Suslov3D.from_inertia`. Rounding errors are removed: products of inertia below
            2**-50 of the largest moment, or 1e-14 of the largest product, become 0, and J_i that
            differ by less than 1e-14 of the largest become equal.

        Raises
        ------
        ValueError
            If I is not symmetric or not positive definite, or a is 0. The message names the member.

        Examples
        --------
        >>> from suslov_fast import SuslovND
        >>> SuslovND.from_mass_tensor([[1, 0, 0.4], [0, 2, -0.7], [0.4, -0.7, 3]])
        SuslovND(J=[4.0, 5.0], I=[0.4, -0.7])
        """
        given = checks.real_array("I", I)
        n = (0, *given.shape)[-1]
        if n < 2:
            raise wrong("I", "have the shape (..., n, n) with n > 1", given.shape)
        tensors, rotation = adapted(given, np.eye(n)[-1] if a is None else a, n)
        moments = np.diagonal(tensors, axis1=-2, axis2=-1)
        J, products = moments[..., :-1] + moments[..., -1:], tensors[..., :-1, -1]
        largest, size = (abs(each).max(axis=-1, keepdims=True) for each in (J, products))
        J = np.take_along_axis(J, first_of_equal(J, _ROUNDING * largest), axis=-1)
        products = np.where(abs(products) < _ROUNDING * size, 0.0, products)
        return cls(J=J, I=products)._rotated(rotation)


MAPS["SuslovND"] = Discretization(  # equation (15) of arXiv:0807.2966
    name="SuslovND",
    title="Discrete Suslov problem in n dimensions",
    body=SuslovND,
    methods={"auto": STEPS_ND, "gauss": GAUSS},
    formulas=IN_ND,
    attitude="in_rows",
    eigenvalues=eigenvalues_nd,
)
