"""`exact`, `flow` and `limits` against iteration and Taylor series in 60 digits."""

import warnings
from types import SimpleNamespace

import naive
import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import suslov_fast as sf
from suslov_fast._core.cpu import closed_form as loops
from suslov_fast._core.cpu import equal_steps, tiles
from suslov_fast._engine import closed_form
from suslov_fast._engine.iterate_3d import jumps
from suslov_fast._engine.units import for_loops


def random_problem(rng):
    parameters = (*10 ** rng.uniform(-0.7, 0.7, 2), *rng.uniform(-0.5, 0.5, 2))
    eps = 10 ** rng.uniform(-2, 0) * rng.choice([-1, 1])
    return parameters, eps, rng.normal(size=2) * 10 ** rng.uniform(-1, 2.3)


def worst_error(computed, exact):
    return max(map(naive.relative_error, computed, exact))


@pytest.mark.parametrize("sign", [1, -1])
def test_states_of_the_map(rng, sign):
    seen = {True: 0, False: 0}
    for _ in range(60):
        parameters, eps, omega = random_problem(rng)
        body = sf.Suslov3D(*parameters)
        below = bool(abs(sf.criticality(body, omega, eps)) < 1)
        seen[below] += 1
        exact = naive.orbit(*parameters, sign * eps, omega, 80 if below else 12)
        computed = sf.exact(body, omega, eps, sign * np.arange(len(exact)))
        assert worst_error(computed, exact) < 2e-14
    assert min(seen.values()) > 3


@pytest.mark.parametrize("eps", [1, -1])
@pytest.mark.parametrize("gap", [0, 1e-15, -1e-15, 3e-16, 1e-12, -1e-8, 1e-4])
@pytest.mark.parametrize("x", [1e-9, 1e-3, 0.3, 5.0, 1e5])
def test_on_and_next_to_the_critical_line(gap, x, eps):
    """|y| = 2 I1 I2 / |eps|, which the unit body holds exactly."""
    unit = sf.Suslov3D(1, 1, 1, 0)
    for y in (2 * (1 + gap), -2 * (1 + gap)):
        exact = naive.orbit(1, 1, 1, 0, eps, [x, -y], 4)
        computed = sf.exact(unit, [x, -y], eps, np.arange(5))
        with np.errstate(all="ignore"):
            assert worst_error(computed, exact) < 2e-15


@pytest.mark.parametrize("distance", [1e-3, 1e-8, 1e-15, 1e-60, 1e-170])
def test_orbits_that_leave_the_repelling_line(distance):
    """Here x is exact and as small as can be; after some steps it is not small any more."""
    body = sf.Suslov3D(2, 1, 0, 0.5)
    omega = [1.5, distance]  # x = Omega2 / 2
    steps = int(-2 * np.log(distance)) + 40
    exact = naive.orbit(2, 1, 0, 0.5, 0.9, omega, steps)
    computed = sf.exact(body, omega, 0.9, np.arange(steps + 1))
    assert worst_error(computed, exact) < 3e-16 * (15 - np.log(distance))


def test_real_n_is_the_same_curve(body):
    """Two half steps are a whole one, and the level of F is kept."""
    omega = np.array([[1.0, 0.5], [-0.3, 2.0], [3.0, 1.0]])
    n = np.linspace(-30, 30, 241)
    states = sf.exact(body, omega, 0.4, n)
    F = sf.first_integral(body, states, 0.4)
    assert abs(F / F[:1] - 1).max() < 1e-14
    assert (states[120] == omega).all()
    again = sf.exact(body, states[122], 0.4, np.arange(-5, 6) + 0.5)
    np.testing.assert_allclose(
        again, sf.exact(body, omega, 0.4, np.arange(-5, 6) + 1.0), rtol=1e-13
    )
    np.testing.assert_allclose(sf.step(body, states[121], 0.4), states[125], rtol=1e-13)


@given(
    st.floats(0.05, 20),
    st.floats(-2, 2),
    st.floats(-2, 2),
    st.floats(-1, 1),
    st.tuples(st.floats(-5, 5), st.floats(-5, 5)),
    st.integers(-40, 40),
)
def test_there_and_back(I1, I13, I23, eps, omega, n):
    body = sf.Suslov3D(I1, 1, I13, I23)
    t = abs(sf.criticality(body, omega, eps))
    if t * abs(n) > 3 or t > 0.9:
        n = np.sign(n)
    if t > 0.9:
        return
    back = sf.exact(body, sf.exact(body, omega, eps, n), eps, -n)
    size = np.hypot(*omega) * max(np.sqrt(I1), 1 / np.sqrt(I1))
    growth = np.exp(2 * np.arctanh(t) * abs(n)) / (1 - t)
    assert abs(back - omega).max() <= 1e-14 * size * growth**2


def test_agrees_with_iterate(body, rng):
    omega = rng.uniform(-5, 5, (50, 2))
    orbits = sf.iterate(body, omega, 0.2, 100)
    computed = sf.exact(body, omega, 0.2, orbits.n)
    scale = np.hypot(*np.moveaxis(orbits.omega, -1, 0))[..., None]
    assert (abs(computed - orbits.omega) / scale).max() < 2e-14


@pytest.mark.parametrize("n", [10**12, 10**15])
@pytest.mark.parametrize("omega", [[1.0, 0.5], [-3.0, 0.2], [60.0, -40.0], [1e-3, 2e-3]])
def test_far_away_states_are_the_limits(body, omega, n):
    minus, plus = sf.limits(body, omega, 0.2)
    np.testing.assert_allclose(sf.exact(body, omega, 0.2, n), plus, rtol=1e-14)
    np.testing.assert_allclose(sf.exact(body, omega, 0.2, -n), minus, rtol=1e-14)
    assert (minus == -plus).all()
    assert abs(sf.to_xy(body, plus)[0]) < 1e-15 * np.hypot(*omega)


def test_far_away_states_of_slow_orbits(body):
    """1e15 steps of an orbit that has moved a little by then."""
    omega = np.array([1.0, 0.5]) * 1e-14
    near = sf.exact(body, omega, 0.2, 1e15)
    flowed = sf.flow(body, omega, 0.2e15)
    np.testing.assert_allclose(near, flowed, rtol=1e-13)
    assert abs(near / omega - 1).max() > 1e-3


@pytest.mark.parametrize("size", [1e-30, 1e-80])
def test_states_of_very_slow_orbits(body, size):
    """They move, if only there are steps enough."""
    omega = np.array([1.0, 0.5])
    states = sf.exact(body, omega * size, 0.2, [0.3 / size, 5.0 / size]) / size
    np.testing.assert_allclose(states, sf.flow(body, omega, [0.06, 1.0]), rtol=1e-13)
    assert (abs(states - omega) > 1e-3).any()


def test_limits_against_the_paper(rng):
    for _ in range(20):
        (I1, I2, I13, I23), eps, omega = random_problem(rng)
        body = sf.Suslov3D(I1, I2, I13, I23)
        D = I13**2 * I2 + I23**2 * I1
        h = D * sf.first_integral(body, omega, eps)
        point = 2 * np.sqrt(I1 * I2 * h) * np.array([I23, -I13]) / D
        minus, plus = sf.limits(body, omega, eps)
        np.testing.assert_allclose(minus, np.sign(eps) * point, rtol=1e-13)
        np.testing.assert_allclose(plus, -np.sign(eps) * point, rtol=1e-13)


def test_states_that_do_not_move(body):
    for still, omega, eps in (
        (body, [0.0, 0.0], 0.2),
        (body, [1.0, 0.5], 0.0),
        (sf.Suslov3D(1, 2, 0, 0), [1.0, 0.5], 0.2),
    ):
        assert (sf.exact(still, omega, eps, [-(10**15), 0.5, 7]) == omega).all()
        assert (np.array(sf.limits(still, omega, eps)) == omega).all()
    body = sf.Suslov3D(4, 1, -0.5, -0.25)
    steady = np.array([[0.375, -0.75], [-0.375, 0.75]])
    states = sf.exact(body, steady, 0.2, [-(10**15), -1, 0.5, 10**15])
    np.testing.assert_allclose(states, np.repeat(steady[None], 4, axis=0), rtol=1e-15)
    flowed = sf.flow(body, steady, [-1e300, 0.5, 1e300])
    np.testing.assert_allclose(flowed, np.repeat(steady[None], 3, axis=0), rtol=1e-15)
    for limit in sf.limits(body, steady, 0.2):
        np.testing.assert_allclose(limit, steady, rtol=1e-15)


def test_shapes(body, rng):
    omega = rng.normal(size=(3, 1, 2))
    eps = np.array([0.1, -0.2])
    assert sf.exact(body, omega, eps, 3).shape == (3, 2, 2)
    many = sf.exact(body, omega, eps, np.arange(1200))
    assert many.shape == (1200, 3, 2, 2)
    assert many.flags.c_contiguous
    np.testing.assert_allclose(many[700, 2, 1], sf.exact(body, omega[2, 0], -0.2, 700), rtol=1e-14)
    assert sf.exact(body, omega, eps, []).shape == (0, 3, 2, 2)
    assert sf.exact(body, np.empty((0, 2)), 0.1, [1, 2]).shape == (2, 0, 2)
    assert [limit.shape for limit in sf.limits(body, omega, eps)] == [(3, 2, 2)] * 2
    assert sf.flow(body, omega, [1.0, 2.0]).shape == (2, 3, 1, 2)
    assert sf.flow(body, omega, 1).shape == (3, 1, 2)


def test_no_state_between_steps_beyond_t_1(unit):
    with pytest.warns(RuntimeWarning, match="1 of 4 states: no state between") as caught:
        states = sf.exact(unit, [[0.3, 0.1], [0.5, -9.0]], 1, [2.5, 3])
    assert caught[0].filename == __file__
    assert caught[0].category is RuntimeWarning
    assert np.isnan(states).all(axis=-1).tolist() == [[False, True], [False, False]]


@pytest.mark.parametrize("omega", [[1.0, -3.0], [0.5, -2.25], [0.0, -2.0], [3.0, -11.0]])
def test_no_state_at_a_pole(unit, omega):
    with pytest.warns(sf.SingularStepWarning, match="1 of 3 states: no state there") as caught:
        states = sf.exact(unit, omega, 1, [-1, 0, 1])
    assert caught[0].filename == __file__
    assert np.isnan(states[2]).all()
    np.testing.assert_allclose(states[0], sf.step(unit, omega, -1), rtol=1e-15)


def test_no_state_at_a_pole_of_far_states(unit, rng):
    """As near to the pole as float64 has a state, what is left of the terms is 0 beside them."""
    x = 10 ** rng.uniform(0, 5, 100)
    with pytest.warns(sf.SingularStepWarning):
        states = sf.exact(unit, np.column_stack([x, -(2 + x * x)]), 1, 1)
    assert np.isnan(states).all()


def test_beyond_the_pole_the_orbit_goes_on(unit):
    """The closed form passes through infinity where iteration ends."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sf.SingularStepWarning)
        states = sf.exact(unit, [1.0, -3.0], 1, np.arange(6))
    np.testing.assert_allclose(sf.step(unit, states[2], 1), states[3], rtol=1e-14)
    F = sf.first_integral(unit, states[[0, 2, 3, 4, 5]], 1)
    np.testing.assert_allclose(F, F[0], rtol=1e-14)


@pytest.mark.parametrize("time", [0.3, -0.7, 5.0, -20.0])
def test_flow_against_taylor_series(rng, time):
    for _ in range(4):
        parameters, _, omega = random_problem(rng)
        omega = omega / np.hypot(*omega)
        exact = naive.flow(*parameters, omega, time, steps=int(10 + 5 * abs(time)))
        assert naive.relative_error(sf.flow(sf.Suslov3D(*parameters), omega, time), exact) < 1e-14


@pytest.mark.parametrize("distance", [1e-8, 1e-30])
def test_flow_next_to_the_repelling_line(distance):
    body, omega = sf.Suslov3D(2, 1, 0, 0.5), [1.5, distance]
    time = -2 * np.log(distance)
    exact = naive.flow(2, 1, 0, 0.5, omega, time, steps=int(4 * time))
    computed = sf.flow(body, omega, time)
    assert naive.relative_error(computed, exact) < 3e-16 * (15 - np.log(distance))


def test_flow_to_the_end_of_time(body):
    omega = np.array([[1.0, 0.5], [-1.0, -2.0], [0.0, 0.0], [0.375, -0.625]])
    states = sf.flow(body, omega, [-1e300, -1e3, 0, 1e3, 1e300])
    np.testing.assert_allclose(states[0], states[1], rtol=1e-13)
    np.testing.assert_allclose(states[3], states[4], rtol=1e-13)
    assert (states[2] == omega).all()
    E = sf.energy(body, states)
    np.testing.assert_allclose(E, E[2:3] + np.zeros((5, 1)), rtol=1e-14)
    assert (sf.flow(sf.Suslov3D(1, 2, 0, 0), [1, 2], [1e300, -5]) == [1, 2]).all()


@pytest.mark.parametrize("scale", [2.0**-400, 2.0**400])
def test_scales(body, scale):
    omega = np.array([1.0, 0.5])
    expected = sf.exact(body, omega, 0.25, [7, 90])
    np.testing.assert_allclose(
        sf.exact(body, omega * scale, 0.25 / scale, [7, 90]) / scale, expected, rtol=1e-14
    )
    np.testing.assert_allclose(
        sf.flow(body, omega * scale, 3.0 / scale) / scale, sf.flow(body, omega, 3.0), rtol=1e-14
    )
    heavy = sf.Suslov3D(*(scale * parameter for parameter in body.parameters))
    np.testing.assert_allclose(sf.exact(heavy, omega, 0.25, [7, 90]), expected, rtol=1e-14)
    np.testing.assert_allclose(sf.flow(heavy, omega, 3.0), sf.flow(body, omega, 3.0), rtol=1e-14)


def test_the_map_tends_to_the_flow_with_order_2(body):
    """Measured by regression of the logarithm of the error."""
    omega, time = [1.0, 0.5], 4.0
    steps = 2 ** np.arange(5, 12)
    errors = [
        np.hypot(*(sf.exact(body, omega, time / n, int(n)) - sf.flow(body, omega, time)))
        for n in steps
    ]
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert abs(order - 2) < 0.01


@pytest.mark.parametrize(
    ("bad", "error", "message"),
    [
        ({"n": [[1, 2]]}, ValueError, r"n: expected a number or a 1-D array, got shape \(1, 2\)"),
        ({"n": "3"}, TypeError, "n: expected real numbers, got '3'"),
        ({"n": np.nan}, ValueError, "n: expected finite real numbers, got nan"),
        ({"omega0": [1, 2, 3]}, ValueError, r"omega0: expected shape \(..., 2\), got \(3,\)"),
        ({"eps": [1, 2, 3]}, ValueError, r"broadcast .* eps \(3,\)"),
        ({"body": None}, TypeError, "body: expected Suslov3D or SuslovND, got NoneType"),
    ],
)
def test_bad_input(body, bad, error, message):
    arguments = {"body": body, "omega0": [[1, 2], [3, 4]], "eps": 0.2, "n": 3}
    with pytest.raises(error, match=message):
        sf.exact(**{**arguments, **bad})


def test_bad_input_of_flow_and_limits(body):
    with pytest.raises(ValueError, match=r"t: expected a number or a 1-D array"):
        sf.flow(body, [1, 2], [[1]])
    with pytest.raises(ValueError, match=r"t: expected finite real numbers, got inf"):
        sf.flow(body, [1, 2], np.inf)
    with pytest.raises(ValueError, match=r"omega0: expected shape"):
        sf.limits(body, [1], 0.2)


@pytest.mark.parametrize("bodies", [1, 2])
def test_many_blocks(body, rng, monkeypatch, bodies):
    """A task that goes through several blocks, of one body or of many, keeps each orbit's bits."""
    monkeypatch.setattr(closed_form, "TASKS", 2)
    batch = 4 * loops.WIDTH + 5
    omega = rng.uniform(-2, 2, (batch, 2))
    if bodies > 1:
        body = sf.Suslov3D(rng.uniform(1, 4, batch), 1, -0.5, -0.3)
    states = sf.exact(body, omega, 0.2, 100)
    final = sf.iterate(body, omega, 0.2, 100, save_every=None).final
    assert (final == states).all()
    for i in (0, loops.WIDTH, batch - 1):
        one = body if bodies == 1 else sf.Suslov3D(body.I1[i], 1, -0.5, -0.3)
        assert (sf.exact(one, omega[i], 0.2, 100) == states[i]).all()


@pytest.mark.parametrize("which", range(5))
def test_many_blocks_that_differ_in_one_parameter(rng, monkeypatch, which):
    monkeypatch.setattr(closed_form, "TASKS", 1)
    batch, parameters = 2 * loops.WIDTH + 5, [4.0, 1.0, -0.5, -0.3, 0.2]
    parameters[which] = parameters[which] * rng.uniform(0.5, 2, batch)
    omega = rng.uniform(-2, 2, (batch, 2))
    states = sf.exact(sf.Suslov3D(*parameters[:4]), omega, parameters[4], 100)
    in_steps = sf.exact(sf.Suslov3D(*parameters[:4]), omega, parameters[4], np.arange(101))
    for i in (0, loops.WIDTH, batch - 1):
        *one, eps = (np.broadcast_to(each, batch)[i] for each in parameters)
        assert (sf.exact(sf.Suslov3D(*one), omega[i], eps, 100) == states[i]).all()
        alone = sf.exact(sf.Suslov3D(*one), omega[i], eps, np.arange(101))
        assert (alone == in_steps[:, i]).all()


def test_last_states_after_a_long_run(rng):
    """What `iterate` returns is within 1e-14 after 1000 steps, by the closed form too."""
    for _ in range(8):
        parameters, eps, omega = random_problem(rng)
        body = sf.Suslov3D(*parameters)
        exact = naive.orbit(*parameters, eps, omega, 1000)[-1]
        final = sf.iterate(body, omega, eps, 1000, save_every=None).final
        assert naive.relative_error(final, exact) < 3e-15
        if abs(sf.criticality(body, omega, eps)) < 1:
            final = sf.iterate(body, omega, eps, 1000, save_every=None, method="canonical").final
            assert naive.relative_error(final, exact) < 1e-14


def test_orbits_past_their_pole_jump(unit, rng):
    """Far states of orbits that start before a pole, some of which meet it."""
    omega = np.column_stack([rng.uniform(0.1, 3, 50), rng.uniform(-9, -2.1, 50)])
    omega[7] = [1.0, -3.0]  # on the pole
    omega[8] = [1.0, -1e3]  # passes it after some 800 steps
    omega[9] = [0.0, -5.0]  # rests
    steps = 10**9 + 1
    result = sf.iterate(unit, omega, 1, steps, save_every=None, on_singular="ignore")
    assert np.flatnonzero(result.status < 0).tolist() == [7]
    assert result.failed_at[7] == 1
    expected = sf.exact(unit, omega[np.arange(50) != 7], 1, steps)
    np.testing.assert_allclose(np.delete(result.final, 7, axis=0), expected, rtol=1e-8, atol=1e-12)
    alone = [sf.iterate(unit, each, 1, steps, save_every=None).final for each in omega[[0, 8, 9]]]
    assert (alone == result.final[[0, 8, 9]]).all()


def test_a_pole_far_ahead(unit):
    """It is found where iteration finds it, and in few steps of many."""
    before_pole = [np.sqrt(132.0), -134.0]  # 1 - Y + X**2 = 0
    start = sf.exact(unit, before_pole, -1, 270)
    orbit = sf.iterate(unit, start, 1, 275, method="canonical", on_singular="ignore")
    assert (orbit.status, orbit.failed_at) == (sf.Status.SINGULAR, 271)
    for steps in (275, 10**9):
        jumped = sf.iterate(
            unit, [start, [0.3, 0.1]], 1, steps, save_every=None, on_singular="ignore"
        )
        assert jumped.status.tolist() == [sf.Status.SINGULAR, sf.Status.OK]
        assert jumped.failed_at.tolist() == [271, -1]
        assert np.isnan(jumped.final[0]).all()


def test_the_status_of_last_states(rng):
    """On the critical line too, whatever rounding makes of it, all ways agree."""
    body = sf.Suslov3D(1.7, 2.3, 0.3, -0.7)
    x, eps = rng.uniform(-3, 3, 500), 0.3
    y = np.full(500, -2 * 1.7 * 2.3 / eps)
    omega = sf.from_xy(body, np.column_stack([x, y]))
    jumped = sf.iterate(body, omega, eps, 40, save_every=None)
    assert (jumped.status == sf.iterate(body, omega, eps, 40).status).all()
    assert len(np.unique(jumped.status)) == 2


def test_steps_that_float64_does_not_hold():
    run = SimpleNamespace(method="auto", orientation=None, keeps=False, stop=2**53)
    assert jumps(run)
    run.stop += 1
    assert not jumps(run)


def energy_error(parameters, computed, exact):
    """In the norm that the flow conserves, which no unit of the components matters to."""
    weights = [naive.mpf(float(each)) for each in parameters[:2]]
    difference = [naive.mpf(float(c)) - e for c, e in zip(computed, exact, strict=True)]
    square = sum(w * d * d for w, d in zip(weights, difference, strict=True))
    size = sum(w * e * e for w, e in zip(weights, exact, strict=True))
    return float(naive.mpmath.sqrt(square / size))


def orbit_state(parameters, eps, omega, n):
    """State n of an orbit with t < 1 in 60 digits, by the sequence of the level's eigenvectors."""
    I1, I2, I13, I23, e, w1, w2 = naive.exactly(*parameters, eps, *omega)
    a, D = I1 * I2, I13**2 * I2 + I23**2 * I1
    x, y = I13 * w1 + I23 * w2, I23 * I1 * w1 - I13 * I2 * w2
    X, Y = e * x / naive.mpmath.sqrt(2 * a), e * y / (2 * a)
    H = (X * X + 2 * Y * Y) / (2 + X * X)
    # (X, 1 + Y) -> linear fractional with matrix ((1 + H, -2 H), (-2, 1 + H)) in Y = U / W.
    T = naive.mpmath.sqrt(H)
    big, small = (1 + T) ** (2 * n), (1 - T) ** (2 * n)
    U = (big * (Y - T) * T + small * (Y + T) * T) / (2 * T)
    W = (-big * (Y - T) + small * (Y + T)) / (2 * T)
    Y_n, X_n = U / W, X * (1 - H) ** n / W
    x, y = X_n * naive.mpmath.sqrt(2 * a) / e, Y_n * 2 * a / e
    return [(I13 * I2 * x + I23 * y) / D, (I23 * I1 * x - I13 * y) / D]


@pytest.mark.parametrize("n", [10**6, 10**9])
@pytest.mark.parametrize("X", [1e-12, 1e-60, 1e-145])
def test_far_along_orbits_from_next_to_the_repelling_half(rng, n, X):
    """After a million steps, or a billion, on their way from one half to the other."""
    for _ in range(20):
        I1, I2, I23 = 10 ** rng.uniform(-0.7, 0.7, 3)
        a = I1 * I2
        Y = -np.log(X) / (2 * n) * rng.uniform(0.5, 1.5)
        parameters = (I1, I2, 0.0, I23)
        omega = [2 * a * Y / (I23 * I1), np.sqrt(2 * a) * X / I23]
        # A body with I13 = 0 has x = I23 Omega2: it cancels nowhere.
        with naive.mp.workdps(400):
            exact = orbit_state(parameters, 1.0, omega, n)
            computed = sf.exact(sf.Suslov3D(*parameters), omega, 1.0, n)
            assert energy_error(parameters, computed, exact) < 3e-15


@pytest.mark.parametrize("n", [600, 900, 1200, 1500, 1900])
def test_a_component_keeps_its_digits_however_small_it_is(n):
    """From 1e-300 it grows to the order of 1, and falls below 1e-270."""
    parameters, omega = (2, 1, 0.0, 0.5), [1.5, 1e-300]  # x = Omega2 / 2
    with naive.mp.workdps(700):
        exact = orbit_state(parameters, 0.9, omega, n)
        computed = sf.exact(sf.Suslov3D(*parameters), omega, 0.9, n)
        assert all(abs(c / e - 1) < 1e-15 for c, e in zip(computed, exact, strict=True))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("gap", [1e-8, 1e-14, 1e-15, 3e-16, -1e-15])
def test_a_component_that_one_step_takes_away(gap, sign):
    """Next to Y = -1, where x' = x (1 + Y) / 2 and all digits of 1 + Y are those of a small sum."""
    parameters = (1.7, 2.3, 0.0, 0.7)
    omega = [-sign * (2 * 2.3 / 0.7) * (1 - gap), 0.37]
    exact = naive.step(*parameters, sign, omega)
    computed = sf.exact(sf.Suslov3D(*parameters), omega, 1.0, sign)
    assert all(abs(float(c / e - 1)) < 2e-15 for c, e in zip(computed, exact, strict=True))


@pytest.mark.parametrize("n", [200, 500])
def test_the_level_is_held_in_two_numbers(n):
    """x decays to 1e-236 by the level's n-th power, where X is not negligible beside Y."""
    parameters, eps = (2, 1, 0.0, 0.5), 0.9
    omega = [4 * 0.5 / 0.9, 2 * 0.02 / 0.45]  # X = 0.02, Y = 1/2
    with naive.mp.workdps(700):
        exact = orbit_state(parameters, eps, omega, n)
        computed = sf.exact(sf.Suslov3D(*parameters), omega, eps, n)
        assert all(abs(c / e - 1) < 2e-15 for c, e in zip(computed, exact, strict=True))


def test_exact_states_of_any_size(unit):
    """Squares of X and Y are far beyond float64 here; all digits of 700 may cancel."""
    for omega in ([1e140, -1e141], [1e145, 3e140], [1e149, 1e120], [1e-140, 1e149]):
        with naive.mp.workdps(700):
            exact = naive.orbit(1, 1, 1, 0, 1, omega, 4)
            assert worst_error(sf.exact(unit, omega, 1, np.arange(5)), exact) < 1e-14


def test_states_far_out(unit):
    """Where |Y| is many times T, sums of the sequence cancel."""
    for X, Y in ((1e3, 1e8), (1e3, -1e12), (1e6, -1e6), (3e5, 1e7)):
        omega = [X * np.sqrt(2), -2 * Y]
        with naive.mp.workdps(200):
            exact = naive.orbit(1, 1, 1, 0, 1, omega, 8)
            assert worst_error(sf.exact(unit, omega, 1, np.arange(9)), exact) < 2e-15


@pytest.mark.parametrize("spread", [1, 5])
def test_any_parameters(rng, spread):
    for _ in range(40):
        parameters = 10 ** rng.uniform(-spread, spread, 4) * [1, 1, *rng.choice([-1, 1], 2)]
        body, omega = sf.Suslov3D(*parameters), rng.normal(size=2)
        eps = rng.uniform(0.01, 0.99) / float(sf.criticality(body, omega, 1.0))
        n = int(rng.integers(-300, 300))
        with naive.mp.workdps(300):
            exact = orbit_state(parameters, eps, omega, n)
            computed = sf.exact(body, omega, eps, n)
            assert energy_error(parameters, computed, exact) < 1e-14


UNITS = [-600, -200, -37, 1, 200, 600]


@pytest.mark.parametrize("k", UNITS)
def test_the_unit_of_time(k):
    """Bit for bit, next to the repelling half too."""
    unit = sf.Suslov3D(1, 1, 1, 0)
    for omega, t in (([2, -1e6], 2e-5), ([2, -1e8], 2e-7), ([1.0, 0.5], 3.0), ([1e-9, -3.0], 9.0)):
        scaled = np.ldexp(omega, k)
        expected = np.ldexp(sf.flow(unit, omega, t), k)
        assert (sf.flow(unit, scaled, np.ldexp(t, -k)) == expected).all()
        times = 0.125 * t * np.arange(40)
        expected = np.ldexp(sf.flow(unit, omega, times), k)
        assert (sf.flow(unit, scaled, np.ldexp(times, -k)) == expected).all()
        for n in (-7, 3, np.arange(60)):
            expected = np.ldexp(sf.exact(unit, omega, 0.75 * t, n), k)
            computed = sf.exact(unit, scaled, np.ldexp(0.75 * t, -k), n)
            assert np.array_equal(computed, expected, equal_nan=True)
        for computed, end in zip(
            sf.limits(unit, scaled, np.ldexp(t, -k)), sf.limits(unit, omega, t), strict=True
        ):
            assert (computed == np.ldexp(end, k)).all()


@pytest.mark.parametrize("k", UNITS)
def test_the_unit_of_mass(body, k):
    omega = np.array([[1.0, 0.5], [0.3, -2.0]])
    bodies = [
        (body, sf.Suslov3D(*np.ldexp(body.parameters, k)), omega),
        (
            sf.SuslovND([1.5, 1.5, 1.5], [0.4, -0.7, 0.5]),
            sf.SuslovND(np.ldexp([1.5, 1.5, 1.5], k), np.ldexp([0.4, -0.7, 0.5], k)),
            np.array([[1.0, 0.5, 0.1], [0.3, -2.0, 0.4]]),
        ),
    ]
    for one, heavy, states in bodies:
        assert (sf.exact(heavy, states, 0.2, [3, -9]) == sf.exact(one, states, 0.2, [3, -9])).all()
        assert (sf.flow(heavy, states, [3, -9]) == sf.flow(one, states, [3, -9])).all()
        assert np.array_equal(sf.limits(heavy, states, 0.2), sf.limits(one, states, 0.2))
        far = np.ldexp(states, k)
        expected = np.ldexp(sf.exact(one, states, 0.25, 5), k)
        assert (sf.exact(one, far, np.ldexp(0.25, -k), 5) == expected).all()


def test_far_units(unit):
    assert sf.exact(unit, [1e301, 0.5e301], 1e-301, 1) == pytest.approx(
        np.array(sf.step(unit, [10.0, 5.0], 0.1)) * 1e300, rel=1e-14
    )
    near = sf.exact(unit, [1e200, 1e200], 1e-310, 1)
    assert near == pytest.approx([1e200, 1e200], rel=1e-15)
    assert np.isfinite(sf.limits(unit, [1e200, 1e200], 1e-310)).all()
    state = [1e200, 1e-200, 1.0]
    assert (sf.exact(sf.SuslovND([1, 1, 1], [1, 0, 0]), state, 1e-200, 0) == state).all()


def test_states_that_are_not_numbers(body):
    omega = np.array([[1.0, 0.5], [np.nan, 1.0], [np.nan, np.nan]])
    assert np.isnan(sf.exact(body, omega[1], 0.2, [0, 1])).all()
    for states in (
        sf.exact(body, omega, 0.2, 7),
        sf.exact(body, omega, 0.2, np.arange(1, 50))[5],
        sf.flow(body, omega, 7.0),
        *sf.limits(body, omega, 0.2),
    ):
        assert np.isnan(states).all(axis=-1).tolist() == [False, True, True]
    for bad in (np.inf, -np.inf):
        with pytest.raises(ValueError, match="omega0: expected finite real numbers"):
            sf.exact(body, [bad, 1.0], 0.2, 7)


def test_limits_of_the_state_that_has_no_next(unit):
    """At (X, Y) = (0, 1) the map is 0 / 0; its inverse leaves that state where it is."""
    minus, plus = sf.limits(unit, [0.0, -2.0], 1)
    assert np.isnan(plus).all()
    assert minus.tolist() == [0.0, -2.0]
    minus, plus = sf.limits(unit, [0.0, 2.0], 1)
    assert np.isnan(minus).all()
    assert plus.tolist() == [0.0, 2.0]


NUMBERS = [
    np.arange(200),
    np.arange(-130, 170),
    np.arange(150, -100, -3),
    np.arange(-500, -100, 7),
    np.arange(5000, 9000, 1000 // 64),
    np.arange(0, 40, 0.25),
]


@pytest.mark.parametrize("n", NUMBERS, ids=str)
@pytest.mark.parametrize("scale", [0.1, 2.0, 60.0])
@pytest.mark.parametrize("batch", [1, 5, 13, 70])
def test_equal_steps_agree_with_single_ones(body, rng, monkeypatch, n, scale, batch):
    omega = rng.normal(size=(batch, 2)) * scale
    omega[0] = 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        states = sf.exact(body, omega, 0.2, n)
        alone = np.stack([sf.exact(body, each, 0.2, n) for each in omega], axis=1)
        monkeypatch.setattr(closed_form, "SHORTEST", 10**9)
        single = sf.exact(body, omega, 0.2, n)
    assert np.array_equal(states, alone, equal_nan=True)
    size = np.hypot(*np.moveaxis(single, -1, 0))[..., None] + 1e-300
    t = sf.criticality(body, omega, 0.2)
    below = abs(t) < 1
    np.testing.assert_array_less((abs(states - single) / size)[:, below], 1e-14)
    assert (np.isnan(states) == np.isnan(single)).all()
    np.testing.assert_allclose(states, single, rtol=1e-7, atol=1e-12 * scale)


@pytest.mark.parametrize("batch", [1, 3, 9])
@pytest.mark.parametrize("sign", [-1, 1])
def test_scattered_numbers_of_steps_in_any_order(body, rng, monkeypatch, batch, sign):
    """A task whose first parts have times of one sign, and the last of both."""
    monkeypatch.setattr(closed_form, "TASKS", 1)
    size = 5 * loops.FEW_STATES // (2 * batch)
    n = rng.integers(-1000, 1000, size)
    n[::7] = 0
    n[: 3 * size // 5] = sign * abs(n[: 3 * size // 5])
    omega = rng.normal(size=(batch, 2))
    states = sf.exact(body, omega, 0.2, n)
    order = rng.permutation(size)
    assert (sf.exact(body, omega, 0.2, n[order]) == states[order]).all()
    assert (states[n == 0] == omega).all()
    for i in (0, size - 1):
        assert (sf.exact(body, omega, 0.2, n[i]) == states[i]).all()


def test_equal_steps_do_not_depend_on_where_they_begin(body, rng):
    omega = rng.normal(size=(9, 2))
    states = sf.exact(body, omega, 0.2, np.arange(0, 3000, 3))
    for begin, end in ((1, 40), (63, 700), (500, 1000)):
        assert (
            sf.exact(body, omega, 0.2, np.arange(3 * begin, 3 * end, 3)) == states[begin:end]
        ).all()
    assert (states[0] == omega).all()


def test_long_results(body, rng, monkeypatch):
    """They are written past the caches, and a task takes a block in several parts."""
    rows = 15_000
    if numba.config.DISABLE_JIT:
        rows = 150
        for module in (loops, equal_steps):
            monkeypatch.setattr(module, "FEW_STATES", 2**9)
        for module in (tiles, equal_steps):
            monkeypatch.setattr(module, "BEYOND_CACHES", 2**14)
    monkeypatch.setattr(closed_form, "TASKS", 1)
    omega = rng.normal(size=(72, 2))
    assert 2 * omega.size < tiles.BEYOND_CACHES < rows * omega.size
    n, times = np.arange(rows), np.sqrt(np.arange(rows))
    steps, moments = sf.exact(body, omega, 0.2, n), sf.flow(body, omega, times)
    for i in (0, 40, 71):
        assert (sf.exact(body, omega[i], 0.2, n) == steps[:, i]).all()
        assert (sf.flow(body, omega[i], times) == moments[:, i]).all()


@pytest.mark.parametrize("dtype", ["i1", "u1", ">i4", "u8", "f4", "g", "O"])
@pytest.mark.parametrize("n", [range(40), range(60, -60, -3), [1] * 40, [0, 3, *range(4, 90, 2)]])
def test_numbers_of_any_type(body, dtype, n):
    """Whether they make up equal steps or not, which many are not converted for."""
    omega, n = np.array([[1.0, 0.5], [0.2, -0.7]]), np.abs(n) if dtype[0] == "u" else n
    expected = sf.exact(body, omega, 0.2, np.array(n, float))
    assert (sf.exact(body, omega, 0.2, np.array(n, dtype)) == expected).all()
    expected = sf.flow(body, omega, np.array(n, float))
    assert (sf.flow(body, omega, np.array(n, dtype)) == expected).all()


def test_numbers_that_only_seem_to_be_equal_steps(body):
    wrapped = (np.arange(300) * 7).astype(np.int8)
    large = np.full(40, 2**62) + np.arange(40)
    for n in (wrapped, wrapped[::-1], large):
        expected = sf.exact(body, [1.0, 0.5], 0.2, n.astype(float))
        assert (sf.exact(body, [1.0, 0.5], 0.2, n) == expected).all()


@pytest.mark.parametrize("wrong", [np.inf, -np.inf, np.nan])
@pytest.mark.parametrize("place", [0, 1, 39_999, 79_998, 79_999])
def test_one_wrong_number_among_equal_steps(body, wrong, place):
    for n in (np.arange(80_000.0), 0.1 * np.arange(80_000.0) - 7.0, -np.arange(80_000.0)):
        n[place] = wrong
        where = rf"got {wrong} at index \({place},\)"
        with pytest.raises(ValueError, match=f"n: expected finite real numbers, {where}"):
            sf.exact(body, [1.0, 0.5], 0.2, n)
        with pytest.raises(ValueError, match=f"t: expected finite real numbers, {where}"):
            sf.flow(body, [1.0, 0.5], n)


def test_slices(body, rng, monkeypatch):
    """Long calls return in between, and their cuts cannot be seen."""
    omega = rng.normal(size=(200, 2))
    whole = sf.exact(body, omega, 0.2, np.arange(300)), sf.exact(body, omega, 0.2, [7, 2.5, -3])
    done = []
    run = closed_form._threads.run

    def counted(loop, work, *arguments):
        done.append(work)
        run(loop, work, *arguments)

    monkeypatch.setattr(closed_form, "SLICE", 5000)
    monkeypatch.setattr(closed_form._threads, "run", counted)
    cut = sf.exact(body, omega, 0.2, np.arange(300)), sf.exact(body, omega, 0.2, [7, 2.5, -3])
    assert all(map(np.array_equal, whole, cut))
    assert len(done) > 10
    assert max(done) <= 5000 * loops.WORK


@pytest.mark.parametrize("batch", [1, 3, 64, 10_000])
def test_cuts_are_as_large_as_they_may_be(batch):
    """Whoever has few trajectories has as many states in each call, for threads to share."""
    rows = 3 * closed_form.SLICE // batch
    cuts = closed_form.slices(batch, rows)
    assert sum((b - a) * (d - c) for (a, b), (c, d) in cuts) == batch * rows
    assert len(cuts) <= 6


@pytest.mark.parametrize("shift", range(8))
@pytest.mark.parametrize("more", [0, 3])
def test_a_single_orbit_past_the_caches(body, monkeypatch, shift, more):
    """Wherever its states lie to the cache lines, they are those of any batch."""
    rows = more + (304 if numba.config.DISABLE_JIT else equal_steps.BEYOND_CACHES // 2 + 776)
    monkeypatch.setattr(equal_steps, "BEYOND_CACHES", 0)  # for kernels that are not compiled
    monkeypatch.setattr(equal_steps, "FEW_STATES", 72)
    # From next to the repelling half; in the middle; beyond criticality.
    for omega in ([0.8 + 1e-9, -4 / 3], [1.0, 0.5], [9.0, -30.0]):
        memory = np.full(2 * rows + 16, 7.0)
        out = memory[shift : shift + 2 * rows].reshape((rows, 2))
        sf.iterate(body, omega, 0.2, rows - 1, out=out)
        beside = sf.iterate(body, [omega, [0.3, 0.4]], 0.2, rows - 1).omega[:, 0]
        assert np.array_equal(out, beside, equal_nan=True)
        assert (memory[:shift] == 7.0).all()
        assert (memory[shift + 2 * rows :] == 7.0).all()
        cut = sf.iterate(body, omega, 0.2, 101).extend(rows - 102).omega
        assert np.array_equal(cut, out, equal_nan=True)


def test_rows_before_the_start_stay(body, rng):
    """Orbits of a run may begin at different numbers."""
    omega, start = rng.normal(size=(70, 2)), rng.integers(0, 150, 70).astype(float)
    out = np.full((200, 70, 2), 7.0)
    missing = closed_form.none_missing()
    parameters = for_loops(body, 0.2, ())
    run = closed_form.Run(1.0, (0.0, 1.0), (0, 200, 0, 1))
    closed_form.fill_run(
        *run, False, parameters, omega, start, out, closed_form.NO_STATUS, missing, None
    )
    for k, begin in enumerate(start.astype(int)):
        assert (out[:begin, k] == 7.0).all()
        assert (out[begin, k] == omega[k]).all()
        expected = sf.exact(body, omega[k], 0.2, np.arange(200 - begin))
        np.testing.assert_allclose(out[begin:, k], expected, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("batch", [1, 5, 12, 64, 70, 136])
def test_memory_past_the_caches(body, rng, monkeypatch, batch):
    """However rows lie to the cache lines, all is written where it belongs."""
    if not numba.config.DISABLE_JIT:
        pytest.skip("looks into kernels that are not compiled")
    omega = rng.normal(size=(batch, 2))
    numbers = np.arange(75), np.arange(-9, 75), np.array([3.0, -2.5, 7.0])
    expected = [sf.exact(body, omega, 0.2, n) for n in numbers]

    def in_whole_lines(write):
        def checked(array, index, *vectors):
            assert (array.ctypes.data // 8 + index) % tiles.VECTOR == 0
            write(array, index, *vectors)

        return checked

    monkeypatch.setattr(tiles, "BEYOND_CACHES", 0)
    monkeypatch.setattr(equal_steps, "BEYOND_CACHES", 0)
    monkeypatch.setattr(tiles, "stream", in_whole_lines(tiles.stream))
    monkeypatch.setattr(equal_steps, "stream_pairs", in_whole_lines(equal_steps.stream_pairs))
    for n, states in zip(numbers, expected, strict=True):
        assert (sf.exact(body, omega, 0.2, n) == states).all()


def test_states_that_do_not_fit_in_memory(body):
    with pytest.raises(MemoryError, match=r"fit in memory, got shape \(10000000, 1000000, 2\)"):
        sf.exact(body, np.broadcast_to([1.0, 2.0], (10**6, 2)), 0.2, np.arange(10**7))


@pytest.mark.compiled
def test_threads(body, rng):
    omega = rng.normal(size=(3000, 2))
    n = np.arange(400)
    assert (sf.exact(body, omega, 0.2, n, threads=1) == sf.exact(body, omega, 0.2, n)).all()
    assert (sf.flow(body, omega, n, threads=1) == sf.flow(body, omega, n)).all()


def test_no_threads(body):
    with pytest.raises(ValueError, match="threads: expected None or an integer"):
        sf.exact(body, [1.0, 0.5], 0.2, 3, threads=0)


@pytest.mark.parametrize("scale", [1e-90, 1e-120, 1e-145])
def test_a_slow_orbit_arrives_after_enough_steps(scale):
    """However little a step does, an orbit has its limits, and as many steps as it needs."""
    body, n = sf.Suslov3D(1, 1, 1, 0), 50.0
    like = sf.flow(body, [1.0, 1.0], n)
    np.testing.assert_allclose(
        sf.exact(body, [scale, scale], 1.0, n / scale) / scale, like, rtol=1e-12, atol=1e-14
    )
    ends = np.array(sf.limits(body, [scale, scale], 1.0)) / scale
    np.testing.assert_allclose(ends, [[0, -np.sqrt(2)], [0, np.sqrt(2)]], rtol=1e-13, atol=1e-14)
