import sys

import numpy as np
import pytest

import suslov_fast as sf


@pytest.fixture
def sweep(rng):
    body = sf.Suslov3D(rng.uniform(1, 2, (3, 1)), 1, 0.3, 0.2)
    return sf.iterate(body, [1, 0.5], [0.1, 0.2], 20, save_every=4)


def test_first_integral_and_energy(sweep):
    for values in (sweep.first_integral(), sweep.energy()):
        assert values.shape == (3, 2, 6)
    one = sf.Suslov3D(sweep.body.I1[2, 0], 1, 0.3, 0.2)
    assert (sweep.first_integral()[2, 1] == sf.first_integral(one, sweep.omega[2, 1], 0.2)).all()
    assert (sweep.energy()[2, 1] == sf.energy(one, sweep.omega[2, 1])).all()
    assert np.ptp(sweep.first_integral(), axis=-1).max() < 1e-15


def test_failed_states_have_no_integral(unit):
    result = sf.iterate(unit, [[1.0, -3.0], [0.3, 0.1]], 1, 5, on_singular="ignore")
    F = result.first_integral()
    assert np.isnan(F[0, 1:]).all()
    assert np.isfinite(F[1]).all()
    assert np.isnan(result.energy()[0, 1:]).all()


def test_to_xarray(body, rng):
    omega = rng.normal(size=(5, 2))
    result = sf.iterate(body, omega, 0.2, 20, save_every=5)
    data = result.to_xarray()
    assert data.omega.dims == ("trajectory", "n", "component")
    assert (data.omega.sel(n=10, component="Omega2") == result.omega[:, 2, 1]).all()
    assert (data.t == result.t).all()
    assert (data.final.values == result.final).all()
    assert (data.status == 0).all()
    assert (data.I13 == -0.5).all()


def test_to_xarray_of_a_sweep(sweep):
    data = sweep.to_xarray()
    assert data.omega.dims == ("batch_0", "batch_1", "n", "component")
    assert data.t.dims == ("batch_0", "batch_1", "n")
    assert (data.eps.values == [[0.1, 0.2]] * 3).all()
    assert (data.t[1, 1] == sweep.t[1]).all()


def test_to_xarray_of_one_trajectory(body):
    data = sf.iterate(body, [1, 0.5], 0.2, 3).to_xarray()
    assert data.omega.dims == ("n", "component")
    assert float(data.eps) == 0.2


def test_to_xarray_without_xarray(body, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ImportError, match=r"pip install 'suslov_fast\[xarray\]'"):
        sf.iterate(body, [1, 0.5], 0.2, 3).to_xarray()
