"""Stores on the command line: creation, continuation, replacement, inspection."""

import os
import signal

import numpy as np
import pytest
from test_cli import check_error, facts_of, run, succeed, summary

from suslov_fast import Suslov3D, iterate, open_ensemble
from suslov_fast._ensemble import compute

pytest.importorskip("dask")
pytest.importorskip("zarr")
ASKED = "run --picture 1 --trajectories 100 --steps 40 --save-every 4 -o run.zarr"


def test_a_grid_of_parameters(tmp_path):
    asked = ASKED.replace("--picture 1", "--I1 4 --I2 1 --I23 -.3")
    line = f"{asked} --sweep eps=0.1:0.4:4 --sweep I13=-0.5:0.5:3 --chunk 60"
    facts = facts_of(line, tmp_path)
    assert facts["trajectories"] == 1200
    assert facts["tiles_done"] == "24 of 24"
    assert facts["status"] == {"OK": 1200}
    assert facts["drift"]["F"] < 1e-12
    dataset = open_ensemble(tmp_path / "run.zarr")
    assert dataset.omega.dims == ("n", "eps", "I13", "trajectory", "component")
    one = dataset.sel(eps=0.2, I13=0.5, method="nearest")
    orbits = iterate(Suslov3D(4, 1, 0.5, -0.3), one.omega.values[0], 0.2, 40, save_every=4)
    assert np.allclose(one.omega, orbits.omega, rtol=1e-12)
    assert {**facts, **facts_of("info run.zarr", tmp_path)} == facts
    assert summary(succeed("info run.zarr", tmp_path))["tiles done"] == ["24 of 24"]


def test_a_sweep_in_n_dimensions(tmp_path):
    line = "run --J 1,2,4 --I .4,-.7,.5 --omega0 1,2,3 --steps 9 -o nd.zarr"
    reduced = "--reduce omega_max --reduce energy_drift"
    facts = facts_of(f"{line} --sweep eps=0.1:0.3:3 {reduced}", tmp_path)
    assert facts["trajectories"] == 3
    dataset = open_ensemble(tmp_path / "nd.zarr")
    assert dataset.eps.values.tolist() == [0.1, 0.2, 0.3]
    assert dataset.omega_max.shape == (3, 1, 3)
    assert facts["drift"] == {"E": float(dataset.energy_drift.max())}


def test_the_same_run_continues_and_another_is_refused(tmp_path):
    succeed(ASKED, tmp_path)
    longer = ASKED.replace("--steps 40", "--steps 60")
    assert facts_of(longer, tmp_path)["steps"] == 60
    for other, message in (
        (f"{longer} --eps 0.3", "another run, with eps 0.2 instead of 0.3"),
        (ASKED, "steps: expected at least the 60 of the run in"),
    ):
        refused = run(other, tmp_path)
        check_error(refused, 1, message)
        assert refused.err.endswith("--force replaces it\n")
    assert facts_of(f"{longer} --eps 0.3 --force", tmp_path)["eps"] == 0.3


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_message_of_a_signal(tmp_path, monkeypatch, number):
    go_on = compute.go_on
    monkeypatch.setattr(compute, "go_on", lambda run: os.kill(os.getpid(), number) or go_on(run))
    stopped = run("run --trajectories 50 --chunk 10 --steps 9 -o o.zarr", tmp_path)
    check_error(stopped, 130, "repeat the call to resume")
    assert open_ensemble(tmp_path / "o.zarr").attrs["tiles_done"].endswith("of 5")
