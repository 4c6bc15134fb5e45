"""How time grows with the batch, with what lies between saved states, with steps, with threads.

Scaling with n is that of `bench_nd.py`, and that of small batches whose states are all saved that
of `bench_map3d.py`.
"""

import os

import numpy as np
import pytest
from problem import BODY, EPS, problem_nd, starts
from results import Table
from revision import TIME_FIRST, iterate, saved_memory

from suslov_fast import exact

BATCH, STEPS = 4096, 1000
BATCHES = [10**k for k in range(9)]
BATCH_STEPS = 50
SAVE_EVERY = [1, 10, 100, 1000, 10_000]
SAVED = 50
NUMBERS = [10**k for k in range(1, 8)]


def many_starts(batch):
    """States for batches of any size; those of large ones come again and again."""
    return np.resize(starts(min(batch, 100_000)), (batch, 2))


@pytest.mark.parametrize("method", ["auto", "canonical"])
@pytest.mark.parametrize(
    "batch",
    [pytest.param(batch, marks=pytest.mark.once if batch > 10**6 else ()) for batch in BATCHES],
)
def bench_batch(measure, batch, method, all_threads):
    """Last states after 50 steps."""
    if batch > 10**7 and not TIME_FIRST:
        pytest.skip("takes minutes with this version")
    if measure.full and 64 * batch > os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"):
        pytest.skip("takes more memory than there is")
    omega0 = many_starts(measure.size(batch, 256))
    options = {"save_every": None, "method": method, "threads": all_threads}
    measure(
        lambda: iterate(BODY, omega0, EPS, BATCH_STEPS, **options),
        rounds=2 if batch > 10**6 else None,
        table=Table.BATCH,
        key=method,
        label=f'`method="{method}"`',
        unit="steps",
        work=len(omega0) * BATCH_STEPS,
        threads=all_threads,
        x=batch,
    )


@pytest.mark.parametrize("method", ["auto", "canonical"])
@pytest.mark.parametrize("save_every", SAVE_EVERY)
def bench_save_every(measure, save_every, method, all_threads):
    """The same number of saved states, further and further apart."""
    omega0 = starts(measure.size(BATCH, 16))
    saved = measure.size(SAVED, 3)
    options = {"save_every": save_every, "method": method, "threads": all_threads}
    options["out"] = saved_memory(saved, len(omega0))
    if not measure.full:
        save_every = min(save_every, 10)
        options["save_every"] = save_every
    measure(
        lambda: iterate(BODY, omega0, EPS, (saved - 1) * save_every, **options),
        table=Table.EVERY,
        key=method,
        label=f'`iterate`, `method="{method}"`',
        unit="states",
        work=len(omega0) * saved,
        threads=all_threads,
        x=save_every,
    )


@pytest.mark.parametrize("save_every", SAVE_EVERY)
def bench_exact_every(measure, save_every, all_threads, set_threads):
    """The same states by `exact`, into new memory."""
    set_threads(all_threads)
    omega0 = starts(measure.size(BATCH, 16))
    n = save_every * np.arange(measure.size(SAVED, 3))
    measure(
        lambda: exact(BODY, omega0, EPS, n),
        table=Table.EVERY,
        key="exact",
        label="`exact`, new memory",
        unit="states",
        work=len(omega0) * len(n),
        threads=all_threads,
        x=save_every,
    )


@pytest.mark.parametrize("method", ["auto", "canonical", "exact"])
@pytest.mark.parametrize("n", NUMBERS)
def bench_steps(measure, n, method, all_threads, set_threads):
    """State n of each orbit, and nothing else."""
    if method == "canonical" and n > 10**5:
        pytest.skip("grows with n, as the shorter ones show")
    set_threads(all_threads)
    omega0 = starts(measure.size(BATCH, 16))
    n = measure.size(n, 100)
    if method == "exact":
        call, label = (lambda: exact(BODY, omega0, EPS, n)), "`exact`"
    else:
        options = {"save_every": None, "method": method, "threads": all_threads}
        call = lambda: iterate(BODY, omega0, EPS, n, **options)  # noqa: E731
        label = f'`iterate`, `method="{method}"`'
    measure(
        call,
        table=Table.STEPS,
        key=method,
        label=label,
        unit="states",
        work=len(omega0),
        threads=all_threads,
        x=n,
    )


@pytest.mark.parametrize("what", ["last", "saved", "nd"])
def bench_threads(measure, what, threads):
    batch = measure.size(16_384, 64)
    options = {"save_every": None, "threads": threads}
    if what == "nd":
        (body, omega0), eps, steps = problem_nd(8, batch), EPS / 2, measure.size(100, 10)
    else:
        body, omega0, eps, steps = BODY, starts(batch), EPS, measure.size(STEPS, 10)
        options["method"] = "canonical"
    if what == "saved":
        options |= {"save_every": 1, "out": saved_memory(steps + 1, batch)}
    labels = {"last": "3D, last states", "saved": "3D, all states", "nd": "n = 9, last states"}
    measure(
        lambda: iterate(body, omega0, eps, steps, **options),
        table=Table.THREADS,
        key=what,
        label=labels[what],
        unit="steps",
        work=batch * steps,
        threads=threads,
        x=threads,
    )
