"""Steps and closed form of bodies and gyrostats: one table, then what holds to the bit."""

import naive
import numpy as np
import pytest
from problems import PROBLEMS

import suslov_fast as sf
from suslov_fast.core import steps_3d
from suslov_fast.core.codes import NONFINITE, OK, SINGULAR, SUPERCRITICAL

every_problem = pytest.mark.parametrize("problem", PROBLEMS, ids=lambda each: each.name)
each_solved = pytest.mark.parametrize(
    "problem", [each for each in PROBLEMS if each.solved], ids=lambda each: each.name
)


def assert_close(states, orbit, tolerance):
    orbit = np.array(orbit, float)
    size = np.linalg.norm(orbit, axis=-1).max()
    assert np.linalg.norm(states - orbit, axis=-1).max() <= tolerance * size


@every_problem
def test_step(problem):
    for state in problem.orbit()[:3]:
        state = np.array(state, float)
        exact = [state, problem.next_state(problem.eps, state)]
        found = [state, sf.step(problem.body(), state, problem.eps)]
        assert_close(found, exact, problem.tolerance)


@every_problem
def test_iterate(problem):
    run = sf.iterate(problem.body(), problem.omega, problem.eps, problem.steps)
    assert_close(run.states, problem.orbit(), problem.tolerance)
    many = np.tile(problem.omega, (20, 1))
    final = sf.iterate(problem.body(), many, problem.eps, problem.steps, save_every=None).final
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
    """A batch of bodies and gyrostats of all kinds: parameters (I1 ... k), states and eps."""
    B = 300
    I1, I2 = rng.uniform(1, 4, (2, B))
    I13, I23 = rng.uniform(-0.9, 0.9, (2, B))
    k, eps = rng.choice([0, 0, 0.05, 2.0], B), rng.choice([0.05, 0.3, 3.0, -0.3, 0.0], B)
    omega = rng.uniform(-2, 2, (B, 2))
    omega[7, 1], omega[8] = np.nan, np.nan
    I13[20:40], omega[20:40, 1], k[20:40] = 0.0, 0.0, 0.0  # at rest
    I13[40:44] = I23[40:44] = 0.0
    omega[50:53] *= [[1e100], [1e160], [1e200]]
    return (I1, I2, I13, I23, k), omega, eps


def run(parameters, omega, eps, steps, every=7, cuts=(), threads=None):
    """Call the kernel: saved, final, status, failed_at."""
    B = len(omega)
    arrays = tuple(np.ascontiguousarray(np.atleast_1d(v), float) for v in (*parameters, eps))
    saved = np.empty((steps // every + 1 if every else 0, B, 2))
    carry, final = np.empty((B, steps_3d.CARRIED)), np.empty((B, 2))
    status, failed_at, row = np.zeros(B, np.int8), np.full(B, -1), 0
    for start, stop in zip((0, *cuts), (*cuts, steps), strict=True):
        span = 0, B, start, stop, every, row
        arguments = arrays, omega, carry, span, saved, final, status, failed_at
        if threads is None:
            steps_3d.steps.serial(*arguments)
        else:
            steps_3d.steps.parallel(threads, *arguments)
        row = stop // every + 1 if every else 0
    return saved, final, status, failed_at


def assert_same(results, expected):
    for found, want in zip(results, expected, strict=True):
        np.testing.assert_array_equal(found, want)


STEPS = 560  # beyond the first restored states


def test_cuts_threads_and_what_is_saved_change_no_bit(mixture):
    expected = run(*mixture, STEPS)
    for cuts in ((1, 2, 13), (512,), (100, 511, 513)):
        assert_same(run(*mixture, STEPS, cuts=cuts), expected)
    assert_same(run(*mixture, STEPS, threads=3), expected)
    every_state, *ends = run(*mixture, STEPS, every=1)
    assert_same([every_state[::7], *ends], expected)
    assert_same(run(*mixture, STEPS, every=0)[1:], expected[1:])


@pytest.mark.parametrize("size", [1, 3, steps_3d.FEW, steps_3d.FEW + 1, 140])
def test_the_batch_changes_no_bit(mixture, size):
    """A few trajectories are stepped one by one, others in blocks."""
    parameters, omega, eps = mixture
    saved, *ends = run(*mixture, STEPS)
    for first in range(0, 300 - size, 29):
        some = slice(first, first + size)
        part = run([each[some] for each in parameters], omega[some], eps[some], STEPS)
        assert_same(part, [saved[:, some], *(each[some] for each in ends)])


def test_states_at_rest_keep_their_bits(mixture, rng):
    (I1, I2, I13, I23, k), omega, eps = mixture
    omega[60:90] = np.stack([I23, -I13], -1)[60:90]  # many of them have l = 0 in floats, too
    k[60:90] = 0.0
    rests = (I13 * omega[:, 0] + I23 * omega[:, 1] + k == 0.0) | (eps == 0.0)
    rests &= np.isfinite(omega).all(1)
    final, status = run((I1, I2, I13, I23, k), omega, eps, STEPS)[1:3]
    assert rests.sum() > 60
    assert (final[rests] == omega[rests]).all()
    assert (status[rests] >= 0).all()


UNIT = 1.0, 1.0, 1.0, 0.0  # X = eps Omega1 / 2 and Y = -eps Omega2 / 2


def test_statuses():
    """For eps = 2, the denominator is 1 + Omega2 + 2 Omega1**2."""
    omega = np.array([
        [1.0, -3.0],  # a pole
        [0.0, -1.0],  # 0 / 0
        [0.0, -0.5],  # at rest
        [0.5, 0.25],
        [0.5, -7.0],  # T > 1
        [1e200, 3.0],  # squares overflow
        [np.nan, 1.0],
    ])  # fmt: skip
    expected = [SINGULAR, SINGULAR, OK, OK, SUPERCRITICAL, NONFINITE, NONFINITE]
    saved, final, status, failed_at = run((*UNIT, 0.0), omega, 2.0, 3, every=1)
    assert status.tolist() == expected
    assert failed_at.tolist() == [1, 1, -1, -1, -1, 1, 0]
    assert np.isnan(saved[1:, status < 0]).all()
    assert np.isfinite(saved[:, status >= 0]).all()
    assert_same([saved[-1]], [final])


def test_the_first_failure_counts():
    """A pole is the second state; later stretches do not report another failure."""
    before = naive.step(1, 1, 1, 0, -2.0, (1.0, -3.0))
    omega = np.array([[float(v) for v in before]])
    for cuts in ((), (1,), (2, 5)):
        *_, status, failed_at = run((*UNIT, 0.0), omega, 2.0, 9, cuts=cuts)
        assert status == SINGULAR
        assert failed_at == 2


@pytest.mark.compiled
@pytest.mark.parametrize("k", [0.0, 1e-3, 0.3, 2.0, 30.0])
def test_F_over_a_million_steps(rng, k):
    I1, I2 = rng.uniform(1, 4, (2, 40))
    I13, I23 = rng.uniform(-0.9, 0.9, (2, 40))
    eps, omega = rng.choice([0.05, 0.3, -0.3, 3.0], 40), rng.uniform(-2, 2, (40, 2))
    final = run((I1, I2, I13, I23, k), omega, eps, 10**6, every=0)[1]

    def F(w):
        l = I13 * w[:, 0] + I23 * w[:, 1] + k
        return (I1 * w[:, 0] ** 2 + I2 * w[:, 1] ** 2) / (4 * I1 * I2 + (eps * l) ** 2)

    assert abs(F(final) / F(omega) - 1).max() < 1e-12


def test_X_that_grows_is_never_flushed():
    """From a distance of 1e-160 to the line an orbit leaves it; towards it, X becomes 0."""
    omega = np.array([[1e-160, -0.9], [1e-160, 0.9]])
    saved, *_ = run((*UNIT, 0.0), omega, 1.0, 500, every=1)
    assert abs(saved[:, 0, 0]).max() > 0.1
    assert saved[-1, 1, 0] == 0.0
    with pytest.warns(RuntimeWarning, match="range"):
        states = sf.exact(sf.Suslov3D(*UNIT), omega, 1.0, np.arange(501))
    assert np.isnan(states[1:, 0]).all()
    np.testing.assert_allclose(saved[:, 1], states[:, 1], atol=1e-13)
    saved, *_ = run((*UNIT, 0.0), omega + np.array([1e-120, 0]), 1.0, 500, every=1)
    states = sf.exact(sf.Suslov3D(*UNIT), omega + np.array([1e-120, 0]), 1.0, np.arange(501))
    np.testing.assert_allclose(saved, states, atol=1e-11)


@pytest.mark.parametrize(
    "omega", [[1e3, 1e10], [1e10, 1e25], [1e16, -1e35], [1e61, 0.1], [1e90, -1e91]]
)
def test_huge_states_are_right_or_missing(omega):
    with naive.mp.workdps(400):
        exact = naive.orbit(*UNIT, 1, omega, 9)[-1]
    final, status = run((*UNIT, 0.0), np.array([omega]), 1.0, 9, every=0)[1:3]
    assert status < 0 or naive.relative_error(final[0], exact) < 1e-13


# ---------------------------------------------------------------------- of the closed form


def test_n_0_is_the_state_to_the_bit(mixture):
    (I1, I2, I13, I23, k), omega, eps = mixture
    body = sf.SuslovGyrostat(I1[:50], I2[:50], I13[:50], I23[:50], k[:50])
    assert_same(
        [sf.exact(body, omega[:50], eps[:50], 0)],
        [np.where(np.isnan(omega[:50, :1] + omega[:50, 1:]), np.nan, omega[:50])],
    )


def test_signs_and_order_of_n_change_no_bit(rng):
    body, omega = sf.Suslov3D(4, 1, -0.5, -0.3), rng.normal(size=(3, 2))
    n = rng.integers(-40, 40, 200)
    states = sf.exact(body, omega, 0.2, n)
    for j in (0, 17, 199):
        for i in range(3):
            assert_same([sf.exact(body, omega[i], 0.2, n[j])], [states[j, i]])
    many = sf.exact(body, np.tile(omega, (60, 1)), 0.2, n)
    assert_same([many], [np.tile(states, (1, 60, 1))])


def test_limits_of_states_that_rest():
    for body, omega, eps in (
        (sf.Suslov3D(*UNIT), [0.0, 2.0], 0.5),
        (sf.Suslov3D(3, 2, 0, 0), [1.0, 2.0], 0.5),
        (sf.SuslovGyrostat(*UNIT, 0.5), [0.0, 0.0], 0.5),
        (sf.SuslovGyrostat(*UNIT, 0.5), [1.0, 2.0], 0.0),
    ):
        assert (np.array(sf.limits(body, omega, eps)) == omega).all()
        assert (sf.exact(body, omega, eps, [-3, 0.5, 1e15]) == omega).all()
        if eps:
            assert (sf.flow(body, omega, [-1e300, 0.5, 1e300]) == omega).all()


def test_a_parabolic_orbit():
    """|k| = A exactly: both limits are the one steady state, which is met as 1 / n."""
    body = sf.SuslovGyrostat(1, 1, 1, 0, 1.0)
    omega = [0.0, 1.0]  # R = 1 / sqrt(1 + e**2) < k; for the flow A = 1
    np.testing.assert_allclose(sf.flow(body, omega, [1e9, -1e9]), [[-1, 0]] * 2, atol=1e-8)


def test_a_rotor_beyond_the_range_has_no_next_state():
    """Where X, Y or K is above 1e8, differences of them have lost their digits."""
    body = sf.SuslovGyrostat(2.0, 1.0, 0.5, -0.3, [1e11, 1e3, -1e11])
    run = sf.iterate(body, [1.0, 0.5], 0.1, 3, on_singular="ignore")
    assert run.status.tolist() == [NONFINITE, OK, NONFINITE]
    assert run.failed_at.tolist() == [1, -1, 1]
    assert np.isnan(run.omega[1:, [0, 2]]).all()
    assert np.isfinite(run.omega[:, 1]).all()
    assert np.isfinite(run.omega[0]).all()
