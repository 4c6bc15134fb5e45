"""Published quadratic flows, typed as published: bounded orbits and the exponents of an integrator.

`data/flows.json` has right-hand sides, initial states near the attractor, and largest exponents by
an integrator of high order with their standard errors.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from systems import tables

from suslov_fast import Field, Status, iterate, lyapunov_exponents

DATA = json.loads((Path(__file__).parents[1] / "data" / "flows.json").read_text("utf-8"))
FLOWS = {flow["name"]: flow for flow in DATA["flows"]}
ORDINARY = "Rossler", "SprottB", "LorenzStenflo"
# One each of those that are alike.
SLOW = "Lorenz", "RikitakeDynamo", "NoseHoover", "HyperRossler", "Lorenz96"
PER_PERIOD = 1600


def field_of(flow):
    equations = zip(flow["variables"], flow["rhs"], strict=True)
    text = "; ".join(f"{name}' = {rate}" for name, rate in equations)
    return Field.from_equations(text, **flow["parameters"])


@pytest.mark.slow_cases(*SLOW)
@pytest.mark.parametrize("name", [*ORDINARY, *SLOW])
def test_published_flows(name):
    flow = FLOWS[name]
    field, eps = field_of(flow), flow["period"] / PER_PERIOD
    assert field.names == tuple(flow["variables"])
    run = iterate(field, flow["start"], eps, 100 * PER_PERIOD, save_every=40)
    assert run.ok.all()
    first, second = np.split(run.states[1:], 2)
    assert abs(second).max() < 3 * abs(first).max()
    # Windows that do not overlap, since the map takes the same orbit from each state on it.
    steps, windows = flow["periods"] * PER_PERIOD, 4 if name in ORDINARY else 8
    starts = iterate(field, run.final, eps, (windows - 1) * steps, save_every=steps).states
    rates = lyapunov_exponents(field, starts, eps, steps)
    largest = rates[:, 0]
    if name == "NoseHoover":  # conservative: depends on the orbit
        assert (largest > 0).all()
        assert abs(rates.sum(axis=1)).max() < 0.01
    else:
        error = np.hypot(flow["spread"], largest.std(ddof=1) / windows**0.5)
        assert abs(largest.mean() - flow["largest_exponent"]) < 3 * error
    quadratic, linear, _ = tables(field)
    divergence = np.trace(linear)
    if not np.trace(quadratic, axis1=0, axis2=1).any():  # it is constant
        assert rates.sum(axis=1) == pytest.approx(divergence, abs=1e-3 * max(1, abs(divergence)))


def test_no_flow_passes_a_pole_at_long_steps():
    """Of 1 / 25 of a period: what is resolved raises no alarm. Each is bounded."""
    for name, flow in FLOWS.items():
        run = iterate(field_of(flow), flow["start"], flow["period"] / 25, 2500, save_every=None)
        assert (run.status, run.failed_at) == (Status.OK, -1), name
