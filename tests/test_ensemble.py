"""Stored runs are those of `iterate`, bit for bit, however they are cut and gone on with."""

import json
import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest

from suslov_fast import (
    RandomStarts,
    Suslov3D,
    SuslovND,
    Trajectories,
    ensemble,
    first_integral,
    iterate,
    modified_energy,
    open_ensemble,
)

xarray = pytest.importorskip("xarray")
zarr = pytest.importorskip("zarr")
pytest.importorskip("dask")

BODY = Suslov3D(4, 1, -0.5, -0.3)
BODY_4D = SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5])
CUT = {"trajectory": 7, "n": 3}


@pytest.fixture
def store(tmp_path):
    return tmp_path / "run.zarr"


def starts(rng, *shape, D=2):
    return rng.uniform(-2.0, 2.0, (*shape, D))


def bits(array):
    return np.ascontiguousarray(array).view(np.uint8)


def assert_same(dataset, orbits):
    """All that is stored is what `iterate` returns, bit for bit."""
    for name in ("omega", "final", "status", "failed_at", "attitude", "n"):
        expected = getattr(orbits, name)
        if expected is None:
            assert name not in dataset
        else:
            assert np.array_equal(bits(dataset[name].values), bits(expected)), name
    np.testing.assert_array_equal(dataset.time.values, np.squeeze(orbits.time))


def contents(store):
    """Every file of a store, but for the time at which it was written."""
    return {
        str(path.relative_to(store)): path.read_bytes()
        for path in sorted(store.rglob("*"))
        if path.is_file()
    }


METHODS = [(BODY, method) for method in ("auto", "canonical", "ds2")]
METHODS += [(BODY_4D, method) for method in ("auto", "gauss", "rank2")]


KEPT = [(None, False), (1, True), (4, False), (100, False), (None, True)]


@pytest.mark.parametrize(
    ("body", "method", "save_every", "attitude"),
    # What is seldom kept only by the method that there is by default.
    [(*each, *kept) for each in METHODS for kept in KEPT[: 5 if each[1] == "auto" else 3]],
)
def test_a_stored_run_is_that_of_iterate(store, rng, body, method, save_every, attitude):
    omega0 = starts(rng, 20, D=body.dimension)
    omega0[3] = np.nan
    settings = {"save_every": save_every, "method": method, "attitude": attitude}
    dataset = ensemble(body, omega0, 0.3, 40, store=store, chunk=CUT, **settings)
    assert_same(dataset, iterate(body, omega0, 0.3, 40, on_singular="ignore", **settings))
    assert dataset.attrs["tiles_done"] == "3 of 3"
    # Longer by less than a chunk, and by more.
    for steps in (41, 73):
        dataset = ensemble(body, omega0, 0.3, steps, store=store, **settings)
        assert_same(dataset, iterate(body, omega0, 0.3, steps, on_singular="ignore", **settings))


@pytest.mark.parametrize("chunk", [None, 5, {"eps": 1}, {"I13": 2, "trajectory": 3, "n": 2}])
def test_parameters_are_axes_of_the_batch(store, rng, chunk):
    body = Suslov3D(4, 1, np.linspace(-0.5, 0.5, 3)[:, None], -0.3)
    eps = np.array([0.1, 0.5])[:, None, None]
    omega0 = starts(rng, 8)
    dims = ("eps_axis", "I13_axis", "trajectory")
    renamed = chunk
    if isinstance(chunk, dict):
        renamed = {{"eps": dims[0], "I13": dims[1]}.get(k, k): v for k, v in chunk.items()}
    coords = {"trajectory": list("abcdefgh")}
    dataset = ensemble(
        body, omega0, eps, 30, store=store, save_every=3, dims=dims, coords=coords, chunk=renamed
    )
    orbits = iterate(body, omega0, eps, 30, save_every=3)
    assert_same(dataset, orbits)
    assert dataset.omega.dims == ("n", *dims, "component")
    assert dataset.sel(trajectory="c").omega.shape == (11, 2, 3, 2)
    again = Trajectories.from_xarray(dataset)
    assert again.body == body
    assert np.array_equal(again.omega, orbits.omega)


@pytest.mark.parametrize("shape", [(), (0,), (1,), (3, 0)])
def test_batches_of_any_shape(store, rng, shape):
    omega0 = starts(rng, *shape)
    for steps in (0, 12):
        dataset = ensemble(BODY, omega0, 0.2, steps, store=store, save_every=5)
        assert_same(dataset, iterate(BODY, omega0, 0.2, steps, save_every=5))


def test_starts_come_from_anywhere(tmp_path):
    dask = pytest.importorskip("dask.array")
    random = RandomStarts(50, 2.0, seed=5)
    array = random.states(50)
    np.save(tmp_path / "starts.npy", array)
    given = {
        "random": random,
        "array": array,
        "file": tmp_path / "starts.npy",
        "dask": dask.from_array(array, chunks=(13, 2)),
    }
    results = {
        name: ensemble(BODY, omega0, 0.2, 20, store=tmp_path / f"{name}.zarr", chunk=9)
        for name, omega0 in given.items()
    }
    for dataset in results.values():
        assert_same(dataset, iterate(BODY, array, 0.2, 20, save_every=None))
    # The same states are the same run, wherever they come from.
    ensemble(BODY, array, 0.2, 20, store=tmp_path / "file.zarr")
    array[-1, -1] += 1e-9
    np.save(tmp_path / "starts.npy", array)
    with pytest.raises(ValueError, match=r"omega0 .*sha256"):
        ensemble(BODY, given["file"], 0.2, 20, store=tmp_path / "file.zarr")


@pytest.mark.parametrize("dimension", [1, 2, 3, 5, 8])
def test_a_random_state_depends_on_seed_and_number_alone(dimension):
    starts = RandomStarts(1000, 3.0, seed=2)
    whole = starts.states(1000, dimension=dimension)
    for start, count in ((0, 1), (1, 1), (7, 13), (998, 2)):
        part = starts.states(count, start, dimension)
        assert np.array_equal(part, whole[start : start + count])
    assert not np.isin(whole, RandomStarts(1000, 3.0, seed=3).states(1000, 0, dimension)).any()
    assert abs(whole).max() <= 3.0
    assert np.unique(whole).size == whole.size
    assert abs(whole.mean()) < 0.1
    assert whole.std() == pytest.approx(3.0 / np.sqrt(3.0), rel=0.05)
    far = starts.states(2, 10**18, dimension)
    assert np.isfinite(far).all()


def test_random_starts_of_any_shape(store):
    random = RandomStarts((3, 4), 1.0, seed=9)
    dataset = ensemble(
        BODY, random, 0.2, 3, store=store, save_every=1, chunk={"batch_0": 2, "batch_1": 3}
    )
    assert np.array_equal(dataset.omega.values[0], random.states(12).reshape(3, 4, 2))


@pytest.mark.parametrize("body", [BODY, BODY_4D])
def test_reductions_stand_for_the_states(store, rng, body):
    omega0 = starts(rng, 20, D=body.dimension)
    names = ["modified_energy_drift", "energy_drift", "omega_min", "omega_max"]
    if body is BODY:
        names.append("first_integral_drift")
    for steps in (30, 50):
        dataset = ensemble(body, omega0, 0.3, steps, store=store, chunk=CUT, reductions=names)
        orbits = iterate(body, omega0, 0.3, steps)
        assert "omega" not in dataset
        assert "n" not in dataset.sizes
        assert np.array_equal(dataset.final, orbits.final)
        assert np.array_equal(dataset.status, orbits.status)
        assert np.array_equal(dataset.omega_min, orbits.omega.min(axis=0))
        assert np.array_equal(dataset.omega_max, orbits.omega.max(axis=0))
        observables = {"modified_energy_drift": modified_energy}
        if body is BODY:
            observables["first_integral_drift"] = first_integral
        for name, observable in observables.items():
            change = abs(observable(body, orbits.omega, 0.3) / observable(body, omega0, 0.3) - 1.0)
            assert np.array_equal(dataset[name], change.max(axis=0))


@pytest.mark.parametrize("compression", [None, "lz4", "zstd"])
def test_compression_loses_nothing(store, rng, compression):
    omega0 = starts(rng, 20)
    dataset = ensemble(
        BODY, omega0, 0.2, 20, store=store, save_every=1, chunk=7, compression=compression
    )
    assert_same(dataset, iterate(BODY, omega0, 0.2, 20))


def test_what_another_run_left_is_refused(store, rng):
    omega0 = starts(rng, 10)
    asked = {"body": BODY, "omega0": omega0, "eps": 0.2, "steps": 20, "save_every": 2}
    ensemble(**asked, store=store)
    before = contents(store)
    others = {
        "body": Suslov3D(4, 1, -0.5, -0.31),
        "eps": -0.2,
        "omega0": omega0 + 1e-12,
        "save_every": None,
        "method": "ds2",
        "attitude": True,
        "reductions": ["omega_min"],
        "dims": "start",
        "steps": 19,
    }
    for name, value in others.items():
        with pytest.raises(ValueError, match=f"{name}"):
            ensemble(**{**asked, name: value}, store=store)
    assert contents(store) == before


def test_other_numerics_are_refused(store, rng, monkeypatch):
    omega0 = starts(rng, 10)
    ensemble(BODY, omega0, 0.2, 20, store=store)
    monkeypatch.setattr("suslov_fast.__version__", "0.0.1")
    with pytest.raises(ValueError, match=r"numerics suslov_fast .* instead of suslov_fast 0\.0\.1"):
        ensemble(BODY, omega0, 0.2, 20, store=store)


def test_what_is_no_store_is_left_alone(tmp_path, rng):
    omega0 = starts(rng, 10)
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "a.txt").write_text("mine")
    with pytest.raises(FileExistsError, match="got another folder"):
        ensemble(BODY, omega0, 0.2, 20, store=tmp_path / "notes")
    with pytest.raises(FileExistsError, match="got a file"):
        ensemble(BODY, omega0, 0.2, 20, store=tmp_path / "notes" / "a.txt")
    iterate(BODY, omega0, 0.2, 20).save(tmp_path / "saved.zarr")
    with pytest.raises(ValueError, match="that ensemble made"):
        ensemble(BODY, omega0, 0.2, 20, store=tmp_path / "saved.zarr")
    with pytest.raises(FileNotFoundError):
        open_ensemble(tmp_path / "none.zarr")
    assert (tmp_path / "notes" / "a.txt").read_text() == "mine"


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"steps": -1}, ValueError, "steps"),
        ({"eps": np.nan}, ValueError, "eps"),
        ({"omega0": [[np.inf, 0.0]]}, ValueError, "omega0"),
        ({"omega0": "starts.txt"}, ValueError, r"omega0.*\.npy"),
        ({"method": "gauss"}, ValueError, "method"),
        ({"save_every": 0}, ValueError, "save_every"),
        ({"chunk": 0}, ValueError, "chunk"),
        ({"chunk": {"time": 3}}, ValueError, "chunk.*time"),
        ({"chunk": "many"}, TypeError, "chunk"),
        ({"reductions": ["mean"]}, ValueError, "reductions.*mean"),
        ({"reductions": "omega_min"}, TypeError, "reductions"),
        ({"compression": "gzip"}, ValueError, "compression"),
        ({"dims": ("a", "b")}, ValueError, "dims"),
        ({"coords": {"trajectory": [1, 2]}}, ValueError, "coords"),
        ({"scheduler": 5}, TypeError, "scheduler"),
        ({"progress": 5}, TypeError, "progress"),
        ({"attitude": np.ones((3, 3))}, ValueError, "attitude"),
        ({"body": "rigid"}, TypeError, "body"),
    ],
)
def test_bad_arguments_leave_nothing_behind(store, change, error, message):
    asked = {"body": BODY, "omega0": [[1.0, 0.5]], "eps": 0.2, "steps": 3, "store": store}
    with pytest.raises(error, match=message):
        ensemble(**{**asked, **change})
    assert list(store.parent.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ((-1, 1.0), ValueError),
        ((2.5, 1.0), TypeError),
        ((3, 0.0), ValueError),
        ((3, [1.0]), ValueError),
        ((3, 1.0, -1), ValueError),
    ],
)
def test_random_starts_are_checked(arguments, error):
    with pytest.raises(error):
        RandomStarts(*arguments)


def chunk_files(store):
    return sorted(path for path in store.rglob("*") if path.is_file() and path.name != "zarr.json")


@pytest.mark.parametrize("harm", ["flip", "cut", "remove"])
def test_damage_is_found_and_made_good(store, rng, harm):
    omega0 = starts(rng, 20)
    settings = {"save_every": 2, "chunk": CUT, "attitude": True}
    ensemble(BODY, omega0, 0.2, 20, store=store, **settings)
    whole = contents(store)
    omega = [path for path in chunk_files(store) if "/omega/" in str(path)]
    results = [path for path in chunk_files(store) if "/progress/" not in str(path)]
    results = [path for path in results if path.parent.parent.name in ("omega", "attitude", "c")]
    damaged = [omega[0], *results[::5]]
    for path in damaged:
        data = bytearray(path.read_bytes())
        if harm == "remove":
            path.unlink()
            continue
        data[len(data) // 2] ^= 1
        path.write_bytes(data[: len(data) // 2] if harm == "cut" else data)
    if harm != "remove":
        with pytest.raises((ValueError, RuntimeError)):
            open_ensemble(store).omega.load()
    dataset = ensemble(BODY, omega0, 0.2, 20, store=store, verify=True, **settings)
    assert_same(dataset, iterate(BODY, omega0, 0.2, 20, save_every=2, attitude=True))
    assert contents(store) == whole


def test_nothing_is_computed_twice(store, rng, monkeypatch):
    from suslov_fast._ensemble import pieces

    made = []
    go_on = pieces.go_on
    monkeypatch.setattr(
        pieces, "go_on", lambda run: made.append((run.batch, run.start, run.steps)) or go_on(run)
    )
    omega0 = starts(rng, 20)
    ensemble(BODY, omega0, 0.2, 20, store=store, save_every=5, chunk=7)
    made.clear()
    ensemble(BODY, omega0, 0.2, 20, store=store, save_every=5)
    assert made == []
    ensemble(BODY, omega0, 0.2, 30, store=store, save_every=5)
    assert sorted(made) == sorted(
        (batch, start, min(start + 10, 30) if start >= 20 else 30) for batch, start, _ in made
    )
    assert min(start for _, start, _ in made) == 20


def test_one_writer_at_a_time(store, rng):
    omega0 = starts(rng, 20)
    refused = []

    def while_it_runs(done, total):
        try:
            ensemble(BODY, omega0, 0.2, 20, store=store)
        except BlockingIOError as error:
            refused.append(str(error))

    ensemble(BODY, omega0, 0.2, 20, store=store, progress=while_it_runs)
    assert refused
    assert "process" in refused[0]
    assert not os.path.exists(f"{store}.lock")


@pytest.mark.skipif(sys.platform == "win32", reason="no flock")
def test_another_process_is_kept_out_until_it_ends(store, rng):
    code = (
        "import sys\n"
        "from suslov_fast._ensemble.lock import only_writer\n"
        "with only_writer(sys.argv[1]):\n"
        "    print('held', flush=True)\n"
        "    sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(store)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout.readline() == b"held\n"
        with pytest.raises(BlockingIOError, match=f"process {holder.pid} on"):
            ensemble(BODY, [[1.0, 0.5]], 0.2, 3, store=store)
        holder.kill()
        holder.wait()
    ensemble(BODY, [[1.0, 0.5]], 0.2, 3, store=store)


@pytest.mark.parametrize("abreast", [1, 2])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_after_the_chunks_in_hand(store, rng, monkeypatch, number, abreast):
    monkeypatch.setattr("suslov_fast._ensemble.local._abreast", lambda job: abreast)
    omega0 = starts(rng, 50)
    asked = {"save_every": 2, "chunk": {"trajectory": 10, "n": 5}, "store": store}
    before = signal.getsignal(number)
    calls = []

    def ask(done, total):
        calls.append(done)
        if len(calls) == 9:  # a tile of four segments is finished by then, and some are not
            os.kill(os.getpid(), number)

    with pytest.raises(KeyboardInterrupt, match=r"of 5 tiles .*goes on"):
        ensemble(BODY, omega0, 0.2, 30, progress=ask, **asked)
    assert signal.getsignal(number) is before
    unfinished = xarray.open_zarr(store)
    missing = unfinished.status.values == -128
    assert missing.any()
    assert not missing.all()
    orbits = iterate(BODY, omega0, 0.2, 30, save_every=2)
    assert np.array_equal(unfinished.omega.values[:, ~missing], orbits.omega[:, ~missing])
    assert open_ensemble(store).attrs["tiles_done"] != "5 of 5"
    assert_same(ensemble(BODY, omega0, 0.2, 30, **asked), orbits)


def test_in_a_thread_signals_are_left_alone(store):
    failures = []

    def run():
        try:
            ensemble(BODY, [[1.0, 0.5]], 0.2, 3, store=store)
        except BaseException as error:
            failures.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert not failures


def test_stores_of_fsspec_and_of_zarr(rng):
    pytest.importorskip("fsspec")
    omega0 = starts(rng, 20)
    for store in ("memory://runs/a.zarr", zarr.storage.MemoryStore()):
        for steps in (20, 31):
            settings = {"save_every": 2, "chunk": CUT}
            dataset = ensemble(BODY, omega0, 0.2, steps, store=store, **settings)
            assert_same(dataset, iterate(BODY, omega0, 0.2, steps, save_every=2))
        with pytest.raises(ValueError, match="eps"):
            ensemble(BODY, omega0, 0.3, 31, store=store)


def test_the_bytes_do_not_depend_on_the_order(tmp_path, rng):
    """A store that was stopped and lengthened is that of one run."""
    omega0 = starts(rng, 20)
    stores = tmp_path / "a.zarr", tmp_path / "b.zarr"
    for steps in (11, 24, 40):
        ensemble(BODY, omega0, 0.2, steps, store=stores[0], save_every=2, chunk=CUT)
    ensemble(BODY, omega0, 0.2, 40, store=stores[1], save_every=2, chunk=CUT)
    one, other = map(contents, stores)
    metadata = [json.loads(each["zarr.json"])["attributes"] for each in (one, other)]
    assert metadata[0] == metadata[1]
    results = [
        {k: v for k, v in each.items() if not k.endswith("zarr.json") and k[:2] not in ("n/", "ti")}
        for each in (one, other)
    ]
    assert results[0] == results[1]


def test_progress_reaches_the_end(store, rng):
    seen = []
    ensemble(
        BODY,
        starts(rng, 20),
        0.2,
        20,
        store=store,
        chunk=7,
        progress=lambda done, total: seen.append((done, total)),
    )
    assert seen[0] == (0, 400)
    assert seen[-1] == (400, 400)
    assert seen == sorted(seen)


@pytest.mark.parametrize("name", ["dask", "zarr", "xarray"])
def test_what_is_not_installed_is_said(store, monkeypatch, name):
    monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "dask.array", raising=False)
    with pytest.raises(ImportError, match=r"suslov_fast\[large\]"):
        ensemble(BODY, [[1.0, 0.5]], 0.2, 3, store=store)


def test_a_full_disk_leaves_what_is_whole(store, rng, monkeypatch):
    """Each write may be the one that fails; the same call again finishes the run."""
    import errno

    from suslov_fast._ensemble import pieces

    omega0 = starts(rng, 20)
    settings = {"save_every": 2, "chunk": CUT}
    put = pieces.put
    for room in range(1, 30, 6):
        left = [room]

        def limited(*arguments, left=left):
            left[0] -= 1
            if left[0] < 0:
                raise OSError(errno.ENOSPC, "No space left on device")
            put(*arguments)

        monkeypatch.setattr(pieces, "put", limited)
        path = store.with_name(f"{room}.zarr")
        with pytest.raises(OSError, match="No space left"):
            ensemble(BODY, omega0, 0.2, 20, store=path, **settings)
        monkeypatch.setattr(pieces, "put", put)
        dataset = ensemble(BODY, omega0, 0.2, 20, store=path, **settings)
        assert_same(dataset, iterate(BODY, omega0, 0.2, 20, save_every=2))


@pytest.mark.parametrize("scheduler", ["threads", "synchronous"])
def test_functions_of_lazy_arrays(store, rng, scheduler):
    """What is stored can be worked on without being loaded."""
    import dask

    omega0 = starts(rng, 40)
    dataset = ensemble(BODY, omega0, 0.2, 20, store=store, save_every=5, chunk=7)
    with dask.config.set(scheduler=scheduler):
        F = xarray.apply_ufunc(
            lambda omega: first_integral(BODY, omega, 0.2),
            dataset.omega,
            input_core_dims=[["component"]],
            dask="parallelized",
            output_dtypes=[float],
        )
        ends = dataset.final.data.map_blocks(
            lambda omega: iterate(BODY, omega, 0.2, 30, save_every=None).final, dtype=float
        )
        assert np.array_equal(F, first_integral(BODY, dataset.omega.values, 0.2))
        further = iterate(BODY, dataset.final.values, 0.2, 30, save_every=None).final
        assert np.array_equal(ends.compute(), further)
