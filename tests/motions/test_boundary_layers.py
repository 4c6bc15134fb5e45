"""Layers of f that are thinner than sub-steps."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.special import beta, erf, expit, i0e
from systems import field

import suslov_fast as sf


def oscillator(s, a, w):
    return s[1], -s[0] - a * np.tanh(s[1] / w)


def belt(s, a, w, b, c):
    slip = s[1] - c
    return s[1], -s[0] - a * np.tanh(slip / w) / (1 + b * slip**2)


def sliding(s, a, w, b, c, d):
    return s[1], d * np.sin(b * s[2]) - a * np.tanh((s[1] + c * s[0]) / w), 1.0


def relay(s, a, w, b, c, d):
    return s[1], -b * s[1] - d * s[0] - a * (2 * expit((s[0] + c * s[1]) / w) - 1)


# Parameters, start and state at the time, by Radau IIA of order 5 with steps below the layer: two
# such computations differ by 1e-11 and less.
DATA = json.loads((Path(__file__).parents[1] / "data" / "layers.json").read_text())
LAYERS = {
    "oscillator": (oscillator, "x v", 20.0),
    "belt": (belt, "x v", 20.0),
    "sliding": (sliding, "x v t", 10.0),
    "relay": (relay, "x v", 20.0),
}


@pytest.mark.parametrize("stiff", [None, True])
@pytest.mark.parametrize("kind", LAYERS)
def test_layers_thinner_than_sub_steps(kind, stiff):
    f, names, time = LAYERS[kind]
    parameters, starts, ends = zip(*DATA["layers"][kind], strict=True)
    family = field(f, names, **dict(zip("awbcd", np.transpose(parameters), strict=False)))
    for rtol in (1e-9, 1e-12):
        motion = sf.flow(family, starts, time=time, rtol=rtol, stiff=stiff)
        np.testing.assert_allclose(motion.states[0, :, :2], ends, rtol=0, atol=1e-5)


def test_steps_do_not_bounce_within_a_layer():
    """The tolerance is about the width of the layer: columns may stay at both sides."""
    a, w, x = DATA["bounce"]
    f = field(lambda s, a, w: (s[1], -s[0] - a * np.tanh(s[1] / w)), 2, a=a, w=w)
    for rtol in 1e-5, 1e-6:
        motion = sf.flow(f, np.stack([x, np.zeros(len(x))], 1), time=20.0, rtol=rtol)
        assert motion.steps.max() < 5000


KNEE = sf.Field(lambda s, eps: (((1 - s[1]) * s[0] - s[0] ** 2) / eps, 1.0), "y t", eps=1e-8)
COSINE = sf.Field(lambda s, eps: (s[0] * (np.cos(s[1]) - s[0]) / eps, 1.0), "y t", eps=1e-8)


@pytest.mark.sampled(24)
@pytest.mark.filterwarnings("ignore:1 of 1 solutions have a component that fell below")
@pytest.mark.parametrize("seed", range(300))
def test_slow_motions_past_a_knee(seed):
    """Where f' vanishes along a slow motion, y is the inverse of a Gaussian integral (Bernoulli).

    With k = 1 / eps it is (2 / (pi k))**(1/2) at the knee of 1 - t, and 1 / (k pi i0e(k)) at that
    of cos t.
    """
    rng = np.random.default_rng(seed)
    eps, rtol = 10 ** rng.uniform(-12, -3), 10.0 ** -rng.integers(6, 10)
    is_cosine = seed % 3 == 2
    knee, right = 1.0, np.sqrt(2 * eps / np.pi)
    if is_cosine:
        knee, right = np.pi / 2, eps / (np.pi * i0e(1 / eps))
    before, after = [knee], [knee, 2.0]
    times = [before, after, [0.5, *after], [0.9, knee, knee + 3 * np.sqrt(eps), 2.0]][seed % 4]
    atol = rng.choice([1e-6, 1e-9, 1e-12])
    field = (COSINE if is_cosine else KNEE).with_parameters(eps=eps)
    start = [[1.0, 0.0], [3.0, 0.0]][seed % 2]
    run = sf.flow(field, start, time=times, rtol=rtol, atol=atol, stiff=rng.choice([None, True]))
    assert abs(run.states[times.index(knee), 0] - right) < 100 * (atol + rtol * right)


PULSES = {  # functions of the cosine of a phase, and their means over a period
    "exp": (lambda c, k: np.exp(k * (c - 1)), i0e),
    "power": (lambda c, k: (c**2) ** k, lambda k: beta(k + 0.5, 0.5) / np.pi),
    "halves": (
        lambda c, k: np.where(c > 0, c, 0) ** k,
        lambda k: beta(k / 2 + 0.5, 0.5) / 2 / np.pi,
    ),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("rtol", [1e-9, 1e-6])
@pytest.mark.parametrize("stiff", [None, True])
@pytest.mark.parametrize("name", PULSES)
def test_periodic_pulses(name, stiff, rtol, rng):
    """Of widths from a sixth to 1/300 of the period."""
    pulse, mean = PULSES[name]
    k, phase = np.append(800.0, 10 ** rng.uniform(1.5, 4.1, 50)), rng.uniform(0, 6, 51)
    w = 2 * np.pi * rng.integers(20, 200, 51) / 300

    def f(s, k, w, phase):
        return 1e-3 + pulse(np.cos(w * s[1] - phase), k), 1.0

    pulsed = sf.Field(f, "y t", k=k, w=w, phase=phase)
    run = sf.flow(pulsed, np.zeros((51, 2)), time=300.0, rtol=rtol, stiff=stiff)
    np.testing.assert_allclose(run.final[:, 0], 300 * (1e-3 + mean(k)), rtol=1000 * rtol)


@pytest.mark.parametrize(
    "pulse",
    [
        lambda a: np.exp2(100 * a),
        lambda a: 1 + np.expm1(a),
        lambda a: 2 * expit(a),
        lambda a: 1 + erf(a),
        lambda a: 1 + np.tanh(a),
        lambda a: np.exp(-np.logaddexp(0, -a)),
    ],
)
def test_pulses_of_functions_like_exp(pulse):
    """The mean of a smooth periodic function is that of its values at equal distances."""
    f = sf.Field(lambda s, k: (pulse(k * (np.cos(s[1] - 1) - 1)), 1.0), "y t", k=1e4)
    phases = np.arange(2**16) * 2 * np.pi / 2**16
    right = 20 * np.pi * pulse(1e4 * (np.cos(phases) - 1)).mean()
    np.testing.assert_allclose(sf.flow(f, [0.0, 0.0], time=20 * np.pi).final[0], right, rtol=1e-7)


def test_square_and_narrow_pulses():
    square = sf.Field(lambda s: (1 + np.tanh(1e6 * (np.cos(s[1]) - 0.9999)), 1.0), "y t")
    motion = sf.flow(square, [0.0, 1.0], time=100 * np.pi)
    # The time above .9999, but for 1e-5 by the curvature there.
    np.testing.assert_allclose(motion.final[0], 200 * np.arccos(0.9999), rtol=2e-5)
    narrow = sf.Field(lambda s, k: (np.exp(k * np.cos(s[1] - 3) - k), 1.0), "y t", k=1e8)
    motion = sf.flow(narrow, [0.0, 0.0], time=20 * np.pi, derivatives="k")
    np.testing.assert_allclose(motion.final[0], 20 * np.pi * i0e(1e8), rtol=1e-7)
    slope = -motion.final[0] / 2e8  # i0e is nearly (2 pi k)**-1/2
    np.testing.assert_allclose(motion.derivatives["k"].ravel()[0], slope, rtol=1e-5)


def test_a_stick_that_ends_where_its_layer_does():
    """At rtol=1e-4; the states are those of Radau and LSODA of SciPy at 1e-11, which agree."""
    rub = field(lambda s: belt(s, 0.4511, 6.428e-5, 1.662, 0.2), "x v")
    motion = sf.flow(rub, [0.0, 0.0], time=20.0, rtol=1e-4)
    np.testing.assert_allclose(motion.final, [0.2880461396, -0.3025853118], atol=5e-3)
