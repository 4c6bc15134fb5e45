"""Runs in files: nothing is lost, and nothing is half written."""

import errno
import os
import signal
import stat
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from test_trajectories import RUNS, assert_same_run, same

import suslov_fast as sf
from suslov_fast._runs import replacing as _replacing
from suslov_fast._runs.replacing import replacing

SUFFIXES = (".npz", ".nc", ".zarr")
RUN, OTHER = RUNS["everything"], RUNS["batch"]

posix = pytest.mark.skipif(os.name != "posix", reason="needs POSIX")


@pytest.fixture(params=SUFFIXES)
def suffix(request):
    if request.param != ".npz":
        pytest.importorskip("xarray")
        pytest.importorskip({".nc": "netCDF4", ".zarr": "zarr"}[request.param])
    return request.param


def parts(folder):
    return [path.name for path in folder.iterdir() if path.name.endswith(".part")]


@pytest.mark.parametrize("name", RUNS)
def test_nothing_is_lost(name, suffix, tmp_path):
    path = tmp_path / f"run{suffix}"
    assert RUNS[name].save(path) is None
    assert_same_run(RUNS[name], sf.Trajectories.load(path))
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_twice_is_once(suffix, tmp_path):
    """What was loaded is saved as it was."""
    first, second = tmp_path / f"a{suffix}", str(tmp_path / f"b{suffix}")
    RUN.save(first)
    sf.Trajectories.load(first).save(second)
    assert_same_run(RUN, sf.Trajectories.load(second))


def test_every_bit_of_nan(suffix, tmp_path):
    omega = RUN.omega.copy()
    omega.view(np.uint64)[-1, 0] = 0xFFF8_0000_DEAD_BEEF
    run = replace(RUN, omega=omega, _resume={})
    run.save(tmp_path / f"run{suffix}")
    assert same(sf.Trajectories.load(tmp_path / f"run{suffix}").omega, omega)


def test_in_another_process(suffix, tmp_path):
    path = tmp_path / f"run{suffix}"
    RUN.save(path)
    code = "import sys, suslov_fast as sf; print(sf.Trajectories.load(sys.argv[1]).omega.tolist())"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, path], capture_output=True, text=True
    )
    assert done.stderr == ""
    assert done.stdout == f"{RUN.omega.tolist()}\n"


def test_npz_needs_numpy_alone(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    RUN.save(tmp_path / "run.npz")
    assert_same_run(RUN, sf.Trajectories.load(tmp_path / "run.npz"))
    with np.load(tmp_path / "run.npz", allow_pickle=False) as plain:
        assert same(plain["omega"], RUN.omega)
        assert plain["I13"] == RUN.body.I13
        assert plain["method"] == "auto"


def test_what_xarray_opens(suffix, tmp_path):
    """Without a warning, and with the labels."""
    if suffix == ".npz":
        pytest.skip("not for xarray")
    xarray = pytest.importorskip("xarray")
    OTHER.save(tmp_path / f"run{suffix}")
    with xarray.open_dataset(tmp_path / f"run{suffix}") as data:
        assert (data.omega.sel(n=10, component="Omega2") == OTHER.omega[2, :, 1]).all()
        assert_same_run(OTHER, sf.Trajectories.from_xarray(data))


@pytest.mark.parametrize("library", ["xarray", "netCDF4", "zarr"])
def test_what_is_missing(library, tmp_path, monkeypatch):
    for name in (library, "h5netcdf") if library == "netCDF4" else (library,):
        monkeypatch.setitem(sys.modules, name, None)
    path = tmp_path / ("run.zarr" if library == "zarr" else "run.nc")
    for attempt in (RUN.save, sf.Trajectories.load):
        with pytest.raises(ImportError, match=r"got none: pip install 'suslov_fast\[xarray\]'"):
            attempt(path)
    assert list(tmp_path.iterdir()) == []


def test_either_library_for_netcdf(tmp_path, monkeypatch):
    pytest.importorskip("netCDF4")
    pytest.importorskip("h5netcdf")
    RUN.save(tmp_path / "a.nc")
    monkeypatch.setitem(sys.modules, "netCDF4", None)
    RUN.save(tmp_path / "b.nc")
    for name in ("a.nc", "b.nc"):
        assert_same_run(RUN, sf.Trajectories.load(tmp_path / name))


@pytest.mark.parametrize("name", ["run", "run.txt", "run.npz/", "npz", ".npz", ""])
def test_other_names(name, tmp_path):
    for attempt in (RUN.save, sf.Trajectories.load):
        with pytest.raises(ValueError, match=r"expected a name that ends in \.npz, \.nc, \.zarr"):
            attempt(name)


def test_names_that_are_none():
    for path in (3, None, b"run.npz"):
        for attempt in (RUN.save, sf.Trajectories.load):
            with pytest.raises(TypeError):
                attempt(path)


def test_no_such_file(suffix, tmp_path):
    with pytest.raises(FileNotFoundError):
        sf.Trajectories.load(tmp_path / f"missing{suffix}")


def test_files_of_something_else(suffix, tmp_path):
    path = tmp_path / f"other{suffix}"
    path.write_bytes(b"something else" * 100)
    with pytest.raises(ValueError, match=rf"other\{suffix}: expected a .*that Trajectories.save"):
        sf.Trajectories.load(path)


def test_arrays_of_something_else(suffix, tmp_path):
    path = tmp_path / f"other{suffix}"
    if suffix == ".npz":
        np.savez(path, omega=np.ones(3))
    else:
        xarray = pytest.importorskip("xarray")
        data = xarray.Dataset({"omega": ("x", np.ones(3))})
        if suffix == ".nc":
            data.to_netcdf(path)
        else:
            data.to_zarr(path, zarr_format=2)
    with pytest.raises(ValueError, match=rf"other\{suffix}: .*without"):
        sf.Trajectories.load(path)


def test_pickles_are_not_loaded(tmp_path):
    np.savez(tmp_path / "evil.npz", omega=np.array([print], dtype=object))
    with pytest.raises(ValueError, match=r"evil.npz: .*allow_pickle=False"):
        sf.Trajectories.load(tmp_path / "evil.npz")


def test_arrays_that_do_not_belong_together(tmp_path):
    path = tmp_path / "run.npz"
    RUN.save(path)
    with np.load(path) as archive:
        entries = dict(archive)
    for name, value, message in [
        ("omega", entries["omega"][:, :3], "omega: expected shape"),
        ("omega", entries["omega"].astype(np.float32), "and dtype float64, got"),
        ("status", entries["status"].astype(int), "and dtype int8, got"),
        ("n", entries["n"] + 1, "n: expected the saved steps of a run of 7 steps"),
        ("eps", np.ones(3), r"eps: expected a shape that broadcasts to \(5,\), got \(3,\)"),
        ("I1", np.ones(3), r"body: expected a shape that broadcasts to \(5,\), got \(3,\)"),
        ("I1", np.array(-1.0), "I1: expected positive"),
        ("attitude", entries["attitude"][1:], "attitude: expected shape"),
        ("steps", np.array(2**61), "n: expected the saved steps"),
        ("format", np.array(1), "expected a run in format 2, got format 1"),
        ("body", np.array("Euler"), "body: expected Suslov3D or SuslovND, got 'Euler'"),
    ]:
        np.savez(path, **{**entries, name: value})
        with pytest.raises(ValueError, match=message):
            sf.Trajectories.load(path)


def flipped(data, position):
    return data[:position] + bytes([data[position] ^ 4]) + data[position + 1 :]


def test_damage_is_found_or_harmless(suffix, tmp_path):
    """Any one bit flipped anywhere: an error of ours, or the same run."""
    path = tmp_path / f"run{suffix}"
    OTHER.save(path)
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    rng = np.random.default_rng(2)
    found = 0
    for file in files:
        data = file.read_bytes()
        low, high = 0, len(data)
        if suffix == ".nc":  # of damaged metadata, the HDF5 library itself may crash
            low = data.index(OTHER.omega.tobytes())
            high = low + OTHER.omega.nbytes
        for position in rng.integers(low, high, 3 if suffix == ".zarr" else 60):
            file.write_bytes(flipped(data, position))
            try:
                loaded = sf.Trajectories.load(path)
            except ValueError as error:
                found += str(path) in str(error)
            else:
                assert_same_run(OTHER, loaded)
        file.write_bytes(data)
    assert found > 10


def test_a_cut_file(suffix, tmp_path):
    path = tmp_path / f"run{suffix}"
    OTHER.save(path)
    file = path / "omega" / "0.0.0" if suffix == ".zarr" else path
    data = file.read_bytes()
    for length in (0, 10, len(data) // 2, len(data) - 1):
        file.write_bytes(data[:length])
        with pytest.raises(ValueError, match=f"run{suffix}: .*expected"):
            sf.Trajectories.load(path)


def test_memory_that_a_damaged_file_asks_for(tmp_path):
    """A header that asks for terabytes is damage, not a machine too small."""
    OTHER.save(tmp_path / "run.npz")
    data = (tmp_path / "run.npz").read_bytes()
    (tmp_path / "run.npz").write_bytes(
        data.replace(b"(5, 5, 2), }         ", b"(5, 5, 2000000000), }")
    )
    with pytest.raises(ValueError, match="damaged"):
        sf.Trajectories.load(tmp_path / "run.npz")


def test_a_failure_leaves_what_was_there(suffix, tmp_path, monkeypatch):
    path = tmp_path / f"run{suffix}"
    OTHER.save(path)

    def fail(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(_replacing, "_exchange", fail)
    with pytest.raises(KeyboardInterrupt):
        RUN.save(path)
    monkeypatch.undo()
    assert_same_run(OTHER, sf.Trajectories.load(path))
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    RUN.save(path)
    assert_same_run(RUN, sf.Trajectories.load(path))


def test_a_store_comes_back_if_its_successor_cannot_be_moved(tmp_path, monkeypatch):
    pytest.importorskip("zarr")
    path = tmp_path / "run.zarr"
    OTHER.save(path)
    rename, calls = os.rename, []

    def second_fails(source, target):
        calls.append(source)
        if len(calls) == 2:
            raise OSError(errno.EIO, "broken")
        rename(source, target)

    monkeypatch.setattr(_replacing, "os", SimpleNamespace(**vars(os) | {"rename": second_fails}))
    with pytest.raises(OSError, match="broken"):
        RUN.save(path)
    monkeypatch.undo()
    assert_same_run(OTHER, sf.Trajectories.load(path))


def killed_between(path, moment):
    """A process that is killed while it writes, after so many renamings."""
    code = (
        "import os, signal, sys, types, suslov_fast as sf\n"
        "from suslov_fast._runs import replacing as _replacing\n"
        "run = sf.Trajectories.load(sys.argv[1])\n"
        "count = 0\n"
        "def renaming(*names):\n"
        "    global count\n"
        f"    if count == {moment}: os.kill(os.getpid(), signal.SIGKILL)\n"
        "    count += 1\n"
        "    os.rename(*names)\n"
        "own = vars(os) | {'rename': renaming, 'replace': renaming}\n"
        "_replacing.os = types.SimpleNamespace(**own)\n"
        "run.save(sys.argv[1])\n"
    )
    done = subprocess.run([sys.executable, "-c", code, path], capture_output=True)
    assert done.returncode == -signal.SIGKILL


@posix
def test_what_a_killed_writer_left_is_removed(suffix, tmp_path):
    path, neighbour = tmp_path / f"run{suffix}", tmp_path / f"neighbour{suffix}"
    OTHER.save(path)
    killed_between(path, 0)
    assert len(parts(tmp_path)) == 1
    assert_same_run(OTHER, sf.Trajectories.load(path))
    RUN.save(neighbour)
    assert len(parts(tmp_path)) == 1, "that of another file is let alone"
    RUN.save(path)
    assert parts(tmp_path) == []
    assert_same_run(RUN, sf.Trajectories.load(path))


@posix
def test_a_store_lost_between_two_moves_comes_back(tmp_path):
    pytest.importorskip("zarr")
    path = tmp_path / "run.zarr"
    OTHER.save(path)
    killed_between(path, 1)
    assert not path.exists()
    with pytest.raises(ValueError, match="stop"), replacing(path, folder=True):
        raise ValueError("stop")
    assert_same_run(OTHER, sf.Trajectories.load(path))
    assert parts(tmp_path) == []


@posix
def test_two_writers_at_once(tmp_path):
    """The second does not take the first for dead; the last to end is what stays."""
    path = tmp_path / "run.npz"
    with replacing(path) as first:
        first.write_text("first")
        with replacing(path) as second:
            second.write_text("second")
        assert path.read_text() == "second"
        assert first.read_text() == "first"
    assert path.read_text() == "first"
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.npz"]


WRITE_OFTEN = """
import sys
from pathlib import Path
from suslov_fast._runs.replacing import replacing
for _ in range(30):
    with replacing(Path(sys.argv[1])) as new:
        new.write_text("x" * int(sys.argv[2]))
"""


@posix
def test_many_writers_at_once(tmp_path):
    path = tmp_path / "run.npz"
    writers = [
        subprocess.Popen([sys.executable, "-c", WRITE_OFTEN, str(path), str(length)])
        for length in (1, 1000)
    ]
    assert [writer.wait() for writer in writers] == [0, 0]
    assert len(path.read_text()) in (1, 1000)
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.npz"]


@posix
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o444])
def test_modes_are_kept(mode, suffix, tmp_path):
    if suffix == ".zarr" and mode == 0o444:
        pytest.skip("a folder must be entered")
    mode |= 0o700 if suffix == ".zarr" else 0
    path = tmp_path / f"run{suffix}"
    OTHER.save(path)
    path.chmod(mode)
    RUN.save(path)
    assert stat.S_IMODE(path.stat().st_mode) == mode
    assert_same_run(RUN, sf.Trajectories.load(path))


@posix
def test_the_mode_of_a_new_file_is_the_usual_one(suffix, tmp_path):
    before = os.umask(0o027)
    try:
        RUN.save(tmp_path / f"run{suffix}")
    finally:
        os.umask(before)
    usual = 0o750 if suffix == ".zarr" else 0o640
    assert stat.S_IMODE((tmp_path / f"run{suffix}").stat().st_mode) == usual


@posix
def test_links(suffix, tmp_path):
    (tmp_path / "there").mkdir()
    target, link = tmp_path / "there" / f"target{suffix}", tmp_path / f"link{suffix}"
    link.symlink_to(target)
    for run in (OTHER, RUN):  # when there is nothing yet, and when there is
        run.save(link)
        assert link.is_symlink()
        assert_same_run(run, sf.Trajectories.load(target))
    assert [entry.name for entry in (tmp_path / "there").iterdir()] == [target.name]


@posix
def test_a_hard_link_keeps_what_it_had(tmp_path):
    OTHER.save(tmp_path / "a.npz")
    os.link(tmp_path / "a.npz", tmp_path / "b.npz")
    RUN.save(tmp_path / "a.npz")
    assert_same_run(RUN, sf.Trajectories.load(tmp_path / "a.npz"))
    assert_same_run(OTHER, sf.Trajectories.load(tmp_path / "b.npz"))


@posix
def test_a_loop_of_links(suffix, tmp_path):
    path = tmp_path / f"loop{suffix}"
    path.symlink_to(path)
    with pytest.raises(OSError, match="got: Too many levels of symbolic links"):
        RUN.save(path)
    with pytest.raises(OSError, match="Too many levels of symbolic links"):
        sf.Trajectories.load(path)


@posix
def test_names_as_long_as_they_may_be(suffix, tmp_path):
    longest = os.pathconf(tmp_path, "PC_NAME_MAX")
    path = tmp_path / ("ü" * ((longest - 5) // 2) + suffix)
    RUN.save(path)
    RUN.save(path)
    assert_same_run(RUN, sf.Trajectories.load(path))
    with pytest.raises(OSError, match="got: File name too long"):
        RUN.save(tmp_path / ("x" * longest + suffix))


@posix
def test_names_that_are_no_text(tmp_path):
    path = os.fsdecode(os.fsencode(tmp_path) + b"/\xff\xfe.npz")
    RUN.save(path)
    assert_same_run(RUN, sf.Trajectories.load(path))


@posix
def test_where_nothing_can_be_written(suffix, tmp_path):
    (tmp_path / "file").touch()
    for folder in (tmp_path / "missing", tmp_path / "file"):
        with pytest.raises(OSError, match="expected a name in a folder that can be written to"):
            RUN.save(folder / f"run{suffix}")


@posix
def test_what_is_not_replaced(suffix, tmp_path):
    path = tmp_path / f"run{suffix}"
    os.mkfifo(path)
    with pytest.raises(OSError, match="got a FIFO"):
        RUN.save(path)
    path.unlink()
    path.mkdir()
    (path / "thesis.tex").touch()
    with pytest.raises(OSError, match=r"got a(nother)? folder"):
        RUN.save(path)
    assert (path / "thesis.tex").exists()
    if suffix == ".zarr":
        (path / "thesis.tex").unlink()
        path.rmdir()
        path.touch()
        with pytest.raises(OSError, match="expected the name of a Zarr store to write, got a file"):
            RUN.save(path)


@posix
def test_a_deleted_working_directory(tmp_path):
    code = (
        "import os, sys, suslov_fast as sf\n"
        "run = sf.iterate(sf.Suslov3D(1, 1, 1, 0), [.1, .2], .1, 3)\n"
        "os.mkdir('gone'); os.chdir('gone'); os.rmdir(os.getcwd())\n"
        "try: run.save('run.npz')\n"
        "except OSError as error: print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert "expected a name in a folder that can be written to, got: No such file" in done.stdout
    assert done.stderr == ""


def test_a_whole_archive(tmp_path):
    """Nothing but arrays lies in it."""
    RUN.save(tmp_path / "run.npz")
    with zipfile.ZipFile(tmp_path / "run.npz") as archive:
        assert archive.testzip() is None
        assert all(Path(name).suffix == ".npy" for name in archive.namelist())
