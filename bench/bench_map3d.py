"""Steps per second of the 3D map. `pytest bench --benchmark-enable` measures."""

import numba
import numpy as np
import pytest
from peers import c_functions, numba_prange, numpy_batch
from problem import BODY, EPS, starts

from suslov_fast import iterate, step

BATCHES = [1, 16, 256, 4096, 65_536]
THREADS = [threads for threads in (1, 2) if threads <= numba.config.NUMBA_NUM_THREADS]
PEERS = {"NumPy": numpy_batch, "Numba, prange": numba_prange, **c_functions()}


def measure(benchmark, work, call):
    """Time a call after one that warms up, and record steps per second."""
    call()
    benchmark(call)
    if benchmark.stats is not None:  # None where benchmarks are only run once, as tests
        benchmark.extra_info["steps_per_second"] = work / benchmark.stats.stats.min


@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("method", ["auto", "canonical", "ds2"])
@pytest.mark.parametrize("batch", BATCHES)
def bench_final_states(benchmark, batch, method, threads):
    omega0 = starts(batch)
    options = {"save_every": None, "method": method, "threads": threads}
    measure(benchmark, batch * 1000, lambda: iterate(BODY, omega0, EPS, 1000, **options))


@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("batch", BATCHES)
def bench_saved_states(benchmark, batch, order, threads):
    omega0 = starts(batch)
    out = np.empty((batch, 101, 2), order=order)
    measure(
        benchmark, batch * 100, lambda: iterate(BODY, omega0, EPS, 100, out=out, threads=threads)
    )


@pytest.mark.parametrize("name", PEERS)
def bench_peers(benchmark, name):
    omega0 = starts(4096)
    measure(benchmark, 4096 * 100, lambda: PEERS[name](omega0, 100))


def bench_small_call(benchmark):
    measure(benchmark, 10, lambda: iterate(BODY, [1.0, 0.5], EPS, 10))


def bench_one_step(benchmark):
    measure(benchmark, 1, lambda: step(BODY, [1.0, 0.5], EPS))
