"""Stores on the command line: made, continued, replaced, looked at."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from test_cli import run, succeed

from suslov_fast import Suslov3D, iterate, open_ensemble

pytest.importorskip("dask")
pytest.importorskip("zarr")
ASKED = "run --picture 1 --trajectories 100 --steps 40 --save-every 4 --json -o"


def test_a_grid_of_parameters(tmp_path):
    store = tmp_path / "grid.zarr"
    sweeps = "--sweep eps=0.1:0.4:4 --sweep I13=-0.5:0.5:3 --chunk 30"
    facts = json.loads(succeed(f"{ASKED} {store} {sweeps}"))
    assert facts["trajectories"] == 1200
    assert facts["tiles_done"] == "48 of 48"
    assert facts["status"] == {"OK": 1200}
    assert facts["drift"]["F"]["largest"] < 1e-12
    dataset = open_ensemble(store)
    assert dataset.omega.dims == ("n", "sweep_eps", "sweep_I13", "trajectory", "component")
    one = dataset.sel(sweep_eps=0.2, sweep_I13=0.5, method="nearest")
    orbits = iterate(Suslov3D(4, 1, 0.5, -0.3), one.omega.values[0], 0.2, 40, save_every=4)
    assert np.allclose(one.omega, orbits.omega, rtol=1e-12)
    same = json.loads(succeed(f"info {store} --json"))
    assert {**facts, **same} == facts
    assert "tiles done      48 of 48" in succeed(f"info {store}")


def test_a_sweep_in_n_dimensions(tmp_path):
    store = tmp_path / "nd.zarr"
    body = "run --J 1,2,4 --I .4,-.7,.5 --eps 0.1 --omega0 1,2,3 --steps 9"
    facts = json.loads(succeed(f"{body} --sweep J2=2:3:3 --reduce omega_max --json -o {store}"))
    assert facts["trajectories"] == 3
    dataset = open_ensemble(store)
    assert dataset.J.values[:, 1].tolist() == [2.0, 2.5, 3.0]
    assert dataset.omega_max.shape == (3, 1, 3)


def test_the_same_run_goes_on_and_another_is_refused(tmp_path):
    store = tmp_path / "run.zarr"
    succeed(f"{ASKED} {store}")
    longer = f"{ASKED} {store}".replace("--steps 40", "--steps 60")
    assert json.loads(succeed(longer))["steps"] == 60
    other = f"{longer} --eps 0.3"
    refused = run(*other.split())
    assert refused.code == 1
    assert "another run, with eps 0.2 instead of 0.3" in refused.err
    assert refused.err.endswith("--force replaces it\n")
    assert json.loads(succeed(f"{other} --force"))["eps"] == 0.3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--sweep eps", "--sweep: expected NAME=LOW:HIGH:COUNT, got 'eps'"),
        ("--sweep mass=1:2:3", "--sweep: expected one of eps, I1, I2, I13, I23, I3, got mass"),
        ("--sweep I1=-1:2:3", "--sweep: I1: expected positive"),
        ("--reduce mean", "reductions: expected names"),
        ("--method rk4", "method: expected one of"),
    ],
)
def test_mistakes(tmp_path, options, message):
    done = run(*f"{ASKED} run.zarr {options} --force".split(), folder=tmp_path)
    assert done.code == 2
    assert message in done.err
    assert done.err.count("\n") == 1
    assert not (tmp_path / "run.zarr").exists()


def test_force_replaces_nothing_but_stores(tmp_path):
    (tmp_path / "thesis.zarr").mkdir()
    (tmp_path / "thesis.zarr" / "thesis.tex").touch()
    (tmp_path / "file.zarr").touch()
    for name, received in (("thesis", "another folder"), ("file", "a file")):
        done = run(*f"{ASKED} {name}.zarr --force".split(), folder=tmp_path)
        assert done.code == 1
        assert f"got {received}" in done.err
    assert (tmp_path / "thesis.zarr" / "thesis.tex").exists()


@pytest.mark.compiled
@pytest.mark.skipif(os.name != "posix", reason="sends signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_says_how_to_go_on(tmp_path, number):
    store = tmp_path / "o.zarr"
    line = f"run --trajectories 1e6 --chunk 500 --steps 1e6 --method canonical -o {store}"
    command = [sys.executable, "-m", "suslov_fast", *line.split()]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as child:
        while not (store / "progress" / "steps_done" / "c").exists():
            assert child.poll() is None
            time.sleep(0.05)
        child.send_signal(number)
        errors = child.communicate(timeout=120)[1]
    assert child.returncode == 130
    assert "goes on from there" in errors
    assert open_ensemble(store).attrs["tiles_done"].endswith("of 2000")
