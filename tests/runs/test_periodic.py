"""Periodic orbits against published values, and against integration by SciPy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import suslov_fast as sf
from suslov_fast.runs import periodic

pytestmark = pytest.mark.compiled  # 20,000 steps of order 8 take minutes as Python


def lorenz(x):
    return 10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]


LORENZ = sf.QuadraticField.from_function(lorenz, 3)


def roessler(a, b, c):
    return sf.QuadraticField.from_function(
        lambda x: (-x[1] - x[2], x[0] + a * x[1], b + x[2] * (x[0] - c)), 3
    )


VOLTERRA = sf.QuadraticField.from_function(lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - 1)), 2)


def nearest_return(field, start, surface, turns, eps):
    """Return the crossing that is nearest to the one some turns later, and the time between."""
    points = sf.crossings(field, start, eps, 20_000, surface, transient=500, method="order8")
    gaps = abs(points.states[turns:] - points.states[:-turns]).max(axis=1)
    k = gaps.argmin()
    return points.states[k], points.time[k + turns] - points.time[k]


# Periods of the symbolic orbits AB and AAB; Roessler's period and multiplier.
@pytest.mark.parametrize(
    ("field", "surface", "turns", "steps", "period", "multiplier"),
    [
        (LORENZ, lambda x: x[..., 2] - 27, 2, 400, 1.558652210716175, None),
        (LORENZ, lambda x: x[..., 2] - 27, 3, 500, 2.3059072639398, None),
        (roessler(0.2, 0.2, 5.7), lambda x: x[..., 0], 1, 1200, 5.881088455555, -2.4039535318),
    ],
    ids=["AB", "AAB", "Roessler"],
)
def test_published_orbits(field, surface, turns, steps, period, multiplier):
    start, about = nearest_return(field, [1.0, 1.0, 1.0], surface, turns, 1 / 32)
    orbit = sf.periodic_orbit(field, start, about, steps)
    assert abs(orbit.period / period - 1) < 1e-12
    assert orbit.residual <= 1e-12
    run = sf.iterate(field, orbit.state, orbit.period / steps, steps, method="order8")
    assert abs(run.final - orbit.state).max() <= 1e-12 * abs(orbit.state).max()
    assert abs(orbit.multipliers[1] - 1) < 1e-9
    if multiplier:
        assert abs(orbit.multipliers[0] - multiplier) < 1e-9
        assert isinstance(orbit.period, float)


def test_multipliers_are_those_of_the_motion():
    """Against the derivative of the flow over a period, by differences of SciPy's solutions."""
    start, about = nearest_return(LORENZ, [1.0, 1.0, 20.0], lambda x: x[..., 2] - 27, 2, 1 / 32)
    orbit = sf.periodic_orbit(LORENZ, start, about, 300)

    def after(x):
        slopes = lambda t, y: lorenz(y.tolist())  # noqa: E731
        return solve_ivp(slopes, (0, orbit.period), x, "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]

    h = 1e-5
    derivative = np.array(
        [(after(orbit.state + h * e) - after(orbit.state - h * e)) / (2 * h) for e in np.eye(3)]
    ).T
    expected = sorted(np.linalg.eigvals(derivative), key=abs, reverse=True)
    np.testing.assert_allclose(orbit.multipliers, expected, atol=1e-5)
    np.testing.assert_allclose(
        np.prod(orbit.multipliers), np.exp(-(41 / 3) * orbit.period), atol=1e-9
    )


def test_a_family_is_followed_to_its_bifurcation():
    """Roessler's system with a = b = 0.2 doubles its period at c = 2.832445."""
    run = sf.iterate(roessler(0.2, 0.2, 2.5), [1, 1, 0], 1 / 16, 4000, save_every=None)
    points = sf.crossings(
        roessler(0.2, 0.2, 2.5), run.final, 1 / 16, 400, lambda x: x[..., 1], method="order8"
    )
    known = [points.states[-1], points.time[-1] - points.time[-2]]

    def distance(c):
        orbit = sf.periodic_orbit(roessler(0.2, 0.2, c), known[0], known[1], 300)
        known[:] = orbit.state, orbit.period
        others = np.delete(orbit.multipliers, abs(orbit.multipliers - 1).argmin())
        return others.real.min() + 1

    assert abs(brentq(distance, 2.7, 2.9, xtol=1e-9) - 2.832445) < 1e-6


@pytest.mark.parametrize("method", ["auto", "order4", "order6", "order8"])
def test_systems_with_an_integral(method):
    """Of a family of orbits one near the start is found; both multipliers are 1."""
    orbit = sf.periodic_orbit(VOLTERRA, [1.0, 2.0], 6.8, 120, method=method)
    assert abs(orbit.state - [1, 2]).max() < 0.1
    values = abs(orbit.multipliers - 1)
    assert values.max() < 1e-5
    solution = solve_ivp(
        lambda t, x: sf.vector_field(VOLTERRA, x), (0, 8), orbit.state, "DOP853", rtol=1e-12,
        atol=1e-12, events=lambda t, x: x[0] - orbit.state[0],
    )  # fmt: skip
    error = {"auto": 3e-3, "order4": 1e-5, "order6": 1e-8, "order8": 1e-9}[method]
    assert abs(solution.t_events[0][-1] / orbit.period - 1) < error


def test_the_middle_of_a_circle_is_no_orbit():
    with pytest.raises(RuntimeError, match=r"equilibrium.*start or period = 3 is too far"):
        sf.periodic_orbit(VOLTERRA, [1.0, 1.0 + 1e-9], 3.0, 20)


def test_time_as_a_variable_never_returns():
    """And a force by two variables does: the orbit of a linear oscillator is known."""
    forced = sf.QuadraticField.from_function(lambda s: (s[1], -s[0] - s[1] + s[2], 1), "q p t")
    with pytest.raises(ValueError, match=r"not one in which t grows at a constant rate: write"):
        sf.periodic_orbit(forced, [0.1, 0.1, 0.0], np.pi, 40)
    own = sf.QuadraticField.from_function(
        lambda s: (s[1], -s[0] - s[1] + s[2], -2 * s[3], 2 * s[2]), "q p c s"
    )
    orbit = sf.periodic_orbit(own, [-0.2, 0.3, 1.0, 0.0], np.pi, 40)
    amplitude = 1 / (1 - 4 + 2j)  # of q = Re(amplitude exp(2 i t)), for a force of size 1
    c, s = orbit.state[2:]
    known = [(amplitude * (c + 1j * s)).real, (2j * amplitude * (c + 1j * s)).real]
    assert abs(orbit.state[:2] - known).max() < 1e-9


def test_a_period_that_tends_to_0_is_no_equilibrium():
    with pytest.raises(RuntimeError, match=r"no orbit: the period tended to 0 at the state \[0\.5"):
        sf.periodic_orbit(sf.QuadraticField.from_function(lambda x: (1 - x[0],), 1), [0.5], 2.0, 20)


def test_a_start_at_rest_is_no_orbit():
    with pytest.raises(RuntimeError, match=r"found the equilibrium .*start or period = 3 is too"):
        sf.periodic_orbit(LORENZ, [0, 0, 0], 3.0, 20)


@pytest.mark.parametrize(
    ("start", "period"), [([1, 1, 20], 1.0), ([8.4, 8.4, 27.1], 0.7), ([1e200, 1, 1], 1.0)]
)
def test_no_orbit_is_an_error(start, period):
    with pytest.raises(RuntimeError, match=r"residual .* exceeds tol = 1e-12; start or period"):
        sf.periodic_orbit(LORENZ, start, period, 100)


def test_a_multiple_of_a_period_is_named():
    about = sf.periodic_orbit(VOLTERRA, [1.0, 2.0], 6.8, 120).period
    for k in (2, 3, 4, 11, 13):
        with pytest.warns(UserWarning, match=rf"is {k} times the shorter period 6\.6"):
            sf.periodic_orbit(VOLTERRA, [1.0, 2.0], k * about, 240)


def test_time_scales_with_its_unit():
    """In another unit of time and of the state the orbit is the same."""
    unit = 2.0**-14
    fast = sf.QuadraticField.from_function(
        lambda x: (x[0] * (1 - 8 * x[1]) / unit, x[1] * (8 * x[0] - 1) / unit), 2
    )
    one = sf.periodic_orbit(VOLTERRA, [1.0, 2.0], 6.5, 60)
    other = sf.periodic_orbit(fast, [0.125, 0.25], 6.5 * unit, 60)
    np.testing.assert_allclose(8 * other.state, one.state, rtol=1e-9)
    assert abs(other.period / (one.period * unit) - 1) < 1e-9


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (
            ([[1.0, 2.0]], 6.5, 60),
            {},
            r"single QuadraticField, state and period, not a batch \(1,\)",
        ),
        (([1.0, 2.0], [6.5, 6.6], 60), {}, "single QuadraticField, state and period"),
        (([1.0, np.nan], 6.5, 60), {}, "start must be finite"),
        (([1.0, 2.0], -6.5, 60), {}, "period must be positive, not -6.5"),
        (([1.0, 2.0], 6.5, 0), {}, "steps must be"),
        (([1.0, 2.0], 6.5, 60), {"tol": 0.5}, "tol must be from 1e-14 to 1e-2, not 0.5"),
        (([1.0, 2.0], 6.5, 60), {"method": "order9"}, "method must be"),
        (([1.0, 2.0, 3.0], 6.5, 60), {}, "2"),
    ],
)
def test_bad_input(arguments, options, message):
    with pytest.raises(ValueError, match=message):
        sf.periodic_orbit(VOLTERRA, *arguments, **options)


def test_a_period_that_leads_away_is_not_taken():
    search = periodic._Shooting(VOLTERRA, np.array([1.0, 3.0]), 5.0, 60, "auto")
    before = search.eps, search.residual
    search._correct_period()
    assert (search.eps, search.residual) == before


def test_a_start_from_which_whole_steps_lead_away():
    """Then parts of Newton's steps are taken: to the orbit AB."""
    orbit = sf.periodic_orbit(LORENZ, [-13.4, -18.2, 25.5], 1.7, 200)
    assert abs(orbit.period / 1.558652210716175 - 1) < 1e-12


def test_multipliers_that_exceed_the_range_of_numbers():
    """exp(800 pi) for a circle beside a third component that grows as exp(400 t)."""
    field = sf.QuadraticField.from_function(lambda x: (x[1], -x[0], 400 * x[2]), 3)
    with pytest.raises(RuntimeError, match=r"period 6\.28319 whose multipliers .*call iterate"):
        sf.periodic_orbit(field, [1.0, 0.0, 0.0], 2 * np.pi, 2000)


def test_a_step_all_of_whose_parts_lead_away_is_taken_back(monkeypatch):
    orbit = sf.periodic_orbit(VOLTERRA, [1.0, 2.0], 6.6, 60, method="auto")
    search = periodic._Shooting(VOLTERRA, orbit.state, orbit.period, 60, "auto")
    monkeypatch.setattr(search, "_step", lambda: np.array([1.0, 1.0, 0.0]))
    before = search.x.tolist(), search.eps, search.residual
    assert not search._improve()
    assert (search.x.tolist(), search.eps, search.residual) == before
