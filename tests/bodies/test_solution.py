"""`exact`, `flow` and `limits` against iteration, fractions and series in 60 digits."""

from fractions import Fraction

import naive
import numpy as np
import pytest

import suslov_fast as sf


def test_limits_of_the_undefined_state(unit):
    """At (X, Y) = (0, 1) the map is 0 / 0, and the inverse map has a fixed point."""
    assert sf.iterate(unit, [0.0, -2.0], 1, 1, on_singular="ignore").status == sf.Status.SINGULAR
    assert (sf.step(unit, [0.0, -2.0], -1) == [0.0, -2.0]).all()
    for sign in (1, -1):
        fixed, missing = unit.limits([0.0, -2.0 * sign], 1)[::sign]
        assert np.isnan(missing).all()
        assert fixed.tolist() == [0.0, -2.0 * sign]
    with pytest.warns(RuntimeWarning, match="pole"):
        states = unit.exact([0.0, -2.0], 1, [-1, 0, 1])
    assert np.isnan(states).any(axis=1).tolist() == [False, False, True]


def test_reasons_for_missing_states(unit):
    """One warning for each reason, with the number of orbits, at the line of the user."""
    omega = [[0.3, 0.1], [0.5, -9.0], [0.0, -9.0], [0.5, -2.0]]  # T < 1, T > 1, at rest, T = 1
    n = [2.5, 3, 2.0**53, 2.0**60]
    with pytest.warns(RuntimeWarning, match=r"^2 of 4 orbits") as caught:
        states = unit.exact(omega, 1, n)
    assert [(each.category, each.filename) for each in caught] == [(RuntimeWarning, __file__)]
    missing = np.isnan(states).all(axis=-1)
    assert not missing[:, [0, 2]].any()
    assert (missing[:, [1, 3]].T == [True, False, False, True]).all()
    with pytest.warns(RuntimeWarning, match=r"^1 of 2 orbits"):
        states = unit.exact([[1e10, 0.3], [0.3, 0.1]], 1, 5)
    assert np.isnan(states).any(axis=-1).tolist() == [True, False]


def test_states_on_the_way_from_rest_that_cannot_be_told(unit):
    """Next to a steady state, at l below 1e-140 of it, squares of l are lost: it is left for NaN,
    and approached in all digits.
    """
    for sign in (1.0, -1.0):
        with pytest.warns(RuntimeWarning, match="range"):
            states = unit.exact([1e-150, 0.5 * sign], 1, [-700 * sign, -sign, 0, 3 * sign])
        assert np.isnan(states[0]).all()
        expected = [[5e-150 / 3, 0.5 * sign], [1e-150, 0.5 * sign], [2.16e-151, 0.5 * sign]]
        np.testing.assert_allclose(states[1:], expected, rtol=1e-14, atol=0.0)
        left, reached = unit.exact([1e-130, 0.5 * sign], 1, [-700 * sign, 700 * sign])
        np.testing.assert_allclose(left, [0.0, -0.5 * sign], atol=1e-13)
        np.testing.assert_allclose(reached, [0.0, 0.5 * sign], atol=1e-13)


def state_on_the_pole(I1, I2, I13, I23, x):
    """Return the state with this x and y = 2 I1 I2 + x**2, a pole for eps = 1."""
    y, D = 2 * I1 * I2 + x * x, I13 * I13 * I2 + I23 * I23 * I1
    return [Fraction(I13 * I2 * x + I23 * y, D), Fraction(I23 * I1 * x - I13 * y, D)]


# Bodies whose states on the pole are float64: D is a power of two.
@pytest.mark.parametrize("x", [1, -3, 40])
@pytest.mark.parametrize("parameters", [(1, 1, 1, 0), (1, 3, 1, 1), (2, 2, 2, -2)], ids=str)
def test_poles_in_fractions(parameters, x):
    """Iteration ends at a pole; `exact` lacks only the next state and goes on beyond it."""
    pole, body = state_on_the_pole(*parameters, x), sf.Suslov3D(*parameters)
    omega = list(map(float, pole))
    assert naive.rational_step(*parameters, 1, omega) is None
    run = sf.iterate(body, omega, 1, 9, on_singular="ignore")
    assert (run.status, run.failed_at) == (sf.Status.SINGULAR, 1)
    assert np.isnan(run.states[1:]).all()
    state = [pole[0] + Fraction(1, 10**40), pole[1]]  # state 2 is the limit from both sides
    for _ in range(2):
        state = naive.rational_step(*parameters, 1, state)
    expected = {0: omega, 2: np.array(state, float)}
    for n, sign, other in ((2, 1, state), (0, -1, pole)):
        for k in range(1, 4):
            other = naive.rational_step(*parameters, sign, other)
            expected[n + sign * k] = np.array(other, float)
    n = np.arange(-3, 6)
    with pytest.warns(sf.IntegrationWarning, match=r"^1 of 1 orbits"):
        states = body.exact(omega, 1, n)
    assert n[np.isnan(states[:, 0])].tolist() == [1]
    for k, state_k in expected.items():
        np.testing.assert_allclose(states[k + 3], state_k, rtol=1e-12, atol=1e-13)


def solved_bodies(rng, m):
    """All J equal, or I along one axis and the other J equal; and I = 0."""
    along = np.arange(m) == rng.integers(m, size=(3, 1))
    I = rng.normal(size=(6, m))
    I[3:] *= along
    J = rng.uniform(1, 4, (6, 1)) * np.ones(m)
    J[3:] *= np.where(along, 10 ** rng.uniform(-1, 1, (3, 1)), 1.0)
    I[2] = 0.0
    return sf.SuslovND(J=J, I=I)


@pytest.mark.parametrize("m", [1, 2, 3, 8])
def test_solved_bodies_in_n_dimensions(rng, m):
    body, omega, eps = solved_bodies(rng, m), rng.normal(size=(6, m)), rng.uniform(-0.3, 0.3, 6)
    omega[5] = body.I[5]  # at rest
    states = body.exact(omega, eps, np.arange(8))
    for i in range(6):
        expected = naive.orbit_nd(body.J[i], body.I[i], eps[i], omega[i], 7)
        assert naive.worst_error(states[:, i], expected) < 1e-13
    back = body.exact(states[7], eps, -7)
    np.testing.assert_allclose(back, omega, rtol=1e-11, atol=1e-12)
    assert (states[0] == omega).all()
    far = body.exact(omega, eps, [-(10**9), 10**9])
    np.testing.assert_allclose(far, body.limits(omega, eps), rtol=1e-11, atol=1e-12)
    assert (far[:, 5] == omega[5]).all()
    far = [sf.flow(body, omega, time=t).states[0] for t in (-1e9, 1e9)]
    np.testing.assert_allclose(far, body.limits(omega, 0.0), rtol=1e-11, atol=1e-12)
    h = 1e-4
    forth, along = (sf.flow(body, omega, time=t).states[0] for t in (h, -h))
    field = body(omega)
    np.testing.assert_allclose((forth - along) / (2 * h), field, rtol=1e-5, atol=1e-6)
    assert np.isnan(body.exact(np.full(m, np.nan), eps, 3)).all()


@pytest.mark.parametrize("I", [[0.0, 0.0, 0.0], [0.5, -0.75, 0.25]])
def test_tiny_states_in_n_dimensions_keep_their_value(I):
    """They are too slow to move, and their squares are out of range."""
    body, omega = sf.SuslovND(J=[2.0, 2.0, 2.0], I=I), 1e-165 * np.array([1.0, 0.3, -0.2])
    for found in (body.exact(omega, 0.2, 5), sf.flow(body, omega, time=0.2).states[0]):
        np.testing.assert_allclose(found, omega, rtol=1e-14)


@pytest.mark.parametrize("power", [-990, -515, 515, 990])
def test_motion_of_states_whose_squares_are_out_of_range(body, power):
    """A unit of 2**power for the state, and its inverse for the time, change no bit."""
    unit, omega, time = 2.0**power, np.array([[1.0, 0.5], [-3.0, 0.1]]), np.array([7.0, 0.5, 90.0])
    expected = unit * sf.flow(body, omega, time=time).states
    np.testing.assert_array_equal(sf.flow(body, unit * omega, time=time / unit).states, expected)
    if power < 0:
        expected = np.multiply(unit, body.limits(omega, 1e-20))
        np.testing.assert_array_equal(body.limits(unit * omega, 1e-20), expected)


def test_overflow_is_no_number():
    """The phase of a rotor is lost; a body has come to its limit."""
    body = sf.Suslov3D(4, 1, -0.5, -0.3, [0.0, 1e60])
    with pytest.warns(RuntimeWarning, match=r"^1 of 2"):
        motion = sf.flow(body, [1e10, 5e9], time=1e300)
    assert np.isnan(motion.states[0]).all(axis=-1).tolist() == [False, True]
    assert motion.status.tolist() == [sf.Status.OK, sf.Status.NONFINITE]


def test_coefficients_out_of_range_are_no_pole():
    """Those of extreme bodies overflow, although states and rates are in the range."""
    body = sf.Suslov3D(1e-50, 1e-50, 1e60, 0.0)
    with pytest.warns(RuntimeWarning, match="^1 of 1 orbits") as caught:
        motion = sf.flow(body, [4e9, 2e9], time=1.0)
    assert [each.category for each in caught] == [RuntimeWarning]  # of a pole: IntegrationWarning
    assert np.isnan(motion.states).all()


def test_orbits_that_turn_next_to_their_steady_state():
    """Coefficients that cancel there are multiplied by n**2."""
    body, omega = sf.Suslov3D(4, 1, -0.5, -0.3, k=1), [0.81967213, 1.96721311]
    energy = body.energy(sf.flow(body, omega, time=np.linspace(0, 1e5, 1001)).states)
    integral = body.first_integral(body.exact(omega, 0.2, np.arange(0, 100_001, 100)), 0.2)
    for conserved in (energy, integral):
        assert abs(conserved / conserved[0] - 1).max() < 1e-13


def test_state_1_is_a_step(rng):
    """With large K and |k| next to A both forms of the closed form almost vanish at n = 1."""
    body, omega = sf.Suslov3D(4, 1, -0.5, -0.3, 80.0), 100 * rng.normal(size=(50, 2))
    for n in (1, -1):
        found = body.exact(omega, 3.0, n)
        np.testing.assert_array_equal(found, sf.step(body, omega, 3.0 * n))


def test_units_of_neighbours(rng):
    """A state far from 1 has a unit of its own: its neighbours keep their bits, of 128 at once."""
    omega, n = rng.normal(size=(400, 2)), [3.0, -1000.0]
    omega[130:170:8] *= 2.0 ** np.array([[120], [-200], [0], [40], [-40]])
    some = [0, 127, 128, *range(130, 170, 4), 255, 256, 383, 384, 399]
    for body in (sf.Suslov3D(4, 1, -0.5, -0.3), sf.Suslov3D(4, 1, -0.5, -0.3, 0.9)):
        for call in (
            lambda *given: sf.Suslov3D.exact(*given, 1e-30, n),
            lambda *given: sf.flow(*given, time=[3.0, 1000.0]).states,
        ):
            alone = np.stack([call(body, state) for state in omega[some]], axis=1)
            np.testing.assert_array_equal(call(body, omega)[:, some], alone)
