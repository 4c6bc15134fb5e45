"""Steps and closed form of bodies and gyrostats: one table, then what holds to the bit."""

import naive
import numpy as np
import pytest
from problems import PROBLEMS

import suslov_fast as sf
from suslov_fast.core import steps_3d
from suslov_fast.core.codes import NONFINITE, OK, SINGULAR, SUPERCRITICAL
from suslov_fast.engine import threads

every_problem = pytest.mark.parametrize("problem", PROBLEMS, ids=lambda each: each.name)
each_solved = pytest.mark.parametrize(
    "problem", [each for each in PROBLEMS if each.solved], ids=lambda each: each.name
)


def assert_close(states, orbit, tolerance):
    orbit = np.array(orbit, float)
    size = np.linalg.norm(orbit, axis=-1).max()
    assert np.linalg.norm(states - orbit, axis=-1).max() <= tolerance * size


@every_problem
def test_step_and_iterate(problem):
    orbit, body = np.array(problem.orbit(), float), problem.body()
    run = sf.iterate(body, problem.omega, problem.eps, problem.steps)
    assert_close(run.states, orbit, problem.tolerance)
    for state in orbit[:3]:
        exact = problem.next_state(problem.eps, state)
        assert_close([state, sf.step(body, state, problem.eps)], [state, exact], problem.tolerance)
    many = np.tile(problem.omega, (20, 1))
    final = sf.iterate(body, many, problem.eps, problem.steps, save_every=None).final
    assert (final == run.final).all()


@each_solved
def test_exact(problem):
    n, body = np.arange(problem.steps + 1), problem.body()
    orbit = np.array(problem.orbit(), float)
    assert_close(sf.exact(body, problem.omega, problem.eps, n), orbit, problem.tolerance)
    if problem.name.startswith("T = 1"):
        return  # state 0 is lost in a collapse
    back = sf.exact(body, problem.omega, -problem.eps, -n)
    assert_close(back, orbit, problem.tolerance)


@each_solved
def test_limits(problem):
    """The limits of the closed form; none for orbits that turn."""
    body, omega, eps = problem.body(), problem.omega, problem.eps
    limits = np.array(sf.limits(body, omega, eps))
    assert np.isnan(limits).any() == ("turns" in problem.name)
    if np.isfinite(limits).all() and "T = 1" not in problem.name:
        far = np.array([sf.exact(body, omega, eps, n) for n in (-(10**12), 10**12)])
        assert_close(far, limits, 1e-5 if problem.name == "small step" else 1e-14)


# ------------------------------------------------------------------------------- to the bit


@pytest.fixture
def mixture(rng):
    """A batch of bodies and gyrostats of all kinds: body, states and eps."""
    B = 300
    I1, I2 = rng.uniform(1, 4, (2, B))
    I13, I23 = rng.uniform(-0.9, 0.9, (2, B))
    k, eps = rng.choice([0, 0, 0.05, 2.0], B), rng.choice([0.05, 0.3, 3.0, -0.3, 0.0], B)
    omega = rng.uniform(-2, 2, (B, 2))
    omega[7, 1], omega[8] = np.nan, np.nan
    I13[20:40], omega[20:40, 1], k[20:40] = 0.0, 0.0, 0.0  # at rest
    I13[40:44] = I23[40:44] = 0.0
    omega[50:53] *= [[1e100], [1e160], [1e200]]
    omega[60:90], k[60:90] = np.stack([I23, -I13], -1)[60:90], 0.0  # many have l = 0 in floats, too
    return sf.SuslovGyrostat(I1, I2, I13, I23, k), omega, eps


def run(body, omega, eps, steps, save_every=1):
    return sf.iterate(body, omega, eps, steps, save_every=save_every, on_singular="ignore")


def assert_same(results, expected):
    for found, want in zip(results, expected, strict=True):
        np.testing.assert_array_equal(found, want)


STEPS = 560  # beyond the first restored states


def test_cuts_threads_and_what_is_saved_change_no_bit(mixture, monkeypatch):
    whole = run(*mixture, STEPS)
    expected = run(*mixture, STEPS, 7)
    assert_same([whole.states[::7], whole.final], [expected.states, expected.final])
    for cuts in ((1, 1, 11, 547), (512, 48), (100, 411, 2, 47)):
        extended = run(*mixture, cuts[0], 7)
        for more in cuts[1:]:
            extended = extended.extend(more, on_singular="ignore")
        assert extended == expected
    monkeypatch.setattr(threads, "CROSSOVER", 0)
    assert sf.iterate(*mixture, STEPS, threads=2, on_singular="ignore") == whole


@pytest.mark.parametrize("size", [1, 3, steps_3d.FEW, steps_3d.FEW + 1, 140])
def test_the_batch_changes_no_bit(mixture, size):
    """A few trajectories are stepped one by one, others in blocks."""
    whole = run(*mixture, STEPS, 7)
    for first in range(0, 300 - size, 29):
        some = slice(first, first + size)
        part = run(*(each[some] for each in mixture), STEPS, 7)
        expected = whole.states[:, some], *(each[some] for each in (whole.final, whole.status))
        assert_same([part.states, part.final, part.status], expected)


def test_states_at_rest_keep_their_bits(mixture):
    body, omega, eps = mixture
    l = body.I13 * omega[:, 0] + body.I23 * omega[:, 1] + body.k
    rests = ((l == 0.0) | (eps == 0.0)) & np.isfinite(omega).all(1)
    end = run(*mixture, STEPS, None)
    assert rests.sum() > 60
    assert (end.final[rests] == omega[rests]).all()
    assert (end.status[rests] >= 0).all()


UNIT = 1.0, 1.0, 1.0, 0.0  # X = eps Omega1 / 2 and Y = -eps Omega2 / 2


def test_statuses():
    """For eps = 2, the denominator is 1 + Omega2 + 2 Omega1**2. The first failure counts."""
    before = np.array(naive.step(1, 1, 1, 0, -2.0, (1.0, -3.0)), float)
    table = (
        ([1.0, -3.0], SINGULAR, 1),  # a pole
        (before, SINGULAR, 2),
        ([0.0, -1.0], SINGULAR, 1),  # 0 / 0
        ([0.0, -0.5], OK, -1),  # at rest
        ([0.5, 0.25], OK, -1),
        ([0.5, -7.0], SUPERCRITICAL, -1),
        ([1e200, 3.0], NONFINITE, 1),  # squares overflow
        ([np.nan, 1.0], NONFINITE, 0),
    )
    omega, status, failed_at = map(np.array, zip(*table, strict=True))
    for first in (0, 1, 2, 5, 9):
        found = run(sf.Suslov3D(*UNIT), omega, 2.0, first).extend(9 - first, on_singular="ignore")
        assert_same([found.status, found.failed_at], [status, failed_at])
        assert np.isnan(found.states[2:, status < 0]).all()
        assert np.isfinite(found.states[:, status >= 0]).all()


@pytest.mark.compiled
@pytest.mark.parametrize("k", [0.0, 1e-3, 0.3, 2.0, 30.0])
def test_F_over_a_million_steps(rng, k):
    I1, I2 = rng.uniform(1, 4, (2, 40))
    I13, I23 = rng.uniform(-0.9, 0.9, (2, 40))
    eps, omega = rng.choice([0.05, 0.3, -0.3, 3.0], 40), rng.uniform(-2, 2, (40, 2))
    final = run(sf.SuslovGyrostat(I1, I2, I13, I23, k), omega, eps, 10**6, None).final

    def F(w):
        l = I13 * w[:, 0] + I23 * w[:, 1] + k
        return (I1 * w[:, 0] ** 2 + I2 * w[:, 1] ** 2) / (4 * I1 * I2 + (eps * l) ** 2)

    assert abs(F(final) / F(omega) - 1).max() < 1e-12


def test_X_that_grows_is_never_flushed():
    """From a distance of 1e-160 to the line an orbit leaves it; towards it, X becomes 0."""
    body, omega = sf.Suslov3D(*UNIT), np.array([[1e-160, -0.9], [1e-160, 0.9]])
    saved = run(body, omega, 1.0, 500).states
    assert abs(saved[:, 0, 0]).max() > 0.1
    assert saved[-1, 1, 0] == 0.0
    with pytest.warns(RuntimeWarning, match="range"):
        states = sf.exact(body, omega, 1.0, np.arange(501))
    assert np.isnan(states[1:, 0]).all()
    np.testing.assert_allclose(saved[:, 1], states[:, 1], atol=1e-13)
    omega = omega + np.array([1e-120, 0])
    states = sf.exact(body, omega, 1.0, np.arange(501))
    np.testing.assert_allclose(run(body, omega, 1.0, 500).states, states, atol=1e-11)


@pytest.mark.parametrize(
    "omega", [[1e3, 1e10], [1e10, 1e25], [1e16, -1e35], [1e61, 0.1], [1e90, -1e91]]
)
def test_huge_states_are_right_or_missing(omega):
    with naive.mp.workdps(400):
        exact = naive.orbit(*UNIT, 1, omega, 9)[-1]
    end = run(sf.Suslov3D(*UNIT), omega, 1.0, 9, None)
    assert end.status < 0 or naive.relative_error(end.final, exact) < 1e-13


# ---------------------------------------------------------------------- of the closed form


def test_n_0_is_the_state_to_the_bit(mixture):
    body, omega, eps = (each[:50] for each in mixture)
    expected = np.where(np.isnan(omega).any(axis=1, keepdims=True), np.nan, omega)
    assert_same([sf.exact(body, omega, eps, 0)], [expected])


def test_signs_and_order_of_n_change_no_bit(rng):
    body, omega = sf.Suslov3D(4, 1, -0.5, -0.3), rng.normal(size=(3, 2))
    n = rng.integers(-40, 40, 200)
    states = sf.exact(body, omega, 0.2, n)
    for j in (0, 17, 199):
        for i in range(3):
            assert_same([sf.exact(body, omega[i], 0.2, n[j])], [states[j, i]])
    many = sf.exact(body, np.tile(omega, (60, 1)), 0.2, n)
    assert_same([many], [np.tile(states, (1, 60, 1))])


def test_the_flow_of_states_that_rest():
    for body, omega in (
        (sf.Suslov3D(*UNIT), [0.0, 2.0]),
        (sf.Suslov3D(3, 2, 0, 0), [1.0, 2.0]),
        (sf.SuslovGyrostat(*UNIT, 0.5), [0.0, 0.0]),
    ):
        assert (sf.flow(body, omega, [-1e300, 0.5, 1e300]) == omega).all()


def test_a_parabolic_orbit():
    """|k| = A exactly: both limits are the one steady state, which is met as 1 / n."""
    body = sf.SuslovGyrostat(1, 1, 1, 0, 1.0)
    omega = [0.0, 1.0]  # R = 1 / sqrt(1 + e**2) < k; for the flow A = 1
    np.testing.assert_allclose(sf.flow(body, omega, [1e9, -1e9]), [[-1, 0]] * 2, atol=1e-8)


def test_a_rotor_beyond_the_range_has_no_next_state():
    """Where X, Y or K is above 1e8, differences of them have lost their digits."""
    body = sf.SuslovGyrostat(2.0, 1.0, 0.5, -0.3, [1e11, 1e3, -1e11])
    found = run(body, [1.0, 0.5], 0.1, 3)
    assert found.status.tolist() == [NONFINITE, OK, NONFINITE]
    assert found.failed_at.tolist() == [1, -1, 1]
    assert np.isnan(found.omega[1:, [0, 2]]).all()
    assert np.isfinite(found.omega[:, 1]).all()
    assert np.isfinite(found.omega[0]).all()
