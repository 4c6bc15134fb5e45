"""States at times inside steps have the errors of the tolerance, and change no later state."""

import numpy as np
import pytest
from scipy.special import sici
from systems import LORENZ, field, kepler, pendulum, robertson, van_der_pol

import suslov_fast as sf

RTOLS = [1e-2, 1e-3, 1e-6, 1e-9]


@pytest.mark.parametrize("rtol", RTOLS)
def test_a_decay_at_many_times(rtol):
    times = np.linspace(0, 30, 1501)[1:]
    motion = sf.flow(field(lambda s: (-s[0],), "x"), [1.0], time=times, rtol=rtol)
    assert abs(motion.states[:, 0] - np.exp(-times)).max() < rtol


def test_a_time_in_the_second_half_of_a_long_step():
    motion = sf.flow(LORENZ, [1, 1, 20], time=[0.2, 5.0], rtol=1e-3)
    np.testing.assert_allclose(motion.states[0], [2.5235, 4.3592, 12.3682], rtol=0, atol=0.03)
    fast = field(lambda s: (-1000 * (s[0] - s[1]), -s[1]), "x y")
    motion = sf.flow(fast, [2.0, 1.0], time=[0.0234, 10.0], rtol=1e-2)
    np.testing.assert_allclose(motion.states[0], [0.97785, 0.97687], rtol=0, atol=0.02)


@pytest.mark.parametrize("T", np.linspace(0.1, 3, 60)[4::8])
def test_times_just_before_the_last_one(T):
    """A step goes on to the last time if that is near, also where it is taken again."""
    oscillator = field(van_der_pol, "x v", mu=5)
    times = T * np.array([0.95, 0.97, 0.99, 1.0])
    right = sf.flow(oscillator, [2.0, 0.0], time=times, rtol=1e-12).states
    for rtol in (1e-2, 1e-3, 1e-6):
        motion = sf.flow(oscillator, [2.0, 0.0], time=times, rtol=rtol)
        np.testing.assert_allclose(motion.states, right, rtol=0, atol=10 * rtol)


def forced(s):
    return s[1], s[0] - s[0] ** 3 - 0.3 * s[1] + 0.5 * np.cos(1.2 * s[2]), 1.0


def doses(s):
    return np.interp(s[1], [0, 1, 2, 12, 13, 24], [0, 50, 0, 0, 80, 0]) - 0.1 * s[0], 1.0


SYSTEMS = {
    "clock": (forced, "q p t", [0.5, 0.0, 0.0], 20.0),
    "stiff": (robertson, "a b c", [1.0, 0.0, 0.0], 4e5),
    "near passage": (kepler, "x y u v", [0.4, 0.0, 0.0, 2.0], 2.0),
    "driven fast": (lambda s: (-50 * (s[0] - np.cos(s[1])), 1.0), "x t", [0.0, 0.0], 10.0),
    "decays": (lambda s: tuple(-(10.0**k) * s[k] for k in range(4)), 4, [1.0] * 4, 10.0),
    "table": (doses, "amount t", [0.0, 0.0], 24.0),
    "jump": (lambda s: (s[1], np.where(s[0] > 0.5, -4 * s[0], -s[0])), "x v", [1.0, 0.0], 20.0),
    "kink": (lambda s: (s[1], -abs(s[0]) * s[0] - np.minimum(s[0], 0.3)), "x v", [1.0, 0.0], 6.0),
    "backwards": (pendulum, "q p", [1.0, 0.5], -10.0),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_later_times_change_nothing(name):
    f, names, start, last = SYSTEMS[name]
    system, times = field(f, names), last * np.random.default_rng(5).uniform(size=6)
    for rtol in (1e-2, 1e-3, 1e-6, 1e-9, 1e-12):
        motion = sf.flow(system, start, time=[*times, *times[:3] * (1 + 1e-9), last], rtol=rtol)
        for time, state in zip(times, motion.states, strict=False):
            alone = sf.flow(system, start, time=time, rtol=rtol).states[0]
            sizes = np.maximum(abs(alone), abs(np.array(start)))
            sizes = np.maximum(sizes, 1e-6 * sizes.max())
            assert (abs(alone - state) <= 10 * rtol * sizes).all(), (rtol, time)


def test_later_times_change_no_derivative():
    system = field(pendulum, "q p", k=1.0)
    times = np.random.default_rng(5).uniform(0, 10, 5)
    for rtol in (1e-3, 1e-6, 1e-9):
        options = {"rtol": rtol, "derivatives": ("x0", "k")}
        motion = sf.flow(system, [1.0, 0.5], time=[*times, 10.0], **options)
        for k, time in enumerate(times):
            alone = sf.flow(system, [1.0, 0.5], time=time, **options)
            for name in ("x0", "k"):
                one, other = (each.derivatives[name] for each in (alone, motion))
                assert abs(one[0] - other[k]).max() < 10 * rtol * abs(one).max()


@pytest.mark.parametrize("stiff", [None, True])
@pytest.mark.parametrize("backward", [1, -1])
def test_clocks_are_their_start_plus_rate_times_time(rng, stiff, backward):
    """Also where nothing depends on a clock, and in records of events that leave clocks alone."""
    field = sf.Field(lambda s, w: (np.cos(s[1]), 1.0, w), "x t u", w=np.array([-2.5, 0.1]))
    starts = rng.uniform(-1, 1, (2, 3)) * [0.5, 30, 30]
    rates, times = np.array([[1.0, -2.5], [1.0, 0.1]]), backward * np.linspace(0, 10, 173)
    kick = sf.Event(times=[3.0], to=("-x", "t", "u"))
    events = [kick, sf.Event("x")] if backward > 0 else [sf.Event("x")]
    for start in (starts, 0 * starts):
        motion = sf.flow(field, start, time=times, events=events, stiff=stiff)
        exact = start[:, 1:] + rates * times[:, np.newaxis, np.newaxis]
        np.testing.assert_array_equal(motion.states[..., 1:], exact)
        own = motion.events
        exact = start[own.trajectory, 1:] + rates[own.trajectory] * own.time[:, np.newaxis]
        assert len(own.time) > 2
        np.testing.assert_array_equal(own.states[:, 1:], exact)
        np.testing.assert_array_equal(own.before[:, 1:], exact)


@pytest.mark.parametrize("stiff", [None, True])
def test_a_time_at_which_f_has_no_value(rng, stiff):
    """The integral of sin(u) / u, also at times with u = 0 exactly."""
    field = sf.Field(lambda s: (np.sin(s[1]) / s[1], 1.0), "x u")
    for start in -rng.integers(1, 200, 20) / 64:
        times = -start * np.array([0.3, 1.0, 2.5])
        motion = sf.flow(field, [0.0, start], time=times[rng.integers(0, 2) :], stiff=stiff)
        exact = sici(start + motion.time)[0] - sici(start)[0]
        np.testing.assert_allclose(motion["x"], exact, atol=1e-8)


def test_a_gate_of_a_neuron_in_a_ramp():
    """At -40 mV its rate is 0/0; right are times beside it."""
    gate = sf.Field(lambda s: (0.1 * (s[1] + 40) / (1 - np.exp(-(s[1] + 40) / 10)) * (1 - s[0])
                               - 4 * np.exp(-(s[1] + 65) / 18) * s[0], 1.0), "m V")  # fmt: skip
    at, beside = (sf.flow(gate, [0.05, -65.0], time=[25 + d, 30])["m"] for d in (0, 1e-9))
    np.testing.assert_allclose(at, beside, rtol=1e-8)
