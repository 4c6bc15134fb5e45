"""`exact`, `flow` and `limits` against iteration and Taylor series in 60 digits."""

from fractions import Fraction
from itertools import product

import naive
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast._engine import threads


def random_problem(rng):
    parameters = (*10 ** rng.uniform(-0.7, 0.7, 2), *rng.uniform(-0.5, 0.5, 2))
    eps = 10 ** rng.uniform(-2, 0) * rng.choice([-1, 1])
    return parameters, eps, rng.normal(size=2) * 10 ** rng.uniform(-1, 2.3)


@pytest.mark.parametrize("gap", [0, 1e-15, -3e-16, 1e-12, -1e-8, 1e-4])
def test_on_and_next_to_the_critical_line(unit, gap):
    """The critical line is |y| = 2 I1 I2 / |eps|, which is exact for the unit body."""
    for x, y, eps in product((1e-9, 1e-3, 0.3, 5.0, 1e5), (2, -2), (1, -1)):
        omega = [x, -y * (1 + gap)]
        exact = naive.orbit(1, 1, 1, 0, eps, omega, 4)
        assert naive.worst_error(sf.exact(unit, omega, eps, np.arange(5)), exact) < 2e-15
        if abs(omega[1]) < 2:  # no pole, however small 1 - Y is
            for body in (unit, sf.SuslovGyrostat(1, 1, 1, 0, 0)):
                states = sf.iterate(body, omega, eps, 4, method="canonical").omega
                assert naive.worst_error(states, exact) < 2e-15


def test_limits_against_the_paper(rng):
    for _ in range(10):
        (I1, I2, I13, I23), eps, omega = random_problem(rng)
        body = sf.Suslov3D(I1, I2, I13, I23)
        D = I13**2 * I2 + I23**2 * I1
        h = D * sf.first_integral(body, omega, eps)
        point = 2 * np.sqrt(I1 * I2 * h) * np.array([I23, -I13]) / D
        minus, plus = sf.limits(body, omega, eps)
        np.testing.assert_allclose(minus, np.sign(eps) * point, rtol=1e-13)
        np.testing.assert_allclose(plus, -np.sign(eps) * point, rtol=1e-13)


def test_steady_states():
    body = sf.Suslov3D(4, 1, -0.5, -0.25)
    steady = np.array([[0.375, -0.75], [-0.375, 0.75]])
    for states in (
        *sf.exact(body, steady, 0.2, [-(10**15), -1, 0.5, 10**15]),
        *sf.flow(body, steady, [-1e300, 0.5, 1e300]),
        *sf.limits(body, steady, 0.2),
    ):
        np.testing.assert_allclose(states, steady, rtol=1e-15)
    for method in ("auto", "canonical", "ds2"):
        final = sf.iterate(body, steady, 0.2, 500, method=method).final
        np.testing.assert_allclose(final, steady, rtol=1e-13)


def test_no_state_between_steps_beyond_t_1(unit):
    """Such orbits alternate; beyond 2**53, floats do not tell even numbers from odd ones."""
    omega = [[0.3, 0.1], [0.5, -9.0], [0.0, -9.0]]
    n = [2.5, 3, 2.0**53, 2.0**53 + 2, -(2.0**60), 1e-300, 2.0**51 + 0.5, 2.0**52 + 1]
    with pytest.warns(RuntimeWarning, match="5 of 24 states: no state between") as caught:
        states = sf.exact(unit, omega, 1, n)
    assert caught[0].filename == __file__
    assert caught[0].category is RuntimeWarning
    missing = np.isnan(states).all(axis=-1)
    assert not missing[:, [0, 2]].any()
    assert missing[:, 1].tolist() == [True, False, False, True, True, True, True, False]
    with pytest.raises(ValueError, match=r"steps: expected at most 2\*\*53, got"):
        sf.iterate(unit, omega, 1, 2**53 + 2, save_every=None)


@pytest.mark.parametrize(
    ("k", "time"),
    [(0, 0.3), (0, -0.7), (0, 5.0), (0, -20.0), (0.05, -20.0), (0.9, 2.0), (-3.0, -9.0)],
)
def test_flow_against_taylor_series(rng, k, time):
    for _ in range(2):
        parameters, _, omega = random_problem(rng)
        omega, steps = omega / np.hypot(*omega), int(10 + 5 * (1 + abs(k)) * abs(time))
        exact = naive.flow(*parameters, omega, time, steps=steps, k=k)
        body = sf.SuslovGyrostat(*parameters, k) if k else sf.Suslov3D(*parameters)
        assert naive.relative_error(sf.flow(body, omega, time), exact) < 1e-14


def test_flow_from_the_repelling_half_to_the_attracting_half():
    exact = naive.flow(2, 1, 0, 0.5, [1.5, 1e-30], 138.0, steps=280)
    computed = sf.flow(sf.Suslov3D(2, 1, 0, 0.5), [1.5, 1e-30], 138.0)
    assert exact[0] < -1
    assert naive.relative_error(computed, exact) < 2.5e-14


def test_a_pole_far_ahead(unit):
    """The closed form finds the same pole as iteration, without making the steps."""
    before_pole = [np.sqrt(132.0), -134.0]  # 1 - Y + X**2 = 0
    backwards = naive.orbit(1, 1, 1, 0, -1, before_pole, 50)
    # Rounding errors of more steps than 20 may pass the pole by.
    for to_pole, steps, method in (
        (20, 25, "canonical"), (20, 25, "auto"), (50, 55, "auto"), (50, 10**9, "auto"),
    ):  # fmt: skip
        start = [np.array(backwards[to_pole], float), [0.3, 0.1]]
        options = {"method": method, "save_every": None, "on_singular": "ignore"}
        run = sf.iterate(unit, start, 1, steps, **options)
        assert run.status.tolist() == [sf.Status.SINGULAR, sf.Status.OK]
        assert run.failed_at.tolist() == [to_pole + 1, -1]
        assert np.isnan(run.final[0]).all()


def test_the_status_of_last_states(rng):
    """Status with and without saved states, for states on the critical line up to rounding."""
    body, x = sf.Suslov3D(1.7, 2.3, 0.3, -0.7), rng.uniform(-3, 3, (500, 1))
    omega = sf.from_xy(body, np.insert(x, 1, -2 * 1.7 * 2.3 / 0.3, axis=1))
    jumped = sf.iterate(body, omega, 0.3, 40, save_every=None)
    assert (jumped.status == sf.iterate(body, omega, 0.3, 40).status).all()
    assert len(np.unique(jumped.status)) == 2


@pytest.mark.parametrize("n", [10**6, 10**9])
@pytest.mark.parametrize("X", [1e-12, 1e-60, 1e-145])
def test_far_along_orbits_from_next_to_the_repelling_half(rng, n, X):
    """After 1e6 and 1e9 steps, these orbits are between the repelling and the attracting half."""
    for _ in range(5):
        I1, I2, I23 = 10 ** rng.uniform(-0.7, 0.7, 3)
        a = I1 * I2
        Y = -np.log(X) / (2 * n) * rng.uniform(0.5, 1.5)
        # For I13 = 0, x = I23 Omega2 has no cancellation.
        parameters, omega = (I1, I2, 0.0, I23), [2 * a * Y / (I23 * I1), np.sqrt(2 * a) * X / I23]
        exact = naive.far_state(*parameters, 1.0, omega, n)
        computed = sf.exact(sf.Suslov3D(*parameters), omega, 1.0, n)
        assert naive.energy_error(parameters[:2], computed, exact) < 3e-15


def test_small_components_keep_their_digits():
    """They grow from 1e-300 to the order of 1 and fall below 1e-270, and decay to 1e-236."""
    for omega, n in (([1.5, 1e-300], [600, 900, 1500, 1900]), ([2 / 0.9, 0.04 / 0.45], [200, 500])):
        states = sf.exact(sf.Suslov3D(2, 1, 0.0, 0.5), omega, 0.9, n)
        for each, computed in zip(n, states, strict=True):
            exact = naive.far_state(2, 1, 0.0, 0.5, 0.9, omega, each)
            assert all(abs(c / e - 1) < 2e-15 for c, e in zip(computed, exact, strict=True))


@pytest.mark.parametrize("spread", [1, 5])
def test_any_parameters(rng, spread):
    for _ in range(20):
        parameters = 10 ** rng.uniform(-spread, spread, 4) * [1, 1, *rng.choice([-1, 1], 2)]
        body, omega = sf.Suslov3D(*parameters), rng.normal(size=2)
        eps = rng.uniform(0.01, 0.99) / float(sf.criticality(body, omega, 1.0))
        while sf.criticality(body, omega, eps) > 1:
            eps /= 2
        n = int(rng.integers(-300, 300))
        exact = naive.far_state(*parameters, eps, omega, n)
        assert naive.energy_error(parameters[:2], sf.exact(body, omega, eps, n), exact) < 1e-14


@pytest.mark.parametrize("k", [-930, -37, 930])
def test_the_unit_of_time_of_the_flow(unit, k):
    """Powers of two change no bit, also next to the repelling half."""
    for omega, t in (([2, -1e6], 2e-5), ([2, -1e8], 2e-7), ([1.0, 0.5], 3.0), ([1e-9, -3.0], 9.0)):
        for time in (t, 0.125 * t * np.arange(40)):
            scaled = sf.flow(unit, np.ldexp(omega, k), np.ldexp(time, -k))
            np.testing.assert_array_equal(scaled, np.ldexp(sf.flow(unit, omega, time), k))


def test_limits_of_the_undefined_state(unit):
    """At (X, Y) = (0, 1) the map is 0 / 0, and the inverse map has a fixed point."""
    for Y, order in ((1, 1), (-1, -1)):
        fixed, missing = sf.limits(unit, [0.0, -2.0 * Y], 1)[::order]
        assert np.isnan(missing).all()
        assert fixed.tolist() == [0.0, -2.0 * Y]


@pytest.mark.parametrize("scale", [1e-14, 1e-90, 1e-145, 1e-270])
def test_slow_orbits_reach_their_limits(unit, scale):
    """An orbit with tiny steps follows the flow and has its limits."""
    states = sf.exact(unit, [scale, scale], 1.0, 50 / scale) / scale
    np.testing.assert_allclose(states, sf.flow(unit, [1.0, 1.0], 50), rtol=1e-12, atol=1e-14)
    ends = np.array(sf.limits(unit, [scale, scale], 1.0)) / scale
    np.testing.assert_allclose(ends, [[0, -np.sqrt(2)], [0, np.sqrt(2)]], rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("power", [16, 20])
def test_bodies_in_which_y_cancels(power):
    """Parameters have one decimal, and y = 0 up to the rounding of the decimals."""
    rng, problems = np.random.default_rng(power), []
    while len(problems) < 8:
        I1, I2 = rng.integers(1, 40, 2) / 10
        I13, I23, c = rng.integers(-40, 40, 3) / 10
        omega = np.round([c * I13 * I2, c * I23 * I1], 3)
        if I13 * I23 * c and abs(I23 * I1 * omega[0] - I13 * I2 * omega[1]) < 1e-12:
            problems.append(((I1, I2, I13, I23), omega))
    for (parameters, omega), eps in product(problems, (10.0**power, -(10.0**power))):
        body, exact = sf.Suslov3D(*parameters), naive.orbit(*parameters, eps, omega, 3)
        assert naive.worst_error(sf.iterate(body, omega, eps, 3).omega, exact) < 1e-14
        t = naive.criticality(*parameters, eps, naive.exactly(*omega))
        assert abs(sf.criticality(body, omega, eps) / t - 1) < 2e-15


def state_on_the_pole(I1, I2, I13, I23, x):
    """Return the state with this x and y = 2 I1 I2 + x**2, a pole for eps = 1: 1 - Y + X**2 = 0."""
    y, D = 2 * I1 * I2 + x * x, I13 * I13 * I2 + I23 * I23 * I1
    return [Fraction(I13 * I2 * x + I23 * y, D), Fraction(I23 * I1 * x - I13 * y, D)]


# Bodies whose states on the pole are float64: D is a power of two.
BODIES = (1, 1, 1, 0), (2, 1, 1, 0), (1, 3, 1, 1), (3, 5, 1, -1), (2, 2, 2, -2), (7, 1, 1, 1)


@pytest.mark.parametrize("x", [1, -3, 40])
@pytest.mark.parametrize("parameters", BODIES, ids=str)
def test_poles_in_fractions(parameters, x):
    """Iteration ends at a pole; `exact` lacks only the next state and continues beyond it."""
    pole, body = state_on_the_pole(*parameters, x), sf.Suslov3D(*parameters)
    omega = list(map(float, pole))
    assert naive.rational_step(*parameters, 1, omega) is None
    for method in ("auto", "canonical", "ds2"):
        run = sf.iterate(body, omega, 1, 9, method=method, on_singular="ignore")
        assert (run.status, run.failed_at) == (sf.Status.SINGULAR, 1)
        assert np.isnan(run.omega[1:]).all()
    # State 2 is the limit from both sides; the others are iterated from state 2 or the pole.
    sides = []
    for h in (Fraction(1, 10**40), -Fraction(1, 10**40)):
        state = [pole[0] + h, pole[1]]
        for _ in range(2):
            state = naive.rational_step(*parameters, 1, state)
        sides.append(np.array(state, float))
    np.testing.assert_allclose(*sides, rtol=1e-15)
    expected = {0: omega, 2: sides[0]}
    for n, sign, other in ((2, 1, state), (0, -1, pole)):
        for k in range(1, 4):
            other = naive.rational_step(*parameters, sign, other)
            expected[n + sign * k] = np.array(other, float)
    for n in (np.arange(-3, 6), np.arange(-3, 60)):
        with pytest.warns(sf.SingularStepWarning, match=f"1 of {len(n)} states: no state there"):
            states = sf.exact(body, omega, 1, n)
        assert np.flatnonzero(np.isnan(states[:, 0])).tolist() == [4]
        for k, state_k in expected.items():
            np.testing.assert_allclose(states[k + 3], state_k, rtol=1e-12, atol=1e-13)


def test_runs_past_their_pole(unit, rng):
    """Orbits pass poles alike by "auto" and by "canonical"."""
    omega = np.column_stack([rng.uniform(0.1, 3, 200), rng.uniform(-9, -2.1, 200)])
    omega[7], omega[8], omega[9] = [1.0, -3.0], [1.0, -1e3], [0.0, -5.0]
    runs = [
        sf.iterate(unit, omega, 1, 60, method=method, on_singular="ignore")
        for method in ("auto", "canonical")
    ]
    assert np.flatnonzero(runs[0].status < 0).tolist() == [7]
    assert (runs[0].status == runs[1].status).all()
    assert (runs[0].failed_at == runs[1].failed_at).all()
    np.testing.assert_allclose(runs[0].omega, runs[1].omega, rtol=1e-6, atol=1e-12)
    far = sf.iterate(unit, omega, 1, 10**9 + 1, save_every=None, on_singular="ignore")
    expected = sf.exact(unit, np.delete(omega, 7, axis=0), 1, 10**9 + 1)
    assert (np.delete(far.final, 7, axis=0) == expected).all()
    assert far.failed_at[7] == 1


WAVES = np.cos(np.arange(200.0))
ALMOST = [np.linspace(1.0, 40.0, 200) * (1.0 + jitter * WAVES) for jitter in (1e-9, 1e-11, 2e-13)]
EQUAL = [start + np.arange(100) * step for start, step in ((0.5, 0.1), (100.5, 0.3), (3.0, 0.1))]


@pytest.mark.filterwarnings("ignore:.* no state between two steps")
@pytest.mark.parametrize("n", [*ALMOST, *EQUAL, 100.7 + np.arange(100)])
@pytest.mark.parametrize("omega", [[1.0, 0.5], [0.5, -9.0]])
def test_times_at_and_almost_at_equal_steps(unit, omega, n):
    """A state does not depend on the other times; some are whole, or one rounding error beside."""
    alone = [sf.exact(unit, omega, 0.8, each) for each in n]
    np.testing.assert_allclose(sf.exact(unit, omega, 0.8, n), alone, rtol=1e-13)


def test_a_batch_without_other_orbits_calls_kernels_once(body, monkeypatch):
    """Orbits that turn, are next to |k| = A or have t >= 1 have code of their own."""
    calls, omega, run = [], [[1.0, 0.5], [0.0, 0.0], [np.nan, 1.0]], threads.call_kernel
    monkeypatch.setattr(
        threads, "call_kernel", lambda *given: calls.append(given[-1]) or run(*given)
    )
    gyrostat = sf.SuslovGyrostat(*body.parameters, [0.1, 3.0, 0.0])
    for each in (body, gyrostat):
        sf.iterate(each, omega, 0.2, 40, save_every=3, on_singular="ignore")
        sf.flow(each, omega, 2.0)
    assert set(calls) == {None}
    sf.exact(gyrostat, [1.0, 0.5], 0.2, 1)
    assert calls[-2:] == [None, True]


def test_a_large_batch_that_begins_with_other_orbits(body):
    """The first orbits decide which kernel takes the others, and change no bit."""
    k, omega = np.repeat([3.0, 0.1], [1100, 4000]), np.random.default_rng(0).normal(size=(5100, 2))
    whole = sf.exact(sf.SuslovGyrostat(*body.parameters, k), omega, 0.2, [1, 7])
    for part in (slice(0, 1100), slice(1100, 2000), slice(2000, 5100)):
        gyrostat = sf.SuslovGyrostat(*body.parameters, k[part])
        np.testing.assert_array_equal(sf.exact(gyrostat, omega[part], 0.2, [1, 7]), whole[:, part])
