"""The n-dimensional bodies whose problem is solved: those that move as a body in three does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ._bodies import Suslov3D
from ._bodies_nd import SuslovND
from ._layout import first_index, spell
from ._validation import FloatArray

# What rounding of J and I may come to: from_inertia turns matrices.
_ROUNDING = 1e-14


class NotIntegrableError(ValueError):
    """No closed form and no first integral is known for this body; `iterate` still works."""


@dataclass(frozen=True)
class Reduction:
    """How states of an n-dimensional body are states of a three-dimensional one.

    For n = 3 it is a change of names. Else J I = b I, and J = a on the vectors orthogonal to I:
    then the direction of the part of omega orthogonal to I is constant, and with x = |I| times its
    length and y = b I.omega the closed form of Section 4 holds, a b in place of I1 I2.
    """

    body: SuslovND
    three: Suslov3D
    a: FloatArray
    b: FloatArray

    def state(self, omega: FloatArray) -> FloatArray:
        """The state (..., 2) of the three-dimensional body."""
        if self.body.dimension == 2:
            return np.stack([-omega[..., 1], omega[..., 0]], axis=-1)
        along, _, length = self._parts(omega)
        x = np.sqrt((self.body.I**2).sum(axis=-1)) * length
        # The body `three` has I13 = 0, I23 = 1 and I1 = I2 = sqrt(a b): x = Omega2, y = I1 Omega1.
        return np.stack(np.broadcast_arrays(self.b * along / self.three.I1, x), axis=-1)

    def back(self, state: FloatArray, omega: FloatArray) -> FloatArray:
        """States (..., n - 1), from those of `three` and a state of the same orbit."""
        if self.body.dimension == 2:
            return np.stack([state[..., 1], -state[..., 0]], axis=-1)
        _, across, length = self._parts(omega)
        square = (self.body.I**2).sum(axis=-1)
        with np.errstate(all="ignore"):
            p = self.three.I1 * state[..., 0] / self.b
            stretch = state[..., 1] / (np.sqrt(square) * length)
            along = (p / square)[..., np.newaxis] * self.body.I
            moved = along + np.where(length > 0, stretch, 0.0)[..., np.newaxis] * across
        return np.where((square > 0)[..., np.newaxis], moved, omega)

    def _parts(self, omega: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """I.omega, the part of omega orthogonal to I, and its length."""
        I = self.body.I
        along = (I * omega).sum(axis=-1)
        square = (I**2).sum(axis=-1)
        with np.errstate(all="ignore"):
            parallel = np.where(square > 0, along / square, 0.0)[..., np.newaxis] * I
        across = omega - parallel
        return along, across, np.sqrt((across**2).sum(axis=-1))


def reduce(body: SuslovND, function: str) -> Reduction:
    """The reduction of a body, or an error that names the function that needs it."""
    J, I = body.J, body.I
    if body.dimension == 2:
        three = Suslov3D(J[..., 1], J[..., 0], -I[..., 0], -I[..., 1])
        return Reduction(body, three, J[..., 1], J[..., 0])
    norm = np.sqrt((I**2).sum(axis=-1, keepdims=True))
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
    s = np.sqrt(a * b)
    return Reduction(body, Suslov3D(s, s, 0.0, np.sign(norm[..., 0])), a, b)


def first_integral(
    reduction: Reduction, omega: FloatArray, eps: FloatArray, energy: FloatArray
) -> FloatArray:
    """F = 2 E / (4 a b + eps**2 x**2)."""
    three, state = reduction.three, reduction.state(omega)
    with np.errstate(all="ignore"):
        x = three.I13 * state[..., 0] + three.I23 * state[..., 1]
        value: FloatArray = 2.0 * energy / (4.0 * three.I1 * three.I2 + (eps * x) ** 2)
    return value[()]
