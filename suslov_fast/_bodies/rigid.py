"""Rigid bodies with the constraint of the Suslov problem, in any dimension."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .algebra import exact_array
from .base import Body
from .field import QuadraticField

PowerArray = NDArray[np.intc]


@dataclass(frozen=True, eq=False, repr=False)
class RigidBody(Body):
    """A body with the equations J_i x_i' = x_i sum_j I_j x_j - I_i sum_j x_j x_j, and a rotor."""

    def J_I_k(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return J and I (..., m), as in n dimensions, and the momentum (..., 1) of a rotor."""
        raise NotImplementedError

    def field(self) -> QuadraticField:
        """Return the equations of motion as a field, exact for a single body."""
        J, I, k = self.J_I_k()
        if not self.shape:
            J, I, k = (exact_array("body", each, each.shape) for each in (J, I, k))
        unit = np.eye(self.dimension, dtype=np.int64)
        q = unit[:, :, np.newaxis] * I[..., np.newaxis, np.newaxis, :]
        q = (q - I[..., np.newaxis, np.newaxis] * unit) / J[..., np.newaxis, np.newaxis]
        if not k.any():
            return QuadraticField(q)
        turn = np.array([[0, -1], [1, 0]])
        return QuadraticField(q, turn * (k / J)[..., np.newaxis])


def in_units(body: RigidBody) -> tuple[FloatArray, FloatArray, FloatArray, PowerArray, PowerArray]:
    """Return J, I and k of a body, of the order of 1, and the exponents of J, and of I and k."""
    J, I, k = body.J_I_k()
    bounds = J.max(axis=-1, keepdims=True), J.min(axis=-1, keepdims=True)
    moments = np.frexp(bounds)[1].sum(axis=0, dtype=np.intc) // 2
    products = np.frexp(np.maximum(abs(I).max(axis=-1, keepdims=True), abs(k)))[1]
    J, I, k = np.ldexp(J, -moments), np.ldexp(I, -products), np.ldexp(k, -products)
    return J, I, k, moments, products


def shortest_rotation_to_last(axis: FloatArray) -> FloatArray:
    """Return the rotations of smallest angle that take unit axes (..., n) to e_n."""
    n = axis.shape[-1]
    # An axis that points down is first rotated by pi in the plane of e_1 and e_n.
    half_turn = np.eye(n)
    half_turn[0, 0] = half_turn[-1, -1] = -1.0
    down = axis[..., -1, np.newaxis, np.newaxis] < 0.0
    first = np.where(down, half_turn, np.eye(n))
    up = first @ axis[..., np.newaxis]
    s = up + np.eye(n)[:, -1:]
    rotation: FloatArray = np.eye(n) - s @ s.swapaxes(-2, -1) / s[..., -1:, :]
    rotation[..., -1, :] += 2.0 * up[..., 0]
    return rotation @ first
