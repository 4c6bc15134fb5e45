"""Crossings of surfaces along motions: points, times, ends, values that are no numbers."""

import numpy as np
import pytest
from scipy.special import ellipk
from systems import pendulum

import suslov_fast as sf

OSCILLATOR = sf.Field(lambda x: (x[1], -x[0]), "q p")


def of_oscillator(start, surface="q", direction="up", **arguments):
    return sf.crossings(OSCILLATOR, start, surface, direction=direction, **arguments)


def test_ripples_that_a_step_does_not_see(rng):
    """Fast forces that are allowed errors of x, almost: v changes its sign many times in a step."""
    w, a = 10 ** rng.uniform(0.2, 2, 30), 10 ** rng.uniform(-3, 0, 30)
    field = sf.Field(lambda s, w, a: (s[1], -s[0] + a * np.cos(w * s[2]), 1.0), "x v t", w=w, a=a)
    points = sf.crossings(field, [1.0, 0.1, 0.0], surface="v", time=20.0, direction=0)
    t, part = np.linspace(0, 20, 100_001)[:, np.newaxis], a / (1 - w * w)
    v = 0.1 * np.cos(t) - np.sin(t) + part * (np.sin(t) - w * np.sin(w * t))
    exact = ((v[1:] >= 0.0) != (v[:-1] >= 0.0)).sum(axis=0)
    assert (points.count[..., 0] == exact).all()
    assert abs(points.states[:, 1]).max() < 2e-12


def test_a_motion_that_only_touches_the_surface_does_not_cross_it():
    points = of_oscillator([0.0, 1.0], lambda x: x[..., 0] - 1.0 - 1e-7, time=100.0, direction=0)
    assert len(points.states) == 0
    points = of_oscillator([0.0, 1.0], lambda x: x[..., 0] - 1.0 + 1e-4, time=100.0, max_step=0.02)
    assert len(points.states) == 16  # with a step short enough


@pytest.mark.parametrize(("direction", "sign"), [(1, 1.0), (0, 1.0), (-1, -1.0)])
def test_a_start_on_the_surface_is_no_crossing(direction, sign):
    starts = [[0.0, 1.0], [0.0, -1.0], [-0.0, -1.0]]
    assert not of_oscillator(starts, time=sign, direction=direction).count.any()
    later = of_oscillator(starts, time=4.0 * sign, direction=direction)
    np.testing.assert_allclose(later.time, sign * np.pi, atol=1e-8)
    up = np.array([False, True, True]) if sign > 0.0 else np.array([True, False, False])
    assert (later.count[..., 0] == (1 if direction == 0 else up == (direction > 0))).all()
    given = {"time": 20.0 * sign, "direction": direction, "most": 1}
    points = sf.crossings(sf.Field(pendulum, "q v"), [0.0, -1.0], surface="q", **given)
    half = 2.0 * ellipk(0.25)  # of the swing to 60 degrees
    assert abs(points.time[0]) == pytest.approx(half if direction in (0, sign) else 2.0 * half)


def test_a_motion_from_a_crossing_does_not_cross_again():
    rng = np.random.default_rng(2)
    for direction in (1, -1):
        points = of_oscillator(
            rng.normal(size=(50, 2)), lambda x: x[..., 0] - 0.1, time=10.0, most=1,
            direction=direction,
        )  # fmt: skip
        again = of_oscillator(points.states, lambda x: x[..., 0] - 0.1, time=0.01, direction=0)
        assert len(points.states) > 40
        assert len(again.states) == 0


def test_crossings_in_the_transient_are_ignored():
    every = of_oscillator([1.0, 0.0], time=30.0)
    later = of_oscillator([1.0, 0.0], time=20.0, transient=10.0)
    np.testing.assert_array_equal(later.time, every.time[every.time > 10.0])
    np.testing.assert_array_equal(later.final, every.final)


def test_solutions_that_end():
    field = sf.Field(lambda x: (x[0] ** 2,), "x")
    x0 = [[1.0], [-1.0], [np.nan], [0.5]]
    with pytest.warns(sf.IntegrationWarning, match="1 of 4"):
        points = sf.crossings(field, x0, surface=lambda x: x[..., 0] - 3.0, time=1.5)
    assert points.trajectory.tolist() == [0]
    np.testing.assert_allclose(points.time, [2 / 3], rtol=1e-8)
    assert points.status.tolist() == [sf.Status.ENDED, 0, sf.Status.NONFINITE, 0]
    np.testing.assert_allclose(points.end, [1.0, 1.5, 0.0, 1.5], rtol=1e-8)
    np.testing.assert_allclose(points.final[:, 0], [np.nan, -0.4, np.nan, 2.0], rtol=1e-8)
    # A trajectory that has stopped before does not end.
    stopped = sf.crossings(field, x0, surface=lambda x: x[..., 0] - 3.0, time=1.5, most=1)
    assert stopped.ok.tolist() == [True, True, False, True]  # of the start that is NaN
    assert stopped.status.tolist() == [sf.Status.STOPPED, 0, sf.Status.NONFINITE, 0]


def test_values_that_are_no_numbers_make_no_crossing():
    with np.errstate(invalid="ignore"):
        points = of_oscillator([0.9, 0.0], lambda x: np.log(x[..., 0]), time=10.0, direction=0)
        assert len(points.states) == 0
    points = of_oscillator([1.0, 0.5], lambda x: 1.0 / x[..., 0], time=10.0, direction=0)
    assert len(points.states) == 0  # a pole of the surface


@pytest.mark.parametrize("gap", [0.3, 1e-2, 1e-8])
def test_gaps_without_values_between_two_signs_make_no_crossing(gap):
    angles = np.linspace(0.1, 6.1, 40)
    starts = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    starts = starts[abs(starts[:, 0]) > gap]
    arguments = {"time": 2 * np.pi, "direction": 0, "rtol": 1e-6}

    def hole(x):
        return 1e-200 * np.sqrt(x**2 - gap**2)

    for surface in (lambda s: s[0] + hole(s[0]), lambda s: np.sign(s[0]) + hole(s[0])):
        assert not of_oscillator(starts, surface, **arguments).count.any()
    found = of_oscillator(starts, lambda s: s[0] - 0.5 + hole(s[0]), **arguments)
    assert (found.count == 2).all()


def test_crossings_beside_gaps(rng):
    """Where x > 0 its logarithm passes a level up and down; else it has no value."""
    level, r, p = rng.uniform(-6, 0, 100), rng.uniform(1, 3, 100), rng.uniform(0, 6, 100)
    field = sf.Field(lambda s, level: (s[1], -s[0]), "x v", level=level)
    x0 = np.stack([r * np.cos(p), -r * np.sin(p)], axis=-1)
    found = sf.crossings(field, x0, surface=lambda s, level: np.log(s[0]) - level, time=30.0)
    angle = np.arccos(np.exp(level) / r)
    for k in range(100):
        times = np.add.outer(2 * np.pi * np.arange(7), [-angle[k], angle[k]]).ravel() - p[k]
        own = found.time[found.trajectory == k]
        np.testing.assert_allclose(own, times[(times > 0) & (times < 30)], atol=1e-6)


def test_progress_ends_a_search():
    told = []

    def progress(done, total):
        told.append((done, total))
        return False

    points = of_oscillator([[1.0, 0.0], [0.0, 1.0]], time=1e5, progress=progress)
    assert told == [(0, 2)]
    assert (points.status == sf.Status.TOO_MANY_STEPS).all()
    assert np.isnan(points.final).all()
