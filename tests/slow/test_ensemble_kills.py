"""Tens of kills, of every kind of run, and a file system that is full."""

import os
import subprocess
import sys

import pytest
from ensemble_runs import arguments
from test_ensemble_kills import assert_undisturbed, run

from suslov_fast import ensemble

KINDS = ["3d", "3d auto", "3d attitude", "3d reductions", "nd", "nd gauss"]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", KINDS)
def test_runs_killed_again_and_again(tmp_path, kind, seed):
    store = tmp_path / "run.zarr"
    assert run("alone", store, kind, seed, 25) == [25]
    assert_undisturbed(store, kind, 300)


@pytest.mark.parametrize("kind", KINDS)
def test_workers_killed_again_and_again(tmp_path, kind):
    store = tmp_path / "run.zarr"
    steps, killed = run("workers", store, kind, 1, 15)
    assert killed == 15
    assert_undisturbed(store, kind, steps)


@pytest.mark.parametrize("kind", KINDS)
def test_a_small_file_system_that_is_full(tmp_path, kind):
    """The run fails, goes on when there is room, and ends with the same bytes."""
    small = tmp_path / "small"
    small.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", str(small)], capture_output=True
    )
    if sys.platform != "linux" or mounted.returncode:
        pytest.skip("no file system can be mounted here")
    try:
        store = small / "run.zarr"
        for _ in range(2):
            with pytest.raises(OSError, match="No space left on device"):
                ensemble(**arguments(kind), steps=300, store=store)
        subprocess.run(["mount", "-o", "remount,size=100m", str(small)], check=True)
        ensemble(**arguments(kind), steps=300, store=store)
        assert_undisturbed(store, kind, 300)
    finally:
        os.sync()
        subprocess.run(["umount", str(small)], check=False)
