"""The reduction of bodies in n dimensions whose J has equal entries to fewer coordinates.

Let E be an eigenspace of diag(J), I_E the part of I in E, and E0 the vectors of E orthogonal to I.
The part of omega in E0 keeps its direction, along the map and along the motion: the proof is in
docs/theory/dimensions.md. So E contributes the coordinate u = omega . I_E / |I_E|, for which I is
|I_E|, unless I_E = 0. It also contributes the signed length r of the part in E0, for which I is 0,
unless E0 = 0. In these coordinates the equations are again equations of a body.
"""

from typing import Any

import numpy as np

from ..checks import FloatArray


class Reduction:
    """The coordinates u and r of a batch of bodies with J and I (..., m).

    Each member has its own eigenspaces, in the order in which their J appear first, and `count`
    coordinates. All members of a result have `size` coordinates; further ones of a member are 0.
    """

    def __init__(self, J: FloatArray, I: FloatArray) -> None:
        self.J, I = np.broadcast_arrays(J, I)
        m = self.J.shape[-1]
        self.first = first_of_equal(self.J)
        multiplicity = self._in_each(np.add, np.ones(m))
        # |I_E| in each eigenspace E, with the sign of I if E has dimension 1: then u is omega_i.
        self.length = np.where(multiplicity == 1, I, self._in_each(np.hypot, I))
        coupled = self.length != 0.0
        self.unit = I / np.where(coupled, self.length, 1.0)
        self.rest = multiplicity - coupled  # the dimension of E0, the part of E orthogonal to I
        # If E0 has dimension 1, r is signed, along a unit vector of E0: 1, or (-unit_j, unit_i).
        i = np.arange(m)
        other = np.where(multiplicity == 2, self._in_each(np.add, i) - i, i).astype(np.int64)
        across = np.take_along_axis(self.unit, other, axis=-1) * np.where(self.first == i, -1, 1)
        self.axis = np.where(self.rest == 1, np.where(coupled, across, 1.0), 0.0)
        # Places 2i and 2i + 1 are for u and r of the eigenspace of J_i, if i is its first index.
        is_first = self.first == i
        present = _interleaved(is_first & coupled, is_first & (self.rest > 0))
        self.count = present.sum(axis=-1)
        self.one_coupled = (is_first & coupled).sum(axis=-1) == 1
        self.steady = ~coupled.any(axis=-1) | (self.count == 1)  # every state is steady
        later = np.repeat(np.where(is_first, 2, 1), 2, axis=-1)
        self.order = np.where(present, 0, later).argsort(axis=-1, kind="stable")
        self.present = present

    def _in_each(self, combine: np.ufunc, values: Any) -> FloatArray:
        """Return for each index the sum, or another combination, of values in its eigenspace."""
        m = self.first.shape[-1]
        values = np.broadcast_to(values, (*_common(values, self.first), m))
        first = np.broadcast_to(self.first, values.shape)
        total = np.zeros(values.shape)
        places = m * np.arange(values.size // m).repeat(m) + first.ravel()
        combine.at(total.reshape(-1), places, values.ravel())
        return np.take_along_axis(total, first, axis=-1)

    def _chosen(self, of_u: Any, of_r: Any, size: int) -> FloatArray:
        """Return the coordinates (..., size), from the values of u and r at each index."""
        values = np.where(self.present, _interleaved(of_u, of_r), 0.0)
        return taken(values, self.order[..., :size])

    def parameters(self, size: int) -> tuple[FloatArray, FloatArray]:
        """Return J and I (..., size) of the reduced bodies."""
        J = taken(_interleaved(self.J, self.J), self.order[..., :size])
        return J, self._chosen(self.length, 0.0, size)

    def further(self, size: int) -> FloatArray:
        """Return the dimension of E0 minus 1 for each coordinate r, and 0 for each u."""
        return self._chosen(0.0, self.rest - 1.0, size)

    def _directions(self, omega: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return u, r and the unit vector of r in E0 at each index."""
        with np.errstate(all="ignore"):
            u = self._in_each(np.add, self.unit * omega)
            across = np.where(self.rest > 1, omega - self.unit * u, 0.0)
            length = self._in_each(np.hypot, across)
            r = np.where(self.rest == 1, self._in_each(np.add, self.axis * omega), length)
            return u, r, self.axis + across / np.where(length > 0.0, length, 1.0)

    def states(self, omega: FloatArray, size: int) -> FloatArray:
        """Return the coordinates (..., size) of states (..., m)."""
        u, r, _ = self._directions(omega)
        return self._chosen(u, r, size)

    def back(self, states: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the states (..., m) that have the coordinates `states` (..., size).

        In each subspace E0, of vectors orthogonal to I in an eigenspace of J, a state has the
        direction that omega has there, and the length r. If the part of omega in an E0 of two or
        more dimensions is 0, but r is not, components in this eigenspace are NaN.
        """
        _, r, direction = self._directions(omega)
        states = np.broadcast_to(states, (*_common(states, r), states.shape[-1]))
        place = self.order.argsort(axis=-1)
        places = (np.take_along_axis(place, 2 * self.first + k, axis=-1) for k in (0, 1))
        # In place of a coordinate that E lacks, the last one is read, and then multiplied by 0.
        u, length = (taken(states, each.clip(max=states.shape[-1] - 1)) for each in places)
        without_direction = (self.rest > 1) & (r == 0.0) & (length != 0.0)
        with np.errstate(all="ignore"):
            return np.where(without_direction, np.nan, self.unit * u + direction * length)


def first_of_equal(J: FloatArray, tolerance: Any = 0.0) -> Any:
    """Return for each J_i (..., m) the first index of an equal entry, up to a `tolerance`."""
    order = J.argsort(axis=-1, kind="stable")
    begins = np.ones(J.shape, bool)
    begins[..., 1:] = np.diff(np.take_along_axis(J, order, axis=-1)) > tolerance
    begin = np.maximum.accumulate(np.where(begins, np.arange(J.shape[-1]), 0), axis=-1)
    first = np.empty_like(order)
    np.put_along_axis(first, order, np.take_along_axis(order, begin, axis=-1), axis=-1)
    return first


def _common(*states: FloatArray) -> tuple[int, ...]:
    return np.broadcast_shapes(*(each.shape[:-1] for each in states))


def _interleaved(of_u: Any, of_r: Any) -> Any:
    """Return the values of u and r at each index (..., m), in turn (..., 2 m)."""
    pairs = np.stack(np.broadcast_arrays(of_u, of_r), axis=-1)
    return pairs.reshape(*pairs.shape[:-2], 2 * pairs.shape[-2])


def taken(values: FloatArray, places: Any) -> FloatArray:
    """Return values (..., n) at places (..., k) on the last axis; batches broadcast."""
    places = places.reshape(*(1,) * (values.ndim - places.ndim), *places.shape)
    return np.take_along_axis(values, places, axis=-1)
