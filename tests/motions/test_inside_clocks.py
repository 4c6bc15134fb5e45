"""Clocks count from the start of a motion: dates in seconds cost what times from 0 cost."""

import numpy as np
import pytest
from systems import field

import suslov_fast as sf

DATE = 1.7e9  # a date in seconds is rounded to 2.4e-7


def rates(at):
    """Right-hand sides that begin at a time, with the integral of each over the next 5."""
    knots = at + np.array([0.0, 0.3, 0.30001, 1.7, 4.2, 9.0])
    heights = np.array([0.1, 0.9, 0.2, 0.7, 0.7, -0.5])
    of_table = (heights[1:] + heights[:-1]) / 2 * np.diff(knots)
    left = at + 5.0 - knots[4]
    rest = left * (0.7 - 0.6 * left / (knots[5] - knots[4]))
    a, b = at + 1.25, at + 3.5
    return {
        "table": (lambda t: np.interp(t, knots, heights), of_table[:4].sum() + rest),
        "pulse": (lambda t: np.where((t >= a) & (t < b), 2.0, 0.0), 4.5),
        "late": (lambda t: np.where(t > b, t - b, 0.0), 1.5**2 / 2),
        "wave": (lambda t: np.cos(3 * (t - at)), np.sin(15.0) / 3),
        "root": (lambda t: np.sqrt(np.abs(t - a)), (1.25**1.5 + 3.75**1.5) / 1.5),
        "ramp": (lambda t: np.clip((t - a) / 2, 0, 1), 1.0 + 1.75),
        "guard": (lambda t: np.where(t < a, 1 / (b - t), 0.0), np.log(3.5 / 2.25)),
        "day": (lambda t: np.where(np.mod(t - at, 2.0) < 0.5, 1.0, 0.0), 1.5),
        "days": (lambda t: np.interp(np.mod(t - at, 2.0), [0, 0.5, 2], [0, 1, 3]), 6.75 + 2 / 3),
    }


@pytest.mark.sampled(10)
@pytest.mark.parametrize("name", rates(0.0))
@pytest.mark.parametrize("stiff", [None, True])
def test_dates_cost_what_times_from_0_cost(name, stiff):
    found = {}
    for at in (0.0, DATE):
        rate, exact = rates(at)[name]
        motion = sf.flow(field(lambda s, r=rate: (r(s[1]), 1.0)), [2.0, at], time=5.0, stiff=stiff)
        found[at] = motion
        assert abs(motion.states[0, 0] - 2.0 - exact) < 1e-8
        assert motion.states[0, 1] == at + 5.0
        many = sf.flow(
            field(lambda s, r=rate: (r(s[1]), 1.0)), [[2.0, at]] * 3, time=[1.0, 5.0], stiff=stiff
        )
        np.testing.assert_array_equal(many.states[1], [motion.states[0]] * 3)
    assert max(motion.steps for motion in found.values()) <= found[0.0].steps + 10


def test_dates_of_which_only_differences_matter_give_the_same_bits():
    def f(s, start):
        return np.where(s[1] - start > 1.0, 0.0, np.cos(s[1] - start)) - s[0], 1.0

    ends = [
        sf.flow(field(f, start=at), [0.3, at], time=[0.5, 3.0]).states[:, 0]
        for at in (0.0, 2.0, DATE)
    ]
    np.testing.assert_array_equal(ends[1:], [ends[0]] * 2)


@pytest.mark.parametrize("at", [0.0, 0.1, DATE])
def test_a_clock_may_be_the_first_component(at):
    """Its number is 0, which is no constant."""

    def f(t, x):
        late = np.where(t > at + 0.5, 3 * t - 3 * at, 0.0)
        return np.cos(2 * t - 1.0) + late + abs(t - at - 0.3) - np.sin(t / 2) * x

    first = sf.flow(field(lambda s: (1.0, f(*s)), "t x"), [at, 0.2], time=[1.0, 2.0])
    last = sf.flow(field(lambda s: (f(s[1], s[0]), 1.0)), [0.2, at], time=[1.0, 2.0])
    np.testing.assert_array_equal(first.states, last.states[:, ::-1])


def test_large_phases():
    """The phase of a wave is known to the rounding of the date times its frequency."""
    omega = np.array([2 * np.pi / 86400, 1.0, 50.0])
    f = field(lambda s, w: (np.cos(w * s[1] + 1), 1.0), w=omega)
    motion = sf.flow(f, [0.0, DATE], time=10.0)
    begin, end = (np.sin(omega * (DATE + t) + 1) for t in (0.0, 10.0))
    np.testing.assert_allclose(motion.states[0, :, 0], (end - begin) / omega, atol=1e-5)
    assert (motion.steps < 500).all()


def test_members_and_derivatives_at_dates():
    def f(s, begin, k):
        return np.where(s[1] > begin, 2.0, 0.0) - k * s[0], 1.0

    begin, start = DATE + np.array([1.0, 1.5]), np.array([[0.0, DATE], [0.0, DATE + 1.0]])
    motion = sf.flow(field(f, begin=begin, k=0.5), start, time=3.0, derivatives=("begin", "x0"))
    left = DATE + np.array([3.0, 4.0]) - begin
    np.testing.assert_allclose(motion.states[0, :, 0], 4.0 * -np.expm1(-left / 2), rtol=1e-9)
    np.testing.assert_allclose(motion.derivatives["begin"][0, :, 0], -2 * np.exp(-left / 2))
    np.testing.assert_allclose(motion.derivatives["x0"][0, :, 0, 1], 2 * np.exp(-left / 2))


@pytest.mark.parametrize("at", [0.0, DATE])
def test_derivatives_by_the_lag_of_a_table(at):
    """x' = T(t - lag), so dx/dlag = T(start - lag) - T(end - lag), by the start its negative."""
    knots, heights = [0, 1, 2, 5, 7], [0, 1, -1, 2, 0]
    f = field(lambda s, lag: (np.interp(s[1] - at - lag, knots, heights), 1.0), lag=[0.1, 0.7])
    motion = sf.flow(f, [0.0, at + 0.9], time=[0.5, 2.5], derivatives=("lag", "x0"))
    begin, end = (np.interp(0.9 + t - f.parameters["lag"], knots, heights) for t in (0.0, 2.5))
    np.testing.assert_allclose(motion.derivatives["lag"][1, :, 0], begin - end, rtol=1e-8)
    np.testing.assert_allclose(motion.derivatives["x0"][1, :, 0, 1], end - begin, rtol=1e-8)


def test_two_clocks_and_a_rate_that_is_a_parameter():
    f = field(lambda s, r: (np.cos(s[1] - r * s[2]), r, 1.0), "x t u", r=[1.0, 2.0])
    motion = sf.flow(f, [[1.0, DATE, DATE - 1.0], [1.0, 5.0, 2.0]], time=4.0)
    np.testing.assert_allclose(motion.states[0, :, 0], 1.0 + 4.0 * np.cos(1.0), rtol=1e-12)
    np.testing.assert_array_equal(motion.states[0, :, 1], [DATE + 4.0, 13.0])


@pytest.mark.parametrize("batch", [(), (3,)])
def test_changes_and_crossings_at_dates(batch):
    """Surfaces and changes read clocks, too; one that changes a clock leaves it as it is."""

    def found(at):
        f = field(lambda s: (np.where(np.sin(s[1] - at) > 0.5, 1.0, -s[0]), 1.0, 2.0), "x t u")
        changes = [
            sf.Event(times=[0.5, 2.0, 2.5], to=lambda s: (s[0] + np.cos(s[1] - at), s[1], s[2])),
            sf.Event(
                surface=lambda s: s[0] - 0.1 * (s[1] - at) - 0.3, to=lambda s: s * [0.5, 1, 0]
            ),
        ]
        x0 = np.broadcast_to([0.3, at, 1.0], (*batch, 3))
        run = sf.flow(f, x0, time=[1.0, 6.0], events=changes)
        points = sf.crossings(
            f, x0, time=6.0, surface=lambda s: s[0] - 0.3 * np.sin(4 * (s[1] - at)), direction=0
        )
        clocks = run.events.states[:, 1], points.states[:, 1], run.states[..., 1]
        return [run.states[..., 0], run.states[..., 2], run.events.time, points.time], clocks

    (usual, clocks), (later, others) = found(0.0), found(DATE)
    assert min(map(len, usual[2:])) > 3
    for a, b in zip(usual, later, strict=True):
        np.testing.assert_array_equal(a, b)
    for a, b in zip(clocks, others, strict=True):
        np.testing.assert_array_equal(a + DATE, b)
