"""Published quadratic flows, typed as published: bounded orbits and the exponents of an integrator.

`data/flows.json` has right-hand sides, initial states near the attractor, and largest exponents by
an integrator of high order with their standard errors.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from suslov_fast import QuadraticField, iterate, lyapunov_exponents

FLOWS = json.loads((Path(__file__).parent / "data" / "flows.json").read_text("utf-8"))["flows"]
ORDINARY = "Rossler", "SprottB", "LorenzStenflo"
PER_PERIOD = 1600


def field_of(flow):
    def f(x, **parameters):
        known = dict(zip(flow["variables"], x, strict=True)) | parameters
        return [eval(text, {}, known) for text in flow["rhs"]]

    return QuadraticField.from_function(f, flow["variables"], **flow["parameters"])


@pytest.mark.parametrize(
    "flow",
    [
        pytest.param(
            flow, marks=[pytest.mark.slow] * (flow["name"] not in ORDINARY), id=flow["name"]
        )
        for flow in FLOWS
    ],
)
def test_published_flows(flow):
    field, eps = field_of(flow), flow["period"] / PER_PERIOD
    assert field.names == tuple(flow["variables"])
    run = iterate(field, flow["start"], eps, 100 * PER_PERIOD, save_every=40)
    assert run.ok
    first, second = np.split(run.x[1:], 2)
    assert abs(second).max() < 2 * abs(first).max()
    # Windows that do not overlap, since the map takes the same orbit from each state on it.
    steps, windows = flow["periods"] * PER_PERIOD, 4 if flow["name"] in ORDINARY else 8
    starts = iterate(field, run.final, eps, (windows - 1) * steps, save_every=steps).x
    rates = lyapunov_exponents(field, starts, eps, steps) / eps
    largest = rates[:, 0]
    if flow["name"] == "NoseHoover":  # conservative: depends on the orbit
        assert (largest > 0).all()
        assert abs(rates.sum(axis=1)).max() < 1e-3
    else:
        error = np.hypot(flow["spread"], largest.std(ddof=1) / windows**0.5)
        assert abs(largest.mean() - flow["largest_exponent"]) < 3 * error
    linear, quadratic = field.linear.astype(float), field.quadratic.astype(float)
    divergence = np.trace(linear)
    if not np.trace(quadratic, axis1=0, axis2=1).any():  # it is constant
        assert rates.sum(axis=1) == pytest.approx(divergence, abs=1e-3 * max(1, abs(divergence)))
