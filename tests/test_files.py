"""Runs in files."""

import contextlib
import json
import os
import sys
import zipfile

import numpy as np
import pytest
import xarray
from test_trajectories import RUNS, run_of

import suslov_fast as sf
from suslov_fast.runs import storage


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.npz"


@pytest.mark.parametrize("name", RUNS)
def test_a_file_holds_all_of_a_run(name, path):
    run = run_of(name)
    run.save(path)
    again = sf.Trajectories.load(path)
    assert again == run
    assert again.body.to_dict() == run.body.to_dict()
    assert again.extend(3, on_singular="ignore") == run.extend(3, on_singular="ignore")
    assert os.listdir(path.parent) == [path.name]
    run.to_xarray().to_netcdf(path.with_suffix(".nc"))
    with xarray.open_dataset(path.with_suffix(".nc")) as data:
        np.testing.assert_array_equal(data[run.map.variable].values, run.states)


def test_existing_files(path):
    run = run_of("one")
    path.write_bytes(b"kept")
    with pytest.raises(FileExistsError, match=r"run\.npz"):
        run.save(path)
    assert path.read_bytes() == b"kept"
    run.save(os.fspath(path), overwrite=True)
    assert sf.Trajectories.load(path) == run
    for name in ("run.nc", "run", "run.zarr"):
        with pytest.raises(ValueError, match=r"^path: .*\.npz.*ensemble"):
            run.save(path.with_name(name))
    with pytest.raises(FileNotFoundError, match=r"absent.run\.npz"):
        run.save(path.parent / "absent" / "run.npz")
    with pytest.raises(FileNotFoundError):
        sf.Trajectories.load(path.with_name("absent.npz"))


def test_an_interrupted_save_leaves_nothing(path, monkeypatch):
    def interrupted(file, **arrays):
        file.write(b"some")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_of("one").save(path)
    assert os.listdir(path.parent) == []


def entries(path):
    with np.load(path) as file:
        return dict(file)


def test_files_of_others(path):
    """A file that lacks an array, or is of another version."""
    run_of("one").save(path)
    found = entries(path)
    about, needed = str(found["about"]), ("states", "about", "body", "status", "eps")
    others = [{name: found[name] for name in found if name != lost} for lost in needed]
    others.append(found | {"about": about.replace('"format": 9', '"format": 8')})
    others.append({"format": 5, "version": "0.5.0", "omega": np.zeros(3)})
    for each in others:
        np.savez(path, **each)
        with pytest.raises(ValueError, match=r"run\.npz: "):
            sf.Trajectories.load(path)
    with pytest.raises(ValueError, match=r"0\.5\.0"):
        sf.Trajectories.load(path)


def test_damaged_files(path):
    run_of("batch").save(path)
    whole = path.read_bytes()
    for cut in (0, 10, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:cut])
        with pytest.raises(ValueError, match=r"run\.npz: "):
            sf.Trajectories.load(path)
    for place in range(200, len(whole) // 2, 301):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 255]) + whole[place + 1 :])
        with contextlib.suppress(ValueError):
            assert sf.Trajectories.load(path) == run_of("batch")


def test_an_entry_that_no_run_has_is_not_read(path):
    """One of 1 MB may need gigabytes, and has no header that NumPy reads."""
    run_of("batch").save(path)
    with zipfile.ZipFile(path, "a") as file:
        file.writestr("junk.npy", b"no array")
    assert sf.Trajectories.load(path) == run_of("batch")


@pytest.mark.parametrize("name", ["turning", "last", "field"])
def test_arrays_of_other_types_and_shapes(path, name):
    """They are refused by their headers, before they are read."""
    run_of(name).save(path)
    found = entries(path)
    for array in found.keys() - {"about", "body"}:
        values = found[array]
        others = [values.astype(np.float32), values.astype(complex)]
        if values.ndim:  # one step size may have any axes
            others.append(values[..., np.newaxis])
        for other in others:
            np.savez(path, **(found | {array: other}))
            with pytest.raises(ValueError, match=r"run\.npz: .*: expected|broadcast"):
                sf.Trajectories.load(path)
    changes = [
        ("steps", -1),
        ("steps", "6"),
        ("save_every", 0),
        ("method", "gauss"),
        ("map", "other"),
    ]
    about = json.loads(str(found["about"]))
    for key, value in changes:
        if about[key] != value:
            np.savez(path, **(found | {"about": json.dumps(about | {key: value})}))
            with pytest.raises(ValueError, match=r"run\.npz: "):
                sf.Trajectories.load(path)


def test_parts_of_killed_processes_are_deleted(path):
    """Those of processes that live are not: they hold a lock."""
    left = path.with_name(".run.npz.0123abcd.part")
    left.write_bytes(b"half")
    other = path.with_name(".other.npz.0123abcd.part")
    other.touch()
    new, file = storage._part(path)
    with file:
        assert not left.exists()
        run_of("one").save(path)
        assert new.exists() or sys.platform == "win32"
    run_of("one").save(path, overwrite=True)
    assert sorted(os.listdir(path.parent)) == [other.name, path.name]
