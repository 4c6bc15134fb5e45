"""Orthonormal columns by reflections: compiled, in NumPy, alone and in batches."""

import numpy as np
import pytest

from suslov_fast.core.numba.orthonormal import decompose_each
from suslov_fast.maps.ordered_algebra import eigenvectors, orthonormal


def by(function, V):
    K, n, _ = V.shape
    found = np.empty((K, n, n)), np.empty((K, n))
    function(V.copy(), *found, np.empty((1, n, n)), np.empty((1, n)))
    return found


@pytest.mark.parametrize("size", [1e-310, 1.0, 1e200])
@pytest.mark.parametrize(
    ("K", "n", "rank"), [(1, 1, 1), (6, 3, 3), (5, 5, 2), (2, 9, 9), (3, 4, 0)]
)
def test_columns(rng, K, n, rank, size):
    V = size * (rng.normal(size=(K, n, rank)) @ rng.normal(size=(K, rank, n)))
    Q, diagonal = orthonormal(V)
    np.testing.assert_allclose(np.swapaxes(Q, 1, 2) @ Q, np.tile(np.eye(n), (K, 1, 1)), atol=1e-14)
    R = np.swapaxes(Q, 1, 2) @ V
    near = 1e-13 * abs(V).max() + 1e-322
    np.testing.assert_allclose(np.tril(R, -1), 0.0, atol=near)
    np.testing.assert_allclose(abs(np.diagonal(R, axis1=1, axis2=2)), diagonal, atol=near)
    in_numpy = by(lambda *a: decompose_each.in_python(0, 1, *a), V)
    for found in (by(decompose_each.serial, V), in_numpy):
        for one, other in zip(found, (Q, diagonal), strict=True):
            np.testing.assert_array_equal(one, other)
    for one, other in zip(orthonormal(V[-1:]), (Q, diagonal), strict=True):
        np.testing.assert_array_equal(one[0], other[-1])


@pytest.mark.parametrize("n", [1, 2, 3, 5, 12])
def test_eigenvectors(rng, n):
    """Of symmetric matrices: generic, with equal eigenvalues, graded, diagonal, and 0."""
    A = rng.normal(size=(6, n, n))
    A[1] = np.eye(n) + A[1, :, :1] * A[1, :, 0]
    A[2] *= np.outer(10.0 ** -np.arange(n), 10.0 ** -np.arange(n))
    A[3], A[4] = np.diag(np.arange(n)), 0.0
    A += np.swapaxes(A, 1, 2)
    V = eigenvectors(A)
    turned = np.swapaxes(V, 1, 2) @ A @ V
    np.testing.assert_allclose(np.swapaxes(V, 1, 2) @ V, np.tile(np.eye(n), (6, 1, 1)), atol=1e-14)
    for k, (found, of) in enumerate(zip(turned, A, strict=True)):
        np.testing.assert_allclose(found - np.diag(np.diag(found)), 0, atol=2e-14 * abs(of).max())
        near = 1e-13 * (abs(np.linalg.eigvalsh(of)) if k == 2 else abs(of).max() + np.zeros(n))
        errors = abs(np.sort(np.diag(found)) - np.linalg.eigvalsh(of))
        assert (errors <= near + 1e-15 * abs(of).max()).all()
        np.testing.assert_array_equal(eigenvectors(of), V[k])
    np.testing.assert_array_equal(V[3:5], np.tile(np.eye(n), (2, 1, 1)))
