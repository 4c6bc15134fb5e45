"""Whatever is killed, the same call finishes the run, with the bytes of one never disturbed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from ensemble_runs import arguments

from suslov_fast import ensemble
from suslov_fast._ensemble import session

Client = pytest.importorskip("distributed").Client
pytestmark = [
    pytest.mark.compiled,
    pytest.mark.skipif(sys.platform == "win32", reason="no fork, no SIGKILL"),
]
HERE = Path(__file__).parent


def run(what, store, kind, seed, kills):
    """The lines that the process prints, once its store is finished."""
    root = HERE.parent if HERE.name == "tests" else HERE.parents[1]
    done = subprocess.run(
        [
            sys.executable,
            str(root / "tests" / "ensemble_runs.py"),
            what,
            str(store),
            kind,
            str(seed),
            str(kills),
        ],
        capture_output=True,
        text=True,
        timeout=600,
        env=os.environ,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return [int(line) for line in done.stdout.split()]


def results(store):
    """The files of a store but for its metadata, by name."""
    return {
        str(path.relative_to(store)): path.read_bytes()
        for path in store.rglob("*")
        if path.is_file() and path.name != "zarr.json" and path.parts[-3] not in ("n", "time")
    }


def assert_undisturbed(store, kind, steps):
    """It holds what an undisturbed run does, byte for byte, and nothing else."""
    other = store.with_name("undisturbed.zarr")
    ensemble(**arguments(kind), steps=steps, store=other)
    found, expected = results(store), results(other)
    assert sorted(found) == sorted(expected)
    assert [name for name in found if found[name] != expected[name]] == []


@pytest.mark.parametrize("kind", ["3d", "3d reductions", "nd"])
def test_killed_runs_are_finished(tmp_path, kind):
    store = tmp_path / "run.zarr"
    assert run("alone", store, kind, 1, 3) == [3]
    assert_undisturbed(store, kind, 300)


def test_killed_workers_cost_nothing(tmp_path):
    store = tmp_path / "run.zarr"
    steps, killed = run("workers", store, "nd", 2, 1)
    assert killed == 1
    assert_undisturbed(store, "nd", steps)


def test_what_killed_workers_leave_is_removed(tmp_path, monkeypatch):
    """The call whose workers they were does so, as no other may follow."""
    store, compute, left = tmp_path / "run.zarr", session._compute, []

    def and_leave_one(job, *others):
        compute(job, *others)
        left.append(store / "final" / "c" / ".0.1.2.partial")
        left[0].write_bytes(b"part of a chunk")

    monkeypatch.setattr(session, "_compute", and_leave_one)
    with Client(n_workers=1, processes=False, dashboard_address=None) as client:
        ensemble(**arguments("3d"), steps=300, store=store, scheduler=client)
    assert len(left) == 1
    assert not left[0].exists()
