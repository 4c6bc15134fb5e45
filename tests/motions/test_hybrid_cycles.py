"""Periodic orbits with events and jumps: a neuron, a walker, a ball on a table, a relay."""

import numpy as np
import pytest
from systems import on_a_table

from suslov_fast import Event, Field, flow, lyapunov_exponents, periodic_orbit


@pytest.mark.parametrize(("start", "period"), [([0.0, 0.5], 1.0), ([0.3, 1.5], None)])
def test_spiking_cycles(start, period):
    f = Field(lambda x, I, a: (I - x[0], -a * x[1]), "v w", I=1.5, a=0.3)
    spike = Event(lambda x: x[0] - 1, direction=1, to=lambda x: (0, x[1] + 0.5))
    orbit = periodic_orbit(f, start, period, events=spike)
    T = np.log(3.0)
    assert abs(orbit.period - T) < 1e-10
    np.testing.assert_allclose(orbit.multipliers, [1.0, np.exp(-0.3 * T)], rtol=1e-9)
    motion = flow(f, orbit.state, time=[T, 2 * T], events=spike, rtol=1e-12)
    np.testing.assert_allclose(motion.states, [orbit.state] * 2, rtol=1e-9)


def test_the_simplest_walker():
    """On a slope of .009: a stable walk, of the long period, with the state after a step."""

    def legs(s):
        theta, phi, u, v = s
        pull = np.sin(theta - 0.009)
        return u, v, pull, pull + np.sin(phi) * (u**2 - np.cos(theta - 0.009))

    def step(s):
        c = np.cos(2 * s[0])
        return -s[0], -2 * s[0], c * s[2], c * (1 - c) * s[2]

    field = Field(legs, "theta phi u v")
    strike = Event(lambda s: s[1] - 2 * s[0], direction=1, to=step)
    orbit = periodic_orbit(field, [0.2, 0.4, -0.2, -0.02], events=strike)
    found = flow(field, orbit.state, time=orbit.period, events=strike).events.states
    np.testing.assert_allclose(found, [[0.2003, 0.4006, -0.1998, -0.0158]], atol=5e-5)
    pair = -0.1900998 + np.array([0.5575988j, -0.5575988j])
    np.testing.assert_allclose(orbit.multipliers, [1.0, *pair, 0.0], atol=1e-7)


def test_a_ball_on_a_vibrating_table():
    """It bounces once in a period at the phase p with A cos p = pi (1 - e)/(1 + e), g = 1."""
    e, T = 0.5, 2 * np.pi
    of_cos, of_sin = T / 2 * (1 - e) / (1 + e), 1.5 / (1 + e) ** 2
    A, p = np.hypot(of_cos, of_sin), np.arctan2(of_sin, of_cos)
    ball, hit = on_a_table(A, e)
    start = [A * np.sin(p) + T**2 / 8 + 0.01, 0.01, p + T / 2]
    orbit = periodic_orbit(ball, start, T, events=hit)
    # Of multipliers m: m**2 - (1 + e**2 - (1 + e)**2 A sin p) m + e**2 = 0.
    right = np.roots([1.0, -(1 + e**2 - 1.5), e**2])
    np.testing.assert_allclose(
        np.sort_complex(orbit.multipliers), np.sort_complex(right), rtol=1e-8
    )
    with pytest.raises(ValueError, match=r"^period must be given"):
        periodic_orbit(ball, start, events=hit)
    with pytest.raises(ValueError, match=r"^period "):
        periodic_orbit(ball, start, 1.1 * T, events=hit)


def test_a_relay_that_drives_an_oscillator():
    # v' = -x - v/5 + sign(v)/2: in half a turn, which lasts pi/w, the amplitude A becomes
    # (A + 1/2) q + 1/2.
    relay = Field(lambda s: (s[1], -s[0] - 0.2 * s[1] + 0.5 * np.sign(s[1])), "x v")
    w = np.sqrt(0.99)
    q = np.exp(-0.1 * np.pi / w)
    A = 0.5 * (1 + q) / (1 - q)
    orbit = periodic_orbit(relay, [-1.1 * A, 0.1], period=6.0)
    assert orbit.period == pytest.approx(2 * np.pi / w, rel=1e-9)
    np.testing.assert_allclose(orbit.multipliers, [1.0, q * q], rtol=1e-8)
    phases = {"time": 5 * orbit.period, "transient": 20 * orbit.period}
    exponents = lyapunov_exponents(relay, orbit.state, **phases)
    np.testing.assert_allclose(exponents, [0.0, -0.1], atol=1e-5)


def test_integrals_that_events_do_not_keep_leave_out_no_multiplier():
    """Kicks change the energy of an oscillator: a speed 1 + d becomes 1 + k d each turn."""
    field = Field.from_hamiltonian(lambda x: (x[0] ** 2 + x[1] ** 2) / 2, "q p")
    for k, is_stable in ((1.5, False), (0.5, True)):
        kick = Event(lambda x: x[0], direction=1, to=lambda x, k=k: (x[0], 1 + k * (x[1] - 1)))
        orbit = periodic_orbit(field, [0.0, -1.0], 6.28, events=kick)
        np.testing.assert_allclose(np.sort(orbit.multipliers.real), sorted([1.0, k]), atol=1e-9)
        assert orbit.stable is is_stable
    marker = Event(lambda x: x[0])  # which changes nothing
    assert periodic_orbit(field, [0.1, -1.0], 6.28, events=marker).stable
