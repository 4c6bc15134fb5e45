"""Every function by one thread and by several."""

import pytest
import test_nd_auto
from test_promises import check_threads, every_case

from suslov_fast._engine import threads

pytestmark = pytest.mark.compiled


@every_case
def test_threads(rng, monkeypatch, name, kind):
    check_threads(rng, monkeypatch, name, kind)


@pytest.mark.parametrize("m", [2, 4])
def test_parts(rng, monkeypatch, m):
    monkeypatch.setattr(threads, "CROSSOVER", 1)  # serial within one block
    test_nd_auto.test_parts(rng, monkeypatch, m)
