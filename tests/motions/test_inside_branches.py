"""Branches of f: one that is not taken counts for nothing."""

import numpy as np
import pytest
from systems import field

import suslov_fast as sf

# The integral of sin(t) / t from 0 to 1, and that of (1 - cos t) / t from 1 to 1.1.
SINE, COSINE = 0.946083070367183, 0.0478407252806422
HOURS = 100 * 24 * (np.pi - 2 * np.arcsin(0.99)) / (2 * np.pi)  # of light in 100 days
AREA = 100 * 24 * (np.sqrt(1 - 0.99**2) / np.pi) - 0.99 * HOURS


def signed_root(c):
    return np.where(c > 0, np.sqrt(c), -np.sqrt(-c))


def from_1(rate):
    """A rate that is 0 before t = 1, and then begins like a root."""
    return lambda t: np.where(t > 1, rate(np.maximum(t - 1, 0)), 0)


def of_the_sun(rate):
    return lambda t: rate(np.sin(2 * np.pi * t / 24))


# Rates, a start of the clock, a time, and the integral; with the digits of the tolerance.
CHOICES = [
    (lambda t: np.where(t < 1, 1 / (2 - t), 0), 0.0, 5.0, np.log(2)),
    (lambda t: np.where(t < 1, -1 / (2 - t), 0), 0.0, 5.0, -np.log(2)),
    (lambda t: (t < 1) / (2 - t), 0.0, 5.0, np.log(2)),
    (lambda t: (t < 1) * (1 / (2 - t)), 0.0, 5.0, np.log(2)),
    (lambda t: np.heaviside(1 - t, 0) / (2 - t), 0.0, 5.0, np.log(2)),
    (lambda t: np.where(t < 1, np.sin(t) / np.cos(t), 0), 0.0, 5.0, -np.log(np.cos(1))),
    (lambda t: np.where(t < 4, np.where(t < 1, 1 / (3 - t), 0), 1 / (t - 3)), 0.0, 5.0, np.log(3)),
    (lambda t: sum(np.where(t < k / 12, 1 / (2 - t), 0) for k in range(12)), 0.0, 5.0,
     sum(np.log(2 / (2 - k / 12)) for k in range(12))),
    # A zero of the dividend is no pole.
    (lambda t: np.where(t != 0, np.sin(t) / t, 1), -1.0, 2.0, SINE * 2),
    (lambda t: np.where(t == 0, 1.0, np.sin(t) / t), 0.0, 1.0, SINE),
    (lambda t: np.where(t < 1, np.where(t == 0, 0, (1 - np.cos(t)) / t), 0), -1.1, 5.0, -COSINE),
    # A choice that changes just after the start, forward and backward.
    (lambda t: np.where(t > 0, np.cos(t), 0.0), 0.0, 1.0, np.sin(1.0)),
    (lambda t: np.where(t >= 0, 0.0, 1.0), 0.0, -1.0, -1.0),
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
    (lambda t: signed_root(np.cos(t)), 0.0, 2.0, 1.0119143948),
    (lambda t: signed_root(t - 1), 0.0, 2.0, 0.0),
    (lambda t: np.where(t > 1, np.log(t - 1), np.log(1 - t)), 0.0, 2.0, -2.0),
    (lambda t: np.where(t > 1, (t - 1) * np.log(t - 1), 2.0), 0.0, 2.0, 2.0 - 0.25),
    (lambda t: abs(t - 1) ** -0.3, 0.0, 2.0, 2 / 0.7),
    (lambda t: np.where(t < 1, (1 - t) ** 0.5, (t - 1) ** 1.5), 0.0, 2.0, 2 / 3 + 2 / 5),
    (lambda t: abs(t) ** 1.5, 0.0, 2.0, 2 / 5 * 2**2.5),
    (lambda t: np.sqrt(abs(t)), 0.0, 2.0, 2 / 3 * 2**1.5),
    (lambda t: np.sqrt(np.maximum(-t, 0.0)), 0.0, 2.0, 0.0),
    (from_1(np.sqrt), 0.0, 2.0, 2 / 3),
    (from_1(lambda s: s**0.9), 0.0, 2.0, 1 / 1.9),
    (from_1(lambda s: s**0.1), 0.0, 2.0, 1 / 1.1),
    (from_1(lambda s: np.where(s > 0, -s * np.log(s + (s <= 0)), 0)), 0.0, 2.0, 1 / 4),
    (from_1(lambda s: 0.7 * s**-0.3 * np.exp(-(s**0.7))), 0.0, 2.0, 1 - np.exp(-1.0)),  # Weibull
    (of_the_sun(lambda sun: np.where(sun > 0.99, 1.0, 0.0)), 0.0, 2400.0, HOURS),
    (of_the_sun(lambda sun: np.floor(abs(sun) / 0.99)), 0.0, 2400.0, 2 * HOURS),
    (of_the_sun(lambda sun: np.maximum(sun, 0.99) - 0.99), 0.0, 2400.0, AREA),
    (of_the_sun(lambda sun: np.interp(sun, [0.98, 0.99, 1.0], [0.0, 0.0, 0.01])), 0.0, 2400.0,
     AREA),
]  # fmt: skip


@pytest.mark.parametrize("turn", [0, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["CHOICES", "ENDS"])
def test_integrals_of_rates_that_choose(name, turn):
    """Of a batch, with the bits of one; by options in turn, at first of every other rate."""
    for k, (rate, start, time, exact) in [*enumerate(globals()[name])][:: 1 if turn else 2]:
        options = ({}, {"stiff": True}, {"atol": 1e-12})[(k + turn) % 3]
        with np.errstate(all="ignore"):
            f = field(lambda s, rate=rate: (rate(s[1]), 1.0))
        motion = sf.flow(f, [[0.0, start]] * 3, time=time, **options)
        digits = 1e-11 if name == "CHOICES" else 2.5e-8
        np.testing.assert_allclose(
            motion.states[0, :, 0], exact, digits, digits, err_msg=f"{name}[{k}]"
        )
        alone = sf.flow(f, [0.0, start], time=time, **options)
        np.testing.assert_array_equal(motion.states, alone.states[:, np.newaxis].repeat(3, axis=1))
        assert motion.steps.max() < (4200 if time > 100.0 else 370)


@pytest.mark.parametrize(
    ("rate", "end"),
    [
        (lambda t: np.where(t < 3, 1 / (2 - t), 0), 2.0),
        (lambda t: np.where(t < 1, 0, -1 / (t - 2)), 2.0),
        (lambda t: np.cos(t) / np.sin(t), np.pi),
    ],
)
def test_a_pole_that_is_taken_ends_the_solution(rate, end):
    with pytest.warns(sf.IntegrationWarning):
        motion = sf.flow(field(lambda s: (rate(s[1]), 1.0)), [0.0, 0.5], time=5.0)
    assert motion.status == sf.Status.ENDED
    np.testing.assert_allclose(motion.end, end - 0.5, rtol=1e-8)


def test_members_of_a_family_whose_factor_is_0_have_no_pole():
    f = field(lambda s, a: (a * (1 / (2 - s[1])), 1.0), a=[0.0, 1.0])
    with pytest.warns(sf.IntegrationWarning):
        motion = sf.flow(f, [0.0, 0.0], time=5.0)
    np.testing.assert_array_equal(motion.states[0, 0], [0.0, 5.0])
    np.testing.assert_allclose(motion.end[1], 2.0, rtol=1e-8)


def test_derivatives_beside_a_pole_that_is_not_taken():
    f = field(lambda s, a: (np.where(s[1] < 1, -a * s[0] / (2 - s[1]), -s[0]), 1.0), a=1.0)
    motion = sf.flow(f, [1.0, 0.0], time=5.0, derivatives=("a", "x0"))
    end = np.exp(-4) / 2  # x = 1 - t/2 up to 1
    np.testing.assert_allclose(motion.states[0, 0], end, rtol=1e-8)
    np.testing.assert_allclose(motion.derivatives["a"][0, 0], -np.log(2) * end, rtol=1e-7)
    np.testing.assert_allclose(motion.derivatives["x0"][0, 0, 0], end, rtol=1e-7)


# ----------------------------------------------------------- branches that end at their surface
@pytest.mark.parametrize(
    ("rate", "integral"),
    [
        (lambda t: np.sqrt(abs(t - 1)), lambda a: a**1.5 / 1.5),
        (lambda t: abs(t - 1) ** 0.3, lambda a: a**1.3 / 1.3),
        (lambda t: np.log(abs(t - 1)), lambda a: a * np.log(a) - a),
        (lambda t: np.where(t < 1, np.sqrt(1 - t), 5.0), lambda a: a**1.5 / 1.5),
    ],
)
def test_times_on_a_kink_beyond_which_there_is_no_value(rate, integral, rng):
    """At the last time, and before it."""
    f = field(lambda s: (rate(s[1]), 1.0))
    starts = [-0.1, *np.round(1 - rng.uniform(0.05, 5.0, 20), 2)]
    for start in starts:
        for times in ([1 - start], [1 - start, 2 - start]):
            motion = sf.flow(f, [3.0, start], time=times)
            np.testing.assert_allclose(motion.states[0, 0], 3.0 + integral(1 - start), atol=3e-7)
            assert motion.status == sf.Status.OK


# --------------------------------------------------------------------------------------- sliding
def test_a_solution_that_slides_is_told_where_it_begins_to():
    """x' = c - sign(x - a sin(b t)) meets the surface where both rates lead back to it."""
    a, b, c, x0 = np.array([
        [1.5, 0.6, 0.3, 2.0], [0.4, 2.9, -1.2, 1.0], [0.9, 1.7, 0.8, -2.5],
        [1.9, 3.1, 0.1, 0.5], [0.2, 3.9, 0.5, -0.7], [1.1, 2.0, -0.4, 1.3],
    ]).T  # fmt: skip
    f = field(lambda s, a, b, c: (c - np.sign(s[0] - a * np.sin(b * s[1])), 1.0), a=a, b=b, c=c)
    with pytest.warns(sf.IntegrationWarning, match="slide"):
        motion = sf.flow(f, np.array([x0, 0 * x0]).T, time=np.linspace(0.05, 6.0, 7))
    for k in range(len(a)):
        np.testing.assert_allclose(motion.end[k], first_slide(a[k], b[k], c[k], x0[k]), rtol=1e-9)


def first_slide(a, b, c, x):
    """Return the time at which the solution of the test above begins to slide, NaN if never."""
    t, side = 0.0, np.sign(x)
    while t < 6.0:
        u = np.linspace(t + 1e-9, 6.0, 20001)
        crossed = np.flatnonzero((x + (c - side) * (u - t) - a * np.sin(b * u)) * side < 0)
        if not crossed.size:
            return np.nan
        low, high = u[crossed[0] - 1] if crossed[0] else t, u[crossed[0]]
        for _ in range(60):
            middle = (low + high) / 2
            is_before = (x + (c - side) * (middle - t) - a * np.sin(b * middle)) * side > 0
            low, high = (middle, high) if is_before else (low, middle)
        x, t = x + (c - side) * (low - t), low
        if (c + side - a * b * np.cos(b * t)) * side >= 0:
            return t
        side = -side
    return np.nan


@pytest.mark.parametrize("times", [[2.0], [1.05, 1.1, 1.5, 2.0]])
def test_a_short_time_of_sliding_is_not_stepped_over(times):
    f = field(lambda s: (np.where(s[0] > 0, -1, 0.1 - s[1]), np.where(s[0] > 0, 0, 1)), "y z")
    with pytest.warns(sf.IntegrationWarning, match="slide"):
        motion = sf.flow(f, [1.0, 0.0], time=times)
    np.testing.assert_allclose(motion.end, 1.0, rtol=1e-10)


# ------------------------------------------------------------------------------ why solutions end
@pytest.mark.parametrize(
    ("f", "start", "why"),
    [
        (lambda x: x**2, 1.0, "escape to infinity"),
        (lambda x: 1 + x**2, 0.0, "escape to infinity"),
        (lambda x: np.exp(x), 0.0, "escape to infinity"),
        (lambda x: -1 / x, 1.0, "pole"),
        (lambda x: -(x**-3.0), 1.0, "pole"),
        (lambda x: -np.sqrt(x) - 0.1, 1.0, "no value beyond"),
        (lambda x: np.log(x) - 1, 0.5, "no value beyond"),
        (lambda x: np.arcsin(x) + 1, 0.0, "no value beyond"),
    ],
)
def test_the_warning_says_what_ended(f, start, why):
    for starts in ([start], [[start]] * 9):
        with pytest.warns(sf.IntegrationWarning, match=why):
            assert (sf.flow(field(f, "x"), starts, time=5.0).status == sf.Status.ENDED).all()


@pytest.mark.parametrize("rate", [lambda t: 1 / (2 - t), lambda t: np.cos(t) / np.sin(t - 2)])
def test_a_pole_of_a_clock_is_told_of(rate):
    with pytest.warns(sf.IntegrationWarning, match="pole"):
        sf.flow(field(lambda s: (rate(s[1]), 1.0)), [1.0, 0.0], time=5.0)


def test_choices_that_change_twice_within_what_would_be_a_step():
    """A state passes through a thin slab, of which each side would be seen alone."""
    f = field(lambda s: (s[1], np.where((s[0] > 1.0) & (s[0] < 1.002), -300.0, 0.0)), "x v")
    motion = sf.flow(f, [0.0, 2.0], time=20.0)
    v = np.sqrt(4.0 - 2 * 300 * 0.002)
    inside = 2 * 0.002 / (2.0 + v)
    np.testing.assert_allclose(motion.states[0], [1.002 + v * (19.5 - inside), v], rtol=1e-9)


def test_thousands_of_jumps_between_two_times():
    """x'' = -sign(x), whose steps have no error and grow long: parabolas of 2 sqrt(2)."""
    time, half = 15_000.0, 2 * np.sqrt(2.0)
    motion = sf.flow(field(lambda s: (s[1], -np.sign(s[0])), "x v"), [1.0, 0.0], time=time)
    count, since = divmod(time + half / 2, half)
    exact = (-1) ** count * np.array([since * (half - since) / 2, half / 2 - since])
    np.testing.assert_allclose(motion.states[0], exact, atol=1e-3)
    assert motion.steps < count + 20


# ------------------------------------------------------------------- many comparisons of one number
BEGIN = np.linspace(0.25, 9.75, 40)
STAIR, SIGNS = 9.5 / 39, (-1.0) ** np.arange(40)


@pytest.mark.parametrize(
    ("rate", "exact"),
    [
        (lambda t: ((t >= BEGIN) & (t < BEGIN + 0.125)).sum(), 40 * 0.125),
        (lambda t: sum(np.where((t > b) & (b + 0.125 >= t), 3.0, 0.0) for b in BEGIN), 15.0),
        (lambda t: sum(a * np.where(b < t, 2.0, -1.0) for a, b in zip(SIGNS, BEGIN, strict=True)),
         (SIGNS * (2 * (10 - BEGIN) - BEGIN)).sum()),
        (lambda t: np.where((t >= BEGIN).sum() > 20, 1.0, 0.0), 10 - BEGIN[20]),
        (lambda t: (t >= BEGIN).sum() * np.where(t < 5, 1.0, 0.5),
         np.maximum(5 - BEGIN, 0).sum() + 0.5 * (10 - np.maximum(BEGIN, 5)).sum()),
        # Each stair leads beyond a kink, for 1/20 of the way to the next one.
        (lambda t: np.maximum((t >= BEGIN).sum() - 0.95 - (t - 0.25) / STAIR, 0),
         (40 * 0.05**2 + (0.25 / STAIR - 0.95) ** 2) / 2 * STAIR),
    ],
)  # fmt: skip
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_pulses_as_conditions(rate, exact, sign):
    f = field(lambda s: (rate(s[1]), 1.0))
    start = [100.0, 0.0 if sign > 0 else 10.0]
    motion = sf.flow(f, [start] * 3, time=10.0 * sign)
    np.testing.assert_allclose(motion.states[0, :, 0] - 100.0, sign * exact, rtol=1e-9)
    alone = sf.flow(f, start, time=10.0 * sign, derivatives="x0")
    np.testing.assert_allclose(alone.states[0, 0] - 100.0, sign * exact, rtol=1e-9)
    by_start = rate(start[1] + 10.0 * sign) - rate(start[1])  # of the clock
    np.testing.assert_allclose(alone.derivatives["x0"][0, 0], [1.0, by_start], atol=1e-9)


def test_stairs_of_the_state():
    """x' = 1 + the number of levels below x: 40 straight lines."""
    f = field(lambda s: (1.0 + (s[0] > BEGIN).sum(),), "x")
    heights = np.diff([0.0, *BEGIN])
    time = (heights / np.arange(1.0, 41.0)).sum()
    motion = sf.flow(f, [0.0], time=[time, time + 1.0])
    np.testing.assert_allclose(motion.states[:, 0], BEGIN[-1] + np.array([0.0, 41.0]), rtol=1e-9)
    falling = field(lambda s: (1.0 - 2 * (s[0] > BEGIN).sum(),), "x")
    with pytest.warns(sf.IntegrationWarning, match="slide"):
        assert sf.flow(falling, [0.0], time=1.0).end == pytest.approx(0.25)
