"""The map in three dimensions: last states, and saved states."""

import pytest
from problem import BODY, CHECKED, EPS, STEPS, orbit, relative_error, starts
from results import Limit, Table
from revision import iterate, saved_memory, time_first

DIVISIONS = {"auto": None, "canonical": (Limit.DIVISIONS, 1), "ds2": (Limit.DIVISIONS, 1)}
WHAT = {
    "auto": "the last state by the closed form",
    "canonical": "iterates, one division per step",
    "ds2": "iterates (ds2)",
}
STREAMING = (Limit.STREAMING, 16)  # bytes of a state
SAVED = 257
EVERY = {1: "every state", 10: "every 10th state", 1000: "every 1,000th state"}
# Batches of a few, beside multiples of the 8 doubles of a vector and of the lanes of a block.
FEW = [1, 2, 3, 4, 5, 6, 7, 9, 100, 1001, 65_533, 65_536]
STATES = 5_000_000


@pytest.mark.parametrize("method", ["auto", "canonical", "ds2"])
def bench_last_states(measure, method, threads):
    batch, steps = measure.size(65_536, 64), measure.size(STEPS, 20)
    omega0, options = starts(batch), {"save_every": None, "method": method, "threads": threads}
    checked = iterate(BODY, starts(CHECKED), EPS, steps, **options).final
    measure(
        lambda: iterate(BODY, omega0, EPS, steps, **options),
        table=Table.LAST,
        key=method,
        label=f'`method="{method}"`: {WHAT[method]}',
        unit="steps",
        work=batch * steps,
        threads=threads,
        error=relative_error(checked, orbit(CHECKED, steps)[-1]),
        limit=DIVISIONS[method],
    )


@pytest.mark.parametrize(
    ("method", "save_every", "memory"),
    [
        ("auto", 1, "reused"),
        ("auto", 10, "reused"),
        ("auto", 1000, "reused"),
        ("canonical", 1, "reused"),
        ("auto", 1, "new"),
    ],
)
def bench_saved_states(measure, method, save_every, memory, threads):
    batch, saved = measure.size(65_536, 64), measure.size(SAVED, 9)
    omega0 = starts(batch)
    options = {"method": method, "save_every": save_every, "threads": threads}
    few = STEPS // save_every * save_every
    checked = time_first(iterate(BODY, starts(CHECKED), EPS, few, **options).omega)
    if memory == "reused":
        options["out"] = saved_memory(saved, batch)
    steps = (saved - 1) * save_every
    measure(
        lambda: iterate(BODY, omega0, EPS, steps, **options),
        rounds=3,
        table=Table.SAVED,
        key=f"{method}-{memory}",
        label=f'`method="{method}"`, {EVERY[save_every]}, {memory} memory',
        unit="states",
        work=batch * saved,
        threads=threads,
        error=relative_error(checked, orbit(CHECKED, STEPS)[::save_every]),
        limit=STREAMING,
        x=save_every,
    )


@pytest.mark.parametrize("batch", FEW)
@pytest.mark.parametrize("method", ["auto", "canonical"])
def bench_few_orbits(measure, method, batch, all_threads):
    """So many orbits, five million states together, into memory that is used again."""
    omega0 = starts(batch) if batch > 1 else starts(1)[0]
    steps = measure.size(STATES // batch, 10)
    out = saved_memory(steps + 1, batch if batch > 1 else None)
    options = {"method": method, "out": out, "threads": all_threads}
    measure(
        lambda: iterate(BODY, omega0, EPS, steps, **options),
        rounds=3,
        table=Table.FEW,
        key=method,
        label=f'`iterate`, `method="{method}"`',
        unit="states",
        work=batch * (steps + 1),
        threads=all_threads,
        limit=STREAMING,
        x=batch,
    )


def bench_one_orbit_in_new_memory(measure, all_threads):
    steps = measure.size(STATES, 1000)
    measure(
        lambda: iterate(BODY, starts(1)[0], EPS, steps, threads=all_threads),
        rounds=3,
        table=Table.FEW,
        key="auto-new",
        label='`iterate`, `method="auto"`, new memory',
        unit="states",
        work=steps + 1,
        threads=all_threads,
        limit=STREAMING,
        x=1,
    )
