"""The n-dimensional bodies whose problem is solved: those that move as a body in three does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray, first_index, spell
from .nd import SuslovND
from .three import Suslov3D
from .units import units_of

# What rounding of J and I may come to: from_mass_tensor turns matrices.
_ROUNDING = 1e-14


class NotIntegrableError(ValueError):
    """No closed form and no first integral is known for this body; `iterate` still works."""


@dataclass(frozen=True)
class Reduction:
    """How states of an n-dimensional body are states of a three-dimensional one.

    For n = 3 it is a change of names. Else J I = b I, and J = a on the vectors orthogonal to I:
    then the direction of the part of omega orthogonal to I is constant, and with x = |I| times its
    length and y = b I.omega the closed form of Section 4 holds, a b in place of I1 I2.

    a, b, and I here are those of the body over powers of two, as `units_of` says, and
    `three` is a body over 2**unit of I1 I2 = a b.
    """

    body: SuslovND
    three: Suslov3D
    I: FloatArray
    a: FloatArray
    b: FloatArray
    unit: NDArray[np.intc]

    def state(self, omega: FloatArray) -> FloatArray:
        """The state (..., 2) of the three-dimensional body."""
        if self.body.dimension == 2:
            return np.stack([-omega[..., 1], omega[..., 0]], axis=-1)
        omega, exponent = in_own_unit(omega)
        along, across = self._parts(omega)
        # `three` has I13 = 0, I23 = 1 and I1 = I2 = sqrt(a b), over powers of two: there
        # x = Omega2, y = I1 Omega1.
        y, x = self.b * self._norm * along, self._norm * _length(across)
        reduced = np.stack(np.broadcast_arrays(y / self._root, x), axis=-1)
        with np.errstate(all="ignore"):
            scaled: FloatArray = np.ldexp(reduced, exponent)
        return scaled

    def back(self, state: FloatArray, omega: FloatArray) -> FloatArray:
        """States (..., n - 1), from those of `three` and a state of the same orbit."""
        if self.body.dimension == 2:
            return np.stack([state[..., 1], -state[..., 0]], axis=-1)
        own, exponent = in_own_unit(omega)
        _, across = self._parts(own)
        length = _length(across)
        with np.errstate(all="ignore"):
            state = np.ldexp(state, -exponent)
            along = self._root * state[..., 0] / (self.b * self._norm)
            stretch = np.where(length > 0, state[..., 1] / (self._norm * length), 0.0)
            moved = along[..., np.newaxis] * self._unit + stretch[..., np.newaxis] * across
            moved = np.ldexp(moved, exponent)
        return np.where((self._norm > 0)[..., np.newaxis], moved, omega)

    @property
    def _root(self) -> FloatArray:
        return np.sqrt(self.a) * np.sqrt(self.b)

    @property
    def _norm(self) -> FloatArray:
        return _length(self.I)

    @property
    def _unit(self) -> FloatArray:
        with np.errstate(all="ignore"):
            unit: FloatArray = np.nan_to_num(self.I / self._norm[..., np.newaxis])
        return unit

    def _parts(self, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The component of omega along I, and the vector orthogonal to I that is left.

        The second one is made of the differences I_j omega_i - I_i omega_j, which are accurate next
        to the steady states, where all of them vanish.
        """
        I, unit = self.I, self._unit
        across: FloatArray = np.zeros(np.broadcast_shapes(I.shape, omega.shape))
        coupled = np.flatnonzero((unit != 0).any(axis=tuple(range(unit.ndim - 1))))
        with np.errstate(all="ignore"):
            norm = self._norm[..., np.newaxis]
            for j in coupled:
                difference = _sum_of_products(I[..., j : j + 1], omega, -I, omega[..., j : j + 1])
                across += unit[..., j : j + 1] * np.where(norm > 0, difference / norm, omega)
        return (unit * omega).sum(axis=-1), across


def _sum_of_products(v1: FloatArray, w1: FloatArray, v2: FloatArray, w2: FloatArray) -> FloatArray:
    """v1 w1 + v2 w2 to a few ulps of the sum, however much of it cancels (Dekker, Knuth)."""
    (p1, lost1), (p2, lost2) = _product(v1, w1), _product(v2, w2)
    total = p1 + p2
    t = total - p1
    return np.asarray(total + ((p1 - (total - t)) + (p2 - t) + (lost1 + lost2)))


def _product(v: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The product, rounded, and its rounding error."""
    product, (v1, v2), (w1, w2) = v * w, _halves(v), _halves(w)
    return product, v2 * w2 - (((product - v1 * w1) - v2 * w1) - v1 * w2)


def _halves(v: FloatArray) -> tuple[FloatArray, FloatArray]:
    c = 134217729.0 * v
    high = c - (c - v)
    return high, v - high


def _length(v: FloatArray) -> FloatArray:
    """The Euclidean length along the last axis, in the range of float64 whenever v is."""
    largest = abs(v).max(axis=-1, keepdims=True)
    with np.errstate(all="ignore"):
        length = largest[..., 0] * np.sqrt((np.nan_to_num(v / largest) ** 2).sum(axis=-1))
    return np.asarray(length)


def in_own_unit(omega: FloatArray) -> tuple[FloatArray, NDArray[np.intc]]:
    """States (..., k) over powers of two, which make them of the order of 1; their exponents."""
    _, exponent = np.frexp(abs(omega).max(axis=-1, keepdims=True, initial=0.0))
    return np.ldexp(omega, -exponent), exponent


def reduce(body: SuslovND, function: str) -> Reduction:
    """The reduction of a body, or an error that names the function that needs it."""
    if body.dimension == 2:
        J, I = body.J, body.I
        three = Suslov3D(J[..., 1], J[..., 0], -I[..., 0], -I[..., 1])
        return Reduction(body, three, I, J[..., 1], J[..., 0], np.zeros((), np.intc))
    moments, couplings, (J, I), _ = units_of(body)
    norm = _length(I)[..., np.newaxis]
    coupled = np.broadcast_to(abs(I) > _ROUNDING * norm, np.broadcast_shapes(I.shape, J.shape))
    count = coupled.sum(axis=-1)
    others = body.dimension - count
    of_coupled = np.where(coupled, J, 0.0).sum(axis=-1) / np.maximum(count, 1)
    of_others = np.where(coupled, 0.0, J).sum(axis=-1) / np.maximum(others, 1)
    b = np.where(count > 0, of_coupled, of_others)
    a = np.where((count == 1) & (others > 0), of_others, b)
    fits = abs(J - np.where(coupled, b[..., np.newaxis], a[..., np.newaxis])) <= _ROUNDING * J
    solved = fits.all(axis=-1) | (norm[..., 0] == 0)
    if not np.all(solved):
        which = spell(first_index(~np.atleast_1d(solved)))
        raise NotIntegrableError(
            f"{function}: expected a body with all J equal, or with I along one axis and all other "
            f"J equal; body {which} is not, and no closed form is known for it: use iterate"
        )
    root, half = np.sqrt(a) * np.sqrt(b), (couplings - moments) // 2
    three = Suslov3D(
        np.ldexp(root, -half),
        np.ldexp(root, -half),
        0.0,
        np.ldexp(np.sign(norm[..., 0]), couplings - moments - half),
    )
    return Reduction(body, three, I, a, b, moments + half)


def first_integral(
    reduction: Reduction, omega: FloatArray, eps: FloatArray, energy: FloatArray
) -> FloatArray:
    """F = 2 E / (4 a b + eps**2 x**2)."""
    three, state = reduction.three, reduction.state(omega)
    with np.errstate(all="ignore"):
        x = three.I13 * state[..., 0] + three.I23 * state[..., 1]
        value: FloatArray = np.ldexp(2.0 * energy, -2 * reduction.unit) / (
            4.0 * three.I1 * three.I2 + (eps * x) ** 2
        )
    return value[()]
