"""How much memory is available, as far as the system tells, and how much calls take."""

import functools
import sys
import tracemalloc

import children
import numba
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast._engine import memory

GB = 2**30
MEMINFO = "MemTotal:       33554432 kB\nMemAvailable:   16777216 kB\n"  # 16 GB
STATUS = "Name:\tpython\nVmSize:\t 1048576 kB\nVmData:\t  524288 kB\n"  # 1 GB, 1/2 GB
V1, V2 = "/sys/fs/cgroup/memory", "/sys/fs/cgroup"


def group_v2(folder, bound, used, cached):
    return {
        f"{folder}/memory.max": f"{bound}\n",
        f"{folder}/memory.current": f"{used}\n",
        f"{folder}/memory.stat": f"anon 7\ninactive_file {cached}\nactive_file 9\n",
    }


def group_v1(folder, bound, used, cached):
    return {
        f"{folder}/memory.limit_in_bytes": f"{bound}\n",
        f"{folder}/memory.usage_in_bytes": f"{used}\n",
        f"{folder}/memory.stat": f"inactive_file 1\ntotal_inactive_file {cached}\n",
    }


def available(files, **limits):
    def read(path):
        if path not in files:
            raise FileNotFoundError(path)
        return files[path]

    return memory.available(read, limits.get)


LINUX = {"/proc/meminfo": MEMINFO, "/proc/self/status": STATUS, "/proc/self/cgroup": "0::/\n"}
OLD = LINUX | {"/proc/self/cgroup": "9:cpu,cpuacct:/a\n5:memory:/a/b\n0::/a\n"}
INSIDE = LINUX | {"/proc/self/cgroup": "0::/a/b\n"}


@pytest.mark.parametrize(
    ("files", "limits", "expected"),
    [
        ({}, {}, None),
        (LINUX, {}, 16 * GB),
        ({"/proc/meminfo": "MemTotal: 5 kB\n"}, {}, None),
        (LINUX | group_v2(V2, "max", 3 * GB, 0), {}, 16 * GB),
        (LINUX | group_v2(V2, 8 * GB, 3 * GB, 0), {}, 5 * GB),
        (LINUX | group_v2(V2, 8 * GB, 7 * GB, 2 * GB), {}, 3 * GB),
        (LINUX | group_v2(V2, 8 * GB, 9 * GB, 0), {}, 0),
        (LINUX | group_v2(V2, 99 * GB, 0, 0), {}, 16 * GB),
        # The group and those around it; in a container the root alone is seen.
        (INSIDE | group_v2(V2 + "/a/b", 8 * GB, GB, 0), {}, 7 * GB),
        (INSIDE | group_v2(V2 + "/a", 4 * GB, GB, 0), {}, 3 * GB),
        (INSIDE | group_v2(V2, 2 * GB, GB, 0), {}, GB),
        (
            INSIDE | group_v2(V2 + "/a/b", 8 * GB, GB, 0) | group_v2(V2 + "/a", 4 * GB, GB, 0),
            {},
            3 * GB,
        ),
        (OLD | group_v1(V1 + "/a/b", 8 * GB, 3 * GB, GB), {}, 6 * GB),
        (OLD | group_v1(V1, 4 * GB, 3 * GB, GB), {}, 2 * GB),
        (OLD | group_v1(V1, 2**63 - 4096, 3 * GB, GB), {}, 16 * GB),
        (LINUX, {"RLIMIT_AS": 4 * GB}, 3 * GB),
        (LINUX, {"RLIMIT_DATA": 4 * GB}, 7 * GB // 2),
        (LINUX, {"RLIMIT_AS": GB // 2, "RLIMIT_DATA": 4 * GB}, 0),
        ({}, {"RLIMIT_AS": 4 * GB}, None),  # no telling how much is in use
    ],
)
def test_available(files, limits, expected):
    assert available(files, **limits) == expected


def test_require(monkeypatch):
    monkeypatch.setattr(memory, "available", lambda: 10 * GB)
    memory.require(10 * GB - memory.SMALL, "lower the batch")
    with pytest.raises(MemoryError) as caught:
        memory.require(10 * GB, "lower the batch")
    assert "10,737,418,240 bytes" in str(caught.value)
    assert str(caught.value).endswith("; lower the batch")
    with pytest.raises(MemoryError, match=r"lower 7 or \(1, 2\)$"):
        memory.require(10 * GB, "lower {} or {}", 7, (1, 2))


def test_what_is_unknown_is_allowed(monkeypatch):
    monkeypatch.setattr(memory, "available", lambda: None)
    memory.require(2**70, "")


def test_small_needs_cost_nothing(monkeypatch):
    monkeypatch.setattr(memory, "available", lambda: pytest.fail("was asked"))
    memory.require(memory.SMALL, "")


@pytest.mark.parametrize("function", [sf.step, functools.partial(sf.exact, n=7)])
def test_large_calls_make_no_copies(body, rng, function):
    """Beside the result some bytes for each state: new memory takes longer than a step."""
    if numba.config.DISABLE_JIT:
        pytest.skip("the rooms of loops are no arrays where they are compiled")
    omega = rng.normal(size=(20_000, 2))
    function(body, omega[:1], 0.2, threads=1)
    tracemalloc.start()
    try:
        result = function(body, omega, 0.2, threads=1)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert np.isfinite(result).all()
    assert peak < 1.7 * result.nbytes


def test_the_limits_of_this_system():
    resource = pytest.importorskip("resource")
    children.run(
        f"""
        import resource
        from suslov_fast._engine import memory
        room = memory.available()
        assert room is None or room > 0
        if room is not None:
            memory.require(room // 2, "")
            used = memory._kilobytes(memory._read("/proc/self/status"), "VmSize")
            resource.setrlimit(resource.RLIMIT_AS, (used + {GB}, {resource.RLIM_INFINITY}))
            assert memory.available() <= {GB}
        """
    )


# What needs more than a gigabyte: the states that it begins with do not.
LARGE = {
    "3D": """
body, omega, steps = sf.Suslov3D(4, 1, -0.5, -0.3), np.ones((1_000_000, 2)), 70
""",
    "n = 20001": """
body = sf.SuslovND(np.ones(20_000), np.ones(20_000) / 20_000)  # which needs elimination
omega, steps = np.full((9, 20_000), 19.98), 2
""",
}


@pytest.mark.compiled
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits the address space")
@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("problem", LARGE)
def test_memory_that_ends_is_an_error(problem, threads):
    """Numba loses errors inside `prange`: what is left are states that nobody computed."""
    code = f"""
import resource, sys
import numpy as np, suslov_fast as sf
from suslov_fast._engine import memory

{LARGE[problem]}
threads = int(sys.argv[1])
few, method = body, "auto"
if "ND" in type(body).__name__:
    few, method = sf.SuslovND([1, 2], [0.1, 0.2]), "rank2"
# Compiled before the limit.
sf.iterate(few, np.ones((2000, 2)), 0.1, 2000, method=method, threads=threads)
used = memory._kilobytes(memory._read("/proc/self/status"), "VmSize")
resource.setrlimit(resource.RLIMIT_AS, (used + {GB}, resource.RLIM_INFINITY))
for known in (True, False):
    if not known:
        memory.available = lambda: None  # an allocation itself must tell
    try:
        sf.iterate(body, omega, 0.1, steps, method=method, threads=threads)
    except MemoryError as error:
        assert not isinstance(error.__context__, SystemError)
    else:
        raise AssertionError("ended")
"""
    children.run(code, threads, **children.layer("workqueue"))
