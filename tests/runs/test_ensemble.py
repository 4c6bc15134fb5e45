"""Stored runs equal those of `iterate`, bit for bit, whatever happened in between."""

import json
import shutil
import signal
import subprocess
import sys
import textwrap
import threading
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import dask.array
import numpy as np
import pytest
import systems
import xarray
import zarr
from scipy.spatial.transform import Rotation

import suslov_fast as sf
from suslov_fast import RandomStarts, Suslov3D, ensemble, flow, iterate, open_ensemble
from suslov_fast.runs.ensemble import sizes_of_chunks
from suslov_fast.runs.files import stores
from suslov_fast.runs.files.stores import described
from suslov_fast.runs.files.tiles import Steps, Times

BODY = Suslov3D(4, 1, -0.5, -0.3)
BODY_4D = sf.SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5])
GYROSTAT = sf.SuslovGyrostat(4, 1, -0.5, -0.3, 0.7)
PENDING = -128


def lorenz(rho):
    return sf.QuadraticField.from_function(systems.lorenz, 3, rho=rho)


def call(function, body, omega0, **options):
    """Call a function with all arguments by name, also those that it takes by position alone."""
    return function(body, omega0, **options)


@pytest.fixture
def store(tmp_path):
    return tmp_path / "run.zarr"


def assert_same(dataset, orbits):
    """Compare all stored variables with the results of `iterate`, bit for bit."""
    for name in (orbits.body.variable, "final", "status", "failed_at", "attitude", "n", "time"):
        expected = getattr(orbits, name)
        if expected is None:
            assert name not in dataset
        elif name != "time" or np.ndim(orbits.eps) == 0:
            found = np.asarray(dataset[name].values)
            assert found.shape == np.shape(expected), name
            assert found.tobytes() == np.asarray(expected).tobytes(), name


def contents(store):
    return {
        path.relative_to(store).as_posix(): path.read_bytes()
        for path in sorted(store.rglob("*"))
        if path.is_file() and path.suffix != ".partial"
    }


CHUNK, TURNING = {"chunk": {"trajectory": 7, "n": 8}}, {"attitude": True}
TURNS = Rotation.random(20, random_state=1).as_matrix()
FAMILY = lorenz(np.linspace(10.0, 40.0, 5)[:, None])
ASKED = {"body": BODY, "omega0": [[1.0, 0.5]], "eps": 0.2, "steps": 20, "save_every": 2}
PENDULUM = sf.Field.from_function(lambda x, k: (x[1], -k * np.sin(x[0])), "q p", k=2.0)
MOVED = {"body": PENDULUM, "omega0": [[1.0, 0.5]], "time": [3.0, 0.0, 1.0]}
FIELD = {"body": FAMILY, "omega0": [1.0, 1.0, 1.0], "eps": 0.01, "steps": 9}


RUNS = [
    (BODY, 20, 0.3, CHUNK, {"save_every": 4}),
    (BODY, 20, 0.3, CHUNK, {"save_every": None} | TURNING),
    (BODY_4D, 20, 0.3, CHUNK, {"save_every": 1, "method": "gauss"} | TURNING),
    (GYROSTAT, 20, 0.3, CHUNK, {"save_every": 1} | TURNING),
    (FAMILY, 20, 0.01, {"chunk": {"rho": 2, "batch_1": 7, "n": 3}}, {"save_every": 2}),
    (BODY, 20, [[0.2], [0.3]], {}, {"save_every": 1}),
    (BODY, 20, np.linspace(0.1, 0.3, 20), {"chunk": 7}, {"save_every": None}),
    (BODY, 20, 0.3, CHUNK, {"save_every": 4, "attitude": TURNS}),
    (BODY, 20, 0.3, {"chunk": {"n": 1}}, {"save_every": 1} | TURNING),
    *[(BODY, shape, 0.2, {}, {"save_every": 5}) for shape in ((), (1,), (3, 0))],
]


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("body", "shape", "eps", "ours", "settings", "steps"),
    [*((*run, 25) for run in RUNS), *((*run, k % 2) for k, run in enumerate(RUNS))],
)
def test_a_stored_run_equals_iterate(store, rng, body, shape, eps, ours, settings, steps):
    omega0 = rng.uniform(-2.0, 2.0, np.append(shape, body.dimension).astype(int))
    if shape == 20:
        omega0[3], omega0[9] = np.nan, 1e308
    orbits = iterate(body, omega0, eps, steps, on_singular="ignore", **settings)
    for _ in range(2):
        assert_same(ensemble(body, omega0, eps, steps, store=store, **ours, **settings), orbits)
    data, expected = open_ensemble(str(store)), orbits.to_xarray()
    assert_same(data, orbits)
    xarray.testing.assert_equal(data, expected)
    assert {*data.coords} == {*expected.coords}
    for name, each in expected.variables.items():
        if name != "status":  # which may be pending in a store
            assert data[name].attrs == each.attrs


MOVING = [
    (BODY_4D, (), {}),
    (sf.SuslovGyrostat(4, 1, -0.5, -0.3, [0.0, 0.7]), (5, 2), {"chunk": {"time": 2}}),
    (FAMILY, (5, 3), {"chunk": {"rho": 2, "batch_1": 2, "time": 3}}),
    (PENDULUM, (0,), {}),
    (
        sf.Field.from_function(lambda x, k: (np.exp(k * x[0]),), "q", k=np.array([0.5, 9.0])),
        (4, 2),
        {"chunk": {"k": 1}, "dims": ("start", "k")},
    ),
]


@pytest.mark.parametrize(("system", "shape", "ours"), MOVING)
def test_a_stored_motion_equals_flow(store, rng, system, shape, ours):
    """Bit for bit, with all that a dataset of it has; solutions that end cause no warning."""
    x0, times = rng.uniform(0.0, 1.0, (*shape, system.dimension)), [0.3, 0.0, 0.1, 0.2]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sf.PoleWarning)
        motion = flow(system, x0, time=times, rtol=1e-7)
    for _ in range(2):
        data = ensemble(system, x0, time=times, rtol=1e-7, store=store, **ours)
        expected = motion.to_xarray(dims=ours.get("dims"))
        xarray.testing.assert_equal(data, expected)
        assert {*data.coords} == {*expected.coords}
    assert motion.ok == (system is not MOVING[-1][0])
    data.to_netcdf(store.with_suffix(".nc"))
    with xarray.open_dataset(store.with_suffix(".nc")) as again:
        np.testing.assert_array_equal(again.end, data.end)


def test_every_initial_state_identifies_a_run(tmp_path):
    """Of many states there is a digest, of all of their parts."""
    array, store = np.linspace(-1.0, 1.0, 1400).reshape(700, 2), tmp_path / "run.zarr"
    ensemble(BODY, array, 0.2, 2, store=store)
    for place in ((0, 0), (350, 1), (699, 1)):
        other = array.copy()
        other[place] = np.nextafter(other[place], 0.0)
        with pytest.raises(ValueError, match=r"x0.*, the store has others"):
            ensemble(BODY, other, 0.2, 2, store=store)
    large = np.arange(2.0**21 + 5)[:, None]  # in two parts
    text = described("omega0", large)
    assert text.startswith("2097157 values from 0 to 2.09716e+06, sha256 ")
    large[-1] += 0.5
    assert described("omega0", large) != text
    assert described("I1", array[:3, 0]) == array[:3, 0].tolist()


def oscillator(constant):
    H = lambda x: (x[0] ** 2 + x[1] ** 2) / 2 + constant  # noqa: E731
    return sf.QuadraticField.from_hamiltonian(H, 2)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("asked", "change", "name"),
    [
        (ASKED, {"body": Suslov3D(4, 1, -0.5, -0.31)}, "I23"),
        (ASKED, {"omega0": [[1.0, 0.5 + 1e-12]]}, "x0"),
        (ASKED, {"save_every": None}, "save_every"),
        (ASKED, {"attitude": True}, "attitude"),
        (ASKED, {"dims": "start"}, "dims"),
        (ASKED, {"steps": 19}, "steps"),
        (FIELD, {"body": lorenz([[10], [40]])}, "rho: 2 values from 10 to 40, the store has 5 "),
        (ASKED | {"body": oscillator(0)}, {"body": oscillator(9)}, "H"),
        (MOVED, {"time": [1.0]}, "time"),
        (MOVED, {"rtol": 1e-6}, "rtol"),
        (MOVED, {"atol": [0.0, 1e-9]}, "atol"),
        (MOVED | {"stiff": True}, {"stiff": None}, "stiff"),
        (MOVED, {"body": sf.Field.from_function(lambda x: (x[1], -x[0]), 2)}, "equations"),
        (MOVED, {"time": None, "eps": 0.2, "steps": 3, "body": BODY}, "map"),
    ],
)
def test_stores_of_other_runs_are_refused_by_name(store, asked, change, name):
    call(ensemble, **asked, store=store)
    before = contents(store)
    with pytest.raises(ValueError, match=name) as raised:
        call(ensemble, **{**asked, **change}, store=store)
    assert "sha256" not in str(raised.value)
    assert contents(store) == before


UNKNOWN = dask.array.ones((5, 2))
UNKNOWN = UNKNOWN[UNKNOWN[:, 0] > 0]
BAD = [
    ({"omega0": "starts.txt"}, TypeError, "x0"), ({"omega0": UNKNOWN}, ValueError, "x0"),
    ({"chunk": 0}, ValueError, "chunk"), ({"chunk": {"time": 3}}, ValueError, "chunk.*time"),
    ({"chunk": "many"}, TypeError, "chunk"), ({"dims": ("a", "b")}, ValueError, "dims"),
    ({"dims": "a/b"}, ValueError, "dims"),
    ({"omega0": RandomStarts(10**15, 1)}, OSError, "free"), ({"store": None}, TypeError, "store"),
    ({"client": 5}, TypeError, "client"), ({"progress": 5}, TypeError, "progress"),
    (FIELD | {"attitude": True}, TypeError, "attitude"),
    ({"time": [1.0]}, TypeError, "eps"), ({"rtol": 1e-6}, TypeError, "rtol"),
    ({"stiff": False}, TypeError, "stiff"), ({"eps": None}, TypeError, "time="),
    *[
        (MOVED | change | {"steps": None, "save_every": None, "eps": None}, error, name)
        for change, error, name in (
            ({"time": [-1.0, 1.0]}, ValueError, "time"), ({"chunk": {"n": 3}}, ValueError, "chunk"),
            ({"attitude": True}, TypeError, "attitude"),
            ({"method": "order4"}, TypeError, "method"),
        )
    ],
]  # fmt: skip


@pytest.mark.parametrize(("change", "error", "message"), BAD)
def test_bad_arguments_leave_nothing_behind(store, change, error, message):
    with pytest.raises(error, match=message):
        call(ensemble, **{"store": store, **(ASKED | change)})
    assert list(store.parent.iterdir()) == []


def test_places_that_cannot_hold_a_store(store):
    (store.parent / "file").write_text("1")
    for place in ("file", "file/run.zarr"):
        with pytest.raises((NotADirectoryError, FileExistsError), match="file"):
            call(ensemble, **ASKED, store=store.parent / place)
    (store.parent / "thesis").mkdir()
    (store.parent / "thesis" / "thesis.tex").touch()
    with pytest.raises(ValueError, match=r"store.*thesis\.tex"):
        call(ensemble, **ASKED, store=store.parent / "thesis")
    with pytest.raises(FileNotFoundError, match="store"):
        open_ensemble(store.with_name("missing.zarr"))


def test_other_kinds_of_stores():
    orbits = call(iterate, **ASKED)
    values = {}
    for place in (zarr.storage.MemoryStore(values), "memory://run.zarr"):
        for _ in range(2):
            assert_same(call(ensemble, **ASKED, store=place), orbits)
    del values["final/c/0/0"]
    with pytest.raises(ValueError, match="delete status/c/0 there"):
        open_ensemble(zarr.storage.MemoryStore(values))
    del values["status/c/0"]
    assert_same(call(ensemble, **ASKED, store=zarr.storage.MemoryStore(values)), orbits)


@pytest.mark.filterwarnings("ignore::UserWarning")  # of Zarr, which one thread ignores for all
def test_two_that_begin_a_store_at_once(store, monkeypatch):
    """With other chunks both have those of the first; another run is told what differs."""
    run, begun = ASKED | {"omega0": np.linspace(0.0, 1.0, 20).reshape(10, 2)}, threading.Barrier(2)
    given, errors = stores.create_store, []

    def create(*arguments):
        begun.wait(60)  # both have found that there is no store
        given(*arguments)

    def begin(name, **changes):
        try:
            call(ensemble, **run | changes, store=store.with_name(name))
        except ValueError as error:
            errors.append(str(error))

    monkeypatch.setattr(stores, "create_store", create)
    for name, change in (("a.zarr", {"chunk": 3}), ("b.zarr", {"eps": 0.3})):
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(lambda change, name=name: begin(name, **change), ({}, change)))
        monkeypatch.setattr(stores, "create_store", given)
        found = open_ensemble(store.with_name(name))
        assert_same(found, call(iterate, **run | {"eps": found.eps.item()}))
        monkeypatch.setattr(stores, "create_store", create)
    assert len(errors) == 1
    assert "b.zarr holds another run: eps: 0." in errors[0]


def test_a_store_that_is_read_only(store):
    """It opens, and a finished run is found in it; what is missing is not written."""
    call(ensemble, **ASKED, store=store)
    closed = zarr.storage.LocalStore(store, read_only=True)
    assert_same(call(ensemble, **ASKED, store=closed), call(iterate, **ASKED))
    for lost in "status/c/0", "eps/c":
        (store / lost).unlink()
        with pytest.raises(ValueError, match="read-only"):
            call(ensemble, **ASKED, store=closed)
        assert not (store / lost).exists()
    empty = store.with_name("empty")
    empty.mkdir()
    new = zarr.storage.LocalStore(empty, read_only=True)
    with pytest.raises(ValueError, match="read-only"):
        call(ensemble, **ASKED, store=new)


def test_an_interrupted_run_goes_on(store, rng):
    """Tiles that are stored are not computed again."""
    run = {"body": BODY, "omega0": rng.uniform(-2.0, 2.0, (50, 2)), "eps": 0.2, "steps": 30}
    ours = {"store": store, "save_every": 2, "chunk": {"trajectory": 10, "n": 5}}

    def stop(done, total):
        if done >= 20 * 30:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        call(ensemble, **run, **ours, progress=stop)
    unfinished, tile = open_ensemble(store), store / "omega/c/0/0/0"
    missing = unfinished.status.values == PENDING
    assert missing.sum() in (20, 30)
    assert np.isnan(unfinished.final.values[missing]).all()
    written = tile.stat().st_mtime_ns
    assert_same(call(ensemble, **run, **ours), call(iterate, **run, save_every=2))
    assert tile.stat().st_mtime_ns == written


RUN = """
    import sys
    from suslov_fast import RandomStarts, Suslov3D, ensemble
    body, starts = Suslov3D(4, 1, -0.5, -0.3), RandomStarts(2000, 1.5, seed=4)
    chunk = {"trajectory": 200, "n": 5}
    ensemble(body, starts, 0.3, 900, save_every=100, store=sys.argv[1], chunk=chunk)
"""


@pytest.mark.compiled
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
@pytest.mark.slow
def test_a_killed_run_is_finished(store, monkeypatch):
    """Kill processes at several moments; the store becomes that of an undisturbed run."""
    command = [sys.executable, "-c", textwrap.dedent(RUN), str(store)]
    for number, tiles in ((signal.SIGKILL, 1), (signal.SIGINT, 4)):
        with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
            while len([*store.glob("status/c/*")]) < tiles and process.poll() is None:
                time.sleep(0.002)
            process.send_signal(number)
    assert len([*store.glob("status/c/*")]) >= 4
    for place in (store, store.with_name("other.zarr")):
        monkeypatch.setattr(sys, "argv", ["run", str(place)])
        exec(textwrap.dedent(RUN), {})
    assert contents(store) == contents(store.with_name("other.zarr"))


def test_a_run_killed_while_its_store_is_made_is_finished(store):
    """With the chunks that it began with, whatever a later call asks for."""
    run = ASKED | {"omega0": np.linspace(0.0, 1.0, 10).reshape(5, 2)}
    call(ensemble, **run, store=store, chunk=2)
    whole = contents(store)
    made = json.loads(whole["zarr.json"])
    del made["consolidated_metadata"]  # which is written last
    (store / "zarr.json").write_text(json.dumps(made))
    for unmade in ("status", "n/c"):
        shutil.rmtree(store / unmade)
    (store / "zarr.0.partial").touch()
    call(ensemble, **run, store=store, chunk=3)
    finished = contents(store)  # whose metadata Zarr 3.1.3 writes in another order
    assert json.loads(finished.pop("zarr.json")) == json.loads(whole.pop("zarr.json"))
    assert finished == whole


@pytest.mark.sampled(3)
@pytest.mark.parametrize("change", ["other bytes", "fewer bytes", "none", "no file"])
@pytest.mark.parametrize("name", ["omega/c/0/0/0", "final/c/0/0", "status/c/0", "n/c/0", "eps/c"])
def test_damage_is_an_error_that_says_what_to_delete(store, name, change):
    """Bytes that differ are never a number; what the call knows it writes again."""
    call(ensemble, **ASKED, store=store)
    whole, array = contents(store), name.partition("/")[0]
    damaged = {"other bytes": bytes([whole[name][0] ^ 1]) + whole[name][1:], "none": b""}
    damaged["fewer bytes"] = whole[name][:-3]
    (store / name).unlink()
    if change in damaged:
        (store / name).write_bytes(damaged[change])
    if array == "status" and change == "no file":  # as if the tile were not computed
        assert (open_ensemble(store).status == PENDING).all()
    else:
        with pytest.raises(ValueError, match=rf"{name}|chunk of {array}|checksum") as found:
            open_ensemble(store).load()
        if array in ("n", "eps"):
            assert "delete" not in str(found.value)
        else:
            with pytest.raises(ValueError, match=r"delete status/c|checksum"):
                open_ensemble(store).load()
            shutil.rmtree(store / "status/c")
            (store / name).unlink(missing_ok=True)
    call(ensemble, **ASKED, store=store)
    assert contents(store) == whole


def test_damaged_metadata_are_an_error(store):
    call(ensemble, **ASKED, store=store)
    whole = (store / "zarr.json").read_bytes()
    for damaged in (b"!" + whole[1:], whole[:-3], b"", whole.replace(b'"tiled"', b'"tilde"')):
        (store / "zarr.json").write_bytes(damaged)
        for function in (open_ensemble, lambda store: call(ensemble, **ASKED, store=store)):
            with pytest.raises(ValueError, match="damaged metadata"):
                function(store)


@pytest.mark.slow
def test_two_at_once_write_the_same(store):
    seen, run = [], {**ASKED, "omega0": RandomStarts(200, 1.0)}
    ours = {"store": store, "chunk": 5, "progress": lambda *done: seen.append(done)}
    with ThreadPoolExecutor(2) as pool:
        for each in [pool.submit(call, ensemble, **run, **ours) for _ in range(2)]:
            each.result()
    assert_same(open_ensemble(store), call(iterate, **run))
    assert seen[-1] == max(seen) == (4000, 4000)


@pytest.mark.slow
def test_workers_of_a_cluster(store):
    import distributed

    random = RandomStarts(50, 1.5)
    orbits = iterate(BODY, random, 0.2, 40, save_every=3)
    settings = {"save_every": 3, "chunk": {"trajectory": 7, "n": 3}}
    with distributed.Client(n_workers=1, processes=False, dashboard_address=":0") as client:
        for name, omega0 in (("random", random), ("states", random.states(50))):
            place = store.with_name(f"{name}.zarr")
            dataset = ensemble(BODY, omega0, 0.2, 40, store=place, client=client, **settings)
            assert_same(dataset, orbits)
        ours = {"store": store.with_name("ended.zarr"), "chunk": 2, "client": client}
        data = ensemble(BODY, random, 0.2, 40, **ours, progress=lambda done, total: done < 400)
        assert (data.status.values != PENDING).sum() >= 10
        data = ensemble(BODY, random, 0.2, 40, **ours)
        assert_same(data, iterate(BODY, random, 0.2, 40, save_every=None))
        data = ensemble(PENDULUM, random, time=[2.0, 1.0], store=store, client=client, chunk=9)
        assert np.array_equal(data.x, flow(PENDULUM, random, time=[2.0, 1.0]).x)
        shutil.rmtree(store)
    with pytest.raises(ValueError, match="client must be an open client"):
        ensemble(BODY, random, 0.2, 40, store=store, client=client)
    assert not store.exists()


def test_attributes_are_plain(store):
    """They can be written to NetCDF, and the dataset is read by xarray alone.

    The consolidated metadata are those that Zarr itself would write.
    """
    dataset = call(ensemble, **FIELD, store=store)
    assert xarray.open_zarr(store).attrs == dataset.attrs
    group = json.loads((store / "zarr.json").read_text())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that they are not part of the format
        zarr.consolidate_metadata(store)
    assert json.loads((store / "zarr.json").read_text()) == group
    assert json.loads(json.dumps(dataset.attrs)) == dataset.attrs
    assert json.loads(dataset.attrs["rho"]) == FAMILY.parameters["rho"].tolist()
    assert (dataset.attrs["eps"], dataset.attrs["steps"]) == (0.01, 9)


def test_a_store_in_a_zip_file(store):
    data = call(ensemble, **ASKED, store=store)
    shutil.make_archive(store, "zip", store)
    with pytest.raises(ValueError, match="store"):
        open_ensemble(f"{store}.zip")
    with zarr.storage.ZipStore(f"{store}.zip", mode="r") as opened:
        assert_same(open_ensemble(opened), call(iterate, **ASKED))
    closed = zarr.storage.ZipStore(f"{store}.zip", mode="r")
    assert_same(open_ensemble(closed), call(iterate, **ASKED))
    assert open_ensemble(closed).attrs == data.attrs
    for mode, name in (("r", f"{store}.zip"), ("w", f"{store}.new.zip")):
        with pytest.raises(ValueError, match=r"store.* ZipStore: write into a folder"):
            call(ensemble, **ASKED, store=zarr.storage.ZipStore(name, mode=mode))
    closed.close()


def test_a_callable_ends_a_run(store):
    """After a tile; the same call goes on."""
    run, ours = (BODY, RandomStarts(50, 1.0), 0.2, 30), {"store": store, "chunk": 10}
    finished = 0
    for first, tiles in ((0, 0), (300, 1), (900, 2), (1500, 5)):
        seen = []

        def progress(done, total, seen=seen, first=first):
            seen.append((done, total))
            return np.False_ if done >= first else None

        data = ensemble(*run, **ours, progress=progress)
        assert seen[0] == (30 * finished, 1500)
        finished = (data.status.values != PENDING).sum()
        assert finished == max(10 * tiles, seen[-1][0] // 30)
        assert seen[-1][1] == 1500
    assert_same(data, iterate(*run, save_every=None))
    meanings = data.status.attrs["flag_meanings"].split()
    assert dict(zip(meanings, data.status.attrs["flag_values"], strict=True)) == {
        **{each.name: each.value for each in sf.Status},
        "PENDING": PENDING,
    }


def test_a_tile_finished_while_its_store_is_opened(store, monkeypatch):
    """A cancelled worker may still write one: its status comes last, and is looked for first."""
    omega0 = np.ones((4, 2))
    ensemble(BODY, omega0, 0.2, 9, save_every=1, store=store, chunk=2)
    parts = ("final/c", "omega/c", "status/c")
    tile = {
        store / name: value for name, value in contents(store).items() if name.startswith(parts)
    }
    for path in tile:
        path.unlink()
    given = stores.lost_tiles

    def written_meanwhile(*arguments):
        for name, content in tile.items():
            name.write_bytes(content)
        return given(*arguments)

    monkeypatch.setattr(stores, "lost_tiles", written_meanwhile)
    assert_same(open_ensemble(store), iterate(BODY, omega0, 0.2, 9))


@pytest.mark.parametrize("steps", [12, 10**6, 10**9])
def test_tiles_take_neither_long_nor_much_memory(steps):
    """Of 2**24 states of 3 numbers, 5 of them saved; of a long run 2**12 trajectories at least."""
    status = SimpleNamespace(sizes={"a": 2**12, "b": 2**12}, size=2**24)
    data = SimpleNamespace(sizes={"component": 3}, status=status, attrs={"tiled": []})
    for task in (Steps("auto", steps, steps // 4), Times(np.arange(5.0), 1, None)):
        found = sizes_of_chunks(data, task, None)
        count = found["a"] * found["b"]
        assert 24 * count * found[task.axis] <= 2**24
        assert count >= task.fewest
        assert count <= max(task.most, task.fewest)
