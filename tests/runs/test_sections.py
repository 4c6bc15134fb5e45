"""Crossings of methods above order 2: points on the orbit of the method, and not on a chord."""

from itertools import cycle

import numpy as np
import pytest
from children import TWO_THREADS
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from systems import HENON_HEILES

import suslov_fast as sf
from suslov_fast.core.motion.refine import crossing_fractions
from suslov_fast.maps import MAPS, map_of
from suslov_fast.runs import search as module

START = [0.0, 0.1, 0.4, 0.05]
METHODS = [
    method
    for map in MAPS.values()
    if map.body is sf.QuadraticField and map.order > 2
    for method in map.methods
]
LENGTHS = {4: 1 / 16, 6: 1 / 8, 8: 1 / 4, 10: 1 / 2}


def slopes(t, state):
    x, y, px, py = state
    return px, py, -x - 2 * x * y, -y - x * x + y * y


def plane(x):
    return x[..., 0]


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("method", "direction"), [*zip(METHODS, cycle([0, 1, -1]), strict=False)])
def test_points_have_the_digits_of_the_states(method, direction):
    """The error of points is at most 10 times that of the states; DOP853 is the reference."""
    eps = LENGTHS[map_of(HENON_HEILES, method).order]
    steps, plane_of_reference = round(60 / eps), lambda t, x: x[0]
    plane_of_reference.direction = direction
    solution = solve_ivp(
        slopes, (0, 60), START, "DOP853", rtol=1e-13, atol=1e-15, dense_output=True,
        events=plane_of_reference,
    )  # fmt: skip
    run = sf.iterate(HENON_HEILES, START, eps, steps, method=method)
    error = abs(run.x - solution.sol(run.time).T).max()
    points = sf.crossings(
        HENON_HEILES, START, eps, steps, plane, direction=direction, method=method
    )
    [times], [states] = solution.t_events, solution.y_events
    if len(times) > len(points):  # an event at the start
        times, states = times[1:], states[1:]
    assert len(points) == len(times) > 7
    assert error < 2e-6
    assert abs(points.states - states).max() < 10 * error
    slope = abs(sf.vector_field(HENON_HEILES, states)[:, 0])
    assert (abs(points.time - times) < 10 * error / slope).all()


@pytest.mark.parametrize("method", METHODS)
def test_points_are_steps_from_the_states_before(rng, method):
    """Also of families whose surface names the parameter, and of steps of either sign."""
    field = sf.QuadraticField.from_function(
        lambda x, a: (x[1], -x[0] + a * x[0] * x[1]), 2, a=np.array([[0.1], [0.2]])
    )
    starts, eps = rng.uniform(-1, 1, (2, 3, 2)), np.array([0.3, -0.3, 0.2])
    level = np.array([[0.1], [0.05]])

    def surface(x):
        return x[..., 1] - level * x[..., 0]

    points = sf.crossings(field, starts, eps, 100, surface, direction=0, method=method)
    assert len(points) > 30
    assert ((points.fraction >= 0) & (points.fraction <= 1)).all()
    for k in range(0, len(points), 7):
        i, j = divmod(int(points.trajectory[k]), 3)
        length = points.fraction[k] * eps[j]
        after = sf.step(field[i, 0], points.before[k], length, method=method)
        np.testing.assert_array_equal(points.states[k], after)
        assert abs(after[1] - level[i, 0] * after[0]) < 1e-15

        def value(t, k=k, i=i):
            x = sf.step(field[i, 0], points.before[k], t, method=method)
            return x[1] - level[i, 0] * x[0]

        assert abs(brentq(value, 0.0, eps[j], xtol=1e-15) - length) < 1e-13
    assert (
        abs(points.time - (points.n + points.fraction) * np.tile(eps, 2)[points.trajectory]).max()
        == 0
    )


@pytest.mark.parametrize("method", METHODS)
def test_grazing_planes_lose_no_crossing(rng, method):
    """Which states cross is as for `iterate`, and every crossing is found on its own step."""
    starts = rng.uniform(-0.25, 0.25, (30, 4))
    run = sf.iterate(HENON_HEILES, starts, 1 / 4, 400, method=method)
    top = np.sort(run.x[..., 0].max(axis=0))[10]  # close to where some orbits turn

    def surface(x):
        return x[..., 0] - 0.999 * top

    for direction in (1, -1):
        points = sf.crossings(
            HENON_HEILES, starts, 1 / 4, 400, surface, direction=direction, method=method
        )
        is_above = surface(run.x) >= 0.0
        changes = is_above[1:].astype(int) - is_above[:-1] == direction
        assert len(points) == changes.sum() > 50
        assert abs(surface(points.states)).max() < 4e-15  # rounding of a step
        slope = sf.vector_field(HENON_HEILES, points.states)[:, 0] * direction
        assert (slope > -1e-6).mean() > 0.95  # two more crossings within a step are rare


def test_states_on_the_surface_stay_where_they_are():
    """A fraction is 0 or 1 where a value is 0, and the point is then the state, bit for bit."""
    line = sf.QuadraticField([[[0.0]]], constant=[1.0])  # x' = 1
    run = sf.iterate(line, [-2.0], 1.0, 4, method="order8")
    for direction, surface, n, fraction in (
        (1, lambda x: x[..., 0] - run.x[2, 0], 1, 1.0),
        (-1, lambda x: run.x[2, 0] - x[..., 0], 2, 0.0),
    ):
        points = sf.crossings(line, [-2.0], 1.0, 4, surface, direction=direction, method="order8")
        assert (points.n.tolist(), points.fraction.tolist()) == ([n], [fraction])
        np.testing.assert_array_equal(points.states, run.x[2:3])


def test_a_surface_without_values_within_a_step():
    """A surface that is NaN or infinite between two states still has its crossing on the step."""
    line = sf.QuadraticField([[[0.0]]], constant=[1.0])

    def surface(x):
        s = x[..., 0] - 0.3
        return np.where((x[..., 0] > 0.3) & (x[..., 0] < 0.9), np.nan, s)

    points = sf.crossings(line, [0.0], 1.0, 1, surface, method="order8")
    assert 0.29 < points.states[0, 0] < 0.31
    jump = sf.crossings(line, [0.0], 1.0, 1, lambda x: np.sign(x[..., 0] - 0.3), method="order8")
    assert abs(jump.states[0, 0] - 0.3) < 1e-5  # twenty halves


@pytest.mark.parametrize("method", ["auto", *METHODS])
def test_bits_depend_on_no_cut(rng, monkeypatch, method):
    starts, arguments = rng.uniform(-0.25, 0.25, (9, 4)), {"method": method, "direction": 0}
    whole = sf.crossings(HENON_HEILES, starts, 1 / 8, 200, plane, threads=TWO_THREADS, **arguments)
    assert whole == sf.crossings(HENON_HEILES, starts, 1 / 8, 200, plane, threads=1, **arguments)
    one = sf.crossings(HENON_HEILES, starts[4], 1 / 8, 200, plane, **arguments)
    np.testing.assert_array_equal(one.states, whole.states[whole.trajectory == 4])
    np.testing.assert_array_equal(one.fraction, whole.fraction[whole.trajectory == 4])
    monkeypatch.setattr(module, "PIECE", 64)
    monkeypatch.setattr(module, "STATES", 3)
    assert whole == sf.crossings(HENON_HEILES, starts, 1 / 8, 200, plane, **arguments)


def test_a_smooth_crossing_takes_few_rounds():
    """A crossing that is found is not asked for again; the root of exp(x) + x^2 / 10 = 1.7."""
    asked, at_ends = [], (np.full(3, -0.7), np.full(3, np.e - 1.6))

    def values_at(which, x):
        asked.append(len(which))
        return np.exp(x) - 1.7 + 0.1 * x**2

    fractions, _ = crossing_fractions(values_at, np.array([0.5, 0.49, 0.1]), *at_ends)
    expected = brentq(lambda x: values_at([], x), 0.0, 1.0, xtol=1e-15)
    np.testing.assert_allclose(fractions, expected, rtol=0, atol=3e-15)
    assert sum(asked) <= 30  # bisection would take 150


@pytest.mark.parametrize("beyond", [1.0, 1e6])
@pytest.mark.parametrize("root", [0.3, 0.71])
def test_a_surface_with_a_jump_is_bisected(root, beyond):
    """Interpolation between -1 and 1 tells nothing, and between -1 and 1e6 less."""

    def values_at(which, x):
        return np.where(x < root, -1.0, beyond)

    ends = np.array([-1.0]), np.array([beyond])
    found, over_pole = crossing_fractions(values_at, np.array([0.5]), *ends)
    assert abs(found - root) < 3e-14
    assert not over_pole


def test_a_pole_within_a_step_gives_the_chord_and_a_status(tmp_path):
    """The sign of the surface changes through infinity: no point lies beyond both ends."""
    rng, seen = np.random.default_rng(1), 0
    for _ in range(6):
        field = sf.QuadraticField(*(rng.normal(size=(3,) * k) for k in (3, 2, 1)))
        x, c = rng.normal(size=(64, 3)), rng.normal(size=3)
        points = sf.crossings(
            field, x, 0.3, 6, lambda x, c=c: x @ c - 0.3, direction=0, method="order4",
            on_singular="ignore",
        )  # fmt: skip
        before, after, there = (x @ c - 0.3 for x in (points.before, points.after, points.states))
        assert (abs(there) <= np.maximum(abs(before), abs(after)) * (1 + 1e-12)).all()
        over = points.over_pole
        chord = points.before + (before / (before - after))[:, None] * (
            points.after - points.before
        )
        np.testing.assert_allclose(points.states[over], chord[over], rtol=1e-12, atol=1e-12)
        assert not points.valid[over].any()
        first, status = points.first_pole[points.trajectory], points.status[points.trajectory]
        assert ((first > 0) & (first <= points.n + 1))[over].all()
        assert {*status[over]} <= {*sf.Status} - {sf.Status.OK}
        points.save(tmp_path / "points.npz", overwrite=True)
        assert sf.load(tmp_path / "points.npz") == points
        seen += over.sum()
    assert seen > 20
