"""After a process is killed, a repeated call finishes the run, bit for bit."""

import sys
from pathlib import Path

import children
import pytest
from ensemble_runs import assert_undisturbed

pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.compiled,
    pytest.mark.skipif(sys.platform == "win32", reason="no fork, no SIGKILL"),
]
SCRIPT = Path(__file__).parent / "ensemble_runs.py"


def run(what, store, kind, seed, kills):
    """Finish a store, and return the numbers of steps and kills."""
    return map(int, children.run(SCRIPT, what, store, kind, seed, kills, timeout=600).split())


def test_a_killed_run_is_finished(tmp_path):
    """`tests/slow` kills runs of all kinds, and workers."""
    steps, killed = run("alone", tmp_path / "run.zarr", "3d attitude", 1, 3)
    assert killed == 3
    assert_undisturbed(tmp_path / "run.zarr", "3d attitude", steps)
