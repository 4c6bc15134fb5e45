"""Steps per second in n dimensions, and of the closed form."""

import numpy as np
import pytest
from bench_map3d import THREADS, measure
from problem import BODY, EPS, problem_nd, starts

from suslov_fast import exact, iterate


@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("method", ["rank2", "gauss"])
@pytest.mark.parametrize("components", [2, 4, 8, 16, 32, 64])
def bench_n_dimensions(benchmark, components, method, threads):
    body, omega0 = problem_nd(components, 1024)
    steps = max(1, 400 // components if method == "rank2" else 800 // components**2)
    options = {"save_every": None, "method": method, "threads": threads}
    measure(benchmark, 1024 * steps, lambda: iterate(body, omega0, 0.1, steps, **options))


@pytest.mark.parametrize("batch", [1, 65_536])
def bench_jump(benchmark, batch):
    omega0 = starts(batch)
    measure(benchmark, batch, lambda: exact(BODY, omega0, EPS, 10**6))


def bench_dense_orbit(benchmark):
    n = np.arange(100_000)
    measure(benchmark, len(n), lambda: exact(BODY, [1.0, 0.5], EPS, n))
