"""Whatever is killed, the same call finishes the run, bit for bit."""

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
    """Return the number of steps and of kills, once the store is finished."""
    return map(int, children.run(SCRIPT, what, store, kind, seed, kills, timeout=600).split())


@pytest.mark.parametrize(
    ("what", "kind", "kills"),
    [("alone", "3d attitude", 4), ("alone", "3d reductions", 3), ("workers", "nd", 1)],
)
def test_killed_runs_are_finished(tmp_path, what, kind, kills):
    steps, killed = run(what, tmp_path / "run.zarr", kind, 1, kills)
    assert killed == kills
    assert_undisturbed(tmp_path / "run.zarr", kind, steps)
