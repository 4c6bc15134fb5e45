"""Whatever is killed, the same call finishes the run, bit for bit."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.compiled,
    pytest.mark.skipif(sys.platform == "win32", reason="no fork, no SIGKILL"),
]
SCRIPT = Path(__file__).parent / "ensemble_runs.py"


def run(what, store, kind, seed, kills):
    """Return the number of steps and of kills, once the store is finished."""
    command = [sys.executable, str(SCRIPT), what, str(store), kind, str(seed), str(kills)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, env=os.environ)
    assert done.returncode == 0, done.stderr[-3000:]
    return [int(number) for number in done.stdout.split()]


@pytest.mark.parametrize(
    ("what", "kind", "kills"),
    [("alone", "3d attitude", 4), ("alone", "3d reductions", 3), ("workers", "nd", 1)],
)
def test_killed_runs_are_finished(tmp_path, what, kind, kills):
    from ensemble_runs import assert_undisturbed

    steps, killed = run(what, tmp_path / "run.zarr", kind, 1, kills)
    assert killed == kills
    assert_undisturbed(tmp_path / "run.zarr", kind, steps)
