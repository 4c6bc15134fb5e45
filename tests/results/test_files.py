"""Results in files, datasets and tables of pandas."""

import contextlib
import errno
import json
import os
import pickle
import zlib
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import xarray
from example_runs import BODY, RUNS, run_of
from systems import PREY

import suslov_fast as sf
from suslov_fast.results import schema
from suslov_fast.results.schema import FORMAT, OF_KIND


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.npz"


@pytest.mark.parametrize("name", RUNS)
def test_a_file_holds_all_of_a_run(name, path):
    run = run_of(name)
    run.save(path)
    again = sf.load(path)
    assert again == run
    assert again.body.to_dict() == run.body.to_dict()
    turns = run.attitude is not None
    kept = {column.name for column in schema.RUN if turns or column.when != "turns"}
    assert {*entries(path)} - {"about", "body", "eps"} == kept
    assert ("attitude" in run.to_xarray()) == turns
    assert os.listdir(path.parent) == [path.name]
    run.to_xarray().to_netcdf(path.with_suffix(".nc"))
    with xarray.open_dataset(path.with_suffix(".nc")) as data:
        np.testing.assert_array_equal(data.states.values, run.states)


@pytest.mark.parametrize("code", [errno.ENOSPC, None])
def test_what_interrupts_a_save_leaves_no_part_and_the_old_file(path, monkeypatch, code):
    run = run_of("one")
    run.save(path)

    def filled(file, **arrays):
        file.write(b"PK")
        raise KeyboardInterrupt if code is None else OSError(code, os.strerror(code))

    monkeypatch.setattr(np, "savez", filled)
    for target in (path, path.with_name("other.npz")):
        with pytest.raises((OSError, KeyboardInterrupt)):
            run.save(target, overwrite=True)
    assert os.listdir(path.parent) == [path.name]
    assert sf.load(path) == run


def test_existing_files(path):
    run = run_of("one")
    path.write_bytes(b"kept")
    with pytest.raises(FileExistsError, match=r"run\.npz"):
        run.save(path)
    assert path.read_bytes() == b"kept"
    run.save(os.fspath(path), overwrite=True)
    assert sf.load(path) == run
    for name in ("run.nc", "run", "run.zarr"):
        with pytest.raises(ValueError, match=r"^path.*\.npz"):
            run.save(path.with_name(name))
    with pytest.raises(FileNotFoundError, match=r"absent.+run\.npz"):
        run.save(path.parent / "absent" / "run.npz")
    with pytest.raises(FileNotFoundError):
        sf.load(path.with_name("absent.npz"))


def entries(path):
    with np.load(path) as file:
        return dict(file)


@pytest.mark.parametrize("change", [-1, 1])
def test_files_of_other_formats_are_refused(path, change):
    run_of("one").save(path)
    found = entries(path)
    about = str(found["about"]).replace(f'"format": {FORMAT}', f'"format": {FORMAT + change}')
    np.savez(path, **found | {"about": about.replace(sf.__version__, "7.8.9")})
    with pytest.raises(ValueError, match=rf"run\.npz .*{FORMAT + change}.*7\.8\.9"):
        sf.load(path)


def test_damaged_files(path):
    run_of("batch").save(path)
    whole = path.read_bytes()
    for cut in (0, 10, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:cut])
        with pytest.raises(ValueError, match=r"run\.npz "):
            sf.load(path)
    end = len(whole)
    for place in (*range(200, end // 2, 301), *range(end - 22, end)):  # those where entries begin
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 255]) + whole[place + 1 :])
        with contextlib.suppress(ValueError):
            assert sf.load(path) == run_of("batch")


FORCED = sf.Field(lambda x, a: (x[1], -a * x[0]), "q p", a=2.0)
ACTING = sf.Event("p", to=lambda x, a: (a, x[1]), direction=1), sf.Event(times=[1.0, np.nan])
SETTINGS = {"atol": 1e-12, "stiff": False, "max_step": 0.125, "derivatives": ("x0", "a")}
OF_EACH_KIND = {
    "Trajectories": lambda: sf.iterate(BODY, [[1.0, 0.5]] * 2, 0.1, 5, attitude=True),
    "Motion": lambda: sf.flow(FORCED, [1.0, 0.5], time=[0.5, 1.0], **SETTINGS),
    "Motion with changes": lambda: sf.flow(FORCED, [1.0, 0.5], time=3.0, events=ACTING),
    "Events": lambda: sf.crossings(FORCED, [1.0, 0.5], surface="p", time=5.0),
}


@pytest.mark.parametrize("kind", OF_EACH_KIND)
def test_results_and_their_copies_are_equal_and_read_only(kind, path):
    """Copies are made before events are read; arithmetic in place changes no number."""
    result = OF_EACH_KIND[kind]()
    copies = pickle.loads(pickle.dumps(result)), deepcopy(result), replace(result)
    result.save(path)
    for each in (*copies, result, sf.load(path)):
        assert (type(each), each) == (type(result), result)
        values = [getattr(each, name) for name in dir(each) if not name.startswith("_")]
        arrays = [value for value in values if isinstance(value, np.ndarray)]
        assert len(arrays) > 5
        for array in arrays:
            with pytest.raises(ValueError, match=r"read-only|output array"):
                array *= 2


@pytest.mark.parametrize("kind", OF_EACH_KIND)
def test_a_lost_or_renamed_entry_is_told(kind, path):
    """Renamed by a single bit in the directory of the archive, or everywhere."""
    result = OF_EACH_KIND[kind]()
    result.save(path)
    whole, found = path.read_bytes(), entries(path)
    columns = {column.name: column.type for column in OF_KIND[type(result).__name__]}
    types = {name: array.dtype for name, array in found.items() if array.dtype.kind != "U"}
    assert types == {name: columns.get(name, "float64") for name in types}  # also of eps
    for name in found:
        others = {key: array for key, array in found.items() if key != name}
        np.savez(path, **others)
        with pytest.raises(ValueError, match=rf"run\.npz .*\b{name}\b"):
            sf.load(path)
        np.savez(path, **others, **{f"{name}_": found[name]})
        with pytest.raises(ValueError, match=r"run\.npz "):
            sf.load(path)
        place = whole.rindex(f"{name}.npy".encode())
        for k in range(len(name)):
            flipped = bytes([whole[place + k] ^ 4])
            path.write_bytes(whole[: place + k] + flipped + whole[place + k + 1 :])
            with pytest.raises(ValueError, match=r"run\.npz "):
                sf.load(path)


@pytest.mark.skipif(os.name != "posix", reason="links of POSIX")
def test_overwriting_keeps_links(path):
    run, other = run_of("one"), run_of("batch")
    real = path.with_name("real.npz")
    run.save(real)
    path.symlink_to(real.name)
    other.save(path, overwrite=True)
    assert path.is_symlink()
    assert sf.load(real) == other
    with pytest.raises(FileExistsError, match=r"run\.npz"):
        run.save(path)
    real.unlink()  # the link now names a file that is yet to be made
    run.save(path)
    assert path.is_symlink()
    assert sf.load(real) == run
    assert sorted(os.listdir(path.parent)) == [real.name, path.name]


# ------------------------------------------------------------------------ the table of columns
# From these starts a failure after a pole, a pole, and neither.
STARTS = [[0.05, 0.25], [0.05, 0.05], [4.5, 5.0]]
NAMES = {column.name for column in schema.RUN if column.name != "_t0"}


def test_the_number_of_the_format_is_that_of_its_columns():
    """Who changes what files hold raises FORMAT, and writes both numbers here."""
    kept = {kind: [c[:3] + c[4:] for c in columns] for kind, columns in OF_KIND.items()}
    text = json.dumps([kept, schema.ARGUMENTS])
    assert (FORMAT, zlib.crc32(text.encode())) == (18, 2027691226)


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
    assert {column.name for column in schema.in_datasets("Trajectories")} == NAMES
    for column in (column for column in schema.in_datasets(kind) if not column.when):
        values, name = getattr(run, column.name), column.name
        dims = schema.dims_of(column, ("trajectory",))
        for others in (found[column.name], data[name].values):
            np.testing.assert_array_equal(others, values)
            assert others.dtype == column.type
        assert data[name].dims == dims
        assert not column.meaning or data[name].attrs["long_name"] == column.meaning


@pytest.mark.parametrize("kind", OF_KIND)
def test_no_parameter_has_the_name_of_a_column(kind):
    def orbit(name):
        field = sf.Field.from_equations(f"u' = {name}*u", **{name: 1.0})
        return sf.iterate(field, [1.0], 0.1, 1)  # some names are of runs alone

    for column in schema.in_datasets(kind):
        with pytest.raises(ValueError, match=f"{column.short}' clashes|parameters"):
            orbit(column.short)


# ---------------------------------------------------------------------------- tables of pandas
FAMILY = sf.Field(lambda x, k: (x[1], -k * x[0]), "q v", k=[1.0, 4.0])
PAIR = [[1.0, 0.0], [0.0, 2.0]]
TABLES = {
    "map": lambda: sf.iterate(FAMILY, PAIR, [0.1, 0.2], 30, save_every=10),
    "motion": lambda: sf.flow(FAMILY, PAIR, time=[0.5, 1.0, 2.0]),
    "crossings": lambda: sf.crossings(FAMILY, PAIR, surface="q", time=9.0),
    "one": lambda: sf.flow(FAMILY[0], [1.0, 0.0], time=[0.0, 1.0]),
    "body": lambda: sf.iterate(sf.Suslov3D(4, [1, 2], -0.5, -0.3), [1.0, 0.5], 0.1, 3),
}


@pytest.mark.parametrize("kind", TABLES)
def test_tables_have_a_row_for_each_state(kind):
    result = TABLES[kind]()
    table = result.to_dataframe()
    labels = [*result.names]
    assert table.shape[0] == result.states[..., 0].size
    assert [*table.columns[-2:]] == labels
    if kind == "crossings":
        np.testing.assert_array_equal(table[labels], result.states)
        np.testing.assert_array_equal(table.k, np.array([1.0, 4.0])[result.trajectory])
        return
    for number, rows in table.groupby("trajectory") if kind != "one" else [(0, table)]:
        of_one = ... if kind == "one" else (slice(None), number)
        np.testing.assert_array_equal(rows[labels], result.states[of_one])
        times = np.reshape(result.time, (len(result.states), -1))
        np.testing.assert_array_equal(rows.time, times[:, number % times.shape[1]])
    columns = {
        "map": ["n", "time", "k", "eps"],
        "motion": ["time", "k"],
        "body": ["n", "time", "I2"],
    }
    assert [*table.columns[:-2]] == ["trajectory", *columns[kind]] if kind in columns else ["time"]
