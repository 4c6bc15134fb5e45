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
    *batch, r, n = slopes.shape
    square = np.zeros((math.prod(batch), n, n))
    square[:, :, :r] = np.swapaxes(slopes, -2, -1).reshape(len(square), n, r)
    basis = orthonormal(square)[0][:, :, r:]
    return basis.reshape(*batch, n, n - r)


class TangentSpaces:
    """Tangent spaces of the constraints along trajectories of a batch.

    moving      numbers of the n components that tangent vectors have
    size        the dimension of the spaces, n - r
    parameters  the parameters (P, B) of the trajectories
    """

    def __init__(self, field: Any, constraints: Constraints, batch: Any, moving: Any) -> None:
        self.constraints, self.moving = constraints, moving
        self.size = len(moving) - len(constraints.rows(moving.tolist()))
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

    def basis(self, x: FloatArray, which: Any = slice(None)) -> FloatArray:
        """Return orthonormal columns (K, n, size) at states x (K, D) of trajectories `which`."""
        moving = self.moving.tolist()
        return tangent_basis(self.constraints.of(x, self.parameters[:, which], moving)[1])

    def decomposed(self, x: FloatArray, V: FloatArray, which: Any) -> tuple[FloatArray, FloatArray]:
        """Return Q (K, n, size) and the moduli of R's diagonal; Q R is V without normal parts."""
        basis = self.basis(x, which)
        inner = dual_product(basis, V)
        inner[~np.isfinite(inner).all(axis=(1, 2))] = np.eye(self.size)
        Q, diagonal = orthonormal(inner)
        return dual_product(np.swapaxes(basis, -2, -1), Q), diagonal


def within(basis: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return the part of matrices (..., n, n) within the space of the columns (..., n, d)."""
    return dual_product(basis, product(slopes, basis))


def block_diagonal(blocks: FloatArray) -> FloatArray:
    """Return the matrix (M n, M d) with the blocks (M, n, d) along its diagonal."""
    M, n, d = blocks.shape
    matrix = np.zeros((M, n, M, d))
    matrix[range(M), :, range(M)] = blocks
    return matrix.reshape(M * n, M * d)
