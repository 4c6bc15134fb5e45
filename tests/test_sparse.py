"""Steps of sparse fields, lane by lane, against the dense implicit equations by NumPy."""

import numpy as np
import pytest

from suslov_fast.core.careful import CHANGED
from suslov_fast.core.elimination import LEAST_PIVOT
from suslov_fast.core.sparse import pattern_of, size_of, sparse_steps

D = 11


def terms(rng):
    """Indices of v x_j x_k in f_i with x_D = 1: neighbours, distant products, constants."""
    i = np.arange(D)
    linear = [[*i, *i], [*i, *(i + 1) % D], [D] * 2 * D]
    products = [[*i, 0], [*(3 * i + 1) % D, 4], [*rng.integers(0, D, D), 4]]
    constants = [[2, 7], [D] * 2, [D] * 2]
    indices = np.hstack([linear, np.sort(products, axis=0) * [[0], [1], [1]], constants])
    indices[0] = np.hstack([linear[0], products[0], constants[0]])
    keeps = (indices[0] != 5) | (indices[1:] == 5).any(axis=0)  # component 5 keeps its sign
    return np.unique(indices[:, keeps].astype(np.int64), axis=1)


def equations(indices, half, x):
    """Matrix A and right side b of x_next - x = sum of half (x_j x_k_next + x_j_next x_k)."""
    A, b, y = np.eye(D), x.copy(), np.append(x, 1.0)
    for (i, j, k), h in zip(indices.T, half, strict=True):
        for known, sought in ((j, k), (k, j)):
            if sought < D:
                A[i, sought] -= h * y[known]
            else:
                b[i] += h * y[known]
    return A, b


def pivots_of(A, order):
    """Pivots of elimination in an order, as quotients of leading minors."""
    sorted_rows = A[np.ix_(order, order)]
    minors = [np.linalg.det(sorted_rows[:k, :k]) for k in range(D + 1)]
    return np.divide(minors[1:], minors[:-1])


@pytest.mark.parametrize("for_each", [False, True])
@pytest.mark.parametrize("W", [1, 8])
def test_steps_solve_the_implicit_equations(rng, W, for_each):
    """Where pivots are large enough; other lanes wait, and those with det A < 0 are told."""
    indices = terms(rng)
    pattern = pattern_of(indices.tobytes(), D)
    half = 0.6 * rng.normal(size=(W if for_each else 1, indices.shape[1]))
    bits, memory, seen = 1 << np.arange(W), np.empty(size_of(pattern)), set()
    signs = 0
    for _ in range(160 // W):
        x = rng.normal(size=(D, W))
        x[3, 6:7] = np.nan
        before, wanted, refused, negative = x.copy(), x.copy(), np.isnan(x[3]), np.zeros(W, bool)
        for l in np.flatnonzero(~refused):
            A, b = equations(indices, half[l % len(half)], x[:, l])
            pivots = pivots_of(A, pattern.order)
            sizes = abs(np.concatenate([pivots, A.diagonal(), [1.0]]))
            refused[l] = abs(pivots).min() <= LEAST_PIVOT * sizes.max()
            if not refused[l]:
                wanted[:, l], negative[l] = np.linalg.solve(A, b), np.linalg.det(A) < 0
            seen.add((refused[l], negative[l]))
        taken = np.array([1, 0])
        sparse_steps.serial(pattern, half, (0, 0, 1), x, memory, taken)
        np.testing.assert_allclose(x, wanted, rtol=1e-9, atol=1e-9)
        told = [bits[each].sum() for each in (refused, negative, wanted[5] * before[5] < 0)]
        assert taken.tolist() == [1, told[0] + (told[1] << 8) + (told[2] << 8 + CHANGED)]
        signs |= told[2]
    assert signs != 0 or W == 1
    assert len(seen) == 3  # all kinds
    # Lanes that have ended, or passed a pole, stop nothing.
    taken = np.array([3, 0])
    sparse_steps.serial(pattern, half, (255, 255, 1), x, memory, taken)
    assert taken.tolist() == [3, 0]
