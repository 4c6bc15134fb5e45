"""Tangent spaces of the manifold on which constraints of mechanics hold."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..checks import FloatArray
from ..fields.constraints import Constraints
from ..maps.ordered_algebra import dual_product, orthonormal, product


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
    size        the dimension m of the spaces, n less the number of constraints
    parameters  the parameters (P, B) of the trajectories

    A tangent vector is a displacement along the holonomic constraints, with the change of velocity
    that the constraints ask for, and a change of velocity along all constraints. The coordinates W
    of tangent vectors V are these two parts, along the first m of n orthogonal axes. Areas in these
    coordinates are those of the motion, without boundary terms: a mass that moves freely on a
    surface keeps them.
    """

    def __init__(self, field: Any, constraints: Constraints, batch: Any, moving: Any) -> None:
        self.constraints, self.moving = constraints, moving
        rows = constraints.rows(moving.tolist())
        first, last, _ = constraints.parts[1].indices(constraints.D)
        of_v = constraints.rows([j for j in range(first, last) if j in moving])
        self.rows = [k for k in rows if k not in of_v] + of_v
        self.size = len(moving) - len(rows)
        self.q, self.g = int((moving < first).sum()), len(rows) - len(of_v)
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

    def _slopes(self, x: FloatArray, which: Any) -> FloatArray:
        """Return the derivatives C (K, r, n) of constraints at states x (K, D), holonomic first."""
        _, slopes = self.constraints.at(x, self.parameters[:, which])
        C: FloatArray = slopes[:, self.rows][..., self.moving]
        return C

    def axes(self, x: FloatArray, which: Any = slice(None)) -> FloatArray:
        """Return axes U (K, n, n), orthogonal matrices, of the spaces at x (K, D).

        Columns are axes along the space, then across, in both parts first of coordinates.
        """
        C, q, g, m = self._slopes(x, which), self.q, self.g, self.size
        U = np.zeros((len(x), len(self.moving), len(self.moving)))
        of_q, of_v = _orthonormal_of(C[:, :g, :q]), _orthonormal_of(C[:, g:, q:])
        across = C.shape[1] - g
        U[:, :q, : q - g], U[:, :q, m : m + g] = of_q[..., g:], of_q[..., :g]
        U[:, q:, q - g : m], U[:, q:, m + g :] = of_v[..., across:], of_v[..., :across]
        return U

    def tangents(self, x: FloatArray, U: FloatArray, W: FloatArray, which: Any) -> tuple[Any, Any]:
        """Return the tangent vectors V (K, n, -) at x with the coordinates W (K, m, -) on axes U.

        U are the axes at a state nearby. The second result is by how much the space has turned
        since: the largest tangent of an angle.
        """
        inner, m = product(self._slopes(x, which), U), self.size
        r, across = inner.shape[1], inner[..., m:]
        G = -inner[..., :m]  # V = U (W, G W)
        for k in range(r):
            for n in range(k + 1, r):
                factor = across[:, n, k, np.newaxis] / across[:, k, k, np.newaxis]
                across[:, n] -= factor * across[:, k]
                G[:, n] -= factor * G[:, k]
        for k in reversed(range(r)):
            for n in range(k + 1, r):
                G[:, k] -= across[:, k, n, np.newaxis] * G[:, n]
            G[:, k] /= across[:, k, k, np.newaxis]
        V = product(U, np.concatenate([W, product(G, W)], axis=1))
        parts = G[:, : self.g, : self.q - self.g], G[:, self.g :, self.q - self.g :]
        turned = np.max([abs(part).max(axis=(1, 2), initial=0.0) for part in parts], axis=0)
        return V, turned

    def coordinates(self, x: FloatArray, which: Any = slice(None)) -> tuple[Any, Any]:
        """Return B (K, n, m), whose columns span the spaces at x (K, D), and L with L B = 1."""
        U = self.axes(x, which)
        W = np.broadcast_to(np.eye(self.size), (len(x), self.size, self.size))
        B, _ = self.tangents(x, U, W, which)
        return B, np.swapaxes(U[..., : self.size], -2, -1)

    def decomposed(self, x: FloatArray, V: FloatArray, which: Any) -> tuple[FloatArray, FloatArray]:
        """Return Q (K, n, m) and the moduli of the diagonal of R; Q R is V without normal parts."""
        B, L = self.coordinates(x, which)
        inner = product(L, V)
        inner[~np.isfinite(inner).all(axis=(1, 2))] = np.eye(self.size)
        Q, diagonal = orthonormal(inner)
        return product(B, Q), diagonal


def within(basis: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return the part of matrices (..., n, n) within the space of the columns (..., n, d)."""
    return dual_product(basis, product(slopes, basis))


def block_diagonal(blocks: FloatArray) -> FloatArray:
    """Return the matrix (M n, M d) with the blocks (M, n, d) along its diagonal."""
    M, n, d = blocks.shape
    matrix = np.zeros((M, n, M, d))
    matrix[range(M), :, range(M)] = blocks
    return matrix.reshape(M * n, M * d)
