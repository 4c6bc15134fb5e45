"""The n-dimensional body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._checks import FloatArray, common_shape, inertia_matrix, real_array, unit_axis
from .._engine.layout import flat_parameter, flat_rows, for_kernel
from .values import equal, frozen, hash_of, line_of, named, plain, table_of, times_power


@dataclass(frozen=True, eq=False, init=False)
class SuslovND:
    """A body in n dimensions, or a batch of them, in the adapted basis of the Suslov problem.

    In that basis Omega_ij = 0 for i, j < n, and the inertia matrix vanishes off the diagonal but
    for its last row and column. The state is omega = (Omega_1n, ..., Omega_(n-1)n).

    Parameters
    ----------
    J : array_like(float, shape=(..., n - 1))
        J_i = I_ii + I_nn, positive, in any unit that I shares.
    I : array_like(float, shape=(..., n - 1))
        The couplings I_in. Where all are 0 every angular velocity is constant.

    Raises
    ------
    TypeError, ValueError
        If J or I are not finite real numbers, their last axes differ, J is not positive, or the
        batches do not broadcast.

    Notes
    -----
    Section 5 of Dragovic and Gajic, equation (nsus). For n = 3 this is :class:`Suslov3D` with
    (Omega_13, Omega_23) = (Omega2, -Omega1), J = (I2, I1) and I = (-I13, -I23).

    Examples
    --------
    >>> from suslov_fast import SuslovND
    >>> body = SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5])
    >>> body.dimension, body.shape
    (3, ())
    """

    J: FloatArray
    I: FloatArray

    def __init__(self, J: ArrayLike, I: ArrayLike) -> None:
        J, I = real_array("J", J), real_array("I", I)
        if J.ndim == 0 or I.ndim == 0 or J.shape[-1] != I.shape[-1] or J.shape[-1] == 0:
            raise ValueError(
                "J, I: expected shapes (..., n - 1) with the same n > 1, "
                f"got {J.shape} and {I.shape}"
            )
        if not (J > 0).all():
            raise ValueError(f"J: expected positive sums I_ii + I_nn, got {J.min()}")
        common_shape({"J": J.shape[:-1], "I": I.shape[:-1]})
        object.__setattr__(self, "J", frozen(J))
        object.__setattr__(self, "I", frozen(I))

    @property
    def dimension(self) -> int:
        """The number of components of a state, n - 1."""
        return int(self.J.shape[-1])

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """The batch shape of the body, () for a single one."""
        return np.broadcast_shapes(self.J.shape[:-1], self.I.shape[:-1])

    @property
    def parameters(self) -> tuple[FloatArray, FloatArray]:
        """J, I."""
        return self.J, self.I

    @cached_property
    def flat(self) -> list[FloatArray]:
        """The parameters of a single body as loops take them."""
        return [for_kernel(each).reshape(-1) for each in self.parameters]

    @cached_property
    def normalised(self) -> tuple[FloatArray, FloatArray]:
        """J and I over powers of two, which define the same map with `normalised_eps`."""
        moments, couplings = self.exponents
        return (
            np.ldexp(self.J, -moments[..., np.newaxis]),
            np.ldexp(self.I, -couplings[..., np.newaxis]),
        )

    def for_loops(self, eps: float | FloatArray, batch: tuple[int, ...]) -> list[FloatArray]:
        """J, I and eps as loops take them, normalised."""
        own = self._one_normalised or [flat_rows(each, batch) for each in self.normalised]
        return [*own, flat_parameter(self.normalised_eps(eps), batch)]

    @cached_property
    def _one_normalised(self) -> list[FloatArray]:
        """What `for_loops` has of the body, the same for all batches, if this is a single one."""
        return [] if self.shape else [flat_rows(each, ()) for each in self.normalised]

    def normalised_eps(self, eps: float | FloatArray) -> float | FloatArray:
        """The step size, or the unit of time, that goes with `normalised`."""
        if isinstance(eps, float) and not self.shape:
            return times_power(eps, self._one_exponent)
        moments, couplings = self.exponents
        with np.errstate(all="ignore"):
            scaled: FloatArray = np.ldexp(eps, couplings - moments)
        return scaled

    @cached_property
    def _one_exponent(self) -> int:
        """What `normalised_eps` adds to exponents, of a single body."""
        moments, couplings = self.exponents
        return int(couplings - moments)

    @cached_property
    def exponents(self) -> tuple[NDArray[np.intc], NDArray[np.intc]]:
        """The powers of two that `normalised` takes out of J and of I."""
        _, smallest = np.frexp(self.J.min(axis=-1))
        _, largest = np.frexp(self.J.max(axis=-1))
        _, couplings = np.frexp(abs(self.I).max(axis=-1))
        return np.asarray((smallest + largest) // 2), np.asarray(couplings)

    @cached_property
    def solved(self) -> NDArray[np.bool_]:
        """Where J I = b I and J = a on the vectors orthogonal to I, to the last bit, or n < 4."""
        J, coupled = np.broadcast_arrays(self.J, self.I != 0)
        several = coupled.sum(axis=-1) > 1
        # Without the coupled component, if it is one.
        left_out = coupled & ~several[..., np.newaxis]
        low = np.where(left_out, np.inf, J).min(axis=-1)
        solved: NDArray[np.bool_] = low >= np.where(left_out, 0.0, J).max(axis=-1)
        return solved | ~coupled.any(axis=-1) | (self.dimension == 2)

    @cached_property
    def any_solved(self) -> bool:
        """Whether that holds for any body of the batch."""
        return bool(self.solved.any())

    def __eq__(self, other: object) -> bool:
        same: bool = equal(self, other)
        return same

    def __hash__(self) -> int:
        return hash_of(self)

    def __repr__(self) -> str:
        return line_of(self)

    def _repr_html_(self) -> str:
        return table_of(self)

    def __reduce__(self) -> tuple[Any, ...]:
        return SuslovND, self.parameters

    def to_dict(self) -> dict[str, Any]:
        """J and I as nested lists of numbers, which JSON can hold, without loss.

        Returns
        -------
        dict

        Examples
        --------
        >>> from suslov_fast import SuslovND
        >>> SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5]).to_dict()
        {'J': [1.3, 2.1, 3.7], 'I': [0.4, -0.7, 0.5]}
        """
        return plain(self)

    @classmethod
    def from_dict(cls, parameters: Mapping[str, Any]) -> SuslovND:
        """The body that :meth:`to_dict` describes.

        Parameters
        ----------
        parameters : mapping
            Nested lists of numbers by name: J and I.

        Returns
        -------
        SuslovND

        Raises
        ------
        TypeError, ValueError
            If other names are given than those, or numbers that no body has.

        Examples
        --------
        >>> from suslov_fast import SuslovND
        >>> SuslovND.from_dict({"J": [1.3, 2.1], "I": [0.4, -0.7]})
        SuslovND(J=[1.3, 2.1], I=[0.4, -0.7])
        """
        return cls(**named(cls, parameters))

    @classmethod
    def from_mass_tensor(
        cls, I: ArrayLike, a: ArrayLike | None = None
    ) -> tuple[SuslovND, FloatArray]:
        """The body with given second moments of mass and a given constraint axis.

        Parameters
        ----------
        I : array_like(float, shape=(n, n))
            Symmetric and positive definite, in any basis fixed in the body: the I of
            M = I Omega + Omega I, which holds the second moments of mass. For n = 3 that is not
            the inertia tensor T of :meth:`Suslov3D.from_inertia` but trace(T) / 2 - T.
        a : array_like(float, shape=(n,)), optional
            The axis that becomes e_n, of any length but 0; by default e_n itself.

        Returns
        -------
        body : SuslovND
            The body in its adapted basis.
        rotation : ndarray(float, shape=(n, n))
            The matrix, of determinant 1, that takes components to the adapted basis:
            ``I_adapted = rotation @ I @ rotation.T``. It is the identity where the given basis is
            adapted already.

        Raises
        ------
        TypeError, ValueError
            If I is not symmetric to 1e-12 of its size or not positive definite, or a is 0.

        Examples
        --------
        >>> from suslov_fast import SuslovND
        >>> body, rotation = SuslovND.from_mass_tensor(
        ...     [[1, 0, 0, 0.4], [0, 2, 0, -0.7], [0, 0, 3, 0.5], [0.4, -0.7, 0.5, 4]]
        ... )
        >>> body
        SuslovND(J=[5.0, 6.0, 7.0], I=[0.4, -0.7, 0.5])
        >>> float(rotation.trace())
        4.0
        """
        matrix = inertia_matrix("I", I)
        n = len(matrix)
        if n < 2:
            raise ValueError(f"I: expected shape (n, n) with n > 1, got {matrix.shape}")
        if a is None:
            rotation = np.eye(n)
        else:
            axis = unit_axis("a", a, n)
            if axis.ndim != 1:
                raise ValueError(f"a: expected shape ({n},), got {axis.shape}")
            rotation = _shortest_rotation_to_last(axis)
        block = (matrix if a is None else rotation @ matrix @ rotation.T)[:-1, :-1]
        if abs(block - np.diag(np.diag(block))).max() > 1e-15 * abs(matrix).max():
            turn = np.eye(n)
            turn[:-1, :-1] = _principal_axes(block)
            rotation = turn @ rotation
        adapted = matrix if (rotation == np.eye(n)).all() else rotation @ matrix @ rotation.T
        diagonal = np.diag(adapted)
        return cls(diagonal[:-1] + diagonal[-1], adapted[:-1, -1]), rotation


def _shortest_rotation_to_last(axis: FloatArray) -> FloatArray:
    """The rotation by the smallest angle that takes a unit axis to e_n; the others stay."""
    n = len(axis)
    e = np.eye(n)[-1]
    half_turn = np.eye(n)
    if axis[-1] < 0:  # first turn by pi in the plane of e_1 and e_n
        half_turn[0, 0] = half_turn[-1, -1] = -1.0
        axis = half_turn @ axis
    s = axis + e
    rotation: FloatArray = (
        np.eye(n) - np.outer(s, s) / (1.0 + axis[-1]) + 2.0 * np.outer(e, axis)
    ) @ half_turn
    return rotation


def _principal_axes(block: FloatArray) -> FloatArray:
    """The rotation that makes a symmetric matrix diagonal, near the identity if one is."""
    from scipy.optimize import linear_sum_assignment  # where it is needed: imports take time

    _, vectors = np.linalg.eigh(block)
    _, order = linear_sum_assignment(-(vectors**2))
    axes = vectors[:, order]
    axes = axes * np.copysign(1.0, np.diag(axes))
    if np.linalg.det(axes) < 0:
        axes[:, np.argmin(abs(np.diag(axes)))] *= -1.0
    return axes.T
