"""Integrals of rates of a clock that choose: the branch not taken counts for nothing; dates."""

import numpy as np
import pytest
from systems import field

import suslov_fast as sf

# The integral of sin(t) / t from 0 to 1, and that of (1 - cos t) / t from 1 to 1.1.
SINE, COSINE = 0.946083070367183, 0.0478407252806422
HOURS = 100 * 24 * (np.pi - 2 * np.arcsin(0.99)) / (2 * np.pi)  # of light in 100 days
AREA = 100 * 24 * (np.sqrt(1 - 0.99**2) / np.pi) - 0.99 * HOURS


def from_1(rate):
    """A rate that is 0 before t = 1, and then begins like a root."""
    return lambda t: np.where(t > 1, rate(np.maximum(t - 1, 0)), 0)


def of_the_sun(rate):
    return lambda t: rate(np.sin(2 * np.pi * t / 24))


FORWARD = lambda t: np.where(t == 0, 1.0, np.sin(t) / t)  # noqa: E731  back it ends at 0/0
# Rates, a start of the clock, a time, and the integral; with the digits of the tolerance.
CHOICES = [
    (lambda t: np.where(t < 1, 1 / (2 - t), 0), 0.0, 5.0, np.log(2)),
    (lambda t: np.where(t < 1, -1 / (2 - t), 0), 0.0, 5.0, -np.log(2)),
    (lambda t: (t < 1) * (1 / (2 - t)), 0.0, 5.0, np.log(2)),
    (lambda t: np.where(t < 1, np.sin(t) / np.cos(t), 0), 0.0, 5.0, -np.log(np.cos(1))),
    (lambda t: np.where(t < 4, np.where(t < 1, 1 / (3 - t), 0), 1 / (t - 3)), 0.0, 5.0, np.log(3)),
    (lambda t: sum(np.where(t < k / 12, 1 / (2 - t), 0) for k in range(12)), 0.0, 5.0,
     sum(np.log(2 / (2 - k / 12)) for k in range(12))),
    # A zero of the dividend is no pole.
    (lambda t: np.where(t != 0, np.sin(t) / t, 1), -1.0, 2.0, SINE * 2),
    (FORWARD, 0.0, 1.0, SINE),
    (lambda t: np.where(t < 1, np.where(t == 0, 0, (1 - np.cos(t)) / t), 0), -1.1, 5.0, -COSINE),
    # A choice that changes just after the start, forward and backward.
    (lambda t: np.where(t > 0, np.cos(t), 0.0), 0.0, 1.0, np.sin(1.0)),
    (lambda t: np.where(t > 0, np.cos(t), 0.0), -1.0, 2.0, np.sin(1.0)),
    # A pulse much shorter than a step.
    (lambda t: np.heaviside(t - 5, 0.5) - np.heaviside(t - 5.001, 0.5), 0.0, 10.0, 0.001),
    (lambda t: np.where((t > 2) & (t < 2.01), 100.0, 0.0), 0.0, 10.0, 1.0),
    (np.floor, 0.0, 10.0, 45.0),
    (np.floor, 2.5, -2.0, -2.0),
]  # fmt: skip
# Branches that end at their surface, and surfaces that are crossed twice in a step: some digits
# fewer.
ENDS = [
    # The integral of sqrt(cos) from 0 to pi/2, less that of sqrt(sin) from 0 to 2 - pi/2.
    (lambda t: np.where(np.cos(t) > 0, np.sqrt(np.cos(t)), -np.sqrt(-np.cos(t))), 0.0, 2.0,
     1.0119143948),
    (lambda t: np.where(t > 1, np.log(t - 1), np.log(1 - t)), 0.0, 2.0, -2.0),
    (lambda t: np.where(t > 1, (t - 1) * np.log(t - 1), 2.0), 0.0, 2.0, 2.0 - 0.25),
    (lambda t: abs(t - 1) ** -0.3, 0.0, 2.0, 2 / 0.7),
    (lambda t: np.where(t < 1, (1 - t) ** 0.5, (t - 1) ** 1.5), 0.0, 2.0, 2 / 3 + 2 / 5),
    (lambda t: abs(t) ** 1.5, 0.0, 2.0, 2 / 5 * 2**2.5),
    (lambda t: np.sqrt(np.maximum(-t, 0.0)), 0.0, 2.0, 0.0),
    (from_1(np.sqrt), 0.0, 2.0, 2 / 3),
    (from_1(lambda s: s**0.1), 0.0, 2.0, 1 / 1.1),
    (from_1(lambda s: np.where(s > 0, -s * np.log(s + (s <= 0)), 0)), 0.0, 2.0, 1 / 4),
    (from_1(lambda s: 0.7 * s**-0.3 * np.exp(-(s**0.7))), 0.0, 2.0, 1 - np.exp(-1.0)),  # Weibull
    (of_the_sun(lambda sun: np.where(sun > 0.99, 1.0, 0.0)), 0.0, 2400.0, HOURS),
    (of_the_sun(lambda sun: np.floor(abs(sun) / 0.99)), 0.0, 2400.0, 2 * HOURS),
    (of_the_sun(lambda sun: np.interp(sun, [0.98, 0.99, 1.0], [0.0, 0.0, 0.01])), 0.0, 2400.0,
     AREA),
]  # fmt: skip


# Many comparisons of one number.
BEGIN = np.linspace(0.25, 9.75, 40)
STAIR, SIGNS = 9.5 / 39, (-1.0) ** np.arange(40)
PULSES = [
    (lambda t: ((t >= BEGIN) & (t < BEGIN + 0.125)).sum(), 0.0, 10.0, 40 * 0.125),
    (lambda t: sum(a * np.where(b < t, 2.0, -1.0) for a, b in zip(SIGNS, BEGIN, strict=True)),
     0.0, 10.0, (SIGNS * (2 * (10 - BEGIN) - BEGIN)).sum()),
    (lambda t: (t >= BEGIN).sum() * np.where(t < 5, 1.0, 0.5), 0.0, 10.0,
     np.maximum(5 - BEGIN, 0).sum() + 0.5 * (10 - np.maximum(BEGIN, 5)).sum()),
    # Each stair leads beyond a kink, for 1/20 of the way to the next one.
    (lambda t: np.maximum((t >= BEGIN).sum() - 0.95 - (t - 0.25) / STAIR, 0), 0.0, 10.0,
     (40 * 0.05**2 + (0.25 / STAIR - 0.95) ** 2) / 2 * STAIR),
]  # fmt: skip


@pytest.mark.parametrize("turn", [0, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["CHOICES", "ENDS", "PULSES"])
def test_integrals_of_rates_that_choose(name, turn):
    """Of a batch, with the bits of one, and back; by options in turn, first of every other rate."""
    for k, (rate, start, time, exact) in [*enumerate(globals()[name])][:: 1 if turn else 2]:
        options = ({}, {"stiff": True}, {"atol": 1e-12})[(k + turn) % 3]
        with np.errstate(all="ignore"):
            f = field(lambda s, rate=rate: (rate(s[1]), 1.0))
        motion = sf.flow(f, [[0.0, start]] * 3, time=time, **options)
        digits = 2.5e-8 if name == "ENDS" else 1e-11
        ends = [motion.final]
        if rate is not FORWARD:
            ends.append(-sf.flow(f, [[0.0, start + time]] * 3, time=-time, **options).final)
        for found in ends:
            np.testing.assert_allclose(found[:, 0], exact, digits, digits, err_msg=f"{name}[{k}]")
        alone = sf.flow(f, [0.0, start], time=time, **options)
        np.testing.assert_array_equal(motion.states, alone.states[:, np.newaxis].repeat(3, axis=1))
        assert motion.steps.max() < (4200 if time > 100.0 else 370)


# ------------------------------------------------------------- clocks that start at a date
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
        "wave": (lambda t: np.cos(3 * (t - at)), np.sin(15.0) / 3),
        "root": (lambda t: np.sqrt(np.abs(t - a)), (1.25**1.5 + 3.75**1.5) / 1.5),
        "ramp": (lambda t: np.clip((t - a) / 2, 0, 1), 1.0 + 1.75),
        "guard": (lambda t: np.where(t < a, 1 / (b - t), 0.0), np.log(3.5 / 2.25)),
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


@pytest.mark.parametrize("at", [0.0, 0.1, DATE])
def test_a_clock_may_be_the_first_component(at):
    """Its number is 0, which is no constant."""

    def f(t, x):
        late = np.where(t > at + 0.5, 3 * t - 3 * at, 0.0)
        return np.cos(2 * t - 1.0) + late + abs(t - at - 0.3) - np.sin(t / 2) * x

    first = sf.flow(field(lambda s: (1.0, f(*s)), "t x"), [at, 0.2], time=[1.0, 2.0])
    last = sf.flow(field(lambda s: (f(s[1], s[0]), 1.0)), [0.2, at], time=[1.0, 2.0])
    np.testing.assert_array_equal(first.states, last.states[:, ::-1])


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


def test_changes_and_crossings_at_dates():
    """Surfaces and changes read clocks, too; one that changes a clock leaves it as it is."""

    def found(at):
        f = field(lambda s: (np.where(np.sin(s[1] - at) > 0.5, 1.0, -s[0]), 1.0, 2.0), "x t u")
        changes = [
            sf.Event(times=[0.5, 2.0, 2.5], to=lambda s: (s[0] + np.cos(s[1] - at), s[1], s[2])),
            sf.Event(
                surface=lambda s: s[0] - 0.1 * (s[1] - at) - 0.3, to=lambda s: s * [0.5, 1, 0]
            ),
        ]
        x0 = np.broadcast_to([0.3, at, 1.0], (3, 3))
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


@pytest.mark.parametrize("stiff", [None, True])
@pytest.mark.parametrize(
    ("f", "start", "time", "right"),
    [
        (lambda t: np.sqrt(np.maximum(1 - t**2, 0)), -1.0, 1.0, np.pi / 4),
        (lambda t: np.sqrt(4 - t**2), -2.0, 2.0, np.pi),
        (lambda t: np.sqrt(1 + t), -1.0, 1.0, 2 / 3),
        (lambda t: np.sqrt(np.maximum(t - 1e6, 0)), 1e6, 9.0, 18.0),
        (lambda t: np.cbrt(t - 5), 5.0, 8.0, 12.0),
    ],
)
def test_starts_at_the_edge_of_the_domain_of_f(f, start, time, right, stiff):
    """Just after the start f is a staircase: t has rounding errors, and f' is infinite."""
    for rtol in (1e-6, 1e-9, 1e-12):
        of_time = sf.Field(lambda s: (f(s[1]), 1.0), "x t")
        motion = sf.flow(of_time, [0.0, start], time=time, rtol=rtol, stiff=stiff)
        assert motion.ok
        assert motion.steps < 200
        assert abs(motion.final[0] - right) < 3 * rtol * right
