"""Arguments and comparisons of stored runs, and stored runs with kills of processes.

`ensemble_runs.py STORE KIND SEED KILLS` finishes a store after as many kills.
"""

import os
import random
import shutil
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

from suslov_fast import RandomStarts, Suslov3D, SuslovND, ensemble

BODY = Suslov3D(4, 1, -0.5, -0.3)
BODY_4D = SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5])
CUT = {"trajectory": 7, "n": 3}
KINDS = {
    "3d": {"save_every": 7, "method": "canonical"},
    "3d auto": {"save_every": None},
    "3d attitude": {"save_every": 50, "method": "ds2", "attitude": True},
    "3d reductions": {"save_every": 30, "reductions": ["first_integral_drift", "omega_max"]},
    "nd": {"save_every": 7, "method": "rank2"},
    "nd gauss": {"save_every": 40, "method": "gauss", "attitude": True},
}


def arguments(kind):
    nd = SuslovND(J=np.linspace(1.0, 3.0, 7), I=np.linspace(-0.3, 0.5, 7))
    starts = RandomStarts(16 * 24, 1.5, seed=4)
    chunk = {"trajectory": 16, "n": 5}
    body = nd if kind.startswith("nd") else BODY
    return {"body": body, "omega0": starts, "eps": 0.3, "steps": 300, "chunk": chunk, **KINDS[kind]}


def assert_same(dataset, orbits):
    """Compare all stored variables with the results of `iterate`, bit for bit."""
    for name in ("omega", "final", "status", "failed_at", "attitude", "n"):
        expected = getattr(orbits, name)
        if expected is None:
            assert name not in dataset
        else:
            found = np.asarray(dataset[name].values)
            assert found.shape == np.shape(expected), name
            assert found.tobytes() == np.asarray(expected).tobytes(), name


def made(monkeypatch):
    """Return a list of the pieces that are computed from now on, by their first steps."""
    from suslov_fast._ensemble import compute

    pieces, execute = [], compute.execute

    def observed(problem, span, *others, **options):
        pieces.append(span.start)
        return execute(problem, span, *others, **options)

    monkeypatch.setattr(compute, "execute", observed)
    return pieces


def contents(store):
    return {
        str(path.relative_to(store)): path.read_bytes()
        for path in sorted(store.rglob("*"))
        if path.is_file() and path.suffix not in (".json", ".partial")
    }


def assert_undisturbed(store, kind):
    other = store.with_name("undisturbed.zarr")
    dataset = ensemble(**arguments(kind), store=other)
    assert dataset.attrs["tiles_done"] == "24 of 24"
    found, expected = contents(store), contents(other)
    for k in range(4):  # these chunks of n are of the size that the first run gave them
        found.pop(f"n/c/{k}", None), expected.pop(f"n/c/{k}", None)
    assert found.keys() == expected.keys()
    assert [name for name in found if found[name] != expected[name]] == []


def finish_after_kills(store, kind, seed, kills):
    """Kill processes at random moments, then let one finish."""
    chance, longest = random.Random(seed), 1.0
    while True:
        child = os.fork()
        if not child:
            with suppress(ValueError):  # the store already has more steps
                ensemble(**arguments(kind) | {"steps": 130}, store=store)
            ensemble(**arguments(kind), store=store)
            os._exit(0)
        if kills:
            time.sleep(chance.uniform(0.0, longest))
            os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        if status == 0 and not kills:
            return
        if status == 0:
            longest /= 2.0  # finished before the kill: start a new store
            shutil.rmtree(store)
        else:
            assert os.WIFSIGNALED(status), status
            kills -= 1


if __name__ == "__main__":
    store, kind, seed, kills = sys.argv[1:]
    finish_after_kills(Path(store), kind, int(seed), int(kills))
