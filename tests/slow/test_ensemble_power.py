"""Many power cuts of every kind of run."""

import pytest
from test_ensemble_power import RUNS, cut_again_and_again


@pytest.mark.parametrize("seed", range(10, 22))
@pytest.mark.parametrize("kind", RUNS)
def test_power_cuts_again_and_again(tmp_path, monkeypatch, kind, seed):
    assert cut_again_and_again(kind, tmp_path, monkeypatch, seed, 10) > 0
