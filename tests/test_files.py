"""Runs in files."""

import contextlib
import os

import numpy as np
import pytest
import xarray
from test_trajectories import RUNS, run_of

import suslov_fast as sf


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
