"""Motions of equations that choose: steps end where a condition changes, and sliding ends them."""

import numpy as np
import pytest
from systems import field

import suslov_fast as sf


def test_a_relaxation_whose_fast_variable_stays_near_a_kink():
    fast = field(lambda s: (-1e6 * (s[0] - np.cos(s[1])), 1 + 0.1 * abs(s[0] - np.cos(s[1]))), 2)
    motion = sf.flow(fast, [1.0, 0.0], time=100 * np.pi)
    np.testing.assert_allclose(motion.states[0, 1] - 100 * np.pi, 2e-5, rtol=0.1)
    assert motion.steps < 4000


def test_a_kink_that_is_only_touched_costs_little():
    touching = field(lambda s: (s[1], -s[0], np.maximum(s[0], 1.0)), "x v y")
    smooth = field(lambda s: (s[1], -s[0], 1.0 + 0 * s[0]), "x v y")
    motions = [sf.flow(f, [1.0, 0.0, 0.0], time=50.0) for f in (touching, smooth)]
    np.testing.assert_allclose(motions[0].states, motions[1].states, atol=1e-9)
    assert motions[0].steps <= motions[1].steps + 40


@pytest.mark.parametrize(
    "power", [lambda q: np.maximum(q, 0.0) ** 1.5, lambda q: np.sign(q) * np.abs(q) ** 1.5]
)
def test_a_kink_beyond_which_its_branch_has_no_value(power):
    """The equation of Lane and Emden, n = 3/2, whose zero is known (Horedt 1986): q^1.5 ends there.

    It begins at 1/10, by the series of q = 1 - r^2/6 + n r^4/120 - ...
    """
    star = field(lambda s: (s[1], -2 * s[1] / s[2] - power(s[0]), 1.0), "q v r")
    r, n = 0.1, 1.5
    a = (-1 / 6, n / 120, -n * (8 * n - 5) / 15120, n * (122 * n**2 - 183 * n + 70) / 3265920)
    q = 1 + sum(each * r ** (2 * k) for k, each in enumerate(a, start=1))
    v = sum(2 * k * each * r ** (2 * k - 1) for k, each in enumerate(a, start=1))
    zero = sf.crossings(star, [q, v, r], surface="q", time=4.9, direction=-1, rtol=1e-11)
    assert zero.ok.all()
    np.testing.assert_allclose(zero.time + r, [3.65375373622], rtol=2e-10)
    run = sf.flow(star, [q, v, r], time=4.9, rtol=1e-11, derivatives="x0")
    assert run.ok.all()
    assert run.states[0, 0] < 0
    assert np.isfinite(run.derivatives["x0"]).all()


def test_a_tank_drains_until_it_is_empty():
    """h' = -sqrt(h): h = (1 - t/2)^2 until t = 2."""
    drained = field(lambda h: -np.sqrt(np.maximum(h, 0.0)), "h")
    np.testing.assert_allclose(
        sf.flow(drained, 1.0, time=[1.0, 1.9, 4.0]).states[:, 0], [0.25, 0.0025, 0.0], atol=5e-9
    )
    back = field(lambda h: -np.sign(h) * np.sqrt(np.abs(h)), "h")  # from both sides to 0
    motion = sf.flow(back, 1.0, time=[1.9, 4.0])
    np.testing.assert_allclose(motion.states[:, 0], [0.0025, 0.0], atol=5e-9)
    assert motion.steps < 200


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


def test_derivatives_beside_a_pole_that_is_not_taken():
    f = field(lambda s, a: (np.where(s[1] < 1, -a * s[0] / (2 - s[1]), -s[0]), 1.0), a=1.0)
    motion = sf.flow(f, [1.0, 0.0], time=5.0, derivatives=("a", "x0"))
    end = np.exp(-4) / 2  # x = 1 - t/2 up to 1
    np.testing.assert_allclose(motion.states[0, 0], end, rtol=1e-8)
    np.testing.assert_allclose(motion.derivatives["a"][0, 0], -np.log(2) * end, rtol=1e-7)
    np.testing.assert_allclose(motion.derivatives["x0"][0, 0, 0], end, rtol=1e-7)


@pytest.mark.parametrize(
    ("rate", "integral"),
    [
        (lambda t: np.sqrt(abs(t - 1)), lambda a: a**1.5 / 1.5),
        (lambda t: abs(t - 1) ** 0.3, lambda a: a**1.3 / 1.3),
        (lambda t: np.where(t < 1, np.sqrt(1 - t), 5.0), lambda a: a**1.5 / 1.5),
    ],
)
def test_times_on_a_kink_beyond_which_there_is_no_value(rate, integral, rng):
    f = field(lambda s: (rate(s[1]), 1.0))
    starts = [-0.1, *np.round(1 - rng.uniform(0.05, 5.0, 6), 2)]
    for start in starts:
        for times in ([1 - start], [1 - start, 2 - start]):
            motion = sf.flow(f, [3.0, start], time=times)
            np.testing.assert_allclose(motion.states[0, 0], 3.0 + integral(1 - start), atol=3e-7)
            assert motion.status == sf.Status.OK


def test_thousands_of_jumps_between_two_times():
    """x'' = -sign(x), whose steps have no error and grow long: parabolas of 2 sqrt(2)."""
    time, half = 15_000.0, 2 * np.sqrt(2.0)
    motion = sf.flow(field(lambda s: (s[1], -np.sign(s[0])), "x v"), [1.0, 0.0], time=time)
    count, since = divmod(time + half / 2, half)
    exact = (-1) ** count * np.array([since * (half - since) / 2, half / 2 - since])
    np.testing.assert_allclose(motion.states[0], exact, atol=1e-3)
    assert motion.steps < count + 20


@pytest.mark.parametrize("stiff", [None, True])
@pytest.mark.parametrize("apart", [0.0, 2e-16, 1e-15, 1e-13, 1e-11])
def test_an_event_just_beyond_the_end_of_a_branch(apart, stiff):
    f = sf.Field(lambda s: (np.where(s[1] < 10, np.sqrt(10 - s[1]), 1.0), 1.0), "z t")
    times = np.array([10 * (1 + apart), 12.0])
    event = sf.Event(times=times, to=("z + 5", "t"))
    motion = sf.flow(f, [0.0, 0.0], time=times, events=event, stiff=stiff)
    assert motion.events.time.tolist() == times.tolist()
    right = 10**1.5 / 1.5 + np.array([5.0, 12.0])
    np.testing.assert_allclose(motion.states, np.stack([right, times], 1), atol=1e-6)


@pytest.mark.parametrize("apart", [0.0, 1e-15, 1e-13, -1e-15, -1e-13])
def test_an_event_just_at_the_end_of_a_branch_in_the_state(apart):
    f = sf.Field(lambda s: (s[1], 0.0, np.where(s[0] < 1, np.sqrt(1 - s[0]), 1.0)), "x y z")
    event = sf.Event(times=[10 * (1 + apart)], to=("x", "y", "z + 5"))
    motion = sf.flow(f, [0.0, 0.1, 0.0], time=12.0, events=event)
    np.testing.assert_allclose(motion.final, [1.2, 0.1, 20 / 3 + 7], atol=1e-6)


# Some c, a, b, d where a x + b z - d is just 0 at the end of a step, or within its rounding.
MEETINGS = [
    (-1.1, -0.83, 0.3, 0.37), (1.63, 1.24, 1.99, 0.16), (-1.78, -1.84, -1.61, 1.56),
    (-1.6, -0.48, -0.43, 0.73), (1.54, -1.19, 0.18, -0.05), (-0.91, 1.93, 0.28, -0.8),
    (1.6676893335771132, 0.22127151376952492, 0.6599960983139659, 1.3680490934919285),
    (0.7439915401232584, 0.8253533291404445, 0.7754219604501986, 0.3820859690609866),
]  # fmt: skip


@pytest.mark.parametrize(
    "step",
    [
        np.sign,
        lambda s: 2 * np.heaviside(s, 0.3) - 1,
        lambda s: np.where(s >= 0, np.where(s <= 0, 14.0, 1.0), -1.0),
    ],
)
def test_sums_cross_where_two_comparisons_and_a_value_at_0_meet(step, rng):
    """z = t + (c+ - c-) / 2, with the times c+, c- on both sides of a x + b z = d; x = c t."""
    random = rng.uniform(-2, 2, (4, 10_000))
    c, a, b, d = np.hstack([np.transpose(MEETINGS), random, random.round(2)])
    rates = a * c + b * (1 + np.array([[0.5], [-0.5]]))
    first, second = np.where(d < 0, rates, rates[::-1])
    crosses = (d != 0) & (abs(rates) > 1e-3).all(axis=0) & (first * second > 0) & (d * first > 0)
    a, b, c, d, first = (each[crosses] for each in (a, b, c, d, first))

    def f(s, a, b, c, d):
        return c + 0 * s[0], 1 + step(a * s[0] + b * s[1] - d) / 2

    sums = sf.Field(f, "x z", a=a, b=b, c=c, d=d)
    motion = sf.flow(sums, np.zeros((len(d), 2)), time=3.0)
    exact = 3 + np.where(d < 0, 0.5, -0.5) * (2 * np.minimum(d / first, 3.0) - 3)
    assert len(d) > 7000
    np.testing.assert_allclose(motion.final[:, 1], exact, atol=1e-8)


def test_the_value_of_sign_at_0_holds_at_starts_and_after_actions():
    """x' = sign(x) - y: at x = 0 with y = 0 nothing moves; on both sides the motion leads away."""
    away = sf.Field(lambda s: (np.sign(s[0]) - s[1], 0.0), "x y")
    states = [[0.0, 0.0], [0.0, 0.5], [0.0, -0.5], [1.0, 0.0]]
    np.testing.assert_allclose(
        sf.flow(away, states, time=2.0).final, [[0, 0], [-3, 0.5], [3, -0.5], [3, 0]], atol=1e-8
    )
    stop = sf.Event(times=[1.0], to=("0*x", "y"))
    np.testing.assert_array_equal(sf.flow(away, [1.0, 0.0], time=2.0, events=stop).final, [0, 0])
