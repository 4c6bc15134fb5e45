"""Every function with one thread and with several."""

import pytest
from test_promises import (
    assert_same_run,
    check_threads,
    cut_further,
    every_case,
    run,
    solved_and_others,
)

from suslov_fast._engine import threads

pytestmark = pytest.mark.compiled


@every_case
def test_threads(rng, monkeypatch, name, kind):
    check_threads(rng, monkeypatch, name, kind)


@pytest.mark.parametrize("m", [2, 4])
def test_hard_problems(rng, monkeypatch, m):
    problem = solved_and_others(rng, 150, m)
    alone = run(*problem, 500, save_every=2, threads=1)
    monkeypatch.setattr(threads, "CROSSOVER", 1)  # serial within one block
    cut_further(monkeypatch)
    assert_same_run(run(*problem, 500, save_every=2), alone)
