"""The n-dimensional map against its implicit equations in 60 digits."""

import naive
import numba
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast._kernels.elimination import ACCURATE, WIDEST, WIDTH, eliminate
from suslov_fast._kernels.one_system import solve_system

METHODS = ("rank2", "gauss")
every_method = pytest.mark.parametrize("method", METHODS)
BODY_C = sf.SuslovND([1.3, 2.1, 3.7], [0.4, -0.7, 0.5])


def random_problem(rng, m, speed=1.0):
    J, I = rng.uniform(1, 4, m), rng.normal(size=m) / np.sqrt(m)
    return J, I, 0.3 * rng.choice([-1, 1]), speed * rng.normal(size=m) / np.sqrt(m)


def one_step(method, J, I, eps, omega):
    return sf.iterate(sf.SuslovND(J, I), omega, eps, 1, method=method, on_singular="ignore")


@pytest.mark.parametrize("m", [1, 2, 3, 4, 7, 16])
@pytest.mark.parametrize("speed", [0.3, 2.0, 8.0])
def test_orbits(rng, m, speed):
    J, I, eps, omega = random_problem(rng, m, speed)
    exact = naive.orbit_nd(J, I, eps, omega, 12 if m < 7 else 4)
    sizes = np.linalg.norm(np.array(exact, float), axis=1)
    for method in METHODS:
        orbit = sf.iterate(sf.SuslovND(J, I), omega, eps, len(exact) - 1, method=method)
        assert orbit.ok
        assert naive.worst_error(orbit.omega, exact) < 5e-14 * (max(sizes) / min(sizes)) ** 2


def with_small_d(J, I, eps, omega, i, gap):
    """Scale omega so that d_i = J_i - eps p / 2 is gap * J_i."""
    return omega * 2 * J[i] * (1 - gap) / (eps * (I @ omega))


@pytest.mark.parametrize("gap", [1e-1, 1e-3, 1e-6, 1e-9, 1e-12, 0.0])
@pytest.mark.parametrize(("m", "equal"), [(3, False), (6, False), (5, True)])
def test_small_d(rng, m, equal, gap):
    """If one d_i or two nearly vanish, A is regular, but the sums of the O(n) step are singular."""
    for k in range(1, m, 2):
        J, I, eps, omega = random_problem(rng, m)
        J[0] = J[k] if equal else J[0]
        omega = with_small_d(J, I, eps, omega, k, gap)
        exact = naive.step_nd(J, I, eps, naive.exactly(*omega))
        size = float(naive.mpmath.norm(exact)) / np.linalg.norm(omega)
        for method in METHODS:
            computed = one_step(method, J, I, eps, omega).final
            assert naive.relative_error(computed, exact) < 1e-11 * max(1, size)


@pytest.mark.parametrize("gap", [1e-5, 1e-8, 1e-11, 1e-13, 1e-15])
@pytest.mark.parametrize(("m", "along"), [(3, False), (5, False), (4, True)])
def test_derivatives_where_all_d_are_small(rng, m, along, gap):
    """A is nearly singular, but the derivative of a problem that is solved is not large."""
    J, I, eps, omega = random_problem(rng, m)
    J[1:] = J[0]
    if along:
        J[0], I[1:] = 0.4 * J[0], 0.0
    omega, body = with_small_d(J, I, eps, omega, 1, gap), sf.SuslovND(J, I)
    exact = naive.derivative(lambda v: naive.step_nd(J, I, eps, v), omega)
    log = naive.mpmath.log(abs(naive.mpmath.det(naive.mpmath.matrix(exact))))
    assert naive.relative_error(sf.jacobian(body, omega, eps).ravel(), sum(exact, ())) < 2e-15
    assert abs(sf.lyapunov_exponents(body, omega, eps, 1).sum() - log) < 1e-14 * abs(log)


@pytest.mark.parametrize("gap", [1e-4, 1e-6, 1e-9])
def test_derivatives_where_three_d_are_small(rng, gap):
    """The condition of A is of the order of 1 / gap, and the problem is not solved."""
    for _ in range(2):
        J, I, eps, omega = random_problem(rng, 5)
        J[:3] = J[0]
        omega = with_small_d(J, I, eps, omega, 0, gap)
        exact = naive.derivative(lambda v: naive.step_nd(J, I, eps, v), omega)  # noqa: B023
        found = sf.jacobian(sf.SuslovND(J, I), omega, eps)
        assert naive.relative_error(found.ravel(), sum(exact, ())) < 1e-13 / gap


@pytest.mark.parametrize(
    ("J", "I", "omega"),
    [
        # One small d in the first step, two in the second.
        ([1.78, 2.8, 4.2, 1.28, 2.8], [-0.51, 0.15, -0.35, -0.13, 0.25], [-12, -13, -31, 18, -4]),
        ([1.0, 10.0, 12.0], [0.4, -0.7, 0.5], [-12, -37, 25]),  # d of both signs, none small
    ],
)
def test_steps_beyond_the_first_zero_of_d(J, I, omega):
    states = sf.iterate(sf.SuslovND(J, I), omega, 0.3, 2, method="rank2").omega
    assert naive.worst_error(states, naive.orbit_nd(J, I, 0.3, omega, 2)) < 1e-13


@pytest.mark.parametrize("speed", [1e2, 1e4, 1e8, 1e16, 1e40])
def test_huge_steps(rng, speed):
    """One step takes |omega| to about |omega| / speed**2, and the scaling follows the state."""
    for _ in range(3):
        J, I, eps, omega = random_problem(rng, 4, speed)
        exact = naive.orbit_nd(J, I, eps, omega, 1)
        for method in METHODS:
            computed = one_step(method, J, I, eps, omega)
            assert naive.relative_error(computed.final, exact[1]) < 2e-13
            further = computed.extend(2).final
            expected = naive.orbit_nd(J, I, eps, computed.final, 2)[-1]
            assert naive.relative_error(further, expected) < 1e-14


@every_method
def test_inverse_and_steady_states(rng, method):
    J, I, eps, omega = random_problem(rng, 6, 0.5)
    body = sf.SuslovND(J, I)
    there = sf.iterate(body, omega, eps, 5, method=method).final
    back = sf.iterate(body, there, -eps, 5, method=method).final
    np.testing.assert_allclose(back, omega, atol=1e-14)
    final = sf.iterate(body, 0.7 * I, eps, 20, method=method).final
    np.testing.assert_allclose(final, 0.7 * I, rtol=1e-13)


@pytest.mark.compiled
def test_many_dimensions(rng):
    J, I = rng.uniform(1, 4, 4999), rng.normal(size=4999) / 70
    run = sf.iterate(sf.SuslovND(J, I), rng.normal(size=4999) / 70, 0.1, 50, save_every=10)
    assert run.ok
    assert np.ptp(run.energy()) < 1e-2


# One d between small and large, and two small ones.
@pytest.mark.parametrize(
    ("low", "high", "factor"), [([0.05], [0.1], 25), ([0.0, 0.001], [0.01, 0.02], 5)]
)
def test_rank2_uses_elimination_for_small_d(rng, low, high, factor):
    ratios = []
    for own in rng.uniform(low, high, (60, len(low))) * rng.choice([-1, 1], (60, len(low))):
        J, I, eps, omega = random_problem(rng, 4)
        J[1 : len(low)] = J[0] * (1 - own[0]) / (1 - own[1:])
        omega = with_small_d(J, I, eps, omega, 0, own[0])
        exact = naive.step_nd(J, I, eps, omega)
        short, eliminated = (
            naive.relative_error(one_step(method, J, I, eps, omega).final, exact)
            for method in METHODS
        )
        ratios.append(short / max(eliminated, 1e-16))
    assert np.quantile(ratios, 0.9) < factor


def test_poles_with_one_small_d(rng):
    """A is singular to rounding at omega times -1 over an eigenvalue of A(omega) - Id."""
    problems = []
    for _ in range(300):
        J, I, omega = rng.uniform(1, 4, 3), rng.normal(size=3), rng.normal(size=3)
        slope = 2 * np.outer(I, omega) - np.outer(omega, I) - (I @ omega) * np.eye(3)
        for value in np.linalg.eigvals(slope / (2 * J)[:, None]):
            state = -omega / value.real
            d = np.sort(abs(1 - (I @ state) / (2 * J)))
            if value.imag == 0.0 and d[0] < 0.2 and d[1] > 0.15:
                problems.append((J, I, state))
    J, I, omega = map(np.array, zip(*problems, strict=True))
    assert len(J) > 20
    short, eliminated = (one_step(method, J, I, 1.0, omega).status for method in METHODS)
    singular = eliminated == sf.Status.SINGULAR
    assert singular.sum() > 10
    assert (short[singular] == sf.Status.SINGULAR).all()


def test_large_singular_matrices(rng):
    """The rounding errors of vanishing pivots grow with the number of equations."""
    J, I, omega = rng.uniform(1, 4, (60, 30)), *rng.normal(size=(2, 60, 30))
    J[:, :3] = 2.0
    omega *= (4.0 / (I * omega).sum(axis=1))[:, None]
    status = one_step("gauss", J, I, 1.0, omega).status
    assert np.count_nonzero(status == sf.Status.SINGULAR) > 57


@pytest.mark.parametrize("m", [1, 2, 3, 8])
@pytest.mark.parametrize("width", [WIDTH, WIDEST])
def test_systems_side_by_side(rng, m, width):
    """The ratio of pivots tells which are accurate; units of the unknowns change no bit."""
    matrix = np.eye(m) + rng.normal(size=(width, m, m)) * 10.0 ** rng.uniform(-9, 1, (width, 1, 1))
    right, units = rng.normal(size=(width, m, 1)), 2.0 ** rng.integers(-25, 25, m)
    matrix[7] = 0.0
    whole, ratios = np.concatenate([matrix, right], axis=2), []
    moved = whole * np.append(1 / units, 1.0) * units[:, np.newaxis]
    for systems in (whole, moved):
        systems[...] = np.moveaxis(solved_together(np.moveaxis(systems, 0, 2), ratios), 2, 0)
    assert not ratios[0][7] > 0.0
    accurate = ratios[0] > ACCURATE
    assert accurate.sum() > width / 2
    np.testing.assert_array_equal(*ratios)
    np.testing.assert_array_equal(moved[accurate, :, m], units * whole[accurate, :, m])
    for each in np.flatnonzero(accurate):
        exact = naive.mpmath.lu_solve(naive.mpmath.matrix(matrix[each].tolist()), right[each, :, 0])
        error = naive.relative_error(whole[each, :, m], list(exact))
        assert error < 5e-15 * np.linalg.cond(matrix[each])


@numba.njit
def eliminated(systems, ratio):
    eliminate(systems, ratio)


@numba.njit
def solved(system, scales):
    solve_system(system, scales)


def solved_together(systems, ratios):
    systems, ratio = np.ascontiguousarray(systems), np.empty(systems.shape[2])
    with np.errstate(all="ignore"):
        eliminated(systems, ratio)
    ratios.append(ratio)
    return systems


@pytest.mark.parametrize("m", [1, 2, 3, 8])
def test_one_system(rng, m):
    """Entries over ten orders of magnitude, in units far apart, have a small relative change."""
    for _ in range(30):
        units = 10.0 ** rng.uniform(-20, 20, m)
        matrix = rng.normal(size=(m, m)) * 10.0 ** rng.uniform(-5, 5, (m, m))
        matrix = (np.eye(m) + matrix * (rng.random((m, m)) < 0.7)) * units[:, np.newaxis] / units
        right = rng.normal(size=(m, 2)) * units[:, np.newaxis]
        system = np.empty((2, m, m + 2))
        system[0] = np.concatenate([matrix, right], axis=1)
        with np.errstate(all="ignore"):
            solved(system, np.empty((2, m)))
        exactly = np.vectorize(naive.mpf, otypes=[object])
        solution, matrix, right = map(exactly, (system[0, :, m:], matrix, right))
        terms = abs(matrix) @ abs(solution) + abs(right)
        assert (abs(matrix @ solution - right) < 1e-15 * terms).all()


@pytest.mark.parametrize(("rows", "pivot"), [([[1, 1e30], [1e-30, 1]], 0), ([[3]], 3)])
def test_singular_systems(rows, pivot):
    m = len(rows)
    system = np.array([np.column_stack([rows, np.ones(m)])] * 2)
    with np.errstate(all="ignore"):
        solved(system, np.empty((2, m)))
    assert system[0, m - 1, m - 1] == pivot
    assert np.isnan(system[0, :, m]).all() == (pivot == 0)


def test_elimination_beyond_memory():
    """Matrices beyond any address space are refused before anything is computed."""
    ones = np.ones(2**21)
    with pytest.raises(MemoryError, match=r"bytes to work in|elimination works in"):
        one_step("gauss", ones, ones, 1.0, ones)
