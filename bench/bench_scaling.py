"""Steps per second against the size of the batch, the states saved, and the threads.

Scaling with n is that of `bench_nd.py`. All rows iterate: `method="canonical"` in 3D.
"""

import limits
import pytest
from problem import BODY, EPS, problem_nd, starts

from suslov_fast import iterate

STEPS = 1000
BATCHES = [1, 4, 16, 64, 128, 256, 512, 1024, 2048, 4096, 16_384, 65_536, 262_144]
SAVE_EVERY = [1, 2, 5, 10, 25, 50, 100, 250, 1000, None]


@pytest.mark.parametrize("build", ["serial", "parallel", "iterate"])
@pytest.mark.parametrize("batch", BATCHES)
def bench_batch(measure, batch, build, all_threads, monkeypatch):
    """On one thread, on all of them whatever the size, and as `iterate` decides."""
    batch = measure.size(batch, 256)
    crossover = None
    parallel = pytest.importorskip("suslov_fast._engine.threads")
    if hasattr(parallel, "CROSSOVER"):
        crossover = parallel.CROSSOVER
        if build == "parallel":
            monkeypatch.setattr(parallel, "CROSSOVER", 0)
    elif build == "parallel":
        pytest.skip("this version does not choose by the amount of work")
    steps = measure.size(STEPS if batch < 100_000 else STEPS // 4, 10)
    options = {"save_every": None, "method": "canonical"}
    options["threads"] = 1 if build == "serial" else all_threads
    omega0 = starts(batch)
    measure(
        lambda: iterate(BODY, omega0, EPS, steps, **options),
        table="batch",
        row=build,
        unit="steps",
        work=batch * steps,
        threads=options["threads"],
        x=batch,
        crossover=crossover and crossover / steps,
    )


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("save_every", SAVE_EVERY)
def bench_saved(measure, save_every, order, all_threads):
    batch, steps = measure.size(16_384, 64), measure.size(STEPS, 100)
    n_saved = 1 if save_every is None else steps // save_every + 1
    shape = (batch, n_saved, 2)
    out = limits.aligned(shape)
    if order == "F":
        out = out.reshape(shape[::-1]).T
    options = {"save_every": save_every, "method": "canonical", "out": out}
    omega0 = starts(batch)
    measure(
        lambda: iterate(BODY, omega0, EPS, steps, **options),
        table="saved",
        row=f'order "{order}"',
        unit="steps",
        work=batch * steps,
        threads=all_threads,
        x=n_saved,
    )


@pytest.mark.parametrize("what", ["3D, last states", "3D, all states", "n = 9, last states"])
def bench_threads(measure, what, threads):
    batch = measure.size(16_384, 64)
    options = {"save_every": None, "threads": threads}
    if "3D" in what:
        body, omega0, eps, steps = BODY, starts(batch), EPS, measure.size(STEPS, 10)
        options["method"] = "canonical"
    else:
        body, omega0 = problem_nd(8, batch)
        eps, steps = EPS / 2, measure.size(100, 10)
    if "all" in what:
        options["save_every"] = 1
        options["out"] = limits.aligned((2, steps + 1, batch)).T
    measure(
        lambda: iterate(body, omega0, eps, steps, **options),
        table="threads",
        row=what,
        unit="steps",
        work=batch * steps,
        threads=threads,
        x=threads,
    )
