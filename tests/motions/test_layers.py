"""Layers of f that are thinner than sub-steps."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit
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
