"""Exhausted memory is a MemoryError, and a stored run of any size needs that of a few chunks."""

import sys
from pathlib import Path

import children
import pytest

pytestmark = [
    pytest.mark.compiled,
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc"),
]


@pytest.mark.parametrize("layer", [None, *children.LAYERS])
@pytest.mark.parametrize("problem", range(7))
def test_scarce_memory(problem, layer):
    """No other error, and no states that were not computed."""
    threads, settings = (2, children.layer(layer)) if layer else (1, {})
    # Freed memory is returned or overwritten, and so never shows the states of the last run.
    settings |= {"MALLOC_MMAP_THRESHOLD_": "65536", "MALLOC_PERTURB_": "170"}
    settings["MALLOC_ARENA_MAX"] = "1"
    children.run(Path(__file__).with_name("scarce.py"), problem, threads, **settings)


LIMIT = 2**24

CODE = """
import sys
from suslov_fast import RandomStarts, Suslov3D, ensemble

def peak():
    with open("/proc/self/status") as file:
        return next(1024 * int(line.split()[1]) for line in file if line.startswith("VmHWM"))

store, limit = sys.argv[1], int(sys.argv[2])
body = Suslov3D(4, 1, -0.5, -0.3)
KINDS = {"states": {"save_every": 1}, "reduced": {"reductions": ["first_integral_drift"]}}

def run(name, kind, count, steps):
    # A chunk is an eighth of the limit, so that four of them are half of it.
    rows = 64
    chunk = {"trajectory": limit // (8 * 16 * rows), "n": rows}
    name = f"{store}/{name} {kind}"
    starts = RandomStarts(count, 1.0)
    ensemble(body, starts, 0.2, steps, store=name, chunk=chunk, **KINDS[kind])

for kind in KINDS:
    run("small", kind, 64, 63)
    run("one", kind, limit // (8 * 16 * 64), 127)
before = peak()
for kind in KINDS:
    run("large", kind, 20 * limit // (16 * 1024), 1023)
    print(peak() - before)
"""


def test_runs_20_times_as_large_as_a_limit(tmp_path):
    output = children.run(CODE, tmp_path, LIMIT, NUMBA_NUM_THREADS="2")  # each thread holds a chunk
    states, reduced = map(int, output.split())
    assert states < LIMIT
    assert reduced < LIMIT
    files = (tmp_path / "large states").rglob("*")
    assert sum(path.stat().st_size for path in files if path.is_file()) > 20 * LIMIT
