"""Orientations: carried along by `iterate`, and found along states that are there."""

import pytest
from problem import BODY, EPS, problem_nd, starts
from results import Table
from revision import TIME_FIRST, iterate

import suslov_fast

PROBLEMS = {3: (BODY, starts, EPS), 4: (problem_nd(3, 1)[0], lambda B: problem_nd(3, B)[1], 0.1)}


@pytest.mark.parametrize("saved", ["last", "all"])
@pytest.mark.parametrize("carried", [False, True])
@pytest.mark.parametrize("n", PROBLEMS)
def bench_iterate(measure, n, carried, saved, all_threads):
    """The map alone, and with the orientation, which is what the difference costs."""
    if carried and not TIME_FIRST:
        pytest.skip("this version carries no orientation along")
    body, make, eps = PROBLEMS[n]
    omega0, steps = make(measure.size(4096, 16)), measure.size(100, 5)
    options = {"method": "canonical" if n == 3 else "rank2", "threads": all_threads}
    options |= {"save_every": None if saved == "last" else 1}
    options |= {"attitude": True} if carried else {}
    measure(
        lambda: iterate(body, omega0, eps, steps, **options),
        rounds=5,
        table=Table.ATTITUDE,
        key=f"{saved}-{'with' if carried else 'without'}",
        label=f"`iterate`, {saved} states, "
        + ("and orientations" if carried else "no orientations"),
        unit="steps",
        work=len(omega0) * steps,
        threads=all_threads,
        x=n,
    )


@pytest.mark.parametrize("n", PROBLEMS)
def bench_along_states(measure, n, all_threads, set_threads):
    set_threads(all_threads)
    body, make, eps = PROBLEMS[n]
    omega0, steps = make(measure.size(4096, 16)), measure.size(100, 5)
    states = suslov_fast.iterate(body, omega0, eps, steps).omega
    measure(
        lambda: suslov_fast.attitude(body, states, eps),
        rounds=3,
        table=Table.ATTITUDE,
        key="along",
        label="`attitude` of all states",
        unit="steps",
        work=len(omega0) * steps,
        threads=all_threads,
        x=n,
    )
