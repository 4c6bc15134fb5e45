"""Many kills of every kind of run, and a full file system."""

import os
import subprocess
import sys

import pytest
from ensemble_runs import KINDS, arguments, assert_undisturbed, finish

from suslov_fast import ensemble


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("what", "kills"), [("alone", 15), ("workers", 5)])
def test_kills(tmp_path, what, kind, kills):
    steps, killed = finish(what, tmp_path / "run.zarr", kind, 2, kills)
    assert killed == kills
    assert_undisturbed(tmp_path / "run.zarr", kind, steps)


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_system_that_is_full(tmp_path, kind):
    small = tmp_path / "small"
    small.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", str(small)]
    if sys.platform != "linux" or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no file system can be mounted here")
    try:
        for _ in range(2):
            with pytest.raises(OSError, match="No space left on device"):
                ensemble(**arguments(kind), steps=300, store=small / "run.zarr")
        subprocess.run(["mount", "-o", "remount,size=100m", str(small)], check=True)
        ensemble(**arguments(kind), steps=300, store=small / "run.zarr")
        assert_undisturbed(small / "run.zarr", kind, 300)
    finally:
        os.sync()
        subprocess.run(["umount", str(small)], check=False)
