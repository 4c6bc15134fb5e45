"""What a power cut takes is found and computed again; without one, nothing is looked for."""

import os
import random
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from suslov_fast import RandomStarts, Suslov3D, SuslovND, ensemble
from suslov_fast._ensemble import chunks, settling

pytest.importorskip("zarr")
pytest.importorskip("dask")
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="names open files by /proc")

BODY = Suslov3D(4, 1, -0.5, -0.3)
BODY_4D = SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5])
RUNS = {
    "3d": {"body": BODY, "save_every": 1},
    "3d attitude": {"body": BODY, "save_every": 2, "method": "canonical", "attitude": True},
    "3d reductions": {
        "body": BODY,
        "reductions": ["omega_max", "omega_min"],
        "method": "canonical",
    },
    "nd": {"body": BODY_4D, "save_every": 3},
    "nd compressed": {"body": BODY_4D, "save_every": 3, "compression": "lz4"},
}


def run(kind, steps, store, **options):
    chunk = {"trajectory": 7, "n": 4}
    starts = RandomStarts(20, 1.0, seed=3)
    settings = {**RUNS[kind], "chunk": chunk, "store": store, **options}
    return ensemble(omega0=starts, eps=0.2, steps=steps, **settings)


@dataclass
class Version:
    """A file as it was given its name: whether what is in it, and the name, are on the disk."""

    data: bytes
    settled: bool
    named: bool = False

    def left(self):
        """What may be left of it."""
        half = len(self.data) // 2
        lost = [b"", self.data[:half] + bytes(len(self.data) - half)]
        return [self.data] if self.settled else [self.data, *lost]


class Disk:
    """A disk that is sure to hold only what it was waited for."""

    def __init__(self, monkeypatch):
        self.files = {}  # versions since the last that is sure, by name
        self.settled = {}  # contents that were waited for, by inode
        self.replace, self.fsync = os.replace, os.fsync
        monkeypatch.setattr(os, "replace", self.replacing)
        monkeypatch.setattr(os, "fsync", self.settling)

    def replacing(self, source, target):
        if os.path.isfile(source):
            self.files.setdefault(Path(target), []).append(self.version(Path(source)))
        self.replace(source, target)
        if os.path.isdir(target):  # a new store
            for path in filter(Path.is_file, Path(target).rglob("*")):
                self.files[path] = [self.version(path, named=True)]

    def version(self, path, named=False):
        data = path.read_bytes()
        return Version(data, self.settled.pop(path.stat().st_ino, None) == data, named)

    def settling(self, descriptor):
        self.fsync(descriptor)
        path = Path(os.readlink(f"/proc/self/fd/{descriptor}"))
        if path.is_dir():
            for each in [each for each in self.files if each.parent == path]:
                del self.files[each][:-1]
                self.files[each][-1].named = True
        elif path in self.files:
            self.files[path][-1].settled = True
        else:
            self.settled[path.stat().st_ino] = path.read_bytes()

    def cut(self, chance):
        """Whatever is not sure may be lost; the number of files that are not what they were."""
        lost, part = 0, chance.choice((0.1, 0.3, 1.0))
        for path, versions in self.files.items():
            if chance.random() > part:
                continue
            may_be = [data for version in versions for data in version.left()]
            if not versions[0].named:
                may_be.append(None)
            left = chance.choice(may_be)
            lost += left != versions[-1].data
            path.unlink()
            if left is not None:
                path.write_bytes(left)
        self.files = {
            path: [Version(path.read_bytes(), True, True)] for path in self.files if path.exists()
        }
        return lost


class PowerCutError(Exception):
    pass


def results(store):
    """The files of a store but for its metadata, by name."""
    return {
        str(path.relative_to(store)): path.read_bytes()
        for path in store.rglob("*")
        if path.is_file() and path.name != "zarr.json" and path.parts[-3] not in ("n", "time")
    }


def assert_finished(kind, steps, store):
    """It holds what an undisturbed run does, byte for byte."""
    run(kind, steps, store.with_name("undisturbed.zarr"))
    found, expected = results(store), results(store.with_name("undisturbed.zarr"))
    assert sorted(found) == sorted(expected)
    assert [name for name in found if found[name] != expected[name]] == []


def cut_again_and_again(kind, tmp_path, monkeypatch, seed, times):
    """Runs that end with power cuts, each with another start of the machine; how much was lost."""
    chance, store, disk = random.Random(seed), tmp_path / "run.zarr", Disk(monkeypatch)
    steps, lost = 21, 0
    for start in range(times):
        monkeypatch.setattr(settling, "boot", lambda start=start: f"start {start}")
        left = chance.randrange(1, 20)

        def count(done, total):
            nonlocal left
            left -= 1
            if left == 0:
                raise PowerCutError

        try:
            run(kind, steps, store, progress=count)
            steps += 13
        except PowerCutError:
            pass
        lost += disk.cut(chance)
    monkeypatch.undo()
    run(kind, steps, store)
    assert_finished(kind, steps, store)
    return lost


@pytest.mark.parametrize("kind", RUNS)
def test_the_same_call_makes_good_what_a_power_cut_took(tmp_path, monkeypatch, kind):
    assert cut_again_and_again(kind, tmp_path, monkeypatch, 1, 4) > 0


@pytest.fixture
def looked_at(monkeypatch):
    """The arrays in which damage was looked for."""
    names = []
    damaged = chunks.damaged
    monkeypatch.setattr(
        chunks, "damaged", lambda array, where: names.append(array.path) or damaged(array, where)
    )
    return names


def test_only_another_start_of_the_machine_makes_it_look(tmp_path, monkeypatch, looked_at):
    store = tmp_path / "run.zarr"
    for start, steps, looks in (
        ("one", 9, False),
        ("one", 20, False),
        ("two", 20, True),  # it is as it should be, and known to be so
        ("three", 20, False),
        ("three", 30, False),
        ("four", 40, True),
        ("four", 50, False),
        (None, 50, True),
    ):
        monkeypatch.setattr(settling, "boot", lambda start=start: start)
        looked_at.clear()
        run("3d", steps, store)
        assert ("omega" in looked_at) == looks, (start, steps)
    monkeypatch.undo()
    assert_finished("3d", 50, store)


@pytest.mark.parametrize("kind", ["3d attitude", "nd compressed"])
def test_where_no_start_is_known_every_chunk_is_waited_for(tmp_path, monkeypatch, looked_at, kind):
    disk = Disk(monkeypatch)
    monkeypatch.setattr(settling, "boot", lambda: None)
    for steps in (9, 20):
        run(kind, steps, tmp_path / "run.zarr")
    waiting = [
        path
        for path, versions in disk.files.items()
        if not (versions[-1].settled and versions[-1].named and len(versions) == 1)
    ]
    # What goes on from the data, and the marks, may be older than they are.
    assert {path.relative_to(tmp_path / "run.zarr").parts[0] for path in waiting} == {"progress"}
    assert looked_at == []


def test_workers_wait_for_the_disk(tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    disk = Disk(monkeypatch)
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0"
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        run("nd", 20, tmp_path / "run.zarr", scheduler=client)
    omega = [each for path, each in disk.files.items() if "omega" in path.parts]
    assert len(omega) > 3
    assert all(versions[-1].settled and versions[-1].named for versions in omega)
