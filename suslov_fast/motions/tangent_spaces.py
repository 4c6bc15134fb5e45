"""Tangent spaces of the manifold on which constraints of mechanics hold."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..checks import FloatArray
from ..fields.constraints import Constraints
from ..maps.orthonormal import dual_product, orthonormal, product


def tangent_basis(slopes: FloatArray) -> FloatArray:
    """Return orthonormal columns (..., n, n - r), to which all rows of slopes (..., r, n) are 0."""
    r = slopes.shape[-2]
    basis: FloatArray = _orthonormal_of(slopes)[..., r:]
    return basis


def _orthonormal_of(slopes: FloatArray) -> FloatArray:
    """Return orthonormal columns (..., n, n); the first r span the rows of slopes (..., r, n)."""
    *batch, r, n = slopes.shape
    square = np.zeros((math.prod(batch), n, n))
    square[:, :, :r] = np.swapaxes(slopes, -2, -1).reshape(len(square), n, r)
    return orthonormal(square)[0].reshape(*batch, n, n)


class TangentSpaces:
    """Tangent spaces of the constraints along trajectories of a batch.

    moving      numbers of the n components that tangent vectors have
    size        the dimension of the spaces, n - r
    parameters  the parameters (P, B) of the trajectories
    """

    def __init__(self, field: Any, constraints: Constraints, batch: Any, moving: Any) -> None:
        self.constraints, self.moving = constraints, moving
        self.size = len(moving) - len(constraints.rows(moving.tolist()))
        self.of_v = constraints.rows(range(*constraints.parts[1].indices(constraints.D)))
        given = field._inputs
        of_batch = (1,) * (len(batch) - (given.ndim - 1))
        P, B = len(given), math.prod(batch)
        given = given.reshape(P, *of_batch, *given.shape[1:])
        self.parameters = np.broadcast_to(given, (P, *batch)).reshape(P, B)

    def of(self, where: Any) -> TangentSpaces:
        """Return the spaces of the trajectories `where`."""
        part = object.__new__(TangentSpaces)
        vars(part).update(vars(self), parameters=self.parameters[:, where])
        return part

    def coordinates(self, x: FloatArray, which: Any = slice(None)) -> tuple[Any, Any]:
        """Return B (K, n, size), whose columns span the spaces at x (K, D), and L with L B = 1.

        A tangent vector is a displacement along the holonomic constraints, with the change of
        velocity that the constraints ask for, and a change of velocity along all constraints. L
        gives these two parts. Their areas are those of the motion, without boundary terms: a mass
        that moves freely on a surface keeps them.
        """
        moving = self.moving.tolist()
        rows = self.constraints.of(x, self.parameters[:, which], moving)[1]
        of_q = self.moving < self.constraints.parts[0].stop
        phi = [k for k, row in enumerate(self.constraints.rows(moving)) if row in self.of_v]
        g = [k for k in range(rows.shape[-2]) if k not in phi]
        along = tangent_basis(rows[:, g][..., of_q])
        A = rows[:, phi][..., ~of_q]
        whole = _orthonormal_of(A)
        across, free = whole[..., : len(phi)], whole[..., len(phi) :]
        asked = -dual_product(np.swapaxes(rows[:, phi][..., of_q], -2, -1), along)
        triangle = dual_product(np.swapaxes(A, -2, -1), across)
        for k in range(len(phi)):  # forward substitution in A across = triangle
            for n in range(k):
                asked[:, k] -= triangle[:, k, n, np.newaxis] * asked[:, n]
            asked[:, k] /= triangle[:, k, k, np.newaxis]
        K, n, d = len(x), len(moving), along.shape[-1]
        B = np.zeros((K, n, self.size))
        B[:, of_q, :d], B[:, ~of_q, d:] = along, free
        L = np.swapaxes(B, -2, -1).copy()
        B[:, ~of_q, :d] = dual_product(np.swapaxes(across, -2, -1), asked)
        return B, L

    def decomposed(self, x: FloatArray, V: FloatArray, which: Any) -> tuple[FloatArray, FloatArray]:
        """Return Q (K, n, size) and the moduli of R's diagonal; Q R is V without normal parts."""
        B, L = self.coordinates(x, which)
        inner = dual_product(np.swapaxes(L, -2, -1), V)
        inner[~np.isfinite(inner).all(axis=(1, 2))] = np.eye(self.size)
        Q, diagonal = orthonormal(inner)
        return dual_product(np.swapaxes(B, -2, -1), Q), diagonal


def within(basis: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return the part of matrices (..., n, n) within the space of the columns (..., n, d)."""
    return dual_product(basis, product(slopes, basis))


def block_diagonal(blocks: FloatArray) -> FloatArray:
    """Return the matrix (M n, M d) with the blocks (M, n, d) along its diagonal."""
    M, n, d = blocks.shape
    matrix = np.zeros((M, n, M, d))
    matrix[range(M), :, range(M)] = blocks
    return matrix.reshape(M * n, M * d)
