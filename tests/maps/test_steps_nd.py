"""The n-dimensional map against its implicit equations in 60 digits."""

import naive
import numpy as np
import pytest

import suslov_fast as sf

METHODS = ("auto", "gauss")


def random_problem(rng, m, speed=1.0):
    J, I = rng.uniform(1, 4, m), rng.normal(size=m) / np.sqrt(m)
    return J, I, 0.3 * rng.choice([-1, 1]), speed * rng.normal(size=m) / np.sqrt(m)


def one_step(method, J, I, eps, omega):
    return sf.iterate(sf.SuslovND(J=J, I=I), omega, eps, 1, method=method, on_singular="ignore")


def error_by_condition(method, J, I, eps, omega):
    """Error of a step in units of the condition of A, in the plain norm or that of the energy."""
    exact = naive.step_nd(J, I, eps, naive.exactly(*omega))
    run, errors = one_step(method, J, I, eps, omega), []
    A = sf.kahan.matrix(sf.SuslovND(J=J, I=I), omega, eps)
    difference = [naive.mpf(c) - e for c, e in zip(run.final, exact, strict=True)]
    for unit in (np.ones(len(J)), np.sqrt(J)):
        error, size = (np.linalg.norm(unit * np.array(v, float)) for v in (difference, exact))
        errors.append(error / size / np.linalg.cond(unit[:, None] * A / unit))
    return max(errors) if run.ok else 1.0


@pytest.mark.parametrize("m", [1, 2, 3, 4, 7, 16])
@pytest.mark.parametrize("speed", [0.3, 2.0, 8.0])
def test_orbits_in_60_digits(rng, m, speed):
    J, I, eps, omega = random_problem(rng, m, speed)
    exact = naive.orbit_nd(J, I, eps, omega, 12 if m < 7 else 4)
    sizes = np.linalg.norm(np.array(exact, float), axis=1)
    for method in METHODS:
        orbit = sf.iterate(sf.SuslovND(J=J, I=I), omega, eps, len(exact) - 1, method=method)
        assert orbit.ok.all()
        assert naive.worst_error(orbit.states, exact) < 5e-14 * (max(sizes) / min(sizes)) ** 2


@pytest.mark.sampled(4)
@pytest.mark.parametrize("spread", [0.0, 0.3, 4.0])  # J and I within a factor 1e8
@pytest.mark.parametrize("kind", ["any", "next to rest", "small d", "equal J"])
def test_all_lengths_of_steps(rng, spread, kind):
    for _ in range(25):
        m = rng.integers(2, 7)
        J, I, omega = (10.0 ** rng.uniform(-spread, spread, (3, m))) * rng.uniform(1, 4, (3, m))
        I, omega = I * rng.choice([-1, 1], m), omega * rng.choice([-1, 1], m)
        J[:] = J[0] if kind == "equal J" else J
        if kind == "next to rest":
            omega = I * rng.normal() + omega * 10.0 ** rng.uniform(-12, 0)
        eps = 10.0 ** rng.uniform(-3, 4) * rng.choice([-1, 1]) * J.min() / np.linalg.norm(I)
        if kind == "small d":
            omega = with_small_d(J, I, eps, omega, 0, 10.0 ** rng.uniform(-9, 0))
        for method in METHODS:
            assert error_by_condition(method, J, I, eps, omega) < 2e-14


def with_small_d(J, I, eps, omega, i, gap):
    """Scale omega so that d_i = J_i - eps p / 2 is gap * J_i."""
    return omega * 2 * J[i] * (1 - gap) / (eps * (I @ omega))


@pytest.mark.parametrize("gap", [0.2, 1e-2, 1e-4, 2.0**-28, 1e-12, 0.0])
def test_a_small_d(gap):
    """Also of a component with little weight, whose terms the sums hide."""
    for i in range(3):
        J, I, eps = np.array([1.5, 2.5, 3.5]), np.array([0.5, -0.75, 1.0]), 0.5
        omega = with_small_d(J, I, eps, np.array([1.0, 0.25, 1.5]), i, gap)
        assert error_by_condition("auto", J, I, eps, omega) < 1e-15
    J, I = np.array([0.25, 0.5, 1.0]), np.array([-(2.0**-8), -256.0, 2.0**-6])
    omega = with_small_d(J, I, eps, np.array([128.0, 64.0, 1.0]), 0, gap)
    assert error_by_condition("auto", J, I, eps, omega) < 1e-15


def test_omega_and_increment_cancel():
    J, I = [3.0540932173177415] * 2, [0.09800705514253186, 0.5610771457228035]
    omega, eps = [0.8689806892551848, -0.11487839708783203], 383.409665128768
    for factor in (0.1, 0.3, 1.0, 100.0, 1e4):
        assert error_by_condition("auto", J, I, eps * factor, omega) < 1e-15


@pytest.mark.parametrize("speed", [1e2, 1e4, 1e8, 1e16, 1e40])
def test_huge_steps(rng, speed):
    """One step takes |omega| to about |omega| / speed**2."""
    for _ in range(3):
        J, I, eps, omega = random_problem(rng, 4, speed)
        exact = naive.orbit_nd(J, I, eps, omega, 1)
        for method in METHODS:
            assert naive.relative_error(one_step(method, J, I, eps, omega).final, exact[1]) < 2e-13


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
