"""Stores: damaged, incomplete, of other programs, in other places, and with two writers."""

import errno
import json
import os
import pickle
import shutil
import subprocess
import sys
import warnings
from contextlib import suppress
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import xarray
import zarr
from ensemble_runs import BODY, CUT, assert_same, contents, made

from suslov_fast import RandomStarts, ensemble, iterate, open_ensemble

STARTS = RandomStarts(20, 2.0, seed=3)
EPS = np.array([0.2, 0.3])[:, None]
ASKED = {
    "body": BODY, "omega0": STARTS, "eps": EPS, "save_every": 2, "method": "canonical",
    "attitude": True, "reductions": ["omega_max"], "dims": ("step_size", "trajectory"),
    "coords": {"step_size": ["a", "b"]}, "chunk": CUT,
}  # fmt: skip
VARIABLES = "omega attitude final status failed_at omega_max eps I1 I13 n component step_size "
VARIABLES = (VARIABLES + "progress/record progress/steps_done").split()


def expected(steps):
    settings = {"save_every": 2, "attitude": True, "method": "canonical"}
    return iterate(BODY, STARTS.states(20), EPS, steps, **settings)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    store = tmp_path_factory.mktemp("ensemble") / "run.zarr"
    ensemble(**ASKED, steps=20, store=store)
    return store


@pytest.fixture
def store(tmp_path, finished):
    return Path(shutil.copytree(finished, tmp_path / "run.zarr"))


HARMS = {
    "bit": lambda data: data[:-1] + bytes([data[-1] ^ 4]),
    "cut": lambda data: data[: len(data) // 2],
    "removed": None,
}


@pytest.mark.parametrize("harm", HARMS)
@pytest.mark.parametrize("name", VARIABLES)
@pytest.mark.sampled(5)
def test_damaged_chunks_are_repaired(store, finished, name, harm):
    paths = [each for each in sorted((store / name).rglob("*")) if each.is_file()]
    path = next(each for each in paths if each.name != "zarr.json")
    if HARMS[harm]:
        path.write_bytes(HARMS[harm](path.read_bytes()))
    else:
        path.unlink()
    dataset = ensemble(**ASKED, steps=20, store=store, verify=True)
    assert_same(dataset, expected(20))
    assert contents(store) == contents(finished)
    assert_same(xarray.open_zarr(store), expected(20))


METADATA_HARMS = {
    "removed": lambda text: None,
    "cut": lambda text: text[: len(text) // 2],
    "array": lambda text: "[1]",
    "group": lambda text: '{"zarr_format": 3, "node_type": "group", "attributes": {}}',
    "attributes": lambda text: json.dumps({**json.loads(text), "attributes": {"a": 1}}),
}
METADATA = ["omega/zarr.json", "eps/zarr.json", "progress/record/zarr.json", "progress/zarr.json"]


def files(store):
    found = sorted(store.rglob("*"))
    return [(path, path.is_file() and path.read_bytes(), path.stat().st_mtime_ns) for path in found]


@pytest.mark.parametrize("harm", METADATA_HARMS)
def test_damaged_metadata_of_the_root_are_reported_or_repaired(store, finished, harm):
    damage(store / "zarr.json", METADATA_HARMS[harm])
    before = files(store)
    for call in (
        lambda: ensemble(**ASKED, steps=31, store=store),
        lambda: ensemble(**ASKED, steps=20, store=store),
        lambda: open_ensemble(store),
    ):
        with pytest.raises(ValueError, match=r"\.zarr: .*; ensemble with verify=True repairs"):
            call()
        assert files(store) == before
    repair(store, finished)


@pytest.mark.parametrize("harm", METADATA_HARMS)
@pytest.mark.parametrize("name", METADATA)
@pytest.mark.sampled(7)
def test_damaged_metadata_of_members_are_not_read(store, finished, name, harm):
    damage(store / name, METADATA_HARMS[harm])
    assert_same(open_ensemble(store), expected(20))
    assert_same(ensemble(**ASKED, steps=20, store=store), expected(20))
    longer = shutil.copytree(store, store.with_name("longer.zarr"))
    assert_same(ensemble(**ASKED, steps=31, store=longer), expected(31))
    repair(store, finished)


def damage(path, harm):
    changed = harm(path.read_text())
    path.unlink() if changed is None else path.write_text(changed)


def repair(store, finished):
    assert_same(ensemble(**ASKED, steps=20, store=store, verify=True), expected(20))
    for path in finished.rglob("*.*"):
        assert (store / path.relative_to(finished)).read_bytes() == path.read_bytes(), path
    assert contents(store) == contents(finished)


@pytest.mark.parametrize("name", ["eps", "n", "component"])
def test_a_store_without_parameters_is_refused(store, name):
    shutil.rmtree(store / name / "c")
    with pytest.raises(ValueError, match="verify=True"):
        open_ensemble(store)
    with pytest.raises(ValueError, match="verify=True"):
        ensemble(**ASKED, steps=20, store=store)


def test_coordinates_of_a_longer_run(tmp_path):
    """Coordinates given first, or added later, stay if a call does not repeat them."""
    small = {**ASKED, "store": tmp_path / "run.zarr"}
    ensemble(**small, steps=4)
    colours = {"colour": ("trajectory", [f"c{k}" for k in range(20)])}
    longer = ensemble(**{**small, "coords": colours}, steps=8)
    assert longer.step_size.values.tolist() == ["a", "b"]
    del small["coords"]
    for verify in (False, True):
        again = ensemble(**small, steps=9, verify=verify)
        assert again.step_size.values.tolist() == ["a", "b"]
        assert again.colour.values.tolist() == colours["colour"][1]
    (tmp_path / "run.zarr" / "zarr.json").unlink()
    with pytest.raises(ValueError, match=r"coords: expected colour, which .* has lost"):
        ensemble(**small, steps=9, verify=True)


def test_complete_tiles_are_not_recomputed(store, finished, monkeypatch):
    pieces = made(monkeypatch)
    ensemble(**ASKED, steps=20, store=store, verify=True)
    assert pieces == []
    # A process killed between the last record of a tile and its mark changes no bit.
    zarr.open_group(store, mode="r+")["progress/steps_done"][...] = -1
    ensemble(**ASKED, steps=20, store=store)
    assert pieces.count(0) == 3  # each tile from the start
    assert contents(store) == contents(finished)
    pieces.clear()
    assert_same(ensemble(**ASKED, steps=31, store=store), expected(31))
    assert min(pieces) == 20
    pieces.clear()
    next((store / "omega").rglob("1")).joinpath("0", "1", "0").unlink()
    assert_same(ensemble(**ASKED, steps=31, store=store, verify=True), expected(31))
    assert pieces[0] == 0  # only one tile is computed
    assert len(set(pieces)) == len(pieces)


@pytest.mark.slow
@pytest.mark.parametrize("room", [*range(0, 140, 3), 10**6])
def test_failures_of_writes(tmp_path, monkeypatch, room):
    """Create and extend a store while writes fail after `room` writes."""
    store, left = tmp_path / "run.zarr", [room]
    methods = {name: getattr(zarr.storage.LocalStore, name) for name in ("set", "delete")}

    def limited(name):
        async def method(self, *arguments):
            left[0] -= 1
            if left[0] < 0:
                raise OSError(errno.ENOSPC, "No space left on device")
            await methods[name](self, *arguments)

        return method

    small = {**ASKED, "chunk": {"trajectory": 20, "n": 6}}
    with monkeypatch.context() as patch:
        for name in methods:
            patch.setattr(zarr.storage.LocalStore, name, limited(name))
        with suppress(OSError):
            ensemble(**small, steps=20, store=store)
            ensemble(**small, steps=31, store=store)
    try:
        dataset = open_ensemble(store)
    except FileNotFoundError:
        pass
    else:
        steps = dataset.attrs["steps"]
        assert dataset.n.values.tolist() == expected(steps).n.tolist()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # no consolidated metadata
            assert xarray.open_zarr(store).sizes["n"] in (11, 16)
        omega = dataset.omega.values
        assert np.array_equal(omega, np.where(np.isnan(omega), omega, expected(steps).omega), True)
        if dataset.attrs["tiles_done"] == "1 of 1":
            assert_same(dataset, expected(steps))
    assert_same(ensemble(**small, steps=31, store=store), expected(31))
    assert_same(xarray.open_zarr(store), expected(31))
    assert left[0] < 0 or room > 60, "no write failed"


def test_a_finished_store_in_a_read_only_folder_is_opened(finished, monkeypatch):
    refuse = Mock(side_effect=OSError(errno.EROFS, "Read-only file system"))
    monkeypatch.setattr("filelock.FileLock.acquire", refuse)
    assert_same(ensemble(**ASKED, steps=20, store=finished), expected(20))


def test_one_writer_for_all_names_of_a_store(tmp_path):
    store, other = tmp_path / "run.zarr", tmp_path / "link.zarr"
    store.mkdir()
    other.symlink_to(store)
    refused = []

    def while_it_runs(done, total):
        for name in (store, other, f"file://{other}"):
            with pytest.raises(BlockingIOError, match="another writer"):
                ensemble(**ASKED, steps=20, store=name)
            refused.append(name)

    ensemble(**ASKED, steps=20, store=other, progress=while_it_runs)
    assert len(refused) >= 3
    code = "import sys; from suslov_fast._ensemble.store import only_writer\n"
    code += "with only_writer(sys.argv[1]): print('held', flush=True); sys.stdin.read()"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", code, str(other)], **pipes) as holder:
        assert holder.stdout.readline().strip() == b"held"
        with pytest.raises(BlockingIOError):
            ensemble(**ASKED, steps=20, store=store)
        holder.kill()
        holder.wait()
    assert_same(ensemble(**ASKED, steps=20, store=store), expected(20))


@pytest.mark.parametrize("place", ["file", "memory", "object"])
@pytest.mark.sampled(1)
def test_stores_by_url_and_as_objects(tmp_path, place):
    store = {
        "file": f"file://{tmp_path}/run.zarr",
        "memory": f"memory://{tmp_path}/run.zarr",
        "object": zarr.storage.MemoryStore(),
    }[place]
    for steps in (20, 31):
        assert_same(ensemble(**ASKED, steps=steps, store=store), expected(steps))
    assert_same(open_ensemble(store), expected(31))
    assert (tmp_path / "run.zarr").exists() == (place == "file")
    with pytest.raises(ValueError, match=r"method ds2|canonical instead of ds2"):
        ensemble(**{**ASKED, "method": "ds2"}, steps=31, store=store)


def test_other_folders_and_stores_are_not_touched(tmp_path):
    asked = {**ASKED, "steps": 20}
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "a.txt").write_text("mine")
    for name in ("notes", "notes/a.txt"):
        with pytest.raises(ValueError, match=f"got other data in .*{name}"):
            ensemble(**asked, store=tmp_path / name)
    zarr.create_group(tmp_path / "other.zarr", attributes={"mine": 1})
    zarr.create_group(tmp_path / "old.zarr", attributes={"source": "suslov_fast 0.2.0"})
    zarr.create_group(tmp_path / "old.zarr", path="progress", attributes={"run": "{}"})
    for name, received in (
        ("other", "got other data in "),
        ("old", r"format 1 of suslov_fast 0\.2\.0"),
    ):
        for function in (lambda store: ensemble(**asked, store=store), open_ensemble):
            with pytest.raises(ValueError, match=received):
                function(tmp_path / f"{name}.zarr")
    with pytest.raises(FileNotFoundError):
        open_ensemble(tmp_path / "none.zarr")
    with pytest.raises(ValueError, match=r"a store written by ensemble, .* got other data"):
        open_ensemble(tmp_path / "notes")
    assert (tmp_path / "notes" / "a.txt").read_text() == "mine"


class Bomb:
    """An object that runs code when it is unpickled."""

    def __reduce__(self):
        return os.mkdir, ("exploded",)


def test_stores_that_could_run_code_are_refused(store, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    root = json.loads((store / "zarr.json").read_text())
    del root["consolidated_metadata"]
    (store / "zarr.json").write_text(json.dumps(root))
    (store / "status" / "zarr.json").unlink()
    status = {"zarr_format": 2, "shape": [2, 20], "chunks": [2, 20], "dtype": "|O"}
    status |= {"order": "C", "fill_value": None, "compressor": None}
    status["filters"] = [{"id": "pickle"}]
    (store / "status" / ".zarray").write_text(json.dumps(status))
    (store / "status" / "0.0").write_bytes(pickle.dumps(Bomb()))
    with pytest.raises(ValueError, match="store: expected"):
        open_ensemble(store)
    assert not (tmp_path / "exploded").exists()
