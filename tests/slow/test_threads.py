"""Every function by one thread and by several."""

import pytest
from test_promises import check_threads, every_case


@pytest.mark.compiled
@every_case
def test_threads(rng, monkeypatch, name, kind):
    check_threads(rng, monkeypatch, name, kind)
