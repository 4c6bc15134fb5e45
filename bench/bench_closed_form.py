"""The closed form: one far state of many orbits, many states of one and of many."""

import numpy as np
import pytest
from problem import BODY, CHECKED, EPS, STEPS, motion, orbit, relative_error, starts
from results import Limit, Table

from suslov_fast import exact, flow

FAR = 10**6
STATES = 5_000_000


def bench_exact(measure, threads, set_threads):
    set_threads(threads)
    omega0 = starts(measure.size(65_536, 64))
    checked = exact(BODY, starts(CHECKED), EPS, STEPS)
    measure(
        lambda: exact(BODY, omega0, EPS, FAR),
        table=Table.JUMPS,
        key="exact",
        label="`exact`",
        unit="states",
        work=len(omega0),
        threads=threads,
        error=relative_error(checked, orbit(CHECKED, STEPS)[-1]),
    )


def bench_flow(measure, threads, set_threads):
    set_threads(threads)
    omega0 = starts(measure.size(65_536, 64))
    t = STEPS * EPS
    checked = flow(BODY, starts(CHECKED), t)
    measure(
        lambda: flow(BODY, omega0, t),
        table=Table.MOTION,
        key="flow",
        label="`flow`, the closed form",
        unit="trajectories",
        work=len(omega0),
        threads=threads,
        error=relative_error(checked, motion(CHECKED, t)),
    )


@pytest.mark.parametrize("function", [exact, flow])
def bench_progression_of_one(measure, function, all_threads, set_threads):
    """All states of one orbit, into new memory."""
    set_threads(all_threads)
    n = np.arange(measure.size(STATES, 1000) + 1)
    times, step_size, name = (n, [EPS], "n") if function is exact else (n * EPS, [], "times")
    error = None
    if function is exact:
        checked = exact(BODY, starts(1)[0], EPS, np.arange(STEPS + 1))
        error = relative_error(checked, orbit(1, STEPS)[:, 0])
    measure(
        lambda: function(BODY, starts(1)[0], *step_size, times),
        rounds=3,
        table=Table.FEW,
        key=function.__name__,
        label=f"`{function.__name__}` of equally spaced {name}, new memory",
        unit="states",
        work=len(n),
        threads=all_threads,
        error=error,
        limit=(Limit.STREAMING, 16),
        x=1,
    )


@pytest.mark.parametrize("step", [1, 100])
def bench_progression(measure, step, all_threads, set_threads):
    """Equally spaced states of many orbits, into new memory."""
    set_threads(all_threads)
    n = step * np.arange(measure.size(256, 16))
    omega0 = starts(measure.size(16_384, 16))
    measure(
        lambda: exact(BODY, omega0, EPS, n),
        rounds=3,
        table=Table.JUMPS,
        key=f"exact-progression-{step}",
        label=f"`exact`, 256 n in steps of {step}, of 16,384 orbits, new memory",
        unit="states",
        work=len(n) * len(omega0),
        threads=all_threads,
    )


@pytest.mark.parametrize("orbits", [1, 4096])
def bench_scattered(measure, orbits, all_threads, set_threads):
    """States at random n, into new memory."""
    set_threads(all_threads)
    rng = np.random.default_rng(1)
    n = rng.integers(-FAR, FAR, measure.size(1_000_000 // orbits, 16))
    omega0 = starts(measure.size(orbits, 16)) if orbits > 1 else starts(1)[0]
    measure(
        lambda: exact(BODY, omega0, EPS, n),
        rounds=3,
        table=Table.JUMPS,
        key=f"exact-scattered-{orbits}",
        label=f"`exact`, {1_000_000 // orbits:,} scattered n of {orbits:,} orbit"
        + "s" * (orbits > 1)
        + ", new memory",
        unit="states",
        work=len(n) * omega0.size // 2,
        threads=all_threads,
    )
