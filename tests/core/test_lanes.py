"""Trajectories side by side: bits depend neither on the lanes of the code nor on the batch."""

import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast.core.flow import batch_solver, integrator

RNG = np.random.default_rng(5)
B = 150  # with 32 lanes each takes several trajectories, and the last ones fill no line
FEW = slice(0, 9)  # too few for more lanes
MU = RNG.uniform(1, 2000, B)


def pendulum(x):
    return x[1], -np.sin(x[0])


def oscillator(x, t):
    return x[1], -x[0] - 0.1 * x[1] + np.cos(t)


def van_der_pol(x, mu):
    return x[1], mu * (1 - x[0] ** 2) * x[1] - x[0]


def energy(x):
    return (x[1] ** 2 + x[0] ** 4) / 2


SYSTEMS = {  # a system, the last time, and options
    "functions": (sf.Field(pendulum, 2), 9.0, {}),
    "a clock": (sf.Field(oscillator, 2), 9.0, {}),
    "a family that turns implicit": (sf.Field(van_der_pol, 2, mu=MU), 30.0, {"rtol": 1e-5}),
    "implicit steps": (sf.Field(van_der_pol, 2, mu=MU), 5.0, {"stiff": True, "rtol": 1e-5}),
    "derivatives": (sf.Field(lambda x: (x[1], -(x[0] ** 3)), 2), 9.0, {"derivatives": "x0"}),
    "a kept energy": (sf.Field.from_hamiltonian(energy, 2).conserving(), 9.0, {}),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_wide_lanes_have_the_bits_of_eight(name, monkeypatch):
    system, last, options = SYSTEMS[name]
    x = RNG.uniform(-2, 2, (B, 2))
    times = np.linspace(0, last, 4)

    def states(part=slice(None)):
        own = system[part] if system.shape else system
        motion = sf.flow(own, x[part], time=times, threads=1, **options)
        return [motion.states, motion.steps, *motion.derivatives.values()]

    before = states()
    # As on a processor with registers of eight numbers, after a second of steps.
    monkeypatch.setattr(integrator, "numbers_in_register", lambda: 8)
    monkeypatch.setattr(batch_solver, "SPENT_BEFORE_WIDE", -1.0)
    batch_solver._integrator.cache_clear()
    wide = set()
    own = batch_solver.code_of

    def code_of(integrator, W, for_each):
        wide.add(W)
        return own(integrator, W, for_each)

    monkeypatch.setattr(batch_solver, "code_of", code_of)
    for a, b in zip(before, states(), strict=True):
        assert np.array_equal(a, b, equal_nan=True)
    assert max(wide) > batch_solver.WIDTH
    few = states(FEW)
    for a, b in zip(before, few, strict=True):
        assert np.array_equal(a[..., FEW] if a.ndim == 1 else a[:, FEW], b, equal_nan=True)
