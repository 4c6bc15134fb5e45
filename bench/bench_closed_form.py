"""The closed form: one far state of many trajectories, many states of one."""

import numba
import numpy as np
import pytest
from problem import BODY, CHECKED, EPS, STEPS, motion, orbit, relative_error, starts

from suslov_fast import exact, flow

FAR = 10**6


@pytest.fixture
def numba_threads(threads):
    """`exact` and `flow` run on the threads that Numba is set to."""
    before = numba.get_num_threads()
    numba.set_num_threads(threads)
    yield
    numba.set_num_threads(before)


@pytest.mark.usefixtures("numba_threads")
def bench_exact(measure, threads):
    omega0 = starts(measure.size(65_536, 64))
    checked = exact(BODY, starts(CHECKED), EPS, STEPS)
    measure(
        lambda: exact(BODY, omega0, EPS, FAR),
        table="jumps",
        row="**suslov_fast**, `exact`",
        unit="jumps",
        work=len(omega0),
        threads=threads,
        error=relative_error(checked, orbit(CHECKED, STEPS)[:, -1]),
    )


@pytest.mark.usefixtures("numba_threads")
def bench_flow(measure, threads):
    omega0 = starts(measure.size(65_536, 64))
    t = STEPS * EPS
    checked = flow(BODY, starts(CHECKED), t)
    measure(
        lambda: flow(BODY, omega0, t),
        table="motion",
        row="**suslov_fast**, `flow`, the closed form",
        unit="trajectories",
        work=len(omega0),
        threads=threads,
        error=relative_error(checked, motion(CHECKED, t)),
    )


@pytest.mark.usefixtures("numba_threads")
def bench_dense_orbit(measure, threads):
    """All states of one trajectory, into new memory."""
    n = np.arange(measure.size(5_000_000, 1000) + 1)
    omega0 = starts(1)[0]
    checked = exact(BODY, omega0, EPS, np.arange(STEPS + 1))
    measure(
        lambda: exact(BODY, omega0, EPS, n),
        table="one orbit",
        row="`exact` of all n, new memory",
        unit="states",
        work=len(n),
        threads=threads,
        error=relative_error(checked, orbit(1, STEPS)[0]),
        limit=("bytes, streaming stores", 16),
    )
