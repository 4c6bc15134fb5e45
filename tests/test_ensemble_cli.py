"""Stores on the command line: made, gone on with, looked at."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack

import numpy as np
import pytest

from suslov_fast import Suslov3D, iterate, open_ensemble
from suslov_fast._cli import main

pytest.importorskip("dask")
pytest.importorskip("zarr")
ASKED = "run --trajectories 100 --steps 40 --save-every 4 --json -o".split()


def call(capsys, *arguments):
    """The status, and what was printed to each stream."""
    with pytest.raises(SystemExit) as stopped:
        main([str(each) for each in arguments])
    return stopped.value.code, *capsys.readouterr()


def test_a_grid_of_parameters(tmp_path, capsys):
    store = tmp_path / "grid.zarr"
    sweeps = ["--sweep", "eps=0.1:0.4:4", "--sweep", "I13=-0.5:0.5:3", "--chunk", 30]
    code, out, err = call(capsys, *ASKED, store, *sweeps)
    assert (code, err) == (0, "")
    facts = json.loads(out)
    assert facts["trajectories"] == 1200
    assert facts["tiles_done"] == "48 of 48"
    assert facts["status"] == {"OK": 1200}
    assert facts["drift"]["F"]["largest"] < 1e-12
    dataset = open_ensemble(store)
    assert dataset.omega.dims == ("n", "sweep_eps", "sweep_I13", "trajectory", "component")
    one = dataset.sel(sweep_eps=0.2, sweep_I13=0.5, method="nearest")
    orbits = iterate(Suslov3D(4, 1, 0.5, -0.3), one.omega.values[0], 0.2, 40, save_every=4)
    assert np.allclose(one.omega, orbits.omega, rtol=1e-12)
    told = json.loads(call(capsys, "info", store, "--json")[1])
    assert {**facts, **told} == facts
    text = call(capsys, "info", store)[1]
    assert "tiles done      48 of 48" in text


def test_it_goes_on(tmp_path, capsys):
    store = tmp_path / "run.zarr"
    assert call(capsys, *ASKED, store)[0] == 0
    longer = list(ASKED)
    longer[longer.index("--steps") + 1] = 60
    assert json.loads(call(capsys, *longer, store)[1])["steps"] == 60
    code, _, err = call(capsys, *longer, store, "--eps", 0.3)
    assert code == 2
    assert "another run, with eps 0.2 instead of 0.3" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--sweep eps", "NAME=LOW:HIGH:COUNT"),
        ("--sweep mass=1:2:3", "expected eps, I1, I2, I13 or I23, got mass"),
        ("--sweep I1=-1:2:3", "--sweep: I1: expected a positive"),
        ("--reduce mean", "reductions: expected names"),
    ],
)
def test_bad_options(tmp_path, capsys, arguments, message):
    code, _, err = call(capsys, *ASKED, tmp_path / "run.zarr", *arguments.split())
    assert code == 2
    assert message in err
    assert err.count("\n") == 1


def test_options_of_stores_need_one(capsys):
    code, _, err = call(capsys, "run", "--steps", 1, "--trajectories", 1, "--chunk", 5)
    assert code == 2
    assert "--chunk: expected -o FILE.zarr" in err


@pytest.mark.compiled
@pytest.mark.skipif(os.name != "posix", reason="sends signals")
def test_a_signal_says_how_to_go_on(tmp_path):
    command = [sys.executable, "-m", "suslov_fast", "run", "--trajectories", "1e6"]
    command += ["--chunk", "500", "--steps", "1e6", "--method", "canonical", "-o"]
    numbers = signal.SIGINT, signal.SIGTERM
    stores = [tmp_path / f"{number}.zarr" for number in numbers]
    with ExitStack() as stack:
        children = [
            stack.enter_context(
                subprocess.Popen([*command, store], stderr=subprocess.PIPE, text=True)
            )
            for store in stores
        ]
        for child, store, number in zip(children, stores, numbers, strict=True):
            while not (store / "progress" / "steps_done" / "c").exists():
                assert child.poll() is None
                time.sleep(0.05)
            child.send_signal(number)
        errors = [child.communicate(timeout=120)[1] for child in children]
    for child, store, err in zip(children, stores, errors, strict=True):
        assert child.returncode == 130
        assert "the same call goes on from there" in err
        assert open_ensemble(store).attrs["tiles_done"].endswith("of 2000")
