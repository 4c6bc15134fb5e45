"""Runs in files: exact round trips, atomic writes, and no execution of code from a file."""

import json
import os
import stat
import sys
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest
from test_trajectories import RUNS, assert_same_run, same

import suslov_fast as sf
from suslov_fast._runs import codecs
from suslov_fast._runs import replacing as _replacing

SUFFIXES = (".npz", ".nc", ".zarr")
posix = pytest.mark.skipif(os.name != "posix", reason="needs POSIX")


@pytest.fixture(params=SUFFIXES)
def suffix(request):
    if request.param != ".npz":
        pytest.importorskip("xarray")
        pytest.importorskip({".nc": "netCDF4", ".zarr": "zarr"}[request.param])
    return request.param


@pytest.fixture
def path(suffix, tmp_path):
    """A saved run of five trajectories."""
    RUNS["batch"].save(tmp_path / f"run{suffix}")
    return tmp_path / f"run{suffix}"


def altered(path, **changes):
    """Rewrite a .npz file with changed entries, and without those that are None."""
    with np.load(path) as archive:
        entries = dict(archive) | changes
    np.savez(path, **{name: value for name, value in entries.items() if value is not None})


def refused(path, message, error=ValueError):
    with pytest.raises(error, match=message):
        sf.Trajectories.load(path)


@pytest.mark.parametrize("name", RUNS)
@pytest.mark.sampled(36)
def test_round_trip_and_continuation(name, suffix, tmp_path):
    """Save, load and extend runs of every map, with and without an orientation, in every format.

    An extended run may replace the file that the run was loaded from.
    """
    run, path = RUNS[name], tmp_path / f"run{suffix}"
    assert run.save(path) is None
    loaded = sf.Trajectories.load(path)
    assert_same_run(run, loaded)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    further = loaded.extend(5, on_singular="ignore")
    assert_same_run(run.extend(5, on_singular="ignore"), further)
    further.save(path)
    assert_same_run(further, sf.Trajectories.load(path))


def test_npz_needs_numpy_alone(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    RUNS["turning"].save(tmp_path / "run.npz")
    assert_same_run(RUNS["turning"], sf.Trajectories.load(tmp_path / "run.npz"))
    with np.load(tmp_path / "run.npz", allow_pickle=False) as plain:
        assert same(plain["omega"], RUNS["turning"].omega)
        assert plain["I13"] == RUNS["turning"].body.I13
        assert plain["method"] == "auto"


@pytest.mark.parametrize("suffix", SUFFIXES[1:], indirect=True)
def test_xarray_opens_saved_runs(path):
    """xarray opens a saved run without a warning, with its labels."""
    xarray = pytest.importorskip("xarray")
    with xarray.open_dataset(path) as data:
        assert (data.omega.sel(n=10, component="Omega2") == RUNS["batch"].omega[2, :, 1]).all()
        assert_same_run(RUNS["batch"], sf.Trajectories.from_xarray(data), resume=False)
    with xarray.open_dataset(path, group="resume") as data:
        assert same(data.omega0.values, RUNS["batch"].omega[0])


@pytest.mark.parametrize("library", ["xarray", "netCDF4", "zarr"])
def test_missing_libraries(library, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)
    path = tmp_path / ("run.zarr" if library == "zarr" else "run.nc")
    for attempt in (RUNS["turning"].save, sf.Trajectories.load):
        with pytest.raises(ImportError, match=r"got none: pip install 'suslov_fast\[xarray\]'"):
            attempt(path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["run", "run.txt", "run.npz/", ".npz", "", 3, None, b"run.npz"])
def test_bad_names(name):
    error = ValueError if isinstance(name, str) else TypeError
    for attempt in (RUNS["turning"].save, sf.Trajectories.load):
        with pytest.raises(error, match=r"ends in \.npz, \.nc, \.zarr|path"):
            attempt(name)


def test_other_files(suffix, tmp_path):
    path = tmp_path / f"other{suffix}"
    message = rf"other\{suffix}: expected a .*that Trajectories.save"
    refused(path, "other", FileNotFoundError)
    path.write_bytes(b"something else" * 100)
    refused(path, message)
    path.unlink()
    if suffix == ".npz":
        np.savez(path, omega=np.ones(3))
    else:
        data = pytest.importorskip("xarray").Dataset({"omega": ("x", np.ones(3))})
        data.to_netcdf(path) if suffix == ".nc" else data.to_zarr(path, zarr_format=2)
    refused(path, message)


def test_files_of_version_0_2(suffix, path):
    """Files of version 0.2 have the format 1, as an entry or as an attribute of the dataset."""
    if suffix == ".npz":
        altered(path, format=np.array(1), version=np.array("0.2.0"), map=None)
    else:
        data = pytest.importorskip("xarray").open_dataset(path).load()
        data.close()
        data.attrs |= {"format": 1, "version": "0.2.0"}
        data.to_netcdf(path) if suffix == ".nc" else data.to_zarr(path, mode="w", zarr_format=2)
    refused(path, rf"run\{suffix}: .*runs of version 0\.2 cannot be read")


ENTRIES = [
    ("omega", lambda run: run.omega[:, :3], "omega: expected shape"),
    ("omega", lambda run: run.omega.astype(np.float32), "and dtype float64, got"),
    ("omega", lambda run: run.omega[..., :1], "expected shape"),
    ("omega", None, "without omega"),
    ("status", lambda run: run.status.astype(int), "and dtype int8, got"),
    ("n", lambda run: run.n + 1, "n: expected the saved steps of a run of 7 steps"),
    ("n", np.arange(3), "n: expected shape"),
    ("eps", np.ones(3), r"eps: expected a shape that broadcasts to \(5,\)"),
    ("I1", np.ones(3), r"I1: expected a shape that broadcasts to \(5,\)"),
    ("I1", np.array(-1.0), "I1: expected a positive"),
    ("attitude", lambda run: run.attitude[1:], "attitude: expected shape"),
    ("resume/state", np.ones((2, 4)), "resume/state: expected shape"),
    ("resume/R0", None, "attitude, resume/R0: expected both or none"),
    ("resume/evil", np.ones(2), "with resume/evil"),
    ("unknown", np.ones(2), "with unknown"),
    ("steps", np.array(2**61), "expected shape"),
    ("steps", np.array(-1), "steps, save_every: expected at least 0 and 1"),
    ("steps", np.array("7"), "steps: expected one int"),
    ("save_every", np.array(0), "steps, save_every: expected at least 0 and 1"),
    ("map", np.array("Euler"), "map: expected suslov3d or .*, got 'Euler'"),
    ("map", np.array("suslov_nd"), "expected a run of the map suslov_nd, got one without J, I"),
    ("format", np.array(4), "expected a run in format 3, got format 4"),
    ("omega", np.array([print], dtype=object), "omega.npy: an array of objects"),
]


@pytest.mark.parametrize(("name", "value", "message"), ENTRIES)
def test_inconsistent_entries(name, value, message, tmp_path):
    path = tmp_path / "run.npz"
    RUNS["turning"].save(path)
    altered(path, **{name: value(RUNS["turning"]) if callable(value) else value})
    refused(path, rf"run.npz: .*{message}")


def test_an_archive_that_would_fill_the_memory(tmp_path, monkeypatch):
    """Names and headers are checked before any array is decoded."""
    RUNS["turning"].save(tmp_path / "run.npz")
    np.save(tmp_path / "bomb.npy", np.zeros(10**7))
    with zipfile.ZipFile(tmp_path / "run.npz", "a", zipfile.ZIP_DEFLATED) as archive:
        archive.write(tmp_path / "bomb.npy", "bomb.npy")
    decoded, original = [], np.lib.format.read_array
    record = lambda *a, **k: decoded.append(original(*a, **k)) or decoded[-1]  # noqa: E731
    monkeypatch.setattr(np.lib.format, "read_array", record)
    refused(tmp_path / "run.npz", "with bomb")
    assert sum(array.nbytes for array in decoded) < 1000


class Bomb:
    """An object that runs code when it is unpickled."""

    def __reduce__(self):
        return os.mkdir, ("exploded",)


@pytest.mark.parametrize("codec", ["pickle", "json2", "msgpack2", "astype"])
def test_codecs_of_both_formats(codec):
    second = {"dtype": "<f8", "filters": [{"id": codec}], "compressor": {"id": "zlib"}}
    third = {"data_type": "float64", "codecs": [{"name": "bytes"}, {"name": f"numcodecs.{codec}"}]}
    shards = {"name": "sharding_indexed", "configuration": {"codecs": third["codecs"]}}
    for metadata in (second, third, {"data_type": "float64", "codecs": [shards]}):
        with pytest.raises(ValueError, match=f"omega: .* got codecs {codec}"):
            codecs._check("omega", metadata)
    text = {"dtype": "|O", "filters": [{"id": "vlen-utf8"}], "compressor": None}
    zstd = {"data_type": "float64", "codecs": [{"name": "bytes"}, {"name": "zstd"}]}
    for metadata in (text, zstd):
        codecs._check("omega", metadata)
    with pytest.raises(ValueError, match=r"omega: .* got objects"):
        codecs._check("omega", text | {"filters": None})


TEXT, EVIL = {"id": "vlen-utf8"}, {"id": "pickle", "protocol": 5}


@pytest.mark.parametrize(
    ("dtype", "filters", "compressor"),
    [("<f8", [EVIL], None), ("|O", [TEXT, EVIL], None), ("|O", [TEXT], EVIL)],
)
@pytest.mark.parametrize("where", ["omega", "n", "component", "stranger", "resume/state"])
@pytest.mark.sampled(4)
def test_code_in_a_store_is_not_run(where, dtype, filters, compressor, tmp_path, monkeypatch):
    pytest.importorskip("zarr")
    pickle = pytest.importorskip("numcodecs").Pickle()
    monkeypatch.chdir(tmp_path)
    RUNS["turning"].save("run.zarr")
    folder = tmp_path / "run.zarr" / where
    folder.mkdir(exist_ok=True)
    metadata = {"zarr_format": 2, "shape": [1], "chunks": [1], "dtype": dtype, "order": "C"}
    metadata |= {"filters": filters, "compressor": compressor, "fill_value": 0}
    (folder / ".zarray").write_text(json.dumps(metadata))
    (folder / "0").write_bytes(pickle.encode(np.array([Bomb()], dtype=object)))
    for known in (".zmetadata", "resume/.zmetadata"):
        (tmp_path / "run.zarr" / known).unlink(missing_ok=True)
    refused("run.zarr", r"run.zarr: .*pickle")
    assert not (tmp_path / "exploded").exists()


@pytest.mark.parametrize("codec", ["zlib", "zstd", "lz4"])
@pytest.mark.sampled(1)
def test_recompressed_stores(codec, tmp_path):
    xarray, numcodecs = pytest.importorskip("xarray"), pytest.importorskip("numcodecs")
    RUNS["turning"].save(tmp_path / "run.zarr")
    compressor = numcodecs.get_codec({"id": codec})
    for group in (None, "resume"):
        options = {"engine": "zarr", "mask_and_scale": False, "decode_times": False}
        data = xarray.open_dataset(tmp_path / "run.zarr", group=group, **options).load()
        for variable in data.variables.values():
            variable.encoding = {"compressors": [compressor]}
        data.to_zarr(tmp_path / "new.zarr", group=group, mode="a", zarr_format=2)
    assert_same_run(RUNS["turning"], sf.Trajectories.load(tmp_path / "new.zarr"))


@pytest.mark.sampled(1)
def test_damage_is_found_or_harmless(suffix, path):
    """With any bit flipped, `load` raises an error that names the file, or returns the same run."""
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    rng, found = np.random.default_rng(2), 0
    for file in files:
        data = file.read_bytes()
        low, high = 0, len(data)
        if suffix == ".nc":  # damaged metadata may crash the HDF5 library
            low = data.index(RUNS["batch"].omega.tobytes())
            high = low + RUNS["batch"].omega.nbytes
        for position in rng.integers(low, high, 3 if suffix == ".zarr" else 60):
            flipped = bytearray(data)
            flipped[position] ^= 4
            file.write_bytes(flipped)
            try:
                loaded = sf.Trajectories.load(path)
            except ValueError as error:
                found += str(path) in str(error)
            else:
                assert_same_run(RUNS["batch"], loaded)
        file.write_bytes(data)
    assert found > 10


def test_a_cut_file(suffix, path):
    file = path / "omega" / "0.0.0" if suffix == ".zarr" else path
    data = file.read_bytes()
    for length in (0, len(data) // 2, len(data) - 1):
        file.write_bytes(data[:length])
        refused(path, f"run{suffix}: .*expected")


def test_a_failed_write_keeps_the_old_file(path, tmp_path, monkeypatch):

    def fail(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(_replacing, "os", SimpleNamespace(**vars(os) | {"replace": fail}))
    with pytest.raises(KeyboardInterrupt):
        RUNS["turning"].save(path)
    monkeypatch.undo()
    assert_same_run(RUNS["batch"], sf.Trajectories.load(path))
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    RUNS["turning"].save(path)
    assert_same_run(RUNS["turning"], sf.Trajectories.load(path))


@posix
def test_modes(suffix, tmp_path):
    """A new file has the usual mode, and a replaced file keeps its mode."""
    path, folder = tmp_path / f"run{suffix}", suffix == ".zarr"
    before = os.umask(0o027)
    try:
        RUNS["turning"].save(path)
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == (0o750 if folder else 0o640)
    for mode in (0o700,) if folder else (0o600, 0o444):
        path.chmod(mode)
        RUNS["batch"].save(path)
        assert stat.S_IMODE(path.stat().st_mode) == mode
    assert_same_run(RUNS["batch"], sf.Trajectories.load(path))


@posix
def test_links(suffix, tmp_path):
    (tmp_path / "there").mkdir()
    target, link = tmp_path / "there" / f"target{suffix}", tmp_path / f"link{suffix}"
    link.symlink_to(target)
    for run in (RUNS["batch"], RUNS["turning"]):  # a missing target, then an existing one
        run.save(link)
        assert link.is_symlink()
        assert_same_run(run, sf.Trajectories.load(target))
    assert [entry.name for entry in (tmp_path / "there").iterdir()] == [target.name]


@posix
def test_other_paths_are_not_replaced(suffix, tmp_path):
    path = tmp_path / f"run{suffix}"

    def unwritable(message, path=path):
        with pytest.raises(OSError, match=message):
            RUNS["turning"].save(path)

    (tmp_path / "file").touch()
    for folder in (tmp_path / "missing", tmp_path / "file"):
        unwritable("expected a name in a folder that can be written to", folder / path.name)
    os.mkfifo(path)
    unwritable("neither a file")
    path.unlink()
    path.mkdir()
    (path / "thesis.tex").touch()
    unwritable(r"got a(nother)? folder")
    assert (path / "thesis.tex").exists()
    if suffix == ".zarr":
        (path / "thesis.tex").unlink()
        path.rmdir()
        path.touch()
        unwritable("expected the name of a Zarr store to write, got a file")
