"""Runs in files: exact round trips, atomic writes, and no execution of code from a file."""

import os
import stat
import sys
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest
from test_trajectories import RUNS, assert_same_run, run_of, same

import suslov_fast as sf
from suslov_fast._engine import memory
from suslov_fast._runs import files

# No body has the I3 of some runs of the scheme in three components.
pytestmark = pytest.mark.filterwarnings("ignore:I3")
posix = pytest.mark.skipif(os.name != "posix", reason="needs POSIX")


@pytest.fixture
def path(tmp_path):
    run_of("batch").save(tmp_path / "run.npz")
    return tmp_path / "run.npz"


def altered(path, **changes):
    """Rewrite a .npz file with changed entries, and without those that are None."""
    with np.load(path) as archive:
        entries = dict(archive) | changes
    np.savez(path, **{name: value for name, value in entries.items() if value is not None})


def refused(path, message, error=ValueError):
    with pytest.raises(error, match=message):
        sf.Trajectories.load(path)


@pytest.mark.parametrize("name", RUNS)
@pytest.mark.sampled(20)
def test_round_trip_and_continuation(name, tmp_path):
    """Save, load and extend runs of every map, with and without an orientation.

    An extended run may replace the file that the run was loaded from.
    """
    run, path = run_of(name), tmp_path / "run.npz"
    assert run.save(path) is None
    loaded = sf.Trajectories.load(path)
    assert_same_run(run, loaded)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    further = loaded.extend(5, on_singular="ignore")
    assert_same_run(run.extend(5, on_singular="ignore"), further)
    further.save(path, overwrite=True)
    assert_same_run(further, sf.Trajectories.load(path))


def test_npz_needs_numpy_alone(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    run_of("turning").save(tmp_path / "run.npz")
    assert_same_run(run_of("turning"), sf.Trajectories.load(tmp_path / "run.npz"))
    with np.load(tmp_path / "run.npz", allow_pickle=False) as plain:
        assert same(plain["omega"], run_of("turning").omega)
        assert plain["I13"] == run_of("turning").body.I13
        assert plain["method"] == "auto"


@pytest.mark.parametrize(
    "name", ["run", "run.nc", "run.zarr", "run.npz/", ".npz", "", 3, None, b"run.npz"]
)
def test_bad_names(name):
    error = ValueError if isinstance(name, str) else TypeError
    for attempt in (run_of("turning").save, sf.Trajectories.load):
        with pytest.raises(error, match=r"path: expected (a string|a name that ends in \.npz)"):
            attempt(name)


def test_other_files(tmp_path):
    path = tmp_path / "other.npz"
    refused(path, "other", FileNotFoundError)
    path.write_bytes(b"something else" * 100)
    refused(path, r"other\.npz: expected a \.npz file that Trajectories\.save wrote, got")
    np.savez(path, omega=np.ones(3))
    refused(path, r"other\.npz: expected a run of this package, got other arrays")


@posix
def test_pipes_and_devices_are_not_read(tmp_path):
    """Reading these would not end, or fill the memory."""
    os.mkfifo(tmp_path / "pipe.npz")
    (tmp_path / "link.npz").symlink_to("/dev/zero")
    (tmp_path / "folder.npz").mkdir()
    for name in ("pipe", "link", "folder"):
        refused(tmp_path / f"{name}.npz", rf"{name}\.npz: expected a file, got")


def test_a_run_larger_than_memory(path, tmp_path, monkeypatch):
    """Memory is tested before the arrays are read."""
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        np.save(tmp_path / "bomb.npy", np.zeros(10**7))
        archive.write(tmp_path / "bomb.npy", "bomb.npy")
    monkeypatch.setattr(memory, "available", lambda: 2**26 + 10**6)
    monkeypatch.setattr(np.lib.format, "read_array", None)
    refused(path, "the run in this file is too large", MemoryError)


@pytest.mark.parametrize(("number", "version"), [(1, "0.2.0"), (4, "0.4.0")])
def test_files_of_older_versions(path, number, version):
    altered(path, format=np.array(number), version=np.array(version), map=None)
    refused(path, rf"run\.npz: .*of suslov_fast {version}: runs of older versions cannot be read")


ENTRIES = [
    ("omega", lambda run: run.omega[:, :3], "omega: expected shape"),
    ("omega", lambda run: run.omega.astype(np.float32), "omega: expected dtype float64, got"),
    ("omega", lambda run: run.omega[..., :1], "expected shape"),
    ("omega", None, "without omega"),
    ("method", None, "expected the arrays of a run, got none named 'method'"),
    ("status", lambda run: run.status.astype(int), "status: expected dtype int8, got"),
    (
        "method",
        np.array("rank2"),
        "method: expected one of 'auto', 'canonical', 'ds2', got 'rank2'",
    ),
    ("eps", np.array(np.inf), "eps: expected finite real numbers, got inf"),
    ("eps", np.array([1, 2, np.nan, 3, 4.0]), r"eps: expected finite .* nan at index \(2,\)"),
    ("n", lambda run: run.n + 1, "n: expected the saved steps of a run of 7 steps"),
    ("n", np.arange(3), "n: expected shape"),
    ("eps", np.ones(3), r"eps: expected a shape that broadcasts to \(5,\)"),
    ("I1", np.ones(3), r"I1: expected a shape that broadcasts to \(5,\)"),
    ("I1", np.array(-1.0), "I1: expected a positive"),
    ("attitude", lambda run: run.attitude[1:], "attitude: expected shape"),
    ("resume/state", np.ones((2, 4)), "resume/state: expected shape"),
    ("steps", np.array(2**61), "expected shape"),
    ("steps", np.array(-1), "steps: expected an integer of at least 0, got -1"),
    ("steps", np.array("7"), "steps: expected an integer of at least 0, got '7'"),
    ("save_every", np.array(0), "save_every: expected an integer of at least 1, got 0"),
    ("map", np.array("Euler"), "map: expected suslov3d or .*, got 'Euler'"),
    ("map", np.array("suslov_nd"), "expected a run of the map suslov_nd, got one without J, I"),
    (
        "format",
        np.array(6),
        "format: expected 5, that of this version, got 6, of suslov_fast [^:]*$",
    ),
    ("omega", np.array([print], dtype=object), "got another file, or a damaged one"),
]


@pytest.mark.parametrize(("name", "value", "message"), ENTRIES)
def test_inconsistent_entries(name, value, message, tmp_path):
    path = tmp_path / "run.npz"
    run_of("turning").save(path)
    altered(path, **{name: value(run_of("turning")) if callable(value) else value})
    refused(path, rf"run.npz: .*{message}")


def test_damage_is_found_or_harmless(path):
    """With any bit flipped, `load` raises an error that names the file, or returns the same run."""
    rng, found = np.random.default_rng(2), 0
    data = path.read_bytes()
    for position in rng.integers(0, len(data), 60):
        flipped = bytearray(data)
        flipped[position] ^= 4
        path.write_bytes(flipped)
        try:
            loaded = sf.Trajectories.load(path)
        except ValueError as error:
            found += str(path) in str(error)
        else:
            assert_same_run(run_of("batch"), loaded)
    assert found > 10


def test_a_cut_file(path):
    data = path.read_bytes()
    for length in (0, len(data) // 2, len(data) - 1):
        path.write_bytes(data[:length])
        refused(path, r"run\.npz: .*expected")


def test_a_failed_write_keeps_the_old_file(path, tmp_path, monkeypatch):
    def fail(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(files, "os", SimpleNamespace(**vars(os) | {"replace": fail}))
    with pytest.raises(KeyboardInterrupt):
        run_of("turning").save(path, overwrite=True)
    monkeypatch.undo()
    assert_same_run(run_of("batch"), sf.Trajectories.load(path))
    with pytest.raises(
        FileExistsError, match=r"the name of a new file, or overwrite=True, .*run\.npz"
    ):
        run_of("turning").save(path)
    assert_same_run(run_of("batch"), sf.Trajectories.load(path))
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    with pytest.raises(TypeError, match="overwrite: expected bool, got str"):
        run_of("turning").save(path, overwrite="no")
    run_of("turning").save(path, overwrite=True)
    assert_same_run(run_of("turning"), sf.Trajectories.load(path))


@posix
def test_modes(tmp_path):
    """A new file has the usual mode, and a replaced file keeps its mode."""
    path = tmp_path / "run.npz"
    before = os.umask(0o027)
    try:
        run_of("turning").save(path)
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    for mode in (0o600, 0o444):
        path.chmod(mode)
        run_of("batch").save(path, overwrite=True)
        assert stat.S_IMODE(path.stat().st_mode) == mode
    assert_same_run(run_of("batch"), sf.Trajectories.load(path))


@posix
def test_links(tmp_path):
    (tmp_path / "there").mkdir()
    target, link = tmp_path / "there" / "target.npz", tmp_path / "link.npz"
    link.symlink_to(target)
    for run in (run_of("batch"), run_of("turning")):  # a missing target, then an existing one
        run.save(link, overwrite=target.exists())
        assert link.is_symlink()
        assert_same_run(run, sf.Trajectories.load(target))
    assert [entry.name for entry in (tmp_path / "there").iterdir()] == [target.name]


@posix
def test_other_paths_are_not_replaced(tmp_path):
    path = tmp_path / "run.npz"

    def unwritable(message, path=path):
        with pytest.raises(OSError, match=message):
            run_of("turning").save(path)

    (tmp_path / "file").touch()
    for folder in (tmp_path / "missing", tmp_path / "file"):
        unwritable("expected a name in a folder that can be written to", folder / path.name)
    os.mkfifo(path)
    unwritable("neither a file")
    path.unlink()
    path.mkdir()
    (path / "thesis.tex").touch()
    unwritable("got a folder")
    assert (path / "thesis.tex").exists()
