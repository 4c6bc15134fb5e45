"""A stored run takes the memory of a few chunks, whatever its size."""

import subprocess
import sys

import pytest

pytest.importorskip("dask")
pytestmark = [
    pytest.mark.compiled,
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc"),
]

LIMIT = 2**24

CODE = """
import sys
from suslov_fast import RandomStarts, Suslov3D, ensemble

def peak():
    with open("/proc/self/status") as file:
        return next(1024 * int(line.split()[1]) for line in file if line.startswith("VmHWM"))

store, limit, kind = sys.argv[1], int(sys.argv[2]), sys.argv[3]
body = Suslov3D(4, 1, -0.5, -0.3)
settings = {"states": {"save_every": 1}, "reduced": {"reductions": ["first_integral_drift"]}}[kind]

def run(name, count, steps):
    # A chunk is an eighth of the limit, so that four of them are half of it.
    rows = 64
    chunk = {"trajectory": limit // (8 * 16 * rows), "n": rows}
    ensemble(
        body, RandomStarts(count, 1.0), 0.2, steps, store=f"{store}/{name}", chunk=chunk, **settings
    )

run("small", 64, 63)
run("one", limit // (8 * 16 * 64), 127)
before = peak()
count = 20 * limit // (16 * 1024)
run("large", count, 1023)
print(peak() - before)
"""


@pytest.mark.parametrize("kind", ["states", "reduced"])
def test_a_run_20_times_as_large_as_a_limit(tmp_path, kind):
    done = subprocess.run(
        [sys.executable, "-c", CODE, str(tmp_path), str(LIMIT), kind],
        capture_output=True,
        text=True,
        check=True,
    )
    assert int(done.stdout) < LIMIT
    if kind == "states":
        stored = sum(
            path.stat().st_size for path in (tmp_path / "large").rglob("*") if path.is_file()
        )
        assert stored > 20 * LIMIT
