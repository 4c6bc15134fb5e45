"""Stored runs are those of `iterate`, bit for bit, however they are cut and gone on with."""

import os
import signal
import sys
import threading

import numpy as np
import pytest
from ensemble_runs import BODY, BODY_4D, CUT, assert_same, contents

from suslov_fast import (
    RandomStarts,
    Suslov3D,
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


@pytest.fixture
def store(tmp_path):
    return tmp_path / "run.zarr"


def starts(rng, *shape, D=2):
    return rng.uniform(-2.0, 2.0, (*shape, D))


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
    omega0[3], omega0[9] = np.nan, 1e308
    settings = {"save_every": save_every, "method": method, "attitude": attitude}
    dataset = ensemble(body, omega0, 0.3, 40, store=store, chunk=CUT, **settings)
    assert_same(dataset, iterate(body, omega0, 0.3, 40, on_singular="ignore", **settings))
    assert dataset.attrs["tiles_done"] == "3 of 3"
    # Longer by less than a chunk, and by more.
    for steps in (41, 73):
        dataset = ensemble(body, omega0, 0.3, steps, store=store, verify=steps == 73, **settings)
        assert_same(dataset, iterate(body, omega0, 0.3, steps, on_singular="ignore", **settings))


@pytest.mark.parametrize("chunk", [None, 5, {"eps": 1}, {"I13": 2, "start": 3, "n": 2}])
def test_parameters_are_axes_of_the_batch(store, rng, chunk):
    body = Suslov3D(4, 1, np.linspace(-0.5, 0.5, 3)[:, None], -0.3)
    eps = np.array([0.1, 0.5])[:, None, None]
    omega0 = starts(rng, 8)
    settings = {"save_every": 3, "dims": ("eps", "I13", "start"), "chunk": chunk}
    settings["coords"] = {"start": list("abcdefgh")}
    for steps in (20, 30):
        dataset = ensemble(body, omega0, eps, steps, store=store, **settings)
        orbits = iterate(body, omega0, eps, steps, save_every=3)
        assert_same(dataset, orbits)
    assert dataset.omega.dims == ("n", "eps", "I13", "start", "component")
    one = dataset.sel(eps=0.5, I13=0.0, start="c")
    assert np.array_equal(one.omega, orbits.omega[:, 1, 1, 2])
    assert np.array_equal(dataset.time.sel(eps=0.5), 0.5 * orbits.n)
    again = Trajectories.from_xarray(dataset)
    assert again.body == body
    assert np.array_equal(again.omega, orbits.omega)


@pytest.mark.parametrize(
    ("eps", "chunk", "settings"),
    [
        ([0.2], None, {}),
        ([[0.2], [0.3]], None, {}),
        (np.linspace(0.1, 0.3, 20), 7, {"save_every": None}),
        (0.2, {"n": 1}, {}),
        ([0.2], {"n": 1}, {"attitude": True, "method": "ds2"}),
    ],
)
def test_step_sizes_and_chunks_of_any_shape(store, rng, eps, chunk, settings):
    omega0 = starts(rng, 20)
    settings = {"save_every": 1, **settings}
    for steps in (10, 20):
        dataset = ensemble(BODY, omega0, eps, steps, store=store, chunk=chunk, **settings)
        assert_same(dataset, iterate(BODY, omega0, eps, steps, **settings))
    assert_same(xarray.open_zarr(store), iterate(BODY, omega0, eps, 20, **settings))


def test_one_row_may_fill_a_chunk(store, monkeypatch):
    monkeypatch.setattr("suslov_fast._ensemble.job._BYTES", 2**12)
    random = RandomStarts(70, 1.0)
    for steps in (3, 5):
        dataset = ensemble(BODY_4D, random, 0.2, steps, store=store, save_every=1, attitude=True)
        states = random.states(70, dimension=3)
        assert_same(dataset, iterate(BODY_4D, states, 0.2, steps, attitude=True))
    assert dataset.omega.chunks[0] == (1,) * 6


@pytest.mark.parametrize("method", ["auto", "canonical", "ds2"])
def test_failed_trajectories_are_whole(store, monkeypatch, method):
    from suslov_fast._ensemble import compute

    body = Suslov3D(1, 1, 1, 0)
    omega0 = [[1.0, -3.0], [1.0, 0.5], [np.nan, 0.0], [1e308, 1e308], [2.0, 3.0]]
    settings = {"save_every": 2, "method": method, "attitude": True, "store": store, "chunk": 3}
    for steps in (9, 20):
        ensemble(body, omega0, 1.0, steps, **settings)
    monkeypatch.setattr(compute, "go_on", None)
    dataset = ensemble(body, omega0, 1.0, 20, verify=True, **settings)
    assert dataset.failed_at.values.tolist() == [1, -1, 0, 1, -1]


@pytest.mark.parametrize("save_every", [None, 10**14])
def test_steps_of_the_closed_form_cost_nothing(store, monkeypatch, save_every):
    from suslov_fast._ensemble import compute

    made, go_on = [], compute.go_on
    monkeypatch.setattr(compute, "go_on", lambda run: made.append(run.start) or go_on(run))
    omega0 = [[1.0, 0.5], [0.3, -0.2]]
    dataset = ensemble(BODY, omega0, 0.2, 10**15, store=store, save_every=save_every)
    assert_same(dataset, iterate(BODY, omega0, 0.2, 10**15, save_every=save_every))
    assert len(made) < 20


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


@pytest.mark.parametrize("save_every", [None, 4])
@pytest.mark.parametrize("body", [BODY, BODY_4D])
def test_reductions(store, rng, body, save_every):
    omega0 = starts(rng, 20, D=body.dimension)
    names = ["modified_energy_drift", "energy_drift", "omega_min", "omega_max"]
    if body is BODY:
        names.append("first_integral_drift")
    for steps in (30, 50):
        settings = {"chunk": CUT, "reductions": names, "save_every": save_every}
        dataset = ensemble(body, omega0, 0.3, steps, store=store, **settings)
        orbits = iterate(body, omega0, 0.3, steps, save_every=save_every or 1)
        if save_every:
            assert_same(dataset, orbits)
        else:
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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_after_the_pieces_in_hand(store, rng, number):
    omega0 = starts(rng, 50)
    before = signal.getsignal(number)
    asked = {"save_every": 2, "chunk": {"trajectory": 10, "n": 5}, "store": store}
    for steps in (30, 60):  # of a new store, and of one that is lengthened
        calls = []

        def ask(done, total, calls=calls):
            calls.append(done)
            if len(calls) == 9:  # a tile is finished by then, and some are not
                os.kill(os.getpid(), number)

        with pytest.raises(KeyboardInterrupt, match=r"of 5 tiles .*goes on"):
            ensemble(BODY, omega0, 0.2, steps, progress=ask, **asked)
        assert signal.getsignal(number) is before
        unfinished = open_ensemble(store)
        missing = unfinished.status.values == -128
        assert missing.any()
        assert not missing.all()
        assert np.isnan(unfinished.final.values[missing]).all()
        assert unfinished.attrs["tiles_done"] == f"{5 - missing.sum() // 10} of 5"
        orbits = iterate(BODY, omega0, 0.2, steps, save_every=2)
        assert np.array_equal(unfinished.omega.values[:, ~missing], orbits.omega[:, ~missing])
        assert_same(ensemble(BODY, omega0, 0.2, steps, **asked), orbits)


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


@pytest.mark.parametrize("name", ["dask", "zarr", "xarray", "filelock"])
def test_what_is_not_installed_is_said(store, monkeypatch, name):
    monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "dask.array", raising=False)
    with pytest.raises(ImportError, match=r"suslov_fast\[large\]"):
        ensemble(BODY, [[1.0, 0.5]], 0.2, 3, store=store)


def test_workers_compute(store):
    from distributed import Client

    settings = {"save_every": 3, "method": "rank2", "chunk": CUT, "store": store}
    random = RandomStarts(50, 1.5)
    with Client(n_workers=1, processes=False, dashboard_address=None) as client:
        for omega0 in (random, random.states(50, dimension=3)):
            dataset = ensemble(BODY_4D, omega0, 0.2, 40, scheduler=client, **settings)
            states = random.states(50, dimension=3)
            assert_same(dataset, iterate(BODY_4D, states, 0.2, 40, save_every=3, method="rank2"))
            settings["store"] = store.with_name("other.zarr")
