"""`elimination.solve` alone, against 60 digits: each system is one that some rule of it is for."""

import mpmath
import numpy as np
import pytest
from numba import njit

from suslov_fast.core.compiling import elimination
from suslov_fast.core.compiling.arrays import uncounted
from suslov_fast.core.compiling.codes import NONFINITE, OK, SINGULAR
from suslov_fast.core.compiling.elimination import LARGEST, LEAST, TO_SOLVE, balance, determinant_of


# Calls from compiled code, with arrays of kernels, run the code of the kernels; those from Python
# would compile another.
@njit
def solve(system, units):
    return elimination.solve(uncounted(system), uncounted(units))


@njit
def eliminate(system, b, lanes):
    elimination.eliminate(uncounted(system), uncounted(b), lanes)


@njit
def accept(a, x, b, lanes):
    return elimination.accept(uncounted(a), uncounted(x), uncounted(b), lanes)


FAR = 2.0**60
RANDOM = np.random.default_rng(5).normal(size=(7, 7))
WILKINSON = np.tril(-np.ones((8, 8)), -1) + np.eye(8)
WILKINSON[:, -1] = 1.0  # the last column doubles with each pivot
HILBERT = 1.0 / (np.arange(5)[:, None] + np.arange(5) + 1.0)
UNITS = np.array([1.0, FAR, 1.0 / FAR, 2.0**30])
SYSTEMS = {
    "one unknown": [[0.25]],
    "no pivot in its place": [[0.0, 2.0], [3.0, 0.0]],
    "three exchanges": [[0.0, 0.0, 0.0, 4.0], [0.5, 0.0, 0.0, 1.0], [0, 3.0, 0, 1], [1, 1, 2, 0]],
    "a small pivot": [[1e-12, 1.0, 3.0], [2.0, 1.0, 0.5], [1.0, -1.0, 0.25]],
    "dense": RANDOM,
    "growth": WILKINSON,
    "badly conditioned": HILBERT,
    "units of unknowns": RANDOM[:4, :4] * UNITS / UNITS[:, None],
    "rows of different size": RANDOM[:4, :4] * np.array([[1.0], [1e8], [1e-8], [1e3]]),
    "triangular": np.triu(RANDOM),
    "one way only": np.eye(3) + np.array([[0, 1e9, 0], [0, 0, 1e9], [0, 0, 0]]),
}


def solved(matrix, *sides):
    """Return the solutions (m, sides), the determinant and the status."""
    A = np.array(matrix, float)
    system = np.concatenate([A, np.transpose(sides)], axis=1)[:, :, None].copy()
    units = np.full((2, len(A)), np.nan)
    with np.errstate(all="ignore"):
        status = solve(system, units)
        return system[:, len(A) :, 0], determinant_of(system, units), status


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", SYSTEMS)
def test_solutions_and_determinants(name):
    A = np.array(SYSTEMS[name], float)
    m = len(A)
    sides = np.linspace(1.0, 2.0, m), np.eye(m)[0] - 3.0 * np.eye(m)[-1]
    found, determinant, status = solved(A, *sides)
    assert status == OK
    with mpmath.workdps(60):
        exact = mpmath.matrix(A.tolist())
        inverse = exact**-1
        for k, side in enumerate(sides):
            expected = inverse * mpmath.matrix(side.tolist())
            # To some units in the last place of each entry of A and of the side (Skeel).
            moved = abs_of(inverse) * (
                abs_of(exact) * abs_of(expected) + abs_of(mpmath.matrix(side.tolist()))
            )
            for i in range(m):
                assert abs(mpmath.mpf(found[i, k]) - expected[i]) <= 2.0**-50 * m * moved[i]
        moved = sum(abs(inverse[j, i] * exact[i, j]) for i in range(m) for j in range(m))
        expected = mpmath.det(exact)
        assert abs(mpmath.mpf(determinant) - expected) <= 2.0**-50 * m * moved * abs(expected)


def abs_of(matrix):
    return matrix.apply(abs)


# U has the last column of WILKINSON, of which the last row leaves 2**-30 beside 2**18.
GROWN = np.tril(-np.ones((20, 20)), -1) + np.eye(20)
GROWN[:, -1], GROWN[-1] = 1.0, [1.0] * 18 + [-1.0, 2.0**-30 - 1.0]
ONES = np.ones(3)
NOT_SOLVED = [
    ([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]], ONES, SINGULAR),  # rank 2
    (1e9 * np.arange(1.0, 10.0).reshape(3, 3) / 7.0, ONES, SINGULAR),  # beside large terms
    ([[1.0, 0.1, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]], ONES, SINGULAR),
    ([[1.0, 0.1, 0.2], [0.0, 0.3, 0.6], [0.0, 0.1, 0.2 + 1e-17]], ONES, SINGULAR),  # to rounding
    ([[np.inf, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], ONES, NONFINITE),
    (np.eye(3), [1.0, np.nan, 1.0], NONFINITE),
    (np.eye(3), [1.0, -np.inf, 1.0], NONFINITE),
    (1e-200 * np.eye(3), 1e200 * ONES, SINGULAR),  # 0 beside the 1 of A
    (GROWN, np.ones(20), SINGULAR),
]


@pytest.mark.parametrize(("matrix", "side", "status"), NOT_SOLVED)
def test_systems_without_a_solution(matrix, side, status):
    found, determinant, received = solved(matrix, side)
    assert received == status
    if status == SINGULAR:
        assert determinant == 0.0
        assert np.isnan(found).any()


def test_a_pivot_just_above_rounding_is_none_of_0():
    """The rank of [[1, 1], [1, 1 + d]] is 2 as soon as d is some units in the last place."""
    for d, status in ((2.0**-52, SINGULAR), (2.0**-44, OK)):
        found, determinant, received = solved([[1.0, 1.0], [1.0, 1.0 + d]], [1.0, 1.0])
        assert received == status
        if status == OK:
            assert determinant == pytest.approx(d, rel=1e-12)
            assert found[:, 0].tolist() == [1.0, 0.0]


def test_the_size_of_a_row_goes_with_it():
    """Beside 2**60 a pivot of 2**-60 is none of 0, wherever an exchange of rows puts it."""
    found, determinant, status = solved([[0.0, 1.0], [1.0, 2.0**60]], [1.0, 0.0])
    assert (status, determinant, found[:, 0].tolist()) == (OK, -1.0, [-(2.0**60), 1.0])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("m", [1, 2, 3, 6, 7])
def test_elimination_of_lanes_without_exchanges(rng, m):
    """Two pivots at a time, an odd one last; with the least and the largest pivot of each lane."""
    lanes = 5
    A = np.eye(m)[:, :, None] + rng.uniform(-0.4, 0.4, (m, m, lanes)) / m
    sides = rng.normal(size=(m, 2, lanes))
    system, b = np.concatenate([A, sides], axis=1), np.full((3, lanes), np.nan)
    eliminate(system, b, lanes)
    for l in range(lanes):
        expected = np.linalg.solve(A[..., l], sides[..., l])
        np.testing.assert_allclose(system[:, m:, l], expected, rtol=1e-13, atol=1e-14)
        minors = [np.linalg.det(A[:k, :k, l]) for k in range(m + 1)]
        pivots = np.abs(np.divide(minors[1:], minors[:-1]))
        assert b[LEAST, l] == pytest.approx(pivots.min(), rel=1e-12)
        largest = max(1.0, pivots.max(), A[range(m), range(m), l].max())
        assert b[LARGEST, l] == pytest.approx(largest, rel=1e-12)


def test_units_are_balanced(rng):
    """However far they are apart: several rounds are needed, and no digit changes."""
    for m in (2, 5, 6):
        chosen = 2.0 ** rng.integers(-60, 60, m)
        A = np.hstack([rng.normal(size=(m, m)) * chosen[:, None] / chosen, np.ones((m, 1))])
        balanced, units = A.copy(), np.empty(m)
        balance(balanced, units)
        beside = abs(balanced[:, :m]) * (1 - np.eye(m))
        assert (abs(np.log2(beside.max(axis=0) / beside.max(axis=1))) < 3).all()
        assert (np.frexp(units)[0] == 0.5).all()
        assert (balanced * units[:, None] / np.append(units, 1.0) == A).all()


def test_states_are_accepted_where_they_keep_their_digits():
    """Lanes: all is well, a small pivot, a right side that is not finite, a state that is NaN."""
    a, x, b = np.full((2, 3, 4), 7.0), np.full((2, 4), 5.0), np.zeros((3, 4))
    x[:, 3] = np.nan
    b[LEAST], b[LARGEST], b[TO_SOLVE, 2] = [1.0, 2.0**-5, 1.0, 2.0**-5], 4.0, 2.0
    a[:, 2, 3] = np.nan
    assert accept(a, x, b, 4) == 2
    assert b[TO_SOLVE].tolist() == [0.0, 1.0, 1.0, 0.0]
    np.testing.assert_array_equal(x, [[7.0, 5.0, 5.0, np.nan]] * 2)
