"""Derivatives of the times of events, and of the states before and after, see `Events`."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from systems import field

import suslov_fast as sf

BALL = field(lambda x, g, e: (x[1], -g), "h v", g=9.81, e=0.8)
BOUNCE = sf.Event("h", direction="down", to=lambda x, e: (x[0], -e * x[1]))
DECAY = field(lambda x, k: (-k * x[0],), "c", k=0.5)


def impacts(h, v, g, e, count):
    """Return the times of impacts, and the speeds after them, also of complex numbers."""
    speed = np.sqrt(v * v + 2 * g * h)
    time, times, speeds = (v + speed) / g, [], []
    for _ in range(count):
        times.append(time)
        speed = e * speed
        speeds.append(speed)
        time = time + 2 * speed / g
    return np.array([times, speeds])


def test_impacts_of_a_ball():
    start, values = [1.0, 0.3], [9.81, 0.8]
    motion = sf.flow(BALL, start, time=3.0, events=BOUNCE, derivatives=("e", "x0", "g"))
    derivatives = motion.events.derivatives
    assert [*derivatives] == ["e", "x0", "g"]
    for k, (name, at) in enumerate([("x0", 0), ("x0", 1), ("g", None), ("e", None)]):
        step = 1e-30j * np.eye(4)[k]
        times, speeds = impacts(*(np.array([*start, *values]) + step), 6).imag / 1e-30
        time, before, states = (a if at is None else a[..., at] for a in derivatives[name])
        np.testing.assert_allclose(time, times, rtol=1e-11)
        np.testing.assert_allclose(states[:, 1], speeds, rtol=1e-10, atol=1e-11)
        # At the floor the height is 0, whatever the parameters are.
        np.testing.assert_allclose(before[:, 0], 0.0, atol=1e-13)
    with pytest.raises(KeyError, match="derivatives="):
        sf.flow(BALL, start, time=3.0, events=BOUNCE).events.derivatives["e"]


@pytest.mark.parametrize("terminal", [False, True])
@pytest.mark.parametrize("level", [1.5, 6.0])  # after the start, and before it
def test_the_time_to_a_threshold(level, terminal):
    k, x0 = 0.5, 3.0
    event = sf.Event(lambda x: x[0] - level, terminal=terminal)
    time = 4.0 if level < x0 else -4.0
    found = sf.flow(DECAY, [x0], time=time, events=event, derivatives=("x0", "k"), rtol=1e-12)
    by = found.events.derivatives
    np.testing.assert_allclose(by["k"].time, [-np.log(x0 / level) / k**2], rtol=1e-10)
    np.testing.assert_allclose(by["x0"].time, [[1 / (k * x0)]], rtol=1e-10)
    for each in (by["k"].states, by["k"].before, by["x0"].states, by["x0"].before):
        np.testing.assert_allclose(each, 0.0, atol=1e-14)


def test_given_times_do_not_move():
    dose = sf.Event(times=[1.0, 2.0], to=lambda x, k: (x[0] + 8 * k,))
    found = sf.flow(DECAY, [3.0], time=4.0, events=dose, derivatives="k").events
    by_k = found.derivatives["k"]
    before = -3 * np.exp(-0.5)
    np.testing.assert_array_equal(by_k.time, 0.0)
    np.testing.assert_allclose(by_k.before[0], before, rtol=1e-9)
    np.testing.assert_allclose(by_k.states[0], before + 8, rtol=1e-9)


def effect_after(dose, ka, k):
    """Return when SciPy's blood falls to 20 after three doses, and the amount in the gut then."""

    def f(_, s):
        return [-ka * s[0], ka * s[0] - k * s[1]]

    x, options = np.zeros(2), {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    for begin in (0.0, 12.0):
        x = solve_ivp(f, (begin, begin + 12.0), x + np.array([dose, 0.0]), **options).y[:, -1]

    def level(_, s):
        return s[1] - 20.0

    level.direction = -1
    end = solve_ivp(f, (24.0, 90.0), x + np.array([dose, 0.0]), events=level, **options)
    return np.array([end.t_events[0][0], end.y_events[0][0][0]])


def test_the_time_of_the_end_of_an_effect():
    values = {"dose": 100.0, "ka": 0.7, "k": 0.1}
    patient = field(
        lambda s, ka, k, dose: (-ka * s[0], ka * s[0] - k * s[1]), "gut blood", **values
    )
    events = [
        sf.Event(times=[0, 12, 24], to=lambda s, dose: (s[0] + dose, s[1])),
        sf.Event(lambda s: s[1] - 20, direction="down"),
    ]
    motion = sf.flow(patient, [0, 0], time=90.0, events=events, derivatives=[*values], rtol=1e-11)
    last = np.flatnonzero(motion.events.which == 1)[-1]
    for name, value in values.items():
        d = 1e-3 * value
        high, low = (effect_after(**values | {name: value + e}) for e in (d, -d))
        far, near = (effect_after(**values | {name: value + e}) for e in (2 * d, -2 * d))
        right = (8 * (high - low) - (far - near)) / (12 * d)
        found = motion.events.derivatives[name]
        np.testing.assert_allclose(found.time[last], right[0], rtol=1e-6)
        np.testing.assert_allclose(found.states[last, 0], right[1], rtol=1e-6, atol=1e-12)


def test_a_surface_that_reads_a_parameter_and_a_jump_of_f_there():
    # x' = 1 before 1, then 2: x = 1 + a, seen at 1 + a / 2.
    speed = field(lambda x, a: (np.where(x[0] > 1, 2.0, 1.0),), "x", a=0.4)
    seen = [sf.Event(lambda x: x[0] - 1), sf.Event(lambda x, a: x[0] - 1 - a)]
    found = sf.flow(speed, [0.0], time=2.0, events=seen, derivatives=("a", "x0")).events
    np.testing.assert_allclose(found.derivatives["a"].time, [0.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(found.derivatives["a"].states, [[0.0], [1.0]], atol=1e-12)
    np.testing.assert_allclose(found.derivatives["x0"].time, [[-1.0], [-1.0]], rtol=1e-12)


def test_bits_depend_neither_on_the_batch_nor_on_threads(rng):
    heights = rng.uniform(0.5, 4.0, 100)  # different numbers of impacts, and none
    heights[7] = 60.0
    starts = np.stack([heights, rng.normal(size=100)], axis=1)
    family = BALL.with_parameters(e=rng.uniform(0.85, 0.95, 100))
    given = {"time": 3.0, "events": BOUNCE, "derivatives": ("e", "x0")}
    one, two = (sf.flow(family, starts, threads=n, **given) for n in (1, 2))
    assert one.events.count[7] == 0
    for k in (0, 7, 41, 99):
        alone = sf.flow(family[k], starts[k], **given)
        for name in ("e", "x0"):
            own = one.member(k).events.derivatives[name]
            for a, b in zip(own, alone.events.derivatives[name], strict=True):
                np.testing.assert_array_equal(a, b)
    for a, b in zip(one.events.derivatives["x0"], two.events.derivatives["x0"], strict=True):
        np.testing.assert_array_equal(a, b)


def test_stiff_oscillations(rng):
    vdp = field(lambda s, mu: (s[1], mu * (1 - s[0] ** 2) * s[1] - s[0]), "x v", mu=20.0)
    given = {"time": 60.0, "events": sf.Event("x"), "rtol": 1e-10, "stiff": True}
    found = sf.flow(vdp, [2.0, 0.0], derivatives="mu", **given).events
    d = 1e-3
    high, low = (
        sf.flow(vdp.with_parameters(mu=20 + e), [2.0, 0.0], **given).events for e in (d, -d)
    )
    by_mu = found.derivatives["mu"]
    np.testing.assert_allclose(by_mu.time, (high.time - low.time) / (2 * d), rtol=1e-5)
    right = (high.states[:, 1] - low.states[:, 1]) / (2 * d)
    np.testing.assert_allclose(by_mu.states[:, 1], right, rtol=1e-4)
