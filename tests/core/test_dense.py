"""Fields of many variables, against the implicit equations by NumPy.

Steps of dense fields, lane by lane; derivatives along orbits of dense and of sparse fields.
"""

import ctypes

import numpy as np
import pytest

from suslov_fast.core.compiling.codes import CHANGED
from suslov_fast.core.fields import generated_tangent, long_tangent, tangent
from suslov_fast.core.fields.called_stages import StageByLoops
from suslov_fast.core.fields.stages import Scheme, Stages
from suslov_fast.core.fields.steps import _Lines, scheme_of
from suslov_fast.core.lists.planned_elimination import LEAST_PIVOT

D = 11


def terms(rng, D=D):
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
    D, y = len(x), np.append(x, 1.0)
    A, b = np.eye(D), x.copy()
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
    minors = [np.linalg.det(sorted_rows[:k, :k]) for k in range(len(A) + 1)]
    return np.divide(minors[1:], minors[:-1])


@pytest.mark.parametrize("for_each", [False, True])
@pytest.mark.parametrize("W", [1, 8])
@pytest.mark.compiled
@pytest.mark.slow_to_compile
def test_stages_solve_the_implicit_equations(rng, W, for_each):
    """Where pivots are large enough; other lanes wait, and those with det A < 0 are told."""
    indices = terms(rng)
    step, signs = scheme_of(indices, D).step, 0
    values = rng.normal(size=(W if for_each else 1, indices.shape[1]))
    notes = np.zeros(W, np.int8), np.zeros(W, np.int64), np.zeros(W)
    bits, seen = 1 << np.arange(W), set()
    for n in range(240 // W):
        scheme = Scheme(step, Stages((1.0,) if n % 2 else (0.5, 0.5)))
        x = rng.normal(size=(D, W))
        x[3, 6:7] = np.nan
        lines = _Lines(
            (scheme, 1.2 * values / scheme.stages.fractions[0], np.ones(1)), x.T, notes, W
        )
        half = scheme.stages.fractions[0] * lines.halves[0].T
        before, wanted, refused, negative = x.copy(), x.copy(), np.isnan(x[3]), np.zeros(W, bool)
        for l in np.flatnonzero(~refused):
            A, b = equations(indices, half[l % len(half)], x[:, l])
            pivots = pivots_of(A, np.arange(D))
            sizes = abs(np.concatenate([pivots, A.diagonal(), [1.0]]))
            refused[l] = abs(pivots).min() <= LEAST_PIVOT * sizes.max()
            if not refused[l]:
                wanted[:, l], negative[l] = np.linalg.solve(A, b), np.linalg.det(A) < 0
            seen.add((refused[l], negative[l]))
        stage = StageByLoops(lines)
        stage.tables_of(0)
        code = ctypes.CFUNCTYPE(*[ctypes.c_int64] * 4)(stage.code)
        found = code(x.ctypes.data, int(stage.plan[0, 0]), stage.own.ctypes.data)
        np.testing.assert_allclose(x, wanted, rtol=1e-9, atol=1e-9)
        changed = (wanted[5] * before[5] < 0) & (n % 2 == 1)  # of whole steps, not of stages
        told = [bits[each].sum() for each in (refused, negative, changed)]
        assert found == told[0] + (told[1] << 8) + (told[2] << 8 + CHANGED)
        signs |= told[2]
    assert signs != 0 or W == 1
    assert len(seen) == 3  # all kinds


class Columns:
    """A line of `long_tangent`, and calls of its code: of lists, or of loops over dense fields."""

    def __init__(self, indices, half, x, has_list):
        D, first = len(x), generated_tangent.LENGTHS
        scheme = scheme_of(indices, D)
        fixed, self.alive = tangent._long_arguments(scheme, 2.0 * half, np.array([1.0]), has_list)
        *self.codes, self.plan, _, width, kept, _, self.table, _ = fixed
        self.kept, self.line = np.full(kept, np.nan), np.zeros(2 * D + first + D * width)
        self.x, self.numbers = self.line[:D], self.line[D : D + first]
        self.lengths, columns = np.split(self.line[D + first :], [D])
        self.columns = columns.reshape(D, width)[:, :D]
        self.x[:], self.lengths[:], self.numbers[generated_tangent.FAR_FROM_1] = x, 1.0, 1.0

    def call(self, code, *arguments):
        arguments = [getattr(each, "ctypes", each) for each in arguments]
        arguments = [getattr(each, "data", each) for each in arguments]
        kind = ctypes.CFUNCTYPE(*[ctypes.c_int64] * (len(arguments) + 1))
        return kind(self.codes[code])(*arguments)

    def take(self, ignored, steps):
        return self.call(0, self.line, self.table, self.kept, self.plan, ignored, steps)

    def orthonormalise(self):
        self.call(1, self.columns, self.numbers, 1, self.kept, self.plan)


@pytest.mark.compiled
@pytest.mark.parametrize("has_list", [True, pytest.param(False, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("D", "size"), [(D, 0.45), (70, 0.2)])  # 64 columns at once
def test_derivatives_along_orbits(rng, D, size, has_list):
    """Columns q become -DPhi q; what stops a run is told."""
    indices, seen, ends = terms(rng, D), 0, 0
    column, pace = rng.normal(size=(D, D)), long_tangent.PACE
    for k in range(60 if D < 64 else 6):
        half, before = size * rng.normal(size=(1, indices.shape[1])), rng.normal(size=D)
        A, b = equations(indices, half[0], before)
        after = np.linalg.solve(A, b)
        B = 2 * np.eye(D) - equations(indices, half[0], after)[0]
        line = Columns(indices, half, before, has_list)
        order = scheme_of(indices, D).step.factors.order if has_list else np.arange(D)
        is_bad = False
        for matrix, most in ((A, np.inf), (B, 1.0)):  # of B, a pivot 1 counts, too
            pivots = abs(pivots_of(matrix, order))
            largest = max(1.0, pivots.max(), abs(matrix.diagonal()).max())
            is_bad |= min(most, pivots.min()) <= LEAST_PIVOT * largest
        flags = [(np.linalg.det(A) < 0, generated_tangent.NEGATIVE)]
        flags.append((after[5] * before[5] < 0, generated_tangent.CHANGED))
        flags.append((is_due := k % 3 == 0, generated_tangent.DUE))
        told = sum(int(is_told) << place for is_told, place in flags)
        line.columns[:], line.numbers[generated_tangent.VOLUME] = column, (2 - is_due) * pace
        assert line.take(1, 3) == 3
        np.testing.assert_array_equal(line.x, before)
        if is_bad:
            assert line.take(0, 3) == 1 << generated_tangent.STEP
            ends += 1
            continue
        seen |= told
        assert line.take(0, 1) == 1 + told
        derivative = np.linalg.solve(A, B)
        np.testing.assert_allclose(line.x, after, rtol=1e-7, atol=1e-9)
        wanted = -derivative @ column
        np.testing.assert_allclose(line.columns, wanted, rtol=1e-7, atol=1e-9 * abs(wanted).max())
        near_1, far = line.numbers[[generated_tangent.NEAR_1, generated_tangent.FAR_FROM_1]]
        logarithm = np.log((1.0 + near_1) * far)
        assert logarithm == pytest.approx(np.linalg.slogdet(derivative)[1], rel=1e-7, abs=1e-9)
    kinds = generated_tangent.NEGATIVE, generated_tangent.CHANGED, generated_tangent.DUE
    assert D > 64 or (ends > 3 and seen == sum(1 << kind for kind in kinds))


@pytest.mark.compiled
def test_columns_are_orthonormalised_as_seldom_as_they_keep_digits(rng):
    """As by QR. A column that loses less than 1/8 of its length lets the next time come later."""
    D, pace = 70, long_tangent.PACE
    indices = terms(rng, D)
    half, limit = np.ones((1, indices.shape[1])), generated_tangent.LIMIT
    line = Columns(indices, half, np.zeros(D), True)
    basis = np.linalg.qr(rng.normal(size=(D, D)))[0]
    for lost, before, after in (
        (1.0, (4, 4), 8),
        (1.0, (16, 16), 16),
        (1.0, (4, 3), 4),  # before its time, because lengths were out of range
        (2 * limit**0.5, (4, 4), 4),
        (2 * limit, (4, 2), 2),
        (2 * limit, (1, 1), 1),
        (np.inf, (8, 8), 4),
    ):
        mixed = np.diag(rng.uniform(0.05, 0.2, D))
        for k in (5, 67):  # of both blocks
            mixed[k - 2, k] = mixed[k, k] * np.sqrt(lost**2 - 1.0) if lost < np.inf else 0.0
        mixed[2, 2] *= lost < np.inf
        line.columns[:], line.lengths[:] = basis @ mixed, 3.0
        line.numbers[generated_tangent.VOLUME] = pace * before[0] + before[1]
        line.orthonormalise()
        assert line.numbers[generated_tangent.VOLUME] == pace * after
        np.testing.assert_allclose(line.lengths, 3.0 * mixed.diagonal(), rtol=1e-6, atol=1e-15)
        if lost < np.inf:
            np.testing.assert_allclose(line.columns, basis, atol=1e-12 * lost)
