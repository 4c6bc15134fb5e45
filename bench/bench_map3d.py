"""The map in three dimensions: last states, and all states."""

import limits
import numpy as np
import pytest
from problem import BODY, CHECKED, EPS, STEPS, orbit, relative_error, starts

from suslov_fast import iterate

DIVISIONS = {"auto": None, "canonical": ("divisions", 1), "ds2": ("divisions", 1)}
WHAT = {
    "auto": "the last state by the closed form",
    "canonical": "iterates, one division per step",
    "ds2": "iterates (ds2)",
}


@pytest.mark.parametrize("method", ["auto", "canonical", "ds2"])
def bench_last_states(measure, method, threads):
    batch, steps = measure.size(65_536, 64), measure.size(STEPS, 20)
    omega0, options = starts(batch), {"save_every": None, "method": method, "threads": threads}
    checked = iterate(BODY, starts(CHECKED), EPS, steps, **options).final
    measure(
        lambda: iterate(BODY, omega0, EPS, steps, **options),
        table="last states",
        row=f'**suslov_fast**, `method="{method}"`: {WHAT[method]}',
        unit="steps",
        work=batch * steps,
        threads=threads,
        error=relative_error(checked, orbit(CHECKED, steps)[:, -1]),
        limit=DIVISIONS[method],
    )


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize(
    ("method", "memory"), [("auto", "reused"), ("auto", "new"), ("canonical", "reused")]
)
def bench_all_states(measure, method, order, memory, threads):
    batch, steps = measure.size(65_536, 64), 256
    omega0, options = starts(batch), {"method": method, "order": order, "threads": threads}
    # Aligned, as the streaming stores of C are.
    out = limits.aligned((batch, steps + 1, 2))
    if order == "F":
        out = out.reshape(2, steps + 1, batch).T
    checked = iterate(BODY, starts(CHECKED), EPS, steps, **options).omega
    if memory == "reused":
        options["out"] = out
    measure(
        lambda: iterate(BODY, omega0, EPS, steps, **options),
        table="all states",
        row=f'**suslov_fast**, `method="{method}"`, order "{order}", {memory} memory',
        unit="states",
        work=batch * (steps + 1),
        threads=threads,
        error=relative_error(checked, orbit(CHECKED, steps)),
        limit=("bytes, streaming stores", 16),
    )


@pytest.mark.parametrize("method", ["auto", "canonical"])
def bench_one_long_orbit(measure, method):
    steps = measure.size(5_000_000, 1000)
    out = np.zeros((steps + 1, 2))
    checked = iterate(BODY, starts(1)[0], EPS, STEPS, method=method).omega
    measure(
        lambda: iterate(BODY, starts(1)[0], EPS, steps, method=method, out=out),
        table="one orbit",
        row=f'`iterate`, `method="{method}"`, reused memory',
        unit="states",
        work=steps + 1,
        threads=1,
        error=relative_error(checked, orbit(1, STEPS)[0]),
        limit=("bytes, streaming stores", 16),
    )
