"""The table of columns: each is in runs, files, datasets and stores, or in none of them."""

import json
import zlib

import numpy as np
import pytest
from systems import PREY

import suslov_fast as sf
from suslov_fast.results import schema

# From these starts a failure after a pole, a pole, and neither.
STARTS = [[0.05, 0.25], [0.05, 0.05], [4.5, 5.0]]
NAMES = {column.name for column in schema.RUN}


def test_the_number_of_the_format_is_that_of_its_columns():
    """Who changes what files hold raises FORMAT, and writes both numbers here."""
    kept = {kind: [c[:3] + c[4:] for c in columns] for kind, columns in schema.OF_KIND.items()}
    text = json.dumps([kept, schema.ARGUMENTS])
    assert (schema.FORMAT, zlib.crc32(text.encode())) == (17, 678905593)


def entries(path):
    with np.load(path) as file:
        return dict(file)


@pytest.mark.parametrize("kind", ["Trajectories", "Motion"])
def test_each_column_is_everywhere(tmp_path, kind):
    """The same values in a run, its file and its dataset, under one name."""
    if kind == "Trajectories":
        run = sf.iterate(PREY, STARTS, 0.1, 60, save_every=20, on_singular="ignore")
        assert (run.first_pole >= 0).any()
    else:
        escaping = sf.Field(lambda x: (x[0] ** 2, -x[1]), "x y")
        with pytest.warns(sf.IntegrationWarning):
            run = sf.flow(escaping, STARTS, time=[2.0, 0.0, 6.0])
    assert (run.status < 0).any()
    run.save(tmp_path / "run.npz")
    assert sf.load(tmp_path / "run.npz") == run
    found, data = entries(tmp_path / "run.npz"), run.to_xarray()
    public = schema.in_datasets(kind)
    assert {column.name for column in schema.in_datasets("Trajectories")} == NAMES - {"attitude"}
    for column in public:
        values, name = getattr(run, column.name), column.name
        dims = schema.dims_of(column, ("trajectory",))
        for others in (found[column.name], data[name].values):
            np.testing.assert_array_equal(others, values)
            assert others.dtype == column.type
        assert data[name].dims == dims
        assert not column.meaning or data[name].attrs["long_name"] == column.meaning


def test_columns_of_orientations(tmp_path):
    body = sf.SuslovND(J=[1, 2, 3], I=[0.1, 0.2, 0.3])
    for turns in (False, True):
        run = sf.iterate(body, [1.0, 0.5, 0.2], 0.1, 5, attitude=turns)
        run.save(tmp_path / "run.npz", overwrite=True)
        found = {*entries(tmp_path / "run.npz")} - {"about", "body", "eps"}
        assert found == {c.name for c in schema.RUN if turns or c.when != "turns"}
        assert ("attitude" in run.to_xarray()) == turns
        assert sf.load(tmp_path / "run.npz") == run
