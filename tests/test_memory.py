"""Available memory, the memory that calls need, and exhausted memory."""

import functools
import sys
import tracemalloc
from pathlib import Path

import children
import numba
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast._engine import execution, memory

GB = 2**30
MEMINFO = "MemTotal:       33554432 kB\nMemAvailable:   16777216 kB\n"  # 16 GB
GROUPS = "/sys/fs/cgroup"
LINUX = {"/proc/meminfo": MEMINFO, "/proc/self/cgroup": "9:cpu,cpuacct:/c\n0::/\n"}
INSIDE = LINUX | {"/proc/self/cgroup": "0::/a/b\n"}


def group(folder, bound, used, cached):
    return {
        f"{folder}/memory.max": f"{bound}\n",
        f"{folder}/memory.current": f"{used}\n",
        f"{folder}/memory.stat": f"anon 7\ninactive_file {cached}\nactive_file 9\n",
    }


OWN = group(GROUPS + "/a/b", 8 * GB, GB, 0)


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({}, None),
        ({"/proc/meminfo": "MemTotal: 5 kB\n"}, None),
        (LINUX, 16 * GB),
        (LINUX | group(GROUPS, "max", 3 * GB, 0), 16 * GB),
        (LINUX | group(GROUPS, 8 * GB, 3 * GB, 0), 5 * GB),
        (LINUX | group(GROUPS, 8 * GB, 7 * GB, 2 * GB), 3 * GB),
        (LINUX | group(GROUPS, 8 * GB, 9 * GB, 0), 0),
        (LINUX | group(GROUPS, 99 * GB, 0, 0), 16 * GB),
        # The cgroup and its parents; a container sees only the root.
        (INSIDE | OWN, 7 * GB),
        (INSIDE | group(GROUPS + "/a", 4 * GB, GB, 0), 3 * GB),
        (INSIDE | group(GROUPS, 2 * GB, GB, 0), GB),
        (INSIDE | OWN | group(GROUPS + "/a", 4 * GB, GB, 0), 3 * GB),
    ],
)
def test_available(files, expected, monkeypatch):
    def read(path):
        if path not in files:
            raise FileNotFoundError(path)
        return files[path]

    monkeypatch.setattr(memory, "_content", read)
    assert memory.available() == expected


def test_the_memory_of_this_system():
    room = memory.available()
    assert room is None or room > 0
    if sys.platform.startswith("linux"):
        assert room is not None


def test_require(monkeypatch):
    monkeypatch.setattr(memory, "available", lambda: 10 * GB)
    memory.require(10 * GB - memory.SMALL, "lower the batch")
    with pytest.raises(MemoryError, match=r"got 10,737,418,240 bytes; lower 7 or \(1, 2\)$"):
        memory.require(10 * GB, "lower {} or {}", 7, (1, 2))
    monkeypatch.setattr(memory, "available", lambda: None)  # no limit if unknown
    memory.require(2**70, "")
    monkeypatch.setattr(memory, "available", lambda: pytest.fail("was asked"))
    memory.require(memory.SMALL, "")


def peak_of(function, *arguments, **options):
    """Return the result of a call, and the most memory that it used."""
    tracemalloc.start()
    try:
        return function(*arguments, **options), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("function", [sf.step, functools.partial(sf.exact, n=7)])
def test_large_calls_make_no_copies(body, rng, function):
    """Calls allocate little beside the result, since new memory costs more than a step."""
    if numba.config.DISABLE_JIT:
        pytest.skip("blocks of kernels are arrays where they are not compiled")
    omega = rng.normal(size=(20_000, 2))
    function(body, omega[:1], 0.2, threads=1)
    result, peak = peak_of(function, body, omega, 0.2, threads=1)
    assert np.isfinite(result).all()
    assert peak < 1.7 * result.nbytes


def test_the_tested_memory_is_that_used(body, monkeypatch):
    """A run is tested for all that it allocates, if only its last state is saved, too."""
    asked = []
    monkeypatch.setattr(execution, "require", lambda nbytes, *more: asked.append(nbytes))
    omega = np.ones((20_000, 2))
    for save_every in (None, 1):
        options = {"save_every": save_every, "method": "canonical", "threads": 1}
        sf.iterate(body, omega[:1], 0.2, 2, **options)
        _, peak = peak_of(sf.iterate, body, omega, 0.2, 2, **options)
        assert 0.5 * peak < asked[-1]


on_linux = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")


@pytest.mark.slow
@pytest.mark.compiled
@on_linux
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


@pytest.mark.slow
@pytest.mark.compiled
@on_linux
def test_runs_20_times_as_large_as_a_limit(tmp_path):
    output = children.run(CODE, tmp_path, LIMIT, NUMBA_NUM_THREADS="2")  # each thread holds a chunk
    states, reduced = map(int, output.split())
    assert states < LIMIT
    assert reduced < LIMIT
    files = (tmp_path / "large states").rglob("*")
    assert sum(path.stat().st_size for path in files if path.is_file()) > 20 * LIMIT
