"""The table of columns: each is in runs, files, datasets and stores, or in none of them."""

import json
from dataclasses import fields

import numpy as np
import pytest
from systems import PREY

import suslov_fast as sf
from suslov_fast.core.motion.engine import Settings
from suslov_fast.runs import columns, results

pytest.importorskip("zarr")
# From these starts a failure after a pole, a pole, and neither.
STARTS = [[0.05, 0.25], [0.05, 0.05], [4.5, 5.0]]
NAMES = {column.name for column in columns.RUN if column.is_public}


def test_results_of_motions_have_the_settings():
    assert [field.name for field in fields(results.OfMotion)] == [*Settings._fields]


def entries(path):
    with np.load(path) as file:
        return dict(file)


@pytest.mark.parametrize("kind", ["Trajectories", "Motion"])
def test_each_column_is_everywhere(tmp_path, kind):
    """The same values in a run, its file, its dataset and a store, under one name."""
    store = tmp_path / "run.zarr"
    if kind == "Trajectories":
        run = sf.iterate(PREY, STARTS, 0.1, 60, save_every=20, on_singular="ignore")
        stored = sf.ensemble(PREY, STARTS, 0.1, 60, save_every=20, store=store, chunk=1)
        assert (run.first_pole >= 0).any()
    else:
        escaping = sf.QuadraticField.from_function(lambda x: (x[0] ** 2, -x[1]), "x y")
        with pytest.warns(sf.PoleWarning):
            run = sf.flow(escaping, STARTS, time=[2.0, 0.0, 6.0])
        stored = sf.ensemble(escaping, STARTS, time=[2.0, 0.0, 6.0], store=store, chunk=1)
    assert (run.status < 0).any()
    run.save(tmp_path / "run.npz")
    assert sf.load(tmp_path / "run.npz") == run
    found, data = entries(tmp_path / "run.npz"), run.to_xarray()
    public = columns.in_stores(kind)
    assert {column.name for column in columns.in_stores("Trajectories")} == NAMES - {"attitude"}
    for column in public:
        values, name = getattr(run, column.name), column.name.replace("states", "x")
        dims = columns.dims_of(column, ("trajectory",))
        for others in (found[column.name], data[name].values, stored[name].values):
            np.testing.assert_array_equal(others, values)
            assert others.dtype == column.type
        assert data[name].dims == stored[name].dims == dims
        assert not column.meaning or stored[name].attrs["long_name"] == column.meaning


def test_columns_of_orientations(tmp_path):
    body = sf.SuslovND([1, 2, 3], [0.1, 0.2, 0.3])
    for turns in (False, True):
        run = sf.iterate(body, [1.0, 0.5, 0.2], 0.1, 5, attitude=turns)
        run.save(tmp_path / "run.npz", overwrite=True)
        found = {*entries(tmp_path / "run.npz")} - {"about", "body", "eps"}
        assert found == {c.name for c in columns.RUN if turns or c.when != "turns"}
        assert ("attitude" in run.to_xarray()) == turns
        assert sf.load(tmp_path / "run.npz") == run


def test_stores_without_a_column_are_refused(tmp_path):
    body = sf.SuslovND([1, 2, 3], [0.1, 0.2, 0.3])
    sf.ensemble(body, [1.0, 0.5, 0.2], 0.1, 5, attitude=True, store=tmp_path / "runs.zarr")
    file = tmp_path / "runs.zarr" / "zarr.json"
    whole = json.loads(file.read_text())
    for name in NAMES - {"states"} | {"omega", "n", "component", "eps"}:
        changed = json.loads(json.dumps(whole))
        del changed["consolidated_metadata"]["metadata"][name]
        file.write_text(json.dumps(changed))
        with pytest.raises(ValueError, match=name):
            sf.open_ensemble(tmp_path / "runs.zarr")


@pytest.mark.parametrize("change", [-1, 1])
def test_stores_of_other_formats_are_refused(tmp_path, change):
    sf.ensemble(sf.Suslov3D(4, 1, -0.5, -0.3), [1.0, 0.5], 0.1, 5, store=tmp_path / "runs.zarr")
    file = tmp_path / "runs.zarr" / "zarr.json"
    whole = json.loads(file.read_text())
    whole["attributes"] |= {"format": columns.FORMAT + change, "version": "7.8.9"}
    file.write_text(json.dumps(whole))
    with pytest.raises(ValueError, match=rf"runs\.zarr .*{columns.FORMAT + change}.*7\.8\.9"):
        sf.open_ensemble(tmp_path / "runs.zarr")
